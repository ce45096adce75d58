"""One robot before one cabinet, ready for compiled planning: names and poses in, arrays to the compiled core, names back out."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain, pairwise
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics import inverse
from kinematics.collision import edge_check
from kinematics.collision.geometry import Query, Solids, make_solids, place_solids
from kinematics.collision.posed_geometry import join_posed, pose_geometry
from kinematics.collision.robot_model import bare_geometry, shape_geometry
from kinematics.collision.sphere_model import posed_sphere_model
from kinematics.doors import checked
from kinematics.mount import standing_still
from kinematics.robots.joints import beyond_limits
from kinematics.robots.robot import Robot, check_names
from kinematics.robots.start import start_q
from kinematics.scene import Body, Held, Scene
from kinematics.shapes import bounds, convex_parts
from kinematics.transforms import Array, transform
from planning.motion.arm import MOST_OPENINGS, arm_at
from planning.motion.connecting import connect, connect_clear
from planning.motion.edges import Memory, Task, connects, connects_from_ends, memory_for, pose_task, with_clearance, without_still
from planning.motion.quicken import quicken
from planning.motion.reaching import HANGS_OVER, PlacementQuery, make_hand, stands, stands_over
from planning.motion.rrt_connect import plan, reach
from planning.motion.settings import DEFAULTS, LEAST_TILT_DEG, MotionSettings, tilt_limit_deg
from planning.motion.shortcut import shorten
from planning.motion.upright import Upright, edge_is_upright, is_upright, make_upright
from planning.motion.waiting import LEVEL, looking_in, waiting
from planning.plan import PLACE_OUT_OF_REACH, Blocked

OUTSIDE_M = 0.03  # before the cabinet's front ends what is pulled straight out of it
LEAST_OUTWARD = 0.5  # a hand that looks in more steeply is not pulled back along its own axis
PULL_TRIES = 6  # starts of inverse kinematics
ENOUGH_WAITING = 24  # after a look at so many places to wait with an object in the hand, those that were found will do
TIME_IS_UP = "the time for it is up"
TILTS = "what is carried would lean too far"
NEAR_M = 0.2  # so far from the ends of a path, in metres moved, the least clearance will do
KEPT = 16  # sets of poses for which the packed bodies are kept
CLEAR_KEPT = 64  # queries that ask for a clearance


@dataclass(frozen=True)
class CollisionPair:
    """What is in the way: a link or the held object, and what it touches."""

    link: str | None = None
    body: str | None = None
    detail: str | None = None


class PlanningQuery(NamedTuple):
    """One motion query: what moves and what stands, packed for the compiled core, with the names behind the indices.

    off_m: what moves is no further than that from where it may be, so any clearance has to be so much more.
    """

    task: Task
    names: tuple[str, ...]
    off_m: float = 0.0

    @property
    def problem(self) -> edge_check.Problem:
        """The same query for the exact test alone."""
        return self.task.exact

    @property
    def parts(self) -> int:
        """How many of the names are of what moves; those after them are of what stands."""
        return len(self.task.world.check)

    def solids_of(self, body: str) -> list[int]:
        """Which of the solids that stand are the body's."""
        return [i for i, name in enumerate(self.names[self.parts :]) if name == body]


class ContactQuery(NamedTuple):
    """A question about single configurations: what may not touch, packed for the exact test alone, with the names behind the indices."""

    problem: edge_check.Problem
    names: tuple[str, ...]


class _Bodies(NamedTuple):
    """What stands at some poses, packed, with the names; the queries among them, by the gripper's value and what is held, or by the two
    values between which an empty hand opens; and the poses without one object. The poses are kept, too, for they are told from others by
    their identity."""

    poses: Mapping[str, Array]
    solids: Solids
    names: tuple[str, ...]
    known: dict[tuple[float, Held | float | None], PlanningQuery]
    without: dict[str, dict[str, Array]]


class Workcell:
    """A robot and a scene's cabinet and shapes. Poses, what is held and how far the hand is open come with each query.

    obstacles: more that stands still, besides what the scene has: space that was not seen yet, from which no distance is kept. Raises:
    ValueError when two things have one name, see `kinematics.robots.robot.check_names`; and for objects that may hardly lean at all.
    """

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
        check_names(robot, scene, obstacles)
        for body in scene.objects:
            if tilt_limit_deg(body, settings.max_tilt_deg) < LEAST_TILT_DEG:
                raise ValueError(
                    f"object {body.name!r}: max_tilt_deg must be at least {LEAST_TILT_DEG:g}: less leaves the arm no way to carry it"
                )
        self.robot, self.scene, self.iterations, self.time_budget_s = robot, scene, iterations, time_budget_s
        self.settings, self._unseen = settings, frozenset(b.name for b in obstacles)
        self.arm = arm_at(robot, scene.robot.T_world_base)
        self.walls = [*standing_still(scene), *obstacles]
        self._stock, self._rows = make_solids([*self.walls, *scene.objects])
        self._bodies: dict[int, _Bodies] = {}
        self._clear: dict[tuple[int, float], tuple[PlanningQuery, PlanningQuery]] = {}  # told by identity, so the queries are kept, too
        self._solutions: dict[tuple[bytes, int], Array] = {}
        n_links, most = len(self.arm.links), max((len(convex_parts(b.shape)) for b in scene.objects), default=0)
        fingers = MOST_OPENINGS * len(self.arm.fingers)
        pairs = (n_links + most + fingers) * len(self._rows) + MOST_OPENINGS * len(self.arm.self_pairs) + most * n_links
        self.memory = memory_for(self.arm.chain, n_links + most + fingers, len(self._rows), pairs)
        self._entered: PlanningQuery | None = None
        self._until_s: float | None = None  # perf_counter's time when the budget that searches share is used up
        self._placed: tuple[str, object, PlacementQuery, ContactQuery] | None = None
        self.hand = make_hand(self.arm.chain, self.arm.backing, self.arm.T_frame_hand)
        T = scene.cabinet.T_world_cabinet
        self.front: Array = np.append(T[:3, 0], T[:3, 0] @ T[:3, 3])

    def home(self) -> Array:
        """The full configuration (J,) in which the arm waits: the robot's own, or where that touches, one before the cabinet.

        Raises: ValueError when there is none.
        """
        gripper = float(self.robot.home[self.robot.gripper_joint])
        empty = self.problem(self.scene.poses(), gripper)
        own = self.robot.arm_q(self.robot.home)
        touch = self.touch(empty, own)
        if touch is None:
            return self.robot.with_arm(own, gripper)
        for q in waiting(self.arm, self.scene.cabinet):
            if self.touch(empty, q) is None:
                return self.robot.with_arm(q, gripper)
        raise ValueError(f"robot {self.robot.name} finds no place to wait before this cabinet: at home, {touch.link} touches {touch.body}")

    def start(self) -> Array:
        """The full configuration (J,) in which the scene's first motion begins: its robot's q_start if it has one, else `home`.

        Raises: ValueError for a q_start with joints that the robot does not have, and like `home`.
        """
        q = start_q(self.robot, self.scene.robot)
        return self.home() if q is None else np.clip(q, self.robot.lower, self.robot.upper)

    def start_blocked(self) -> Blocked | None:
        """Why no motion can begin at the scene's q_start; None when one can, or when the scene leaves the start open."""
        q = start_q(self.robot, self.scene.robot)
        if q is None:
            return None
        if beyond := beyond_limits(self.robot.joint_names, q, self.robot.lower, self.robot.upper):
            return Blocked("transit", detail=f"at the start, {beyond}")
        start = self.start()
        gripper = float(start[self.robot.gripper_joint])
        touch = self.touch(self.problem(self.scene.poses(), gripper), self.robot.arm_q(start))
        return None if touch is None else Blocked("transit", touch.link, touch.body, detail="at the start")

    @property
    def stock(self) -> tuple[Solids, Sequence[str]]:
        """The walls and the scene's objects, packed where they stand at the beginning, and the name behind each solid."""
        return self._stock, self._rows

    @property
    def home_arm(self) -> Array:
        return self.robot.arm_q(self.robot.home)

    def problem(
        self,
        poses: Mapping[str, Array],
        gripper: float,
        *,
        held: Held | None = None,
        ignore: Collection[tuple[str, str]] = (),
    ) -> PlanningQuery:
        """Pack a query: objects standing at poses, fingers at a gripper value, an object in the hand, pairs of names that may touch.

        The held object may touch the pads, which hold it, and is checked against the rest of the robot.
        """
        _, solids, bodies, known, _ = self._standing(poses)
        if not ignore and (gripper, held) in known:
            return known[gripper, held]
        (posed, model), links = self.arm.packed(gripper), self.arm.links
        pairs = self.arm.self_pairs
        if held is not None:
            first = len(links)
            grip = self.arm.in_hand(shape_geometry(self.scene.body(held.body).shape), held.T_hand_body)
            posed, links = join_posed(posed, grip), links + (held.body,) * len(grip.frame)
            model = posed_sphere_model(self.arm.chain, posed)
            others = [i for i, link in enumerate(links[:first]) if link not in self.robot.pads]
            pairs = np.concatenate([pairs, np.array([(h, i) for h in range(first, len(links)) for i in others], np.int64).reshape(-1, 2)])
        check = np.ones((len(links), len(bodies)), np.uint8)
        check[posed.frame == 0] = 0  # the base stands still: the final check judges it
        for a, b in ignore:
            check[np.ix_([i for i, n in enumerate(links) if n == a], [i for i, n in enumerate(bodies) if n == b])] = 0
        task = pose_task(self.arm.chain, posed, model, solids, Query(check, pairs), edge_check.MARGIN_M)
        if self.settings.clearance.least_m > 0:
            task = self._with_clearance(task, bodies, self.settings.clearance.least_m)
        if held is not None:
            task, self._entered = without_still(task, self.memory)._replace(upright=self._upright(held)), None
        query = PlanningQuery(task, links + bodies)
        if not ignore:
            known[gripper, held] = query
        return query

    def without(self, poses: Mapping[str, Array], name: str) -> dict[str, Array]:
        """The poses of the objects besides one: for the same poses the same ones, so that what was packed for them is found again."""
        known = self._standing(poses).without
        if name not in known:
            known[name] = {n: T for n, T in poses.items() if n != name}
        return known[name]

    def _upright(self, held: Held) -> Upright:
        """How far a held object may tilt from how it stood."""
        R_stood = self.scene.body(held.body).T_world_body[:3, :3]
        axis = self.arm.T_frame_hand[:3, :3] @ held.T_hand_body[:3, :3] @ R_stood[2]
        return make_upright(axis, float(np.radians(tilt_limit_deg(self.scene.body(held.body), self.settings.max_tilt_deg))))

    def allowing(self, query: PlanningQuery, a: str, b: str) -> PlanningQuery:
        """The same query, but link or held object a may touch body b."""
        (task, names, off_m), P = query, query.parts
        problem, world = task.exact, task.world
        first, second = (np.array([n == name for n in names]) for name in (a, b))
        first[P:] = second[:P] = False  # a mover and what stands: their names are of two spaces
        kept = ~(first[problem.pairs[:, 0]] & second[problem.pairs[:, 1]])
        problem = edge_check.some_pairs(problem, kept)
        check = np.where(first[:P, None] & second[P:], np.uint8(0), world.check)
        return PlanningQuery(task._replace(exact=problem, world=world._replace(check=check)), names, off_m)

    def any_opening(self, poses: Mapping[str, Array], first: float, last: float) -> PlanningQuery | None:
        """The query of an empty hand whose fingers may be anywhere between two gripper values; what is free by it is free however they
        move. None where the values are too far apart."""
        moving = self.arm.any_opening(first, last)
        if moving is None:
            return None
        _, solids, bodies, known, _ = self._standing(poses)
        if (first, last) not in known:
            posed, model, links, pairs, off_m = moving
            check = np.ones((len(links), len(bodies)), np.uint8)
            check[posed.frame == 0] = 0
            task = pose_task(self.arm.chain, posed, model, solids, Query(check, pairs), edge_check.MARGIN_M)
            known[first, last] = self.keeping(PlanningQuery(task, links + bodies, off_m), self.settings.clearance.least_m)
        return known[first, last]

    def free_along(self, query: PlanningQuery, path: Array) -> bool:
        """Whether a path (K, A), K > 1, is free all along, for certain."""
        memory = self.enter(query)
        return all(connects(query.task, a, b, memory) for a, b in pairwise(path))

    def free_however_open(self, poses: Mapping[str, Array], path: Array, first: float, last: float) -> bool:
        """Whether a path (K, A), K > 1, of an empty hand is free with the fingers anywhere between two gripper values all along."""
        query = self.any_opening(poses, first, last)
        return query is not None and self.free_along(query, path)

    def moving_fingers(self, poses: Mapping[str, Array], name: str, opened: float, closed: float) -> ContactQuery:
        """The fingers on their way between two gripper values, before and at the second; the pads may touch the object between them."""
        posed, links, pairs, moving = self.arm.moving_fingers(opened, closed)
        _, solids, bodies, _, _ = self._standing(poses)
        check = np.repeat(moving.astype(np.uint8)[:, None], len(bodies), 1)
        check[np.ix_([i for i, n in enumerate(links) if n in self.robot.pads], [i for i, n in enumerate(bodies) if n == name])] = 0
        return ContactQuery(edge_check.pose(self.arm.chain, posed, solids, Query(check, pairs), edge_check.MARGIN_M), links + bodies)

    def standing(self, name: str, poses: Mapping[str, Array]) -> tuple[PlacementQuery, ContactQuery]:
        """An object against all that it must stand free of: the walls besides the floor, and the objects at poses."""
        pieces = bare_geometry(self.scene.body(name).shape)
        n = len(pieces.start) - 1
        posed = pose_geometry(self.arm.chain, pieces, np.zeros(n, np.int64), np.tile(np.eye(4), (n, 1, 1)))
        _, solids, bodies, _, _ = self._standing(poses)
        check = np.tile(np.array([b != "floor" for b in bodies], np.uint8), (n, 1))
        query = Query(check, np.zeros((0, 2), np.int64))
        problem = edge_check.pose(self.arm.chain, posed, solids, query, edge_check.MARGIN_M)
        return PlacementQuery(posed, problem, self.front), ContactQuery(problem, (name,) * n + bodies)

    def placed(self, body: Body, T: Array, poses: Mapping[str, Array]) -> CollisionPair | None:
        """What an object standing at T would touch, or where it would stick out of the cabinet; None when it stands free."""
        standing, among = self._among(body.name, poses)
        pair = int(stands(standing, T, self.memory))
        return self._in_the_way(among, pair)

    def room_over(self, name: str, R: Array, centres: Array, poses: Mapping[str, Array]) -> NDArray[np.bool_]:
        """Over which of centres (N, 3), its bottom at their height, an object with rotation R (3, 3) stands free: see `placed`."""
        standing, _ = self._among(name, poses)
        free = np.empty(len(centres), np.bool_)
        stands_over(standing, R, centres, np.empty((4, 4)), self.memory, free)
        return free

    def _in_the_way(self, among: PlanningQuery | ContactQuery, pair: int) -> CollisionPair | None:
        """What `reaching.stands` found, in words."""
        if pair == HANGS_OVER:
            return CollisionPair(among.names[0], "floor", "it would hang over the front edge")
        return self.name_of(among, pair)

    def _among(self, name: str, poses: Mapping[str, Array]) -> tuple[PlacementQuery, ContactQuery]:
        """What an object is held against that is to stand among others; the memory will serve it."""
        if self._placed is None or self._placed[0] != name or self._placed[1] is not poses:
            self._placed = (name, poses, *self.standing(name, poses))
        self._entered = None
        return self._placed[2:]

    def touch(self, query: PlanningQuery, q: Array) -> CollisionPair | None:
        """What touches at the arm's configuration q (A,), or None."""
        q = checked("q", q, len(self.arm.chain.lower))
        return self.name_of(query, edge_check.first_contact(query.task.exact, q, self.enter(query).exact))

    def edge(self, query: PlanningQuery, qa: Array, qb: Array) -> CollisionPair | None:
        """What touches on the straight way from qa to qb (A,); None is certain: nothing does, anywhere on it."""
        qa, qb = (checked("q", q, len(self.arm.chain.lower)) for q in (qa, qb))
        memory = self.enter(query)
        if connects(query.task, qa, qb, memory):
            return None
        if not edge_is_upright(query.task.exact.chain, query.task.upright, qa, qb, memory.exact):
            return CollisionPair(detail=TILTS)
        pair = edge_check.edge_contact(query.task.exact, qa, qb, memory.exact)
        return self.name_of(query, pair) if pair >= 0 else CollisionPair(detail="touches by less than the margin")

    def straight(self, query: PlanningQuery, qa: Array, qb: Array, ends_m: float) -> bool:
        """Whether the straight way from qa to qb (A,) keeps the clearance that is wanted, and near its ends so many metres, for certain."""
        near, clear = self.keeping(query, ends_m).task, self.keeping(query, self.settings.clearance.wanted_m).task
        memory, middle = self.enter(query), np.empty((2, len(qa)))
        return bool(connects_from_ends(near, clear, qa, qb, 3, NEAR_M, middle, memory))

    def quickened(self, query: PlanningQuery, path: Array, rng: np.random.Generator) -> Array:
        """A certified path (K, A) that takes less time, with the same ends and as much clearance as it has now, graded, apart from its ends
        and near them."""
        seed = int(rng.integers(2**31))
        if len(path) < 3:
            return path
        memory, middle, last = self.enter(query), np.empty((2, path.shape[1])), len(path) - 2
        for level, ends in self.settings.clearance.grades_m:
            clear, near = self.keeping(query, level).task, self.keeping(query, ends).task
            if all(
                connects_from_ends(near, clear, a, b, (k == 0) + 2 * (k == last), NEAR_M, middle, memory)
                for k, (a, b) in enumerate(pairwise(path))
            ):
                break
        return quicken(near, clear, path, self.robot.arm_limits, NEAR_M, seed, memory, self.settings.quicken)

    def enter(self, query: PlanningQuery) -> Memory:
        """The memory, made ready for this situation."""
        if self._entered is not query:
            edge_check.enter(query.task.exact, self.memory.exact)
            self._entered = query
        return self.memory

    def forget(self) -> None:
        """The memory has served others meanwhile."""
        self._entered = None

    def ik(self, T_world_hand: Array, *, near: Array | None = None, tries: int = 24) -> Array:
        """Arm configurations (S, A) with the hand at a pose (4, 4), nearest to `near` (A,) first, by default to home."""
        arm = self.arm
        if near is not None:
            return inverse.solve(arm.chain, arm.T_frame_hand, arm.seeds, T_world_hand, near, tries=tries)
        key = T_world_hand.tobytes(), tries
        if key not in self._solutions:  # those of a grasp are asked for by whoever picks and by whoever looks ahead
            self._solutions[key] = inverse.solve(arm.chain, arm.T_frame_hand, arm.seeds, T_world_hand, self.home_arm, tries=tries)
        return self._solutions[key]

    @property
    def partly_unseen(self) -> bool:
        """Whether there are obstacles besides the scene's: space that nobody has seen."""
        return bool(self._unseen)

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
        self, query: PlanningQuery, start: Array, goals: Array, rng: np.random.Generator, iterations: int | None = None
    ) -> Array | Blocked:
        """A shortened, certified path (K, A) from start (A,), or the nearest of several (S, A) with the hand at one pose, to the nearest of
        goals (G, A), with as much clearance as there is; iterations: a budget of its own."""
        seed, starts = int(rng.integers(2**31)), np.atleast_2d(start)
        if touch := self.touch(query, starts[0]):
            return Blocked("transit", touch.link, touch.body, detail="at the start")
        left_s = None if iterations else self._left_s()
        if left_s is not None and left_s <= 0:
            return Blocked("transit", detail=TIME_IS_UP)
        found = connect(
            query.task, lambda clearance_m: self.keeping(query, clearance_m).task, starts, goals,
            max_iterations=iterations or (self.iterations if self.time_budget_s is None else 2**62),
            time_budget_s=left_s, seed=seed, memory=self.memory, settings=self.settings,
        )  # fmt: skip
        self._entered = None
        if found.path is not None:
            return found.path
        if touch := self.touch(query, goals[0]):
            return Blocked("transit", touch.link, touch.body, detail="at the goal")
        if found.why == "tilt":
            return Blocked("transit", detail=TILTS)
        touch = self.edge(query, starts[0], goals[0]) or CollisionPair()
        return Blocked("transit", touch.link, touch.body, detail=f"no path in {found.iterations} iterations")

    def connect_clear(self, query: PlanningQuery, start: Array, goal: Array, rng: np.random.Generator, iterations: int) -> Array | None:
        """A shortened, certified path (K, A) from start (A,) to goal (A,), both free, that keeps the wanted clearance but near its ends.

        None when none is found in so many iterations.
        """
        seed = int(rng.integers(2**31))
        clear, memory = self.keeping(query, self.settings.clearance.wanted_m).task, self.enter(query)
        found = connect_clear(query.task, clear, start[None], goal[None], iterations, seed, memory, self.settings)
        self._entered = None
        return None if found is None else found.path

    def keeping(self, query: PlanningQuery, clearance_m: float) -> PlanningQuery:
        """The same query for motions that keep so far from everything but what they may touch and unseen space, in metres."""
        key = id(query), clearance_m
        if key not in self._clear:
            if len(self._clear) == CLEAR_KEPT:
                self._clear.pop(next(iter(self._clear)))  # the oldest
            clear = query._replace(task=self._with_clearance(query.task, query.names[query.parts :], clearance_m, query.off_m))
            self._clear[key] = query, clear
        return self._clear[key][1]

    def clearest(self, query: PlanningQuery, path: Array) -> float:
        """The largest of the clearances that are tried which all edges of a certified path (K, A) keep, in metres."""
        *wider, least = self.settings.clearance.levels_m
        return next((level for level in wider if self.keeps(query, path, level)), least)

    def keeps(self, query: PlanningQuery, path: Array, clearance_m: float) -> bool:
        """Whether all edges of a path (K, A) keep a clearance in metres, for certain."""
        clear = self.keeping(query, clearance_m)
        memory = self.enter(clear)
        return all(connects(clear.task, a, b, memory) for a, b in pairwise(path))

    def for_chords(self, query: PlanningQuery, clearance_m: float, within_m: float) -> Task:
        """The task by which chords are judged in the place of a curve of which no point of the arm is further than within_m metres from
        where a chord has it: when the chords are free by it, the curve keeps clearance_m, and what is carried is as upright as it must be.
        """
        task = self._with_clearance(query.task, query.names[query.parts :], max(clearance_m, self.settings.clearance.least_m), query.off_m)
        more = max(0.0, within_m - edge_check.MARGIN_M / 2)  # the exact test's proof keeps half the margin besides
        exact, world = task.exact, task.world
        exact = exact._replace(clearance=exact.clearance + more)
        if task.covered:
            world = world._replace(clearance=world.clearance + np.float32(within_m), own_clearance=world.own_clearance + within_m)
        task = task._replace(exact=exact, world=world)
        if not task.upright.limited:
            return task
        lean = within_m / float(task.exact.weight.min())  # the joints turn by no more than that between curve and chord
        return task._replace(upright=task.upright._replace(least=float(np.cos(max(0.0, np.arccos(task.upright.least) - lean)))))

    def _with_clearance(self, task: Task, bodies: Sequence[str], clearance_m: float, off_m: float = 0.0) -> Task:
        solids = np.array([0.0 if name in self._unseen else clearance_m for name in bodies])
        return with_clearance(task, solids + off_m, min(clearance_m, self.settings.clearance.own_m) + off_m)

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

    def name_of(self, query: PlanningQuery | ContactQuery, pair: int) -> CollisionPair | None:
        """The bodies behind the index of a pair; None behind -1."""
        if pair < 0:
            return None
        a, b = query.problem.pairs[pair, :2]
        return CollisionPair(query.names[a], query.names[b])

    def blocked(self, stage: str, query: PlanningQuery | ContactQuery, pair: int, name: str) -> Blocked:
        """What the compiled core found, in words: the stage and the two bodies, or that it was the arm's reach."""
        if stage == "ik":
            return Blocked("ik", "hand", name, detail=PLACE_OUT_OF_REACH)
        touch = self._in_the_way(query, pair) if stage == "region" else self.name_of(query, pair)
        if touch is not None:
            return Blocked(stage, touch.link, touch.body, detail=touch.detail)
        return Blocked(stage, "hand", name, detail="the straight way is not free, or leaves the arm's reach")

    def outside(self, carrying: PlanningQuery, held: Held, most: int = 8) -> Array:
        """Free arm configurations (G, A) that hold an object wholly before the cabinet's front; home first, G may be 0."""
        goals, task, memory, shape = list[Array](), carrying.task, self.memory, self.scene.body(held.body).shape
        T_cabinet = np.linalg.inv(self.scene.cabinet.T_world_cabinet)
        for i, q in enumerate(chain([self.home_arm], waiting(self.arm, self.scene.cabinet, self._looks(task.upright, held)))):
            if goals and i > ENOUGH_WAITING:
                break
            T = T_cabinet @ self.arm.hand_pose(q) @ held.T_hand_body
            inmost = bounds(shape, T)[1][0]
            upright = is_upright(task.exact.chain, task.upright, q, memory.exact)
            if T[0, 3] < -0.03 and inmost < 0.0 and upright and self.touch(carrying, q) is None:
                goals.append(q)
                if len(goals) == most:
                    break
        return np.array(goals).reshape(-1, len(self.home_arm))

    def pulled_out(self, carrying: PlanningQuery, held: Held, q: Array) -> Array:
        """Free arm configurations (G, A) near q (A,) with the hand as it is there, but so far back that a held object is wholly before the
        cabinet's front: back along its own z, and straight out of the cabinet. G may be 0."""
        goals, T_hand, T_cabinet = list[Array](), self.arm.hand_pose(q), self.scene.cabinet.T_world_cabinet
        out = -T_cabinet[:3, 0]
        inmost = bounds(self.scene.body(held.body).shape, np.linalg.inv(T_cabinet) @ T_hand @ held.T_hand_body)[1][0]
        for along in (-T_hand[:3, 2], out):
            if along @ out > LEAST_OUTWARD:
                there = transform(T_hand[:3, :3], T_hand[:3, 3] + max(0.0, inmost + OUTSIDE_M) / float(along @ out) * along)
                solutions = (
                    self.arm.headed(np.eye(4), there, q, PULL_TRIES) if self.arm.few_joints else self.ik(there, near=q, tries=PULL_TRIES)
                )
                for goal in solutions[:1]:
                    upright = is_upright(carrying.task.exact.chain, carrying.task.upright, goal, self.memory.exact)
                    if upright and self.touch(carrying, goal) is None:
                        goals.append(goal)
        return np.array(goals).reshape(-1, len(q))

    def _looks(self, upright: Upright, held: Held) -> Array:
        """How the hand looks into the cabinet with an object in it, in the cabinet's frame (3, 3): level, or where the object would then
        lean too far, pitched as when it was taken."""
        T_cabinet = self.scene.cabinet.T_world_cabinet
        axis_in_hand = self.arm.T_frame_hand[:3, :3].T @ upright.axis
        if (T_cabinet[2, :3] @ LEVEL) @ axis_in_hand >= upright.allowed:
            return LEVEL
        return looking_in(T_cabinet, self.scene.body(held.body).T_world_body[:3, :3] @ held.T_hand_body[:3, :3].T)

    def _standing(self, poses: Mapping[str, Array]) -> _Bodies:
        found = self._bodies.pop(id(poses), None)
        if found is None:
            if len(self._bodies) == KEPT:
                self._bodies.pop(next(iter(self._bodies)))  # the one that was not asked about for longest
            fixed = {b.name: b.T_world_body for b in self.walls}
            which = [i for i, name in enumerate(self._rows) if name in poses or name in fixed]
            names = tuple(self._rows[i] for i in which)
            T = np.array([poses[name] if name in poses else fixed[name] for name in names])
            found = _Bodies(poses, place_solids(self._stock, np.array(which), T), names, {}, {})
        self._bodies[id(poses)] = found
        return found
