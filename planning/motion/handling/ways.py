"""The straight ways to an object: a grasp, an arm configuration for it, the approach, the closing fingers and the lift.

Ways are found lazily, and judged from cheap to costly: the hand alone on its way in, the arm at the grasp, the arm on its way in, at last
the closing fingers and the lift. A way that is blocked at one stage is not looked at any further.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from kinematics.chain import Int
from kinematics.collision.edge_problem import Problem
from kinematics.inverse import may_reach
from kinematics.scene import Grasp
from kinematics.transforms import Array, inverse
from planning.grasping.finger_grasps import open_width
from planning.motion.cell.queries import PlanningQuery
from planning.motion.cell.workcell import IkSearch, Workcell
from planning.motion.handling.contacts import WHOLE, Flags, meet_along, meet_at, meet_hand
from planning.motion.handling.spots import SpotQueries, WayProblems
from planning.motion.search import reaching
from planning.motion.search.reaching import APPROACH_STEPS, LIFT_STEPS

GraspsOn = Callable[[str, Array], Iterable[Grasp]]
"""The grasps on an object at T_world_object (4, 4), by its name."""
HAND, GRASP, WAY_IN, WHOLE_WAY = range(4)
"""The stages of a way."""


@dataclass(frozen=True, eq=False)
class FreeWay:
    """A whole way to an object that the walls and the object itself leave free. grasp: with the hand where it really is; opened, closed:
    the gripper's values; arm waypoints (n, A) of the approach and the lift; problems: what is asked about the approach, the fingers and
    the lift."""

    grasp: Grasp
    opened: float
    closed: float
    approach: Array
    lift: Array
    problems: WayProblems


@dataclass(eq=False, slots=True)
class Way:
    """A way as far as it was looked at. met: the spots that are known to block it; known: those that were held against it.

    test: which of some spots block it at this stage. split: the ways of the next stage. number: of its grasp, in the order in which they
    come. found: a whole way's waypoints.
    """

    stage: int
    test: Callable[[int], int]
    split: Callable[[], Iterator[Way]]
    number: int = 0
    found: FreeWay | None = None
    met: int = 0
    known: int = 0
    _parts: list[Way] | None = None

    def blockers(self, present: int) -> int:
        """Which spots of `present` block this way; each is asked about once."""
        if missing := present & ~self.known:
            self.met |= self.test(missing)
            self.known |= missing
        return self.met & present

    def parts(self) -> list[Way]:
        """The ways of the next stage that this one begins; found when asked for."""
        if self._parts is None:
            self._parts = list(self.split())
            for part in self._parts:  # what blocks a way early blocks it for good
                part.met = part.known = self.met
        return self._parts


def open_ways(ways: Iterable[Way], present: int, stage: int) -> Iterator[Way]:
    """The ways of a stage that nothing of `present` blocks, each when it is asked for."""
    for way in ways:
        if not way.blockers(present):
            if way.stage == stage:
                yield way
            else:
                yield from open_ways(way.parts(), present, stage)


@dataclass(frozen=True, eq=False)
class _Grip:
    """A grasp, and the gripper's values before and after closing. alone: the open hand before the object alone; reach: among everything."""

    grasp: Grasp
    opened: float
    closed: float
    alone: PlanningQuery
    reach: Problem


OpenHand = tuple[float, float, PlanningQuery]
"""The gripper's values before and after closing, and what the open hand may meet."""


def open_hand(cell: Workcell, width_m: float, poses: Mapping[str, Array]) -> OpenHand:
    """To close on something of a width, among objects at poses."""
    opening = cell.robot.opening
    opened = opening.value_at(open_width(width_m, opening))
    return opened, opening.closing_value(width_m), cell.problem(poses, opened)


def rounded_width(width_m: float) -> float:
    """All round a cylinder it differs by rounding."""
    return round(width_m, 6)


def approachable(cell: Workcell, grasps: Sequence[Grasp], poses: Mapping[str, Array], closer: Sequence[IkSearch]) -> list[Grasp]:
    """Those of some grasps that can be approached: walls and objects at poses, what is to be grasped among them, leave the open hand and
    the arm a way in. Judged as ways are one by one, but for many grasps of which hardly any can be. closer: how closely the arm's solutions
    are sought, where it was in vain more closely."""
    widths = np.array([rounded_width(grasp.width_m) for grasp in grasps])
    hands = np.array([cell.robot.opening.beside(grasp.T_world_hand) for grasp in grasps]).reshape(-1, 4, 4)
    near, free = may_reach(cell.arm.chain, cell.arm.T_frame_hand, cell.arm.seeds, hands), np.zeros(len(grasps), np.bool_)
    for width in np.unique(widths[near]):
        of_width = np.flatnonzero(near & (widths == width))
        *_, hand_open = open_hand(cell, float(width), poses)
        by_hand = np.empty(len(of_width), np.bool_)
        reaching.hands_way_in(cell.hand, hand_open.task, hands[of_width], cell.memory, by_hand)
        for i in of_width[by_hand]:
            free[i] = any(len(ways_in(cell, hand_open, hands[i], cell.ik(hands[i], ik, kept=False))[0]) for ik in closer)
        cell.forget()
    return [grasp for grasp, may in zip(grasps, free) if may]


def ways_in(cell: Workcell, hand_open: PlanningQuery, T_hand: Array, solutions: Array) -> tuple[Array, Int]:
    """Waypoints (W, n, A) of the straight ways to a hand at T_hand (4, 4) that are free, of the arm's solutions (S, A); and how far each of
    these got, with the pair that touched (S, 2); see `reaching.ways_in`."""
    found, said = np.empty((len(solutions), APPROACH_STEPS + 1, solutions.shape[1])), np.empty((len(solutions), 2), np.int64)
    free = reaching.ways_in(cell.hand, hand_open.task, T_hand, solutions, cell.memory, found, said)
    return found[:free], said


class WaysToObject:
    """The ways to one object at T (4, 4), and how they are tested. ik: how closely the arm's solutions for each grasp are looked for."""

    def __init__(self, queries: SpotQueries, name: str, T: Array, grasps_on: GraspsOn, ik: IkSearch) -> None:
        self.queries, self.cell, self.name, self.T = queries, queries.cell, name, T
        self.grasps_on, self.ik = grasps_on, ik

    def ways(self) -> Iterator[Way]:
        """The ways of the hand alone, for each grasp to which the walls and the object itself leave one."""
        cell, opening = self.cell, self.cell.robot.opening
        hands = dict[float, OpenHand]()
        for number, asked in enumerate(self.grasps_on(self.name, self.T)):
            T_hand = opening.beside(asked.T_world_hand)
            grasp = asked if T_hand is asked.T_world_hand else replace(asked, T_world_hand=T_hand)
            width = rounded_width(grasp.width_m)
            if width not in hands:
                hands[width] = open_hand(cell, width, {self.name: self.T})
            opened, closed, alone = hands[width]
            code, _ = reaching.hand_way_in(cell.hand, alone.task, grasp.T_world_hand, cell.memory)
            cell.forget()
            if code == reaching.OK:
                yield self._hand(_Grip(grasp, opened, closed, alone, self.queries.reach(opened)), number)

    def _hand(self, grip: _Grip, number: int) -> Way:
        cell = self.cell

        def test(flags: Flags) -> None:
            meet_hand(cell.hand, grip.reach, grip.grasp.T_world_hand, cell.memory.exact, flags)

        return Way(HAND, self._asked(test), lambda: self._at_grasp(grip), number)

    def _at_grasp(self, grip: _Grip) -> Iterator[Way]:
        """The arm's solutions for a grasp; what one of them is asked, all are asked at once, for they are asked about the same spots."""
        solutions, said = self.cell.ik(grip.grasp.T_world_hand, self.ik), dict[int, list[int]]()

        def test(spots: int, i: int) -> int:
            if spots not in said:
                flags = self.queries.ask(spots)[None].repeat(len(solutions), 0)
                meet_at(grip.reach, solutions, self.cell.memory.exact, flags)
                self.cell.forget()
                said[spots] = self.queries.met(spots, flags)
            return said[spots][i]

        return (Way(GRASP, partial(test, i=i), partial(self._way_in, grip, q)) for i, q in enumerate(solutions))

    def _way_in(self, grip: _Grip, q: Array) -> Iterator[Way]:
        """The straight way to the grasp, if the arm can follow it and the walls leave it free."""
        cell, T_hand = self.cell, grip.grasp.T_world_hand
        found, _ = ways_in(cell, grip.alone, T_hand, q[None])
        if len(found):

            def test(flags: Flags) -> None:
                meet_along(grip.reach, found[0], WHOLE, self.queries.open, cell.memory.exact, flags)

            yield Way(WAY_IN, self._asked(test), lambda: self._whole_way(grip, found[0]))
        cell.forget()

    def _whole_way(self, grip: _Grip, approach: Array) -> Iterator[Way]:
        """The same with the closing fingers and the lift, if the arm can follow and the walls leave them free."""
        cell, queries, T_hand, scratch, q = self.cell, self.queries, grip.grasp.T_world_hand, self.cell.memory.exact, approach[-1]
        up = np.empty((LIFT_STEPS + 1, len(q)))
        code, _ = reaching.lift(cell.hand, queries.nothing, T_hand, q, up, cell.memory)
        cell.forget()
        if code != reaching.OK:
            return
        closing = queries.closing(grip.opened, grip.closed)
        lifting = queries.lifting(self.name, grip.closed, inverse(T_hand) @ self.T)

        def hold(flags: Flags) -> None:
            meet_at(closing, approach[-1:], scratch, flags[None])
            meet_along(lifting, up, WHOLE, queries.open, scratch, flags)

        walls = queries.ask_walls()
        hold(walls)
        if not queries.met_walls(walls):
            way = FreeWay(grip.grasp, grip.opened, grip.closed, approach, up, (grip.reach, closing, lifting))
            yield Way(WHOLE_WAY, self._asked(hold), lambda: iter(()), found=way)

    def _asked(self, test: Callable[[Flags], None]) -> Callable[[int], int]:
        """Ask a test about spots."""

        def ask(spots: int) -> int:
            flags = self.queries.ask(spots)
            test(flags)
            self.cell.forget()
            return self.queries.met(spots, flags[None])[0]

        return ask
