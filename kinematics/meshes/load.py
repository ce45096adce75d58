"""A mesh file as a solid of convex parts, proven to contain it; kept on disk by the file's content, for it takes seconds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import numpy as np

from kinematics import cache
from kinematics.meshes.containment import largest_protrusion
from kinematics.meshes.cutting import hull_volume
from kinematics.meshes.decomposition import Decomposition, decompose
from kinematics.meshes.inside import fill
from kinematics.meshes.surface import Surface, read_surface
from kinematics.shapes import ConvexMesh
from kinematics.transforms import Array

PROTRUSION_M = 1e-4
"""No point of a mesh sticks out of its parts by more."""
USUAL = Decomposition()

OnShare = Callable[[float], None]

_VERSION = "1"


def load_mesh(
    file: Path, scale: float = 1.0, name: str = "", *, how: Decomposition = USUAL, on_share: OnShare = lambda _: None
) -> ConvexMesh:
    """Read a mesh file as a solid of convex parts that contain it.

    It may have holes, split vertices, inner faces, several bodies and a million triangles. What it encloses is solid; a surface that is
    open by more than small holes is a thin shell. name: what stands for the file in a scene. on_share: told how much is done.
    Raises: ValueError when the file is missing, unreadable, without volume, or of a size that is not allowed.
    """
    if not file.is_file():
        raise ValueError(f"mesh file {file} does not exist")
    key = "mesh-" + cache.key(_VERSION, _content(file), file.suffix.lower(), repr(scale), repr(asdict(how)))
    known = cache.load(key)
    if known is not None:
        return ConvexMesh(tuple(np.asarray(known[f"part_{k}"], float) for k in range(len(known))), name or str(file), scale)
    surface = read_surface(file, scale)
    on_share(0.0)
    parts = convex_parts_of(surface, str(file), how, on_share)
    cache.store(key, {f"part_{k}": part for k, part in enumerate(parts)})
    on_share(1.0)
    return ConvexMesh(tuple(parts), name or str(file), scale)


def convex_parts_of(surface: Surface, name: str, how: Decomposition = USUAL, on_share: OnShare = lambda _: None) -> list[Array]:
    """Corners (V, 3) of convex parts that contain a surface to `PROTRUSION_M`. Raises: ValueError, which begins with the mesh's name."""
    if hull_volume(surface.vertices) < 1e-9:
        raise ValueError(f"mesh file {name} is flat: it has no volume")
    parts = decompose(surface, fill(surface), how, on_share)
    out = largest_protrusion(surface, parts)
    if out > PROTRUSION_M:
        raise ValueError(f"mesh file {name} can't be taken apart: {1000 * out:.2g} mm of it stick out of the parts; repair or simplify it")
    return parts


def _content(file: Path) -> bytes:
    """The file's bytes, and those of the buffers that a .gltf file leaves beside it."""
    beside = sorted(file.parent.glob("*.bin")) if file.suffix.lower() == ".gltf" else []
    return b"\0".join(f.read_bytes() for f in (file, *beside))
