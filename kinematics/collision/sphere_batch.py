"""One batch: sixteen configurations against every body and every pair of parts, coarse to fine.

Clearance. Where the world asks for some distance, every ball grows by it, the inner ones too: "free" is to keep the distance, "touches" is
to fall short of it, both for certain.

Bounds go coarse to fine: a ball around all that one frame carries, such as a hand, a part's bounding ball, its coarse balls, and only the
fine balls that a touching coarse ball lists.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Int
from kinematics.collision.sphere_lanes import (
    ROW_RELATIVE,
    ROW_X,
    U64,
    Mask,
    Real,
    forced_inline,
    forward_kinematics,
    frame_into_body,
    frame_into_frame,
    hits,
    keep,
    near_ball,
    near_body,
    near_box,
    placed,
    seen_from,
    squared_distance,
)
from kinematics.collision.sphere_model import F32, Index, SphereModel, SphereWorld
from kinematics.jit.decorators import jit_inline
from kinematics.jit.record import record
from kinematics.jit.simd import WIDTH, below, load
from kinematics.transforms import Array

FINE_M, COARSE_M = 0.010, 0.120  # up to so much growth the fine and the coarse balls are worth a look

_NEAR, _APART = 1, 2
_f, _U = np.float32, np.uint64
Flags = NDArray[np.uint8]
_W = np.uint64(WIDTH)
_ZERO, _ONE = _f(0), _f(1)
ALL = (1 << WIDTH) - 1
"""A mask of all lanes."""


@record
class SphereScratch(NamedTuple):
    """Working memory of one thread: `make_sphere_scratch` makes it; it may serve any number of calls with the same sizes or smaller.

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


@jit_inline
def _part_body(
    S: F32, M: SphereModel, Wd: SphereWorld, p: U64, b: U64, grow: Real, slack: Real, done: Mask, whole: bool
) -> tuple[Mask, Mask]:
    """Part p's balls, grown by `grow` (motion), `slack` (rounding) and the body's clearance, against body b: lanes that touch, and that do
    so for certain.

    Lanes in `done` are of no interest any more. whole: lanes that touch are looked at further, whether they do so for certain.
    """
    fail, sure = _U(0), _U(0)
    clear = Wd.clearance[b]
    more = grow + slack + clear
    frame_into_body(S, ROW_X + _W * (_U(M.T.shape[0]) + _U(12) * M.frame[p]), Wd.R, Wd.p, b)
    for i in range(M.coarse_start[p], M.coarse_start[p + _U(1)]):
        x, y, z = placed(S, ROW_RELATIVE, M.coarse, i)
        hit, in_hit = hits(x, y, z, Wd, b, M.coarse[i, 3] + more, _inner(M.coarse[i, 4], slack, clear))
        hit &= ~(done | sure)
        if hit == _U(0):
            continue
        sure |= in_hit
        hit &= ~sure
        if grow > _f(FINE_M):
            fail |= hit
            continue
        for c in range(M.child_start[i], M.child_start[i + _U(1)]):
            j = M.child[c]
            x, y, z = placed(S, ROW_RELATIVE, M.fine, j)
            touch, in_touch = hits(x, y, z, Wd, b, M.fine[j, 3] + more, _inner(M.fine[j, 4], slack, clear))
            touch &= hit
            if touch != _U(0):
                fail |= touch
                sure |= in_touch
                hit &= ~(sure if whole else fail)
                if hit == _U(0):
                    break
    return fail | sure, sure


@jit_inline
def _part_part(S: F32, M: SphereModel, a: U64, b: U64, grow: Real, slack: Real, clear: Real, done: Mask, whole: bool) -> tuple[Mask, Mask]:
    """Part a's balls against part b's, as `_part_body` does it; everything is seen from a's frame, so b had better have fewer."""
    fail, sure = _U(0), _U(0)
    more = grow + slack + clear
    K = _U(M.T.shape[0])
    A = ROW_X + _W * (K + _U(12) * M.frame[a])
    x, y, z = seen_from(S, A, ROW_X + _W * (_U(13) * K + _U(12) + _U(3) * b))
    if near_box(x, y, z, M.box, a, M.bound[b, 3] + more) & ~done == _U(0):
        return fail, sure
    frame_into_frame(S, ROW_X + _W * (K + _U(12) * M.frame[b]), A)
    for j in range(M.coarse_start[b], M.coarse_start[b + _U(1)]):
        x, y, z = placed(S, ROW_RELATIVE, M.coarse, j)
        if near_box(x, y, z, M.box, a, M.coarse[j, 3] + more) & ~(done | (sure if whole else fail | sure)) == _U(0):
            continue
        for i in range(M.coarse_start[a], M.coarse_start[a + _U(1)]):
            d = squared_distance(x, y, z, M.coarse, i)
            r, inner = M.coarse[i, 3] + M.coarse[j, 3] + more, _inner(_both(M.coarse[i, 4], M.coarse[j, 4]), slack, clear)
            hit = below(d, r * r) & ~(done | (sure if whole else fail | sure))
            if hit == _U(0):
                continue
            sure |= below(d, inner * abs(inner))
            hit &= ~sure
            if grow > _f(FINE_M):
                fail |= hit
                continue
            for e in range(M.child_start[j], M.child_start[j + _U(1)]):
                g = M.child[e]
                u, v, t = placed(S, ROW_RELATIVE, M.fine, g)
                now = near_ball(u, v, t, M.coarse, i, M.coarse[i, 3] + M.fine[g, 3] + more) & hit & ~(sure if whole else fail)
                if now == _U(0):
                    continue
                for c in range(M.child_start[i], M.child_start[i + _U(1)]):
                    h = M.child[c]
                    d = squared_distance(u, v, t, M.fine, h)
                    r = M.fine[g, 3] + M.fine[h, 3] + more
                    touch = below(d, r * r) & now
                    if touch != _U(0):
                        inner = _inner(_both(M.fine[g, 4], M.fine[h, 4]), slack, clear)
                        fail |= touch
                        sure |= below(d, inner * abs(inner))
                        now &= ~(sure if whole else fail)
                        if now == _U(0):
                            break
    return fail | sure, sure


@forced_inline
def coarse_balls(M: SphereModel, p: U64) -> U64:
    """How many coarse balls part p has."""
    return M.coarse_start[p + _U(1)] - M.coarse_start[p]


@forced_inline
def _both(a: Any, b: Any) -> Any:
    """The sum of two inner radii, or something negative when a ball has none."""
    return a + b if a > _ZERO and b > _ZERO else -_ONE


@forced_inline
def _inner(radius: Real, slack: Real, clear: Real) -> Real:
    """How near to an inner ball's centre something certainly falls short of the clearance; negative for a ball that has none."""
    return radius - slack + clear if radius > _ZERO else radius - slack


@jit_inline
def _all_near(M: SphereModel, Wd: SphereWorld, X: SphereScratch, f: U64, half: float) -> None:
    """Note in X.in_reach (B,) which bodies the parts that frame f carries may reach, in some lane, and begin a row of X.looked."""
    K, P = _U(M.T.shape[0]), _U(M.frame.shape[0])
    many = M.many[f] != 0
    if many:
        x, y, z = placed(X.rows, ROW_X + _W * (K + _U(12) * f), M.all, f)
        keep(X.rows, ROW_X + _W * (_U(13) * K + _U(12) + _U(3) * (P + f)), x, y, z)
        r = M.all[f, 3] + _f(half * X.all_travel[f]) + M.all_slack[f]
        for b in range(_U(Wd.kind.shape[0])):
            X.in_reach[b] = near_body(x, y, z, Wd, b, r + Wd.slack[b] + Wd.clearance[b], _U(0)) != _U(0)
    else:
        for b in range(_U(Wd.kind.shape[0])):
            X.in_reach[b] = 1
    for p in range(P):
        X.looked[f, p] = 0 if many else _NEAR


@forced_inline
def _apart_from_all(M: SphereModel, X: SphereScratch, a: U64, f: U64, half: float, clear: Real) -> bool:
    """Whether part a is out of reach of all that frame f carries, in every lane. Parts on one frame are not asked about."""
    if X.looked[f, a] == 0:
        S, P = X.rows, _U(M.frame.shape[0])
        bounds = ROW_X + _W * (_U(13) * _U(M.T.shape[0]) + _U(12))
        u, v = bounds + _W * _U(3) * a, bounds + _W * _U(3) * (P + f)
        x, y, z = load(S, u) - load(S, v), load(S, u + _W) - load(S, v + _W), load(S, u + _U(2) * _W) - load(S, v + _U(2) * _W)
        more = M.all[f, 3] + _f(half * X.all_travel[f]) + M.slack[a] + M.all_slack[f] + clear
        r = M.bound[a, 3] + more
        near = below(x * x + y * y + z * z, r * r)
        if near != _U(0):
            x, y, z = seen_from(S, ROW_X + _W * (_U(M.T.shape[0]) + _U(12) * M.frame[a]), v)
            near = near_box(x, y, z, M.box, a, more)
        X.looked[f, a] = _NEAR if near != _U(0) else _APART
    return bool(X.looked[f, a] == _APART)


@jit_inline
def check_batch(M: SphereModel, Wd: SphereWorld, X: SphereScratch, width: float, first: bool, last: bool, whole: bool) -> tuple[Mask, Mask]:
    """Test the 16 configurations in rows ROW_X, balls grown for pieces of this width: lanes that touch, and that do so for certain.

    first: notes the pairs within reach; later batches look at those alone. last: notes which pairs are left. whole: goes on after a certain
    contact.
    """
    S = X.rows
    K, P, B, n = _U(M.T.shape[0]), _U(M.frame.shape[0]), _U(Wd.kind.shape[0]), _U(Wd.pairs.shape[0])
    frames, bounds = ROW_X + _W * K, ROW_X + _W * (_U(13) * K + _U(12))
    fail, sure = _U(0), _U(0)
    forward_kinematics(S, M)
    half, at, together = width * 0.5, K + _U(1), first or whole  # later batches look at what was near
    own = _f(Wd.own_clearance)
    for q in range(P):
        p = P - _U(1) - q  # the hand touches most
        f = M.frame[p]
        if together and f != at:
            at = f
            _all_near(M, Wd, X, f, half)
        x, y, z = placed(S, frames + _W * _U(12) * f, M.bound, p)
        keep(S, bounds + _W * _U(3) * p, x, y, z)
        grow = _f(half * X.travel[p, f])
        for b in range(B):
            if not X.bodies_on[p, b] or (together and not X.in_reach[b]):
                if first:
                    X.bodies_on[p, b] = 0
                continue
            slack = M.slack[p] + Wd.slack[b]
            near = near_body(x, y, z, Wd, b, M.bound[p, 3] + grow + slack + Wd.clearance[b], sure)
            if first:
                X.bodies_on[p, b] = near != _U(0)
            if near & ~sure != _U(0):
                if grow > _f(COARSE_M):
                    fail |= near
                    continue
                now, certain = _part_body(S, M, Wd, p, b, grow, slack, ~near | sure, whole)
                if last and now != _U(0):
                    X.left[p, P + b] = 1
                fail |= now
                sure |= certain
                if sure == _U(ALL) or (sure != _U(0) and not whole):
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
                if coarse_balls(M, a) < coarse_balls(M, b):
                    a, b = b, a
                now, certain = _part_part(S, M, a, b, grow, slack, own, ~near | sure, whole)
                if last and now != _U(0):
                    X.left[a, b] = X.left[b, a] = 1
                fail |= now
                sure |= certain
                if sure == _U(ALL) or (sure != _U(0) and not whole):
                    return fail, sure
    return fail, sure


@jit_inline
def open_batch(
    M: SphereModel, Wd: SphereWorld, X: SphereScratch, refused: Mask, parts: Int, bodies: Int, check: Flags, pairs: Int, out: Index
) -> None:
    """For every pair the lanes of the 16 configurations in rows ROW_X in which it may touch.

    Some parts (m,), those of one frame together, against some bodies (b,), where check (m · b,) says so, and pairs (n, 2) of these parts.
    out (m · b + n,): of pair (i, j) at i · b + j, then of `pairs`; what is not asked about is left as it was.
    """
    S = X.rows
    K, m, B, n = _U(M.T.shape[0]), _U(parts.shape[0]), _U(bodies.shape[0]), _U(pairs.shape[0])
    frames, bounds = ROW_X + _W * K, ROW_X + _W * (_U(13) * K + _U(12))
    forward_kinematics(S, M)
    at, own = K + _U(1), _f(Wd.own_clearance)
    for i in range(m):
        p = _U(parts[i])
        f = M.frame[p]
        if f != at:
            at = f
            _all_near(M, Wd, X, f, 0.0)
        x, y, z = placed(S, frames + _W * _U(12) * f, M.bound, p)
        keep(S, bounds + _W * _U(3) * p, x, y, z)
        for j in range(B):
            if check[i * B + j]:
                b = _U(bodies[j])
                slack, near = M.slack[p] + Wd.slack[b], _U(0)
                if X.in_reach[b]:
                    near = near_body(x, y, z, Wd, b, M.bound[p, 3] + slack + Wd.clearance[b], _U(0))
                if near != _U(0):
                    near, _ = _part_body(S, M, Wd, p, b, _ZERO, slack, ~near, False)
                out[i * B + j] = near | refused
    for i in range(n):
        a, b = _U(parts[pairs[i, 0]]), _U(parts[pairs[i, 1]])
        if M.frame[a] > M.frame[b]:
            a, b = b, a
        if M.frame[a] != M.frame[b] and _apart_from_all(M, X, a, M.frame[b], 0.0, own):
            out[m * B + i] = refused
            continue
        slack = M.slack[a] + M.slack[b]
        r = M.bound[a, 3] + M.bound[b, 3] + slack + own
        u, v = bounds + _W * _U(3) * a, bounds + _W * _U(3) * b
        x, y, z = load(S, u) - load(S, v), load(S, u + _W) - load(S, v + _W), load(S, u + _U(2) * _W) - load(S, v + _U(2) * _W)
        near = below(x * x + y * y + z * z, r * r)
        if near != _U(0):
            if coarse_balls(M, a) < coarse_balls(M, b):
                a, b = b, a
            near, _ = _part_part(S, M, a, b, _ZERO, slack, own, ~near, False)
        out[m * B + i] = near | refused
