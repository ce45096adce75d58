"""Where a robot's joints are when a scene begins, as the scene says it by their names."""

from __future__ import annotations

from kinematics.robots.joints import with_joints
from kinematics.robots.robot import Robot
from kinematics.scene import RobotRef
from kinematics.transforms import Array


def start_q(robot: Robot, ref: RobotRef) -> Array | None:
    """The configuration (J,) in which a scene finds its robot; None when it doesn't say. Joints that it leaves out are at home.

    Raises: ValueError for a joint that the robot does not have, or that is neither the arm's nor the gripper's and not at home: no plan
    moves those.
    """
    if ref.q_start is None:
        return None
    q = with_joints(robot.joint_names, robot.home, ref.q_start, f"robot {robot.name}: q_start")
    still = [j for j in range(len(q)) if j not in robot.arm_joints and j != robot.gripper_joint and q[j] != robot.home[j]]
    if still:
        name = robot.joint_names[still[0]]
        raise ValueError(f"robot {robot.name}: q_start: the joint {name!r} is neither the arm's nor the gripper's; set it in robot.home")
    return q
