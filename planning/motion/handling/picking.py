"""Taking hold of an object where it stands: grasps, the arm's solutions for them, straight ways in and up, all but RRT-Connect."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, islice

import numpy as np

from kinematics.scene import Grasp, Held
from kinematics.transforms import Array, inverse
from planning.grasping.sampling import DENSE, DENSEST, USUAL, Sampling
from planning.motion.cell import queries
from planning.motion.cell.arm import Arm
from planning.motion.cell.queries import ContactQuery, PlanningQuery
from planning.motion.cell.workcell import QUICK_IK, IkSearch, Workcell
from planning.motion.handling.object_grasps import sampled_grasps
from planning.motion.handling.turns import whole_turns
from planning.motion.handling.ways import open_hand, rounded_width, ways_in
from planning.motion.lazy_list import LazyList
from planning.motion.search import reaching
from planning.motion.search.reaching import LIFT_STEPS
from planning.plan import Blocked

STAGES = {
    reaching.REACH: "ik", reaching.AT_GRASP: "approach", reaching.BACKWARDS: "approach", reaching.FINGERS: "grasp",
    reaching.LIFTED: "lift", reaching.UPWARDS: "lift",
}  # fmt: skip
"""What the compiled core's codes are called in a plan."""


MAX_TRIES = 3  # picks of an object, or of the target with one grasp, that are given to RRT-Connect


@dataclass(frozen=True)
class PickSettings:
    """How hard picks are sought. sampling: of grasps; ik: how closely the arm's solutions for each are looked for. enough_picks: so many
    ways that hold up are kept for one object; enough_grasps: after so many, the first in the most natural order, any that was found will
    do. tries: so many picks of an object are given to RRT-Connect before a move is given up. shuffled: whether grasps come in any order, so
    that those that are kept are unlike one another. together: before any place is sought for what is picked, a way is sought to all picks
    of an object together, in so many iterations; 0: a place is sought first, which is quicker where most are reached."""

    sampling: Sampling = USUAL
    ik: IkSearch = QUICK_IK
    enough_picks: int = 8
    enough_grasps: int = 24
    tries: int = MAX_TRIES
    shuffled: bool = False
    together: int = 0


QUICK = PickSettings()
THOROUGH = PickSettings(DENSE, IkSearch(96), enough_grasps=10**9)
"""Where the quick look finds no way: four times as many grasps, and all of them."""
EXHAUSTIVE = replace(THOROUGH, sampling=DENSEST)
"""Where a thorough look finds none, either."""
VARIED = replace(EXHAUSTIVE, enough_picks=400, tries=8, shuffled=True, together=100_000)
"""Where there are picks, and nothing can be done with the most natural ones: those are alike, and what stops one stops them all. In a low
cabinet most picks from above are where the arm does not get to, and to others only a narrow passage leads: what a search for each would
look for again and again, one for all finds in seconds, or does not."""
CLOSE_IK = IkSearch(1000, 0.05)
"""For proofs with a redundant arm: some dozen of its solutions for a hand are looked at."""
WIDER = replace(QUICK, sampling=DENSE, enough_picks=10**9, enough_grasps=10**9)
"""Where the picks of a quick look leave no room to anything."""
MOST_WIDER = 4
"""So many that leave some are enough."""


def ik_for_proofs(arm: Arm) -> IkSearch:
    """How closely an arm's solutions for a hand are looked for where it is to be proved that none will do."""
    return CLOSE_IK if arm.redundant else EXHAUSTIVE.ik


@dataclass(frozen=True, eq=False)
class Pick:
    """A way to take hold of an object: arm waypoints of the straight pieces, gripper values, and where the object sits in the hand.

    carrying: the object in the closed hand; lifting: the same while it may touch the floor.
    """

    grasp: Grasp
    approach: Array
    lift: Array
    gripper_open: float
    gripper_closed: float
    held: Held
    carrying: PlanningQuery
    lifting: PlanningQuery

    def turned(self, lower: Array, upper: Array) -> list[Pick]:
        """This pick, and the same with joints whole turns further where limits (A,) allow that."""
        _, *turns = whole_turns(np.concatenate([self.approach, self.lift]), lower, upper)
        rest = self.gripper_open, self.gripper_closed, self.held, self.carrying, self.lifting
        return [self, *(Pick(self.grasp, self.approach + by, self.lift + by, *rest) for by in turns)]


class Picking:
    """The picks of a scene's objects. The grasps on an object are remembered, for most objects stay where they are."""

    def __init__(self, cell: Workcell, settings: PickSettings = QUICK) -> None:
        self.cell, self.settings = cell, settings
        self._known: dict[tuple[str, bytes], _Grasps] = {}
        self._among: dict[LazyList[Grasp], _Grasps] = {}

    def with_more(self, poses: Mapping[str, Array], hands: Mapping[str, Sequence[Grasp]], ik: IkSearch) -> Picking:
        """The same with more grasps of objects that stand at poses, before all others. ik: how closely the arm's solutions for
        them are looked for."""
        other, usual = copy(self), self.settings.ik
        other._known = dict(self._known)
        for name, more in hands.items():
            other._known[name, poses[name].tobytes()] = _Grasps(self.cell, self.grasps(poses, name), usual, more, ik)
        return other

    def picks(self, poses: Mapping[str, Array], rest: Mapping[str, Array], name: str, q: Array) -> tuple[list[Pick], Blocked]:
        """The ways to take hold of an object that hold up to all checks but RRT-Connect's, those first that turn the arm least from q (A,);
        and how far the best of the others got.

        poses: of all objects; rest: of all besides this one.
        """
        return self._picks(self.grasps(poses, name), poses, rest, name, q)

    def picks_with(
        self, grasps: Sequence[Grasp], poses: Mapping[str, Array], rest: Mapping[str, Array], name: str, q: Array
    ) -> tuple[list[Pick], Blocked]:
        """As `picks`, with these grasps and no others; the best, which come first, are preferred to those that turn the arm less."""
        key = (name, b"".join(grasp.T_world_hand.tobytes() + np.float64(grasp.width_m).tobytes() for grasp in grasps))
        if key not in self._known:
            self._known[key] = _Grasps(self.cell, grasps, self.settings.ik)
        known = self._known[key]  # which may have been asked for before, as other objects that say the same
        picks, why = self._picks(known, poses, rest, name, q)
        ranks = {grasp: i for i, grasp in enumerate(known)}
        return sorted(picks, key=lambda pick: ranks[pick.grasp]), why

    def picks_among(
        self, grasps: LazyList[Grasp], poses: Mapping[str, Array], rest: Mapping[str, Array], name: str, q: Array
    ) -> tuple[list[Pick], Blocked]:
        """As `picks`, with grasps that are found when they are asked for."""
        if grasps not in self._among:
            self._among[grasps] = _Grasps(self.cell, grasps, self.settings.ik)
        return self._picks(self._among[grasps], poses, rest, name, q)

    def some(
        self, poses: Mapping[str, Array], rest: Mapping[str, Array], name: str, q: Array, will_do: Callable[[Pick], bool]
    ) -> list[Pick]:
        """As `picks`, but only a few that will do, those of the most natural grasps."""
        ways = self._one_by_one(self.grasps(poses, name), poses, rest, name, _Failures(name))
        return sorted(islice(filter(will_do, ways), MOST_WIDER), key=lambda p: float(np.abs(p.approach[0] - q).max()))

    def grasps(self, poses: Mapping[str, Array], name: str) -> _Grasps:
        """The grasps that are sampled on an object where it stands, the most natural first, or in any order, the same each time."""
        key = (name, poses[name].tobytes())
        if key not in self._known:
            grasps: Iterable[Grasp] = sampled_grasps(self.cell.robot, self.cell.scene, name, poses[name], sampling=self.settings.sampling)
            if self.settings.shuffled:
                natural = list(grasps)
                grasps = (natural[i] for i in np.random.default_rng(0).permutation(len(natural)))
            self._known[key] = _Grasps(self.cell, grasps, self.settings.ik)
        return self._known[key]

    def _picks(
        self, grasps: _Grasps, poses: Mapping[str, Array], rest: Mapping[str, Array], name: str, q: Array
    ) -> tuple[list[Pick], Blocked]:
        failures = _Failures(name)
        picks = list(self._one_by_one(grasps, poses, rest, name, failures))
        picks.sort(key=lambda p: float(np.abs(p.approach[0] - q).max()))
        return picks, failures.furthest

    def _one_by_one(
        self, grasps: _Grasps, poses: Mapping[str, Array], rest: Mapping[str, Array], name: str, failures: _Failures
    ) -> Iterator[Pick]:
        """The picks in the grasps' order, each when it is asked for."""
        cell, hands, found = self.cell, dict[float, _OpenHand](), 0
        for i, grasp in enumerate(grasps):
            width = rounded_width(grasp.width_m)
            hand = hands.get(width)
            if hand is None:
                hand = hands[width] = _OpenHand(cell, poses, name, width)
            T_hand = cell.robot.opening.beside(grasp.T_world_hand)
            ways = [way for way in self._ways_in(hand, T_hand, grasps, i, failures) if hand.closes(way[-1], failures)]
            if not ways:
                continue
            held = Held(name, cell.robot.opening.held(inverse(T_hand) @ poses[name]))
            carrying = cell.problem(rest, hand.closed, held=held)
            lifting = carrying.allowing(name, "floor")
            for way in ways:
                up = np.empty((LIFT_STEPS + 1, way.shape[1]))
                code, pair = reaching.lift(cell.hand, lifting.task, T_hand, way[-1], up, cell.memory)
                if code == reaching.OK:
                    found += 1
                    cell.forget()
                    yield Pick(grasp, way, up, hand.opened, hand.closed, held, carrying, lifting)
                else:
                    failures.note(code, lifting, pair)
            if found >= self.settings.enough_picks or (found and i + 1 >= self.settings.enough_grasps):
                break
        cell.forget()

    def _ways_in(self, hand: _OpenHand, T_hand: Array, grasps: _Grasps, i: int, failures: _Failures) -> Array:
        """Arm waypoints (W, n, A) of the straight ways of an open hand to grasp i, at T_hand (4, 4): the hand alone first, then the arm's
        solutions."""
        cell, task = self.cell, hand.reaching.task
        code, pair = reaching.hand_way_in(cell.hand, task, T_hand, cell.memory)
        if code != reaching.OK:
            failures.note(code, hand.reaching, pair)
            return np.empty((0, 0, 0))
        solutions = grasps.solutions(T_hand, i)
        if len(solutions) == 0:
            failures.out_of_reach()
        found, said = ways_in(cell, hand.reaching, T_hand, solutions)
        for code, pair in said:
            if code != reaching.OK:
                failures.note(code, hand.reaching, pair)
        return found


class _Failures:
    """How far the best of the ways that failed got; in words once somebody asks."""

    def __init__(self, name: str) -> None:
        self._name, self._got_to = name, 0
        self._last: tuple[str, PlanningQuery | ContactQuery, int] | None = None

    def out_of_reach(self) -> None:
        self._got_to = max(self._got_to, 1)

    def note(self, code: int, query: PlanningQuery | ContactQuery, pair: int) -> None:
        """One got as far as a code of `reaching`, where a pair of the query touched."""
        if 1 + code >= self._got_to:
            self._last, self._got_to = (STAGES[code], query, pair), 1 + code

    @property
    def furthest(self) -> Blocked:
        """What blocked the last of those that got furthest."""
        if self._last is not None:
            stage, query, pair = self._last
            return queries.blocked(stage, query, pair, self._name)
        if self._got_to:
            return Blocked("ik", "hand", self._name, detail="the grasp is out of reach")
        return Blocked("grasp", body=self._name, detail="no grasp fits its shape and the gripper's opening")


class _OpenHand:
    """The hand before it closes on an object of some width: gripper values, the query while it is open, and those while the fingers
    move."""

    def __init__(self, cell: Workcell, poses: Mapping[str, Array], name: str, width_m: float) -> None:
        self.opened, self.closed, self.reaching = open_hand(cell, width_m, poses)
        self._cell, self._poses, self._name = cell, poses, name

    @cached_property
    def closing(self) -> ContactQuery:
        """Not asked for where the open hand does not even get there."""
        return self._cell.moving_fingers(self._poses, self._name, self.opened, self.closed)

    def closes(self, q: Array, failures: _Failures) -> bool:
        """Whether nothing touches while the fingers close, the arm being at q (A,)."""
        pair = reaching.fingers(self.closing.problem, q, self._cell.memory)
        if pair >= 0:
            failures.note(reaching.FINGERS, self.closing, pair)
        return bool(pair < 0)


class _Grasps(LazyList[Grasp]):
    """The grasps on an object where it stands, and the arm's solutions for each; both are found when asked for, and once."""

    def __init__(
        self, cell: Workcell, grasps: Iterable[Grasp], ik: IkSearch, first: Sequence[Grasp] = (), ik_first: IkSearch = QUICK_IK
    ) -> None:
        super().__init__(chain(first, grasps))
        self._cell, self._ik, self._first, self._ik_first = cell, ik, len(first), ik_first
        self._solutions: dict[int, Array] = {}

    def solutions(self, T_hand: Array, i: int) -> Array:
        """Arm configurations (S, A) with the hand at T_hand (4, 4), for grasp number i, the nearest to home first."""
        if i not in self._solutions:
            ik = self._ik_first if i < self._first else self._ik
            self._solutions[i] = self._cell.ik(T_hand, ik)
        return self._solutions[i]
