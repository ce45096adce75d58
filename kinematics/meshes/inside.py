"""What a surface encloses, on a grid: a voxel is inside when no way leads to it from outside, however the surface's faces are turned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.meshes.surface import Surface
from kinematics.transforms import Array

CELLS = 64
"""Voxels along the longest side."""
CLOSED = (1, 2)
"""By so many voxels gaps are closed, one after another, in a surface that is open."""
LEAST_SHARE = 0.02
"""An open surface encloses something when what is inside is this share of its box, at least."""


@dataclass(frozen=True, eq=False)
class Inside:
    """points (M, 3): middles of the voxels wholly inside; skin (K, 3): of those that the surface runs through. pitch_m: their size."""

    points: Array
    skin: Array
    pitch_m: float

    def contains(self, points: Array) -> NDArray[np.bool_]:
        """Which points (N, 3) lie in voxels that are wholly inside."""
        codes = {tuple(c) for c in np.floor(self.points / self.pitch_m).astype(int).tolist()}
        return np.array([tuple(c) in codes for c in np.floor(points / self.pitch_m).astype(int).tolist()], bool)

    @property
    def volumes_m3(self) -> tuple[float, float]:
        """The least and the largest volume that the solid can have."""
        return len(self.points) * self.pitch_m**3, (len(self.points) + len(self.skin)) * self.pitch_m**3


def fill(surface: Surface) -> Inside:
    """What the surface encloses; nothing where it is open by more than a few voxels."""
    pitch = surface.extent_m / CELLS
    cells = np.unique(np.floor(surface_samples(surface.triangles, pitch / 2) / pitch).astype(np.int64), axis=0)
    low = cells.min(0) - 3
    skin = np.zeros(cells.max(0) - low + 4, bool)
    skin[tuple((cells - low).T)] = True
    inside = _enclosed(skin, 0)
    for width in CLOSED if not surface.closed and inside.sum() < LEAST_SHARE * skin.size else ():
        closed = _enclosed(skin, width)
        if closed.sum() >= LEAST_SHARE * skin.size:
            inside = closed
            break
    return Inside(np.asarray((np.argwhere(inside) + low + 0.5) * pitch, float), np.asarray((cells + 0.5) * pitch, float), pitch)


def _enclosed(skin: NDArray[np.bool_], width: int) -> NDArray[np.bool_]:
    """What can't be reached from the grid's border, gaps of up to 2 · width voxels in the skin being closed."""
    from scipy import ndimage

    wall = ndimage.binary_dilation(skin, iterations=width) if width else skin
    label, _ = ndimage.label(~wall)
    outside = label == label[0, 0, 0]
    if width:
        outside = ndimage.binary_dilation(outside, iterations=width, mask=~skin)
    return np.asarray(~outside & ~skin)


def surface_samples(triangles: Array, spacing_m: float) -> Array:
    """Points (N, 3) on triangles (F, 3, 3), on each a lattice no wider than the spacing, corners included."""
    sides = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2)  # side k ends in corners k - 1 and k
    order = (np.argmin(sides, axis=1)[:, None] + np.array([1, 2, 0])) % 3  # a tip first, then the ends of the shortest side
    a, b, c = np.moveaxis(np.take_along_axis(triangles, order[:, :, None], axis=1), 1, 0)
    along, across = (np.maximum(np.ceil(s / spacing_m), 1).astype(int) for s in (sides.max(1), sides.min(1)))
    found = []
    for n, m in np.unique(np.stack([along, across], -1), axis=0):
        some = (along == n) & (across == m)
        s, t = (k.reshape(-1, 1, 1) for k in np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, m + 1)))
        found.append((a[some] + s * (b[some] + t * (c[some] - b[some]) - a[some])).reshape(-1, 3))
    return np.concatenate(found)
