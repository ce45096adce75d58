"""How far what is carried leans from how it stood: for one configuration, proved for a whole straight joint-space edge, and mended.

The axis that pointed up when the object stood is fixed in the hand. Its tilt is the angle to the world's vertical; its cosine f is the
axis's z. On an edge f changes at the rate ω · (axis × up), and that rate by no more than

    Σ_g |r_g| (|r_g| + 3 Σ_{h<g} |r_h|)    a unit of the edge,

r_g being how far the joints of group g turn on it: neighbours whose axes are parallel turn as one, and those parallel to the world's
vertical do not count, since they tilt nothing. So one configuration vouches for a stretch of the edge, and a march from one end to the
other for all.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinematics.chain import Chain, forward
from kinematics.collision.edge_problem import Scratch
from kinematics.collision.motion_bounds import until
from kinematics.jit.decorators import jit_entry, jit_inline
from kinematics.jit.record import record
from kinematics.transforms import Array

ROOM = 0.02
"""Share of the limit that is kept in hand: a configuration may use the rest, so that every edge between such can be judged."""
PARALLEL = 1.0 - 1e-12
MENDS = 8
"""Steps of Newton's method in which a configuration is to come upright."""
LARGEST_MEND = 0.5
"""Radians that a joint may turn in one of them."""


@record
class Upright(NamedTuple):
    """What is carried may tilt by no more than an angle. axis (3,): a unit vector in the chain's last frame, up where the object stood.

    least: the cosine that its z may not fall below anywhere on an edge; allowed: the one that a configuration needs; most: the angle
    that belongs to it, rad. limited: 0 when it may tilt as it likes.
    """

    axis: Array
    least: float
    allowed: float
    most: float
    limited: int


ANY_WAY_UP = Upright(np.array([0.0, 0.0, 1.0]), -1.0, -1.0, float(np.pi), 0)


def make_upright(axis: Array, max_tilt_rad: float) -> Upright:
    """A limit of the tilt; from half a turn on there is none."""
    if max_tilt_rad >= np.pi:
        return ANY_WAY_UP
    most = (1 - ROOM) * max_tilt_rad
    return Upright(np.ascontiguousarray(axis, float), float(np.cos(max_tilt_rad)), float(np.cos(most)), float(most), 1)


@jit_entry
def is_upright(chain: Chain, upright: Upright, q: Array, scratch: Scratch) -> bool:
    """Whether what is carried is as upright at q (J,) as a configuration must have it."""
    return bool(not upright.limited or _cosine(chain, upright, q, scratch) >= upright.allowed)


@jit_inline
def edge_upright(chain: Chain, upright: Upright, qa: Array, qb: Array, scratch: Scratch) -> bool:
    """Whether what is carried stays upright all the way from qa to qb (J,). True is certain."""
    if not _cosine(chain, upright, qb, scratch) >= upright.allowed:  # written so that NaN fails
        return False
    bend = _rates(chain, qa, qb, scratch.rate)
    q, rate, t = scratch.q, scratch.rate, 0.0
    while t < 1.0:
        for j in range(q.shape[0]):
            q[j] = qa[j] + t * (qb[j] - qa[j])
        z = _cosine(chain, upright, q, scratch)
        if not z >= upright.allowed:
            return False
        t += until(z - upright.least, -_cosine_rate(chain, upright, rate, scratch), bend)
    return True


@jit_entry
def bring_upright(chain: Chain, upright: Upright, weight: Array, most: float, q: Array, scratch: Scratch, work: Array) -> bool:
    """Turn q (J,), in place, until what is carried tilts by no more than `most` rad, as little as possible by the metric `weight` (J,).

    Whether that was possible within the limits. work (J,): scratch.
    """
    K, wanted = chain.q_index.shape[0], np.cos(most)
    for _ in range(MENDS):
        z = _cosine(chain, upright, q, scratch)
        if z >= wanted:
            return True
        x, y = _axis_across(upright, scratch.poses[K])
        sine = max(1e-6, np.sqrt(x * x + y * y))
        for j in range(q.shape[0]):
            work[j] = 0.0
        for k in range(K):
            if not chain.prismatic[k]:
                P = scratch.poses[k + 1]
                work[chain.q_index[k]] -= chain.scale[k] * (P[0, 2] * y - P[1, 2] * x) / sine  # how fast the tilt grows
        total = 0.0
        for j in range(q.shape[0]):
            total += (work[j] / weight[j]) ** 2
        if total < 1e-12:
            return False
        turn = (0.999 * most - np.arctan2(sine, z)) / total
        for j in range(q.shape[0]):
            step = min(max(turn * work[j] / (weight[j] * weight[j]), -LARGEST_MEND), LARGEST_MEND)
            q[j] = min(max(q[j] + step, chain.lower[j]), chain.upper[j])
    return bool(_cosine(chain, upright, q, scratch) >= wanted)


@jit_inline
def _cosine(chain: Chain, upright: Upright, q: Array, scratch: Scratch) -> float:
    """The z of the axis at q (J,); the frames' poses are left in the scratch."""
    forward(chain, q, scratch.poses)
    T, a = scratch.poses[chain.q_index.shape[0]], upright.axis
    return float(T[2, 0] * a[0] + T[2, 1] * a[1] + T[2, 2] * a[2])


@jit_inline
def _axis_across(upright: Upright, T: Array) -> tuple[float, float]:
    """The horizontal part of the axis, seen from the last frame at T (4, 4)."""
    a = upright.axis
    return float(T[0, 0] * a[0] + T[0, 1] * a[1] + T[0, 2] * a[2]), float(T[1, 0] * a[0] + T[1, 1] * a[1] + T[1, 2] * a[2])


@jit_inline
def _cosine_rate(chain: Chain, upright: Upright, rate: Array, scratch: Scratch) -> float:
    """How fast the axis's z changes a unit of the edge, at the poses in the scratch: ω · (axis × up)."""
    K, wx, wy = rate.shape[0], 0.0, 0.0
    for k in range(K):
        if not chain.prismatic[k]:
            wx += rate[k] * scratch.poses[k + 1, 0, 2]
            wy += rate[k] * scratch.poses[k + 1, 1, 2]
    x, y = _axis_across(upright, scratch.poses[K])
    return float(wx * y - wy * x)


@jit_inline
def _rates(chain: Chain, qa: Array, qb: Array, rate: Array) -> float:
    """Fill in rate (K,), how far each joint goes from qa to qb (J,); returns the bound of the second derivative, see the module."""
    bend, before, group, sign, tilts = 0.0, 0.0, 0.0, 1.0, False  # the first group is parallel to the world's vertical
    for k in range(rate.shape[0]):
        j = chain.q_index[k]
        rate[k] = chain.scale[k] * (qb[j] - qa[j])
        along = chain.T_prev[k, 2, 2]
        if abs(along) < PARALLEL:  # a new direction
            if tilts:
                bend += abs(group) * (abs(group) + 3.0 * before)
                before += abs(group)
            group, sign, tilts = 0.0, 1.0, True
        elif along < 0.0:
            sign = -sign
        if not chain.prismatic[k]:
            group += sign * rate[k]
    return bend + (abs(group) * (abs(group) + 3.0 * before) if tilts else 0.0)
