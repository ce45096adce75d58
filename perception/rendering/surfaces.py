"""Posed solids, packed flat for drawing: boxes, cylinders, convex hulls and triangle meshes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.array_checks import checked
from kinematics.collision.geometry import BOX, CYLINDER, HULL
from kinematics.jit.record import record
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape
from kinematics.transforms import Array

Int = NDArray[np.int64]
Ids = NDArray[np.int32]
MESH = 3
"""Any triangles, beside the convex kinds of `kinematics.collision.geometry`."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles: vertices (V, 3) in metres, faces (F, 3) rows of vertices; they need neither be closed nor face one way."""

    vertices: Array
    faces: Int


@record
class Surfaces(NamedTuple):
    """S posed solids: kind (S,) BOX, CYLINDER, HULL or MESH; T (S, 4, 4) in the world; half (S, 3) as in `Solids`; id (S,), what an image
    calls them. Solid s has the faces[first_face[s]:first_face[s + 1]] (·, 3), rows of vertices (V, 3), which are in its own frame and of
    which vertices[first_vertex[s]:first_vertex[s + 1]] are its own. A hull's faces turn counter-clockwise outwards.
    """

    kind: Int
    T: Array
    half: Array
    id: Ids
    first_vertex: Int
    vertices: Array
    first_face: Int
    faces: Int


def surfaces(shapes: Sequence[Shape | Mesh | Array], T: Array) -> Surfaces:
    """Pack shapes at their poses T (B, 4, 4); an array (V, 3) stands for the convex hull of its points. The id is the shape's place."""
    rows: list[tuple[int, int, Array, Array, Int]] = []
    no_points, no_faces = np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    for i, shape in enumerate(shapes):
        match shape:
            case Box():
                rows.append((i, BOX, shape.half, no_points, no_faces))
            case Cylinder():
                rows.append((i, CYLINDER, shape.half, no_points, no_faces))
            case ConvexMesh():
                rows += [(i, HULL, np.zeros(3), *hull_faces(part)) for part in shape.parts]
            case Mesh():
                rows.append((i, MESH, np.zeros(3), np.asarray(shape.vertices, float), np.asarray(shape.faces, np.int64)))
            case _:
                rows.append((i, HULL, np.zeros(3), *hull_faces(shape)))
    return _pack(rows, checked("T", np.asarray(T, float).reshape(-1, 4, 4), len(shapes), 4, 4))


def join(*several: Surfaces) -> Surfaces:
    """All in one. The ids of each follow on those of the one before: b's begin at a's greatest + 1."""
    vertices, faces, solids = 0, 0, 0
    ids, first_vertex, first_face, rows = [], [np.zeros(1, np.int64)], [np.zeros(1, np.int64)], []
    for s in several:
        ids.append(s.id + np.int32(solids))
        rows.append(s.faces + vertices)
        first_vertex.append(s.first_vertex[1:] + vertices)
        first_face.append(s.first_face[1:] + faces)
        vertices, faces, solids = vertices + len(s.vertices), faces + len(s.faces), solids + int(s.id.max(initial=-1)) + 1
    return Surfaces(
        np.concatenate([s.kind for s in several]),
        np.concatenate([s.T for s in several]),
        np.concatenate([s.half for s in several]),
        np.concatenate(ids),
        np.concatenate(first_vertex),
        np.concatenate([s.vertices for s in several]),
        np.concatenate(first_face),
        np.concatenate(rows),
    )


def moved(s: Surfaces, T: Array) -> Surfaces:
    """The same shapes, the one with id i at T[i]; T is (B, 4, 4). Nothing is packed or triangulated again."""
    return s._replace(T=np.ascontiguousarray(T[s.id], float))


def hull_faces(points: Array) -> tuple[Array, Int]:
    """The corners (V, 3) of the convex hull of points and its triangles (F, 3), counter-clockwise seen from outside. Neither is to be
    written to: they are kept, as a robot's hulls are asked for in every picture."""
    return _hull_faces(np.ascontiguousarray(points, float).tobytes())


@lru_cache(maxsize=512)
def _hull_faces(points: bytes) -> tuple[Array, Int]:
    from scipy.spatial import ConvexHull

    hull = ConvexHull(np.frombuffer(points).reshape(-1, 3))
    place = np.full(len(hull.points), -1, np.int64)
    place[hull.vertices] = np.arange(len(hull.vertices))
    corners = hull.points[hull.simplices]
    turn = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    wrong = np.einsum("fi,fi->f", turn, hull.equations[:, :3]) < 0
    faces = place[hull.simplices]
    faces[wrong] = faces[wrong][:, ::-1]
    vertices = np.ascontiguousarray(hull.points[hull.vertices])
    vertices.flags.writeable = faces.flags.writeable = False
    return vertices, faces


def _pack(rows: list[tuple[int, int, Array, Array, Int]], T: Array) -> Surfaces:
    ids = np.array([r[0] for r in rows], np.int32)
    first_vertex = np.concatenate([[0], np.cumsum([len(r[3]) for r in rows])]).astype(np.int64)
    first_face = np.concatenate([[0], np.cumsum([len(r[4]) for r in rows])]).astype(np.int64)
    return Surfaces(
        np.array([r[1] for r in rows], np.int64),
        np.ascontiguousarray(T[ids]),
        np.array([r[2] for r in rows]).reshape(-1, 3),
        ids,
        first_vertex,
        np.concatenate([np.zeros((0, 3)), *(r[3] for r in rows)]),
        first_face,
        np.concatenate([np.zeros((0, 3), np.int64), *(r[4] + v for r, v in zip(rows, first_vertex))]),
    )
