"""A robot of boxes on `toy_arm`: what the verdict asks of a robot, and nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import cast

import numpy as np
import trimesh
from toy_arm import ARM, JOINTS, URDF

from kinematics.robots.hands.opening import Opening
from kinematics.robots.robot import Robot
from kinematics.shapes import box_corners
from kinematics.transforms import Array

OPENING = Opening(np.array([0.0, 0.05]), np.array([0.0, 0.1]), np.zeros(2), np.full(2, 0.5), np.zeros(2))
Ends = tuple[float, float]


def solid(x: Ends, y: Ends, z: Ends) -> Array:
    """The corners (8, 3) of a box between those ends."""
    low, high = np.array([x, y, z]).T
    return box_corners((high - low) / 2) + (low + high) / 2


FINGERS = {
    "left": solid((-0.011, 0.011), (0.0, 0.01), (-0.01, 0.04)),
    "right": solid((-0.011, 0.011), (-0.01, 0.0), (-0.01, 0.04)),
}
"""Their inner faces meet at y = 0 when grip is 0; the middle of these is 1.5 cm along z."""
PALM = {"palm": solid((-0.03, 0.03), (-0.06, 0.06), (-0.06, -0.03))}


class ToyRobot:
    """Stands for a robot."""

    def __init__(self, links: Mapping[str, Array | Sequence[Array]], **other: object) -> None:
        self.name, self.urdf, self.joint_names, self.gripper_joint, self.grip = "toy", URDF, JOINTS, 4, None
        self.opening, self.pads, self.skip = OPENING, frozenset({"left", "right"}), frozenset[frozenset[str]]()
        self.velocity, self.acceleration, self.known_jerk = ARM.velocity, np.full(5, 10.0), np.full(5, np.inf)
        self.jerk, self.home = np.full(5, np.inf), np.array([0.0, 0.0, 0.0, 0.0, 0.03])
        self.grip_force_N: float | None = None
        self.most_grip_force_N: float | None = None
        self.hulls = [hull(link, v) for link, some in links.items() for v in ([some] if isinstance(some, np.ndarray) else some)]
        self.__dict__.update(other)


def hull(link: str, vertices: Array) -> SimpleNamespace:
    """A link's convex part."""
    found = trimesh.convex.convex_hull(vertices)
    return SimpleNamespace(link=link, vertices=np.asarray(found.vertices), faces=np.asarray(found.faces, np.int64))


def toy_robot(links: Mapping[str, Array | Sequence[Array]] | None = None, **other: object) -> Robot:
    """With palm and fingers unless told otherwise; other: attributes that differ."""
    return cast("Robot", ToyRobot({**PALM, **FINGERS} if links is None else links, **other))
