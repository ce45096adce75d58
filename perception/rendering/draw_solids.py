"""Boxes and cylinders drawn into a buffer of inverse depth. Compiled.

`P` is a solid's pose in the camera frame; a plane of the solid keeps the ray where g ≤ s·w, with g affine in the pixel and s the plane's
distance from the camera: an upper bound of w where the camera is beyond the plane, a lower one where it is on the solid's side.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinematics.jit.decorators import copy_row, jit_inline
from kinematics.jit.record import record
from kinematics.transforms import Array
from perception.rendering.surfaces import Ids, Surfaces

FAR = 1e30
TINY = 1e-12


@record
class Scratch(NamedTuple):
    """Room for drawing one image: a pose (3, 4); planes (2, 4), upper and lower bounds (6, 3) and conditions (12, 4) of a solid; of the
    largest one the corners (V, 6): in the camera frame, in the image, and 1 / depth."""

    pose: Array
    planes: Array
    upper: Array
    lower: Array
    conditions: Array
    corners: Array


def scratch(s: Surfaces) -> Scratch:
    """For drawing these."""
    most = int(np.diff(s.first_vertex).max(initial=0))
    return Scratch(*(np.empty(shape) for shape in ((3, 4), (2, 4), (6, 3), (6, 3), (12, 4), (most, 6))))


@jit_inline
def _bounds(P: Array, half: Array, fx: float, fy: float, cx: float, cy: float, width: int, height: int) -> tuple[int, int, int, int]:
    """First and last column and row that a cuboid may cover; empty (first > last) when it is behind the camera or out of view."""
    u0, u1, v0, v1, behind = FAR, -FAR, FAR, -FAR, 0
    for i in range(8):
        x = half[0] if i & 1 else -half[0]
        y = half[1] if i & 2 else -half[1]
        z = half[2] if i & 4 else -half[2]
        depth = P[2, 0] * x + P[2, 1] * y + P[2, 2] * z + P[2, 3]
        if depth < 1e-6:
            behind += 1
        else:
            u = fx * (P[0, 0] * x + P[0, 1] * y + P[0, 2] * z + P[0, 3]) / depth + cx
            v = fy * (P[1, 0] * x + P[1, 1] * y + P[1, 2] * z + P[1, 3]) / depth + cy
            u0, u1, v0, v1 = min(u0, u), max(u1, u), min(v0, v), max(v1, v)
    if behind == 8:
        return 0, -1, 0, -1
    if behind > 0:
        return 0, width - 1, 0, height - 1
    return clamp_to_image(u0, u1, v0, v1, width, height)


@jit_inline
def clamp_to_image(u0: float, u1: float, v0: float, v1: float, width: int, height: int) -> tuple[int, int, int, int]:
    """First and last column and row within the image of what reaches from u0 to u1 and from v0 to v1, pixels."""
    return (
        int(np.ceil(min(max(u0, 0.0), float(width)))),
        int(np.floor(max(min(u1, width - 1.0), -1.0))),
        int(np.ceil(min(max(v0, 0.0), float(height)))),
        int(np.floor(max(min(v1, height - 1.0), -1.0))),
    )


@jit_inline
def _slab(P: Array, half: float, axis: int, fx: float, fy: float, cx: float, cy: float, planes: Array) -> None:
    """The two planes ± of one axis: rows [a, b, c, s] of planes (2, 4), with g / |s| = a·u + b·v + c and s = +1 lower, -1 upper bound."""
    o = -(P[0, axis] * P[0, 3] + P[1, axis] * P[1, 3] + P[2, axis] * P[2, 3])
    for side in range(2):
        sign = 1.0 if side == 0 else -1.0
        s = half - sign * o
        if s >= 0.0 and s < TINY:
            s = TINY
        planes[side, 0] = sign * P[0, axis] / fx / s
        planes[side, 1] = sign * P[1, axis] / fy / s
        planes[side, 2] = sign * P[2, axis] / s - planes[side, 0] * cx - planes[side, 1] * cy
        planes[side, 3] = 1.0 if s > 0.0 else -1.0


@jit_inline
def draw_box(
    P: Array, half: Array, k: np.int32, fx: float, fy: float, cx: float, cy: float, w: Array, primitive: Ids, room: Scratch
) -> None:
    """Draw solid k, a box of half sizes half (3,) at P (3, 4) in the camera frame, into w (H, W) and primitive (H, W)."""
    height, width = w.shape
    planes, upper, lower, conditions = room.planes, room.upper, room.lower, room.conditions
    n_upper, n_lower = 0, 0
    for axis in range(3):
        _slab(P, half[axis], axis, fx, fy, cx, cy, planes)
        for side in range(2):
            if planes[side, 3] < 0.0:
                copy_row(planes[side, :3], upper[n_upper])
                n_upper += 1
            else:
                copy_row(planes[side, :3], lower[n_lower])
                n_lower += 1
    if n_upper == 0:
        _fill_from_within(lower, k, w, primitive)
        return
    _, _, v0, v1 = _bounds(P, half, fx, fy, cx, cy, width, height)
    for i in range(n_upper, 3):
        copy_row(upper[0], upper[i])
    # The row is covered where every upper bound is positive and above every lower one: an interval of columns, found by its ends.
    n = 0
    for i in range(n_upper):
        for j in range(n_lower + 1):
            for c in range(3):
                conditions[n, c] = upper[i, c] - (lower[j, c] if j < n_lower else 0.0)
            conditions[n, 3] = -1.0 / conditions[n, 0] if abs(conditions[n, 0]) > 1e-300 else 0.0
            n += 1
    a0, a1, a2 = upper[0, 0], upper[1, 0], upper[2, 0]
    for v in range(v0, v1 + 1):
        first, last = 0.0, width - 1.0
        for i in range(n):
            rest = conditions[i, 1] * v + conditions[i, 2]
            if conditions[i, 0] > 0.0:
                first = max(first, rest * conditions[i, 3])
            elif conditions[i, 0] < 0.0:
                last = min(last, rest * conditions[i, 3])
            elif rest < 0.0:
                last = -1.0
        if last < first:
            continue
        b0 = upper[0, 1] * v + upper[0, 2]
        b1 = upper[1, 1] * v + upper[1, 2]
        b2 = upper[2, 1] * v + upper[2, 2]
        row, row_primitive = w[v], primitive[v]
        for u in range(int(np.ceil(first)), int(last) + 1):
            near = min(min(a0 * u + b0, a1 * u + b1), a2 * u + b2)
            seen = near > row[u]
            row[u] = near if seen else row[u]
            row_primitive[u] = k if seen else row_primitive[u]


@jit_inline
def _fill_from_within(lower: Array, k: np.int32, w: Array, primitive: Ids) -> None:
    """A box around the camera: the whole image sees its far planes."""
    for v in range(w.shape[0]):
        row, row_primitive = w[v], primitive[v]
        for u in range(w.shape[1]):
            far = 0.0
            for i in range(6):
                far = max(far, lower[i, 0] * u + (lower[i, 1] * v + lower[i, 2]))
            seen = far > row[u]
            row[u] = far if seen else row[u]
            row_primitive[u] = k if seen else row_primitive[u]


@jit_inline
def draw_cylinder(
    P: Array, half: Array, k: np.int32, fx: float, fy: float, cx: float, cy: float, w: Array, primitive: Ids, room: Scratch
) -> None:
    """With o the camera and d the ray across the axis, the side keeps the ray where c·w² + 2b·w + a ≤ 0: a = d·d, b = o·d, c = o·o - r²."""
    height, width = w.shape
    u0, u1, v0, v1 = _bounds(P, half, fx, fy, cx, cy, width, height)
    caps = room.planes
    _slab(P, half[2], 2, fx, fy, cx, cy, caps)
    ox = -(P[0, 0] * P[0, 3] + P[1, 0] * P[1, 3] + P[2, 0] * P[2, 3])
    oy = -(P[0, 1] * P[0, 3] + P[1, 1] * P[1, 3] + P[2, 1] * P[2, 3])
    c = ox * ox + oy * oy - half[0] * half[0]
    if abs(c) < TINY:
        c = TINY if c >= 0.0 else -TINY
    outside = c > 0.0
    within = not outside and caps[0, 3] > 0.0 and caps[1, 3] > 0.0
    rr, by_c = half[0] * half[0], 1.0 / c
    ax, ay, dx, dy = P[0, 0] / fx, P[0, 1] / fx, P[1, 0] / fy, P[1, 1] / fy
    top, floor = room.upper[0], room.lower  # what bounds w from above: at most one cap; from below: at most both
    top[0], top[1], top[2] = 0.0, 0.0, FAR
    for i in range(2):
        if caps[i, 3] < 0.0:
            copy_row(caps[i, :3], top)
            floor[i, 0], floor[i, 1], floor[i, 2] = 0.0, 0.0, 0.0
        else:
            copy_row(caps[i, :3], floor[i])
    ta, fa, ga = top[0], floor[0, 0], floor[1, 0]
    for v in range(v0, v1 + 1):
        x0 = dx * (v - cy) + P[2, 0] - ax * cx
        y0 = dy * (v - cy) + P[2, 1] - ay * cx
        t0, f0, g0 = top[1] * v + top[2], floor[0, 1] * v + floor[0, 2], floor[1, 1] * v + floor[1, 2]
        row, row_primitive = w[v], primitive[v]
        for u in range(u0, u1 + 1):
            x, y = ax * u + x0, ay * u + y0
            across = ox * y - oy * x
            b = ox * x + oy * y
            a = x * x + y * y
            root2 = rr * a - across * across
            root = np.sqrt(max(root2, 0.0))
            high = ta * u + t0
            low = max(max(fa * u + f0, ga * u + g0), 0.0)
            high = min(high, (root - b) * by_c) if outside else high
            low = max(low, -(b + root) * by_c if b > 0.0 else a / max(root - b, 1e-300))  # two forms of one root, each where it is exact
            near = low if within else high
            seen = (root2 >= 0.0) & (low <= high) & (near > row[u])
            row[u] = near if seen else row[u]
            row_primitive[u] = k if seen else row_primitive[u]
