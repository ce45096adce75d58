"""The ways to take hold of objects and to put them down in one state, each found once, so that the many regions of an object don't ask
twice: all of pick and place but RRT-Connect, and what RRT-Connect said about them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from kinematics.scene import Grasp, State
from kinematics.transforms import Array
from planning.motion.cell.workcell import Workcell
from planning.motion.handling import waiting
from planning.motion.handling.object_grasps import can_be_exhaustive
from planning.motion.handling.picking import Pick, Picking
from planning.motion.handling.placing import Placing, ReleaseQuery
from planning.motion.handling.room import Room
from planning.motion.lazy_list import LazyList
from planning.plan import Blocked


class StateWays:
    """Of one state. transits: from where the arm is to the picks that were gone for; reached: the same to those of each object that were
    sought together; failures: of carrying what a pick takes hold of."""

    def __init__(self, cell: Workcell, state: State) -> None:
        self.cell, self.state = cell, state
        self.transits: dict[Pick, Array | Blocked] = {}
        self.reached: dict[str, dict[Pick, Array]] = {}
        self.searches = Counter[str]()
        self.failures = Counter[Pick]()
        self._picks: dict[str, tuple[list[Pick], Blocked]] = {}
        self._wider: dict[str, list[Pick]] = {}
        self._turned: dict[Pick, list[Pick]] = {}
        self._placing: dict[Pick, Placing] = {}
        self._release_query: dict[tuple[str, float, float], ReleaseQuery] = {}
        self._way_out_ends: dict[Pick, Array] = {}
        self._outside: dict[tuple[str, bytes], Array] = {}

    def rest(self, name: str) -> dict[str, Array]:
        """The poses of the objects besides one."""
        return self.cell.without(self.state.poses, name)

    def picks(self, name: str, picking: Picking, grasps: Sequence[Grasp] | LazyList[Grasp] | None) -> tuple[list[Pick], Blocked]:
        """The ways to take hold of an object, with the grasps that are sampled on it or with others; and why there are no more: see
        `Motions.picks`."""
        if name not in self._picks:
            poses, rest, q = self.state.poses, self.rest(name), self.cell.robot.arm_q(self.state.q)
            if kept := self.cell.supports.kept(name, poses):
                self._picks[name] = [], kept
            elif grasps is None:
                self._picks[name] = picking.picks(poses, rest, name, q)
            elif isinstance(grasps, LazyList):
                self._picks[name] = picking.picks_among(grasps, poses, rest, name, q)
            else:
                self._picks[name] = picking.picks_with(grasps, poses, rest, name, q)
        return self._picks[name]

    def wider(self, name: str, picking: Picking, room: Room) -> Iterator[Pick]:
        """Some picks with room more, of grasps that are sampled more densely, where that is quickly done; found when the first is asked
        for."""
        if name not in self._wider:
            poses, q, cell = self.state.poses, self.cell.robot.arm_q(self.state.q), self.cell
            self._wider[name] = []
            if can_be_exhaustive(cell.robot, cell.scene) and not cell.arm.few_joints:
                self._wider[name] = picking.some(poses, self.rest(name), name, q, lambda pick: room.to_pick(poses, pick))
        yield from self._wider[name]

    def turned(self, pick: Pick) -> list[Pick]:
        """A pick, and where what it holds must stay upright, the same with joints whole turns further."""
        if not pick.carrying.task.upright.limited:
            return [pick]
        if pick not in self._turned:
            self._turned[pick] = pick.turned(self.cell.arm.chain.lower, self.cell.arm.chain.upper)
        return self._turned[pick]

    def way_out_ends(self, pick: Pick) -> Array:
        """Arm configurations (G, A) with all of what a pick takes hold of outside the cabinet: straight out of it where there is a way."""
        if pick not in self._way_out_ends:
            held, carrying = pick.held, pick.carrying
            near, key = waiting.pulled_out(self.cell, carrying, held, pick.lift[-1]), (held.body, held.T_hand_body.tobytes())
            if key not in self._outside:
                self._outside[key] = waiting.outside(self.cell, carrying, held)
            self._way_out_ends[pick] = np.concatenate([near, self._outside[key]])
        return self._way_out_ends[pick]

    def placing(self, pick: Pick) -> Placing:
        """The ways to put down what a pick takes hold of."""
        if pick not in self._placing:
            name, rest = pick.held.body, self.rest(pick.held.body)
            query = self._releasing(pick, rest)
            self._placing[pick] = Placing(self.cell, pick, self.state.poses[name], query)
        return self._placing[pick]

    def _releasing(self, pick: Pick, rest: Mapping[str, Array]) -> ReleaseQuery:
        name = pick.held.body
        key = (name, pick.gripper_open, pick.gripper_closed)
        if key not in self._release_query:
            standing = {**rest, name: self.state.poses[name]}
            opening = self.cell.moving_fingers(standing, name, pick.gripper_open, pick.gripper_closed)
            leaving = self.cell.problem(standing, pick.gripper_open)
            self._release_query[key] = ReleaseQuery(opening, leaving, *self.cell.standing(name, rest))
        return self._release_query[key]
