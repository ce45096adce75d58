"""What stands where points were seen: the smaller of the two upright solids around them, a box turned about z or a cylinder.

Both contain every point, so neither promises more room than was seen; which of the two is smaller tells a can from a carton. Clean points
of a part of the sides tell it better.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from kinematics.shapes import Box, Cylinder, Shape
from kinematics.transforms import Array, rotation_about, transform

LEAST_M = 0.004  # a flat thing gets some thickness
DIRECTIONS, COARSE = 180, 10  # in so many directions the outermost point is sought; one in so many at first
NOTHING_M, FAR_M = 1e-6, 1e-9  # how far a point may lie outside of the outline, and of the circle, and count as on it
BLOCK = 4096
ROUND_M, LARGEST_M, BENT_M = 1e-4, 0.15, 0.002
"""Clean points of a side are on a circle when none is further off, it is no larger, and they don't lie in a strip that is narrower."""
TOP_M = 5e-4
"""Points that are so much lower than the highest are not on the top."""
ALIKE, MOST_SIDE = 1.3, 500
"""Rectangles of so much of the least area are told apart by how near to their edges the points of the sides lie, so many of them."""


def upright_solid(points: Array) -> tuple[Shape, Array]:
    """The smallest upright box or cylinder around points (N, 3) and their feet on the plane z = 0, and its pose (4, 4) there.

    Without a margin, for grasps leave fractions of a millimetre. Raises: ValueError when there are no points.
    """
    return _smallest(points)


def clean_solid(points: Array) -> tuple[Shape, Array]:
    """The same of clean points: the cylinder on whose side those below the top lie, or the box along its seen faces."""
    side = points[points[:, 2] < points[:, 2].max(initial=0.0) - TOP_M, :2]
    if (seen := _seen_circle(points[:, :2], side)) is None:
        return _smallest(points, side)
    height = _height(points)
    return Cylinder(seen[1], height), transform(p=[*seen[0], height / 2])


def _smallest(points: Array, side: Array | None = None) -> tuple[Shape, Array]:
    """See `upright_solid`; side (K, 2): see `least_rectangle`."""
    if len(points) == 0:
        raise ValueError("there is no solid around no points")
    height, outline = _height(points), outline_of(points[:, :2])
    corner, size, yaw = least_rectangle(outline, side)
    centre, radius = least_circle(outline)
    size, radius = np.maximum(size, LEAST_M), max(radius, LEAST_M / 2)
    if np.pi * radius**2 < size[0] * size[1]:
        return Cylinder(radius, height), transform(p=[*centre, height / 2])
    return Box(np.array([*size, height])), transform(rotation_about((0.0, 0.0, 1.0), yaw), [*corner, height / 2])


def _height(points: Array) -> float:
    """How high an upright solid around points (N, 3) is."""
    return float(max(points[:, 2].max(), LEAST_M))


def _seen_circle(points: Array, side: Array) -> tuple[Array, float] | None:
    """Centre (2,) and radius of the circle on which all points (K, 2) of a side lie, if they do and the others (N, 2) within it: a can of
    which a part of the side was seen. It is the least squares solution of |p|² = 2 p · c + r² - |c|² (Kåsa 1976)."""
    if len(side) < 3:
        return None
    middle = side.mean(0)
    side = side - middle
    if np.ptp(side @ np.linalg.eigh(np.cov(side.T))[1][:, 0]) < BENT_M:
        return None
    *c, rest = np.linalg.lstsq(np.column_stack([2 * side, np.ones(len(side))]), (side**2).sum(1), rcond=None)[0]
    radius, centre = float(np.sqrt(max(rest + c @ np.asarray(c), 0.0))), middle + c
    if radius > LARGEST_M or np.abs(np.hypot(*(side - c).T) - radius).max() > ROUND_M:
        return None
    furthest = float(np.hypot(*(points - centre).T).max())
    return (centre, max(radius, furthest)) if furthest < radius + ROUND_M else None


def outline_of(points: Array) -> Array:
    """The corners (K, 2) of the convex hull of points (N, 2), counter-clockwise.

    Andrew's monotone chain on the outermost point of every direction.
    """
    extreme = points[_outermost(points)]
    order = extreme[np.lexsort((extreme[:, 1], extreme[:, 0]))]
    chains = []
    for side in (order, order[::-1]):
        chain: list[Array] = []
        for p in side:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], p) <= 0:
                chain.pop()
            chain.append(p)
        chains += chain[:-1]
    return np.array(chains if chains else order[:1])


def _outermost(points: Array) -> NDArray[np.int64]:
    """Which of the points (N, 2) lie furthest out in some direction. What lies within the polygon of the first few is not asked again."""
    angle = np.arange(DIRECTIONS) * (2 * np.pi / DIRECTIONS)
    directions = np.stack([np.cos(angle), np.sin(angle)], -1)
    rough = _furthest(points, directions[::COARSE])
    corners = points[rough[np.append(True, np.diff(rough) != 0)]]
    x, y = points.T.copy()
    out = np.zeros(len(points), bool)
    for (cx, cy), (dx, dy) in zip(corners, np.roll(corners, -1, axis=0) - corners):
        out |= dx * (y - cy) - dy * (x - cx) < -NOTHING_M * np.hypot(dx, dy)
    out[rough] = True
    rows = np.flatnonzero(out)
    return np.unique(rows[_furthest(points[rows], directions)])


def _furthest(points: Array, directions: Array) -> NDArray[np.int64]:
    """For each direction (D, 2) the index of the point (N, 2) that lies furthest along it."""
    columns = points.T.copy()
    most, at = np.full(len(directions), -np.inf), np.zeros(len(directions), np.int64)
    for first in range(0, len(points), BLOCK):  # in pieces that stay in the processor's cache
        along = directions @ columns[:, first : first + BLOCK]
        k = along.argmax(1)
        value = along[np.arange(len(k)), k]
        at, most = np.where(value > most, first + k, at), np.maximum(value, most)
    return at


def _turn(a: Array, b: Array, c: Array) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def least_rectangle(outline: Array, side: Array | None = None) -> tuple[Array, Array, float]:
    """Centre (2,), size (2,) and yaw of the rectangle of least area around a convex polygon; one side runs along an edge.

    side (K, 2): points that lie on its edges. Around two faces of a box the rectangle along them is as large as the one along the diagonal.
    """
    edges = np.diff(np.concatenate([outline, outline[:1]]), axis=0)
    yaws = np.unique(np.round(np.arctan2(edges[:, 1], edges[:, 0]) % (np.pi / 2), 6))
    c, s, (x, y) = np.cos(yaws)[:, None], np.sin(yaws)[:, None], outline.T
    area = (np.ptp(c * x + s * y, axis=1) + 1e-9) * (np.ptp(c * y - s * x, axis=1) + 1e-9)
    best = area.argmin()
    if side is not None and len(side):
        alike, some = np.flatnonzero(area <= ALIKE * area[best]), side[:: -(-len(side) // MOST_SIDE)]
        best = alike[int(np.argmin([_off_edges(outline, some, yaws[i]) for i in alike]))]
    yaw = float(yaws[best])
    R = _turned(yaw)
    local = outline @ R.T
    low, high = local.min(0), local.max(0)
    return R.T @ ((low + high) / 2), high - low, yaw


def _off_edges(outline: Array, side: Array, yaw: float) -> float:
    """How far points (K, 2) lie from the edges of the rectangle around a convex polygon, on average."""
    R = _turned(yaw)
    around, local = outline @ R.T, side @ R.T
    return float(np.minimum(local - around.min(0), around.max(0) - local).min(1).mean())


def _turned(yaw: float) -> Array:
    """R (2, 2) so that R @ p is a point seen from a frame turned by yaw."""
    return np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])


def least_circle(outline: Array) -> tuple[Array, float]:
    """Centre (2,) and radius of the least circle around points (K, 2).

    It grows from the points on its rim and the one that is furthest out (after Welzl 1991, Gärtner 1999).
    """
    rim, centre, r = outline[:1], outline[0], 0.0
    while True:
        off = np.hypot(*(outline - centre).T)
        if off.max() <= r + FAR_M:
            return centre, r
        p, best = outline[off.argmax()], (np.inf, centre, rim)
        for others in (c for n in (1, 2) for c in combinations(rim, n)):
            middle = (p + others[0]) / 2 if len(others) == 1 else _through(p, *others)
            radius = float(np.linalg.norm(p - middle))
            if radius < best[0] and np.hypot(*(rim - middle).T).max() <= radius + FAR_M:
                best = (radius, middle, np.array([p, *others]))
        if best[0] <= r:
            return centre, float(off.max())  # rounding: it grows no more
        r, centre, rim = best


def _through(a: Array, b: Array, c: Array) -> Array:
    """The middle (2,) of the circle through three points; of the two furthest, when they lie on a line."""
    M = 2 * np.array([b - a, c - a])
    if abs(np.linalg.det(M)) < 1e-15:
        pairs = [(a, b), (a, c), (b, c)]
        far = max(pairs, key=lambda pair: float(np.linalg.norm(pair[0] - pair[1])))
        return np.asarray((far[0] + far[1]) / 2)
    return np.asarray(np.linalg.solve(M, [b @ b - a @ a, c @ c - a @ a]))
