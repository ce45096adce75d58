"""Labels that look ahead: how many moves a state is away from the target, which object goes first, and where it helps to put it.

The paper's labels look one step ahead: an object blocks paths or it does not. Here the shortest relaxed plans (planning.relaxed_plan) say
which objects must go, and in which order, if what is moved vanished.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Int
from kinematics.scene import State
from kinematics.transforms import Array
from planning.learning.labelling.label_file import NOT_ASKED, UNKNOWN
from planning.motion.handling.obstruction import View
from planning.motion.pick_place import Motions
from planning.relaxed_plan import Names, RelaxedPlan, relaxed_plans, shortest_plans

MOST_MOVES = 6
MOST_SETS = 1000
"""Longer relaxed plans are not looked for, nor any among more sets of objects: beyond, a state's horizon is unknown."""
MOST_WAYS = 16
"""A place that blocks so many ways to an object is taken to block all: of a hundred ways, the others leave 3 places of 1,000 free."""


@dataclass(frozen=True, eq=False)
class Horizon:
    """The shortest relaxed plans of a state; none where it is unknown, or where no picks help."""

    plans: Sequence[RelaxedPlan]

    @property
    def moves(self) -> int:
        """The length h of the plans, `UNKNOWN` without one."""
        return self.plans[0].length if self.plans else UNKNOWN

    @property
    def firsts(self) -> Names:
        """The objects that go first in some shortest plan."""
        return frozenset(name for plan in self.plans for name in plan.firsts)


def look_ahead(view: View) -> Horizon:
    """The shortest relaxed plans of a state, whose obstructions these are."""
    plans = relaxed_plans(view, view.target, frozenset(view.spots) - {view.target}, most=MOST_MOVES, most_sets=MOST_SETS)
    return Horizon(shortest_plans(plans))


def shortens(motions: Motions, state: State, view: View, horizon: Horizon, name: str, regions: Sequence[int] | Int) -> Mapping[int, int]:
    """For each of some regions whether h gets shorter once an object stands there (1 or 0); `NOT_ASKED` without a plan to shorten.

    It does where one of the shortest plans in which the object goes first is a plan of the others from there. No other plan could be
    shorter: with the object it would be a shortest one from here, and all of these are known.
    """
    regions = [int(region) for region in regions]
    if horizon.moves < 1:
        return dict.fromkeys(regions, NOT_ASKED)
    poses = state.poses
    there = motions.place_poses(name, poses[name], regions)
    beside, shorter = _Beside(view, name, there), np.zeros(len(regions), np.bool_)
    for plan in horizon.plans:
        if name in plan.firsts and not shorter.all():
            goners = tuple(other for other in plan.order if other != name)
            shorter |= beside.emptied(goners, frozenset(poses) - {name, view.target}, ~shorter)
    return dict(zip(regions, shorter.astype(int).tolist()))


class _Beside:
    """What can still be picked once an object stands at one of poses (R, 4, 4): all poses at once."""

    def __init__(self, view: View, name: str, poses: Array) -> None:
        self.view, self.name, self.poses = view, name, poses
        self._known: dict[tuple[str, Names], tuple[NDArray[np.bool_], NDArray[np.bool_]]] = {}

    def emptied(self, goners: Sequence[str], rest: Names, at: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """At which of the poses `at` (R,) some objects of `rest` can go, in any order, and the target after them (R,). goners: in the
        likeliest order.

        What can go at a moment can still go later: so at each pose it is enough to try one order.
        """
        out = np.zeros(len(self.poses), np.bool_)
        if not goners:
            return self._free(self.view.target, rest, at)
        for i, other in enumerate(goners):
            if (free := self._free(other, rest - {other}, at)).any():
                out |= self.emptied((*goners[:i], *goners[i + 1 :]), rest - {other}, free)
                at = at & ~free
        return out

    def _free(self, other: str, rest: Names, at: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """At which of the poses `at` (R,) another object can be picked while `rest` stands, too (R,)."""
        nowhere = np.zeros(len(self.poses), np.bool_)
        free, asked = self._known.setdefault((other, rest), (nowhere, nowhere.copy()))
        new = at & ~asked
        if new.any():
            for way in islice(self.view.free_ways(other, rest), MOST_WAYS):
                left = np.flatnonzero(new & ~free)
                if not len(left):
                    break
                free[left] = self.view.clear_of(way, self.name, self.poses[left])
            asked |= new
        return at & free
