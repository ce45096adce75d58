"""RRT-Connect (Kuffner and LaValle 2000) from any of several starts to any of several goals, in compiled code, every edge certified.

Two trees grow towards each other in the box of joint limits; all starts are roots of the first, all goals of the second one: see
trees.py. Several starts are the same thing held in several ways, such as an arm whose joints are whole turns further.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import count
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.array_checks import checked
from kinematics.collision.edge_check import first_contact
from kinematics.transforms import Array
from planning.motion.search.edges import Memory, Task, make_memory
from planning.motion.search.tree_memory import widen
from planning.motion.search.trees import FOUND, FULL, NO_GOAL, NO_START, SPENT, GrowthSettings, search, spread

MAX_ITERATIONS = 5000
_CHUNK = 16  # iterations between looks at the clock
_ROOM = 64  # nodes that a search can add before it asks for more


@dataclass(frozen=True)
class RRTConnectSettings:
    """How the trees grow.

    step: longest edge that one extension adds, as a share of the box's diagonal in the weighted metric. around_roots: share of the samples
    that are drawn around a tree's root, where the ways are narrow, in a box down to `narrowest` times the whole one. domain: radius, in
    steps, of the domain that a node gets when it first fails; it shrinks and grows by 30 % down to a tenth of this.
    pulls_at: iteration from which on the hand is pulled out of the roots, once each way; pulls: in a row, at most. stuck: a tree with more
    nodes than that, roots aside, finds its way without pulls; pulled: how many starts, and how many goals, are pulled out of, the nearest.
    far_from: iteration from which on an extension makes as many steps as are free, not one. balanced_from: iteration from which on the
    larger tree hardly grows any more: a search that lasts is for what is hidden where the smaller one is.
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
    balanced_from: int = 3000

    @cached_property
    def packed(self) -> GrowthSettings:
        """The same for compiled code."""
        return GrowthSettings(*(getattr(self, f.name) for f in fields(self)))


DEFAULTS = RRTConnectSettings()


class Route(NamedTuple):
    """What came out: the path (K, J) or None, and why not: all of `start` or `goals` in contact, `tilt` where what is carried leans too far
    at all starts or at all goals, or the `budget` spent.

    start, goal: indices of those that the path joins, -1 without one. contact: the pair (first body, second body) that touches at the last
    start, or goal, when all of them touch; bodies as in `edge_problem.Problem`, the P parts first. iterations of the planner;
    configurations and edges looked at; seconds.
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
    planning.motion.search.edges).

    known: ways (K, J) that were free for similar tasks, maybe between other ends: what of them is free for this one is what the trees begin
    with (Berenson, Abbeel and Goldberg 2012, A Robot Path Planning Framework that Learns from Experience).
    The same arguments give the same path, unless time_budget_s cuts the search off. memory: this thread's, for this task.
    Raises: ValueError when the shapes don't fit the task.
    """
    began = time.perf_counter()
    starts, goals = _ends(task, start, goals)
    S, G, n_q = len(starts), len(goals), starts.shape[1]
    if S == 0 or G == 0:
        raise ValueError(f"starts {starts.shape} and goals {goals.shape} must be (S, {n_q}) and (G, {n_q}) with S, G > 0")
    memory = make_memory(task) if memory is None else memory
    counts = memory.exact.counts.copy()
    ways = np.concatenate(known) if known else np.empty((0, n_q))
    first = np.cumsum([0, *map(len, known)])
    if (least := max(S, G) + len(ways) + _ROOM) > memory.trees.q.shape[1]:
        memory = memory._replace(trees=widen(memory.trees, 2 * least))
    said, nodes = np.empty(S + G, np.int64), np.empty((2, len(ways)), np.int64)
    status, n, iterations = SPENT, 0, 0
    for turn in count():
        left = max_iterations - iterations
        most = left if time_budget_s is None else min(left, _CHUNK)
        status, n = search(task, starts, goals, ways, first, settings.packed, seed % 2**63, most, turn == 0, memory, said, nodes)
        if status in (NO_START, NO_GOAL):
            break
        iterations = int(memory.trees.met[2])
        late = time_budget_s is not None and time.perf_counter() - began > time_budget_s
        if status == FOUND or iterations >= max_iterations or late:
            break
        if status == FULL:
            memory = memory._replace(trees=widen(memory.trees, 2 * memory.trees.q.shape[1]))
    spent = memory.exact.counts - counts
    none = Route(None, "budget", -1, -1, None, iterations, int(spent[0]), int(spent[2]), time.perf_counter() - began)
    if status == FOUND:
        start_at, goal_at = memory.trees.joined.tolist()
        return none._replace(path=memory.trees.path[:n].copy(), why="", start=start_at, goal=goal_at)
    if status in (NO_START, NO_GOAL):
        which = said[:S] if status == NO_START else said[S:]
        if which.min() < 0:
            return none._replace(why="tilt")
        a, b = task.exact.pairs[which[-1], :2].tolist()
        return none._replace(why="start" if status == NO_START else "goals", contact=(a, b))
    return none


def _ends(task: Task, start: Array, goals: Array) -> tuple[Array, Array]:
    """One start (J,) or several, as (S, J), and goals (G, J). Raises: ValueError when the shapes don't fit the task."""
    n_q = len(task.exact.chain.lower)
    return checked("start", np.atleast_2d(start), -1, n_q), checked("goals", goals, -1, n_q)


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
    starts, goals = _ends(task, start, goals)
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
