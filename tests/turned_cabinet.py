"""A small cabinet that is turned, and scenes in it."""

from __future__ import annotations

import numpy as np

from kinematics.scene import Body, Cabinet, RobotRef, Scene
from kinematics.transforms import rotation_about, transform

CABINET = Cabinet(np.array([0.5, 0.6, 0.4]), transform(rotation_about((0, 0, 1), 0.3), [0.3, 0.1, 0.2]), 0.03)


def scene_of(*bodies: Body) -> Scene:
    """They stand in it, and the first is the target."""
    return Scene("s", RobotRef(np.eye(4), "ur5e"), CABINET, bodies, bodies[0].name, None, approaches=("horizontal",))
