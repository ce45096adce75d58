"""A URDF link's collision geometry as convex hulls, in the link's frame.

A mesh that is about as large as its convex hull becomes that hull. One that is much smaller (a frame, a jaw, a bracket) is taken apart by
V-HACD, and each of its triangles then lies wholly in one of the parts: what V-HACD lets stick out is added to the nearest part.
"""

from __future__ import annotations

import io
import os
import subprocess
import sys
from collections.abc import Collection, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from kinematics import cache
from kinematics.chain import Int
from kinematics.git_lfs import refuse_pointer
from kinematics.robots.tree import LinkHull
from kinematics.transforms import Array

MESHES = (".stl", ".obj", ".ply", ".dae", ".glb", ".gltf", ".off")
"""Of meshes whose format is another it is said what to make of them."""
LARGEST_M = 3.0
"""A link whose mesh is longer than that was meant in millimetres."""
FILLS, HAND_FILLS = 0.6, 0.9
"""A mesh that fills less of its hull is taken apart; of a gripper's links, what lies between jaws matters more."""
PARTS, HAND_PARTS, FRAME_PARTS = 4, 12, 16
FRAME_FILLS = 0.25
"""A mesh that fills less of its hull is a frame or a sheet, and needs more parts."""
SMALL_M3 = 2e-6
FLAT_M = 1e-4  # what is thinner becomes twice as thick as that, for it takes a volume to be covered by balls
VOXELS, ARM_VOXELS = 30_000, 8_000
"""Of which V-HACD looks at a mesh; of an arm's link mostly to see that its parts are hardly smaller than its hull."""
PATIENCE_S = 20.0
"""How long V-HACD may take for a mesh."""
EDGE_M = 0.02  # triangles are cut so fine before they are given to parts, so that parts don't grow along large ones
MOST_TRIANGLES = 60_000


@dataclass(frozen=True, eq=False)
class MeshSolid:
    """A mesh in metres, its scale applied: points (P, 3) as the file has them; vertices (V, 3), those at one place merged, and faces (F, 3)
    of them; its volume and its hull's in m³."""

    points: Array
    vertices: Array
    faces: Int
    volume: float
    hull_volume: float


def check_sizes(model: Any) -> None:
    """Look at the size of every collision mesh before anything is made of them.

    model: yourdfpy's. Raises: ValueError that names the link, the file and the size where one is longer than LARGEST_M, or can't be read.
    """
    for name, link in model.link_map.items():
        for collision in link.collisions or []:
            if (mesh := collision.geometry.mesh) is not None:
                size = float(np.ptp(read_mesh(Path(mesh.filename), _scale(mesh)).points, axis=0).max())
                if size > LARGEST_M:
                    raise ValueError(
                        f"link {name!r}: its mesh {mesh.filename} is {size:.4g} m long; is it in millimetres? "
                        'Then its <mesh> needs scale="0.001 0.001 0.001"'
                    )


def link_hulls(link: Any, at_hand: Collection[str], *, apart: bool = True) -> tuple[list[LinkHull], list[str]]:
    """Convex hulls of each collision element of yourdfpy's link, and notes about what could not be done well. Spheres and cylinders become
    containing polyhedra. at_hand: the links that hold objects or lie between those that do; apart: concave meshes are taken apart."""
    import trimesh

    from kinematics.shapes import box_corners, prism

    hulls, notes = list[LinkHull](), list[str]()
    for collision in link.collisions or []:
        geometry = collision.geometry
        if geometry.mesh is not None:
            file, scale = Path(geometry.mesh.filename), _scale(geometry.mesh)
            parts, said = _mesh_parts(file, scale, link.name in at_hand) if apart else ((read_mesh(file, scale).points,), ())
            notes += [f"link {link.name}: {words}" for words in said]
        elif geometry.box is not None:
            parts = (box_corners(np.asarray(geometry.box.size, float) / 2),)
        elif geometry.cylinder is not None:
            parts = (prism(geometry.cylinder.radius, geometry.cylinder.length),)
        elif geometry.sphere is not None:
            ball = trimesh.creation.icosphere(subdivisions=2)
            inner = float(np.min(ball.face_normals * ball.triangles_center @ np.ones(3)))
            parts = (np.asarray(ball.vertices) * geometry.sphere.radius / inner,)
        else:
            continue
        T = np.eye(4) if collision.origin is None else collision.origin
        for points in parts:
            placed = np.asarray(points @ T[:3, :3].T + T[:3, 3], float)
            hulls.append(LinkHull(link.name, *_hull(placed.tobytes())))
    return hulls, notes


@lru_cache(maxsize=512)
def _hull(points: bytes) -> tuple[Array, Int]:
    """Vertices (V, 3) and faces (F, 3) of the hull of points (P, 3): a URDF is read twice, before its hand is known and after."""
    import trimesh

    hull = trimesh.convex.convex_hull(_not_flat(np.frombuffer(points).reshape(-1, 3)))
    return np.asarray(hull.vertices, float), np.asarray(hull.faces, np.int64)


def _not_flat(points: Array) -> Array:
    """Points (P, 3), or where they lie in a plane (a printed marker, a label) or a line, such to both sides of it."""
    _, axes = np.linalg.eigh(np.cov(points.T))
    for axis in axes.T[np.ptp(points @ axes, axis=0) < FLAT_M]:
        points = np.concatenate([points + FLAT_M * axis, points - FLAT_M * axis])
    return points


def _scale(mesh: Any) -> tuple[float, float, float]:
    scale = np.broadcast_to(np.asarray(1.0 if mesh.scale is None else mesh.scale, float), 3)
    return float(scale[0]), float(scale[1]), float(scale[2])


@lru_cache(maxsize=128)
def read_mesh(file: Path, scale: tuple[float, float, float]) -> MeshSolid:
    """A mesh file in metres; of COLLADA files, the unit is heeded. Raises: ValueError when it holds no solid."""
    import trimesh

    refuse_pointer(file, "mesh")
    try:
        mesh: Any = trimesh.load(file, force="mesh", process=False)
        points = collada_unit(file) * np.asarray(mesh.vertices, float) * np.asarray(scale)
        hull = trimesh.convex.convex_hull(points)
        merged = trimesh.Trimesh(points, mesh.faces, process=False)
        merged.merge_vertices(merge_tex=True, merge_norm=True)
    except Exception as e:  # trimesh and Qhull raise many kinds, all of them "this file is no solid"
        why = str(e).strip().split("\n")[0] or type(e).__name__
        mend = "" if file.suffix.lower() in MESHES else f"; convert it to one of {', '.join(MESHES)}"
        raise ValueError(f"mesh file {file} can't be read, or holds no solid: {why}{mend}") from e
    vertices, faces = np.asarray(merged.vertices, float), np.asarray(merged.faces, np.int64)
    with np.errstate(all="ignore"):  # of what is flat
        return MeshSolid(points, vertices, faces, abs(float(merged.volume)), float(hull.volume))


@lru_cache(maxsize=256)
def _mesh_parts(file: Path, scale: tuple[float, float, float], at_hand: bool) -> tuple[tuple[Array, ...], tuple[str, ...]]:
    """The points (P, 3) of convex parts that contain a mesh, and notes."""
    mesh = read_mesh(file, scale)
    most = _parts_wanted(mesh, at_hand)
    if most == 1:
        return (mesh.points,), ()
    parts = _kept(mesh, most) or _taken_apart([(mesh, most)])[0]
    if parts is None:
        share = 100 * mesh.volume / mesh.hull_volume
        return (mesh.points,), (f"{file.name} fills {share:.0f} % of its convex hull and can't be taken apart: its hull stands for it",)
    if _volume(parts) >= _fills(at_hand) * mesh.hull_volume:  # hollow, but convex as seen from outside
        return (mesh.points,), ()
    return parts, ()


def _fills(at_hand: bool) -> float:
    return HAND_FILLS if at_hand else FILLS


def _parts_wanted(mesh: MeshSolid, at_hand: bool) -> int:
    """Of how many convex parts a mesh may be made; 1 where its hull will do."""
    if mesh.hull_volume < SMALL_M3 or mesh.volume >= _fills(at_hand) * mesh.hull_volume:
        return 1
    return FRAME_PARTS if mesh.volume < FRAME_FILLS * mesh.hull_volume else HAND_PARTS if at_hand else PARTS


def _volume(parts: tuple[Array, ...]) -> float:
    from scipy.spatial import ConvexHull

    return float(sum(ConvexHull(points, qhull_options="QJ").volume for points in parts))


def take_apart(links: Iterable[Any], at_hand: Collection[str]) -> None:
    """Take apart the concave meshes of yourdfpy's links, a process for each processor, before `link_hulls` asks for each mesh."""
    meshes = ((c.geometry.mesh, link.name in at_hand) for link in links for c in link.collisions or [])
    asked = dict.fromkeys((Path(mesh.filename), _scale(mesh), is_at_hand) for mesh, is_at_hand in meshes if mesh is not None)
    read = ((read_mesh(file, scale), is_at_hand) for file, scale, is_at_hand in asked)
    concave = [(mesh, most) for mesh, is_at_hand in read if (most := _parts_wanted(mesh, is_at_hand)) > 1 and _kept(mesh, most) is None]
    wanted, processes = list({_name_of(*each): each for each in concave}.values()), os.cpu_count() or 1
    with ThreadPoolExecutor(processes) as pool:
        list(pool.map(_taken_apart, (some for k in range(processes) if (some := wanted[k::processes]))))


def _name_of(mesh: MeshSolid, most: int) -> str:
    """Parts are kept on disk by the mesh's content: a changed URDF has the same meshes, and so have arms with the same gripper."""
    return f"parts-3-{cache.key(mesh.vertices.tobytes(), mesh.faces.tobytes(), str(most))}"


def _kept(mesh: MeshSolid, most: int) -> tuple[Array, ...] | None:
    kept = cache.load(_name_of(mesh, most))
    return None if kept is None else tuple(np.asarray(kept[str(i)], float) for i in range(len(kept)))


def _taken_apart(wanted: Sequence[tuple[MeshSolid, int]]) -> list[tuple[Array, ...] | None]:
    """Convex parts of meshes, each of so many at most, of which each triangle lies in one; None where V-HACD does not come to an end, or
    can't do it, and for those behind it. One process takes all: V-HACD may crash."""
    given = io.BytesIO()
    asked = [(mesh.vertices, mesh.faces, most, ARM_VOXELS if most == PARTS else VOXELS) for mesh, most in wanted]
    arrays = {f"{what}{k}": a for k, each in enumerate(asked) for what, a in zip("pfmv", each)}
    np.savez(given, **arrays)  # type: ignore[arg-type]
    command, patience = [sys.executable, "-P", "-c", _TAKE_APART], PATIENCE_S * len(wanted)
    try:
        done = subprocess.run(command, input=given.getvalue(), capture_output=True, timeout=patience, check=False)
        written = io.BytesIO(done.stdout)
    except subprocess.TimeoutExpired as e:
        written = io.BytesIO(e.stdout or b"")
    except OSError:
        written = io.BytesIO()
    found = list[tuple[Array, ...] | None]()
    for mesh, most in wanted:
        pieces = _next_written(written)
        parts = _containing(mesh, pieces) if pieces else None
        if parts is not None:
            cache.store(_name_of(mesh, most), {str(i): part for i, part in enumerate(parts)})
        found.append(parts)
    return found


def _next_written(stream: io.BytesIO) -> list[Array]:
    """The parts of the next mesh that the other process wrote; none where it wrote no more, or failed."""
    size = int.from_bytes(stream.read(8), "little")
    data = stream.read(size)
    if not size or len(data) < size:
        return []
    with np.load(io.BytesIO(data)) as found:
        return [np.asarray(found[name], float) for name in found.files]


_TAKE_APART = """
import io, sys
import numpy as np
import vhacdx
given = np.load(io.BytesIO(sys.stdin.buffer.read()))
for k in range(len(given.files) // 4):
    points, faces, most, voxels = (given[f"{what}{k}"] for what in "pfmv")
    faces = np.c_[np.full(len(faces), 3), faces].ravel().astype(np.uint32)
    out = io.BytesIO()
    how = dict(resolution=int(voxels), maxNumVerticesPerCH=32, maxRecursionDepth=7, asyncACD=False)
    np.savez(out, *(np.asarray(vertices, float) for vertices, _ in vhacdx.compute_vhacd(points, faces, maxConvexHulls=int(most), **how)))
    sys.stdout.buffer.write(len(out.getvalue()).to_bytes(8, "little") + out.getvalue())
    sys.stdout.buffer.flush()
"""


def _containing(mesh: MeshSolid, parts: list[Array]) -> tuple[Array, ...]:
    """Parts that contain every triangle of a mesh: of each triangle, the corners are added to the part that they stick out of least."""
    from scipy.spatial import ConvexHull
    from trimesh import remesh

    vertices, faces = mesh.vertices, mesh.faces
    while len(faces) < MOST_TRIANGLES:
        edges = np.linalg.norm(vertices[faces] - vertices[np.roll(faces, 1, axis=1)], axis=2).max(1)
        long = np.flatnonzero(edges > EDGE_M)
        if not len(long):
            break
        vertices, faces = remesh.subdivide(vertices, faces, face_index=long)  # type: ignore[no-untyped-call]
    used = np.unique(faces)
    vertices, faces = vertices[used], np.searchsorted(used, faces)
    parts = [part for part in parts if np.linalg.matrix_rank(part - part.mean(0), tol=1e-4) == 3]  # some are flat
    if not parts:
        return (mesh.points,)
    planes = [ConvexHull(part, qhull_options="QJ").equations for part in parts]
    out = np.array([(vertices @ e[:, :3].T + e[:, 3]).max(1) for e in planes])
    nearest = out[:, faces].max(2).argmin(0)
    grown = list[Array]()
    for k, part in enumerate(parts):
        corners = np.unique(faces[nearest == k])
        outside = corners[out[k][corners] > 0]
        points = np.concatenate([part, vertices[outside]])
        grown.append(points[ConvexHull(points, qhull_options="QJ").vertices])
    return tuple(grown)


def collada_unit(file: Path) -> float:
    """What a COLLADA file's coordinates are multiplied by for metres; of other files 1.

    Which axis it says is up is not heeded, nor do RViz and MoveIt: robots' meshes are in their link's frame, whatever an exporter wrote.
    """
    if file.suffix.lower() != ".dae":
        return 1.0
    from lxml import etree

    unit = etree.parse(str(file), etree.XMLParser(recover=True)).getroot().find("{*}asset/{*}unit")
    return 1.0 if unit is None else float(unit.get("meter", "1"))
