"""The ceiling: best-first search over objects and regions, every move tried with true motions, up to five moves.

A state's rank is the number of moves so far and the least number still to come: for each way to x_g, the objects that block its last
piece must go, and the best way needs the fewest. A state is not expanded at once: its moves come one by one, the most promising first, and
after each of them the state steps back behind those that look better.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count

import numpy as np

from kinematics.scene import State
from perception.observation import Observation, observe
from planning.motion.pick_place import Done, Motions
from planning.motion.picking import Pick
from planning.plan import Blocked
from planning.policies.regions import free_regions

MOST_MOVES = 5
ATTEMPTS = 600
"""Moves tried at most in one search, feasible or not; about ten seconds."""
STEP_BACK = 0.02
"""By how much a state's rank grows with each of its moves that was tried: after 50 of them one more move elsewhere looks as good."""

Choice = tuple[str, int]


@dataclass(frozen=True, eq=False)
class Node:
    """A state, the moves that led to it, and the moves from it that were not tried yet. needed: how many must follow, at least."""

    state: State
    moves: tuple[Choice, ...]
    needed: int
    choices: Iterator[Choice]


def search(motions: Motions, start: State, rng: np.random.Generator, *, attempts: int = ATTEMPTS, most: int = MOST_MOVES) -> list[Choice]:
    """Moves (object, region) after which the target can be taken out; empty when none were found in so many attempts."""
    target, ticket = motions.scene.target_name, count()
    ways, _ = motions.picks(State(start.q, {target: start.poses[target]}), target, [motions.scene.x_g])
    root = _node(motions, ways, start, (), rng)
    queue = [(float(root.needed), next(ticket), root)]
    while queue and attempts > 0:
        rank, _, node = heappop(queue)
        choice = next(node.choices, None)
        if choice is None:
            continue
        heappush(queue, (rank + STEP_BACK, next(ticket), node))
        attempts -= 1
        done = motions.relocate(node.state, *choice, rng)
        if isinstance(done, Blocked):
            continue
        child = _node(motions, ways, done.after, (*node.moves, choice), rng)
        if child.needed == 0 and isinstance(motions.retrieve_target(done.after, rng), Done):
            return list(child.moves)
        if len(child.moves) < most:
            heappush(queue, (float(len(child.moves) + max(1, child.needed)), next(ticket), child))
    return []


def _node(motions: Motions, ways: Sequence[Pick], state: State, moves: tuple[Choice, ...], rng: np.random.Generator) -> Node:
    blockers = blocking(motions, ways, state)
    return Node(state, moves, min((len(b) for b in blockers), default=len(state.poses)), _choices(motions, state, blockers, rng))


def blocking(motions: Motions, ways: Sequence[Pick], state: State) -> list[frozenset[str]]:
    """For each way to close the hand as x_g says, found in the cabinet with nothing but the target: the objects that block it."""
    found: list[set[str]] = [set() for _ in ways]
    for name, pose in state.poses.items():
        if name == motions.scene.target_name or not ways:
            continue
        reaching = motions.cell.problem({name: pose}, ways[0].gripper_open)
        for blockers, way in zip(found, ways):
            if any(motions.cell.edge(reaching, a, b) for a, b in zip(way.approach[:-1], way.approach[1:])):
                blockers.add(name)
    return [frozenset(b) for b in found]


def _choices(motions: Motions, state: State, blockers: list[frozenset[str]], rng: np.random.Generator) -> Iterator[Choice]:
    """The moves of a state, the most promising first: objects in turn, those first that block the ways with the fewest blockers."""
    seen = observe(motions.scene, state)
    fewest = min((len(b) for b in blockers), default=0)
    weight = {name: sum(2.0 ** (fewest - len(b)) for b in blockers if name in b) for name in seen.movable}
    names = sorted(seen.movable, key=lambda name: -weight[name])
    queues = [(name, iter(_regions(seen, name, rng))) for name in names if motions.picks(state, name)[0]]
    first = [q for q in queues if weight[q[0]] > 0]
    for group in (first, [q for q in queues if weight[q[0]] == 0]):
        while group:
            left = []
            for name, regions in group:
                region = next(regions, None)
                if region is not None:
                    left.append((name, regions))
                    yield name, region
            group = left


def _regions(seen: Observation, name: str, rng: np.random.Generator) -> Sequence[int]:
    """The free regions for an object, in random order."""
    return [int(i) for i in rng.permutation(free_regions(seen, name))]


class Plans:
    """The moves that a search found, kept while they can be carried out, searched for anew when one can't."""

    def __init__(self, motions: Motions) -> None:
        self.motions = motions
        self._next: list[Choice] = []
        self._seen: Observation | None = None
        self._in_vain: State | None = None

    def of(self, seen: Observation, rng: np.random.Generator) -> list[Choice]:
        if seen is not self._seen:
            moved = self._seen is not None and bool(self._next) and _stands_at(seen, *self._next[0])
            self._next = self._next[1:] if moved else []
            self._seen = seen
            if not self._next and not self._hopeless(self.motions.state):
                self._next = search(self.motions, self.motions.state, rng)
                self._in_vain = None if self._next else self.motions.state
        return self._next

    def _hopeless(self, state: State) -> bool:
        """Whether a search from this very state found nothing: the loop asks again at every step that it has."""
        return state is self._in_vain


def _stands_at(seen: Observation, name: str, region: int) -> bool:
    return bool(np.abs(seen.boxes[name][:2] - seen.regions[region, :2]).max() < 1e-6)


def make_search_object(plans: Plans) -> Callable[[Observation, np.random.Generator], Sequence[str]]:
    """select: the object that the search moves first; none when it found nothing."""

    def search_object(seen: Observation, rng: np.random.Generator) -> Sequence[str]:
        return [name for name, _ in plans.of(seen, rng)[:1]]

    return search_object


def make_search_region(plans: Plans) -> Callable[[Observation, str, np.random.Generator], Sequence[int]]:
    """place: the region that the search chose for its first move."""

    def search_region(seen: Observation, name: str, rng: np.random.Generator) -> Sequence[int]:
        return [region for chosen, region in plans.of(seen, rng)[:1] if chosen == name]

    return search_region
