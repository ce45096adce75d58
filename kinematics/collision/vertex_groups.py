"""Vertices sorted so that the search for the furthest one in a direction skips most of them (see `gjk.support`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinematics.transforms import Array

GROUP = 16
"""Vertices in a group that the search for the furthest one opens or skips as a whole."""
_BITS = np.arange(5)[:, None]
"""Of the three coordinates' cells, to be interleaved."""


def grouped(points: Array, start: NDArray[np.int64]) -> tuple[Array, Array, NDArray[np.int64]]:
    """Sort the points (V, 3) of bodies, body i's being points[start[i]:start[i + 1]], so that neighbours in space are neighbours in memory.

    Returns vertices (3, N), every body filled up to whole groups by repeating its last point; balls around the groups (4, N / GROUP):
    centre and radius; and where each body starts now.
    """
    sizes = np.diff(start)
    if not len(points):
        return np.zeros((3, 0)), np.zeros((4, 0)), np.zeros(len(start), np.int64)
    body = np.repeat(np.arange(len(sizes)), sizes)
    some = np.flatnonzero(sizes)
    low, high = np.zeros((len(sizes), 3)), np.ones((len(sizes), 3))
    low[some], high[some] = (f.reduceat(points, start[some]) for f in (np.minimum, np.maximum))
    cell = ((points - low[body]) / np.maximum(high - low, 1e-9)[body] * 31.99).astype(np.int64)
    code = ((cell[:, None] >> _BITS & 1) << (3 * _BITS + np.arange(3))).sum((1, 2))  # Morton's order
    order = np.argsort(code + (body << 15), kind="stable")
    filled = -(-sizes // GROUP) * GROUP
    starts = np.concatenate([[0], np.cumsum(filled)]).astype(np.int64)
    owner = np.repeat(np.arange(len(sizes)), filled)
    within = np.minimum(np.arange(starts[-1]) - starts[owner], sizes[owner] - 1)
    placed = points[order[start[owner] + within]]
    corners = placed.reshape(-1, GROUP, 3)
    centre = (corners.min(1) + corners.max(1)) / 2
    radius = np.sqrt(((corners - centre[:, None]) ** 2).sum(-1).max(-1)) + 1e-12
    return np.ascontiguousarray(placed.T), np.ascontiguousarray(np.c_[centre, radius].T), starts
