"""One thing on another whose sides are flush in part: no crease runs all around, so a ledge alone tells where the lower one ends.

Where two upright solids explain what was seen, one below a ledge and one above it, and one solid doesn't, there may be two bodies. A single
body that steps in, such as a bottle or a jar with its lid, does so all around, about its own axis. What was put on another stands anywhere
on it: here its side goes on in the side of what carries it, and there it stands back. So both must be seen.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from kinematics.transforms import Array
from perception.objects.footprint import least_circle, least_rectangle, outline_of
from perception.objects.merging import CONTACT_M, fitted_circle, numbered
from perception.objects.patches import CELL_M, Cells, Int

Bool = NDArray[np.bool_]

LEAST_M, SLIMMEST_M = 0.025, 0.04
"""Neither of the two is lower, or slimmer as seen from above: a bottle's neck is."""
LEDGE_M, FEWEST_CELLS = 0.007, 20
"""A ledge is so wide somewhere, and shows so many cells; a side shows as many."""
LEDGES = 4
"""So many heights at which most of the level cells lie are looked at."""
LEVEL, SIDE = 0.9, 0.35
"""The upward part of the normal of what is level, at least, and of what is a side, at most."""
OFF_M = 0.004
"""What a solid explains lies no further from its top or its sides."""
EXPLAINED, MORE = 0.93, 0.06
"""Each of two solids explains so much of its cells, and both the second more than one solid does."""
FLUSH, FLUSH_M, ALIKE = 0.15, 0.005, 0.94
"""So much of the upper one's side goes on below the ledge: no further off, and with a normal whose cosine to the other is this at least."""
BELOW_M, ABOVE_M = 0.015, 0.020
"""Sides are compared so far below and above a ledge."""


def stacks_divided(cells: Cells, label: Int) -> Int:
    """The clusters (C,) once what stands on another is divided from it, numbered anew.

    Where a cluster goes on above what is divided, that is a part of it which the lower one had.
    """
    out, count = label.copy(), int(label.max(initial=-1)) + 1
    todo = list(range(count))
    while todo:
        rows = np.flatnonzero(out == (k := todo.pop()))
        upper = rows[_upper(cells.points[rows], cells.normals[rows])]
        if len(upper):
            above = _above(cells.points, out, upper)
            out[upper] = count if above is None else above
            if above is None:
                todo += [k, count]
                count += 1
    return numbered(out)


def _above(points: Array, label: Int, upper: Int) -> int | None:
    """The cluster that goes on where cells `upper` end above, if there is one."""
    own = points[upper]
    end = own[own[:, 2] > own[:, 2].max() - 2 * CELL_M]
    others = np.flatnonzero((label != label[upper[0]]) & (points[:, 2] > end[:, 2].max() - CELL_M))
    touching = others[cKDTree(end).query(points[others], distance_upper_bound=CONTACT_M)[0] < CONTACT_M] if len(others) else others
    return int(np.bincount(label[touching]).argmax()) if len(touching) >= FEWEST_CELLS else None


def _upper(points: Array, normals: Array) -> Bool:
    """Which of a cluster's cells (N, 3) are of a body that stands on the rest; none when it is one body."""
    z, level, side = points[:, 2], normals[:, 2] > LEVEL, np.abs(normals[:, 2]) < SIDE
    least, found = -1.0, np.zeros(len(points), bool)
    for ledge in _ledges(z, level):
        height = float(np.median(z[ledge]))
        below, above = ledge | (z < height - CELL_M / 2), z > height + 1.5 * CELL_M  # cells between are of either
        if min(height - z.min(), z.max() - height) < LEAST_M or min(_slimness(points[part]) for part in (below, above)) < SLIMMEST_M:
            continue
        if _width(points, ledge, above) < LEDGE_M or _flush(points, normals, side & below, side & above, height) < FLUSH:
            continue
        if least < 0:
            least = MORE + _explained(points, side) / len(points)
        counts, of = np.array([(_explained(points[part], side[part]), np.count_nonzero(part)) for part in (below, above)]).T
        if counts.sum() / of.sum() > least and (counts > EXPLAINED * of).all():
            least, found = counts.sum() / of.sum(), ~ledge & (z > height + CELL_M / 2)
    return found


def _ledges(z: Array, level: Bool) -> list[Bool]:
    """Which cells (N,) are at each of the heights at which most that are level lie."""
    bins = np.floor((z[level] - z.min()) / CELL_M).astype(np.int64)
    count = np.bincount(bins, minlength=2)
    pairs = count[:-1] + count[1:]
    most = np.argsort(-pairs, kind="stable")[:LEDGES]
    number = np.full(len(z), -2, np.int64)
    number[level] = bins
    return [(number == k) | (number == k + 1) for k in most if pairs[k] >= FEWEST_CELLS]


def _slimness(points: Array) -> float:
    """The shorter side of the least rectangle around points (N, 3), seen from above; 0 of too few."""
    return float(least_rectangle(outline_of(points[:, :2]))[1].min()) if len(points) >= FEWEST_CELLS else 0.0


def _width(points: Array, ledge: Bool, above: Bool) -> float:
    """How far the widest parts of a ledge reach out from what stands above it."""
    return float(np.percentile(cKDTree(points[above, :2]).query(points[ledge, :2])[0], 95))


def _flush(points: Array, normals: Array, below: Bool, above: Bool, height: float) -> float:
    """The share of the side that begins above a ledge, at a height, which goes on below it; 0 where either shows too little."""
    low = np.flatnonzero(below & (points[:, 2] > height - BELOW_M))
    high = np.flatnonzero(above & (points[:, 2] < height + ABOVE_M))
    if min(len(low), len(high)) < FEWEST_CELLS:
        return 0.0
    off, i = cKDTree(points[low, :2]).query(points[high, :2])
    return float(np.mean((off < FLUSH_M) & ((normals[low[i]] * normals[high]).sum(1) > ALIKE)))


def _explained(points: Array, side: Bool) -> int:
    """How many points (N, 3) lie on the top or the sides of the upright solid that explains most: a box, or one of two cylinders."""
    plan, beneath = points[:, :2], np.percentile(points[:, 2], 98) - points[:, 2]
    outline = outline_of(plan)
    middle, size, yaw = least_rectangle(outline, plan[side])
    c, s = np.cos(yaw), np.sin(yaw)
    within = [(size / 2 - np.abs((plan - middle) @ np.array([[c, -s], [s, c]]))).min(1)]
    circles = [least_circle(outline), fitted_circle(plan[side]) if np.count_nonzero(side) >= FEWEST_CELLS else None]
    within += [radius - np.hypot(*(plan - centre).T) for centre, radius in filter(None, circles)]
    return max(int(np.count_nonzero(np.minimum(np.abs(inside), np.abs(beneath)) < OFF_M)) for inside in within)
