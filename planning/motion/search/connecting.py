"""A path with as much clearance as there is: RRT-Connect and shortcuts at falling distances from everything, retreating from narrow ends.

The wanted distance is tried first, and briefly; then whether there is a path at all, with the whole budget; then the distances between. So
a motion that can't be had costs little more than one search, and one that can keeps well clear wherever its ends let it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from kinematics.collision import edge_problem
from kinematics.transforms import Array
from planning.motion.search.edges import NOTHING, Memory, Task, connects, lacks
from planning.motion.search.pulling import WAYS, pull
from planning.motion.search.rrt_connect import Route, plan
from planning.motion.search.shortcut import shorten
from planning.motion.settings import MotionSettings

PULL_OUT_M, PULLS_OUT = 0.02, 5
"""Steps in which the hand is pulled out of a narrow end, and how many."""
MOST_ENDS = 8
"""Starts, and goals, that a search with clearance is given."""


def connect(
    task: Task,
    keeping: Callable[[float], Task],
    starts: Array,
    goals: Array,
    *,
    max_iterations: int,
    time_budget_s: float | None,
    seed: int,
    memory: Memory,
    settings: MotionSettings,
    known: Sequence[Array] = (),
) -> Route:
    """A shortened path from the nearest of starts (S, A) to the nearest of goals (G, A), each edge certified.

    task: the query at the least clearance, which starts and goals are to hold to; keeping: the same at another clearance, in metres.
    The memory is ready for the task, and has served others afterwards. max_iterations, time_budget_s: of the search at the least clearance.
    known: see `rrt_connect.plan`.
    """
    *wider, _ = settings.clearance.levels_m
    briefly = min(settings.clearance.iterations, max_iterations)
    for level in wider[:1]:
        if (found := connect_clear(task, keeping(level), starts, goals, briefly, seed, memory, settings, known)) is not None:
            return found
        edge_problem.enter(task.exact, memory.exact)
    found = plan(
        task, starts, goals, max_iterations=max_iterations, time_budget_s=time_budget_s, seed=seed, memory=memory, settings=settings.rrt,
        known=known,
    )  # fmt: skip
    if found.path is None:
        return found
    closely = found._replace(path=shorten(task, found.path, settings=settings.shortcuts, seed=seed, memory=memory).path)
    clear = (connect_clear(task, keeping(level), starts, goals, briefly, seed, memory, settings, known) for level in wider[1:])
    return next((route for route in clear if route is not None), closely)


def connect_clear(
    task: Task, clear: Task, starts: Array, goals: Array, iterations: int, seed: int, memory: Memory, settings: MotionSettings,
    known: Sequence[Array] = (),
) -> Route | None:  # fmt: skip
    """A path by the clear task, found within a few iterations, or None. Where an end is nearer to something than that, the hand is pulled
    straight out of there first, by edges of the other task. known: see `rrt_connect.plan`."""
    begins = ways_out(task, clear, starts[:MOST_ENDS], memory)
    ends = ways_out(task, clear, goals[:MOST_ENDS], memory) if begins else []
    if not ends:
        return None
    edge_problem.enter(clear.exact, memory.exact)
    first, last = (np.array([way[-1] for _, way in ways]) for ways in (begins, ends))
    found = plan(clear, first, last, max_iterations=iterations, seed=seed, memory=memory, settings=settings.rrt, known=known)
    if found.path is None:
        return None
    short = shorten(clear, found.path, settings=settings.shortcuts, seed=seed, memory=memory).path
    assert short is not None
    (start, begin), (goal, end) = begins[found.start], ends[found.goal]
    return found._replace(path=np.concatenate([begin[:-1], short, end[-2::-1]]), start=start, goal=goal)


def ways_out(task: Task, clear: Task, Q: Array, memory: Memory) -> list[tuple[int, Array]]:
    """From each of Q (N, A) to where the clear task holds, as its index and waypoints (K, A): itself alone where it does there, else a
    straight pull of the hand that is free by the other task. Those from which no pull gets there are left out."""
    edge_problem.enter(clear.exact, memory.exact)
    held = lacks(clear, Q, memory) == NOTHING
    ways = ((i, q[None] if held[i] else _pulled_out(task, clear, q, memory)) for i, q in enumerate(Q))
    return [(i, way) for i, way in ways if way is not None]


def _pulled_out(task: Task, clear: Task, q: Array, memory: Memory) -> Array | None:
    for way in range(WAYS):
        out = [q]
        for _ in range(PULLS_OUT):
            there = pull(task.exact.chain, out[-1], way, PULL_OUT_M)
            edge_problem.enter(task.exact, memory.exact)
            if not connects(task, out[-1], there, memory):
                break
            out.append(there)
            edge_problem.enter(clear.exact, memory.exact)
            if lacks(clear, there[None], memory)[0] == NOTHING:
                return np.array(out)
    return None
