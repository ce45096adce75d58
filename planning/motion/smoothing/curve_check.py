"""Proof that a curve is free: chords beside it, each judged like any other edge, with room for how far the curve is from them.

`spline_rows.chords` gives waypoints such that no point of the arm on the curve is further than WITHIN_M from where a point of a chord has
it. When the chords keep that distance from everything, the curve touches nothing (`Workcell.for_chords`).
"""

from __future__ import annotations

from kinematics.collision.edge_problem import MARGIN_M
from kinematics.jit.decorators import jit_entry
from kinematics.transforms import Array
from planning.motion.search.edges import Memory, Task, connects

WITHIN_M = MARGIN_M / 2


@jit_entry
def first_blocked(task: Task, points: Array, count: int, memory: Memory) -> int:
    """The first of the edges between the first `count` of points (N, J) that is not free; -1 when all are."""
    for i in range(count - 1):
        if not connects(task, points[i], points[i + 1], memory):
            return i
    return -1
