"""How a robot looks: the visual meshes of its URDF, piece by piece, each in one calm colour.

Colours come from the meshes' own materials, else from the URDF, and are greyed, so that on a picture the objects have the strong colours
and not the arm. A link without a readable visual mesh shows its collision hulls. Textured pieces are left out where a link has more that is
plain (labels, a dangling cable); where it has not, they are the link, in their textures' mean colours.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinematics import cache
from kinematics.robots.link_geometry import collada_unit
from kinematics.robots.robot import Robot
from kinematics.transforms import Array, apply, rotation_rpy, transform
from perception.rendering.colours import Colour

PLAIN: Colour = (0.80, 0.81, 0.83)
DARK: Colour = (0.17, 0.18, 0.20)
GREYED = 0.55
"""How far a material's colour is moved to its own grey."""


@dataclass(frozen=True, eq=False)
class Piece:
    """Triangles of one colour that move with a link: vertices (V, 3) in the link's frame, faces (F, 3). textured: in its file."""

    link: str
    vertices: Array
    faces: NDArray[np.int64]
    colour: Colour
    textured: bool = False


@lru_cache(maxsize=4)
def visuals(robot: Robot) -> tuple[Piece, ...]:
    """Everything to draw of a robot. Reading dozens of mesh files takes a second or two, so it is kept on disk."""
    from lxml import etree

    root = etree.fromstring(robot.urdf)
    folders = sorted({Path(mesh.get("filename", "")).parent for mesh in root.iter("mesh")})
    files = [(str(f), f.stat().st_size, f.stat().st_mtime_ns) for folder in folders if folder.is_dir() for f in sorted(folder.iterdir())]
    name = (
        f"visuals-{cache.key(robot.urdf, repr(files), *(h.vertices.tobytes() for h in robot.hulls))}"  # materials lie beside their meshes
    )
    kept = cache.load(name)
    if kept is None:
        pieces = _read(robot, root)
        cache.store(name, _packed(pieces))
        return pieces
    return _unpacked(kept)


def _packed(pieces: Sequence[Piece]) -> dict[str, NDArray[Any]]:
    return {
        "links": np.array([p.link for p in pieces]),
        "colours": np.array([p.colour for p in pieces]).reshape(-1, 3),
        "sizes": np.array([(len(p.vertices), len(p.faces)) for p in pieces], np.int64).reshape(-1, 2),
        "vertices": np.concatenate([np.zeros((0, 3)), *(p.vertices for p in pieces)]),
        "faces": np.concatenate([np.zeros((0, 3), np.int64), *(p.faces for p in pieces)]),
    }


def _unpacked(kept: Mapping[str, NDArray[Any]]) -> tuple[Piece, ...]:
    v, f = np.cumsum(kept["sizes"], axis=0).T[:, :-1]
    parts = zip(kept["links"].tolist(), np.split(kept["vertices"], v), np.split(kept["faces"], f), kept["colours"].tolist())
    return tuple(Piece(link, vertices, faces, (r, g, b)) for link, vertices, faces, (r, g, b) in parts)


def _read(robot: Robot, root: Any) -> tuple[Piece, ...]:
    """The pieces, from the mesh files. root: of the robot's URDF."""
    named = {m.get("name"): c.get("rgba") for m in root.iter("material") if (c := m.find("color")) is not None}
    pieces: list[Piece] = []
    for link in root.iter("link"):
        name = link.get("name", "")
        looks = _plain([piece for v in link.findall("visual") for piece in _visual(name, v, named)])
        if not looks and link.find("visual") is not None:
            looks = [Piece(name, h.vertices, h.faces, PLAIN) for h in robot.hulls if h.link == name]
        pieces += _joined(looks)
    drawn = {p.link for p in pieces}
    return (*pieces, *(Piece(h.link, h.vertices, h.faces, PLAIN) for h in robot.hulls if not drawn))


def _visual(link: str, visual: Any, named: dict[str, str]) -> list[Piece]:
    origin, geometry, material = visual.find("origin"), visual.find("geometry"), visual.find("material")
    T = np.eye(4)
    if origin is not None:
        T = transform(rotation_rpy(_floats(origin.get("rpy", "0 0 0"))), _floats(origin.get("xyz", "0 0 0")))
    rgba = named.get(material.get("name")) if material is not None else None
    given = _calm(_floats(rgba)[:3]) if rgba else None
    shape = geometry[0] if geometry is not None and len(geometry) else None
    if shape is None:
        return []
    if shape.tag == "mesh":
        return _mesh(link, shape, T, given)
    import trimesh

    if shape.tag == "box":
        solid = trimesh.creation.box(_floats(shape.get("size")))
    elif shape.tag == "cylinder":
        solid = trimesh.creation.cylinder(float(shape.get("radius")), float(shape.get("length")), sections=48)
    else:
        solid = trimesh.creation.icosphere(3, float(shape.get("radius")))
    return [Piece(link, apply(T, solid.vertices), np.asarray(solid.faces), given or DARK)]


def _mesh(link: str, mesh: Any, T: Array, given: Colour | None) -> list[Piece]:
    """The parts of a mesh file, one for each material. Nothing where it can't be read."""
    import trimesh

    try:
        scene = trimesh.load_scene(Path(mesh.get("filename")))
    except Exception:  # trimesh raises many kinds; the link then shows its hulls
        return []
    scale, unit = np.broadcast_to(_floats(mesh.get("scale", "1 1 1")), 3), collada_unit(Path(mesh.get("filename")))
    pieces = []
    for node in scene.graph.nodes_geometry:
        T_node, name = scene.graph[node]
        part = scene.geometry[name]
        material = getattr(part.visual, "material", None)
        if not hasattr(part, "faces"):
            continue
        texture = _texture(material)
        own = getattr(material, "diffuse", None)
        if texture is not None:
            own = np.asarray(texture.convert("RGB").resize((1, 1)))[0, 0]
        elif own is None:
            own = getattr(material, "baseColorFactor", None)
        colour = given or (_calm(np.asarray(own[:3], float) / 255) if own is not None else PLAIN)
        vertices = apply(T, unit * apply(np.asarray(T_node), np.asarray(part.vertices, float)) * scale)
        pieces.append(Piece(link, vertices, np.asarray(part.faces, np.int64), colour, texture is not None))
    return pieces


def _texture(material: Any) -> Any:
    """A material's texture, None where it has none; tiny images stand for one colour."""
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    return image if image is not None and max(image.size) > 8 else None


def _plain(pieces: list[Piece]) -> list[Piece]:
    """Of a link's pieces those without a texture, where they have the larger area; else all."""

    def area(some: list[Piece]) -> float:
        corners = [p.vertices[p.faces] for p in some]
        return sum(float(np.linalg.norm(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), axis=1).sum()) for c in corners)

    plain = [p for p in pieces if not p.textured]
    return plain if area(plain) > area([p for p in pieces if p.textured]) else pieces


def _joined(pieces: list[Piece]) -> list[Piece]:
    """One piece for each link and colour, doubled vertices merged."""
    out = []
    for colour in dict.fromkeys(p.colour for p in pieces):
        same = [p for p in pieces if p.colour == colour]
        starts = np.cumsum([0, *(len(p.vertices) for p in same)])
        vertices = np.concatenate([p.vertices for p in same])
        faces = np.concatenate([p.faces + s for p, s in zip(same, starts)])
        first, number = _same_places(vertices)
        faces = number[faces]
        solid = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
        out.append(Piece(same[0].link, vertices[first], faces[solid], colour))
    return out


def _same_places(points: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """One index (M,) for each different place among points (V, 3), to 1 µm, and for every point the number (V,) of its place."""
    x, y, z = np.round((points - points.min(0)) * 1e6).astype(np.int64).T
    _, first, number = np.unique((x << 42) ^ (y << 21) ^ z, return_index=True, return_inverse=True)
    return first, number


def _calm(rgb: Array) -> Colour:
    """A material's colour, lightened and greyed, neither black nor white."""
    bright = np.clip(rgb, 0.0, 1.0) ** 0.55
    grey = float(bright @ np.array([0.30, 0.59, 0.11]))
    calm = (bright + GREYED * (grey - bright)) * 0.80 + 0.06
    return (round(float(calm[0]), 3), round(float(calm[1]), 3), round(float(calm[2]), 3))


def _floats(text: str) -> Array:
    return np.array([float(x) for x in text.split()])
