"""What a robot's joints can do: positions and their rates up to jerk, motions that follow one another without a gap, rest between them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kinematics.quintic_spline import DEGREE, coefficients, extremes
from kinematics.robots.plain_urdf import Arm
from kinematics.transforms import Array
from planning.plan import JOINED, jump
from planning.verdict.course import Course
from planning.verdict.faults import Fault

POSITION = 1e-6  # rad or m, by which files may round
THIRD = DEGREE * (DEGREE - 1) * (DEGREE - 2)
RATE = 1e-4  # of a limit, by which a rate may be above it; and the rate, in rad/s or rad/s², that still is rest


def limit_faults(arm: Arm, courses: Sequence[Course], acceleration: Array, jerk: Array) -> list[Fault]:
    """What the joints can't do, the worst joint of each motion; acceleration, jerk (J,): limits in rad/s² or m/s², rad/s³ or m/s³."""
    out: list[Fault] = []
    for n in np.flatnonzero(_doubtful(arm, courses, acceleration, jerk)).tolist():
        course = courses[n]
        out += _positions(arm, course)
        if n > 0:
            jumped = jump(courses[n - 1].q[-1], course.q[0])
            if jumped is not None:
                worst, far = jumped
                out.append(_fault(course, f"starts {far:.3g} {arm.units[worst]} from where {arm.joints[worst]} ended before", far))
        out += _rates(arm, course, acceleration, jerk)
    return out


def jerk_notes(arm: Arm, courses: Sequence[Course], jerk: Array) -> list[Fault]:
    """The spike of jerk that is furthest above what is assumed of a joint, where one is; jerk (J,): rad/s³ or m/s³, infinite where a
    limit is known. No fault, since nobody says what the joint takes."""
    splines = [course for course in courses if course.spline is not None]
    over = np.array([_jerks(course) / jerk for course in splines]).reshape(-1, len(jerk))
    if not (over > 1 + RATE).any():
        return []
    n, worst = (int(k) for k in np.unravel_index(np.argmax(over), over.shape))
    reached, unit = over[n, worst] * jerk[worst], f"{arm.units[worst]}/s³"
    words = f"{arm.joints[worst]} reaches {reached:.3g} {unit}; nobody says the limit of its jerk, and {jerk[worst]:.3g} {unit} are assumed"
    return [_fault(splines[n], words, reached)]


def _doubtful(arm: Arm, courses: Sequence[Course], acceleration: Array, jerk: Array) -> NDArray[np.bool_]:
    """Which courses (C,) deserve a closer look: all but those splines whose Bernstein coefficients, between which they stay, keep all
    limits, and that begin where the one before ends, and rest at both ends."""
    doubtful = np.array([course.spline is None for course in courses])
    smooth = np.flatnonzero(~doubtful)
    if not len(smooth):
        return doubtful
    splines = [spline for n in smooth.tolist() if (spline := courses[n].spline) is not None]
    pieces = np.cumsum([0, *(len(spline.control) for spline in splines)])
    control, h = np.concatenate([spline.control for spline in splines]), np.concatenate([np.diff(spline.t_s) for spline in splines])
    way = np.diff(control, axis=1)
    speed = DEGREE / h[:, None, None] * way
    rate = DEGREE * (DEGREE - 1) / h[:, None, None] ** 2 * np.diff(way, axis=1)
    change = THIRD / h[:, None, None] ** 3 * np.diff(way, 2, axis=1)
    beyond = (control > arm.upper).any((1, 2)) | (control < arm.lower).any((1, 2))
    beyond |= (np.abs(speed) > arm.velocity).any((1, 2)) | (np.abs(rate) > acceleration).any((1, 2)) | (np.abs(change) > jerk).any((1, 2))
    doubtful[smooth] = np.logical_or.reduceat(beyond, pieces[:-1])
    for ends in (speed[pieces[:-1], 0], speed[pieces[1:] - 1, -1], rate[pieces[:-1], 0], rate[pieces[1:] - 1, -1]):
        doubtful[smooth] |= (np.abs(ends) > RATE).any(1)
    first, last = (np.array([course.q[k] for course in courses]) for k in (0, -1))
    doubtful[1:] |= (np.abs(first[1:] - last[:-1]) > JOINED).any(1)
    return doubtful


def _positions(arm: Arm, course: Course) -> list[Fault]:
    low, high = course.reach
    if course.spline is not None:  # whose coefficients may lie beyond
        lows, highs = extremes(course.spline)
        low, high = lows.min(0), highs.max(0)
    beyond = np.maximum(high - arm.upper, arm.lower - low)
    worst = int(np.argmax(beyond))
    if not beyond[worst] > POSITION:
        return []
    return [_fault(course, f"{arm.joints[worst]} goes {beyond[worst]:.3g} {arm.units[worst]} beyond its limits", beyond[worst])]


def _rates(arm: Arm, course: Course, acceleration: Array, jerk: Array) -> list[Fault]:
    """Velocity in a polyline is way by time; in a spline, what its derivatives reach between the rows."""
    if len(course.q) < 2:
        return []
    if course.spline is None:
        way, time = np.abs(np.diff(course.q, axis=0)), np.diff(course.t_s)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            speed = np.where(way > POSITION, way / time, 0.0).max(0)
        return _above(arm, course, speed, arm.velocity, "velocity", "/s")
    out = []
    for order, limit, what, unit in ((1, arm.velocity, "velocity", "/s"), (2, acceleration, "acceleration", "/s²")):
        low, high = extremes(course.spline, order, 1e-6)
        out += _above(arm, course, np.maximum(high, -low).max(0), limit, what, unit)
        ends = np.abs(coefficients(course.spline, order)[[0, -1], [0, -1]]).max(0)
        if ends.max() > RATE * float(limit[np.isfinite(limit)].max(initial=1.0)):
            worst = int(np.argmax(ends))
            rate = f"{ends[worst]:.3g} {arm.units[worst]}{unit}"
            detail = f"{arm.joints[worst]} does not rest where it begins or ends: its {what} is {rate} there"
            out.append(_fault(course, detail, ends[worst]))
    return out + _above(arm, course, _jerks(course), jerk, "jerk", "/s³")


def _jerks(course: Course) -> Array:
    """The largest jerk (J,) of a spline, less what the rounding of positions may come to in it."""
    assert course.spline is not None
    h = np.diff(course.t_s)
    low, high = extremes(course.spline, 3, 1e-6)
    return np.asarray((np.maximum(high, -low) - (THIRD * POSITION / h**3)[:, None]).max(0))


def _above(arm: Arm, course: Course, reached: Array, limit: Array, what: str, unit: str) -> list[Fault]:
    over = reached / limit
    worst = int(np.argmax(over))
    if not over[worst] > 1 + RATE:
        return []
    unit = arm.units[worst] + unit
    detail = f"{arm.joints[worst]} reaches {reached[worst]:.3g} {unit}, and the limit of its {what} is {limit[worst]:.3g} {unit}"
    return [_fault(course, detail, reached[worst])]


def _fault(course: Course, detail: str, amount: float) -> Fault:
    return Fault(course.stage, (), f"{course.where}: {detail}", float(amount))
