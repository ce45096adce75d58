"""Hands that hold by an edge: the verdict calls the object held by each but for what palm and knuckles touch; and none is left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kinematics.robots.load import load
from kinematics.robots.robot import Robot
from kinematics.scene import APPROACHES, Body, Cabinet, Grasp, RobotRef, Scene
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape, box_corners
from kinematics.transforms import Array, rotation_about, transform
from planning.grasping.cup_grasps import grasps_on
from planning.grasping.hand_poses import level_across, level_hand
from planning.grasping.marginal_grasps import LEAST_M, SURELY_M, _Outline, _overlapping, lacks_m, marginal_grasps
from planning.grasping.pads import Pad, inner_pad_of, pad_of
from planning.grasping.sampling import DENSEST, USUAL, Sampling
from planning.motion.handling.neighbourhoods import SQUARE, STEPS_M
from planning.verdict import Settings, judge_grasp, judge_hold

CABINET = Cabinet(np.array([3.0, 3.0, 3.0]), transform(p=[-1.0, 0.0, 0.0]), 0.02)
FINEST = replace(DENSEST, steps_m=STEPS_M, beyond_m=SQUARE.moved_m)
PAD = Pad(0.010, -0.012, 0.020)
BOX, CAN = Box(np.array([0.05, 0.07, 0.14])), Cylinder(0.03, 0.14)


def on_floor(shape: Shape, height_m: float = 0.14, yaw: float = 0.3) -> Body:
    return Body("it", shape, transform(rotation_about((0, 0, 1), yaw), [0.5, 0.1, height_m / 2]))


@pytest.mark.parametrize("shape", [BOX, CAN], ids=["box", "can"])
@pytest.mark.parametrize("arm", ["ur5e", "gen3"])
def test_the_verdict_calls_it_held(shape: Shape, arm: str) -> None:
    """Whatever it says against some is that something other than the pads is in the way: that is not asked here, but by the planner. The
    pads of the one are rectangles, those of the other have round corners."""
    body, robot = on_floor(shape), load(arm)
    scene = Scene("s", RobotRef(np.eye(4), name=arm), CABINET, (body,), "it", None, 5)
    grasps = list(marginal_grasps(body, robot.opening, APPROACHES, 0.2, DENSEST, inner_pad_of(robot)))
    said = [judge_grasp(robot, scene, grasp) or "held" for grasp in grasps[:: len(grasps) // 150]]
    assert {words for words in said if " would " not in words} == {"held"}
    assert said.count("held") > 30


def test_they_reach_over_the_top_and_deeper_than_the_middle_and_before_it(ur5e: Robot) -> None:
    body = on_floor(BOX, yaw=0.0)
    middles = []
    for grasp in marginal_grasps(body, ur5e.opening, ("horizontal",), 0.0, DENSEST, pad_of(ur5e)):
        if grasp.T_world_hand[0, 2] > 0.99:  # which look along x
            middles.append((grasp.T_world_hand @ [*ur5e.opening.middle(grasp.width_m), 1.0])[:3] - body.T_world_body[:3, 3])
    low, high = np.min(middles, axis=0), np.max(middles, axis=0)
    assert low[0] < -0.025
    assert high[0] > 0.025
    assert high[2] > 0.07
    assert np.abs([low[1], high[1]]).max() < 1e-9


@pytest.mark.parametrize("pitch", [0.0, 0.5, 1.0, np.pi / 2])
def test_pads_overlap_by_a_square_just_where_they_are_said_to(pitch: float) -> None:
    """Squares all over the pad, and whether one of them lies in the outline: so it is nearly everywhere that is said, and nowhere else."""
    outline, R = _Outline(0.03, 0.06, 0.05), level_hand(np.array([1.0, 0.0, 0.0]), pitch)
    x_axis, z_axis = R[[0, 2]][:, 0], R[[0, 2]][:, 2]
    xs = np.linspace(-PAD.half_x_m, PAD.half_x_m - LEAST_M, 33)
    zs = np.linspace(PAD.low_z_m, PAD.high_z_m - LEAST_M, 57)
    corners = np.array([i * LEAST_M * x_axis + k * LEAST_M * z_axis for i in (0, 1) for k in (0, 1)])
    squares = np.array([x * x_axis + z * z_axis + corner for x in xs for z in zs for corner in corners]).reshape(-1, 4, 2)

    def holds(at: Array, spare_m: float) -> bool:
        return bool((np.abs(at + squares) <= np.array([outline.ahead_m, outline.up_m]) + spare_m).all((1, 2)).any())

    said = _overlapping(outline, pitch, (0.004, 0.004), PAD, 0.0)
    assert all(holds(at, 1e-3) for at in said)
    some = np.random.default_rng(1).uniform(-0.09, 0.09, (300, 2))
    for at in some[[holds(at, 0.0) for at in some]]:
        assert np.abs(said - at).max(1).min() <= 0.004 + 1e-9


@pytest.mark.parametrize("sampling", [DENSEST, FINEST])
def test_steps_are_as_fine_as_is_asked(sampling: Sampling) -> None:
    steps = sampling.steps_m
    assert steps is not None
    for values, step in zip(_overlapping(_Outline(0.03, 0.06, 0.05), 0.0, steps, PAD, sampling.beyond_m).T, steps):
        assert step / 2 < np.diff(np.unique(np.round(values, 9))).max() <= step + 1e-9


def test_there_are_none_on_what_lies_or_is_a_mesh_or_too_wide_nor_where_none_are_asked_for(ur5e: Robot) -> None:
    def some(body: Body, sampling: Sampling = DENSEST) -> bool:
        return next(marginal_grasps(body, ur5e.opening, APPROACHES, 0.0, sampling, pad_of(ur5e)), None) is not None

    lying = Body("it", CAN, transform(rotation_about((1, 0, 0), np.pi / 2), [0.5, 0.0, 0.03]))
    assert some(on_floor(CAN))
    assert not some(lying)
    assert not some(on_floor(ConvexMesh((box_corners(BOX.half),))))
    assert not some(on_floor(Cylinder(0.06, 0.14)))
    assert not some(on_floor(CAN), USUAL)
    assert not some(on_floor(Box(np.array([0.05, 0.05, 0.002])), 0.002))


def test_an_arm_of_few_joints_looks_as_it_has_to(ur5e: Robot) -> None:
    """Here: straight away from the origin, whichever way it is asked for."""
    body = on_floor(CAN)

    def headings(T: Array, width_m: float) -> list[Array]:
        at = np.array([*T[:2, 3], 0.0])
        return [level_hand(at / np.linalg.norm(at), 0.0)]

    sampling = replace(DENSEST, steps_m=(0.01, 0.03))
    grasps = list(marginal_grasps(body, ur5e.opening, ("horizontal",), 0.0, sampling, pad_of(ur5e), headings))
    assert len(grasps) > 10
    for grasp in grasps:
        R, middle = grasp.T_world_hand[:3, :3], (grasp.T_world_hand @ [*ur5e.opening.middle(grasp.width_m), 1.0])[:3]
        assert abs(R[:, 1] @ (middle - body.T_world_body[:3, 3])) < 1e-9
        assert R[:2, 2] @ middle[:2] == pytest.approx(np.linalg.norm(middle[:2]), abs=1e-12)


@pytest.mark.parametrize(("sampling", "beyond"), [(DENSEST, False), (FINEST, True)])
@pytest.mark.parametrize("kind", APPROACHES)
def test_pads_meet_a_can_with_their_faces_but_for_proofs(ur5e: Robot, kind: str, sampling: Sampling, beyond: bool) -> None:
    """A line beyond the pads' ends is held, but by friction alone: plans don't rely on it, and proofs have to."""
    pad, can, outside = pad_of(ur5e), on_floor(CAN), 0
    line = can.T_world_body[:3, 3] + np.outer(np.linspace(-CAN.height_m / 2, CAN.height_m / 2, 400), [0.0, 0.0, 1.0])
    fewer = replace(sampling, yaws=2)  # all round a can they are the same
    for grasp in marginal_grasps(can, ur5e.opening, (kind,), 0.0, fewer, pad):
        x, _, z = ((line - (grasp.T_world_hand @ [*ur5e.opening.middle(grasp.width_m), 1.0])[:3]) @ grasp.T_world_hand[:3, :3]).T
        met = (np.abs(x) <= pad.half_x_m) & (pad.low_z_m <= z) & (z <= pad.high_z_m)
        outside += not met.any()
    assert (outside > 0) == beyond


def test_the_most_overlap_comes_first() -> None:
    at = _overlapping(_Outline(0.03, 0.06, 0.05), 0.0, (0.01, 0.006), PAD, 0.0)
    assert np.abs(at[0]).max() < 0.01
    assert np.abs(at[-1]).max() > 0.03


@pytest.mark.parametrize("shape", [BOX, CAN], ids=["box", "can"])
def test_no_hand_that_lacks_something_holds_and_what_lacks_is_how_far_it_is_off(shape: Shape, ur5e: Robot) -> None:
    """Hands moved at random from those that hold: what each lacks is no more than it was moved by, and the verdict calls none held that
    lacks something."""
    body, pad, rng = on_floor(shape), pad_of(ur5e), np.random.default_rng(3)
    grasps = [*marginal_grasps(body, ur5e.opening, APPROACHES, 0.2, DENSEST, pad)]
    assert pytest.approx(Settings().overlap_m * 2**0.5 / 3) == SURELY_M
    lacking = 0
    for grasp in [grasps[i] for i in rng.integers(len(grasps), size=600)]:
        assert lacks_m(body, ur5e.opening, pad, grasp) == 0.0
        ahead, by = level_across(grasp.T_world_hand[:3, 1]), rng.uniform(-0.02, 0.02, 2)
        moved = replace(grasp, T_world_hand=transform(p=by[0] * ahead + by[1] * np.array([0.0, 0.0, 1.0])) @ grasp.T_world_hand)
        lacks = lacks_m(body, ur5e.opening, pad, moved)
        assert lacks <= np.linalg.norm(by) + 1e-9
        if lacks > 0.0:
            lacking += 1
            assert judge_hold(ur5e, body, moved) is not None
    assert lacking > 20


def test_of_what_lies_it_is_not_said_what_a_hand_lacks(ur5e: Robot) -> None:
    lying = Body("it", CAN, transform(rotation_about((1, 0, 0), np.pi / 2), [0.5, 0.0, 0.03]))
    far = Grasp(transform(p=[9.0, 0.0, 0.0]), 0.05)
    assert lacks_m(lying, ur5e.opening, PAD, far) == 0.0
    assert lacks_m(on_floor(CAN), ur5e.opening, PAD, far) > 8.0


def test_they_come_after_all_others(ur5e: Robot) -> None:
    body = on_floor(CAN)
    plain = [g.T_world_hand for g in grasps_on(body, ur5e, ("horizontal",), 0.0, 0.0, replace(DENSEST, steps_m=None))]
    both = [g.T_world_hand for g in grasps_on(body, ur5e, ("horizontal",), 0.0, 0.0, DENSEST)]
    assert len(both) > len(plain)
    assert np.array_equal(both[: len(plain)], plain)
