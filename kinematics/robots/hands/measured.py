"""The gripper's table from the cache: measuring it takes half a second, and every command would."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from kinematics import cache
from kinematics.robots.hands.gripper import measure
from kinematics.robots.hands.opening import Opening
from kinematics.robots.tree import LinkHull, Tree
from kinematics.transforms import Array

_VERSION = "opening-10"  # raise it when what `measure` computes changes
_NUMBERS = ("jaw", "round_only", "cup_m")


def measure_once(
    tree: Tree, hulls: tuple[LinkHull, ...], fingers: frozenset[str], gripper: int, limits: tuple[float, float], rest: Array, name: str
) -> tuple[Opening, frozenset[str]]:
    """`gripper.measure`, or what an earlier run found for the same geometry. Raises what that does."""
    arrays = [tree.parent, tree.T_joint, tree.kind, tree.axis, tree.q_index, tree.scale, tree.offset, rest]
    for hull in hulls:
        arrays += [hull.vertices, hull.faces]
    words = repr((_VERSION, tree.names, [h.link for h in hulls], sorted(fingers), gripper, limits, [a.shape for a in arrays]))
    key = "opening-" + cache.key(words, *(np.ascontiguousarray(a).tobytes() for a in arrays))
    data = cache.load(key)
    if data is not None:
        known: dict[str, Any] = {f.name: data[f.name].item() if f.name in _NUMBERS else data[f.name] for f in fields(Opening)}
        return Opening(**known), frozenset(str(link) for link in data["pads"])
    opening, pads = measure(tree, hulls, fingers, gripper, limits, rest, name)
    cache.store(key, {"pads": np.array(sorted(pads), str), **{f.name: np.asarray(getattr(opening, f.name)) for f in fields(Opening)}})
    return opening, pads
