"""The quickest of many ways to make moves that were found: grasps, branches of the arm, turns and ends chosen together.

A move is found with what came first. Here it is known which moves follow one another, and where each object ends stays as it is; all else
is chosen anew: with which grasp and which of the arm's solutions an object is taken, with which it is put down, where the target ends.
These are the nodes of a graph, a layer a move, and ways between them its edges, weighted by time. The shortest path is sought lazily: ways
are taken to be straight and free until a shortest path comes to use them; then they are looked at, and where they are not free they are
planned (LazySP; Dellin and Srinivasa 2016, A Unifying Formalism for Shortest Path Problems with Expensive Edge Evaluations). The moves as
they were found are a path of the graph, too, so the result takes no longer, as far as times are estimated well. What is planned here keeps
the wanted clearance, or is not used; and the search ends when what it may still gain is not worth another look.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from kinematics.scene import State
from kinematics.transforms import Array
from planning.motion.cell.queries import PlanningQuery
from planning.motion.cell.workcell import Workcell
from planning.motion.handling.carry import Carry, opens_on_the_way, setting_out
from planning.motion.handling.picking import Pick
from planning.motion.handling.placing import Place
from planning.motion.handling.turns import nearest_turns
from planning.motion.polishing import polished
from planning.motion.way_cost import WayCost
from planning.plan import Blocked

OPENING_S = 0.35
"""To set the fingers to an opening before the arm moves."""
PUT_DOWN_S = 0.9
"""Lowering and retreating, until these are known."""
HINTS = 3
"""So many known ways at most are what a way that is planned may begin with."""
UNKNOWN, BENT, KNOWN = 0, 1, 2


@dataclass(frozen=True, eq=False)
class Choices:
    """The ways to make one move.

    before: the state before it, as it was found; name: of the object; rest: poses of the others. found: the way that was found. picks: all
    that hold up to the static checks. ends: about where transfer may end, (S, A), for a pick. put: the way down from there, None when it is
    not free; None where nothing is put down.
    """

    before: State
    name: str
    rest: dict[str, Array]
    found: Carry
    picks: Sequence[Pick]
    ends: Callable[[Pick], Array]
    put: Callable[[Pick, Array], Place | None] | None


class _Layer:
    """The nodes of one move: a pick, and where its transfer ends. Node 0 is the way that was found.

    picks, as_found (P): each pick at every whole turn of its joints, and as it came. enter, lifted (P, A): where its approach begins and
    its lift ends. pick_of (N,): the pick of each node. ends, leaves (N, A): where its transfer ends and where the arm is afterwards, about
    until it is known. solution, grasp (N,): which of its pick's ends that is, and whose grasp: equal for nodes that differ by whole turns.
    entry, beginning (P, 3), ending, exit (N, 3): where the hand is at the picks' first and last waypoints, and at ends and leaves.
    taking_s (P,): what approach and lift cost; looked_at (P,): whether it is known how clear they keep. across_s, put_s (N,): what the
    transfer and what follows cost; known (N,): of the transfer. transit_s, transit_known (M, P): the same of the ways from the M nodes of
    the layer before to the P picks. sure_s (N,), sure_transit_s (M, P): the same, but infinite where not known. places, across, transits:
    the ways down and the transfers that are known, by node, and the ways to a pick, by the node before and the pick.
    """

    def __init__(self, choices: Choices, lower: Array, upper: Array, cost: WayCost) -> None:
        self.choices, self.cost, found = choices, cost, choices.found
        turned = [(found.pick, found.pick), *((other, pick) for pick in choices.picks for other in pick.turned(lower, upper))]
        self.picks, self.as_found = [other for other, _ in turned], [pick for _, pick in turned]
        self.enter = np.array([pick.approach[0] for pick in self.picks])
        taken = np.array([pick.lift[0] for pick in self.picks])
        self.lifted = np.array([pick.lift[-1] for pick in self.picks])
        # the nodes: the way that was found, then each pick with each end of its transfer
        ends_of = {pick: choices.ends(pick) for pick in dict.fromkeys(self.as_found)}
        ends = [ends_of[pick] for pick in self.as_found]
        pick_of = np.repeat(np.arange(len(ends)), [len(e) for e in ends])
        self.pick_of = np.append(0, pick_of)
        self.ends = np.concatenate([found.across[-1:], nearest_turns(np.concatenate(ends), self.lifted[pick_of], lower, upper)])
        self.leaves = self.ends.copy()
        self.solution = np.concatenate([[-1], *(np.arange(len(e)) for e in ends)]).astype(np.int64)
        self.grasp = np.array([id(pick.grasp) for pick in self.picks])[self.pick_of]
        # where the hand is
        self.entry, self.exit, self.beginning, self.ending = (cost.points(q) for q in (self.enter, self.leaves, self.lifted, self.ends))
        # what all that costs, as hoped for until it is looked at; the ways to the picks are `_Graph`'s
        self.taking_s = cost.straight(self.enter - taken) + cost.straight(self.lifted - taken)
        self.looked_at = np.zeros(len(self.picks), np.bool_)
        self.across_s = cost.hoped(self.ends - self.lifted[self.pick_of], self.ending - self.beginning[self.pick_of])
        self.put_s = np.full(len(self.ends), 0.0 if choices.put is None else PUT_DOWN_S)
        self.known, self.sure_s = np.zeros(len(self.ends), np.int64), np.full(len(self.ends), np.inf)
        self.transit_s, self.sure_transit_s, self.transit_known = np.zeros((0, 0)), np.zeros((0, 0)), np.zeros((0, 0), np.int64)
        # the ways that are known
        self.places: dict[int, Place] = {}
        self.across: dict[int, Array] = {}
        self.transits: dict[tuple[int, int], Array] = {}

    def node_s(self, across_s: Array) -> Array:
        return np.asarray(self.taking_s[self.pick_of] + across_s + self.put_s)

    def settle(self, n: int, place: Place, more_s: float) -> None:
        """Node n's way down is known, and counts so many seconds more than it takes."""
        self.places[n], self.ends[n], self.leaves[n] = place, place.lower[0], place.retreat[-1]
        at, cost = place.lower[-1], self.cost
        self.ending[n], self.exit[n] = cost.points(np.array([self.ends[n], self.leaves[n]]))
        self.put_s[n] = cost.straight(self.ends[n] - at) + cost.straight(self.leaves[n] - at) + more_s
        self.across_s[n] = cost.hoped(*self.across_by(n))

    def across_by(self, n: int) -> tuple[Array, Array]:
        """What the joints turn in node n's transfer (A,), and how the hand moves (3,)."""
        p = self.pick_of[n]
        return self.ends[n] - self.lifted[p], self.ending[n] - self.beginning[p]

    def carry(self, before: int, n: int) -> Carry:
        p = int(self.pick_of[n])
        return Carry(self.picks[p], self.places.get(n), self.transits[before, p], self.across[n])


class _Graph:
    """All layers, the start before the first, and what looks at their edges."""

    def __init__(self, cell: Workcell, start: Array, choices: Sequence[Choices], rng: np.random.Generator) -> None:
        self.cell, self.start, self.rng = cell, start, rng
        self.settings, self.ends_m = cell.settings.quickest, cell.settings.clearance.ends_m
        chain, cost = cell.arm.chain, WayCost(cell.arm, cell.robot.arm_limits, self.settings.metre_s)
        retrieving = replace(cost, metre_s=self.settings.target_metre_s)
        self.layers = [_Layer(c, chain.lower, chain.upper, retrieving if c.put is None else cost) for c in choices]
        self.start_at = cost.points(start[None])
        self.planned = self.settings.planned * len(self.layers)
        self.surer = True  # whether more is known than when this was last set to False
        for k, layer in enumerate(self.layers):
            found = layer.choices.found
            layer.transit_s = layer.cost.hoped(*self._transit_by(k, slice(None), slice(None)))
            layer.transit_known, layer.sure_transit_s = np.zeros(layer.transit_s.shape, np.int64), np.full(layer.transit_s.shape, np.inf)
            self._know_transit(layer, (0, 0), found.way_in, self._tight_s((self._moving(layer, 0), found.way_in)))
            self._look_pick(k, 0)
            if found.place is not None:
                self._settle(k, 0, found.place)
            self._know_across(layer, 0, found.across, self._tight_s((found.pick.carrying, found.across)))
        for k in range(1, len(self.layers)):
            self._leave_from(k, 0)

    def shortest(self, *, sure: bool = False) -> tuple[float, list[int]]:
        """The seconds of a shortest path, and its node in each layer, as far as times are known; sure: among what is known alone."""
        best, before = np.zeros(1), list[Array]()
        for layer in self.layers:
            total = best[:, None] + (layer.sure_transit_s if sure else layer.transit_s)
            first = total.argmin(0)
            before.append(first[layer.pick_of])
            best = total[first, np.arange(len(first))][layer.pick_of] + layer.node_s(layer.sure_s if sure else layer.across_s)
        path = [int(best.argmin())]
        for first in before[:0:-1]:
            path.append(int(first[path[-1]]))
        return float(best.min()), path[::-1]

    def look(self, path: Sequence[int]) -> bool:
        """Look at what is not known about a path: at all that is taken to be straight and free, or else plan one way that is not straight.
        Whether there was anything to look at."""
        todo = [(k, before, n) for k, (before, n) in enumerate(zip([0, *path], path))]
        fresh = False
        for k, before, n in todo:
            layer = self.layers[k]
            if not layer.looked_at[layer.pick_of[n]]:
                self._look_pick(k, int(layer.pick_of[n]))
                fresh = True
            if layer.known[n] == UNKNOWN:
                self._look_across(k, n)
                fresh = True
            if layer.transit_known[before, layer.pick_of[n]] == UNKNOWN:
                self._look_transit(k, before, int(layer.pick_of[n]))
                fresh = True
        if fresh:
            return True
        for k, before, n in todo:
            layer, p = self.layers[k], int(self.layers[k].pick_of[n])
            if layer.transit_known[before, p] == BENT:
                way = self._plan(self._moving(layer, p), self._leaves(k)[before], layer.enter[p], layer.transits.values())
                self._know_transit(layer, (before, p), None if way is None else self._opens(k, before, p, way))
                return True
            if layer.known[n] == BENT:
                way = self._plan(layer.picks[p].carrying, layer.lifted[p], layer.ends[n], layer.across.values())
                self._know_across(layer, n, way)
                return True
        return False

    def polish(self, path: Sequence[int]) -> None:
        """Plan the ways of a path that are not straight anew, and make the quickest of each quicker."""
        for k, (before, n) in enumerate(zip([0, *path], path)):
            layer, p = self.layers[k], int(self.layers[k].pick_of[n])
            if len(layer.transits[before, p]) > 2:
                opening_s = partial(self._opening_s, k, before, p)
                better = polished(self.cell, layer.cost, self._moving(layer, p), layer.transits[before, p], self.rng, opening_s)
                if self._opens(k, before, p, better) is not None:
                    layer.transits[before, p] = better
            if len(layer.across[n]) > 2:
                layer.across[n] = polished(self.cell, layer.cost, layer.picks[p].carrying, layer.across[n], self.rng)

    def _leaves(self, k: int) -> Array:
        return self.layers[k - 1].leaves if k else self.start[None]

    def _leave_from(self, k: int, n: int) -> None:
        """Transits to layer k from node n of the layer before, which has become known."""
        layer = self.layers[k]
        fresh = layer.transit_known[n] == UNKNOWN
        layer.transit_s[n, fresh] = layer.cost.hoped(*self._transit_by(k, n, fresh))

    def _transit_by(self, k: int, before: Any, picks: Any) -> tuple[Array, Array]:
        """What the joints turn (..., A) in transits to layer k from nodes before it to picks, and how the hand moves (..., 3)."""
        layer, exits = self.layers[k], self.layers[k - 1].exit if k else self.start_at
        return layer.enter[picks] - self._leaves(k)[before, None], layer.entry[picks] - exits[before, None]

    def _look_pick(self, k: int, p: int) -> None:
        """How clear the straight ways of a pick keep, whichever turns its joints are at."""
        layer, pick = self.layers[k], self.layers[k].as_found[p]
        more_s = self._tight_s((self._moving(layer, p), pick.approach), (pick.lifting, pick.lift))
        same = np.array([other is pick for other in layer.as_found])
        layer.taking_s[same] += more_s
        layer.looked_at[same] = self.surer = True

    def _settle(self, k: int, n: int, place: Place) -> None:
        layer = self.layers[k]
        pick, ways = layer.picks[layer.pick_of[n]], [(layer.picks[layer.pick_of[n]].lifting, place.lower)]
        if k + 1 < len(self.layers):
            ways.append((self.cell.problem(self.layers[k + 1].choices.before.poses, pick.gripper_open), place.retreat))
        layer.settle(n, place, self._tight_s(*ways))

    def _tight_s(self, *ways: tuple[PlanningQuery, Array]) -> float:
        """What straight ways (K, A) count more because one of them comes nearer to something than it should."""
        return 0.0 if all(self.cell.keeps(query, way, self.ends_m) for query, way in ways) else self.settings.tight_s

    def _straight(self, query: PlanningQuery, a: Array, b: Array) -> tuple[Array | None, float]:
        """The straight way from a to b (A,) if it is free and clear enough, and what it counts more than it takes."""
        for ends_m, more_s in ((self.ends_m, 0.0), (self.cell.settings.clearance.least_m, self.settings.tight_s)):
            if self.cell.straight(query, a, b, ends_m):
                return np.array([a, b]), more_s
        return None, 0.0

    def _moving(self, layer: _Layer, p: int) -> PlanningQuery:
        return self.cell.problem(layer.choices.before.poses, layer.picks[p].gripper_open)

    def _look_across(self, k: int, n: int) -> None:
        layer, put = self.layers[k], self.layers[k].choices.put
        p = int(layer.pick_of[n])
        if put is not None and n not in layer.places:
            place = put(layer.as_found[p], layer.ends[n])
            if place is None:  # nor are those that differ by whole turns
                same = (layer.solution == layer.solution[n]) & (layer.grasp == layer.grasp[n]) & (layer.known == UNKNOWN)
                layer.across_s[same], layer.known[same] = np.inf, KNOWN
                return
            self._settle(k, n, place)
            if k + 1 < len(self.layers):
                self._leave_from(k + 1, n)
        path, more_s = self._straight(layer.picks[p].carrying, layer.lifted[p], layer.ends[n])
        if path is not None:
            self._know_across(layer, n, path, more_s)
        else:
            layer.across_s[n], layer.known[n] = layer.cost.detour(*layer.across_by(n)), BENT

    def _look_transit(self, k: int, before: int, p: int) -> None:
        layer, q = self.layers[k], self._leaves(k)[before]
        path, more_s = self._straight(self._moving(layer, p), q, layer.enter[p])
        if path is not None:
            self._know_transit(layer, (before, p), self._opens(k, before, p, path), more_s)
        else:
            by, way = self._transit_by(k, before, p)
            layer.transit_s[before, p], layer.transit_known[before, p] = layer.cost.detour(by, way)[0], BENT

    def _opens(self, k: int, before: int, p: int, path: Array) -> Array | None:
        """A transit's path where the fingers can be set to the pick's opening."""
        layer = self.layers[k]
        state = replace(layer.choices.before, q=self.cell.robot.with_arm(path[0], self._gripper(k, before)))
        return None if isinstance(setting_out(self.cell, state, layer.picks[p], path), Blocked) else path

    def _opening_s(self, k: int, before: int, p: int, path: Array) -> float:
        """What a transit counts more than it takes where the fingers are to be set to the pick's opening before."""
        poses, opened = self.layers[k].choices.before.poses, self.layers[k].picks[p].gripper_open
        return 0.0 if opens_on_the_way(self.cell, poses, path, self._gripper(k, before), opened) else OPENING_S

    def _gripper(self, k: int, before: int) -> float:
        """The gripper's value before a transit to layer k."""
        if not k:
            return float(self.layers[k].choices.before.q[self.cell.robot.gripper_joint])
        last = self.layers[k - 1]
        return float(last.picks[last.pick_of[before]].gripper_open)

    def _plan(self, query: PlanningQuery, a: Array, b: Array, known: Iterable[Array]) -> Array | None:
        """Plan a way from a to b (A,); it may go where known ones go, those first whose ends are nearest."""
        if self.planned == 0:
            return None
        self.planned -= 1
        weight = query.task.exact.weight
        near = sorted(known, key=lambda way: np.linalg.norm(weight * (way[0] - a)) + np.linalg.norm(weight * (way[-1] - b)))
        return self.cell.connect_clear(query, a, b, self.rng, self.settings.iterations, near[:HINTS])

    def _know_transit(self, layer: _Layer, key: tuple[int, int], path: Array | None, more_s: float = 0.0) -> None:
        layer.transit_known[key] = KNOWN
        layer.transit_s[key] = layer.sure_transit_s[key] = np.inf if path is None else layer.cost.path(path) + more_s
        if path is not None:
            layer.transits[key], self.surer = path, True

    def _know_across(self, layer: _Layer, n: int, path: Array | None, more_s: float = 0.0) -> None:
        layer.known[n] = KNOWN
        layer.across_s[n] = layer.sure_s[n] = np.inf if path is None else layer.cost.path(path) + more_s
        if path is not None:
            layer.across[n], self.surer = path, True


def quickest(cell: Workcell, start: Array, moves: Sequence[Choices], rng: np.random.Generator) -> list[Carry]:
    """For moves that follow one another from the arm's configuration `start` (A,), the ways that together take least time."""
    graph = _Graph(cell, start, moves, rng)
    enough_s = graph.settings.gain_s * len(moves)
    sure_s, path = graph.shortest(sure=True)
    for _ in range(graph.settings.looks):
        hoped_s, hopeful = graph.shortest()
        graph.surer = False
        if hoped_s > sure_s - enough_s or not graph.look(hopeful):
            break
        if graph.surer:
            sure_s, path = graph.shortest(sure=True)
    graph.polish(path)
    return [layer.carry(before, n) for layer, before, n in zip(graph.layers, [0, *path], path)]
