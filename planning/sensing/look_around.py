"""Active sensing: the camera in the hand looks into an unknown cabinet, from one view to the next, until enough is known (section III-B).

Nothing is known at first but the cabinet's size. Every voxel that was not seen is an obstacle for every motion until it is seen, so the arm
only ever moves through what earlier views have shown to be free. The next view is the one that would reveal most, less the way to it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from kinematics.mount import mount
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, Scene
from kinematics.transforms import Array
from perception.camera import Intrinsics
from perception.frames import Frame
from perception.mapping.next_best_view import InformationGain, sweep_poses
from perception.mapping.voxels import ClearRays, Voxels, clear_rays
from perception.rendering.synthetic_camera import DEFAULT, RANGE_M, Camera
from planning.motion.cell.queries import PlanningQuery
from planning.motion.cell.workcell import Workcell
from planning.motion.trajectory import FULL, Pace, timed
from planning.plan import Blocked, Motion
from planning.sensing.protrusions import Protrusions
from planning.sensing.reachable_views import ReachableViews, reachable_views
from planning.sensing.unknown_space import SKIN_M, unknown_space

SHARE, LEAST, MAX_VIEWS = 0.97, 0.003, 8
CHOICES = ("gain", "random", "sweep")
ITERATIONS = 1000  # of one RRT-Connect: there are other views
MOST_UNREACHED = 16  # views that RRT-Connect may fail to reach before the looking ends
TRAVEL = 0.01  # what a metre of the camera's way costs, as a share of the space
BLIND = 3  # views in a row that measure nothing, before the looking ends

Drive = Callable[[Sequence[Motion]], tuple[Sequence[Motion], Array]]
"""Carries motions out: those that were, the last one perhaps in part, and where the arm is then, q (J,)."""


@dataclass(frozen=True)
class Limits:
    """When to stop: the share of the space that is to be known, the least share that a further view must reveal, the most views.

    travel: what a metre of the camera's way costs, as a share of the space.
    """

    share: float = SHARE
    least: float = LEAST
    views: int = MAX_VIEWS
    travel: float = TRAVEL


@dataclass(frozen=True, eq=False)
class Looked:
    """What a look around brought. views: T_world_camera (4, 4) of each frame, and the share known after it. q (J,): where the arm is now.

    reason: why it ended there. rays: what each frame said of the space.
    """

    frames: tuple[Frame, ...]
    views: tuple[tuple[Array, float], ...]
    voxels: Voxels
    motions: tuple[Motion, ...]
    q: Array
    reason: str
    rays: tuple[ClearRays, ...] = ()


def look_around(
    empty_scene: Scene,
    robot: Robot,
    camera: Camera,
    q: Array,
    voxels: Voxels,
    rng: np.random.Generator,
    *,
    bodies: Sequence[Body] = (),
    limits: Limits | None = None,
    focus: Array | None = None,
    choose: str = "gain",
    noise_1m_m: float = 0.0,
    intrinsics: Intrinsics = DEFAULT,
    pace: Pace = FULL,
    drive: Drive | None = None,
    hiding: Callable[[], tuple[Body, ...]] | None = None,
    spots: ReachableViews | None = None,
    on_step: Callable[[str], None] = lambda _: None,
) -> Looked:
    """Take views of the cabinet, the first one where the arm stands, at q (J,).

    empty_scene: the scene without its objects; bodies: the objects that are known already. camera: takes the pictures, of `intrinsics`.
    focus (X, Y, Z): what voxels count more than others, in shares of the space, see `planning.sensing.focus`.
    choose: "gain", "random" or "sweep". pace: how fast the arm moves. drive: takes the arm along motions to the next view; without it the
    camera is told where it would be. hiding: obstacles around all that may be in unseen space, asked when the arm stands in some of it.
    spots: the views that are chosen from, by default `reachable_views`.
    Raises: ValueError when the robot has no camera in its hand, and for another word.
    """
    limits = limits or Limits()
    if choose not in CHOICES:
        raise ValueError(f"views can be chosen by {', '.join(CHOICES)}, not by {choose!r}")
    if limits.views < 1:
        return Looked((), (), voxels, (), q, "no view was allowed")
    base = empty_scene.robot.T_world_base
    spots = spots or reachable_views(robot, empty_scene, intrinsics)
    preview = InformationGain(voxels, spots.views, RANGE_M[0], focus)
    order = _order(choose, spots, empty_scene.cabinet, rng)
    frames, seen, protrusions = list[Frame](), list[ClearRays](), Protrusions(empty_scene.cabinet, noise_1m_m)
    views: list[tuple[Array, float]] = []
    motions: list[Motion] = []
    known = (*bodies, *empty_scene.obstacles, *filter(None, [mount(empty_scene)]))
    blind, done, at = 0, np.zeros(len(spots.q), bool), -1
    while True:
        frame = camera(base @ robot.link_poses(q)["camera"], q)
        depth = frame.depth if frame.arm is None else np.where(frame.arm, np.float32(0), frame.depth)
        rays = clear_rays(
            voxels.cabinet, frame.depth, frame.intrinsics, frame.T_world_camera, own=frame.arm, noise_1m_m=noise_1m_m
        )  # fmt: skip
        voxels = voxels.after(rays)
        protrusions.add(frame)
        frames.append(frame)
        seen.append(rays)
        views.append((frame.T_world_camera, voxels.known))
        on_step(f"view {len(frames)}: {100 * voxels.known:.1f} % known")
        blind = 0 if (depth > 0).any() else blind + 1
        if reason := _enough(limits, voxels, len(frames), blind):
            break
        if at >= 0:
            preview.taken(voxels, at)
        way = KnownFreePaths(empty_scene, robot, voxels, bodies, q, spots, rng, hiding, protrusions.boxes(known, SKIN_M))
        if way.blocked is not None:
            reason = f"the arm can't move on: {way.blocked}"
            break
        chosen = _next(choose, order, preview, voxels, way, done, frame.T_world_camera, limits)
        if isinstance(chosen, str):
            reason = chosen
            break
        at, path = chosen
        done[at] = True
        rows = robot.with_arm(path, q[robot.gripper_joint])
        to_view = timed(way.cell, way.poses, [Motion("look", robot.joint_names, rows, np.arange(len(rows), dtype=float))], pace)
        gone, q = (to_view, rows[-1]) if drive is None else drive(to_view)
        motions += gone
    return Looked(tuple(frames), tuple(views), voxels, tuple(motions), q, reason, tuple(seen))


def _enough(limits: Limits, voxels: Voxels, views: int, blind: int) -> str:
    """Why no further view is taken; nothing when one should be."""
    if voxels.known >= limits.share:
        return f"{100 * voxels.known:.1f} % of the space is known"
    if blind >= BLIND:
        return f"{blind} views in a row measured nothing: is the camera covered, or too near to something?"
    return f"{views} views were taken" if views >= limits.views else ""


def _next(
    choose: str,
    order: Sequence[int],
    preview: InformationGain,
    voxels: Voxels,
    way: KnownFreePaths,
    done: NDArray[np.bool_],
    T_now: Array,
    limits: Limits,
) -> tuple[int, Array] | str:
    """The next view and the path (K, A) to it, or why there is none."""
    if choose != "gain":
        for i in order:
            if not done[i] and way.reach(i):
                return i, way.paths[i]
        return "no other view can be reached"
    cost = limits.travel * np.linalg.norm(way.spots.T[:, :3, 3] - T_now[:3, 3], axis=1) + np.where(done, np.inf, 0.0)
    best = preview.best(voxels, cost, way.reach, limits.least)
    if best is None:
        return f"no view that can be reached would reveal another {100 * limits.least:g} %"
    return best[0], way.paths[best[0]]


def _order(choose: str, spots: ReachableViews, cabinet: Cabinet, rng: np.random.Generator) -> Sequence[int]:
    """In which order the baselines take the views: at random, or those nearest to the poses of a fixed sweep."""
    if choose == "random":
        return [int(i) for i in rng.permutation(len(spots.q))]
    if choose == "gain":
        return []
    out: list[int] = []
    for T in sweep_poses(cabinet):
        off = np.linalg.norm(spots.T[:, :3, 3] - T[:3, 3], axis=1) + 0.3 * (1 - spots.T[:, :3, 2] @ T[:3, 2])
        out += [int(i) for i in np.argsort(off)[:4] if int(i) not in out][:1]
    return out


class KnownFreePaths:
    """Ways from where the arm is to other views, through nothing but known, free space.

    blocked: what keeps the arm from moving at all, None when it can move. paths: those that were found (K, A), by view.
    """

    def __init__(
        self,
        empty_scene: Scene,
        robot: Robot,
        voxels: Voxels,
        bodies: Sequence[Body],
        q: Array,
        spots: ReachableViews,
        rng: np.random.Generator,
        hiding: Callable[[], tuple[Body, ...]] | None = None,
        front: tuple[Body, ...] = (),
    ) -> None:
        """hiding: obstacles around all that may be in unseen space, asked when the arm stands in some of it; front: around what was seen
        before the cabinet."""
        self.spots, self.rng, self.paths, self.failed = spots, rng, dict[int, Array](), 0
        self.start, gripper = robot.arm_q(q), float(q[robot.gripper_joint])
        scene = replace(empty_scene, objects=tuple(bodies))
        self.poses = scene.poses()
        unknown: list[Callable[[], tuple[Body, ...]]] = [partial(unknown_space, voxels, bodies, blocks) for blocks in (2, 1)]
        tries = unknown if hiding is None else [*unknown, hiding]  # in blocks the map is quicker, and a little larger
        for walls, more in product(tries, (front, ()) if front else ((),)):
            self.cell = Workcell(robot, scene, iterations=ITERATIONS, time_budget_s=None, obstacles=(*walls(), *more))
            self.query: PlanningQuery = self.cell.problem(self.poses, gripper)
            touch = self.cell.touch(self.query, self.start)
            if touch is None:
                break
        self.blocked = None if touch is None else Blocked("look", touch.link, touch.body)

    def reach(self, i: int) -> bool:
        """Whether the arm can get to view i; the path is kept."""
        q = self.spots.q[i]
        if self.failed >= MOST_UNREACHED or self.cell.touch(self.query, q) is not None:
            return False
        path = self.cell.connect(self.query, self.start, q[None], self.rng)
        if isinstance(path, Blocked):
            self.failed += 1
            return False
        self.paths[i] = path
        return True
