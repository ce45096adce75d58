"""Few boxes that cover the marked voxels of a grid, compiled."""

from __future__ import annotations

import numpy as np

from kinematics.chain import Int
from kinematics.jit.decorators import njit
from perception.mapping.carving import States


@njit(cache=True, nogil=True)
def cover_with_boxes(blocked: States, out: Int) -> int:
    """Cover the blocked voxels (X, Y, Z) with boxes, rows [x0, y0, z0, x1, y1, z1) of `out` (N, 6).

    Returns how many, or -1 if N is too few.

    Greedy: from the first voxel that is not covered yet a box is grown along the three axes, in each of the six orders, over blocked
    voxels, covered or not; the box that covers most that is new is taken.
    """
    X, Y, Z = blocked.shape
    done = np.zeros((X, Y, Z), np.uint8)
    orders = np.array([[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]])
    low, high, best = np.empty(3, np.int64), np.empty(3, np.int64), np.empty(6, np.int64)
    shape = np.array([X, Y, Z])
    n = 0
    for i in range(X):
        for j in range(Y):
            for k in range(Z):
                if not blocked[i, j, k] or done[i, j, k]:
                    continue
                most = -1
                for o in range(6):
                    low[0], low[1], low[2] = i, j, k
                    high[0], high[1], high[2] = i + 1, j + 1, k + 1
                    for p in range(3):
                        axis = orders[o, p]
                        for side in range(2):
                            while True:
                                at = high[axis] if side == 0 else low[axis] - 1
                                if at < 0 or at >= shape[axis] or not _slice_blocked(blocked, low, high, axis, at):
                                    break
                                if side == 0:
                                    high[axis] += 1
                                else:
                                    low[axis] -= 1
                    fresh = 0
                    for x in range(low[0], high[0]):
                        for y in range(low[1], high[1]):
                            for z in range(low[2], high[2]):
                                fresh += 1 - done[x, y, z]
                    if fresh > most:
                        most = fresh
                        best[:3], best[3:] = low, high
                if n == out.shape[0]:
                    return -1
                out[n] = best
                n += 1
                done[best[0] : best[3], best[1] : best[4], best[2] : best[5]] = 1
    return n


@njit(cache=True, nogil=True)
def _slice_blocked(blocked: States, low: Int, high: Int, axis: int, at: int) -> bool:
    """Whether the layer `at` next to a box along an axis is blocked throughout."""
    x0, x1, y0, y1, z0, z1 = low[0], high[0], low[1], high[1], low[2], high[2]
    if axis == 0:
        x0, x1 = at, at + 1
    elif axis == 1:
        y0, y1 = at, at + 1
    else:
        z0, z1 = at, at + 1
    for x in range(x0, x1):
        for y in range(y0, y1):
            for z in range(z0, z1):
                if not blocked[x, y, z]:
                    return False
    return True
