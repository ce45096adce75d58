"""Convex solids as polyhedra: corners, edges and planes, and what a window that looks along z sees of them in closed form."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from kinematics.jit.decorators import jit_entry, jit_inline
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

    @cached_property
    def low(self) -> Array:
        """The lower corner (3,) of the box around it."""
        return np.asarray(self.vertices.min(0))

    @cached_property
    def high(self) -> Array:
        """The upper corner (3,) of the box around it."""
        return np.asarray(self.vertices.max(0))

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
    normal, side = np.empty(3), np.empty((len(solid.vertices), len(window.corners)))
    least = _least_in_window(*_flat(solid), window.corners, window.along, window.inward, window.offset, window.share, side, normal)
    return (least, normal) if least < np.inf else None


def _flat(solid: Polyhedron) -> tuple[Array, Int, Array]:
    """Corners, edges and planes as compiled code takes them."""
    return np.ascontiguousarray(solid.vertices), np.ascontiguousarray(solid.edges), np.ascontiguousarray(solid.planes)


def section_below(solid: Polyhedron, z: float) -> Array:
    """Points (N, 2) whose convex hull is the outline, seen along z, of all that a solid has at or below a height z."""
    height = solid.vertices[:, 2]
    a, b = solid.edges.T
    crossing = (height[a] <= z) != (height[b] <= z)
    a, b = a[crossing], b[crossing]
    share = ((z - height[a]) / (height[b] - height[a]))[:, None]
    between = solid.vertices[a, :2] + share * (solid.vertices[b, :2] - solid.vertices[a, :2])
    return np.concatenate([solid.vertices[height <= z, :2], between])


@jit_entry
def _least_in_window(
    vertices: Array, edges: Int, planes: Array, corners: Array, along: Array, inward: Array, offset: Array, share: Array,
    side: Array, normal: Array,
) -> float:  # fmt: skip
    """`nearest_in_window`: the least z, infinite where nothing is over the window, and the normal (3,). side (V, N): scratch, how far each
    corner of the solid is within each edge of the window, times that edge's length."""
    least = np.inf
    normal[0], normal[1], normal[2] = 0.0, 0.0, -1.0
    for v in range(vertices.shape[0]):
        inside = True
        for k in range(corners.shape[0]):
            side[v, k] = vertices[v, 0] * inward[k, 0] + vertices[v, 1] * inward[k, 1] - offset[k]
            inside = inside and side[v, k] >= -1e-15
        if inside:
            least = min(least, vertices[v, 2])
    least = _over_edges(vertices, edges, corners, along, share, side, least, normal)
    return float(_over_corners(planes, corners, least, normal))


@jit_inline
def _over_edges(vertices: Array, edges: Int, corners: Array, along: Array, share: Array, side: Array, least: float, normal: Array) -> float:
    """The lowest point at which an edge of the solid passes over an edge of the window, if that is lower, with its normal; or least."""
    known, e, w = least, -1, -1
    for i in range(edges.shape[0]):
        a, b = edges[i, 0], edges[i, 1]
        if min(vertices[a, 2], vertices[b, 2]) >= known:
            continue
        for k in range(corners.shape[0]):
            if (side[a, k] > 0.0) == (side[b, k] > 0.0):
                continue
            part = side[a, k] / (side[a, k] - side[b, k])
            x = vertices[a, 0] + part * (vertices[b, 0] - vertices[a, 0]) - corners[k, 0]
            y = vertices[a, 1] + part * (vertices[b, 1] - vertices[a, 1]) - corners[k, 1]
            z = vertices[a, 2] + part * (vertices[b, 2] - vertices[a, 2])
            if z < least and 0.0 <= x * share[k, 0] + y * share[k, 1] <= 1.0:
                least, e, w = z, i, k
    if e < 0:
        return float(least)
    a, b = edges[e, 0], edges[e, 1]
    x, y, z = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1], vertices[b, 2] - vertices[a, 2]
    u, v = along[w, 0], along[w, 1]
    across = x * v - y * u
    length = np.sqrt(z * z * (u * u + v * v) + across * across)
    if length > 1e-15:
        length = -length if across > 0.0 else length
        normal[0], normal[1], normal[2] = -z * v / length, z * u / length, across / length
    else:
        normal[0], normal[1], normal[2] = 0.0, 0.0, -1.0
    return float(least)


@jit_inline
def _over_corners(planes: Array, corners: Array, least: float, normal: Array) -> float:
    """The lowest point over a corner of the window, where a line along z enters the solid, if that is lower, with its normal; or least."""
    for k in range(corners.shape[0]):
        low, high, face, hit = -np.inf, np.inf, 0, True
        for f in range(planes.shape[0]):
            nz = planes[f, 2]
            room = planes[f, 3] - corners[k, 0] * planes[f, 0] - corners[k, 1] * planes[f, 1]  # nz z <= room
            if nz < -1e-12:
                if room / nz > low:
                    low, face = room / nz, f
            elif nz > 1e-12:
                high = min(high, room / nz)
            else:
                hit = hit and room >= 0.0
        if hit and low <= high and low < least:
            least = low
            normal[0], normal[1], normal[2] = planes[face, 0], planes[face, 1], planes[face, 2]
    return least
