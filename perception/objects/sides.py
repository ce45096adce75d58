"""Between which heights the sides of a solid were seen where the solid has them: a bottle's solid is as wide at its neck as at its body."""

from __future__ import annotations

import numpy as np

from kinematics.shapes import Box, Cylinder, Shape, is_upright
from kinematics.transforms import Array, apply, inverse

LAYER_M = 0.005
FEWEST = 15
"""So many points of a layer say where its sides are."""
NEAREST = 0.2
"""A layer is as far from the solid's sides as that share of its points, those that are nearest to one."""
NARROW_M = 0.003
"""A layer is narrow that is further from them by so much than the nearest one, which may be so far off itself, as a fit is no better than
that. Fingers that are told to go on close by as much on either side."""
TOP_M = 0.010
"""What lies so near to the top may show its face, which is as far from the sides as can be."""
LEAST_M = 0.02
"""Where less height has sides, nothing is said."""


def seen_sides(shape: Shape, T: Array, points: Array) -> tuple[float, float] | None:
    """From which to which height above its bottom (m) an upright box or can has its sides where points (N, 3) show them; None where it does
    all the way up, or where nothing can be said.

    T (4, 4): its pose in the points' frame. Layers that show nothing, as they are hidden, count as those that show sides.
    """
    if not isinstance(shape, (Box, Cylinder)) or not is_upright(T):
        return None
    height = 2 * float(shape.half[2])
    local = apply(inverse(T), points)
    if isinstance(shape, Cylinder):
        inside = shape.radius_m - np.hypot(local[:, 0], local[:, 1])
    else:
        inside = (shape.half - np.abs(local))[:, :2].min(1)
    layers = max(int((height - TOP_M) / LAYER_M), 0)
    layer = np.floor((local[:, 2] + height / 2) / LAYER_M).astype(np.int64)
    found = [inside[layer == k] for k in range(layers)]
    off = np.array([np.quantile(here, NEAREST) if len(here) >= FEWEST else -np.inf for here in found])
    least = off[off > -np.inf].min(initial=np.inf)
    narrow = off > NARROW_M + np.clip(least, 0.0, NARROW_M)
    if not narrow.any():
        return None
    ends = np.flatnonzero(np.concatenate([[True], narrow, [True]]))  # runs of layers with sides lie between those
    first = int(np.diff(ends).argmax())
    low, high = LAYER_M * float(ends[first]), LAYER_M * float(ends[first + 1] - 1)
    if ends[first + 1] - 1 == layers:
        high = height
    return (low, high) if high - low >= LEAST_M else None
