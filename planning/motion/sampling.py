"""Configurations along a motion, so dense that no point of the arm or of what it holds moves more than RESOLUTION_M from one to the next.

Between two poses of a body the displacement of its points is greatest at a corner of any box around it, so eight corners tell. Where the
corners go is measured over pieces of at most COARSE; within such a piece their speeds vary by less than SLACK allows for. Along a spline
the joints speed up and slow down within a piece, too, and it is cut the more finely.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from kinematics.chain import Int
from kinematics.jit.decorators import jit_entry
from kinematics.quintic_spline import QuinticSpline, evaluate
from kinematics.robots.robot import Robot
from kinematics.scene import Scene
from kinematics.shapes import bounds
from kinematics.transforms import Array
from planning.plan import Motion

RESOLUTION_M = 0.002
COARSE, SLACK = 0.03, 1.1  # rad (or m); a tenth
MOST_UNEVEN = 3.0  # a joint that sets out from rest at a constant jerk ends at three times its mean speed


def samples(robot: Robot, scene: Scene, motion: Motion) -> Array:
    """Configurations (N, J) along a motion, its rows among them, RESOLUTION_M apart: on its spline, or on lines between waypoints."""
    link, middle, half = _link_boxes(robot)
    if motion.held is not None:
        low, high = bounds(scene.body(motion.held.body).shape, motion.held.T_hand_body)
        link = np.append(link, robot.tree.index["hand"])
        middle, half = np.concatenate([middle, [(low + high) / 2]]), np.concatenate([half, [(high - low) / 2]])
    spline, q = motion.spline, np.ascontiguousarray(motion.q, float)
    if spline is not None:
        return _along_spline(robot, spline, link, middle, half)
    rows, pieces = _coarse(q, COARSE)
    return _fine(q, pieces, robot.tree.poses(rows), link, middle, half, RESOLUTION_M / SLACK)


def while_fingers_move(robot: Robot, q: Array) -> list[Array]:
    """Configurations q (N, J) in two parts, one as a rule: up to where the gripper's joint stays as it is, and from there on. Covers can
    speak for fingers that don't move."""
    g = robot.gripper_joint
    moves = np.flatnonzero(q[:, g] != q[-1, g])
    if len(moves) == 0 or (robot.arm_q(q) == robot.arm_q(q[0])).all():
        return [q]
    return [q[: moves[-1] + 2], q[moves[-1] + 1 :]]


def _along_spline(robot: Robot, spline: QuinticSpline, link: Int, middle: Array, half: Array) -> Array:
    """The samples of a spline. Where a piece of it is at most COARSE long its speed is greatest at an end of it, and so much is it cut."""
    travel = np.abs(np.diff(spline.control, axis=1)).sum(1).max(1)
    i, k = _cut(np.maximum(1, np.ceil(travel / COARSE)).astype(np.int64))
    parts = np.bincount(i)[i]
    t = np.append(spline.t_s[i] + k / parts * np.diff(spline.t_s)[i], spline.t_s[-1])
    q, qd, T = evaluate(spline, t), np.abs(evaluate(spline, t, 1)), np.diff(t)
    farthest = np.zeros(len(T))
    _farthest(robot.tree.poses(q), link, middle, half, np.empty(3), np.empty((3, 3)), farthest)
    top = np.maximum(qd[:-1], qd[1:]) * T[:, None]
    counts = top > 0.1 * top.max(1, keepdims=True)
    uneven = np.clip((counts * top / np.maximum(np.abs(np.diff(q, axis=0)), 1e-12)).max(1), 1.0, MOST_UNEVEN)
    cuts = np.maximum(1, np.ceil(SLACK * uneven * np.sqrt(farthest) / RESOLUTION_M)).astype(np.int64)
    r, c = _cut(cuts)
    return evaluate(spline, np.append(t[r] + c / cuts[r] * T[r], t[-1]))


@lru_cache(maxsize=8)
def _link_boxes(robot: Robot) -> tuple[Int, Array, Array]:
    """For every link hull the link that carries it (S,), and the middle and half edges (S, 3) of a box around it, in that link."""
    low, high = np.array([h.vertices.min(0) for h in robot.hulls]), np.array([h.vertices.max(0) for h in robot.hulls])
    return np.array([robot.tree.index[h.link] for h in robot.hulls], np.int64), (low + high) / 2, (high - low) / 2


def _coarse(q: Array, longest: float) -> tuple[Array, Int]:
    """The ends of all pieces, (R, J), and how many of them lie between waypoints i and i + 1 of q (K, J), (K - 1,)."""
    pieces = np.maximum(1, np.ceil(np.abs(np.diff(q, axis=0)).max(1) / longest)).astype(np.int64)
    i, k = _cut(pieces)
    return np.concatenate([q[:1], q[i] + ((k + 1) / pieces[i])[:, None] * (q[i + 1] - q[i])]), pieces


def _fine(q: Array, pieces: Int, T: Array, link: Int, middle: Array, half: Array, step_m: float) -> Array:
    """The samples: each piece cut so that no corner moves more than step_m. T (R, L, 4, 4): the links' poses at the ends of the pieces."""
    farthest = np.zeros(len(T) - 1)
    _farthest(T, link, middle, half, np.empty(3), np.empty((3, 3)), farthest)
    cuts = np.maximum(1, np.ceil(np.sqrt(farthest) / step_m)).astype(np.int64)
    i, k = _cut(pieces)
    r, c = _cut(cuts)
    i, k = i[r], k[r]
    return np.concatenate([q[:1], q[i] + ((k + (c + 1) / cuts[r]) / pieces[i])[:, None] * (q[i + 1] - q[i])])


def _cut(counts: Int) -> tuple[Int, Int]:
    """For all pieces of things cut into so many each: which thing, and which of its pieces."""
    thing = np.repeat(np.arange(len(counts)), counts)
    return thing, np.arange(len(thing)) - (np.cumsum(counts) - counts)[thing]


@jit_entry
def _farthest(T: Array, link: Int, middle: Array, half: Array, at: Array, edge: Array, out: Array) -> None:
    """How far, squared, a corner of any link's box moves at most between each two poses in T (R, L, 4, 4); out (R - 1,): zeros before."""
    for i in range(out.shape[0]):
        for s in range(link.shape[0]):
            A, B = T[i, link[s]], T[i + 1, link[s]]
            for r in range(3):
                at[r] = B[r, 3] - A[r, 3]
                for c in range(3):
                    turn = B[r, c] - A[r, c]
                    at[r] += turn * middle[s, c]
                    edge[r, c] = turn * half[s, c]
            for corner in range(4):  # and the one opposite
                x, y = 1.0 if corner & 1 else -1.0, 1.0 if corner & 2 else -1.0
                plus, minus = 0.0, 0.0
                for r in range(3):
                    one = edge[r, 0] + x * edge[r, 1] + y * edge[r, 2]
                    plus, minus = plus + (at[r] + one) ** 2, minus + (at[r] - one) ** 2
                out[i] = max(out[i], plus, minus)
