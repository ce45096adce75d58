"""Proof that a curve is free: chords beside it, each judged like any other edge, with room for how far the curve is from them.

`spline_rows.chords` gives waypoints such that no point of the arm on the curve is further than WITHIN_M from where a point of a chord has
it. When the chords keep that distance from everything, the curve touches nothing (`Workcell.for_chords`).
"""

from __future__ import annotations

from kinematics.collision.edge_problem import MARGIN_M
from kinematics.jit.decorators import jit_entry, jit_inline
from kinematics.transforms import Array
from planning.motion.search.edges import Memory, Task, connects
from planning.motion.smoothing.spline_rows import chords

WITHIN_M = MARGIN_M / 2
SAME = 1e-9
"""By so much, in rad or m, a joint may be beyond its limits, for rounding."""


@jit_entry
def curve_free(
    task: Task, t: Array, rows: Array, count: int, lower: Array, upper: Array, ends: Array, points: Array, memory: Memory
) -> bool:
    """Whether the spline through the first `count` rows (R, 3, J) at times t (R,), which rise, is free, for certain, and no joint leaves
    its limits lower, upper (J,) on it. Scratch: ends (2, 3, J), points (N, J)."""
    for i in range(count - 1):
        if not _within(rows[i], rows[i + 1], t[i + 1] - t[i], lower, upper):
            return False
    n = chords(t, rows, count, task.exact.weight, WITHIN_M, ends, points)
    return n > 0 and first_blocked(task, points, n, memory) < 0


@jit_inline
def _within(a: Array, b: Array, h: float, lower: Array, upper: Array) -> bool:
    """Whether the Bernstein coefficients of a piece of h seconds between two rows (3, J), between which it stays, keep to the limits."""
    for j in range(lower.shape[0]):
        low, high = lower[j] - SAME, upper[j] + SAME
        for end in range(2):
            row, later = (a, h) if end == 0 else (b, -h)
            x, y = row[0, j] + later / 5 * row[1, j], row[0, j] + 2 * later / 5 * row[1, j] + h**2 / 20 * row[2, j]
            if min(row[0, j], x, y) < low or max(row[0, j], x, y) > high:
                return False
    return True


@jit_entry
def first_blocked(task: Task, points: Array, count: int, memory: Memory) -> int:
    """The first of the edges between the first `count` of points (N, J) that is not free; -1 when all are."""
    for i in range(count - 1):
        if not connects(task, points[i], points[i + 1], memory):
            return i
    return -1
