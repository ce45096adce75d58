"""Configurations along a motion, so dense that no point of the arm or of what it holds moves more than RESOLUTION_M from one to the next.

Between two poses of a body the displacement of its points is greatest at a corner of any box around it, so eight corners tell. Where the
corners go is measured over pieces of at most COARSE; within such a piece their speeds vary by less than SLACK allows for.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit

from kinematics.arm import Int
from kinematics.robot import Robot
from kinematics.scene import Scene
from kinematics.shapes import bounds
from kinematics.transforms import Array
from planning.plan import Motion

RESOLUTION_M = 0.002
COARSE, SLACK = 0.03, 1.1  # rad (or m); a tenth


def samples(robot: Robot, scene: Scene, motion: Motion) -> Array:
    """Configurations (N, J) along a motion, its waypoints among them, RESOLUTION_M apart."""
    link, middle, half = _link_boxes(robot)
    if motion.held is not None:
        low, high = bounds(scene.body(motion.held.body).shape, motion.held.T_hand_body)
        link = np.append(link, robot.tree.index["hand"])
        middle, half = np.concatenate([middle, [(low + high) / 2]]), np.concatenate([half, [(high - low) / 2]])
    q = np.ascontiguousarray(motion.q, float)
    rows, pieces = _coarse(q, COARSE)
    return np.asarray(_fine(q, pieces, robot.tree.poses(rows), link, middle, half, RESOLUTION_M / SLACK))


@lru_cache(maxsize=8)
def _link_boxes(robot: Robot) -> tuple[Int, Array, Array]:
    """For every link hull the link that carries it (S,), and the middle and half edges (S, 3) of a box around it, in that link."""
    low, high = np.array([h.vertices.min(0) for h in robot.hulls]), np.array([h.vertices.max(0) for h in robot.hulls])
    return np.array([robot.tree.index[h.link] for h in robot.hulls], np.int64), (low + high) / 2, (high - low) / 2


@njit(cache=True, nogil=True)
def _coarse(q: Array, longest: float) -> tuple[Array, Int]:
    """The ends of all pieces, (R, J), and how many of them lie between waypoints i and i + 1 of q (K, J), (K - 1,)."""
    pieces = np.ones(q.shape[0] - 1, np.int64)
    for i in range(q.shape[0] - 1):
        pieces[i] = max(1, int(np.ceil(np.abs(q[i + 1] - q[i]).max() / longest)))
    rows, n = np.empty((pieces.sum() + 1, q.shape[1])), 0
    rows[0] = q[0]
    for i in range(q.shape[0] - 1):
        for k in range(pieces[i]):
            n += 1
            rows[n] = q[i] + (k + 1) / pieces[i] * (q[i + 1] - q[i])
    return rows, pieces


@njit(cache=True, nogil=True)
def _fine(q: Array, pieces: Int, T: Array, link: Int, middle: Array, half: Array, step_m: float) -> Array:
    """The samples: each piece cut so that no corner moves more than step_m. T (R, L, 4, 4): the links' poses at the ends of the pieces."""
    cuts, total = np.empty(T.shape[0] - 1, np.int64), 1
    for r in range(T.shape[0] - 1):
        farthest = 0.0
        for s in range(link.shape[0]):
            farthest = max(farthest, _farthest(T[r, link[s]], T[r + 1, link[s]], middle[s], half[s]))
        cuts[r] = max(1, int(np.ceil(np.sqrt(farthest) / step_m)))
        total += cuts[r]
    rows, n, r = np.empty((total, q.shape[1])), 0, 0
    rows[0] = q[0]
    for i in range(q.shape[0] - 1):
        for k in range(pieces[i]):
            for c in range(cuts[r]):
                n += 1
                rows[n] = q[i] + (k + (c + 1) / cuts[r]) / pieces[i] * (q[i + 1] - q[i])
            r += 1
    return rows


@njit(cache=True, nogil=True)
def _farthest(A: Array, B: Array, middle: Array, half: Array) -> float:
    """How far, squared, a corner of a box moves at most between two poses of it."""
    at, edge = np.empty(3), np.empty((3, 3))
    for r in range(3):
        at[r] = B[r, 3] - A[r, 3]
        for c in range(3):
            turn = B[r, c] - A[r, c]
            at[r] += turn * middle[c]
            edge[r, c] = turn * half[c]
    most = 0.0
    for corner in range(4):  # and the one opposite
        x, y = 1.0 if corner & 1 else -1.0, 1.0 if corner & 2 else -1.0
        plus, minus = 0.0, 0.0
        for r in range(3):
            one = edge[r, 0] + x * edge[r, 1] + y * edge[r, 2]
            plus, minus = plus + (at[r] + one) ** 2, minus + (at[r] - one) ** 2
        most = max(most, plus, minus)
    return most
