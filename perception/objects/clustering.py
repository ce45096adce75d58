"""Objects told apart by geometry alone: cells of the surface, patches of them, convex surfaces, and the objects that these are parts of.

Surfaces are divided at concave edges (`convexity`), and where the cameras look through air between two convex bodies that hang together
all the same (`emptiness`); then the parts of vessels, of bodies that are not convex and of bodies behind others are joined (`merging`),
and what stands on another is divided from it by the ledge around a part of it (`stacked`).
Boxes that touch face to face and are flush leave no trace, and stay one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kinematics.transforms import Array
from perception.objects import merging
from perception.objects.convexity import convex_surfaces
from perception.objects.emptiness import Witness, divided, witness
from perception.objects.patches import CELL_M, Cells, Int, surface_cells, surface_patches
from perception.objects.prepared_frames import PreparedFrames
from perception.objects.stacked import stacks_divided

FEWEST_CELLS = 12
"""Fewer are no object but noise."""
MOST_PATCHES = 20000
"""The surface of a hundred objects."""


class NoSurfaces(ValueError):
    """Depth images show points all over the cabinet, as no surfaces would: they are noise, or the cameras' poses are wrong."""


def cluster_instances(views: PreparedFrames) -> PreparedFrames:
    """The same views with instances found by geometry alone, whatever they had, and names object_0, object_1, … from the front back.

    Raises: NoSurfaces when the points fill the cabinet.
    """
    cells = surface_cells(views)
    groups = group(cells, witness(views)) if len(cells.points) else np.zeros(0, np.int32)
    label = np.append(groups, np.int32(-1))[cells.of_pixel]  # a pixel without a cell has -1, the last
    names = tuple(f"object_{k}" for k in range(int(groups.max(initial=-1)) + 1))
    frames, at = [], 0
    for frame, inside in zip(views.frames, views.inside):
        instance = np.full(inside.shape, -1, np.int32)
        n = int(np.count_nonzero(inside))
        instance[inside] = label[at : at + n]
        at += n
        frames.append(replace(frame, instance=instance, names=names))
    return replace(views, frames=tuple(frames))


def group(cells: Cells, seen: Witness) -> NDArray[np.int32]:
    """The object (C,) of each cell, numbered from the front of the cabinet to its back, -1 for none.

    Raises: NoSurfaces when the cells fill the cabinet.
    """
    patches = surface_patches(cells)
    if len(patches.size) > MOST_PATCHES:
        raise NoSurfaces(
            "the depth images show no surfaces but points all over the cabinet: they are noise, or the cameras' poses are wrong"
        )
    surface = merging.small_absorbed(cells, convex_surfaces(patches)[patches.of_cell])
    label, parted = divided(cells, patches, merging.owners(patches, surface), seen)
    closed = merging.enclosed_absorbed(cells, merging.vessels_closed(cells, label))
    now = {k: int(closed[label == k][0]) for pair in parted for k in pair}
    bodies = [(now[a], now[b]) for a, b in parted if now[a] != now[b]]
    label = merging.parts_joined(cells, patches, closed, bodies)
    label = merging.occluded_joined(cells, patches, label, seen)
    label = stacks_divided(cells, merging.fragments_absorbed(cells, label))
    return _from_the_front(cells.points, label)


def _from_the_front(points: Array, label: Int) -> NDArray[np.int32]:
    """The same groups, numbered by how far their nearest cell lies behind the front; those of fewer than FEWEST_CELLS cells are none."""
    kept = np.flatnonzero(np.bincount(label) >= FEWEST_CELLS)
    order = np.argsort([points[label == k, 0].min() for k in kept], kind="stable")
    number = np.full(int(label.max()) + 1, -1, np.int32)
    number[kept[order]] = np.arange(len(kept))
    return np.asarray(number[label], np.int32)


__all__ = ["CELL_M", "FEWEST_CELLS", "NoSurfaces", "cluster_instances", "group"]
