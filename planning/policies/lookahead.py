"""Policies that look ahead: a relaxed plan says what is worth a try, a search makes it true, a proof says when nothing helps.

When an object is asked for, the moves to the goal are searched for as a whole (planning.policies.search), with motions that were tried, and
handed out one by one. So the rules deep, region and strict come to the same, and choosing takes as long as the motions that it tries. A
policy that also has an eye for what to do, networks as a rule, glances first: if some way to the target is blocked by one object alone,
that object is proposed, to the best regions off that way, before any motion was tried.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from math import inf

import numpy as np

from kinematics.scene import State
from perception.observation import Observation
from planning.plan import Outlook
from planning.policies.hopeless import why_hopeless
from planning.policies.random import random_region
from planning.policies.regions import nearest_regions
from planning.policies.search import Effort, Preferences, Search, Step, World
from planning.policies.unsolvable import Finding
from planning.relaxed_plan import Names, relaxed_plan

GLANCED = 12
"""Regions that are proposed at a glance, and for each object where nothing but a guess is left."""
QUICKLY = 2 / 3
"""Share of all attempts that may be made with the grasps that are quick to sample."""
ONCE_MORE = 1 / 2
"""As many attempts more, as a share of all, may be made with the likeliest regions where near ones have not done."""
VARIED_SHARE = 1 / 10
"""Share of the attempts of a last search that are made before it with picks unlike one another."""
NEVER = inf
"""So many moves where no number of them does."""
Prove = Callable[[State], Finding]


NEAREST = Preferences(lambda seen: lambda name: 0.0, nearest_regions)
"""Any object, to the nearest regions."""
SCATTERED = replace(NEAREST, regions=random_region)
"""Any object, to any region: where the arm finds no way though nothing is in the way of the hand, near places change little."""


@dataclass(frozen=True, eq=False)
class _Look:
    """A look in which there is hope. share: of the attempts that are left; natural: whether grasps were sought as one would take them."""

    world: World
    share: float
    natural: bool = True


class Lookahead:
    """What is known about one scene: the moves to come, the fewest that are needed, and the proof, if there is one, that none help.

    most: how many moves there may be. prove: asked where no relaxed plan is found. glance: whether to propose before motions were tried.
    """

    def __init__(self, world: World, preferences: Preferences, effort: Effort, prove: Prove, *, most: int, glance: bool = False) -> None:
        self.world, self.preferences, self.effort, self.prove, self.most, self.glance = world, preferences, effort, prove, most, glance
        self.outlook = Outlook()
        self._target = world.scene.target_name
        self._state: State | None = None
        self._made = -1  # moves; states that were seen, less the first
        self._coming: list[Step] = []
        self._regions: Iterator[int] = iter(())

    def select(self, seen: Observation, rng: np.random.Generator) -> Iterator[str]:
        """The object of the next move that was foreseen; else those seen at a glance, and at last that of the moves that a search finds."""
        fresh = self._follow(self.world.state)
        if fresh and self.glance and not self._coming:
            yield from self._glanced(seen, rng)
        if not self._coming:
            self._coming = self._searched(seen, rng)
        for step in self._coming[:1]:
            name, region = step.choice
            self._regions = iter((region,))
            yield name
        if not self._coming and self.world.partly_unseen:
            yield from self._guessed(seen, rng)

    def place(self, seen: Observation, name: str, rng: np.random.Generator) -> Iterator[int]:
        """The regions for the object that was selected last."""
        return self._regions

    def certain(self, name: str, region: int) -> bool:
        """Whether a move comes next of those that a search has found, motions and all: a glance may have proposed it in vain."""
        return bool(self._coming) and self._coming[0].choice == (name, region)

    def _follow(self, state: State) -> bool:
        """Note where things stand; whether that is news. What was foreseen is dropped when it did not come about."""
        if state is self._state:
            self._coming = []
            return False
        came_about = bool(self._coming) and self._coming[0].after is state
        self._coming = self._coming[1:] if came_about else []
        self._state = state
        self._made += 1
        return True

    def _glanced(self, seen: Observation, rng: np.random.Generator) -> Iterator[str]:
        """The objects that alone block a way to the target."""
        assert self._state is not None
        blockers = self.world.obstructions(self._state.poses, roughly=True).blockers(self._target, frozenset(seen.movable))
        names = [name for blocking in blockers if len(blocking) == 1 for name in blocking]
        if not names:
            return
        self._needed(1)
        if len(names) > 1:
            cost = self.preferences.objects(seen)
            names.sort(key=lambda name: (cost(name), name))
        for name in names:
            self._regions = islice(self._off_the_way(seen, name, rng), GLANCED)
            yield name

    def _guessed(self, seen: Observation, rng: np.random.Generator) -> Iterator[str]:
        """The objects that go first in a shortest relaxed plan if all unseen space were free, to where the plan gets shorter: what stops
        them says where to look next."""
        assert self._state is not None
        for world in (self.world.if_free, self.world.if_free.thorough, self.world.if_free.exhaustive):
            search = Search(world, self.preferences, self.effort, self.most - self._made, rng)
            if leading := search.leading(self._state):
                for name, regions in leading:
                    self._regions = islice(regions, GLANCED)
                    yield name
                return

    def _off_the_way(self, seen: Observation, name: str, rng: np.random.Generator) -> Iterator[int]:
        """The regions for an object where the target could be picked."""
        assert self._state is not None
        poses = self._state.poses
        for region in self.preferences.regions_with(1)(seen, name, rng):
            there = {**poses, name: self.world.place_pose(name, poses[name], region)}
            if self.world.obstructions(there, roughly=True).free(self._target, frozenset(seen.movable)):
                yield region

    def _searched(self, seen: Observation, rng: np.random.Generator) -> list[Step]:
        """The moves that a search finds with the looks that hold out hope, a slow one only where the arm gets to what keeps the target in;
        and at last in other orders."""
        assert self._state is not None
        state, left, attempts = self._state, self.most - self._made, self.effort.attempts
        hopeful: _Look | None = None
        for hopeful in self._looks(state, frozenset(seen.movable), left):
            if hopeful.world is not self.world and self._is_hopeless(hopeful.world, state):
                return []
            search = Search(hopeful.world, self.preferences, replace(self.effort, attempts=round(hopeful.share * attempts)), left, rng)
            if found := search.run(state):
                return found
            attempts -= search.tried
        if hopeful is None:
            return []
        return self._searched_at_last(hopeful, state, left, rng)

    def _is_hopeless(self, look: World, state: State) -> bool:
        """Whether what keeps the target in is where the arm does not get to: asked before a slower look; not where unseen space may be
        why."""
        why = None if self.world.partly_unseen else why_hopeless((look, self.world.thorough, self.world.varied), state)
        if why is not None:
            self.outlook = replace(self.outlook, undecided=why)
        return why is not None

    def _looks(self, state: State, standing: Names, left: int) -> Iterator[_Look]:
        """The looks in which so many moves as are left do, if what is moved vanished: with the grasps that are quick to sample, and with
        many more; where neither holds out hope, with as many as can be; where no number of moves does, with hands that a proof was missed
        by."""
        hope = False
        for world, share in ((self.world, QUICKLY), (self.world.thorough, 1.0)):
            if self._fewest(world, state, standing) <= left:
                hope = True
                yield _Look(world, share)
        if hope:
            return
        fewest, last = self._fewest(self.world.exhaustive, state, standing), self.world.exhaustive
        if fewest == NEVER and not self._unseen_is_why(state, standing) and (missed := self._missed_by(state)) is not None:
            fewest, last = self._fewest(missed, state, standing), missed
        if fewest <= left:
            yield _Look(last, 1.0, natural=False)

    def _unseen_is_why(self, state: State, standing: Names) -> bool:
        """Whether there is hope if unseen space is free, where there is none as it is solid."""
        if not self.world.partly_unseen:
            return False
        return relaxed_plan(self.world.if_free.exhaustive.obstructions(state.poses), self._target, standing) is not None

    def _fewest(self, world: World, state: State, standing: Names) -> float:
        """How many moves do at least, by a relaxed plan; NEVER where there is none."""
        plan = relaxed_plan(world.obstructions(state.poses), self._target, standing)
        if plan is None:
            return NEVER
        self._needed(plan.length)
        return plan.length

    def _missed_by(self, state: State) -> World | None:
        """The look with the hands that were found where a proof was sought that there is no hope; None where none were. What is proved of
        objects that were moved is no proof for the scene."""
        found, first = self.prove(state), self.world.scene.poses()
        proof, undecided = found.unsolvable, found.undecided
        if proof is not None and not all(np.array_equal(state.poses[name], first[name]) for name in proof.stuck):
            undecided, proof = f"{proof.words}, where they stand after moves", None
        self.outlook = replace(self.outlook, unsolvable=proof, undecided=undecided)
        return found.hope

    def _searched_at_last(self, hopeful: _Look, state: State, left: int, rng: np.random.Generator) -> list[Step]:
        """The moves to the likeliest regions, not the near ones first; if there are none of them, those with picks unlike one another; and
        if these don't do, either, those that many attempts find as the ceiling makes them, or the ceiling itself to any regions (none where
        only the densest grasps hold out hope: each takes its time)."""
        world, likeliest, few = hopeful.world, replace(self.preferences, nearby=None), round(ONCE_MORE * self.effort.attempts)
        others, many = SCATTERED if self.preferences is NEAREST else NEAREST, 0 if world.partly_unseen else self.effort.last
        searches = (
            (world, likeliest, few if self.preferences.nearby else 0),
            (world.varied, NEAREST, round(VARIED_SHARE * many)),
            (world, others, many if hopeful.natural else 0),
        )
        for look, preferences, attempts in searches:
            if attempts and (found := Search(look, preferences, replace(self.effort, attempts=attempts), left, rng).run(state)):
                return found
        return []

    def _needed(self, moves: int) -> None:
        """So many moves are needed from the first state, if this is the first, at least."""
        if self._made == 0:
            self.outlook = replace(self.outlook, least_moves=moves)
