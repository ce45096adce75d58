"""Clearance as an argument: what covers and exact test call free keeps it, what they call touching falls short of it, by FCL's distance."""

from __future__ import annotations

from itertools import pairwise

import fcl
import numpy as np
import pytest
from cluttered_cell import Cell, cell_of
from test_edge_check import frames_at, packed, pair_distance

from kinematics.chain import Int, forward
from kinematics.collision import sphere_check
from kinematics.collision.edge_check import config_free, edge_contact
from kinematics.collision.edge_problem import MARGIN_M, make_scratch
from kinematics.collision.pair_bounds import TOLERANCE
from kinematics.collision.path_clearance import make_gaps, path_clearances
from kinematics.robots.robot import Robot
from kinematics.transforms import Array
from planning.motion.search.edges import LARGEST_CLEARANCE_M, Task, connects, with_clearance

OWN_M = 0.002
FCL_M = 2e-5
"""How far FCL's distance of round solids may be off."""


def keeping(cell: Cell, clearance_m: float, own_m: float = OWN_M) -> Task:
    return with_clearance(cell.task, np.full(len(cell.task.exact.solid_T), clearance_m), own_m)


def shortfall(cell: Cell, q: Array, clearance_m: float, own_m: float = OWN_M) -> float:
    """By how much, in metres, the worst pair at q falls short of its clearance, by FCL: negative when all keep theirs. Pairs whose balls
    are 2 cm further apart than their clearance count as that far apart."""
    forward(cell.chain, q, cell.frames)
    T = cell.frames[cell.frame]
    at = np.concatenate([np.einsum("pij,pj->pi", T[:, :3, :3], cell.centres) + T[:, :3, 3], cell.still])
    wanted = np.where(cell.pairs[:, 1] < len(cell.movers), own_m, clearance_m)
    near = np.linalg.norm(at[cell.pairs[:, 0]] - at[cell.pairs[:, 1]], axis=1) <= cell.reach + wanted + 0.02
    for i in np.unique(cell.pairs[near]):
        if i < len(cell.movers):
            cell.objects[i].setTransform(fcl.Transform(T[i, :3, :3], T[i, :3, 3]))
    worst = -0.02
    for (i, j), want in zip(cell.pairs[near], wanted[near]):
        if fcl.collide(cell.objects[i], cell.objects[j], fcl.CollisionRequest(), fcl.CollisionResult()):
            return want
        worst = max(worst, want - fcl.distance(cell.objects[i], cell.objects[j], fcl.DistanceRequest(), fcl.DistanceResult()))
    return worst


@pytest.mark.parametrize("clearance_m", [0.001, 0.005, 0.03])
def test_the_kernel_s_free_keeps_the_clearance_and_its_touching_falls_short(robot: Robot, clearance_m: float) -> None:
    cell = cell_of(robot)
    task = keeping(cell, clearance_m)
    Q = cell.random(400, 11)
    said = sphere_check.configs_free(task.model, task.world, Q, cell.memory.spheres)
    short = np.array([shortfall(cell, q, clearance_m) for q in Q])
    assert (short[said == sphere_check.FREE] <= FCL_M).all()
    assert (short[said == sphere_check.TOUCHES] >= -FCL_M).all()
    assert (said == sphere_check.FREE).sum() > 5
    assert (said == sphere_check.TOUCHES).sum() > 40
    exact = np.array([config_free(task.exact, q, cell.memory.exact) for q in Q])
    margin = MARGIN_M
    assert (short[exact] <= FCL_M - margin).all()
    assert (short[~exact] >= -margin - TOLERANCE * (clearance_m + 2 * margin) - FCL_M).all()


def test_more_clearance_frees_nothing(robot: Robot) -> None:
    """Neither an own distance nor one from the solids; and none at all is what was there before.

    Each configuration is asked about alone: in a batch, what is near another one may be looked at more finely, and stay undecided.
    """
    cell = cell_of(robot)
    Q = cell.random(2000, 12)

    def answers(task: Task) -> Int:
        return np.concatenate([sphere_check.configs_free(task.model, task.world, q[None], cell.memory.spheres) for q in Q])

    before = answers(cell.task)
    for i, (clearance_m, own_m) in enumerate(((0.0, 0.0), (0.002, 0.0), (0.002, 0.001), (0.01, 0.002))):
        said = answers(keeping(cell, clearance_m, own_m))
        assert np.array_equal(said, before) if i == 0 else not ((said == sphere_check.FREE) & (before != sphere_check.FREE)).any()
        assert not ((said != sphere_check.TOUCHES) & (before == sphere_check.TOUCHES)).any()
        before = said


@pytest.mark.parametrize("clearance_m", [0.002, 0.005])
def test_certified_edges_keep_the_clearance_everywhere(robot: Robot, clearance_m: float) -> None:
    cell, rng = cell_of(robot), np.random.default_rng(13)
    task = keeping(cell, clearance_m)
    starts = [q for q in cell.random(1200, 14) if config_free(task.exact, q, cell.memory.exact)][:60]
    granted = 0
    for a in starts:
        b = np.clip(a + rng.normal(size=len(a)) * 0.2, cell.chain.lower, cell.chain.upper)
        if connects(task, a, b, cell.memory):
            granted += 1
            assert all(shortfall(cell, a + t * (b - a), clearance_m) <= FCL_M for t in rng.random(10))
    assert granted > 5
    assert granted < len(starts)


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_exact_edges_keep_each_pair_s_own_clearance(seed: int) -> None:
    """To full precision, every pair with a clearance of its own; a refused edge names a pair that falls short."""
    problem, _, _ = packed(seed)
    rng = np.random.default_rng([seed, 7])
    problem = problem._replace(clearance=rng.choice([0.0, 0.001, 0.004], len(problem.pairs)))
    scratch, seen = make_scratch(problem), {True: 0, False: 0}
    for qa in rng.uniform(problem.chain.lower, problem.chain.upper, (3000, 5)):
        qb = np.clip(qa + rng.normal(size=5) * rng.choice([0.05, 0.3]), problem.chain.lower, problem.chain.upper)
        if not config_free(problem, qa, scratch) or min(seen.values()) >= 8:
            continue
        pair = edge_contact(problem, qa, qb, scratch)
        seen[pair < 0] += 1
        if pair >= 0:
            frames = frames_at(problem, qa + scratch.where[0] * (qb - qa))
            within = problem.clearance[pair] + problem.margin_m
            assert pair_distance(problem, frames, pair) <= within * (1 + 2 * TOLERANCE)
        elif seen[True] <= 8:
            for t in np.linspace(0, 1, 25):
                frames = frames_at(problem, qa + t * (qb - qa))
                gaps = np.array([pair_distance(problem, frames, n) for n in range(len(problem.pairs))])
                assert (gaps >= problem.clearance + 0.5 * problem.margin_m - 1e-9).all()
    assert min(seen.values()) >= 5


@pytest.mark.parametrize("seed", range(2))
def test_the_least_distance_along_a_path(seed: int) -> None:
    """What skips rows finds what a look at every row finds."""
    problem, _, _ = packed(seed)
    scratch, rng = make_scratch(problem), np.random.default_rng([seed, 8])
    found = 0
    for _ in range(12):
        corners = rng.uniform(problem.chain.lower, problem.chain.upper, (3, 5))
        rows = np.concatenate([np.linspace(a, b, 60) for a, b in pairwise(corners)])
        step = max(float((problem.reach @ np.abs(problem.chain.scale * (b - a)[problem.chain.q_index])).max()) for a, b in pairwise(rows))
        gaps = [[pair_distance(problem, frames_at(problem, q), n) for n in range(len(problem.pairs))] for q in rows]
        both, nearest, pairs = np.empty(2), np.empty(2, np.int64), len(problem.pairs)
        some = np.array([[0, len(rows)], [20, 50]]), np.array([0, pairs, pairs]), np.full(2, step)  # the second path has no pairs
        path_clearances(problem, rows, *some, 0.05, 1e-3, scratch, make_gaps(some[0], some[1]), both, nearest)
        assert (both[1], nearest[1]) == (0.05, -1)
        least, pair, exact = both[0], nearest[0], float(np.min(gaps))
        assert min(exact, 0.05) * (1 - 1e-3) - 1e-9 <= least <= min(exact, 0.05) + 1e-9
        assert (pair < 0) == (exact >= 0.05)
        if pair >= 0:
            found += 1
            assert np.min(gaps, axis=0)[pair] * (1 - 1e-3) - 1e-9 <= least
    assert found > 0


def test_what_is_no_clearance_is_refused(ur5e: Robot) -> None:
    cell = cell_of(ur5e)
    B = len(cell.task.exact.solid_T)
    for solids, own in (
        (np.full(B, -0.001), 0.0),
        (np.full(B, np.nan), 0.0),
        (np.full(B, LARGEST_CLEARANCE_M), 0.0),
        (np.zeros(B + 1), 0.0),
    ):
        with pytest.raises(ValueError, match="clearances"):
            with_clearance(cell.task, solids, own)
    with pytest.raises(ValueError, match="clearances"):
        with_clearance(cell.task, np.zeros(B), -1.0)
