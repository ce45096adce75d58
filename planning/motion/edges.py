"""The one place where an edge is judged: by the sphere covers, 16 configurations at once; what they leave open, exactly by GJK.

What the covers call free is free, and what they call touching touches (kinematics.collision.sphere_check); a thin shell remains, and only
the pieces of the edge that pass through it are looked at again (kinematics.collision.edge_check).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinematics.chain import Chain
from kinematics.collision import edge_check
from kinematics.collision.geometry import Query, Solids, make_parts, make_solids
from kinematics.collision.posed_geometry import PosedGeometry
from kinematics.collision.sphere_check import SphereScratch, edge_open, scratch_for
from kinematics.collision.sphere_model import SphereModel, SphereWorld, make_sphere_model, make_sphere_world
from kinematics.jit.decorators import jit_entry
from kinematics.jit.record import record
from kinematics.transforms import Array

_MOST_PIECES = 48
_TOUCHES, _EVERYTHING = -1, -2


@record
class Task(NamedTuple):
    """A motion query, packed twice: exactly, and for the lanes. covered: 0 when there are no covers and the exact test does it all."""

    exact: edge_check.Problem
    model: SphereModel
    world: SphereWorld
    covered: int


@record
class Memory(NamedTuple):
    """One thread's memory for one task. pieces (N, 2): undecided pieces of an edge."""

    exact: edge_check.Scratch
    lanes: SphereScratch
    pieces: Array


def make_task(problem: edge_check.Problem, model: SphereModel | None = None, world: SphereWorld | None = None) -> Task:
    """A task with covers, or without."""
    if model is None or world is None:
        solids, _ = make_solids([])
        empty = Query(np.zeros((0, 0), np.uint8), np.zeros((0, 2), np.int64))
        return Task(problem, make_sphere_model(problem.chain, make_parts([], []), []), make_sphere_world(solids, empty), 0)
    return Task(problem, model, world, 1)


def pose_task(chain: Chain, posed: PosedGeometry, model: SphereModel, solids: Solids, query: Query, margin_m: float) -> Task:
    """A motion query of posed geometry with covers, which `model` packs for the lanes."""
    return Task(edge_check.pose(chain, posed, solids, query, margin_m), model, make_sphere_world(solids, query), 1)


def without_still(task: Task, memory: Memory) -> Task:
    """The task without the pairs that stand still to each other, such as a held object and the palm, if they are all apart.

    They are looked at here, once for all configurations; their covers overlap, so else every edge would be asked about exactly, all along.
    """
    problem, world, frame = task.exact, task.world, task.model.frame
    edge_check.enter(problem, memory.exact)
    moving = problem.pairs[:, 2] != problem.pairs[:, 3]
    if moving.all() or not edge_check.still_apart(problem, memory.exact):
        return task
    problem = problem._replace(pairs=problem.pairs[moving], reach=problem.reach[moving])
    world = world._replace(pairs=world.pairs[frame[world.pairs[:, 0]] != frame[world.pairs[:, 1]]])
    return task._replace(exact=problem, world=world)


def make_memory(task: Task) -> Memory:
    """Memory for one thread; it may serve any number of queries on the same task."""
    chain, parts, solids, pairs = task.exact.chain, len(task.model.frame), len(task.exact.solid_T), len(task.exact.pairs)
    memory = memory_for(chain, parts, solids, pairs)
    edge_check.enter(task.exact, memory.exact)
    return memory


def memory_for(chain: Chain, parts: int, solids: int, pairs: int) -> Memory:
    """Memory for one thread, for all tasks with this chain that are no larger; `exact.enter` each of them first."""
    K, J = len(chain.q_index), len(chain.lower)
    return Memory(edge_check.scratch_for(K, J, solids, pairs), scratch_for(K, parts, solids, pairs), np.zeros((_MOST_PIECES, 2)))


@jit_entry
def connects(task: Task, qa: Array, qb: Array, memory: Memory) -> bool:
    """Whether the arm may move straight from qa to qb (J,), for certain. Every planner asks this and nothing else."""
    if not task.covered:
        return bool(edge_check.edge_free(task.exact, qa, qb, memory.exact))
    n = edge_open(task.model, task.world, qa, qb, memory.lanes, memory.pieces)
    if n == 0:
        return True
    if n == _TOUCHES:
        return False
    if n == _EVERYTHING:
        return bool(edge_check.edge_free(task.exact, qa, qb, memory.exact))
    return bool(edge_check.pieces_free(task.exact, qa, qb, memory.pieces, n, memory.lanes.left, memory.exact))
