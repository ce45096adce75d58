"""The robot that options ask for in the place of a scene's."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from kinematics.errors import InputError
from planning.io.files import SceneLine

if TYPE_CHECKING:
    from kinematics.scene import RobotRef


def overridden(line: SceneLine, robot: str | None, hand_frame: str | None, gripper_joint: str | None) -> SceneLine:
    """The line with the robot that the options ask for."""
    if line.scene is None or not (robot or hand_frame or gripper_joint):
        return line
    try:
        ref = other_robot(line.scene.robot, robot, hand_frame, gripper_joint, line.where)
    except InputError as e:
        return replace(line, scene=None, error=str(e))
    return replace(line, scene=replace(line.scene, robot=ref))


def other_robot(scene: RobotRef, robot: str | None, hand_frame: str | None, gripper_joint: str | None, where: str) -> RobotRef:
    """The robot to plan with: another one, or the scene's own URDF with another hand frame or gripper joint. Raises InputError."""
    from kinematics.robots.named import named_robots
    from kinematics.scene import RobotRef

    if robot is None and scene.urdf is not None:
        return replace(scene, hand_frame=hand_frame or scene.hand_frame, gripper_joint=gripper_joint or scene.gripper_joint)
    name = robot or scene.name
    if name not in named_robots():
        return RobotRef(scene.T_world_base, None, name, hand_frame, gripper_joint, mount=scene.mount)
    if hand_frame or gripper_joint:
        raise InputError(f"{where}: --hand-frame and --gripper-joint are for a URDF of one's own; the robot {name} has its own")
    return scene if name == scene.name else RobotRef(scene.T_world_base, name, mount=scene.mount)
