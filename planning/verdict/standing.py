"""Whether a body stands: it touches what is below it, and its centre of mass lies over what it touches.

Heights are those of the cabinet's frame, whose floor is at 0. What stands on plain surfaces is judged by the patches of contact; where
these don't carry it, the points at which it leans on others are taken along.

By this both the verdict judges what a plan leaves behind and the planner knows what may not be taken yet (`planning.motion.cell.supports`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from kinematics.collision.fcl_solids import hull_solid
from kinematics.scene import Cabinet, Scene
from kinematics.shapes import Shape
from kinematics.transforms import Array, cross, inverse
from planning.verdict import polygons
from planning.verdict.polyhedra import FEW_SIDES, Polyhedron, centre_of_mass, polyhedra, section_below

FROM_ABOVE = 0.1  # a direction's z: what is touched there presses down
OVER_M = 1e-6  # rounding, where the centre of mass is right above an edge of the support


@dataclass(frozen=True, eq=False)
class Placed:
    """A body's convex parts in the cabinet's frame, and the heights between which it is."""

    name: str
    parts: tuple[Polyhedron, ...]
    low: Array
    high: Array


@dataclass(frozen=True, eq=False)
class Stand:
    """What a body stands on: names of those that it touches from above; gap_m to the nearest of these, or to the floor; negative when it is
    that deep in it; off_m: how far, seen from above, its centre of mass is from the support."""

    on: tuple[str, ...]
    gap_m: float
    off_m: float

    @property
    def carried(self) -> bool:
        """Whether the centre of mass lies over the support."""
        return self.off_m < OVER_M


def placed(name: str, shape: Shape, T_world_body: Array, cabinet: Cabinet) -> Placed:
    """A body as it is in a cabinet."""
    T = inverse(cabinet.T_world_cabinet) @ T_world_body
    parts = tuple(p.moved(T) for p in polyhedra(shape, FEW_SIDES))
    points = np.concatenate([p.vertices for p in parts])
    return Placed(name, parts, points.min(0), points.max(0))


def boxes_meet(a: Placed | Polyhedron, b: Placed | Polyhedron, within_m: float) -> bool:
    """Whether the boxes around two bodies are no further apart than within_m along any axis: else the bodies are not, either."""
    return bool((a.low <= b.high + within_m).all() and (b.low <= a.high + within_m).all())


def stand(body: Placed, others: Iterable[Placed], cabinet: Cabinet, within_m: float) -> Stand:
    """What a body stands on, up to within_m above it or in it. others: all that may carry it besides the floor, in the same frame."""
    bottom, centre = float(body.low[2]), centre_of_mass(body.parts)[:2]
    floor = _floor(cabinet)
    if abs(bottom) <= within_m and (floor[0] <= body.low[:2]).all() and (floor[2] >= body.high[:2]).all():
        corners = np.concatenate([p.vertices for p in body.parts])
        if polygons.contains(polygons.hull(corners[corners[:, 2] <= bottom + within_m, :2]), centre):
            return Stand(("floor",), bottom, 0.0)  # as nearly all do
    feet = polygons.hull(np.concatenate([section_below(p, bottom + within_m) for p in body.parts]))
    near = [other for other in others if boxes_meet(body, other, within_m)]
    patches = [("floor", bottom, polygons.clip(feet, floor))] if abs(bottom) <= within_m else []
    for other in near:
        for part in other.parts:
            top = float(part.vertices[:, 2].max())
            if abs(bottom - top) <= within_m:
                under = polygons.hull(section_below(part.moved(_FLIP), within_m - top))
                patches.append((other.name, bottom - top, polygons.clip(feet, under) if len(under) > 2 else under))
    patches = [p for p in patches if len(p[2])]
    on = tuple(dict.fromkeys(name for name, _, _ in patches))
    gap = min((g for _, g, _ in patches), key=abs, default=bottom)
    support = [patch for _, _, patch in patches]
    if (off := _off(support, centre)) < OVER_M:
        return Stand(on, gap, off)
    leans = _leaning(body, near, within_m)
    support += [patch for _, patch in leans if len(patch)]
    return Stand(tuple(dict.fromkeys([*on, *(name for name, _ in leans)])), gap, _off(support, centre))


def stand_among(body: Placed, here: Iterable[Placed], scene: Scene, within_m: float) -> Stand:
    """What an object of a scene stands on while those of `here` are where they are, itself perhaps among them."""
    return stand(body, chain(_fixtures(scene), (other for other in here if other.name != body.name)), scene.cabinet, within_m)


def falls(at: Stand, first: Stand, by_m: float) -> bool:
    """Whether what stood somehow at first does not stay as it is now. Where it stood by the scene's word alone, with its centre of mass
    beside what it stands on, it may still do so, no further beside it but for by_m."""
    return not (at.carried or (at.on and not first.carried and at.off_m <= first.off_m + by_m))


def _fixtures(scene: Scene) -> Iterator[Placed]:
    """Walls and obstacles, which are placed when somebody looks at them: most objects stand on the floor."""
    for body in (*scene.cabinet.walls()[1:], *scene.obstacles):
        yield placed(body.name, body.shape, body.T_world_body, scene.cabinet)


def _floor(cabinet: Cabinet) -> Array:
    """The outline (4, 2) of the cabinet's floor."""
    depth, half, w = float(cabinet.size_m[0]), float(cabinet.size_m[1]) / 2, cabinet.wall_m
    return np.array([[0.0, -half - w], [depth + w, -half - w], [depth + w, half + w], [0.0, half + w]])


_FLIP = np.diag([1.0, 1.0, -1.0, 1.0])  # upside down: a reflection, which does for outlines seen along z


def _off(patches: Sequence[Array], centre: Array) -> float:
    """How far a point (2,) is from the hull of patches, in m."""
    if not any(map(len, patches)):
        return np.inf
    outline = polygons.hull(np.concatenate(patches))
    if polygons.contains(outline, centre):
        return 0.0
    here, there = polygons.nearest(centre[None], outline)
    return max(float(np.linalg.norm(here - there)), OVER_M if len(outline) < 3 else 0.0)  # nothing stands on a line


def _leaning(body: Placed, near: Sequence[Placed], within_m: float) -> list[tuple[str, Array]]:
    """Where a body touches others that are beside it: their names, and the corners (N, 2) of what touches, seen from above. What lies on it
    carries nothing."""
    out = []
    for other in near:
        for a in body.parts:
            for b in other.parts:
                if boxes_meet(a, b, within_m) and (u := _direction(a, b, within_m)) is not None and not _lies_on(b, a, u, within_m):
                    out.append((other.name, _common(a, b, u, within_m)))
    return out


def _lies_on(upper: Polyhedron, lower: Polyhedron, u: Array, within_m: float) -> bool:
    """Whether a solid presses on another from above, where u (3,) leads from that to it; of solids that are deep in each other u says
    nothing."""
    return bool(u[2] > FROM_ABOVE and (lower.vertices @ u).max() - (upper.vertices @ u).min() <= within_m)


def _direction(a: Polyhedron, b: Polyhedron, within_m: float) -> Array | None:
    """The unit vector (3,) from one solid to another that is no further away than within_m."""
    import fcl

    one, two = hull_solid("", a.vertices).object, hull_solid("", b.vertices).object
    found = fcl.CollisionResult()
    if fcl.collide(one, two, fcl.CollisionRequest(enable_contact=True), found):
        return np.asarray(found.contacts[0].normal, float)
    result = fcl.DistanceResult()
    fcl.distance(one, two, fcl.DistanceRequest(enable_nearest_points=True), result)
    way = np.subtract(result.nearest_points[1], result.nearest_points[0])
    length = float(np.linalg.norm(way))
    return np.asarray(way / length) if 0 < length <= within_m else None


def _common(a: Polyhedron, b: Polyhedron, u: Array, within_m: float) -> Array:
    """The corners (N, 2), from above, of the patch in which two solids touch across a plane with normal u (3,)."""
    x = np.eye(3)[int(np.argmin(np.abs(u)))]
    x = x - (x @ u) * u
    x /= np.linalg.norm(x)
    y = cross(u, x)
    ahead, behind = a.vertices @ u, b.vertices @ u
    caps = [a.vertices[ahead >= ahead.max() - within_m], b.vertices[behind <= behind.min() + within_m]]
    flat = sorted((polygons.hull(np.stack([c @ x, c @ y], -1)) for c in caps), key=len)
    patch = polygons.clip(*flat) if len(flat[1]) > 2 else np.stack(polygons.nearest(*flat))
    return np.asarray((patch[:, :1] * x + patch[:, 1:] * y + ahead.max() * u)[:, :2])
