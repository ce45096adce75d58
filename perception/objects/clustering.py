"""Objects told apart by geometry alone: two points are of one convex object unless the segment between them is somewhere seen to be empty.

So the frames themselves are the witness: a gap, a step in height or a concave crease between two bodies is air that some camera looks
through, whereas both halves of a body that stands behind another have only hidden space between them. Boxes that touch face to face and are
flush leave no such trace, and stay one. The points are first gathered into patches, the patches into objects by average linkage, and
the few cells between two objects are then judged one by one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError, cKDTree

from kinematics.transforms import Array, inverse
from perception.objects.prepared_frames import PreparedFrames, arm_of, pinhole_of
from perception.pixels import nearest_around, separated_shares, separations

Int = NDArray[np.int64]

CELL_M = 0.004
"""Points are gathered in cubes of this size; an object has no gap of three of them."""
PATCH_M = 0.02
"""Patches are the parts of an object within cubes of this size."""
STEP_M = 0.004
"""Along a segment, a point is looked at every so far."""
SLACK_M = 0.004
"""What is measured must be further away than this for a point in front of it to be empty."""
USUAL_M, MOST_M = 0.12, 0.60
"""Hidden space joins what is nearer than the first, as most objects are no wider, ever less what is further apart, and nothing from the
second on."""
CUT = 0.15
"""Patches whose segments are seen to be empty more often than this are of two objects."""
FEWEST_CELLS = 12
"""Fewer are no object but noise."""
MEMBERS = 24
"""So many cells speak for an object."""
MOST_PATCHES = 5000
"""The surface of a hundred objects."""
FAR_M = 1e3
AROUND = 32
"""So many cells around one say which objects it may belong to."""


class NoSurfaces(ValueError):
    """Depth images show points all over the cabinet, as no surfaces would: they are noise, or the cameras' poses are wrong."""


@dataclass(frozen=True, eq=False)
class Witness:
    """What the frames can say about empty space: see `perception.pixels.seen`."""

    near: NDArray[np.float32]
    cameras: Array
    T_camera_cabinet: Array
    axial: float


def cluster_instances(views: PreparedFrames) -> PreparedFrames:
    """The same views with instances found by geometry alone, whatever they had, and names object_0, object_1, … from the front back."""
    cells, index, pixel_cell = _cells(views)
    groups = group(cells, index, witness(views)) if len(cells) else np.zeros(0, np.int32)
    label = np.append(groups, np.int32(-1))[pixel_cell]  # a pixel without a cell has -1, the last
    names = tuple(f"object_{k}" for k in range(int(groups.max(initial=-1)) + 1))
    frames, at = [], 0
    for frame, inside in zip(views.frames, views.inside):
        instance = np.full(inside.shape, -1, np.int32)
        n = int(np.count_nonzero(inside))
        instance[inside] = label[at : at + n]
        at += n
        frames.append(replace(frame, instance=instance, names=names))
    return replace(views, frames=tuple(frames))


def witness(views: PreparedFrames) -> Witness:
    """The frames as witnesses of empty space; smaller images are filled up with nothing."""
    shape = np.max([d.shape for d in views.depths], axis=0)
    near = np.zeros((len(views.frames), *shape), np.float32)
    for i, (frame, depth) in enumerate(zip(views.frames, views.depths)):
        near[i, : depth.shape[0], : depth.shape[1]] = nearest_around(depth, arm_of(frame))
    cameras = np.array([pinhole_of(f) for f in views.frames])
    return Witness(near, cameras, inverse(np.array(views.T_cabinet_camera)), views.axial)


def _cells(views: PreparedFrames) -> tuple[Array, Int, Int]:
    """Mean points (C, 3) of the cells that hold enough pixels, each one's grid index (C, 3), and per pixel inside its cell, -1 for none."""
    points = np.concatenate([np.zeros((0, 3)), *(p[inside] for p, inside in zip(views.points, views.inside))])
    if not len(points):
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64), np.zeros(0, np.int64)
    index = np.floor((points - points.min(0)) / CELL_M).astype(np.int64)
    shape = index.max(0) + 1
    flat = np.ravel_multi_index(tuple(index.T), shape)
    count = np.bincount(flat, minlength=int(np.prod(shape)))
    around = ndimage.uniform_filter(count.reshape(shape).astype(np.float32), 3, mode="constant").reshape(-1) * 27
    kept = np.flatnonzero((count > 0) & (around >= 2.5))
    number = np.full(len(count), -1, np.int64)
    number[kept] = np.arange(len(kept))
    mean = np.stack([np.bincount(flat, points[:, k], minlength=len(count))[kept] / count[kept] for k in range(3)], -1)
    return mean, np.stack(np.unravel_index(kept, shape), -1), number[flat]


def group(cells: Array, index: Int, seen: Witness) -> NDArray[np.int32]:
    """The object (C,) of each cell, numbered from the front of the cabinet to its back, -1 for none.

    cells (C, 3): mean points in the cabinet, metres; index (C, 3): their place in a grid of CELL_M. Raises: NoSurfaces when they fill the
    cabinet.
    """
    patch = _patches(index)
    size = np.bincount(patch)
    centre = np.stack([np.bincount(patch, cells[:, k]) / size for k in range(3)], -1)
    large = np.flatnonzero(size >= 3)
    if not len(large):
        return np.full(len(cells), -1, np.int32)
    if len(large) > MOST_PATCHES:
        raise NoSurfaces(
            "the depth images show no surfaces but points all over the cabinet: they are noise, or the cameras' poses are wrong"
        )
    cluster = np.full(len(size), -1, np.int64)
    cluster[large] = _clusters(centre[large], seen)
    label = _refined(cells, _without_small(cluster[patch]), seen)
    return _numbered(cells, _without_small(_without_enclosed_fragments(cells, label)))


def _clusters(points: Array, seen: Witness) -> Int:
    """Average linkage of points (N, 3) by the share of their segments that are seen to be empty."""
    if len(points) == 1:
        return np.zeros(1, np.int64)
    apart = separations(points, seen.near, seen.cameras, seen.T_camera_cabinet, STEP_M, SLACK_M, seen.axial, USUAL_M, MOST_M)
    return np.asarray(fcluster(linkage(apart, "average"), CUT, "distance") - 1, np.int64)


def _patches(index: Int) -> Int:
    """Which patch (C,) each cell belongs to: cells of one cube of PATCH_M that touch one another there."""
    shape = index.max(0) + 2
    number = np.full(shape, -1, np.int64)
    number[tuple(index.T)] = np.arange(len(index))
    cube = index // round(PATCH_M / CELL_M)
    rows, columns = [], []
    for step in np.ndindex(3, 3, 3):
        if step > (1, 1, 1):
            beside = index + step - 1
            inside = ((beside >= 0) & (beside < shape)).all(1)
            there = np.where(inside, number[tuple(np.where(inside[:, None], beside, 0).T)], -1)
            own = np.flatnonzero(there >= 0)
            same = own[(cube[own] == cube[there[own]]).all(1)]
            rows.append(same)
            columns.append(there[same])
    r, c = np.concatenate(rows), np.concatenate(columns)
    graph = coo_array((np.ones(len(r), bool), (r, c)), shape=(len(index), len(index)))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


def _refined(cells: Array, label: Int, seen: Witness) -> Int:
    """Cells near two objects, or in none, go to the nearby object of whose cells fewest are separated from them.

    Where that decides nothing, on faces that are flush, they go to the one whose footprint they are deepest in or nearest to.
    """
    labelled = np.flatnonzero(label >= 0)
    if not len(labelled):
        return label
    _, which = cKDTree(cells[labelled]).query(cells, k=AROUND, distance_upper_bound=0.015)
    groups = np.append(label[labelled], -1)[which]  # what is too far has the index len(labelled)
    lowest, highest = np.where(groups >= 0, groups, len(label)).min(1), groups.max(1)
    asked = np.flatnonzero((highest >= 0) & ((lowest != highest) | (label < 0)))
    if not len(asked):
        return label
    candidates = groups[asked]
    for k in range(1, AROUND):  # each group once
        candidates[(candidates[:, :k] == candidates[:, k : k + 1]).any(1), k] = -1
    members, first = _members(cells, label)
    shares = separated_shares(
        cells[asked],
        candidates.astype(np.int32),
        members,
        first,
        seen.near,
        seen.cameras,
        seen.T_camera_cabinet,
        STEP_M,
        SLACK_M,
        seen.axial,
    )
    out = label.copy()
    out[asked] = -1
    clear = np.partition(shares, 1, axis=1)[:, 1] > shares.min(1) + 0.1
    out[asked[clear]] = candidates[clear, shares[clear].argmin(1)]
    prints = [footprint(cells[out == k]) for k in range(int(label.max()) + 1)]
    undecided = np.flatnonzero(~clear)
    off = np.stack([outside(p, cells[asked[undecided]]) for p in prints], -1)
    rows, columns = np.nonzero(shares[undecided] <= shares[undecided].min(1, keepdims=True) + 0.1)
    allowed = np.zeros(off.shape, bool)
    allowed[rows, candidates[undecided[rows], columns]] = True
    own = label[asked[undecided]]  # a cell stays where it is when nothing decides
    off[np.flatnonzero(own >= 0), own[own >= 0]] -= 1e-9
    out[asked[undecided]] = np.where(allowed, off, np.inf).argmin(1)
    return out


def _members(cells: Array, label: Int) -> tuple[Array, NDArray[np.int32]]:
    """Up to MEMBERS cells of each group, evenly chosen, and where each group's begin: first (G + 1,)."""
    rows = [np.flatnonzero(label == k) for k in range(int(label.max()) + 1)]
    few = [r[np.unique(np.linspace(0, len(r) - 1, min(len(r), MEMBERS)).astype(int))] if len(r) else r for r in rows]
    return cells[np.concatenate(few)], np.cumsum([0, *map(len, few)]).astype(np.int32)


def footprint(cells: Array) -> Array:
    """The convex outline of points (N, 3) on the floor as half planes (H, 3): a·x + b·y + c <= 0 inside; (0, 3) of too few points."""
    try:
        return np.asarray(ConvexHull(cells[:, :2]).equations)
    except (QhullError, ValueError):
        return np.zeros((0, 3))


def outside(planes: Array, points: Array) -> Array:
    """How far (N,) points (N, 3) lie outside a footprint, negative inside; far outside of one without area."""
    if not len(planes):
        return np.full(len(points), FAR_M)
    return np.asarray((planes[:, :2] @ points[:, :2].T + planes[:, 2:]).max(0))


def _without_enclosed_fragments(cells: Array, label: Int) -> Int:
    """Two things can't stand on one spot: a group most of which lies on the footprints of larger ones is made of parts of them."""
    out = label.copy()
    count = np.bincount(out[out >= 0], minlength=1)
    by_size = [int(k) for k in np.argsort(count, kind="stable") if count[k]]
    prints = {k: footprint(cells[label == k]) for k in by_size}
    for i, small in enumerate(by_size):
        rows, larger = np.flatnonzero(label == small), [k for k in by_size[i + 1 :] if len(prints[k])]
        if larger:
            off = np.stack([outside(prints[k], cells[rows]) for k in larger], -1)
            if np.median(off.min(1)) < 0.002:
                out[rows] = np.array(larger)[off.argmin(1)]
    return out


def _without_small(label: Int) -> Int:
    """Groups of fewer than FEWEST_CELLS cells are none."""
    count = np.bincount(label[label >= 0], minlength=1)
    return np.where((label >= 0) & (count[np.maximum(label, 0)] >= FEWEST_CELLS), label, -1)


def _numbered(cells: Array, label: Int) -> NDArray[np.int32]:
    """The same groups, numbered by how far their nearest cell lies behind the front."""
    ids = np.unique(label[label >= 0])
    order = np.argsort([cells[label == k, 0].min() for k in ids], kind="stable")
    out = np.full(len(label), -1, np.int32)
    for rank, k in enumerate(ids[order] if len(ids) else []):
        out[label == k] = rank
    return out
