"""Our forward kinematics against another program's: pytorch-kinematics reads the same URDF, and every link must be at the same place.

It is asked when a robot is seen for the first time; the answer is kept with the robot's cache, so that later starts never import torch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kinematics.robots.batched_fk import Forward
from kinematics.robots.tree import FIXED
from kinematics.transforms import Array

if TYPE_CHECKING:
    from kinematics.robots.robot import Robot

CONFIGURATIONS = 1000
TOLERANCE_M = 1e-5
"""How far a link's origin may lie from where pytorch-kinematics has it; it reads angles in single precision, which is good for 1e-6."""
TOLERANCE_ROTATION = 1e-4
"""The same for the entries of a link's rotation matrix."""


def check_kinematics(robot: Robot, seed: int = 0) -> None:
    """Compare every link's pose at random configurations within the limits.

    Raises: ValueError that names the first joint, counted from the base, behind which the two disagree, and by how much.
    """
    low = np.where(np.isfinite(robot.lower), robot.lower, -np.pi)
    high = np.where(np.isfinite(robot.upper), robot.upper, np.pi)
    q: Array = np.random.default_rng(seed).uniform(low, high, (CONFIGURATIONS, len(low)))
    ours = robot.tree.poses(q)
    theirs = Forward(robot).poses(q)
    for i, link in enumerate(robot.tree.names):  # parents come before their children
        apart = np.abs(ours[:, i] - theirs[link].numpy())
        far, turned = float(apart[:, :3, 3].max()), float(apart[:, :3, :3].max())
        if not (far <= TOLERANCE_M and turned <= TOLERANCE_ROTATION):
            kind = "fixed joint" if robot.tree.kind[i] == FIXED else "joint"
            parent = robot.tree.names[robot.tree.parent[i]] if robot.tree.parent[i] >= 0 else "nothing"
            raise ValueError(
                f"robot {robot.name}: the {kind} between {parent} and {link} is read differently by pytorch-kinematics, which puts {link} "
                f"up to {1000 * far:.3g} mm away and turns it by {turned:.2g}; check its origin, axis and mimic tags"
            )
