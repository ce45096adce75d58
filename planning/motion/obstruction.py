"""Which objects are in the way of taking hold of which: for every straight way to an object, the set of all that it would meet.

Whether an object can be picked is, but for RRT-Connect, a matter of pairs: a way (a grasp, an arm configuration for it, the straight pieces
before and after) is free when the arm, the hand and what it holds meet none of the other objects, and whether they meet one does not depend
on what else stands there. So each way is held against each object once, and from then on questions about any set of objects are questions
about sets. An object at a pose is a *spot*; a set of spots is an integer, a bit a spot, so that all states of a scene share what is known.

Ways are found lazily, and judged from cheap to dear: the hand alone on its way in, the arm at the grasp, the arm on its way in, and at last
the closing fingers and the lift. A way that is blocked at one stage is not looked at any further.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from heapq import heapify, heappop, heappush
from itertools import count

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Int
from kinematics.collision import edge_check
from kinematics.collision.geometry import Query, make_solids
from kinematics.collision.posed_geometry import PosedGeometry, join_posed
from kinematics.collision.robot_model import bare_geometry
from kinematics.scene import Grasp
from kinematics.transforms import Array, inverse
from planning.grasps import open_width
from planning.motion import reaching
from planning.motion.arm import FINGERS_AT, Arm
from planning.motion.contacts import WHOLE, Flags, clear_of, meet_along, meet_at, meet_hand
from planning.motion.edges import Task, make_task
from planning.motion.lazy_list import LazyList
from planning.motion.reaching import APPROACH_STEPS, LIFT_STEPS
from planning.motion.workcell import PlanningQuery, Workcell

GraspsOn = Callable[[str, Array], Iterable[Grasp]]
"""The grasps on an object at T_world_object (4, 4), by its name."""
IK_TRIES = 24
HAND, GRASP, WAY_IN, WHOLE_WAY = range(4)
"""The stages of a way."""


class Obstruction:
    """The ways to all objects of a scene, wherever they stand, and what blocks them.

    grasps_on: the grasps that are considered, those on the target, too. ik_tries: starts of inverse kinematics for each.
    """

    def __init__(self, cell: Workcell, grasps_on: GraspsOn, *, ik_tries: int = IK_TRIES) -> None:
        self.cell, self.grasps_on, self.ik_tries = cell, grasps_on, ik_tries
        self.queries = _Queries(cell)
        self._numbers: dict[tuple[str, bytes], int] = {}
        self._spots: list[tuple[str, Array]] = []
        self._ways: dict[int, LazyList[_Way]] = {}

    def at(self, poses: Mapping[str, Array], stage: int = WHOLE_WAY) -> View:
        """The obstructions of a state whose objects stand at poses. stage: how far ways are judged; leaving out the last saves time."""
        return View(self, {name: 1 << self._number(name, T) for name, T in poses.items()}, self.cell.scene.target_name, stage)

    def free(self, spot: int, present: int, stage: int) -> bool:
        """Whether some way to the object at a spot meets none of the spots `present`, judged up to a stage."""
        return any(True for _ in _free_ways(self._ways_to(spot), present, stage))

    def blockers(self, spot: int, present: int, stage: int) -> list[int]:
        """What of `present` blocks each way to the object at a spot: the smallest sets, none of which contains another."""
        ticket, found = count(), list[int]()
        queue = [(way.blockers(present).bit_count(), next(ticket), way) for way in self._ways_to(spot)]
        heapify(queue)
        while queue:
            *_, way = heappop(queue)
            blockers = way.blockers(present)
            if any(not smaller & ~blockers for smaller in found):
                continue
            if way.stage == stage:
                found.append(blockers)
                continue
            for part in way.parts():
                heappush(queue, (part.blockers(present).bit_count(), next(ticket), part))
        return found

    def first_ways(self, spot: int, present: int, enough: int, enough_grasps: int) -> list[FreeWay]:
        """Whole ways to the object at a spot that nothing of `present` blocks, those by the most natural grasps first: so many will do, and
        after so many grasps any that was found."""
        found = list[FreeWay]()
        for way in self._ways_to(spot):
            if found and (len(found) >= enough or way.number >= enough_grasps):
                break
            found += (free.found for free in _free_ways([way], present, WHOLE_WAY) if free.found is not None)
        return found

    def free_ways(self, spot: int, present: int) -> Iterator[FreeWay]:
        """All whole ways to the object at a spot that nothing of `present` blocks, each when it is asked for."""
        return (way.found for way in _free_ways(self._ways_to(spot), present, WHOLE_WAY) if way.found is not None)

    def clear_of(self, way: FreeWay, name: str, T: Array) -> NDArray[np.bool_]:
        """Whether a way to another object is clear of this one at each of poses T (R, 4, 4): (R,)."""
        clear = np.empty(len(T), np.bool_)
        self.queries.move(way, name, T, clear)
        self.cell.forget()
        return clear

    def members(self, spots: int) -> list[tuple[int, str, Array]]:
        """The spots of a set: each as a set of its own, whose it is, and T_world_object (4, 4)."""
        found = []
        while spots:
            spot = spots & -spots
            found.append((spot, *self._spots[spot.bit_length() - 1]))
            spots ^= spot
        return found

    def _number(self, name: str, T: Array) -> int:
        key = (name, T.tobytes())
        if key not in self._numbers:
            self._numbers[key] = len(self._spots)
            self._spots.append((name, T))
        return self._numbers[key]

    def _ways_to(self, spot: int) -> LazyList[_Way]:
        if spot not in self._ways:
            _, name, T = self.members(spot)[0]
            self._ways[spot] = LazyList(_Reach(self, name, T).ways())
        return self._ways[spot]


@dataclass(frozen=True, eq=False)
class View:
    """The obstructions of one state, by the objects' names (planning.relaxed_plan.Obstructions)."""

    ways: Obstruction
    spots: Mapping[str, int]
    target: str
    stage: int = WHOLE_WAY

    def free(self, name: str, standing: frozenset[str]) -> bool:
        return self.ways.free(self.spots[name], self._present(name, standing), self.stage)

    def blockers(self, name: str, standing: frozenset[str]) -> list[frozenset[str]]:
        """A way that the target blocks is none, for it never goes before its turn."""
        found = self.ways.blockers(self.spots[name], self._present(name, standing), self.stage)
        sets = (frozenset(other for _, other, _ in self.ways.members(spots)) for spots in found)
        return [names for names in sets if self.target not in names]

    def first_ways(self, name: str, standing: frozenset[str], enough: int, enough_grasps: int) -> list[FreeWay]:
        """See `Obstruction.first_ways`; the target stands, too."""
        return self.ways.first_ways(self.spots[name], self._present(name, standing), enough, enough_grasps)

    def free_ways(self, name: str, standing: frozenset[str]) -> Iterator[FreeWay]:
        """All whole ways to an object while only `standing`, itself and the target stand."""
        return self.ways.free_ways(self.spots[name], self._present(name, standing))

    def clear_of(self, way: FreeWay, name: str, T: Array) -> NDArray[np.bool_]:
        """Whether a way to another object is clear of this one at each of poses T (R, 4, 4): (R,)."""
        return self.ways.clear_of(way, name, T)

    def _present(self, name: str, standing: frozenset[str]) -> int:
        return sum(self.spots[other] for other in {*standing, self.target} - {name})


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
    problems: tuple[edge_check.Problem, edge_check.Problem, edge_check.Problem]


@dataclass(eq=False)
class _Way:
    """A way as far as it was looked at. met: the spots that are known to block it; known: those that were held against it.

    test: which of some spots block it at this stage. split: the ways of the next stage. number: of its grasp, in the order in which they
    come. found: a whole way's waypoints.
    """

    stage: int
    test: Callable[[int], int]
    split: Callable[[], Iterator[_Way]]
    number: int = 0
    found: FreeWay | None = None
    met: int = 0
    known: int = 0
    _parts: list[_Way] | None = None

    def blockers(self, present: int) -> int:
        if missing := present & ~self.known:
            self.met |= self.test(missing)
            self.known |= missing
        return self.met & present

    def parts(self) -> list[_Way]:
        if self._parts is None:
            self._parts = list(self.split())
            for part in self._parts:  # what blocks a way early blocks it for good
                part.met = part.known = self.met
        return self._parts


def _free_ways(ways: Iterable[_Way], present: int, stage: int) -> Iterator[_Way]:
    """The ways of a stage that nothing of `present` blocks, each when it is asked for."""
    for way in ways:
        if not way.blockers(present):
            if way.stage == stage:
                yield way
            else:
                yield from _free_ways(way.parts(), present, stage)


@dataclass(frozen=True, eq=False)
class _Grip:
    """A grasp, and the gripper's values before and after closing. alone: the open hand before the object alone; reach: among everything."""

    grasp: Grasp
    opened: float
    closed: float
    alone: PlanningQuery
    reach: edge_check.Problem


class _Reach:
    """The ways to one object at T (4, 4), and how they are tested."""

    def __init__(self, ways: Obstruction, name: str, T: Array) -> None:
        self.all, self.cell, self.queries, self.name, self.T = ways, ways.cell, ways.queries, name, T

    def ways(self) -> Iterator[_Way]:
        """The ways of the hand alone, for each grasp to which the walls and the object itself leave one."""
        cell, opening = self.cell, self.cell.robot.opening
        hands = dict[float, tuple[float, float, PlanningQuery]]()
        for number, asked in enumerate(self.all.grasps_on(self.name, self.T)):
            grasp = replace(asked, T_world_hand=opening.beside(asked.T_world_hand))
            width = round(grasp.width_m, 6)  # all round a cylinder it differs by rounding
            if width not in hands:
                opened = opening.value_at(open_width(width, opening))
                hands[width] = opened, opening.closing_value(width), cell.problem({self.name: self.T}, opened)
            opened, closed, alone = hands[width]
            code, _ = reaching.hand_way_in(cell.hand, alone.task, grasp.T_world_hand, cell.memory)
            cell.forget()
            if code == reaching.OK:
                yield self._hand(_Grip(grasp, opened, closed, alone, self.queries.reach(opened)), number)

    def _hand(self, grip: _Grip, number: int) -> _Way:
        cell = self.cell

        def test(flags: Flags) -> None:
            meet_hand(cell.hand, grip.reach, grip.grasp.T_world_hand, cell.memory.exact, flags)

        def split() -> Iterator[_Way]:
            return (self._at_grasp(grip, q) for q in cell.ik(grip.grasp.T_world_hand, tries=self.all.ik_tries))

        return _Way(HAND, self._asked(test), split, number)

    def _at_grasp(self, grip: _Grip, q: Array) -> _Way:
        memory = self.cell.memory
        return _Way(GRASP, self._asked(lambda flags: meet_at(grip.reach, q, memory.exact, flags)), lambda: self._way_in(grip, q))

    def _way_in(self, grip: _Grip, q: Array) -> Iterator[_Way]:
        """The straight way to the grasp, if the arm can follow it and the walls leave it free."""
        cell, T_hand = self.cell, grip.grasp.T_world_hand
        found, said = np.empty((1, APPROACH_STEPS + 1, len(q))), np.empty((1, 2), np.int64)
        if reaching.ways_in(cell.hand, grip.alone.task, T_hand, q[None], cell.memory, found, said):

            def test(flags: Flags) -> None:
                meet_along(grip.reach, found[0], WHOLE, self.queries.open, cell.memory.exact, flags)

            yield _Way(WAY_IN, self._asked(test), lambda: self._whole_way(grip, found[0]))
        cell.forget()

    def _whole_way(self, grip: _Grip, approach: Array) -> Iterator[_Way]:
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
            meet_at(closing, q, scratch, flags)
            meet_along(lifting, up, WHOLE, queries.open, scratch, flags)

        walls = queries.ask_walls()
        hold(walls)
        if not queries.met_walls(walls):
            way = FreeWay(grip.grasp, grip.opened, grip.closed, approach, up, (grip.reach, closing, lifting))
            yield _Way(WHOLE_WAY, self._asked(hold), lambda: iter(()), found=way)

    def _asked(self, test: Callable[[Flags], None]) -> Callable[[int], int]:
        """Ask a test about spots."""

        def ask(spots: int) -> int:
            flags = self.queries.ask(spots, self.all.members)
            test(flags)
            self.cell.forget()
            return self.queries.met(spots, flags)

        return ask


class _Queries:
    """What the hand can meet, packed once for the compiled core: the walls and all objects, which are moved to where they are asked about.

    Each question has flags (B + 1,) for the solids and the arm itself (see planning.motion.contacts).
    """

    def __init__(self, cell: Workcell) -> None:
        self.cell, self.arm = cell, cell.arm
        stock, names = cell.stock
        self.solids = stock._replace(T=stock.T.copy())
        self._rows = {name: [i for i, n in enumerate(names) if n == name] for name in names}
        self._walls = [i for body in cell.walls for i in self._rows[body.name]]
        self._memo: dict[tuple[object, ...], edge_check.Problem] = {}
        self._asked: dict[
            int, tuple[Flags, bytes, list[tuple[int, list[int], Array]]]
        ] = {}  # by spots: whose flags are 0; what stands where
        self._placed = 0  # the spots that were asked about last
        n = len(self.arm.links) + max(*map(len, self._rows.values()), len(FINGERS_AT) * len(self.arm.fingers)) + len(names)
        self.open: Flags = np.zeros((n, n), np.uint8)
        self.nothing = _nothing(self.arm)

    def ask(self, spots: int, members: Callable[[int], list[tuple[int, str, Array]]]) -> Flags:
        """Flags of a question about some spots, whose objects are put there."""
        if spots not in self._asked:
            found = members(spots)
            flags = np.ones(len(self.solids.T) + 1, np.uint8)
            rows = [self._rows[name] for _, name, _ in found]
            flags[[i for at in rows for i in at]] = 0
            self._asked[spots] = flags, flags.tobytes(), [(spot, at, T) for (spot, _, T), at in zip(found, rows)]
        flags, _, placed = self._asked[spots]
        if spots != self._placed:
            for _, at, T in placed:
                self.solids.T[at] = T
            self._placed = spots
        return flags.copy()

    def met(self, spots: int, flags: Flags) -> int:
        """The spots that were met."""
        _, before, placed = self._asked[spots]
        if flags.tobytes() == before:
            return 0
        return sum(spot for spot, rows, _ in placed if any(flags[i] for i in rows))

    def move(self, way: FreeWay, name: str, T: Array, clear: NDArray[np.bool_]) -> None:
        """See `contacts.clear_of`."""
        rows, met = self._rows[name], np.empty(len(self.solids.T) + 1, np.uint8)
        scratch = self.cell.memory.exact
        clear_of(*way.problems, way.approach, way.lift, rows[0], rows[-1] + 1, T, WHOLE, self.open, scratch, met, clear)
        self._placed = 0

    def ask_walls(self) -> Flags:
        """Flags of a question about the walls, and about the arm and what it holds among themselves."""
        flags = np.ones(len(self.solids.T) + 1, np.uint8)
        flags[self._walls] = flags[-1] = 0
        return flags

    def met_walls(self, flags: Flags) -> bool:
        return bool(flags[self._walls].any() or flags[-1])

    def reach(self, opened: float) -> edge_check.Problem:
        """The empty hand, fingers at a gripper value, among everything."""
        return self._made(("reach", opened), lambda: self._pose(self.arm.posed(opened), self.arm.self_pairs))

    def closing(self, opened: float, closed: float) -> edge_check.Problem:
        """The fingers alone at several gripper values on their way."""

        def make() -> edge_check.Problem:
            posed, _, pairs, moving = self.arm.moving_fingers(opened, closed)
            return self._pose(posed, pairs, np.repeat(moving.astype(np.uint8)[:, None], len(self.solids.T), 1))

        return self._made(("closing", opened, closed), make)

    def lifting(self, name: str, closed: float, T_hand_body: Array) -> edge_check.Problem:
        """An object in the closed hand; it may touch the pads and the floor."""

        def make() -> edge_check.Problem:
            links = self.arm.links
            held_object = self.arm.in_hand(bare_geometry(self.cell.scene.body(name).shape), T_hand_body)
            posed, P = join_posed(self.arm.posed(closed), held_object), len(links)
            check = np.ones((len(posed.frame), len(self.solids.T)), np.uint8)
            check[P:, self._rows["floor"]] = 0
            others = [i for i, link in enumerate(links) if link not in self.cell.robot.pads]
            held = np.array([(h, i) for h in range(P, len(posed.frame)) for i in others], np.int64).reshape(-1, 2)
            return self._pose(posed, np.concatenate([self.arm.self_pairs, held]), check)

        return self._made(("lifting", name, closed, T_hand_body.tobytes()), make)

    def _pose(self, posed: PosedGeometry, pairs: Int, check: Flags | None = None) -> edge_check.Problem:
        check = np.ones((len(posed.frame), len(self.solids.T)), np.uint8) if check is None else check
        check[posed.frame == 0] = 0  # the base stands still
        return edge_check.pose(self.arm.chain, posed, self.solids, Query(check, pairs), edge_check.MARGIN_M)

    def _made(self, key: tuple[object, ...], make: Callable[[], edge_check.Problem]) -> edge_check.Problem:
        if key not in self._memo:
            self._memo[key] = make()
        return self._memo[key]


@lru_cache(maxsize=8)
def _nothing(arm: Arm) -> Task:
    """The empty hand in the empty world."""
    solids, _ = make_solids([])
    query = Query(np.zeros((len(arm.links), 0), np.uint8), np.zeros((0, 2), np.int64))
    hand = arm.posed(float(arm.robot.home[arm.robot.gripper_joint]))
    return make_task(edge_check.pose(arm.chain, hand, solids, query, edge_check.MARGIN_M))
