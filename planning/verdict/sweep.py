"""A motion in samples so near to each other that no point of what moves goes further than a step, and quick bounds between boxes.

Between two poses of a solid the displacement of its points is greatest at a corner of a box around it. It is measured over pieces of at
most `COARSE` in any joint, within which speeds vary by less than `SLACK` allows for; on a spline, where joints speed up and slow down, from
sample to sample, and pieces are cut until none is longer than a step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.robots.plain_urdf import Arm, poses
from kinematics.shapes import box_corners
from kinematics.transforms import Array
from planning.verdict.course import Course
from planning.verdict.polyhedra import Int

COARSE, SLACK = 0.03, 1.1  # rad (or m); a tenth
ENOUGH = 2  # samples; an interval no longer than this is not cut for the sake of boxes
_SIGNS = box_corners(np.ones(3))


@dataclass(frozen=True, eq=False)
class Boxes:
    """Boxes around B solids: those of M that move first, then of those that stand. carrier (M,): what they move with; T (B, 4, 4): the
    solid's frame in its carrier, or in the world; middle, half (B, 3): in the solid's frame."""

    carrier: Int
    T: Array
    middle: Array
    half: Array


@dataclass(frozen=True, eq=False)
class Sweep:
    """Samples of a motion: places rows (N,) on its way, and there poses T (N, M, 4, 4) of what moves and T_standing (S, 4, 4).

    middle, half (M + S, 3): of the boxes, in the solids' frames. gone (N, M + S): how far a point has moved at most since the first sample.
    """

    rows: Array
    T: Array
    T_standing: Array
    middle: Array
    half: Array
    gone: Array

    def pose(self, n: int, b: int) -> Array:
        """Where solid b is (4, 4) at sample n."""
        movers = self.T.shape[1]
        return np.asarray(self.T[n, b] if b < movers else self.T_standing[b - movers])

    def poses(self, n: Int, b: Int) -> Array:
        """Where solids b (P,) are, (P, 4, 4), at samples n (P,)."""
        movers = self.T.shape[1]
        out = np.empty((len(b), 4, 4))
        moves = b < movers
        out[moves] = self.T[n[moves], b[moves]]
        out[~moves] = self.T_standing[b[~moves] - movers]
        return out


def sweep(arm: Arm, T_world_base: Array, course: Course, boxes: Boxes, step_m: float) -> Sweep:
    """The samples of a motion, its rows among them, step_m apart."""
    (rows, q), movers = course.dense(COARSE), len(boxes.carrier)
    T = _poses(arm, T_world_base, q, boxes)
    while True:
        finer, gone = _cut(rows, SLACK * _moved(T, boxes.middle[:movers], boxes.half[:movers]), step_m)
        if len(finer) == len(rows):
            break
        rows, T = finer, _poses(arm, T_world_base, course.at(finer), boxes)
        if course.spline is None:  # joints go evenly within a piece
            break
    still = np.zeros((len(rows), len(boxes.half) - movers))
    return Sweep(rows, T, boxes.T[movers:], boxes.middle, boxes.half, np.concatenate([gone, still], axis=1))


def _cut(rows: Array, far: Array, step_m: float) -> tuple[Array, Array]:
    """Places (N,) on a way whose pieces (P,) are cut evenly, so that what goes `far` (P, M) in one goes no further than a step at once; and
    how far each has gone (N, M) at them, if it goes evenly."""
    counts = np.maximum(1, np.ceil(far.max(1, initial=0.0) / step_m)).astype(np.int64)
    piece = np.repeat(np.arange(len(counts)), counts)
    share = (np.arange(len(piece)) - (np.cumsum(counts) - counts)[piece] + 1) / counts[piece]
    fine = np.concatenate([rows[:1], rows[piece] + share * np.diff(rows)[piece]])
    return fine, np.concatenate([np.zeros((1, far.shape[1])), np.cumsum((far / counts[:, None])[piece], axis=0)])


def _poses(arm: Arm, T_world_base: Array, q: Array, boxes: Boxes) -> Array:
    """Poses (N, M, 4, 4) of what moves at configurations q (N, J)."""
    at = poses(arm, q, T_world_base, frozenset(boxes.carrier.tolist()))
    T = np.empty((len(q), len(boxes.carrier), 4, 4))
    for i, c in enumerate(boxes.carrier.tolist()):
        np.matmul(at[c], boxes.T[i], out=T[:, i])
    return T


def _moved(T: Array, middle: Array, half: Array) -> Array:
    """How far (N - 1, M) a corner of each box moves at most from one pose in T (N, M, 4, 4) to the next."""
    turn, way = np.diff(T[..., :3, :3], axis=0), np.diff(T[..., :3, 3], axis=0)
    corners = np.swapaxes(middle[:, None] + half[:, None] * _SIGNS, 1, 2)  # (M, 3, 8)
    ways = turn @ corners + way[..., None]
    return np.asarray(np.sqrt((ways**2).sum(2).max(2)))


def least_distance(s: Sweep, a: Int, b: Int, n: Int) -> Array:
    """A lower bound (P,) of the distance of solids a (P,) and b (P,) at samples n (P,): how far their boxes are apart along their own axes,
    or one's ball from the other's box; 0 or less says nothing."""
    T_a, T_b, half_a, half_b = s.poses(n, a), s.poses(n, b), s.half[a], s.half[b]
    R_a, R_b = T_a[:, :3, :3], T_b[:, :3, :3]
    way = T_b[:, :3, 3] - T_a[:, :3, 3] + (R_b @ s.middle[b][..., None] - R_a @ s.middle[a][..., None])[..., 0]
    turn = np.abs(np.swapaxes(R_a, 1, 2) @ R_b)
    in_a, in_b = np.abs(way[:, None] @ R_a)[:, 0], np.abs(way[:, None] @ R_b)[:, 0]
    beyond_a, beyond_b = in_a - half_a, in_b - half_b
    along_a = (beyond_a - (turn @ half_b[..., None])[..., 0]).max(1)
    along_b = (beyond_b - (half_a[:, None] @ turn)[:, 0]).max(1)
    ball_b = np.sqrt((np.maximum(beyond_a, 0) ** 2).sum(1)) - np.sqrt((half_b**2).sum(1))
    ball_a = np.sqrt((np.maximum(beyond_b, 0) ** 2).sum(1)) - np.sqrt((half_a**2).sum(1))
    return np.asarray(np.maximum(np.maximum(along_a, along_b), np.maximum(ball_a, ball_b)))


def open_intervals(s: Sweep, a: Int, b: Int, still: NDArray[np.bool_], apart_m: float = 0.0) -> list[tuple[int, int, int]]:
    """Where boxes can't tell that pairs (a, b), (P,) each, stay apart: (pair, first sample, last sample), neighbours joined.

    Two solids stay apart between samples i and j when their distances there, together, are more than both can have moved meanwhile.
    apart_m: by how much they have to be apart. still: whether nothing moves between the two of a pair, so that the first sample is the
    only one.
    """
    pair, i, j = np.arange(len(a)), np.zeros(len(a), np.int64), np.where(still, 0, len(s.rows) - 1)
    at_i, at_j = least_distance(s, a, b, i) - apart_m, least_distance(s, a, b, j) - apart_m
    out: list[tuple[int, int, int]] = []
    while len(pair):
        one, two = a[pair], b[pair]
        may = s.gone[j, one] - s.gone[i, one] + s.gone[j, two] - s.gone[i, two]
        unsure = at_i + at_j <= may
        short = unsure & (j - i <= ENOUGH)
        out += zip(pair[short].tolist(), i[short].tolist(), j[short].tolist())
        left = unsure & ~short
        pair, i, j, at_i, at_j = pair[left], i[left], j[left], at_i[left], at_j[left]
        middle = (i + j) // 2
        at = least_distance(s, a[pair], b[pair], middle) - apart_m
        pair, i, j = np.concatenate([pair, pair]), np.concatenate([i, middle]), np.concatenate([middle, j])
        at_i, at_j = np.concatenate([at_i, at]), np.concatenate([at, at_j])
    joined: list[tuple[int, int, int]] = []
    for p, first, end in sorted(out):
        if joined and joined[-1][0] == p and first <= joined[-1][2]:
            joined[-1] = (p, joined[-1][1], max(end, joined[-1][2]))
        else:
            joined.append((p, first, end))
    return joined
