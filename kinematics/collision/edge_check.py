"""Does the arm come too close to anything: exact verdicts on its convex parts, for one configuration or a whole straight joint-space edge.

`Problem` is one motion query, packed flat for compiled code; `Scratch` is one thread's memory. A pair is two bodies that may not touch:
part and part, or part and solid. Its distance is bounded from below by a ball and a box first, and by GJK (gjk.py) where they don't
decide.

Edges are certified, not sampled: what is apart in the middle of an interval stays so for a while, and certificate.py says how long. What is
undecided then is cut there and asked again, the coarse level of the whole edge first, so that an edge that collides ends early.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Chain, Int, forward
from kinematics.collision.geometry import HULL, Query, Solids
from kinematics.collision.gjk import box_gap, gjk, relative
from kinematics.collision.motion_bounds import begin_edge, safe_interval, twists
from kinematics.collision.posed_geometry import PosedGeometry
from kinematics.jit.decorators import copy_rows, jit_entry, jit_inline
from kinematics.jit.record import record
from kinematics.transforms import Array

Flags = NDArray[np.uint8]
MARGIN_M = 5e-4
"""Bodies closer than this, beyond the clearance that is asked for, count as touching; half of it is what a certified edge keeps everywhere
besides."""
TOLERANCE = 0.05
"""How much of a distance, relative, may be given away for speed; a pair up to 5 % beyond the margin may count as touching."""
LOOSE = 0.5
"""The tolerance for distances that only say how far an edge is free around a sample."""
BLOCK = 16
"""Rows that `path_clearance` looks at together first."""
GJK_PAYS_M = 0.03
"""GJK may prove this much more than the boxes do; where more is asked for, halving the interval is cheaper."""


@record
class Problem(NamedTuple):
    """What moves, what it may not touch, and how fast. Bodies are the P parts, then the B solids.

    boxes (P + B, 7): half sizes and centre of the box around each body along its own axes (a box's and a cylinder's sizes), radius of the
    ball about the same centre. vertices (3, N), groups (4, ·): of all bodies, see `vertex_groups.grouped`. pairs (M, 9): the two bodies,
    the first one a part; their two rows of `Scratch.poses`; the second one's kind; the first one's and the second one's range of vertices.
    reach (M, K): metres that one body of the pair moves at most, relative to the other, per unit of each joint.
    weight (J,): the same for the arm as a whole, never 0. solid_T (B, 4, 4).
    clearance (M,): how far each pair is to stay apart, in metres. A pair counts as touching when it is not further apart than
    clearance + margin_m, and a certified edge keeps at least clearance + margin_m / 2.
    """

    chain: Chain
    boxes: Array
    vertices: Array
    groups: Array
    pairs: Int
    reach: Array
    weight: Array
    solid_T: Array
    margin_m: float
    clearance: Array


@record
class Scratch(NamedTuple):
    """One thread's memory for one `Problem`.

    poses (K + 1 + B, 4, 4): the chain's frames, then the solids. work (8, 4) and toward (M, 3): GJK's, and each pair's last direction.
    q (J,). Of the edge at hand rate (K,), motion (M,), bend (M,) and twist (K + 1, 6), see certificate.py.
    spans (2, ·, 2), lists (2, ·, 2) and pool (2, ·): intervals of the edge that are undecided, where in the pool their undecided pairs are
    listed, and those lists; this level's and the next one's.
    counts (4,): configurations looked at, pairs that came to GJK, edges, edges found free. where (1,): how far along the last blocked edge.
    """

    poses: Array
    work: Array
    toward: Array
    q: Array
    rate: Array
    motion: Array
    bend: Array
    twist: Array
    spans: Array
    lists: Int
    pool: Int
    counts: Int
    where: Array


def pose(chain: Chain, posed: PosedGeometry, solids: Solids, query: Query, margin_m: float) -> Problem:
    """Pack one motion query of posed geometry: the problem that `edge_free` and the others solve."""
    P, B = len(posed.frame), len(solids.kind)
    if query.check.shape != (P, B):
        raise ValueError(f"check {query.check.shape} must say of {P} parts and {B} solids which are asked about")
    if len(query.pairs) and not (query.pairs.min() >= 0 and query.pairs.max() < P):
        raise ValueError(f"pairs name parts from {query.pairs.min()} to {query.pairs.max()}, and there are {P}")
    count, J, K = int(np.count_nonzero(query.check)) + len(query.pairs), len(chain.lower), len(chain.q_index)
    problem = Problem(
        chain,
        np.concatenate([posed.boxes, solids.boxes]),
        np.concatenate([posed.vertices, solids.points], 1),
        np.concatenate([posed.groups, solids.groups], 1),
        np.empty((count, 9), np.int64),
        np.zeros((count, K)),
        np.zeros(J),
        solids.T,
        margin_m,
        np.zeros(count),
    )
    _fill(posed, solids, query, problem, np.empty((count, 4), np.int64))
    return problem


@jit_entry
def _fill(posed: PosedGeometry, solids: Solids, query: Query, problem: Problem, listed: Int) -> None:
    """Fill in pairs, reach and weight. listed (M, 4), scratch: the two bodies of each pair; the one that the joints move which do not
    carry both, and the frame from which on they do."""
    P, n = posed.frame.shape[0], 0
    for p in range(P):
        for b in range(solids.kind.shape[0]):
            if query.check[p, b]:
                listed[n, 0], listed[n, 1], listed[n, 2], listed[n, 3] = p, P + b, p, 0
                n += 1
    for i in range(query.pairs.shape[0]):
        a, b = query.pairs[i, 0], query.pairs[i, 1]
        listed[n, 0], listed[n, 1] = a, b
        listed[n, 2], listed[n, 3] = a if posed.frame[a] >= posed.frame[b] else b, min(posed.frame[a], posed.frame[b])
        n += 1
    chain, weight, pairs, frames = problem.chain, problem.weight, problem.pairs, problem.chain.q_index.shape[0] + 1
    n = 0
    for frame in range(frames - 1, -1, -1):  # the hand collides most often
        for i in range(listed.shape[0]):
            a, b, moved = listed[i, 0], listed[i, 1], listed[i, 2]
            if posed.frame[moved] != frame:
                continue
            solid, before = b - P, posed.start[P]
            pairs[n, 0], pairs[n, 1], pairs[n, 2] = a, b, posed.frame[a]
            pairs[n, 5], pairs[n, 6] = posed.start[a], posed.start[a + 1]
            if solid >= 0:
                pairs[n, 3], pairs[n, 4] = frames + solid, solids.kind[solid]
                pairs[n, 7], pairs[n, 8] = before + solids.point_start[solid], before + solids.point_start[solid + 1]
            else:
                pairs[n, 3], pairs[n, 4], pairs[n, 7], pairs[n, 8] = posed.frame[b], HULL, posed.start[b], posed.start[b + 1]
            for k in range(listed[i, 3], frame):
                problem.reach[n, k] = posed.reach[k, moved]
            n += 1
    for k in range(frames - 1):
        far = 0.0
        for p in range(P):
            far = max(far, posed.reach[k, p])
        weight[chain.q_index[k]] += far * abs(chain.scale[k]) if P else 1.0
    most = 0.0
    for j in range(weight.shape[0]):
        most = max(most, weight[j])
    for j in range(weight.shape[0]):
        weight[j] = max(weight[j], max(1e-9, 0.02 * most))


@jit_entry
def still_apart(problem: Problem, scratch: Scratch) -> bool:
    """Whether all pairs that stand still to each other, such as a held object and the palm, are apart, whatever the arm does."""
    forward(problem.chain, problem.chain.lower, scratch.poses)
    pairs = problem.pairs
    near = False
    for n in range(pairs.shape[0]):
        near = near or (pairs[n, 2] == pairs[n, 3] and _near(problem, scratch, n))
    return not near


@jit_inline
def _near(problem: Problem, scratch: Scratch, n: int) -> bool:
    """Whether pair n is not further apart than its clearance and the margin; in doubt it is near."""
    pairs, boxes, poses, margin = problem.pairs, problem.boxes, scratch.poses, problem.clearance[n] + problem.margin_m
    if ball_gap(pairs, boxes, poses, n) > margin:
        return False
    scratch.counts[1] += 1
    work, toward, high = scratch.work, scratch.toward, margin * (1 + TOLERANCE)
    bound = pair_bound(pairs, boxes, problem.vertices, problem.groups, poses, work, toward, n, margin, high, np.inf, TOLERANCE)
    return bool(bound <= margin)


def some_pairs(problem: Problem, kept: NDArray[np.bool_]) -> Problem:
    """The same problem with some of its pairs alone, kept (M,)."""
    return problem._replace(pairs=problem.pairs[kept], reach=problem.reach[kept], clearance=problem.clearance[kept])


def make_scratch(problem: Problem) -> Scratch:
    """Memory for one thread; it may serve any number of queries on the same problem."""
    scratch = scratch_for(len(problem.chain.q_index), len(problem.chain.lower), len(problem.solid_T), len(problem.pairs))
    enter(problem, scratch)
    return scratch


def scratch_for(joints: int, coordinates: int, solids: int, pairs: int) -> Scratch:
    """Memory for one thread, for all problems that are no larger than this; `enter` each of them first."""
    return Scratch(
        np.zeros((joints + 1 + solids, 4, 4)),
        np.zeros((8, 4)),
        np.zeros((pairs, 3)),
        np.zeros(coordinates),
        np.zeros(joints),
        np.zeros(pairs),
        np.zeros(pairs),
        np.zeros((joints + 1, 6)),
        np.zeros((2, 2048, 2)),
        np.zeros((2, 2048, 2), np.int64),
        np.zeros((2, 16384 + 64 * pairs), np.int64),
        np.zeros(4, np.int64),
        np.zeros(1),
    )


@jit_entry
def enter(problem: Problem, scratch: Scratch) -> None:
    """Make a scratch that served another problem, as large as this one or larger, as good as new for this one."""
    frames, n = problem.chain.q_index.shape[0] + 1, problem.pairs.shape[0]
    for b in range(problem.solid_T.shape[0]):
        copy_rows(problem.solid_T[b], scratch.poses[frames + b])
    for i in range(n):
        scratch.toward[i, 0] = scratch.toward[i, 1] = scratch.toward[i, 2] = 0.0


@jit_entry
def config_free(problem: Problem, q: Array, scratch: Scratch) -> bool:
    """Whether every pair is further apart than its clearance and the margin at q (J,); in doubt it is not."""
    return bool(first_contact(problem, q, scratch) < 0)


@jit_entry
def first_contact(problem: Problem, q: Array, scratch: Scratch) -> int:
    """The index in problem.pairs of a pair that is not further apart than its clearance and the margin at q (J,), -1 when there is none."""
    forward(problem.chain, q, scratch.poses)
    scratch.counts[0] += 1
    for n in range(problem.pairs.shape[0]):
        if _near(problem, scratch, n):
            return n
    return -1


@jit_inline
def frame_contact(problem: Problem, frame: int, T: Array, scratch: Scratch) -> int:
    """As `first_contact`, but of what one frame of the chain carries against the solids alone, the frame being at T (4, 4)."""
    copy_rows(T, scratch.poses[frame])
    frames = problem.chain.q_index.shape[0] + 1
    for n in range(problem.pairs.shape[0]):
        if problem.pairs[n, 2] == frame and problem.pairs[n, 3] >= frames and _near(problem, scratch, n):
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
                bound = _pair_bound(problem, n, least + by, TOLERANCE, scratch)
                if bound < least:
                    bound = _pair_bound(problem, n, least, tolerance, scratch)
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
        bound = _pair_bound(problem, n, least, tolerance, scratch)
        if bound < least:
            least, nearest = bound, n
            if least <= 0.0:
                return 0.0, nearest
    return least, nearest


@jit_inline
def _pair_bound(problem: Problem, n: int, cap_m: float, tolerance: float, scratch: Scratch) -> float:
    """A lower bound of pair n's distance at the poses in the scratch, by the tolerance too low at most; cap_m or more when it is that far
    apart."""
    pairs, boxes, poses = problem.pairs, problem.boxes, scratch.poses
    far = ball_gap(pairs, boxes, poses, n)
    if far >= cap_m:
        return far
    scratch.counts[1] += 1
    work, toward = scratch.work, scratch.toward
    return float(pair_bound(pairs, boxes, problem.vertices, problem.groups, poses, work, toward, n, 0.0, cap_m, np.inf, tolerance))


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
