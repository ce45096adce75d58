"""How good the networks are at what they are for, on unseen states: the first choice, the first region, honest chances."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from planning.learning.networks.scores import BLOCKING_SHARE, object_score, region_score
from planning.learning.networks.tokens import F32
from planning.learning.training.batches import asked, usable
from planning.learning.training.dataset import Data
from planning.learning.training.settings import Settings

STATES = 1000  # that are looked at, at most


@torch.no_grad()
def judge_osnet(net: nn.Module, data: Data, settings: Settings) -> dict[str, float]:
    """Shares over the states where an object blocks: the first choice has the label's largest p; it can be picked; the target is free
    without it (of the states where any one object does that); both. Over the states with a relaxed plan of at least one move, and of at
    least two: the first choice goes first in a shortest one. And the calibration errors of the chances.
    """
    part = data.take(usable("osnet", data)[:STATES])
    net.eval()
    logits = net(*(torch.from_numpy(a) for a in (part.context, part.grasp, part.boxes, part.mask))).numpy()
    chances = 1 / (1 + np.exp(-logits))
    here = part.mask[:, 1:]
    score = chances[..., 0] if settings.form == "paper" else object_score(*np.moveaxis(chances, -1, 0))
    blocked = np.nansum(part.p, 1) > 0
    first = np.where(here, score, -np.inf).argmax(1)
    by_label = np.where(here, chances[..., 0], -np.inf).argmax(1)
    rows = np.arange(len(part))
    helps, picked = part.opens[rows, first] == 1, part.pickable[rows, first] == 1
    can = (part.opens == 1).any(1) & blocked
    best = ((part.opens == 1) & (part.pickable == 1)).any(1) & blocked
    goes_first = part.first[rows, first] == 1
    found = {
        "states": float(blocked.sum()),
        "top1_label": _share(part.p[rows, by_label] >= np.nanmax(np.nan_to_num(part.p), 1) - 1e-6, blocked),
        "top1_opens": _share(helps, can),
        "top1_pickable": _share(picked, blocked),
        "top1_opens_and_pickable": _share(helps & picked, best),
        "top1_first": _share(goes_first, part.least_moves >= 1),
        "top1_first_of_several": _share(goes_first, part.least_moves >= 2),
    }
    if settings.form == "objects":
        found["ece_pickable"] = calibration_error(chances[..., 1][here], part.pickable[here])
        found["ece_opens"] = calibration_error(chances[..., 2][here], part.opens[here])
        found["ece_first"] = calibration_error(chances[..., 3][here], part.first[here])
    return found


@torch.no_grad()
def judge_rpnet(net: nn.Module, data: Data, settings: Settings) -> dict[str, float]:
    """Over all objects that could be put somewhere: the first region is truly reachable, off the paths, both; how many regions are tried
    until one is both; of the objects that can make the relaxed plan shorter, whether they do in the first region. And the calibration
    error of the chance that o' can be carried there.
    """
    part = data.take(usable("rpnet", data)[:STATES])
    known = asked(part)
    share = part.hits / np.maximum(part.paths, 1)[:, None, None]
    good = known & (part.feasible == 1) & (share < BLOCKING_SHARE)
    rows, objects = np.nonzero(good.any(2))
    score, feasible = _ask(net, part, rows, objects, settings)
    known, good = known[rows, objects], good[rows, objects]
    shorter = (part.shorter == 1)[rows, objects]
    carried, off = (part.feasible == 1)[rows, objects], (share < BLOCKING_SHARE)[rows, objects]
    order = np.argsort(np.where(known, -score, np.inf), axis=1, kind="stable")
    first, each = order[:, 0], np.arange(len(rows))
    tries = np.take_along_axis(good, order, 1).argmax(1) + 1
    found = {
        "objects": float(len(rows)),
        "chance": _share(good[known], np.ones(int(known.sum()), bool)),
        "first_reachable": float(carried[each, first].mean()),
        "first_off_the_paths": float(off[each, first].mean()),
        "first_both": float(good[each, first].mean()),
        "tries_until_both": float(tries.mean()),
        "first_shortens": _share(shorter[each, first], shorter.any(1)),
    }
    if settings.form == "objects":
        found["ece_feasible"] = calibration_error(feasible[known], carried[known].astype(np.float32))
    return found


def calibration_error(chance: F32, truth: F32, bins: int = 10) -> float:
    """Expected calibration error: how far chances are from what came true, averaged over bins of equal width. NaN truths don't count."""
    chance, truth = chance[~np.isnan(truth)], truth[~np.isnan(truth)]
    if len(chance) == 0:
        return float("nan")
    which = np.minimum((chance * bins).astype(int), bins - 1)
    off = [abs(chance[which == k].mean() - truth[which == k].mean()) * (which == k).sum() for k in range(bins) if (which == k).any()]
    return float(sum(off) / len(chance))


def _ask(net: nn.Module, data: Data, rows: NDArray[np.intp], objects: NDArray[np.intp], settings: Settings) -> tuple[F32, F32]:
    """Scores and chances (n, B) of all regions for the object objects[i] of the state rows[i]."""
    net.eval()
    scores, chances = [], []
    distance = data.distance()
    for first in range(0, len(rows), 64):
        row, moved = rows[first : first + 64], objects[first : first + 64]
        scene = [torch.from_numpy(a[row]) for a in (data.context, data.grasp, data.boxes)]
        regions, chosen = torch.from_numpy(data.regions[row]), torch.from_numpy(moved + 1)[:, None]
        if settings.form == "paper":
            cost = net(*scene, regions, torch.from_numpy(data.there[row]), chosen)[:, 0].sigmoid().numpy()
            scores.append(-cost)
            chances.append(1 - cost)
            continue
        out = net(*scene, torch.from_numpy(data.mask[row]), regions, chosen.expand(-1, regions.shape[1])).sigmoid().numpy()
        scores.append(region_score(out[..., 1], out[..., 2], distance[row, moved]))
        chances.append(out[..., 1])
    return np.concatenate(scores), np.concatenate(chances)


def _share(true: NDArray[np.bool_], among: NDArray[np.bool_]) -> float:
    return float(true[among].mean()) if among.any() else float("nan")
