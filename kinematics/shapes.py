"""Convex solids: boxes, cylinders and meshes made of convex parts.

A shape has its own frame: boxes and cylinders have the origin at the centre, a cylinder its axis along z; a mesh keeps the frame of its
file. Every solid is convex or a union of convex parts, because only for those can collision be decided exactly and fast.
"""

from __future__ import annotations

import io
import subprocess
import sys
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from kinematics.transforms import Array

LARGEST_M = 100.0
PATIENCE_S = 15.0
"""How long the decomposition of a mesh may take."""
CYLINDER_SIDES = 48
"""Sides of the prism that stands for a cylinder where only a polyhedron will do (meshcat, URDF exchange); it contains the cylinder."""


@dataclass(frozen=True, eq=False)
class Box:
    """A cuboid with edges size_m (3,) along x, y, z, in metres."""

    size_m: Array

    @cached_property
    def half(self) -> Array:
        return np.asarray(self.size_m, float) / 2


@dataclass(frozen=True)
class Cylinder:
    """A cylinder about z, in metres."""

    radius_m: float
    height_m: float

    @property
    def half(self) -> Array:
        return np.array([self.radius_m, self.radius_m, self.height_m / 2])


@dataclass(frozen=True, eq=False)
class ConvexMesh:
    """A union of convex parts, each given by the (V, 3) vertices of its hull, in metres, `scale` already applied.

    file and scale: what the scene file says, so that the shape can be written again.
    """

    parts: tuple[Array, ...]
    file: str = ""
    scale: float = 1.0

    @cached_property
    def half(self) -> Array:
        """Half the extents (3,) of the tightest box along the mesh's own axes."""
        points = np.concatenate(self.parts)
        return np.asarray(np.ptp(points, axis=0) / 2)


Shape = Box | Cylinder | ConvexMesh


def box_corners(half: Array) -> Array:
    """The 8 corners (8, 3) of a cuboid with half edges (3,)."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    return np.asarray(signs * half)


def prism(radius_m: float, height_m: float, sides: int = CYLINDER_SIDES) -> Array:
    """Vertices (2·sides, 3) of the regular prism about z that circumscribes a cylinder."""
    angle = 2 * np.pi * np.arange(sides) / sides
    rim = radius_m / np.cos(np.pi / sides) * np.stack([np.cos(angle), np.sin(angle)], -1)
    return np.concatenate([np.c_[rim, np.full(sides, z)] for z in (-height_m / 2, height_m / 2)])


def convex_parts(shape: Shape) -> tuple[Array, ...]:
    """Vertices (V, 3) of convex polyhedra whose union contains the shape; exact but for cylinders (see `prism`)."""
    match shape:
        case Box():
            return (box_corners(shape.half),)
        case Cylinder():
            return (prism(shape.radius_m, shape.height_m),)
        case ConvexMesh():
            return shape.parts


def bounds(shape: Shape, T: Array) -> tuple[Array, Array]:
    """The tightest axis-aligned box of a shape at pose T (4, 4): lower and upper corner (3,), exact for every shape."""
    R, p = T[:3, :3], T[:3, 3]
    match shape:
        case Box():
            reach = np.abs(R) @ shape.half
        case Cylinder():
            reach = shape.radius_m * np.hypot(R[:, 0], R[:, 1]) + shape.height_m / 2 * np.abs(R[:, 2])
        case ConvexMesh():
            points = np.concatenate(shape.parts) @ R.T + p
            return points.min(0), points.max(0)
    return p - reach, p + reach


def load_mesh(file: Path, scale: float = 1.0, name: str = "") -> ConvexMesh:
    """Read a mesh file as a solid of convex parts.

    A mesh that fills at least 98 % of its convex hull is that hull; any other is decomposed (V-HACD).

    Raises: ValueError when the file is missing, unreadable or without volume.
    """
    import trimesh

    if not file.is_file():
        raise ValueError(f"mesh file {file} does not exist")
    try:
        mesh: Any = trimesh.load(file, force="mesh")
    except Exception as e:  # trimesh raises many kinds, all of them "this file is no mesh"
        raise ValueError(f"mesh file {file} can't be read: {e}") from e
    if len(mesh.vertices) < 4:
        raise ValueError(f"mesh file {file} holds no solid")
    mesh.apply_scale(scale)
    points = np.asarray(mesh.vertices, float)
    if not np.isfinite(points).all() or np.ptp(points, axis=0).max() > LARGEST_M or np.abs(points).max() > LARGEST_M:
        raise ValueError(f"mesh file {file} reaches beyond {LARGEST_M:g} m at scale {scale:g}; is it in millimetres? then scale is 0.001")
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    try:
        hull = mesh.convex_hull
    except Exception as e:
        raise ValueError(f"mesh file {file} is flat: it has no volume") from e
    if hull.volume < 1e-9:
        raise ValueError(f"mesh file {file} is flat: it has no volume")
    parts: tuple[Array, ...] = (np.asarray(hull.vertices, float),)
    if mesh.is_watertight and mesh.volume < 0.98 * hull.volume:
        parts = _decomposed(points=np.asarray(mesh.vertices, float), faces=np.asarray(mesh.faces, np.int64), file=file)
    return ConvexMesh(parts, name or str(file), scale)


_DECOMPOSE = """
import io, sys
import numpy as np
import trimesh
mesh = np.load(io.BytesIO(sys.stdin.buffer.read()))
pieces = trimesh.decomposition.convex_decomposition(trimesh.Trimesh(mesh["points"], mesh["faces"]), maxConvexHulls=16)
parts = [np.asarray(trimesh.Trimesh(p["vertices"], p["faces"]).convex_hull.vertices, float) for p in pieces]
np.savez(sys.stdout.buffer, *parts)
"""


def _decomposed(points: Array, faces: Array, file: Path) -> tuple[Array, ...]:
    """Convex parts (V, 3) of a mesh by V-HACD, in a process of its own: there are meshes on which it never ends, or takes its process down.

    Raises: ValueError then.
    """
    given, found = io.BytesIO(), io.BytesIO()
    np.savez(given, points=points, faces=faces)
    try:
        words = [sys.executable, "-P", "-c", _DECOMPOSE]
        done = subprocess.run(words, input=given.getvalue(), capture_output=True, check=True, timeout=PATIENCE_S)
        found.write(done.stdout)
        found.seek(0)
        with np.load(found) as parts:
            return tuple(np.asarray(parts[name], float) for name in parts.files)
    except (subprocess.SubprocessError, OSError, ValueError) as e:
        raise ValueError(f"mesh file {file} can't be taken apart into convex parts; repair or simplify it, or use its hull") from e
