"""How long ways take, at once: straight ones from rest to rest, and polylines whose corners are rounded."""

from __future__ import annotations

import numpy as np

from kinematics.jit.decorators import jit_entry, jit_inline
from kinematics.transforms import Array
from planning.motion.smoothing.blending import Corners, choose_levels, measure_pieces, unmeasured_corners

Limits = tuple[Array, Array, Array]
"""Of velocity, acceleration and jerk (A,)."""


def straight_s(by: Array, limits: Limits) -> Array:
    """Seconds (...,) from rest to rest for joints that turn `by` (..., A) rad or m: those of the joint that takes longest."""
    out = np.empty(by.shape[:-1])
    _all_straight(np.ascontiguousarray(by).reshape(-1, by.shape[-1]), *limits, out.reshape(-1))
    return out


@jit_entry
def _all_straight(by: Array, velocity: Array, acceleration: Array, jerk: Array, out: Array) -> None:
    for i in range(by.shape[0]):
        out[i] = one_straight(by[i], velocity, acceleration, jerk)


@jit_inline
def one_straight(by: Array, velocity: Array, acceleration: Array, jerk: Array) -> float:
    """`straight_s` of one way, by (A,)."""
    longest = 0.0
    for k in range(by.shape[0]):
        d, v, a, j = abs(by[k]), velocity[k], acceleration[k], jerk[k]
        ramp = v / a + a / j if v * j >= a * a else 2 * np.sqrt(v / j)  # to full speed
        if d >= v * ramp:
            s = d / v + ramp
        elif d >= 2 * a**3 / j**2:
            s = a / j + np.sqrt((a / j) ** 2 + 4 * d / a)
        else:
            s = np.cbrt(32 * d / j)
        longest = max(longest, s)
    return longest


def polyline_s(q: Array, limits: Limits) -> float:
    """Seconds from rest to rest along a polyline (K, A), its corners rounded as is quickest."""
    new = (np.abs(q[1:] - q[:-1]) > 1e-9).any(1)
    q = q if new.all() else q[np.append(True, new)]
    if len(q) < 3:
        return float(straight_s(q[-1] - q[0], limits))
    return float(seconds(unmeasured_corners(q, *limits, np.ones(q.shape[1])), len(q)))


def room_for(q: Array, limits: Limits) -> Corners:
    """What `seconds` works on, for polylines that are no longer than q (K, A)."""
    return unmeasured_corners(np.empty_like(q), *limits, np.ones(q.shape[1]))


@jit_entry
def seconds(corners: Corners, n: int) -> float:
    """Seconds along the first n waypoints of corners.q from rest to rest, about; infinite when one is repeated."""
    if not measure_pieces(corners, n):
        return np.inf
    return float(choose_levels(corners, n))
