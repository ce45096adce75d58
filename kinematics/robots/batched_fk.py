"""Batched forward kinematics and Jacobians in torch, differentiable, by pytorch-kinematics over the robot's cleaned URDF.

For one configuration `Robot.link_poses` is faster; this is for thousands at a time, and for gradients. pytorch-kinematics takes mimic
joints for free inputs, so they are driven from the actuated ones here. Torch is imported when a `Forward` is made, not before.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

from kinematics.robots.tree import FIXED
from kinematics.transforms import Array

if TYPE_CHECKING:
    import torch

    from kinematics.robots.robot import Robot


class Forward:
    """A robot's kinematics for batches of q (B, J) in the order of `robot.joint_names`, in float64 and the robot's base frame.

    Poses agree with `Robot.link_poses` to 1e-6, no better: pytorch-kinematics reads the URDF's angles in single precision.
    """

    def __init__(self, robot: Robot) -> None:
        import torch

        self.robot = robot
        self._torch = torch
        self._urdf = _with_all_limits(robot.urdf)
        self._chain = _readers().build_chain_from_urdf(self._urdf).to(dtype=torch.float64)
        self._serial: dict[str, Any] = {}
        driven = _driven(robot)
        self._expand, self._offset = self._matrix([driven[n] for n in self._chain.get_joint_parameter_names()])

    def poses(self, q: Array | torch.Tensor) -> dict[str, torch.Tensor]:
        """Pose (B, 4, 4) of every link at q (B, J)."""
        frames = self._chain.forward_kinematics(self._inputs(q) @ self._expand.T + self._offset)
        return {name: frames[name].get_matrix().expand(len(q), 4, 4) for name in self.robot.tree.names}

    def jacobian(self, q: Array | torch.Tensor, link: str = "hand") -> torch.Tensor:
        """Jacobian (B, 6, A) of a link's origin at q (B, J): linear above angular velocity in the base frame, a column an arm joint.

        Raises: ValueError for a link that the robot doesn't have.
        """
        if link not in self.robot.tree.index:
            raise ValueError(f"robot {self.robot.name} has no link {link!r}; it has {', '.join(self.robot.tree.names)}")
        q, arm = self._inputs(q), list(self.robot.arm_joints)
        if all(self.robot.tree.kind[i] == FIXED for i in self.robot.tree.path(self.robot.tree.index[link])):
            return q.new_zeros(len(q), 6, len(arm))
        if link not in self._serial:
            chain = _readers().build_serial_chain_from_urdf(self._urdf, link).to(dtype=self._torch.float64)
            driven = _driven(self.robot)
            self._serial[link] = chain, *self._matrix([driven[n] for n in chain.get_joint_parameter_names()])
        chain, expand, offset = self._serial[link]
        return chain.jacobian(q @ expand.T + offset) @ expand[:, arm]  # type: ignore[no-any-return]

    def _inputs(self, q: Array | torch.Tensor) -> torch.Tensor:
        return self._torch.as_tensor(q, dtype=self._torch.float64)

    def _matrix(self, driven: list[tuple[int, float, float]]) -> tuple[torch.Tensor, torch.Tensor]:
        """The moving joints' values as a linear map of q: matrix (M, J) and offset (M,)."""
        expand = self._torch.zeros(len(driven), len(self.robot.joint_names), dtype=self._torch.float64)
        for row, (j, scale, _) in enumerate(driven):
            expand[row, j] = scale
        return expand, self._torch.tensor([offset for _, _, offset in driven], dtype=self._torch.float64)


def _readers() -> ModuleType:
    """pytorch-kinematics' readers of URDFs, without what its package imports besides: MuJoCo and Matplotlib, half a second for each first
    load of a robot. Who imports the package afterwards gets all of it."""
    if (package := "pytorch_kinematics") in sys.modules or (spec := importlib.util.find_spec(package)) is None:
        return importlib.import_module(f"{package}.urdf")
    sys.modules[package] = importlib.util.module_from_spec(spec)
    try:
        return importlib.import_module(f"{package}.urdf")
    finally:
        del sys.modules[package]


def _with_all_limits(urdf: str) -> bytes:
    """The URDF with a velocity and an effort at every limit, which pytorch-kinematics insists on and has no use for."""
    from lxml import etree

    root = etree.fromstring(urdf)
    for limit in root.iter("limit"):
        for name in ("velocity", "effort"):
            limit.set(name, limit.get(name, "1"))
    return bytes(etree.tostring(root))


def _driven(robot: Robot) -> dict[str, tuple[int, float, float]]:
    """Every moving joint by name: the index in q that drives it, scale and offset, as the URDF's mimic tags say (not as our tree does)."""
    from lxml import etree

    joints = {j.get("name", ""): j for j in etree.fromstring(robot.urdf).iter("joint") if j.get("type") not in (None, "fixed")}

    def drive(name: str) -> tuple[int, float, float]:
        mimic = joints[name].find("mimic")
        if mimic is None:
            return robot.joint_names.index(name), 1.0, 0.0
        j, scale, offset = drive(mimic.get("joint", ""))
        factor = float(mimic.get("multiplier", 1.0))
        return j, factor * scale, factor * offset + float(mimic.get("offset", 0.0))

    return {name: drive(name) for name in joints if name in robot.joint_names or joints[name].find("mimic") is not None}
