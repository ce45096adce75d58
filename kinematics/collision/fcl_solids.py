"""Convex solids for FCL, and what it says of two of them: whether they touch, how deep, how far apart they are.

Traps that shape this module: FCL's mesh type is a surface, so every solid is a `Convex` here; result objects accumulate, so each query
gets a fresh one; an exception in a manager's callback is swallowed, so no callback is used.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kinematics.scene import Body
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape, bounds, convex_parts
from kinematics.transforms import Array, apply, inverse

if TYPE_CHECKING:
    from kinematics.robots.tree import LinkHull


SHALLOW_M = 0.001
"""FCL's own depth is right to 2 % up to here."""
SURELY_M = 1e-6
"""More than FCL's distances are wrong by."""
ROUNDING_M = 1e-9
"""More than boxes are wrong by."""


@dataclass(frozen=True)
class Contact:
    """Two names that touch, a link or the held object first, and the penetration depth in metres (see `depth`); below 0 it is a gap."""

    a: str
    b: str
    depth_m: float


class Solid:
    """A named solid for FCL; made once, then moved. vertices (V, 3): of a polyhedron that is the solid, or just contains it."""

    def __init__(self, name: str, geometry: Any, centre: Array, radius: float, vertices: Array) -> None:
        import fcl

        self.name, self.geometry, self.centre, self.radius, self.vertices = name, geometry, centre, radius, vertices
        self.object = fcl.CollisionObject(geometry)
        self.T = np.eye(4)
        self._at: Array | None = None
        self._normals: list[Array] = []  # one list for all twins

    def twin(self) -> Solid:
        """The same solid once more, to be moved on its own."""
        import fcl

        self.box  # noqa: B018  # which is found once for all twins
        twin = object.__new__(Solid)
        vars(twin).update(vars(self))  # with all that is known of its form
        twin.object = fcl.CollisionObject(self.geometry)
        return twin.move(self.T)

    def move(self, T: Array) -> Solid:
        """Put it at pose T (4, 4)."""
        self.object.setRotation(T[:3, :3])  # both are faster than a transform
        self.object.setTranslation(T[:3, 3])
        self.T, self._at = T, None
        return self

    @property
    def at(self) -> Array:
        """Where its centre (3,) is."""
        if self._at is None:
            self._at = self.T[:3, :3] @ self.centre + self.T[:3, 3]
        return self._at

    @cached_property
    def box(self) -> Array:
        """Middle and half edges (2, 3) of the box around it along its own axes."""
        low, high = self.vertices.min(0), self.vertices.max(0)
        return np.array([(low + high) / 2, (high - low) / 2])

    @property
    def normals(self) -> Array:
        """Outward normals (M, 3) of the polyhedron's faces, each once; found when asked for, by one of all twins."""
        if not self._normals:
            from scipy.spatial import ConvexHull

            self._normals.append(np.unique(np.round(ConvexHull(self.vertices).equations[:, :3], 6), axis=0))
        return self._normals[0]


def hull_solid(name: str, vertices: Array, faces: NDArray[np.int64] | None = None) -> Solid:
    """A convex polyhedron (V, 3); its faces (F, 3) are found when not given."""
    import fcl

    if faces is None:
        from scipy.spatial import ConvexHull

        hull = ConvexHull(vertices)
        corners = np.sort(hull.vertices)
        vertices, faces = vertices[corners], np.searchsorted(corners, hull.simplices).astype(np.int64)
        a, b, c = (vertices[faces[:, i]] for i in range(3))
        inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a - vertices.mean(0)) < 0
        faces[inward] = faces[inward][:, ::-1]
    flat = np.concatenate([np.full((len(faces), 1), 3), faces], axis=1).astype(np.int64).ravel()
    centre = (vertices.min(0) + vertices.max(0)) / 2
    radius = float(np.linalg.norm(vertices - centre, axis=1).max())
    return Solid(name, fcl.Convex(np.asarray(vertices, float), len(faces), flat), centre, radius, vertices)


def shape_solids(name: str, shape: Shape) -> list[Solid]:
    """A body's convex parts: FCL's own box and cylinder, hulls for meshes."""
    import fcl

    match shape:
        case Box():
            box = fcl.Box(*np.asarray(shape.size_m, float))
            return [Solid(name, box, np.zeros(3), float(np.linalg.norm(shape.half)), *convex_parts(shape))]
        case Cylinder():
            radius = float(np.hypot(shape.radius_m, shape.height_m / 2))
            return [Solid(name, fcl.Cylinder(shape.radius_m, shape.height_m), np.zeros(3), radius, *convex_parts(shape))]
        case _:
            return [mould.twin() for mould in _mesh_moulds(name, shape)]


@lru_cache(maxsize=128)
def _mesh_moulds(name: str, shape: ConvexMesh) -> tuple[Solid, ...]:
    """The hulls of a mesh's parts, which take a millisecond each to make: grasps of it are judged by the hundred."""
    return tuple(hull_solid(name, part) for part in shape.parts)


def touch(a: Solid, b: Solid) -> float | None:
    """None when two solids are apart, else how deep they penetrate at most, in metres: close for shallow contacts, coarse for deep."""
    d = a.at - b.at
    return None if d @ d > (a.radius + b.radius) ** 2 else _touch_near(a, b)


def _touch_near(a: Solid, b: Solid) -> float | None:
    """`touch` without a look at the balls around the two."""
    import fcl

    if not fcl.collide(a.object, b.object, fcl.CollisionRequest(), fcl.CollisionResult()):
        return None
    result = fcl.CollisionResult()
    fcl.collide(a.object, b.object, fcl.CollisionRequest(num_max_contacts=4, enable_contact=True), result)
    return max((float(c.penetration_depth) for c in result.contacts), default=0.0)


def depth(a: Solid, b: Solid, *, near: bool = False) -> float | None:
    """How deep two solids penetrate, in metres: the shortest way out along a face of either; None when they are apart.

    FCL's own figure (libccd's portal refinement) is up to 17 times too large for deep contacts. near: their boxes are known to overlap.
    """
    bound = _touch_near(a, b) if near else touch(a, b)
    if bound is None or bound <= SHALLOW_M:
        return bound
    out = np.concatenate([a.normals @ a.T[:3, :3].T, -b.normals @ b.T[:3, :3].T])
    overlap = (apply(a.T, a.vertices) @ out.T).max(0) - (apply(b.T, b.vertices) @ out.T).min(0)
    return min(bound, float(overlap.min()))


def near_pairs(some: Sequence[Solid], others: Sequence[Solid], within_m: float = 0.0) -> list[list[int]]:
    """Which of some solids and which of others (P, 2) have boxes along the world's axes that overlap, or are no further apart than
    within_m: no other two touch, or are so near."""
    (middle, half), (middle_b, half_b) = _boxes_around(some), _boxes_around(others)
    apart = np.abs(middle[:, None] - middle_b) > half[:, None] + half_b + (within_m + ROUNDING_M)
    found: list[list[int]] = np.argwhere(~apart.any(-1)).tolist()
    return found


def _boxes_around(solids: Sequence[Solid]) -> tuple[Array, Array]:
    """Middles and half edges (S, 3) of boxes along the world's axes around solids where they are."""
    T, boxes = np.array([s.T for s in solids]).reshape(-1, 4, 4), np.array([s.box for s in solids]).reshape(-1, 2, 3, 1)
    R = T[:, :3, :3]
    return (R @ boxes[:, 0])[..., 0] + T[:, :3, 3], (np.abs(R) @ boxes[:, 1])[..., 0]


def always_touching(
    hulls: Sequence[LinkHull], samples: Sequence[Mapping[str, Array]], known: set[frozenset[str]], share: float = 0.95
) -> set[frozenset[str]]:
    """Pairs of links that touch in at least `share` of the sampled link poses: neighbours in all but name, as MoveIt's assistant finds."""
    solids = [hull_solid(h.link, h.vertices, h.faces) for h in hulls]
    pairs: dict[frozenset[str], list[tuple[Solid, Solid]]] = {}
    for i, a in enumerate(solids):
        for b in solids[:i]:
            if a.name != b.name and frozenset((a.name, b.name)) not in known:
                pairs.setdefault(frozenset((a.name, b.name)), []).append((a, b))
    touched = dict.fromkeys(pairs, 0)
    for number, poses in enumerate(samples, 1):
        for s in solids:
            s.move(poses[s.name])
        for pair, parts in list(pairs.items()):
            touched[pair] += any(touch(a, b) is not None for a, b in parts)
            if touched[pair] + len(samples) - number < share * len(samples):  # whatever the other samples say
                del pairs[pair]
    return set(pairs)


def overlapping(bodies: Sequence[Body], tolerance_m: float = 0.001) -> list[Contact]:
    """Pairs of standing bodies that overlap by more than the tolerance, deepest first. A tolerance below 0 finds those, too, that are apart
    by less than that: their depth is below 0."""
    parts = [(n, s.move(b.T_world_body)) for n, b in enumerate(bodies) for s in shape_solids(b.name, b.shape)]
    solids, deepest = [s for _, s in parts], dict[tuple[int, int], float]()
    for (a, solid), (b, other) in ((parts[i], parts[j]) for i, j in near_pairs(solids, solids, max(0.0, -tolerance_m))):
        if b < a and (d := _depth_or_gap(solid, other, tolerance_m)) is not None and d > tolerance_m:
            deepest[b, a] = max(d, deepest.get((b, a), -np.inf))
    return sorted((Contact(bodies[b].name, bodies[a].name, d) for (b, a), d in deepest.items()), key=lambda c: -c.depth_m)


def _depth_or_gap(a: Solid, b: Solid, tolerance_m: float) -> float | None:
    """How deep two solids penetrate; with a tolerance below 0 less their gap, where they are apart."""
    d = depth(a, b, near=True)
    return d if d is not None or tolerance_m >= 0 else -gap(a, b, -tolerance_m)


def apart(body: Body, others: Sequence[Body], gap_m: float) -> bool:
    """Whether a body keeps at least gap_m from every other."""
    near = [other for other in others if not _boxes_apart(body, other, gap_m + SURELY_M)]
    mine = [s.move(body.T_world_body) for s in shape_solids(body.name, body.shape)] if near else []
    return all(
        gap(a, b.move(other.T_world_body), gap_m) >= gap_m for other in near for b in shape_solids(other.name, other.shape) for a in mine
    )


def _boxes_apart(a: Body, b: Body, gap_m: float) -> bool:
    """Whether the boxes around two bodies along the world's axes or b's own are so far apart: most pairs need no look by FCL."""
    if not isinstance(a.shape, ConvexMesh) and not isinstance(b.shape, ConvexMesh):  # whose origin is anywhere
        between = math.dist(a.T_world_body[:3, 3], b.T_world_body[:3, 3])
        if between >= math.hypot(*a.shape.half) + math.hypot(*b.shape.half) + gap_m:
            return True
    (low, high), (low_b, high_b) = bounds(a.shape, a.T_world_body), bounds(b.shape, b.T_world_body)
    if _furthest_apart(low, high, low_b, high_b) >= gap_m:
        return True
    (low, high), (low_b, high_b) = bounds(a.shape, inverse(b.T_world_body) @ a.T_world_body), bounds(b.shape, np.eye(4))
    return _furthest_apart(low, high, low_b, high_b) >= gap_m


def _furthest_apart(low: Array, high: Array, low_b: Array, high_b: Array) -> float:
    """How far two boxes are apart along the axis along which they are furthest; below 0 when they meet. Corners (3,)."""
    (a, b, c), (d, e, f) = (low_b - high).tolist(), (low - high_b).tolist()
    return float(max(a, b, c, d, e, f))


def gap(a: Solid, b: Solid, cap_m: float) -> float:
    """The distance of two solids in metres, 0 when they touch; cap_m or more when the balls around them already are that far apart."""
    import fcl

    d = a.at - b.at
    far = float(np.sqrt(d @ d)) - a.radius - b.radius
    if far >= cap_m:
        return far
    if touch(a, b) is not None:
        return 0.0
    return max(0.0, float(fcl.distance(a.object, b.object, fcl.DistanceRequest(), fcl.DistanceResult())))
