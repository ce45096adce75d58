"""The points that each instance shows in several frames. Compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Int
from kinematics.jit.decorators import jit_entry
from kinematics.transforms import Array

F32 = NDArray[np.float32]
Bool = NDArray[np.bool_]
Labels = NDArray[np.int32]


@jit_entry
def count_instances(inside: Bool, instance: Labels, counts: Int) -> None:
    """How many pixels (H, W) inside the cabinet each of N instances has: added to counts (N,). Other numbers are nobody's."""
    for v in range(instance.shape[0]):
        for u in range(instance.shape[1]):
            k = instance[v, u]
            if inside[v, u] and 0 <= k < counts.shape[0]:
                counts[k] += 1


@jit_entry
def take_points(frame: int, inside: Bool, instance: Labels, points: F32, places: Int, free: Int, cloud: Array, pixels: Int) -> None:
    """Write down the points (H, W, 3) of a frame's instances, row by row, where there is room.

    places (N,): of each instance in `free`. free (M,): the next free rows of cloud (·, 3) and pixels (·, 2), which move on. A pixel is its
    frame and its number, row by row.
    """
    for v in range(instance.shape[0]):
        for u in range(instance.shape[1]):
            k = instance[v, u]
            if inside[v, u] and 0 <= k < places.shape[0]:
                row = free[places[k]]
                free[places[k]] += 1
                for r in range(3):
                    cloud[row, r] = points[v, u, r]
                pixels[row, 0], pixels[row, 1] = frame, v * instance.shape[1] + u
