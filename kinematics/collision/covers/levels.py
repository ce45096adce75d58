"""Coarse and fine covers of a solid, bound together by one proof; made once a solid, shipped or kept on disk.

Every piece of the solid lies in one coarse ball i and one fine ball j, and i lists j. If coarse ball i misses a body, so do all the pieces
in it; otherwise only the fine balls that i lists need a look.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics import cache
from kinematics.collision.covers.grids import box_cover, cylinder_cover
from kinematics.collision.covers.hulls import convex_solid
from kinematics.collision.covers.proof import links
from kinematics.collision.covers.sphere_cover import ROUNDING_M, Cover, OnStep, cover
from kinematics.transforms import Array, apply

Int = NDArray[np.int64]
COARSE_M, FINE_M = 0.020, 0.005
SHAPE_M = 0.0065
"""How far the fine balls of boxes and cylinders reach beyond them. Their covers are made in every scene, a cylinder's in 0.6 of the time
that 5 mm would take; edges take 1 % longer to prove free."""
SLIVER_M = 1e-9
"""Where cells overlap by less, the balls around the others that meet there hold it."""
LONG_M, MOST_BALLS = 0.9, 400
"""Covers are coarser of hulls that are longer, by the square of how much longer they are, and of those that would take more fine balls, by
an estimate: of no link of the named robots, but of columns, chassis and plates."""
SHIPPED = Path(__file__).with_name("shipped.npz")
"""The covers of the named robots' hulls: `make covers` makes them."""

_ALGORITHM = "cover-6"  # part of the cache's key: change it whenever another result may come out


class Levels(NamedTuple):
    """Two covers of one solid. Coarse ball i lists fine balls child[start[i]:start[i + 1]]: the solid is the union of pieces of which
    each lies in a coarse ball and in a fine ball that it lists."""

    coarse: Cover
    fine: Cover
    start: Int
    child: Int


def levels(vertices: Array, coarse_m: float = COARSE_M, fine_m: float = FINE_M, *, on_step: OnStep | None = None) -> Levels:
    """A coarse and a fine cover of the hull of vertices (V, 3), from those that ship or the disk cache if these hold them.

    Both are coarser for a large hull (`MOST_BALLS`). The vertices are taken to 0.1 nm, so that a hull is the same hull on every CPU: that
    is a tenth of what the proof leaves for rounding.
    Raises: ValueError as `cover` does.
    """
    points = _rounded(vertices)
    name = _name(points, coarse_m, fine_m)
    known = cache.shipped(SHIPPED, name) or cache.load(name)
    if known is None:
        known = _derived(points, coarse_m, fine_m, on_step)
        cache.store(name, known)
    c, f = known["coarse"].astype(float), known["fine"].astype(float)
    start, child = known["start"].astype(np.int64), known["child"].astype(np.int64)
    coarse_m, fine_m = (float(m) for m in known.get("excess_m", (coarse_m, fine_m)))
    return Levels(Cover(c[:, :3], c[:, 3], coarse_m), Cover(f[:, :3], f[:, 3], fine_m), start, child)


def derived(vertices: Array) -> tuple[str, dict[str, NDArray[np.generic]]]:
    """The levels of a hull of vertices (V, 3) as arrays, and the name that `levels` finds them under. Raises: as `cover` does."""
    points = _rounded(vertices)
    return _name(points, COARSE_M, FINE_M), _derived(points, COARSE_M, FINE_M, None)


def _coarser(points: Array, fine_m: float) -> float:
    """How much coarser the covers of a hull of points (V, 3) are than those of a link of usual size. Raises: as `cover` does."""
    if not fine_m > 0:
        raise ValueError(f"excess_m: {fine_m} is not positive")
    t = convex_solid(points).triangles
    across = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
    area, middle = np.linalg.norm(across, axis=1).sum() / 2, points.mean(0)
    thick = np.abs(((t[:, 0] - middle) * across).sum(1)).sum() / 6 / area
    coarser = max(1.0, float(np.ptp(points, axis=0).max()) / LONG_M) ** 2
    while area > MOST_BALLS * np.pi * (2 * thick + coarser * fine_m) * coarser * fine_m:  # what a ball cuts out of a flat side
        coarser *= 1.25
    return float(coarser)


def _rounded(vertices: Array) -> Array:
    return np.ascontiguousarray(np.round(np.asarray(vertices, float), 10) + 0.0)


def _name(points: Array, coarse_m: float, fine_m: float) -> str:
    return "spheres-" + cache.key(_ALGORITHM, points.tobytes(), f"{coarse_m!r} {fine_m!r}")


def _derived(points: Array, coarse_m: float, fine_m: float, on_step: OnStep | None) -> dict[str, NDArray[np.generic]]:
    coarser = _coarser(points, fine_m)
    excess_m = np.array([coarser * coarse_m, coarser * fine_m])
    a, b = (cover(points, float(m), on_step=on_step) for m in excess_m)
    a = _by_size(a)
    start, child = _csr(links(convex_solid(points).fan, a.centres, a.radii - ROUNDING_M, b.centres, b.radii - ROUNDING_M))
    found = {"coarse": np.c_[a.centres, a.radii], "fine": np.c_[b.centres, b.radii], "start": start, "child": child}
    return found if coarser == 1.0 else {**found, "excess_m": excess_m}


def moved(balls: Levels, T: Array) -> Levels:
    """The same levels in another frame: T (4, 4) maps the old frame's points to the new one's."""
    a, b = balls.coarse, balls.fine
    return balls._replace(coarse=a._replace(centres=apply(T, a.centres)), fine=b._replace(centres=apply(T, b.centres)))


@lru_cache(maxsize=256)
def box_levels(size_m: tuple[float, float, float]) -> Levels:
    """Levels of a cuboid about the origin with edges size_m along x, y, z; kept in memory."""
    (a, few), (b, many) = box_cover(size_m, COARSE_M), box_cover(size_m, SHAPE_M)
    few = few[:, None]
    overlap = (few[:, :, 0] + SLIVER_M < many[:, 1]) & (many[:, 0] + SLIVER_M < few[:, :, 1])
    return Levels(a, b, *_csr(np.asarray(overlap.all(2))))


@lru_cache(maxsize=256)
def cylinder_levels(radius_m: float, height_m: float) -> Levels:
    """Levels of a cylinder about z through the origin. Half a millisecond; kept in memory."""
    a, b = _by_size(cylinder_cover(radius_m, height_m, COARSE_M)), cylinder_cover(radius_m, height_m, SHAPE_M)
    far = np.linalg.norm(a.centres[:, None] - b.centres, axis=2)
    return Levels(a, b, *_csr(far <= a.radii[:, None] + b.radii))  # every point's coarse ball meets its fine one


def _by_size(balls: Cover) -> Cover:
    order = np.argsort(-balls.radii, kind="stable")
    return Cover(balls.centres[order], balls.radii[order], balls.excess_m)


def _csr(linked: NDArray[np.uint8] | NDArray[np.bool_]) -> tuple[Int, Int]:
    """Row starts (C + 1,) and column indices of a 0-1 matrix (C, F)."""
    return np.concatenate([[0], np.cumsum(linked.sum(1, dtype=np.int64))]).astype(np.int64), np.nonzero(linked)[1].astype(np.int64)
