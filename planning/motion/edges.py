"""The one place where an edge is judged: by the sphere covers, 16 configurations at once; what they leave open, exactly by GJK.

What the covers call free is free, and what they call touching touches (kinematics.lanes); a thin shell remains, and only the pieces of the
edge that pass through it are looked at again (kinematics.exact).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinematics import exact
from kinematics.arm import Chain, Query, Solids, make_parts, make_solids
from kinematics.compiling import bare
from kinematics.lane_model import LaneModel, LaneWorld, lane_model, lane_world
from kinematics.lanes import LaneScratch, edge_open, scratch_for
from kinematics.record import record
from kinematics.rig import Rig
from kinematics.transforms import Array

_MOST_PIECES = 48
_TOUCHES, _EVERYTHING = -1, -2


@record
class Task(NamedTuple):
    """A motion query, packed twice: exactly, and for the lanes. covered: 0 when there are no covers and the exact test does it all."""

    exact: exact.Problem
    model: LaneModel
    world: LaneWorld
    covered: int


@record
class Memory(NamedTuple):
    """One thread's memory for one task. pieces (N, 2): undecided pieces of an edge."""

    exact: exact.Scratch
    lanes: LaneScratch
    pieces: Array


def make_task(problem: exact.Problem, model: LaneModel | None = None, world: LaneWorld | None = None) -> Task:
    """A task with covers, or without."""
    if model is None or world is None:
        solids, _ = make_solids([])
        empty = Query(np.zeros((0, 0), np.uint8), np.zeros((0, 2), np.int64))
        return Task(problem, lane_model(problem.chain, make_parts([], []), []), lane_world(solids, empty), 0)
    return Task(problem, model, world, 1)


def pose_task(chain: Chain, rig: Rig, model: LaneModel, solids: Solids, query: Query, margin_m: float) -> Task:
    """A motion query of a rig with covers, which `model` packs for the lanes."""
    return Task(exact.pose(chain, rig, solids, query, margin_m), model, lane_world(solids, query), 1)


def without_still(task: Task, memory: Memory) -> Task:
    """The task without the pairs that stand still to each other, such as a held object and the palm, if they are all apart.

    They are looked at here, once for all configurations; their covers overlap, so else every edge would be asked about exactly, all along.
    """
    problem, world, frame = task.exact, task.world, task.model.frame
    exact.enter(problem, memory.exact)
    moving = problem.pairs[:, 2] != problem.pairs[:, 3]
    if moving.all() or not exact.still_apart(problem, memory.exact):
        return task
    problem = problem._replace(pairs=problem.pairs[moving], reach=problem.reach[moving])
    world = world._replace(pairs=world.pairs[frame[world.pairs[:, 0]] != frame[world.pairs[:, 1]]])
    return task._replace(exact=problem, world=world)


def make_memory(task: Task) -> Memory:
    """Memory for one thread; it may serve any number of queries on the same task."""
    chain, parts, solids, pairs = task.exact.chain, len(task.model.frame), len(task.exact.solid_T), len(task.exact.pairs)
    memory = memory_for(chain, parts, solids, pairs)
    exact.enter(task.exact, memory.exact)
    return memory


def memory_for(chain: Chain, parts: int, solids: int, pairs: int) -> Memory:
    """Memory for one thread, for all tasks with this chain that are no larger; `exact.enter` each of them first."""
    K, J = len(chain.q_index), len(chain.lower)
    return Memory(exact.scratch_for(K, J, solids, pairs), scratch_for(K, parts, solids, pairs), np.zeros((_MOST_PIECES, 2)))


@bare
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
    return bool(exact.pieces_free(task.exact, qa, qb, memory.pieces, n, memory.lanes.left, memory.exact))
