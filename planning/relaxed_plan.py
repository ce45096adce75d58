"""Relaxed plans: which objects must go, in which order, if every object that is moved vanished (delete relaxation).

The relaxation forgets where a moved object is put, and it asks about straight pieces only, not about RRT-Connect. So it is never harder
than the truth, and its shortest plan is a lower bound on the moves of every true plan: let M be the objects that a true plan moves, in the
order in which each is moved for the first time. At its first move an object stands where it stood at the beginning, and so do all objects
that were not moved before it; what the arm could do among more objects it can do among fewer. So the objects of M vanish in that order in
the relaxed problem, too, and a true plan has at least as many moves as M has members.

Plans are found by regression from the target. A set of objects that contains the blockers of one way to the target is emptied as far as it
goes; where it gets stuck, some object of the rest must get a way that leads around the rest, and the blockers of that way join the set.
Sets are looked at in the order of their sizes, so the first that can be emptied is a smallest one.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from typing import Protocol

Names = frozenset[str]
NOTHING: Names = frozenset()
MOST_SETS = 20_000
"""Sets of objects that one question may look at; no scene of the shipped specs comes near."""


class Obstructions(Protocol):
    """What stands in the way of what in one state. `standing` are objects besides the target, which never goes before its turn."""

    def free(self, name: str, standing: Names) -> bool:
        """Whether the object (or the target) can be picked while only `standing`, itself and the target stand."""
        ...

    def blockers(self, name: str, standing: Names) -> Collection[Names]:
        """For the ways to pick an object, the sets of objects of `standing` that block each: the smallest sets only, none containing
        another. Empty when there is no way even in the empty cabinet."""
        ...


@dataclass(frozen=True)
class RelaxedPlan:
    """Objects that vanish one after the other, after which the target can be picked. firsts: those of them that can go first."""

    order: tuple[str, ...]
    firsts: tuple[str, ...]

    @property
    def length(self) -> int:
        """How many objects go."""
        return len(self.order)


def relaxed_plans(
    obstructions: Obstructions,
    target: str,
    standing: Names,
    *,
    most: int | None = None,
    not_first: Names = NOTHING,
    cost: Callable[[str], float] = lambda _: 0.0,
    most_sets: int = MOST_SETS,
) -> Iterator[RelaxedPlan]:
    """Yield relaxed plans, the shortest first, each for another set of objects; among plans of one length, the cheapest set first.

    most: the longest plan that is of interest. not_first: objects that can't go first, whatever their ways say (the arm does not get to
    them). cost: what it costs to move an object, for ties only. The iterator ends after `most_sets` sets.
    """
    queue: list[tuple[int, float, tuple[str, ...], Names]] = []
    known = set[Names]()

    def put(goners: Names) -> None:
        if goners not in known and (most is None or len(goners) <= most):
            known.add(goners)
            names = tuple(sorted(goners))
            heappush(queue, (len(goners), sum(map(cost, names)), names, goners))

    for blockers in obstructions.blockers(target, standing):
        put(blockers)
    for _ in range(most_sets):
        if not queue:
            return
        *_, goners = heappop(queue)
        order, firsts = _removal(obstructions, goners, standing, not_first, cost)
        if len(order) == len(goners):
            yield RelaxedPlan(order, firsts)
            continue
        stuck = goners.difference(order)
        for name in sorted(stuck):
            for blockers in obstructions.blockers(name, standing - {name}):
                if not blockers & stuck:  # whichever of the stuck goes first, none of them has made way for it
                    put(goners | blockers)
        if not order:  # what can't go first has to wait for something else, whatever that is
            waiting = {name for name in stuck & not_first if obstructions.free(name, standing - {name})}
            for name in sorted(standing - goners - not_first) if waiting else ():
                if obstructions.free(name, standing - {name}):
                    put(goners | {name})


def relaxed_plan(obstructions: Obstructions, target: str, standing: Names, *, most: int | None = None) -> RelaxedPlan | None:
    """A shortest relaxed plan; None when there is none of at most `most` objects."""
    return next(relaxed_plans(obstructions, target, standing, most=most), None)


def shortest_plans(plans: Iterator[RelaxedPlan]) -> list[RelaxedPlan]:
    """All plans of an iterator, shortest first, that are as short as its first one."""
    found: list[RelaxedPlan] = []
    for plan in plans:
        if found and plan.length > found[0].length:
            break
        found.append(plan)
    return found


def still_holds(obstructions: Obstructions, target: str, standing: Names, order: Sequence[str]) -> bool:
    """Whether objects can go in an order, and the target after them."""
    for name in order:
        standing -= {name}
        if not obstructions.free(name, standing):
            return False
    return obstructions.free(target, standing)


def gets_shorter(there: Obstructions, target: str, standing: Names, plans: Sequence[RelaxedPlan], name: str) -> bool:
    """Whether an object's move makes the relaxed plan shorter. plans: all shortest ones before it, which are of one length; there: the
    obstructions once the object has moved.

    It does only if the object goes first in one of the plans: it, and a shorter plan after it, are a plan.
    """
    firsts = [plan for plan in plans if name in plan.firsts]
    if any(still_holds(there, target, standing, [n for n in plan.order if n != name]) for plan in firsts):
        return True
    most = plans[0].length - 1
    return bool(firsts) and most > 0 and relaxed_plan(there, target, standing, most=most) is not None


def stuck_set(obstructions: Obstructions, standing: Names) -> Names:
    """The largest set of objects of which none can be picked while only they and the target stand.

    It is what remains when everything goes that can, in any order: whatever goes first never blocks what goes later.
    """
    stuck = set(standing)
    while gone := {name for name in sorted(stuck) if obstructions.free(name, frozenset(stuck - {name}))}:
        stuck -= gone
    return frozenset(stuck)


def _removal(
    obstructions: Obstructions, goners: Names, standing: Names, not_first: Names, cost: Callable[[str], float]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The order in which objects can go while all others stay, the cheapest that can go in front, as far as it goes; and which of them
    can go first. What can go at a moment can still go later, so no order gets further."""
    order: list[str] = []
    here, left = set(standing), sorted(goners, key=lambda name: (cost(name), name))
    firsts = tuple(name for name in left if name not in not_first and obstructions.free(name, frozenset(here - {name})))
    while left:
        free = firsts if not order else (name for name in left if obstructions.free(name, frozenset(here - {name})))
        name = next(iter(free), None)
        if name is None:
            break
        order.append(name)
        left.remove(name)
        here.remove(name)
    return tuple(order), firsts
