"""Surface normals at what an image shows. Compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinematics.collision.geometry import BOX, CYLINDER
from kinematics.jit.decorators import jit_entry, jit_inline
from kinematics.transforms import Array
from perception.rendering.surfaces import Ids, Surfaces


@jit_inline
def owner(s: Surfaces, primitive: int) -> int:
    """The solid behind a primitive."""
    n = s.kind.shape[0]
    if primitive < n:
        return primitive
    low, high = 0, n
    while high - low > 1:
        middle = (low + high) // 2
        if s.first_face[middle] <= primitive - n:
            low = middle
        else:
            high = middle
    return low


@jit_entry
def write_normals(
    s: Surfaces,
    T_world_camera: Array,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    w: Array,
    primitive: Ids,
    corner_normals: Array,
    normals: NDArray[np.float32],
) -> None:
    """Normals (H, W, 3) at what is seen. corner_normals (F, 3, 3), in the solids' frames, are blended over each face; none: flat faces."""
    n, last, k = s.kind.shape[0], np.int32(-1), 0
    for v in range(w.shape[0]):
        for u in range(w.shape[1]):
            i = primitive[v, u]
            if i < 0:
                continue
            if i != last:
                last, k = i, owner(s, i)
            T, half = s.T[k], s.half[k]
            x, y, z = (u - cx) / fx, (v - cy) / fy, 1.0 / w[v, u]
            dx = T_world_camera[0, 0] * x + T_world_camera[0, 1] * y + T_world_camera[0, 2]
            dy = T_world_camera[1, 0] * x + T_world_camera[1, 1] * y + T_world_camera[1, 2]
            dz = T_world_camera[2, 0] * x + T_world_camera[2, 1] * y + T_world_camera[2, 2]
            px = T_world_camera[0, 3] + dx * z - T[0, 3]
            py = T_world_camera[1, 3] + dy * z - T[1, 3]
            pz = T_world_camera[2, 3] + dz * z - T[2, 3]
            qx = T[0, 0] * px + T[1, 0] * py + T[2, 0] * pz
            qy = T[0, 1] * px + T[1, 1] * py + T[2, 1] * pz
            qz = T[0, 2] * px + T[1, 2] * py + T[2, 2] * pz
            if s.kind[k] == BOX:
                nx, ny, nz = _box_normal(half, qx, qy, qz)
            elif s.kind[k] == CYLINDER:
                nx, ny, nz = _cylinder_normal(half, qx, qy, qz)
            else:
                nx, ny, nz = _face_normal(s, i - n, qx, qy, qz, corner_normals[:0])
            mx = T[0, 0] * nx + T[0, 1] * ny + T[0, 2] * nz
            my = T[1, 0] * nx + T[1, 1] * ny + T[1, 2] * nz
            mz = T[2, 0] * nx + T[2, 1] * ny + T[2, 2] * nz
            sign = -1.0 if mx * dx + my * dy + mz * dz > 0.0 else 1.0
            if i >= n and corner_normals.shape[0] > 0:  # which side is seen is for the face to say, not for its blended normal
                nx, ny, nz = _face_normal(s, i - n, qx, qy, qz, corner_normals)
                mx = T[0, 0] * nx + T[0, 1] * ny + T[0, 2] * nz
                my = T[1, 0] * nx + T[1, 1] * ny + T[1, 2] * nz
                mz = T[2, 0] * nx + T[2, 1] * ny + T[2, 2] * nz
            normals[v, u, 0], normals[v, u, 1], normals[v, u, 2] = sign * mx, sign * my, sign * mz


@jit_inline
def _box_normal(half: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    gx, gy, gz = abs(abs(x) - half[0]), abs(abs(y) - half[1]), abs(abs(z) - half[2])
    if gx <= gy and gx <= gz:
        return np.copysign(1.0, x), 0.0, 0.0
    if gy <= gz:
        return 0.0, np.copysign(1.0, y), 0.0
    return 0.0, 0.0, np.copysign(1.0, z)


@jit_inline
def _cylinder_normal(half: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    r = np.sqrt(x * x + y * y)
    if abs(abs(z) - half[2]) < abs(r - half[0]):
        return 0.0, 0.0, np.copysign(1.0, z)
    return x / r, y / r, 0.0


@jit_inline
def _face_normal(s: Surfaces, f: int, x: float, y: float, z: float, corner_normals: Array) -> tuple[float, float, float]:
    a, b, c = s.vertices[s.faces[f, 0]], s.vertices[s.faces[f, 1]], s.vertices[s.faces[f, 2]]
    ax, ay, az, bx, by, bz = b[0] - a[0], b[1] - a[1], b[2] - a[2], c[0] - a[0], c[1] - a[1], c[2] - a[2]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    if corner_normals.shape[0] > 0:
        m = corner_normals[f]
        px, py, pz = x - a[0], y - a[1], z - a[2]
        area = max(nx * nx + ny * ny + nz * nz, 1e-300)
        l1 = ((py * bz - pz * by) * nx + (pz * bx - px * bz) * ny + (px * by - py * bx) * nz) / area
        l2 = ((ay * pz - az * py) * nx + (az * px - ax * pz) * ny + (ax * py - ay * px) * nz) / area
        l1, l2 = min(max(l1, 0.0), 1.0), min(max(l2, 0.0), 1.0)
        l0 = max(1.0 - l1 - l2, 0.0)
        nx = l0 * m[0, 0] + l1 * m[1, 0] + l2 * m[2, 0]
        ny = l0 * m[0, 1] + l1 * m[1, 1] + l2 * m[2, 1]
        nz = l0 * m[0, 2] + l1 * m[1, 2] + l2 * m[2, 2]
    length = max(np.sqrt(nx * nx + ny * ny + nz * nz), 1e-300)
    return nx / length, ny / length, nz / length
