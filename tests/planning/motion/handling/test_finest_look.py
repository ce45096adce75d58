"""The look that proofs rest on has as much more room as there is between two hands that it looks at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, RobotRef, Scene
from kinematics.shapes import Box, Cylinder
from kinematics.transforms import Array, inverse, rotation_about, transform
from planning.motion.handling.finest_look import SAMPLINGS, FinestLook, with_more_room
from planning.motion.settings import UNCONSTRAINED

UP = (0, 0, 1)
CABINET = Cabinet(np.array([0.5, 0.6, 0.4]), transform(rotation_about(UP, 0.3), [0.3, 0.1, 0.2]), 0.03)


def scene_of(*bodies: Body) -> Scene:
    return Scene("s", RobotRef(np.eye(4), "ur5e"), CABINET, bodies, bodies[0].name, None, approaches=("horizontal",))


def inside(body: Body, points: Array, by_m: float) -> Array:
    """Which of points (N, 3), world frame, are in a solid, and by so much from its surface."""
    p = (points - body.T_world_body[:3, 3]) @ body.T_world_body[:3, :3]
    if isinstance(body.shape, Cylinder):
        return (np.hypot(p[:, 0], p[:, 1]) <= body.shape.radius_m - by_m) & (np.abs(p[:, 2]) <= body.shape.height_m / 2 - by_m)
    return np.asarray((np.abs(p) <= body.shape.half - by_m).all(1))


def test_everything_is_further_from_any_point_by_as_much_as_is_asked() -> None:
    """What is in a solid of the roomier scene is in one of the scene, and so much from its surface, but where walls meet walls."""
    box = Body("b", Box(np.array([0.08, 0.05, 0.2])), CABINET.T_world_cabinet @ transform(p=[0.2, 0.0, 0.1]))
    can = Body("c", Cylinder(0.04, 0.1), transform(rotation_about((1, 0, 0), 0.7), [0.6, 0.2, 0.3]))
    scene, by_m = replace(scene_of(box, can), obstacles=(replace(box, name="post"),)), 0.004
    roomier = with_more_room(scene, by_m)
    points = np.random.default_rng(0).uniform([0.2, -0.4, 0.1], [1.0, 0.6, 0.7], (200_000, 3))
    for before, after in zip((*scene.objects, *scene.obstacles), (*roomier.objects, *roomier.obstacles)):
        assert np.array_equal(inside(after, points, 0.0), inside(before, points, by_m))
    solid = np.any([inside(wall, points, 0.0) for wall in roomier.cabinet.walls()], 0)
    in_cabinet = points @ inverse(CABINET.T_world_cabinet)[:3, :3].T + inverse(CABINET.T_world_cabinet)[:3, 3]
    low, high = np.array([0.0, -0.3, 0.0]), np.array([0.5, 0.3, 0.4])
    nearest = np.clip(in_cabinet, low, high)  # of the space that the walls enclose
    assert solid.sum() > 1000
    assert np.linalg.norm(in_cabinet - nearest, axis=1)[solid].min() > by_m - 1e-9


@pytest.mark.parametrize(("gap_m", "free"), [(0.01, False), (0.06, True)])
def test_what_is_tight_is_stuck_and_what_is_not_is_not(ur5e: Robot, gap_m: float, free: bool) -> None:
    """A tall box between two that reach as far: fingers need 3 cm on both sides."""
    cabinet = replace(CABINET, T_world_cabinet=transform(p=[0.35, 0.0, 0.0]))
    sizes = {"it": (0.06, 0.05, 0.38), "a": (0.3, 0.05, 0.38), "b": (0.3, 0.05, 0.38)}
    at = {"it": 0.0, "a": 0.05 + gap_m, "b": -0.05 - gap_m}
    bodies = (Body(n, Box(np.array(s)), cabinet.T_world_cabinet @ transform(p=[0.2, at[n], s[2] / 2])) for n, s in sizes.items())
    scene = replace(scene_of(*bodies), robot=RobotRef(transform(p=ur5e.base_p), "ur5e"), cabinet=cabinet)
    look = FinestLook(ur5e, scene, UNCONSTRAINED).obstructions(scene.poses())
    assert look.free("it", frozenset({"a", "b"})) == free


def test_the_room_is_what_lies_between_two_hands() -> None:
    """Any point is within half a step ahead and half a step up of the nearest."""
    for sampling in SAMPLINGS:
        assert sampling.steps_m is not None
        assert sampling.beyond_m == pytest.approx(np.hypot(*sampling.steps_m) / 2)
