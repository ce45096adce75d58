"""Rows of a quintic Hermite spline in compiled code: a state in between, shares of the limits, slowing down, chords that enclose it.

t (R,) are times in s, rows (R, 3, A) positions, velocities and accelerations; between two rows runs the quintic polynomial that meets both
(kinematics.quintic_spline holds the same for everybody else, with arrays of its own).
"""

from __future__ import annotations

import numpy as np

from kinematics.jit.decorators import copy_row, jit_entry, jit_inline
from kinematics.transforms import Array

MOST_PARTS = 64
"""Into so many chords a piece between two rows is cut at most."""


@jit_inline
def state_at(t: Array, rows: Array, i: int, after: float, out: Array) -> None:
    """out (3, A): position, velocity and acceleration `after` seconds behind row i, before row i + 1."""
    h, x = t[i + 1] - t[i], after
    for j in range(rows.shape[2]):
        q, v, a = rows[i, 0, j], rows[i, 1, j], rows[i, 2, j]
        # what is left at row i + 1 of a motion with this acceleration, as h³, h⁴ and h⁵ have to make it
        dq = (rows[i + 1, 0, j] - q - h * (v + 0.5 * h * a)) / (h * h * h)
        dv = (rows[i + 1, 1, j] - v - h * a) / (h * h)
        da = (rows[i + 1, 2, j] - a) / h
        c3 = 10.0 * dq - 4.0 * dv + 0.5 * da
        c4 = (-15.0 * dq + 7.0 * dv - da) / h
        c5 = (6.0 * dq - 3.0 * dv + 0.5 * da) / (h * h)
        out[0, j] = q + x * (v + x * (0.5 * a + x * (c3 + x * (c4 + x * c5))))
        out[1, j] = v + x * (a + x * (3.0 * c3 + x * (4.0 * c4 + x * 5.0 * c5)))
        out[2, j] = a + x * (6.0 * c3 + x * (12.0 * c4 + x * 20.0 * c5))


@jit_inline
def largest_shares(velocity: Array, acceleration: Array, jerk: Array, count: int, t: Array, rows: Array) -> tuple[float, float, float]:
    """Upper bounds of the shares of their limits (A,) that velocity, acceleration and jerk reach on the first `count` rows: the largest
    Bernstein coefficients of each piece."""
    over_v, over_a, over_b = 0.0, 0.0, 0.0
    for i in range(count - 1):
        h = t[i + 1] - t[i]
        for j in range(rows.shape[2]):
            c0 = rows[i, 0, j]
            c1 = c0 + h / 5 * rows[i, 1, j]
            c2 = c0 + 2 * h / 5 * rows[i, 1, j] + h * h / 20 * rows[i, 2, j]
            c5 = rows[i + 1, 0, j]
            c4 = c5 - h / 5 * rows[i + 1, 1, j]
            c3 = c5 - 2 * h / 5 * rows[i + 1, 1, j] + h * h / 20 * rows[i + 1, 2, j]
            v0, v1, v2, v3, v4 = c1 - c0, c2 - c1, c3 - c2, c4 - c3, c5 - c4
            a0, a1, a2, a3 = v1 - v0, v2 - v1, v3 - v2, v4 - v3
            v = max(abs(v0), abs(v1), abs(v2), abs(v3), abs(v4)) * 5 / h
            a = max(abs(a0), abs(a1), abs(a2), abs(a3)) * 20 / (h * h)
            b = max(abs(a1 - a0), abs(a2 - a1), abs(a3 - a2)) * 60 / (h * h * h)
            over_v, over_a, over_b = max(over_v, v / velocity[j]), max(over_a, a / acceleration[j]), max(over_b, b / jerk[j])
    return over_v, over_a, over_b


@jit_entry
def keep_limits(velocity: Array, acceleration: Array, jerk: Array, most: float, count: int, t: Array, rows: Array) -> float:
    """Slow the first `count` rows down as a whole until no limit (A,) is used by more than a share `most`; by how much comes back."""
    v, a, b = largest_shares(velocity, acceleration, jerk, count, t, rows)
    slower = max(1.0, v / most, np.sqrt(a / most), (b / most) ** (1.0 / 3.0))
    if slower > 1.0:
        slow_down(slower, count, t, rows)
    return float(slower)


@jit_entry
def slow_down(slower: float, count: int, t: Array, rows: Array) -> None:
    """The same curve, so many times slower."""
    for i in range(count):
        t[i] *= slower
        for j in range(rows.shape[2]):
            rows[i, 1, j] /= slower
            rows[i, 2, j] /= slower * slower


@jit_entry
def chords(t: Array, rows: Array, count: int, weight: Array, within: float, ends: Array, points: Array) -> int:
    """Waypoints that follow the curve of the first `count` rows so closely that no point of the arm on the curve is further than `within`
    metres from where some point of a chord between two waypoints has it: points (N, A); how many, 0 when there are not enough.

    A piece of the curve is a mean of its control points, and each of those is near the chord. As many pieces share a chord as can; one that
    strays too far is cut. weight (A,): metres that any point of the arm moves at most per unit of each joint. Scratch: ends (2, 3, A).
    """
    n, i = 1, 0
    for j in range(rows.shape[2]):
        points[0, j] = rows[0, 0, j]
    while i < count - 1:
        to = i + 1
        while to < count and _all_near(t, rows, i, to, weight, within):
            to += 1
        parts = 1
        if to > i + 1:
            to -= 1
        else:
            parts = _parts(t, rows, i, weight, within, ends)
        if parts == 0 or n + parts > points.shape[0]:
            return 0
        for part in range(parts):
            if part == parts - 1:
                copy_row(rows[to, 0], points[n])
            else:
                state_at(t, rows, i, (part + 1) * (t[to] - t[i]) / parts, ends[0])
                copy_row(ends[0, 0], points[n])
            n += 1
        i = to
    return n


@jit_inline
def _all_near(t: Array, rows: Array, first: int, last: int, weight: Array, within: float) -> bool:
    """Whether the pieces between two rows are near the chord from the one to the other."""
    for i in range(first, last):
        if _off_chord(rows[i], rows[i + 1], t[i + 1] - t[i], rows[first, 0], rows[last, 0], weight) > within:
            return False
    return True


@jit_inline
def _parts(t: Array, rows: Array, i: int, weight: Array, within: float, ends: Array) -> int:
    """Into how many parts the piece behind row i has to be cut for each to be near its chord; 0 when into too many."""
    h, parts = t[i + 1] - t[i], 2
    while parts <= MOST_PARTS:
        worst = 0.0
        for part in range(parts):
            state_at(t, rows, i, part * h / parts, ends[0])
            state_at(t, rows, i, (part + 1) * h / parts, ends[1])
            worst = max(worst, _off_chord(ends[0], ends[1], h / parts, ends[0, 0], ends[1, 0], weight))
            if worst > within:
                break
        if worst <= within:
            return parts
        parts = max(parts + 1, min(2 * parts, int(parts * np.sqrt(worst / within)) + 1))
    return 0


@jit_inline
def _off_chord(first: Array, last: Array, h: float, a: Array, b: Array, weight: Array) -> float:
    """How far, in metres, a control point of the piece between two states (3, A), h seconds apart, is from the chord from a to b (A,)."""
    worst, squares = 0.0, 0.0
    for j in range(weight.shape[0]):
        squares += (weight[j] * (b[j] - a[j])) ** 2
    for k in range(6):
        sign, steps = (1.0, k) if k < 3 else (-1.0, 5 - k)
        speed, bend = sign * steps * h / 5, h * h / 20 if steps == 2 else 0.0
        along = 0.0
        for j in range(weight.shape[0]):
            x = first[0, j] + speed * first[1, j] + bend * first[2, j] if k < 3 else last[0, j] + speed * last[1, j] + bend * last[2, j]
            along += weight[j] * weight[j] * (x - a[j]) * (b[j] - a[j])
        share = min(1.0, max(0.0, along / squares)) if squares > 0.0 else 0.0
        off = 0.0
        for j in range(weight.shape[0]):
            x = first[0, j] + speed * first[1, j] + bend * first[2, j] if k < 3 else last[0, j] + speed * last[1, j] + bend * last[2, j]
            off += weight[j] * abs(x - a[j] - share * (b[j] - a[j]))
        worst = max(worst, off)
    return worst
