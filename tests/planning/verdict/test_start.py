"""Where a plan begins, of a robot of boxes that is at home at 0, its hand open."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from toy_arm import course
from toy_robot import FINGERS, PALM, solid, toy_robot

from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, RobotRef, Scene
from kinematics.shapes import Box
from kinematics.transforms import rotation_about, transform
from planning.plan import Fault
from planning.verdict.hand import hand_of
from planning.verdict.start import start_faults

SCENE = Scene("s", RobotRef(np.eye(4), "toy", mount=False), Cabinet(np.full(3, 0.4), transform(p=[9.0, 0, 0]), 0.03), (), None, None)
HOME = (0.0, 0.0, 0.0, 0.0, 0.03)


def begins(*q: float, scene: Scene = SCENE, robot: Robot | None = None) -> list[Fault]:
    arm = robot or toy_robot()
    return start_faults(arm, hand_of(arm), scene, [course(q, stage="approach"), course((7.0,))])


def test_it_begins_at_home_where_the_scene_says_nothing_else() -> None:
    words = "motion 0 begins with y 0.5 m from home, where the arm is unless the scene's robot.q_start says otherwise"
    assert begins(*HOME) == begins(0.9e-6, *HOME[1:]) == begins(1e-6, *HOME[1:]) == []
    assert begins(0.2, -0.5, 0.0, 0.0, 0.03) == [Fault("approach", (), words, 0.5)]
    assert begins(*HOME, robot=toy_robot(home=np.array([0.0, 0.5, 0.0, 0.0, 0.03]))) == [Fault("approach", (), words, 0.5)]
    turned = toy_robot(joint_names=("grip", "tip", "turn", "y", "x"), gripper_joint=0, home=np.array(HOME[::-1]))
    assert begins(*HOME, robot=turned) == []


def test_joints_that_q_start_leaves_out_are_at_home() -> None:
    scene = replace(SCENE, robot=replace(SCENE.robot, q_start={"turn": 0.5}))
    assert begins(0.0, 0.0, 0.5, 0.0, 0.03, scene=scene) == []
    assert begins(0.0, 0.0, 0.2, 0.1, 0.03, scene=scene)[0].detail == "motion 0 begins with turn 0.3 rad from where the scene says it is"
    assert begins(0.0, 0.0, 0.5, 0.1, 0.03, scene=scene)[0].detail == "motion 0 begins with tip 0.1 rad from where the scene says it is"


@pytest.mark.parametrize("kind", ["object", "obstacle"])
def test_where_something_stands_at_home_it_may_begin_anywhere(kind: str) -> None:
    """As the planner does, which keeps half a millimetre from everything: whatever is nearer than one. The palm ends at y = 6 cm."""
    for T_base in (np.eye(4), transform(rotation_about((0, 0, 1), np.pi / 2), [0.3, 0.0, 0.0])):
        for gap, free in ((-0.01, False), (0.0005, False), (0.0009, False), (0.0012, True), (0.1, True)):
            post = Body("post", Box(np.full(3, 0.02)), T_base @ transform(p=[0.0, 0.06 + gap + 0.01, -0.04]))
            stands = {"objects": (post,)} if kind == "object" else {"obstacles": (post,)}
            scene = replace(SCENE, robot=replace(SCENE.robot, T_world_base=T_base), **stands)  # type: ignore[arg-type]
            assert len(begins(0.5, 0.0, 0.0, 0.0, 0.03, scene=scene)) == free, gap
            said = replace(scene, robot=replace(scene.robot, q_start={}))
            assert len(begins(0.5, 0.0, 0.0, 0.0, 0.03, scene=said)) == 1


def test_where_the_arm_is_in_its_own_way_at_home_it_may_begin_anywhere() -> None:
    """Its base is beside the right finger, which ends at y = -4 cm."""
    for gap, free in ((-0.001, False), (0.0005, False), (0.0009, False), (0.0012, True)):
        base = solid((-0.01, 0.01), (-0.06, -0.04 - gap), (-0.01, 0.02))
        robot = toy_robot({**PALM, **FINGERS, "base": base})
        assert len(begins(0.5, 0.0, 0.0, 0.0, 0.03, robot=robot)) == free, gap
    turned = (0.0, 0.0, np.pi / 2, 0.0, 0.03)  # there the tool, 40 cm beside the palm, is half a millimetre above the base
    small = solid((-0.01, 0.01), (-0.01, 0.01), (-0.01, 0.01))
    parts = {**PALM, **FINGERS, "tool": small, "base": small + np.array([-0.4, 0.0, -0.2205])}
    assert begins(0.5, 0.0, 0.0, 0.0, 0.03, robot=toy_robot(parts, home=np.array(turned))) == []
    assert len(begins(0.5, 0.0, 0.0, 0.0, 0.03, robot=toy_robot(parts))) == 1
