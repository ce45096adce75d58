"""A mesh file as a clean surface: vertices merged, degenerate and double faces dropped, small holes filled.

Nothing here asks for a watertight or well oriented mesh: what is inside a surface is found by filling from outside (`inside.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinematics.git_lfs import refuse_pointer
from kinematics.transforms import Array

LARGEST_M, SMALLEST_M = 3.0, 0.001
"""What is larger or smaller than this is no object in a cabinet: its scale is wrong."""
HOLE_SHARE = 0.25
"""A hole is small, and filled, when it is no wider than this share of the mesh's longest side."""

Faces = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles faces (F, 3) over vertices (V, 3), metres. filled: how many holes were closed to make it."""

    vertices: Array
    faces: Faces
    filled: int = 0

    @property
    def triangles(self) -> Array:
        """Their corners (F, 3, 3)."""
        return np.asarray(self.vertices[self.faces])

    @cached_property
    def extent_m(self) -> float:
        """Its longest side along the axes."""
        return float(np.ptp(self.vertices, axis=0).max())

    @cached_property
    def closed(self) -> bool:
        """Whether every edge belongs to two faces (or four, …): nothing leads from one side to the other."""
        return bool((_edge_counts(self.faces)[1] % 2 == 0).all())

    @cached_property
    def volume_m3(self) -> float:
        """The volume within, by the divergence theorem: right where the surface is closed, and its faces are turned alike."""
        a, b, c = np.moveaxis(self.triangles - self.vertices.mean(0), 1, 0)
        return abs(float(np.einsum("ij,ij->", a, np.cross(b, c)))) / 6


def read_surface(file: Path, scale: float = 1.0) -> Surface:
    """Read a mesh file in any format that trimesh knows, its bodies together.

    Raises: ValueError when it is missing, unreadable, empty, or of a size that is not allowed.
    """
    mesh = _read(file)
    vertices, faces = np.asarray(mesh.vertices, float) * scale, np.asarray(mesh.faces, np.int64)
    if len(faces) == 0:
        raise ValueError(f"mesh file {file} holds no triangles: it is empty, cut off, or of points and lines alone; export it anew")
    if len(vertices) < 4:
        raise ValueError(f"mesh file {file} holds no solid, but {len(vertices)} corners in a plane")
    _check_size(file, float(np.ptp(vertices, axis=0).max()), scale)
    return clean_surface(vertices, faces)


def _read(file: Path) -> Any:
    import trimesh

    if not file.is_file():
        raise ValueError(f"mesh file {file} does not exist")
    refuse_pointer(file, "mesh")
    try:
        mesh = trimesh.load(file, force="mesh", process=False)
    except Exception as e:  # trimesh raises many kinds, all of them "this file is no mesh"
        raise ValueError(f"mesh file {file} can't be read: {e}") from e
    if not isinstance(mesh, trimesh.Trimesh):
        raise ValueError(f"mesh file {file} holds no triangles")
    if not np.isfinite(mesh.vertices).all():
        raise ValueError(f"mesh file {file} has vertices that are no numbers")
    if len(mesh.faces) and not 0 <= mesh.faces.min() <= mesh.faces.max() < len(mesh.vertices):
        raise ValueError(f"mesh file {file} has faces with corners that it does not list: {len(mesh.vertices)} vertices are in it")
    try:
        mesh.merge_vertices(merge_tex=True, merge_norm=True)
    except (ValueError, ArithmeticError) as e:  # rows of unlike lengths, or numbers that trimesh can't compare
        raise ValueError(f"mesh file {file} has invalid vertices: {e}") from e
    return mesh


def _check_size(file: Path, extent_m: float, scale: float) -> None:
    if SMALLEST_M <= extent_m <= LARGEST_M:
        return
    factor = min((0.001, 0.0254, 0.01, 10.0, 100.0, 1000.0), key=lambda f: abs(np.log(extent_m * f / 0.15)) if extent_m else f)
    raise ValueError(
        f"mesh file {file} is {extent_m:.4g} m large at scale {scale:g}, and {SMALLEST_M:g} to {LARGEST_M:g} m are allowed; is it "
        f"{'in millimetres' if factor == 0.001 else 'in other units'}? then its scale is {scale * factor:g}"
    )


def clean_surface(vertices: Array, faces: Faces) -> Surface:
    """A surface of the faces (F, 3) that span a triangle, each once, its small holes filled."""
    corners = vertices[faces]
    doubled = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    faces = faces[doubled > 1e-16]
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    faces = faces[np.sort(first)]
    if len(faces) == 0:
        raise ValueError("the mesh has no face that spans a triangle")
    used, inverse = np.unique(faces, return_inverse=True)
    return _without_small_holes(Surface(vertices[used], inverse.reshape(-1, 3)))


def _edge_counts(faces: Faces) -> tuple[Faces, NDArray[np.int64]]:
    """Every edge (E, 2) once, and how many faces have it (E,)."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    most = int(faces.max()) + 1
    codes, counts = np.unique(edges[:, 0] * most + edges[:, 1], return_counts=True)
    return np.stack([codes // most, codes % most], -1), counts


def _without_small_holes(surface: Surface) -> Surface:
    """The surface with a fan over every simple loop of open edges that is small."""
    edges, counts = _edge_counts(surface.faces)
    vertices, fans, filled = [surface.vertices], [surface.faces], 0
    for loop in _loops(edges[counts == 1]):
        rim = surface.vertices[loop]
        if np.ptp(rim, axis=0).max() <= HOLE_SHARE * surface.extent_m:
            middle = len(surface.vertices) + filled
            fans.append(np.stack([loop, np.roll(loop, -1), np.full(len(loop), middle)], -1))
            vertices.append(rim.mean(0)[None])
            filled += 1
    return Surface(np.concatenate(vertices), np.concatenate(fans), filled) if filled else surface


def _loops(edges: Faces) -> list[NDArray[np.int64]]:
    """The vertices of every closed loop of edges (E, 2), in order; loops that touch others are left out."""
    neighbours: dict[int, list[int]] = {}
    for a, b in edges.tolist():
        neighbours.setdefault(a, []).append(b)
        neighbours.setdefault(b, []).append(a)
    loops, seen = [], set[int]()
    for start in neighbours:
        if start in seen:
            continue
        loop, last, at = list[int](), -1, start
        while at not in seen and len(neighbours[at]) == 2:
            seen.add(at)
            loop.append(at)
            onward = neighbours[at][0] if neighbours[at][0] != last else neighbours[at][1]
            last, at = at, onward
        seen.add(at)
        if at == start and len(loop) >= 3:
            loops.append(np.array(loop, np.int64))
    return loops
