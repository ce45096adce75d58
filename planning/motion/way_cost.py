"""What a way of the arm costs: the seconds that it takes, and some more for every metre that the hand goes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kinematics.jit.decorators import jit_entry
from kinematics.transforms import Array
from planning.motion.cell.arm import Arm
from planning.motion.smoothing.estimates import Limits, one_straight, polyline_s, straight_s
from planning.motion.smoothing.hand_speed import hand_points, hand_way

DETOUR, DETOUR_S, FLIP, FLIP_S = 1.6, 0.35, 2.1, 1.2
"""What a way that is not straight is taken to need until it is planned: so many times the straight one's time, and seconds more; beyond
FLIP_S, where arms turn into another branch as a rule, so many times as much again. Of 1,572 ways that were planned in 120 scenes a quarter
took less than that, half 1.15 times as much and more; of the 120 that were used at last three quarters took less."""
DOUBT = 0.7
"""A way that nobody has looked at is taken to need so much more than the straight one, as a share of what a detour takes more."""
BOW, ROUND = 1.2, 2.1
"""So many times the distance is the hand's way taken to be while the joints go straight, and where they don't."""


@dataclass(frozen=True, eq=False)
class WayCost:
    """In seconds. limits: of the arm's joints; metre_s: what a metre of the hand's way counts."""

    arm: Arm
    limits: Limits
    metre_s: float

    def path(self, q: Array) -> float:
        """Of a polyline (K, A), its corners rounded."""
        work = np.empty((3, max(3, q.shape[1])))
        way = hand_way(self.arm.chain, self.arm.T_frame_hand, np.ascontiguousarray(q), self._frames, work) if self.metre_s else 0.0
        return polyline_s(q, self.limits) + self.metre_s * float(way)

    def straight(self, by: Array) -> Array:
        """Seconds alone (...,) of straight ways that turn the joints `by` (..., A)."""
        return straight_s(by, self.limits)

    def points(self, q: Array) -> Array:
        """Where the hand is (N, 3) at configurations q (N, A)."""
        out = np.empty((len(q), 3))
        hand_points(self.arm.chain, self.arm.T_frame_hand, np.ascontiguousarray(q), self._frames, out)
        return out

    def detour(self, by: Array, way: Array) -> Array:
        """What ways (...,) are taken to cost that are not straight; by (..., A): what the joints turn, way (..., 3): how the hand moves."""
        return np.asarray(self._both(by, way)[0])

    def hoped(self, by: Array, way: Array) -> Array:
        """The same of ways that nobody has looked at."""
        return np.asarray(self._both(by, way)[1])

    def _both(self, by: Array, way: Array) -> Array:
        out = np.empty((2, *by.shape[:-1]))
        rows, moves = (np.ascontiguousarray(x).reshape(-1, x.shape[-1]) for x in (by, way))
        _not_known(rows, moves, *self.limits, self.metre_s, out.reshape(2, -1))
        return out

    @cached_property
    def _frames(self) -> Array:
        return np.empty((len(self.arm.chain.q_index) + 1, 4, 4))


@jit_entry
def _not_known(by: Array, way: Array, velocity: Array, acceleration: Array, jerk: Array, metre_s: float, out: Array) -> None:
    """What detours and ways that nobody has looked at are taken to cost, out (2, N); by (N, A), way (N, 3)."""
    for i in range(by.shape[0]):
        s, metres = one_straight(by[i], velocity, acceleration, jerk), 0.0
        for r in range(way.shape[1]):
            metres += way[i, r] * way[i, r]
        metres = np.sqrt(metres)
        detour = DETOUR * s + DETOUR_S + FLIP * max(0.0, s - FLIP_S) + metre_s * ROUND * metres
        least = s + metre_s * BOW * metres
        out[0, i], out[1, i] = detour, least + DOUBT * (detour - least)
