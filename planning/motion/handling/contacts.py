"""Which solids a motion meets: all of them, and not only the first. Compiled.

Collision checks elsewhere end at the first contact. Whoever looks ahead asks who else is in the way, so these functions go on. Their
`met` (B + 1,) has a flag for each solid of the problem and one more for the arm and what it holds among themselves. 1 on entry leaves that
out of the question, 1 on return says that it is met, too.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import forward
from kinematics.collision import edge_check, edge_problem, pair_bounds
from kinematics.collision.edge_problem import Problem, Scratch
from kinematics.collision.pair_bounds import TOLERANCE
from kinematics.jit.decorators import copy_rows, jit_entry, jit_inline
from kinematics.transforms import Array
from planning.motion.search.reaching import APPROACH_M, APPROACH_STEPS, Hand

Flags = NDArray[np.uint8]
WHOLE = np.array([[0.0, 1.0]])
"""An edge as a whole, for `edge_check.pieces_free`."""


@jit_entry
def meet_at(problem: Problem, Q: Array, scratch: Scratch, met: Flags) -> None:
    """Flag the solids that the arm, or what it holds, touches at each of Q (N, J), and whether these touch each other: met (N, B + 1)."""
    for i in range(Q.shape[0]):
        _meet_at(problem, Q[i], scratch, met[i])


@jit_inline
def _meet_at(problem: Problem, q: Array, scratch: Scratch, met: Flags) -> None:
    edge_problem.enter(problem, scratch)
    forward(problem.chain, q, scratch.poses)
    _meet(problem, -1, scratch, met)


@jit_entry
def meet_hand(hand: Hand, problem: Problem, T_world_hand: Array, scratch: Scratch, met: Flags) -> None:
    """Flag the solids that the open hand alone touches on its straight way to T_world_hand (4, 4), wherever the arm is."""
    edge_problem.enter(problem, scratch)
    T, frame, H = hand.T[0], problem.chain.q_index.shape[0], hand.T_hand_frame
    for k in range(APPROACH_STEPS + 1):
        for r in range(3):
            back = T_world_hand[r, 3] - k / APPROACH_STEPS * APPROACH_M * T_world_hand[r, 2]
            for c in range(4):
                T[r, c] = T_world_hand[r, 0] * H[0, c] + T_world_hand[r, 1] * H[1, c] + T_world_hand[r, 2] * H[2, c] + back * H[3, c]
        T[3, 0], T[3, 1], T[3, 2], T[3, 3] = 0.0, 0.0, 0.0, 1.0
        copy_rows(T, scratch.poses[frame])
        _meet(problem, frame, scratch, met)


@jit_entry
def meet_along(problem: Problem, way: Array, whole: Array, open_: Flags, scratch: Scratch, met: Flags) -> None:
    """Flag the solids that the arm, or what it holds, touches on straight joint-space edges between the rows of way (n, J), and whether
    these touch each other.

    whole: `WHOLE`. open_ (P + B, P + B): scratch for the pairs of bodies that are looked at.
    """
    edge_problem.enter(problem, scratch)
    B = problem.solid_T.shape[0]
    for k in range(way.shape[0] - 1):
        for b in range(B + 1):
            _open(problem, b, 1 - met[b], open_)
        if edge_check.pieces_free(problem, way[k], way[k + 1], whole, 1, open_, scratch):
            continue
        for b in range(B + 1):
            _open(problem, b, 0, open_)
        for b in range(B + 1):
            if met[b] == 0:
                _open(problem, b, 1, open_)
                met[b] = 0 if edge_check.pieces_free(problem, way[k], way[k + 1], whole, 1, open_, scratch) else 1
                _open(problem, b, 0, open_)


@jit_entry
def clear_of(
    reach: Problem, closing: Problem, lifting: Problem, approach: Array, up: Array, first: int, last: int,
    T: Array, whole: Array, open_: Flags, scratch: Scratch, met: Flags, clear: NDArray[np.bool_],
) -> None:  # fmt: skip
    """For each of poses T (R, 4, 4) of the object whose solids are first:last, whether a whole way to another one is clear of it: (R,).

    reach: the empty hand, along approach (n, A); closing: the fingers on their way, at its end; lifting: the object in the hand, along up
    (m, A). All have the same solids, which are moved. whole, open_: see `meet_along`. met (B + 1,): scratch.
    """
    for r in range(T.shape[0]):
        for b in range(first, last):
            copy_rows(T[r], reach.solid_T[b])
        clear[r] = _clear_along(reach, approach, first, last, whole, open_, scratch)
        if clear[r]:
            for b in range(met.shape[0]):
                met[b] = 0 if first <= b < last else 1
            _meet_at(closing, approach[approach.shape[0] - 1], scratch, met)
            for b in range(first, last):
                clear[r] = clear[r] and met[b] == 0
        if clear[r]:
            clear[r] = _clear_along(lifting, up, first, last, whole, open_, scratch)


@jit_inline
def _clear_along(problem: Problem, way: Array, first: int, last: int, whole: Array, open_: Flags, scratch: Scratch) -> bool:
    """Whether all edges between the rows of way (n, J) are clear of solids first:last."""
    edge_problem.enter(problem, scratch)
    for b in range(problem.solid_T.shape[0] + 1):
        _open(problem, b, 1 if first <= b < last else 0, open_)
    free = True
    for k in range(way.shape[0] - 1, 0, -1):  # the end is the likeliest to touch
        free = free and edge_check.pieces_free(problem, way[k - 1], way[k], whole, 1, open_, scratch)
    return free


@jit_inline
def _open(problem: Problem, b: int, value: int, open_: Flags) -> None:
    """Set whether the pairs of the moving bodies and solid b are looked at; with b = B, those of the moving bodies among themselves."""
    B = problem.solid_T.shape[0]
    P = problem.boxes.shape[0] - B
    for p in range(P):
        if b < B:
            open_[p, P + b] = value
        else:
            for other in range(P):
                open_[p, other] = value


@jit_inline
def _meet(problem: Problem, frame: int, scratch: Scratch, met: Flags) -> None:
    """Flag what is touched by what one frame of the chain carries, -1 for all frames; the frames' poses stand in the scratch.

    One frame alone is not held against the rest of the arm, of which nobody knows where it is.
    """
    pairs, boxes, poses, margin = problem.pairs, problem.boxes, scratch.poses, problem.margin_m
    frames, B = problem.chain.q_index.shape[0] + 1, problem.solid_T.shape[0]
    for n in range(pairs.shape[0]):
        b = pairs[n, 3] - frames if pairs[n, 3] >= frames else B
        if met[b] or (frame >= 0 and (b == B or pairs[n, 2] != frame)) or pair_bounds.ball_gap(pairs, boxes, poses, n) > margin:
            continue
        high, work, toward = margin * (1 + TOLERANCE), scratch.work, scratch.toward
        bound = pair_bounds.pair_bound(
            pairs, boxes, problem.vertices, problem.groups, poses, work, toward, n, margin, high, np.inf, TOLERANCE
        )
        if bound <= margin:
            met[b] = 1
