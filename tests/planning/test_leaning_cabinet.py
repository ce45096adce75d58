"""A cabinet that leans: scene and robot are turned until it does not, planned in, and the plan is turned back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Scene
from kinematics.transforms import rotation_about, transform
from planning import plan_scene, verify_plan
from planning.conclusion import judged_again
from planning.motion.settings import DEFAULTS
from planning.scenes.generation import generate, load_spec
from planning.target_grasps.proposals import propose
from planning.upright import LEVEL_DEG, more_upright, turned_plan, turned_scene, upright, upright_turn
from planning.verdict import judge_grasp


@pytest.fixture(scope="module")
def level(ur5e: Robot) -> Scene:
    return generate(load_spec("paper"), ur5e, to_ref(ur5e), 31, 0)


def leaning(scene: Scene, degrees: float, axis: tuple[float, float, float]) -> Scene:
    """All but the robot turned about the cabinet's origin."""
    R, p = rotation_about(axis, np.radians(degrees)), scene.cabinet.T_world_cabinet[:3, 3]
    return replace(turned_scene(scene, transform(p=p) @ transform(R, -R @ p)), robot=scene.robot)


@pytest.mark.parametrize(("degrees", "axis"), [(5.0, (0.0, 1.0, 0.0)), (-3.0, (1.0, 0.0, 0.0)), (12.0, (0.6, 0.8, 0.0))])
def test_a_leaning_cabinet_is_turned_upright(level: Scene, degrees: float, axis: tuple[float, float, float]) -> None:
    scene = leaning(level, degrees, axis)
    T = upright_turn(scene)
    assert T is not None
    stood = turned_scene(scene, T)
    for before, after in zip((level.cabinet, *level.objects), (stood.cabinet, *stood.objects)):
        name = "T_world_body" if hasattr(before, "T_world_body") else "T_world_cabinet"
        np.testing.assert_allclose(getattr(after, name), getattr(before, name), atol=1e-12)
    np.testing.assert_allclose(np.linalg.inv(T) @ stood.robot.T_world_base, scene.robot.T_world_base, atol=1e-12)


def test_a_level_one_is_left_alone(level: Scene) -> None:
    assert upright_turn(level) is None
    assert upright_turn(leaning(level, 0.9 * LEVEL_DEG, (1.0, 0.0, 0.0))) is None
    assert upright_turn(leaning(level, 30.0, (0.0, 0.0, 1.0))) is None
    assert upright_turn(leaning(level, 1.1 * LEVEL_DEG, (1.0, 0.0, 0.0))) is not None


@pytest.mark.parametrize("degrees", [2.0, 8.0])
def test_what_is_moved_in_a_leaning_cabinet_stands_on_its_floor(level: Scene, degrees: float) -> None:
    """The verdict in the scene as it is finds nothing, and the plan's poses are told there."""
    scene = leaning(level, degrees, (0.0, 1.0, 0.0))
    plan = plan_scene(scene, "lookahead")
    assert plan.success
    assert plan.verified
    assert len(plan.moves) > 0
    assert verify_plan(scene, plan) == ()
    T = upright_turn(scene)
    assert T is not None
    assert verify_plan(scene, turned_plan(plan, T))  # told elsewhere they are false


@pytest.mark.parametrize(
    ("most", "lean", "left"), [(30.0, 5.0, 20.0), (30.0, 10.0, 10.0), (30.0, 15.0, 10.0), (180.0, 15.0, 180.0), (1.5, 5.0, 1.0)]
)
def test_what_is_carried_may_lean_by_less_where_all_was_turned(level: Scene, most: float, lean: float, left: float) -> None:
    """Twice the lean is what it may cost in the scene as it is; of an object's own limit, too."""
    first, *others = level.objects
    scene = replace(level, objects=(replace(first, max_tilt_deg=most), *others))
    upright, settings = more_upright(scene, replace(DEFAULTS, max_tilt_deg=most), lean)
    assert settings.max_tilt_deg == left
    assert [body.max_tilt_deg for body in upright.objects] == [left, *(body.max_tilt_deg for body in others)]


def test_what_is_planned_in_knows_what_it_was_made_of(level: Scene) -> None:
    scene = leaning(level, 4.0, (0.0, 1.0, 0.0))
    made = upright(scene, DEFAULTS)
    assert made.scene.cabinet.lean_deg < 1e-6
    assert made.settings.max_tilt_deg == pytest.approx(DEFAULTS.max_tilt_deg - 8.0)
    assert (made.as_it_is, made.as_they_are) == (scene, DEFAULTS)
    flat = upright(level, DEFAULTS)
    assert (flat.scene, flat.settings, flat.T_upright_world) == (level, DEFAULTS, None)


def test_grasps_are_proposed_by_the_cabinets_vertical(ur5e: Robot, level: Scene) -> None:
    scene = leaning(level, 10.0, (0.0, 1.0, 0.0))
    found = propose(ur5e, scene)
    assert len(found.grasps) > 3
    assert all(judge_grasp(ur5e, scene, grasp) is None for grasp, _ in found.grasps)


def test_the_scene_as_it_is_has_the_last_word(ur5e: Robot, level: Scene) -> None:
    """A plan of the level cabinet, said to be one of a leaning cabinet, has faults there and fails."""
    plan = plan_scene(level, "lookahead")
    again = judged_again(ur5e, leaning(level, 5.0, (0.0, 1.0, 0.0)), plan, DEFAULTS)
    assert plan.verified
    assert (again.success, again.verified) == (False, False)
    assert again.faults
    assert again.reason is not None
    assert again.reason.stage == "verify"
    assert again.value < plan.value
    kept = judged_again(ur5e, level, plan, DEFAULTS)
    assert (kept.success, kept.verified, kept.faults) == (True, True, ())
