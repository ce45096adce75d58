"""Cans held by the very ends of the pads, or by a line beyond them: from where on do they leave the hand?

    pip install mujoco
    python benchmarks/edge_grasps.py [--robot ur5e] [-n 12] [--beyond-mm 0 1 2 3 5] [--friction 0.5] [--seed 0]

Each can stands alone in the cabinet of `paper` and is taken out by a level hand whose tips close on it (`tip`) and by one from above, by a
side of the pads (`side`); the line in which pads meet the can is so far beyond that edge, or inside it. What the verdict refuses
is counted and left out, and so is what the arm can't reach. One line of JSON of each edge and length, with how many stay in the hand.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import physics

from kinematics.robots.load import load, to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Grasp, Scene
from kinematics.shapes import Cylinder
from kinematics.transforms import Array, transform
from planning.grasping.hand_poses import level_hand
from planning.motion.pick_place import Motions
from planning.policies import make_policy
from planning.retrieval import retrieve
from planning.rules import Rule
from planning.scenes.generation import generate, load_spec
from planning.verdict import judge_grasp
from planning.verdict.grasp import closing_value
from planning.verdict.hand import hand_of, in_hand

EDGES = ("tip", "side")
TOP_M = 0.002  # how far below a can's upper end pads from above begin


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--robot", default="ur5e")
    parser.add_argument("-n", type=int, default=12, metavar="N", help="cans")
    parser.add_argument("--beyond-mm", type=float, nargs="+", default=[0.0, 1.0, 2.0, 3.0, 5.0])
    parser.add_argument("--friction", type=float, default=0.5)
    parser.add_argument("--force", type=float, default=40.0, help="newtons a pad")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    robot = load(asked.robot)
    settings = physics.Settings(friction=asked.friction, force_n=asked.force)
    found = {(edge, beyond): Counter[str]() for edge in EDGES for beyond in asked.beyond_mm}
    for n, room, can in cans(robot, asked.n, asked.seed):
        for (edge, beyond), count in found.items():
            count[outcome(robot, with_grasp(robot, room, can, edge, beyond / 1000), settings, asked.seed + n)] += 1
    for (edge, beyond), count in found.items():
        print(json.dumps({"edge": edge, "beyond_mm": beyond, **count, "friction": asked.friction, "robot": robot.name, "seed": asked.seed}))
    return 0


def cans(robot: Robot, count: int, seed: int) -> Iterator[tuple[int, Scene, Body]]:
    """Cans of many sizes at many places of one cabinet, which they have for themselves."""
    rng = np.random.default_rng(seed)
    room = generate(load_spec("paper"), robot, to_ref(robot), seed, 0)
    for n in range(count):
        radius, height = rng.uniform(0.02, 0.42 * robot.opening.max_m), rng.uniform(0.10, 0.20)
        place = transform(p=[rng.uniform(0.10, 0.25), rng.uniform(-0.2, 0.2), height / 2])
        yield n, room, Body("can", Cylinder(float(radius), float(height)), room.cabinet.T_world_cabinet @ place)


def with_grasp(robot: Robot, room: Scene, can: Body, edge: str, beyond_m: float) -> Scene:
    """The scene of one can whose line of contact lies so far beyond an edge of the pads."""
    assert isinstance(can.shape, Cylinder)
    width, at = 2 * can.shape.radius_m, can.T_world_body[:3, 3]
    low, high = face(robot, width)
    bearing = at - robot.base_p
    R = level_hand(np.array([*bearing[:2], 0.0]) / np.hypot(*bearing[:2]), 0.0 if edge == "tip" else np.pi / 2)
    middle = (low + high) / 2
    line = [middle[0], 0.0, high[2] + beyond_m] if edge == "tip" else [high[0] + beyond_m, 0.0, middle[2]]
    up = 0.0 if edge == "tip" else can.shape.height_m / 2 - (high[2] - low[2]) / 2 - TOP_M
    T_world_hand = transform(R, at + np.array([0.0, 0.0, up]) - R @ line)
    return replace(room, objects=(can,), target="can", grasp=Grasp(T_world_hand, width))


def face(robot: Robot, width_m: float) -> tuple[Array, Array]:
    """The lowest and the highest corner (3,) of a pad's face in the hand's frame, so far open."""
    hand = hand_of(robot)
    pad = hand.pads[0]
    T = in_hand(hand, closing_value(hand, width_m))[pad.carrier] @ pad.T_carrier_face
    corners = pad.window.corners @ T[:3, :2].T + T[:3, 3]
    return corners.min(0), corners.max(0)


def outcome(robot: Robot, scene: Scene, settings: physics.Settings, seed: int) -> str:
    if judge_grasp(robot, scene) is not None:
        return "refused"
    motions = Motions(robot, scene)
    plan = retrieve(scene, make_policy("local", motions), motions, name="local", rule=Rule.DEEP, rng=np.random.default_rng(seed))
    if not plan.success:
        return "unreachable"
    return "held" if physics.execute(robot, scene, plan, settings, np.random.default_rng(seed)).success else "lost"


if __name__ == "__main__":
    sys.exit(main())
