"""The least distance of any pair at each of many configurations, or at any of those along a path."""

from __future__ import annotations

import numpy as np

from kinematics.chain import Int, forward
from kinematics.collision.edge_problem import Problem, Scratch
from kinematics.collision.pair_bounds import TOLERANCE, ball_gap, distance_bound, hull_bound
from kinematics.jit.decorators import jit_entry, jit_inline
from kinematics.transforms import Array

BLOCK = 16
"""Rows of a path that are looked at together first."""


@jit_entry
def config_clearances(problem: Problem, Q: Array, rows: Int, pairs: Int, cap_m: float, scratch: Scratch, out: Array) -> None:
    """A lower bound, at most 5 % low, of the least distance of any pair at each of configurations Q (N, J), or cap_m if that is less: out
    (N,), 0 where something touches. rows (L, 2), pairs (L + 1,): which pairs are meant at which rows, see `path_clearances`."""
    for n in range(rows.shape[0]):
        for i in range(rows[n, 0], rows[n, 1]):
            out[i], _ = _nearest_pair(problem, Q[i], pairs[n], pairs[n + 1], cap_m, TOLERANCE, scratch)


@jit_entry
def path_clearances(
    problem: Problem, Q: Array, rows: Int, pairs: Int, steps_m: Array, cap_m: float, tolerance: float, scratch: Scratch, gaps: Array,
    least: Array, nearest: Int,
) -> None:  # fmt: skip
    """Of each of L paths through configurations Q (N, J) a lower bound of the least distance of any pair at any of them, or cap_m if that
    is less, least (L,); and between which pair, nearest (L,), -1 where nothing comes nearer than cap_m.

    rows (L, 2): from which to before which row of Q a path goes; pairs (L + 1,): where its pairs begin. steps_m (L,): from one row to the
    next no pair comes nearer by more. So rows around one at which a pair is far apart need no look at that pair, and rows without such
    pairs none at all. tolerance: how much of the distance, relative, the bound may be low. gaps: scratch, see `make_gaps`.
    """
    for n in range(least.shape[0]):
        first, last = pairs[n], pairs[n + 1]
        least[n], nearest[n] = _along(problem, Q, rows[n, 0], rows[n, 1], first, last, steps_m[n], cap_m, tolerance, scratch, gaps)


def make_gaps(rows: Int, pairs: Int) -> Array:
    """Scratch for `path_clearances`, whose rows and pairs these are: for each block of the longest path, the gap of each pair."""
    return np.empty((int((rows[:, 1] - rows[:, 0]).max(initial=0)) // BLOCK + 1, int((pairs[1:] - pairs[:-1]).max(initial=0))))


@jit_inline
def _along(
    problem: Problem, Q: Array, start: int, stop: int, first_pair: int, last_pair: int, step_m: float, cap_m: float, tolerance: float,
    scratch: Scratch, gaps: Array,
) -> tuple[float, int]:  # fmt: skip
    """The bound and the pair of one path: rows and pairs from a first one to before a last one."""
    least, pair, n_pairs = cap_m, -1, last_pair - first_pair
    for block in range((stop - start + BLOCK // 2 - 1) // BLOCK):  # a first impression: then most of the rest is too far to matter
        forward(problem.chain, Q[start + block * BLOCK + BLOCK // 2], scratch.poses)
        scratch.counts[0] += 1
        for n in range(n_pairs):
            gaps[block, n] = ball_gap(problem.pairs, problem.boxes, scratch.poses, first_pair + n)
        for n in range(n_pairs):
            if gaps[block, n] < least:
                bound = hull_bound(problem, first_pair + n, least, tolerance, scratch)
                if bound < least:
                    least, pair = bound, first_pair + n
    pool, spans, lists = scratch.pool[0], scratch.spans[0], scratch.lists[0]
    for n in range(n_pairs):
        pool[n] = first_pair + n
    for first in range(start, stop, BLOCK):
        top, block = 1, (first - start) // BLOCK
        spans[0, 0], spans[0, 1], lists[0, 0], lists[0, 1] = first, min(first + BLOCK, stop), 0, n_pairs
        while top > 0:
            top -= 1
            low, high, begin, end = int(spans[top, 0]), int(spans[top, 1]), lists[top, 0], lists[top, 1]
            middle, used, posed, seen = (low + high) // 2, end, False, high - low == BLOCK
            around = step_m * max(middle - low, high - 1 - middle)
            for k in range(begin, end):
                n = pool[k]
                by = around if problem.pairs[n, 2] != problem.pairs[n, 3] else 0.0
                if seen and gaps[block, n - first_pair] >= least + by:
                    continue
                if not posed:
                    posed = True
                    forward(problem.chain, Q[middle], scratch.poses)
                    scratch.counts[0] += 1
                bound = distance_bound(problem, n, least + by, TOLERANCE, scratch)
                if bound < least:
                    bound = distance_bound(problem, n, least, tolerance, scratch)
                    if bound < least:
                        least, pair = bound, n
                if bound < least + by:
                    pool[used] = n
                    used += 1
            if used > end:
                for side in range(2):
                    spans[top, 0], spans[top, 1] = (low, middle) if side == 0 else (middle + 1, high)
                    if spans[top, 0] < spans[top, 1]:
                        lists[top, 0], lists[top, 1] = end, used
                        top += 1
    return least, pair


@jit_inline
def _nearest_pair(problem: Problem, q: Array, first: int, last: int, cap_m: float, tolerance: float, scratch: Scratch) -> tuple[float, int]:
    """A lower bound of the least distance of any pair from the first to before the last at q (J,), and which pair that is; cap_m and -1
    when all are that far apart."""
    forward(problem.chain, q, scratch.poses)
    scratch.counts[0] += 1
    least, nearest = cap_m, -1
    for n in range(first, last):
        bound = distance_bound(problem, n, least, tolerance, scratch)
        if bound < least:
            least, nearest = bound, n
            if least <= 0.0:
                return 0.0, nearest
    return least, nearest
