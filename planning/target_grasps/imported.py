"""Grasps from elsewhere put onto a scene's target: into the world, the pads between the surfaces that they close on, and checked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import Grasp, Scene
from kinematics.transforms import Array
from planning.grasping.hand_poses import hand_points
from planning.grasping.line_contacts import stretch_at
from planning.io.grasp_files import ReadGrasps
from planning.target_grasps.proposals import Proposals, rank


def onto_target(robot: Robot, scene: Scene, read: ReadGrasps, T_world_file: Array, *, most: int = 12) -> Proposals:
    """The grasps of a file that hold the target, the best first: the network's scores, made 0 to 1, stand for how well the pads close.

    T_world_file (4, 4): the frame that the file's poses are in, a camera's most often. Raises: InputError for a scene without a target.
    """
    target, grasps, quality, missed = scene.target_body, list[Grasp](), list[float](), 0
    spread = float(np.ptp(read.scores)) if len(read.scores) else 0.0
    share = (read.scores - read.scores.min()) / spread if spread > 0 else np.ones(len(read.scores))
    for i in np.argsort(-read.scores, kind="stable"):
        T = T_world_file @ read.T[i]
        if T[2, 0] < 0:  # the fingers are alike: the hand is turned so that its x, where the camera is, points up
            T[:3, :2] *= -1
        if read.at_tips:
            T[:3, 3] -= pad_to_tip(robot) * T[:3, 2]
        hit = stretch_at(target.shape, target.T_world_body, T[:3, 3], T[:3, 1])
        if hit is None:
            missed += 1
            continue
        width = hit.leave - hit.enter
        T[:3, 3] = robot.opening.hand_position(T[:3, 3] + (hit.enter + hit.leave) / 2 * T[:3, 1], T[:3, :3], width)
        grasps.append(Grasp(T, float(width)))
        quality.append(float(share[i]))
    found = rank(robot, scene, grasps, most=most, quality=quality)
    return replace(found, dropped=(*found.dropped, *([("that miss the target", missed)] if missed else [])))


def pad_to_tip(robot: Robot) -> float:
    """How far the fingertips reach beyond the pads' middle, in metres, the hand closed."""
    width = float(robot.opening.width_m[0])
    return float(hand_points(robot, width, robot.fingers)[:, 2].max()) - robot.opening.pad_z_at(width)
