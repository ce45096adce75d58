"""A way that is used at last: planned anew a few times, and those that promise most made quicker."""

from __future__ import annotations

from collections.abc import Callable
from operator import itemgetter

import numpy as np

from kinematics.transforms import Array
from planning.motion.cell.queries import PlanningQuery
from planning.motion.cell.workcell import Workcell
from planning.motion.way_cost import WayCost

WORTH = 1.2
"""A way is made quicker, too, only if it takes no more than so many times what the quickest takes already."""


def polished(
    cell: Workcell,
    cost: WayCost,
    query: PlanningQuery,
    path: Array,
    rng: np.random.Generator,
    more_s: Callable[[Array], float] = lambda way: 0.0,
) -> Array:
    """The best of a certified path (K, A) and of others with its ends, made quicker; one with little clearance counts more than it takes,
    and any so much more as more_s says. What is planned anew is not shortened first: to make it quicker does that, too."""
    settings, ends_m, least_s = cell.settings.quickest, cell.settings.clearance.ends_m, float(cost.straight(path[-1] - path[0]))
    ways = [(cost.path(path), path)]
    for _ in range(settings.again):
        if ways[0][0] - least_s < settings.gain_s:
            break
        other = cell.connect_clear(query, path[0], path[-1], rng, settings.iterations, shortened=False)
        if other is not None:
            ways = sorted([*ways, (cost.path(other), other)], key=itemgetter(0))
    best, best_s = path, np.inf
    for way_s, way in ways[: settings.quickened]:
        if way_s > WORTH * best_s or best_s - least_s < settings.gain_s:
            break
        quicker, clearance_m = cell.quickened(query, way, rng)
        quicker_s = cost.path(quicker) + (settings.tight_s if clearance_m < ends_m else 0.0) + more_s(quicker)
        if quicker_s < best_s:
            best, best_s = quicker, quicker_s
    return best
