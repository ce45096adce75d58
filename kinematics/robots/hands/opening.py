"""How a gripper opens: tables over its joint of the fingers' width, where the pads are, and how deep an object may reach in.

A constant would not do: the pads of a Robotiq 2F-85 move 14 mm along the approach while they open, and its knuckles reach into the opening.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from kinematics.transforms import Array

ROOM_M = 0.005
"""What an object in the hand is to keep from all that does not hold it."""
BESIDE_M, PUSH_M = 0.00062, 0.0004
"""So far from an object is the pad that stands still while the hand comes, more than what planned motions keep from everything; and so far
does the jaw that moves push the object against it. The 0.22 mm that are left are less than half of what counts as no contact."""

TILTS = np.radians(np.arange(-75, 76, 15))
"""How far directions are turned about the hand's y, from its z towards its x, along which it is measured what lies behind the pads."""
SLICES = np.sin(np.linspace(0.0, np.pi / 2, 9))[:-1]
"""Where slices of what is in the hand begin, from its middle outwards, in shares of half its width; the last one ends beside it."""


@dataclass(frozen=True, eq=False)
class Opening:
    """The gripper's table, by rising width: joint value, width between the pads, where the pads' middle is along the hand's z, and how far
    behind that an object of this width may reach if it is to end ROOM_M before a knuckle or the palm, which then are nowhere nearer; and
    where the pads' middle is along the hand's y, which is 0 but for a jaw that moves alone; metres.
    cup_m: the diameter of a suction cup, which holds at that width, is off at any larger one, and takes what comes near along z; else 0.
    jaw: on which side along y the one jaw is that moves against a fixed one, 1 or -1; 0 where both sides move. round_only: a hinged jaw
    stands askew on whatever is between the pads, and holds what is round. tilted_m (widths, T, S): like depth_m, along each of TILTS,
    for each of SLICES; where it is empty, nothing is known of directions but the hand's z.
    """

    value: Array
    width_m: Array
    pad_z_m: Array
    depth_m: Array
    pad_y_m: Array = field(default_factory=lambda: np.zeros(0))
    jaw: int = 0
    round_only: bool = False
    cup_m: float = 0.0
    tilted_m: Array = field(default_factory=lambda: np.zeros((0, len(TILTS), len(SLICES))))

    @property
    def max_m(self) -> float:
        """How wide the fingers open, m."""
        return float(self.width_m[-1])

    def value_at(self, width_m: float) -> float:
        """The gripper joint's value for a width, clipped to what the gripper can do."""
        return float(np.interp(width_m, self.width_m, self.value))

    def width_at(self, value: float) -> float:
        """The width between the pads, in metres, at a value of the gripper's joint."""
        return float(np.interp(value, *self._by_value))

    @cached_property
    def _by_value(self) -> tuple[Array, Array]:
        """Values, rising, and the widths there."""
        order = np.argsort(self.value)
        return self.value[order], self.width_m[order]

    def pad_z_at(self, width_m: float) -> float:
        """The middle of the pads along the hand's z, at a width."""
        return float(np.interp(width_m, self.width_m, self.pad_z_m))

    def pad_y_at(self, width_m: float) -> float:
        """The middle of the pads along the hand's y, at a width."""
        return 0.0 if self.jaw == 0 and not self.round_only else float(np.interp(width_m, self.width_m, self.pad_y_m))

    def hand_position(self, middle: Array, R: Array, width_m: float) -> Array:
        """Where the hand frame (..., 3) is when R (3, 3) turns it and the middle between its pads is at points (..., 3), at a width."""
        if self.jaw == 0 and not self.round_only:
            return np.asarray(middle - self.pad_z_at(width_m) * R[:, 2])
        return np.asarray(middle - self.pad_z_at(width_m) * R[:, 2] - self.pad_y_at(width_m) * R[:, 1])

    def pads_middle(self, width_m: float) -> Array:
        """Where (3,) the middle between the pads is in the hand, at a width."""
        return np.array([0.0, self.pad_y_at(width_m), self.pad_z_at(width_m)])

    def middle(self, width_m: float) -> Array:
        """The same (3,) in the hand that comes to close on an object of that width, after `beside`."""
        closed = self.pads_middle(width_m)
        return closed if self._draws is None else closed - BESIDE_M * self._draws

    @cached_property
    def _draws(self) -> Array | None:
        """Which way (3,) the hand draws an object that it closes on, in its own frame; None where it closes from both sides."""
        return np.array([0.0, -float(self.jaw), -1.0 if self.cup_m else 0.0]) if self.jaw or self.cup_m else None

    def beside(self, T_world_hand: Array) -> Array:
        """Where the hand is (4, 4) to close as at T_world_hand: with a jaw that moves alone BESIDE_M further, so that the pad that stands
        still passes the object, and as far before it with a cup; with any other hand just there."""
        return self._drawn(T_world_hand, BESIDE_M, T_world_hand[:3, :3])

    def held(self, T_hand_body: Array) -> Array:
        """Where an object is in the hand (4, 4) once it is closed: a jaw that moves alone pushes it by PUSH_M, and a cup draws it."""
        return self._drawn(T_hand_body, PUSH_M)

    def let_go(self, T_hand_body: Array) -> Array:
        """The inverse of `held`: where it is when the hand opens."""
        return self._drawn(T_hand_body, -PUSH_M)

    def _drawn(self, T: Array, by_m: float, R: Array | None = None) -> Array:
        """A pose (4, 4) moved the way the hand draws; R (3, 3): the hand's, in the pose's frame, if that is not the hand's own."""
        if self._draws is None:
            return T
        out = T.copy()
        out[:3, 3] += by_m * (self._draws if R is None else R @ self._draws)
        return out

    def closing_value(self, width_m: float) -> float:
        """The joint's value at which the pads hold an object of a width, after `beside` and `held`."""
        return self.value_at(width_m if self.jaw == 0 else width_m + BESIDE_M - PUSH_M)

    def depth_at(self, width_m: Array) -> Array:
        """How far (N,) behind the pads' middle objects of these widths (N,) may reach."""
        return np.interp(width_m, self.width_m, self.depth_m)

    def depths_at(self, width_m: Array) -> Array:
        """How far behind the pads' middle each of SLICES of objects of these widths (N,) may reach, along each of TILTS: (N, T, S)."""
        if len(self.tilted_m) == 0:
            return np.where(TILTS[:, None] == 0.0, self.depth_at(width_m)[:, None, None], -np.inf) + np.zeros(len(SLICES))
        i = np.clip(np.searchsorted(self.width_m, width_m), 1, len(self.width_m) - 1)
        low, high = self.width_m[i - 1], self.width_m[i]
        share = np.clip((width_m - low) / (high - low), 0.0, 1.0)[:, None, None]
        return np.asarray((1 - share) * self.tilted_m[i - 1] + share * self.tilted_m[i])
