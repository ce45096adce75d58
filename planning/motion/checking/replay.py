"""Where everything is while motions follow one another, and how far each motion keeps from what it may not touch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.collision.clearance import Clearance, least_clearances
from kinematics.collision.stretches import PackedStretches, Stretch
from kinematics.robots.robot import Robot
from kinematics.scene import Scene
from kinematics.transforms import Array
from planning.motion.checking.sampled_motion import RESOLUTION_M, samples, while_fingers_move
from planning.plan import Motion


def replay(robot: Robot, scene: Scene, motions: Sequence[Motion]) -> Iterator[tuple[Motion, dict[str, Array]]]:
    """Each of the motions with the poses of the objects that stand while it lasts, from the scene's first state on: what a hand lets go of
    stays where it is then. Motions during which the same things stand are given the same poses, to be read."""
    poses, before = scene.poses(), None
    for motion in motions:
        if before is not None and before.held and (motion.held is None or motion.held.body != before.held.body):
            poses = {**poses, before.held.body: hand_poses(robot, scene, before.q[-1]) @ before.held.T_hand_body}
        if motion.held is not None and motion.held.body in poses:
            poses = {name: T for name, T in poses.items() if name != motion.held.body}
        yield motion, poses
        before = motion


@dataclass(frozen=True, eq=False)
class Replayed:
    """Motions in samples, packed for checks: a stretch each, or two where the fingers move for a part of the way alone.

    number (S,): whose motion each stretch is a part of. rows: of each motion, all its samples (N, J).
    """

    number: tuple[int, ...]
    rows: tuple[Array, ...]
    packed: PackedStretches


def replayed(robot: Robot, scene: Scene, motions: Sequence[Motion]) -> Replayed:
    """The motions from the scene's first state on, so densely sampled that no point moves further than RESOLUTION_M from row to row."""
    number, rows, stretches = list[int](), list[Array](), list[Stretch]()
    for n, (motion, poses) in enumerate(replay(robot, scene, motions)):
        rows.append(samples(robot, scene, motion))
        for some in while_fingers_move(robot, rows[-1]):
            number.append(n)
            stretches.append(Stretch(some, poses, motion.held, tuple(motion.allowed_contacts)))
    return Replayed(tuple(number), tuple(rows), PackedStretches(robot, scene, stretches))


def with_clearances(motions: Sequence[Motion], way: Replayed) -> tuple[Motion, ...]:
    """The same motions, each with the least distance that it keeps outside allowed contacts, and between which two bodies that is.

    way: the motions as `replayed` has them.
    """
    nearest: dict[int, Clearance] = {}
    for number, found in zip(way.number, least_clearances(way.packed, RESOLUTION_M)):
        if found is not None and (number not in nearest or found.distance_m < nearest[number].distance_m):
            nearest[number] = found
    return tuple(
        replace(motion, clearance_m=None, clearance_between=None)
        if (found := nearest.get(n)) is None
        else replace(motion, clearance_m=found.distance_m, clearance_between=found.between)
        for n, motion in enumerate(motions)
    )


def hand_poses(robot: Robot, scene: Scene, q: Array) -> Array:
    """T_world_hand (..., 4, 4) at full configurations q (..., J)."""
    return np.asarray(scene.robot.T_world_base @ robot.tree.link("hand", q))
