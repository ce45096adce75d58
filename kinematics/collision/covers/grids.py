"""Covers of boxes and cylinders, by the cells of a grid: a box's cells lie in a ball each, a cylinder's are a weighted set cover.

A cell whose corners all lie in one ball is covered, and the cells fill the solid.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinematics.collision.covers.set_cover import weighted_set_cover
from kinematics.collision.covers.sphere_cover import SLACK, Cover
from kinematics.jit.decorators import jit_entry
from kinematics.shapes import CYLINDER_SIDES
from kinematics.transforms import Array

Int = NDArray[np.int64]
Bits = NDArray[np.uint64]
_SHARES = np.arange(14) / 13
SNUG = 0.003
"""Balls around cells are larger by this share of the excess: no rounding leaves a corner out."""


def box_cells(size_m: tuple[float, float, float], excess_m: float) -> Array:
    """The cells of a cuboid about the origin with edges size_m, by their low and high corners (N, 2, 3): equal ones at its surface, larger
    ones inside. The ball around a cell reaches no further beyond the cuboid than excess_m, and by `SNUG` less."""
    size, reach = np.array(size_m, float), 2 * (1 - SNUG) * excess_m
    if not (size > 0).all() or not excess_m > 0:
        raise ValueError(f"a box of {size_m} m with {excess_m} m of excess: all must be positive")
    # of a cell with edges a, |a| - min a <= reach: so none is longer than sqrt(2) reach, and none needs to be shorter than half of that
    fewest, most = np.ceil(size * np.sqrt([[0.5], [2.0]]) / reach).astype(np.int64)
    longest = np.concatenate([edge / np.arange(n, m + 1) for edge, n, m in zip(size, fewest, most)])
    counts = np.ceil(size / longest[:, None] - 1e-9)
    edges = size / counts
    fits = np.sqrt((edges * edges).sum(1)) - edges.min(1) <= reach
    n = counts[fits][counts[fits].prod(1).argmin()].astype(np.int64)
    edge, at = size / n, np.argwhere(np.ones(n, np.bool_))
    if n.min() < 3:
        return np.asarray(edge * np.stack([at, at + 1], 1) - size / 2)
    at = at[((at == 0) | (at == n - 1)).any(1)]
    inner = edge * (n - 2)
    inside = box_cells((inner[0], inner[1], inner[2]), excess_m + float(edge.min()))
    return np.concatenate([edge * np.stack([at, at + 1], 1) - size / 2, inside])


def box_cover(size_m: tuple[float, float, float], excess_m: float) -> tuple[Cover, Array]:
    """Balls that contain the cuboid about the origin with edges size_m and reach at most excess_m beyond it, one around each of its
    `box_cells`; and these."""
    cells = box_cells(size_m, excess_m)
    centres, radii = cells.mean(1), np.linalg.norm(cells[:, 1] - cells[:, 0], axis=1) / 2 + SNUG * excess_m
    return Cover(centres, radii, float((radii - (np.array(size_m) / 2 - np.abs(centres)).min(1)).max())), cells


def cylinder_cover(radius_m: float, height_m: float, excess_m: float) -> Cover:
    """Balls that contain the cylinder about z (and the prism of `shapes.prism` around it) and reach at most excess_m beyond it."""
    if not min(radius_m, height_m, excess_m) > 0:
        raise ValueError(f"a cylinder of {radius_m} × {height_m} m with {excess_m} m of excess: all must be positive")
    outer, h = radius_m / np.cos(np.pi / CYLINDER_SIDES), height_m / 2
    step = excess_m
    most = 8 + 4 * outer / excess_m  # balls in the ring that holds the rim: each takes about a step of it
    rings = np.array(sorted({1, *(3 * (most / 3) ** _SHARES).astype(np.int64).tolist()}))
    while True:
        cells, (spots, heights) = [_edges(outer, step), _edges(h, step)], (_spots(radius_m, step), _spots(h, step))
        at, up, ring = np.nonzero((rings > 1) | (spots == 0)[:, None, None] | np.zeros((len(heights), 1), np.bool_))
        rho, z, n = spots[at], heights[up], rings[ring]
        radii = np.minimum(radius_m - rho, h - z) + excess_m
        r = cells[0]
        flat = r[None] ** 2 + rho[:, None] ** 2 - 2 * r[None] * (rho * np.cos(np.pi / n))[:, None]
        flat = np.maximum(flat[:, :-1], flat[:, 1:])
        tall = (cells[1][None] - z[:, None]) ** 2
        tall = np.maximum(tall[:, :-1], tall[:, 1:])
        count = flat.shape[1] * tall.shape[1]
        holds = np.zeros((len(rho), count // 64 + 1), np.uint64)
        _rings_hold(flat, tall, (radii - SLACK * excess_m) ** 2, holds)
        chosen, left = weighted_set_cover(holds, count, n * (1.0 + (z > 0)), np.zeros(0, np.int64))
        if left == 0:
            balls = _rings(rho[chosen], z[chosen], n[chosen], radii[chosen], chosen % 2)
            return Cover(balls[:, :3].copy(), balls[:, 3].copy(), excess_m)
        step /= 2


def _rings(rho: Array, z: Array, n: Int, radii: Array, turned: Int) -> Array:
    """The balls (·, 4) of rings about z, centre and radius: n of them each at distance rho, at height z and, unless that is 0, -z; turned
    (1 or 0) by half the angle between two."""
    size = n * (1 + (z > 0))
    of = np.repeat(np.arange(len(n)), size)
    k = np.arange(len(of)) - np.repeat(np.cumsum(size) - size, size)
    angle = 2 * np.pi * (k % n[of] + 0.5 * turned[of]) / n[of]
    return np.stack([rho[of] * np.cos(angle), rho[of] * np.sin(angle), np.where(k < n[of], z[of], -z[of]), radii[of]], 1)


def _edges(h: float, step: float) -> Array:
    """Cell edges over [0, h], not wider than 0.6 step."""
    n = max(1, int(np.ceil(h / (0.6 * step))))
    return np.asarray(h / n * np.arange(n + 1))


def _spots(h: float, step: float) -> Array:
    """Coordinates in [0, h] for centres: counted from the surface inwards, and 0."""
    deep = np.concatenate([np.arange(0.5, 2.5, 0.5), np.arange(3.0, max(h / step, 3.0))])
    inner = h - step * deep
    return np.concatenate([[0.0], inner[inner > 0.1 * step]])


@jit_entry
def _rings_hold(flat: Array, tall: Array, most: Array, holds: Bits) -> None:
    """Set in holds (balls, words of 64 cells) whether a ring holds cell (u, v): flat (balls, u) + tall (balls, v) <= most (balls,)."""
    one = np.uint64(1)
    for i in range(flat.shape[0]):
        for u in range(flat.shape[1]):
            for v in range(tall.shape[1]):
                if flat[i, u] + tall[i, v] <= most[i]:
                    cell = u * tall.shape[1] + v
                    holds[i, cell >> 6] |= one << np.uint64(cell & 63)
