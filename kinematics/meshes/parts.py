"""Convex parts made fit for use: flat ones given a thickness, too many joined, corners that make no difference left out."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from kinematics.meshes.cutting import SAME_M, furthest, hull_points, hull_volume, planes_of
from kinematics.transforms import Array

FLAT_M = 1e-4
"""What is thinner is made thicker."""
JOINED = 0.005
"""Parts that are few enough are joined further as long as this adds less than this share to the volume of all, all joints together."""
EXTREMES = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1], [1, 1, -1], [1, -1, 1], [-1, 1, 1]], float)
"""The corners that reach furthest along these, either way, are kept: a part's bounds stay as they are."""


def thickened(parts: list[Array], skin_m: float) -> list[Array]:
    """Parts that are all but flat made as thick as a skin; those that others contain left out."""
    solid = [p for p in parts if not _is_flat(p)]
    planes = [planes_of(p) for p in solid]
    for part in (p for p in parts if _is_flat(p)):
        if any((part @ e[:, :3].T <= e[:, 3] + SAME_M).all() for e in planes):
            continue
        thick = _with_thickness(part, skin_m)
        solid.append(thick)
        planes.append(planes_of(thick))
    return solid


def _is_flat(points: Array) -> bool:
    """Whether points (N, 3) span no solid, or one that is thinner than `FLAT_M`."""
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        return True
    return bool(hull.volume < hull.area / 2 * FLAT_M)


def _with_thickness(points: Array, skin_m: float) -> Array:
    """Points (N, 3) of a flat or straight patch as a thin solid: moved by half a skin to both sides, across it."""
    middle = points.mean(0)
    _, _, axes = np.linalg.svd(points - middle, full_matrices=True)
    flat = np.ptp((points - middle) @ axes.T, axis=0)
    for axis, wide in zip(axes, flat):
        if wide < skin_m:
            points = np.concatenate([points + skin_m / 2 * axis, points - skin_m / 2 * axis])
    return hull_points(points)


def joined(parts: list[Array], most: int) -> list[Array]:
    """Parts two of which become their common hull, the pair first that gains least volume: until no more than `most` are left, and further
    while it costs hardly anything."""
    found = dict(enumerate(parts))
    volume = {k: hull_volume(p) for k, p in found.items()}
    spare, pairs = JOINED * sum(volume.values()), dict[tuple[int, int], tuple[float, Array]]()

    def look(a: int, b: int) -> None:
        p, q = found[a], found[b]
        adjoin = bool((p.min(0) <= q.max(0) + 1e-6).all() and (q.min(0) <= p.max(0) + 1e-6).all())
        if adjoin or len(found) > most:
            points = np.concatenate([p, q])
            pairs[a, b] = hull_volume(points) - volume[a] - volume[b], points

    for a, b in combinations(found, 2):
        look(a, b)
    while pairs:
        (a, b), (gained, points) = min(pairs.items(), key=lambda item: (item[1][0], item[0]))
        if len(found) <= most:
            spare -= max(gained, 0.0)
            if spare < 0:
                break
        new = max(found) + 1
        for k in (a, b):
            del found[k]
        found[new], volume[new] = hull_points(points), hull_volume(points)
        pairs = {pair: value for pair, value in pairs.items() if a not in pair and b not in pair}
        for k in [k for k in found if k != new]:
            look(k, new)
    return list(found.values())


def thinned(points: Array, slack_m: float) -> Array:
    """Some of the corners (N, 3) of a hull, such that no other one is further than slack_m beyond any face of theirs: as Quickhull finds
    them, the furthest first (Barber et al., 1996), the extreme ones along the axes among them."""
    kept = np.unique(np.concatenate([np.argmax(points @ EXTREMES.T, axis=0), np.argmin(points @ EXTREMES.T, axis=0)]))
    while len(kept) < len(points):
        try:
            planes = planes_of(points[kept])
        except (QhullError, ValueError):
            return points
        face, far = furthest(points, planes)
        if far.max() <= slack_m:
            break
        order = np.lexsort((-far, face))
        first = order[np.unique(face[order], return_index=True)[1]]
        kept = np.union1d(kept, first[far[first] > slack_m])
    return np.asarray(points[kept])
