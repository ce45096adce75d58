"""Sixteen configurations at once: a compiled check that says "free" only where it is certain.

The arm's parts are covered by balls (see spheres.py). One batch holds 16 configurations side by side, one a lane, in float32; every
loop over the lanes has constant length and works on rows of one flat array, which is what LLVM needs to turn it into vector code.

Free along an edge. An edge is straight in joint space. It is cut into pieces, a lane takes the middle of one, and every ball grows by the
way that any point of its part can go from there to the piece's ends:

    half the piece's length · sum over joints k of |change of joint k| · reach[k, part]

where reach is the largest distance of a point of the part from joint k's axis in any configuration (1 for a sliding joint): no point moves
faster than that. Of two parts only the joints between them count. So a lane that misses everything clears its whole piece; the others
are cut finer, down to `FINAL_M` of growth. A piece that still touches then is *undecided*; where an inner ball touches it is
certain that the edge does. Bodies and pairs out of reach of the whole edge are left aside after the first batch.

Bounds go coarse to fine: a part's bounding ball, its coarse balls, and only the fine balls that a touching coarse ball lists.

Rounding. With u = 2^-24, a lane's joint value is off by at most 4u·|x| with |x| <= X_MAX = 16, so by 64u; sine and cosine by 6u more; the
products of one joint by 8u of the lengths involved. So one joint moves a point by less than 80u times its distance from the base, K joints
by K times that, and placing a ball, the body's own numbers and the comparison by no more than two joints would. `_RATIO` = 96u leaves a fifth
to spare, and the tests compare with float64. For a UR5e this is below 0.1 mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache, partial
from typing import NamedTuple

import numba
import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from kinematics.arm import BOX, CYLINDER, HULL, Chain, Parts, Query, Solids
from kinematics.spheres import Levels
from kinematics.transforms import Array

numba.config.SLP_VECTORIZE = 1  # read at each compilation; loops of 16 are unrolled first, so it is this pass that makes vectors of them

F32 = NDArray[np.float32]
Index = NDArray[np.uint64]

FREE, UNDECIDED, TOUCHES = 0, 1, 2
LANES = 16
FINAL_M = 0.0015  # a piece whose balls grow no more than this is not cut again
FINE_M, COARSE_M = 0.010, 0.040  # up to so much growth the fine and the coarse balls are worth a look
X_MAX = 16.0  # joint values beyond this are refused: float32 has too few digits left for them

_RATIO = 96 * 2.0**-24
_fast = partial(njit, cache=True, nogil=True, fastmath={"reassoc", "nsz", "arcp", "contract", "afn"}, error_model="numpy")
_f = np.float32
_U = np.uint64
_W = np.uint64(LANES)
_ZERO, _ONE, _HALF, _TWO = _f(0), _f(1), _f(0.5), _f(2)
_TURN, _TURN_HI, _TURN_LO = _f(1 / (2 * np.pi)), _f(6.28125), _f(2 * np.pi - 6.28125)
_S3, _S5, _S7, _S9, _S11 = _f(-1 / 6), _f(1 / 120), _f(-1 / 5040), _f(1 / 362880), _f(-1 / 39916800)

_C2, _C4, _C6, _C8, _C10, _C12 = _f(-0.5), _f(1 / 24), _f(-1 / 720), _f(1 / 40320), _f(-1 / 3628800), _f(1 / 479001600)
_FAR = _f(-1e9)

# Rows of the flat array, 16 numbers each.
_FAIL, _SURE, _HIT, _MASK = (_U(16 * i) for i in range(4))  # lanes that touch so far; certainly; in the last test; by a coarse ball
_BALL, _OTHER, _REL, _AT, _X = _U(16 * 4), _U(16 * 7), _U(16 * 10), _U(16 * 22), _U(16 * 23)  # _X: K values, K sines, K cosines, frames, bounds


class LaneModel(NamedTuple):
    """A chain and its covered parts, for 16 lanes; float32 where the kernel reads it.

    T (K, 12): the rows of T_prev. limit (K,): largest joint value. frame (P,), bound (P, 4): a ball around each part.
    coarse (C, 5): centre, outer and inner radius; part p's are coarse_start[p]:coarse_start[p + 1]. fine (F, 5), child_start (C + 1,),
    child (·,): as in `Levels`. reach (P, K): see above. slack (P,): the rounding allowance, metres.
    """

    T: F32
    q_index: Index
    scale: Array
    offset: Array
    prismatic: Index
    limit: Array
    frame: Index
    bound: F32
    coarse_start: Index
    coarse: F32
    child_start: Index
    child: Index
    fine: F32
    reach: Array
    slack: Array


class LaneWorld(NamedTuple):
    """Solids and the question. T (B, 12): world to body, as rows of a (3, 4) matrix on points less centre... see `_into_body`.

    kind (B,), R (B, 9): rows of R_body_world, p (B, 3): the body's origin, half (B, 3), planes (H, 4) of hulls in their own frames, plane_start
    (B + 1,), ball (B, 4): a ball around each, slack (B,): rounding allowance; check (P, B), pairs (S, 2): see `Query`.
    """

    kind: Index
    R: F32
    p: F32
    half: F32
    plane_start: Index
    planes: F32
    ball: F32
    slack: Array
    check: NDArray[np.uint8]
    pairs: Index


class LaneScratch(NamedTuple):
    """Working memory of one thread: `lane_scratch` makes it, and it may be used for any number of calls with the same sizes or smaller."""

    rows: F32
    start: Array
    step: Array
    travel: Array
    bodies_on: NDArray[np.uint8]
    pairs_on: NDArray[np.uint8]
    stack: Array


# Building


def lane_model(chain: Chain, parts: Parts, covers: Sequence[Levels]) -> LaneModel:
    """Pack a chain, its P parts and their covers, given in the parts' frames. Raises: ValueError when the numbers differ."""
    if len(covers) != len(parts.frame):
        raise ValueError(f"covers: {len(covers)} for {len(parts.frame)} parts")
    coarse_n = np.array([len(c.coarse.radii) for c in covers], np.int64)
    fine_n = np.array([len(c.fine.radii) for c in covers], np.int64)
    child_n = np.concatenate([np.diff(c.start) for c in covers]) if covers else np.zeros(0, np.int64)
    fine_before = np.concatenate([[0], np.cumsum(fine_n)])
    size, reach, limit = _reaches(chain, parts)
    return LaneModel(
        np.ascontiguousarray(chain.T_prev[:, :3].reshape(-1, 12), np.float32),
        chain.q_index.astype(np.uint64),
        chain.scale,
        chain.offset,
        chain.prismatic.astype(np.uint64),
        limit,
        parts.frame.astype(np.uint64),
        np.ascontiguousarray(np.c_[parts.centre, parts.radius], np.float32),
        _starts(coarse_n),
        _rows([np.c_[c.coarse.centres, c.coarse.radii, c.coarse.inner_radii()] for c in covers], 5),
        _starts(child_n),
        np.concatenate([c.child + n for c, n in zip(covers, fine_before[:-1], strict=True)] or [np.zeros(0)]).astype(np.uint64),
        _rows([np.c_[c.fine.centres, c.fine.radii, c.fine.inner_radii()] for c in covers], 5),
        reach,
        _RATIO * (len(chain.q_index) + 2) * size,
    )


def lane_world(solids: Solids, query: Query) -> LaneWorld:
    """Pack the bodies and the question about them."""
    planes = [
        _planes(solids.vertices[solids.start[b] : solids.start[b + 1]].tobytes()) if solids.kind[b] == HULL else _NO_PLANES
        for b in range(len(solids.kind))
    ]
    R, p = solids.T[:, :3, :3], solids.T[:, :3, 3]
    return LaneWorld(
        solids.kind.astype(np.uint64),
        np.ascontiguousarray(R.transpose(0, 2, 1).reshape(-1, 9), np.float32),
        p.astype(np.float32),
        solids.half.astype(np.float32),
        _starts(np.array([len(x) for x in planes], np.int64)),
        _rows(planes, 4),
        np.concatenate([solids.centre, solids.radius[:, None]], 1).astype(np.float32),
        _RATIO * (np.sqrt((p * p).sum(1)) + np.sqrt((solids.centre * solids.centre).sum(1)) + 2 * solids.radius),
        query.check,
        query.pairs.reshape(-1, 2).astype(np.uint64),
    )


@njit(cache=True, nogil=True)
def lane_scratch(model: LaneModel, world: LaneWorld) -> LaneScratch:
    """Working memory for calls with this model and this world."""
    K, P, B, S = model.T.shape[0], model.frame.shape[0], world.kind.shape[0], world.pairs.shape[0]
    rows = np.zeros(16 * (23 + 3 * K + 12 * (K + 1) + 3 * P), np.float32)
    first = 16 * (23 + 3 * K)
    for r in range(3):
        for w in range(16):
            rows[first + 16 * (5 * r) + w] = 1.0
    return LaneScratch(
        rows, np.empty(K), np.empty(K), np.empty((P, K + 1)), np.empty((P, B), np.uint8), np.empty(S, np.uint8), np.empty((1024, 3))
    )


_NO_PLANES = np.zeros((0, 4))


@lru_cache(maxsize=1024)
def _planes(vertices: bytes) -> Array:
    """Planes (H, 4) of a hull: outward unit normal and offset."""
    planes = ConvexHull(np.frombuffer(vertices).reshape(-1, 3)).equations
    return np.unique(np.round(planes * (1, 1, 1, -1), 9), axis=0)


def _starts(counts: NDArray[np.int64]) -> Index:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.uint64)


def _rows(blocks: list[Array], width: int) -> F32:
    return np.ascontiguousarray(np.concatenate([*blocks, np.zeros((0, width))]), np.float32)


@njit(cache=True, nogil=True)
def _reaches(chain: Chain, parts: Parts) -> tuple[Array, Array, Array]:
    """size (P,): how far from the world's origin a part can get; reach (P, K): see the module; limit (K,): the largest joint values.

    The triangle inequality along the chain, from the part backwards: no configuration can do better.
    """
    K, P = chain.q_index.shape[0], parts.frame.shape[0]
    size, reach, limit = np.empty(P), np.zeros((P, K)), np.full(K, X_MAX)
    slide = np.zeros(K)
    for k in range(K):
        if chain.prismatic[k]:
            for q in (chain.lower[chain.q_index[k]], chain.upper[chain.q_index[k]]):
                slide[k] = max(slide[k], abs(chain.scale[k] * q + chain.offset[k]) + 1e-6)
            limit[k] = min(slide[k], X_MAX)
    for p in range(P):
        far, off = 0.0, 0.0
        for i in range(parts.start[p], parts.start[p + 1]):
            v = parts.vertices[i]
            off = max(off, np.sqrt(v[0] * v[0] + v[1] * v[1]))
            far = max(far, np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]))
        for k in range(parts.frame[p] - 1, -1, -1):
            reach[p, k] = 1.0 if chain.prismatic[k] else off
            t = chain.T_prev[k, :3, 3]
            off = np.sqrt(t[0] * t[0] + t[1] * t[1]) + slide[k] + far
            far = np.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2]) + slide[k] + far
        size[p] = far
    return size, reach, limit


# One batch: 16 lanes against everything


@_fast
def _sines(S: F32, K: int) -> None:
    """Sines and cosines of the K joint values, by whole turns and half angles; off by less than 6 · 2^-24."""
    for k in range(K):
        x = _X + _W * k
        s, c = x + _W * K, x + _W * _U(2) * K
        for w in range(_W):
            a = S[x + w]
            turns = _f(np.int32(a * _TURN + (_HALF if a >= _ZERO else -_HALF)))
            y = ((a - turns * _TURN_HI) - turns * _TURN_LO) * _HALF
            z = y * y
            si = y * (_ONE + z * (_S3 + z * (_S5 + z * (_S7 + z * (_S9 + z * _S11)))))
            co = _ONE + z * (_C2 + z * (_C4 + z * (_C6 + z * (_C8 + z * (_C10 + z * _C12)))))
            S[s + w] = _TWO * si * co
            S[c + w] = _ONE - _TWO * si * si


@_fast
def _frames(S: F32, M: LaneModel) -> None:
    """Forward kinematics of all lanes: joint values in rows _X to the frames' rows; frame 0, the world, stands there already."""
    K = _U(M.T.shape[0])
    _sines(S, K)
    for k in range(K):
        O = M.T[k]
        o00, o01, o02, o03 = O[0], O[1], O[2], O[3]
        o10, o11, o12, o13 = O[4], O[5], O[6], O[7]
        o20, o21, o22, o23 = O[8], O[9], O[10], O[11]
        v = _X + _W * k
        b, c = v + _W * K, v + _W * _U(2) * K
        p = _X + _W * (_U(3) * K + _U(12) * k)
        n = p + _U(12) * _W
        if M.prismatic[k]:
            for r in range(_U(3)):
                i, j = p + _U(4) * r * _W, n + _U(4) * r * _W
                for w in range(_W):
                    x, y, z, t = S[i + w], S[i + _W + w], S[i + _U(2) * _W + w], S[i + _U(3) * _W + w]
                    m2 = x * o02 + y * o12 + z * o22
                    S[j + w] = x * o00 + y * o10 + z * o20
                    S[j + _W + w] = x * o01 + y * o11 + z * o21
                    S[j + _U(2) * _W + w] = m2
                    S[j + _U(3) * _W + w] = x * o03 + y * o13 + z * o23 + t + m2 * S[v + w]
        else:
            for r in range(_U(3)):
                i, j = p + _U(4) * r * _W, n + _U(4) * r * _W
                for w in range(_W):
                    x, y, z, t = S[i + w], S[i + _W + w], S[i + _U(2) * _W + w], S[i + _U(3) * _W + w]
                    m0 = x * o00 + y * o10 + z * o20
                    m1 = x * o01 + y * o11 + z * o21
                    si, co = S[b + w], S[c + w]
                    S[j + w] = m0 * co + m1 * si
                    S[j + _W + w] = m1 * co - m0 * si
                    S[j + _U(2) * _W + w] = x * o02 + y * o12 + z * o22
                    S[j + _U(3) * _W + w] = x * o03 + y * o13 + z * o23 + t


@_fast
def _put(S: F32, T: int, x: float, y: float, z: float, o: int) -> None:
    """Rows o, o + 1, o + 2: the point (x, y, z) mapped by the frame in the 12 rows from T on."""
    for r in range(_U(3)):
        p, q = T + _U(4) * r * _W, o + r * _W
        for w in range(_W):
            S[q + w] = S[p + w] * x + S[p + _W + w] * y + S[p + _U(2) * _W + w] * z + S[p + _U(3) * _W + w]


@_fast
def _point_into_body(S: F32, o: int, Wd: LaneWorld, b: int) -> None:
    """Rows _BALL: the point in rows o (world) in body b's frame."""
    R, p = Wd.R[b], Wd.p[b]
    x0, y0, z0 = p[0], p[1], p[2]
    for r in range(_U(3)):
        a0, a1, a2 = R[_U(3) * r], R[_U(3) * r + _U(1)], R[_U(3) * r + _U(2)]
        q = _BALL + r * _W
        for w in range(_W):
            S[q + w] = a0 * (S[o + w] - x0) + a1 * (S[o + _W + w] - y0) + a2 * (S[o + _U(2) * _W + w] - z0)


@_fast
def _frame_into_body(S: F32, T: int, Wd: LaneWorld, b: int) -> None:
    """Rows _REL: the frame in the rows from T on, seen from body b."""
    R, p = Wd.R[b], Wd.p[b]
    x0, y0, z0 = p[0], p[1], p[2]
    for r in range(_U(3)):
        a0, a1, a2 = R[_U(3) * r], R[_U(3) * r + _U(1)], R[_U(3) * r + _U(2)]
        q = _REL + _U(4) * r * _W
        for c in range(_U(3)):
            i, j = T + c * _W, q + c * _W
            for w in range(_W):
                S[j + w] = a0 * S[i + w] + a1 * S[i + _U(4) * _W + w] + a2 * S[i + _U(8) * _W + w]
        i, j = T + _U(3) * _W, q + _U(3) * _W
        for w in range(_W):
            S[j + w] = a0 * (S[i + w] - x0) + a1 * (S[i + _U(4) * _W + w] - y0) + a2 * (S[i + _U(8) * _W + w] - z0)


@_fast
def _frame_into_frame(S: F32, T: int, A: int) -> None:
    """Rows _REL: the frame in the rows from T on, seen from the frame in the rows from A on."""
    for r in range(_U(3)):
        q, a = _REL + _U(4) * r * _W, A + r * _W
        for c in range(_U(3)):
            i, j = T + c * _W, q + c * _W
            for w in range(_W):
                S[j + w] = S[a + w] * S[i + w] + S[a + _U(4) * _W + w] * S[i + _U(4) * _W + w] + S[a + _U(8) * _W + w] * S[i + _U(8) * _W + w]
        i, d, j = T + _U(3) * _W, A + _U(3) * _W, q + _U(3) * _W
        for w in range(_W):
            S[j + w] = (
                S[a + w] * (S[i + w] - S[d + w])
                + S[a + _U(4) * _W + w] * (S[i + _U(4) * _W + w] - S[d + _U(4) * _W + w])
                + S[a + _U(8) * _W + w] * (S[i + _U(8) * _W + w] - S[d + _U(8) * _W + w])
            )


@_fast
def _hits(S: F32, Wd: LaneWorld, b: int, r: float, inner: float) -> float:
    """How many balls in rows _BALL (body b's frame), of radius r, reach the body; row _HIT says which. Adds to row _SURE the lanes in which
    the ball of radius `inner` reaches it; none if `inner` is negative."""
    h = Wd.half[b]
    h0, h1, h2 = h[0], h[1], h[2]
    acc, rr, ii = _ZERO, r * r, inner * abs(inner)
    if Wd.kind[b] == _U(BOX):
        for w in range(_W):
            u, v, t = abs(S[_BALL + w]) - h0, abs(S[_BALL + _W + w]) - h1, abs(S[_BALL + _U(2) * _W + w]) - h2
            u = u if u > _ZERO else _ZERO
            v = v if v > _ZERO else _ZERO
            t = t if t > _ZERO else _ZERO
            d = u * u + v * v + t * t
            e = _ONE if d < rr else _ZERO
            acc += e
            S[_HIT + w] = e
            S[_SURE + w] += _ONE if d < ii else _ZERO
    elif Wd.kind[b] == _U(CYLINDER):
        for w in range(_W):
            x, y, t = S[_BALL + w], S[_BALL + _W + w], abs(S[_BALL + _U(2) * _W + w]) - h2
            u = np.sqrt(x * x + y * y) - h0
            u = u if u > _ZERO else _ZERO
            t = t if t > _ZERO else _ZERO
            d = u * u + t * t
            e = _ONE if d < rr else _ZERO
            acc += e
            S[_HIT + w] = e
            S[_SURE + w] += _ONE if d < ii else _ZERO
    else:
        for w in range(_W):
            S[_HIT + w] = _FAR
        for j in range(Wd.plane_start[b], Wd.plane_start[b + _U(1)]):
            n0, n1, n2, n3 = Wd.planes[j, 0], Wd.planes[j, 1], Wd.planes[j, 2], Wd.planes[j, 3]
            for w in range(_W):
                d = n0 * S[_BALL + w] + n1 * S[_BALL + _W + w] + n2 * S[_BALL + _U(2) * _W + w] - n3
                S[_HIT + w] = d if d > S[_HIT + w] else S[_HIT + w]
        deep = _ZERO if inner > _ZERO else _FAR  # outside, a plane's distance is only a lower bound: the centre itself must be inside
        deep -= _f(1e-4)
        for w in range(_W):
            d = S[_HIT + w]
            e = _ONE if d < r else _ZERO
            acc += e
            S[_HIT + w] = e
            S[_SURE + w] += _ONE if d < deep else _ZERO
    return acc


@_fast
def _near(S: F32, o: int, x: float, y: float, z: float, r: float, inner: float) -> float:
    """How many points in rows o are nearer than r to (x, y, z); rows _HIT and _SURE as in `_hits`."""
    acc, rr, ii = _ZERO, r * r, inner * abs(inner)
    for w in range(_W):
        u, v, t = S[o + w] - x, S[o + _W + w] - y, S[o + _U(2) * _W + w] - z
        d = u * u + v * v + t * t
        e = _ONE if d < rr else _ZERO
        acc += e
        S[_HIT + w] = e
        S[_SURE + w] += _ONE if d < ii else _ZERO
    return acc


@_fast
def _add_hits(S: F32) -> None:
    for w in range(_W):
        S[_FAIL + w] += S[_HIT + w]


@_fast
def _add_masked_hits(S: F32) -> None:
    for w in range(_W):
        S[_FAIL + w] += S[_HIT + w] * S[_MASK + w]


@_fast
def _keep_mask(S: F32) -> None:
    for w in range(_W):
        S[_MASK + w] = S[_HIT + w]


@_fast
def _part_body(S: F32, M: LaneModel, Wd: LaneWorld, p: int, b: int, grow: float, slack: float) -> bool:
    """Test part p against body b with balls grown by `grow` (motion) and `slack` (rounding). Whether the bounding ball touched."""
    K = _U(M.T.shape[0])
    more = grow + slack
    at = _X + _W * (_U(15) * K + _U(12) + _U(3) * p)
    ball = Wd.ball[b]
    if _near(S, at, ball[0], ball[1], ball[2], ball[3] + M.bound[p, 3] + more, -_ONE) == _ZERO:
        return False
    _point_into_body(S, at, Wd, b)
    if _hits(S, Wd, b, M.bound[p, 3] + more, -_ONE) == _ZERO:
        return False
    if grow > _f(COARSE_M):
        _add_hits(S)
        return True
    _frame_into_body(S, _X + _W * (_U(3) * K + _U(12) * M.frame[p]), Wd, b)
    for i in range(M.coarse_start[p], M.coarse_start[p + _U(1)]):
        g = M.coarse[i]
        _put(S, _REL, g[0], g[1], g[2], _BALL)
        if _hits(S, Wd, b, g[3] + more, g[4] - slack) == _ZERO:
            continue
        if grow > _f(FINE_M):
            _add_hits(S)
            continue
        _keep_mask(S)
        for c in range(M.child_start[i], M.child_start[i + _U(1)]):
            g = M.fine[M.child[c]]
            _put(S, _REL, g[0], g[1], g[2], _BALL)
            if _hits(S, Wd, b, g[3] + more, g[4] - slack) > _ZERO:
                _add_masked_hits(S)
    return True


@_fast
def _part_part(S: F32, M: LaneModel, a: int, b: int, grow: float, slack: float) -> bool:
    """Test part a against part b, as `_part_body` does; everything is seen from a's frame."""
    K = _U(M.T.shape[0])
    more = grow + slack
    A, B = M.bound[a], M.bound[b]
    base = _X + _W * (_U(15) * K + _U(12))
    i, j = base + _U(3) * _W * a, base + _U(3) * _W * b
    rr, acc = (A[3] + B[3] + more) * (A[3] + B[3] + more), _ZERO
    for w in range(_W):
        x, y, z = S[i + w] - S[j + w], S[i + _W + w] - S[j + _W + w], S[i + _U(2) * _W + w] - S[j + _U(2) * _W + w]
        e = _ONE if x * x + y * y + z * z < rr else _ZERO
        acc += e
        S[_HIT + w] = e
    if acc == _ZERO:
        return False
    if grow > _f(COARSE_M):
        _add_hits(S)
        return True
    frames = _X + _W * _U(3) * K
    _frame_into_frame(S, frames + _W * _U(12) * M.frame[b], frames + _W * _U(12) * M.frame[a])
    for j in range(M.coarse_start[b], M.coarse_start[b + _U(1)]):
        h = M.coarse[j]
        _put(S, _REL, h[0], h[1], h[2], _BALL)
        if _near(S, _BALL, A[0], A[1], A[2], A[3] + h[3] + more, -_ONE) == _ZERO:
            continue
        for i in range(M.coarse_start[a], M.coarse_start[a + _U(1)]):
            g = M.coarse[i]
            if _near(S, _BALL, g[0], g[1], g[2], g[3] + h[3] + more, _both(g[4], h[4]) - slack) == _ZERO:
                continue
            if grow > _f(FINE_M):
                _add_hits(S)
                continue
            _keep_mask(S)
            for d in range(M.child_start[j], M.child_start[j + _U(1)]):
                f = M.fine[M.child[d]]
                _put(S, _REL, f[0], f[1], f[2], _OTHER)
                if _near(S, _OTHER, g[0], g[1], g[2], g[3] + f[3] + more, -_ONE) == _ZERO:
                    continue
                for c in range(M.child_start[i], M.child_start[i + _U(1)]):
                    e = M.fine[M.child[c]]
                    if _near(S, _OTHER, e[0], e[1], e[2], e[3] + f[3] + more, _both(e[4], f[4]) - slack) > _ZERO:
                        _add_masked_hits(S)
    return True


@_fast
def _both(a: float, b: float) -> float:
    """The sum of two inner radii, or something negative when a ball has none."""
    return a + b if a > _ZERO and b > _ZERO else -_ONE


@_fast
def _any(S: F32, row: int) -> bool:
    acc = _ZERO
    for w in range(_W):
        acc += S[row + w]
    return acc > _ZERO


@_fast
def _clear(S: F32) -> None:
    for w in range(_W):
        S[_FAIL + w] = _ZERO
        S[_SURE + w] = _ZERO


@_fast
def _batch(M: LaneModel, Wd: LaneWorld, X: LaneScratch, width: float, first: bool, whole: bool) -> None:
    """Test the 16 configurations in rows _X, balls grown for pieces of this width; rows _FAIL and _SURE say which touch.

    first: notes the pairs within reach, later batches look at those alone. whole: goes on after a certain contact.
    """
    S = X.rows
    K, P, B, n = _U(M.T.shape[0]), _U(M.frame.shape[0]), _U(Wd.kind.shape[0]), _U(Wd.pairs.shape[0])
    _clear(S)
    _frames(S, M)
    for p in range(P):
        g = M.bound[p]
        _put(S, _X + _W * (_U(3) * K + _U(12) * M.frame[p]), g[0], g[1], g[2], _X + _W * (_U(15) * K + _U(12) + _U(3) * p))
    half = width * 0.5
    for q in range(P):
        p = P - _U(1) - q  # the hand touches most
        grow = _f(half * X.travel[p, M.frame[p]])
        for b in range(B):
            if X.bodies_on[p, b]:
                near = _part_body(S, M, Wd, p, b, grow, _f(M.slack[p] + Wd.slack[b]))
                if first:
                    X.bodies_on[p, b] = near
                if near and not whole and _any(S, _SURE):
                    return
    for i in range(n):
        if X.pairs_on[i]:
            a, b = Wd.pairs[i, 0], Wd.pairs[i, 1]
            if M.frame[a] > M.frame[b]:
                a, b = b, a
            grow = _f(half * (X.travel[b, M.frame[b]] - X.travel[b, M.frame[a]]) + 1e-7)
            near = _part_part(S, M, a, b, grow, _f(M.slack[a] + M.slack[b]))
            if first:
                X.pairs_on[i] = near
            if near and not whole and _any(S, _SURE):
                return


# Edges and sets of configurations


@njit(cache=True, nogil=True)
def _begin(M: LaneModel, Wd: LaneWorld, qa: Array, qb: Array, X: LaneScratch) -> float:
    """Joint values at the start and their change, and each part's travel; the largest travel comes back, or -1 for a value out of bounds."""
    K, P = M.T.shape[0], M.frame.shape[0]
    for k in range(K):
        j = M.q_index[k]
        a = M.scale[k] * qa[j] + M.offset[k]
        d = M.scale[k] * (qb[j] - qa[j])
        if not (abs(a) <= M.limit[k] and abs(a + d) <= M.limit[k]):  # written so that NaN fails
            return -1.0
        X.start[k], X.step[k] = a, d
    longest = 0.0
    for p in range(P):
        X.travel[p, 0] = 0.0
        for k in range(M.frame[p]):
            X.travel[p, k + 1] = X.travel[p, k] + abs(X.step[k]) * M.reach[p, k]
        longest = max(longest, X.travel[p, M.frame[p]])
    for p in range(P):
        for b in range(Wd.kind.shape[0]):
            X.bodies_on[p, b] = Wd.check[p, b]
    for i in range(Wd.pairs.shape[0]):
        X.pairs_on[i] = 1
    return longest


@_fast
def _spread(S: F32, X: LaneScratch) -> None:
    """Joint values of the 16 places along the edge that row _AT names."""
    for k in range(_U(X.start.shape[0])):
        a, d, o = _f(X.start[k]), _f(X.step[k]), _X + _W * k
        for w in range(_W):
            S[o + w] = a + d * S[_AT + w]


@njit(cache=True, nogil=True)
def edge_free(model: LaneModel, world: LaneWorld, qa: Array, qb: Array, scratch: LaneScratch) -> int:
    """Whether the straight motion from qa (J,) to qb (J,) touches nothing.

    FREE: certain, at every point. TOUCHES: certain as well. UNDECIDED: ask an exact check. Joint values that are not finite, or a sliding
    joint beyond its limits, are undecided.
    """
    longest = _begin(model, world, qa, qb, scratch)
    if longest < 0.0:
        return UNDECIDED
    S, stack = scratch.rows, scratch.stack
    width, top = 1.0 / 16, 0
    for w in range(16):
        S[_AT + _U(w)] = np.float32((w + 0.5) * width)
    first, n = True, 1
    pieces = 16
    lows = np.zeros(16)
    while True:
        _spread(S, scratch)
        _batch(model, world, scratch, width, first, False)
        first = False
        if _any(S, _SURE):
            return TOUCHES
        if _any(S, _FAIL):
            if width * longest <= 2 * FINAL_M or top + 16 > stack.shape[0]:
                return UNDECIDED
            for i in range(n):
                for j in range(pieces):
                    if S[_FAIL + _U(i * pieces + j)] > 0:
                        stack[top, 0], stack[top, 1] = lows[i] + j * width, width
                        top += 1
        if top == 0:
            return FREE
        wide = stack[top - 1, 1]
        pieces = 2
        while pieces < 16 and wide * longest > 2 * FINAL_M * pieces:
            pieces *= 2
        width = wide / pieces
        n = 0
        while n < 16 // pieces and top > 0 and stack[top - 1, 1] == wide:
            top -= 1
            lows[n] = stack[top, 0]
            n += 1
        for i in range(16 // pieces):
            low = lows[min(i, n - 1)]
            for j in range(pieces):
                S[_AT + _U(i * pieces + j)] = np.float32(low + (j + 0.5) * width)


@njit(cache=True, nogil=True)
def configs_free(model: LaneModel, world: LaneWorld, Q: Array, scratch: LaneScratch) -> NDArray[np.uint8]:
    """FREE, UNDECIDED or TOUCHES for each configuration of Q (N, J), as (N,)."""
    N, K, J = Q.shape[0], model.T.shape[0], Q.shape[1]
    out = np.empty(N, np.uint8)
    S = scratch.rows
    zero = np.zeros(J)
    _begin(model, world, zero, zero, scratch)
    scratch.travel[:] = 0.0
    for start in range(0, N, 16):
        n = min(16, N - start)
        for w in range(16):
            i = start + min(w, n - 1)
            for k in range(K):
                x = model.scale[k] * Q[i, model.q_index[k]] + model.offset[k]
                S[_X + _U(16 * k + w)] = np.float32(x) if abs(x) <= model.limit[k] else np.float32(0.0)
        _batch(model, world, scratch, 0.0, False, True)
        for w in range(n):
            out[start + w] = TOUCHES if S[_SURE + _U(w)] > 0 else UNDECIDED if S[_FAIL + _U(w)] > 0 else FREE
            for k in range(K):
                if not abs(model.scale[k] * Q[start + w, model.q_index[k]] + model.offset[k]) <= model.limit[k]:
                    out[start + w] = UNDECIDED
    return out
