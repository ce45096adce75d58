"""Our forward kinematics against another reading of the same URDF, every link at random configurations.

yourdfpy reads the tree of joints that all planning rests on; `plain_urdf.py`, which shares no line with either, reads the XML by itself and
multiplies plain matrices. pytorch-kinematics, a third one, agrees with both in the tests: its torch would take a first load two seconds.
It is asked when a robot is seen for the first time; that it passed is kept with the robot's cache.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kinematics.robots.plain_urdf import poses, read
from kinematics.robots.tree import FIXED
from kinematics.transforms import Array

if TYPE_CHECKING:
    from kinematics.robots.robot import Robot

CONFIGURATIONS = 1000
TOLERANCE = 1e-8
"""How far the entries of a link's pose, m or of its rotation, may lie from the other reading's."""


def check_kinematics(robot: Robot, seed: int = 0) -> None:
    """Compare every link's pose at random configurations within the limits.

    Raises: ValueError that names the first joint, counted from the base, behind which the two disagree, and by how much.
    """
    low = np.where(np.isfinite(robot.lower), robot.lower, -np.pi)
    high = np.where(np.isfinite(robot.upper), robot.upper, np.pi)
    q: Array = np.random.default_rng(seed).uniform(low, high, (CONFIGURATIONS, len(low)))
    plain = read(robot.urdf)
    if sorted(plain.joints) != sorted(robot.joint_names) or set(plain.links) != set(robot.tree.names):
        raise ValueError(f"robot {robot.name}: read plainly, its URDF has other joints or links: {', '.join(plain.joints)}")
    ours = robot.tree.poses(q)
    theirs = poses(plain, q[:, [robot.joint_names.index(name) for name in plain.joints]], np.eye(4))
    for i, link in enumerate(robot.tree.names):  # parents come before their children
        carrier, T = plain.links[link]
        apart = np.abs(ours[:, i] - theirs[carrier] @ T)
        far, turned = float(apart[:, :3, 3].max()), float(apart[:, :3, :3].max())
        if not max(far, turned) <= TOLERANCE:
            kind = "fixed joint" if robot.tree.kind[i] == FIXED else "joint"
            parent = robot.tree.names[robot.tree.parent[i]] if robot.tree.parent[i] >= 0 else "nothing"
            raise ValueError(
                f"robot {robot.name}: the {kind} between {parent} and {link} is read differently by a plain reading, which puts "
                f"{link} up to {1000 * far:.3g} mm away and turns it by {turned:.2g}; check its origin, axis and mimic tags"
            )
