"""A robot and what stands around it, packed for compiled planning: poses, what is held and a gripper value in, a motion query out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from kinematics.bounded_cache import evict_oldest
from kinematics.collision import edge_problem
from kinematics.collision.edge_problem import MARGIN_M
from kinematics.collision.geometry import Query, Solids, make_solids, scene_solids, solids_at, some_solids
from kinematics.collision.posed_geometry import join_posed, pose_geometry
from kinematics.collision.robot_model import bare_geometry, shape_geometry
from kinematics.collision.sphere_model import with_more_parts
from kinematics.mount import standing_still
from kinematics.robots.names import check_names
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Held, Scene
from kinematics.shapes import convex_parts
from kinematics.transforms import Array
from planning.motion.cell.arm import MOST_OPENINGS, arm_at
from planning.motion.cell.queries import ContactQuery, PlanningQuery
from planning.motion.search.edges import Memory, Task, memory_for, pose_task, task_elsewhere, with_clearance, without_still
from planning.motion.search.reaching import PlacementQuery
from planning.motion.search.upright import Upright, make_upright
from planning.motion.settings import LEAST_TILT_DEG, MotionSettings, tilt_limit_deg

ELSEWHERE_KEPT = 256  # queries by the opening, what stands and what is held
KEPT = 16  # sets of poses for which the packed bodies are kept
KNOWN_KEPT = 32  # queries at one of these sets; a large robot's take 2 MB each
CLEAR_KEPT = 64  # queries that ask for a clearance


class _Bodies(NamedTuple):
    """What stands at some poses, packed, with the names; the queries among them, by the gripper's value and what is held, or by the two
    values between which an empty hand opens; and the poses without one object. The poses are kept, too, for they are told from others by
    their identity."""

    poses: Mapping[str, Array]
    solids: Solids
    names: tuple[str, ...]
    known: dict[tuple[float, Held | float | None], PlanningQuery]
    without: dict[str, dict[str, Array]]


class PackedCell:
    """A robot, a scene's cabinet and shapes, and other obstacles. Poses, what is held and how far the hand is open come with each query.

    obstacles: space that was not seen yet, from which no distance is kept. Raises: ValueError when two things have one name, see
    `kinematics.robots.names.check_names`; and for objects that may hardly lean at all.
    """

    def __init__(self, robot: Robot, scene: Scene, obstacles: Sequence[Body], settings: MotionSettings) -> None:
        check_names(robot, scene, obstacles)
        for body in scene.objects:
            if tilt_limit_deg(body, settings.max_tilt_deg) < LEAST_TILT_DEG:
                raise ValueError(
                    f"object {body.name!r}: max_tilt_deg must be at least {LEAST_TILT_DEG:g}: less leaves the arm no way to carry it"
                )
        self.robot, self.scene, self.settings = robot, scene, settings
        self._unseen = frozenset(b.name for b in obstacles)
        self.arm = arm_at(robot, scene.robot.T_world_base)
        self.walls = [*standing_still(scene), *obstacles]
        self._fixed = {b.name: b.T_world_body for b in self.walls}
        self._stock, self._rows = make_solids([*self.walls, *scene.objects]) if obstacles else scene_solids(scene)
        self._some: dict[tuple[int, ...], Solids] = {}  # the packed bodies that stood together, wherever
        self._bodies: dict[int, _Bodies] = {}
        self._elsewhere: dict[tuple[object, ...], PlanningQuery] = {}  # among the same objects at some poses
        self._clear: dict[tuple[int, float], tuple[PlanningQuery, PlanningQuery]] = {}  # told by identity, so the queries are kept, too
        n_links, most = len(self.arm.links), max((len(convex_parts(b.shape)) for b in scene.objects), default=0)
        fingers = MOST_OPENINGS * len(self.arm.fingers)
        pairs = (n_links + most + fingers) * len(self._rows) + MOST_OPENINGS * len(self.arm.self_pairs) + most * n_links
        self.memory = memory_for(self.arm.chain, n_links + most + fingers, len(self._rows), pairs)
        self._entered: PlanningQuery | None = None
        T = scene.cabinet.T_world_cabinet
        self.front: Array = np.append(T[:3, 0], T[:3, 0] @ T[:3, 3])

    @property
    def partly_unseen(self) -> bool:
        """Whether there are obstacles besides the scene's: space that nobody has seen."""
        return bool(self._unseen)

    @property
    def stock(self) -> tuple[Solids, Sequence[str]]:
        """The walls and the scene's objects, packed where they stand at the beginning, and the name behind each solid."""
        return self._stock, self._rows

    def problem(self, poses: Mapping[str, Array], gripper: float, *, held: Held | None = None) -> PlanningQuery:
        """Pack a query: objects standing at poses, fingers at a gripper value, an object in the hand.

        The held object may touch the pads, which hold it, and is checked against the rest of the robot.
        """
        _, solids, bodies, known, _ = self._standing(poses)
        if (gripper, held) not in known:
            evict_oldest(known, KNOWN_KEPT)
            known[gripper, held] = self._packed_among(solids, bodies, gripper, held)
        return known[gripper, held]

    def _packed_among(self, solids: Solids, bodies: tuple[str, ...], gripper: float, held: Held | None) -> PlanningQuery:
        """A query among bodies: of the same ones elsewhere only the poses are packed again, for the arm and what it holds are the same."""
        key = gripper, bodies, held and (held.body, held.T_hand_body.tobytes())
        if key in self._elsewhere:
            query = self._elsewhere[key]
            return query._replace(task=task_elsewhere(query.task, solids))
        evict_oldest(self._elsewhere, ELSEWHERE_KEPT)
        query = self._elsewhere[key] = self._pack(solids, bodies, gripper, held)
        return query

    def _pack(self, solids: Solids, bodies: tuple[str, ...], gripper: float, held: Held | None) -> PlanningQuery:
        """See `problem`; of bodies that stand as these solids do."""
        (posed, model), links = self.arm.packed(gripper), self.arm.links
        pairs = self.arm.self_pairs
        if held is not None:
            first = len(links)
            grip = self.arm.in_hand(shape_geometry(self.scene.body(held.body).shape), held.T_hand_body)
            posed, links = join_posed(posed, grip), links + (held.body,) * len(grip.frame)
            model = with_more_parts(self.arm.chain, model, posed, grip)
            others = [i for i, link in enumerate(links[:first]) if link not in self.robot.pads]
            pairs = np.concatenate([pairs, np.array([(h, i) for h in range(first, len(links)) for i in others], np.int64).reshape(-1, 2)])
        check = np.ones((len(links), len(bodies)), np.uint8)
        check[posed.frame == 0] = 0  # the base stands still: the final check judges it
        task = pose_task(self.arm.chain, posed, model, solids, Query(check, pairs), MARGIN_M)
        if self.settings.clearance.least_m > 0:
            task = self._with_clearance(task, bodies, self.settings.clearance.least_m)
        if held is not None:
            task, self._entered = without_still(task, self.memory)._replace(upright=self._upright(held)), None
        return PlanningQuery(task, links + bodies)

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

    def any_opening(self, poses: Mapping[str, Array], first: float, last: float) -> PlanningQuery | None:
        """The query of an empty hand whose fingers may be anywhere between two gripper values; what is free by it is free however they
        move. None where the values are too far apart."""
        moving = self.arm.any_opening(first, last)
        if moving is None:
            return None
        _, solids, bodies, known, _ = self._standing(poses)
        if (first, last) not in known:
            evict_oldest(known, KNOWN_KEPT)
            posed, model, links, pairs, off_m = moving
            check = np.ones((len(links), len(bodies)), np.uint8)
            check[posed.frame == 0] = 0
            task = pose_task(self.arm.chain, posed, model, solids, Query(check, pairs), MARGIN_M)
            known[first, last] = self.keeping(PlanningQuery(task, links + bodies, off_m), self.settings.clearance.least_m)
        return known[first, last]

    def moving_fingers(self, poses: Mapping[str, Array], name: str, opened: float, closed: float) -> ContactQuery:
        """The fingers on their way between two gripper values, before and at the second; the pads may touch the object between them."""
        posed, links, pairs, moving = self.arm.moving_fingers(opened, closed)
        _, solids, bodies, _, _ = self._standing(poses)
        check = np.repeat(moving.astype(np.uint8)[:, None], len(bodies), 1)
        check[np.ix_([i for i, n in enumerate(links) if n in self.robot.pads], [i for i, n in enumerate(bodies) if n == name])] = 0
        return ContactQuery(edge_problem.pose(self.arm.chain, posed, solids, Query(check, pairs), MARGIN_M), links + bodies)

    def standing(self, name: str, poses: Mapping[str, Array]) -> tuple[PlacementQuery, ContactQuery]:
        """An object against all that it must stand free of: the walls besides the floor, and the objects at poses."""
        pieces = bare_geometry(self.scene.body(name).shape)
        n = len(pieces.start) - 1
        posed = pose_geometry(self.arm.chain, pieces, np.zeros(n, np.int64), np.tile(np.eye(4), (n, 1, 1)))
        _, solids, bodies, _, _ = self._standing(poses)
        check = np.tile(np.array([b != "floor" for b in bodies], np.uint8), (n, 1))
        query = Query(check, np.zeros((0, 2), np.int64))
        problem = edge_problem.pose(self.arm.chain, posed, solids, query, MARGIN_M)
        return PlacementQuery(posed, problem, self.front), ContactQuery(problem, (name,) * n + bodies)

    def keeping(self, query: PlanningQuery, clearance_m: float) -> PlanningQuery:
        """The same query for motions that keep so far from everything but what they may touch and unseen space, in metres."""
        key = id(query), clearance_m
        if key not in self._clear:
            evict_oldest(self._clear, CLEAR_KEPT)
            clear = query._replace(task=self._with_clearance(query.task, query.names[query.parts :], clearance_m, query.off_m))
            self._clear[key] = query, clear
        return self._clear[key][1]

    def for_chords(self, query: PlanningQuery, clearance_m: float, within_m: float) -> Task:
        """The task by which chords are judged in the place of a curve of which no point of the arm is further than within_m metres from
        where a chord has it: when the chords are free by it, the curve keeps clearance_m, and what is carried is as upright as it must be.
        """
        task = self._with_clearance(query.task, query.names[query.parts :], max(clearance_m, self.settings.clearance.least_m), query.off_m)
        exact, world, upright = task.exact, task.world, task.upright
        if (more := within_m - MARGIN_M / 2) > 0:  # the exact test's proof keeps half the margin besides
            exact = exact._replace(clearance=exact.clearance + more)
        if task.covered:
            world = world._replace(clearance=world.clearance + np.float32(within_m), own_clearance=world.own_clearance + within_m)
        if upright.limited:
            lean = within_m / float(exact.weight.min())  # the joints turn by no more than that between curve and chord
            upright = upright._replace(least=float(np.cos(max(0.0, np.arccos(upright.least) - lean))))
        return task._replace(exact=exact, world=world, upright=upright)

    def _with_clearance(self, task: Task, bodies: Sequence[str], clearance_m: float, off_m: float = 0.0) -> Task:
        solids = np.full(len(bodies), clearance_m + off_m)
        if self._unseen:
            solids[[name in self._unseen for name in bodies]] = off_m
        return with_clearance(task, solids, min(clearance_m, self.settings.clearance.own_m) + off_m)

    def enter(self, query: PlanningQuery) -> Memory:
        """The memory, made ready for this query."""
        if self._entered is not query:
            edge_problem.enter(query.task.exact, self.memory.exact)
            self._entered = query
        return self.memory

    def forget(self) -> None:
        """The memory has served others meanwhile."""
        self._entered = None

    def _standing(self, poses: Mapping[str, Array]) -> _Bodies:
        found = self._bodies.pop(id(poses), None)
        if found is None:
            evict_oldest(self._bodies, KEPT)  # the one that was not asked about for longest
            fixed = self._fixed
            which = tuple(i for i, name in enumerate(self._rows) if name in poses or name in fixed)
            if which not in self._some:
                self._some[which] = some_solids(self._stock, np.array(which))
            names = tuple(self._rows[i] for i in which)
            T = np.array([poses[name] if name in poses else fixed[name] for name in names])
            found = _Bodies(poses, solids_at(self._some[which], T), names, {}, {})
        self._bodies[id(poses)] = found
        return found
