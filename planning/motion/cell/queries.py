"""A motion query: what moves and what stands, packed for the compiled core, and the names that turn its answers back into words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from kinematics.collision import edge_problem
from kinematics.collision.edge_problem import Problem
from planning.motion.search.edges import Task
from planning.motion.search.reaching import HANGS_OVER
from planning.plan import PLACE_OUT_OF_REACH, Blocked


@dataclass(frozen=True)
class CollisionPair:
    """What is in the way: a link or the held object, and what it touches."""

    link: str | None = None
    body: str | None = None
    detail: str | None = None


class PlanningQuery(NamedTuple):
    """One motion query: what moves and what stands, packed for the compiled core, with the names behind the indices.

    off_m: what moves is no further than that from where it may be, so any clearance has to be so much more.
    """

    task: Task
    names: tuple[str, ...]
    off_m: float = 0.0

    @property
    def problem(self) -> Problem:
        """The same query for the exact test alone."""
        return self.task.exact

    @property
    def parts(self) -> int:
        """How many of the names are of what moves; those after them are of what stands."""
        return len(self.task.world.check)

    def solids_of(self, body: str) -> list[int]:
        """Which of the solids that stand are the body's."""
        return [i for i, name in enumerate(self.names[self.parts :]) if name == body]

    def allowing(self, a: str, b: str) -> PlanningQuery:
        """The same query, but link or held object a may touch body b."""
        (task, names, off_m), P = self, self.parts
        problem, world = task.exact, task.world
        first, second = (np.array([n == name for n in names]) for name in (a, b))
        first[P:] = second[:P] = False  # a mover and what stands: their names are of two spaces
        kept = ~(first[problem.pairs[:, 0]] & second[problem.pairs[:, 1]])
        problem = edge_problem.some_pairs(problem, kept)
        check = np.where(first[:P, None] & second[P:], np.uint8(0), world.check)
        return PlanningQuery(task._replace(exact=problem, world=world._replace(check=check)), names, off_m)


class ContactQuery(NamedTuple):
    """A question about single configurations: what may not touch, packed for the exact test alone, with the names behind the indices."""

    problem: Problem
    names: tuple[str, ...]


def pair_of(query: PlanningQuery | ContactQuery, pair: int) -> CollisionPair | None:
    """The bodies behind the index of a pair; None behind -1."""
    if pair < 0:
        return None
    a, b = query.problem.pairs[pair, :2]
    return CollisionPair(query.names[a], query.names[b])


def in_the_way(among: PlanningQuery | ContactQuery, pair: int) -> CollisionPair | None:
    """What `reaching.stands` found, in words; None when the object stands free."""
    if pair == HANGS_OVER:
        return CollisionPair(among.names[0], "floor", "it would hang over the front edge")
    return pair_of(among, pair)


def blocked(stage: str, query: PlanningQuery | ContactQuery, pair: int, name: str) -> Blocked:
    """What the compiled core found, in words: the stage and the two bodies, or that it was the arm's reach."""
    if stage == "ik":
        return Blocked("ik", "hand", name, detail=PLACE_OUT_OF_REACH)
    touch = in_the_way(query, pair) if stage == "region" else pair_of(query, pair)
    if touch is not None:
        return Blocked(stage, touch.link, touch.body, detail=touch.detail)
    return Blocked(stage, "hand", name, detail="the straight way is not free, or leaves the arm's reach")
