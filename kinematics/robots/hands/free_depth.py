"""How far behind a gripper's pads what they hold may reach, before it meets the links there."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from kinematics.chain import Int
from kinematics.robots.hands.hull_sections import HEIGHTS_M
from kinematics.robots.hands.opening import ROOM_M, SLICES, TILTS
from kinematics.transforms import Array

FOOT_M = 0.002
"""What of a pad comes so much further in than where it holds is behind what is held: the foot of a finger shaped like an L. Less is a pad
that tapers."""


def free_depth(placed: Sequence[tuple[str, Array, Int]], pads: frozenset[str], width: float, pad_z: float, *, feet: bool) -> float:
    """How far behind pad_z an object of this width may reach, however high it is, plus ROOM_M: an object that ends ROOM_M before this depth
    keeps ROOM_M from all other links, beside it as well as behind it.

    placed: hulls in the hand's frame, (link, vertices, faces). feet: whether the pads are in its way, too, where they come further in than
    `FOOT_M` past where they hold it.
    """
    nearest = float(HEIGHTS_M[0])
    steps = np.linspace(0.0, ROOM_M, 11)
    for link, vertices, faces in sorted(placed, key=lambda hull: -float(hull[1][:, 2].max())):
        if (feet or link not in pads) and vertices[:, 2].max() > nearest:
            reach = _furthest(vertices, faces, width / 2 + (np.array([-FOOT_M]) if link in pads else steps[1:]))
            for inner, z in zip(steps, reach):  # what is that far beside it has to be so far behind it
                if z < pad_z:
                    nearest = max(nearest, float(z) - ROOM_M + float(np.sqrt(ROOM_M**2 - inner**2)))
    return pad_z - nearest


def _furthest(vertices: Array, faces: Int, half: Array) -> Array:
    """The largest z of a convex hull where |y| ≤ half (N,), for each (N,); -inf where it has nothing there."""
    a, b = (np.concatenate([vertices[faces[:, i]] for i in order]) for order in ((0, 1, 2), (1, 2, 0)))
    best = np.where(np.abs(a[:, 1]) <= half[:, None], a[:, 2], -np.inf).max(1, initial=-np.inf)
    for y in (-half[:, None], half[:, None]):
        crosses = (a[:, 1] - y) * (b[:, 1] - y) < 0
        with np.errstate(divide="ignore", invalid="ignore"):
            z = a[:, 2] + (y - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 2] - a[:, 2])
        best = np.maximum(best, np.where(crosses, z, -np.inf).max(1, initial=-np.inf))
    return np.asarray(best)


def free_depths(placed: Sequence[tuple[str, Array, Int]], pads: frozenset[str], width: float, pad_z: float, *, feet: bool) -> Array:
    """The same along each of TILTS, for each of SLICES of an object of this width: (T, S); of links behind the pads alone, so of no camera
    that looks past them."""
    half, along = width / 2, np.stack([np.sin(TILTS), np.cos(TILTS)])
    steps = np.linspace(0.0, ROOM_M, 6)
    starts, forward = half * SLICES, np.full((len(TILTS), len(SLICES)), float(HEIGHTS_M[0]))
    straight = int(np.argmin(np.abs(TILTS)))
    slices = [(s, low, high, 0.0) for s, (low, high) in enumerate(zip(starts, [*starts[1:], half + steps[1]]))]
    slices += [(len(starts) - 1, half, half + outer, inner) for inner, outer in itertools.pairwise(steps[1:])]
    at, low, high, inner = (np.array(column) for column in zip(*slices))
    spare = np.sqrt(ROOM_M**2 - inner**2)[:, None]  # what is beside it has to be less far behind it
    for link, vertices, faces in placed:
        if (link in pads and not feet) or not vertices[:, 0].min() < 0.0 < vertices[:, 0].max():
            continue
        ahead = (vertices[:, ::2] - [0.0, pad_z]) @ along
        if (ahead.max(0)[:, None] <= forward).all():
            continue
        edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        most = half - FOOT_M if link in pads else np.inf
        reach = _forward(vertices[:, 1], ahead, edges[edges[:, 0] < edges[:, 1]], np.minimum(low, most), np.minimum(high, most))
        behind = (reach[:, straight] < 0.0) & (low < most)
        np.maximum.at(forward.T, at[behind], (reach - ROOM_M + spare)[behind])
    return -forward


def _forward(y: Array, ahead: Array, edges: Int, low: Array, high: Array) -> Array:
    """The largest of each column of `ahead` (V, T) that a convex hull has where low ≤ |y| ≤ high, for each of these (S,).

    (S, T), -inf where it has nothing there.
    """
    planes, at = np.unique(np.concatenate([-high, -low, low, high]), return_inverse=True)
    a, b = y[edges[:, 0]] - planes[:, None], y[edges[:, 1]] - planes[:, None]
    k, e = np.nonzero(a * b < 0)
    i, j = edges[e].T
    share = (a[k, e] / (a[k, e] - b[k, e]))[:, None]
    crossed = np.full((len(planes), ahead.shape[1]), -np.inf)
    np.maximum.at(crossed, k, ahead[i] + share * (ahead[j] - ahead[i]))
    beside = np.abs(y)
    within = np.stack([ahead[(beside >= least) & (beside <= most)].max(0, initial=-np.inf) for least, most in zip(low, high)])
    return np.asarray(np.maximum(within, crossed[at.reshape(4, -1)].max(0)))
