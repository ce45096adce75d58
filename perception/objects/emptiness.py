"""The frames as witnesses of empty space: a segment between two points of one convex body is nowhere seen to be empty.

A gap, a step in height or a concave crease between two bodies is air that some camera looks through, whereas both halves of a body that
stands behind another have only hidden space between them. Bodies that touch without a crease all around, such as two cans of one height or
a carton flush with a lower one, hang together over convex edges; but each of them is convex by itself, and there is air between the two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial import ConvexHull, QhullError, cKDTree
from scipy.spatial.distance import squareform

from kinematics.transforms import Array, inverse
from perception.objects.patches import Cells, Int, Patches
from perception.objects.prepared_frames import PreparedFrames, arm_of, pinhole_of
from perception.pixels import empty_share, nearest_around, separated_shares, separations

STEP_M = 0.004
"""Along a segment, a point is looked at every so far."""
SLACK_M = 0.004
"""What is measured must be further away than this for a point in front of it to be empty."""
USUAL_M, MOST_M = 0.12, 20.0
"""Of segments without air, the shorter ones on the floor join first, up to the first; the second is further than any segment is long."""
MOST_PATCHES = 200
"""So many patches of a surface are enough to tell whether it is of two bodies."""
BETWEEN, WITHIN = 0.25, 0.03
"""Two halves are two bodies when more segments than the first share between them are empty, and fewer than the second in either."""
FEWEST_PATCHES = 20
"""What has fewer patches is no body by itself, rather a part of one."""
MEMBERS = 24
"""So many cells speak for an object."""
AROUND, AROUND_M = 32, 0.015
"""So many cells around one, and no further, say which objects it may belong to."""
FAR_M = 1e3


@dataclass(frozen=True, eq=False)
class Witness:
    """What the frames can say about empty space: see `perception.pixels.seen`."""

    near: NDArray[np.float32]
    cameras: Array
    T_camera_cabinet: Array
    axial: float


def witness(views: PreparedFrames) -> Witness:
    """The frames as witnesses; smaller images are filled up with nothing."""
    shape = np.max([d.shape for d in views.depths], axis=0)
    near = np.zeros((len(views.frames), *shape), np.float32)
    for i, (frame, depth) in enumerate(zip(views.frames, views.depths)):
        near[i, : depth.shape[0], : depth.shape[1]] = nearest_around(depth, arm_of(frame))
    cameras = np.array([pinhole_of(f) for f in views.frames])
    return Witness(near, cameras, inverse(np.array(views.T_cabinet_camera)), views.axial)


def air_between(a: Array, b: Array, seen: Witness) -> float:
    """The share of the segments between points (N, 3) and points (M, 3), MEMBERS of each at most, that are seen to be empty somewhere."""
    return float(empty_share(_few(a), _few(b), seen.near, seen.cameras, seen.T_camera_cabinet, STEP_M, SLACK_M, seen.axial))


def _few(points: Array) -> Array:
    """MEMBERS of the points (N, 3), evenly chosen."""
    return np.ascontiguousarray(points[np.unique(np.linspace(0, len(points) - 1, min(len(points), MEMBERS)).astype(int))])


def divided(cells: Cells, patches: Patches, surface: Int, seen: Witness) -> tuple[Int, list[tuple[int, int]]]:
    """The surface (C,) of each cell once those of two convex bodies are divided, again and again; and which are parts of what was one.

    surface (K,): of each patch.
    """
    surface = surface.copy()
    count = int(surface.max(initial=-1)) + 1
    todo, parted = list(range(count)), []
    while todo:
        k = todo.pop()
        second = _second_body(patches, np.flatnonzero(surface == k), seen)
        if len(second):
            surface[second] = count
            parted.append((k, count))
            todo += [k, count]
            count += 1
    label = surface[patches.of_cell]
    for pair in parted:
        rows = np.flatnonzero(np.isin(label, pair))
        label[rows] = np.array(pair)[_border(cells.points[rows], (label[rows] == pair[1]).astype(np.int64), seen)]
    return label, parted


def _second_body(patches: Patches, rows: Int, seen: Witness) -> Int:
    """Which of a surface's patches, `rows`, are of a second convex body; none when it is of one body, or of none that is convex."""
    few = rows[patches.size[rows] >= 3]
    few = few[np.unique(np.linspace(0, len(few) - 1, min(len(few), MOST_PATCHES)).astype(int))] if len(few) else few
    if len(few) < 2 * FEWEST_PATCHES:
        return rows[:0]
    points = np.ascontiguousarray(patches.centres[few])
    apart = separations(points, seen.near, seen.cameras, seen.T_camera_cabinet, STEP_M, SLACK_M, seen.axial, USUAL_M, MOST_M)
    empty = squareform(apart >= 1)
    half = fcluster(linkage(apart, "average"), 2, "maxclust")
    if half.max() < 2 or min(np.bincount(half)[1:]) * len(rows) < FEWEST_PATCHES * len(few):
        return rows[:0]
    between, first, second = (empty[np.ix_(half == a, half == b)].mean() for a, b in ((1, 2), (1, 1), (2, 2)))
    if between < BETWEEN or max(first, second) > WITHIN:
        return rows[:0]
    nearest = cKDTree(points).query(patches.centres[rows])[1]
    return np.asarray(rows[half[nearest] == 2], np.int64)


def _border(points: Array, label: Int, seen: Witness) -> Int:
    """Labels 0 and 1 (C,) of cells (C, 3), those near the border given to the body of whose cells fewest have air between them and it.

    Where that decides nothing, on faces that are flush, they go to the one whose footprint they are deepest in or nearest to.
    """
    if not 0 < label.sum() < len(label):
        return label
    beside = cKDTree(points).query(points, k=min(AROUND, len(points)), distance_upper_bound=AROUND_M)[1]
    around = np.append(label, -1)[beside]
    asked = np.flatnonzero((around == 0).any(1) & (around == 1).any(1))
    if not len(asked):
        return label
    members = [_few(points[label == k]) for k in (0, 1)]
    first = np.array([0, len(members[0]), len(members[0]) + len(members[1])], np.int32)
    candidates = np.tile(np.array([0, 1], np.int32), (len(asked), 1))
    shares = separated_shares(
        np.ascontiguousarray(points[asked]), candidates, np.concatenate(members), first, seen.near, seen.cameras, seen.T_camera_cabinet,
        STEP_M, SLACK_M, seen.axial,
    )  # fmt: skip
    off = np.stack([outside(footprint(points[label == k]), points[asked]) for k in (0, 1)], -1)
    off[np.arange(len(asked)), label[asked]] -= 1e-9  # a cell stays where it is when nothing decides
    clear = np.abs(shares[:, 0] - shares[:, 1]) > 0.1
    out = label.copy()
    out[asked] = np.where(clear, shares.argmin(1), off.argmin(1))
    return out


def footprint(points: Array) -> Array:
    """The convex outline of points (N, 3) on the floor as half planes (H, 3): a·x + b·y + c <= 0 inside; (0, 3) of too few points."""
    return _half_spaces(points[:, :2])


def convex_hull(points: Array) -> Array:
    """The convex hull of points (N, 3) as half spaces (H, 4): a·x + b·y + c·z + d <= 0 inside; (0, 4) of too few points."""
    return _half_spaces(points)


def _half_spaces(points: Array) -> Array:
    try:
        return np.asarray(ConvexHull(points).equations)
    except (QhullError, ValueError):
        return np.zeros((0, points.shape[1] + 1))


def outside(planes: Array, points: Array) -> Array:
    """How far (N,) points (N, 3) lie outside a footprint or a hull, negative inside; far outside of one without extent."""
    if not len(planes):
        return np.full(len(points), FAR_M)
    k = planes.shape[1] - 1
    return np.asarray((points[:, :k] @ planes[:, :k].T + planes[:, k]).max(1))
