"""The views of a cabinet that an arm can take with the camera in its hand, when nothing stands in it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import Scene
from kinematics.shapes import convex_parts
from kinematics.transforms import Array, inverse
from perception.camera import Intrinsics
from perception.mapping.next_best_view import ViewCandidates, make_view_candidates, reduced, sample_poses, sweep_poses
from perception.mapping.voxels import unknown_voxels
from perception.rendering.synthetic_camera import DEFAULT, robot_depth
from planning.motion.cell.workcell import IkSearch, Workcell

CANDIDATES = 600  # camera poses that are tried; about half of them can be reached in an empty cabinet
BRANCHES = 2  # arm configurations that are kept for one of them


@dataclass(frozen=True, eq=False)
class ReachableViews:
    """Arm configurations q (C, A) that put the camera at T_world_camera (C, 4, 4), free of the cabinet's walls.

    views: what can be told of them beforehand, whatever stands in the cabinet.
    """

    q: Array
    T: Array
    views: ViewCandidates


def reachable_views(robot: Robot, empty_scene: Scene, intrinsics: Intrinsics = DEFAULT, seed: int = 0) -> ReachableViews:
    """Views of the cabinet that the arm can take when nothing is in it, the same for every scene before the same cabinet among the same
    obstacles; kept.

    Raises: ValueError when the robot has no camera that moves with the hand, or can't take any view.
    """
    return _reachable_views(robot, _Cell(_cell_key(empty_scene), replace(empty_scene, objects=())), intrinsics, seed)


@dataclass(frozen=True)
class _Cell:
    """What stands still about a robot; two of them are equal when their keys are, whatever the scenes are called."""

    key: bytes
    empty_scene: Scene = field(compare=False)


def _cell_key(scene: Scene) -> bytes:
    """Bytes that tell one robot's cell from another: where its base is, and all that stands still."""
    still = [scene.robot.T_world_base]
    for body in scene.fixtures():
        still += [body.T_world_body, *convex_parts(body.shape)]
    return b"".join(np.ascontiguousarray(array, float).tobytes() for array in still)


@lru_cache(maxsize=4)
def _reachable_views(robot: Robot, cell: _Cell, intrinsics: Intrinsics, seed: int) -> ReachableViews:
    cabinet, rng = cell.empty_scene.cabinet, np.random.default_rng(seed)
    found = views_from(robot, cell.empty_scene, np.concatenate([sweep_poses(cabinet), sample_poses(cabinet, CANDIDATES, rng)]), intrinsics)
    if found is None:
        raise ValueError(f"robot {robot.name} can't look into this cabinet from anywhere: is the camera mounted the right way round?")
    return found


def views_from(robot: Robot, empty_scene: Scene, poses: Array, intrinsics: Intrinsics) -> ReachableViews | None:
    """Of camera poses (C, 4, 4), those that the arm can take when nothing is in the cabinet; None when there are none.

    Raises: ValueError when the robot has no camera that moves with the hand.
    """
    T_base = empty_scene.robot.T_world_base
    carried = robot.frame_of_links(float(robot.home[robot.gripper_joint]), T_base)
    if carried["camera"][0] != carried["hand"][0]:
        raise ValueError(
            f"robot {robot.name} has no camera in its hand: its link 'camera' goes with {robot.carrier('camera')!r}; views are chosen for "
            f"one that is fixed to {robot.carrier('hand')!r}: move the link there, or call it otherwise; what a camera elsewhere has seen "
            "is read by `retrieve sense --from-views DIR`"
        )
    T_camera_hand = inverse(carried["camera"][1]) @ carried["hand"][1]
    workcell = Workcell(robot, empty_scene, iterations=1, time_budget_s=None)  # nothing is searched
    gripper = float(robot.home[robot.gripper_joint])
    alone = workcell.problem({}, gripper)
    found = [(q, T) for T in poses for q in workcell.ik(T @ T_camera_hand, IkSearch(8))[:BRANCHES] if workcell.touch(alone, q) is None]
    if not found:
        return None
    small = reduced(intrinsics)
    own = np.array([robot_depth(robot, T_base, robot.with_arm(q, gripper), T, small) > 0 for q, T in found])
    views = np.array([T for _, T in found])
    return ReachableViews(
        np.array([q for q, _ in found]), views, make_view_candidates(unknown_voxels(empty_scene.cabinet), views, intrinsics, own)
    )
