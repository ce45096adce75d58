"""One robot before one cabinet: what touches, whether edges are free, and searches for paths, asked and answered in names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from itertools import pairwise
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics import inverse
from kinematics.array_checks import checked
from kinematics.collision import edge_check
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Scene
from kinematics.transforms import Array
from planning.motion.cell.packed_cell import PackedCell
from planning.motion.cell.queries import CollisionPair, ContactQuery, PlanningQuery, in_the_way, pair_of
from planning.motion.cell.supports import Supports
from planning.motion.search.connecting import connect, connect_clear
from planning.motion.search.edges import NOTHING, TILT, connects, connects_from_ends, lacks
from planning.motion.search.reaching import PlacementQuery, make_hand, stands, stands_over
from planning.motion.search.rrt_connect import plan, reach
from planning.motion.search.shortcut import shorten
from planning.motion.settings import DEFAULTS, MotionSettings
from planning.motion.smoothing.curve_check import first_blocked
from planning.motion.smoothing.quicken import quicken
from planning.plan import Blocked

TIME_IS_UP = "the time for it is up"
TILTS = "what is carried would lean too far"
LOOKS = 64  # along a way that is not free, for what touches
NEAR_M = 0.2  # so far from the ends of a path, in metres moved, the least clearance will do


class IkSearch(NamedTuple):
    """How closely the arm's solutions for a hand are looked for: from how many starts, and when two are distinct (`inverse.solve`)."""

    tries: int = 24
    distinct: float = inverse.DISTINCT


QUICK_IK = IkSearch()


class Workcell(PackedCell):
    """A packed cell that answers questions and searches for paths. See `PackedCell`; iterations, time_budget_s: of a search."""

    def __init__(
        self,
        robot: Robot,
        scene: Scene,
        *,
        iterations: int,
        time_budget_s: float | None,
        obstacles: Sequence[Body] = (),
        settings: MotionSettings = DEFAULTS,
    ) -> None:
        super().__init__(robot, scene, obstacles, settings)
        self.iterations, self.time_budget_s = iterations, time_budget_s
        self.hand = make_hand(self.arm.chain, self.arm.backing, self.arm.T_frame_hand)
        self._solutions: dict[tuple[bytes, IkSearch], Array] = {}
        self.ik_starts = 0  # from so many starts solutions were looked for so far
        self._until_s: float | None = None  # perf_counter's time when the budget that searches share is used up
        self._placed: tuple[str, object, PlacementQuery, ContactQuery] | None = None

    @cached_property
    def home_arm(self) -> Array:
        """The arm's joints (A,) where its robot waits."""
        return self.robot.arm_q(self.robot.home)

    @cached_property
    def supports(self) -> Supports:
        """Which of the scene's objects can't be moved as things are."""
        return Supports(self.scene, fixtures=self.walls)

    def free_along(self, query: PlanningQuery, path: Array) -> bool:
        """Whether a path (K, A), K > 1, is free all along, for certain."""
        return bool(first_blocked(query.task, np.ascontiguousarray(path), len(path), self.enter(query)) < 0)

    def free_however_open(
        self, poses: Mapping[str, Array], path: Array, first: float, last: float, clearance_m: float | None = None
    ) -> bool:
        """Whether a path (K, A), K > 1, of an empty hand is free with the fingers anywhere between two gripper values all along, and keeps
        so far from everything, in metres, by default the least."""
        query = self.any_opening(poses, first, last)
        if query is None:
            return False
        return self.free_along(query, path) if clearance_m is None else self.keeps(query, path, clearance_m)

    def placed(self, body: Body, T: Array, poses: Mapping[str, Array]) -> CollisionPair | None:
        """What an object standing at T would touch, or where it would stick out of the cabinet; None when it stands free."""
        standing, among = self._among(body.name, poses)
        pair = int(stands(standing, T, self.memory))
        return in_the_way(among, pair)

    def room_over(self, name: str, R: Array, centres: Array, poses: Mapping[str, Array]) -> NDArray[np.bool_]:
        """Over which of centres (N, 3), its bottom at their height, an object with rotation R (3, 3) stands free: see `placed`."""
        standing, _ = self._among(name, poses)
        free = np.empty(len(centres), np.bool_)
        stands_over(standing, R, centres, np.empty((4, 4)), self.memory, free)
        return free

    def _among(self, name: str, poses: Mapping[str, Array]) -> tuple[PlacementQuery, ContactQuery]:
        """What an object is held against that is to stand among others; the memory will serve it."""
        if self._placed is None or self._placed[0] != name or self._placed[1] is not poses:
            self._placed = (name, poses, *self.standing(name, poses))
        self.forget()
        return self._placed[2:]

    def touch(self, query: PlanningQuery, q: Array) -> CollisionPair | None:
        """What touches at the arm's configuration q (A,), or None."""
        q = checked("q", q, len(self.arm.chain.lower))
        return pair_of(query, edge_check.first_contact(query.task.exact, q, self.enter(query).exact))

    def edge(self, query: PlanningQuery, qa: Array, qb: Array) -> CollisionPair | None:
        """What touches on the straight way from qa to qb (A,), by a look here and there. None is certain: nothing does, anywhere
        on it."""
        qa, qb = (checked("q", q, len(self.arm.chain.lower)) for q in (qa, qb))
        memory = self.enter(query)
        if connects(query.task, qa, qb, memory):
            return None
        said = lacks(query.task, qa + np.linspace(0, 1, LOOKS)[:, None] * (qb - qa), memory)
        pair = next((int(n) for n in said if n != NOTHING), NOTHING)
        if pair == NOTHING:
            return CollisionPair(detail="touches by less than the margin, or between two looks")
        return CollisionPair(detail=TILTS) if pair == TILT else pair_of(query, pair)

    def straight(self, query: PlanningQuery, qa: Array, qb: Array, ends_m: float) -> bool:
        """Whether the straight way from qa to qb (A,) keeps the clearance that is wanted, and near its ends so many metres, for certain."""
        near, clear = self.keeping(query, ends_m).task, self.keeping(query, self.settings.clearance.wanted_m).task
        memory, middle = self.enter(query), np.empty((2, len(qa)))
        return bool(connects_from_ends(near, clear, qa, qb, 3, NEAR_M, middle, memory))

    def quickened(self, query: PlanningQuery, path: Array, rng: np.random.Generator) -> tuple[Array, float]:
        """A certified path (K, A) that takes less time, with the same ends and as much clearance as it has now, graded, apart from its ends
        and near them; and how much that is, in metres, at least."""
        seed = int(rng.integers(2**31))
        memory, middle, last = self.enter(query), np.empty((2, path.shape[1])), len(path) - 2
        for level, ends in self.settings.clearance.grades_m:
            clear, near = self.keeping(query, level).task, self.keeping(query, ends).task
            if all(
                connects_from_ends(near, clear, a, b, (k == 0) + 2 * (k == last), NEAR_M, middle, memory)
                for k, (a, b) in enumerate(pairwise(path))
            ):
                break
        return quicken(near, clear, path, self.robot.arm_limits, NEAR_M, seed, memory, self.settings.quicken), min(level, ends)

    def ik(self, T_world_hand: Array, search: IkSearch = QUICK_IK, *, near: Array | None = None, kept: bool = True) -> Array:
        """Arm configurations (S, A) with the hand at a pose (4, 4), nearest to `near` (A,) first, by default to home; see inverse.solve.
        kept: those nearest to home are remembered, for whoever picks asks for them and whoever looks ahead."""
        arm, key = self.arm, (T_world_hand.tobytes(), search)
        if near is None and key in self._solutions:
            return self._solutions[key]
        near_to = self.home_arm if near is None else near
        self.ik_starts += search.tries
        found = inverse.solve(arm.chain, arm.T_frame_hand, arm.seeds, T_world_hand, near_to, tries=search.tries, distinct=search.distinct)
        if near is None and kept:
            self._solutions[key] = found
        return found

    def follow(self, T_world_hand: Array, q: Array) -> Array | None:
        """The arm's configuration (A,) with the hand at a pose (4, 4) that inverse kinematics comes to from q (A,); None if to none."""
        out, hand = q.copy(), self.hand
        arrived = inverse.descend(hand.chain, hand.T_frame_hand, T_world_hand, out, hand.frames, hand.work, inverse.PATIENT)
        return out if arrived else None

    @contextmanager
    def within_budget(self) -> Iterator[None]:
        """All that is sought inside shares one time budget, if there is one: the paper's second for the whole indicator."""
        self._until_s = None if self.time_budget_s is None else perf_counter() + self.time_budget_s
        try:
            yield
        finally:
            self._until_s = None

    def _left_s(self) -> float | None:
        """How many seconds a search may take; None without a time budget."""
        return self.time_budget_s if self._until_s is None else self._until_s - perf_counter()

    def connect(
        self,
        query: PlanningQuery,
        start: Array,
        goals: Array,
        rng: np.random.Generator,
        iterations: int | None = None,
        known: Sequence[Array] = (),
    ) -> Array | Blocked:
        """A shortened, certified path (K, A) from start (A,), or the nearest of several (S, A) with the hand at one pose, to the nearest of
        goals (G, A), with as much clearance as there is; iterations: a budget of its own; known: see `rrt_connect.plan`."""
        seed, starts = int(rng.integers(2**31)), np.atleast_2d(start)
        if touch := self.touch(query, starts[0]):
            return Blocked("transit", touch.link, touch.body, detail="at the start")
        left_s = None if iterations else self._left_s()
        if left_s is not None and left_s <= 0:
            return Blocked("transit", detail=TIME_IS_UP)
        found = connect(
            query.task, lambda clearance_m: self.keeping(query, clearance_m).task, starts, goals,
            max_iterations=iterations or (self.iterations if self.time_budget_s is None else 2**62),
            time_budget_s=left_s, seed=seed, memory=self.memory, settings=self.settings, known=known,
        )  # fmt: skip
        self.forget()
        if found.path is not None:
            return found.path
        if touch := self.touch(query, goals[0]):
            return Blocked("transit", touch.link, touch.body, detail="at the goal")
        if found.why == "tilt":
            return Blocked("transit", detail=TILTS)
        touch = self.edge(query, starts[0], goals[0]) or CollisionPair()
        return Blocked("transit", touch.link, touch.body, detail=f"no path in {found.iterations} iterations")

    def connect_clear(
        self,
        query: PlanningQuery,
        start: Array,
        goal: Array,
        rng: np.random.Generator,
        iterations: int,
        known: Sequence[Array] = (),
        *,
        shortened: bool = True,
    ) -> Array | None:
        """A certified path (K, A) from start (A,) to goal (A,), both free, that keeps the wanted clearance but near its ends.

        None when none is found in so many iterations. known: see `rrt_connect.plan`. shortened: whether shortcuts are tried at random.
        """
        seed, settings = int(rng.integers(2**31)), self.settings if shortened else self.settings.unshortened
        clear, memory = self.keeping(query, settings.clearance.wanted_m).task, self.enter(query)
        found = connect_clear(query.task, clear, start[None], goal[None], iterations, seed, memory, settings, known)
        self.forget()
        return None if found is None else found.path

    def clearest(self, query: PlanningQuery, path: Array) -> float:
        """The largest of the clearances that are tried which all edges of a certified path (K, A) keep, in metres."""
        *wider, least = self.settings.clearance.levels_m
        return next((level for level in wider if self.keeps(query, path, level)), least)

    def keeps(self, query: PlanningQuery, path: Array, clearance_m: float) -> bool:
        """Whether all edges of a path (K, A) keep a clearance in metres, for certain."""
        return self.free_along(self.keeping(query, clearance_m), path)

    def way(
        self, query: PlanningQuery, start: Array, goals: Array, rng: np.random.Generator, iterations: int, *, shorter: bool = False
    ) -> Array | None:
        """As `connect`, but the first path that is found (K, A), from one of starts (A,) or (S, A), with no more than the least clearance;
        None without one.

        shorter: whether it is shortened.
        """
        seed = int(rng.integers(2**31))
        memory, rrt = self.enter(query), self.settings.rrt
        path = plan(query.task, start, goals, max_iterations=iterations, seed=seed, memory=memory, settings=rrt).path
        if path is None or not shorter:
            return path
        return shorten(query.task, path, settings=self.settings.shortcuts, seed=seed, memory=memory).path

    def reached(self, query: PlanningQuery, start: Array, goals: Array, rng: np.random.Generator, iterations: int) -> NDArray[np.bool_]:
        """To which of goals (G, A) there is a path from start (A,), or from any of several (S, A), each sought in so many iterations."""
        seed = int(rng.integers(2**31))
        memory, rrt = self.enter(query), self.settings.rrt
        return reach(query.task, start, goals, max_iterations=iterations, seed=seed, memory=memory, settings=rrt)
