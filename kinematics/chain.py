"""The arm as a chain of moving joints in flat arrays, and its compiled forward kinematics.

A `Chain` moves frames: frame 0 is the world, frame k + 1 the one that joint k moves. `Robot.chain` builds it from a URDF.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.jit.decorators import jit_entry
from kinematics.jit.record import record
from kinematics.transforms import Array

Int = NDArray[np.int64]


@record
class Chain(NamedTuple):
    """K moving joints in a row from the base to the hand; every axis is z of its own frame.

    T_prev (K, 4, 4): joint k's frame in the frame that joint k-1 moves (the world for k = 0), at position 0.
    q_index (K,): which of the J planning coordinates drives it, as scale (K,) · q + offset (K,): mimic joints share an index.
    prismatic (K,): 1 when it slides along z, 0 when it turns about z. lower, upper (J,): limits, ±π where a joint is continuous.
    wraps (J,): 1 when the coordinate is continuous, so that q and q + 2π are the same place.
    heading: 1.0; 0.0 where inverse kinematics may leave the hand turned about the vertical, as an arm of few joints has to.
    """

    T_prev: Array
    q_index: Int
    scale: Array
    offset: Array
    prismatic: Int
    lower: Array
    upper: Array
    wraps: Int
    heading: float = 1.0


@jit_entry
def forward(chain: Chain, q: Array, frames: Array) -> None:
    """Forward kinematics: q (J,) to frames (K + 1, 4, 4) in the world, written in place; frames[0] is the world itself."""
    for r in range(4):
        for c in range(4):
            frames[0, r, c] = 1.0 if r == c else 0.0
    for k in range(chain.q_index.shape[0]):
        x = chain.scale[k] * q[chain.q_index[k]] + chain.offset[k]
        slide = x if chain.prismatic[k] else 0.0
        co = 1.0 if chain.prismatic[k] else np.cos(x)
        si = 0.0 if chain.prismatic[k] else np.sin(x)
        T = chain.T_prev[k]
        for r in range(3):
            a, b, c, p = frames[k, r, 0], frames[k, r, 1], frames[k, r, 2], frames[k, r, 3]
            m0 = a * T[0, 0] + b * T[1, 0] + c * T[2, 0]
            m1 = a * T[0, 1] + b * T[1, 1] + c * T[2, 1]
            m2 = a * T[0, 2] + b * T[1, 2] + c * T[2, 2]
            frames[k + 1, r, 0] = m0 * co + m1 * si
            frames[k + 1, r, 1] = m1 * co - m0 * si
            frames[k + 1, r, 2] = m2
            frames[k + 1, r, 3] = a * T[0, 3] + b * T[1, 3] + c * T[2, 3] + p + m2 * slide
        frames[k + 1, 3, 0] = frames[k + 1, 3, 1] = frames[k + 1, 3, 2] = 0.0
        frames[k + 1, 3, 3] = 1.0
