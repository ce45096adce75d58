"""Convex polygons in the plane: hulls, clipping, width, distance. A polygon is its corners (N, 2), counter-clockwise; N may be below 3."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinematics.jit.decorators import jit_entry
from kinematics.transforms import Array

_SAME = 1e-12


def hull(points: Array) -> Array:
    """The convex hull (N, 2) of points (M, 2) (Andrew's monotone chain).

    Turns are compared with zero and not with a tolerance: where x is the same but for rounding, the order of the points goes up and down
    one line, and a tolerance would drop its ends.
    """
    if len(points) < 3:
        return points
    order, out = np.lexsort((points[:, 1], points[:, 0])), np.empty((len(points) + 1, 2))
    return out[: _hull(np.ascontiguousarray(points, float), order, out)]


@jit_entry
def _hull(points: Array, order: NDArray[np.int64], out: Array) -> int:
    """`hull` of points (M, 2), M > 2, into out (M + 1, 2); how many corners there are. order (M,): the points by x, then by y."""
    count, M = 0, points.shape[0]
    for chain in range(2):  # the lower one from left to right, then the upper one back; each ends where the other begins
        first = count
        for i in range(M):
            x, y = points[order[i if chain == 0 else M - 1 - i]]
            while count - first > 1:
                ax, ay, bx, by = out[count - 2, 0], out[count - 2, 1], out[count - 1, 0], out[count - 1, 1]
                if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0:
                    break
                count -= 1
            out[count, 0], out[count, 1] = x, y
            count += 1
        count -= 1
    return count


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
    width = _least_width(np.ascontiguousarray(polygon))
    return float(width) if width < np.inf else 0.0


@jit_entry
def _least_width(polygon: Array) -> float:
    """`least_width` of a polygon with an edge that has a length; infinite for another."""
    least, N = np.inf, polygon.shape[0]
    for i in range(N):
        x, y = polygon[i, 0], polygon[i, 1]
        u, v = polygon[(i + 1) % N, 0] - x, polygon[(i + 1) % N, 1] - y
        length = np.sqrt(u * u + v * v)
        if length > _SAME:
            reach = -np.inf
            for k in range(N):
                reach = max(reach, (u * (polygon[k, 1] - y) - v * (polygon[k, 0] - x)) / length)
            least = min(least, reach)
    return least


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
