"""A way through the waypoints of a polyline that stops nowhere inside: straight pieces, and corners that are rounded.

Along each straight piece the arm follows a jerk-limited profile (jerk_limited.py). At a corner the velocity, a vector, changes straight
from one piece's direction to the next one's with such a profile, so the jerk is constant but for three switches, all joints' limits hold
exactly, and the whole is a spline of cubic pieces: C², with rows at the switches. The curve stays in the triangle between the corner and
the two points where it leaves and rejoins the polyline; the faster the corner is passed, the larger that triangle. `choose_speeds` looks
for the speeds at the corners that make the whole fastest, within the deviation that is allowed at each: among a few levels first, by
dynamic programming, then around these.

Lengths and speeds along a piece are scaled: at speed 1 some joint is at its velocity limit, and a piece's length is its duration then.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinematics.jit.decorators import jit_entry, jit_inline
from kinematics.transforms import Array
from planning.motion.smoothing.jerk_limited import change_time, driving_time, peak_speed, ramp_time

LEVELS = (0.0, 0.1, 0.2, 0.3, 0.45, 0.65, 1.0)
"""Speeds among which those at the corners are chosen at first."""
SWEEPS = 2
_FIRST_STEP, _LAST_STEP = 0.08, 0.005
_WORTH_S = 1e-3  # another sweep is made when the last one saved as much
LEAST_S = 2e-4
"""Rows are at least so far apart: in double precision, the jerk can't be told from positions that lie closer together."""


class Corners(NamedTuple):
    """A polyline of K waypoints of A joints, what limits it, and how it is driven.

    q (K, A). velocity, acceleration, jerk (A,). most (K - 1,): largest speed on each piece, 1 where nothing but the joints limits it.
    weight (A,): metres that any point of the arm moves at most per unit of each joint. allowed (K,): how far the curve may leave the
    polyline at each waypoint, in metres moved.
    direction (K - 1, A); limits (K - 1, 3): length, acceleration and jerk along it. speed (K, 2): at each waypoint, before and behind it.
    took, strays (K,): for each corner its seconds, and how far the curve leaves the polyline there at most, in metres moved.
    table (3, K, number of levels): scratch.
    """

    q: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    most: Array
    weight: Array
    allowed: Array
    direction: Array
    limits: Array
    speed: Array
    took: Array
    strays: Array
    table: Array


def make_corners(q: Array, velocity: Array, acceleration: Array, jerk: Array, weight: Array, most: Array | None = None) -> Corners:
    """A polyline (K, A) without repeated waypoints, K > 1, that stops at every waypoint so far."""
    corners = unmeasured_corners(q, velocity, acceleration, jerk, weight, most)
    measure(*corners)
    return corners


def unmeasured_corners(q: Array, velocity: Array, acceleration: Array, jerk: Array, weight: Array, most: Array | None = None) -> Corners:
    """The same without directions and limits of its pieces."""
    K, A = q.shape
    return Corners(
        np.ascontiguousarray(q, float), velocity, acceleration, jerk, np.ones(K - 1) if most is None else most, weight, np.full(K, np.inf),
        np.empty((K - 1, A)), np.empty((K - 1, 3)), np.zeros((K, 2)), np.zeros(K), np.zeros(K), np.empty((3, K, len(LEVELS))),
    )  # fmt: skip


@jit_entry
def measure(
    q: Array, velocity: Array, acceleration: Array, jerk: Array, most: Array, weight: Array, allowed: Array, direction: Array,
    limits: Array, speed: Array, took: Array, strays: Array, table: Array,
) -> None:  # fmt: skip
    """Fill in direction and limits."""
    measure_pieces(q, q.shape[0], velocity, acceleration, jerk, direction, limits)


@jit_inline
def measure_pieces(q: Array, n: int, velocity: Array, acceleration: Array, jerk: Array, direction: Array, limits: Array) -> bool:
    """Fill in direction and limits for the pieces of q[:n]; False when one of them has no length."""
    for i in range(n - 1):
        length, a, b = 0.0, np.inf, np.inf
        for j in range(q.shape[1]):
            length = max(length, abs(q[i + 1, j] - q[i, j]) / velocity[j])
        if length == 0.0:
            return False
        for j in range(q.shape[1]):
            d = (q[i + 1, j] - q[i, j]) / length
            direction[i, j] = d
            if d != 0.0:
                a, b = min(a, acceleration[j] / abs(d)), min(b, jerk[j] / abs(d))
        limits[i, 0], limits[i, 1], limits[i, 2] = length, a, b
    return True


@jit_entry
def choose_speeds(
    q: Array, velocity: Array, acceleration: Array, jerk: Array, most: Array, weight: Array, allowed: Array, direction: Array,
    limits: Array, speed: Array, took: Array, strays: Array, table: Array,
) -> float:  # fmt: skip
    """Choose speed and took; the duration of the whole comes back.

    Levels first, then a pattern search, corner by corner: both speeds of a corner at once, then either.
    """
    K = q.shape[0]
    choose_levels(K, acceleration, jerk, most, weight, allowed, direction, limits, speed, took, table)
    for sweep in range(SWEEPS):
        saved = 0.0
        for i in range(1, K - 1):
            for which in range(3):
                saved += _improve(acceleration, jerk, most, weight, allowed, direction, limits, speed, took, i, which, sweep)
        if saved < _WORTH_S:
            break
    for i in range(1, K - 1):
        strays[i] = _off_corner(weight, direction, speed, took, i)
    return _whole(limits, most, speed, took)


@jit_inline
def choose_levels(
    n: int, acceleration: Array, jerk: Array, most: Array, weight: Array, allowed: Array, direction: Array, limits: Array, speed: Array,
    took: Array, table: Array,
) -> float:  # fmt: skip
    """Choose among levels the speeds, the same before and behind it, at each of the first n waypoints; the duration comes back.

    table[0] holds the seconds of each corner at each level, table[1] those of the best way to there, table[2] the level before on it.
    """
    corner, best, before = table[0], table[1], table[2]
    for i in range(n):
        for s in range(len(LEVELS)):
            corner[i, s] = best[i, s] = np.inf
            if s == 0:
                corner[i, s] = 0.0
            elif 0 < i < n - 1 and LEVELS[s] <= min(most[i - 1], most[i]):
                speed[i, 0] = speed[i, 1] = LEVELS[s]
                took[i] = _corner_time(acceleration, jerk, direction, speed, i)
                if _off_corner(weight, direction, speed, took, i) <= allowed[i]:
                    corner[i, s] = took[i]
    best[0, 0] = 0.0
    for i in range(1, n):
        length, a, b = limits[i - 1, 0], limits[i - 1, 1], limits[i - 1, 2]
        for s in range(len(LEVELS)):
            if corner[i, s] == np.inf:
                continue
            for r in range(len(LEVELS)):
                if best[i - 1, r] < np.inf:
                    left = length - 0.5 * (LEVELS[r] * corner[i - 1, r] + LEVELS[s] * corner[i, s])
                    if left >= 0.0:
                        now = best[i - 1, r] + corner[i, s] + _quick_drive(left, LEVELS[r], LEVELS[s], most[i - 1], a, b)
                        if now < best[i, s]:
                            best[i, s], before[i, s] = now, r
    level = 0
    for i in range(n - 1, 0, -1):
        speed[i, 0] = speed[i, 1] = LEVELS[level]
        took[i] = corner[i, level]
        level = int(before[i, level])
    speed[0, 0] = speed[0, 1] = took[0] = 0.0
    return float(best[n - 1, 0])


@jit_inline
def _quick_drive(left: float, first: float, last: float, most: float, a: float, b: float) -> float:
    """Seconds over a distance between two speeds by way of the highest level that it has room for; infinite without room for any."""
    for k in range(len(LEVELS) - 1, -1, -1):
        peak = min(LEVELS[k], most)
        if peak < max(first, last):
            return np.inf
        up, down = change_time(peak - first, a, b), change_time(peak - last, a, b)
        over = 0.5 * ((first + peak) * up + (peak + last) * down)
        if over <= left and peak > 0.0:
            return up + down + (left - over) / peak
    return float((32.0 * left / b) ** (1.0 / 3.0))  # from rest to rest, slower than the slowest level: four pulses of the jerk


@jit_inline
def _improve(
    acceleration: Array, jerk: Array, most: Array, weight: Array, allowed: Array, direction: Array, limits: Array, speed: Array,
    took: Array, i: int, which: int, sweep: int,
) -> float:  # fmt: skip
    """Try faster and slower at waypoint i: both speeds (which = 0), the one before it (1) or behind it (2). The seconds saved."""
    best = _around(limits, most, speed, took, i)
    begin, step = best, _FIRST_STEP / (1.0 + 2.0 * sweep)
    while step > _LAST_STEP:
        moved = False
        for sign in range(2):
            before, behind, duration = speed[i, 0], speed[i, 1], took[i]
            by = step if sign == 0 else -step
            if which != 2:
                speed[i, 0] = min(most[i - 1], max(0.0, before + by))
            if which != 1:
                speed[i, 1] = min(most[i], max(0.0, behind + by))
            took[i] = _corner_time(acceleration, jerk, direction, speed, i)
            now = np.inf
            if _off_corner(weight, direction, speed, took, i) <= allowed[i]:
                now = _around(limits, most, speed, took, i)
            if now < best - 1e-9:
                best, moved = now, True
                break
            speed[i, 0], speed[i, 1], took[i] = before, behind, duration
        if not moved:
            step *= 0.5
    return begin - best if begin < np.inf else 0.0


@jit_inline
def _corner_time(acceleration: Array, jerk: Array, direction: Array, speed: Array, i: int) -> float:
    """Seconds that the change of velocity at waypoint i takes."""
    a, b = _corner_limits(acceleration, jerk, direction, speed, i)
    return change_time(1.0, a, b) if a < np.inf else 0.0


@jit_inline
def _corner_limits(acceleration: Array, jerk: Array, direction: Array, speed: Array, i: int) -> tuple[float, float]:
    """The change of velocity at waypoint i as a change from 0 to 1: its acceleration and jerk; infinite when nothing changes."""
    a, b = np.inf, np.inf
    for j in range(direction.shape[1]):
        d = abs(speed[i, 1] * direction[i, j] - speed[i, 0] * direction[i - 1, j])
        if d > 1e-12:
            a, b = min(a, acceleration[j] / d), min(b, jerk[j] / d)
    return a, b


@jit_inline
def _off_corner(weight: Array, direction: Array, speed: Array, took: Array, i: int) -> float:
    """How far any point of the arm is from where waypoint i has it, when the curve is nearest to that, at most, in metres."""
    change = 0.0
    for j in range(direction.shape[1]):
        change += weight[j] * abs(speed[i, 1] * direction[i, j] - speed[i, 0] * direction[i - 1, j])
    return float(change * took[i] / 8.0)


@jit_inline
def _piece_time(limits: Array, most: Array, speed: Array, took: Array, i: int) -> float:
    """Seconds on the straight part of piece i, infinite when the corners leave too little of it."""
    left = limits[i, 0] - 0.5 * (speed[i, 1] * took[i] + speed[i + 1, 0] * took[i + 1])
    if left < 0.0:
        return np.inf
    return driving_time(left, speed[i, 1], speed[i + 1, 0], most[i], limits[i, 1], limits[i, 2])


@jit_inline
def _around(limits: Array, most: Array, speed: Array, took: Array, i: int) -> float:
    """Seconds for what the speeds at waypoint i change."""
    return float(_piece_time(limits, most, speed, took, i - 1) + took[i] + _piece_time(limits, most, speed, took, i))


@jit_inline
def _whole(limits: Array, most: Array, speed: Array, took: Array) -> float:
    total = 0.0
    for i in range(limits.shape[0]):
        total += took[i] + _piece_time(limits, most, speed, took, i)
    return total


@jit_entry
def write_corner(
    q: Array, velocity: Array, acceleration: Array, jerk: Array, most: Array, weight: Array, allowed: Array, direction: Array,
    limits: Array, speed: Array, took: Array, strays: Array, table: Array, i: int, t: Array, rows: Array,
) -> int:  # fmt: skip
    """The corner at waypoint i alone: its rows, see `write_rows`; how many come back."""
    for j in range(q.shape[1]):
        rows[0, 0, j] = q[i, j] - 0.5 * speed[i, 0] * took[i] * direction[i - 1, j]
        rows[0, 1, j] = speed[i, 0] * direction[i - 1, j]
        rows[0, 2, j] = 0.0
    t[0] = 0.0
    return _add_corner(q, acceleration, jerk, direction, speed, took, i, t, rows, 1)


@jit_entry
def write_rows(
    q: Array, velocity: Array, acceleration: Array, jerk: Array, most: Array, weight: Array, allowed: Array, direction: Array,
    limits: Array, speed: Array, took: Array, strays: Array, table: Array, t: Array, rows: Array,
) -> int:  # fmt: skip
    """The rows of the spline: t (R,) times and rows (R, 3, A) positions, velocities, accelerations; how many come back. R ≥ 10 K."""
    n, last = 1, q.shape[0] - 1
    t[0] = 0.0
    for j in range(q.shape[1]):
        rows[0, 0, j], rows[0, 1, j], rows[0, 2, j] = q[0, j], 0.0, 0.0
    for i in range(last):
        if i > 0:
            n = _add_corner(q, acceleration, jerk, direction, speed, took, i, t, rows, n)
        first, final = speed[i, 1], speed[i + 1, 0]
        skipped = 0.5 * first * took[i]
        left = max(0.0, limits[i, 0] - skipped - 0.5 * final * took[i + 1])
        a, b = limits[i, 1], limits[i, 2]
        peak = max(peak_speed(left, first, final, most[i], a, b), max(first, final))
        at, now = skipped, first
        for change in range(2):
            to = peak if change == 0 else final
            whole, ramp = change_time(to - now, a, b), ramp_time(to - now, a, b)
            top = (to - now) / (whole - ramp) if whole > ramp else 0.0
            n = _add(direction[i], q[i], at + now * ramp + top * ramp * ramp / 6, now + 0.5 * top * ramp, top, ramp, t, rows, n)
            n = _add(
                direction[i], q[i], at + 0.5 * (now + to) * whole - to * ramp + top * ramp * ramp / 6, to - 0.5 * top * ramp, top,
                whole - 2 * ramp, t, rows, n,
            )  # fmt: skip
            at += 0.5 * (now + to) * whole
            n = _add(direction[i], q[i], at, to, 0.0, ramp, t, rows, n)
            now = to
            if change == 0 and peak > 0.0:
                still = max(0.0, left - (at - skipped) - 0.5 * (peak + final) * change_time(peak - final, a, b))
                at += still
                n = _add(direction[i], q[i], at, peak, 0.0, still / peak, t, rows, n)
    for j in range(q.shape[1]):
        rows[n - 1, 0, j], rows[n - 1, 1, j], rows[n - 1, 2, j] = q[last, j], 0.0, 0.0
    return n


@jit_inline
def _add(u: Array, q: Array, s: float, speed: float, acceleration: float, took: float, t: Array, rows: Array, n: int) -> int:
    """One more row, after `took` seconds: on a piece that begins at q in direction u. A row that is too near takes the last one's place."""
    when = t[n - 1] + took
    if took < LEAST_S and n > 1:
        n -= 1
    for j in range(q.shape[0]):
        rows[n, 0, j], rows[n, 1, j], rows[n, 2, j] = q[j] + s * u[j], speed * u[j], acceleration * u[j]
    t[n] = when
    return n + 1


@jit_inline
def _add_corner(
    q: Array, acceleration: Array, jerk: Array, direction: Array, speed: Array, took: Array, i: int, t: Array, rows: Array, n: int
) -> int:
    """The rows of the corner at waypoint i, after one at its beginning."""
    a, b = _corner_limits(acceleration, jerk, direction, speed, i)
    if a == np.inf:
        return n
    whole, ramp = took[i], ramp_time(1.0, a, b)
    top = 1.0 / (whole - ramp)
    p, r = speed[i, 0], speed[i, 1]
    for k in range(3):
        # the share of the change that is made, and its integral, `when` seconds into the corner
        when = ramp if k == 0 else whole - ramp if k == 1 else whole
        if k == 1 and whole - 2 * ramp < LEAST_S:
            continue
        made = 0.5 * top * ramp if k == 0 else 1.0 - 0.5 * top * ramp if k == 1 else 1.0
        area = top * ramp * ramp / 6 if k == 0 else 0.5 * whole - ramp + top * ramp * ramp / 6 if k == 1 else 0.5 * whole
        rate = 0.0 if k == 2 else top
        before = t[n - 1]
        for j in range(q.shape[1]):
            u, v = p * direction[i - 1, j], r * direction[i, j]
            rows[n, 0, j] = q[i, j] - 0.5 * whole * u + u * (when - area) + v * area
            rows[n, 1, j] = u + made * (v - u)
            rows[n, 2, j] = rate * (v - u)
        t[n] = before + (ramp if k == 0 or (whole - 2 * ramp >= LEAST_S and k == 2) else whole - 2 * ramp if k == 1 else whole - ramp)
        n += 1
    return n
