"""The exact verdict: which bodies touch in a State, how deep, by FCL on convex solids.

Traps that shape this module: FCL's mesh type is a surface, so every solid is a `Convex` here; result objects accumulate, so each query
gets a fresh one; an exception in a manager's callback is swallowed, so no callback is used: pairs are culled by balls in numpy instead.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Int
from kinematics.collision.fcl_solids import Contact, Solid, depth, hull_solid, shape_solids
from kinematics.doors import checked
from kinematics.jit.decorators import jit_entry
from kinematics.mount import MOUNT, standing_still
from kinematics.scene import Held, Scene, State
from kinematics.transforms import Array

if TYPE_CHECKING:
    from kinematics.collision.broad_phase import BroadPhaseResult
    from kinematics.robots.robot import Robot

_BATCH = 512  # configurations looked at together


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
        for name, T in poses.items():
            checked(f"the pose of {name}", T, 4, 4)
        if held is not None:
            checked("T_hand_body", held.T_hand_body, 4, 4)
        grip = self._objects[held.body] if held is not None else []
        standing = [*self._fixtures, *((s, pose) for name, pose in poses.items() for s in self._objects[name])]
        solids, movers = [*self._links, *grip, *(s for s, _ in standing)], len(self._links) + len(grip)
        names = tuple(s.name for s in solids)
        tested = self._tested(names, movers, allowed_contacts)
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

    def _tested(self, names: Sequence[str], movers: int, allowed_contacts: Iterable[tuple[str, str]]) -> NDArray[np.bool_]:
        """Which pairs are tested (movers, solids): links as the robot lists them, what is held against links, movers against the rest,
        but for links that are fixed to the world against obstacles."""
        tested, links = np.zeros((movers, len(names)), np.bool_), len(self._links)
        tested[self._pairs[:, 0], self._pairs[:, 1]] = True
        tested[links:, :links] = tested[:, movers:] = True
        still = np.array([name in self._obstacles for name in names])
        tested[np.ix_(self._fixed_links(), np.flatnonzero(still))] = False
        for pair in allowed_contacts:
            first, second = (np.array([n == name for n in names]) for name in pair)
            tested[first[:movers, None] & second | second[:movers, None] & first] = False
        return tested

    def _fixed_links(self) -> Int:
        """The links that are fixed to the world: they stand on a table or beside a post as they were mounted."""
        turned = self._on_way[: len(self._links)] & (self.robot.tree.q_index >= 0)
        return np.flatnonzero(~turned.any(1))

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


@jit_entry
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
