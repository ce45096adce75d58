"""What stands where points were seen: the smaller of the two upright solids around them, a box turned about z or a cylinder.

Both contain every point, so neither promises more room than was seen; which of the two is smaller tells a can from a carton.
"""

from __future__ import annotations

import numpy as np

from kinematics.shapes import Box, Cylinder, Shape
from kinematics.transforms import Array, rotation_about, transform

LEAST_M = 0.004  # a flat thing gets some thickness


def upright_solid(points: Array, margin_m: float = 0.0) -> tuple[Shape, Array]:
    """The smallest upright box or cylinder around points (N, 3) and their feet on the plane z = 0, and its pose (4, 4) there.

    margin_m: how much larger it is on every side; none, for grasps leave fractions of a millimetre.
    Raises: ValueError when there are no points.
    """
    if len(points) == 0:
        raise ValueError("there is no solid around no points")
    height = float(max(points[:, 2].max(), LEAST_M)) + margin_m
    outline = _hull(points[:, :2])
    corner, size, yaw = _rectangle(outline)
    centre, radius = _circle(outline)
    size = np.maximum(size + 2 * margin_m, LEAST_M)
    radius = max(radius + margin_m, LEAST_M / 2)
    if np.pi * radius**2 < size[0] * size[1]:
        return Cylinder(radius, height), transform(p=[*centre, height / 2])
    return Box(np.array([*size, height])), transform(rotation_about((0.0, 0.0, 1.0), yaw), [*corner, height / 2])


def _hull(points: Array) -> Array:
    """The corners (K, 2) of the convex hull, counter-clockwise (Andrew's monotone chain on the outermost point of every direction)."""
    angle = np.arange(180) * (2 * np.pi / 180)
    directions = np.stack([np.cos(angle), np.sin(angle)])
    extreme = points[np.unique((points @ directions).argmax(0))]
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


def _turn(a: Array, b: Array, c: Array) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def _rectangle(outline: Array) -> tuple[Array, Array, float]:
    """Centre (2,), size (2,) and yaw of the rectangle of least area around a convex polygon; one side runs along an edge."""
    edges = np.diff(np.concatenate([outline, outline[:1]]), axis=0)
    yaws = np.unique(np.round(np.arctan2(edges[:, 1], edges[:, 0]) % (np.pi / 2), 6))
    best: tuple[float, Array, Array, float] | None = None
    for yaw in yaws:
        R = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
        local = outline @ R.T
        low, high = local.min(0), local.max(0)
        area = float(np.prod(high - low + 1e-9))
        if best is None or area < best[0]:
            best = (area, R.T @ ((low + high) / 2), high - low, float(yaw))
    assert best is not None
    return best[1:]


def _circle(outline: Array) -> tuple[Array, float]:
    """Centre (2,) and radius of the least circle around points (K, 2) (Welzl 1991, as three nested loops)."""
    centre, r = outline[0], 0.0
    far = 1e-9
    for i, p in enumerate(outline):
        if np.linalg.norm(p - centre) <= r + far:
            continue
        centre, r = p, 0.0
        for j, a in enumerate(outline[:i]):
            if np.linalg.norm(a - centre) <= r + far:
                continue
            centre, r = (p + a) / 2, float(np.linalg.norm(p - a)) / 2
            for b in outline[:j]:
                if np.linalg.norm(b - centre) > r + far:
                    centre = _through(p, a, b)
                    r = float(np.linalg.norm(p - centre))
    return centre, r


def _through(a: Array, b: Array, c: Array) -> Array:
    """The middle (2,) of the circle through three points; of the two furthest, when they lie on a line."""
    M = 2 * np.array([b - a, c - a])
    if abs(np.linalg.det(M)) < 1e-15:
        pairs = [(a, b), (a, c), (b, c)]
        far = max(pairs, key=lambda pair: float(np.linalg.norm(pair[0] - pair[1])))
        return np.asarray((far[0] + far[1]) / 2)
    return np.asarray(np.linalg.solve(M, [b @ b - a @ a, c @ c - a @ a]))
