"""A cabinet that leans, known from pictures alone: the loop sees it upright, and the world is as it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Scene
from kinematics.transforms import Array, inverse, rotation_about, transform
from planning import verify_plan
from planning.policies import make_policy
from planning.scenes.generation import generate, load_spec
from planning.sensing.retrieve import retrieve_unseen
from planning.sensing.settings import SensingSettings
from planning.sensing.turned_world import TurnedWorld
from planning.sensing.world import SimulatedWorld
from planning.upright import turned_box, turned_scene, upright_turn
from retrieve_cli.plan_job import Job
from retrieve_cli.plan_line import plan_scene

LEAN_DEG = 5.0


@pytest.fixture(scope="module")
def leaning(ur5e: Robot) -> Scene:
    level = generate(load_spec("paper-any"), ur5e, to_ref(ur5e), 71, 0)
    R, p = rotation_about((0.0, 1.0, 0.0), np.radians(LEAN_DEG)), level.cabinet.T_world_cabinet[:3, 3]
    return replace(turned_scene(level, transform(p=p) @ transform(R, -R @ p)), robot=level.robot)


@pytest.fixture(scope="module")
def turn(leaning: Scene) -> Array:
    T = upright_turn(leaning)
    assert T is not None
    return T


def test_where_the_camera_is_turns_along_and_nothing_else(ur5e: Robot, leaning: Scene, turn: Array) -> None:
    world = SimulatedWorld(ur5e, leaning, np.random.default_rng(0))
    turned = TurnedWorld(world, turn)
    seen, there = world.take_frame(), turned.take_frame()
    np.testing.assert_allclose(there.T_world_camera, turn @ seen.T_world_camera)
    np.testing.assert_array_equal(there.depth, seen.depth)
    assert turned.where() == world.where()
    upright = SimulatedWorld(ur5e, turned_scene(leaning, turn), np.random.default_rng(0)).take_frame()
    np.testing.assert_allclose(there.T_world_camera, upright.T_world_camera, atol=1e-12)
    np.testing.assert_allclose(there.depth, upright.depth, atol=1e-5)


def test_a_real_world_that_leans_is_cleared_as_an_upright_one(ur5e: Robot, leaning: Scene, turn: Array) -> None:
    """Nothing but frames and joints comes out of the world that leans; where things end in it, they stand on its floor."""
    world = SimulatedWorld(ur5e, leaning, np.random.default_rng(0), by="geometry")
    plan = retrieve_unseen(
        TurnedWorld(world, turn), ur5e, replace(turned_scene(leaning, turn), objects=()),
        lambda m, moves: make_policy("neural", m, max_moves=moves),
        sensing=SensingSettings(by=None), name="neural", rng=np.random.default_rng([0, 4, 0]),
    )  # fmt: skip
    assert plan.success, plan.reason
    assert not leaning.cabinet.contains(world.poses[leaning.target_name][:3, 3])
    T_cabinet_world = inverse(leaning.cabinet.T_world_cabinet)
    moved = [name for name, T in leaning.poses().items() if name != leaning.target_name and not np.allclose(T, world.poses[name])]
    assert moved
    for name in moved:
        before, after = T_cabinet_world @ leaning.poses()[name], T_cabinet_world @ world.poses[name]
        assert abs(after[2, 3] - before[2, 3]) < 1e-3
        assert after[2, 2] > np.cos(np.radians(0.2))


def test_plan_sense_in_a_leaning_cabinet_holds_in_it(leaning: Scene) -> None:
    plan = plan_scene(Job(None, sense=True), "leaning", leaning)
    assert plan.success, plan.reason
    assert plan.verified
    assert verify_plan(leaning, plan) == ()


def test_a_box_around_a_turned_box_holds_it() -> None:
    T = transform(rotation_about((0.0, 0.0, 1.0), np.pi / 2), np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(turned_box(np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]), T), [0.8, 0.1, 0.3, 0.5, 0.4, 0.6], atol=1e-12)
