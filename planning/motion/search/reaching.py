"""Taking hold of an object and putting one down, without RRT-Connect: end poses, straight pieces, fingers. Compiled, whole.

Each function tries one thing after the other, the cheapest first, and says how far it got: OK, or the stage at which it was blocked, with
the pair of bodies that touched (an index into that task's pairs, -1 when it was the arm's reach).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Chain, Int
from kinematics.collision import edge_check, edge_problem, pair_bounds
from kinematics.collision.edge_problem import MARGIN_M, Problem
from kinematics.collision.posed_geometry import PosedGeometry
from kinematics.collision.sphere_model import place_body
from kinematics.inverse import BRISK, descend, make_work
from kinematics.jit.decorators import copy_row, copy_rows, jit_entry, jit_inline
from kinematics.jit.record import record
from kinematics.transforms import Array, inverse
from planning.motion.search.edges import Memory, Task, connects

LARGEST_TURN = 0.3  # rad by which a joint may turn between two such waypoints: beyond it the arm is passing a singularity
APPROACH_M = 0.06
LIFT_M = 0.02
APPROACH_STEPS, LIFT_STEPS = 6, 2  # waypoints every centimetre: between two of them the hand strays from the line by less than 0.1 mm
PLACE_GAP_M = 2 * MARGIN_M  # what a placed object keeps from all others
PLACE_TURNS = (0.0, 0.5, -0.5, 1.0, -1.0)  # how far from its natural bearing the hand may turn where it puts an object down, rad
OK, REACH, REGION, AT_GRASP, BACKWARDS, FINGERS, LIFTED, UPWARDS = 0, 1, 2, 3, 4, 5, 6, 7
"""How far it got: all is well; no solution of inverse kinematics; the object would not stand free; the arm at the end pose; the straight
way between end pose and free space with an open hand; the closing or opening fingers; the arm at the end pose with the object in the hand;
the straight way up or down with it."""


FREE, HANGS_OVER = -2, -1


@record
class Hand(NamedTuple):
    """The arm's hand, T_frame_hand (4, 4) in the chain's last frame and the other way round; one thread's memory: frames and work for
    `inverse.descend`, T (3, 4, 4), by (3,). backing: the same chain for a hand that goes back, of few joints one with a free heading."""

    chain: Chain
    backing: Chain
    T_frame_hand: Array
    T_hand_frame: Array
    frames: Array
    work: Array
    T: Array
    by: Array


def make_hand(chain: Chain, backing: Chain, T_frame_hand: Array) -> Hand:
    """A hand with memory for one thread."""
    return Hand(chain, backing, T_frame_hand, inverse(T_frame_hand), *make_work(chain), np.empty((3, 4, 4)), np.empty(3))


@record
class PlacementQuery(NamedTuple):
    """An object against all that it must stand free of: its pieces as a part of the world, and the pairs of them and the others.

    front (4,): the direction into the cabinet, and where along it the floor begins, which it must not hang over.
    """

    body: PosedGeometry
    problem: Problem
    front: Array


@record
class PutDown(NamedTuple):
    """Putting a held object down: the tasks with it in the hand, and with it standing, its solids being rows first:last of those worlds.

    lowering: in the hand, which is closed; opening: it stands, fingers on their way open; retreating: it stands, the hand is open.
    standing: the object among the others. T_hand_body (4, 4).
    """

    lowering: Task
    opening: Problem
    retreating: Task
    first: int
    last: int
    standing: PlacementQuery
    T_hand_body: Array


@jit_inline
def straight(hand: Hand, task: Task, T_world_hand: Array, by_m: float, way: Array, memory: Memory) -> tuple[bool, int]:
    """Take the hand from T_world_hand, where way[0] puts it, straight back along its own z, by_m < 0, or up, by_m > 0: the waypoints in
    way (n, A). A hand that goes back may turn about the vertical on the way where its arm can't do otherwise.

    Whether it is free, and if not, the pair that touches; -1 when the arm can't follow or passes a singularity, or when the contact lies
    between two waypoints.
    """
    T, steps = hand.T[0], way.shape[0] - 1
    copy_rows(T_world_hand, T)
    for r in range(3):
        hand.by[r] = by_m * T_world_hand[r, 2] if by_m < 0.0 else (by_m if r == 2 else 0.0)
    for k in range(1, steps + 1):
        for r in range(3):
            T[r, 3] = T_world_hand[r, 3] + k / steps * hand.by[r]
        copy_row(way[k - 1], way[k])
        if not descend(hand.backing if by_m < 0.0 else hand.chain, hand.T_frame_hand, T, way[k], hand.frames, hand.work, BRISK):
            return False, -1
        for j in range(way.shape[1]):
            if abs(way[k, j] - way[k - 1, j]) > LARGEST_TURN:
                return False, -1
        if not connects(task, way[k - 1], way[k], memory):
            return False, int(edge_check.first_contact(task.exact, way[k], memory.exact))
    pair = int(edge_check.first_contact(task.exact, way[steps], memory.exact))  # a search that begins there asks for the margin, too
    return pair < 0, pair


@jit_inline
def hand_touches(hand: Hand, task: Task, T_world_hand: Array, memory: Memory) -> int:
    """The pair of a task in which the hand alone, or what it holds, touches something at a pose (4, 4), wherever the arm is; or -1."""
    T, H = hand.T[2], hand.T_hand_frame
    for r in range(4):
        for c in range(4):
            T[r, c] = 0.0
            for k in range(4):
                T[r, c] += T_world_hand[r, k] * H[k, c]
    return int(edge_check.frame_contact(task.exact, hand.chain.q_index.shape[0], T, memory.exact))


@jit_entry
def hand_way_in(hand: Hand, reaching: Task, T_world_hand: Array, memory: Memory) -> tuple[int, int]:
    """How far the open hand alone gets in coming to a pose (4, 4), and the pair that touched: no arm can do better. See `ways_in`."""
    edge_problem.enter(reaching.exact, memory.exact)
    T = hand.T[0]
    copy_rows(T_world_hand, T)
    for k in range(APPROACH_STEPS + 1):
        for r in range(3):
            T[r, 3] = T_world_hand[r, 3] - k / APPROACH_STEPS * APPROACH_M * T_world_hand[r, 2]
        pair = hand_touches(hand, reaching, T, memory)
        if pair >= 0:
            return (AT_GRASP if k == 0 else BACKWARDS), pair
    return OK, -1


@jit_entry
def hands_way_in(hand: Hand, reaching: Task, T_world_hand: Array, memory: Memory, free: NDArray[np.bool_]) -> None:
    """Whether the open hand alone gets to each of some poses (N, 4, 4): free (N,)."""
    for i in range(T_world_hand.shape[0]):
        free[i] = hand_way_in(hand, reaching, T_world_hand[i], memory)[0] == OK


@jit_entry
def ways_in(
    hand: Hand,
    reaching: Task,
    T_world_hand: Array,
    solutions: Array,
    memory: Memory,
    found: Array,
    said: Int,
) -> int:
    """The straight ways of an open hand to a pose (4, 4), where solutions (S, A) put it: how many are free.

    found (S, n, A): waypoints of the free ones, from before the object to it. said (S, 2): how far each solution got, and the pair that
    touched.
    """
    n, last = 0, found.shape[1] - 1
    for s in range(solutions.shape[0]):
        way = found[n]
        said[s, 0], said[s, 1] = AT_GRASP, touching(reaching, solutions[s], memory)
        if said[s, 1] >= 0:
            continue
        copy_row(solutions[s], way[0])
        said[s, 0] = BACKWARDS
        free, said[s, 1] = straight(hand, reaching, T_world_hand, -APPROACH_M, way, memory)
        if not free:
            continue
        said[s, 0] = OK
        for k in range((last + 1) // 2):
            for j in range(way.shape[1]):
                way[k, j], way[last - k, j] = way[last - k, j], way[k, j]
        n += 1
    return n


@jit_entry
def lift(hand: Hand, lifting: Task, T_world_hand: Array, q: Array, way: Array, memory: Memory) -> tuple[int, int]:
    """Take a held object straight up from where q (A,) puts the hand, T_world_hand (4, 4): waypoints in way (n, A)."""
    pair = touching(lifting, q, memory)
    if pair >= 0:
        return LIFTED, pair
    copy_row(q, way[0])
    free, pair = straight(hand, lifting, T_world_hand, LIFT_M, way, memory)
    return (OK if free else UPWARDS), pair


@jit_inline
def touching(task: Task, q: Array, memory: Memory) -> int:
    """The pair of a task that touches at q (A,), or -1; the memory is made ready for the task."""
    edge_problem.enter(task.exact, memory.exact)
    return int(edge_check.first_contact(task.exact, q, memory.exact))


@jit_entry
def fingers(moving: Problem, q: Array, memory: Memory) -> int:
    """What touches while the fingers move, the arm being at q (A,): a pair of the problem, which has them at several openings, or -1."""
    edge_problem.enter(moving, memory.exact)
    return int(edge_check.first_contact(moving, q, memory.exact))


@jit_entry
def put_down(
    hand: Hand, p: PutDown, R: Array, natural: float, centre: Array, turns: Array, starts: Array, memory: Memory, lower: Array,
    retreat: Array, T_body: Array,
) -> tuple[int, int]:  # fmt: skip
    """Put the held object down with its middle over `centre` (3,) on the floor, turned from R (3, 3) by `natural` rad about the vertical
    and one of `turns` more, by the solution of inverse kinematics that one of starts (S, A) leads to. How far it got, and the pair that
    touched.

    turns: in which order they are tried; the one that works is moved to the front. lower (n, A): the waypoints down, retreat (m, A): those
    back, T_body (4, 4): where the object stands then.
    """
    said, pair = REGION, FREE
    for i in range(turns.shape[0]):
        code, touch = _put_down_turned(hand, p, R, natural + turns[i], centre, starts, memory, lower, retreat, T_body)
        if code == OK:
            for k in range(i, 0, -1):
                turns[k], turns[k - 1] = turns[k - 1], turns[k]
            return OK, -1
        if said == REGION or (code > said and code != REGION):
            said, pair = code, touch
    return said, pair


@jit_inline
def _put_down_turned(
    hand: Hand, p: PutDown, R: Array, turn: float, centre: Array, starts: Array, memory: Memory, lower: Array, retreat: Array, T_body: Array
) -> tuple[int, int]:
    """Put the held object down, turned from R (3, 3) by `turn` rad about the vertical. See `put_down`."""
    place_on_floor(p.standing.body.vertices, R, turn, centre, T_body)
    touch = stands(p.standing, T_body, memory)
    if touch != FREE:
        return REGION, touch
    T_hand = hand.T[1]
    hand_at(T_body, p.T_hand_body, T_hand)
    edge_problem.enter(p.lowering.exact, memory.exact)
    touch = hand_touches(hand, p.lowering, T_hand, memory)
    if touch >= 0:
        return LIFTED, touch
    said, pair = REACH, -1
    for s in range(starts.shape[0]):
        copy_row(starts[s], lower[0])
        if descend(hand.chain, hand.T_frame_hand, T_hand, lower[0], hand.frames, hand.work, BRISK):
            code, touch = _put_down_from(hand, p, T_body, T_hand, memory, lower, retreat)
            if code == OK:
                return OK, -1
            if code >= said:
                said, pair = code, touch
    return said, pair


@jit_inline
def _put_down_from(hand: Hand, p: PutDown, T_body: Array, T_hand: Array, memory: Memory, lower: Array, retreat: Array) -> tuple[int, int]:
    """Put the held object down at T_body (4, 4), the hand being at T_hand (4, 4) with the arm at lower[0] (A,). See `put_down`."""
    q = retreat[0]
    copy_row(lower[0], q)
    pair = touching(p.lowering, q, memory)
    if pair >= 0:
        return LIFTED, pair
    for b in range(p.first, p.last):
        move_body(p.retreating, b, T_body)
    pair = touching(p.retreating, q, memory)
    if pair >= 0:
        return AT_GRASP, pair
    edge_problem.enter(p.lowering.exact, memory.exact)
    free, pair = straight(hand, p.lowering, T_hand, LIFT_M, lower, memory)
    if not free:
        return UPWARDS, pair
    last = lower.shape[0] - 1
    for k in range((last + 1) // 2):
        for j in range(lower.shape[1]):
            lower[k, j], lower[last - k, j] = lower[last - k, j], lower[k, j]
    for b in range(p.first, p.last):
        copy_rows(T_body, p.opening.solid_T[b])
    pair = fingers(p.opening, q, memory)
    if pair >= 0:
        return FINGERS, pair
    edge_problem.enter(p.retreating.exact, memory.exact)
    free, pair = straight(hand, p.retreating, T_hand, -APPROACH_M, retreat, memory)
    return (OK if free else BACKWARDS), pair


@jit_entry
def put_down_all(
    hand: Hand, p: PutDown, R: Array, natural: Array, centres: Array, turns: Array, starts: Array, memory: Memory, lower: Array,
    retreat: Array, T_body: Array, ends: Array, codes: Int,
) -> None:  # fmt: skip
    """`put_down` over each of centres (N, 3): where each lowering begins, ends (N, A), and how far each got, codes (N,)."""
    for i in range(centres.shape[0]):
        codes[i], _ = put_down(hand, p, R, natural[i], centres[i], turns, starts, memory, lower, retreat, T_body)
        copy_row(lower[0], ends[i])


@jit_entry
def stands(s: PlacementQuery, T_body: Array, memory: Memory) -> int:
    """FREE when the object stands free at T_body (4, 4), HANGS_OVER the front edge, or else the pair of its problem that is too close."""
    problem, scratch = s.problem, memory.exact
    edge_problem.enter(problem, scratch)
    copy_rows(T_body, scratch.poses[0])
    v, least = s.body.vertices, np.inf
    for i in range(v.shape[1]):
        x = 0.0
        for r in range(3):
            x += s.front[r] * (T_body[r, 0] * v[0, i] + T_body[r, 1] * v[1, i] + T_body[r, 2] * v[2, i] + T_body[r, 3])
        least = min(least, x)
    if least < s.front[3]:
        return HANGS_OVER
    pairs, boxes, vertices, groups, poses = problem.pairs, problem.boxes, problem.vertices, problem.groups, scratch.poses
    for n in range(pairs.shape[0]):
        if pair_bounds.ball_gap(pairs, boxes, poses, n) < PLACE_GAP_M:
            bound = pair_bounds.pair_bound(
                pairs, boxes, vertices, groups, poses, scratch.work, scratch.toward, n, PLACE_GAP_M, 1.02 * PLACE_GAP_M, np.inf, 0.02
            )
            if bound < PLACE_GAP_M:
                return int(n)
    return FREE


@jit_entry
def stands_over(s: PlacementQuery, R: Array, centres: Array, T: Array, memory: Memory, free: NDArray[np.bool_]) -> None:
    """Over which of centres (N, 3) the object stands free with rotation R (3, 3): free (N,). T (4, 4) is overwritten."""
    for i in range(centres.shape[0]):
        place_on_floor(s.body.vertices, R, 0.0, centres[i], T)
        free[i] = stands(s, T, memory) == FREE


@jit_inline
def move_body(task: Task, b: int, T: Array) -> None:
    """Put solid b of a task at pose T (4, 4); `edge_problem.enter` it afterwards."""
    problem = task.exact
    row = problem.boxes.shape[0] - problem.solid_T.shape[0] + b
    copy_rows(T, problem.solid_T[b])
    place_body(task.world, b, T, problem.boxes[row])


@jit_entry
def place_on_floor(v: Array, R: Array, turn: float, centre: Array, T: Array) -> None:
    """Pose T (4, 4) of a body with vertices v (3, V), turned from R (3, 3) about the vertical: its box's middle over `centre` (3,), its
    bottom on that height."""
    co, si = np.cos(turn), np.sin(turn)
    for c in range(3):
        T[0, c] = co * R[0, c] - si * R[1, c]
        T[1, c] = si * R[0, c] + co * R[1, c]
        T[2, c] = R[2, c]
        T[3, c] = 0.0
    T[3, 3] = 1.0
    for r in range(3):
        low, high = np.inf, -np.inf
        for i in range(v.shape[1]):
            x = T[r, 0] * v[0, i] + T[r, 1] * v[1, i] + T[r, 2] * v[2, i]
            low, high = min(low, x), max(high, x)
        T[r, 3] = centre[r] - ((low + high) / 2 if r < 2 else low)


@jit_inline
def hand_at(T_body: Array, H: Array, T_hand: Array) -> None:
    """Where the hand is, T_hand (4, 4), when it holds the object at T_body (4, 4): T_body · H⁻¹ with H = T_hand_body."""
    for r in range(4):
        for c in range(3):
            T_hand[r, c] = T_body[r, 0] * H[c, 0] + T_body[r, 1] * H[c, 1] + T_body[r, 2] * H[c, 2]
    for r in range(4):
        T_hand[r, 3] = T_body[r, 3] - (T_hand[r, 0] * H[0, 3] + T_hand[r, 1] * H[1, 3] + T_hand[r, 2] * H[2, 3])
