"""What a step of training sees: some states, and of each the objects and regions that are asked about."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planning.learning.labelling.label_file import NOT_ASKED
from planning.learning.networks.scores import paper_cost
from planning.learning.networks.tokens import F32
from planning.learning.training.dataset import Data, Flags
from planning.learning.training.settings import Settings

ASKED = 2  # objects o' of a state in a step, `paper` form
HIDDEN = 0.3  # share of the states, `paper` form, in which some regions are made unobserved: most labels come from fully seen scenes


@dataclass(frozen=True, eq=False)
class Batch:
    """inputs: what the network's `forward` takes. wanted: per head, NaN where unknown, with its weight in the loss.

    heads: whether the network's output has a last axis for its heads.
    """

    inputs: tuple[NDArray[Any], ...]
    wanted: tuple[F32, ...]
    weights: tuple[float, ...]
    heads: bool = True


def usable(name: str, data: Data) -> NDArray[np.intp]:
    """Indices of the states that say something to this network."""
    if name == "osnet":
        return np.flatnonzero((~np.isnan(data.p)).any(1))
    return np.flatnonzero(np.concatenate([asked(part).any((1, 2)) for part in _slices(data)]))


def asked(data: Data) -> Flags:
    """(N, M, B): pairs that the labels know about, of objects that can be picked and regions where they would touch nothing.

    The others need no network: the boxes say so, or the object can't be moved at all.
    """
    known = (data.feasible != NOT_ASKED) & (data.hits != NOT_ASKED) & (data.paths[:, None, None] > 0)
    return np.asarray(known & data.free & (data.pickable == 1)[:, :, None])


def osnet_batch(data: Data, index: NDArray[np.intp], settings: Settings, rng: np.random.Generator) -> Batch:
    """Some states for OSNet."""
    inputs = (data.context[index], data.grasp[index], data.boxes[index], data.mask[index])
    if settings.form == "paper":
        return Batch(inputs, (data.p[index],), (1.0,))
    return Batch(inputs, (data.p[index], data.pickable[index], data.opens[index], data.first[index]), (4.0, 1.0, 1.0, 1.0))


def rpnet_batch(data: Data, index: NDArray[np.intp], settings: Settings, rng: np.random.Generator) -> Batch:
    """Some states for RPNet, with pairs (o', region) drawn from what was asked."""
    part = data.take(index)
    return _paper_pairs(part, rng) if settings.form == "paper" else _pairs(part, settings.pairs, rng)


def _pairs(part: Data, count: int, rng: np.random.Generator) -> Batch:
    n, cells = len(part), part.regions.shape[1]
    known = asked(part).reshape(n, -1)
    draw = np.where(known, rng.random(known.shape, np.float32), np.float32(2))
    count = min(count, draw.shape[1])
    pairs = np.argpartition(draw, count - 1, axis=1)[:, :count]
    rows = np.arange(n)[:, None]
    moved, region = pairs // cells, pairs % cells
    nothing = ~known[rows, pairs]
    feasible = part.feasible[rows, moved, region].astype(np.float32)
    hits = part.hits[rows, moved, region].astype(np.float32) / np.maximum(part.paths, 1)[:, None]
    way = part.boxes[rows, moved + 1, :2] - part.regions[rows, region, :2]
    distance = np.linalg.norm(way, axis=-1) / np.linalg.norm(part.context[:, 3:5], axis=1)[:, None]
    shorter = part.shorter[rows, moved, region].astype(np.float32)
    shorter[shorter == NOT_ASKED] = np.nan
    wanted = [np.where(nothing, np.nan, w).astype(np.float32) for w in (paper_cost(feasible, hits, distance), feasible, hits, shorter)]
    inputs = (part.context, part.grasp, part.boxes, part.mask, part.regions[rows, region], moved + 1)
    return Batch(inputs, tuple(wanted), (1.0, 1.0, 1.0, 1.0))


def _paper_pairs(part: Data, rng: np.random.Generator) -> Batch:
    """Two objects a state, all regions: unobserved and occupied ones cost 1, without a doubt."""
    n = len(part)
    candidates = np.asarray(asked(part).any(2))
    draw = np.where(candidates, rng.random(candidates.shape), 2)
    moved = np.argsort(draw, axis=1)[:, :ASKED]
    rows = np.arange(n)[:, None]
    regions = part.regions.copy()
    corner = regions[np.arange(n), rng.integers(0, part.there.sum(1)), :2]  # behind or beside it nothing was seen
    side = rng.choice([-1.0, 1.0], (n, 2))
    beyond = np.asarray((regions[..., :2] - corner[:, None]) * side[:, None]) >= 0
    hidden = beyond.all(-1) & (rng.random((n, 1)) < HIDDEN)
    regions[..., 3] *= ~hidden
    feasible, hits = part.feasible[rows, moved], part.hits[rows, moved]
    share = np.asarray(hits / np.maximum(part.paths, 1)[:, None, None], np.float32)
    cost = paper_cost(feasible.astype(np.float32), share, part.distance()[rows, moved])
    cost[(feasible == NOT_ASKED) | ((hits == NOT_ASKED) & (feasible == 1))] = np.nan
    cost[~part.free[rows, moved] | (regions[:, None, :, 3] < 0.5)] = 1
    cost[~part.there[:, None].repeat(moved.shape[1], 1)] = np.nan
    cost[~candidates[rows, moved]] = np.nan
    inputs = (part.context, part.grasp, part.boxes, regions, part.there, moved + 1)
    return Batch(inputs, (cost.astype(np.float32),), (1.0,), heads=False)


def _slices(data: Data, size: int = 4096) -> list[Data]:
    return [data.take(np.arange(i, min(i + size, len(data)))) for i in range(0, len(data), size)]
