"""Limits of speed out of a file of one's own, in the place of those that a robot has."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from kinematics.errors import OptionError, one_line

if TYPE_CHECKING:
    from kinematics.robots.robot import Robot


@lru_cache(maxsize=16)
def with_limits(robot: Robot, file: str | None) -> Robot:
    """The robot with a file's limits of speed, or as it is. Raises: OptionError, see `read_limits`."""
    from kinematics.robots.limits import read_limits

    if file is None:
        return robot
    try:
        limits = read_limits(Path(file), robot.joint_names, robot.limits, robot.urdf)
    except ValueError as e:
        raise OptionError(f"--limits for the robot {robot.name}: {one_line(e)}") from e
    return replace(robot, limits=limits)


def digest(file: str | None) -> str | None:
    """A hash of the file's content: what tells these limits from any other."""
    return None if file is None else hashlib.sha256(Path(file).read_bytes()).hexdigest()[:16]
