"""Which objects are in the way of taking hold of which: for every straight way to an object, the set of all that it would meet.

Whether an object can be picked is, but for RRT-Connect, a matter of pairs: a way (a grasp, an arm configuration for it, the straight pieces
before and after) is free when the arm, the hand and what it holds meet none of the other objects, and whether they meet one does not depend
on what else stands there. So each way (`ways.py`) is held against each object once, and from then on questions about any set of objects are
questions about sets of spots (`spots.py`), which all states of a scene share. What rests on an object blocks all ways to it
(`planning.motion.cell.supports`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from heapq import heapify, heappop, heappush
from itertools import chain, count

import numpy as np
from numpy.typing import NDArray

from kinematics.scene import Grasp
from kinematics.transforms import Array
from planning.motion.cell.workcell import QUICK_IK, IkSearch, Workcell
from planning.motion.handling.spots import SpotQueries, Spots
from planning.motion.handling.ways import WHOLE_WAY, FreeWay, GraspsOn, Way, WaysToObject, open_ways
from planning.motion.lazy_list import LazyList


class Obstruction:
    """The ways to all objects of a scene, wherever they stand, and what blocks them.

    grasps_on: the grasps that are considered, those on the target, too. ik: how closely the arm's solutions for each are looked for.
    fingers: whether it is asked what they meet as they close.
    """

    def __init__(self, cell: Workcell, grasps_on: GraspsOn, *, ik: IkSearch = QUICK_IK, fingers: bool = True) -> None:
        self.cell, self.grasps_on, self.ik = cell, grasps_on, ik
        self.spots = Spots()
        self.queries = SpotQueries(cell, self.spots, fingers=fingers)
        self._ways: dict[int, LazyList[Way]] = {}

    def with_more(self, poses: Mapping[str, Array], hands: Mapping[str, Sequence[Grasp]], ik: IkSearch) -> Obstruction:
        """The same with more grasps of objects that stand at poses, numbered like the others; what is known of those is kept. ik: how
        closely the arm's solutions for these are looked for."""
        other = copy(self)
        other._ways = dict(self._ways)
        for name, more in hands.items():
            spot, T = self.spots.at(name, poses[name]), poses[name]
            ways = WaysToObject(self.queries, name, T, lambda *_, more=more: more, ik).ways()
            other._ways[spot] = LazyList(chain(ways, self._ways_to(spot)))
        return other

    def at(self, poses: Mapping[str, Array], stage: int = WHOLE_WAY) -> View:
        """The obstructions of a state whose objects stand at poses. stage: how far ways are judged; leaving out the last saves time."""
        spots = {name: self.spots.at(name, T) for name, T in poses.items()}
        return View(self, spots, self.cell.scene.target_name, stage, self.cell.supports.waiting(poses))

    def free(self, spot: int, present: int, stage: int) -> bool:
        """Whether some way to the object at a spot meets none of the spots `present`, judged up to a stage."""
        return any(True for _ in open_ways(self._ways_to(spot), present, stage))

    def blockers(self, spot: int, present: int, stage: int, always: int = 0) -> list[int]:
        """What of `present` blocks each way to the object at a spot, `always` among it: the smallest sets, none containing another."""
        ticket, found = count(), list[int]()
        queue = [((way.blockers(present) | always).bit_count(), next(ticket), way) for way in self._ways_to(spot)]
        heapify(queue)
        while queue:
            *_, way = heappop(queue)
            blockers = way.blockers(present) | always
            if any(not smaller & ~blockers for smaller in found):
                continue
            if way.stage == stage:
                found.append(blockers)
                continue
            for part in way.parts():
                heappush(queue, ((part.blockers(present) | always).bit_count(), next(ticket), part))
        return found

    def first_ways(self, spot: int, present: int, enough: int, enough_grasps: int) -> list[FreeWay]:
        """Whole ways to the object at a spot that nothing of `present` blocks, those by the most natural grasps first: so many will do, and
        after so many grasps any that was found."""
        found = list[FreeWay]()
        for way in self._ways_to(spot):
            if found and (len(found) >= enough or way.number >= enough_grasps):
                break
            found += (free.found for free in open_ways([way], present, WHOLE_WAY) if free.found is not None)
        return found

    def free_ways(self, spot: int, present: int) -> Iterator[FreeWay]:
        """All whole ways to the object at a spot that nothing of `present` blocks, each when it is asked for."""
        return (way.found for way in open_ways(self._ways_to(spot), present, WHOLE_WAY) if way.found is not None)

    def open_grasps(self, spot: int, present: int) -> Iterator[int]:
        """The numbers of the grasps by which a whole way leads to the object at a spot that nothing of `present` blocks."""
        return (way.number for way in self._ways_to(spot) if any(True for _ in open_ways([way], present, WHOLE_WAY)))

    def clear_of(self, way: FreeWay, name: str, T: Array) -> NDArray[np.bool_]:
        """Whether a way to another object is clear of this one at each of poses T (R, 4, 4): (R,)."""
        return self.queries.clear_of(way.problems, way.approach, way.lift, name, T)

    def _ways_to(self, spot: int) -> LazyList[Way]:
        if spot not in self._ways:
            _, name, T = self.spots.members(spot)[0]
            self._ways[spot] = LazyList(WaysToObject(self.queries, name, T, self.grasps_on, self.ik).ways())
        return self._ways[spot]


@dataclass(frozen=True, eq=False)
class View:
    """The obstructions of one state, by the objects' names (planning.relaxed_plan.Obstructions). waiting: those that have to go before an
    object, whatever way leads to it (`planning.motion.cell.supports.Supports.waiting`)."""

    ways: Obstruction
    spots: Mapping[str, int]
    target: str
    stage: int
    waiting: Mapping[str, frozenset[str]]

    def free(self, name: str, standing: frozenset[str]) -> bool:
        """Whether an object can be picked while only `standing`, itself and the target stand."""
        return not self._waits(name, standing) and self.ways.free(self.spots[name], self._present(name, standing), self.stage)

    def blockers(self, name: str, standing: frozenset[str]) -> list[frozenset[str]]:
        """A way that the target blocks is none, for it never goes before its turn."""
        waits = self._waits(name, standing)
        if self.target in waits:
            return []
        always = sum(self.spots[other] for other in waits)
        found = self.ways.blockers(self.spots[name], self._present(name, standing), self.stage, always)
        sets = (frozenset(other for _, other, _ in self.ways.spots.members(spots)) for spots in found)
        return [names for names in sets if self.target not in names]

    def first_ways(self, name: str, standing: frozenset[str], enough: int, enough_grasps: int) -> list[FreeWay]:
        """See `Obstruction.first_ways`; the target stands, too."""
        if self._waits(name, standing):
            return []
        return self.ways.first_ways(self.spots[name], self._present(name, standing), enough, enough_grasps)

    def free_ways(self, name: str, standing: frozenset[str]) -> Iterator[FreeWay]:
        """All whole ways to an object while only `standing`, itself and the target stand."""
        return iter(()) if self._waits(name, standing) else self.ways.free_ways(self.spots[name], self._present(name, standing))

    def open_grasps(self, name: str, standing: frozenset[str]) -> Iterator[int]:
        """The numbers of the grasps by which an object can be picked while only `standing`, itself and the target stand."""
        return self.ways.open_grasps(self.spots[name], self._present(name, standing))

    def clear_of(self, way: FreeWay, name: str, T: Array) -> NDArray[np.bool_]:
        """Whether a way to another object is clear of this one at each of poses T (R, 4, 4): (R,)."""
        return self.ways.clear_of(way, name, T)

    def _waits(self, name: str, standing: frozenset[str]) -> frozenset[str]:
        """Those of `standing` and the target that have to go before an object, whatever way leads to it."""
        return self.waiting[name] & {*standing, self.target} if name in self.waiting else frozenset()

    def _present(self, name: str, standing: frozenset[str]) -> int:
        return sum(self.spots[other] for other in {*standing, self.target} - {name})
