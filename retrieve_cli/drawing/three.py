"""Commands of meshcat's viewer: solids, meshes, lines and properties of its tree of objects (three.js underneath)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinematics.shapes import Box, Cylinder, Shape, box_corners, convex_parts
from kinematics.transforms import Array
from perception.rendering.colours import Colour
from perception.rendering.smooth_normals import corner_normals
from perception.rendering.surfaces import Mesh, hull_faces, surfaces

Command = dict[str, Any]
Int = NDArray[np.int64]


def solid(path: str, shape: Shape | Mesh, colour: Colour, opacity: float = 1.0, *, through: bool = False) -> list[Command]:
    """Commands that show a shape in its own frame; a mesh of several parts takes one each."""
    match shape:
        case Box():
            return [mesh(path, *flat(*hull_faces(box_corners(shape.half))), colour, opacity, through=through)]
        case Cylinder():
            return [mesh(path, *_cylinder_mesh(shape.radius_m, shape.height_m), colour, opacity, through=through)]
        case Mesh():
            return [mesh(path, *creased(shape.vertices, shape.faces), colour, opacity, through=through)]
        case _:
            parts = [creased(*hull_faces(part)) for part in convex_parts(shape)]
            return [mesh(f"{path}/part {k}", *part, colour, opacity, through=through) for k, part in enumerate(parts)]


def mesh(
    path: str,
    vertices: Array,
    normals: Array,
    faces: Int,
    colour: Colour,
    opacity: float = 1.0,
    *,
    shine: float = 12,
    basic: bool = False,
    through: bool = False,
) -> Command:
    """Triangles: vertices (V, 3) are packed as 16-bit shares of the largest coordinate, normals (V, 3) as bytes.

    basic: one even colour without light; through: drawn over everything in front of it.
    """
    size = float(np.abs(vertices).max())
    small = len(vertices) < 2**16
    material: Command = {"type": "MeshBasicMaterial" if basic or through else "MeshPhongMaterial", "color": hex_colour(colour), "side": 2}
    material |= {} if basic or through else {"shininess": shine, "specular": 0x1A1A1A}
    material |= {"transparent": True, "opacity": opacity, "depthWrite": False} if opacity < 1 else {}
    material |= {"depthTest": False} if through else {}
    geometry = {
        "attributes": {
            "position": packed(np.round(vertices / size * 32767).astype("<i2"), "Int16Array", 3),
            "normal": packed(np.round(normals * 127).astype("i1"), "Int8Array", 3),
        },
        "index": packed(faces.astype("<u2" if small else "<u4"), "Uint16Array" if small else "Uint32Array", 1),
    }
    return three_object(path, "Mesh", geometry, material, [*np.diag([size, size, size, 1.0]).ravel()])


def lines(path: str, polylines: list[Array], colour: Colour, opacity: float = 1.0, *, through: bool = False) -> Command:
    """Lines of one pixel through points (N, 3)."""
    pairs = np.concatenate([np.zeros((0, 3)), *(np.stack([p[:-1], p[1:]], 1).reshape(-1, 3) for p in polylines)]).astype("<f4")
    material: Command = {"type": "LineBasicMaterial", "color": hex_colour(colour)}
    material |= {"transparent": True, "opacity": opacity} if opacity < 1 else {}
    material |= {"depthTest": False} if through else {}
    return three_object(
        path, "LineSegments", {"attributes": {"position": packed(pairs, "Float32Array", 3)}}, material, [*np.eye(4).ravel()]
    )


def three_object(path: str, kind: str, geometry: Command, material: Command, matrix: list[float]) -> Command:
    """An object of three.js with one geometry and one material; matrix (16,): its pose, column by column."""
    ids = {"geometry": f"g {path}", "material": f"m {path}"}
    return {
        "type": "set_object",
        "path": path,
        "object": {
            "metadata": {"version": 4.5, "type": "Object"},
            "geometries": [{"uuid": ids["geometry"], "type": "BufferGeometry", "data": geometry}],
            "materials": [{"uuid": ids["material"], **material}],
            "object": {"uuid": f"o {path}", "type": kind, **ids, "matrix": [float(x) for x in matrix]},
        },
    }


def packed(values: Any, kind: str, items: int) -> Command:
    """An array as meshcat's viewer unpacks it: an extension type for each kind of number."""
    import umsgpack  # type: ignore[import-untyped]

    code = {"Int8Array": 0x11, "Int16Array": 0x13, "Uint16Array": 0x14, "Uint32Array": 0x16, "Float32Array": 0x17}[kind]
    data = umsgpack.Ext(code, np.ascontiguousarray(values).tobytes())
    return {"itemSize": items, "type": kind, "array": data, "normalized": kind in ("Int8Array", "Int16Array")}


def place(path: str, T: Array) -> Command:
    """Put what is shown at a path at pose T (4, 4) in its parent."""
    return {"type": "set_transform", "path": path, "matrix": [float(x) for x in T.T.ravel()]}


def hide(path: str) -> Command:
    """Hide what is shown at a path."""
    return {"type": "set_property", "path": path, "property": "visible", "value": False}


def hex_colour(colour: Colour) -> int:
    """An sRGB colour, 0 to 1 each, as 0xRRGGBB."""
    r, g, b = (round(255 * c) for c in colour)
    return r << 16 | g << 8 | b


# Triangles --------------------------------------------------------------------------------------------------------------------------------


def flat(vertices: Array, faces: Int) -> tuple[Array, Array, Int]:
    """Vertices, normals and faces of a mesh (vertices (V, 3), faces (F, 3)) whose faces are flat."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-18)
    return corners.reshape(-1, 3), np.repeat(normals, 3, 0), np.arange(3 * len(corners)).reshape(-1, 3)


def creased(vertices: Array, faces: Int, crease_rad: float = 0.6) -> tuple[Array, Array, Int]:
    """Vertices, normals and faces of a mesh, smooth but for edges sharper than a crease: there each side has vertices of its own."""
    normals = corner_normals(surfaces([Mesh(vertices, faces)], np.eye(4)[None]), np.array([crease_rad])).reshape(-1, 3)
    leaning = np.round(normals * 60).astype(np.int64) + 60
    keys = ((faces.ravel() * 121 + leaning[:, 0]) * 121 + leaning[:, 1]) * 121 + leaning[:, 2]
    _, first, number = np.unique(keys, return_index=True, return_inverse=True)
    return vertices[faces.ravel()[first]], normals[first], number.reshape(-1, 3)


def _cylinder_mesh(radius: float, height: float, sides: int = 64) -> tuple[Array, Array, Int]:
    angle = 2 * np.pi * np.arange(sides) / sides
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], -1)
    low, top = np.array([0, 0, -height / 2]), np.array([0, 0, height / 2])
    i = np.arange(sides)
    j = (i + 1) % sides
    wall = np.concatenate([np.stack([i, j, j + sides], -1), np.stack([i, j + sides, i + sides], -1)])
    caps = [np.stack([np.full(sides, 4 * sides), 2 * sides + j, 2 * sides + i], -1)]
    caps.append(np.stack([np.full(sides, 4 * sides + 1), 3 * sides + i, 3 * sides + j], -1))
    vertices = np.concatenate([radius * out + low, radius * out + top, radius * out + low, radius * out + top, [low, top]])
    down, up = np.array([0, 0, -1.0]), np.array([0, 0, 1.0])
    normals = np.concatenate([out, out, np.tile(down, (sides, 1)), np.tile(up, (sides, 1)), [down, up]])
    return vertices, normals, np.concatenate([wall, *caps])


def annulus(inner: float, outer: float, sides: int = 96) -> tuple[Array, Array, Int]:
    """A flat ring about z between two radii, m: vertices (V, 3), normals (V, 3), faces (F, 3)."""
    angle = 2 * np.pi * np.arange(sides) / sides
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], -1)
    i = np.arange(sides)
    j = (i + 1) % sides
    faces = np.concatenate([np.stack([i, i + sides, j + sides], -1), np.stack([i, j + sides, j], -1)])
    return np.concatenate([inner * rim, outer * rim]), np.tile([0, 0, 1.0], (2 * sides, 1)), faces


def tube(points: Array, radius: float, sides: int = 6) -> tuple[Array, Array, Int]:
    """A tube around a polyline (N, 3)."""
    along = np.diff(points, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    tangent = np.concatenate([along[:1], along[:-1] + along[1:], along[-1:]])
    side = np.cross(tangent, [0.0, 0.0, 1.0])
    side[np.linalg.norm(side, axis=1) < 0.05] = [1.0, 0.0, 0.0]
    other = np.cross(side, tangent)
    for v in (side, other):
        v /= np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-12)
    angle = 2 * np.pi * np.arange(sides) / sides
    out = np.cos(angle)[:, None] * side[:, None] + np.sin(angle)[:, None] * other[:, None]
    n = len(points)
    start = (np.arange(n - 1) * sides)[:, None]
    i = np.arange(sides)
    j = (i + 1) % sides
    quads = [np.stack([start + i, start + j, start + j + sides], -1), np.stack([start + i, start + j + sides, start + i + sides], -1)]
    return (points[:, None] + radius * out).reshape(-1, 3), out.reshape(-1, 3), np.concatenate([q.reshape(-1, 3) for q in quads])
