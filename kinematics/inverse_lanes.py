"""Inverse kinematics from sixteen starts at once: damped least squares in float32, a start a lane, as far as float32 goes.

What comes near to the pose here is polished in float64 (`inverse.descend`); most starts that lead to a solution found before, or to none,
need not be followed there. Sixteen starts take as long as two in float64.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Chain
from kinematics.collision.sphere_lanes import ROW_X, U64, Lanes, Mask, Real, forced_inline, forward_kinematics
from kinematics.collision.sphere_model import F32
from kinematics.jit.decorators import jit_inline
from kinematics.jit.record import record
from kinematics.jit.simd import WIDTH, below, chosen, largest, load, nearest_int, root, spread, store
from kinematics.transforms import Array

STEPS, STALLED = 24, 6
NEAR = 1e-7
"""A lane has arrived when its cost, m² and ROTATION_WEIGHT · rad², is below: within 0.3 mm. Float32 tells 0.01 mm."""
ROTATION_WEIGHT = 0.05
_f, _U = np.float32, np.uint64
_W = np.uint64(WIDTH)
_ZERO, _ONE = _f(0), _f(1)
_BY_ROOT = _f(ROTATION_WEIGHT**0.5)
_TURN = _f(2 * np.pi)
_LONGEST = _f(0.6)  # a joint's step
_LEAST_COSINE = _f(0.1)  # of half turns the axis is not known, and the tangent of half the angle has no end
_LEAST_PIVOT = _f(1e-8)
_DAMPING, _LEAST_DAMPING, _LESS, _MORE = _f(1e-3), _f(1e-6), _f(0.2), _f(8.0)
ALL = _U((1 << WIDTH) - 1)


@record
class LaneChain(NamedTuple):
    """A chain's numbers for the lanes: T (K, 12), the rows of T_prev, and prismatic (K,)."""

    T: F32
    prismatic: NDArray[np.uint64]


def lane_chain(chain: Chain) -> LaneChain:
    """A chain for the lanes."""
    return LaneChain(chain.T_prev[:, :3].reshape(-1, 12).astype(np.float32), chain.prismatic.astype(np.uint64))


def make_rows(chain: Chain) -> F32:
    """Memory for `come_near`, one thread's."""
    K, J = len(chain.q_index), len(chain.lower)
    rows = np.zeros(int(ROW_X) + WIDTH * (K + 12 * (K + 1) + _rows_of(J)), np.float32)
    for r in range(3):
        first = int(ROW_X) + WIDTH * (K + 5 * r)
        rows[first : first + WIDTH] = 1.0  # the world
    return rows


def _rows_of(J: int) -> int:
    """Rows besides the frames: q, trial and b (J), two Jacobians (6 J), two errors (6), A (J J)."""
    return 3 * J + 12 * J + 12 + J * J


@jit_inline
def come_near(
    chain: Chain, lanes: LaneChain, H: Array, T: Array, table: Array, starts: NDArray[np.int64], first: int, S: F32, q: U64
) -> Mask:
    """Go from the rows starts[first:first + 16] of table (N, J), the last one repeated, towards the hand at T (4, 4), H (4, 4) being the
    hand in the chain's last frame: the lanes that arrived. Where the lanes are then: rows q (J) of S.

    As `inverse.descend`, but the rotation is measured by twice the tangent of half its angle.
    """
    J, K = _U(chain.lower.shape[0]), _U(chain.q_index.shape[0])
    trial, b = q + _W * J, q + _W * _U(2) * J
    kept, fresh = q + _W * _U(3) * J, q + _W * _U(9) * J  # Jacobians
    e, e_fresh = q + _W * _U(15) * J, q + _W * (_U(15) * J + _U(6))
    A = e_fresh + _W * _U(6)
    for w in range(WIDTH):
        s = starts[min(first + w, starts.shape[0] - 1)]
        for j in range(J):
            S[trial + _W * j + _U(w)] = _f(table[s, j])
    best = before = spread(_f(1e30))
    damping, arrived = spread(_DAMPING), _U(0)
    for n in range(STEPS):
        for k in range(K):
            x = load(S, trial + _W * _U(chain.q_index[k])) * _f(chain.scale[k]) + _f(chain.offset[k])
            store(S, ROW_X + _W * k, x)
        forward_kinematics(S, lanes)
        x, y, z = _error(S, ROW_X + _W * (K + _U(12) * K), H, T, e_fresh, _f(chain.heading))
        cost = spread(_ZERO)
        for r in range(_U(6)):
            cost = cost + load(S, e_fresh + _W * r) * load(S, e_fresh + _W * r)
        better = ALL & ~below(best, cost)
        best, damping = chosen(better, cost, best), chosen(better, largest(damping * _LESS, _LEAST_DAMPING), damping * _MORE)
        _jacobian(S, chain, x, y, z, fresh, K, J)
        _take(S, better, trial, q, J)
        _take(S, better, e_fresh, e, _U(6))
        _take(S, better, fresh, kept, _U(6) * J)
        arrived = below(best, spread(_f(NEAR)))
        if n % STALLED == 0:
            if arrived | ~below(best, before * _f(0.5)) & ALL == ALL:
                break
            before = best
        if arrived == ALL:
            break
        _step(S, chain, q, trial, b, kept, e, A, damping, J)
    return arrived


@forced_inline
def _take(S: F32, which: Mask, fresh: U64, kept: U64, n: U64) -> None:
    """Overwrite n rows where lanes are better."""
    for i in range(n):
        store(S, kept + _W * i, chosen(which, load(S, fresh + _W * i), load(S, kept + _W * i)))


@forced_inline
def _error(S: F32, F: U64, H: Array, T: Array, e: U64, heading: Real) -> tuple[Lanes, Lanes, Lanes]:
    """Rows e (6): the hand's way to T (4, 4), metres, and its turn, weighted; the frame in the rows from F on carries it at H (4, 4). The
    hand's position comes back."""
    x, y, z = _mapped(S, F, H[0, 3], H[1, 3], H[2, 3])
    x, y, z = x + load(S, F + _U(3) * _W), y + load(S, F + _U(7) * _W), z + load(S, F + _U(11) * _W)
    store(S, e, spread(_f(T[0, 3])) - x)
    store(S, e + _W, spread(_f(T[1, 3])) - y)
    store(S, e + _U(2) * _W, spread(_f(T[2, 3])) - z)
    u = v = w = trace = spread(_ZERO)
    for k in range(3):  # the sum of (T's axis) × (the hand's), and of their products
        a, b, c = _mapped(S, F, H[0, k], H[1, k], H[2, k])
        d, f, g = _f(T[0, k]), _f(T[1, k]), _f(T[2, k])
        u, v, w = u + (b * g - c * f), v + (c * d - a * g), w + (a * f - b * d)
        trace = trace + (a * d + b * f + c * g)
    by = spread(_BY_ROOT) / largest((trace + _ONE) * _f(0.5), _LEAST_COSINE)
    store(S, e + _U(3) * _W, u * by)
    store(S, e + _U(4) * _W, v * by)
    store(S, e + _U(5) * _W, w * by * heading)
    return x, y, z


@forced_inline
def _mapped(S: F32, F: U64, x: float, y: float, z: float) -> tuple[Lanes, Lanes, Lanes]:
    """A direction (x, y, z) turned by the frame in the rows from F on."""
    a, b, c = _f(x), _f(y), _f(z)
    return (
        load(S, F) * a + load(S, F + _W) * b + load(S, F + _U(2) * _W) * c,
        load(S, F + _U(4) * _W) * a + load(S, F + _U(5) * _W) * b + load(S, F + _U(6) * _W) * c,
        load(S, F + _U(8) * _W) * a + load(S, F + _U(9) * _W) * b + load(S, F + _U(10) * _W) * c,
    )


@jit_inline
def _jacobian(S: F32, chain: Chain, x: Lanes, y: Lanes, z: Lanes, jac: U64, K: U64, J: U64) -> None:
    """Rows jac (6 J), six a joint: how the hand at (x, y, z) moves and, weighted, turns with it."""
    for i in range(_U(6) * J):
        store(S, jac + _W * i, spread(_ZERO))
    for k in range(K):
        F, scale, o = ROW_X + _W * (K + _U(12) * (k + _U(1))), _f(chain.scale[k]), jac + _W * _U(6) * _U(chain.q_index[k])
        a, b, c = load(S, F + _U(2) * _W) * scale, load(S, F + _U(6) * _W) * scale, load(S, F + _U(10) * _W) * scale
        if chain.prismatic[k]:
            _add_to(S, o, a, b, c)
        else:
            u, v, w = x - load(S, F + _U(3) * _W), y - load(S, F + _U(7) * _W), z - load(S, F + _U(11) * _W)
            _add_to(S, o, b * w - c * v, c * u - a * w, a * v - b * u)
            _add_to(S, o + _U(3) * _W, a * _BY_ROOT, b * _BY_ROOT, c * (_BY_ROOT * _f(chain.heading)))


@forced_inline
def _add_to(S: F32, o: U64, a: Lanes, b: Lanes, c: Lanes) -> None:
    store(S, o, load(S, o) + a)
    store(S, o + _W, load(S, o + _W) + b)
    store(S, o + _U(2) * _W, load(S, o + _U(2) * _W) + c)


@jit_inline
def _step(S: F32, chain: Chain, q: U64, trial: U64, b: U64, jac: U64, e: U64, A: U64, damping: Lanes, J: U64) -> None:
    """Rows trial (J): a damped step from rows q, within the limits. b (J), A (J J): scratch."""
    for i in range(J):
        at = jac + _W * _U(6) * i
        total = spread(_ZERO)
        for r in range(_U(6)):
            total = total + load(S, at + _W * r) * load(S, e + _W * r)
        store(S, b + _W * i, total)
        for j in range(i + _U(1)):
            other, total = jac + _W * _U(6) * j, spread(_ZERO)
            for r in range(_U(6)):
                total = total + load(S, at + _W * r) * load(S, other + _W * r)
            store(S, A + _W * (i * J + j), total + damping if i == j else total)
    _solve(S, A, b, J)
    for j in range(J):
        step = load(S, b + _W * j)
        step = largest(largest(step, -_LONGEST) * -_ONE, -_LONGEST) * -_ONE
        value = load(S, q + _W * j) + step
        if chain.wraps[j]:
            value = value - nearest_int((value - _f((chain.lower[j] + chain.upper[j]) / 2)) * (_ONE / _TURN)) * _TURN
        value = largest(largest(value, _f(chain.lower[j])) * -_ONE, -_f(chain.upper[j])) * -_ONE
        store(S, trial + _W * j, value)


@jit_inline
def _solve(S: F32, A: U64, b: U64, J: U64) -> None:
    """Solve A x = b in every lane: A rows (J J), the lower half of a symmetric positive matrix, and b rows (J), in which x is left."""
    for i in range(J):
        for j in range(i + _U(1)):
            a = load(S, A + _W * (i * J + j))
            for k in range(j):
                a = a - load(S, A + _W * (i * J + k)) * load(S, A + _W * (j * J + k))
            # the diagonal holds reciprocals
            a = spread(_ONE) / root(largest(a, _LEAST_PIVOT)) if i == j else a * load(S, A + _W * (j * J + j))
            store(S, A + _W * (i * J + j), a)
    for i in range(J):
        a = load(S, b + _W * i)
        for k in range(i):
            a = a - load(S, A + _W * (i * J + k)) * load(S, b + _W * k)
        store(S, b + _W * i, a * load(S, A + _W * (i * J + i)))
    for m in range(J):
        i = J - _U(1) - m
        a = load(S, b + _W * i)
        for k in range(i + _U(1), J):
            a = a - load(S, A + _W * (k * J + i)) * load(S, b + _W * k)
        store(S, b + _W * i, a * load(S, A + _W * (i * J + i)))
