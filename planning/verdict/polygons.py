"""Convex polygons in the plane: hulls, clipping, width, distance. A polygon is its corners (N, 2), counter-clockwise; N may be below 3."""

from __future__ import annotations

import numpy as np

from kinematics.transforms import Array

_SAME = 1e-12


def hull(points: Array) -> Array:
    """The convex hull (N, 2) of points (M, 2) (Andrew's monotone chain).

    Turns are compared with zero and not with a tolerance: where x is the same but for rounding, the order of the points goes up and down
    one line, and a tolerance would drop its ends.
    """
    if len(points) < 3:
        return points
    order = points[np.lexsort((points[:, 1], points[:, 0]))].tolist()
    lower, upper = _chain(order), _chain(order[::-1])
    return np.array(lower[:-1] + upper[:-1])


def _chain(points: list[list[float]]) -> list[list[float]]:
    out: list[list[float]] = []
    for x, y in points:
        while len(out) > 1 and (out[-1][0] - out[-2][0]) * (y - out[-2][1]) - (out[-1][1] - out[-2][1]) * (x - out[-2][0]) <= 0:
            out.pop()
        out.append([x, y])
    return out


def clip(polygon: Array, window: Array) -> Array:
    """What of a polygon lies within another, which has an area (Sutherland and Hodgman). The result may be a point, a line or nothing."""
    corners = polygon.tolist()
    edges = window.tolist()
    for (ax, ay), (bx, by) in zip(edges, edges[1:] + edges[:1]):
        inside = [(bx - ax) * (y - ay) - (by - ay) * (x - ax) for x, y in corners]
        kept: list[list[float]] = []
        for i, (p, side) in enumerate(zip(corners, inside)):
            q, other = corners[i - 1], inside[i - 1]
            if (side >= 0) != (other >= 0):
                share = other / (other - side)
                kept.append([q[0] + share * (p[0] - q[0]), q[1] + share * (p[1] - q[1])])
            if side >= 0:
                kept.append(p)
        corners = kept
    return np.array(corners).reshape(-1, 2)


def contains(polygon: Array, point: Array) -> bool:
    """Whether a point (2,) lies in a polygon or on its edge."""
    if len(polygon) < 3:
        return False
    edge, to = np.concatenate([polygon[1:], polygon[:1]]) - polygon, point - polygon
    return bool((edge[:, 0] * to[:, 1] - edge[:, 1] * to[:, 0] >= -_SAME).all())


def least_width(polygon: Array) -> float:
    """The distance of the two nearest parallel lines with the polygon between them; 0 for a line or a point."""
    if len(polygon) < 3:
        return 0.0
    edge = np.roll(polygon, -1, axis=0) - polygon
    length = np.hypot(edge[:, 0], edge[:, 1])
    edge, start = edge[length > _SAME] / length[length > _SAME, None], polygon[length > _SAME]
    reach = edge[:, :1] * (polygon[:, 1] - start[:, 1:]) - edge[:, 1:] * (polygon[:, 0] - start[:, :1])
    return float(reach.max(1).min(initial=np.inf)) if len(edge) else 0.0


def nearest(a: Array, b: Array) -> tuple[Array, Array]:
    """The nearest points (2,) of two polygons; one point twice where they overlap. Raises: ValueError when one has no corner."""
    if not len(a) or not len(b):
        raise ValueError("a polygon without corners is near to nothing")
    for one, other in ((a, b), (b, a)):
        if len(other) > 2 and len(common := clip(one, other)):
            middle = common.mean(0)
            return middle, middle
    on_a, on_b = _to_edges(a, b), _to_edges(b, a)[::-1]
    return min((on_a, on_b), key=lambda pair: float(np.linalg.norm(pair[0] - pair[1])))


def _to_edges(points: Array, polygon: Array) -> tuple[Array, Array]:
    """The corner of one polygon that is nearest to an edge of another, and the point there."""
    start, way = polygon, np.roll(polygon, -1, axis=0) - polygon
    length = np.maximum((way**2).sum(1), _SAME**2)
    share = np.clip(((points[:, None] - start) * way).sum(-1) / length, 0, 1)
    foot = start + share[..., None] * way
    i, k = np.unravel_index(int(np.argmin(((points[:, None] - foot) ** 2).sum(-1))), share.shape)
    return points[i], foot[i, k]
