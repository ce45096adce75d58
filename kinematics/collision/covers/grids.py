"""Covers of boxes and cylinders: a weighted set cover of grid cells, in one octant and mirrored.

A cell whose corners all lie in one ball is covered, and the cells fill the solid.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinematics.collision.covers.set_cover import weighted_set_cover
from kinematics.collision.covers.sphere_cover import SLACK, Cover
from kinematics.jit.decorators import jit_entry, jit_inline
from kinematics.shapes import CYLINDER_SIDES
from kinematics.transforms import Array

Int = NDArray[np.int64]
Bits = NDArray[np.uint64]
ROUNDING = 1e-15
"""m², so much more than it can be is allowed before the last test, which alone decides: of sums in another order."""


def mirror_images(centres: Array, axis: int) -> Int:
    """The index of each ball's mirror image, of balls that are symmetric about the plane across an axis."""
    mirrored = centres.copy()
    mirrored[:, axis] *= -1
    twins = np.empty(len(centres), np.int64)
    twins[np.lexsort(mirrored.T)] = np.lexsort(centres.T)
    return twins


def box_cover(size_m: tuple[float, float, float], excess_m: float) -> Cover:
    """Balls that contain the cuboid about the origin with edges size_m and reach at most excess_m beyond it."""
    half = np.array(size_m, float) / 2
    if not (half > 0).all() or not excess_m > 0:
        raise ValueError(f"a box of {size_m} m with {excess_m} m of excess: all must be positive")
    step = excess_m
    while True:
        far, spots = zip(*(_axis(h, step) for h in half), strict=True)
        centres = np.stack(np.meshgrid(*spots, indexing="ij"), -1).reshape(-1, 3)
        radii = (half - centres).min(1) + excess_m
        weights = 2.0 ** (centres > 0).sum(1)
        holds = np.zeros((len(radii), far[0].shape[1] * far[1].shape[1] * far[2].shape[1] // 64 + 1), np.uint64)
        _cells_held(far[0], far[1], far[2], radii - SLACK * excess_m, holds)
        chosen, left = weighted_set_cover(holds, far[0].shape[1] * far[1].shape[1] * far[2].shape[1], weights, np.zeros(0, np.int64))
        if left == 0:
            c, r = _mirrored(centres[chosen], radii[chosen])
            return Cover(c, r, excess_m)
        step /= 2


def cylinder_cover(radius_m: float, height_m: float, excess_m: float) -> Cover:
    """Balls that contain the cylinder about z (and the prism of `shapes.prism` around it) and reach at most excess_m beyond it."""
    if not min(radius_m, height_m, excess_m) > 0:
        raise ValueError(f"a cylinder of {radius_m} × {height_m} m with {excess_m} m of excess: all must be positive")
    outer, h = radius_m / np.cos(np.pi / CYLINDER_SIDES), height_m / 2
    step = excess_m
    most = 8 + 4 * outer / excess_m  # balls in the ring that holds the rim: each takes about a step of it
    rings = np.unique(np.concatenate([[1], np.geomspace(3, most, 14).astype(np.int64)]))
    while True:
        cells, (spots, heights) = [_edges(outer, step), _edges(h, step)], (_spots(radius_m, step), _spots(h, step))
        rho, z, n = (g.ravel() for g in np.meshgrid(spots, heights, rings, indexing="ij"))
        fits = (n > 1) | (rho == 0)
        rho, z, n = rho[fits], z[fits], n[fits]
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
    return np.linspace(0, h, max(1, int(np.ceil(h / (0.6 * step)))) + 1)


def _spots(h: float, step: float) -> Array:
    """Coordinates in [0, h] for centres: counted from the surface inwards, and 0."""
    deep = np.concatenate([np.arange(0.5, 2.5, 0.5), np.arange(3.0, max(h / step, 3.0))])
    inner = h - step * deep
    return np.concatenate([[0.0], inner[inner > 0.1 * step]])


def _axis(h: float, step: float) -> tuple[Array, Array]:
    """For one axis: the squared distance (spots, cells) from a centre's coordinate to the far side of each cell; and the spots."""
    edges, spots = _edges(h, step), _spots(h, step)
    d = (edges[None] - spots[:, None]) ** 2
    return np.maximum(d[:, :-1], d[:, 1:]), spots


@jit_entry
def _cells_held(fx: Array, fy: Array, fz: Array, radii: Array, holds: Bits) -> None:
    """Set in holds (balls, words of 64 cells) whether ball (i, j, k) of the lattice holds cell (u, v, w): those that it holds of a row of
    cells lie side by side, about the one whose far side is nearest to its centre."""
    ny, nz = fy.shape[1], fz.shape[1]
    for i in range(fx.shape[0]):
        at_u = _nearest(fx[i])
        for j in range(fy.shape[0]):
            at_v = _nearest(fy[j])
            for k in range(fz.shape[0]):
                at_w = _nearest(fz[k])
                ball = (i * fy.shape[0] + j) * fz.shape[0] + k
                rr = radii[ball] ** 2 if radii[ball] > 0 else -1.0
                first_u, last_u = _within(fx[i], at_u, rr - fy[j, at_v] - fz[k, at_w] + ROUNDING)
                for u in range(first_u, last_u):
                    first_v, last_v = _within(fy[j], at_v, rr - fx[i, u] - fz[k, at_w] + ROUNDING)
                    for v in range(first_v, last_v):
                        first, last = _within(fz[k], at_w, rr - fx[i, u] - fy[j, v])
                        at = (u * ny + v) * nz
                        _set_bits(holds[ball], at + first, at + last)


@jit_inline
def _nearest(far: Array) -> int:
    """The first of the cells whose far side is nearest."""
    nearest = 0
    for w in range(1, far.shape[0]):
        if far[w] < far[nearest]:
            nearest = w
    return nearest


@jit_inline
def _within(far: Array, nearest: int, most: float) -> tuple[int, int]:
    """Which cells' far sides (squared) are no further than `most`: from the first to before the last; away from the nearest they are only
    ever further."""
    first, last = nearest, nearest
    while first > 0 and far[first - 1] <= most:
        first -= 1
    while last < far.shape[0] and far[last] <= most:
        last += 1
    return first, last


@jit_inline
def _set_bits(words: Bits, first: int, last: int) -> None:
    """Set the bits from the first to before the last."""
    every = np.uint64(0xFFFFFFFFFFFFFFFF)
    while first < last:
        end = min(last, (first | 63) + 1)
        words[first >> 6] |= (every >> np.uint64(64 - (end - first))) << np.uint64(first & 63)
        first = end


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


def _mirrored(centres: Array, radii: Array) -> tuple[Array, Array]:
    """The balls of the octant x, y, z >= 0 in all octants, once where they lie on a plane between two."""
    balls = np.column_stack((centres, radii))
    for axis in range(3):
        twin = balls[balls[:, axis] > 0].copy()
        twin[:, axis] *= -1
        balls = np.concatenate([balls, twin])
    return balls[:, :3].copy(), balls[:, 3].copy()
