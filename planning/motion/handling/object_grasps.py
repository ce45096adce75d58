"""The grasps that are sampled on an object where it stands; those on meshes are remembered in a frame of the object's own.

Which hands hold a mesh depends on how it stands, not on where, nor on its yaw: it is asked about at its *home*, as it would stand about the
world's vertical axis on a floor at height 0. What depends on the place is asked there: which grasps are natural, and which a wall is in the
way of.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import islice

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import APPROACHES, Body, Grasp, Scene
from kinematics.shapes import ConvexMesh, Cylinder, Shape, is_upright
from kinematics.transforms import Array, inverse, rotation_about, transform
from planning.grasping.cup_grasps import grasps_on
from planning.grasping.hand_poses import UP
from planning.grasping.sampling import USUAL, Headings, Sampling
from planning.motion.cell.arm import HALF_TURN, Arm, arm_at
from planning.verdict import closes_askew, judge_grasp, judge_hold
from planning.verdict.polyhedra import SIDES

HEADING_TRIES, SAME_HEADING = 8, 1e-4
MOST_PER_YAW = 10
"""So many grasps on a mesh are enough, for each closing direction that is sampled: the most natural ones."""
MOST_JUDGED = 400
"""So many grasps at most, the most natural ones, are judged for a thorough look where each has to be: a few seconds an object."""
HOME_DIGITS, ROUND_DIGITS = 9, 5  # a nanometre, and round what is round a hundredth of a millimetre: poses that differ by less are one
LEVEL = 0.5  # of a unit vector that is level enough for its bearing to say how a body is turned


def sampled_grasps(
    robot: Robot, scene: Scene, name: str, T: Array, *, approaches: Sequence[str] | None = None, sampling: Sampling = USUAL
) -> Iterator[Grasp]:
    """Grasps on an object at T (4, 4), the most natural first. approaches: the scene's by default.

    On a mesh, where pads may meet an edge, or the palm what is beside them, and of a hand of one's own whose pads are askew, those that the
    verdict accepts in the empty cabinet; on what is round such a hand's are accepted wherever the walls are, which a pick keeps clear of.
    """
    arm = arm_at(robot, scene.robot.T_world_base)
    to_body = T[:2, 3] - arm.pivot
    toward = float(np.arctan2(to_body[1], to_body[0]))
    kinds = [a for a in APPROACHES if a in (scene.approaches if approaches is None else approaches)]
    body, headings = replace(scene.body(name), T_world_body=T), headings_of(arm)
    floor_z = float(scene.cabinet.T_world_cabinet[2, 3])
    most = None if sampling is USUAL else MOST_JUDGED
    alone = replace(scene, objects=(body,), target=name, grasp=None, grasps=())
    if isinstance(body.shape, ConvexMesh):
        found = islice(_at_home(body, robot, kinds, floor_z, toward, sampling, headings), most)
        good = (grasp for grasp, holds in found if holds and judge_grasp(robot, alone, grasp, unseen=True) is None)
        return islice(good, sampling.yaws * MOST_PER_YAW)
    natural = grasps_on(body, robot, kinds, floor_z, toward, sampling, headings)
    if not _is_askew(robot):
        return natural
    natural = islice(natural, most)
    if isinstance(body.shape, Cylinder) and is_upright(body.T_world_body):
        return (grasp for grasp in natural if _holds_round(robot, body, floor_z, grasp))
    return (grasp for grasp in natural if judge_grasp(robot, alone, grasp) is None)


def _holds_round(robot: Robot, body: Body, floor_z: float, grasp: Grasp) -> bool:
    """Whether a hand holds an upright cylinder: asked once for all hands that are the same but for where round it they are.

    The verdict takes a cylinder for a prism, so it is asked about a hand before a face of it, and before an edge; where it does not say the
    same of both, it is asked about the hand itself.
    """
    T, middle = grasp.T_world_hand, body.T_world_body[:3, 3]
    looks = T[:2, 2] if np.hypot(*T[:2, 2]) > LEVEL else T[:2, 0]
    T_ahead = transform(rotation_about(UP, -float(np.arctan2(looks[1], looks[0])))) @ transform(p=[-middle[0], -middle[1], -floor_z]) @ T
    height = float(middle[2]) - floor_z
    known, key = _known(robot, body.shape, b""), (np.round([*T_ahead.flat, height], ROUND_DIGITS).tobytes(), round(grasp.width_m, 6))
    if key not in known:
        T_hand = Grasp(T_ahead, grasp.width_m)
        turns = (transform(rotation_about(UP, turn), [0.0, 0.0, height]) for turn in (0.0, np.pi / SIDES))
        holds = [judge_hold(robot, replace(body, T_world_body=T_turned), T_hand) is None for T_turned in turns]
        known[key] = holds[0] if holds[0] == holds[1] else None
    found = known[key]
    return judge_hold(robot, body, grasp) is None if found is None else found


def _at_home(
    body: Body, robot: Robot, kinds: Sequence[str], floor_z: float, toward: float, sampling: Sampling, headings: Headings | None
) -> Iterator[tuple[Grasp, bool]]:
    """The grasps on a body that is a mesh, found at its home, and whether each holds it; see `sampled_grasps`."""
    assert isinstance(body.shape, ConvexMesh)
    T_world_home, yaw = _home(body.T_world_body, floor_z)
    home = replace(body, T_world_body=np.round(inverse(T_world_home) @ body.T_world_body, HOME_DIGITS) + 0.0)
    known = _known(robot, body.shape, home.T_world_body.tobytes())

    def headings_home(T_home_middle: Array, width_m: float) -> list[Array]:
        assert headings is not None
        return [T_world_home[:3, :3].T @ R for R in headings(T_world_home @ T_home_middle, width_m)]

    for grasp in grasps_on(home, robot, kinds, 0.0, toward - yaw, sampling, headings and headings_home):
        key = (grasp.T_world_hand.tobytes(), grasp.width_m)
        if key not in known:
            known[key] = judge_hold(robot, home, grasp) is None
        yield Grasp(T_world_home @ grasp.T_world_hand, grasp.width_m), bool(known[key])


def _home(T_world_body: Array, floor_z: float) -> tuple[Array, float]:
    """The frame (4, 4) below a body, on the floor, that turns about the vertical with it, and its yaw."""
    axis = 0 if np.hypot(*T_world_body[:2, 0]) > LEVEL else 1
    yaw = float(np.arctan2(T_world_body[1, axis], T_world_body[0, axis]))
    return transform(rotation_about((0.0, 0.0, 1.0), yaw), [*T_world_body[:2, 3], floor_z]), yaw


@lru_cache(maxsize=64)
def _known(robot: Robot, shape: Shape, T_home_body: bytes) -> dict[tuple[bytes, float], bool | None]:
    """Which hands hold a body at its home, by their poses and widths, as far as they were asked about; None where it depends on more."""
    return {}


def can_be_exhaustive(robot: Robot, scene: Scene) -> bool:
    """Whether all grasps can be gone through, and cost little: on upright boxes and cans, where none has to be judged by itself."""
    return all(not isinstance(body.shape, ConvexMesh) and is_upright(body.T_world_body) for body in scene.objects) and not _is_askew(robot)


def _is_askew(robot: Robot) -> bool:
    """Whether the hand is one of one's own whose pads are askew."""
    return robot.grip is not None and closes_askew(robot)


def headings_of(arm: Arm) -> Headings | None:
    """How an arm of few joints can look at a place; None of one that can choose that."""
    if not arm.few_joints:
        return None

    def headings(T_world_middle: Array, width_m: float) -> list[Array]:
        T_hand_middle = transform(p=arm.robot.opening.middle(width_m))
        home, out = arm.robot.arm_q(arm.robot.home), list[Array]()
        for R in (T_world_middle[:3, :3], T_world_middle[:3, :3] @ HALF_TURN):
            T = transform(R, T_world_middle[:3, 3])
            turns = sorted((arm.turned(T_hand_middle, T, q) for q in arm.headed(T_hand_middle, T, home, HEADING_TRIES)), key=abs)
            apart = [turn for i, turn in enumerate(turns) if all(abs(turn - other) > SAME_HEADING for other in turns[:i])]
            out += [rotation_about((0.0, 0.0, 1.0), turn) @ R for turn in apart]
        return out

    return headings
