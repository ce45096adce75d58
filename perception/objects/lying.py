"""A cylinder that lies on what bears it: looked for where no upright solid explains what was seen, a can or a bottle that fell over."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from kinematics.shapes import Cylinder
from kinematics.transforms import Array, rotation_about, transform

MOST_POINTS = 1500
"""So many points are enough for a fit."""
FUZZ_M = 0.001
"""What a real can is less round than a cylinder."""
HELD_BACK = 0.05
"""The share of points that may lie further outside than noise carries them: strays at its ends, where depth jumps."""
OFF = 2.0
"""How far from its surface points are, in what noise and fuzz explain: four fifths of them no further."""
LEAST_RADIUS_M, MOST_RADIUS_M = 0.006, 0.10
TOP = 0.15
"""Its top is as high as what was seen, but for that share of its height."""
LEAST_LENGTH = 1.2
"""In radii. What is shorter looks like a ball."""
ENDS = 0.002
"""Its ends are where that share of the points that are on it lies beyond."""


def lying_cylinder(points: Array, doubt_m: Array) -> tuple[Cylinder, Array] | None:
    """The cylinder on the plane z = 0, its axis level, that explains points (N, 3) of its upper side, and its pose (4, 4); None where
    there is none.

    doubt_m (N,): the standard deviations of the points' depths. It contains the points but for noise, and for HELD_BACK of them.
    """
    step = max(1, len(points) // MOST_POINTS)
    points, scale = points[::step], FUZZ_M + doubt_m[::step]
    middle = points[:, :2].mean(0)
    level, height = points[:, :2] - middle, float(points[:, 2].max())
    if len(points) < 30 or not 2 * LEAST_RADIUS_M < height < 2 * MOST_RADIUS_M:
        return None

    def off(x: Array) -> Array:
        """How far each point is outside of the side of a cylinder with a yaw, beside the middle by some way, and with a radius."""
        across = -level[:, 0] * np.sin(x[0]) + level[:, 1] * np.cos(x[0]) - x[1]
        return np.asarray(np.hypot(across, points[:, 2] - x[2]) - x[2])

    spread = np.linalg.eigh(np.cov(level.T))[1][:, 1]
    long = float(np.arctan2(spread[1], spread[0]))
    fits = [
        least_squares(lambda x: off(x) / scale, [yaw, 0.0, height / 2], loss="soft_l1", x_scale=[0.1, 0.01, 0.01], max_nfev=60)
        for yaw in (long, long + np.pi / 2)
    ]
    yaw, beside, radius = min(fits, key=lambda fit: float(fit.cost)).x
    if not LEAST_RADIUS_M < radius < MOST_RADIUS_M:
        return None
    outside = off(np.array([yaw, beside, radius]))
    axis = np.array([np.cos(yaw), np.sin(yaw)])
    along, on_it = level @ axis, np.abs(outside) < 3 * scale
    if not on_it.any():
        return None
    first, last = np.quantile(along[on_it], [ENDS, 1 - ENDS])
    from_ends = np.minimum(np.abs(along - first), np.abs(along - last))
    away = np.where(outside < 0, np.minimum(-outside, from_ends), outside)  # from its side, or from an end that was seen
    beyond = np.maximum(np.maximum(first - along, along - last), outside)
    if np.quantile(away / scale, 0.8) > OFF or np.mean(beyond > 3 * scale) > HELD_BACK:
        return None
    if abs(np.quantile(points[:, 2], 0.98) / (2 * radius) - 1) > TOP or last - first < LEAST_LENGTH * radius:
        return None
    stands_out = float(np.quantile(outside[on_it], 0.95)) - float(np.median(doubt_m))  # beyond what noise explains
    radius += min(max(stands_out, 0.0), float(np.median(scale)))
    centre = middle + axis * (first + last) / 2 + beside * np.array([-axis[1], axis[0]])
    R = rotation_about((0.0, 0.0, 1.0), float(yaw)) @ rotation_about((0.0, 1.0, 0.0), np.pi / 2)
    return Cylinder(float(radius), float(last - first)), transform(R, [*centre, radius])
