"""Upright pieces of a thing that no single box or cylinder describes, such as a drill: together they contain all that was seen of it.

Seen from above, its points are cut in two where the rectangles around both halves are smallest together, as long as that saves a good part.
"""

from __future__ import annotations

import numpy as np

from kinematics.scene import Body
from kinematics.transforms import Array, transform
from perception.objects.footprint import least_rectangle, outline_of, upright_solid

MOST_PIECES = 6
SAVED = 0.2
"""A cut is worth it when it saves this share of the area."""
CUTS = 12
FEWEST_POINTS = 40
LEAST_AREA_M2 = 1e-6


def upright_pieces(name: str, points: Array, base_m: float) -> tuple[Body, ...]:
    """Solids around points (N, 3) of the cabinet, from the height base_m on, in the cabinet's frame: name_part_0, name_part_1, …"""
    parts = [points]
    while len(parts) < MOST_PIECES:
        cuts = [(_saved(part), i) for i, part in enumerate(parts)]
        (saved, halves), i = max(cuts, key=lambda cut: cut[0][0])
        if saved <= 0 or halves is None:
            break
        parts[i : i + 1] = halves
    up = np.array([0.0, 0.0, base_m])
    out = []
    for k, part in enumerate(parts):
        shape, T = upright_solid(part - up)
        out.append(Body(f"{name}_part_{k}", shape, transform(p=up) @ T))
    return tuple(out)


def _saved(points: Array) -> tuple[float, list[Array] | None]:
    """The area that the best cut of points (N, 3) saves, and both halves; 0 and None when no cut is worth it."""
    whole, (_, size, yaw) = _area(points), least_rectangle(outline_of(points[:, :2]))
    best: tuple[float, list[Array] | None] = (0.0, None)
    for angle, extent in ((yaw, size[0]), (yaw + np.pi / 2, size[1])):
        along = points[:, :2] @ np.array([np.cos(angle), np.sin(angle)])
        for at in along.min() + extent * np.arange(1, CUTS) / CUTS:
            first = along < at
            if FEWEST_POINTS <= np.count_nonzero(first) <= len(points) - FEWEST_POINTS:
                saved = whole - _area(points[first]) - _area(points[~first])
                if saved > max(best[0], SAVED * whole):
                    best = (saved, [points[first], points[~first]])
    return best


def _area(points: Array) -> float:
    """The area of the least rectangle around points (N, 3), seen from above."""
    return max(float(np.prod(least_rectangle(outline_of(points[:, :2]))[1])), LEAST_AREA_M2)
