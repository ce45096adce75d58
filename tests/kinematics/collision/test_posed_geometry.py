"""Posed geometry and its sphere models are the same however they were put together."""

from __future__ import annotations

import numpy as np
import pytest

from kinematics.collision.posed_geometry import GeometryModel, join_posed, make_geometry_model, several_times
from kinematics.collision.robot_model import link_covers, robot_collision_model, shape_geometry
from kinematics.collision.sphere_model import posed_sphere_model, with_more_parts
from kinematics.robots.load import load
from kinematics.robots.robot import Robot
from kinematics.shapes import Box, Cylinder, Shape
from kinematics.transforms import transform


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load("ur5e")


def same(a: object, b: object) -> bool:
    return np.asarray(a).dtype == np.asarray(b).dtype and np.array_equal(np.asarray(a), np.asarray(b))


@pytest.mark.parametrize("times", [1, 2, 7])
@pytest.mark.parametrize("covered", [True, False])
def test_pieces_several_times_are_those_of_hulls_repeated(robot: Robot, times: int, covered: bool) -> None:
    own = [i for i, hull in enumerate(robot.hulls) if hull.link in robot.fingers]

    def made(of: list[int]) -> GeometryModel:
        return make_geometry_model([robot.hulls[i].vertices for i in of], [link_covers(robot)[i] for i in of] if covered else [])

    assert all(map(same, several_times(made(own), times), made(own * times)))


@pytest.mark.parametrize("shape", [Box(np.array([0.05, 0.06, 0.2])), Cylinder(0.03, 0.15)])
def test_a_sphere_model_with_more_parts_is_that_of_all_parts(robot: Robot, shape: Shape) -> None:
    arm = robot_collision_model(robot, np.eye(4))
    posed, model = arm.packed(0.3)
    grip = arm.in_hand(shape_geometry(shape), transform(p=(0.0, 0.01, 0.02)))
    whole = join_posed(posed, grip)
    assert all(map(same, with_more_parts(arm.chain, model, whole, grip), posed_sphere_model(arm.chain, whole)))
