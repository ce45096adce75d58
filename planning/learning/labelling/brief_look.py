"""What the arm can do in a state, for labels: which objects it can pick, where they can be put, whether the target comes out.

The same checks as `Motions` makes, in the same order, with less patience: the static ones first, held against each object once for all
states of a scene (planning.motion.handling.obstruction), then brief searches of RRT-Connect of which nothing is kept but whether they
got there. What the fingers meet on their way is not asked, for where the open hand meets nothing, and the closed one with the object, they
do not.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Int
from kinematics.collision.edge_problem import some_pairs
from kinematics.scene import Held, State
from kinematics.transforms import Array, inverse
from planning.motion.cell.queries import ContactQuery, PlanningQuery
from planning.motion.handling import waiting
from planning.motion.handling.obstruction import View
from planning.motion.handling.picking import MAX_TRIES, Pick
from planning.motion.handling.placing import Placing, ReleaseQuery
from planning.motion.handling.ways import FreeWay
from planning.motion.pick_place import Motions
from planning.plan import Blocked

Flags = NDArray[np.bool_]

BRIEFLY, PATIENTLY = 200, 1000
"""Iterations of RRT-Connect for an object, and for the target."""
PICKS, AMONG_GRASPS = 4, 12
"""With so many picks of an object, found among so many grasps and more if need be, its regions are looked at."""


class _Carrying(NamedTuple):
    """An object in the hand, whichever way the arm has taken hold of it; lifting: while it may touch the floor."""

    held: Held
    carrying: PlanningQuery
    lifting: PlanningQuery


class _Put(NamedTuple):
    """Picks by one of which an object can be carried to a region, where the way down begins at `end` (A,)."""

    picks: Sequence[Pick]
    end: Array

    @property
    def pick(self) -> Pick:
        """The one after which the arm turns least."""
        return min(self.picks, key=lambda pick: float(np.abs(pick.lift[-1] - self.end).max()))


class BriefLook:
    """What can be done in a state. view: its obstructions; rng: decides where searches look."""

    def __init__(self, motions: Motions, state: State, rng: np.random.Generator) -> None:
        self.motions, self.state, self.rng = motions, state, rng
        self.view: View = motions.obstructions(state.poses, fingers=False)
        self.names = frozenset(state.poses)
        self._picks: dict[str, list[FreeWay]] = {}
        self._reached: dict[FreeWay, bool] = {}
        self._put: dict[tuple[str, int], _Put] = {}

    def pickable(self, name: str) -> bool:
        """Whether an object can be picked now: some way holds up to the static checks, and the arm gets there from where it is.

        The first ways that are found are tried first, for most often they will do; where there are no more of them, all were tried.
        """
        tried = 0
        for way in islice(self.view.free_ways(name, self.names - {name}), MAX_TRIES):
            if self._reachable(way):
                return True
            tried += 1
        return tried == MAX_TRIES and any(map(self._reachable, self._ways(name)))

    def placeable(self, name: str, regions: Sequence[int] | Int) -> Flags:
        """To which of some regions (N,) an object can be carried now.

        The ways with the same grasp are asked together: where the hand can't be, none of them leads. The next grasp is looked at for the
        regions that are left.
        """
        cell, regions, rest = self.motions.cell, np.asarray(regions, np.int64), self._rest(name)
        out, releases = np.zeros(len(regions), np.bool_), dict[float, ReleaseQuery]()
        left = np.flatnonzero(cell.room_over(name, self.state.poses[name][:3, :3], self.motions.scene.regions()[regions], rest))
        for ways in _by_grasp(self._ways(name)):
            if not len(left):
                break
            carrying: dict[int, _Carrying] = {}
            picks = [self._pick(name, rest, way, carrying) for way in ways if self._reachable(way)]
            if picks:
                self._carry(picks, rest, regions, left, releases, out)
                left = left[~out[left]]
        return out

    def _carry(
        self, picks: Sequence[Pick], rest: Mapping[str, Array], regions: Int, left: Int, releases: dict[float, ReleaseQuery], out: Flags
    ) -> None:
        """Mark in out (N,) to which of the regions regions[left] an object can be carried with one grasp, by any of its picks."""
        cell, name, centres = self.motions.cell, picks[0].held.body, self.motions.scene.regions()[regions]
        placing, lifts = self._placing(picks[0], rest, releases), np.array([pick.lift[-1] for pick in picks])
        starts = np.array(list({q.tobytes(): q for pick in picks for q in self._lifted(pick)}.values()))
        for near in (lifts, lifts[::-1].copy())[: len(lifts)]:  # what is not reached one way may be another
            down, ends = placing.ends(centres[left], near)
            left = left[down]
            if len(left):
                out[left] = cell.reached(picks[0].carrying, starts, ends, self.rng, BRIEFLY)
                for i in np.flatnonzero(out[left]).tolist():
                    self._put[name, int(regions[left[i]])] = _Put(picks, ends[i])
            left = left[~out[left]]

    def after(self, name: str, region: int) -> State | None:
        """The state after an object was carried to a region, as far as it was found, or is found now, that it can be."""
        key, motions = (name, region), self.motions
        if key not in self._put and not self.placeable(name, [region])[0]:
            return None
        pick = self._put[key].pick
        place = motions.placing(self.state, pick).place(motions.scene.regions()[region])
        if isinstance(place, Blocked):
            return None
        return State(motions.robot.with_arm(place.retreat[-1], pick.gripper_open), {**self._rest(name), name: place.T_world_object})

    def target_free(self, gone: Collection[str] = ()) -> bool:
        """Whether the target can be taken out now, or would be if some objects were gone."""
        motions, target, q = self.motions, self.view.target, self.motions.robot.arm_q(self.state.q)
        standing = self.names.difference(gone)
        ways = self.view.first_ways(target, standing - {target}, PICKS, AMONG_GRASPS)
        if not ways:
            return False
        poses = {name: T for name, T in self.state.poses.items() if name in standing} if gone else self.state.poses
        rest = {name: T for name, T in poses.items() if name != target}
        carrying: dict[int, _Carrying] = {}
        for way in _by_turn(ways, q)[:MAX_TRIES]:
            if not self._leads(motions.cell.problem(poses, way.opened), q, way.approach[:1]):
                continue
            pick = self._pick(target, rest, way, carrying)
            if self._leads(pick.carrying, self._lifted(pick), waiting.pulled_out(motions.cell, pick.carrying, pick.held, pick.lift[-1])):
                return True
            if self._leads(pick.carrying, self._lifted(pick), waiting.outside(motions.cell, pick.carrying, pick.held)):
                return True
        return False

    def _ways(self, name: str) -> list[FreeWay]:
        """The static picks of an object, the least to turn first."""
        if name not in self._picks:
            found = self.view.first_ways(name, self.names - {name}, PICKS, AMONG_GRASPS)
            self._picks[name] = _by_turn(found, self.motions.robot.arm_q(self.state.q))[:PICKS]
        return self._picks[name]

    def _reachable(self, way: FreeWay) -> bool:
        """Whether the arm gets from where it is to the beginning of a way."""
        if way not in self._reached:
            moving = self.motions.cell.problem(self.state.poses, way.opened)
            q = self.motions.robot.arm_q(self.state.q)
            self._reached[way] = bool(self.motions.cell.reached(moving, q, way.approach[:1], self.rng, BRIEFLY)[0])
        return self._reached[way]

    def _lifted(self, pick: Pick) -> Array:
        """Where the arm may be once a pick has lifted its object (S, A): the same hand, joints whole turns apart."""
        return np.array([turned.lift[-1] for turned in self.motions.turned(self.state, pick)])

    def _leads(self, query: PlanningQuery, start: Array, goals: Array) -> bool:
        """Whether there is a path from start (A,), or from one of several (S, A), to one of goals (G, A)."""
        return len(goals) > 0 and self.motions.cell.way(query, start, goals, self.rng, PATIENTLY) is not None

    def _pick(self, name: str, rest: Mapping[str, Array], way: FreeWay, carrying: dict[int, _Carrying]) -> Pick:
        """A way as a pick. carrying: the object in the hand, by the grasp, which grows."""
        cell = self.motions.cell
        if id(way.grasp) not in carrying:
            held = Held(name, cell.robot.opening.held(inverse(way.grasp.T_world_hand) @ self.state.poses[name]))
            query = cell.problem(rest, way.closed, held=held)
            carrying[id(way.grasp)] = _Carrying(held, query, query.allowing(name, "floor"))
        return Pick(way.grasp, way.approach, way.lift, way.opened, way.closed, *carrying[id(way.grasp)])

    def _placing(self, pick: Pick, rest: Mapping[str, Array], releases: dict[float, ReleaseQuery]) -> Placing:
        """The ways to put down what a pick takes hold of. releases: the queries of the hand once the object stands, by how far it opens,
        which grow."""
        cell, name, opened = self.motions.cell, pick.held.body, pick.gripper_open
        if opened not in releases:
            query = cell.problem({**rest, name: self.state.poses[name]}, opened)
            nothing = some_pairs(query.problem, np.zeros(len(query.problem.pairs), np.bool_))
            releases[opened] = ReleaseQuery(ContactQuery(nothing, query.names), query, *cell.standing(name, rest))
        return Placing(cell, pick, self.state.poses[name], releases[opened])

    def _rest(self, name: str) -> Mapping[str, Array]:
        """The poses of the objects besides one."""
        return self.motions.without(self.state, name)


def _by_turn(ways: Sequence[FreeWay], q: Array) -> list[FreeWay]:
    """Ways by how far the arm turns from q (A,) to where they begin."""
    return sorted(ways, key=lambda way: float(np.abs(way.approach[0] - q).max()))


def _by_grasp(ways: Iterable[FreeWay]) -> Iterable[list[FreeWay]]:
    """Ways with one grasp together."""
    found: dict[int, list[FreeWay]] = {}
    for way in ways:
        found.setdefault(id(way.grasp), []).append(way)
    return found.values()
