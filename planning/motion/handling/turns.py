"""Whole turns of joints: the hand is where it was, and the arm has other room to move.

What is carried upright leaves it little: a wrist that may not tip over has to turn round through a side look, and on one side of that the
hand may meet its own arm. With a joint a whole turn further the way leads through the other side.
"""

from __future__ import annotations

from itertools import islice, product

import numpy as np

from kinematics.transforms import Array

MOST = 4
"""So many ways to stand the same are enough."""


def whole_turns(way: Array, lower: Array, upper: Array, most: int = MOST) -> Array:
    """By what waypoints (K, A) may be moved (T, A), in whole turns of joints, all of them staying within limits (A,); T is 1 to `most`, and
    those come first that turn the fewest joints, none of all."""
    ranges = zip(way.min(0).tolist(), way.max(0).tolist(), lower.tolist(), upper.tolist())
    fits = [
        [s for s in (0, 1, -1) if s == 0 or (low <= least + s * 2 * np.pi and largest + s * 2 * np.pi <= high)]
        for least, largest, low, high in ranges
    ]
    turns = sorted(product(*fits), key=lambda by: sum(map(abs, by)))
    return 2 * np.pi * np.array(list(islice(turns, most)), float)


def nearest_turns(solutions: Array, near: Array, lower: Array, upper: Array) -> Array:
    """Arm configurations (S, A), each joint by whole turns as near to `near` (S, A) as limits (A,) allow."""
    best, far = solutions.copy(), np.abs(solutions - near)
    for by in (2 * np.pi, -2 * np.pi):
        other = solutions + by
        nearer = (np.abs(other - near) < far) & (other >= lower) & (other <= upper)
        best, far = np.where(nearer, other, best), np.where(nearer, np.abs(other - near), far)
    return best
