"""A robot's arm at one place: its collision model, with what inverse kinematics starts from, and its fingers on their way."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics import inverse
from kinematics.bounded_cache import evict_oldest
from kinematics.chain import Int, forward
from kinematics.collision.posed_geometry import PosedGeometry, join_posed, without_covers
from kinematics.collision.robot_model import OPENINGS, RobotCollisionModel, robot_collision_model
from kinematics.collision.sphere_model import SphereModel, posed_sphere_model
from kinematics.robots.robot import Robot
from kinematics.transforms import Array

FINGERS_AT = tuple(n / 6 for n in range(1, 7))  # shares of the fingers' way at which they are looked at: two millimetres apart or so
APART_M = 0.003  # where the arm moves meanwhile: they are looked at so often that no point of theirs moves further in between
MOST_OPENINGS = 12
FEW_JOINTS = 6
"""An arm with fewer joints can't choose where its hand looks: where it is, how steep it is and how it leans leave a heading or two."""
HALF_TURN = np.diag([-1.0, -1.0, 1.0])
"""About the hand's z: the fingers close along the same line, and x points the other way."""
PITCHES, STEP_RAD, LEAST_PITCH = 33, 1e-4, 0.01
"""At how many configurations, by how small steps, an arm is asked whether its hand can pitch; and from what singular value on it can."""
BENDS = 1.05  # a finger's point strays from where two openings have it by so much more than half of what lies between them


class AnyOpening(NamedTuple):
    """The arm with its fingers at several openings at once, for the compiled core.

    links: behind each part; pairs (S, 2): of parts that may not touch, no two of them at different openings. within_m: at any opening in
    between, no point of a finger is further than that from where one of these has it.
    """

    posed: PosedGeometry
    model: SphereModel
    links: tuple[str, ...]
    pairs: Int
    within_m: float


class Arm(RobotCollisionModel):
    """A robot at one place, with what inverse kinematics starts from.

    few_joints: whether it is one of fewer than six; backing: the chain, of such an arm with a free heading. redundant: whether it is one of
    more, whose solutions for a hand are whole lines.
    """

    def __init__(self, robot: Robot, T_world_base: Array) -> None:
        super().__init__(robot, T_world_base)
        self.few_joints, self.redundant = len(robot.arm_joints) < FEW_JOINTS, len(robot.arm_joints) > FEW_JOINTS
        self.backing = self.chain._replace(heading=0.0) if self.few_joints else self.chain
        known = robot_collision_model(robot, T_world_base)  # what the final check packs is what the planner has packed
        self._posed, self._packed = known._posed, known._packed
        self.seeds = inverse.make_seeds(self.chain, self.T_frame_hand)
        self.self_pairs: Int = robot.self_pairs
        by_fingers = np.isin(self.self_pairs, self.fingers).any(1)
        self._finger_pairs, self._own_pairs = self.self_pairs[by_fingers], self.self_pairs[~by_fingers]
        self._moving: dict[tuple[float, float], tuple[PosedGeometry, tuple[str, ...], Int, NDArray[np.bool_]]] = {}
        self._known_times: dict[int, tuple[tuple[str, ...], Int, NDArray[np.bool_]]] = {}
        self._any_opening: dict[tuple[float, float], AnyOpening | None] = {}

    def moving_fingers(self, opened: float, closed: float) -> tuple[PosedGeometry, tuple[str, ...], Int, NDArray[np.bool_]]:
        """The arm with its fingers at several gripper values on the way from `opened` to `closed` at once: without covers, its links, the
        pairs (S, 2) of them in which a finger takes part, and which of the links (P,) are fingers."""
        key = (opened, closed)
        if key not in self._moving:
            evict_oldest(self._moving, OPENINGS)
            values = [opened + share * (closed - opened) for share in FINGERS_AT]
            posed, links, pairs, moving = self._at_all(values if len(self.fingers) else values[-1:], covered=False)
            self._moving[key] = posed, links, pairs, moving
        return self._moving[key]

    def any_opening(self, first: float, last: float) -> AnyOpening | None:
        """The arm with its fingers anywhere between two gripper values; None where these are too far apart for that to pay."""
        key = (min(first, last), max(first, last))
        if key not in self._any_opening:
            evict_oldest(self._any_opening, OPENINGS)
            self._any_opening[key] = self._between(*key)
        return self._any_opening[key]

    def _between(self, first: float, last: float) -> AnyOpening | None:
        if not len(self.fingers):  # a suction cup
            posed, links, *_ = self._at_all([last])
            return AnyOpening(posed, posed_sphere_model(self.chain, posed), links, self.self_pairs, 0.0)
        fingers = self.posed_fingers(np.linspace(first, last, MOST_OPENINGS).tolist()).vertices.reshape(3, MOST_OPENINGS, -1)
        steps = np.linalg.norm(np.diff(fingers, axis=1), axis=0).max(1).tolist()
        parts = int(np.ceil(sum(steps) / APART_M))
        if parts >= MOST_OPENINGS:
            return None
        posed, links, pairs, _ = self._at_all(np.linspace(first, last, parts + 1).tolist())
        own = self._own_pairs
        within_m = BENDS / 2 * max(steps) * (MOST_OPENINGS - 1) / parts
        return AnyOpening(posed, posed_sphere_model(self.chain, posed), links, np.concatenate([own, pairs]), within_m)

    def _at_all(self, openings: Sequence[float], *, covered: bool = True) -> tuple[PosedGeometry, tuple[str, ...], Int, NDArray[np.bool_]]:
        """The arm with its fingers at several gripper values at once: the posed geometry, with the last of them first, and what `_times`
        says of it."""
        *others, last = openings
        posed = self.posed(last) if covered else without_covers(self.posed(last))
        if others:
            posed = join_posed(posed, self.posed_fingers(others, covered=covered))
        return posed, *self._times(len(others))

    def _times(self, more: int) -> tuple[tuple[str, ...], Int, NDArray[np.bool_]]:
        """The links, with the fingers so many times more, the pairs (S, 2) in which a finger takes part, and which of the links (P,) are
        fingers."""
        if more not in self._known_times:
            own, links, copies = self.fingers, self.links, np.arange(len(self.links))
            pairs = [self._finger_pairs]
            for _ in range(more):
                copies[own] = len(links) + np.arange(len(own))
                links += tuple(self.links[i] for i in own)
                pairs.append(copies[pairs[0]])
            self._known_times[more] = links, np.concatenate(pairs), np.isin(links, sorted(self.robot.fingers))
        return self._known_times[more]

    @cached_property
    def pivot(self) -> Array:
        """Where (2,) its first joint turns about the vertical, see `Robot.pivot`."""
        return self.robot.pivot(self.T_world_base)

    @cached_property
    def pitches(self) -> bool:
        """Whether the hand may look more or less steeply where it is: four joints and more move place and pitch apart, mostly, but not
        where one only rolls the hand, or all of them are upright."""
        least = []
        for q in self.seeds.q[:PITCHES]:
            at = self._place_and_pitch(q)
            moved = [(self._place_and_pitch(q + STEP_RAD * e) - at) / STEP_RAD for e in np.eye(len(q))]
            least.append(np.linalg.svd(np.array(moved), compute_uv=False)[3:].sum())
        return bool(np.median(least) > LEAST_PITCH)

    def _place_and_pitch(self, q: Array) -> Array:
        """Of the hand (4,), in m and by how much of its approach leads up."""
        T = self.hand_pose(q)
        return np.append(T[:3, 3], T[2, 2])

    def hand_pose(self, q: Array) -> Array:
        """T_world_hand (4, 4) at the arm's configuration q (A,)."""
        frames = np.empty((len(self.chain.q_index) + 1, 4, 4))
        forward(self.chain, q, frames)
        return np.asarray(frames[-1] @ self.T_frame_hand)

    def headed(self, T_hand_x: Array, T_world_x: Array, near: Array, tries: int) -> Array:
        """Configurations (S, A) of an arm of few joints that put x, which goes with the hand, at T_world_x (4, 4), but turned about the
        vertical as the arm has to; the nearest to near (A,) first."""
        return inverse.solve(self.backing, self.T_frame_hand @ T_hand_x, self.seeds, T_world_x, near, tries=tries)

    def turned(self, T_hand_x: Array, T_world_x: Array, q: Array) -> float:
        """How far x is turned about the vertical from T_world_x (4, 4) at an arm's configuration q (A,), rad."""
        R = (self.hand_pose(q) @ T_hand_x)[:3, :3] @ T_world_x[:3, :3].T
        return float(np.arctan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1]))


def arm_at(robot: Robot, T_world_base: Array) -> Arm:
    """The arm standing at T_world_base (4, 4), made once."""
    return _arm(robot, T_world_base.tobytes())


@lru_cache(maxsize=8)
def _arm(robot: Robot, base: bytes) -> Arm:
    return Arm(robot, np.frombuffer(base).reshape(4, 4))
