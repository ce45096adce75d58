"""What a view would reveal of a map, compiled: the map as a depth image, and the voxels that are wholly clear in it.

Frames, `step`, `T` and states are as in `perception.mapping.carving`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Int
from kinematics.jit.decorators import njit
from kinematics.transforms import Array
from perception.mapping.carving import FAR, NEAR, Image, States, half_extents, wholly_clear


@njit(cache=True, nogil=True)
def map_depth(
    occupied: Array, step: Array, fx: float, fy: float, cx: float, cy: float, T: Array, blind: NDArray[np.bool_], least: float, out: Image
) -> None:
    """A depth image (H, W) of the occupied voxels, given by their centres (N, 3): their far sides; far where there is none.

    0 where nothing would be learnt: where `blind` (H, W) is True, or where something is nearer than `least`, the camera's least depth.
    """
    height, width = out.shape
    for v in range(height):
        for u in range(width):
            out[v, u] = np.float32(0.0) if blind[v, u] else FAR
    half = np.empty(3)
    half_extents(step, T, half)
    for i in range(occupied.shape[0]):
        a, b, c = occupied[i, 0], occupied[i, 1], occupied[i, 2]
        z = T[2, 0] * a + T[2, 1] * b + T[2, 2] * c + T[2, 3]
        if z < NEAR:
            continue
        x = T[0, 0] * a + T[0, 1] * b + T[0, 2] * c + T[0, 3]
        y = T[1, 0] * a + T[1, 1] * b + T[1, 2] * c + T[1, 3]
        by = 1.0 / z
        u0 = int(max(np.ceil(fx * (x - half[0]) * by + cx), 0.0))
        u1 = int(min(np.floor(fx * (x + half[0]) * by + cx), width - 1.0))
        v0 = int(max(np.ceil(fy * (y - half[1]) * by + cy), 0.0))
        v1 = int(min(np.floor(fy * (y + half[1]) * by + cy), height - 1.0))
        far = np.float32(z + half[2]) if z >= least else np.float32(0.0)
        for v in range(v0, v1 + 1):
            for u in range(u0, u1 + 1):
                out[v, u] = min(out[v, u], far)


@njit(cache=True, nogil=True)
def revealed(
    rows: Int, points: Array, step: Array, T: Array, levels: Image, fx: float, fy: float, cx: float, cy: float, seen: States
) -> None:
    """Leave 1 in `seen` (P,) only for those of `rows` (N,), with centres `points` (N, 3), that a picture would mark FREE.

    levels: the `pyramid` of the map's depth image. Places whose `seen` is 0 are not asked about, those beyond `rows` stay as they are.
    """
    half = np.empty(3)
    half_extents(step, T, half)
    for i in range(rows.shape[0]):
        if seen[rows[i]]:
            seen[rows[i]] = wholly_clear(points[i, 0], points[i, 1], points[i, 2], half, T, levels, fx, fy, cx, cy)


@njit(cache=True, nogil=True)
def revealed_at_most(rows: Int, points: Array, T: Array, depth: Image, fx: float, fy: float, cx: float, cy: float, seen: States) -> None:
    """Whether rows (N,) of `seen` (P,), with centres `points` (N, 3), are inside a picture and before its depth (H, W).

    Quick, and seldom too few.
    """
    height, width = depth.shape
    for i in range(rows.shape[0]):
        seen[rows[i]] = 0
        a, b, c = points[i, 0], points[i, 1], points[i, 2]
        z = T[2, 0] * a + T[2, 1] * b + T[2, 2] * c + T[2, 3]
        if z < NEAR:
            continue
        u = fx * (T[0, 0] * a + T[0, 1] * b + T[0, 2] * c + T[0, 3]) / z + cx
        v = fy * (T[1, 0] * a + T[1, 1] * b + T[1, 2] * c + T[1, 3]) / z + cy
        if u < -0.5 or v < -0.5 or u >= width - 0.5 or v >= height - 0.5:
            continue
        if z < depth[int(np.floor(v + 0.5)), int(np.floor(u + 0.5))]:
            seen[rows[i]] = 1


@njit(cache=True, nogil=True)
def weigh(rows: Int, weight: Array, seen: States, out: Array) -> None:
    """For each view (C,) the summed weight (N,) of those of `rows` (N,) that it has seen; seen (C, P)."""
    for c in range(seen.shape[0]):
        total = 0.0
        for i in range(rows.shape[0]):
            total += weight[i] * seen[c, rows[i]]
        out[c] = total
