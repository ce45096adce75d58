"""The memory of RRT-Connect's two trees: allocated once for a thread, and used by query after query."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Int
from kinematics.jit.record import record
from kinematics.transforms import Array

NODES = 512  # of each tree, until a search needs more


@record
class Trees(NamedTuple):
    """Both trees, the starts' (0) and goals' (1), N nodes at most: q (2, N, J), parent (2, N), -1 for roots, radius (2, N) of the domain.

    roots (2,): how many of each tree's first nodes are roots; end (2, N): which start, or goal, each of these is. size (2,); rng (1,): the
    random numbers' state; met (3,): the two nodes that met, and iterations so far. path (2 N, J): from root to root, once they met; joined
    (2,): the start and the goal that it joins. Scratch: work (3, J); descent and T (2, 4, 4) for pulls.
    """

    q: Array
    parent: Int
    radius: Array
    roots: Int
    end: Int
    size: Int
    rng: NDArray[np.uint64]
    met: Int
    path: Array
    joined: Int
    work: Array
    descent: Array
    T: Array


def make_trees(n_q: int, nodes: int = NODES) -> Trees:
    """Trees of arms with n_q joints, with room for so many nodes each."""
    return Trees(
        q=np.zeros((2, nodes, n_q)),
        parent=np.zeros((2, nodes), np.int64),
        radius=np.zeros((2, nodes)),
        roots=np.zeros(2, np.int64),
        end=np.zeros((2, nodes), np.int64),
        size=np.zeros(2, np.int64),
        rng=np.zeros(1, np.uint64),
        met=np.zeros(3, np.int64),
        path=np.zeros((2 * nodes, n_q)),
        joined=np.zeros(2, np.int64),
        work=np.empty((3, n_q)),
        descent=np.empty((12 + n_q, max(6, n_q))),
        T=np.empty((2, 4, 4)),
    )


def widen(trees: Trees, nodes: int) -> Trees:
    """The same trees with room for more nodes, so many each."""
    n = trees.q.shape[1]
    wider = make_trees(trees.q.shape[2], nodes)
    for old, new in zip(trees, wider):
        if old.shape == new.shape:
            new[...] = old
        elif old is not trees.path:  # which is written at last
            new[:, :n] = old
    return wider
