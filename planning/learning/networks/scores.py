"""How the heads of the `objects` form become one order of objects and one of regions. The constants were chosen on validation states."""

from __future__ import annotations

import numpy as np

from planning.learning.networks.tokens import F32

BLOCKING_SHARE = 0.10  # an object that touches so many of the paths is in their way
LABEL_WEIGHT = 0.6  # of p̂ beside the chance that the target is free once the object is gone
CAREFUL = 3  # how much worse than the chance of blocking no path it is to block a share of them
AHEAD = 0.1  # of the chance of going first in a shortest relaxed plan, beside what one step says
NEAREST = 0.05  # what the distance across the whole floor is worth, in probability
NEAREST_TRIED = 1.5
"""The same where motions are tried before a region is settled on, in a look ahead: a miss costs milliseconds there, a metre seconds of the
arm. Chosen on 100 development scenes among 0.3, 0.7, 1.5 and 2.5: as many are solved, with as many moves; relocations are 1.90, 1.92, 1.84
and 1.78 m long, plans take 11.0, 11.0, 10.8 and 10.8 s, and from 2.5 on more of them pass things at less than 3 mm."""


def object_score(p: F32, pickable: F32, opens: F32, first: F32 | None = None) -> F32:
    """Larger is better: it can be picked, and then the target is free, or at least fewer paths are blocked.

    first: the chance that it goes first in a shortest relaxed plan, where the networks know it. It decides where no single move helps.
    """
    one_step = pickable * (opens + LABEL_WEIGHT * p)
    return np.asarray(one_step if first is None else one_step + AHEAD * pickable * first)


def region_score(feasible: F32, hits: F32, distance: F32, nearest: float = NEAREST) -> F32:
    """Larger is better: o' can be carried there, does not stand in the paths' way there, and the region is near.

    hits: the share of paths that o' would block; distance: from o', in floor diagonals; nearest: what one of these is worth. What RPNet
    says about the moves that are needed then is left out: a region off the paths is one that shortens the plan, and with that chance
    as a factor the first region was worse by every measure on validation states (off the paths and reachable 86.7 % instead of 91.6,
    shortens the plan 91.7 instead of 93.7).
    """
    return np.asarray(feasible * np.clip(1 - hits, 0, 1) ** CAREFUL - nearest * distance)


def paper_cost(feasible: F32, hits: F32, distance: F32) -> F32:
    """RPNet's label: 1 where o' can't be put or stands in the way of the paths, elsewhere the distance in floor diagonals."""
    return np.where((feasible > 0.5) & (hits < BLOCKING_SHARE), distance, np.float32(1)).astype(np.float32)
