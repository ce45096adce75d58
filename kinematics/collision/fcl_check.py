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

from kinematics.array_checks import checked
from kinematics.chain import Int
from kinematics.collision.fcl_solids import Contact, Solid, depth, hull_solid, shape_solids
from kinematics.collision.near_boxes import near_pairs_along
from kinematics.collision.stretches import Stretch
from kinematics.jit.decorators import jit_entry
from kinematics.mount import MOUNT, standing_still
from kinematics.robots.tree import Joints, link_poses, product
from kinematics.scene import Held, Scene, State
from kinematics.transforms import Array

if TYPE_CHECKING:
    from kinematics.collision.broad_phase import BroadPhaseResult
    from kinematics.robots.robot import Robot

_BATCH = 512  # configurations looked at together


class _Layout(NamedTuple):
    """Which solids a question is about: the movers (M) first, link hulls and the held object's parts, then what stands.

    numbers (S,): of the solids. tested (M, S): which pairs are tested if no contact is allowed. at: the places of the solids with a name.
    """

    numbers: Int
    names: tuple[str, ...]
    movers: int
    tested: NDArray[np.bool_]
    at: dict[str, list[int]]


class _Asked(NamedTuple):
    """Pairs of solids, by their numbers, that one stretch is asked about: always (·, 2) at each of its configurations, once (·, 2) at the
    first, said (·, 3) at the configuration that stands before them, these rising."""

    always: Int
    once: Int
    said: Int


class Verdict:
    """FCL's word on States of one scene with one robot. Holds the collision objects, which are made once and moved."""

    def __init__(self, robot: Robot, scene: Scene) -> None:
        self.robot, self.scene = robot, scene
        self.T_world_base = scene.robot.T_world_base
        links = [solid.twin() for solid in _link_solids(robot)]
        still = [(s, b.T_world_body) for b in standing_still(scene) for s in shape_solids(b.name, b.shape)]
        objects = [(b.name, shape_solids(b.name, b.shape)) for b in scene.objects]
        self._links = len(links)
        self._fixtures, self._T_fixtures = range(len(links), len(links) + len(still)), [T for _, T in still]
        self._solids = [*links, *(s for s, _ in still)]
        self._objects: dict[str, range] = {}
        for name, parts in objects:
            self._objects[name] = range(len(self._solids), len(self._solids) + len(parts))
            self._solids += parts
        self._boxes = np.array([s.box for s in self._solids])
        self._obstacles = {MOUNT, *(b.name for b in scene.obstacles)}
        self._pairs = robot.self_pairs
        self._carriers, self._on_way = _ways(robot)
        self._known_movers: dict[tuple[bytes, int, int], Int] = {}
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
        """The first of configurations q (N, J) in which something touches, and what does, deepest first; None when nothing ever does: see
        `along`."""
        found = self.along([Stretch(q, poses, held, tuple(allowed_contacts))], [judged])
        return None if found is None else found[1:]

    def along(self, stretches: Sequence[Stretch], judged: Sequence[BroadPhaseResult | None]) -> tuple[int, int, list[Contact]] | None:
        """The first of some stretches, and the first of its configurations, in which something touches, and what does, deepest first; None
        when nothing ever does.

        Pairs are culled by boxes, along the world's axes and their own, then asked of FCL. judged: what the covers say about these very
        configurations. Then a pair that they judge is asked about where they leave it open, any other in every configuration, or just in
        the first when nothing between the two moves.

        Raises: ValueError when `judged` is about other solids, or about a pair that is not to be tested here.
        """
        if not stretches:
            return None
        every = [checked("q", s.q, -1, len(self.robot.joint_names)) for s in stretches]
        q, starts = np.concatenate(every), np.cumsum([0, *(len(rows) for rows in every)])
        places, T_standing = self._places(stretches)
        T_held = np.array([np.eye(4) if s.held is None else checked("T_hand_body", s.held.T_hand_body, 4, 4) for s in stretches])
        asked = [self._asked(rows, s, said) for rows, s, said in zip(every, stretches, judged)]
        rows, always, once, said = _rows_to_look_at(asked, starts)
        which = np.searchsorted(starts, rows, "right") - 1
        first, most = rows == starts[which], np.diff(always[1]).max(initial=0)
        for i in range(0, len(rows), _BATCH):
            now, its = rows[i : i + _BATCH], which[i : i + _BATCH]
            T = self._poses(q[now], T_held, its)
            part = said[slice(*np.searchsorted(said[:, 0], (now[0], now[-1] + 1)))]
            ask, made = np.empty((len(now) * most + len(once[0]) + len(part), 3), np.int64), np.full(len(self._boxes), -1)
            around, begins = np.empty_like(self._boxes), first[i : i + _BATCH]
            count = near_pairs_along(
                self._boxes, T, T_standing, places, now, its, begins, *always, *once, part, made, around, np.empty(3), ask
            )
            found = self._ask(T, T_standing, places, its, ask[:count])
            if found is not None:
                s = int(its[found[0]])
                return s, int(now[found[0]] - starts[s]), found[1]
        return None

    def _places(self, stretches: Sequence[Stretch]) -> tuple[Int, Array]:
        """Where the solids are during each stretch (S, N): at which of poses (P, 4, 4), and those; -1 for what moves."""
        places, T = np.full((len(stretches), len(self._solids)), -1), list(self._T_fixtures)
        places[:, self._fixtures] = np.arange(len(T))
        before: Mapping[str, Array] | None = None
        for s, stretch in enumerate(stretches):
            if stretch.poses is before:
                places[s] = places[s - 1]
                continue
            before = stretch.poses
            if not _sound(before):
                for name, pose in before.items():
                    checked(f"the pose of {name}", pose, 4, 4)
            for name, pose in before.items():
                places[s, self._objects[name]] = len(T)
                T.append(pose)
        return places, np.array(T, float).reshape(-1, 4, 4)

    def _asked(self, q: Array, stretch: Stretch, judged: BroadPhaseResult | None) -> _Asked:
        """What FCL is asked about at configurations q (N, J) of a stretch."""
        layout = self._layout(None if stretch.held is None else stretch.held.body, tuple(stretch.poses))
        tested, numbers = self._tested(layout, stretch.allowed_contacts), layout.numbers
        if judged is None:
            return _Asked(numbers[np.argwhere(tested)], _NO_PAIRS, _NO_ROWS)
        if judged.names != layout.names or (judged.judged & ~tested).any():
            raise ValueError("the covers and FCL were asked about different pairs")
        goes_with = self._goes_with(q, layout.movers - self._links, len(numbers) - layout.movers)
        pairs, said = np.empty((tested.size, 2), np.int64), np.empty((len(judged.rows), 3), np.int64)
        always, others = _left(numbers, tested, judged.judged, goes_with, judged.rows, judged.a, judged.b, pairs, said)
        return _Asked(pairs[:always], pairs[len(pairs) - others :], said)

    def _layout(self, held: str | None, standing: tuple[str, ...]) -> _Layout:
        """What is asked about while an object is held and others stand."""
        if (held, standing) not in self._layouts:
            grip = self._objects[held] if held is not None else range(0)
            numbers = np.array([*range(self._links), *grip, *self._fixtures, *(i for name in standing for i in self._objects[name])])
            movers = self._links + len(grip)
            names, at = tuple(self._solids[i].name for i in numbers), dict[str, list[int]]()
            for i, name in enumerate(names):
                at.setdefault(name, []).append(i)
            tested = np.zeros((movers, len(names)), np.bool_)
            tested[self._pairs[:, 0], self._pairs[:, 1]] = True
            tested[self._links :, : self._links] = tested[:, movers:] = True
            obstacles = [i for name in self._obstacles for i in at.get(name, ())]
            tested[np.ix_(self._fixed_links(), np.array(obstacles, np.int64))] = False
            self._layouts[held, standing] = _Layout(numbers, names, movers, tested, at)
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
        turned = self._on_way[: self._links] & (self.robot.tree.q_index >= 0)
        return np.flatnonzero(~turned.any(1))

    def _goes_with(self, q: Array, grip: int, standing: int) -> Int:
        """The last moving link that each solid, movers and what stands, goes with along q (N, J), or -1: between two that go with the same
        no joint moves."""
        moves = np.append((q != q[0]).any(0), False)[self.robot.tree.q_index]  # a fixed joint's index is -1
        key = (moves.tobytes(), grip, standing)
        if key not in self._known_movers:
            goes_with = np.where(self._on_way & moves, np.arange(len(moves)), -1).max(1)
            self._known_movers[key] = np.concatenate([goes_with[:-1], np.repeat(goes_with[-1], grip), np.full(standing, -1)])
        return self._known_movers[key]

    def _poses(self, q: Array, T_held: Array, which: Int) -> Array:
        """Poses (N, L + 1, 4, 4) of the link hulls and of what is held at q (N, J), in the world. T_held (S, 4, 4): in the hand, during
        each stretch, which (N,)."""
        joints, T = self.robot.tree.joints, np.empty((len(q), self._links + 1, 4, 4))
        base, scratch = np.ascontiguousarray(self.T_world_base, float), np.empty((1, len(joints.parent), 4, 4))
        _mover_poses(joints, q, self._carriers, base, T_held, which, np.empty((2, 4, 4)), scratch, T)
        return T

    def _ask(self, T: Array, T_standing: Array, places: Int, which: Int, ask: Int) -> tuple[int, list[Contact]] | None:
        """What FCL says of rows (n, i, j), n rising: solids i and j at configuration n. The first n with contacts, and these, deepest
        first. T, T_standing, places, which: see `near_boxes.near_pairs_along`."""
        solids, links = self._solids, self._links
        placed: dict[int, int] = {}  # where each solid was moved last: to a configuration, or to place k as -1 - k
        found: dict[tuple[str, str], float] = {}
        first, at = -1, -1
        for n, i, j in ask.tolist():
            if found and n != first:
                break
            if n != at:
                at, here = n, places[which[n]].tolist()
            for k in (i, j):
                to = n if here[k] < 0 else -1 - here[k]
                if placed.get(k) != to:
                    solids[k].move(T[n, min(k, links)] if to >= 0 else T_standing[here[k]])
                    placed[k] = to
            if (d := depth(solids[i], solids[j], near=True)) is not None:
                names = solids[i].name, solids[j].name
                first, found[names] = n, max(d, found.get(names, 0.0))
        return (first, sorted((Contact(a, b, d) for (a, b), d in found.items()), key=lambda c: -c.depth_m)) if found else None


def _rows_to_look_at(asked: Sequence[_Asked], starts: Int) -> tuple[Int, tuple[Int, Int], tuple[Int, Int], Int]:
    """At which rows of all stretches, which begin at `starts`, there is something to ask; the pairs of all, always and once, each with
    where those of a stretch begin; and what is said of rows."""
    looked_at = np.zeros(starts[-1], np.bool_)
    for one, start, end in zip(asked, starts[:-1], starts[1:]):
        looked_at[start : end if len(one.always) else start + bool(len(one.once))] = True
    said = np.concatenate([one.said for one in asked])
    said[:, 0] += np.repeat(starts[:-1], [len(one.said) for one in asked])
    looked_at[said[:, 0]] = True
    always, once = (
        (np.concatenate(pairs), np.cumsum([0, *(len(p) for p in pairs)])) for pairs in zip(*((one.always, one.once) for one in asked))
    )
    return np.flatnonzero(looked_at), always, once, said


@jit_entry
def _left(
    numbers: Int, tested: NDArray[np.bool_], judged: NDArray[np.bool_], goes_with: Int, rows: Int, a: Int, b: Int, pairs: Int, said: Int
) -> tuple[int, int]:
    """How many pairs (·, 2) FCL is asked about in every configuration of a stretch, from the front, and in its first alone, from the end.
    said (N, 3): what the covers leave open at which row. All by the solids' numbers (S,). tested, judged: (M, S), goes_with (S,)."""
    always, others = 0, pairs.shape[0]
    for i in range(tested.shape[0]):
        for j in range(tested.shape[1]):
            if tested[i, j] and not judged[i, j]:
                if goes_with[i] == goes_with[j]:
                    others -= 1
                    pairs[others, 0], pairs[others, 1] = numbers[i], numbers[j]
                else:
                    pairs[always, 0], pairs[always, 1] = numbers[i], numbers[j]
                    always += 1
    for n in range(rows.shape[0]):
        said[n, 0], said[n, 1], said[n, 2] = rows[n], numbers[a[n]], numbers[b[n]]
    return always, pairs.shape[0] - others


_NO_PAIRS, _NO_ROWS = np.zeros((0, 2), np.int64), np.zeros((0, 3), np.int64)


def _sound(poses: Mapping[str, Array]) -> bool:
    """Whether poses are what they should be, at a glance."""
    if not all(isinstance(T, np.ndarray) and T.shape == (4, 4) and T.dtype == np.float64 for T in poses.values()):
        return False
    return bool(np.isfinite([*poses.values()]).all()) if poses else True


@jit_entry
def _mover_poses(
    joints: Joints, q: Array, carriers: Int, base: Array, T_held: Array, which: Int, local: Array, links: Array, T: Array
) -> None:
    """`Verdict._poses` into T (N, H + 1, 4, 4). carriers (H + 1,): of the H link hulls, and the hand. local (2, 4, 4),
    links (1, L, 4, 4): scratch."""
    hulls = carriers.shape[0] - 1
    for r in range(q.shape[0]):
        link_poses(joints, q[r : r + 1], local[0], links)
        for i in range(hulls):
            product(base, links[0, carriers[i]], T[r, i])
        product(base, links[0, carriers[hulls]], local[0])
        product(local[0], T_held[which[r]], T[r, hulls])


@lru_cache(maxsize=8)
def _link_solids(robot: Robot) -> tuple[Solid, ...]:
    """The link hulls, which take long to make; each Verdict moves twins of its own."""
    return tuple(hull_solid(h.link, h.vertices, h.faces) for h in robot.hulls)


@lru_cache(maxsize=8)
def _ways(robot: Robot) -> tuple[Int, NDArray[np.bool_]]:
    """The links (H + 1,) that carry the hulls and, at last, what the hand holds; and which links (H + 1, L) lead to each."""
    tree = robot.tree
    carriers = [tree.index[name] for name in (*(h.link for h in robot.hulls), "hand")]
    return np.array(carriers), np.array([np.isin(np.arange(len(tree.names)), tree.path(k)) for k in carriers])
