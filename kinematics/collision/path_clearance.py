"""The least distance of any pair at one configuration, or at any of many along a path."""

from __future__ import annotations

from kinematics.chain import forward
from kinematics.collision.edge_problem import Problem, Scratch
from kinematics.collision.pair_bounds import TOLERANCE, distance_bound
from kinematics.jit.decorators import jit_entry, jit_inline
from kinematics.transforms import Array

BLOCK = 16
"""Rows that `path_clearance` looks at together first."""


@jit_entry
def config_clearance(problem: Problem, q: Array, cap_m: float, scratch: Scratch) -> float:
    """A lower bound, at most 5 % low, of the least distance of any pair at q (J,), or cap_m if that is less; 0 when something touches."""
    least, _ = _nearest_pair(problem, q, cap_m, TOLERANCE, scratch)
    return float(least)


@jit_entry
def path_clearance(problem: Problem, Q: Array, step_m: float, cap_m: float, tolerance: float, scratch: Scratch) -> tuple[float, int, int]:
    """A lower bound of the least distance of any pair at any of configurations Q (N, J), or cap_m if that is less; in which row that is,
    and between which pair, -1 where nothing comes nearer than cap_m.

    step_m: from one row to the next no pair comes nearer by more. So rows around one at which a pair is far apart need no look at that
    pair, and rows without such pairs none at all. tolerance: how much of the distance, relative, the bound may be low.
    """
    least, row, pair, n_pairs, N = cap_m, -1, -1, problem.pairs.shape[0], Q.shape[0]
    for i in range(BLOCK // 2, N, BLOCK):  # a first impression, so that most of the rest is not near enough to matter
        bound, n = _nearest_pair(problem, Q[i], least, tolerance, scratch)
        if bound < least:
            least, row, pair = bound, i, n
    pool, spans, lists = scratch.pool[0], scratch.spans[0], scratch.lists[0]
    for n in range(n_pairs):
        pool[n] = n
    for first in range(0, N, BLOCK):
        top = 1
        spans[0, 0], spans[0, 1], lists[0, 0], lists[0, 1] = first, min(first + BLOCK, N), 0, n_pairs
        while top > 0:
            top -= 1
            low, high, begin, end = int(spans[top, 0]), int(spans[top, 1]), lists[top, 0], lists[top, 1]
            middle, used = (low + high) // 2, end
            around = step_m * max(middle - low, high - 1 - middle)
            forward(problem.chain, Q[middle], scratch.poses)
            scratch.counts[0] += 1
            for k in range(begin, end):
                n = pool[k]
                by = around if problem.pairs[n, 2] != problem.pairs[n, 3] else 0.0
                bound = distance_bound(problem, n, least + by, TOLERANCE, scratch)
                if bound < least:
                    bound = distance_bound(problem, n, least, tolerance, scratch)
                    if bound < least:
                        least, row, pair = bound, middle, n
                if bound < least + by:
                    pool[used] = n
                    used += 1
            if used > end:
                for side in range(2):
                    spans[top, 0], spans[top, 1] = (low, middle) if side == 0 else (middle + 1, high)
                    if spans[top, 0] < spans[top, 1]:
                        lists[top, 0], lists[top, 1] = end, used
                        top += 1
    return least, row, pair


@jit_inline
def _nearest_pair(problem: Problem, q: Array, cap_m: float, tolerance: float, scratch: Scratch) -> tuple[float, int]:
    """A lower bound of the least distance of any pair at q (J,), and which pair that is; cap_m and -1 when all are that far apart."""
    forward(problem.chain, q, scratch.poses)
    scratch.counts[0] += 1
    least, nearest = cap_m, -1
    for n in range(problem.pairs.shape[0]):
        bound = distance_bound(problem, n, least, tolerance, scratch)
        if bound < least:
            least, nearest = bound, n
            if least <= 0.0:
                return 0.0, nearest
    return least, nearest
