"""Configurations along a motion, so dense that no point of the arm or of what it holds moves more than RESOLUTION_M from one to the next.

Between two poses of a body the displacement of its points is greatest at a corner of any box around it, so eight corners tell. Where the
corners go is measured over pieces of at most COARSE; within such a piece their speeds vary by less than SLACK allows for. Along a spline
the joints speed up and slow down within a piece, too, and it is cut the more finely.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from kinematics.chain import Int
from kinematics.jit.decorators import jit_entry, jit_inline
from kinematics.quintic_spline import QuinticSpline
from kinematics.robots.robot import Robot
from kinematics.robots.tree import Joints, link_poses
from kinematics.scene import Scene
from kinematics.shapes import bounds
from kinematics.spline_kernel import evaluate_rows
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
    if spline is not None and len(q) > 1:
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
    """The samples of a spline. A part that is at most COARSE long is as fast as at its ends or, from rest to rest, in its middle; so
    finely is it cut."""
    joints, (K, _, J), t_s = robot.tree.joints, spline.control.shape, spline.t_s
    parts = np.empty(K, np.int64)
    _parts(spline.control, parts)
    t, cuts = np.empty(int(parts.sum()) + 1), np.empty(int(parts.sum()), np.int64)
    q, T = np.empty((5, J)), np.empty((2, len(joints.parent), 4, 4))
    work, local, at, edge = np.empty((6, J)), np.empty((4, 4)), np.empty(3), np.empty((3, 3))
    _cuts(joints, t_s, spline.control, parts, link, middle, half, q, T, work, local, at, edge, t, cuts)
    fine, rows = np.empty(int(cuts.sum()) + 1), np.empty((int(cuts.sum()) + 1, J))
    _times(t, cuts, fine)
    evaluate_rows(t_s, spline.control, fine, 0, work, rows)
    return rows


@jit_entry
def _parts(control: Array, parts: Int) -> None:
    """Into how many parts each piece of a spline is cut, so that no joint goes further than COARSE in one."""
    for k in range(control.shape[0]):
        most = 0.0
        for j in range(control.shape[2]):
            way = 0.0
            for i in range(control.shape[1] - 1):
                way += abs(control[k, i + 1, j] - control[k, i, j])
            most = max(most, way)
        parts[k] = max(1, int(np.ceil(most / COARSE)))


@jit_entry
def _cuts(
    joints: Joints, t_s: Array, control: Array, parts: Int, link: Int, middle: Array, half: Array,
    q: Array, T: Array, work: Array, local: Array, at: Array, edge: Array, t: Array, cuts: Int,
) -> None:  # fmt: skip
    """The times t (R,) of the parts' ends, and into how many steps each part is cut, cuts (R - 1,).

    Scratch: q (5, J), positions at both ends of a part, speeds there and in its middle; T (2, L, 4, 4), the links at its ends; work,
    local, at, edge.
    """
    n, J, half_way = 0, control.shape[2], edge[0, :1]
    for k in range(parts.shape[0]):
        for i in range(parts[k]):
            t[n] = t_s[k] + i / parts[k] * (t_s[k + 1] - t_s[k])
            n += 1
    t[n] = t_s[t_s.shape[0] - 1]
    for r in range(n + 1):
        now = r % 2
        evaluate_rows(t_s, control, t[r : r + 1], 0, work, q[now : now + 1])
        evaluate_rows(t_s, control, t[r : r + 1], 1, work, q[2 + now : 3 + now])
        link_poses(joints, q[now : now + 1], local, T[now : now + 1])
        if r == 0:
            continue
        h, fastest, uneven = t[r] - t[r - 1], 0.0, 1.0
        half_way[0] = (t[r - 1] + t[r]) / 2
        evaluate_rows(t_s, control, half_way, 1, work, q[4:5])
        for j in range(J):
            fastest = max(fastest, h * max(abs(q[2, j]), abs(q[3, j]), abs(q[4, j])))
        for j in range(J):
            top = h * max(abs(q[2, j]), abs(q[3, j]), abs(q[4, j]))
            if top > 0.1 * fastest:
                uneven = max(uneven, top / max(abs(q[1, j] - q[0, j]), 1e-12))
        squared = _farthest(T, link, middle, half, at, edge)
        cuts[r - 1] = max(1, int(np.ceil(SLACK * min(uneven, MOST_UNEVEN) * np.sqrt(squared) / RESOLUTION_M)))


@jit_entry
def _times(t: Array, cuts: Int, fine: Array) -> None:
    """The times of all steps, fine (N,): parts with ends t (R,), each cut into so many, cuts (R - 1,)."""
    n = 0
    for r in range(cuts.shape[0]):
        for c in range(cuts[r]):
            fine[n] = t[r] + c / cuts[r] * (t[r + 1] - t[r])
            n += 1
    fine[n] = t[cuts.shape[0]]


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
    farthest = np.empty(len(T) - 1)
    _all_farthest(T, link, middle, half, np.empty(3), np.empty((3, 3)), farthest)
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
def _all_farthest(T: Array, link: Int, middle: Array, half: Array, at: Array, edge: Array, out: Array) -> None:
    """`_farthest` between each two poses in T (R, L, 4, 4), out (R - 1,)."""
    for i in range(out.shape[0]):
        out[i] = _farthest(T[i : i + 2], link, middle, half, at, edge)


@jit_inline
def _farthest(T: Array, link: Int, middle: Array, half: Array, at: Array, edge: Array) -> float:
    """How far, squared, a corner of any link's box moves at most between two poses T (2, L, 4, 4)."""
    most = 0.0
    for s in range(link.shape[0]):
        A, B = T[0, link[s]], T[1, link[s]]
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
            most = max(most, plus, minus)
    return most
