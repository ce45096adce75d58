"""Whether the straight ways of picking and placing keep clear: what is preferred near the ends of a way, at least, from everything."""

from __future__ import annotations

from collections.abc import Mapping
from weakref import WeakKeyDictionary

from kinematics.transforms import Array
from planning.motion.cell.queries import PlanningQuery
from planning.motion.cell.workcell import Workcell
from planning.motion.handling.carry import Carry
from planning.motion.handling.picking import Pick
from planning.motion.handling.placing import Place


class Room:
    """How much room there is around picks and places: questions that are asked once they hold up to all other tests."""

    def __init__(self, cell: Workcell) -> None:
        self.cell, self._ends_m = cell, cell.settings.clearance.ends_m
        self._known: WeakKeyDictionary[Pick | Place, bool] = WeakKeyDictionary()

    def to_pick(self, poses: Mapping[str, Array], pick: Pick) -> bool:
        """Whether approach and lift have room, among objects at the poses at which the pick was found; remembered."""
        if pick not in self._known:
            reaching = self.cell.problem(poses, pick.gripper_open)
            self._known[pick] = self._has(reaching, pick.approach) and self._has(pick.lifting, pick.lift)
        return self._known[pick]

    def to_place(self, rest: Mapping[str, Array], pick: Pick, place: Place) -> bool:
        """Whether lowering and retreat have room, among the other objects where they were as the place was found, rest; remembered."""
        if place not in self._known:
            leaving = self.cell.problem({**rest, pick.held.body: place.T_world_object}, pick.gripper_open)
            self._known[place] = self._has(pick.lifting, place.lower) and self._has(leaving, place.retreat)
        return self._known[place]

    def to_carry(self, rest: Mapping[str, Array], carry: Carry) -> bool:
        """Whether an object can be carried to its place, and be put down there, with room."""
        assert carry.place is not None
        return self._has(carry.pick.carrying, carry.across) and self.to_place(rest, carry.pick, carry.place)

    def _has(self, query: PlanningQuery, way: Array) -> bool:
        return self.cell.keeps(query, way, self._ends_m)
