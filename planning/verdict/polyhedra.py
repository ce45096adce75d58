"""Convex solids as polyhedra: corners, edges and planes, and what a window that looks along z sees of them in closed form."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape, box_corners
from kinematics.transforms import Array

Int = NDArray[np.int64]

SIDES, FEW_SIDES = 96, 24
"""Of the prism that stands for a cylinder, as far inside of it as outside: 0.03 % of the radius; and where less will do, 0.4 %."""


@dataclass(frozen=True, eq=False)
class Polyhedron:
    """vertices (V, 3); edges (E, 2): pairs of them, perhaps with diagonals of faces; planes (F, 4): outward normal n and offset d,
    n · x <= d within. volume_m3 and centroid (3,): of the solid."""

    vertices: Array
    edges: Int
    planes: Array
    volume_m3: float
    centroid: Array

    def moved(self, T: Array) -> Polyhedron:
        """The same solid at pose T (4, 4)."""
        R, p = T[:3, :3], T[:3, 3]
        normals = self.planes[:, :3] @ R.T
        planes = np.concatenate([normals, self.planes[:, 3:] + (normals @ p)[:, None]], axis=1)
        return Polyhedron(self.vertices @ R.T + p, self.edges, planes, self.volume_m3, R @ self.centroid + p)


@dataclass(frozen=True, eq=False)
class Window:
    """A convex polygon in the plane z = 0, corners (N, 2) counter-clockwise, through which solids are looked at along z."""

    corners: Array

    @cached_property
    def along(self) -> Array:
        """Its edges (N, 2), each from its corner on."""
        return np.roll(self.corners, -1, axis=0) - self.corners

    @cached_property
    def inward(self) -> Array:
        """Normals (N, 2) of the edges, as long as these."""
        return np.stack([-self.along[:, 1], self.along[:, 0]], -1)

    @cached_property
    def offset(self) -> Array:
        """(N,): inward · p >= offset for points p within."""
        return np.asarray((self.inward * self.corners).sum(1))

    @cached_property
    def share(self) -> Array:
        """(N, 2): share · (p - corner) is how far along an edge a point p lies, from 0 to 1."""
        return np.asarray(self.along / (self.along**2).sum(1, keepdims=True))


def polyhedra(shape: Shape, sides: int = SIDES) -> tuple[Polyhedron, ...]:
    """The convex parts of a shape in its own frame, exact but for cylinders (see `SIDES`)."""
    match shape:
        case Box():
            return (_box(*np.asarray(shape.size_m, float).tolist()),)
        case Cylinder():
            return (_prism(shape.radius_m, shape.height_m, sides),)
        case ConvexMesh():
            return _parts(shape)


_FACES = np.concatenate([np.eye(3), -np.eye(3)])
_CORNERS = box_corners(np.ones(3))
_BOX_EDGES = np.array([(i, j) for i in range(8) for j in range(i) if np.count_nonzero(_CORNERS[i] != _CORNERS[j]) == 1])


@lru_cache(maxsize=256)
def _box(x: float, y: float, z: float) -> Polyhedron:
    half = np.array([x, y, z]) / 2
    planes = np.concatenate([_FACES, np.concatenate([half, half])[:, None]], axis=1)
    return Polyhedron(box_corners(half), _BOX_EDGES, planes, x * y * z, np.zeros(3))


@lru_cache(maxsize=256)
def _prism(radius: float, height: float, sides: int) -> Polyhedron:
    around, edges, outward = _ring(sides)
    inner = radius * np.sqrt(np.cos(np.pi / sides))
    vertices, planes = np.empty((2 * sides, 3)), np.zeros((sides + 2, 4))
    vertices[:sides, :2] = vertices[sides:, :2] = inner / np.cos(np.pi / sides) * around
    vertices[:sides, 2], vertices[sides:, 2] = -height / 2, height / 2
    planes[:sides, :2], planes[:sides, 3] = outward, inner
    planes[sides:, 2], planes[sides:, 3] = (1.0, -1.0), height / 2
    return Polyhedron(vertices, edges, planes, np.pi * radius**2 * height, np.zeros(3))


@lru_cache(maxsize=8)
def _ring(sides: int) -> tuple[Array, Int, Array]:
    """Of an upright prism around a unit circle: its corners (N, 2) seen from above, its edges (3 N, 2), its sides' normals (N, 2)."""
    angle, i = 2 * np.pi * np.arange(sides) / sides, np.arange(sides)
    edges = np.concatenate([np.stack(e, -1) for e in ((i, (i + 1) % sides), (i + sides, (i + 1) % sides + sides), (i, i + sides))])
    middle = angle + np.pi / sides
    return np.stack([np.cos(angle), np.sin(angle)], -1), edges, np.stack([np.cos(middle), np.sin(middle)], -1)


@lru_cache(maxsize=64)
def _parts(shape: ConvexMesh) -> tuple[Polyhedron, ...]:
    return tuple(from_points(part) for part in shape.parts)


def from_points(points: Array) -> Polyhedron:
    """The convex hull of points (N, 3). Raises: ValueError when they have no volume."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        found = ConvexHull(points)
    except QhullError as e:
        raise ValueError("the points span no solid") from e
    corners = np.sort(found.vertices)
    faces = np.searchsorted(corners, found.simplices)
    edges = np.unique(np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])), axis=0)
    planes = np.unique(np.round(np.c_[found.equations[:, :3], -found.equations[:, 3]], 12), axis=0).astype(float)
    vertices = np.asarray(points, float)[corners]
    inner = vertices.mean(0)
    a, b, c = (vertices[faces[:, i]] - inner for i in range(3))
    shares = np.abs(np.einsum("ij,ij->i", a, np.cross(b, c))) / 6
    centroid = inner + (shares[:, None] * (a + b + c) / 4).sum(0) / shares.sum()
    return Polyhedron(vertices, edges.astype(np.int64), planes, float(shares.sum()), centroid)


def centre_of_mass(parts: tuple[Polyhedron, ...]) -> Array:
    """The middle (3,) of the parts by their volumes, as if they did not overlap."""
    weights = np.array([p.volume_m3 for p in parts])
    return np.asarray((weights[:, None] * [p.centroid for p in parts]).sum(0) / weights.sum())


def nearest_in_window(solid: Polyhedron, window: Window) -> tuple[float, Array] | None:
    """How near a solid comes to the plane z = 0 within a window: its least z there, and the outward normal (3,) of the contact at that
    point, z down; None when none of it is over the window.

    The least z of a polyhedron cut by an upright prism is at one of its corners: a corner of the solid within the window, an edge of the
    solid over an edge of the window, or a face over a corner of the window. The normal is the plane's, or across both edges, or the face's.
    """
    side = solid.vertices[:, :2] @ window.inward.T - window.offset  # (V, N), positive within
    inside = (side >= -1e-15).all(1)
    best = (float(solid.vertices[inside, 2].min()), _DOWN) if inside.any() else None
    for found in (_over_edges(solid, window, side, best), _over_corners(solid, window)):
        if found is not None and (best is None or found[0] < best[0]):
            best = found
    return best


def section_below(solid: Polyhedron, z: float) -> Array:
    """Points (N, 2) whose convex hull is the outline, seen along z, of all that a solid has at or below a height z."""
    height = solid.vertices[:, 2]
    a, b = solid.edges.T
    crossing = (height[a] <= z) != (height[b] <= z)
    a, b = a[crossing], b[crossing]
    share = ((z - height[a]) / (height[b] - height[a]))[:, None]
    between = solid.vertices[a, :2] + share * (solid.vertices[b, :2] - solid.vertices[a, :2])
    return np.concatenate([solid.vertices[height <= z, :2], between])


_DOWN = np.array([0.0, 0.0, -1.0])


def _over_edges(solid: Polyhedron, window: Window, side: Array, below: tuple[float, Array] | None) -> tuple[float, Array] | None:
    """The lowest point at which an edge of the solid passes over an edge of the window; edges above what is known are left out."""
    a, b = solid.edges.T
    crosses = (side[a] > 0) != (side[b] > 0)
    if below is not None:
        crosses &= (np.minimum(solid.vertices[a, 2], solid.vertices[b, 2]) < below[0])[:, None]
    e, k = np.nonzero(crosses)
    if not len(e):
        return None
    a, b = a[e], b[e]
    share = (side[a, k] / (side[a, k] - side[b, k]))[:, None]
    point = solid.vertices[a] + share * (solid.vertices[b] - solid.vertices[a])
    place = ((point[:, :2] - window.corners[k]) * window.share[k]).sum(1)
    on = (place >= 0) & (place <= 1)
    if not on.any():
        return None
    i = int(np.argmin(np.where(on, point[:, 2], np.inf)))
    (x, y, z), (u, v) = solid.vertices[b[i]] - solid.vertices[a[i]], window.along[k[i]]
    across = np.array([-z * v, z * u, x * v - y * u])
    length = float(np.linalg.norm(across))
    return float(point[i, 2]), across / length * (-1.0 if across[2] > 0 else 1.0) if length > 1e-15 else _DOWN


def _over_corners(solid: Polyhedron, window: Window) -> tuple[float, Array] | None:
    """The lowest point over a corner of the window: where a line along z enters the solid."""
    normal, d = solid.planes[:, :3], solid.planes[:, 3]
    room = d - window.corners @ normal[:, :2].T  # (N, F): n_z z <= room
    nz = normal[:, 2]
    down, up = nz < -1e-12, nz > 1e-12
    hit = (room[:, ~(down | up)] >= 0).all(1)
    if not hit.any():
        return None
    enters = room[:, down] / nz[down]
    low, high = enters.max(1, initial=-np.inf), (room[:, up] / nz[up]).min(1, initial=np.inf)
    hit &= low <= high
    if not hit.any():
        return None
    corner = int(np.argmin(np.where(hit, low, np.inf)))
    return float(low[corner]), normal[down][int(np.argmax(enters[corner]))]
