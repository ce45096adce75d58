"""How far the two bodies of a pair are apart, from below: by a ball and a box first, and by GJK (gjk.py) where they don't decide."""

from __future__ import annotations

import numpy as np

from kinematics.chain import Int
from kinematics.collision.edge_problem import Problem, Scratch
from kinematics.collision.gjk import box_gap, gjk, relative
from kinematics.jit.decorators import jit_inline
from kinematics.transforms import Array

TOLERANCE = 0.05
"""How much of a distance, relative, may be given away for speed; a pair up to 5 % beyond the margin may count as touching."""


@jit_inline
def too_near(problem: Problem, scratch: Scratch, n: int) -> bool:
    """Whether pair n is not further apart than its clearance and the margin; in doubt it is near."""
    if ball_gap(problem.pairs, problem.boxes, scratch.poses, n) > problem.clearance[n] + problem.margin_m:
        return False
    return bool(hulls_too_near(problem, scratch, n))


@jit_inline
def hulls_too_near(problem: Problem, scratch: Scratch, n: int) -> bool:
    """The same without a look at the ball."""
    pairs, boxes, poses, margin = problem.pairs, problem.boxes, scratch.poses, problem.clearance[n] + problem.margin_m
    scratch.counts[1] += 1
    work, toward, high = scratch.work, scratch.toward, margin * (1 + TOLERANCE)
    bound = pair_bound(pairs, boxes, problem.vertices, problem.groups, poses, work, toward, n, margin, high, np.inf, TOLERANCE)
    return bool(bound <= margin)


@jit_inline
def distance_bound(problem: Problem, n: int, cap_m: float, tolerance: float, scratch: Scratch) -> float:
    """A lower bound of pair n's distance at the poses in the scratch, by the tolerance too low at most; cap_m or more when it is that far
    apart."""
    far = ball_gap(problem.pairs, problem.boxes, scratch.poses, n)
    return far if far >= cap_m else float(hull_bound(problem, n, cap_m, tolerance, scratch))


@jit_inline
def hull_bound(problem: Problem, n: int, cap_m: float, tolerance: float, scratch: Scratch) -> float:
    """The same without a look at the ball."""
    pairs, boxes, poses, work, toward = problem.pairs, problem.boxes, scratch.poses, scratch.work, scratch.toward
    scratch.counts[1] += 1
    return float(pair_bound(pairs, boxes, problem.vertices, problem.groups, poses, work, toward, n, 0.0, cap_m, np.inf, tolerance))


@jit_inline
def ball_gap(pairs: Int, boxes: Array, poses: Array, n: int) -> float:
    """The distance in metres of the ball around the first body of pair n from the box around the second; negative when it reaches it."""
    m = np.uint64(n)  # unsigned: no look for negative indices
    a, b, i, j = np.uint64(pairs[m, 0]), np.uint64(pairs[m, 1]), np.uint64(pairs[m, 2]), np.uint64(pairs[m, 3])
    x, y, z = boxes[a, 3], boxes[a, 4], boxes[a, 5]
    dx = poses[i, 0, 0] * x + poses[i, 0, 1] * y + poses[i, 0, 2] * z + poses[i, 0, 3] - poses[j, 0, 3]
    dy = poses[i, 1, 0] * x + poses[i, 1, 1] * y + poses[i, 1, 2] * z + poses[i, 1, 3] - poses[j, 1, 3]
    dz = poses[i, 2, 0] * x + poses[i, 2, 1] * y + poses[i, 2, 2] * z + poses[i, 2, 3] - poses[j, 2, 3]
    ex = max(abs(poses[j, 0, 0] * dx + poses[j, 1, 0] * dy + poses[j, 2, 0] * dz - boxes[b, 3]) - boxes[b, 0], 0.0)
    ey = max(abs(poses[j, 0, 1] * dx + poses[j, 1, 1] * dy + poses[j, 2, 1] * dz - boxes[b, 4]) - boxes[b, 1], 0.0)
    ez = max(abs(poses[j, 0, 2] * dx + poses[j, 1, 2] * dy + poses[j, 2, 2] * dz - boxes[b, 5]) - boxes[b, 2], 0.0)
    return float(np.sqrt(ex * ex + ey * ey + ez * ez) - boxes[a, 6])


@jit_inline
def pair_bound(
    pairs: Int,
    boxes: Array,
    vertices: Array,
    groups: Array,
    poses: Array,
    work: Array,
    toward: Array,
    n: int,
    low: float,
    high: float,
    pays: float,
    tolerance: float,
) -> float:
    """A lower bound in metres of the distance of pair n: at least `high`, or at most `low`, or within the tolerance.

    The boxes' bound, when it lies between low and high, is taken as it is if it falls short of high by more than `pays`.
    """
    m = np.uint64(n)
    b = np.uint64(pairs[m, 1])
    work[7, 3] = 0.0
    relative(poses[np.uint64(pairs[m, 2])], poses[np.uint64(pairs[m, 3])], work)
    cheap = box_gap(boxes, pairs[m, 0], pairs[m, 1], work)
    if cheap >= high or (cheap > low and cheap < high - pays):
        return float(cheap)
    work[7, 0], work[7, 1], work[7, 2] = toward[m, 0], toward[m, 1], toward[m, 2]
    hx, hy, hz = boxes[b, 0], boxes[b, 1], boxes[b, 2]
    bound = gjk(vertices, groups, pairs[m, 5], pairs[m, 6], pairs[m, 4], hx, hy, hz, pairs[m, 7], pairs[m, 8], work, low, high, tolerance)
    toward[m, 0], toward[m, 1], toward[m, 2] = work[7, 0], work[7, 1], work[7, 2]
    return float(max(bound, cheap))
