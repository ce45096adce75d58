"""Moves that are made quick: free by the last word, every object where it was, no slower than they were found, the same each time."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import State
from kinematics.transforms import Array
from planning.conclusion import hand_travel
from planning.motion import quickest
from planning.motion.checking.verify import verify
from planning.motion.handling.carry import Carry, Done
from planning.motion.pick_place import Motions
from planning.motion.polishing import polished
from planning.motion.quickest import _Graph
from planning.motion.settings import ClearanceSettings
from planning.motion.smoothing.blending import choose_speeds, make_corners
from planning.motion.smoothing.estimates import polyline_s, straight_s
from planning.motion.way_cost import WayCost
from planning.plan import Blocked, Motion
from planning.scenes.generation import generate, load_spec

Found = list[tuple[State, Done]]


@pytest.fixture(scope="module")
def found(ur5e: Robot) -> tuple[Motions, Found]:
    """Two moves that follow one another."""
    scene = generate(load_spec("paper"), ur5e, to_ref(ur5e), 91, 0)
    motions, rng = Motions(ur5e, scene), np.random.default_rng(0)
    state, out = motions.start(), []
    for name in (b.name for b in scene.objects if b.name != scene.target):
        tried = (motions.relocate(state, name, region, rng) for region in range(0, scene.regions_n**2, 7))
        if (done := next((d for d in tried if isinstance(d, Done)), None)) is not None:
            out.append((state, done))
            state = done.after
        if len(out) == 2:
            return motions, out
    pytest.fail("too little could be moved")


def _with_carry(move: tuple[State, Done]) -> tuple[State, Carry]:
    state, done = move
    assert done.carry is not None
    return state, done.carry


def free_s(ur5e: Robot, motions: list[Motion]) -> float:
    """Estimated seconds of the free motions."""
    return sum(polyline_s(ur5e.arm_q(m.q), ur5e.arm_limits) for m in motions if m.stage in ("transit", "transfer"))


def test_moves_stay_what_they_were_and_become_quicker(found: tuple[Motions, Found], ur5e: Robot) -> None:
    motions, before = found
    after = motions.quickest(before, np.random.default_rng(1))
    assert len(after) == len(before)
    ways = [[m for _, done in moves for m in done.motions] for moves in (before, after)]
    assert free_s(ur5e, ways[1]) < free_s(ur5e, ways[0]) + 1e-9
    for (_, old), (state, new) in zip(before, after):
        assert old.after.poses.keys() == new.after.poses.keys()
        assert all(np.abs(old.after.poses[name] - new.after.poses[name]).max() < 1e-9 for name in old.after.poses)
        assert np.array_equal(new.motions[0].q[0], state.q)
    assert all(np.array_equal(a.q[-1], b.q[0]) for a, b in pairwise(ways[1]))
    driven = [m for state, done in after for m in motions.trajectories(state, done.motions)]
    assert verify(ur5e, motions.scene, driven, max_tilt_deg=motions.settings.max_tilt_deg) is None
    again = motions.quickest(before, np.random.default_rng(1))
    assert all(np.array_equal(a.q, b.q) for (_, x), (_, y) in zip(after, again) for a, b in zip(x.motions, y.motions, strict=True))


def test_what_counts_is_the_way_to_other_objects_and_less_that_of_the_target(found: tuple[Motions, Found], ur5e: Robot) -> None:
    motions, before = found
    layers = _Graph(
        motions.cell, ur5e.arm_q(before[0][0].q), [motions._choices(*_with_carry(m)) for m in before], np.random.default_rng(0)
    ).layers
    assert [layer.cost.metre_s for layer in layers] == [motions.settings.quickest.metre_s] * 2
    target = replace(motions._choices(*_with_carry(before[0])), put=None)
    (layer,) = _Graph(motions.cell, ur5e.arm_q(before[0][0].q), [target], np.random.default_rng(0)).layers
    assert layer.cost.metre_s == motions.settings.quickest.target_metre_s < motions.settings.quickest.metre_s
    after = motions.quickest(before, np.random.default_rng(1))
    ways = [hand_travel(ur5e, motions.scene, [m for _, done in moves for m in done.motions]) for moves in (before, after)]
    assert ways[1] < ways[0]


def test_transits_on_which_the_fingers_cannot_be_set_are_not_used(found: tuple[Motions, Found], monkeypatch: pytest.MonkeyPatch) -> None:
    """Straight ones as well as planned ones: those that were found are all that is left."""
    motions, before = found
    start = motions.robot.arm_q(before[0][0].q)
    graph = _Graph(motions.cell, start, [motions._choices(*_with_carry(m)) for m in before], np.random.default_rng(0))
    monkeypatch.setattr(quickest, "setting_out", lambda *_: Blocked("transit"))
    left, found_ways = graph.planned, [layer.transit_s[0, 0] for layer in graph.layers]
    for layer in graph.layers:
        layer.transit_s[0, 0] = np.inf  # so others are looked at
    for _ in range(motions.settings.quickest.looks):
        if not graph.look(graph.shortest()[1]):
            break
    assert np.isfinite(found_ways).all()
    assert graph.planned < left
    assert [set(layer.transits) for layer in graph.layers] == [{(0, 0)}] * 2


def test_a_quickened_path_is_free_and_never_slower(found: tuple[Motions, Found], ur5e: Robot) -> None:
    motions, ((state, _), *_) = found
    cell, rng, bent = motions.cell, np.random.default_rng(5), 0
    query = cell.problem(state.poses, float(state.q[ur5e.gripper_joint]))
    at = ur5e.arm_q(state.q)
    inside = [p.approach[0] for name in state.poses for p in motions.picks(state, name)[0]]
    for goal in inside[:12]:
        path = cell.connect(query, at, goal[None], rng)
        if not isinstance(path, np.ndarray) or len(path) < 3:
            continue
        quick, _ = cell.quickened(query, path, rng)
        assert np.array_equal(quick[[0, -1]], path[[0, -1]])
        assert polyline_s(quick, ur5e.arm_limits) < polyline_s(path, ur5e.arm_limits) + 1e-9
        q = np.array([ur5e.with_arm(a, float(state.q[ur5e.gripper_joint])) for a in quick])
        assert verify(ur5e, motions.scene, [Motion("transit", ur5e.joint_names, q, np.arange(len(q), dtype=float))]) is None
        bent += 1
    assert bent > 0


def test_a_polished_way_is_free_no_slower_and_as_clear(found: tuple[Motions, Found], ur5e: Robot) -> None:
    """Nor is it another one when it is asked for again."""
    motions, ((state, _), *_) = found
    cell, cost, ends_m = motions.cell, WayCost(motions.cell.arm, ur5e.arm_limits, 0.0), motions.settings.clearance.ends_m
    query, at, bent = cell.problem(state.poses, float(state.q[ur5e.gripper_joint])), ur5e.arm_q(state.q), 0
    for goal in [p.approach[0] for name in state.poses for p in motions.picks(state, name)[0]][:12]:
        path = cell.connect(query, at, goal[None], np.random.default_rng(7))
        if not isinstance(path, np.ndarray) or len(path) < 3:
            continue
        way, again = (polished(cell, cost, query, path, np.random.default_rng(8)) for _ in range(2))
        assert np.array_equal(way, again)
        assert np.array_equal(way[[0, -1]], path[[0, -1]])
        assert cell.free_along(query, way)
        assert cost.path(way) < cost.path(path) + 1e-9
        assert cell.keeps(query, way, ends_m) or not cell.keeps(query, path, ends_m)
        bent += 1
    assert bent > 0


def chosen_s(q: Array, robot: Robot) -> float:
    return float(choose_speeds(make_corners(q, *robot.arm_limits, np.ones(q.shape[1]))))


def test_estimates(robot: Robot) -> None:
    """A straight way takes what its slowest joint takes, a polyline no less than it, and with a few speeds no less than with any."""
    rng, limits, A = np.random.default_rng(0), robot.arm_limits, len(robot.arm_joints)
    for size in (0.01, 0.1, 1.0, 3.0):
        for _ in range(20):
            by = rng.normal(size=A) * size
            alone = [chosen_s(np.stack([np.zeros(A), np.where(np.arange(A) == j, by, 0.0)]), robot) for j in range(A)]
            assert straight_s(by, limits) == pytest.approx(max(alone), rel=1e-6)
            q = np.cumsum(rng.normal(size=(4, A)) * size, axis=0)
            assert straight_s(q[-1] - q[0], limits) <= chosen_s(q, robot) + 1e-9
            assert chosen_s(q, robot) <= polyline_s(q, limits) + 1e-9


def test_ways_that_are_planned_for_quickness_keep_the_wanted_clearance(found: tuple[Motions, Found], ur5e: Robot) -> None:
    """From end to end where both ends do, and a straight way that keeps more near its ends keeps less there, too."""
    motions, ((state, _), *_) = found
    cell, rng, planned, clear_ways = motions.cell, np.random.default_rng(3), 0, [0, 0]
    query, wanted = cell.problem(state.poses, float(state.q[ur5e.gripper_joint])), motions.settings.clearance.wanted_m
    at = ur5e.arm_q(state.q)
    for goal in [p.approach[0] for name in state.poses for p in motions.picks(state, name)[0]][:12]:
        ends = [cell.straight(query, at, goal, m) for m in (wanted, motions.settings.clearance.ends_m, 0.0)]
        assert ends == sorted(ends)
        clear_ways[0] += ends[0]
        clear_ways[1] += ends[2]
        path = cell.connect_clear(query, at, goal, rng, 300)
        if path is None:
            continue
        assert np.array_equal(path[[0, -1]], [at, goal])
        if all(cell.keeps(query, np.stack([q, q]), wanted) for q in (at, goal)):
            assert cell.keeps(query, path, wanted)
            planned += 1
    assert planned > 2
    assert clear_ways[0] <= clear_ways[1] < 12


def test_a_metre_of_the_hand_counts(found: tuple[Motions, Found], ur5e: Robot) -> None:
    """The hand's way by compiled chords is that of many small steps, and what is hoped for costs no more than a detour."""
    arm, rng = found[0].cell.arm, np.random.default_rng(2)
    plain, by_path = (WayCost(arm, ur5e.arm_limits, metre_s) for metre_s in (0.0, 2.0))
    for _ in range(5):
        q = np.cumsum(rng.normal(size=(4, 6)) * 0.4, axis=0)
        fine = np.concatenate([np.linspace(a, b, 200) for a, b in pairwise(q)])
        steps = np.linalg.norm(np.diff([arm.hand_pose(x)[:3, 3] for x in fine], axis=0), axis=1).sum()
        assert by_path.path(q) - plain.path(q) == pytest.approx(2.0 * steps, rel=0.02)
        assert plain.path(q) == polyline_s(q, ur5e.arm_limits)
        assert np.allclose(by_path.points(q), [arm.hand_pose(x)[:3, 3] for x in q])
        by, way = np.diff(q, axis=0), np.diff(by_path.points(q), axis=0)
        assert (by_path.straight(by) <= by_path.hoped(by, way)).all()
        assert (by_path.hoped(by, way) <= by_path.detour(by, way)).all()


def test_grades_of_clearance_fall() -> None:
    grades = ClearanceSettings().grades_m
    assert grades[0] == (0.005, 0.003)
    assert grades[-1] == (0.0, 0.0)
    assert sorted(grades, reverse=True) == list(grades)
    assert ClearanceSettings(wanted_m=0.0).grades_m == ((0.0, 0.0),)
    assert ClearanceSettings(wanted_m=0.004, least_m=0.004).grades_m == ((0.004, 0.004),)
