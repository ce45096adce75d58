"""RRT-Connect (Kuffner and LaValle 2000) from any of several starts to any of several goals, in compiled code, every edge certified.

Two trees grow towards each other in the box of joint limits; all starts are roots of the first, all goals of the second one: see
trees.py. Several starts are the same thing held in several ways, such as an arm whose joints are whole turns further.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kinematics.collision.edge_check import first_contact
from kinematics.doors import checked
from kinematics.transforms import Array
from planning.motion.edges import NOTHING, Memory, Task, lacks, make_memory
from planning.motion.trees import FOUND, FULL, SPENT, GrowthSettings, climb, follow, grow, plant, spread, widen

MAX_ITERATIONS = 5000
_CHUNK = 16  # iterations between looks at the clock


@dataclass(frozen=True)
class RRTConnectSettings:
    """How the trees grow.

    step: longest edge that one extension adds, as a share of the box's diagonal in the weighted metric. around_roots: share of the samples
    that are drawn around a tree's root, where the ways are narrow, in a box down to `narrowest` times the whole one. domain: radius, in
    steps, of the domain that a node gets when it first fails; it shrinks and grows by 30 % down to a tenth of this.
    pulls_at: iteration from which on the hand is pulled out of the roots, once each way; pulls: in a row, at most. stuck: a tree with more
    nodes than that, roots aside, finds its way without pulls; pulled: how many starts, and how many goals, are pulled out of, the nearest.
    far_from: iteration from which on an extension makes as many steps as are free, not one.
    """

    step: float = 0.04
    around_roots: float = 0.5
    narrowest: float = 0.03
    domain: float = 60.0
    pulls_at: int = 40
    pulls: int = 5
    stuck: int = 8
    pulled: int = 4
    far_from: int = 150

    @cached_property
    def packed(self) -> GrowthSettings:
        """The same for compiled code."""
        return GrowthSettings(*(getattr(self, f.name) for f in fields(self)))


DEFAULTS = RRTConnectSettings()


@dataclass(frozen=True, eq=False)
class Route:
    """What came out: the path (K, J) or None, and why not: all of `start` or `goals` in contact, `tilt` where what is carried leans too far
    at all starts or at all goals, or the `budget` spent.

    start, goal: indices of those that the path joins, -1 without one. contact: the pair (first body, second body) that touches at the last
    start, or goal, when all of them touch; bodies as in `exact.Problem`, the P parts first. iterations of the planner; configurations and
    edges looked at; seconds.
    """

    path: Array | None
    why: str
    start: int
    goal: int
    contact: tuple[int, int] | None
    iterations: int
    configurations: int
    edges: int
    time_s: float


def plan(
    task: Task,
    start: Array,
    goals: Array,
    *,
    max_iterations: int = MAX_ITERATIONS,
    time_budget_s: float | None = None,
    seed: int = 0,
    memory: Memory | None = None,
    settings: RRTConnectSettings = DEFAULTS,
    known: Sequence[Array] = (),
) -> Route:
    """Find a path from start (J,), or from one of several (S, J), to one of goals (G, J), each edge of which is certified free (see
    planning.motion.edges).

    known: ways (K, J) that were free for similar tasks, maybe between other ends: what of them is free for this one is what the trees begin
    with (Berenson, Abbeel and Goldberg 2012, A Robot Path Planning Framework that Learns from Experience).
    The same arguments give the same path, unless time_budget_s cuts the search off. memory: this thread's, for this task.
    Raises: ValueError when the shapes don't fit the task.
    """
    began = time.perf_counter()
    problem, n_q = task.exact, len(task.exact.chain.lower)
    starts, goals = checked("start", np.atleast_2d(start), -1, n_q), checked("goals", goals, -1, n_q)
    if len(starts) == 0 or len(goals) == 0:
        raise ValueError(f"starts {starts.shape} and goals {goals.shape} must be (S, {n_q}) and (G, {n_q}) with S, G > 0")
    memory = make_memory(task) if memory is None else memory
    scratch = memory.exact
    counts = scratch.counts.copy()

    def route(path: Array | None, why: str, ends: tuple[int, int] = (-1, -1), pair: int = -1, iterations: int = 0) -> Route:
        spent = scratch.counts - counts
        contact = None if pair < 0 else (int(problem.pairs[pair, 0]), int(problem.pairs[pair, 1]))
        return Route(path, why, *ends, contact, iterations, int(spent[0]), int(spent[2]), time.perf_counter() - began)

    roots = list[list[int]]()
    for which, Q in (("start", starts), ("goals", goals)):
        said = lacks(task, Q, memory).tolist()
        if min(said) >= 0:
            return route(None, which, pair=said[-1])
        roots.append([i for i, what in enumerate(said) if what == NOTHING])
        if not roots[-1]:
            return route(None, "tilt")
    first, last = roots
    if len(first) + len(last) > 2:
        apart = (problem.weight**2 * (goals[last] - starts[first][:, None]) ** 2).sum(2)
        first, last = ([side[i] for i in np.argsort(apart.min(axis), kind="stable")] for side, axis in ((first, 1), (last, 0)))
    trees = plant(starts[first], goals[last], seed, sum(map(len, known)))
    status = FOUND if any(follow(task, trees, way, np.empty((2, len(way)), np.int64), memory) for way in known) else SPENT
    while trees.met[2] < max_iterations and status != FOUND:
        if time_budget_s is not None and time.perf_counter() - began > time_budget_s:
            break
        left = max_iterations - int(trees.met[2])
        status = grow(task, trees, settings.packed, left if time_budget_s is None else min(left, _CHUNK), memory)
        if status == FULL:
            trees = widen(trees)
    iterations = int(trees.met[2])
    if status != FOUND:
        return route(None, "budget", iterations=iterations)
    ahead, back = climb(trees, 0), climb(trees, 1)
    path = np.concatenate([trees.q[0, ahead[::-1]], trees.q[1, back]])
    return route(path, "", (first[ahead[-1]], last[back[-1]]), iterations=iterations)


def reach(
    task: Task,
    start: Array,
    goals: Array,
    *,
    max_iterations: int,
    seed: int,
    memory: Memory,
    settings: RRTConnectSettings = DEFAULTS,
) -> NDArray[np.bool_]:
    """To which of goals (G, J) a path leads from start (J,), or from one of several (S, J), each edge of which is certified free; the paths
    themselves are not kept.

    What one goal is reached by serves the others: edges to goals reached before come first, then one search for all that are left, as
    often as it finds one of them in max_iterations.
    """
    n_q = len(task.exact.chain.lower)
    starts, goals = checked("start", np.atleast_2d(start), -1, n_q), checked("goals", goals, -1, n_q)
    starts = starts[[first_contact(task.exact, q, memory.exact) < 0 for q in starts]]
    found, tried = np.zeros(len(goals), np.bool_), np.zeros((len(goals), len(goals) + len(starts)), np.bool_)
    if len(starts) == 0:
        return found
    while True:
        spread(task, starts, goals, memory, found, tried)
        left = np.flatnonzero(~found)
        if len(left) == 0:
            return found
        route = plan(task, starts, goals[left], max_iterations=max_iterations, seed=seed + len(left), memory=memory, settings=settings)
        if route.path is None:
            return found
        found[left[route.goal]] = True
