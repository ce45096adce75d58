"""Whether convex parts contain a surface, and how much else: measured on the parts alone, without the code that made them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kinematics.meshes.cutting import ENTRIES, planes_of
from kinematics.meshes.surface import Surface
from kinematics.transforms import Array

MOST_ROUNDS = 40
CHUNK = 20_000
FINE_M = 8e-5
"""What reaches out of the parts by no more is not looked at closer."""


def largest_protrusion(surface: Surface, parts: Sequence[Array]) -> float:
    """How far a surface, the inside of its triangles too, reaches out of the union of convex parts at most, in metres; proven from above.

    How far a point is outside a part, by the part's planes, is a convex function, so its largest value on a triangle is at a corner. A
    triangle with no part that holds all three corners to FINE_M is halved along its longest side, again and again; what is too small to
    be halved counts with the part that holds it best.
    """
    if not parts:
        return float("inf")
    planes, boxes = [planes_of(p) for p in parts], np.array([[p.min(0), p.max(0)] for p in parts])
    worst, left = _held_by_one(surface, planes, boxes)
    for _ in range(MOST_ROUNDS):
        if len(left) == 0:
            return worst
        out = np.concatenate([_outside(left[i : i + CHUNK], planes, boxes, FINE_M) for i in range(0, len(left), CHUNK)])
        longest = np.linalg.norm(left - np.roll(left, 1, axis=1), axis=2).max(1)
        settled = (out <= FINE_M) | (longest <= FINE_M)
        worst = max(worst, float(out[settled].max(initial=0.0)))
        left = _halved(left[~settled])
    return max(worst, float(_outside(left, planes, boxes, 0.0).max(initial=0.0)))


def _held_by_one(surface: Surface, planes: Sequence[Array], boxes: Array) -> tuple[float, Array]:
    """The first round, a vertex at a time: how far triangles that one part holds to FINE_M reach out of it, and the others (F, 3, 3)."""
    best = np.full(len(surface.faces), np.inf)
    for (low, high), rows in zip(boxes, planes):
        near = np.flatnonzero(((surface.vertices >= low - FINE_M) & (surface.vertices <= high + FINE_M)).all(1))
        out = np.full(len(surface.vertices), np.inf)
        step = max(1, ENTRIES // len(rows))
        for some in (near[i : i + step] for i in range(0, len(near), step)):
            out[some] = (surface.vertices[some] @ rows[:, :3].T - rows[:, 3]).max(1)
        np.minimum(best, out[surface.faces].max(1), out=best)
    held = best <= FINE_M
    return max(float(best[held].max(initial=0.0)), 0.0), surface.triangles[~held]


def _outside(triangles: Array, planes: Sequence[Array], boxes: Array, fine_m: float) -> Array:
    """How far triangles (F, 3, 3) reach out of the part that holds each best (F,): exact where that is no more than fine_m."""
    out = np.full(len(triangles), np.inf)
    low, high = triangles.min(1), triangles.max(1)
    for (part_low, part_high), rows in zip(boxes, planes):
        beside = np.maximum(part_low - low, high - part_high).max(1)  # no less than this is the answer
        some = np.flatnonzero((out > fine_m) & (beside < out))
        if len(some):
            reach = (triangles[some].reshape(-1, 3) @ rows[:, :3].T - rows[:, 3]).max(1).reshape(-1, 3).max(1)
            out[some] = np.minimum(out[some], np.maximum(reach, beside[some]))
    return np.asarray(np.maximum(out, 0.0))


def _halved(triangles: Array) -> Array:
    """Triangles (2 F, 3, 3): each cut at the middle of its longest side."""
    if len(triangles) == 0:
        return triangles
    sides = np.linalg.norm(triangles - np.roll(triangles, -1, axis=1), axis=2)
    order = (np.argmax(sides, axis=1)[:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(np.take_along_axis(triangles, order[:, :, None], axis=1), 1, 0)
    middle = (a + b) / 2
    return np.concatenate([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)])
