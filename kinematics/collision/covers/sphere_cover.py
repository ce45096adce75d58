"""Sphere covers: balls whose union provably contains a convex solid, and that reach at most `excess_m` beyond it.

How tight. Every ball has its centre c inside the solid and the radius depth(c) + excess, where depth(c) is the distance from c to the
solid's surface. So no ball reaches further out than `excess_m`, and the same ball less `excess_m` lies inside the solid: the
outer balls prove that a part is free, the inner ones (`inner_radii`) that it touches.

Why contained: proof.py for hulls, grids.py for boxes and cylinders.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from kinematics.collision.covers.hulls import candidate_balls, convex_solid, evenly, surface_samples
from kinematics.collision.covers.proof import counterexamples
from kinematics.collision.covers.set_cover import Held, set_cover
from kinematics.transforms import Array

OnStep = Callable[[str], None]
ROUNDING_M = 1e-9  # balls are this much smaller in proofs: qhull's planes and float64 are better than that for anything in a room
SLACK = 0.03  # samples are covered by balls this share of the excess smaller, so that the bisection ends

_CANDIDATES = 900  # surface points that candidate balls are made from
_GAPS = 250  # counterexamples a round
_FRESH_ROUNDS = 10  # so often the set cover starts afresh with the new samples; later rounds only add to it


class Cover(NamedTuple):
    """S balls that contain a solid and reach at most excess_m beyond it: centres (S, 3), radii (S,), metres, in the solid's frame."""

    centres: Array
    radii: Array
    excess_m: float

    def inner_radii(self) -> Array:
        """Radii (S,) of the balls about the same centres that lie inside the solid; zero where there is none."""
        return np.maximum(self.radii - self.excess_m - ROUNDING_M, 0.0)


def cover(vertices: Array, excess_m: float, *, on_step: OnStep | None = None) -> Cover:
    """Balls that contain the convex hull of vertices (V, 3), in metres, and reach at most excess_m beyond it.

    on_step hears one line a round. Raises: ValueError when the hull has no volume or excess_m is not positive.
    """
    if not excess_m > 0:
        raise ValueError(f"excess_m: {excess_m} is not positive")
    solid = convex_solid(vertices)
    slack = SLACK * excess_m
    samples, normals = surface_samples(solid, excess_m)
    some = evenly(len(samples), _CANDIDATES)
    centres, radii = candidate_balls(solid, samples[some], normals[some], excess_m, slack)
    c, r, pruned, none = centres, radii, False, np.zeros(0, np.int64)
    unproved, held = np.ones(len(solid.fan), np.bool_), Held()
    held.add(centres, radii - slack, samples)
    for turn in range(1000):
        if turn < _FRESH_ROUNDS:
            chosen = held.cover()
            c, r = centres[chosen], radii[chosen]
            unproved[:] = True  # other balls. As long as balls are only added, what is proved stays proved
        gaps = counterexamples(solid.fan, c, r - ROUNDING_M, slack / 4, _GAPS, unproved)
        if on_step is not None:
            on_step(f"round {turn + 1}: {len(r)} balls, {len(gaps)} gaps")
        if len(gaps) == 0 and (pruned or turn < _FRESH_ROUNDS):
            return Cover(c, r, excess_m)
        if len(gaps) == 0:
            needed = set_cover(c, r - slack, samples, np.arange(len(r)))
            c, r, pruned = c[needed], r[needed], True
            unproved[:] = True
            continue
        samples = np.concatenate([samples, gaps])
        nearest = np.argmin(solid.planes[:, 3] - gaps @ solid.planes[:, :3].T, 1)
        more, more_r = candidate_balls(solid, gaps, solid.planes[nearest, :3], excess_m, slack)
        if turn + 1 < _FRESH_ROUNDS:
            centres, radii = np.concatenate([centres, more]), np.concatenate([radii, more_r])
            held.add(more, more_r - slack, gaps)
        else:
            chosen = set_cover(more, more_r - slack, gaps, none)
            c, r = np.concatenate([c, more[chosen]]), np.concatenate([r, more_r[chosen]])
    raise RuntimeError("the cover did not close")  # each round covers at least one gap with slack: it can't take so many


def uncovered(vertices: Array, balls: Cover) -> Array:
    """Points (N, 3) of the hull of vertices (V, 3) that lie in no ball, at most 400: none is the proof that the balls contain it."""
    fan = convex_solid(vertices).fan
    return counterexamples(fan, balls.centres, balls.radii, 1e-6, 400, np.ones(len(fan), np.bool_))
