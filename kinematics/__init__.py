"""Where things are and whether they touch: robots, scenes, forward and inverse kinematics, collision. Knows no goal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kinematics.lazy_imports import lazily

if TYPE_CHECKING:
    from kinematics.errors import InputError, RetrieveError
    from kinematics.robots.load import load
    from kinematics.robots.named import named_robots
    from kinematics.robots.robot import Robot
    from kinematics.scene import Body, Cabinet, Grasp, Held, RobotRef, Scene, State
    from kinematics.shapes import Box, ConvexMesh, Cylinder

__all__ = [
    "Body",
    "Box",
    "Cabinet",
    "ConvexMesh",
    "Cylinder",
    "Grasp",
    "Held",
    "InputError",
    "RetrieveError",
    "Robot",
    "RobotRef",
    "Scene",
    "State",
    "load",
    "load_mesh",
    "named_robots",
]

_WHERE = {
    "Body": "kinematics.scene",
    "Box": "kinematics.shapes",
    "Cabinet": "kinematics.scene",
    "ConvexMesh": "kinematics.shapes",
    "Cylinder": "kinematics.shapes",
    "Grasp": "kinematics.scene",
    "Held": "kinematics.scene",
    "InputError": "kinematics.errors",
    "RetrieveError": "kinematics.errors",
    "Robot": "kinematics.robots.robot",
    "RobotRef": "kinematics.scene",
    "Scene": "kinematics.scene",
    "State": "kinematics.scene",
    "load": "kinematics.robots.load",
    "load_mesh": "kinematics.meshes.load",
    "named_robots": "kinematics.robots.named",
}

__getattr__ = lazily(__name__, _WHERE)
