"""The exact verdict: which bodies touch in a State, how deep, by FCL on convex solids.

Traps that shape this module: FCL's mesh type is a surface, so every solid is a `Convex` here; result objects accumulate, so each query
gets a fresh one; an exception in a manager's callback is swallowed, so no callback is used: pairs are culled by balls in numpy instead.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kinematics.arm import Int
from kinematics.compiling import bare
from kinematics.scene import Body, Held, Scene, State
from kinematics.shapes import Box, Cylinder, Shape, convex_parts
from kinematics.transforms import Array, apply

if TYPE_CHECKING:
    from kinematics.coverage import Judged
    from kinematics.robot import Robot
    from kinematics.tree import LinkHull

SHALLOW_M = 0.001
"""FCL's own depth is right to 2 % up to here."""
_BATCH = 512  # configurations looked at together


@dataclass(frozen=True)
class Contact:
    """Two names that touch, a link or the held object first, and the penetration depth in metres (see `depth`)."""

    a: str
    b: str
    depth_m: float


class Solid:
    """A named solid for FCL; made once, then moved. vertices (V, 3): of a polyhedron that is the solid, or just contains it."""

    def __init__(self, name: str, geometry: Any, centre: Array, radius: float, vertices: Array) -> None:
        import fcl

        self.name, self.geometry, self.centre, self.radius, self.vertices = name, geometry, centre, radius, vertices
        self.object = fcl.CollisionObject(geometry)
        self.at, self.T = centre, np.eye(4)

    def twin(self) -> Solid:
        """The same solid once more, to be moved on its own."""
        import fcl

        twin = copy(self)  # with all that is known of its form
        twin.object = fcl.CollisionObject(self.geometry)
        return twin.move(self.T)

    def move(self, T: Array) -> Solid:
        """Put it at pose T (4, 4)."""
        import fcl

        self.object.setTransform(fcl.Transform(T[:3, :3], T[:3, 3]))
        self.at, self.T = T[:3, :3] @ self.centre + T[:3, 3], T
        return self

    @cached_property
    def box(self) -> Array:
        """Middle and half edges (2, 3) of the box around it along its own axes."""
        low, high = self.vertices.min(0), self.vertices.max(0)
        return np.array([(low + high) / 2, (high - low) / 2])

    @cached_property
    def normals(self) -> Array:
        """Outward normals (M, 3) of the polyhedron's faces, each once."""
        from scipy.spatial import ConvexHull

        return np.unique(np.round(ConvexHull(self.vertices).equations[:, :3], 6), axis=0)


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
            return [hull_solid(name, part) for part in convex_parts(shape)]


def touch(a: Solid, b: Solid) -> float | None:
    """None when two solids are apart, else how deep they penetrate at most, in metres: close for shallow contacts, coarse for deep."""
    import fcl

    d = a.at - b.at
    if d @ d > (a.radius + b.radius) ** 2:
        return None
    if not fcl.collide(a.object, b.object, fcl.CollisionRequest(), fcl.CollisionResult()):
        return None
    result = fcl.CollisionResult()
    fcl.collide(a.object, b.object, fcl.CollisionRequest(num_max_contacts=4, enable_contact=True), result)
    return max((float(c.penetration_depth) for c in result.contacts), default=0.0)


def depth(a: Solid, b: Solid) -> float | None:
    """How deep two solids penetrate, in metres: the shortest way out along a face of either; None when they are apart.

    FCL's own figure (libccd's portal refinement) is up to 17 times too large for deep contacts.
    """
    bound = touch(a, b)
    if bound is None or bound <= SHALLOW_M:
        return bound
    out = np.concatenate([a.normals @ a.T[:3, :3].T, -b.normals @ b.T[:3, :3].T])
    overlap = (apply(a.T, a.vertices) @ out.T).max(0) - (apply(b.T, b.vertices) @ out.T).min(0)
    return min(bound, float(overlap.min()))


class Verdict:
    """FCL's word on States of one scene with one robot. Holds the collision objects, which are made once and moved."""

    def __init__(self, robot: Robot, scene: Scene) -> None:
        self.robot, self.scene = robot, scene
        self.T_world_base = scene.robot.T_world_base
        self._links = [mould.twin() for mould in _moulds(robot)]
        self._walls = [(s, w.T_world_body) for w in scene.cabinet.walls() for s in shape_solids(w.name, w.shape)]
        self._objects = {b.name: shape_solids(b.name, b.shape) for b in scene.objects}
        self._pairs = _self_pairs(robot)
        self._carriers, self._on_way = _ways(robot)

    def contacts(self, state: State, may_touch: Iterable[tuple[str, str]] = ()) -> list[Contact]:
        """All that touches in a State, deepest first, without the pairs in may_touch and without links that are neighbours.

        Objects that stand are tested against the robot and the held object, not against each other or the walls.
        """
        found = self.first_contacts(state.q[None], state.poses, state.held, may_touch)
        return found[1] if found else []

    def first_contacts(
        self,
        q: Array,
        poses: Mapping[str, Array],
        held: Held | None = None,
        may_touch: Iterable[tuple[str, str]] = (),
        judged: Judged | None = None,
    ) -> tuple[int, list[Contact]] | None:
        """The first of configurations q (N, J) in which something touches, and what does, deepest first; None when nothing ever does.

        poses: of the objects that stand; held: moves with the hand. Pairs are culled by boxes along the world's axes, then asked of FCL.
        judged: what the covers say about these very configurations. Then a pair that they judge is asked about where they leave it open,
        any other in every configuration, or just in the first when nothing between the two moves.

        Raises: ValueError when `judged` is about other solids, or about a pair that is not to be tested here.
        """
        grip = self._objects[held.body] if held is not None else []
        standing = [*self._walls, *((s, pose) for name, pose in poses.items() for s in self._objects[name])]
        solids, movers = [*self._links, *grip, *(s for s, _ in standing)], len(self._links) + len(grip)
        names = tuple(s.name for s in solids)
        tested = self._tested(names, movers, may_touch)
        always, once = np.argwhere(tested), np.zeros((0, 2), np.int64)
        if judged is not None:
            if judged.names != names or (judged.judged & ~tested).any():
                raise ValueError("the covers and FCL were asked about different pairs")
            left, still = tested & ~judged.judged, self._still(q, len(grip), len(standing))
            always, once = np.argwhere(left & ~still), np.argwhere(left & still)
        T_standing = np.array([T for _, T in standing])
        for first in range(0, len(q), _BATCH):
            some = np.arange(first, min(first + _BATCH, len(q)))
            asked = [(np.repeat(some, len(always)), *np.tile(always, (len(some), 1)).T)]
            if first == 0:
                asked.append((np.zeros(len(once), np.int64), *once.T))
            if judged is not None:
                part = slice(*np.searchsorted(judged.rows, (first, first + _BATCH)))
                asked.append((judged.rows[part], judged.a[part], judged.b[part]))
            ask = np.concatenate([np.array(columns) for columns in asked], axis=1).T
            if len(ask):
                rows, ask[:, 0] = np.unique(ask[:, 0], return_inverse=True)
                found = _ask(solids, self._poses(q[rows], len(grip), held), T_standing, ask)
                if found is not None:
                    return int(rows[found[0]]), found[1]
        return None

    def _tested(self, names: Sequence[str], movers: int, may_touch: Iterable[tuple[str, str]]) -> NDArray[np.bool_]:
        """Which pairs are tested (movers, solids): links as the robot lists them, what is held against links, movers against the rest."""
        tested, links = np.zeros((movers, len(names)), np.bool_), len(self._links)
        tested[self._pairs[:, 0], self._pairs[:, 1]] = True
        tested[links:, :links] = tested[:, movers:] = True
        for pair in may_touch:
            first, second = (np.array([n == name for n in names]) for name in pair)
            tested[first[:movers, None] & second | second[:movers, None] & first] = False
        return tested

    def _still(self, q: Array, grip: int, standing: int) -> NDArray[np.bool_]:
        """Between which pairs (movers, solids) no joint moves along q (N, J): those that go with the same moving link, or with none."""
        moves = np.append((q != q[0]).any(0), False)[self.robot.tree.q_index]  # a fixed joint's index is -1
        goes_with = np.where(self._on_way & moves, np.arange(len(moves)), -1).max(1)
        goes_with = np.concatenate([goes_with[:-1], np.repeat(goes_with[-1], grip), np.full(standing, -1)])
        return np.asarray(goes_with[: len(goes_with) - standing, None] == goes_with)

    def _poses(self, q: Array, grip: int, held: Held | None) -> Array:
        """Poses (N, movers, 4, 4) of the link hulls and the held object's parts at q (N, J), in the world."""
        T = self.T_world_base @ self.robot.tree.poses(q)[:, self._carriers]
        T_held = T[:, -1:] @ held.T_hand_body if held is not None else T[:, -1:]
        return np.concatenate([T[:, :-1], np.repeat(T_held, grip, axis=1)], axis=1)


@lru_cache(maxsize=8)
def _moulds(robot: Robot) -> tuple[Solid, ...]:
    """The link hulls, which take long to make; each Verdict moves twins of its own."""
    return tuple(hull_solid(h.link, h.vertices, h.faces) for h in robot.hulls)


@lru_cache(maxsize=8)
def _self_pairs(robot: Robot) -> Int:
    return robot.self_pairs()


@lru_cache(maxsize=8)
def _ways(robot: Robot) -> tuple[Int, NDArray[np.bool_]]:
    """The links (H + 1,) that carry the hulls and, at last, what the hand holds; and which links (H + 1, L) lead to each."""
    tree = robot.tree
    carriers = [tree.index[name] for name in (*(h.link for h in robot.hulls), "hand")]
    return np.array(carriers), np.array([np.isin(np.arange(len(tree.names)), tree.path(k)) for k in carriers])


def _ask(solids: Sequence[Solid], T: Array, T_standing: Array, ask: Int) -> tuple[int, list[Contact]] | None:
    """What FCL says of rows (n, i, j): solids i and j at configuration n. The first n with contacts, and these, deepest first.

    T (N, M, 4, 4): poses of the first M solids; T_standing (S, 4, 4): of the rest.
    """
    movers = T.shape[1]
    ask = ask[_boxes_meet(solids, T, T_standing, ask)]
    placed: dict[int, int] = {}  # the configuration for which each solid was moved last
    found: dict[tuple[str, str], float] = {}
    first = -1
    for n, i, j in ask[np.argsort(ask[:, 0], kind="stable")].tolist():
        if found and n != first:
            break
        for k in (i, j):
            if placed.get(k) != (n if k < movers else 0):
                solids[k].move(T[n, k] if k < movers else T_standing[k - movers])
                placed[k] = n if k < movers else 0
        if (d := depth(solids[i], solids[j])) is not None:
            names = solids[i].name, solids[j].name
            first, found[names] = n, max(d, found.get(names, 0.0))
    return (first, sorted((Contact(a, b, d) for (a, b), d in found.items()), key=lambda c: -c.depth_m)) if found else None


def _boxes_meet(solids: Sequence[Solid], T: Array, T_standing: Array, ask: Int) -> NDArray[np.bool_]:
    """Of rows (n, i, j) those where boxes along the world's axes around the two solids overlap; see `_ask`."""
    meet = np.empty(len(ask), np.bool_)
    T_standing = np.ascontiguousarray(T_standing, float).reshape(-1, 4, 4)
    _meet(np.array([s.box for s in solids]), np.ascontiguousarray(T), T_standing, np.ascontiguousarray(ask), meet)
    return meet


@bare
def _meet(boxes: Array, T: Array, T_standing: Array, ask: Int, meet: NDArray[np.bool_]) -> None:
    """`_boxes_meet` for boxes (M + S, 2, 3), middle and half edges of each in the solid's own frame."""
    movers = T.shape[1]
    for row in range(ask.shape[0]):
        n, i, j = ask[row, 0], ask[row, 1], ask[row, 2]
        A = T[n, i] if i < movers else T_standing[i - movers]
        B = T[n, j] if j < movers else T_standing[j - movers]
        meet[row] = True
        for r in range(3):
            apart, room = A[r, 3] - B[r, 3], 1e-9
            for c in range(3):
                apart += A[r, c] * boxes[i, 0, c] - B[r, c] * boxes[j, 0, c]
                room += abs(A[r, c]) * boxes[i, 1, c] + abs(B[r, c]) * boxes[j, 1, c]
            if abs(apart) > room:
                meet[row] = False
                break


def always_touching(
    hulls: Sequence[LinkHull], samples: Sequence[Mapping[str, Array]], known: set[frozenset[str]], share: float = 0.95
) -> set[frozenset[str]]:
    """Pairs of links that touch in at least `share` of the sampled link poses: neighbours in all but name, as MoveIt's assistant finds."""
    solids = [hull_solid(h.link, h.vertices, h.faces) for h in hulls]
    counts: dict[frozenset[str], int] = {}
    for poses in samples:
        for s in solids:
            s.move(poses[s.name])
        touching = {
            pair
            for i, a in enumerate(solids)
            for b in solids[:i]
            if (pair := frozenset((a.name, b.name))) not in known and len(pair) == 2 and touch(a, b) is not None
        }
        for pair in touching:
            counts[pair] = counts.get(pair, 0) + 1
    return {pair for pair, n in counts.items() if n >= share * len(samples)}


def overlapping(bodies: Sequence[Body], tolerance_m: float = 0.001) -> list[Contact]:
    """Pairs of standing bodies that overlap by more than the tolerance, deepest first."""
    solids = [[s.move(b.T_world_body) for s in shape_solids(b.name, b.shape)] for b in bodies]
    found = []
    for i, group in enumerate(solids):
        for other in solids[:i]:
            deepest = max((d for a in group for b in other if (d := depth(a, b)) is not None), default=None)
            if deepest is not None and deepest > tolerance_m:
                found.append(Contact(other[0].name, group[0].name, deepest))
    return sorted(found, key=lambda c: -c.depth_m)


def apart(body: Body, others: Sequence[Body], gap_m: float) -> bool:
    """Whether a body keeps at least gap_m from every other."""
    mine = [s.move(body.T_world_body) for s in shape_solids(body.name, body.shape)]
    return all(
        gap(a, b.move(other.T_world_body), gap_m) >= gap_m for other in others for b in shape_solids(other.name, other.shape) for a in mine
    )


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
