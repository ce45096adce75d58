"""The exact verdict: which bodies touch in a State, how deep, by FCL on convex solids.

Traps that shape this module: FCL's mesh type is a surface, so every solid is a `Convex` here; result objects accumulate, so each query
gets a fresh one; an exception in a manager's callback is swallowed, so no callback is used: pairs are culled by balls in numpy instead.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Int
from kinematics.collision.fcl_solids import Contact, Solid, depth, hull_solid, shape_solids
from kinematics.doors import checked
from kinematics.jit.decorators import jit_entry, jit_inline
from kinematics.mount import MOUNT, standing_still
from kinematics.robots.tree import Joints, link_poses, product
from kinematics.scene import Held, Scene, State
from kinematics.transforms import Array

if TYPE_CHECKING:
    from kinematics.collision.broad_phase import BroadPhaseResult
    from kinematics.robots.robot import Robot

_BATCH = 512  # configurations looked at together


class _Layout(NamedTuple):
    """The solids of a question: the movers (M) first, link hulls and the held object's parts, then what stands.

    tested (M, S): which pairs are tested if no contact is allowed. at: the numbers of the solids with a name. boxes (S, 2, 3): of all.
    """

    solids: tuple[Solid, ...]
    names: tuple[str, ...]
    movers: int
    tested: NDArray[np.bool_]
    at: dict[str, list[int]]
    boxes: Array


class Verdict:
    """FCL's word on States of one scene with one robot. Holds the collision objects, which are made once and moved."""

    def __init__(self, robot: Robot, scene: Scene) -> None:
        self.robot, self.scene = robot, scene
        self.T_world_base = scene.robot.T_world_base
        self._links = [solid.twin() for solid in _link_solids(robot)]
        self._fixtures = [(s, b.T_world_body) for b in standing_still(scene) for s in shape_solids(b.name, b.shape)]
        self._obstacles = {MOUNT, *(b.name for b in scene.obstacles)}
        self._objects = {b.name: shape_solids(b.name, b.shape) for b in scene.objects}
        self._pairs = _self_pairs(robot)
        self._carriers, self._on_way = _ways(robot)
        self._known_still: dict[tuple[bytes, int, int], NDArray[np.bool_]] = {}
        self._layouts: dict[tuple[str | None, tuple[str, ...]], _Layout] = {}

    def contacts(self, state: State, allowed_contacts: Iterable[tuple[str, str]] = ()) -> list[Contact]:
        """All that touches in a State, deepest first, without the allowed contacts and without links that are neighbours.

        Objects that stand are tested against the robot and the held object, not against each other or the walls.
        """
        found = self.first_contacts(state.q[None], state.poses, state.held, allowed_contacts)
        return found[1] if found else []

    def first_contacts(
        self,
        q: Array,
        poses: Mapping[str, Array],
        held: Held | None = None,
        allowed_contacts: Iterable[tuple[str, str]] = (),
        judged: BroadPhaseResult | None = None,
    ) -> tuple[int, list[Contact]] | None:
        """The first of configurations q (N, J) in which something touches, and what does, deepest first; None when nothing ever does.

        poses: of the objects that stand; held: moves with the hand. Pairs are culled by boxes along the world's axes, then asked of FCL.
        judged: what the covers say about these very configurations. Then a pair that they judge is asked about where they leave it open,
        any other in every configuration, or just in the first when nothing between the two moves.

        Raises: ValueError when `judged` is about other solids, or about a pair that is not to be tested here.
        """
        q = checked("q", q, -1, len(self.robot.joint_names))
        if not _sound(poses):
            for name, T in poses.items():
                checked(f"the pose of {name}", T, 4, 4)
        if held is not None:
            checked("T_hand_body", held.T_hand_body, 4, 4)
        layout = self._layout(None if held is None else held.body, tuple(poses))
        grip = layout.movers - len(self._links)
        T_standing = np.array([*(T for _, T in self._fixtures), *(T for name, T in poses.items() for _ in self._objects[name])])
        tested = self._tested(layout, allowed_contacts)
        none = np.zeros((0, 2), np.int64)
        if judged is None:
            always, once, said = np.argwhere(tested), none, np.zeros((0, 3), np.int64)
        else:
            if judged.names != layout.names or (judged.judged & ~tested).any():
                raise ValueError("the covers and FCL were asked about different pairs")
            left, still = tested & ~judged.judged, self._still(q, grip, len(T_standing))
            always, once = (np.argwhere(some) if some.any() else none for some in (left & ~still, left & still))
            said = np.stack([judged.rows, judged.a, judged.b], axis=-1)
        for first in range(0, len(q), _BATCH):
            part = said[slice(*np.searchsorted(said[:, 0], (first, first + _BATCH)))]
            looked_at = np.full(min(_BATCH, len(q) - first), len(always) > 0)
            looked_at[part[:, 0] - first] = True
            looked_at[:1] |= first == 0 and len(once) > 0
            rows = first + np.flatnonzero(looked_at)
            if len(rows) == 0:
                continue
            T, ask = self._poses(q[rows], grip, held), np.empty((len(rows) * len(always) + len(once) + len(part), 3), np.int64)
            count = _near(layout.boxes, T, T_standing, rows, always, once if first == 0 else once[:0], part, ask)
            found = _ask(layout.solids, T, T_standing, ask[:count])
            if found is not None:
                return int(rows[found[0]]), found[1]
        return None

    def _layout(self, held: str | None, standing: tuple[str, ...]) -> _Layout:
        """What is asked about while an object is held and others stand."""
        if (held, standing) not in self._layouts:
            grip = self._objects[held] if held is not None else []
            around = [*(s for s, _ in self._fixtures), *(s for name in standing for s in self._objects[name])]
            solids, links, movers = (*self._links, *grip, *around), len(self._links), len(self._links) + len(grip)
            names, at = tuple(s.name for s in solids), dict[str, list[int]]()
            for i, name in enumerate(names):
                at.setdefault(name, []).append(i)
            tested = np.zeros((movers, len(names)), np.bool_)
            tested[self._pairs[:, 0], self._pairs[:, 1]] = True
            tested[links:, :links] = tested[:, movers:] = True
            obstacles = [i for name in self._obstacles for i in at.get(name, ())]
            tested[np.ix_(self._fixed_links(), np.array(obstacles, np.int64))] = False
            self._layouts[held, standing] = _Layout(solids, names, movers, tested, at, np.array([s.box for s in solids]))
        return self._layouts[held, standing]

    def _tested(self, layout: _Layout, allowed_contacts: Iterable[tuple[str, str]]) -> NDArray[np.bool_]:
        """Which pairs are tested (movers, solids): links as the robot lists them, what is held against links, movers against the rest,
        but for links that are fixed to the world against obstacles, and for allowed contacts."""
        tested = layout.tested.copy()
        for a, b in allowed_contacts:
            first, second = layout.at.get(a, ()), layout.at.get(b, ())
            for i, j in (*((i, j) for i in first for j in second), *((j, i) for i in first for j in second)):
                if i < layout.movers:
                    tested[i, j] = False
        return tested

    def _fixed_links(self) -> Int:
        """The links that are fixed to the world: they stand on a table or beside a post as they were mounted."""
        turned = self._on_way[: len(self._links)] & (self.robot.tree.q_index >= 0)
        return np.flatnonzero(~turned.any(1))

    def _still(self, q: Array, grip: int, standing: int) -> NDArray[np.bool_]:
        """Between which pairs (movers, solids) no joint moves along q (N, J): those that go with the same moving link, or with none."""
        moves = np.append((q != q[0]).any(0), False)[self.robot.tree.q_index]  # a fixed joint's index is -1
        key = (moves.tobytes(), grip, standing)
        if key not in self._known_still:
            goes_with = np.where(self._on_way & moves, np.arange(len(moves)), -1).max(1)
            goes_with = np.concatenate([goes_with[:-1], np.repeat(goes_with[-1], grip), np.full(standing, -1)])
            self._known_still[key] = goes_with[: len(goes_with) - standing, None] == goes_with
        return self._known_still[key]

    def _poses(self, q: Array, grip: int, held: Held | None) -> Array:
        """Poses (N, movers, 4, 4) of the link hulls and the held object's parts at q (N, J), in the world."""
        joints, T = self.robot.tree.joints, np.empty((len(q), len(self._links) + grip, 4, 4))
        T_held = np.eye(4) if held is None else np.ascontiguousarray(held.T_hand_body, float)
        base, scratch = np.ascontiguousarray(self.T_world_base, float), np.empty((1, len(joints.parent), 4, 4))
        _mover_poses(joints, q, self._carriers, base, T_held, np.empty((2, 4, 4)), scratch, T)
        return T


def _sound(poses: Mapping[str, Array]) -> bool:
    """Whether poses are what they should be, at a glance."""
    if not all(isinstance(T, np.ndarray) and T.shape == (4, 4) and T.dtype == np.float64 for T in poses.values()):
        return False
    return bool(np.isfinite([*poses.values()]).all()) if poses else True


@jit_entry
def _mover_poses(joints: Joints, q: Array, carriers: Int, base: Array, T_held: Array, local: Array, links: Array, T: Array) -> None:
    """`Verdict._poses` into T (N, M, 4, 4). carriers (H + 1,): of the H link hulls, and the hand. local (2, 4, 4), links (1, L, 4, 4):
    scratch."""
    hulls = carriers.shape[0] - 1
    for r in range(q.shape[0]):
        link_poses(joints, q[r : r + 1], local[0], links)
        for i in range(hulls):
            product(base, links[0, carriers[i]], T[r, i])
        product(base, links[0, carriers[hulls]], local[0])
        for i in range(hulls, T.shape[1]):
            product(local[0], T_held, T[r, i])


@lru_cache(maxsize=8)
def _link_solids(robot: Robot) -> tuple[Solid, ...]:
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
    """What FCL says of rows (n, i, j), n rising: solids i and j at configuration n. The first n with contacts, and these, deepest first.

    T (N, M, 4, 4): poses of the first M solids; T_standing (S, 4, 4): of the rest.
    """
    movers = T.shape[1]
    placed: dict[int, int] = {}  # the configuration for which each solid was moved last
    found: dict[tuple[str, str], float] = {}
    first = -1
    for n, i, j in ask.tolist():
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


@jit_entry
def _near(boxes: Array, T: Array, T_standing: Array, rows: Int, always: Int, once: Int, said: Int, ask: Int) -> int:
    """Fill in rows (n, i, j) of `ask`, n rising: pairs whose boxes overlap at T[n], and return how many there are.

    boxes (M + S, 2, 3): middle and half edges of each solid's in its own frame. T (N, M, 4, 4): poses of the first M at configurations
    rows (N,), T_standing (S, 4, 4) of the rest. Pairs (i, j): always (·, 2) at every configuration, once (·, 2) at the first; said
    (·, 3) at the configuration that it names, these rising.
    """
    count, next_said = 0, 0
    for n in range(rows.shape[0]):
        for k in range(always.shape[0]):
            count = _add(boxes, T, T_standing, n, always[k, 0], always[k, 1], ask, count)
        if n == 0:
            for k in range(once.shape[0]):
                count = _add(boxes, T, T_standing, n, once[k, 0], once[k, 1], ask, count)
        while next_said < said.shape[0] and said[next_said, 0] == rows[n]:
            count = _add(boxes, T, T_standing, n, said[next_said, 1], said[next_said, 2], ask, count)
            next_said += 1
    return count


@jit_inline
def _add(boxes: Array, T: Array, T_standing: Array, n: int, i: int, j: int, ask: Int, count: int) -> int:
    """Add (n, i, j) to `ask` if boxes along the world's axes around the two solids overlap; how many there are then."""
    movers = T.shape[1]
    A = T[n, i] if i < movers else T_standing[i - movers]
    B = T[n, j] if j < movers else T_standing[j - movers]
    for r in range(3):
        apart, room = A[r, 3] - B[r, 3], 1e-9
        for c in range(3):
            apart += A[r, c] * boxes[i, 0, c] - B[r, c] * boxes[j, 0, c]
            room += abs(A[r, c]) * boxes[i, 1, c] + abs(B[r, c]) * boxes[j, 1, c]
        if abs(apart) > room:
            return count
    ask[count, 0], ask[count, 1], ask[count, 2] = n, i, j
    return count + 1
