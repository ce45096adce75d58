"""Convex parts of a surface: cells that planes cut out of space, and the hull of what of the solid lies in each.

The solid in a cell is within the hull of the cell's pieces of the surface and of those corners of the cell that lie inside, for what else
of it sticks out furthest is on the surface. So the parts contain every triangle by construction, and what is inside. Planes are chosen as
approximate convex decomposition does (Mamou, V-HACD, 2016; Wei et al., CoACD, 2022): they take most off the hulls' volume; where no single
plane takes much, as through a ring, two of them together. Parts whose common hull is hardly larger are joined at the end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import HalfspaceIntersection, QhullError

from kinematics.meshes.cutting import SAME_M, cut, hull_points, hull_volume
from kinematics.meshes.inside import Inside
from kinematics.meshes.parts import joined, thickened, thinned
from kinematics.meshes.surface import Faces, Surface
from kinematics.transforms import Array

OnShare = Callable[[float], None]


@dataclass(frozen=True)
class Decomposition:
    """How a surface is taken apart.

    parts: the most parts. cells: the most cells that they are joined of. excess: hulls that are together larger than the solid by this
    share are fine. offsets: planes tried along a direction, beside those through concave edges. little: a cut that takes less than this
    share of what a cell has too much is looked at together with the next one. skin_m: how thick an open surface is taken to be, at least.
    faces: the search looks at a simplified surface of about so many; the parts are those of the true one.
    """

    parts: int = 32
    cells: int = 56
    excess: float = 0.03
    offsets: int = 7
    little: float = 0.15
    skin_m: float = 0.0005
    slack_m: float = 0.00005
    faces: int = 12_000


_DIAGONALS = np.array([[1, 1, 0], [1, -1, 0], [1, 0, 1], [1, 0, -1], [0, 1, 1], [0, 1, -1]]) / np.sqrt(2)
DIRECTIONS = np.concatenate([np.eye(3), _DIAGONALS])
BALANCE = 0.02
"""What uneven halves cost, as a share of a hull's volume."""


@dataclass
class _Cell:
    """A convex piece of space: what of the surface is in it, (F, 3, 3), simplified; the voxels inside, and in the skin; its planes (H, 4),
    n · x ≤ d; the cuts that led to it, each with whether it is below. corners (N, 3): those of its own that are inside. hull, too_much:
    volumes (m³) of the hull of what is in it, and by how much that is larger than the solid."""

    triangles: Array
    inside: Array
    skin: Array
    planes: Array
    path: tuple[tuple[Array, float, bool], ...] = ()
    corners: Array = field(default_factory=lambda: np.zeros((0, 3)))
    hull: float = 0.0
    too_much: float = 0.0


def decompose(surface: Surface, inside: Inside, how: Decomposition, on_share: OnShare = lambda _: None) -> list[Array]:
    """Corners (V, 3) of convex parts that together contain the surface, and what it encloses. on_share: told how much is done."""
    coarse = simplified(surface, how.faces)
    solid_m3 = solid_volume(surface, inside, how)
    voxel_m3 = solid_m3 / max(len(inside.points) + 0.5 * len(inside.skin), 1.0)
    low, high = surface.vertices.min(0), surface.vertices.max(0)
    box = np.concatenate([np.c_[np.eye(3), high + SAME_M], np.c_[-np.eye(3), SAME_M - low]])
    cells = [_measured(_Cell(coarse.triangles, inside.points, inside.skin, box), inside, voxel_m3)]
    done = list[_Cell]()
    while cells and len(cells) + len(done) < how.cells:
        if sum(c.hull for c in (*cells, *done)) <= (1 + how.excess) * solid_m3:
            break
        cells.sort(key=lambda c: c.too_much)
        worst = cells.pop()
        if worst.too_much < how.excess / how.cells * solid_m3:
            done.append(worst)
            break
        plane = _best_plane(worst, how)
        if plane is None:
            done.append(worst)
            continue
        cells += [_measured(c, inside, voxel_m3) for c in _halves(worst, *plane)]
        on_share(0.8 * (len(cells) + len(done)) / how.cells)
    return [thinned(p, how.slack_m) for p in joined(_exact_parts(surface, [*cells, *done], how), how.parts)]


def simplified(surface: Surface, faces: int) -> Surface:
    """The surface with vertices that are close together as one, so that about `faces` are left; itself where it has no more."""
    if len(surface.faces) <= faces:
        return surface
    low, size = surface.vertices.min(0), surface.extent_m
    cells = int(np.sqrt(faces))
    while True:
        code = np.floor((surface.vertices - low) / size * cells).astype(np.int64)
        _, group, counts = np.unique(code @ [cells * cells * 4, cells * 2, 1], return_inverse=True, return_counts=True)
        moved = group[surface.faces]
        kept = moved[(moved[:, 0] != moved[:, 1]) & (moved[:, 1] != moved[:, 2]) & (moved[:, 2] != moved[:, 0])]
        if len(kept) <= 1.5 * faces or cells <= 8:
            break
        cells = max(8, int(cells / np.sqrt(len(kept) / faces)))
    middle = np.stack([np.bincount(group, surface.vertices[:, k]) / counts for k in range(3)], -1)
    _, first = np.unique(np.sort(kept, axis=1), axis=0, return_index=True)
    return Surface(middle, kept[np.sort(first)])


def solid_volume(surface: Surface, inside: Inside, how: Decomposition) -> float:
    """About the volume of what a surface bounds: what it encloses, or a thin skin where it is open."""
    a, b, c = np.moveaxis(surface.triangles, 1, 0)
    skin = how.skin_m * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()) / 2
    least, most = inside.volumes_m3
    if surface.closed and max(least, skin / 2) <= surface.volume_m3 <= most:
        return surface.volume_m3
    return (least + most) / 2 if least > 0 else skin


def _measured(cell: _Cell, inside: Inside, voxel_m3: float) -> _Cell:
    cell.corners = _corners_inside(cell, inside)
    cell.hull = hull_volume(np.concatenate([cell.triangles.reshape(-1, 3), cell.corners]))
    cell.too_much = cell.hull - (len(cell.inside) + 0.5 * len(cell.skin)) * voxel_m3
    return cell


def _halves(cell: _Cell, normal: Array, offset: float) -> list[_Cell]:
    down, up = cut(cell.triangles, normal, offset)
    halves = []
    for triangles, sign in ((down, 1.0), (up, -1.0)):
        here = [points[sign * (points @ normal - offset) <= 0] for points in (cell.inside, cell.skin)]
        plane = np.append(sign * normal, sign * offset)
        planes, path = np.concatenate([cell.planes, plane[None]]), (*cell.path, (normal, offset, sign > 0))
        halves.append(_Cell(triangles, here[0], here[1], planes, path))
    return halves


# Which plane ------------------------------------------------------------------------------------------------------------------------------


def _best_plane(cell: _Cell, how: Decomposition) -> tuple[Array, float] | None:
    """The plane that takes most off the hulls' volume, alone or with the best one after it; None when there is none to try."""
    tried = _tried(cell.triangles, cell.corners, how.offsets)
    if not tried:
        return None
    cost, normal, offset = min(tried, key=lambda t: t[0])
    if cell.hull - cost >= how.little * cell.too_much:
        return normal, offset
    best, first = dict[int, tuple[float, Array, float]](), list[tuple[float, Array, float]]()
    for t in tried:  # the best plane of each direction
        key = int(np.argmax(DIRECTIONS @ t[1]))
        best[key] = min(best.get(key, t), t, key=lambda t: t[0])
    none = np.zeros((0, 3))
    for _, n, d in sorted(best.values(), key=lambda t: t[0])[:5]:
        after = 0.0
        for half in cut(cell.triangles, n, d):
            whole = hull_volume(half.reshape(-1, 3))
            after += min((t[0] for t in _tried(half, none, max(how.offsets // 2, 1))), default=whole)
        first.append((after, n, d))
    _, normal, offset = min(first, key=lambda t: t[0])
    return normal, offset


def _tried(triangles: Array, corners: Array, offsets: int) -> list[tuple[float, Array, float]]:
    """Planes with the volumes of both hulls together, (m³, n, d), uneven halves costing a little. corners (N, 3): points that lie in one or
    the other hull beside the triangles' own."""
    if len(triangles) == 0:
        return []
    vertices, index = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    faces = index.reshape(-1, 3)
    edges = np.unique(np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1), axis=0)
    vertices = np.concatenate([vertices, corners])
    size = float(np.ptp(vertices, axis=0).max())
    out = list[tuple[float, Array, float]]()
    for normal in DIRECTIONS:
        height = vertices @ normal
        low, high = float(height.min()), float(height.max())
        if high - low < 0.02 * size or high - low < 1e-4:
            continue
        even = low + (high - low) * np.arange(1, offsets + 1) / (offsets + 1)
        at = np.unique(np.concatenate([even, _levels(height[: len(vertices) - len(corners)], faces, offsets)]))
        at = at[(at > low + 1e-5) & (at < high - 1e-5)]
        for d, volumes in zip(at, _volumes(vertices, height, faces, edges, at)):
            out.append((sum(volumes) + BALANCE * abs(volumes[0] - volumes[1]), normal, float(d)))
    return out


def _levels(height: Array, faces: Faces, most: int) -> Array:
    """Heights at which many vertices lie, or large flat faces: where parts that were put together meet."""
    heights = np.unique(np.round(height, 6))
    if len(heights) <= most:
        return np.asarray(heights)
    flat = np.ptp(height[faces], axis=1) < 1e-6
    levels, faces_there = np.unique(np.round(height[faces[flat, 0]], 6), return_counts=True)
    return np.asarray(levels[np.argsort(-faces_there, kind="stable")[:most]])


def _volumes(vertices: Array, height: Array, faces: Faces, edges: Faces, at: Array) -> list[tuple[float, float]]:
    """The volumes of the hulls below and above each height (K,) in rising order."""
    ends = height[edges]
    below, above = np.full(len(vertices), np.inf), np.full(len(vertices), -np.inf)  # how far the faces at a vertex reach
    span = height[faces]
    for k in range(3):
        np.minimum.at(below, faces[:, k], span.min(1))
        np.maximum.at(above, faces[:, k], span.max(1))
    cuts = []
    for d in at:
        low, high = ends.min(1), ends.max(1)
        across = edges[(low < d - SAME_M) & (high > d + SAME_M)]
        a, b = height[across].T
        cuts.append(vertices[across[:, 0]] + ((d - a) / (b - a))[:, None] * (vertices[across[:, 1]] - vertices[across[:, 0]]))
    sides = []
    for sign, reach, order in ((1.0, below, range(len(at))), (-1.0, -above, range(len(at) - 1, -1, -1))):
        hull, last, volumes = np.zeros((0, 3)), -np.inf, dict[int, float]()
        for k in order:
            d = sign * at[k]
            own = sign * height
            hull = hull_points(np.concatenate([hull, vertices[(own > last) & (own <= d - SAME_M)]]))
            last = d - SAME_M
            touching = vertices[(np.abs(own - d) <= SAME_M) & (reach < d - SAME_M)]
            volumes[k] = hull_volume(np.concatenate([hull, touching, cuts[k]]))
        sides.append([volumes[k] for k in range(len(at))])
    return list(zip(*sides))


# From cells to parts ----------------------------------------------------------------------------------------------------------------------


def _exact_parts(surface: Surface, cells: list[_Cell], how: Decomposition) -> list[Array]:
    """The hulls of what is truly in each cell."""
    pieces = dict[int, Array]()
    _sort_into(surface.triangles, cells, list(range(len(cells))), 0, pieces)
    parts = []
    for k, cell in enumerate(cells):
        points = np.concatenate([pieces[k].reshape(-1, 3), cell.corners])
        if len(points):
            parts.append(hull_points(points))
    return thickened(parts, how.skin_m)


def _sort_into(triangles: Array, cells: list[_Cell], some: list[int], depth: int, pieces: dict[int, Array]) -> None:
    """Cut triangles as the cells were cut out of space, one plane after another."""
    if len(some) == 1 and len(cells[some[0]].path) == depth:
        pieces[some[0]] = triangles
        return
    normal, offset, _ = cells[some[0]].path[depth]
    for half, is_down in zip(cut(triangles, normal, offset), (True, False)):
        _sort_into(half, cells, [k for k in some if cells[k].path[depth][2] == is_down], depth + 1, pieces)


def _corners_inside(cell: _Cell, inside: Inside) -> Array:
    """The corners (N, 3) of a cell that lie inside the surface."""
    if len(cell.inside) == 0 or not cell.path:
        return np.zeros((0, 3))
    middle = cell.inside.mean(0)
    try:
        corners = HalfspaceIntersection(np.c_[cell.planes[:, :3], -cell.planes[:, 3]], middle).intersections
    except QhullError:
        return np.zeros((0, 3))
    corners = np.unique(np.round(corners, 12), axis=0)
    return np.asarray(corners[inside.contains(corners)])
