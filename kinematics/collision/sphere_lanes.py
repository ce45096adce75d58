"""The arithmetic of sixteen lanes: forward kinematics, points seen from frames and bodies, distances to boxes, cylinders and planes.

Rounding. With u = 2^-24, a lane's joint value is off by at most 4u·|x| with |x| <= X_MAX = 16, so by 64u; sine and cosine by 6u more; the
products of one joint by 8u of the lengths involved. So one joint moves a point by less than 80u times its distance from the base, K joints
by K times that, and placing a ball, the body's own numbers and the comparison by no more than two joints would. `RATIO` = 96u leaves a
fifth to spare, and the tests compare with float64. For a UR5e this is below 0.1 mm.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from kinematics.collision.geometry import BOX, CYLINDER
from kinematics.collision.sphere_model import F32, SphereWorld
from kinematics.jit.decorators import Function, jit_inline
from kinematics.jit.simd import WIDTH, below, largest, load, nearest_int, root, size, spread, store

Lanes = Any  # a float32x16, which exists in compiled code only
Mask = Any  # a uint64 with a bit a lane
U64 = Any
Real = Any  # a float32

_f, _U = np.float32, np.uint64
_W = np.uint64(WIDTH)
_ZERO, _ONE, _HALF, _FAR, _INSIDE = _f(0), _f(1), _f(0.5), _f(1e9), _f(1e-4)
_TURN, _TURN_HI, _TURN_LO = _f(1 / (2 * np.pi)), _f(6.28125), _f(2 * np.pi - 6.28125)
_S3, _S5, _S7, _S9, _S11 = _f(-1 / 6), _f(1 / 120), _f(-1 / 5040), _f(1 / 362880), _f(-1 / 39916800)
_C2, _C4, _C6, _C8, _C10, _C12 = _f(-0.5), _f(1 / 24), _f(-1 / 720), _f(1 / 40320), _f(-1 / 3628800), _f(1 / 479001600)

# Rows of the scratch array, 16 numbers each: places along the edge, a frame, K joint values; then K + 1 frames of 12, P centres of 3, and
# K + 1 centres of all that a frame carries
ROW_AT, ROW_RELATIVE, ROW_X = _U(0), _U(16), _U(16 * 13)


def forced_inline(function: Function) -> Function:
    """Compiled right into whatever calls it."""
    return jit_inline(function, forceinline=True)


@forced_inline
def _sine_cosine(x: Lanes) -> tuple[Lanes, Lanes]:
    """By whole turns and half angles; off by less than 6 · 2^-24."""
    turns = nearest_int(x * _TURN)
    y = ((x - turns * _TURN_HI) - turns * _TURN_LO) * _HALF
    z = y * y
    s = y * (z * (z * (z * (z * (z * _S11 + _S9) + _S7) + _S5) + _S3) + _ONE)
    c = z * (z * (z * (z * (z * (z * _C12 + _C10) + _C8) + _C6) + _C4) + _C2) + _ONE
    return (s + s) * c, _ONE - (s + s) * s


@forced_inline
def forward_kinematics(S: F32, M: Any) -> None:  # M: a SphereModel, or what else has its T and prismatic
    """Forward kinematics of all lanes: joint values in rows ROW_X to the frames' rows; frame 0, the world, stands there already."""
    K = _U(M.T.shape[0])
    for k in range(K):
        x = load(S, ROW_X + _W * k)
        p = ROW_X + _W * (K + _U(12) * k)
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


@forced_inline
def _turned_row(S: F32, i: U64, T: F32, k: U64) -> tuple[Lanes, Lanes, Lanes, Lanes]:
    """A row of the frame before, times T[k]."""
    x, y, z, t = load(S, i), load(S, i + _W), load(S, i + _U(2) * _W), load(S, i + _U(3) * _W)
    return (
        x * T[k, 0] + y * T[k, 4] + z * T[k, 8],
        x * T[k, 1] + y * T[k, 5] + z * T[k, 9],
        x * T[k, 2] + y * T[k, 6] + z * T[k, 10],
        x * T[k, 3] + y * T[k, 7] + z * T[k, 11] + t,
    )


@forced_inline
def _store_row(S: F32, i: U64, a: Lanes, b: Lanes, c: Lanes, d: Lanes) -> None:
    store(S, i, a)
    store(S, i + _W, b)
    store(S, i + _U(2) * _W, c)
    store(S, i + _U(3) * _W, d)


@forced_inline
def placed(S: F32, T: U64, balls: F32, i: U64) -> tuple[Lanes, Lanes, Lanes]:
    """The centre of balls[i] mapped by the frame in the 12 rows from T on."""
    x, y, z = balls[i, 0], balls[i, 1], balls[i, 2]
    return _row_put(S, T, x, y, z), _row_put(S, T + _U(4) * _W, x, y, z), _row_put(S, T + _U(8) * _W, x, y, z)


@forced_inline
def _row_put(S: F32, i: U64, x: Real, y: Real, z: Real) -> Lanes:
    return load(S, i) * x + load(S, i + _W) * y + load(S, i + _U(2) * _W) * z + load(S, i + _U(3) * _W)


@forced_inline
def into_body(R: F32, b: U64, x: Lanes, y: Lanes, z: Lanes) -> tuple[Lanes, Lanes, Lanes]:
    """A direction in the world, seen from body b."""
    return (
        x * R[b, 0] + y * R[b, 1] + z * R[b, 2],
        x * R[b, 3] + y * R[b, 4] + z * R[b, 5],
        x * R[b, 6] + y * R[b, 7] + z * R[b, 8],
    )


@jit_inline
def frame_into_body(S: F32, T: U64, R: F32, p: F32, b: U64) -> None:
    """Rows ROW_RELATIVE: the frame in the rows from T on, seen from body b."""
    for c in range(_U(4)):
        i = T + c * _W
        x, y, z = load(S, i), load(S, i + _U(4) * _W), load(S, i + _U(8) * _W)
        if c == _U(3):
            x, y, z = x - p[b, 0], y - p[b, 1], z - p[b, 2]
        u, v, w = into_body(R, b, x, y, z)
        store(S, ROW_RELATIVE + c * _W, u)
        store(S, ROW_RELATIVE + (c + _U(4)) * _W, v)
        store(S, ROW_RELATIVE + (c + _U(8)) * _W, w)


@forced_inline
def seen_from(S: F32, A: U64, o: U64) -> tuple[Lanes, Lanes, Lanes]:
    """The point in the three rows from o on, seen from the frame in the rows from A on."""
    x, y, z = load(S, o), load(S, o + _W), load(S, o + _U(2) * _W)
    x, y, z = x - load(S, A + _U(3) * _W), y - load(S, A + _U(7) * _W), z - load(S, A + _U(11) * _W)
    return _turned_back(S, A, x, y, z), _turned_back(S, A + _W, x, y, z), _turned_back(S, A + _U(2) * _W, x, y, z)


@forced_inline
def _turned_back(S: F32, a: U64, x: Lanes, y: Lanes, z: Lanes) -> Lanes:
    return load(S, a) * x + load(S, a + _U(4) * _W) * y + load(S, a + _U(8) * _W) * z


@jit_inline
def frame_into_frame(S: F32, T: U64, A: U64) -> None:
    """Rows ROW_RELATIVE: the frame in the rows from T on, seen from the frame in the rows from A on."""
    for c in range(_U(4)):
        i = T + c * _W
        x, y, z = load(S, i), load(S, i + _U(4) * _W), load(S, i + _U(8) * _W)
        if c == _U(3):
            x, y, z = x - load(S, A + _U(3) * _W), y - load(S, A + _U(7) * _W), z - load(S, A + _U(11) * _W)
        for r in range(_U(3)):
            store(S, ROW_RELATIVE + (_U(4) * r + c) * _W, _turned_back(S, A + r * _W, x, y, z))


@forced_inline
def hits(x: Lanes, y: Lanes, z: Lanes, Wd: SphereWorld, b: U64, r: Real, inner: Real) -> tuple[Mask, Mask]:
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


@forced_inline
def near_ball(x: Lanes, y: Lanes, z: Lanes, balls: F32, i: U64, r: Real) -> Mask:
    """Lanes in which (x, y, z) is nearer than r to the centre of balls[i]."""
    return below(squared_distance(x, y, z, balls, i), r * r)


@forced_inline
def squared_distance(x: Lanes, y: Lanes, z: Lanes, balls: F32, i: U64) -> Lanes:
    """From (x, y, z) to the centre of ball i, m²."""
    u, v, t = x - balls[i, 0], y - balls[i, 1], z - balls[i, 2]
    return u * u + v * v + t * t


@forced_inline
def near_box(x: Lanes, y: Lanes, z: Lanes, boxes: F32, i: U64, r: Real) -> Mask:
    """Lanes in which (x, y, z) is nearer than r to boxes[i]."""
    u = largest(size(x - boxes[i, 0]) - boxes[i, 3], _ZERO)
    v = largest(size(y - boxes[i, 1]) - boxes[i, 4], _ZERO)
    t = largest(size(z - boxes[i, 2]) - boxes[i, 5], _ZERO)
    return below(u * u + v * v + t * t, r * r)


@forced_inline
def near_body(x: Lanes, y: Lanes, z: Lanes, Wd: SphereWorld, b: U64, r: Real, sure: Mask) -> Mask:
    """Lanes in which the ball about (x, y, z) reaches body b; maybe more where all of them are in `sure`."""
    near = near_ball(x, y, z, Wd.ball, b, Wd.ball[b, 3] + r)
    if near & ~sure != _U(0):
        u, v, t = into_body(Wd.R, b, x - Wd.p[b, 0], y - Wd.p[b, 1], z - Wd.p[b, 2])
        near, _ = hits(u, v, t, Wd, b, r, -_ONE)
    return near


@forced_inline
def keep(S: F32, o: U64, x: Lanes, y: Lanes, z: Lanes) -> None:
    """Put down a centre in the three rows from o on."""
    store(S, o, x)
    store(S, o + _W, y)
    store(S, o + _U(2) * _W, z)
