"""Sixteen configurations at once: a compiled check that says "free" only where it is certain.

The arm's parts are covered by balls (see sphere_cover.py). One batch holds 16 configurations side by side in float32, one a
lane (see simd.py).

Free along an edge. An edge is straight in joint space. It is cut into pieces, a lane takes the middle of one, and every ball grows by the
way that any point of its part can go from there to the piece's ends:

    half the piece's length · sum over joints k of |change of joint k| · reach[k, part]

where reach is the largest distance of a point of the part from joint k's axis in any configuration (1 for a sliding joint): no point moves
faster than that. Of two parts only the joints between them count. So a lane that misses everything clears its whole piece; the others
are cut finer, down to `FINAL_M` of growth. A piece that still touches then is *undecided*; where an inner ball touches it is
certain that the edge does. Bodies and pairs out of reach of the whole edge are left aside after the first batch.

Clearance. Where the world asks for some distance, every ball grows by it, the inner ones too: "free" is to keep the distance, "touches" is
to fall short of it, both for certain.

Bounds go coarse to fine: a ball around all that one frame carries, such as a hand, a part's bounding ball, its coarse balls, and only the
fine balls that a touching coarse ball lists.

Rounding. With u = 2^-24, a lane's joint value is off by at most 4u·|x| with |x| <= X_MAX = 16, so by 64u; sine and cosine by 6u more; the
products of one joint by 8u of the lengths involved. So one joint moves a point by less than 80u times its distance from the base, K joints
by K times that, and placing a ball, the body's own numbers and the comparison by no more than two joints would. `RATIO` = 96u leaves a
fifth to spare, and the tests compare with float64. For a UR5e this is below 0.1 mm.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Int
from kinematics.collision.geometry import BOX, CYLINDER
from kinematics.collision.sphere_model import F32, Index, SphereModel, SphereWorld
from kinematics.doors import checked
from kinematics.jit.decorators import Function, jit_entry, jit_inline
from kinematics.jit.record import record
from kinematics.jit.simd import WIDTH, below, largest, load, nearest_int, root, size, spread, store
from kinematics.transforms import Array

Lanes = Any  # a float32x16, which exists in compiled code only
Mask = Any  # a uint64 with a bit a lane
U64 = Any
Real = Any  # a float32

FREE, UNDECIDED, TOUCHES = 0, 1, 2
_CONTACT, _TOO_MUCH = -1, -2
_NEAR, _APART = 1, 2
FINAL_M = 0.006  # a piece whose balls grow no more than this is not cut again: the exact test is quicker then
FINE_M, COARSE_M = 0.010, 0.120  # up to so much growth the fine and the coarse balls are worth a look

_f, _U = np.float32, np.uint64
_W = np.uint64(WIDTH)
_ZERO, _ONE, _HALF, _FAR, _INSIDE = _f(0), _f(1), _f(0.5), _f(1e9), _f(1e-4)
_TURN, _TURN_HI, _TURN_LO = _f(1 / (2 * np.pi)), _f(6.28125), _f(2 * np.pi - 6.28125)
_S3, _S5, _S7, _S9, _S11 = _f(-1 / 6), _f(1 / 120), _f(-1 / 5040), _f(1 / 362880), _f(-1 / 39916800)
_C2, _C4, _C6, _C8, _C10, _C12 = _f(-0.5), _f(1 / 24), _f(-1 / 720), _f(1 / 40320), _f(-1 / 3628800), _f(1 / 479001600)


def _inline(function: Function) -> Function:
    """Compiled right into whatever calls it."""
    return jit_inline(function, forceinline=True)


# Rows of the scratch array, 16 numbers each: places along the edge, a frame, K joint values; then K + 1 frames of 12, P centres of 3, and
# K + 1 centres of all that a frame carries
_AT, _REL, _X = _U(0), _U(16), _U(16 * 13)


@record
class SphereScratch(NamedTuple):
    """Working memory of one thread: `lane_scratch` makes it, and it may be used for any number of calls with the same sizes or smaller.

    left (P, P + B): of the last edge that was undecided, between which bodies; the P parts come first.
    all_travel (K + 1,): the largest travel of what a frame carries. in_reach (B,): which bodies the parts of the frame at hand may reach.
    looked (K + 1, P): which parts those of a frame may reach, 0 while nobody looked, _NEAR or _APART.
    """

    rows: F32
    start: Array
    step: Array
    travel: Array
    all_travel: Array
    in_reach: NDArray[np.uint8]
    looked: NDArray[np.uint8]
    bodies_on: NDArray[np.uint8]
    pairs_on: NDArray[np.uint8]
    left: NDArray[np.uint8]
    stack: Array
    lows: Array


def make_sphere_scratch(model: SphereModel, world: SphereWorld) -> SphereScratch:
    """Working memory for calls with this model and this world."""
    return scratch_for(len(model.T), len(model.frame), len(world.kind), len(world.pairs))


def scratch_for(joints: int, parts: int, solids: int, pairs: int) -> SphereScratch:
    """Working memory for calls with models and worlds that are no larger than this."""
    rows = np.zeros(16 * (13 + joints + 15 * (joints + 1) + 3 * parts), np.float32)
    first = 16 * (13 + joints)
    for r in range(3):
        rows[first + 16 * (5 * r) : first + 16 * (5 * r + 1)] = 1.0
    return SphereScratch(
        rows,
        np.empty(joints),
        np.empty(joints),
        np.empty((parts, joints + 1)),
        np.zeros(joints + 1),
        np.empty(solids, np.uint8),
        np.empty((joints + 1, parts), np.uint8),
        np.empty((parts, solids), np.uint8),
        np.empty(pairs, np.uint8),
        np.empty((parts, parts + solids), np.uint8),
        np.empty((1024, 2)),
        np.empty(16),
    )


# One batch: 16 lanes against everything. Lanes that touch are bits of an integer


@_inline
def _sine_cosine(x: Lanes) -> tuple[Lanes, Lanes]:
    """By whole turns and half angles; off by less than 6 · 2^-24."""
    turns = nearest_int(x * _TURN)
    y = ((x - turns * _TURN_HI) - turns * _TURN_LO) * _HALF
    z = y * y
    s = y * (z * (z * (z * (z * (z * _S11 + _S9) + _S7) + _S5) + _S3) + _ONE)
    c = z * (z * (z * (z * (z * (z * _C12 + _C10) + _C8) + _C6) + _C4) + _C2) + _ONE
    return (s + s) * c, _ONE - (s + s) * s


@_inline
def _frames(S: F32, M: SphereModel) -> None:
    """Forward kinematics of all lanes: joint values in rows _X to the frames' rows; frame 0, the world, stands there already."""
    K = _U(M.T.shape[0])
    for k in range(K):
        x = load(S, _X + _W * k)
        p = _X + _W * (K + _U(12) * k)
        if M.prismatic[k]:
            for r in range(_U(3)):
                i = p + _W * _U(4) * r
                m0, m1, m2, t = _turned_row(S, i, M.T, k)
                _store_row(S, i + _U(12) * _W, m0, m1, m2, t + m2 * x)
        else:
            s, c = _sine_cosine(x)
            for r in range(_U(3)):
                i = p + _W * _U(4) * r
                m0, m1, m2, t = _turned_row(S, i, M.T, k)
                _store_row(S, i + _U(12) * _W, m0 * c + m1 * s, m1 * c - m0 * s, m2, t)


@_inline
def _turned_row(S: F32, i: U64, T: F32, k: U64) -> tuple[Lanes, Lanes, Lanes, Lanes]:
    """A row of the frame before, times T[k]."""
    x, y, z, t = load(S, i), load(S, i + _W), load(S, i + _U(2) * _W), load(S, i + _U(3) * _W)
    return (
        x * T[k, 0] + y * T[k, 4] + z * T[k, 8],
        x * T[k, 1] + y * T[k, 5] + z * T[k, 9],
        x * T[k, 2] + y * T[k, 6] + z * T[k, 10],
        x * T[k, 3] + y * T[k, 7] + z * T[k, 11] + t,
    )


@_inline
def _store_row(S: F32, i: U64, a: Lanes, b: Lanes, c: Lanes, d: Lanes) -> None:
    store(S, i, a)
    store(S, i + _W, b)
    store(S, i + _U(2) * _W, c)
    store(S, i + _U(3) * _W, d)


@_inline
def _put(S: F32, T: U64, balls: F32, i: U64) -> tuple[Lanes, Lanes, Lanes]:
    """The centre of balls[i] mapped by the frame in the 12 rows from T on."""
    x, y, z = balls[i, 0], balls[i, 1], balls[i, 2]
    return _row_put(S, T, x, y, z), _row_put(S, T + _U(4) * _W, x, y, z), _row_put(S, T + _U(8) * _W, x, y, z)


@_inline
def _row_put(S: F32, i: U64, x: Real, y: Real, z: Real) -> Lanes:
    return load(S, i) * x + load(S, i + _W) * y + load(S, i + _U(2) * _W) * z + load(S, i + _U(3) * _W)


@_inline
def _into_body(R: F32, b: U64, x: Lanes, y: Lanes, z: Lanes) -> tuple[Lanes, Lanes, Lanes]:
    """A direction in the world, seen from body b."""
    return (
        x * R[b, 0] + y * R[b, 1] + z * R[b, 2],
        x * R[b, 3] + y * R[b, 4] + z * R[b, 5],
        x * R[b, 6] + y * R[b, 7] + z * R[b, 8],
    )


@jit_inline
def _frame_into_body(S: F32, T: U64, R: F32, p: F32, b: U64) -> None:
    """Rows _REL: the frame in the rows from T on, seen from body b."""
    for c in range(_U(4)):
        i = T + c * _W
        x, y, z = load(S, i), load(S, i + _U(4) * _W), load(S, i + _U(8) * _W)
        if c == _U(3):
            x, y, z = x - p[b, 0], y - p[b, 1], z - p[b, 2]
        u, v, w = _into_body(R, b, x, y, z)
        store(S, _REL + c * _W, u)
        store(S, _REL + (c + _U(4)) * _W, v)
        store(S, _REL + (c + _U(8)) * _W, w)


@_inline
def _seen_from(S: F32, A: U64, o: U64) -> tuple[Lanes, Lanes, Lanes]:
    """The point in the three rows from o on, seen from the frame in the rows from A on."""
    x, y, z = load(S, o), load(S, o + _W), load(S, o + _U(2) * _W)
    x, y, z = x - load(S, A + _U(3) * _W), y - load(S, A + _U(7) * _W), z - load(S, A + _U(11) * _W)
    return _turned_back(S, A, x, y, z), _turned_back(S, A + _W, x, y, z), _turned_back(S, A + _U(2) * _W, x, y, z)


@_inline
def _turned_back(S: F32, a: U64, x: Lanes, y: Lanes, z: Lanes) -> Lanes:
    return load(S, a) * x + load(S, a + _U(4) * _W) * y + load(S, a + _U(8) * _W) * z


@jit_inline
def _frame_into_frame(S: F32, T: U64, A: U64) -> None:
    """Rows _REL: the frame in the rows from T on, seen from the frame in the rows from A on."""
    for c in range(_U(4)):
        i = T + c * _W
        x, y, z = load(S, i), load(S, i + _U(4) * _W), load(S, i + _U(8) * _W)
        if c == _U(3):
            x, y, z = x - load(S, A + _U(3) * _W), y - load(S, A + _U(7) * _W), z - load(S, A + _U(11) * _W)
        for r in range(_U(3)):
            store(S, _REL + (_U(4) * r + c) * _W, _turned_back(S, A + r * _W, x, y, z))


@_inline
def _hits(x: Lanes, y: Lanes, z: Lanes, Wd: SphereWorld, b: U64, r: Real, inner: Real) -> tuple[Mask, Mask]:
    """Lanes in which the ball about (x, y, z), body b's frame, reaches the body: with radius r, and for certain with radius `inner`."""
    if Wd.kind[b] == _U(BOX):
        u = largest(size(x) - Wd.half[b, 0], _ZERO)
        v = largest(size(y) - Wd.half[b, 1], _ZERO)
        t = largest(size(z) - Wd.half[b, 2], _ZERO)
        d = u * u + v * v + t * t
        return below(d, r * r), below(d, inner * abs(inner))
    if Wd.kind[b] == _U(CYLINDER):
        u = largest(root(x * x + y * y) - Wd.half[b, 0], _ZERO)
        t = largest(size(z) - Wd.half[b, 2], _ZERO)
        d = u * u + t * t
        return below(d, r * r), below(d, inner * abs(inner))
    d = spread(-_FAR)
    for j in range(Wd.plane_start[b], Wd.plane_start[b + _U(1)]):
        d = largest(x * Wd.planes[j, 0] + y * Wd.planes[j, 1] + z * Wd.planes[j, 2] - Wd.planes[j, 3], d)
    # outside, the largest plane distance is only a lower bound: for certain contact the ball's centre must be well inside
    return below(d, r), below(d, -_INSIDE if inner > _ZERO else -_FAR)


@_inline
def _near(x: Lanes, y: Lanes, z: Lanes, balls: F32, i: U64, r: Real) -> Mask:
    """Lanes in which (x, y, z) is nearer than r to the centre of balls[i]."""
    return below(_apart(x, y, z, balls, i), r * r)


@_inline
def _apart(x: Lanes, y: Lanes, z: Lanes, balls: F32, i: U64) -> Lanes:
    u, v, t = x - balls[i, 0], y - balls[i, 1], z - balls[i, 2]
    return u * u + v * v + t * t


@_inline
def _near_box(x: Lanes, y: Lanes, z: Lanes, boxes: F32, i: U64, r: Real) -> Mask:
    """Lanes in which (x, y, z) is nearer than r to boxes[i]."""
    u = largest(size(x - boxes[i, 0]) - boxes[i, 3], _ZERO)
    v = largest(size(y - boxes[i, 1]) - boxes[i, 4], _ZERO)
    t = largest(size(z - boxes[i, 2]) - boxes[i, 5], _ZERO)
    return below(u * u + v * v + t * t, r * r)


@jit_inline
def _part_body(S: F32, M: SphereModel, Wd: SphereWorld, p: U64, b: U64, grow: Real, slack: Real, done: Mask) -> tuple[Mask, Mask]:
    """Part p's balls, grown by `grow` (motion), `slack` (rounding) and the body's clearance, against body b: lanes that touch, and that do
    so for certain.

    Lanes in `done` are of no interest any more.
    """
    fail, sure = _U(0), _U(0)
    clear = Wd.clearance[b]
    more = grow + slack + clear
    _frame_into_body(S, _X + _W * (_U(M.T.shape[0]) + _U(12) * M.frame[p]), Wd.R, Wd.p, b)
    for i in range(M.coarse_start[p], M.coarse_start[p + _U(1)]):
        x, y, z = _put(S, _REL, M.coarse, i)
        hit, in_hit = _hits(x, y, z, Wd, b, M.coarse[i, 3] + more, _inner(M.coarse[i, 4], slack, clear))
        sure |= in_hit
        hit &= ~(done | sure)
        if hit == _U(0):
            continue
        if grow > _f(FINE_M):
            fail |= hit
            continue
        for c in range(M.child_start[i], M.child_start[i + _U(1)]):
            j = M.child[c]
            x, y, z = _put(S, _REL, M.fine, j)
            touch, in_touch = _hits(x, y, z, Wd, b, M.fine[j, 3] + more, _inner(M.fine[j, 4], slack, clear))
            fail |= touch & hit
            sure |= in_touch
    return fail | sure, sure


@jit_inline
def _part_part(S: F32, M: SphereModel, a: U64, b: U64, grow: Real, slack: Real, clear: Real, done: Mask) -> tuple[Mask, Mask]:
    """Part a's balls against part b's, as `_part_body` does it; everything is seen from a's frame, so b had better have fewer."""
    fail, sure = _U(0), _U(0)
    more = grow + slack + clear
    K = _U(M.T.shape[0])
    A = _X + _W * (K + _U(12) * M.frame[a])
    x, y, z = _seen_from(S, A, _X + _W * (_U(13) * K + _U(12) + _U(3) * b))
    if _near_box(x, y, z, M.box, a, M.bound[b, 3] + more) & ~done == _U(0):
        return fail, sure
    _frame_into_frame(S, _X + _W * (K + _U(12) * M.frame[b]), A)
    for j in range(M.coarse_start[b], M.coarse_start[b + _U(1)]):
        x, y, z = _put(S, _REL, M.coarse, j)
        if _near_box(x, y, z, M.box, a, M.coarse[j, 3] + more) & ~(done | sure) == _U(0):
            continue
        for i in range(M.coarse_start[a], M.coarse_start[a + _U(1)]):
            d = _apart(x, y, z, M.coarse, i)
            r, inner = M.coarse[i, 3] + M.coarse[j, 3] + more, _inner(_both(M.coarse[i, 4], M.coarse[j, 4]), slack, clear)
            hit = below(d, r * r)
            if hit & ~(done | sure) == _U(0):
                continue
            sure |= below(d, inner * abs(inner))
            hit &= ~(done | sure)
            if grow > _f(FINE_M):
                fail |= hit
                continue
            for e in range(M.child_start[j], M.child_start[j + _U(1)]):
                g = M.child[e]
                u, v, t = _put(S, _REL, M.fine, g)
                if _near(u, v, t, M.coarse, i, M.coarse[i, 3] + M.fine[g, 3] + more) & hit == _U(0):
                    continue
                for c in range(M.child_start[i], M.child_start[i + _U(1)]):
                    h = M.child[c]
                    d = _apart(u, v, t, M.fine, h)
                    r, inner = M.fine[g, 3] + M.fine[h, 3] + more, _inner(_both(M.fine[g, 4], M.fine[h, 4]), slack, clear)
                    fail |= below(d, r * r) & hit
                    sure |= below(d, inner * abs(inner))
    return fail | sure, sure


@_inline
def _balls(M: SphereModel, p: U64) -> U64:
    """How many coarse balls part p has."""
    return M.coarse_start[p + _U(1)] - M.coarse_start[p]


@_inline
def _both(a: Any, b: Any) -> Any:
    """The sum of two inner radii, or something negative when a ball has none."""
    return a + b if a > _ZERO and b > _ZERO else -_ONE


@_inline
def _inner(radius: Real, slack: Real, clear: Real) -> Real:
    """How near to an inner ball's centre something certainly falls short of the clearance; negative for a ball that has none."""
    return radius - slack + clear if radius > _ZERO else radius - slack


@_inline
def _near_body(x: Lanes, y: Lanes, z: Lanes, Wd: SphereWorld, b: U64, r: Real, sure: Mask) -> Mask:
    """Lanes in which the ball about (x, y, z) reaches body b; maybe more where all of them are in `sure`."""
    near = _near(x, y, z, Wd.ball, b, Wd.ball[b, 3] + r)
    if near & ~sure != _U(0):
        u, v, t = _into_body(Wd.R, b, x - Wd.p[b, 0], y - Wd.p[b, 1], z - Wd.p[b, 2])
        near, _ = _hits(u, v, t, Wd, b, r, -_ONE)
    return near


@_inline
def _keep(S: F32, o: U64, x: Lanes, y: Lanes, z: Lanes) -> None:
    """Put down a centre in the three rows from o on."""
    store(S, o, x)
    store(S, o + _W, y)
    store(S, o + _U(2) * _W, z)


@jit_inline
def _all_near(M: SphereModel, Wd: SphereWorld, X: SphereScratch, f: U64, half: float) -> None:
    """Note in X.in_reach (B,) which bodies the parts that frame f carries may reach, in some lane, and begin a row of X.looked."""
    K, P = _U(M.T.shape[0]), _U(M.frame.shape[0])
    many = M.many[f] != 0
    if many:
        x, y, z = _put(X.rows, _X + _W * (K + _U(12) * f), M.all, f)
        _keep(X.rows, _X + _W * (_U(13) * K + _U(12) + _U(3) * (P + f)), x, y, z)
        r = M.all[f, 3] + _f(half * X.all_travel[f]) + M.all_slack[f]
        for b in range(_U(Wd.kind.shape[0])):
            X.in_reach[b] = _near_body(x, y, z, Wd, b, r + Wd.slack[b] + Wd.clearance[b], _U(0)) != _U(0)
    else:
        for b in range(_U(Wd.kind.shape[0])):
            X.in_reach[b] = 1
    for p in range(P):
        X.looked[f, p] = 0 if many else _NEAR


@_inline
def _apart_from_all(M: SphereModel, X: SphereScratch, a: U64, f: U64, half: float, clear: Real) -> bool:
    """Whether part a is out of reach of all that frame f carries, in every lane. Parts on one frame are not asked about."""
    if X.looked[f, a] == 0:
        S, P = X.rows, _U(M.frame.shape[0])
        bounds = _X + _W * (_U(13) * _U(M.T.shape[0]) + _U(12))
        u, v = bounds + _W * _U(3) * a, bounds + _W * _U(3) * (P + f)
        x, y, z = load(S, u) - load(S, v), load(S, u + _W) - load(S, v + _W), load(S, u + _U(2) * _W) - load(S, v + _U(2) * _W)
        more = M.all[f, 3] + _f(half * X.all_travel[f]) + M.slack[a] + M.all_slack[f] + clear
        r = M.bound[a, 3] + more
        near = below(x * x + y * y + z * z, r * r)
        if near != _U(0):
            x, y, z = _seen_from(S, _X + _W * (_U(M.T.shape[0]) + _U(12) * M.frame[a]), v)
            near = _near_box(x, y, z, M.box, a, more)
        X.looked[f, a] = _NEAR if near != _U(0) else _APART
    return bool(X.looked[f, a] == _APART)


@jit_inline
def _batch(M: SphereModel, Wd: SphereWorld, X: SphereScratch, width: float, first: bool, last: bool, whole: bool) -> tuple[Mask, Mask]:
    """Test the 16 configurations in rows _X, balls grown for pieces of this width: lanes that touch, and that do so for certain.

    first: notes the pairs within reach; later batches look at those alone. last: notes which pairs are left. whole: goes on after a certain
    contact.
    """
    S = X.rows
    K, P, B, n = _U(M.T.shape[0]), _U(M.frame.shape[0]), _U(Wd.kind.shape[0]), _U(Wd.pairs.shape[0])
    frames, bounds = _X + _W * K, _X + _W * (_U(13) * K + _U(12))
    fail, sure = _U(0), _U(0)
    _frames(S, M)
    half, at, together = width * 0.5, K + _U(1), first or whole  # later batches look at what was near
    own = _f(Wd.own_clearance)
    for q in range(P):
        p = P - _U(1) - q  # the hand touches most
        f = M.frame[p]
        if together and f != at:
            at = f
            _all_near(M, Wd, X, f, half)
        x, y, z = _put(S, frames + _W * _U(12) * f, M.bound, p)
        _keep(S, bounds + _W * _U(3) * p, x, y, z)
        grow = _f(half * X.travel[p, f])
        for b in range(B):
            if not X.bodies_on[p, b] or (together and not X.in_reach[b]):
                if first:
                    X.bodies_on[p, b] = 0
                continue
            slack = M.slack[p] + Wd.slack[b]
            near = _near_body(x, y, z, Wd, b, M.bound[p, 3] + grow + slack + Wd.clearance[b], sure)
            if first:
                X.bodies_on[p, b] = near != _U(0)
            if near & ~sure != _U(0):
                if grow > _f(COARSE_M):
                    fail |= near
                    continue
                now, certain = _part_body(S, M, Wd, p, b, grow, slack, ~near | sure)
                if last and now != _U(0):
                    X.left[p, P + b] = 1
                fail |= now
                sure |= certain
                if sure != _U(0) and not whole:
                    return fail, sure
    for i in range(n):
        if X.pairs_on[i]:
            a, b = Wd.pairs[i, 0], Wd.pairs[i, 1]
            if M.frame[a] > M.frame[b]:
                a, b = b, a
            if together and M.frame[a] != M.frame[b] and _apart_from_all(M, X, a, M.frame[b], half, own):
                if first:
                    X.pairs_on[i] = 0
                continue
            grow = _f(half * (X.travel[b, M.frame[b]] - X.travel[b, M.frame[a]]))
            slack = M.slack[a] + M.slack[b]
            r = M.bound[a, 3] + M.bound[b, 3] + grow + slack + own
            u, v = bounds + _W * _U(3) * a, bounds + _W * _U(3) * b
            x, y, z = load(S, u) - load(S, v), load(S, u + _W) - load(S, v + _W), load(S, u + _U(2) * _W) - load(S, v + _U(2) * _W)
            near = below(x * x + y * y + z * z, r * r)
            if first:
                X.pairs_on[i] = near != _U(0)
            if near & ~sure != _U(0):
                if grow > _f(COARSE_M):
                    fail |= near
                    continue
                if _balls(M, a) < _balls(M, b):
                    a, b = b, a
                now, certain = _part_part(S, M, a, b, grow, slack, own, ~near | sure)
                if last and now != _U(0):
                    X.left[a, b] = X.left[b, a] = 1
                fail |= now
                sure |= certain
                if sure != _U(0) and not whole:
                    return fail, sure
    return fail, sure


# Edges and sets of configurations


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
    """Joint values of the 16 places along the edge that row _AT names."""
    for k in range(_U(X.start.shape[0])):
        a, d, o = _f(X.start[k]), _f(X.step[k]), _X + _W * k
        store(S, o, load(S, _AT) * d + a)


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
        S[_AT + _U(w)] = np.float32((w + 0.5) * width)
    while True:
        _begin_edge(S, X)
        last = width * longest <= 2 * FINAL_M
        fail, sure = _batch(M, Wd, X, width, first, last, False)
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
                S[_AT + _U(i * cuts + j)] = np.float32(low + (j + 0.5) * width)


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
        refused = _take(model, Q, start, scratch.rows)
        fail, sure = _batch(model, world, scratch, 0.0, False, False, True)
        for w in range(min(16, Q.shape[0] - start)):
            touches, open_ = (sure >> _U(w)) & _U(1), ((fail | refused) >> _U(w)) & _U(1)
            out[start + w] = UNDECIDED if (refused >> _U(w)) & _U(1) else TOUCHES if touches else UNDECIDED if open_ else FREE


def open_pairs(model: SphereModel, world: SphereWorld, Q: Array, scratch: SphereScratch) -> tuple[Int, Int]:
    """The pairs that the covers do not prove apart at configurations Q (N, J): rows (F,) and pairs (F,), in the order of the rows.

    Pair p · B + b is part p against body b, of those in `check`; pair P · B + i is the i-th of `pairs`. Joint values that `edge_free` would
    not decide leave every pair of their row open.
    """
    Q = checked("Q", Q, -1, _coordinates(model), finite=False)
    masks = np.zeros((-(-len(Q) // 16), world.check.size + len(world.pairs)), np.uint64)
    _open_batches(model, world, Q, scratch, masks)
    batches, pairs = np.nonzero(masks)
    at, lane = np.nonzero(masks[batches, pairs][:, None] >> np.arange(16, dtype=np.uint64) & _U(1))
    rows, pairs = 16 * batches[at] + lane, pairs[at]
    order = np.argsort(rows, kind="stable")
    order = order[rows[order] < len(Q)]
    return rows[order], pairs[order]


@jit_entry
def _open_batches(model: SphereModel, world: SphereWorld, Q: Array, scratch: SphereScratch, masks: Index) -> None:
    for batch in range(masks.shape[0]):
        refused = _take(model, Q, 16 * batch, scratch.rows)
        _open_batch(model, world, scratch, refused, masks[batch])


@jit_inline
def _take(M: SphereModel, Q: Array, start: int, S: F32) -> Mask:
    """Rows _X: joint values of Q from row `start` on, the last one repeated. A bit for each lane with values out of bounds, put to 0."""
    refused = _U(0)
    for w in range(16):
        i = min(start + w, Q.shape[0] - 1)
        for k in range(M.T.shape[0]):
            x = M.scale[k] * Q[i, M.q_index[k]] + M.offset[k]
            within = abs(x) <= M.limit[k]  # not so for NaN
            S[_X + _U(16 * k + w)] = np.float32(x) if within else np.float32(0.0)
            if not within:
                refused |= _U(1) << _U(w)
    return refused


@jit_inline
def _open_batch(M: SphereModel, Wd: SphereWorld, X: SphereScratch, refused: Mask, out: Index) -> None:
    """For every pair the lanes of the 16 configurations in rows _X in which it may touch. out: zeros, one a pair."""
    S = X.rows
    K, P, B, n = _U(M.T.shape[0]), _U(M.frame.shape[0]), _U(Wd.kind.shape[0]), _U(Wd.pairs.shape[0])
    frames, bounds = _X + _W * K, _X + _W * (_U(13) * K + _U(12))
    _frames(S, M)
    at, own = K + _U(1), _f(Wd.own_clearance)
    for p in range(P):
        f = M.frame[p]
        if f != at:
            at = f
            _all_near(M, Wd, X, f, 0.0)
        x, y, z = _put(S, frames + _W * _U(12) * f, M.bound, p)
        _keep(S, bounds + _W * _U(3) * p, x, y, z)
        for b in range(B):
            if Wd.check[p, b]:
                slack, near = M.slack[p] + Wd.slack[b], _U(0)
                if X.in_reach[b]:
                    near = _near_body(x, y, z, Wd, b, M.bound[p, 3] + slack + Wd.clearance[b], _U(0))
                if near != _U(0):
                    near, _ = _part_body(S, M, Wd, p, b, _ZERO, slack, ~near)
                out[p * B + b] = near | refused
    for i in range(n):
        a, b = Wd.pairs[i, 0], Wd.pairs[i, 1]
        if M.frame[a] > M.frame[b]:
            a, b = b, a
        if M.frame[a] != M.frame[b] and _apart_from_all(M, X, a, M.frame[b], 0.0, own):
            out[P * B + i] = refused
            continue
        slack = M.slack[a] + M.slack[b]
        r = M.bound[a, 3] + M.bound[b, 3] + slack + own
        u, v = bounds + _W * _U(3) * a, bounds + _W * _U(3) * b
        x, y, z = load(S, u) - load(S, v), load(S, u + _W) - load(S, v + _W), load(S, u + _U(2) * _W) - load(S, v + _U(2) * _W)
        near = below(x * x + y * y + z * z, r * r)
        if near != _U(0):
            if _balls(M, a) < _balls(M, b):
                a, b = b, a
            near, _ = _part_part(S, M, a, b, _ZERO, slack, own, ~near)
        out[P * B + i] = near | refused
