"""Sixteen configurations at once: a compiled check that says "free" only where it is certain.

The arm's parts are covered by balls (see covers/levels.py). One batch holds 16 configurations side by side in float32, one a
lane (see simd.py).

Free along an edge. An edge is straight in joint space. It is cut into pieces, a lane takes the middle of one, and every ball grows by the
way that any point of its part can go from there to the piece's ends:

    half the piece's length · sum over joints k of |change of joint k| · reach[k, part]

where reach is the largest distance of a point of the part from joint k's axis in any configuration (1 for a sliding joint): no point moves
faster than that. Of two parts only the joints between them count. So a lane that misses everything clears its whole piece; the others
are cut finer, down to `FINAL_M` of growth. A piece that still touches then is *undecided*; where an inner ball touches it is
certain that the edge does. Bodies and pairs out of reach of the whole edge are left aside after the first batch.

Clearance and bounds: sphere_batch.py. Rounding: sphere_lanes.py.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinematics.array_checks import checked
from kinematics.chain import Int
from kinematics.collision.geometry import Asked, Queries, make_queries
from kinematics.collision.sphere_batch import SphereScratch, check_batch, make_sphere_scratch, open_batch, scratch_for
from kinematics.collision.sphere_lanes import ROW_AT, ROW_X, Mask
from kinematics.collision.sphere_model import F32, Index, SphereModel, SphereWorld
from kinematics.jit.decorators import jit_entry, jit_inline
from kinematics.jit.simd import WIDTH, load, store
from kinematics.transforms import Array

__all__ = [
    "FREE",
    "TOUCHES",
    "UNDECIDED",
    "SphereScratch",
    "configs_free",
    "edge_free",
    "edge_open",
    "make_sphere_scratch",
    "open_pairs",
    "open_rows",
    "scratch_for",
]

FREE, UNDECIDED, TOUCHES = 0, 1, 2
FINAL_M = 0.006  # a piece whose balls grow no more than this is not cut again: the exact test is quicker then

_CONTACT, _TOO_MUCH = -1, -2
_f, _U = np.float32, np.uint64
_W = np.uint64(WIDTH)


@jit_inline
def _begin(M: SphereModel, Wd: SphereWorld, qa: Array, qb: Array, X: SphereScratch) -> float:
    """Joint values at the start, their change and each part's travel; the largest travel comes back, or -1 for a value out of bounds."""
    K, P = M.T.shape[0], M.frame.shape[0]
    for k in range(K):
        j = M.q_index[k]
        a = M.scale[k] * qa[j] + M.offset[k]
        d = M.scale[k] * (qb[j] - qa[j])
        if not (abs(a) <= M.limit[k] and abs(a + d) <= M.limit[k]):  # written so that NaN fails
            return -1.0
        X.start[k], X.step[k] = a, d
    longest = 0.0
    for f in range(K + 1):
        X.all_travel[f] = 0.0
    for p in range(P):
        X.travel[p, 0] = 0.0
        for k in range(M.frame[p]):
            X.travel[p, k + 1] = X.travel[p, k] + abs(X.step[k]) * M.reach[p, k]
        longest = max(longest, X.travel[p, M.frame[p]])
        X.all_travel[M.frame[p]] = max(X.all_travel[M.frame[p]], X.travel[p, M.frame[p]])
    for p in range(P):
        for b in range(Wd.kind.shape[0]):
            X.bodies_on[p, b] = Wd.check[p, b]
        for b in range(P + Wd.kind.shape[0]):
            X.left[p, b] = 0
    for i in range(Wd.pairs.shape[0]):
        X.pairs_on[i] = 1
    return longest


@jit_inline
def _begin_edge(S: F32, X: SphereScratch) -> None:
    """Joint values of the 16 places along the edge that row ROW_AT names."""
    for k in range(_U(X.start.shape[0])):
        a, d, o = _f(X.start[k]), _f(X.step[k]), ROW_X + _W * k
        store(S, o, load(S, ROW_AT) * d + a)


@jit_entry
def edge_free(model: SphereModel, world: SphereWorld, qa: Array, qb: Array, scratch: SphereScratch) -> int:
    """Whether the straight motion from qa (J,) to qb (J,) touches nothing, and keeps the world's clearances.

    FREE: certain, at every point. TOUCHES: certain as well, with the clearances for contact. UNDECIDED: ask an exact check. Joint values
    that are not finite, or a sliding joint beyond its limits, are undecided.
    """
    n = _edge(model, world, qa, qb, scratch, scratch.stack, 0)
    return FREE if n == 0 else TOUCHES if n == _CONTACT else UNDECIDED


@jit_entry
def edge_open(model: SphereModel, world: SphereWorld, qa: Array, qb: Array, scratch: SphereScratch, pieces: Array) -> int:
    """What an exact check still has to look at on the motion from qa to qb: n pieces, from pieces[i, 0] to pieces[i, 1] as shares of the
    way, i < n, the last one first and no two of them in touch, and there only at what scratch.left names; all the rest is free for certain,
    and 0 means that everything is. -1: it touches for certain. -2: more than pieces (N, 2) holds, or joint values that are refused: look at
    everything.
    """
    return _edge(model, world, qa, qb, scratch, pieces, pieces.shape[0])


@jit_inline
def _edge(M: SphereModel, Wd: SphereWorld, qa: Array, qb: Array, X: SphereScratch, pieces: Array, most: int) -> int:
    """`edge_open`, but with room for `most` pieces."""
    longest = _begin(M, Wd, qa, qb, X)
    if longest < 0.0:
        return _TOO_MUCH
    S, stack, lows = X.rows, X.stack, X.lows
    lows[0] = 0.0
    width, top, found, first = 1.0 / 16, 0, 0, True
    parents, cuts = 1, 16  # the batch holds `parents` pieces of the level before, each cut in so many
    for w in range(16):
        S[ROW_AT + _U(w)] = np.float32((w + 0.5) * width)
    while True:
        _begin_edge(S, X)
        last = width * longest <= 2 * FINAL_M
        fail, sure = check_batch(M, Wd, X, width, first, last, False)
        first = False
        if sure != 0:
            return _CONTACT
        if fail != 0:
            for e in range(parents * cuts):
                k = e if last else parents * cuts - 1 - e  # pieces from the edge's end to its start; on the stack the end is on top
                i, j = k // cuts, cuts - 1 - k % cuts
                if (fail >> _U(i * cuts + j)) & _U(1):
                    low = lows[i] + j * width
                    if not last:
                        if top == stack.shape[0]:
                            return _TOO_MUCH
                        stack[top, 0], stack[top, 1] = low, width
                        top += 1
                    elif found > 0 and pieces[found - 1, 0] == low + width:  # no rounding: all these are multiples of a power of two
                        pieces[found - 1, 0] = low
                    else:
                        if found == most:
                            return _TOO_MUCH
                        pieces[found, 0], pieces[found, 1] = low, low + width
                        found += 1
        if top == 0:
            return found
        wide = stack[top - 1, 1]
        cuts = 2
        while cuts < 16 and wide * longest > 2 * FINAL_M * cuts:
            cuts *= 2
        width = wide / cuts
        parents = 0
        while parents < 16 // cuts and top > 0 and stack[top - 1, 1] == wide:
            top -= 1
            lows[parents] = stack[top, 0]
            parents += 1
        for i in range(16 // cuts):
            low = lows[min(i, parents - 1)]
            for j in range(cuts):
                S[ROW_AT + _U(i * cuts + j)] = np.float32(low + (j + 0.5) * width)


def _coordinates(model: SphereModel) -> int:
    """How many joint values an arm has."""
    return int(model.q_index.max()) + 1 if len(model.q_index) else 0


def configs_free(model: SphereModel, world: SphereWorld, Q: Array, scratch: SphereScratch) -> NDArray[np.uint8]:
    """FREE, UNDECIDED or TOUCHES for each configuration of Q (N, J), as (N,)."""
    Q = checked("Q", Q, -1, _coordinates(model), finite=False)
    out = np.empty(len(Q), np.uint8)
    _judge_all(model, world, Q, np.zeros(Q.shape[1]), scratch, out)
    return out


@jit_entry
def _judge_all(model: SphereModel, world: SphereWorld, Q: Array, zero: Array, scratch: SphereScratch, out: NDArray[np.uint8]) -> None:
    _begin(model, world, zero, zero, scratch)  # no travel
    for start in range(0, Q.shape[0], 16):
        refused = _take(model, Q, start, Q.shape[0], scratch.rows)
        fail, sure = check_batch(model, world, scratch, 0.0, False, False, True)
        for w in range(min(16, Q.shape[0] - start)):
            touches, open_ = (sure >> _U(w)) & _U(1), ((fail | refused) >> _U(w)) & _U(1)
            out[start + w] = UNDECIDED if (refused >> _U(w)) & _U(1) else TOUCHES if touches else UNDECIDED if open_ else FREE


def open_pairs(model: SphereModel, world: SphereWorld, Q: Array, scratch: SphereScratch) -> tuple[Int, Int]:
    """The pairs that the covers do not prove apart at configurations Q (N, J): rows (F,) and pairs (F,), in the order of the rows.

    Pair p · B + b is part p against body b, of those in `check`; pair P · B + i is the i-th of `pairs`. Joint values that `edge_free` would
    not decide leave every pair of their row open.
    """
    Q = checked("Q", Q, -1, _coordinates(model), finite=False)
    P, B = world.check.shape
    asked = Asked((0, len(Q)), np.arange(P), np.arange(B), world.check, world.pairs.astype(np.int64))
    found = open_rows(model, world, make_queries([asked]), Q, scratch)
    return found[:, 0], found[:, 1]


def open_rows(model: SphereModel, world: SphereWorld, queries: Queries, Q: Array, scratch: SphereScratch) -> Int:
    """What the covers do not prove apart at configurations Q (N, J) that several queries are about: rows (row of Q, pair, i, j), query by
    query, the rows of Q rising in each.

    In a query with parts (m,) and bodies (b,), pair i · b + j is part i against body j, which is numbered m + j; the pairs of parts
    come after these. Joint values that `edge_free` would not decide leave every pair of their row open.
    """
    most = int((np.diff(queries.check_start) + np.diff(queries.pair_start)).max(initial=0))
    masks, listed, out = np.empty(most, np.uint64), np.empty(most, np.int64), np.empty((4096, 4), np.int64)
    count = _open_rows(model, world, queries, Q, scratch, masks, listed, out)
    if count > len(out):
        out = np.empty((count, 4), np.int64)
        _open_rows(model, world, queries, Q, scratch, masks, listed, out)
    return out[:count]


@jit_entry
def _open_rows(
    model: SphereModel, world: SphereWorld, all: Queries, Q: Array, scratch: SphereScratch, masks: Index, listed: Int, out: Int
) -> int:
    """`open_rows`, as far as `out` has room; how many rows there are. masks, listed: scratch, one a pair."""
    count = 0
    for s in range(all.rows.shape[0]):
        parts, bodies = all.parts[all.part_start[s] : all.part_start[s + 1]], all.bodies[all.body_start[s] : all.body_start[s + 1]]
        check, pairs = all.check[all.check_start[s] : all.check_start[s + 1]], all.pairs[all.pair_start[s] : all.pair_start[s + 1]]
        m, b = parts.shape[0], bodies.shape[0]
        for start in range(all.rows[s, 0], all.rows[s, 1], 16):
            rows = min(16, all.rows[s, 1] - start)
            refused, found = _take(model, Q, start, start + rows, scratch.rows), 0
            for k in range(m * b + pairs.shape[0]):
                masks[k] = 0
            open_batch(model, world, scratch, refused, parts, bodies, check, pairs, masks)
            for k in range(m * b + pairs.shape[0]):
                if masks[k] != _U(0):
                    listed[found] = k
                    found += 1
            for w in range(rows):
                for e in range(found):
                    k = listed[e]
                    if (masks[k] >> _U(w)) & _U(1):
                        if count < out.shape[0]:
                            out[count, 0], out[count, 1] = start + w, k
                            if k < m * b:
                                out[count, 2], out[count, 3] = k // b, m + k % b
                            else:
                                out[count, 2], out[count, 3] = pairs[k - m * b, 0], pairs[k - m * b, 1]
                        count += 1
    return count


@jit_inline
def _take(M: SphereModel, Q: Array, start: int, end: int, S: F32) -> Mask:
    """Rows ROW_X: joint values of Q from row `start` to before `end`, the last one repeated. A bit for each lane with values out of bounds,
    put to 0."""
    refused = _U(0)
    for w in range(16):
        i = min(start + w, end - 1)
        for k in range(M.T.shape[0]):
            x = M.scale[k] * Q[i, M.q_index[k]] + M.offset[k]
            within = abs(x) <= M.limit[k]  # not so for NaN
            S[ROW_X + _U(16 * k + w)] = np.float32(x) if within else np.float32(0.0)
            if not within:
                refused |= _U(1) << _U(w)
    return refused
