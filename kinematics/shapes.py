"""Convex solids: boxes, cylinders and meshes made of convex parts.

A shape has its own frame: boxes and cylinders have the origin at the centre, a cylinder its axis along z; a mesh keeps the frame of its
file. Every solid is convex or a union of convex parts, because only for those can collision be decided exactly and fast.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from kinematics.transforms import Array

CYLINDER_SIDES = 48
"""Sides of the prism that stands for a cylinder where only a polyhedron will do (meshcat, URDF exchange); it contains the cylinder."""


@dataclass(frozen=True, eq=False)
class Box:
    """A cuboid with edges size_m (3,) along x, y, z, in metres."""

    size_m: Array

    @cached_property
    def half(self) -> Array:
        """Half sizes (3,), m."""
        return np.asarray(self.size_m, float) / 2


@dataclass(frozen=True)
class Cylinder:
    """A cylinder about z, in metres."""

    radius_m: float
    height_m: float

    @property
    def half(self) -> Array:
        """Half sizes (3,) of the box around it, m."""
        return np.array([self.radius_m, self.radius_m, self.height_m / 2])


@dataclass(frozen=True, eq=False)
class ConvexMesh:
    """A union of convex parts, each given by the (V, 3) vertices of its hull, in metres, `scale` already applied (see `kinematics.meshes`).

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
UPRIGHT = np.cos(np.radians(1))
"""What leans by a degree counts as upright."""


def is_upright(T: Array) -> bool:
    """Whether the z of a pose (4, 4) is the vertical, up or down."""
    return bool(abs(T[2, 2]) > UPRIGHT)


def is_level(T: Array) -> bool:
    """Whether the z of a pose (4, 4) is level, as a lying cylinder's axis."""
    return bool(abs(T[2, 2]) < np.sqrt(1 - UPRIGHT**2))


_SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)


def box_corners(half: Array) -> Array:
    """The 8 corners (8, 3) of a cuboid with half edges (3,)."""
    return np.asarray(_SIGNS * half)


def prism(radius_m: float, height_m: float, sides: int = CYLINDER_SIDES) -> Array:
    """Vertices (2·sides, 3) of the regular prism about z that circumscribes a cylinder."""
    out = np.empty((2, sides, 3))
    out[..., :2] = radius_m / np.cos(np.pi / sides) * _ring(sides)
    out[..., 2] = [[-height_m / 2], [height_m / 2]]
    return out.reshape(-1, 3)


@lru_cache(maxsize=8)
def _ring(sides: int) -> Array:
    """The corners (sides, 2) of a regular polygon in the unit circle."""
    angle = 2 * np.pi * np.arange(sides) / sides
    return np.stack([np.cos(angle), np.sin(angle)], -1)


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
