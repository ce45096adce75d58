"""What a cover of a convex hull is made from: its planes and tetrahedra, samples of its surface, and balls that may hold them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.jit.decorators import jit_entry
from kinematics.transforms import Array

Int = NDArray[np.int64]

_GAMMAS = (0.08, 0.25, 0.5, 0.75, 1.0)
_LONG_M, _FEW, _LONG_OF_FEW_M = 0.9, 80, 0.2
"""Tetrahedra that are longer are cut, for the proof finds three counterexamples in each and no more; where they are few, those that are
longer than the last."""


class Solid(NamedTuple):
    """planes (F, 4): outward unit normal n and offset, inside is n·x <= offset; fan (T, 4, 3): tetrahedra that fill the hull;
    triangles (T, 3, 3) and normals (T, 3) of its surface."""

    planes: Array
    fan: Array
    triangles: Array
    normals: Array


def convex_solid(vertices: Array) -> Solid:
    """The convex hull of vertices (V, 3), m. Raises: ValueError when they are not finite, or their hull has no volume."""
    from scipy.spatial import ConvexHull, QhullError

    points = np.asarray(vertices, float)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise ValueError(f"vertices: expected finite (V, 3), got shape {points.shape}")
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError) as e:
        raise ValueError("vertices: their hull has no volume") from e
    normals = hull.equations[:, :3]
    planes = np.unique(np.round(np.c_[normals, -hull.equations[:, 3]], 12), axis=0)
    triangles = points[hull.simplices]
    middle = points[hull.vertices].mean(0)
    fan = np.concatenate([np.repeat(middle[None, None], len(triangles), 0), triangles], 1)
    return Solid(planes.astype(float), _cut(fan), triangles, normals)


def _cut(tetrahedra: Array) -> Array:
    """Tetrahedra (T, 4, 3), those that are long (`_LONG_M`) bisected at their longest edges until they are half as long as that."""
    long_m = _LONG_M if len(tetrahedra) >= _FEW else _LONG_OF_FEW_M
    i, j = np.triu_indices(4, 1)
    longest = np.linalg.norm(tetrahedra[:, i] - tetrahedra[:, j], axis=2).max(1)
    if not (longest > long_m).any():
        return tetrahedra
    done, left = [tetrahedra[longest <= long_m]], tetrahedra[longest > long_m]
    while len(left):
        edges = np.linalg.norm(left[:, i] - left[:, j], axis=2)
        done.append(left[edges.max(1) <= long_m / 2])
        left, edges = left[edges.max(1) > long_m / 2], edges[edges.max(1) > long_m / 2]
        row, k = np.arange(len(left)), edges.argmax(1)
        middle = (left[row, i[k]] + left[row, j[k]]) / 2
        first, second = left.copy(), left.copy()
        first[row, i[k]] = second[row, j[k]] = middle
        left = np.concatenate([first, second])
    return np.concatenate(done)


def surface_samples(solid: Solid, excess_m: float) -> tuple[Array, Array]:
    """Points (N, 3) spread over the surface, one per square of the excess or so, and every corner; outward directions (N, 3)."""
    rng = np.random.default_rng(0)
    t = solid.triangles
    area = np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1) / 2
    n = int(np.clip(area.sum() / excess_m**2, 200, 10000))
    face = rng.choice(len(t), n, p=area / area.sum())
    u = rng.random((n, 2))
    u[u.sum(1) > 1] = 1 - u[u.sum(1) > 1]
    spread = t[face, 0] + u[:, :1] * (t[face, 1] - t[face, 0]) + u[:, 1:] * (t[face, 2] - t[face, 0])
    corners, where = np.unique(t.reshape(-1, 3), axis=0, return_inverse=True)
    outward = np.zeros_like(corners)
    np.add.at(outward, where.ravel(), np.repeat(solid.normals * np.sqrt(area)[:, None], 3, 0))
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)
    return np.concatenate([spread, corners]), np.concatenate([solid.normals[face], outward])


def evenly(n: int, most: int) -> Int:
    """At most `most` indices out of n, evenly spread."""
    return np.unique(np.linspace(0, n - 1, min(n, most)).astype(np.int64))


def candidate_balls(solid: Solid, points: Array, outward: Array, excess_m: float, slack: float) -> tuple[Array, Array]:
    """Balls that hold one of the points (N, 3) with slack: centres (C, 3) on the lines inwards, radii (C,) depth + excess.

    On the line x - t·d the depth is min_j D_j + t d·n_j, so the ball about that point still reaches x while t <= depth + excess - slack:
    up to t = min_j (D_j + excess - slack) / (1 - d·n_j). Centres are taken at several parts of the way.
    """
    n, gammas = len(points), np.array(_GAMMAS)
    centres, radii = np.empty((n * len(gammas), 3)), np.empty(n * len(gammas))
    _line_balls(np.ascontiguousarray(points), np.ascontiguousarray(outward), solid.planes, excess_m, slack, gammas, centres, radii)
    return centres, radii


@jit_entry
def _line_balls(
    points: Array, outward: Array, planes: Array, excess: float, slack: float, gammas: Array, centres: Array, radii: Array
) -> None:
    m = gammas.shape[0]
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        dx, dy, dz = outward[i, 0], outward[i, 1], outward[i, 2]
        reach = 1e9
        for j in range(planes.shape[0]):
            along = 1.0 - (dx * planes[j, 0] + dy * planes[j, 1] + dz * planes[j, 2])
            gap = planes[j, 3] - (x * planes[j, 0] + y * planes[j, 1] + z * planes[j, 2]) + excess - slack
            if gap < reach * along:
                reach = gap / along
        for g in range(m):
            t = gammas[g] * max(reach, 0.0) * (1 - 1e-9)
            a, b, c = x - t * dx, y - t * dy, z - t * dz
            depth = 1e9
            for j in range(planes.shape[0]):
                depth = min(depth, planes[j, 3] - (a * planes[j, 0] + b * planes[j, 1] + c * planes[j, 2]))
            if depth < 0.0:  # the line has left a sharp corner: a ball about the point itself always will do
                a, b, c, depth = x, y, z, 0.0
            k = i * m + g
            centres[k, 0], centres[k, 1], centres[k, 2] = a, b, c
            radii[k] = depth + excess
