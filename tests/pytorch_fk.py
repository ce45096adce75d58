"""Forward kinematics by pytorch-kinematics over a robot's cleaned URDF: a reading of it that shares nothing with ours."""

from __future__ import annotations

import pytorch_kinematics
import torch
from lxml import etree

from kinematics.robots.robot import Robot
from kinematics.transforms import Array


def poses_by_pytorch(robot: Robot, q: Array) -> dict[str, Array]:
    """Pose (B, 4, 4) of every link in the robot's base frame at q (B, J).

    They agree with `Robot.link_poses` to 1e-6, no better: pytorch-kinematics reads the URDF's angles in single precision. It takes mimic
    joints for free inputs, so they are driven from the actuated ones here.
    """
    chain = pytorch_kinematics.build_chain_from_urdf(_with_all_limits(robot.urdf)).to(dtype=torch.float64)
    driven = _driven(robot)
    index, scale, offset = zip(*(driven[name] for name in chain.get_joint_parameter_names()))
    frames = chain.forward_kinematics(torch.as_tensor(q[:, index] * scale + offset))
    return {name: frames[name].get_matrix().expand(len(q), 4, 4).numpy() for name in robot.tree.names}


def _with_all_limits(urdf: str) -> bytes:
    """The URDF with a velocity and an effort at every limit, which pytorch-kinematics insists on and has no use for."""
    root = etree.fromstring(urdf)
    for limit in root.iter("limit"):
        for name in ("velocity", "effort"):
            limit.set(name, limit.get(name, "1"))
    return bytes(etree.tostring(root))


def _driven(robot: Robot) -> dict[str, tuple[int, float, float]]:
    """Every moving joint by name: the index in q that drives it, scale and offset, as the URDF's mimic tags say (not as our tree does)."""
    joints = {j.get("name", ""): j for j in etree.fromstring(robot.urdf).iter("joint") if j.get("type") not in (None, "fixed")}

    def drive(name: str) -> tuple[int, float, float]:
        mimic = joints[name].find("mimic")
        if mimic is None:
            return robot.joint_names.index(name), 1.0, 0.0
        j, scale, offset = drive(mimic.get("joint", ""))
        factor = float(mimic.get("multiplier", 1.0))
        return j, factor * scale, factor * offset + float(mimic.get("offset", 0.0))

    return {name: drive(name) for name in joints if name in robot.joint_names or joints[name].find("mimic") is not None}
