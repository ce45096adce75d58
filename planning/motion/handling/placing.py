"""Putting a held object down: where it may stand, the arm's solutions, straight ways down and back, all but RRT-Connect."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from kinematics.chain import Int
from kinematics.transforms import Array, inverse
from planning.motion.cell import queries
from planning.motion.cell.queries import ContactQuery, PlanningQuery
from planning.motion.cell.workcell import IkSearch, Workcell
from planning.motion.handling.picking import Pick
from planning.motion.handling.turns import whole_turns
from planning.motion.search import reaching
from planning.motion.search.reaching import APPROACH_STEPS, LIFT_STEPS
from planning.plan import Blocked

TRIES = 12  # starts of inverse kinematics where an object is put down
BRIEF_DOWN, BRIEF_BACK = 1, 2  # pieces of the straight ways down and back where only labels depend on the answer
SETTLING, SETTLED = 4, 1e-7
"""An object's middle moves as it turns, so an arm of few joints is asked again, until it turns by less than that."""
STAGES = {
    reaching.REACH: "ik", reaching.REGION: "region", reaching.LIFTED: "lower", reaching.AT_GRASP: "lower", reaching.UPWARDS: "lower",
    reaching.FINGERS: "release", reaching.BACKWARDS: "retreat",
}  # fmt: skip
"""What the compiled core's codes are called in a plan."""


@dataclass(frozen=True, eq=False)
class Place:
    """A way to put a held object down: arm waypoints of the straight pieces and the object's pose afterwards."""

    lower: Array
    retreat: Array
    T_world_object: Array

    def turned(self, lower: Array, upper: Array) -> list[Place]:
        """This place, and the same with joints whole turns further where limits (A,) allow that."""
        _, *turns = whole_turns(np.concatenate([self.lower, self.retreat]), lower, upper)
        return [self, *(replace(self, lower=self.lower + by, retreat=self.retreat + by) for by in turns)]


@dataclass(frozen=True, eq=False)
class ReleaseQuery:
    """The hand once an object stands: the queries while it opens and when it is open, and the object among the others. It is the same
    for all picks with the same gripper values."""

    opening: ContactQuery
    open: PlanningQuery
    standing: reaching.PlacementQuery
    among: ContactQuery


class Placing:
    """A held object that is put down, anywhere: for the compiled core, with the names behind its indices."""

    def __init__(self, cell: Workcell, pick: Pick, T_world_object: Array, release_query: ReleaseQuery) -> None:
        """T_world_object (4, 4): where the object was picked."""
        self.cell, self.pick, self.R, self.release_query = cell, pick, T_world_object[:3, :3], release_query
        self._let_go = cell.robot.opening.let_go(pick.held.T_hand_body)
        rows = release_query.open.solids_of(pick.held.body)
        tasks = pick.lifting.task, release_query.opening.problem, release_query.open.task
        self._compiled = reaching.PutDown(*tasks, rows[0], rows[-1] + 1, release_query.standing, self._let_go)

    def place(self, centre: Array) -> Place | Blocked:
        """Put the object down over `centre` (3,), turned as suits the hand: static checks and the straight pieces.

        The arm should turn no more than it must: first the solutions near the pick's are tried, for every turn of the hand, then all.
        """
        cell, p, near = self.cell, self._compiled, self.pick.lift[-1]
        natural, (lower, retreat, T) = float(self._natural_turns(centre)), self._waypoints()

        def down(turns: Array, starts: Array) -> tuple[int, int]:
            return reaching.put_down(cell.hand, p, self.R, natural, centre, turns, starts, cell.memory, lower, retreat, T)

        code, pair = down(np.array(reaching.PLACE_TURNS), near[None])
        cell.forget()
        if code == reaching.OK:
            return Place(lower, retreat, T)
        if code != reaching.REGION:
            for turn in reaching.PLACE_TURNS:
                reaching.place_on_floor(p.standing.body.vertices, self.R, natural + turn, centre, T)
                if reaching.stands(p.standing, T, cell.memory) == reaching.FREE:
                    T_hand = T @ inverse(self._let_go)
                    got, touch = down(np.array([turn]), cell.ik(T_hand, IkSearch(TRIES), near=near))
                    if got == reaching.OK:
                        return Place(lower, retreat, T)
                    if got >= code:
                        code, pair = got, touch
        return queries.blocked(STAGES[code], self._seen_at(code), pair, self.pick.held.body)

    def at(self, T_world_object: Array, start: Array) -> Place | None:
        """Put the object down at T_world_object (4, 4) on the floor, by the solution of inverse kinematics that `start` (A,) leads to; None
        when that is not free."""
        p, R = self._compiled, np.ascontiguousarray(T_world_object[:3, :3])
        low, high = (R @ p.standing.body.vertices).min(1), (R @ p.standing.body.vertices).max(1)
        centre, (lower, retreat, T) = T_world_object[:3, 3] + np.append((low + high)[:2] / 2, low[2]), self._waypoints()
        code, _ = reaching.put_down(self.cell.hand, p, R, 0.0, centre, np.zeros(1), start[None], self.cell.memory, lower, retreat, T)
        self.cell.forget()
        return Place(lower, retreat, T_world_object) if code == reaching.OK else None

    def ends(self, centres: Array, near: Array) -> tuple[Int, Array]:
        """Over which of centres (N, 3) the object can be put down by solutions near those of `near` (S, A), looked at in longer pieces than
        `place` does: their indices (K,), and the arm's configurations where the ways down begin (K, A)."""
        natural, turns = self._natural_turns(centres), np.array(reaching.PLACE_TURNS)
        lower, retreat, T = self._waypoints(BRIEF_DOWN, BRIEF_BACK)
        ends, codes = np.empty((len(centres), near.shape[1])), np.empty(len(centres), np.int64)
        reaching.put_down_all(
            self.cell.hand, self._compiled, self.R, natural, centres, turns, near, self.cell.memory, lower, retreat, T, ends, codes
        )
        self.cell.forget()
        down = np.flatnonzero(codes == reaching.OK)
        return down, ends[down]

    def _waypoints(self, down: int = LIFT_STEPS, back: int = APPROACH_STEPS) -> tuple[Array, Array, Array]:
        """Room for the ways down and back, in so many pieces, and a pose."""
        A = self.pick.lift.shape[1]
        return np.empty((down + 1, A)), np.empty((back + 1, A)), np.empty((4, 4))

    def _natural_turns(self, centres: Array) -> Array:
        """How far an object turns with the hand to centres (..., 3): for a level grasp the hand comes in along the bearing of the place,
        else not at all; and with an arm of few joints, as that has to."""
        turns = self._bearings(centres)
        if not self.cell.arm.few_joints:
            return turns
        flat = np.atleast_1d(turns)
        for i, centre in enumerate(np.reshape(centres, (-1, 3))):
            flat[i] = self._headed(centre, float(flat[i]))
        return flat.reshape(turns.shape)

    def _headed(self, centre: Array, turn: float) -> float:
        """How far the object turns over a centre (3,), where an arm of few joints has to turn it; `turn` where it does not get there."""
        arm, near, T = self.cell.arm, self.pick.lift[-1], np.empty((4, 4))
        for _ in range(SETTLING):
            reaching.place_on_floor(self._compiled.standing.body.vertices, self.R, turn, centre, T)
            found = arm.headed(self._let_go, T, near, TRIES)
            if not len(found):
                break
            more, near = arm.turned(self._let_go, T, found[0]), found[0]
            turn += more
            if abs(more) < SETTLED:
                break
        return turn

    def _bearings(self, centres: Array) -> Array:
        """How far an object turns with a hand that comes in along the bearing of centres (..., 3)."""
        ahead = self.pick.grasp.T_world_hand[:3, 2]
        if np.hypot(ahead[0], ahead[1]) <= 0.3:
            return np.zeros(centres.shape[:-1])
        bearing = centres[..., :2] - self.cell.arm.pivot
        return np.asarray(np.arctan2(bearing[..., 1], bearing[..., 0]) - np.arctan2(ahead[1], ahead[0]))

    def _seen_at(self, code: int) -> PlanningQuery | ContactQuery:
        """The query of which `reaching.put_down` got to say a code."""
        match code:
            case reaching.AT_GRASP | reaching.BACKWARDS:
                return self.release_query.open
            case reaching.FINGERS:
                return self.release_query.opening
            case reaching.REGION:
                return self.release_query.among
        return self.pick.lifting
