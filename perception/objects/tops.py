"""How much of a solid's top was seen: the top of an upright thing shows how far it reaches, on the sides that no camera sees as well."""

from __future__ import annotations

import numpy as np

from kinematics.scene import Body
from kinematics.shapes import Box, Cylinder
from kinematics.transforms import Array, apply, inverse

CELL_M, LEVEL_M = 0.008, 0.012
"""The top is divided into squares of this size; one is seen when a point over it is this near to the top's height."""


def seen_top(body: Body, points: Array) -> float:
    """The share of an upright body's top face that points (N, 3) in the world show; 0 for other shapes than boxes and cylinders."""
    if not isinstance(body.shape, (Box, Cylinder)):
        return 0.0
    half, top = body.shape.half[:2], float(body.shape.half[2])
    local = apply(inverse(body.T_world_body), points)
    local = local[np.abs(local[:, 2] - top) < LEVEL_M]
    n = np.maximum(np.floor(2 * half / CELL_M), 1).astype(np.int64)
    cell = np.floor((local[:, :2] + half) / (2 * half) * n).astype(np.int64)
    cell = cell[((cell >= 0) & (cell < n)).all(1)]
    hit = np.zeros(n, bool)
    hit[tuple(cell.T)] = True
    if isinstance(body.shape, Cylinder):
        x, y = ((np.arange(k) + 0.5) / k * 2 - 1 for k in n)
        within = np.hypot(*np.meshgrid(x, y, indexing="ij")) < 1 - 1 / n.max()
        return float(hit[within].mean()) if within.any() else float(hit.any())
    return float(hit.mean())
