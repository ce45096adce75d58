"""What blocks which way to what, held against the picks that motion planning itself finds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, Grasp, RobotRef, Scene, State
from kinematics.shapes import Box, Cylinder
from kinematics.transforms import rotation_about, transform
from planning.motion.handling.carry import Done
from planning.motion.handling.picking import THOROUGH, Picking
from planning.motion.handling.spots import SpotQueries, Spots
from planning.motion.pick_place import Motions
from planning.policies.unsolvable import Finding, Prover
from planning.relaxed_plan import relaxed_plan, stuck_set
from planning.scenes.generation import generate, load_spec

LEVEL = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])  # the hand looks into the cabinet, its x up
UP = (0.0, 0.0, 1.0)


@pytest.mark.parametrize("spec", ["paper", "paper-any", "shelf"])
def test_an_object_is_free_just_when_it_can_be_picked(ur5e: Robot, spec: str) -> None:
    """Among any of the others, from where they stand or anywhere else: the same as the picks, quick and thorough."""
    rng, answers = np.random.default_rng(5), []
    for index in range(2):
        scene = generate(load_spec(spec), ur5e, to_ref(ur5e), 31, index)
        motions = Motions(ur5e, scene)
        first = motions.start().poses
        for _ in range(4):
            poses = {name: T for name, T in first.items() if name == scene.target or rng.random() < 0.7}
            moved = next((name for name in poses if name != scene.target), None)
            if moved and rng.random() < 0.6:
                poses[moved] = motions.place_pose(moved, poses[moved], int(rng.integers(100)))
            view, standing = motions.obstructions(poses), frozenset(poses) - {scene.target_name}
            for name in poses:
                rest = {other: T for other, T in poses.items() if other != name}
                if name == scene.target:
                    picks = motions.picks(State(motions.start().q, poses), name, motions.target_grasps)[0]
                else:
                    picks = motions.picks(State(motions.start().q, poses), name)[0]
                assert view.free(name, standing - {name}) == bool(picks), (scene.id, name, sorted(rest))
                answers.append(bool(picks))
                if picks:  # what can be picked quickly can be picked thoroughly
                    assert motions.thorough.obstructions(poses).free(name, standing - {name})
    assert 5 < sum(answers) < len(answers) - 5


@pytest.mark.parametrize("spec", ["paper-any", "shelf"])
def test_moving_fingers_meet_only_what_the_open_or_the_closed_hand_meets(ur5e: Robot, spec: str) -> None:
    """So labels need not ask what they meet on their way."""
    scene, answers = generate(load_spec(spec), ur5e, to_ref(ur5e), 31, 4), []
    motions, standing = Motions(ur5e, scene), frozenset(scene.poses()) - {scene.target_name}
    whole, without = (motions.obstructions(scene.poses(), fingers=fingers) for fingers in (True, False))
    for name in scene.poses():
        ways = [[w.approach.tobytes() for w in view.free_ways(name, standing - {name})] for view in (whole, without)]
        assert ways[0] == ways[1]
        answers += ways[0]
    assert len(answers) > 20


def test_blockers_are_the_smallest_sets_without_which_it_is_free(ur5e: Robot) -> None:
    for index in range(3):
        scene = generate(load_spec("paper"), ur5e, to_ref(ur5e), 31, index)
        motions = Motions(ur5e, scene)
        view = motions.obstructions(scene.poses())
        standing = frozenset(scene.poses()) - {scene.target_name}
        sets = view.blockers(scene.target_name, standing)
        assert sets
        assert all(sets)  # a generated scene is blocked
        for blockers in sets:
            assert view.free(scene.target_name, standing - blockers)
            assert all(not view.free(scene.target_name, standing - (blockers - {name})) for name in blockers)
            assert not any(other < blockers for other in sets)


def test_an_object_elsewhere_in_the_hand_is_packed_as_if_for_the_first_time(ur5e: Robot) -> None:
    scene = generate(load_spec("paper-any"), ur5e, to_ref(ur5e), 31, 0)
    cell, (name, *_) = Motions(ur5e, scene).cell, scene.poses()
    closed = ur5e.opening.closing_value(0.05)
    grips = [transform(rotation_about((0.3, 0.5, 0.8), turn), [0.0, 0.01 * turn, 0.02]) for turn in (0.0, 1.0, 2.5)]
    queries = SpotQueries(cell, Spots())
    for T in grips:
        again, first = queries.lifting(name, closed, T), SpotQueries(cell, Spots()).lifting(name, closed, T)
        for a, b in zip(again[1:], first[1:], strict=True):
            assert np.array_equal(a, b)
    assert not np.array_equal(queries.lifting(name, closed, grips[0]).reach, queries.lifting(name, closed, grips[1]).reach)


def shelf(*objects: Body, approaches: Sequence[str] = ("horizontal",)) -> Scene:
    """A can at the back of a low cabinet, to be taken straight from the front, and what stands before it."""
    cabinet = Cabinet(np.array([0.56, 0.86, 0.35]), transform(p=[0.35, 0.0, 0.25]), 0.03)
    can = Body("can", Cylinder(0.03, 0.14), transform(p=[0.62, 0.0, 0.32]))
    grasp = Grasp(transform(LEVEL, [0.62, 0.0, 0.33]), 0.06)
    return Scene("shelf", RobotRef(np.eye(4), "ur5e"), cabinet, (can, *objects), "can", grasp, approaches=tuple(approaches))


def pitched(scene: Scene, robot: Robot) -> Scene:
    """The same with the pads' centre at the grasp, whatever the finger's length."""
    T = scene.x_g.T_world_hand.copy()
    T[0, 3] -= robot.opening.pad_z_at(scene.x_g.width_m)
    return replace(scene, grasp=Grasp(T, scene.x_g.width_m))


def block(name: str, x: float, y: float, size: Sequence[float], yaw: float = 0.0) -> Body:
    return Body(name, Box(np.array(size)), transform(rotation_about(UP, yaw), [x, y, 0.25 + size[2] / 2]))


def test_a_box_that_no_hand_can_take_proves_that_no_move_helps(ur5e: Robot) -> None:
    """A box wider than the gripper opens stands before the target; a can beside it is in nobody's way."""
    scene = pitched(shelf(block("box", 0.50, 0.0, [0.12, 0.2, 0.2]), block("tin", 0.5, 0.3, [0.05, 0.05, 0.1])), ur5e)
    motions = Motions(ur5e, scene)
    state = motions.start()
    view, standing = motions.obstructions(state.poses), frozenset({"box", "tin"})
    assert relaxed_plan(view, "can", standing) is None
    assert stuck_set(view, standing) == {"box"}
    proof = Prover(motions)(state).unsolvable
    assert proof is not None
    assert proof.stuck == ("box",)
    assert "box taken away by hand" in proof.would_help
    assert not any("tin" in words for words in proof.would_help)


def test_no_proof_where_a_move_helps(ur5e: Robot) -> None:
    scene = pitched(shelf(block("box", 0.50, 0.0, [0.06, 0.06, 0.2])), ur5e)
    motions = Motions(ur5e, scene)
    state = motions.start()
    plan = relaxed_plan(motions.obstructions(state.poses), "can", frozenset({"box"}))
    assert plan is not None
    assert plan.order == ("box",)
    assert Prover(motions)(state) == Finding()
    free = State(state.q, {"can": state.poses["can"]})
    assert isinstance(motions.retrieve_target(free, np.random.default_rng(0)), Done)


def test_a_thorough_look_samples_more_grasps(ur5e: Robot) -> None:
    scene = pitched(shelf(block("box", 0.50, 0.0, [0.06, 0.06, 0.2])), ur5e)
    motions = Motions(ur5e, scene)
    poses = scene.poses()
    quick, thorough = (len(list(picking.grasps(poses, "can"))) for picking in (motions._picking, Picking(motions.cell, THOROUGH)))
    assert thorough > 3 * quick
