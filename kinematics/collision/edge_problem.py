"""One motion query for the exact check, packed flat for compiled code: what moves, what it may not touch, and one thread's memory.

A pair is two bodies that may not touch: part and part, or part and solid.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Chain, Int
from kinematics.collision.geometry import HULL, Queries, Query, Solids
from kinematics.collision.posed_geometry import PosedGeometry
from kinematics.jit.decorators import copy_rows, jit_entry, jit_inline
from kinematics.jit.record import record
from kinematics.transforms import Array

MARGIN_M = 5e-4
"""Bodies closer than this, beyond the clearance that is asked for, count as touching; half of it is what a certified edge keeps everywhere
besides."""


Flags = NDArray[np.uint8]


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
    q (J,). Of the edge at hand rate (K,), motion (M,), bend (M,) and twist (K + 1, 6), see motion_bounds.py.
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
        _joined(posed.vertices, solids.points),
        _joined(posed.groups, solids.groups),
        np.empty((count, 9), np.int64),
        np.zeros((count, K)),
        np.zeros(J),
        solids.T,
        margin_m,
        np.zeros(count),
    )
    _fill(posed, solids, query.check, query.pairs, problem)
    return problem


def last_parts_elsewhere(problem: Problem, before: PosedGeometry, last: PosedGeometry) -> Problem:
    """The problem that `pose` makes with the last parts of its posed geometry elsewhere in the frame, or the frames, that carry them.

    before: all parts before those, as they are in the problem; last: the last ones. No part before them is in a frame beyond theirs.
    """
    chain, P, frames = problem.chain, len(before.frame), len(problem.chain.q_index) + 1
    boxes, vertices, groups, reach = (a.copy() for a in (problem.boxes, problem.vertices, problem.groups, problem.reach))
    boxes[P : P + len(last.frame)] = last.boxes
    for all_, some, first in ((vertices, last.vertices, before.vertices.shape[1]), (groups, last.groups, before.groups.shape[1])):
        all_[:, first : first + some.shape[1]] = some
    rows = np.flatnonzero(problem.pairs[:, 0] >= P)
    part, other, k = problem.pairs[rows, 0] - P, problem.pairs[rows, 3, None], np.arange(frames - 1)
    moves = (k < last.frame[part, None]) & ((other >= frames) | (k >= other))
    reach[rows] = np.where(moves, last.reach[:, part].T, 0.0)
    weight = np.zeros(len(chain.lower))
    np.add.at(weight, chain.q_index, np.maximum(before.reach.max(1), last.reach.max(1)) * np.abs(chain.scale))
    weight = np.maximum(weight, max(1e-9, 0.02 * float(weight.max())))
    return problem._replace(boxes=boxes, vertices=vertices, groups=groups, reach=reach, weight=weight)


def pose_all(chain: Chain, posed: PosedGeometry, solids: Solids, queries: Queries) -> tuple[Problem, Int]:
    """Pack the pairs of several queries about the same bodies as one problem, and where the pairs of each begin (S + 1,): for distances at
    configurations. It has no reach, so no edges can be asked about."""
    asked = np.concatenate([[0], np.cumsum(queries.check, dtype=np.int64)])[queries.check_start]
    start = asked + queries.pair_start
    J, K = len(chain.lower), len(chain.q_index)
    problem = Problem(
        chain,
        np.concatenate([posed.boxes, solids.boxes]),
        _joined(posed.vertices, solids.points),
        _joined(posed.groups, solids.groups),
        np.empty((int(start[-1]), 9), np.int64),
        np.zeros((0, K)),
        np.ones(J),
        solids.T,
        0.0,
        np.zeros(0),
    )
    _fill_all(posed, solids, queries, problem)
    return problem, start


def _joined(some: Array, others: Array) -> Array:
    """Columns of both; the very same array where there are no others, as among boxes and cylinders: an arm has ten thousand vertices."""
    return np.concatenate([some, others], 1) if others.shape[1] else some


@jit_entry
def _fill_all(posed: PosedGeometry, solids: Solids, queries: Queries, problem: Problem) -> None:
    """Fill in the pairs of every query, what moves furthest out first."""
    P, frames, n, pairs = posed.frame.shape[0], problem.chain.q_index.shape[0] + 1, 0, problem.pairs
    parts, before = queries.parts, posed.start[P]
    for s in range(queries.rows.shape[0]):
        first, body, check = queries.part_start[s], queries.body_start[s], queries.check_start[s]
        m, B = queries.part_start[s + 1] - first, queries.body_start[s + 1] - body
        for frame in range(frames - 1, -1, -1):  # the hand collides most often
            for i in range(m):
                p = parts[first + i]
                if posed.frame[p] != frame:
                    continue
                for j in range(B):
                    if not queries.check[check + i * B + j]:
                        continue
                    b = queries.bodies[body + j]
                    _first_of(posed, p, pairs[n])
                    pairs[n, 1], pairs[n, 3], pairs[n, 4] = P + b, frames + b, solids.kind[b]
                    pairs[n, 7], pairs[n, 8] = before + solids.point_start[b], before + solids.point_start[b + 1]
                    n += 1
            for k in range(queries.pair_start[s], queries.pair_start[s + 1]):
                a, b = parts[first + queries.pairs[k, 0]], parts[first + queries.pairs[k, 1]]
                if max(posed.frame[a], posed.frame[b]) != frame:
                    continue
                _first_of(posed, a, pairs[n])
                pairs[n, 1], pairs[n, 3], pairs[n, 4] = b, posed.frame[b], HULL
                pairs[n, 7], pairs[n, 8] = posed.start[b], posed.start[b + 1]
                n += 1


@jit_entry
def _fill(posed: PosedGeometry, solids: Solids, check: Flags, own: Int, problem: Problem) -> None:
    """Fill in pairs, reach and weight. check (P, B), own (S, 2): see `Query`."""
    P, n = posed.frame.shape[0], 0
    chain, weight, pairs, frames = problem.chain, problem.weight, problem.pairs, problem.chain.q_index.shape[0] + 1
    before = posed.start[P]
    for frame in range(frames - 1, -1, -1):  # the hand collides most often
        for p in range(P):
            if posed.frame[p] != frame:
                continue
            for b in range(check.shape[1]):
                if not check[p, b]:
                    continue
                _first_of(posed, p, pairs[n])
                pairs[n, 1], pairs[n, 3], pairs[n, 4] = P + b, frames + b, solids.kind[b]
                pairs[n, 7], pairs[n, 8] = before + solids.point_start[b], before + solids.point_start[b + 1]
                for k in range(frame):
                    problem.reach[n, k] = posed.reach[k, p]
                n += 1
        for i in range(own.shape[0]):
            a, b = own[i, 0], own[i, 1]
            if max(posed.frame[a], posed.frame[b]) != frame:
                continue
            moved = a if posed.frame[a] == frame else b  # the one that joints move which do not carry both
            _first_of(posed, a, pairs[n])
            pairs[n, 1], pairs[n, 3], pairs[n, 4], pairs[n, 7], pairs[n, 8] = b, posed.frame[b], HULL, posed.start[b], posed.start[b + 1]
            for k in range(min(posed.frame[a], posed.frame[b]), frame):
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


@jit_inline
def _first_of(posed: PosedGeometry, p: int, pair: Int) -> None:
    """What a row of pairs says of its first body, part p."""
    pair[0], pair[2], pair[5], pair[6] = p, posed.frame[p], posed.start[p], posed.start[p + 1]


def some_pairs(problem: Problem, kept: NDArray[np.bool_]) -> Problem:
    """The same problem with some of its pairs alone, kept (M,)."""
    pairs, reach, clearance = (of_each.compress(kept, 0) for of_each in (problem.pairs, problem.reach, problem.clearance))
    return problem._replace(pairs=pairs, reach=reach, clearance=clearance)


def make_scratch(problem: Problem, at_once: int | None = None) -> Scratch:
    """Memory for one thread; it may serve any number of queries on the same problem. at_once: of how many of its pairs a query is, at most,
    where that are not all."""
    chain, pairs = problem.chain, len(problem.pairs)
    scratch = scratch_for(len(chain.q_index), len(chain.lower), len(problem.solid_T), pairs, pairs if at_once is None else at_once)
    enter(problem, scratch)
    return scratch


def scratch_for(joints: int, coordinates: int, solids: int, pairs: int, at_once: int) -> Scratch:
    """Memory for one thread, for all problems that are no larger than this, and queries of so many pairs at once; `enter` each of them
    first."""
    return Scratch(
        np.zeros((joints + 1 + solids, 4, 4)),
        np.zeros((8, 4)),
        np.zeros((pairs, 3)),
        np.zeros(coordinates),
        np.zeros(joints),
        np.zeros(pairs),
        np.zeros(pairs),
        np.zeros((joints + 1, 6)),
        np.empty((2, 2048, 2)),
        np.empty((2, 2048, 2), np.int64),
        np.empty((2, 16384 + 64 * at_once), np.int64),
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
