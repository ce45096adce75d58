"""Objects at poses, and which of them the hand would meet. An object at a pose is a *spot*; a set of spots is an integer, a bit a spot."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import lru_cache, reduce
from operator import or_
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Int
from kinematics.collision import edge_problem
from kinematics.collision.edge_problem import MARGIN_M, Problem
from kinematics.collision.geometry import Query, make_solids
from kinematics.collision.posed_geometry import PosedGeometry, join_posed, without_covers
from kinematics.collision.robot_model import bare_geometry
from kinematics.transforms import Array
from planning.motion.cell.arm import FINGERS_AT, Arm
from planning.motion.cell.workcell import Workcell
from planning.motion.handling.contacts import WHOLE, Flags, clear_of
from planning.motion.search.edges import Task, make_task

WayProblems = tuple[Problem, Problem, Problem]
"""What is asked about a way's approach, its closing fingers and its lift."""


class _Asked(NamedTuple):
    """A question about some spots: flags that are 0 for their solids, which rows (S,) of solids go where (S, 4, 4), and the spot of each of
    these rows."""

    flags: Flags
    rows: Int
    T: Array
    spots: list[int]


class Spots:
    """All spots that were asked about, in the order in which they came."""

    def __init__(self) -> None:
        self._numbers: dict[tuple[str, bytes], int] = {}
        self._spots: list[tuple[str, Array]] = []

    def at(self, name: str, T: Array) -> int:
        """The spot of an object standing at T_world_object (4, 4): a set of its own."""
        key = (name, T.tobytes())
        if key not in self._numbers:
            self._numbers[key] = len(self._spots)
            self._spots.append((name, T))
        return 1 << self._numbers[key]

    def members(self, spots: int) -> list[tuple[int, str, Array]]:
        """The spots of a set: each as a set of its own, whose it is, and T_world_object (4, 4)."""
        found = []
        while spots:
            spot = spots & -spots
            found.append((spot, *self._spots[spot.bit_length() - 1]))
            spots ^= spot
        return found


class SpotQueries:
    """What the hand can meet, packed once for the compiled core: the walls and all objects, which are moved to where they are asked about.

    Each question has flags (B + 1,) for the solids and the arm itself (see planning.motion.handling.contacts). fingers: whether it is asked
    what they meet on their way, too.
    """

    def __init__(self, cell: Workcell, spots: Spots, *, fingers: bool = True) -> None:
        self.cell, self.arm, self._spots, self.fingers = cell, cell.arm, spots, fingers
        stock, names = cell.stock
        self.solids = stock._replace(T=stock.T.copy())
        self._rows = {name: [i for i, n in enumerate(names) if n == name] for name in names}
        self._walls = [i for body in cell.walls for i in self._rows[body.name]]
        self._memo: dict[tuple[object, ...], Problem] = {}
        self._asked: dict[int, _Asked] = {}  # by spots
        self._placed = 0  # the spots that were asked about last
        n = len(self.arm.links) + max(*map(len, self._rows.values()), len(FINGERS_AT) * len(self.arm.fingers)) + len(names)
        self.open: Flags = np.zeros((n, n), np.uint8)
        self.nothing = _nothing(self.arm)

    def ask(self, spots: int) -> Flags:
        """Flags of a question about some spots, whose objects are put there."""
        if spots not in self._asked:
            found = [(i, T, spot) for spot, name, T in self._spots.members(spots) for i in self._rows[name]]
            rows, poses, spot_of = ([*column] for column in zip(*found))
            flags = np.ones(len(self.solids.T) + 1, np.uint8)
            flags[rows] = 0
            self._asked[spots] = _Asked(flags, np.array(rows, np.int64), np.array(poses), spot_of)
        asked = self._asked[spots]
        if spots != self._placed:
            self.solids.T[asked.rows] = asked.T
            self._placed = spots
        return asked.flags.copy()

    def met(self, spots: int, flags: Flags) -> list[int]:
        """For each of the answers (N, B + 1) to a question about some spots, those that were met."""
        asked, S = self._asked[spots], len(self._asked[spots].rows)
        touched = flags.take(asked.rows, 1).tobytes()  # a byte a flag
        if 1 not in touched:
            return [0] * len(flags)
        return [_together(spot for spot, hit in zip(asked.spots, touched[i : i + S]) if hit) for i in range(0, len(touched), S)]

    def clear_of(self, problems: WayProblems, approach: Array, lift: Array, name: str, T: Array) -> NDArray[np.bool_]:
        """Whether a way is clear of an object at each of poses T (R, 4, 4): (R,). See `contacts.clear_of`."""
        rows, met, clear = self._rows[name], np.empty(len(self.solids.T) + 1, np.uint8), np.empty(len(T), np.bool_)
        scratch = self.cell.memory.exact
        clear_of(*problems, approach, lift, rows[0], rows[-1] + 1, T, WHOLE, self.open, scratch, met, clear)
        self._placed = 0
        self.cell.forget()
        return clear

    def ask_walls(self) -> Flags:
        """Flags of a question about the walls, and about the arm and what it holds among themselves."""
        flags = np.ones(len(self.solids.T) + 1, np.uint8)
        flags[self._walls] = flags[-1] = 0
        return flags

    def met_walls(self, flags: Flags) -> bool:
        """Whether the answer to `ask_walls` is that something was met."""
        return bool(flags[self._walls].any() or flags[-1])

    def reach(self, opened: float) -> Problem:
        """The empty hand, fingers at a gripper value, among everything."""
        return self._made(("reach", opened), lambda: self._pose(self.arm.posed(opened), self.arm.self_pairs))

    def closing(self, opened: float, closed: float) -> Problem:
        """The fingers alone at several gripper values on their way; nothing at all where that is not asked."""

        def make() -> Problem:
            if not self.fingers:
                reach = self.reach(opened)
                return edge_problem.some_pairs(reach, np.zeros(len(reach.pairs), np.bool_))
            posed, _, pairs, moving = self.arm.moving_fingers(opened, closed)
            return self._pose(posed, pairs, np.repeat(moving.astype(np.uint8)[:, None], len(self.solids.T), 1))

        return self._made(("closing", opened, closed if self.fingers else None), make)

    def lifting(self, name: str, closed: float, T_hand_body: Array) -> Problem:
        """An object in the closed hand; it may touch the pads and the floor."""

        def make() -> Problem:
            posed = without_covers(self.arm.posed(closed))
            held = self.arm.in_hand(bare_geometry(self.cell.scene.body(name).shape), T_hand_body)
            alike = self._made(("held", name, closed), lambda: self._held(posed, held))  # but for where it sits in the hand
            return edge_problem.last_parts_elsewhere(alike, posed, held)

        return self._made(("lifting", name, closed, T_hand_body.tobytes()), make)

    def _held(self, arm: PosedGeometry, held: PosedGeometry) -> Problem:
        """An object in the closed hand."""
        posed, P = join_posed(arm, held), len(arm.frame)
        check = np.ones((len(posed.frame), len(self.solids.T)), np.uint8)
        check[P:, self._rows["floor"]] = 0
        others = [i for i, link in enumerate(self.arm.links) if link not in self.cell.robot.pads]
        own = np.array([(h, i) for h in range(P, len(posed.frame)) for i in others], np.int64).reshape(-1, 2)
        return self._pose(posed, np.concatenate([self.arm.self_pairs, own]), check)

    def _pose(self, posed: PosedGeometry, pairs: Int, check: Flags | None = None) -> Problem:
        check = np.ones((len(posed.frame), len(self.solids.T)), np.uint8) if check is None else check
        check[posed.frame == 0] = 0  # the base stands still
        return edge_problem.pose(self.arm.chain, posed, self.solids, Query(check, pairs), MARGIN_M)

    def _made(self, key: tuple[object, ...], make: Callable[[], Problem]) -> Problem:
        if key not in self._memo:
            self._memo[key] = make()
        return self._memo[key]


def _together(spots: Iterable[int]) -> int:
    """All of some spots as a set."""
    return reduce(or_, spots, 0)


@lru_cache(maxsize=8)
def _nothing(arm: Arm) -> Task:
    """The empty hand in the empty world."""
    solids, _ = make_solids([])
    query = Query(np.zeros((len(arm.links), 0), np.uint8), np.zeros((0, 2), np.int64))
    hand = arm.posed(float(arm.robot.home[arm.robot.gripper_joint]))
    return make_task(edge_problem.pose(arm.chain, hand, solids, query, MARGIN_M))
