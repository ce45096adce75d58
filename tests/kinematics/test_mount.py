"""What a robot stands on: where the plane is, who may touch it, and that it leaves a lower cabinet alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kinematics.collision.fcl_check import Verdict
from kinematics.mount import MOUNT, mount, standing_still
from kinematics.robots.names import check_names
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, RobotRef, Scene, State
from kinematics.shapes import Box, bounds
from kinematics.transforms import Array, rotation_about, transform


def scene_of(T_base: Array, floor_z: float = 0.1, name: str | None = "ur5e", mounted: bool | None = None, yaw: float = 0.0) -> Scene:
    T_cabinet = transform(rotation_about((0.0, 0.0, 1.0), yaw), [0.3, 0.0, floor_z])
    cabinet = Cabinet(np.array([0.56, 0.86, 0.5]), T_cabinet, 0.03)
    return Scene("m", RobotRef(T_base, name, None if name else "own.urdf", mount=mounted), cabinet, (), None, None)


def test_who_stands_on_one() -> None:
    for name, mounted, stands in (("ur5e", None, True), ("ur5e", False, False), (None, None, False), (None, True, True)):
        assert (mount(scene_of(np.eye(4), name=name, mounted=mounted)) is not None) == stands
    scene = scene_of(np.eye(4))
    assert [b.name for b in standing_still(scene)] == [*(b.name for b in scene.fixtures()), MOUNT]


def test_its_top_is_the_base_s_plane_and_it_ends_before_a_lower_cabinet() -> None:
    base = transform(p=[0.0, 0.0, 0.4])
    high = mount(scene_of(base, floor_z=0.5))
    assert high is not None
    _low, top = bounds(high.shape, high.T_world_body)
    assert top == pytest.approx([3.0, 3.0, 0.4])
    for yaw in (0.0, 0.3):
        cut = mount(scene_of(base, floor_z=0.1, yaw=yaw))
        assert cut is not None
        cabinet = scene_of(base, floor_z=0.1, yaw=yaw).cabinet
        corners = np.array([[x, y, z] for x in (0.0, 0.56) for y in (-0.43, 0.43) for z in (0.0, 0.5)])
        inside = corners @ cabinet.T_world_cabinet[:3, :3].T + cabinet.T_world_cabinet[:3, 3]
        seen = (inside - cut.T_world_body[:3, 3]) @ cut.T_world_body[:3, :3]
        assert (seen[:, 0] >= cut.shape.half[0] - 1e-9).all()


def test_the_arm_may_not_dip_under_it_and_the_base_stands_on_it(ur5e: Robot) -> None:
    down = ur5e.home.copy()
    down[list(ur5e.arm_joints)[1]] = 0.3  # the arm stretched out, below the horizontal
    for mounted in (None, False):
        scene = scene_of(np.eye(4), mounted=mounted)
        touched = {(c.a, c.b) for c in Verdict(ur5e, scene).contacts(State(down, {}))}
        assert any(b == MOUNT for _, b in touched) == (mounted is None)
        assert not any(a == "base_link_inertia" and b == MOUNT for a, b in touched)
        assert not any(b == MOUNT for _, b in {(c.a, c.b) for c in Verdict(ur5e, scene).contacts(State(ur5e.home, {}))})


def test_its_name_is_its_own(ur5e: Robot) -> None:
    scene = replace(scene_of(np.eye(4)), obstacles=(Body(MOUNT, Box(np.ones(3)), transform(p=[0, 0, 3.0])),))
    with pytest.raises(ValueError, match="mount"):
        check_names(ur5e, scene)
    check_names(ur5e, replace(scene, robot=replace(scene.robot, mount=False)))
