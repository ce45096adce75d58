"""Cans that lie: they are held across their axis, moved, and put down lying; and nothing is proved of them that was not looked at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kinematics.robots.load import load, to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, Scene
from kinematics.shapes import Cylinder
from kinematics.transforms import rotation_about, transform
from planning.grasping.candidates import closing_directions
from planning.motion.checking.verify import verify
from planning.motion.handling.carry import Done
from planning.motion.handling.object_grasps import can_be_exhaustive, sampled_grasps
from planning.motion.pick_place import Motions
from planning.verdict import judge_grasp, judge_motions

RADIUS_M = 0.033
YAWS = (0.0, 0.4, 1.3, 2.9)


def lying(yaw: float, at: tuple[float, float] = (0.55, 0.05), radius_m: float = RADIUS_M, name: str = "can") -> Body:
    """A can on the floor of `cabinet`, its axis along a yaw (rad)."""
    R = rotation_about((0.0, 0.0, 1.0), yaw) @ rotation_about((0.0, 1.0, 0.0), np.pi / 2)
    return Body(name, Cylinder(radius_m, 0.10), transform(R, [*at, 0.10 + radius_m]))


def scene(robot: Robot, *bodies: Body) -> Scene:
    cabinet = Cabinet(np.array([0.56, 0.86, 0.5]), transform(p=[0.30, 0.0, 0.10]), 0.03)
    return Scene("lying", to_ref(robot), cabinet, bodies, bodies[0].name, None)


@pytest.mark.parametrize("yaw", YAWS)
def test_fingers_close_across_the_axis_and_along_it(yaw: float) -> None:
    body = lying(yaw)
    assert np.allclose(closing_directions(body.shape, body.T_world_body), sorted(y % np.pi for y in (yaw, yaw + np.pi / 2)), atol=1e-6)


@pytest.mark.parametrize("yaw", YAWS)
@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_it_is_held_from_above_with_room_behind_the_pads(name: str, yaw: float) -> None:
    robot = load(name)
    one = scene(robot, lying(yaw))
    grasps = list(sampled_grasps(robot, one, "can", one.objects[0].T_world_body))
    good = [grasp for grasp in grasps if judge_grasp(robot, one, grasp) is None]
    assert any(grasp.T_world_hand[2, 2] < -0.99 for grasp in good), "none from above"
    for grasp in grasps:
        assert grasp.width_m == pytest.approx(
            2 * RADIUS_M if abs(grasp.T_world_hand[:3, 1] @ one.objects[0].T_world_body[:3, 2]) < 0.5 else 0.10
        )


def test_beside_its_middle_too_for_where_something_stands_there(ur5e: Robot) -> None:
    one = scene(ur5e, lying(0.4))
    T, along = one.objects[0].T_world_body, set[float]()
    for grasp in sampled_grasps(ur5e, one, "can", T):
        if grasp.T_world_hand[2, 2] < -0.99 and judge_grasp(ur5e, one, grasp) is None:
            along.add(round(float((grasp.T_world_hand[:3, 3] - T[:3, 3]) @ T[:3, 2]), 3))
    assert along == {0.0, 0.025, -0.025}


def test_one_too_thick_for_the_fingers_is_not_held(ur5e: Robot) -> None:
    one = scene(ur5e, lying(0.4, radius_m=0.045))
    assert not list(sampled_grasps(ur5e, one, "can", one.objects[0].T_world_body))


@pytest.mark.parametrize("yaw", YAWS)
def test_it_is_moved_and_put_down_lying(ur5e: Robot, yaw: float) -> None:
    two = scene(ur5e, replace(lying(0.0, (0.7, -0.2)), name="target"), lying(yaw))
    motions, rng = Motions(ur5e, two), np.random.default_rng(0)
    state = motions.start()
    found = (motions.relocate(state, "can", region, rng) for region in range(15, 100, 7))
    done = next(d for d in found if isinstance(d, Done))
    way = motions.trajectories(state, done.motions)
    assert judge_motions(two, way, ur5e) == ()
    assert verify(ur5e, two, way) is None
    assert abs(done.after.poses["can"][2, 2]) < 1e-6
    assert done.after.poses["can"][2, 3] == pytest.approx(0.10 + RADIUS_M, abs=5e-4)


def test_nothing_is_proved_of_what_lies(ur5e: Robot) -> None:
    """All hands that hold an upright can are gone through; those that hold a lying one are not."""
    upright = Body("can", Cylinder(RADIUS_M, 0.10), transform(p=[0.55, 0.05, 0.15]))
    assert can_be_exhaustive(ur5e, scene(ur5e, upright))
    assert Motions(ur5e, scene(ur5e, upright)).finest is not None
    assert not can_be_exhaustive(ur5e, scene(ur5e, lying(0.3)))
    assert Motions(ur5e, scene(ur5e, lying(0.3))).finest is None
