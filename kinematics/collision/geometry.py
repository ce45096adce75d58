"""What moves with the arm and what stands around it as flat arrays: what every compiled collision check takes.

`Chain` (kinematics.chain) moves frames, `Parts` are convex polyhedra fixed to those frames (links, fingers at one opening, a held object),
`Solids` are the bodies that stand in the world, `Query` says which pairs matter. Robot builds the first two (see robot.py), Scene the
third. What a motion query needs of the parts is put together in posed_geometry.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics import cache
from kinematics.chain import Int
from kinematics.collision.vertex_groups import GROUP, grouped
from kinematics.jit.record import record
from kinematics.mount import standing_still
from kinematics.scene import Body, Scene
from kinematics.shapes import Box, ConvexMesh, Cylinder
from kinematics.transforms import Array

BOX, CYLINDER, HULL = 0, 1, 2


class Parts(NamedTuple):
    """P convex polyhedra, each fixed to a frame: 0 is the world, k + 1 the frame that joint k moves.

    frame (P,). Part p's vertices are vertices[start[p]:start[p + 1]], (·, 3) in its frame, metres.
    centre (P, 3), radius (P,): a ball around it, in its frame.
    """

    frame: Int
    start: Int
    vertices: Array
    centre: Array
    radius: Array


@record
class Solids(NamedTuple):
    """B convex bodies at rest: kind (B,) BOX, CYLINDER or HULL; T (B, 4, 4) in the world; half (B, 3) sizes in its own frame
    (a cylinder's: radius, radius, half height); a hull's vertices, vertices[start[b]:start[b + 1]] (·, 3), in its own frame.

    centre (B, 3), radius (B,): a ball around it, in the world. boxes (B, 7): half sizes and middle of the box around it along its own axes,
    radius of the ball about that middle. Of hulls alone: points (3, ·), groups (4, ·) and point_start (B + 1,), the vertices as
    `vertex_groups.grouped` gives them; planes[plane_start[b]:plane_start[b + 1]] (·, 4), outward unit normal and offset.
    """

    kind: Int
    T: Array
    half: Array
    start: Int
    vertices: Array
    centre: Array
    radius: Array
    boxes: Array
    points: Array
    groups: Array
    point_start: Int
    planes: Array
    plane_start: Int


@record
class Query(NamedTuple):
    """Which pairs may not touch: check (P, B) 1 for part against solid, pairs (S, 2) part against part."""

    check: NDArray[np.uint8]
    pairs: Int


class Asked(NamedTuple):
    """One of several queries about the same set of parts and solids, from row rows[0] to before row rows[1] of some configurations.

    parts (m,), bodies (b,): those that are there, the parts of one frame together. check (m, b), pairs (n, 2): as in `Query`, counted
    among them.
    """

    rows: tuple[int, int]
    parts: Int
    bodies: Int
    check: NDArray[Any]
    pairs: NDArray[Any]


@record
class Queries(NamedTuple):
    """`Asked`, S of them, for compiled code: rows (S, 2), then all parts, all bodies, all tables flat and all pairs; those of query s begin
    at part_start[s], and so on, (S + 1,) each."""

    rows: Int
    parts: Int
    bodies: Int
    check: NDArray[np.uint8]
    pairs: Int
    part_start: Int
    body_start: Int
    check_start: Int
    pair_start: Int


def make_queries(asked: Sequence[Asked]) -> Queries:
    """Pack queries for compiled code."""
    rows, parts, bodies, check, pairs = zip(*asked)
    return Queries(
        np.array(rows, np.int64),
        np.concatenate(parts),
        np.concatenate(bodies),
        np.concatenate([c.ravel() for c in check]).astype(np.uint8),
        np.concatenate(pairs).astype(np.int64, order="C"),
        _starts([len(p) for p in parts]),
        _starts([len(b) for b in bodies]),
        _starts([c.size for c in check]),
        _starts([len(p) for p in pairs]),
    )


def make_parts(frames: list[int], hulls: list[Array]) -> Parts:
    """Pack P hulls (V_p, 3), given in their frames' coordinates."""
    start = np.concatenate([[0], np.cumsum([len(h) for h in hulls])]).astype(np.int64)
    balls = [_ball(h) for h in hulls]
    return Parts(
        np.array(frames, np.int64),
        start,
        np.ascontiguousarray(np.concatenate(hulls) if hulls else np.zeros((0, 3))),
        np.array([c for c, _ in balls]).reshape(-1, 3),
        np.array([r for _, r in balls]),
    )


def make_solids(bodies: tuple[Body, ...] | list[Body]) -> tuple[Solids, list[str]]:
    """Pack bodies at their poses; also the name of the body behind each solid (a mesh gives one solid a part)."""
    rows: list[tuple[int, Array, Array, Array, str]] = []
    none = np.zeros((0, 3))
    for b in bodies:
        match b.shape:
            case Box():
                rows.append((BOX, b.T_world_body, b.shape.half, none, b.name))
            case Cylinder():
                rows.append((CYLINDER, b.T_world_body, b.shape.half, none, b.name))
            case ConvexMesh():
                rows += [(HULL, b.T_world_body, np.zeros(3), part, b.name) for part in b.shape.parts]
    n = len(rows)
    boxes, planes = np.zeros((n, 7)), []
    for i, (kind, _, half, vertices, _) in enumerate(rows):
        if kind == HULL:
            centre, radius = _ball(vertices)
            boxes[i] = [*np.ptp(vertices, axis=0) / 2, *centre, radius]
        else:
            boxes[i] = [*half, 0, 0, 0, np.linalg.norm(half) if kind == BOX else np.hypot(half[0], half[2])]
        planes.append(_planes(vertices.tobytes()) if kind == HULL else np.zeros((0, 4)))
    start = _starts([len(r[3]) for r in rows])
    vertices = np.ascontiguousarray(np.concatenate([r[3] for r in rows]) if rows else none)
    stock = Solids(
        np.array([r[0] for r in rows], np.int64),
        np.zeros((n, 4, 4)),
        np.array([r[2] for r in rows]).reshape(n, 3),
        start,
        vertices,
        np.zeros((n, 3)),
        boxes[:, 6].copy(),
        boxes,
        *grouped(vertices, start),
        np.concatenate([*planes, np.zeros((0, 4))]),
        _starts([len(p) for p in planes]),
    )
    return place_solids(stock, np.arange(n), np.array([r[1] for r in rows]).reshape(n, 4, 4)), [r[4] for r in rows]


@lru_cache(maxsize=8)
def scene_solids(scene: Scene) -> tuple[Solids, list[str]]:
    """All that stands in a scene, packed at the poses that it has there, and the name behind each solid; to be read, as it is made once."""
    return make_solids([*standing_still(scene), *scene.objects])


def place_solids(stock: Solids, which: Int, T: Array) -> Solids:
    """Some of the solids, which (n,) of them, at new poses T (n, 4, 4)."""
    return solids_at(some_solids(stock, which), T)


def solids_at(solids: Solids, T: Array) -> Solids:
    """The same solids at other poses T (B, 4, 4)."""
    x, y, z = solids.boxes[:, 3:6].T[:, :, None]
    centre = T[:, :3, 0] * x + T[:, :3, 1] * y + T[:, :3, 2] * z + T[:, :3, 3]
    return solids._replace(T=np.array(T, float).reshape(-1, 4, 4), centre=centre)


def some_solids(stock: Solids, which: Int) -> Solids:
    """Some of the solids, which (n,) of them, where they are."""
    start, vertices = _chosen(stock.start, which)
    point_start, points = _chosen(stock.point_start, which)
    plane_start, planes = _chosen(stock.plane_start, which)
    return Solids(
        stock.kind[which],
        stock.T[which],
        stock.half[which],
        start,
        stock.vertices[vertices],
        stock.centre[which],
        stock.radius[which],
        stock.boxes[which],
        np.ascontiguousarray(stock.points[:, points]),
        np.ascontiguousarray(stock.groups[:, points[::GROUP] // GROUP]),
        point_start,
        stock.planes[planes],
        plane_start,
    )


def _chosen(start: Int, which: Int) -> tuple[Int, Int]:
    """Of bodies with rows start[b]:start[b + 1] each, some (n,): where each starts now (n + 1,), and the rows it had before."""
    if not start[-1]:  # as among boxes and cylinders
        return np.zeros(len(which) + 1, np.int64), np.zeros(0, np.int64)
    counts = np.diff(start)[which]
    now = np.concatenate([[0], np.cumsum(counts)])
    return now, np.arange(now[-1]) + np.repeat(start[which] - now[:-1], counts)


@lru_cache(maxsize=1024)
def _planes(vertices: bytes) -> Array:
    """Planes (H, 4) of a hull: outward unit normal and offset; from the disk cache, so that most runs need no scipy."""
    name = "planes-" + cache.key(vertices)
    known = cache.load(name)
    if known is not None:
        return known["planes"].astype(float)
    from scipy.spatial import ConvexHull

    equations = ConvexHull(np.frombuffer(vertices).reshape(-1, 3)).equations
    planes = np.unique(np.round(equations * (1, 1, 1, -1), 9), axis=0)
    cache.store(name, {"planes": planes})
    return planes


def _starts(counts: list[int]) -> Int:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def _ball(vertices: Array) -> tuple[Array, float]:
    centre = (vertices.min(0) + vertices.max(0)) / 2
    return centre, float(np.linalg.norm(vertices - centre, axis=1).max())
