"""The one place where an edge is judged: by the sphere covers, 16 configurations at once; what they leave open, exactly by GJK.

What the covers call free is free, and what they call touching touches (kinematics.lanes); a thin shell remains, and only the pieces of the
edge that pass through it are looked at again (kinematics.exact).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from kinematics import exact
from kinematics.arm import Query, make_parts, make_solids
from kinematics.lanes import LaneModel, LaneScratch, LaneWorld, edge_open, lane_model, lane_scratch, lane_world
from kinematics.transforms import Array

_MOST_PIECES = 48
_TOUCHES, _EVERYTHING = -1, -2


class Task(NamedTuple):
    """A motion query, packed twice: exactly, and for the lanes. covered: 0 when there are no covers and the exact test does it all."""

    exact: exact.Problem
    model: LaneModel
    world: LaneWorld
    covered: int


class Memory(NamedTuple):
    """One thread's memory for one task. pieces (N, 2): undecided pieces of an edge; ends (2, J): of one of them."""

    exact: exact.Scratch
    lanes: LaneScratch
    pieces: Array
    ends: Array


def make_task(problem: exact.Problem, model: LaneModel | None = None, world: LaneWorld | None = None) -> Task:
    """A task with covers, or without.

    Parts that stand still to each other, such as a held object and the palm, are looked at here, once and exactly, and left out when they
    are apart: their covers overlap at every configuration, so every edge would be asked about exactly, all along.
    """
    still = problem.pairs[:, 2] == problem.pairs[:, 3]
    if still.any():
        only = problem._replace(pairs=problem.pairs[still], reach=problem.reach[still])
        if exact.config_free(only, problem.chain.lower, exact.make_scratch(only)):
            problem = problem._replace(pairs=problem.pairs[~still], reach=problem.reach[~still])
            if model is not None and world is not None:
                world = world._replace(pairs=world.pairs[model.frame[world.pairs[:, 0]] != model.frame[world.pairs[:, 1]]])
    if model is None or world is None:
        solids, _ = make_solids([])
        empty = Query(np.zeros((0, 0), np.uint8), np.zeros((0, 2), np.int64))
        return Task(problem, lane_model(problem.chain, make_parts([], []), []), lane_world(solids, empty), 0)
    return Task(problem, model, world, 1)


def make_memory(task: Task) -> Memory:
    """Memory for one thread; it may serve any number of queries on the same task."""
    J = len(task.exact.chain.lower)
    return Memory(exact.make_scratch(task.exact), lane_scratch(task.model, task.world), np.zeros((_MOST_PIECES, 2)), np.zeros((2, J)))


@njit(cache=True, nogil=True)
def connects(task: Task, qa: Array, qb: Array, memory: Memory) -> bool:
    """Whether the arm may move straight from qa to qb (J,), for certain. Every planner asks this and nothing else."""
    if not task.covered:
        return bool(exact.edge_free(task.exact, qa, qb, memory.exact))
    n = edge_open(task.model, task.world, qa, qb, memory.lanes, memory.pieces)
    if n == 0:
        return True
    if n == _TOUCHES:
        return False
    if n == _EVERYTHING:
        return bool(exact.edge_free(task.exact, qa, qb, memory.exact))
    for i in range(n):
        for j in range(qa.shape[0]):
            memory.ends[0, j] = qa[j] + memory.pieces[i, 0] * (qb[j] - qa[j])
            memory.ends[1, j] = qa[j] + memory.pieces[i, 1] * (qb[j] - qa[j])
        if not exact.edge_free(task.exact, memory.ends[0], memory.ends[1], memory.exact):
            return False
    return True
