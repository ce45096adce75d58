"""Views aimed at what is wanted, for where those that are drawn for the whole cabinet do not show it.

A place between two objects, or behind one, is seen through gaps and from few places. So camera positions are drawn all over, each looks at
a voxel that is wanted, and those are kept from which most of these voxels are not hidden by what is known to stand there.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kinematics.robots.robot import Robot
from kinematics.scene import Body, Scene
from kinematics.transforms import Array, inverse, rotation_about
from perception.camera import Intrinsics, look_at, project
from perception.mapping.next_best_view import sample_poses
from perception.mapping.voxels import OCCUPIED, Voxels
from perception.rendering.synthetic_camera import DEFAULT
from planning.sensing.reachable_views import ReachableViews, views_from

DRAWN, KEPT = 1500, 100
"""Camera positions that are drawn, and those of them to which the arm is asked to go."""
MOST_WANTED = 30
"""So many of the wanted voxels stand for all."""
BEFORE_M = 0.015
"""A line of sight ends so far before a voxel: what it borders on does not hide it."""
AT_ONCE = 250  # positions that are looked at together


def aimed_views(
    robot: Robot,
    empty_scene: Scene,
    voxels: Voxels,
    bodies: Sequence[Body],
    focus: Array,
    rng: np.random.Generator,
    intrinsics: Intrinsics = DEFAULT,
) -> ReachableViews | None:
    """Views that the arm can take when nothing is in the cabinet, and that show some of what is wanted; None where there are none.

    focus (X, Y, Z): the wanted voxels are above 0. bodies: what is known to stand there.
    """
    wanted = voxels.centres(focus > 0)
    wanted = wanted[rng.permutation(len(wanted))[:MOST_WANTED]]
    if len(wanted) == 0:
        return None
    eyes = sample_poses(empty_scene.cabinet, DRAWN, rng)[:, :3, 3]
    aims = wanted[rng.integers(len(wanted), size=DRAWN)]
    poses = np.array([look_at(eye, aim) for eye, aim in zip(eyes, aims)])
    shown = in_image(poses, wanted, intrinsics) & in_sight(voxels, bodies, eyes, wanted)
    count = shown.sum(1)
    best = np.argsort(-count, kind="stable")[:KEPT]
    best = best[count[best] > 0]
    if len(best) == 0:
        return None
    turned = poses[best].copy()
    turned[:, :3, :3] = turned[:, :3, :3] @ rotation_about((0.0, 0.0, 1.0), np.pi)
    return views_from(robot, empty_scene, np.concatenate([poses[best], turned]), intrinsics)


def in_image(poses: Array, points: Array, intrinsics: Intrinsics) -> NDArray[np.bool_]:
    """Which points (N, 3) are in the image of a camera at each of poses (C, 4, 4), if nothing hides them: (C, N)."""
    u, v, _ = np.moveaxis(project(points, intrinsics, poses), -1, 0)
    return np.asarray((u >= 0) & (u < intrinsics.width) & (v >= 0) & (v < intrinsics.height))  # not a number: behind the camera


def in_sight(voxels: Voxels, bodies: Sequence[Body], eyes: Array, points: Array) -> NDArray[np.bool_]:
    """Which points (N, 3) are seen from each of eyes (C, 3) past all that was seen to be occupied and all bodies: (C, N). What nobody has
    seen hides nothing."""
    full = voxels.state == OCCUPIED
    for body in bodies:
        full |= voxels.touched(body)
    full = np.pad(full, 1)  # nothing is beyond the grid
    step, T = voxels.step, inverse(voxels.T_world_grid)
    eyes, points = eyes @ T[:3, :3].T + T[:3, 3], points @ T[:3, :3].T + T[:3, 3]
    farthest = float(np.linalg.norm(eyes[:, None] - points, axis=-1).max())
    along = np.arange(0.0, farthest, float(step.min()))
    out = np.empty((len(eyes), len(points)), bool)
    for first in range(0, len(eyes), AT_ONCE):
        ray = points - eyes[first : first + AT_ONCE, None]
        away = np.linalg.norm(ray, axis=-1, keepdims=True)
        back = np.minimum(BEFORE_M + along, away)  # from the point to the eye
        at = (points[None, :, None] - back[..., None] * (ray / away)[:, :, None]) / step
        index = np.clip(np.floor(at).astype(int), -1, np.array(voxels.state.shape)) + 1
        out[first : first + AT_ONCE] = ~full[tuple(np.moveaxis(index, -1, 0))].any(-1)
    return out
