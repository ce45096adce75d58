"""Grasps of real plans and scenes, spoilt at random: does the verdict tell those that hold from those that don't?

Half of the edits change a scene's x_g (`judge_grasp` is asked), half a plan and its scene together, so that all else stays consistent
(`judge` is asked, all but contacts). Kinds: miss, too wide, too deep, rotated; sizes from a hundredth of a millimetre on. The truth is
tests/sampled_hold.py's: pinocchio and points on surfaces, nothing of ours. Edits of which it says neither are left out and counted.

Usage: python benchmarks/verdict_edits.py [-n 500] [--seed 0] [--robots ur5e panda gen3] [--plans 12]
prints what is wrongly verified or refused as it is found, and one JSON line of totals at last. Exit 1 if there is any.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import sampled_hold as truth

from kinematics.robots.load import load, to_ref
from kinematics.robots.named import installed
from kinematics.robots.robot import Robot
from kinematics.scene import Grasp, Scene
from kinematics.shapes import Box, bounds
from kinematics.transforms import Array, inverse, rotation_about, transform
from planning.io.scene_documents import scene_to_json
from planning.motion.pick_place import Motions
from planning.plan import Plan
from planning.policies import make_policy
from planning.retrieval import retrieve
from planning.rules import Rule
from planning.scenes.generation import generate, load_spec
from planning.verdict import Settings, judge, judge_grasp

KINDS = ("miss", "wide", "deep", "rotated")
LEAST_M, MOST_M = {"miss": 1e-4, "wide": 1e-5, "deep": 1e-5}, {"miss": 0.2, "wide": 0.03, "deep": 0.03}


@dataclass(frozen=True, eq=False)
class Subject:
    """A robot, a scene, and a plan for it that holds."""

    robot: Robot
    scene: Scene
    plan: Plan


@dataclass(frozen=True, eq=False)
class Edit:
    """What was done, what the verdict says of it (None: it holds), and the truth."""

    what: str
    said: str | None
    true: str


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=500, metavar="N", help="edits of each sort, those that hold and those that don't")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--robots", nargs="+", default=["ur5e", "panda", "gen3"])
    parser.add_argument("--plans", type=int, default=12, help="plans of each robot that are spoilt")
    args = parser.parse_args()
    subjects = [s for name in args.robots if installed(name) for s in planned(load(name), args.seed, args.plans)]
    rng, total, wrong, kinds = np.random.default_rng([args.seed, 1]), Counter[str](), Counter[str](), Counter[str]()
    while min(total[truth.HOLDS], total[truth.FAILS]) < args.n:
        kind = KINDS[rng.integers(len(KINDS))]
        subject = subjects[rng.integers(len(subjects))]
        found = edit_grasp(subject, kind, rng) if rng.random() < 0.5 else edit_plan(subject, kind, rng)
        if total[found.true] >= args.n and found.true != truth.UNDECIDED:
            continue
        total[found.true] += 1
        kinds[f"{kind} {found.true}"] += 1
        if found.true != truth.UNDECIDED and (found.true == truth.HOLDS) != (found.said is None):
            wrong["wrongly_verified" if found.said is None else "wrongly_refused"] += 1
            where = f"{subject.robot.name} {subject.scene.id} {kind}"
            print(f"{where}: {found.what}: it {found.true}, and the verdict says {found.said}", flush=True)
    out = {"plans": len(subjects), **total, "wrongly_verified": wrong["wrongly_verified"], "wrongly_refused": wrong["wrongly_refused"]}
    print(json.dumps({**out, "kinds": dict(sorted(kinds.items())), "seed": args.seed}))
    return int(sum(wrong.values()) > 0)


def planned(robot: Robot, seed: int, count: int) -> Iterator[Subject]:
    """So many scenes of both specs by turns, with plans that succeed."""
    ref, index = to_ref(robot), 0
    while count:
        scene = generate(load_spec(("paper", "paper-any")[index % 2]), robot, ref, seed, index)
        motions = Motions(robot, scene)
        rng = np.random.default_rng([seed, index])
        plan = retrieve(scene, make_policy("local", motions), motions, name="local", rule=Rule.DEEP, rng=rng)
        index += 1
        if plan.success:
            count -= 1
            yield Subject(robot, scene, plan)


def size(kind: str, rng: np.random.Generator) -> float:
    """How much to change, in m: all magnitudes alike."""
    return float(np.exp(rng.uniform(np.log(LEAST_M[kind]), np.log(MOST_M[kind]))))


# ---------------------------------------------------------------------------------------------------------------- a scene's grasp


def edit_grasp(s: Subject, kind: str, rng: np.random.Generator) -> Edit:
    """The scene with another x_g."""
    T, width = s.scene.grasp.T_world_hand, s.scene.grasp.width_m
    if kind in ("wide", "deep") and rng.random() < 0.7:
        width = max(0.0, width + size(kind, rng) * (1 if kind == "wide" else -1))
    elif kind == "deep":
        T = T @ transform(p=[0.0, 0.0, size("miss", rng)])  # deeper in along the approach
    elif kind == "rotated":
        axis = np.eye(3)[rng.integers(3)] if rng.random() < 0.7 else rng.normal(size=3)
        T = T @ transform(rotation_about(axis, float(rng.uniform(-np.pi, np.pi) * rng.random() ** 2)))
    else:
        way = rng.normal(size=3)
        if rng.random() < 0.5:
            way[1] = 0.0  # along the pads, where there is room
        T = T @ transform(p=size("miss", rng) * way / np.linalg.norm(way))
    scene = replace(s.scene, grasp=Grasp(T, width))
    off = np.linalg.norm(T[:3, 3] - s.scene.grasp.T_world_hand[:3, 3])
    return Edit(f"x_g {1000 * off:.2f} mm away, {1000 * width:.2f} mm wide", judge_grasp(s.robot, scene), true_grasp(s.robot, scene))


def true_grasp(robot: Robot, scene: Scene) -> str:
    hand = truth.gripper(robot.urdf, robot.joint_names[robot.gripper_joint])
    if scene.grasp.width_m > robot.opening.max_m + 2e-4 + truth.GAP_M:
        return truth.FAILS
    value = true_value(hand, scene.grasp.width_m)
    hulls = hand.hulls(value)
    T_hand_world = inverse(scene.grasp.T_world_hand)
    shape = shape_of(scene, scene.target)
    held = truth.hold(shape, T_hand_world @ scene.body(scene.target).T_world_body, hulls)
    walls = [(np.asarray(w.shape.size_m) / 2, T_hand_world @ w.T_world_body) for w in scene.cabinet.walls() if isinstance(w.shape, Box)]
    said = {held, truth.in_walls(hulls, walls)}
    return truth.FAILS if truth.FAILS in said else truth.UNDECIDED if truth.UNDECIDED in said else truth.HOLDS


def true_value(hand: truth.Gripper, width_m: float) -> float:
    """The gripper's value at which the pads are so far apart, by bisection."""
    low, high = hand.low, hand.high
    widest = hand.width(high) > hand.width(low)
    for _ in range(40):
        middle = (low + high) / 2
        if (hand.width(middle) < width_m) == widest:
            low = middle
        else:
            high = middle
    return (low + high) / 2


def shape_of(scene: Scene, name: str) -> truth.Json:
    return next(o["shape"] for o in scene_to_json(scene)["objects"] if o["name"] == name)


# ---------------------------------------------------------------------------------------------------------------- a plan


def edit_plan(s: Subject, kind: str, rng: np.random.Generator) -> Edit:
    """The plan and its scene with one object taken otherwise: the fingers closed to another width, or the object elsewhere on the floor."""
    names = [n for n in dict.fromkeys(m.held.body for m in s.plan.motions if m.held) if takes(s.plan, n) == 1]
    name = names[rng.integers(len(names))]
    if kind in ("wide", "deep"):
        change = size(kind, rng) * (1 if kind == "wide" else -1)
        scene, plan, what = s.scene, closed_otherwise(s, name, change), f"{name} gripped {1000 * change:.2f} mm wider"
    else:
        D, what = elsewhere(s, name, kind, rng)
        scene, plan = stood_otherwise(s, name, D)
    # what is about the arm alone is another matter: fingers that close to another width may go beyond their limits on the way
    faults = [f for f in judge(scene, plan, s.robot, Settings(contact=False)) if f.bodies]
    hand = truth.gripper(s.robot.urdf, s.robot.joint_names[s.robot.gripper_joint])
    motion = next(m for m in plan.motions if m.held and m.held.body == name)
    assert motion.held is not None
    hulls = hand.hulls(float(motion.q[0, motion.joint_names.index(hand.joint)]))
    true = truth.hold(shape_of(scene, name), motion.held.T_hand_body, hulls, whole_hand=False)
    return Edit(what, str(faults[0]) if faults else None, true)


def takes(plan: Plan, name: str) -> int:
    """How often the hand takes an object."""
    held = [m.held.body if m.held else None for m in plan.motions]
    return sum(now == name and before != name for now, before in zip(held, [None, *held]))


def closed_otherwise(s: Subject, name: str, change_m: float) -> Plan:
    """The fingers, where they hold the object, are closed to another width; within what their joint can do."""
    j, opening = s.robot.gripper_joint, s.robot.opening
    first = next(m for m in s.plan.motions if m.held and m.held.body == name)
    closed = float(first.q[0, j])
    rising = slice(None) if opening.value[0] < opening.value[-1] else slice(None, None, -1)
    width = float(np.interp(closed, opening.value[rising], opening.width_m[rising]))
    value = opening.value_at(min(max(width + change_m, float(opening.width_m[0])), opening.max_m))
    motions = list(s.plan.motions)
    numbers = [i for i, m in enumerate(motions) if m.held and m.held.body == name]
    for i in range(numbers[0] - 1, min(numbers[-1] + 2, len(motions))):
        q = motions[i].q.copy()
        own = np.abs(q[:, j] - closed) < 1e-9
        q[own, j] = value
        motions[i] = replace(motions[i], q=q, t_s=motions[i].t_s * 3)  # never faster than before
    return replace(s.plan, motions=tuple(motions))


def elsewhere(s: Subject, name: str, kind: str, rng: np.random.Generator) -> tuple[Array, str]:
    """A motion on the floor (4, 4), in the world, about the object's place."""
    at = s.scene.body(name).T_world_body[:3, 3]
    if kind == "rotated":
        angle = float(rng.uniform(-np.pi, np.pi) * rng.random() ** 2)
        D = transform(p=at) @ transform(rotation_about((0.0, 0.0, 1.0), angle)) @ transform(p=-at)
        return D, f"{name} turned by {np.degrees(angle):.1f}°"
    yaw, far = rng.uniform(-np.pi, np.pi), size("miss", rng)
    if rng.random() < 0.5:  # along the approach, where there is room
        T_hand_body = next(m.held.T_hand_body for m in s.plan.motions if m.held and m.held.body == name)
        T_hand = s.scene.body(name).T_world_body @ inverse(T_hand_body)
        yaw = float(np.arctan2(T_hand[1, 2], T_hand[0, 2])) + (np.pi if rng.random() < 0.5 else 0.0)
    return transform(p=[far * np.cos(yaw), far * np.sin(yaw), 0.0]), f"{name} moved by {1000 * far:.2f} mm"


def stood_otherwise(s: Subject, name: str, D: Array) -> tuple[Scene, Plan]:
    """The object stands elsewhere, the hand moves as before: it is held otherwise, and put down otherwise, and the plan says so."""
    scene = replace(s.scene, objects=tuple(replace(b, T_world_body=D @ b.T_world_body) if b.name == name else b for b in s.scene.objects))
    held = next(m.held for m in s.plan.motions if m.held and m.held.body == name)
    T_hand = s.scene.body(name).T_world_body @ inverse(held.T_hand_body)
    now = replace(held, T_hand_body=inverse(T_hand) @ scene.body(name).T_world_body)
    motions = tuple(replace(m, held=now) if m.held and m.held.body == name else m for m in s.plan.motions)
    moves = []
    for move in s.plan.moves:
        if move.object == name and move.done:
            T_put = move.T_world_to @ inverse(held.T_hand_body) @ now.T_hand_body
            move = replace(move, T_world_from=scene.body(name).T_world_body, T_world_to=T_put, region=region_of(scene, name, T_put))
        moves.append(move)
    base = scene.robot.T_world_base[:3, 3]
    ends = [(m.T_world_from[:3, 3], m.T_world_to[:3, 3]) for m in moves if m.done]
    value = float(s.plan.success) - sum(float(np.linalg.norm(a - base) + np.linalg.norm(b - a)) for a, b in ends)
    return scene, replace(s.plan, motions=motions, moves=tuple(moves), value=value)


def region_of(scene: Scene, name: str, T: Array) -> int:
    middle = np.mean(bounds(scene.body(name).shape, inverse(scene.cabinet.T_world_cabinet) @ T), axis=0)
    depth, width, _ = scene.cabinet.size_m
    n = scene.regions_n
    row, column = np.clip([middle[0] / depth * n, (middle[1] + width / 2) / width * n], 0, n - 1).astype(int)
    return int(row * n + column)


if __name__ == "__main__":
    sys.exit(main())
