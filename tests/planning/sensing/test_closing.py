"""Fingers that close until they meet the true object: a stranger says that they hold it, and a push is what it must be."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import sampled_hold as stranger

from kinematics.quintic_spline import hermite
from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.shapes import Box, Cylinder, Shape
from kinematics.transforms import Array, inverse, rotation_about, transform
from planning.library import plan_scene
from planning.motion.trajectory import FURTHER_M
from planning.plan import GripperState, Motion
from planning.scenes.generation import generate, load_spec
from planning.sensing.closing import close_on, with_fingers
from planning.sensing.world import SimulatedWorld
from planning.verdict import judge
from planning.verdict.grasp import closing_value
from planning.verdict.hand import hand_of
from planning.verdict.polyhedra import polyhedra

UPRIGHT = rotation_about((0.0, 1.0, 0.0), np.pi / 2)  # in a level hand: the body's axis along the hand's x


def described(shape: Shape) -> dict[str, Any]:
    if isinstance(shape, Box):
        return {"type": "box", "size_m": list(shape.size_m)}
    assert isinstance(shape, Cylinder)
    return {"type": "cylinder", "radius_m": shape.radius_m, "height_m": shape.height_m}


def test_what_they_close_on_is_held_and_ends_in_the_middle(ur5e: Robot) -> None:
    rng, hand, gripper = np.random.default_rng(7), hand_of(ur5e), stranger.gripper(ur5e.urdf, "finger_joint")
    for i in range(12):
        half, aside = rng.uniform(0.012, 0.035), rng.uniform(-0.0015, 0.0015)
        shape = Box(np.array([0.05, 2 * half, 0.12])) if i % 2 else Cylinder(float(half), 0.12)
        T = transform(UPRIGHT, [rng.uniform(-0.02, 0.02), aside, rng.uniform(-0.003, 0.003)])
        thought = 2 * half + rng.uniform(0.0, 0.003)
        opened, told = (closing_value(hand, float(w)) for w in (thought + 0.006, thought - FURTHER_M))
        closed = close_on(hand, polyhedra(shape), T, opened, told)
        assert closed is not None
        assert opened < closed.value < told  # they are stopped by it: the joint of this gripper rises as it closes
        assert closed.pushed_m == pytest.approx(-aside, abs=2e-5)
        assert stranger.hold(described(shape), closed.T_hand_body, gripper.hulls(closed.value), whole_hand=False) == stranger.HOLDS
        # nothing else moves than along the line on which they close
        np.testing.assert_allclose(closed.T_hand_body, transform(p=[0, closed.pushed_m, 0]) @ T, atol=1e-12)


def test_what_is_slimmer_than_they_go_is_not_held(ur5e: Robot) -> None:
    """They stop as far as they are told to; one of them pushes what stands in its way."""
    hand, slim = hand_of(ur5e), Box(np.array([0.05, 0.030, 0.12]))
    opened, told = closing_value(hand, 0.06), closing_value(hand, 0.04)
    for aside, pushed in ((0.0, 0.0), (0.008, -0.003), (-0.008, 0.003)):
        closed = close_on(hand, polyhedra(slim), transform(UPRIGHT, [0.0, aside, 0.0]), opened, told)
        assert closed is not None
        assert closed.value == told
        assert closed.pushed_m == pytest.approx(pushed, abs=2e-5)


def test_nothing_between_them_is_nothing(ur5e: Robot) -> None:
    hand, box = hand_of(ur5e), polyhedra(Box(np.array([0.05, 0.05, 0.12])))
    opened, told = closing_value(hand, 0.06), closing_value(hand, 0.044)
    assert close_on(hand, box, transform(UPRIGHT, [0.0, 0.0, 0.3]), opened, told) is None  # far ahead
    assert close_on(hand, box, transform(UPRIGHT, [0.0, 0.01, 0.0]), opened, told) is None  # a finger is in it from the start


def test_fingers_that_go_further_take_longer() -> None:
    """Velocities and accelerations stay what they were at most, and the spline goes where it is said to."""
    t, rows = np.array([0.0, 0.5, 1.0]), np.array([[0.0, 1.0, 7.0], [0.5, 1.0, 7.0], [1.0, 1.0, 7.0]])
    qd, qdd = np.array([[0.0, 0, 0], [1.6, 0, 0], [0.0, 0, 0]]), np.zeros((3, 3))
    motion = Motion("grasp", ("finger", "a", "b"), rows, t, qd=qd, qdd=qdd)
    for first, last in ((0.0, 1.3), (0.0, 0.7), (0.2, 1.0), (1.0, -0.5)):
        moved = with_fingers(motion, 0, first, last)
        assert moved.q[0, 0] == pytest.approx(first)
        assert moved.q[-1, 0] == last
        np.testing.assert_array_equal(moved.q[:, 1:], rows[:, 1:])
        assert moved.qd is not None
        assert np.abs(moved.qd).max() <= 1.6 + 1e-12
        spline = hermite(moved.t_s, moved.q, moved.qd, np.zeros((3, 3)))
        was = hermite(t, rows, qd, qdd)
        scaled = (spline.control[..., 0] - first) / (last - first)
        np.testing.assert_allclose(scaled, was.control[..., 0], atol=1e-12)
    assert with_fingers(motion, 0, 0.0, 1.0) is motion


def test_a_plan_on_what_was_seen_holds_on_what_is_there(ur5e: Robot) -> None:
    """Every object is seen 1.5 mm too large on one side. Told to stop where it was seen the hand would hold nothing."""
    truth = generate(load_spec("paper-any"), ur5e, to_ref(ur5e), 72, 0)
    seen = replace(truth, objects=tuple(replace(b, shape=_larger(b.shape), T_world_body=_beside(b), source="seen") for b in truth.objects))
    plan = plan_scene(seen, "local", robot=ur5e, grasp="any")
    assert plan.success, plan.reason
    names = {b.name: b.name for b in truth.objects}
    world = SimulatedWorld(ur5e, truth, np.random.default_rng(0))

    def on_the_truth(motions: tuple[Motion, ...]) -> list[str]:
        done = world.recorded(motions, names, truth.poses())
        return [fault.detail for fault in judge(truth, replace(plan, moves=(), motions=done), ur5e) if fault.stage == "grasp"]

    assert not on_the_truth(plan.motions)
    g = ur5e.gripper_joint
    for motion in world.recorded(plan.motions, names, truth.poses()):
        if motion.stage == "grasp":
            assert motion.gripper is not None
            assert motion.gripper.after.value == motion.q[-1, g]
            assert motion.gripper.after.command is not None

    def as_seen(told: GripperState) -> GripperState:
        return replace(told, width_m=ur5e.opening.width_at(told.value), command=None)

    untold = tuple(m if m.gripper is None else replace(m, gripper=replace(m.gripper, after=as_seen(m.gripper.after))) for m in plan.motions)
    assert all("stops" in detail for detail in on_the_truth(untold))
    assert on_the_truth(untold)


def _larger(shape: Shape) -> Shape:
    if isinstance(shape, Box):
        return Box(shape.size_m + np.array([0.0015, 0.0015, 0.0]))
    assert isinstance(shape, Cylinder)
    return Cylinder(shape.radius_m + 0.00075, shape.height_m)


def _beside(body: Any) -> Array:
    """The pose of a body that was seen 1.5 mm too large towards the cabinet's back."""
    T = np.array(body.T_world_body)
    step = 0.00075 * np.sign(T[:3, :2].T @ [1.0, 0.0, 0.0]) if isinstance(body.shape, Box) else np.array([0.00075, 0.0])
    return T @ transform(p=[*step, 0.0]) if isinstance(body.shape, Box) else inverse(transform(p=[-0.00075, 0, 0])) @ T
