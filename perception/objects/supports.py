"""What an object stands on: the floor, unless something else is seen beneath it at the height at which it ends."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from kinematics.transforms import Array
from perception.objects.emptiness import footprint

FLOOR_M = 0.015
"""What is seen down to this height stands on the floor, as what is lower is taken for the floor's own noise."""
BENEATH_M = 0.03
"""What something stands on comes up to its lowest point, less this; and begins lower down by at least LOWER_M."""
LOWER_M = 0.008
STRAY_M = 0.01
"""What ends further below nearly all of a thing's points is no end of it: pixels of something else."""
SLACK_M = 0.004
FEWEST_POINTS, FEWEST_SHARE = 20, 0.002
"""So many points, and such a share of all that a thing has, must be beneath what it carries."""


def base_heights(points: Mapping[str, Array]) -> dict[str, float]:
    """The height over the floor at which each object ends below: 0, or where another carries it the top of that one as it is seen beside
    it, for pixels at a seam may be either's; where nothing is seen beside it that of its own lowest point.

    points (N, 3): what is seen of each, in the cabinet's frame. An object whose lower part is hidden stands on the floor.
    """
    low = {name: _lowest(p[:, 2]) for name, p in points.items()}
    out = {}
    for name, p in points.items():
        lower = [q for other, q in points.items() if other != name and low[name] > FLOOR_M and low[other] < low[name] - LOWER_M]
        outline = footprint(p) if lower else p[:0]
        carriers = [q for q in lower if _beneath(outline, q, low[name])]
        tops = [top for q in carriers for top in _top_beside(outline, q) if low[name] - STRAY_M < top < low[name] + SLACK_M]
        own = p[p[:, 2] > low[name] - STRAY_M, 2]
        out[name] = float(max(tops, default=own.min())) if carriers else 0.0
    return out


def _lowest(z: Array) -> float:
    """`np.percentile(z, 1)`, in a fifth of the time."""
    i, share = divmod(0.01 * (len(z) - 1), 1.0)
    rows = [int(i), min(int(i) + 1, len(z) - 1)]
    a, b = np.partition(z, rows)[rows]
    return float(a + (b - a) * share if share < 0.5 else b - (b - a) * (1.0 - share))


def _top_beside(outline: Array, q: Array) -> list[float]:
    """How high points q (M, 3) come outside an outline on the floor, half planes (H, 3), in a list of one; of none where none are."""
    outside = (q[:, :2] @ outline[:, :2].T + outline[:, 2] > SLACK_M).any(1)
    return [-_lowest(-q[outside, 2])] if outside.any() else []


def _beneath(outline: Array, q: Array, low: float) -> bool:
    """Whether points q (M, 3) come up to the height `low` within an outline on the floor, half planes (H, 3)."""
    level = q[(q[:, 2] > low - BENEATH_M) & (q[:, 2] < low + BENEATH_M), :2]
    enough = max(FEWEST_POINTS, FEWEST_SHARE * len(q))
    for a, b, c in outline:  # most points are far from it, and few half planes say so
        if len(level) < enough:
            return False
        level = level[level[:, 0] * a + level[:, 1] * b + c < SLACK_M]
    return len(outline) > 0 and len(level) >= enough
