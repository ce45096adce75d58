"""How far and how fast the hand moves, along straight pieces in joint space and along a spline's rows. Compiled."""

from __future__ import annotations

import numpy as np

from kinematics.chain import Chain, forward
from kinematics.jit.decorators import jit_entry, jit_inline
from kinematics.transforms import Array
from planning.motion.smoothing.spline_rows import state_at

STEP = 0.05
"""Between two looks along a straight piece no joint moves further than this, rad or m."""
CHORD = 0.2
"""So far at most some joint moves between two looks at how far the hand has come."""
STEP_S = 0.002
"""Between two looks along a spline."""


@jit_inline
def _speed(chain: Chain, T_frame_hand: Array, q: Array, rate: Array, frames: Array) -> float:
    """The speed of the hand's origin at q (J,) while the joints move at rate (J,)."""
    forward(chain, q, frames)
    K = chain.q_index.shape[0]
    x, y, z = T_frame_hand[0, 3], T_frame_hand[1, 3], T_frame_hand[2, 3]
    px = frames[K, 0, 0] * x + frames[K, 0, 1] * y + frames[K, 0, 2] * z + frames[K, 0, 3]
    py = frames[K, 1, 0] * x + frames[K, 1, 1] * y + frames[K, 1, 2] * z + frames[K, 1, 3]
    pz = frames[K, 2, 0] * x + frames[K, 2, 1] * y + frames[K, 2, 2] * z + frames[K, 2, 3]
    vx, vy, vz = 0.0, 0.0, 0.0
    for k in range(K):
        w = chain.scale[k] * rate[chain.q_index[k]]
        ax, ay, az = frames[k + 1, 0, 2], frames[k + 1, 1, 2], frames[k + 1, 2, 2]
        if chain.prismatic[k]:
            vx, vy, vz = vx + w * ax, vy + w * ay, vz + w * az
            continue
        dx, dy, dz = px - frames[k + 1, 0, 3], py - frames[k + 1, 1, 3], pz - frames[k + 1, 2, 3]
        vx, vy, vz = vx + w * (ay * dz - az * dy), vy + w * (az * dx - ax * dz), vz + w * (ax * dy - ay * dx)
    return float(np.sqrt(vx * vx + vy * vy + vz * vz))


@jit_entry
def along_pieces(chain: Chain, T_frame_hand: Array, q: Array, direction: Array, frames: Array, at: Array, out: Array) -> None:
    """out (K - 1,): the largest speed of the hand on each piece between waypoints q (K, J), while the joints move at direction (K - 1, J).

    Scratch: frames, as for `forward`, and at (J,).
    """
    for i in range(q.shape[0] - 1):
        longest = 0.0
        for j in range(q.shape[1]):
            longest = max(longest, abs(q[i + 1, j] - q[i, j]))
        n, out[i] = int(np.ceil(longest / STEP)) + 1, 0.0
        for k in range(n + 1):
            for j in range(q.shape[1]):
                at[j] = q[i, j] + k / n * (q[i + 1, j] - q[i, j])
            out[i] = max(out[i], _speed(chain, T_frame_hand, at, direction[i], frames))


@jit_entry
def along_rows(chain: Chain, T_frame_hand: Array, count: int, t: Array, rows: Array, frames: Array, state: Array) -> float:
    """The largest speed of the hand on the first `count` rows of a spline, t (R,), rows (R, 3, J). Scratch: frames, and state (3, J)."""
    fastest = 0.0
    for i in range(count - 1):
        n = int(np.ceil((t[i + 1] - t[i]) / STEP_S))
        for k in range(n):
            state_at(t, rows, i, k / n * (t[i + 1] - t[i]), state)
            fastest = max(fastest, _speed(chain, T_frame_hand, state[0], state[1], frames))
    return fastest


@jit_entry
def hand_points(chain: Chain, T_frame_hand: Array, q: Array, frames: Array, out: Array) -> None:
    """out (N, 3): where the hand's origin is at configurations q (N, J). Scratch: frames."""
    for i in range(q.shape[0]):
        forward(chain, q[i], frames)
        _origin(frames[chain.q_index.shape[0]], T_frame_hand, out[i])


@jit_entry
def hand_way(chain: Chain, T_frame_hand: Array, q: Array, frames: Array, work: Array) -> float:
    """The length in metres of the hand's way along waypoints q (K, J), straight in joint space, by chords between looks. Scratch: frames,
    and work (3, J), J at least 3."""
    length, at, here, before = 0.0, work[0], work[1], work[2]
    for i in range(q.shape[0] - 1):
        longest = 0.0
        for j in range(q.shape[1]):
            longest = max(longest, abs(q[i + 1, j] - q[i, j]))
        n = int(np.ceil(longest / CHORD)) + 1
        for k in range(n + 1):
            for j in range(q.shape[1]):
                at[j] = q[i, j] + k / n * (q[i + 1, j] - q[i, j])
            forward(chain, at, frames)
            _origin(frames[chain.q_index.shape[0]], T_frame_hand, here)
            if k > 0:
                squares = 0.0
                for r in range(3):
                    squares += (here[r] - before[r]) ** 2
                length += np.sqrt(squares)
            for r in range(3):
                before[r] = here[r]
    return length


@jit_inline
def _origin(frame: Array, T_frame_hand: Array, out: Array) -> None:
    for r in range(3):
        out[r] = frame[r, 3]
        for c in range(3):
            out[r] += frame[r, c] * T_frame_hand[c, 3]
