"""How an object that is a mesh looks: its file's own triangles; or, when that is asked for, the convex parts that stand for it."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from kinematics.shapes import ConvexMesh, Shape

if TYPE_CHECKING:
    from perception.rendering.surfaces import Mesh

MOST_FACES = 40_000
"""A finer mesh is drawn simplified."""


def look_of(shape: Shape, parts: bool = False) -> Shape | Mesh:
    """What to draw of a shape. parts: of a mesh its convex parts; they are drawn, too, where its file can't be read."""
    if parts or not isinstance(shape, ConvexMesh) or not shape.file:
        return shape
    return _surface(shape.file, shape.scale) or shape


@lru_cache(maxsize=64)
def _surface(file: str, scale: float) -> Mesh | None:
    from kinematics.meshes.decomposition import simplified
    from kinematics.meshes.surface import read_surface
    from perception.rendering.surfaces import Mesh

    try:
        surface = simplified(read_surface(Path(file), scale), MOST_FACES)
    except ValueError:
        return None
    return Mesh(surface.vertices, surface.faces)
