"""Who is where while a plan runs: what the hand takes, carries and puts down, and whether the plan says the same."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from kinematics.robots.plain_urdf import poses
from kinematics.scene import Scene
from kinematics.transforms import Array, angle_between
from planning.verdict.course import Course
from planning.verdict.faults import Fault, Settings
from planning.verdict.hand import Hand

FINGERS_M = 1e-4  # by how much the pads may move while they hold something


@dataclass(frozen=True, eq=False)
class Carry:
    """One object in the hand, from course `first` up to and with course `last`: its poses T (4, 4) before and after, where it is in the
    hand, the hand's pose and the configuration when it is taken. put: whether the hand lets go of it within the plan."""

    body: str
    first: int
    last: int
    T_world_from: Array
    T_world_to: Array
    T_hand_body: Array
    T_world_hand: Array
    q: Array
    put: bool


@dataclass(eq=False)
class _Book:
    """What is being written: poses of what stands, and the object in the hand since some course."""

    poses: dict[str, Array]
    carries: list[Carry] = field(default_factory=list)
    standing: list[Mapping[str, Array]] = field(default_factory=list)
    faults: list[Fault] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Ledger:
    """carries: in order; standing: for each course, poses of the objects that stand during it; faults: where the motions contradict
    themselves. poses: of all objects at the end."""

    carries: tuple[Carry, ...]
    standing: tuple[Mapping[str, Array], ...]
    poses: Mapping[str, Array]
    faults: tuple[Fault, ...]


def hand_poses(hand: Hand, q: Array, T_world_base: Array) -> Array:
    """T_world_hand (N, 4, 4) at configurations q (N, J)."""
    return np.asarray(poses(hand.arm, q, T_world_base, frozenset({hand.carrier}))[hand.carrier] @ hand.T_carrier_hand)


def keep(hand: Hand, scene: Scene, courses: Sequence[Course], settings: Settings) -> Ledger:
    """Follow the objects through the courses. It ends early where a body that does not exist is held."""
    book = _Book(dict(scene.poses()))
    if not courses:
        return Ledger((), (), book.poses, ())
    T_hand = hand_poses(hand, np.concatenate([c.q[[0, -1]] for c in courses]), scene.robot.T_world_base).reshape(-1, 2, 4, 4)
    open_: Carry | None = None
    for i, course in enumerate(courses):
        held = course.held
        if held is not None and held.body not in book.poses:
            book.faults.append(Fault(course.stage, (held.body,), f"{course.where} holds {held.body!r}, which is not in the scene"))
            break
        if open_ is not None and (held is None or held.body != open_.body):
            book.carries.append(_closed(open_, i - 1, book.poses, True))
            open_ = None
        if held is not None:
            T_start = T_hand[i, 0] @ held.T_hand_body
            if open_ is None:
                _same(book, course, "is not where the hand takes it", book.poses[held.body], T_start, settings)
                open_ = Carry(held.body, i, i, book.poses[held.body], T_start, held.T_hand_body, T_hand[i, 0], course.q[0], False)
            _same(book, course, "does not keep its pose in the hand", open_.T_hand_body, held.T_hand_body, settings)
            _fingers(book, hand, course, open_)
            book.poses[held.body] = T_hand[i, 1] @ held.T_hand_body
        book.standing.append({name: T for name, T in book.poses.items() if held is None or name != held.body})
    if open_ is not None:
        book.carries.append(_closed(open_, len(book.standing) - 1, book.poses, False))
    return Ledger(tuple(book.carries), tuple(book.standing), book.poses, tuple(book.faults))


def _closed(carry: Carry, last: int, at: Mapping[str, Array], put: bool) -> Carry:
    return Carry(
        carry.body, carry.first, last, carry.T_world_from, at[carry.body], carry.T_hand_body, carry.T_world_hand, carry.q, put
    )  # fmt: skip


def _same(book: _Book, course: Course, otherwise: str, A: Array, B: Array, settings: Settings) -> None:
    """Two poses (4, 4) of the held object are the same, or it is a fault."""
    far, turned = difference(A, B)
    if not (far <= settings.pose_m and turned <= settings.pose_rad):
        assert course.held is not None
        detail = f"{course.where}: {course.held.body} {otherwise}: {1000 * far:.1f} mm and {np.degrees(turned):.1f}° off"
        book.faults.append(Fault(course.stage, ("hand", course.held.body), detail, far))


def _fingers(book: _Book, hand: Hand, course: Course, carry: Carry) -> None:
    """The fingers stay as they closed."""
    low, high = (float(x[hand.gripper]) for x in course.reach)
    closed, span = float(carry.q[hand.gripper]), float(np.ptp(hand.values))
    metres = max(closed - low, high - closed) / span * hand.max_width_m
    if metres > FINGERS_M:
        detail = f"{course.where}: the fingers move by {1000 * metres:.1f} mm while they hold {carry.body}"
        book.faults.append(Fault(course.stage, (carry.body,), detail, metres))


def difference(A: Array, B: Array) -> tuple[float, float]:
    """Distance in m and angle in rad between two poses (4, 4)."""
    D = B - A
    if np.abs(D).max() < 1e-12:
        return 0.0, 0.0
    return float(np.linalg.norm(D[:3, 3])), float(angle_between(A[:3, :3], B[:3, :3]))
