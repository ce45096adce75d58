"""Grasps x_g for a scene's target: proposed on its shape, or taken from elsewhere and checked; the best first.

A grasp is kept when the hand alone can hold the target with it in the empty cabinet (`planning.verdict.judge_grasp`) and the arm gets
there. Its score, from 0 to 1, has three parts: how squarely and how near to the middle the pads close, how far the arm stays from its joint
limits, and whether the way to it is free as things stand.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import APPROACHES, Body, Grasp, Scene
from kinematics.shapes import ConvexMesh, bounds
from kinematics.transforms import Array, inverse
from planning.grasping.antipodal import FRICTION_ANGLE
from planning.grasping.cup_grasps import grasps_on
from planning.grasping.line_contacts import stretch_at
from planning.motion.pick_place import Motions
from planning.upright import turned_grasp, turned_scene, upright_turn
from planning.verdict import judge_grasp

MOST_SAMPLED = 60
"""So many of the sampled grasps are looked at, the most natural first; on a mesh, where many may not hold, so many of those that do."""
SQUARE, REACH, FREE = 0.4, 0.3, 0.3
"""What the parts of a score weigh."""
OUT_OF_REACH, IN_A_WALL = "out of the arm's reach", "with the hand in a wall or an obstacle"
AHEAD_M = (0.0, 0.01, 0.02)
"""How far before the hand frame the pads' closing is looked at: they hold what is low by their ends."""
ALIKE_M, ALIKE_RAD = 0.0005, np.radians(0.5)
"""What differs by no more in place, width and direction is one grasp: heights that are clamped meet, and networks say things twice."""


@dataclass(frozen=True, eq=False)
class Proposals:
    """grasps: with their scores, the best first. dropped: how many were not kept, by the reason in words."""

    grasps: tuple[tuple[Grasp, float], ...]
    dropped: tuple[tuple[str, int], ...] = ()

    @property
    def beyond_reach(self) -> bool:
        """Whether some would hold the target, but the arm, or the hand among the walls, gets to none of them."""
        return not self.grasps and any(why in (OUT_OF_REACH, IN_A_WALL) for why, _ in self.dropped)

    def __str__(self) -> str:
        said = [f"{n} {why}" for why, n in self.dropped]
        n = len(self.grasps)
        return f"{n} grasp{'s' if n != 1 else ''}" + (f"; left out: {', '.join(said)}" if said else "")


def propose(robot: Robot, scene: Scene, *, most: int = 12) -> Proposals:
    """Antipodal grasps on the target's shape, from every side that the fingers can close on it, `most` of them at most.

    Raises: InputError for a scene without a target; ValueError when the robot can't stand there.
    """
    if (turn := upright_turn(scene)) is not None:  # the hand's ways are level, or down, by the cabinet that the target stands in
        found = propose(robot, turned_scene(scene, turn), most=most)
        return replace(found, grasps=tuple((turned_grasp(grasp, inverse(turn)), score) for grasp, score in found.grasps))
    target, base = scene.target_body, scene.robot.T_world_base[:3, 3]
    middle = np.sum(bounds(target.shape, target.T_world_body), axis=0) / 2
    toward = float(np.arctan2(middle[1] - base[1], middle[0] - base[0]))
    sampled = grasps_on(target, robot, APPROACHES, float(scene.cabinet.T_world_cabinet[2, 3]), toward)
    if isinstance(target.shape, ConvexMesh):
        return rank(robot, scene, sampled, most=most, enough=MOST_SAMPLED)
    return rank(robot, scene, islice(sampled, MOST_SAMPLED), most=most)


def rank(
    robot: Robot,
    scene: Scene,
    grasps: Iterable[Grasp],
    *,
    most: int = 12,
    quality: Sequence[float] | None = None,
    enough: int | None = None,
) -> Proposals:
    """The grasps that hold the target and are in reach, each once, the best first. quality: of each, from 0 to 1; by default measured on
    the shape. enough: after so many that hold the target no more are looked at."""
    target = scene.target_body
    scene = replace(scene, robot=replace(scene.robot, payload_kg=None))  # where the hand gets to, whatever the target weighs
    alone = Motions(robot, replace(scene, objects=(target,)), target_grasps=())
    among = Motions(robot, scene, target_grasps=())
    begin, crowded = alone.start(), among.start()
    kept, dropped, held, seen = list[tuple[Grasp, float]](), Counter[str](), 0, list[Grasp]()
    for i, grasp in enumerate(grasps):
        if any(_alike(grasp, other) for other in seen):
            continue
        seen.append(grasp)
        wrong = judge_grasp(robot, scene, grasp)
        if wrong is not None:
            dropped[_in_short(wrong)] += 1
            continue
        held += 1
        if enough is not None and held > enough:
            break
        start = replace(begin)  # a state of its own: what was found for one grasp is not what is found for another
        picks, _ = alone.picks(start, target.name, [grasp])
        if not picks:
            dropped[OUT_OF_REACH] += 1
            continue
        free = bool(among.picks(replace(crowded), target.name, [grasp])[0])
        square = squareness(target, grasp, cup=bool(robot.opening.cup_m)) if quality is None else quality[i]
        kept.append((grasp, SQUARE * square + REACH * _room(robot, picks[0].approach) + FREE * free))
    kept.sort(key=lambda pair: -pair[1])
    return Proposals(tuple((grasp, round(score, 4)) for grasp, score in kept[:most]), tuple(dropped.most_common()))


def with_grasps(scene: Scene, proposals: Proposals) -> Scene:
    """The scene with the best of the grasps as x_g, and the others as its alternatives. Raises: ValueError when there is none."""
    if not proposals.grasps:
        raise ValueError(f"scene {scene.id}: no grasp of {scene.target_name} can be used: {proposals}")
    (best, _), *others = proposals.grasps
    return replace(scene, grasp=best, grasps=tuple(others))


def squareness(target: Body, grasp: Grasp, *, cup: bool = False) -> float:
    """How well the pads close on a shape, or a cup lies on it, from 0 to 1: how square its surface is to them, and how near its middle they
    are."""
    T, closing = grasp.T_world_hand, grasp.T_world_hand[:3, 2 if cup else 1]
    lines = (T[:3, 3] + ahead * T[:3, 2] for ahead in AHEAD_M)
    hit = next((h for p in lines if (h := stretch_at(target.shape, target.T_world_body, p, closing)) is not None), None)
    if hit is None:
        return 0.0
    off = np.arccos(np.clip(-hit.enter_normal @ closing if cup else min(-hit.enter_normal @ closing, hit.leave_normal @ closing), -1, 1))
    low, high = bounds(target.shape, target.T_world_body)
    away = np.linalg.norm(np.cross((low + high) / 2 - T[:3, 3], closing)) / (np.linalg.norm(high - low) / 2)
    return float(max(0.0, 1 - off / (2 * FRICTION_ANGLE)) * max(0.0, 1 - away))


def _alike(a: Grasp, b: Grasp) -> bool:
    """Whether two grasps are one and the same for an arm."""
    T, U = a.T_world_hand, b.T_world_hand
    if abs(a.width_m - b.width_m) > ALIKE_M or float(np.linalg.norm(T[:3, 3] - U[:3, 3])) > ALIKE_M:
        return False
    return bool(np.linalg.norm(T[:3, :3] - U[:3, :3]) <= 2 * np.sqrt(2) * np.sin(ALIKE_RAD / 2))


def _room(robot: Robot, approach: Array) -> float:
    """How far the arm stays from its joint limits along an approach (K, A), as a share: 1 in the middle, 0 at a limit."""
    arm = list(robot.arm_joints)
    low, high = robot.lower[arm], robot.upper[arm]
    finite = np.isfinite(low) & np.isfinite(high)
    if not finite.any():
        return 1.0
    half = (high[finite] - low[finite]) / 2
    away = np.minimum(approach[:, finite] - low[finite], high[finite] - approach[:, finite]) / half
    return float(np.clip(away.min(), 0.0, 1.0))


def _in_short(wrong: str) -> str:
    """A judge's complaint as a kind, without its figures."""
    for words, kind in (
        ("the gripper opens", "too wide for the gripper"),
        ("the gripper closes", "too narrow for the gripper"),
        ("would touch the target", "with a part of the hand in the target"),
        ("does not hold", "that don't hold the target"),
        ("can't be reached", IN_A_WALL),
    ):
        if words in wrong:
            return kind
    return "that are invalid"
