"""Obstacles where a robot's base is: its fixed links may touch what they stand on, and what stands through one is easily overlooked."""

from __future__ import annotations

import numpy as np

from kinematics.collision.fcl_solids import shape_solids, touch
from kinematics.robots.robot import Robot
from kinematics.robots.tree import FIXED
from kinematics.scene import Scene
from kinematics.shapes import Box
from kinematics.transforms import transform

MIDDLE_M = 1e-4
"""The size of a cube that stands for a point."""


def through_base(robot: Robot, scene: Scene) -> list[tuple[str, str]]:
    """(link, obstacle) where an obstacle holds the middle of a link that is fixed to the world, or of one of the link's convex parts."""
    poses, found = robot.tree.poses(robot.home), dict[tuple[str, str], None]()
    (point,) = shape_solids("middle", Box(np.full(3, MIDDLE_M)))
    solids = [s.move(body.T_world_body) for body in scene.obstacles for s in shape_solids(body.name, body.shape)]
    for hull in robot.hulls:
        link = robot.tree.index[hull.link]
        if all(robot.tree.kind[i] == FIXED for i in robot.tree.path(link)):
            middle = transform(p=(hull.vertices.min(0) + hull.vertices.max(0)) / 2)
            point.move(scene.robot.T_world_base @ poses[link] @ middle)
            found |= {(hull.link, solid.name): None for solid in solids if touch(point, solid) is not None}
    return list(found)
