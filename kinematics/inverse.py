"""Inverse kinematics: every distinct configuration of the arm that puts the hand at a pose.

Damped least squares (Levenberg-Marquardt) in compiled code, started from the nearest entries of a table of random configurations, so that
few iterations are needed and the arm's different branches (elbow up or down, wrist flipped) are all found. Sixteen starts go side by side
(inverse_lanes.py); what comes near is polished to about 1e-9. Solutions stay inside the limits.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.array_checks import checked
from kinematics.chain import Chain, forward
from kinematics.collision.sphere_lanes import ROW_X
from kinematics.collision.sphere_model import F32
from kinematics.inverse_lanes import LaneChain, come_near, lane_chain, make_rows
from kinematics.jit.decorators import copy_row, jit_entry, jit_inline
from kinematics.jit.simd import WIDTH
from kinematics.reach import Reach, reach_of
from kinematics.transforms import Array

DISTINCT = 0.2
"""Two solutions are distinct when some joint differs by more, in rad (or m)."""
POSITION_TOLERANCE_M = 1e-5
ROTATION_TOLERANCE = 1e-5
_OUT_OF_REACH_M = 1e-4
"""A hand is out of reach where it is so much further than any; more than what solutions may be off."""
_TABLE = 8192
_W = np.uint64(WIDTH)
PATIENT: Any = np.int64(40)
BRISK: Any = np.int64(30)
"""Iterations of `descend`, from the table and from nearby. A plain int is a type of its own, and `descend` would be compiled for each."""
STALLED = 10
"""A descent is given up after so many iterations that did not halve what is left. A third of the starts from the table never arrive."""


class Seeds(NamedTuple):
    """Where the search for solutions starts: configurations (N, J) and the first three rows of their hand poses in the world, T (12, N);
    and the chain, for the lanes; and what is out of reach."""

    q: Array
    T: F32
    lanes: LaneChain
    reach: Reach


def make_seeds(chain: Chain, T_frame_hand: Array, n: int = _TABLE) -> Seeds:
    """A table of n random configurations inside the limits; T_frame_hand (4, 4) is the hand in the last frame of the chain."""
    T_frame_hand = checked("T_frame_hand", T_frame_hand, 4, 4)
    rng = np.random.default_rng(0)
    q = rng.uniform(chain.lower, chain.upper, (n, len(chain.lower)))
    T = np.empty((n, 4, 4))
    _hand_poses(chain, T_frame_hand, q, np.empty((len(chain.q_index) + 1, 4, 4)), T)
    rows = np.ascontiguousarray(T[:, :3].reshape(n, 12).T, np.float32)
    return Seeds(q, rows, lane_chain(chain), reach_of(chain))


def may_reach(chain: Chain, T_frame_hand: Array, seeds: Seeds, T_world_hand: Array) -> NDArray[np.bool_]:
    """Whether hands at T_world_hand (..., 4, 4) are not, for certain, too far away for any solution: (...)."""
    return seeds.reach.beyond_m(T_frame_hand, T_world_hand, any_heading=chain.heading == 0.0) <= _OUT_OF_REACH_M


def solve(
    chain: Chain, T_frame_hand: Array, seeds: Seeds, T_world_hand: Array, near: Array, *, tries: int = 24, distinct: float = DISTINCT
) -> Array:
    """Configurations (S, J) inside the limits with the hand at T_world_hand (4, 4), nearest to `near` (J,) first; S may be 0.

    tries: how many starts. Two solutions are distinct when some joint differs by more than `distinct` rad (or m).
    """
    J, N = len(chain.lower), seeds.T.shape[1]
    T_frame_hand, T_world_hand = checked("T_frame_hand", T_frame_hand, 4, 4), checked("T_world_hand", T_world_hand, 4, 4)
    near = checked("near", near, J)
    if seeds.q.shape != (N, J) or seeds.T.shape[0] != 12:
        raise ValueError(f"the seeds are for another arm: {seeds.q.shape} for {J} joints")
    tries = max(0, min(tries, N))
    if tries == 0 or not may_reach(chain, T_frame_hand, seeds, T_world_hand):
        return np.empty((0, J))
    starts, score, far = np.zeros(tries, np.int64), np.zeros(N, np.float32), np.full(tries, np.inf, np.float32)
    _nearest(seeds.T, T_world_hand, score, starts, far)
    out, cost, q, rows = np.empty((tries, J)), np.zeros(tries), np.empty(J), make_rows(chain)
    found = _solve(chain, seeds.lanes, T_frame_hand, seeds.q, starts, T_world_hand, near, distinct, rows, q, *make_work(chain), out, cost)
    return out[np.argsort(cost[:found])]


@jit_entry
def _hand_poses(chain: Chain, T_frame_hand: Array, q: Array, frames: Array, out: Array) -> None:
    K = chain.q_index.shape[0]
    for i in range(q.shape[0]):
        forward(chain, q[i], frames)
        for r in range(4):
            for c in range(4):
                x = 0.0
                for k in range(4):
                    x += frames[K, r, k] * T_frame_hand[k, c]
                out[i, r, c] = x


@jit_entry
def _solve(
    chain: Chain, lanes: LaneChain, T_frame_hand: Array, table: Array, starts: NDArray[np.int64], T: Array, near: Array, distinct: float,
    rows: F32, q: Array, frames: Array, work: Array, out: Array, cost: Array,
) -> int:  # fmt: skip
    """The distinct solutions, out[:found], and how far each is from `near`, squared, cost[:found], zeros before. rows, q (J,): scratch."""
    J, K, found = q.shape[0], chain.q_index.shape[0], 0
    at = ROW_X + _W * np.uint64(K + 12 * (K + 1))
    for first in range(0, starts.shape[0], WIDTH):
        arrived = come_near(chain, lanes, T_frame_hand, T, table, starts, first, rows, at)
        for w in range(min(WIDTH, starts.shape[0] - first)):
            if not (arrived >> np.uint64(w)) & np.uint64(1):
                continue
            for j in range(J):
                q[j] = rows[at + _W * np.uint64(j) + np.uint64(w)]
                q[j] = min(max(q[j], chain.lower[j]), chain.upper[j])  # which float32 may have rounded
                other = q[j] - np.copysign(2 * np.pi, q[j] - near[j])
                if abs(other - near[j]) < abs(q[j] - near[j]) and chain.lower[j] <= other <= chain.upper[j]:
                    q[j] = other  # of two turns that are both inside the limits, the one nearer to `near`
            new = _is_new(chain, q, distinct, out, found) and descend(chain, T_frame_hand, T, q, frames, work, BRISK)
            if new and _is_new(chain, q, distinct, out, found):
                copy_row(q, out[found])
                for j in range(J):
                    cost[found] += (q[j] - near[j]) ** 2
                found += 1
    return found


@jit_inline
def _is_new(chain: Chain, q: Array, distinct: float, out: Array, found: int) -> bool:
    """Whether a solution q (J,) is none of out[:found]."""
    for f in range(found):
        far = False
        for j in range(q.shape[0]):
            delta = abs(out[f, j] - q[j])
            if chain.wraps[j]:
                delta = min(delta, abs(delta - 2 * np.pi))
            far = far or delta > distinct
        if not far:
            return False
    return True


@jit_entry
def _nearest(table: NDArray[np.float32], T: Array, score: NDArray[np.float32], best: NDArray[np.int64], far: NDArray[np.float32]) -> None:
    """The columns `best` of a table of poses (12, N) nearest to the pose T (4, 4), the nearest first.

    score (N,): zeros before. far, as long as best: infinite before.
    """
    N, most = table.shape[1], best.shape[0]
    for i in range(12):
        r, c = i // 4, i % 4
        weight, wanted = np.float32(1.0 if c == 3 else 0.02), np.float32(T[r, c])  # 0.02 m² weighs a half turn (8) like 0.4 m
        for n in range(N):
            d = table[i, n] - wanted
            score[n] += weight * d * d
    for n in range(N):
        if score[n] < far[most - 1]:
            k = most - 1
            while k > 0 and far[k - 1] > score[n]:
                best[k], far[k] = best[k - 1], far[k - 1]
                k -= 1
            best[k], far[k] = n, score[n]


def make_work(chain: Chain) -> tuple[Array, Array]:
    """Memory for `descend`, one thread's: frames (K + 1, 4, 4) and work (12 + J, max(6, J))."""
    K, J = len(chain.q_index), len(chain.lower)
    return np.empty((K + 1, 4, 4)), np.empty((12 + J, max(6, J)))


@jit_entry
def descend(chain: Chain, T_frame_hand: Array, T: Array, q: Array, frames: Array, work: Array, iterations: int) -> bool:
    """Levenberg-Marquardt from q (J,), in place, kept inside the limits. Returns whether it arrived (to the module's tolerances), but for
    a turn about the vertical where the chain's heading is 0.

    frames, work: scratch, see `make_work`.
    """
    J, K = q.shape[0], chain.q_index.shape[0]
    e, b, trial, D, best = work[0], work[1], work[2], work[3:6], np.inf
    jac, A = work[6:12], work[12:]
    damping, polish, before = 1e-3, 0, np.inf
    copy_row(q, trial)
    for n in range(iterations):
        if n % STALLED == 0:
            if n > 0 and best > 0.5 * before and polish == 0:
                return False
            before = best
        forward(chain, trial, frames)
        x, y, z = _residual(frames[K], T_frame_hand, T, e, D)
        e[5] *= chain.heading
        cost = 0.0
        for r in range(6):
            cost += e[r] * e[r] * (1.0 if r < 3 else 0.05)
        if cost < best:
            for j in range(J):
                q[j] = trial[j]
            closer = cost < 0.25 * best
            best = cost
            damping = max(damping * 0.2, 1e-9)
            if e[0] ** 2 + e[1] ** 2 + e[2] ** 2 < POSITION_TOLERANCE_M**2 and e[3] ** 2 + e[4] ** 2 + e[5] ** 2 < ROTATION_TOLERANCE**2:
                polish += 1
                if polish > 2 or not closer or best < 1e-20:
                    return True
            for r in range(6):
                for j in range(J):
                    jac[r, j] = 0.0
            for k in range(K):
                j, s = chain.q_index[k], chain.scale[k]
                ax, ay, az = frames[k + 1, 0, 2] * s, frames[k + 1, 1, 2] * s, frames[k + 1, 2, 2] * s
                if chain.prismatic[k]:
                    jac[0, j] += ax
                    jac[1, j] += ay
                    jac[2, j] += az
                else:
                    px, py, pz = x - frames[k + 1, 0, 3], y - frames[k + 1, 1, 3], z - frames[k + 1, 2, 3]
                    jac[0, j] += ay * pz - az * py
                    jac[1, j] += az * px - ax * pz
                    jac[2, j] += ax * py - ay * px
                    jac[3, j] += ax
                    jac[4, j] += ay
                    jac[5, j] += az * chain.heading
            for j in range(J):
                b[j] = 0.0
                for r in range(6):
                    b[j] += jac[r, j] * e[r] * (1.0 if r < 3 else 0.05)
        elif polish:
            return True
        else:
            damping *= 8.0
            if damping > 1e4:
                return False
        for i in range(J):
            for j in range(i + 1):
                a = 0.0
                for r in range(6):
                    a += jac[r, i] * jac[r, j] * (1.0 if r < 3 else 0.05)
                A[i, j] = a
            A[i, i] += damping + 1e-12
        if not _cholesky_solve(A, b, trial, J):
            return False
        moved = 0.0
        for j in range(J):
            step = min(max(trial[j], -0.6), 0.6)
            value = q[j] + step
            if chain.wraps[j]:
                while value > chain.upper[j]:
                    value -= 2 * np.pi
                while value < chain.lower[j]:
                    value += 2 * np.pi
            else:
                value = min(max(value, chain.lower[j]), chain.upper[j])
            moved += abs(value - q[j])
            trial[j] = value
        if moved < 1e-14:
            return polish > 0
    return polish > 0


@jit_inline
def _residual(F: Array, H: Array, T: Array, e: Array, D: Array) -> tuple[float, float, float]:
    """Position error and rotation vector (6,) from the hand F @ H to T, in the world; returns the hand's position. D (3, 3): scratch."""
    x = F[0, 0] * H[0, 3] + F[0, 1] * H[1, 3] + F[0, 2] * H[2, 3] + F[0, 3]
    y = F[1, 0] * H[0, 3] + F[1, 1] * H[1, 3] + F[1, 2] * H[2, 3] + F[1, 3]
    z = F[2, 0] * H[0, 3] + F[2, 1] * H[1, 3] + F[2, 2] * H[2, 3] + F[2, 3]
    e[0], e[1], e[2] = T[0, 3] - x, T[1, 3] - y, T[2, 3] - z
    for r in range(3):
        for c in range(3):
            D[r, c] = 0.0
            for k in range(3):  # D = T_R · hand_Rᵀ
                h = F[c, 0] * H[0, k] + F[c, 1] * H[1, k] + F[c, 2] * H[2, k]
                D[r, c] += T[r, k] * h
    vx, vy, vz = D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]
    sine = np.sqrt(vx * vx + vy * vy + vz * vz)
    cosine = D[0, 0] + D[1, 1] + D[2, 2] - 1.0
    angle = np.arctan2(sine, cosine)
    if sine > 1e-12:
        scale = angle / sine
    elif cosine > 0:
        scale = 0.5
    else:  # half a turn: any axis will do to get away from here
        vx, vy, vz, scale = 1.0, 0.0, 0.0, np.pi
    e[3], e[4], e[5] = vx * scale, vy * scale, vz * scale
    return x, y, z


@jit_inline
def _cholesky_solve(A: Array, b: Array, x: Array, n: int) -> bool:
    """Solve A x = b for a symmetric positive matrix (n, n) given by its lower half, which is overwritten. False when it is singular."""
    for i in range(n):
        for j in range(i + 1):
            a = A[i, j]
            for k in range(j):
                a -= A[i, k] * A[j, k]
            if i == j:
                if a <= 0.0:
                    return False
                A[i, i] = np.sqrt(a)
            else:
                A[i, j] = a / A[j, j]
    for i in range(n):
        a = b[i]
        for k in range(i):
            a -= A[i, k] * x[k]
        x[i] = a / A[i, i]
    for i in range(n - 1, -1, -1):
        a = x[i]
        for k in range(i + 1, n):
            a -= A[k, i] * x[k]
        x[i] = a / A[i, i]
    return True
