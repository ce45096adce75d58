"""Triangles of hulls and meshes drawn into a buffer of inverse depth. Compiled."""

from __future__ import annotations

import numpy as np

from kinematics.collision.geometry import HULL
from kinematics.jit.decorators import jit_inline
from kinematics.transforms import Array
from perception.rendering.draw_solids import FAR, clamp_to_image
from perception.rendering.surfaces import Ids, Surfaces


@jit_inline
def draw_triangles(s: Surfaces, k: int, P: Array, p: Array, fx: float, fy: float, cx: float, cy: float, w: Array, primitive: Ids) -> None:
    """With corners p_i in the camera frame the ray d meets the triangle where every e_i = (p_j × p_k)·d has the sign of det(p_0, p_1, p_2);
    there w = n·d / n·p_0. Both triangles at an edge compute the same e_i but for its sign, so no ray slips through between them.
    """
    height, width = w.shape
    start, base = s.first_vertex[k], s.kind.shape[0]
    in_front = True
    for i in range(s.first_vertex[k + 1] - start):
        x, y, z = s.vertices[start + i, 0], s.vertices[start + i, 1], s.vertices[start + i, 2]
        for r in range(3):
            p[i, r] = P[r, 0] * x + P[r, 1] * y + P[r, 2] * z + P[r, 3]
        if p[i, 2] > 1e-6:
            p[i, 5] = 1.0 / p[i, 2]
            p[i, 3] = fx * p[i, 0] * p[i, 5] + cx
            p[i, 4] = fy * p[i, 1] * p[i, 5] + cy
        else:
            in_front = False
    front_only = False
    if s.kind[k] == HULL:  # from outside its back faces are hidden; from inside there are only back faces
        for f in range(s.first_face[k], s.first_face[k + 1]):
            if _facing(p, s.faces[f, 0] - start, s.faces[f, 1] - start, s.faces[f, 2] - start) < 0.0:
                front_only = True
                break
    for f in range(s.first_face[k], s.first_face[k + 1]):
        i0, i1, i2 = s.faces[f, 0] - start, s.faces[f, 1] - start, s.faces[f, 2] - start
        whole = in_front or (p[i0, 2] > 1e-6 and p[i1, 2] > 1e-6 and p[i2, 2] > 1e-6)
        if whole:
            u_low, u_high = min(min(p[i0, 3], p[i1, 3]), p[i2, 3]), max(max(p[i0, 3], p[i1, 3]), p[i2, 3])
            v_low, v_high = min(min(p[i0, 4], p[i1, 4]), p[i2, 4]), max(max(p[i0, 4], p[i1, 4]), p[i2, 4])
            w_low, w_high = min(min(p[i0, 5], p[i1, 5]), p[i2, 5]), max(max(p[i0, 5], p[i1, 5]), p[i2, 5])
        elif p[i0, 2] <= 0.0 and p[i1, 2] <= 0.0 and p[i2, 2] <= 0.0:
            continue
        else:
            u_low, u_high, v_low, v_high, w_low, w_high = 0.0, float(width), 0.0, float(height), 0.0, FAR
        u0, u1, v0, v1 = clamp_to_image(u_low, u_high, v_low, v_high, width, height)
        if u0 > u1 or v0 > v1:
            continue
        x0, y0, z0 = p[i0, 0], p[i0, 1], p[i0, 2]
        x1, y1, z1 = p[i1, 0], p[i1, 1], p[i1, 2]
        x2, y2, z2 = p[i2, 0], p[i2, 1], p[i2, 2]
        nx = (y1 - y0) * (z2 - z0) - (z1 - z0) * (y2 - y0)
        ny = (z1 - z0) * (x2 - x0) - (x1 - x0) * (z2 - z0)
        nz = (x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0)
        det = nx * x0 + ny * y0 + nz * z0
        if det == 0.0 or (front_only and det > 0.0):
            continue
        sign, by_det = 1.0 if det > 0.0 else -1.0, 1.0 / det
        e0a, e0b, e0c = _edge(x1, y1, z1, x2, y2, z2, sign, fx, fy, cx, cy)
        e1a, e1b, e1c = _edge(x2, y2, z2, x0, y0, z0, sign, fx, fy, cx, cy)
        e2a, e2b, e2c = _edge(x0, y0, z0, x1, y1, z1, sign, fx, fy, cx, cy)
        wa, wb = nx * by_det / fx, ny * by_det / fy
        wc = nz * by_det - wa * cx - wb * cy
        name = np.int32(base + f)
        for v in range(v0, v1 + 1):
            r0, r1, r2, rw = e0b * v + e0c, e1b * v + e1c, e2b * v + e2c, wb * v + wc
            first, last = u0, u1
            if u1 - u0 > 16:  # above all where a corner is behind the camera, and nothing is known of the columns
                first, last = _inside(e0a, r0, first, last)
                first, last = _inside(e1a, r1, first, last)
                first, last = _inside(e2a, r2, first, last)
            row, row_primitive = w[v], primitive[v]
            for u in range(first, last + 1):
                least = min(min(e0a * u + r0, e1a * u + r1), e2a * u + r2)
                near = min(max(wa * u + rw, w_low), w_high)
                seen = (least >= 0.0) & (near > row[u])
                row[u] = near if seen else row[u]
                row_primitive[u] = name if seen else row_primitive[u]


@jit_inline
def _inside(a: float, rest: float, first: int, last: int) -> tuple[int, int]:
    """The columns first to last without those, but for one, where a·u + rest < 0."""
    if a == 0.0:
        return (first, last) if rest >= 0.0 else (1, 0)
    at = min(max(-rest / a, -1.0), 1e6)
    return (max(first, int(at) - 1), last) if a > 0.0 else (first, min(last, int(at) + 1))


@jit_inline
def _edge(
    ax: float, ay: float, az: float, bx: float, by: float, bz: float, sign: float, fx: float, fy: float, cx: float, cy: float
) -> tuple[float, float, float]:
    """The plane through the camera and the edge from a to b, as a·u + b·v + c in pixels."""
    ea = sign * (ay * bz - az * by) / fx
    eb = sign * (az * bx - ax * bz) / fy
    return ea, eb, sign * (ax * by - ay * bx) - ea * cx - eb * cy


@jit_inline
def _facing(p: Array, i0: int, i1: int, i2: int) -> float:
    """Negative when the camera at the origin is on the outer side of a triangle."""
    ax, ay, az = p[i1, 0] - p[i0, 0], p[i1, 1] - p[i0, 1], p[i1, 2] - p[i0, 2]
    bx, by, bz = p[i2, 0] - p[i0, 0], p[i2, 1] - p[i0, 1], p[i2, 2] - p[i0, 2]
    return float((ay * bz - az * by) * p[i0, 0] + (az * bx - ax * bz) * p[i0, 1] + (ax * by - ay * bx) * p[i0, 2])
