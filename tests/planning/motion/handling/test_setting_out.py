"""Where motions set out from: ends of straight pieces keep the margin that a search asks for, fingers are set where there is room."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Grasp, Scene, State
from kinematics.shapes import Box, Cylinder
from kinematics.transforms import transform
from planning.motion.checking.verify import verify
from planning.motion.handling.carry import Done, opening_blocked
from planning.motion.pick_place import Motions
from planning.scenes.generation import generate, load_spec

LEVEL = np.stack([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]], 1)
"""A hand that looks ahead, its x up."""


@pytest.fixture(scope="module")
def alone(ur5e: Robot) -> Scene:
    """A can in an empty cabinet, a target far from it."""
    scene = generate(load_spec("paper"), ur5e, to_ref(ur5e), 23, 0)
    floor_z = float(scene.cabinet.T_world_cabinet[2, 3])
    can = Body("can", Cylinder(0.03, 0.16), transform(p=[0.5, 0.1, floor_z + 0.08]))
    far = Body("far", Cylinder(0.03, 0.12), transform(p=[0.75, -0.2, floor_z + 0.06]))
    return replace(scene, objects=(can, far), target="far", grasp=None, grasps=())


def with_plate(scene: Scene, bottom_z: float) -> Scene:
    """A plate above the can, at a height."""
    x, y = scene.body("can").T_world_body[:2, 3]
    plate = Body("plate", Box(np.array([0.3, 0.2, 0.01])), transform(p=[x - 0.1, y, bottom_z + 0.005]))
    return replace(scene, obstacles=(plate,))


def lifts(scene: Scene, ur5e: Robot) -> list[bool]:
    """For each pick by one grasp on the can, whether a search may begin where its lift ends."""
    motions = Motions(ur5e, scene)
    state, can = motions.start(), scene.body("can").T_world_body
    grasp = Grasp(transform(LEVEL, can[:3, 3] + [0.0, 0.0, 0.02]), 0.06)
    picks, _ = motions._picking.picks_with([grasp], state.poses, {"far": state.poses["far"]}, "can", ur5e.arm_q(state.q))
    return [motions.cell.touch(pick.carrying, pick.lift[-1]) is None for pick in picks]


def test_no_lift_ends_nearer_to_anything_than_a_search_may_begin(alone: Scene, ur5e: Robot) -> None:
    """A plate is lowered onto what is lifted below it, by a tenth of the margin at a time."""
    low, high = 0.25, 0.75
    for _ in range(16):
        middle = (low + high) / 2
        low, high = (low, middle) if lifts(with_plate(alone, middle), ur5e) else (middle, high)
    free = [lifts(with_plate(alone, high + step), ur5e) for step in np.arange(-6e-4, 6e-4, 5e-5)]
    assert all(all(picks) for picks in free)
    assert {bool(picks) for picks in free} == {True, False}


def test_fingers_that_have_no_room_to_open_are_set_at_the_end(alone: Scene, ur5e: Robot) -> None:
    motions = Motions(ur5e, alone)
    start = motions.start()
    closed = State(ur5e.with_arm(ur5e.arm_q(start.q), ur5e.opening.closing_value(0.02)), start.poses)
    hand = ur5e.link_poses(closed.q)["hand"]
    T = alone.robot.T_world_base @ hand
    pick = motions.picks(start, "can")[0][0]
    for gap in np.arange(0.04, 0.09, 0.002):
        sides = [Body(f"side_{i}", Box(np.array([0.04, 0.004, 0.04])), T @ transform(p=[0.0, s * gap, 0.0])) for i, s in enumerate((1, -1))]
        scene = replace(alone, obstacles=tuple(sides))
        motions = Motions(ur5e, scene)
        at_first = motions.cell.problem(closed.poses, float(closed.q[ur5e.gripper_joint]))
        if motions.cell.touch(at_first, ur5e.arm_q(closed.q)) is None and opening_blocked(motions.cell, closed, ur5e.arm_q(closed.q), pick):
            break
    else:
        pytest.fail("the fingers always have room, or never")
    done = next(d for region in range(100) if isinstance(d := motions.relocate(closed, "can", region, np.random.default_rng(0)), Done))
    first, second, third = done.motions[:3]
    assert (first.stage, second.stage, third.stage) == ("transit", "transit", "approach")
    g = ur5e.gripper_joint
    assert np.ptp(first.q[:, g]) == 0
    assert first.q[0, g] == closed.q[g]
    assert np.ptp(ur5e.arm_q(second.q), axis=0).max() == 0
    assert second.q[-1, g] == pytest.approx(third.q[0, g])
    assert verify(ur5e, scene, motions.trajectories(closed, done.motions), max_tilt_deg=30) is None
    ((_, quick),) = motions.quickest([(closed, done)], np.random.default_rng(1))
    assert verify(ur5e, scene, motions.trajectories(closed, quick.motions), max_tilt_deg=30) is None
