"""Triangles cut by planes, and the hulls of what lies on either side.

A plane is a unit normal n (3,) and an offset d: below it is n · x ≤ d. A triangle that lies in the plane belongs to the side on which
its neighbours lie, else below.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from kinematics.transforms import Array

SAME_M = 1e-9
"""Points no further from a plane than this lie in it."""
ENTRIES = 200_000
"""So many distances of points to planes are worked out at once: as many as a core's cache holds."""


def cut(triangles: Array, normal: Array, offset: float) -> tuple[Array, Array]:
    """Triangles (F, 3, 3) below and above a plane, those across it cut along it: together the same surface, to rounding."""
    side = triangles @ normal - offset
    side[np.abs(side) <= SAME_M] = 0.0
    low, high = side.min(1), side.max(1)
    flat = (low == 0) & (high == 0)
    below, above, across = (high <= 0) & ~flat, (low >= 0) & ~flat, (low < 0) & (high > 0)
    pieces = _cut_across(triangles[across], side[across])
    down, up = np.concatenate([triangles[below], pieces[0]]), np.concatenate([triangles[above], pieces[1]])
    if flat.any():
        to_up = _flat_above(triangles[flat], *(t[np.abs(t @ normal - offset) <= SAME_M] for t in (down, up)))
        down, up = np.concatenate([down, triangles[flat][~to_up]]), np.concatenate([up, triangles[flat][to_up]])
    return down, up


def _cut_across(triangles: Array, side: Array) -> tuple[Array, Array]:
    """The pieces below and above of triangles that have corners on both sides."""
    if len(triangles) == 0:
        return triangles, triangles
    # a corner in the plane and one on each side of it, or one corner alone on its side: turned so that this corner comes first
    in_plane = side == 0
    touching = in_plane.any(1)
    alone = np.where(touching, np.argmax(in_plane, axis=1), np.argmax((side > 0) == ((side > 0).sum(1) == 1)[:, None], axis=1))
    order = (alone[:, None] + np.arange(3)) % 3
    t, s = np.take_along_axis(triangles, order[:, :, None], axis=1), np.take_along_axis(side, order, axis=1)
    pieces, where = list[Array](), list[Array]()
    if touching.any():
        (a, b, c), (_, sb, sc) = np.moveaxis(t[touching], 1, 0), s[touching].T
        m = b + (sb / (sb - sc))[:, None] * (c - b)
        pieces += [np.stack([a, b, m], 1), np.stack([a, m, c], 1)]
        where += [sb, sc]
    if not touching.all():
        (a, b, c), (sa, sb, sc) = np.moveaxis(t[~touching], 1, 0), s[~touching].T
        p, q = a + (sa / (sa - sb))[:, None] * (b - a), a + (sa / (sa - sc))[:, None] * (c - a)
        pieces += [np.stack([a, p, q], 1), np.stack([p, b, c], 1), np.stack([p, c, q], 1)]
        where += [sa, sb, sb]
    joined, at = np.concatenate(pieces), np.concatenate(where)
    return joined[at < 0], joined[at > 0]


def _flat_above(flat: Array, down: Array, up: Array) -> NDArray[np.bool_]:
    """Which triangles (F, 3, 3) in the plane belong above: more of their corners are among the points (N, 3) above than below."""
    known = [{tuple(p) for p in np.round(points, 9).tolist()} for points in (down, up)]
    corners = np.round(flat, 9).tolist()
    below, above = (np.array([sum(tuple(p) in side for p in t) for t in corners]) for side in known)
    return np.asarray(above > below)


def hull_points(points: Array) -> Array:
    """Those of the points (N, 3) that are corners of their convex hull; all of them, each once, when they lie in a plane."""
    try:
        return np.asarray(points[np.sort(ConvexHull(points).vertices)])
    except (QhullError, ValueError):
        return np.unique(points, axis=0)


def hull_volume(points: Array) -> float:
    """The volume (m³) of the convex hull of points (N, 3); 0 when they lie in a plane."""
    if len(points) < 4:
        return 0.0
    try:
        return float(ConvexHull(points).volume)
    except (QhullError, ValueError):
        return 0.0


def planes_of(part: Array) -> Array:
    """Planes (H, 4) of a part's hull: n · x ≤ d inside."""
    return np.asarray(ConvexHull(part).equations * (1, 1, 1, -1))


def furthest(points: Array, planes: Array) -> tuple[NDArray[np.intp], Array]:
    """Which of planes (H, 4) each of points (N, 3) is furthest beyond (N,), and how far (N,)."""
    face, far = np.empty(len(points), np.intp), np.empty(len(points))
    step = max(1, ENTRIES // len(planes))
    for some in (slice(i, i + step) for i in range(0, len(points), step)):
        out = points[some] @ planes[:, :3].T - planes[:, 3]
        face[some] = np.argmax(out, axis=1)
        far[some] = np.take_along_axis(out, face[some][:, None], axis=1)[:, 0]
    return face, far
