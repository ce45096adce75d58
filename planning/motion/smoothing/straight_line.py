"""A straight way of the hand, driven in one piece: approach, lift, lower and retreat.

The arm's waypoints stand at even distances along the hand's line. A cubic spline through them, over the hand's way s, is C² and
keeps much closer to the line than the polyline does. Along it the hand follows a jerk-limited profile from rest to rest; where the arm's
joints have to turn fastest decides about its limits, and where the result breaks a limit all the same the profile is slowed down. Rows are
written so densely that quintic Hermite pieces reproduce the spline under the profile.
"""

from __future__ import annotations

import numpy as np

from kinematics.jit.decorators import jit_entry, jit_inline
from kinematics.transforms import Array
from planning.motion.smoothing.jerk_limited import change_time, peak_speed, ramp_time
from planning.motion.smoothing.spline_rows import largest_shares

ROW_S = 0.02
"""Rows are no further apart."""
_KNOT_S = 2e-4  # a knot that is passed so shortly before or after another row gets none of its own
_ROUNDS = 6


@jit_entry
def second_derivatives(q: Array, step: float, out: Array, work: Array) -> None:
    """out (n, A): the second derivatives of the cubic spline through q (n, A), n > 2, which stand `step` apart, with one cubic over the
    first two pieces and one over the last two ("not a knot"). work (n,): scratch."""
    n, A = q.shape
    for j in range(A):
        for k in range(1, n - 1):
            out[k, j] = (q[k + 1, j] - 2.0 * q[k, j] + q[k - 1, j]) / (step * step)  # also what the second and the last but one are
        if n > 4:  # the tridiagonal system 1 4 1 between these two, Thomas's algorithm
            last = out[n - 2, j]
            work[1] = 0.0
            for k in range(2, n - 2):
                pivot = 4.0 - work[k - 1]
                work[k] = 1.0 / pivot
                out[k, j] = (6.0 * out[k, j] - out[k - 1, j]) / pivot
            for k in range(n - 3, 1, -1):
                out[k, j] -= work[k] * (last if k == n - 3 else out[k + 1, j])
        if n == 3:
            out[0, j] = out[2, j] = out[1, j]
        else:
            out[0, j], out[n - 1, j] = 2.0 * out[1, j] - out[2, j], 2.0 * out[n - 2, j] - out[n - 3, j]


@jit_inline
def _spline(q: Array, second: Array, step: float, s: float, out: Array) -> None:
    """out (4, A): the spline and its first three derivatives by s."""
    k = min(q.shape[0] - 2, max(0, int(s / step)))
    u = s - k * step
    for j in range(q.shape[1]):
        a, b = second[k, j], second[k + 1, j]
        third = (b - a) / step
        slope = (q[k + 1, j] - q[k, j]) / step - step * (2.0 * a + b) / 6.0
        out[0, j] = q[k, j] + u * (slope + u * (0.5 * a + u * third / 6.0))
        out[1, j] = slope + u * (a + 0.5 * u * third)
        out[2, j] = a + u * third
        out[3, j] = third


@jit_entry
def write_line(
    q: Array, length: float, speed: float, velocity: Array, acceleration: Array, jerk: Array, second: Array, work: Array, out: Array,
    t: Array, rows: Array,
) -> int:  # fmt: skip
    """The rows of the trajectory along waypoints q (n, A), `length` metres from rest to rest: t (R,) times and rows (R, 3, A) positions,
    velocities, accelerations; how many come back, 0 when there is no room for them or the hand does not move.

    speed: the hand's limit in m/s; velocity, acceleration, jerk (A,): the joints' limits. Scratch: second (n, A), work (n,), out (4, A).
    """
    n, step = q.shape[0], length / (q.shape[0] - 1)
    second_derivatives(q, step, second, work)
    fastest, a, b = speed, np.inf, np.inf
    for i in range(4 * (n - 1) + 1):
        _spline(q, second, step, 0.25 * i * step, out)
        for j in range(q.shape[1]):
            d = abs(out[1, j])
            if d > 0.0:
                fastest, a, b = min(fastest, velocity[j] / d), min(a, acceleration[j] / d), min(b, jerk[j] / d)
    if a == np.inf:
        return 0
    count = 0
    for _ in range(_ROUNDS):
        count = _rows(q, second, step, length, fastest, a, b, out, t, rows)
        if count == 0:
            return 0
        over_v, over_a, over_b = largest_shares(velocity, acceleration, jerk, count, t, rows)
        if max(over_v, over_a, over_b) <= 1.0:
            break
        fastest, a, b = fastest / max(1.0, over_v), a / max(1.0, over_a), b / max(1.0, over_b)
    return count


@jit_inline
def _rows(q: Array, second: Array, step: float, length: float, most: float, a: float, b: float, out: Array, t: Array, rows: Array) -> int:
    """The rows at given limits of the hand's speed, acceleration and jerk."""
    peak = peak_speed(length, 0.0, 0.0, most, a, b)
    whole, ramp = change_time(peak, a, b), ramp_time(peak, a, b)
    still = max(0.0, length - peak * whole) / peak
    top = peak / (whole - ramp)
    rate = top / ramp
    n, when, s, v, w = 0, 0.0, 0.0, 0.0, 0.0
    n = _row(q, second, step, 0.0, 0.0, 0.0, 0.0, out, t, rows, n)
    for phase in range(7):
        took = still if phase == 3 else (whole - 2 * ramp if phase == 1 or phase == 5 else ramp)
        if took <= _KNOT_S and (phase == 1 or phase == 3 or phase == 5):
            s, v, when = s + took * (v + 0.5 * took * w), v + took * w, when + took
            continue
        jump = rate if phase == 0 or phase == 6 else (-rate if phase == 2 or phase == 4 else 0.0)
        at, end = 0.0, s + took * (v + took * (0.5 * w + took * jump / 6.0))
        while at < took:
            # as far as the next knot of the spline, the end of the phase or the longest row, whichever comes first
            left = took - at
            parts = max(1, int(np.ceil(left / ROW_S)))
            to = at + left / parts if parts > 1 else took
            here = s + at * (v + at * (0.5 * w + at * jump / 6.0))
            there = s + to * (v + to * (0.5 * w + to * jump / 6.0))
            knot = (int(here / step + 1e-9) + 1) * step
            if knot < there:
                low, high = at, to
                for _ in range(50):
                    middle = 0.5 * (low + high)
                    if s + middle * (v + middle * (0.5 * w + middle * jump / 6.0)) < knot:
                        low = middle
                    else:
                        high = middle
                if high - at > _KNOT_S and took - high > _KNOT_S:
                    to = high
            if n == t.shape[0]:
                return 0
            x = s + to * (v + to * (0.5 * w + to * jump / 6.0))
            n = _row(q, second, step, x, v + to * (w + 0.5 * to * jump), w + to * jump, when + to, out, t, rows, n)
            at = to
        s, v, w, when = end, v + took * (w + 0.5 * took * jump), w + took * jump, when + took
    for j in range(q.shape[1]):
        rows[n - 1, 0, j], rows[n - 1, 1, j], rows[n - 1, 2, j] = q[q.shape[0] - 1, j], 0.0, 0.0
    return n


@jit_inline
def _row(q: Array, second: Array, step: float, s: float, v: float, w: float, when: float, out: Array, t: Array, rows: Array, n: int) -> int:
    _spline(q, second, step, s, out)
    for j in range(q.shape[1]):
        rows[n, 0, j], rows[n, 1, j], rows[n, 2, j] = out[0, j], out[1, j] * v, out[2, j] * v * v + out[1, j] * w
    t[n] = when
    return n + 1
