"""What belongs to one object although a concave edge, a gap or another object divides it.

A vessel shows its outside, its inside and its bottom; a drill has a handle; a box behind a post shows two parts; a sensor leaves fragments.
Each rule here joins one such kind, and says by which trace it knows it. Clusters are labels (C,) of cells, 0, 1, …, in the cabinet's frame.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from kinematics.transforms import Array
from perception.objects.emptiness import Witness, air_between, convex_hull, outside
from perception.objects.patches import CELL_M, Cells, Int, Patches, unit

CONTACT_M = 2 * CELL_M
"""Cells so near to each other touch."""
SMALL_CELLS, SMALL_M = 60, 0.03
"""A cluster with fewer cells, or less long, that touches another is the fillet of a crease or the like."""
FRAGMENT_CELLS, FRAGMENT_SHARE, FRAGMENT_GAP_M = 150, 0.08, 0.02
"""A cluster with fewer cells, less than this share of another's, and so near to it, is a part of it that stands out, such as a handle."""
STRAY_CELLS, STRAY_GAP_M = 40, 0.025
"""What has fewer cells is no object by itself, but belongs to one that is so near."""
RIM_M, RIM_GAP_M, RIM_LEVEL_M = 0.018, 0.06, 0.015
"""A rim is this deep; the parts of one are no further apart, and end at one height."""
RADII_M, ROUND_M, ROUND_SHARE = (0.02, 0.14), 0.003, 0.035
"""Radii of vessels; the mean distance of a rim's cells from its circle, and what is added of the radius."""
COVERED, COMMON, SECTORS = 0.5, 0.6, 24
"""The parts of a rim fill so much of the circle together, and have no more than the second share of the smaller one in common."""
ENCLOSED, HULL_SLACK_M = 0.7, 0.004
"""A cluster with such a share of its cells in the hull of a larger one is its inside."""
SADDLE_M, SMOOTH_SADDLE_M, GROUND_M, SADDLE_WIDTH = 0.007, 0.012, 0.012, 0.25
"""Two parts of one body stand on the same ground: where they meet is no more than the first below the lower one's top, by the second more
for a smooth edge, at least the third above the feet of both, and as wide as a quarter of the slimmer part."""
BEND_DEG, BESIDE_M = 47.0, 0.025
"""There the surfaces of either side, so far around, are turned towards each other by less; things that touch meet at steeper angles."""
GAP_M, AIR = (0.012, 0.15), 0.2
"""Between the visible parts of one body behind another is a gap of this size, and no more air than the second."""
FACE_CELLS, FACE_DEG, FACE_FLAT_M = 15, 20.0, 0.005
"""A face has so many cells, of patches turned by less and no further off its plane."""
SAME_DEG, SAME_M, SAME_SLOPE, SAME_SHARE = 10.0, 0.006, 0.04, 0.3
"""Two faces lie in one plane when their normals differ by less, and the middle of either lies no further from the other's plane than the
second and this slope of their distance, as the depths of a sensor are warped a little; of one body's parts this share of cells does so."""


def united(label: Int, pairs: Iterable[tuple[int, int]], apart: Iterable[tuple[int, int]] = ()) -> Int:
    """The clusters once those of each pair are one, numbered anew; a pair is left out that would join what is known to be `apart`."""
    joined = np.arange(int(label.max(initial=-1)) + 1)
    known = np.array(list(apart), np.int64).reshape(-1, 2)
    for i, j in pairs:
        tried = np.where(joined == joined[j], joined[i], joined)
        if not (tried[known[:, 0]] == tried[known[:, 1]]).any():
            joined = tried
    return numbered(joined[label])


def numbered(label: Int) -> Int:
    """The same clusters with numbers 0, 1, … without a gap."""
    return np.asarray(np.unique(label, return_inverse=True)[1], np.int64)


def length(points: Array) -> float:
    """The extent of points (N, K) along the direction in which it is greatest."""
    if len(points) < 3:
        return 0.0
    centred = points - points.mean(0)
    return float(np.ptp(centred @ np.linalg.eigh(centred.T @ centred)[1][:, -1]))


def small_absorbed(cells: Cells, label: Int) -> Int:
    """Small clusters join the larger one that they touch most."""
    pairs = cKDTree(cells.points).query_pairs(CONTACT_M, output_type="ndarray")
    while True:
        size = np.bincount(label)
        ends = label[pairs]
        both = np.concatenate([ends, ends[:, ::-1]])
        both = both[size[both[:, 0]] < size[both[:, 1]]]
        found, count = np.unique(both, axis=0, return_counts=True)
        goals: dict[int, tuple[int, int]] = {}
        for (s, t), n in zip(found.tolist(), count.tolist()):
            goals[s] = max(goals.get(s, (0, 0)), (n, t))
        small = [s for s in goals if size[s] < SMALL_CELLS or length(cells.points[label == s]) < SMALL_M]
        taken: set[int] = set()
        for s in sorted(small, key=lambda s: (size[s], s)):  # smallest first; a cluster takes part once a round
            if taken.isdisjoint((s, goals[s][1])):
                taken |= {s, goals[s][1]}
                label = np.where(label == s, goals[s][1], label)
        if not taken:
            return label
        label = numbered(label)


def vessels_closed(cells: Cells, label: Int) -> Int:
    """The outside and the inside of a vessel are one: their upper edges lie on one upright circle, and fill different parts of it."""
    parts = [cells.points[label == k] for k in range(int(label.max(initial=-1)) + 1)]
    tops = [float(np.percentile(p[:, 2], 98)) for p in parts]
    pairs = []
    for i, a in enumerate(parts):
        for j, b in enumerate(parts[:i]):
            if min(len(a), len(b)) < 20 or abs(tops[i] - tops[j]) > RIM_LEVEL_M or gap(a, b) > RIM_GAP_M:
                continue
            top = max(tops[i], tops[j]) - RIM_M
            if _one_rim(a[a[:, 2] > top, :2], b[b[:, 2] > top, :2]):
                pairs.append((i, j))
    return united(label, pairs)


def _one_rim(a: Array, b: Array) -> bool:
    """Whether points (N, 2) and (M, 2) are two parts of one circle."""
    if min(len(a), len(b)) < 5 or (found := fitted_circle(np.concatenate([a, b]))) is None:
        return False
    centre, radius = found
    off = [float(np.mean(np.abs(np.hypot(*(p - centre).T) - radius))) for p in (a, b)]
    sectors = [set((np.arctan2(*(p - centre).T) // (2 * np.pi / SECTORS)).astype(int).tolist()) for p in (a, b)]
    common = len(sectors[0] & sectors[1]) / min(map(len, sectors))
    return (
        RADII_M[0] < radius < RADII_M[1]
        and max(off) < ROUND_M + ROUND_SHARE * radius
        and len(sectors[0] | sectors[1]) > COVERED * SECTORS
        and common < COMMON
    )


def fitted_circle(points: Array) -> tuple[Array, float] | None:
    """Centre (2,) and radius of a circle through points (N, 2), least squares without the outliers (Kåsa 1976); None on a line."""
    kept = np.ones(len(points), bool)
    for _ in range(3):
        if kept.sum() < 8:
            return None
        x = np.column_stack([2 * points[kept], np.ones(int(kept.sum()))])
        c, _, rank, _ = np.linalg.lstsq(x, (points[kept] ** 2).sum(1))
        if rank < 3:
            return None
        radius = float(np.sqrt(max(c[2] + c[0] ** 2 + c[1] ** 2, 1e-12)))
        error = np.abs(np.hypot(*(points - c[:2]).T) - radius)
        kept = error < max(0.004, 2.5 * float(np.median(error)))
    return c[:2], radius


def enclosed_absorbed(cells: Cells, label: Int) -> Int:
    """What lies within the hull of a larger cluster is its inside, such as the bottom of a cup."""
    parts = [cells.points[label == k] for k in range(int(label.max(initial=-1)) + 1)]
    hulls = [convex_hull(p) for p in parts]
    pairs = []
    for s, small in enumerate(parts):
        shares = [(float(np.mean(outside(hulls[t], small) < HULL_SLACK_M)), t) for t, p in enumerate(parts) if len(p) > len(small)]
        share, t = max(shares, default=(0.0, -1))
        if share > ENCLOSED:
            pairs.append((s, t))
    return united(label, pairs)


def parts_joined(cells: Cells, patches: Patches, label: Int, parted: Iterable[tuple[int, int]]) -> Int:
    """Parts of one body that is not convex, such as a drill's, are one: see SADDLE_M and BEND_DEG. parted: pairs that are two bodies."""
    clusters = [cells.points[label == k] for k in range(int(label.max(initial=-1)) + 1)]
    top, low = (np.array([np.percentile(p[:, 2], share) for p in clusters]) for share in (97, 3))
    near = cKDTree(cells.points).query_pairs(CONTACT_M, output_type="ndarray")
    near = near[label[near[:, 0]] != label[near[:, 1]]]
    near_ends = np.sort(label[near], axis=1)
    owner = owners(patches, label)
    ends = np.sort(owner[patches.edges], axis=1)
    beside = cKDTree(patches.centres)
    known, pairs = [(min(p), max(p)) for p in parted], []
    for a, b in np.unique(ends[ends[:, 0] != ends[:, 1]], axis=0).tolist():
        rows = near[(near_ends == (a, b)).all(1)]
        if len(rows) < 4 or (a, b) in known:
            continue
        border = cells.points[np.unique(rows)]
        saddle = float(np.percentile(border[:, 2], 90))
        if saddle < max(low[a], low[b]) + GROUND_M:
            continue
        slimmer = min(length(clusters[a][:, :2]), length(clusters[b][:, :2]))
        width = length(border[border[:, 2] > saddle - GROUND_M, :2])
        bend = _bend(patches, owner, beside, patches.edges[(ends == (a, b)).all(1)], a, b)
        smooth = 1 - max(-bend, 0.0) / BEND_DEG
        if smooth > 0 and saddle > min(top[a], top[b]) - SADDLE_M - SMOOTH_SADDLE_M * smooth and width > SADDLE_WIDTH * slimmer:
            pairs.append((a, b))
    return united(label, pairs, known)


def _bend(patches: Patches, owner: Int, beside: cKDTree, edges: Int, a: int, b: int) -> float:
    """By how many degrees the surfaces of clusters a and b beside their border turn, positive when convex: the mean over `edges`."""
    out = []
    for middle in patches.centres[edges].mean(1):
        around = np.array(beside.query_ball_point(middle, BESIDE_M))
        sides = [around[owner[around] == k] for k in (a, b)]
        if all(map(len, sides)):
            weight = [patches.size[side, None] for side in sides]
            normal = [unit((patches.normals[side] * w).sum(0)[None])[0] for side, w in zip(sides, weight)]
            centre = [(patches.centres[side] * w).sum(0) / w.sum() for side, w in zip(sides, weight)]
            turn = float(np.degrees(np.arccos(np.clip(normal[0] @ normal[1], -1, 1))))
            out.append(turn if (normal[0] - normal[1]) @ (centre[0] - centre[1]) >= 0 else -turn)
    return float(np.mean(out)) if out else -180.0


def owners(patches: Patches, label: Int) -> Int:
    """The cluster (K,) of each patch, that of its first cell."""
    first = np.zeros(len(patches.size), np.int64)
    first[patches.of_cell[::-1]] = np.arange(len(label))[::-1]
    return label[first]


def occluded_joined(cells: Cells, patches: Patches, label: Int, seen: Witness) -> Int:
    """The visible parts of one body behind another are one: no air is seen between them, and their faces lie in the same planes."""
    clusters = [cells.points[label == k] for k in range(int(label.max(initial=-1)) + 1)]
    owner = owners(patches, label)
    pairs = []
    for i, a in enumerate(clusters):
        for j, b in enumerate(clusters[:i]):
            if not GAP_M[0] < gap(a, b) < GAP_M[1] or air_between(a, b, seen) > AIR:
                continue
            if _shared(patches, np.flatnonzero(owner == i), np.flatnonzero(owner == j)) > SAME_SHARE:
                pairs.append((i, j))
    return united(label, pairs)


def _faces(patches: Patches, rows: Int) -> tuple[Array, Array, list[Int]]:
    """The plane faces of a cluster with patches `rows`: middles (F, 3), normals (F, 3), and the patches of each, the largest face first."""
    middles, normals, members = [np.zeros((0, 3))], [np.zeros((0, 3))], []
    rows = rows[patches.normals[rows].any(1)]
    while patches.size[rows].sum() >= FACE_CELLS:
        centres, size = patches.centres[rows], patches.size[rows]
        fits = _in_plane(patches, rows, centres, patches.normals[rows])
        mine = fits[np.argmax(fits @ size)]
        for _ in range(2):
            middle = np.average(centres[mine], axis=0, weights=size[mine])
            normal = unit((patches.normals[rows[mine]] * size[mine, None]).sum(0)[None])
            again = _in_plane(patches, rows, middle[None], normal)[0]
            mine = again if again.any() else mine
        if size[mine].sum() < FACE_CELLS:
            break
        middles.append(middle[None])
        normals.append(normal)
        members.append(rows[mine])
        rows = rows[~mine]
    return np.concatenate(middles), np.concatenate(normals), members


def _in_plane(patches: Patches, rows: Int, middles: Array, normals: Array) -> NDArray[np.bool_]:
    """Which patches of `rows` (R,) lie in each plane (M, 3), (M, 3), as (M, R)."""
    height = np.abs(np.einsum("mrk,mk->mr", patches.centres[rows] - middles[:, None], normals))
    return np.asarray((height < FACE_FLAT_M) & (normals @ patches.normals[rows].T > np.cos(np.radians(FACE_DEG))))


def _shared(patches: Patches, a: Int, b: Int) -> float:
    """The lesser of the shares of two clusters, with patches a and b, that lie in a plane which has a face of the other, too."""
    middle_a, normal_a, faces_a = _faces(patches, a)
    middle_b, normal_b, faces_b = _faces(patches, b)
    between = middle_a[:, None] - middle_b
    off = np.maximum(np.abs((between * normal_a[:, None]).sum(2)), np.abs((between * normal_b).sum(2)))
    same = (normal_a @ normal_b.T > np.cos(np.radians(SAME_DEG))) & (off < SAME_M + SAME_SLOPE * np.linalg.norm(between, axis=2))
    shares = [
        sum(int(patches.size[faces[f]].sum()) for f in np.flatnonzero(hit)) / max(int(patches.size[rows].sum()), 1)
        for rows, faces, hit in ((a, faces_a, same.any(1)), (b, faces_b, same.any(0)))
    ]
    return min(shares)


def fragments_absorbed(cells: Cells, label: Int) -> Int:
    """What is small and near to a much larger cluster is a part of it; what is very small and near to any, of that."""
    for most, share, reach in ((FRAGMENT_CELLS, FRAGMENT_SHARE, FRAGMENT_GAP_M), (STRAY_CELLS, 1.0, STRAY_GAP_M)):
        for s in np.argsort(np.bincount(label), kind="stable"):
            size = np.bincount(label)
            larger = np.flatnonzero((size[label] * share > size[s]) & (size[label] >= min(most, STRAY_CELLS)) & (label != s))
            if 0 < size[s] < most and len(larger):
                distance, k = cKDTree(cells.points[larger]).query(cells.points[label == s])
                if distance.min() < reach:
                    label = np.where(label == s, label[larger[k[distance.argmin()]]], label)
    return numbered(label)


def gap(a: Array, b: Array) -> float:
    """The least distance between points (N, 3) and points (M, 3)."""
    return float(cKDTree(a).query(b)[0].min())
