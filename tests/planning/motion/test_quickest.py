"""Moves that are made quick: free by the last word, every object where it was, no slower than they were found, the same each time."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from kinematics.robots.robot import Robot
from kinematics.scene import RobotRef, State
from kinematics.transforms import Array, transform
from planning.motion.carry import Done
from planning.motion.pick_place import Motions
from planning.motion.smoothing.blending import choose_speeds, make_corners
from planning.motion.smoothing.estimates import polyline_s, straight_s
from planning.motion.verify import verify
from planning.plan import Motion
from planning.scene_generation import generate, load_spec

Found = list[tuple[State, Done]]


@pytest.fixture(scope="module")
def found(ur5e: Robot) -> tuple[Motions, Found]:
    """Two moves that follow one another."""
    scene = generate(load_spec("paper"), ur5e, RobotRef(transform(p=ur5e.base_p), "ur5e"), 91, 0)
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
        quick = cell.quickened(query, path, rng)
        assert np.array_equal(quick[[0, -1]], path[[0, -1]])
        assert polyline_s(quick, ur5e.arm_limits) < polyline_s(path, ur5e.arm_limits) + 1e-9
        q = np.array([ur5e.with_arm(a, float(state.q[ur5e.gripper_joint])) for a in quick])
        assert verify(ur5e, motions.scene, [Motion("transit", ur5e.joint_names, q, np.arange(len(q), dtype=float))]) is None
        bent += 1
    assert bent > 0


def chosen_s(q: Array, robot: Robot) -> float:
    return float(choose_speeds(*make_corners(q, *robot.arm_limits, np.ones(q.shape[1]))))


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
