"""Straight pulls: where they lead, and a blade that only they get out of its slot."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from small_queries import make_problem

from kinematics.chain import Chain, forward
from kinematics.collision.edge_check import config_free
from kinematics.collision.edge_problem import Problem, make_scratch
from kinematics.collision.geometry import Query, make_parts, make_solids
from kinematics.inverse import make_work as make_descent
from kinematics.jit.decorators import jit_entry
from kinematics.robots.robot import Robot
from kinematics.scene import Body
from kinematics.shapes import Box, box_corners
from kinematics.transforms import Array, transform
from planning.motion.search.edges import make_task
from planning.motion.search.pulling import PULL_M, WAYS, pulled
from planning.motion.search.rrt_connect import RRTConnectSettings, plan

LINK = 0.4


@jit_entry
def _pulled(chain: Chain, q: Array, way: int, frames: Array, work: Array, T: Array, out: Array) -> None:
    pulled(chain, q, way, PULL_M, frames, work, T, out)


def _frame(chain: Chain, q: Array) -> Array:
    frames = np.empty((len(chain.q_index) + 1, 4, 4))
    forward(chain, q, frames)
    return frames[-1]


def test_the_hand_keeps_its_orientation(robot: Robot) -> None:
    """Mostly: where no limit and no singularity is near. The limits are kept everywhere."""
    chain = robot.chain(transform(p=[0.0, 0.0, 0.0]))
    frames, work = make_descent(chain)
    rng, shares, T_pull = np.random.default_rng(0), [], np.empty((2, 4, 4))
    for share in rng.uniform(0.15, 0.85, (40, len(chain.lower))):
        q = chain.lower + share * (chain.upper - chain.lower)
        T = _frame(chain, q)
        for way in range(WAYS):
            axis = (T[:3, :3] if way < 6 else np.eye(3))[:, way // 2 % 3] * (1 - 2 * (way % 2))
            out = np.empty_like(q)
            _pulled(chain, q, way, frames, work, T_pull, out)
            assert (out >= chain.lower).all()
            assert (out <= chain.upper).all()
            there = _frame(chain, out)
            strays = np.linalg.norm(there[:3, 3] - T[:3, 3] - PULL_M * axis)
            shares.append(strays < 0.005 and np.abs(there[:3, :3] - T[:3, :3]).max() < 0.03)
    assert np.mean(shares) > 0.5


def slot(gap_m: float) -> tuple[Problem, Array, Array]:
    """Two links turn in the plane and carry a blade, 0.3 × 0.02 m, in a slot with a gap on both sides; start in it, goal outside."""
    along = transform(p=[LINK, 0.0, 0.0])
    limit = np.full(3, 2.8)
    chain = Chain(
        np.array([np.eye(4), along, along]),
        np.arange(3),
        np.ones(3),
        np.zeros(3),
        np.zeros(3, np.int64),
        -limit,
        limit,
        np.zeros(3, np.int64),
    )
    link, blade = (box_corners(np.array([x, 0.01, 0.01])) + np.array([x, 0.0, 0.0]) for x in (LINK / 2, 0.15))
    y = 0.11 + gap_m
    walls = [Body(name, Box(np.array([0.3, 0.2, 0.2])), transform(p=[0.75, at, 0.0])) for name, at in (("left", y), ("right", -y))]
    query = Query(np.ones((3, 2), np.uint8), np.zeros((0, 2), np.int64))
    bend = np.arccos(0.58 / 2 / LINK)
    start, goal = np.array([-bend, 2 * bend, -bend]), np.array([2.0, 0.5, 0.5])
    return make_problem(chain, make_parts([1, 2, 3], [link, link, blade]), make_solids(walls)[0], query), start, goal


@pytest.mark.parametrize("back", [False, True])
def test_out_of_a_tight_slot(back: bool) -> None:
    """Without pulls, one search of sixteen got out within 20 000 iterations."""
    problem, start, goal = slot(0.004)
    scratch = make_scratch(problem)
    for seed in range(4):
        ends = (goal, start) if back else (start, goal)
        found = plan(make_task(problem), ends[0], ends[1][None], seed=seed, max_iterations=2000)
        assert found.path is not None
        assert found.iterations > RRTConnectSettings().pulls_at
        for a, b in pairwise(found.path):
            assert all(
                config_free(problem._replace(margin_m=0.45 * problem.margin_m), a + t * (b - a), scratch) for t in np.linspace(0, 1, 50)
            )
