"""The robot that --robot, --hand-frame and --gripper-joint ask for, in the place of a scene's or for scenes that are generated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from kinematics.errors import InputError

if TYPE_CHECKING:
    from kinematics.robots.robot import Robot
    from kinematics.scene import RobotRef
    from planning.io.files import SceneLine


class RobotOptions(NamedTuple):
    """What the three options say; all None where none is given."""

    robot: str | None = None
    hand_frame: str | None = None
    gripper_joint: str | None = None

    @property
    def given(self) -> bool:
        """Whether any of them is."""
        return any(self)

    def load(self, on_step: Callable[[str], None]) -> Robot:
        """The robot, by default a UR5e. Raises: ValueError, see `kinematics.robots.load.load`."""
        from kinematics.robots.load import load

        return load(self.robot or "ur5e", self.hand_frame, self.gripper_joint, on_step=on_step)


NO_OPTIONS = RobotOptions()


def overridden(line: SceneLine, options: RobotOptions) -> SceneLine:
    """The line with the robot that the options ask for."""
    if line.scene is None or not options.given:
        return line
    try:
        ref = other_robot(line.scene.robot, options, line.where)
    except InputError as e:
        return replace(line, scene=None, error=str(e))
    return replace(line, scene=replace(line.scene, robot=ref))


def other_robot(scene: RobotRef, options: RobotOptions, where: str) -> RobotRef:
    """The robot to plan with: another one, or the scene's own URDF with another hand frame or gripper joint. Raises InputError."""
    from kinematics.robots.named import named_robots
    from kinematics.scene import RobotRef

    robot, hand_frame, gripper_joint = options
    if robot is None and scene.urdf is not None:
        return replace(scene, hand_frame=hand_frame or scene.hand_frame, gripper_joint=gripper_joint or scene.gripper_joint)
    name = robot or scene.name
    if name not in named_robots():
        return RobotRef(scene.T_world_base, None, name, hand_frame, gripper_joint, mount=scene.mount)
    if hand_frame or gripper_joint:
        raise InputError(f"{where}: --hand-frame and --gripper-joint are for a URDF of one's own; the robot {name} has its own")
    return scene if name == scene.name else RobotRef(scene.T_world_base, name, mount=scene.mount)
