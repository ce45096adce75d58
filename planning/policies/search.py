"""Look ahead: find moves after which the target can be taken out, with motions that were tried, the shortest first.

The search is A* over moves (object, region). A state's rank is the number of moves that led to it and the length of its shortest relaxed
plan (planning.relaxed_plan), which never overestimates. A state has hundreds of moves, and each costs a motion plan, so a state is
expanded one move at a time: first the objects that can go first in a shortest relaxed plan, to regions where the rest of the plan still
holds; these keep the rank. Then all others, which raise it. With each move that was tried a state also steps back a little, so that a state
whose moves keep failing doesn't use up the search.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from heapq import heappop, heappush
from itertools import count
from typing import Protocol

import numpy as np

from kinematics.scene import Scene, State
from kinematics.transforms import Array
from perception.observation import Observation, observe
from planning.motion.handling.carry import Done
from planning.motion.pick_place import Choice
from planning.plan import Blocked
from planning.relaxed_plan import NOTHING, Names, Obstructions, RelaxedPlan, gets_shorter, relaxed_plans, shortest_plans


class World(Protocol):
    """What a look ahead asks of `planning.motion.pick_place.Motions`."""

    @property
    def scene(self) -> Scene: ...
    @property
    def state(self) -> State: ...
    @property
    def thorough(self) -> World: ...
    @property
    def exhaustive(self) -> World: ...
    @property
    def varied(self) -> World: ...
    @property
    def if_free(self) -> World: ...
    @property
    def partly_unseen(self) -> bool: ...
    def relocate(self, state: State, name: str, region: int, rng: np.random.Generator) -> Done | Blocked: ...
    def retrieve_target(self, state: State, rng: np.random.Generator) -> Done | Blocked: ...
    def place_pose(self, name: str, T_from: Array, region: int) -> Array: ...
    def out_of_reach(self, state: State, name: str) -> bool: ...
    def gets_to(self, state: State, name: str, rng: np.random.Generator) -> bool: ...
    def obstructions(self, poses: Mapping[str, Array], *, roughly: bool = ...) -> Obstructions: ...


@dataclass(frozen=True)
class Effort:
    """How hard a search tries. attempts: moves that are tried at most, feasible or not. step_back: by how much a state's rank grows with
    each of its moves that was tried: after 1 / step_back of them one more move elsewhere looks as good. choosy: after so many more of them
    a move that can be carried out, but comes near to something, looks as good as one that does not. last: attempts of a last search, to
    near places, where others have found nothing and yet there is hope."""

    attempts: int
    step_back: float = 0.02
    choosy: int = 4
    last: int = 0


RegionOrder = Callable[[Observation, str, np.random.Generator], Sequence[int]]
"""The free regions for an object, the best first."""
FEW_MOVES = 3
"""So many moves at most are to come where near places are preferred: where more objects have to go, room is scarce."""


@dataclass(frozen=True)
class Preferences:
    """In which order moves are tried, among those that are as short.

    objects: what it costs to move each object (by name), the cheapest first. regions: those for an object, the likeliest first; nearby: the
    same where few moves are to come, and what counts is the arm's way; None where that is no other order.
    """

    objects: Callable[[Observation], Callable[[str], float]]
    regions: RegionOrder
    nearby: RegionOrder | None = None

    def regions_with(self, moves: int) -> RegionOrder:
        """The order of regions for a move when so many are to come, itself among them."""
        return self.nearby if self.nearby is not None and moves <= FEW_MOVES else self.regions


@dataclass(frozen=True, eq=False)
class Step:
    """A move that was found, and the state after it."""

    choice: Choice
    after: State


@dataclass(eq=False)
class _Node:
    """A state in the search.

    moves: what led to it. cost: of moving each object. plans: all shortest relaxed plans. cannot: objects to which the arm was found
    not to get. tried: the moves from here that were tried. last_resort: whether those that keep the rank are used up.
    """

    state: State
    moves: tuple[Step, ...]
    seen: Observation
    cost: Callable[[str], float]
    plans: Sequence[RelaxedPlan] = ()
    cannot: Names = NOTHING
    tried: set[Choice] = field(default_factory=set)
    last_resort: bool = False
    choices: Iterator[Choice] = field(default_factory=lambda: iter(()))
    asked: bool = True
    back: int = 0

    @property
    def fewest(self) -> int:
        """How many moves there are at least on a way through this state, with the moves that are to be tried next.

        Where nothing is statically in the way, and yet the arm does not get to the target, at least one object must go.
        """
        needed = self.plans[0].length
        return len(self.moves) + (max(1, needed + self.last_resort) if self.asked else 0)

    @property
    def standing(self) -> Names:
        return frozenset(self.seen.movable)


class Search:
    """One search. most: how many moves there may be. tried: how many were tried, feasible or not."""

    def __init__(self, world: World, preferences: Preferences, effort: Effort, most: int, rng: np.random.Generator) -> None:
        self.world, self.preferences, self.effort, self.most, self.rng = world, preferences, effort, most, rng
        self.target = world.scene.target_name
        self._queue: list[tuple[float, int, int, _Node]] = []
        self._ticket = count()
        self.tried = 0

    def run(self, start: State) -> list[Step]:
        """Moves from a state after which the target can be taken out; empty when none were found. It can be asked for once."""
        found = self._found(start)
        self._queue.clear()  # what is left refers to this search, and would keep it
        return found

    def leading(self, start: State) -> list[tuple[str, Iterator[int]]]:
        """The objects that go first in a shortest relaxed plan from a state, the cheapest in front, each with the regions where it gets
        shorter; empty where no plan is short enough."""
        node = self._node(start, ())
        return [] if node is None else [(name, (region for _, region in choices)) for name, choices in self._leading(node)]

    def _found(self, start: State) -> list[Step]:
        self._put(self._node(start, ()))
        while (found := self._next()) is not None:
            node, choice = found
            if choice is None:
                if isinstance(self.world.retrieve_target(node.state, self.rng), Done):
                    return list(node.moves)
                self._put(node)
                continue
            self.tried += 1
            child = self._tried(node, choice)
            self._put(node)
            self._put(child)
        return []

    def _next(self) -> tuple[_Node, Choice | None] | None:
        """The most promising state that has a move left, and the move; no move where the target is to be sought first; None when all were
        tried, or as many as may be."""
        while self._queue:
            *_, node = heappop(self._queue)
            if not node.asked:
                node.asked = True
                return node, None
            if self.tried == self.effort.attempts:
                continue
            choice = next((choice for choice in node.choices if choice not in node.tried), None)
            if choice is not None:
                return node, choice
            if not node.last_resort:
                node.last_resort, node.choices = True, self._other_choices(node)
                self._put(node)
        return None

    def _tried(self, node: _Node, choice: Choice) -> _Node | None:
        """Try a move: the state that it leads to, if it can be carried out and leads anywhere."""
        node.tried.add(choice)
        done = self.world.relocate(node.state, *choice, self.rng)
        if isinstance(done, Done):
            child = self._node(done.after, (*node.moves, Step(choice, done.after)))
            if child is not None:
                child.asked = child.plans[0].length > 0
                child.back = node.back + (len(node.tried) + self.effort.choosy if done.tight else 0)
            return child
        if self.world.out_of_reach(node.state, choice[0]):
            node.cannot |= {choice[0]}  # something else must go first
            self._think(node)
        return None

    def _put(self, node: _Node | None) -> None:
        if node is not None and node.fewest <= self.most:
            rank = node.fewest + self.effort.step_back * (node.back + len(node.tried))
            heappush(self._queue, (rank, -len(node.moves), next(self._ticket), node))

    def _node(self, state: State, moves: tuple[Step, ...]) -> _Node | None:
        """The node of a state; None when more moves are needed than are left, or none helps."""
        seen = observe(self.world.scene, state)
        node = _Node(state, moves, seen, self.preferences.objects(seen))
        self._think(node)
        return node if node.plans else None

    def _think(self, node: _Node) -> None:
        """Find a node's shortest relaxed plans and, from them, its most promising moves."""
        plans = relaxed_plans(
            self.world.obstructions(node.state.poses), self.target, node.standing,
            most=self.most - len(node.moves), not_first=node.cannot, cost=node.cost,
        )  # fmt: skip
        found = shortest_plans(plans)
        if found:
            node.plans = found
            node.choices = self._choices(node)
        elif node.plans:  # without what the arm does not get to, there is no plan, but perhaps a detour
            node.last_resort, node.choices = True, self._other_choices(node)

    def _choices(self, node: _Node) -> Iterator[Choice]:
        """The moves of a shortest relaxed plan's first object to where the rest of that plan, or of another as short, still holds."""
        return _in_turn([choices for _, choices in self._leading(node)])

    def _leading(self, node: _Node) -> list[tuple[str, Iterator[Choice]]]:
        """The same for each such object."""
        names = sorted({name for plan in node.plans for name in plan.firsts}, key=lambda name: (node.cost(name), name))
        return [(name, self._leading_on(node.state, node.seen, node.plans, name)) for name in names]

    def _leading_on(self, state: State, seen: Observation, plans: Sequence[RelaxedPlan], name: str) -> Iterator[Choice]:
        """Of a node's, whose choices they are: they don't refer to it, or neither would be gone before the garbage collector comes."""
        standing = frozenset(seen.movable)
        for region in self.preferences.regions_with(plans[0].length)(seen, name, self.rng):
            there = {**state.poses, name: self.world.place_pose(name, state.poses[name], region)}
            if gets_shorter(self.world.obstructions(there), self.target, standing, plans, name):
                yield name, region

    def _other_choices(self, node: _Node) -> Iterator[Choice]:
        """All moves of all objects that can be picked: what makes room, or a detour."""
        obstructions = self.world.obstructions(node.state.poses)
        names = [n for n in node.seen.movable if n not in node.cannot and obstructions.free(n, node.standing - {n})]
        firsts = {name for plan in node.plans for name in plan.firsts}
        names.sort(key=lambda name: (name not in firsts, node.cost(name), name))
        return _in_turn([self._anywhere(node.seen, name) for name in names])

    def _anywhere(self, seen: Observation, name: str) -> Iterator[Choice]:
        for region in self.preferences.regions(seen, name, self.rng):
            yield name, region


def _in_turn(queues: Sequence[Iterator[Choice]]) -> Iterator[Choice]:
    """One of each in turn, until all are used up."""
    waiting = list(queues)
    while waiting:
        left = []
        for queue in waiting:
            choice = next(queue, None)
            if choice is not None:
                left.append(queue)
                yield choice
        waiting = left
