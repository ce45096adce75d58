"""A straight pull: the hand moves along a line and keeps its orientation.

A hand between objects, or one that holds an object between others, gets out straight along one of its own axes or of the world's. In joint
space such ways are too thin to be met by chance.
"""

from __future__ import annotations

import numpy as np

from kinematics.chain import Chain, forward
from kinematics.inverse import descend, make_work
from kinematics.jit.decorators import copy_row, copy_rows, jit_entry
from kinematics.transforms import Array

WAYS = 12
PULL_M = 0.1
_ROUGHLY = 3
"""Iterations of `descend`. The millimetres that it may leave do no harm: an edge is certified for itself, whatever it was meant to be."""


def pull(chain: Chain, q: Array, way: int, by_m: float) -> Array:
    """Where the joints (J,) are, about, when the last frame has moved by by_m from where it is at q (J,); way: see `pulled`."""
    out = np.empty(len(q))
    frames, work = make_work(chain)
    pulled(chain, q, way, by_m, frames, work, np.empty((2, 4, 4)), out)
    return out


@jit_entry
def pulled(chain: Chain, q: Array, way: int, by_m: float, frames: Array, work: Array, T: Array, out: Array) -> None:
    """Where the joints (J,) are, about, when the last frame has moved by by_m from where it is at q (J,), as far as limits allow.

    way: 0 to 11; there and back along each of its own axes first, then along the world's. Scratch: frames and work, as for
    `inverse.descend`, and T (2, 4, 4).
    """
    K, axis, by = chain.q_index.shape[0], way // 2 % 3, by_m if way % 2 == 0 else -by_m
    forward(chain, q, frames)
    copy_rows(frames[0], T[0])  # the identity
    copy_rows(frames[K], T[1])
    for r in range(3):
        T[1, r, 3] += by * (frames[K, r, axis] if way < 6 else frames[0, r, axis])
    copy_row(q, out)
    descend(chain, T[0], T[1], out, frames, work, _ROUGHLY)
