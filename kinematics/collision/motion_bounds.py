"""For how long on a straight joint-space edge two bodies stay apart, when they are so at one configuration of it.

While every joint k goes |dx_k|, no point of one body moves further relative to the other than Σ_k reach_k |dx_k|. Where a plane lies
between them more is known: only speed along its normal counts, and that changes, a unit of the edge, by no more than

    Σ_k reach_k |dx_k| (|dx_k| + 2 Σ_{j<k} |dx_j|),    |dx_k| and |dx_j| in brackets of joints that turn only,

which bounds the second derivative of any point. The whole edge takes 1; rate (K,) is how far each joint goes on it, motion and bend are the
two sums of a pair, and a twist is a frame's angular velocity and its velocity at the world's origin.
"""

from __future__ import annotations

import numpy as np

from kinematics.chain import Chain, Int
from kinematics.jit.decorators import jit_inline
from kinematics.transforms import Array


@jit_inline
def begin_edge(chain: Chain, reach: Array, qa: Array, qb: Array, listed: Int, rate: Array, motion: Array, bend: Array) -> None:
    """Of an edge from qa to qb (J,): rate (K,), and motion (M,) and bend (M,) of the pairs that are listed (·,). reach (M, K)."""
    for k in range(rate.shape[0]):
        j = chain.q_index[k]
        rate[k] = chain.scale[k] * (qb[j] - qa[j])
    for i in range(listed.shape[0]):
        n = listed[i]
        speed, change, turned = 0.0, 0.0, 0.0
        for k in range(rate.shape[0]):
            if reach[n, k] > 0.0:
                way, turn = reach[n, k] * abs(rate[k]), 0.0 if chain.prismatic[k] else abs(rate[k])
                speed += way
                change += way * (turn + 2 * turned)
                turned += turn
        motion[n], bend[n] = speed, change


@jit_inline
def twists(chain: Chain, rate: Array, poses: Array, twist: Array) -> None:
    """Fill in twist (K + 1, 6): how each frame of the chain moves while the joints do, its poses being (K + 1, 4, 4)."""
    for c in range(6):
        twist[0, c] = 0.0
    for k in range(rate.shape[0]):
        x, y, z = rate[k] * poses[k + 1, 0, 2], rate[k] * poses[k + 1, 1, 2], rate[k] * poses[k + 1, 2, 2]
        px, py, pz = poses[k + 1, 0, 3], poses[k + 1, 1, 3], poses[k + 1, 2, 3]
        slides = chain.prismatic[k] != 0
        for c in range(6):
            twist[k + 1, c] = twist[k, c]
        if not slides:
            twist[k + 1, 0] += x
            twist[k + 1, 1] += y
            twist[k + 1, 2] += z
        twist[k + 1, 3] += x if slides else py * z - pz * y
        twist[k + 1, 4] += y if slides else pz * x - px * z
        twist[k + 1, 5] += z if slides else px * y - py * x


@jit_inline
def safe_interval(
    pairs: Int, boxes: Array, poses: Array, twist: Array, work: Array, n: int, keep: float, bend: float
) -> tuple[float, float]:
    """How far back and how far ahead on the edge the plane that GJK just found keeps pair n `keep` metres apart, as shares of the edge.

    Seen from the body nearer the base the other one moves, and no point of it nears the plane faster than a corner of its box does.
    pairs, boxes: of `edge_problem.Problem`; work: GJK's, its last row the plane; no plane, no share.
    """
    gap = work[7, 3] - keep
    if gap <= 0.0:
        return 0.0, 0.0
    body, i, j = pairs[n, 0], pairs[n, 2], pairs[n, 3]
    vx, vy, vz = work[7, 0], work[7, 1], work[7, 2]
    size = 1.0 / np.sqrt(vx * vx + vy * vy + vz * vz)
    x = (poses[j, 0, 0] * vx + poses[j, 0, 1] * vy + poses[j, 0, 2] * vz) * size
    y = (poses[j, 1, 0] * vx + poses[j, 1, 1] * vy + poses[j, 1, 2] * vz) * size
    z = (poses[j, 2, 0] * vx + poses[j, 2, 1] * vy + poses[j, 2, 2] * vz) * size
    if i < j < twist.shape[0]:
        body, i, j = pairs[n, 1], j, i
        x, y, z = -x, -y, -z
    wx, wy, wz, ux, uy, uz = twist[i, 0], twist[i, 1], twist[i, 2], twist[i, 3], twist[i, 4], twist[i, 5]
    if j < twist.shape[0]:
        wx, wy, wz, ux, uy, uz = wx - twist[j, 0], wy - twist[j, 1], wz - twist[j, 2], ux - twist[j, 3], uy - twist[j, 4], uz - twist[j, 5]
    bx, by, bz = boxes[body, 3], boxes[body, 4], boxes[body, 5]
    cx = poses[i, 0, 0] * bx + poses[i, 0, 1] * by + poses[i, 0, 2] * bz + poses[i, 0, 3]
    cy = poses[i, 1, 0] * bx + poses[i, 1, 1] * by + poses[i, 1, 2] * bz + poses[i, 1, 3]
    cz = poses[i, 2, 0] * bx + poses[i, 2, 1] * by + poses[i, 2, 2] * bz + poses[i, 2, 3]
    away = x * (ux + wy * cz - wz * cy) + y * (uy + wz * cx - wx * cz) + z * (uz + wx * cy - wy * cx)
    rx, ry, rz = y * wz - z * wy, z * wx - x * wz, x * wy - y * wx
    spin = 0.0
    for r in range(3):
        spin += boxes[body, r] * abs(rx * poses[i, 0, r] + ry * poses[i, 1, r] + rz * poses[i, 2, r])
    return until(gap, spin + away, bend), until(gap, spin - away, bend)


@jit_inline
def until(gap: float, speed: float, bend: float) -> float:
    """The s ≥ 0 at which speed · s + bend · s² / 2 reaches a gap > 0."""
    root = np.sqrt(speed * speed + 2.0 * bend * gap)
    if speed > 0.0:
        return float(2.0 * gap / (speed + root))
    return float((root - speed) / bend) if bend > 0.0 else np.inf
