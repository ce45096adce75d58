"""When fingers close and open: a gripper is told apart from the arm, so it may be early or late by as much as a motion lasts.

So what is taken is closed on, and what is put down let go of, while the arm stands; and fingers that move beside the arm touch nothing
wherever on their way they are, all along. The clearance that is said of such a motion is for as long as they are meant to move.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from kinematics.quintic_spline import QuinticSpline
from planning.verdict.course import Course
from planning.verdict.faults import Fault
from planning.verdict.hand import Hand
from planning.verdict.ledger import Ledger

STILL = 1e-6  # rad or m, by which a joint that stands still may move
APART_M = 0.004  # by no more do the widths differ at which fingers that move beside the arm are looked at


def grip_faults(hand: Hand, courses: Sequence[Course], ledger: Ledger) -> list[Fault]:
    """What is held though nothing closed on it, or stands alone though nothing let go of it, the arm standing meanwhile."""
    out = list[Fault]()
    for carry in ledger.carries:
        before = next((c for c in reversed(courses[: carry.first]) if _moves(hand, c)), None)
        if before is None or arm_moves(hand, before) or not _widens(hand, before) < 0:
            detail = f"{courses[carry.first].where} holds {carry.body}, and no motion before it closes the hand on it while the arm stands"
            out.append(Fault("grasp", ("hand", carry.body), detail))
        after = next((c for c in courses[carry.last + 1 :] if _moves(hand, c)), None)
        if carry.put and (after is None or arm_moves(hand, after) or not _widens(hand, after) > 0):
            detail = f"{courses[carry.last].where} is the last to hold {carry.body}, and no motion then opens the hand while the arm stands"
            out.append(Fault("release", ("hand", carry.body), detail))
    return out


def any_opening(hand: Hand, course: Course) -> tuple[tuple[float, Course], ...]:
    """Where fingers move beside the arm: the same motion with the gripper's joint at one value all along, for values on its way, each in
    two parts: that in which it was to move, and the rest, of which no clearance is said; else nothing."""
    low, high = (float(x[hand.gripper]) for x in course.reach)
    if high - low <= STILL or not arm_moves(hand, course):
        return ()
    count = int(np.ceil(abs(_width(hand, high) - _width(hand, low)) / APART_M)) + 1
    at = course.q[:, hand.gripper]
    moving = np.flatnonzero(at != at[-1])
    end = int(moving[-1]) + 1 if len(moving) else len(at) - 1  # from there on they stay
    parts = [_part(course, 0, end)]
    if end < len(at) - 1:
        parts.append(replace(_part(course, end, len(at) - 1), clearance_m=None))
    values = np.linspace(low, high, max(2, count)).tolist()
    return tuple((value, _held_at(part, hand.gripper, value)) for value in values for part in parts)


def arm_moves(hand: Hand, course: Course) -> bool:
    """Whether any of the joints that carry the hand moves."""
    low, high = course.reach
    return bool((high - low)[list(hand.arm.driven_by(hand.carrier))].max() > STILL)


def _moves(hand: Hand, course: Course) -> bool:
    """Whether arm or fingers move."""
    low, high = course.reach
    return arm_moves(hand, course) or bool((high - low)[hand.gripper] > STILL)


def _widens(hand: Hand, course: Course) -> float:
    """By how much the hand is wider at a motion's end than at its beginning, in m."""
    return _width(hand, float(course.q[-1, hand.gripper])) - _width(hand, float(course.q[0, hand.gripper]))


def _width(hand: Hand, value: float) -> float:
    """The width of the hand, in m, at a value of its gripper's joint, by its table."""
    order = np.argsort(hand.values)
    return float(np.interp(value, hand.values[order], hand.widths[order]))


def _part(course: Course, first: int, last: int) -> Course:
    """A motion from one row to another."""
    spline, t_s = course.spline, course.t_s[first : last + 1]
    some = None if spline is None else QuinticSpline(t_s, spline.control[first:last])
    return replace(course, q=course.q[first : last + 1], t_s=t_s, spline=some)


def _held_at(course: Course, joint: int, value: float) -> Course:
    """A motion during which one joint stands still at a value."""
    q = course.q.copy()
    q[:, joint] = value
    if course.spline is None:
        return replace(course, q=q)
    control = course.spline.control.copy()
    control[..., joint] = value
    return replace(course, q=q, spline=QuinticSpline(course.spline.t_s, control))
