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
from kinematics.jit.record import record
from kinematics.transforms import Array
from planning.motion.smoothing.jerk_limited import change_time, driving_time, peak_speed, ramp_time

LEVELS = (0.0, 0.1, 0.2, 0.3, 0.45, 0.65, 1.0)
"""Speeds among which those at the corners are chosen at first."""
SWEEPS = 2
_FIRST_STEP, _LAST_STEP = 0.08, 0.005
_WORTH_S = 1e-3  # another sweep is made when the last one saved as much
LEAST_S = 2e-4
"""Rows are at least so far apart: in double precision, the jerk can't be told from positions that lie closer together."""


@record
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
    measure(corners)
    return corners


def unmeasured_corners(q: Array, velocity: Array, acceleration: Array, jerk: Array, weight: Array, most: Array | None = None) -> Corners:
    """The same without directions and limits of its pieces."""
    K, A = q.shape
    return Corners(
        np.ascontiguousarray(q, float), velocity, acceleration, jerk, np.ones(K - 1) if most is None else most, weight, np.full(K, np.inf),
        np.empty((K - 1, A)), np.empty((K - 1, 3)), np.zeros((K, 2)), np.zeros(K), np.zeros(K), np.empty((3, K, len(LEVELS))),
    )  # fmt: skip


@jit_entry
def measure(c: Corners) -> None:
    """Fill in direction and limits."""
    measure_pieces(c, c.q.shape[0])


@jit_inline
def measure_pieces(c: Corners, n: int) -> bool:
    """Fill in direction and limits for the pieces of q[:n]; False when one of them has no length."""
    for i in range(n - 1):
        length, a, b = 0.0, np.inf, np.inf
        for j in range(c.q.shape[1]):
            length = max(length, abs(c.q[i + 1, j] - c.q[i, j]) / c.velocity[j])
        if length == 0.0:
            return False
        for j in range(c.q.shape[1]):
            d = (c.q[i + 1, j] - c.q[i, j]) / length
            c.direction[i, j] = d
            if d != 0.0:
                a, b = min(a, c.acceleration[j] / abs(d)), min(b, c.jerk[j] / abs(d))
        c.limits[i, 0], c.limits[i, 1], c.limits[i, 2] = length, a, b
    return True


@jit_entry
def choose_speeds(c: Corners) -> float:
    """Choose speed and took; the duration of the whole comes back.

    Levels first, then a pattern search, corner by corner: both speeds of a corner at once, then either.
    """
    K = c.q.shape[0]
    choose_levels(c, K)
    for sweep in range(SWEEPS):
        saved = 0.0
        for i in range(1, K - 1):
            for which in range(3):
                saved += _improve(c, i, which, sweep)
        if saved < _WORTH_S:
            break
    for i in range(1, K - 1):
        c.strays[i] = _off_corner(c, i)
    return _whole(c)


@jit_inline
def choose_levels(c: Corners, n: int) -> float:
    """Choose among levels the speeds, the same before and behind it, at each of the first n waypoints; the duration comes back.

    table[0] holds the seconds of each corner at each level, table[1] those of the best way to there, table[2] the level before on it.
    """
    corner, best, before = c.table[0], c.table[1], c.table[2]
    for i in range(n):
        for s in range(len(LEVELS)):
            corner[i, s] = best[i, s] = np.inf
            if s == 0:
                corner[i, s] = 0.0
            elif 0 < i < n - 1 and LEVELS[s] <= min(c.most[i - 1], c.most[i]):
                c.speed[i, 0] = c.speed[i, 1] = LEVELS[s]
                c.took[i] = _corner_time(c, i)
                if _off_corner(c, i) <= c.allowed[i]:
                    corner[i, s] = c.took[i]
    best[0, 0] = 0.0
    for i in range(1, n):
        length, a, b = c.limits[i - 1, 0], c.limits[i - 1, 1], c.limits[i - 1, 2]
        for s in range(len(LEVELS)):
            if corner[i, s] == np.inf:
                continue
            for r in range(len(LEVELS)):
                if best[i - 1, r] < np.inf:
                    left = length - 0.5 * (LEVELS[r] * corner[i - 1, r] + LEVELS[s] * corner[i, s])
                    if left >= 0.0:
                        now = best[i - 1, r] + corner[i, s] + _quick_drive(left, LEVELS[r], LEVELS[s], c.most[i - 1], a, b)
                        if now < best[i, s]:
                            best[i, s], before[i, s] = now, r
    level = 0
    for i in range(n - 1, 0, -1):
        c.speed[i, 0] = c.speed[i, 1] = LEVELS[level]
        c.took[i] = corner[i, level]
        level = int(before[i, level])
    c.speed[0, 0] = c.speed[0, 1] = c.took[0] = 0.0
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
def _improve(c: Corners, i: int, which: int, sweep: int) -> float:
    """Try faster and slower at waypoint i: both speeds (which = 0), the one before it (1) or behind it (2). The seconds saved."""
    best = _around(c, i)
    begin, step = best, _FIRST_STEP / (1.0 + 2.0 * sweep)
    while step > _LAST_STEP:
        moved = False
        for sign in range(2):
            before, behind, duration = c.speed[i, 0], c.speed[i, 1], c.took[i]
            by = step if sign == 0 else -step
            if which != 2:
                c.speed[i, 0] = min(c.most[i - 1], max(0.0, before + by))
            if which != 1:
                c.speed[i, 1] = min(c.most[i], max(0.0, behind + by))
            c.took[i] = _corner_time(c, i)
            now = np.inf
            if _off_corner(c, i) <= c.allowed[i]:
                now = _around(c, i)
            if now < best - 1e-9:
                best, moved = now, True
                break
            c.speed[i, 0], c.speed[i, 1], c.took[i] = before, behind, duration
        if not moved:
            step *= 0.5
    return begin - best if begin < np.inf else 0.0


@jit_inline
def _corner_time(c: Corners, i: int) -> float:
    """Seconds that the change of velocity at waypoint i takes."""
    a, b = _corner_limits(c, i)
    return change_time(1.0, a, b) if a < np.inf else 0.0


@jit_inline
def _corner_limits(c: Corners, i: int) -> tuple[float, float]:
    """The change of velocity at waypoint i as a change from 0 to 1: its acceleration and jerk; infinite when nothing changes."""
    a, b = np.inf, np.inf
    for j in range(c.direction.shape[1]):
        d = abs(c.speed[i, 1] * c.direction[i, j] - c.speed[i, 0] * c.direction[i - 1, j])
        if d > 1e-12:
            a, b = min(a, c.acceleration[j] / d), min(b, c.jerk[j] / d)
    return a, b


@jit_inline
def _off_corner(c: Corners, i: int) -> float:
    """How far any point of the arm is from where waypoint i has it, when the curve is nearest to that, at most, in metres."""
    change = 0.0
    for j in range(c.direction.shape[1]):
        change += c.weight[j] * abs(c.speed[i, 1] * c.direction[i, j] - c.speed[i, 0] * c.direction[i - 1, j])
    return float(change * c.took[i] / 8.0)


@jit_inline
def _piece_time(c: Corners, i: int) -> float:
    """Seconds on the straight part of piece i, infinite when the corners leave too little of it."""
    left = c.limits[i, 0] - 0.5 * (c.speed[i, 1] * c.took[i] + c.speed[i + 1, 0] * c.took[i + 1])
    if left < 0.0:
        return np.inf
    return driving_time(left, c.speed[i, 1], c.speed[i + 1, 0], c.most[i], c.limits[i, 1], c.limits[i, 2])


@jit_inline
def _around(c: Corners, i: int) -> float:
    """Seconds for what the speeds at waypoint i change."""
    return float(_piece_time(c, i - 1) + c.took[i] + _piece_time(c, i))


@jit_inline
def _whole(c: Corners) -> float:
    total = 0.0
    for i in range(c.limits.shape[0]):
        total += c.took[i] + _piece_time(c, i)
    return total


@jit_entry
def write_corner(c: Corners, i: int, t: Array, rows: Array) -> int:
    """The corner at waypoint i alone: its rows, see `write_rows`; how many come back."""
    for j in range(c.q.shape[1]):
        rows[0, 0, j] = c.q[i, j] - 0.5 * c.speed[i, 0] * c.took[i] * c.direction[i - 1, j]
        rows[0, 1, j] = c.speed[i, 0] * c.direction[i - 1, j]
        rows[0, 2, j] = 0.0
    t[0] = 0.0
    return _add_corner(c, i, t, rows, 1)


@jit_entry
def write_rows(c: Corners, t: Array, rows: Array) -> int:
    """The rows of the spline: t (R,) times and rows (R, 3, A) positions, velocities, accelerations; how many come back. R ≥ 10 K."""
    n, last = 1, c.q.shape[0] - 1
    t[0] = 0.0
    for j in range(c.q.shape[1]):
        rows[0, 0, j], rows[0, 1, j], rows[0, 2, j] = c.q[0, j], 0.0, 0.0
    for i in range(last):
        if i > 0:
            n = _add_corner(c, i, t, rows, n)
        first, final = c.speed[i, 1], c.speed[i + 1, 0]
        skipped = 0.5 * first * c.took[i]
        left = max(0.0, c.limits[i, 0] - skipped - 0.5 * final * c.took[i + 1])
        a, b = c.limits[i, 1], c.limits[i, 2]
        peak = max(peak_speed(left, first, final, c.most[i], a, b), max(first, final))
        at, now = skipped, first
        for change in range(2):
            to = peak if change == 0 else final
            whole, ramp = change_time(to - now, a, b), ramp_time(to - now, a, b)
            top = (to - now) / (whole - ramp) if whole > ramp else 0.0
            n = _add(c.direction[i], c.q[i], at + now * ramp + top * ramp * ramp / 6, now + 0.5 * top * ramp, top, ramp, t, rows, n)
            n = _add(
                c.direction[i], c.q[i], at + 0.5 * (now + to) * whole - to * ramp + top * ramp * ramp / 6, to - 0.5 * top * ramp, top,
                whole - 2 * ramp, t, rows, n,
            )  # fmt: skip
            at += 0.5 * (now + to) * whole
            n = _add(c.direction[i], c.q[i], at, to, 0.0, ramp, t, rows, n)
            now = to
            if change == 0 and peak > 0.0:
                still = max(0.0, left - (at - skipped) - 0.5 * (peak + final) * change_time(peak - final, a, b))
                at += still
                n = _add(c.direction[i], c.q[i], at, peak, 0.0, still / peak, t, rows, n)
    for j in range(c.q.shape[1]):
        rows[n - 1, 0, j], rows[n - 1, 1, j], rows[n - 1, 2, j] = c.q[last, j], 0.0, 0.0
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
def _add_corner(c: Corners, i: int, t: Array, rows: Array, n: int) -> int:
    """The rows of the corner at waypoint i, after one at its beginning."""
    a, b = _corner_limits(c, i)
    if a == np.inf:
        return n
    whole, ramp = c.took[i], ramp_time(1.0, a, b)
    top = 1.0 / (whole - ramp)
    p, r = c.speed[i, 0], c.speed[i, 1]
    for k in range(3):
        # the share of the change that is made, and its integral, `when` seconds into the corner
        when = ramp if k == 0 else whole - ramp if k == 1 else whole
        if k == 1 and whole - 2 * ramp < LEAST_S:
            continue
        made = 0.5 * top * ramp if k == 0 else 1.0 - 0.5 * top * ramp if k == 1 else 1.0
        area = top * ramp * ramp / 6 if k == 0 else 0.5 * whole - ramp + top * ramp * ramp / 6 if k == 1 else 0.5 * whole
        rate = 0.0 if k == 2 else top
        before = t[n - 1]
        for j in range(c.q.shape[1]):
            u, v = p * c.direction[i - 1, j], r * c.direction[i, j]
            rows[n, 0, j] = c.q[i, j] - 0.5 * whole * u + u * (when - area) + v * area
            rows[n, 1, j] = u + made * (v - u)
            rows[n, 2, j] = rate * (v - u)
        t[n] = before + (ramp if k == 0 or (whole - 2 * ramp >= LEAST_S and k == 2) else whole - 2 * ramp if k == 1 else whole - ramp)
        n += 1
    return n
