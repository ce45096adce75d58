"""Samples of a motion lie so dense that no point of the arm goes further than RESOLUTION_M from one to the next."""

from __future__ import annotations

import numpy as np
import pytest
from documents import scene

from kinematics.robots.robot import Robot
from kinematics.transforms import Array
from planning.io.scene_documents import scene_from_json
from planning.motion.checking.sampled_motion import RESOLUTION_M, samples
from planning.plan import Motion

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])


def ways(robot: Robot, q: Array) -> Array:
    """How far any corner of a box around any link's hull goes from one configuration to the next (N - 1,)."""
    poses = robot.tree.poses(q)
    most = np.zeros(len(q) - 1)
    for hull in robot.hulls:
        T, low, high = poses[:, robot.tree.index[hull.link]], hull.vertices.min(0), hull.vertices.max(0)
        at = ((low + high) / 2 + CORNERS * (high - low) / 2) @ T[:, :3, :3].swapaxes(1, 2) + T[:, None, :3, 3]
        most = np.maximum(most, np.linalg.norm(np.diff(at, axis=0), axis=2).max(1))
    return most


def motion(robot: Robot, q: Array, qd: Array | None = None, t_s: Array | None = None) -> Motion:
    """From rest to rest through q (K, J), with velocities qd there, without accelerations."""
    qd = np.zeros_like(q) if qd is None else qd
    return Motion("transit", robot.joint_names, q, np.arange(float(len(q))) if t_s is None else t_s, None, (), qd, np.zeros_like(q))


@pytest.mark.parametrize("way", [0.003, 0.01, 0.02, 0.03, 0.05, 0.3])
@pytest.mark.parametrize("joint", [0, 2])
def test_from_rest_to_rest(ur5e: Robot, way: float, joint: int) -> None:
    """In its middle such a spline is nearly twice as fast as in the mean, and at both ends it stands still."""
    q = np.stack([ur5e.home, ur5e.home])
    q[1, joint] += way
    assert ways(ur5e, samples(ur5e, scene_from_json(scene()), motion(ur5e, q))).max() <= RESOLUTION_M


def test_with_stops_and_turns_between(ur5e: Robot) -> None:
    """Pieces of all lengths, joints that stand, stop or turn round at a row."""
    rng, where = np.random.default_rng(5), scene_from_json(scene())
    for _ in range(60):
        pieces, step = int(rng.integers(1, 5)), 10 ** rng.uniform(-2.5, -0.3)
        moves = (rng.random(len(ur5e.home)) < rng.choice([0.3, 1.0])) & (np.arange(len(ur5e.home)) != ur5e.gripper_joint)
        steps = np.where(moves, rng.normal(size=(pieces, len(moves))), 0.0) * step
        t_s = np.concatenate([[0.0], np.cumsum(rng.uniform(0.5, 2.0, pieces))])
        q, v = ur5e.home + np.concatenate([0 * steps[:1], np.cumsum(steps, axis=0)]), steps / np.diff(t_s)[:, None]
        qd = np.zeros_like(q)
        qd[1:-1] = np.where(v[:-1] * v[1:] > 0, v[:-1] + v[1:], 0.0) / 2 * rng.uniform(0, 1, (pieces - 1, 1))
        rows = samples(ur5e, where, motion(ur5e, q, qd, t_s))
        assert np.array_equal(rows[[0, -1]], q[[0, -1]])
        assert ways(ur5e, rows).max(initial=0.0) <= RESOLUTION_M


def test_between_waypoints(ur5e: Robot) -> None:
    q = ur5e.home + np.cumsum(np.random.default_rng(7).normal(size=(4, len(ur5e.home))) * 0.2, axis=0)
    q[:, ur5e.gripper_joint] = ur5e.home[ur5e.gripper_joint]
    plain = Motion("transit", ur5e.joint_names, q, np.arange(4.0), None, ())
    assert ways(ur5e, samples(ur5e, scene_from_json(scene()), plain)).max() <= RESOLUTION_M
