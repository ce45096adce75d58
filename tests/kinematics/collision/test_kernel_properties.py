"""What the compiled core promises, on every named robot before a cabinet with eight objects: free is free and touching touches, by FCL; the
covers contain the hulls; forward kinematics agree with pytorch-kinematics; a certified edge is free wherever it is looked at.

RETRIEVE_SAMPLES: how many random configurations a robot, by default 4 000.
"""

from __future__ import annotations

import os

import numpy as np
import pytest
from cluttered_cell import cell_of
from conftest import random_q

from kinematics.chain import forward
from kinematics.collision import edge_check, sphere_check
from kinematics.collision.covers.sphere_cover import uncovered
from kinematics.collision.robot_model import link_covers
from kinematics.robots.robot import Robot
from planning.motion.search.edges import connects

SAMPLES = int(os.environ.get("RETRIEVE_SAMPLES", "4000"))
EDGES = max(300, SAMPLES // 20)


def test_free_is_free_and_touching_touches(robot: Robot) -> None:
    cell = cell_of(robot)
    Q = cell.random(SAMPLES, 1)
    said = sphere_check.configs_free(cell.task.model, cell.task.world, Q, cell.memory.spheres)
    by_fcl = np.array([said[i] != sphere_check.UNDECIDED and cell.touches(q) for i, q in enumerate(Q)])
    assert not (by_fcl & (said == sphere_check.FREE)).any(), Q[by_fcl & (said == sphere_check.FREE)]
    assert not (~by_fcl & (said == sphere_check.TOUCHES)).any(), Q[~by_fcl & (said == sphere_check.TOUCHES)]
    assert (said == sphere_check.FREE).mean() > 0.03
    assert (said == sphere_check.TOUCHES).mean() > 0.1


def test_exact_free_is_free_where_the_covers_leave_it_open(robot: Robot) -> None:
    cell = cell_of(robot)
    Q = cell.random(SAMPLES, 2)
    open_ = Q[sphere_check.configs_free(cell.task.model, cell.task.world, Q, cell.memory.spheres) == sphere_check.UNDECIDED]
    assert len(open_) > 0
    for q in open_:
        assert not (edge_check.config_free(cell.task.exact, q, cell.memory.exact) and cell.touches(q)), q


def test_covers_contain_the_hulls(robot: Robot) -> None:
    for hull, levels in zip(robot.hulls, link_covers(robot), strict=True):
        for balls in (levels.coarse, levels.fine):
            assert len(uncovered(hull.vertices, balls)) == 0, hull.link


def test_forward_kinematics_agree_with_pytorch_kinematics(robot: Robot) -> None:
    pytest.importorskip("pytorch_kinematics")
    from kinematics.robots.batched_fk import Forward

    q = random_q(robot, 200, seed=3)
    q[:, robot.gripper_joint] = 0.5 * q[0, robot.gripper_joint]  # one gripper value, the other joints anywhere
    chain, carried = robot.chain(np.eye(4)), robot.frame_of_links(float(q[0, robot.gripper_joint]), np.eye(4))
    theirs = {link: T.numpy() for link, T in Forward(robot).poses(q).items()}
    frames = np.zeros((len(chain.q_index) + 1, 4, 4))
    for i, row in enumerate(robot.arm_q(q)):
        forward(chain, row, frames)
        for link, (frame, T) in carried.items():
            np.testing.assert_allclose(frames[frame] @ T, theirs[link][i], atol=1e-5, err_msg=link)


def test_certified_edges_are_free_at_every_sample(robot: Robot) -> None:
    cell, rng = cell_of(robot), np.random.default_rng(5)
    starts = [q for q in cell.random(20 * EDGES, 4) if edge_check.config_free(cell.task.exact, q, cell.memory.exact)][:EDGES]
    granted = refused = 0
    for a in starts:
        b = np.clip(a + rng.normal(size=len(a)) * 0.25, cell.chain.lower, cell.chain.upper)
        if not connects(cell.task, a, b, cell.memory):
            refused += 1
            continue
        granted += 1
        for t in rng.random(24):
            assert not cell.touches(a + t * (b - a)), (a, b, t)
    assert granted > 0.2 * len(starts)
    assert refused > 0
