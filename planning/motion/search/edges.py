"""The one place where an edge is judged: by the sphere covers, 16 configurations at once; what they leave open, exactly by GJK.

What the covers call free is free, and what they call touching touches (kinematics.collision.sphere_check); a thin shell remains, and only
the pieces of the edge that pass through it are looked at again (kinematics.collision.edge_check). What is carried has to stay upright
besides (planning.motion.search.upright).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinematics.chain import Chain, Int
from kinematics.collision import edge_check, edge_problem
from kinematics.collision.edge_problem import Problem, Scratch
from kinematics.collision.geometry import Query, Solids, make_parts, make_solids
from kinematics.collision.posed_geometry import PosedGeometry
from kinematics.collision.sphere_check import SphereScratch, edge_open, scratch_for
from kinematics.collision.sphere_model import SphereModel, SphereWorld, make_sphere_model, make_sphere_world, world_elsewhere
from kinematics.jit.decorators import jit_entry
from kinematics.jit.record import record
from kinematics.transforms import Array
from planning.motion.search.tree_memory import Trees, make_trees
from planning.motion.search.upright import ANY_WAY_UP, Upright, edge_upright, is_upright

LARGEST_CLEARANCE_M = 0.5
NOTHING, TILT = -1, -2
_MOST_PIECES = 48
_TOUCHES, _EVERYTHING = -1, -2


@record
class Task(NamedTuple):
    """A motion query, packed twice: exactly, and for the sphere check. covered: 0 when there are no covers and the exact test does it all.
    upright: how far what is carried may tilt."""

    exact: Problem
    model: SphereModel
    world: SphereWorld
    covered: int
    upright: Upright


@record
class Memory(NamedTuple):
    """One thread's memory for one task. pieces (N, 2): undecided pieces of an edge; trees: of a search."""

    exact: Scratch
    spheres: SphereScratch
    pieces: Array
    trees: Trees


def make_task(problem: Problem, model: SphereModel | None = None, world: SphereWorld | None = None) -> Task:
    """A task with covers, or without."""
    if model is None or world is None:
        solids, _ = make_solids([])
        empty = Query(np.zeros((0, 0), np.uint8), np.zeros((0, 2), np.int64))
        return Task(problem, make_sphere_model(problem.chain, make_parts([], []), []), make_sphere_world(solids, empty), 0, ANY_WAY_UP)
    return Task(problem, model, world, 1, ANY_WAY_UP)


def pose_task(chain: Chain, posed: PosedGeometry, model: SphereModel, solids: Solids, query: Query, margin_m: float) -> Task:
    """A motion query of posed geometry with covers, which `model` packs for the sphere check."""
    return Task(edge_problem.pose(chain, posed, solids, query, margin_m), model, make_sphere_world(solids, query), 1, ANY_WAY_UP)


def task_elsewhere(task: Task, solids: Solids) -> Task:
    """The same task with the same solids at other poses: only these are packed again."""
    return task._replace(exact=task.exact._replace(solid_T=solids.T), world=world_elsewhere(task.world, solids))


def with_clearance(task: Task, solids_m: Array, own_m: float) -> Task:
    """The same task for motions that keep some distance, proved by the covers as well as by the exact test.

    solids_m (B,): from each of the solids, in metres; own_m: of the parts from each other. Raises: ValueError for a negative or huge one.
    """
    problem, world = task.exact, task.world
    B = len(problem.solid_T)
    if solids_m.shape != (B,) or not all(0 <= m < LARGEST_CLEARANCE_M for m in (own_m, *solids_m.tolist())):
        raise ValueError(f"clearances must be {B} lengths from 0 to {LARGEST_CLEARANCE_M} m, and one between the parts")
    from_body = np.full(len(problem.boxes), own_m)
    from_body[len(from_body) - B :] = solids_m
    world = world._replace(clearance=solids_m.astype(np.float32), own_clearance=float(own_m)) if task.covered else world
    return task._replace(exact=problem._replace(clearance=from_body.take(problem.pairs[:, 1])), world=world)


def without_still(task: Task, memory: Memory) -> Task:
    """The task without the pairs that stand still to each other, such as a held object and the palm, if they are all apart.

    They are looked at here, once for all configurations; their covers overlap, so else every edge would be asked about exactly, all along.
    """
    problem, world, frame = task.exact, task.world, task.model.frame
    edge_problem.enter(problem, memory.exact)
    moving = problem.pairs[:, 2] != problem.pairs[:, 3]
    if moving.all() or not edge_check.still_apart(problem, memory.exact):
        return task
    problem = edge_problem.some_pairs(problem, moving)
    world = world._replace(pairs=world.pairs[frame[world.pairs[:, 0]] != frame[world.pairs[:, 1]]])
    return task._replace(exact=problem, world=world)


def make_memory(task: Task) -> Memory:
    """Memory for one thread; it may serve any number of queries on the same task."""
    chain, parts, solids, pairs = task.exact.chain, len(task.model.frame), len(task.exact.solid_T), len(task.exact.pairs)
    memory = memory_for(chain, parts, solids, pairs)
    edge_problem.enter(task.exact, memory.exact)
    return memory


def memory_for(chain: Chain, parts: int, solids: int, pairs: int) -> Memory:
    """Memory for one thread, for all tasks with this chain that are no larger; `edge_problem.enter` each of them first."""
    K, J = len(chain.q_index), len(chain.lower)
    return Memory(
        edge_problem.scratch_for(K, J, solids, pairs, pairs),
        scratch_for(K, parts, solids, pairs),
        np.zeros((_MOST_PIECES, 2)),
        make_trees(J),
    )


@jit_entry
def connects(task: Task, qa: Array, qb: Array, memory: Memory) -> bool:
    """Whether the arm may move straight from qa to qb (J,), for certain. Every planner asks this and nothing else."""
    if task.upright.limited and not edge_upright(task.exact.chain, task.upright, qa, qb, memory.exact):
        return False
    if not task.covered:
        return bool(edge_check.edge_free(task.exact, qa, qb, memory.exact))
    n = edge_open(task.model, task.world, qa, qb, memory.spheres, memory.pieces)
    if n == 0:
        return True
    if n == _TOUCHES:
        return False
    if n == _EVERYTHING:
        return bool(edge_check.edge_free(task.exact, qa, qb, memory.exact))
    return bool(edge_check.pieces_free(task.exact, qa, qb, memory.pieces, n, memory.spheres.left, memory.exact))


def lacks(task: Task, Q: Array, memory: Memory) -> Int:
    """What each of configurations Q (N, J) lacks to be an end of a way: NOTHING, TILT where what is carried would lean too far, else the
    pair of the exact problem that touches. The memory is ready for the task."""
    said = np.empty(len(Q), np.int64)
    judge_ends(task, np.ascontiguousarray(Q), memory, said)
    return said


@jit_entry
def judge_ends(task: Task, Q: Array, memory: Memory, said: Int) -> bool:
    """See `lacks`; said (N,). Whether any lacks nothing."""
    any_will_do = False
    for i in range(Q.shape[0]):
        said[i] = edge_check.first_contact(task.exact, Q[i], memory.exact)
        if said[i] < 0:
            said[i] = NOTHING if is_upright(task.exact.chain, task.upright, Q[i], memory.exact) else TILT
            any_will_do |= said[i] == NOTHING
    return any_will_do


@jit_entry
def connects_from_ends(task: Task, clear: Task, qa: Array, qb: Array, ends: int, near_m: float, middle: Array, memory: Memory) -> bool:
    """As `connects` by the clear task, but near the ends of a path the other one will do: both are the same but for their clearances.

    ends: 1 when qa is an end, 2 when qb is, 3 for both, else 0. near_m: so far from an end, in metres moved. middle (2, J): scratch.
    """
    length = 0.0
    for j in range(qa.shape[0]):
        length += (task.exact.weight[j] * (qb[j] - qa[j])) ** 2
    length = np.sqrt(length)
    first, last = near_m if ends & 1 else 0.0, length - (near_m if ends & 2 else 0.0)
    if first >= last:
        return connects(task if ends else clear, qa, qb, memory)
    for j in range(qa.shape[0]):
        middle[0, j] = qa[j] + first / length * (qb[j] - qa[j])
        middle[1, j] = qa[j] + last / length * (qb[j] - qa[j]) if ends & 2 else qb[j]
    if not connects(clear, middle[0], middle[1], memory):
        return False
    if ends & 1 and not connects(task, qa, middle[0], memory):
        return False
    return not (ends & 2) or connects(task, middle[1], qb, memory)
