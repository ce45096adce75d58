"""Surfaces of convex bodies out of patches: neighbours belong together over a convex or a smooth edge, and apart over a concave one.

That objects are divided at concave edges is the idea of Stein et al., "Object partitioning using local convexity", 2014 (LCCP). Here each
edge between two patches speaks for or against with a weight, and the edges with the greatest total between two sets are contracted first,
until none speaks for (greedy additive edge contraction, Keuper et al. 2015). So a single doubtful edge neither joins nor divides.
"""

from __future__ import annotations

import heapq

import numpy as np

from kinematics.transforms import Array
from perception.objects.patches import Int, Patches, unit

TOLERATED_DEG, SCALE_DEG = 19.0, 18.0
"""An edge that is concave by the first speaks neither way; each further SCALE_DEG count one. Vessels are smoothly concave inside."""
LEAST, MOST = -2.5, 1.0
"""What an edge can weigh, for each square root of its pairs of cells."""
STEP_DEG, STEP_SCALE_DEG, PARALLEL_DEG = 35.0, 20.0, 40.0
"""Patches with normals less than PARALLEL_DEG apart of which one lies above the other, by more than STEP_DEG as seen along the surface,
are the two sides of a step."""


def edge_angles(patches: Patches) -> tuple[Array, Array]:
    """For each edge (E,): the angle between the normals, positive when convex; and how steeply one patch lies above the other; degrees.

    Both are 0 where a patch has no normal.
    """
    i, j = patches.edges.T
    along = unit(patches.centres[i] - patches.centres[j])
    a, b = patches.normals[i], patches.normals[j]
    turn = np.degrees(np.arccos(np.clip((a * b).sum(1), -1, 1)))
    bend = np.where(((a - b) * along).sum(1) >= 0, turn, -turn)
    climb = np.degrees(np.arcsin(np.clip(np.abs((along * unit(a + b)).sum(1)), 0, 1)))
    told = a.any(1) & b.any(1)
    return np.where(told, bend, 0.0), np.where(told, climb, 0.0)


def edge_weights(patches: Patches) -> Array:
    """How much each edge (E,) speaks for one body, LEAST to MOST; to be multiplied by the length of the edge."""
    bend, climb = edge_angles(patches)
    weight = np.clip((bend + TOLERATED_DEG) / SCALE_DEG, LEAST, MOST)
    step = (climb > STEP_DEG) & (np.abs(bend) < PARALLEL_DEG)
    return np.where(step, np.minimum(weight, (STEP_DEG - climb) / STEP_SCALE_DEG), weight)


def convex_surfaces(patches: Patches) -> Int:
    """Which surface (K,) each patch belongs to."""
    return contracted(len(patches.size), patches.edges, edge_weights(patches) * np.sqrt(patches.contacts))


def contracted(count: int, edges: Int, weights: Array) -> Int:
    """The cluster (count,) of each node of a graph with signed weights (E,) on its edges (E, 2), by greedy additive edge contraction.

    The edge of greatest weight is contracted and parallel edges are added up, until no weight is positive.
    """
    beside: list[dict[int, float]] = [{} for _ in range(count)]
    for (i, j), w in zip(edges.tolist(), weights.tolist()):
        beside[i][j] = beside[i].get(j, 0.0) + w
        beside[j][i] = beside[i][j]
    heap = [(-w, i, j) for i in range(count) for j, w in beside[i].items() if i < j and w > 0]
    heapq.heapify(heap)
    parent = list(range(count))
    while heap:
        w, i, j = heapq.heappop(heap)
        if beside[i].get(j) != -w:
            continue  # one of the two is gone, or their weight is another by now
        if len(beside[i]) < len(beside[j]):
            i, j = j, i
        parent[j] = i
        del beside[i][j]
        for k, v in beside[j].items():
            if k != i:
                total = beside[i].get(k, 0.0) + v
                beside[i][k] = beside[k][i] = total
                del beside[k][j]
                if total > 0:
                    heapq.heappush(heap, (-total, min(i, k), max(i, k)))
        beside[j] = {}
    root = np.array(parent, np.int64)
    while (root[root] != root).any():
        root = root[root]
    return np.asarray(np.unique(root, return_inverse=True)[1], np.int64)
