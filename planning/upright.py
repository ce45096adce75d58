"""Which way up a mesh stands: the side that it rests on most surely."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from kinematics.shapes import ConvexMesh, convex_parts
from kinematics.transforms import Array

AXES: Mapping[str, tuple[float, float, float]] = {
    "z": (0, 0, 1), "y": (0, 1, 0), "x": (1, 0, 0), "-z": (0, 0, -1), "-y": (0, -1, 0), "-x": (-1, 0, 0),
}  # fmt: skip
SKIN = 0.02
"""What lies within this share of a shape's height of its lowest point is what it rests on."""
HABIT = 0.5
"""z is taken for the upright axis, as most files have it, where a shape rests on half as much that way as on its best side."""


def upright_axis(shape: ConvexMesh) -> str:
    """The axis of a mesh's own frame that points up when it stands: z where it stands well that way, else the one with the largest base.

    A base is as good as the area of its hull, and worth nothing where the middle of the shape is not above it.
    """
    points = np.concatenate(convex_parts(shape))
    bases = {name: base_area(points, np.array(axis, float)) for name, axis in AXES.items()}
    best = max(bases.values())
    if bases["z"] > 0 and bases["z"] >= HABIT * best:
        return "z"
    return max(bases, key=lambda name: bases[name])


def base_area(points: Array, up: Array) -> float:
    """The area (m²) that points (V, 3) rest on with `up` (3,) pointing up; 0 where their middle would tip over."""
    height = points @ up
    low, tall = float(height.min()), float(np.ptp(height))
    flat = points @ turned_up(up).T
    base = flat[height <= low + SKIN * tall, :2]
    try:
        hull = ConvexHull(base)
    except (QhullError, ValueError):
        return 0.0
    middle = (flat[:, :2].min(0) + flat[:, :2].max(0)) / 2
    return float(hull.volume) if (hull.equations[:, :2] @ middle + hull.equations[:, 2] <= 0).all() else 0.0


def turned_up(up: Array) -> Array:
    """The rotation (3, 3) that takes the axis `up` (3,) of a shape to z by the shortest way."""
    z = np.array([0.0, 0.0, 1.0])
    axis, cosine = np.cross(up, z), float(up @ z)
    if cosine < -0.999999:
        return np.diag([1.0, -1.0, -1.0])
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + K + K @ K / (1 + cosine))
