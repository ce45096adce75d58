"""The surface that depth images show, as cells of a few millimetres with normals, and as small patches of cells that are nearly plane.

Patches are supervoxels (Papon et al., "Voxel cloud connectivity segmentation", 2013): cells are assigned to the seed that is nearest by
distance, normal and height over its plane, a few times over, and a patch is a connected set of them. No patch runs over a crease that is
longer than a patch is wide, so what objects are made of can be decided patch by patch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from kinematics.transforms import Array
from perception.objects.normals import surface_normals
from perception.objects.prepared_frames import PreparedFrames, pinhole_of

Int = NDArray[np.int64]

CELL_M = 0.004
"""Points are gathered in cubes of this size."""
REACH_M, GATE_M = 0.008, 0.010
"""A normal is fitted to the pixels this far around one, and no deeper or nearer than the second."""
PATCH_M = 0.014
"""The width of a patch."""
NORMAL_WEIGHT, HEIGHT_WEIGHT, HEIGHT_M = 4.0, 0.3, 0.004
"""What a turned normal counts, and a height of HEIGHT_M over the patch's plane, against a distance of PATCH_M."""
ROUNDS, SEEDS = 5, 8
FEWEST = 4
"""A patch of fewer cells joins a neighbour."""


@dataclass(frozen=True, eq=False)
class Cells:
    """points (C, 3) in the cabinet, their mean; normals (C, 3) towards the cameras; index (C, 3) in a grid of CELL_M.

    of_pixel (P,): the cell of each pixel inside the cabinet, frame by frame and row by row, -1 for none. pairs (E, 2): cells that touch.
    """

    points: Array
    normals: Array
    index: Int
    of_pixel: Int
    pairs: Int


@dataclass(frozen=True, eq=False)
class Patches:
    """of_cell (C,): the patch of each cell. size (K,), centres (K, 3), normals (K, 3) of the patches.

    edges (E, 2): patches that touch, the lower number first; contacts (E,): by how many pairs of cells.
    """

    of_cell: Int
    size: Int
    centres: Array
    normals: Array
    edges: Int
    contacts: Int


def surface_cells(views: PreparedFrames) -> Cells:
    """The cells that hold enough pixels."""
    shown = zip(views.points, views.inside)
    points = np.concatenate([np.zeros((0, 3)), *(p[inside] for p, inside in shown)])
    if not len(points):
        return Cells(points, points, np.zeros((0, 3), np.int64), np.zeros(0, np.int64), np.zeros((0, 2), np.int64))
    normals = np.concatenate([_normals(views, i)[inside] for i, inside in enumerate(views.inside)])
    index = np.floor((points - points.min(0)) / CELL_M).astype(np.int64)
    shape = index.max(0) + 1
    flat = np.ravel_multi_index(tuple(index.T), shape)
    count = np.bincount(flat, minlength=int(np.prod(shape)))
    around = ndimage.uniform_filter(count.reshape(shape).astype(np.float32), 3, mode="constant").reshape(-1) * 27
    kept = np.flatnonzero((count > 0) & (around >= 2.5))
    number = np.full(len(count), -1, np.int64)
    number[kept] = np.arange(len(kept))
    of_pixel = number[flat]
    means = _means(np.concatenate([points, normals], 1)[of_pixel >= 0], of_pixel[of_pixel >= 0], len(kept))
    index = np.stack(np.unravel_index(kept, shape), -1)
    return Cells(means[:, :3], unit(means[:, 3:]), index, of_pixel, touching(index))


def _normals(views: PreparedFrames, i: int) -> NDArray[np.float32]:
    return surface_normals(
        views.depths[i], views.inside[i], *pinhole_of(views.frames[i]), views.T_cabinet_camera[i], REACH_M, GATE_M, views.axial
    )


def touching(index: Int) -> Int:
    """Pairs (E, 2) of cells (C, 3) that share a face, an edge or a corner."""
    number = np.full(index.max(0, initial=0) + 3, -1, np.int64)
    number[tuple((index + 1).T)] = np.arange(len(index))
    pairs = [np.zeros((0, 2), np.int64)]
    for step in np.ndindex(3, 3, 3):
        if step > (1, 1, 1):
            other = number[tuple((index + step).T)]
            own = np.flatnonzero(other >= 0)
            pairs.append(np.column_stack([own, other[own]]))
    return np.concatenate(pairs)


def surface_patches(cells: Cells) -> Patches:
    """The cells gathered into patches."""
    cube = np.floor(cells.points / PATCH_M).astype(np.int64)
    cube -= cube.min(0)
    label: Int = np.unique(np.ravel_multi_index(tuple(cube.T), cube.max(0) + 1), return_inverse=True)[1].astype(np.int64)
    for _ in range(ROUNDS):
        label = _reassigned(cells, label)
    same = cells.pairs[label[cells.pairs[:, 0]] == label[cells.pairs[:, 1]]]
    label = _without_tiny(components(same, len(label)), cells.pairs)
    size = np.bincount(label)
    means = _means(np.concatenate([cells.points, cells.normals], 1), label, len(size))
    ends = np.sort(label[cells.pairs], axis=1)
    edges, contacts = np.unique(ends[ends[:, 0] != ends[:, 1]], axis=0, return_counts=True)
    return Patches(label, size, means[:, :3], unit(means[:, 3:]), edges, contacts)


def _reassigned(cells: Cells, label: Int) -> Int:
    """Each cell in the patch of those around that suits it best, once their middles are taken anew."""
    label = np.unique(label, return_inverse=True)[1]
    means = _means(np.concatenate([cells.points, cells.normals], 1), label, int(label.max()) + 1)
    centres, normals = means[:, :3], unit(means[:, 3:])
    distance, seed = cKDTree(centres).query(cells.points, k=min(SEEDS, len(centres)))
    distance, seed = distance.reshape(len(label), -1), seed.reshape(len(label), -1)
    turned = 1 - np.einsum("ck,csk->cs", cells.normals, normals[seed])
    height = np.einsum("csk,csk->cs", cells.points[:, None] - centres[seed], normals[seed])
    cost = (distance / PATCH_M) ** 2 + NORMAL_WEIGHT * turned + HEIGHT_WEIGHT * (height / HEIGHT_M) ** 2
    return np.asarray(seed[np.arange(len(label)), cost.argmin(1)], np.int64)


def _without_tiny(label: Int, pairs: Int) -> Int:
    """Patches of fewer than FEWEST cells join the larger one that they touch most."""
    both = np.concatenate([pairs, pairs[:, ::-1]])
    for _ in range(3):
        tiny = np.bincount(label)[label] < FEWEST
        ends = label[both[tiny[both[:, 0]] & ~tiny[both[:, 1]]]]
        found, count = np.unique(ends, axis=0, return_counts=True)
        order = np.lexsort((-found[:, 1], count))  # the last one of a patch decides: most touches, then the lowest number
        goal = np.arange(int(label.max(initial=-1)) + 1)
        goal[found[order, 0]] = found[order, 1]
        label = np.unique(goal[label], return_inverse=True)[1].astype(np.int64)
    return label


def components(pairs: Int, count: int) -> Int:
    """The number (count,) of the connected component that each of `count` things is in; pairs (E, 2) are joined."""
    graph = coo_array((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


def _means(values: Array, label: Int, count: int) -> Array:
    """The mean (count, K) of the rows (N, K) that bear each label."""
    total = np.stack([np.bincount(label, values[:, k], minlength=count) for k in range(values.shape[1])], -1)
    return np.asarray(total / np.maximum(np.bincount(label, minlength=count), 1)[:, None])


def unit(vectors: Array) -> Array:
    """Vectors (N, 3) of length one; those of length zero stay zero."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12))
