"""Does the arm come too close to anything: exact verdicts on its convex parts, for one configuration or a whole straight joint-space edge.

Edges are certified, not sampled: what is apart in the middle of an interval stays so for a while, and motion_bounds.py says how long. What
is undecided then is cut there and asked again, the coarse level of the whole edge first, so that an edge that collides ends early.
"""

from __future__ import annotations

import numpy as np

from kinematics.chain import forward
from kinematics.collision.edge_problem import Flags, Problem, Scratch
from kinematics.collision.motion_bounds import begin_edge, safe_interval, twists
from kinematics.collision.pair_bounds import ball_gap, hulls_too_near, pair_bound, too_near
from kinematics.jit.decorators import copy_rows, jit_entry, jit_inline
from kinematics.transforms import Array

LOOSE = 0.5
"""The tolerance for distances that only say how far an edge is free around a sample."""
GJK_PAYS_M = 0.03
"""GJK may prove this much more than the boxes do; where more is asked for, halving the interval is cheaper."""


@jit_entry
def still_apart(problem: Problem, scratch: Scratch) -> bool:
    """Whether all pairs that stand still to each other, such as a held object and the palm, are apart, whatever the arm does."""
    forward(problem.chain, problem.chain.lower, scratch.poses)
    pairs = problem.pairs
    near = False
    for n in range(pairs.shape[0]):
        near = near or (pairs[n, 2] == pairs[n, 3] and too_near(problem, scratch, n))
    return not near


@jit_entry
def config_free(problem: Problem, q: Array, scratch: Scratch) -> bool:
    """Whether every pair is further apart than its clearance and the margin at q (J,); in doubt it is not."""
    return bool(first_contact(problem, q, scratch) < 0)


@jit_entry
def first_contact(problem: Problem, q: Array, scratch: Scratch) -> int:
    """The index in problem.pairs of a pair that is not further apart than its clearance and the margin at q (J,), -1 when there is none."""
    forward(problem.chain, q, scratch.poses)
    scratch.counts[0] += 1
    pairs, boxes, poses = problem.pairs, problem.boxes, scratch.poses
    part, cx, cy, cz, radius = np.int64(-1), 0.0, 0.0, 0.0, 0.0
    for n in range(pairs.shape[0]):  # as `ball_gap`; the pairs of a part follow one another
        m = np.uint64(n)  # unsigned: no look for negative indices
        a, b, i, j = np.uint64(pairs[m, 0]), np.uint64(pairs[m, 1]), np.uint64(pairs[m, 2]), np.uint64(pairs[m, 3])
        if pairs[m, 0] != part:
            part, radius = pairs[m, 0], boxes[a, 6]
            x, y, z = boxes[a, 3], boxes[a, 4], boxes[a, 5]
            cx = poses[i, 0, 0] * x + poses[i, 0, 1] * y + poses[i, 0, 2] * z + poses[i, 0, 3]
            cy = poses[i, 1, 0] * x + poses[i, 1, 1] * y + poses[i, 1, 2] * z + poses[i, 1, 3]
            cz = poses[i, 2, 0] * x + poses[i, 2, 1] * y + poses[i, 2, 2] * z + poses[i, 2, 3]
        dx, dy, dz = cx - poses[j, 0, 3], cy - poses[j, 1, 3], cz - poses[j, 2, 3]
        ex = max(abs(poses[j, 0, 0] * dx + poses[j, 1, 0] * dy + poses[j, 2, 0] * dz - boxes[b, 3]) - boxes[b, 0], 0.0)
        ey = max(abs(poses[j, 0, 1] * dx + poses[j, 1, 1] * dy + poses[j, 2, 1] * dz - boxes[b, 4]) - boxes[b, 1], 0.0)
        ez = max(abs(poses[j, 0, 2] * dx + poses[j, 1, 2] * dy + poses[j, 2, 2] * dz - boxes[b, 5]) - boxes[b, 2], 0.0)
        far = problem.clearance[m] + problem.margin_m + radius
        if not ex * ex + ey * ey + ez * ez > far * far and hulls_too_near(problem, scratch, n):  # not so for NaN, which is in doubt
            return int(n)
    return -1


@jit_inline
def frame_contact(problem: Problem, frame: int, T: Array, scratch: Scratch) -> int:
    """As `first_contact`, but of what one frame of the chain carries against the solids alone, the frame being at T (4, 4)."""
    copy_rows(T, scratch.poses[frame])
    frames = problem.chain.q_index.shape[0] + 1
    for n in range(problem.pairs.shape[0]):
        if problem.pairs[n, 2] == frame and problem.pairs[n, 3] >= frames and too_near(problem, scratch, n):
            return n
    return -1


@jit_entry
def first_in_contact(problem: Problem, Q: Array, scratch: Scratch) -> int:
    """The index of the first of configurations Q (N, J) at which something touches, -1 when nothing ever does."""
    for i in range(Q.shape[0]):
        if first_contact(problem, Q[i], scratch) >= 0:
            return i
    return -1


@jit_entry
def edge_free(problem: Problem, qa: Array, qb: Array, scratch: Scratch) -> bool:
    """Whether the arm may move straight from qa to qb (J,).

    True is certain: every pair keeps its clearance and half the margin anywhere on the edge. False: some configuration on it has a pair
    that is not further apart than its clearance and the margin.
    """
    return bool(edge_contact(problem, qa, qb, scratch) < 0)


@jit_entry
def edge_contact(problem: Problem, qa: Array, qb: Array, scratch: Scratch) -> int:
    """As `edge_free`: -1 when free, else the index in problem.pairs of a pair that blocks, scratch.where[0] in [0, 1] of the way along."""
    n_pairs = problem.pairs.shape[0]
    for n in range(n_pairs):
        scratch.pool[0, n] = n
    scratch.spans[0, 0, 0], scratch.spans[0, 0, 1] = 0.0, 1.0
    return int(_search(problem, qa, qb, 1, n_pairs, scratch))


@jit_entry
def pieces_free(problem: Problem, qa: Array, qb: Array, pieces: Array, count: int, open_: Flags, scratch: Scratch) -> bool:
    """As `edge_free`, for some pieces of the edge and some pairs alone: from pieces[i, 0] to pieces[i, 1] of the way, i < count, and the
    pairs of bodies a, b with open_[a, b]."""
    n_pairs = 0
    for n in range(problem.pairs.shape[0]):
        if open_[problem.pairs[n, 0], problem.pairs[n, 1]]:
            scratch.pool[0, n_pairs] = n
            n_pairs += 1
    for i in range(count):
        scratch.spans[0, i, 0], scratch.spans[0, i, 1] = pieces[i, 0], pieces[i, 1]
    return bool(_search(problem, qa, qb, count, n_pairs, scratch) < 0)


@jit_inline
def _search(problem: Problem, qa: Array, qb: Array, count: int, n_pairs: int, scratch: Scratch) -> int:
    """`edge_contact` for the first `count` spans and the first n_pairs pairs of the pool."""
    pairs, boxes, vertices, groups = problem.pairs, problem.boxes, problem.vertices, problem.groups
    poses, work, toward, counts, q = scratch.poses, scratch.work, scratch.toward, scratch.counts, scratch.q
    spans, lists, pool, motion = scratch.spans, scratch.lists, scratch.pool, scratch.motion
    clearance, own_margin = problem.clearance, problem.margin_m
    counts[2] += 1
    begin_edge(problem.chain, problem.reach, qa, qb, pool[0, :n_pairs], scratch.rate, motion, scratch.bend)
    for s in range(count):
        lists[0, s, 0], lists[0, s, 1] = 0, n_pairs
    now = 0
    while count > 0:
        after, next_count, used = 1 - now, 0, 0
        for s in range(count):
            low, high = spans[now, s, 0], spans[now, s, 1]
            t, h = 0.5 * (low + high), 0.5 * (high - low)
            for j in range(qa.shape[0]):
                q[j] = qa[j] + t * (qb[j] - qa[j])
            forward(problem.chain, q, poses)
            twists(problem.chain, scratch.rate, poses, scratch.twist)
            counts[0] += 1
            begin, back, ahead = used, h, h
            for i in range(lists[now, s, 0], lists[now, s, 0] + lists[now, s, 1]):
                n = pool[now, i]
                margin, keep = clearance[n] + own_margin, clearance[n] + 0.5 * own_margin
                need = keep + motion[n] * h
                bound = ball_gap(pairs, boxes, poses, n)
                if bound >= need:
                    continue
                counts[1] += 1
                bound = pair_bound(pairs, boxes, vertices, groups, poses, work, toward, n, margin, need, GJK_PAYS_M, LOOSE)
                if bound >= need:
                    continue
                if bound <= margin or used == pool.shape[1] or next_count + 2 > spans.shape[1]:  # out of memory reads as blocked
                    scratch.where[0] = t
                    return int(n)
                any_way = (bound - keep) / motion[n]
                to_low, to_high = safe_interval(pairs, boxes, poses, scratch.twist, work, n, keep, scratch.bend[n])
                to_low, to_high = max(to_low, any_way), max(to_high, any_way)
                if to_low < h or to_high < h:
                    back, ahead = min(back, to_low), min(ahead, to_high)
                    pool[after, used] = n
                    used += 1
            for side in range(2):
                if (back if side == 0 else ahead) < h:
                    spans[after, next_count, 0] = low if side == 0 else t + ahead
                    spans[after, next_count, 1] = t - back if side == 0 else high
                    lists[after, next_count, 0], lists[after, next_count, 1] = begin, used - begin
                    next_count += 1
        now, count = after, next_count
    counts[3] += 1
    return -1
