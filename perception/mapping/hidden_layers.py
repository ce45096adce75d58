"""How far the space beside a box is hidden, as a map has it; compiled."""

from __future__ import annotations

import numpy as np

from kinematics.chain import Int
from kinematics.jit.decorators import jit_entry
from kinematics.transforms import Array
from perception.mapping.carving import FREE, OCCUPIED, States


def hidden_layers(state: States, step: Array, T_grid_world: Array, low: Array, high: Array, axis: int, side: int, most: int) -> int:
    """How many layers of voxels, `most` at most, beside one face of a box of the world hide what is in them; 0 for two or fewer.

    low, high (3,): the box's corners. The face is that across `axis` at its low or high end, side -1 or 1. A layer hides nothing when it
    leaves the grid, when a fifth of it is FREE, or, beyond the first, when half of it is OCCUPIED. T_grid_world (4, 4).
    """
    return int(_hidden_layers(state, step, T_grid_world, low, high, axis, side, most, np.empty(3), np.empty(3, np.int64)))


@jit_entry
def _hidden_layers(
    state: States, step: Array, T_grid_world: Array, low: Array, high: Array, axis: int, side: int, most: int, x: Array, v: Int
) -> int:
    thickness, T = max(step[0], step[1], step[2]), T_grid_world
    p, q = (axis + 1) % 3, (axis + 2) % 3
    n_p = max(int(np.ceil(2 * (high[p] - low[p]) / thickness)), 3)
    n_q = max(int(np.ceil(2 * (high[q] - low[q]) / thickness)), 3)
    for layer in range(max(most, 3)):
        x[axis] = (high[axis] if side > 0 else low[axis]) + side * (layer + 0.5) * thickness
        free, occupied, inside = 0, 0, True
        for i in range(1, n_p):
            x[p] = low[p] + i * ((high[p] - low[p]) / n_p)
            for j in range(1, n_q):
                x[q] = low[q] + j * ((high[q] - low[q]) / n_q)
                for r in range(3):
                    v[r] = int(np.floor((T[r, 0] * x[0] + T[r, 1] * x[1] + T[r, 2] * x[2] + T[r, 3]) / step[r]))
                    inside = inside and 0 <= v[r] < state.shape[r]
                if inside:
                    free += state[v[0], v[1], v[2]] == FREE
                    occupied += state[v[0], v[1], v[2]] == OCCUPIED
        total = (n_p - 1) * (n_q - 1)
        if not inside or free / total >= 0.2 or (layer > 0 and occupied / total >= 0.5):
            return layer if layer > 2 else 0
    return most
