"""RRT-Connect and shortcuts where the answer is known: a gantry that carries a cube through a slit, and the named robots at a cabinet."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from small_queries import make_problem

from kinematics.chain import Chain
from kinematics.collision.edge_check import config_free, edge_free
from kinematics.collision.edge_problem import Problem, make_scratch
from kinematics.collision.geometry import Query, make_parts, make_solids
from kinematics.collision.gjk import distance, make_work
from kinematics.robots.robot import Robot
from kinematics.scene import Body
from kinematics.shapes import Box, box_corners
from kinematics.transforms import Array, transform
from planning.motion.search.edges import make_memory, make_task
from planning.motion.search.rrt_connect import plan, reach
from planning.motion.search.shortcut import ShortcutSettings, length, shorten

LEFT, RIGHT = np.array([-0.8, 0.0]), np.array([0.8, 0.0])


def slit(width_m: float, at_y: float = 0.6) -> Problem:
    """A cube of 0.2 m slides in the plane; a wall at x = 0 leaves an opening of some width around y = at_y."""
    T_y = np.eye(4)[:, [2, 0, 1, 3]]  # the joint's z along the world's x, then along its y
    T_x = np.eye(4)[:, [1, 2, 0, 3]]
    chain = Chain(
        np.array([T_x, np.linalg.inv(T_x) @ T_y]),
        np.array([0, 1]),
        np.ones(2),
        np.zeros(2),
        np.ones(2, np.int64),
        np.array([-1.0, -1.0]),
        np.array([1.0, 1.0]),
        np.zeros(2, np.int64),
    )
    parts = make_parts([2], [box_corners(np.full(3, 0.1))])
    low, high = at_y - width_m / 2, at_y + width_m / 2
    walls = [Body("low", Box(np.array([0.1, low + 1.5, 1.0])), transform(p=[0, (low - 1.5) / 2, 0]))]
    walls += [Body("high", Box(np.array([0.1, 1.5 - high, 1.0])), transform(p=[0, (1.5 + high) / 2, 0]))]
    return make_problem(chain, parts, make_solids(walls)[0], Query(np.ones((1, 2), np.uint8), np.zeros((0, 2), np.int64)))


def clearance(problem: Problem, q: Array) -> float:
    """The gantry's distance to the walls, to full precision, without the code under test."""
    cube, least = np.ascontiguousarray(box_corners(np.full(3, 0.1)).T), np.inf
    for n, T in enumerate(problem.solid_T):
        half = problem.boxes[1 + n, :3].copy()
        least = min(least, distance(cube, 0, 8, transform(p=[q[0], q[1], 0.0]), 0, half, 0, 0, T, make_work()))
    return least


@pytest.mark.parametrize("width_m", [0.6, 0.25, 0.21])
def test_through_the_slit(width_m: float) -> None:
    problem = slit(width_m)
    for seed in range(3):
        found = plan(make_task(problem), LEFT, RIGHT[None], max_iterations=20000, seed=seed)
        assert found.path is not None
        np.testing.assert_array_equal(found.path[[0, -1]], [LEFT, RIGHT])
        short = shorten(make_task(problem), found.path, seed=seed, settings=ShortcutSettings(tries=200)).path
        assert short is not None
        np.testing.assert_array_equal(short[[0, -1]], [LEFT, RIGHT])
        assert length(make_task(problem), short) <= length(make_task(problem), found.path) + 1e-12
        for path in (found.path, short):
            for a, b in pairwise(path):
                for t in np.linspace(0, 1, 200):
                    assert clearance(problem, a + t * (b - a)) >= 0.49 * problem.margin_m
        assert short[:, 1].max() > 0.69 - width_m / 2  # up into the slit, there is no other way


@pytest.mark.parametrize("width_m", [0.0, 0.15, 0.2])
def test_no_way_through(width_m: float) -> None:
    found = plan(make_task(slit(width_m)), LEFT, RIGHT[None], max_iterations=3000)
    assert found.path is None
    assert (found.why, found.goal, found.iterations) == ("budget", -1, 3000)


def test_shortest_way_is_nearly_found() -> None:
    """Around the edge of an opening: the bound is two straight lines past the cube's corner positions."""
    problem = slit(0.6, at_y=0.7)
    corners = np.array([LEFT, [-0.15, 0.5], [0.15, 0.5], RIGHT])
    found = plan(make_task(problem), LEFT, RIGHT[None], seed=1)
    assert found.path is not None
    short = shorten(make_task(problem), found.path, settings=ShortcutSettings(tries=1000)).path
    assert short is not None
    assert length(make_task(problem), corners) - 1e-9 <= length(make_task(problem), short) < 1.03 * length(make_task(problem), corners)


def test_repeatable() -> None:
    problem = slit(0.25)
    runs = [plan(make_task(problem), LEFT, RIGHT[None], seed=seed, max_iterations=20000) for seed in (4, 4, 5)]
    paths = [run.path for run in runs]
    assert paths[0] is not None
    np.testing.assert_array_equal(paths[0], paths[1])
    assert paths[2] is None or not np.array_equal(paths[0], paths[2])
    assert runs[0].configurations == runs[1].configurations
    chunked = plan(make_task(problem), LEFT, RIGHT[None], seed=4, max_iterations=20000, time_budget_s=60.0).path
    np.testing.assert_array_equal(paths[0], chunked)  # looking at the clock changes nothing
    a, b = (shorten(make_task(problem), paths[0], seed=9).path for _ in range(2))
    np.testing.assert_array_equal(a, b)


def test_known_ways_are_begun_with() -> None:
    """A way that was found between other ends leads through the slit at once, and only as far as it is free for this task."""
    way = np.array([[-0.9, 0.2], [-0.3, 0.6], [0.0, 0.6], [0.3, 0.6], [0.9, 0.2]])
    task = make_task(slit(0.21))
    found = plan(task, LEFT, RIGHT[None], known=[way])
    assert found.path is not None
    assert found.iterations == 0
    np.testing.assert_array_equal(found.path[[0, -1]], [LEFT, RIGHT])
    backwards = plan(task, RIGHT, LEFT[None], known=[np.array([[0.0, -0.9], [-0.5, -0.9]]), way]).path
    assert backwards is not None
    for path in (found.path, backwards):
        for a, b in pairwise(path):
            assert edge_free(task.exact, a, b, make_scratch(task.exact))
    shut = plan(make_task(slit(0.3, at_y=0.3)), LEFT, RIGHT[None], max_iterations=20000, seed=3, known=[way])
    assert shut.path is not None
    assert shut.iterations > 0
    assert clearance(slit(0.3, at_y=0.3), np.array([0.0, 0.6])) <= 0.0 < min(clearance(slit(0.3, at_y=0.3), q) for q in shut.path)
    assert plan(make_task(slit(0.0)), LEFT, RIGHT[None], max_iterations=200, known=[way]).path is None
    long = np.repeat(way[:2], 400, 0)
    assert plan(task, LEFT, RIGHT[None], max_iterations=20000, seed=3, known=[long, way]).path is not None


def test_ends_in_contact_are_named() -> None:
    problem, inside = slit(0.3), np.array([0.0, -0.5])
    blocked = plan(make_task(problem), inside, RIGHT[None])
    assert (blocked.path, blocked.why, blocked.contact) == (None, "start", (0, 1))
    blocked = plan(make_task(problem), LEFT, np.array([inside, [0.0, 0.95]]))
    assert (blocked.path, blocked.why, blocked.contact, blocked.iterations) == (None, "goals", (0, 2), 0)


def test_several_goals() -> None:
    """Goals in contact are left out, a goal behind a closed wall is not reached, the index is that of the caller's array."""
    found = plan(make_task(slit(0.0)), LEFT, np.array([RIGHT, [0.0, 0.0], [-0.5, 0.7]]))
    assert found.path is not None
    assert found.goal == 2
    np.testing.assert_array_equal(found.path[-1], [-0.5, 0.7])
    here = plan(make_task(slit(0.0)), LEFT, LEFT[None])
    assert here.path is not None
    assert here.goal == 0


def test_several_starts() -> None:
    """Starts in contact are left out, one behind a closed wall leads nowhere, the indices are those of the caller's arrays."""
    inside, starts = np.array([0.0, -0.5]), np.array([[0.0, -0.5], RIGHT, LEFT, [-0.6, -0.7]])
    for goals, pairs in ((np.array([[-0.5, 0.7]]), {(2, 0), (3, 0)}), (np.array([inside, RIGHT + 0.1]), {(1, 1)})):
        found = plan(make_task(slit(0.0)), starts, goals)
        assert found.path is not None
        assert (found.start, found.goal) in pairs
        np.testing.assert_array_equal(found.path[[0, -1]], [starts[found.start], goals[found.goal]])
    blocked = plan(make_task(slit(0.3)), np.array([inside, [0.0, 0.95]]), RIGHT[None])
    assert (blocked.path, blocked.why, blocked.contact, blocked.start) == (None, "start", (0, 2), -1)
    task = make_task(slit(0.19))
    goals = np.array([[-0.7, 0.8], [0.7, -0.8], inside])
    for begin, reached in ((starts[:1], [0, 0, 0]), (starts[2:], [1, 0, 0]), (starts, [1, 1, 0])):
        np.testing.assert_array_equal(reach(task, begin, goals, max_iterations=2000, seed=1, memory=make_memory(task)), reached)


def test_reached_goals_are_those_with_a_way() -> None:
    """Goals on both sides of the wall, and some within it: through an opening all free ones are reached, without one those on this side."""
    x, y = np.meshgrid([-0.7, -0.5, 0.0, 0.5, 0.7], [-0.8, -0.3, 0.2, 0.8])
    goals = np.column_stack([x.ravel(), y.ravel()])
    for width_m, beyond in ((0.6, True), (0.19, False)):
        problem = slit(width_m)
        free = np.array([config_free(problem, g, make_scratch(problem)) for g in goals])
        task = make_task(problem)
        found = reach(task, LEFT, goals, max_iterations=3000, seed=1, memory=make_memory(task))
        np.testing.assert_array_equal(found, free & (beyond | (goals[:, 0] < 0)))
        assert not reach(task, np.array([0.0, -0.5]), goals, max_iterations=100, seed=1, memory=make_memory(task)).any()  # within the wall


def test_time_budget_ends_the_search() -> None:
    found = plan(make_task(slit(0.0)), LEFT, RIGHT[None], max_iterations=10**9, time_budget_s=0.05)
    assert (found.path, found.why) == (None, "budget")
    assert found.time_s < 2.0


def test_shapes_are_checked() -> None:
    problem = slit(0.3)
    with pytest.raises(ValueError, match="goals"):
        plan(make_task(problem), LEFT, RIGHT)
    with pytest.raises(ValueError, match="start"):
        plan(make_task(problem), np.zeros(3), RIGHT[None])
    with pytest.raises(ValueError, match="path"):
        shorten(make_task(problem), LEFT)


def test_robots_among_walls(robot: Robot) -> None:
    """Every named robot plans between random free configurations under a shelf; each edge keeps half the margin when sampled densely."""
    base = transform(p=[0.0, 0.0, 0.0])
    chain = robot.chain(base)
    parts, _ = robot.parts(float(robot.home[robot.gripper_joint]), base)
    walls = [Body("shelf", Box(np.array([0.4, 1.0, 0.02])), transform(p=[0.7, 0, 0.6]))]
    walls += [Body("floor", Box(np.array([2.0, 2.0, 0.02])), transform(p=[0, 0, -0.3]))]
    solids, _ = make_solids(walls)
    check = np.ones((len(parts.frame), 2), np.uint8)
    check[parts.frame == 0] = 0
    problem = make_problem(chain, parts, solids, Query(check, robot.self_pairs))
    scratch, task = make_scratch(problem), make_task(problem)
    memory = make_memory(task)
    rng = np.random.default_rng(0)
    free = [q for q in rng.uniform(chain.lower, chain.upper, (300, len(chain.lower))) if config_free(problem, q, scratch)][:6]
    solved = 0
    for i, (a, b) in enumerate(zip(free[::2], free[1::2])):
        found = plan(make_task(problem), a, b[None], seed=i, max_iterations=3000, memory=memory)
        if found.path is None:
            continue
        solved += 1
        short = shorten(make_task(problem), found.path, seed=i, settings=ShortcutSettings(tries=30), memory=memory).path
        assert short is not None
        looser = problem._replace(margin_m=0.45 * problem.margin_m)
        for qa, qb in pairwise(short):
            assert edge_free(looser, qa, qb, scratch)
            assert all(config_free(looser, qa + t * (qb - qa), scratch) for t in np.linspace(0, 1, 100))
    assert solved >= 1
