"""Where lines cross convex hulls: what a gripper's fingers leave free is measured along them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Int
from kinematics.transforms import Array

HEIGHTS_M = np.linspace(-0.12, 0.04, 161)  # where the fingers are looked at, along the hand's z
FLAT = 1e-12  # what of a face's normal is along a line, where they are parallel: the normal is as long as twice the face's area, m²
SLIVER_M = 1e-6
"""Triangles that are no higher than that say nothing about a hull's faces."""

_NOWHERE = np.full(len(HEIGHTS_M), np.nan)


class Sections:
    """Where lines along y cross hulls at HEIGHTS_M; remembered by their arrays, for most of them stand still as the fingers move."""

    def __init__(self) -> None:
        self._known: dict[tuple[int, float], tuple[Array, Array, Array]] = {}

    def at(self, vertices: Array, faces: Int, x: float) -> tuple[Array, Array]:
        """Least and greatest y (Z,) of the lines at x, see `cross_section`."""
        if not vertices[:, 0].min() <= x <= vertices[:, 0].max():
            return _NOWHERE, _NOWHERE
        key = (id(vertices), x)
        if key not in self._known:
            low, high = cross_section(vertices if x == 0.0 else vertices - [x, 0.0, 0.0], faces, HEIGHTS_M)
            self._known[key] = vertices, low, high  # which keeps the array: another one may not get its id
        return self._known[key][1:]


def cross_section(vertices: Array, faces: Int, z: Array) -> tuple[Array, Array]:
    """Where the lines x = 0 at heights z (Z,) cross a convex hull: least and greatest y (Z,), nan where they miss."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    longest = np.max([np.linalg.norm(side, axis=1) for side in (b - a, c - b, a - c)], axis=0)
    wide = np.linalg.norm(normal, axis=1) > SLIVER_M * longest  # a sliver's normal is rounding; its neighbours speak for it
    a, normal = a[wide], normal[wide]
    normal *= np.sign(np.einsum("ij,ij->i", normal, a - vertices.mean(0)))[:, None]
    d = np.einsum("ij,ij->i", normal, a)
    across, up = normal[:, 1], normal[:, 2:3]
    below, above = across < -FLAT, across > FLAT
    flat = ~(below | above)

    def most(some: NDArray[np.bool_]) -> Array:
        """What n_y · y may be at most, by each of some faces, at each height."""
        return np.asarray(d[some, None] - up[some] * z)

    low = (most(below) / across[below, None]).max(0, initial=-np.inf)
    high = (most(above) / across[above, None]).min(0, initial=np.inf)
    miss = (low > high) | (most(flat) < 0).any(0)
    return np.where(miss, np.nan, low), np.where(miss, np.nan, high)
