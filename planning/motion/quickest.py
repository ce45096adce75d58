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

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.scene import State
from kinematics.transforms import Array
from planning.motion.carry import Carry, setting_out
from planning.motion.picking import Pick
from planning.motion.placing import Place
from planning.motion.smoothing.estimates import Limits, polyline_s, straight_s
from planning.motion.workcell import PlanningQuery, Workcell
from planning.plan import Blocked

DETOUR, DETOUR_S, FLIP, FLIP_S = 1.15, 0.25, 1.5, 1.2
"""What a way that is not straight is taken to need until it is planned: so many times the straight one's time, and seconds more; beyond
FLIP_S, where arms turn into another branch as a rule, so many times as much again."""
PUT_DOWN_S = 0.9
"""Lowering and retreating, until these are known."""
WORTH = 1.2
"""A way that was planned anew is made quicker only if it takes no more than so many times what the quickest takes already."""
DOUBT = 0.7
"""A way that nobody has looked at is taken to need so much more than the straight one, as a share of what a detour takes more."""
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

    pick_of (N,): the pick of each node. ends, leaves (N, A): where its transfer ends and where the arm is afterwards, about until it is
    known. across_s, put_s (N,): seconds of transfer, and of what follows; known (N,): of the transfer. transit_s, transit_known (M, P): the
    same of the ways from the M nodes of the layer before to the P picks. sure_s (N,), sure_transit_s (M, P): the same, but infinite where
    not known.
    """

    def __init__(self, choices: Choices, lower: Array, upper: Array, limits: Limits) -> None:
        self.choices, self.limits, found = choices, limits, choices.found
        kinds = [(found.pick, found.pick), *((turned, pick) for pick in choices.picks for turned in pick.turned(lower, upper))]
        self.picks, self.as_found = [turned for turned, _ in kinds], [pick for _, pick in kinds]
        known_ends = {id(pick): choices.ends(pick) for pick in self.as_found}
        ends = [_nearest_turns(known_ends[id(pick)], turned.lift[-1], lower, upper) for turned, pick in kinds]
        self.pick_of = np.concatenate([[0], np.repeat(np.arange(len(ends)), [len(e) for e in ends])])
        self.ends = np.concatenate([found.across[-1:], *ends])
        self.solution = np.concatenate([[-1], *(np.arange(len(e)) for e in ends)]).astype(np.int64)
        self.grasp = np.array([id(pick.grasp) for pick in self.picks])[self.pick_of]
        self.leaves = self.ends.copy()
        self.enter, self.lifted = (np.array([getattr(p, way)[i] for p in self.picks]) for way, i in (("approach", 0), ("lift", -1)))
        at = np.array([pick.lift[0] for pick in self.picks])
        self.taking_s = straight_s(self.enter - at, limits) + straight_s(self.lifted - at, limits)
        self.across_s = _hoped_s(straight_s(self.ends - self.lifted[self.pick_of], limits))
        self.put_s = np.full(len(self.ends), 0.0 if choices.put is None else PUT_DOWN_S)
        self.known, self.sure_s = np.zeros(len(self.ends), np.int64), np.full(len(self.ends), np.inf)
        self.places: dict[int, Place] = {}
        self.across: dict[int, Array] = {}
        self.transits: dict[tuple[int, int], Array] = {}
        self.transit_s, self.sure_transit_s, self.transit_known = np.zeros((0, 0)), np.zeros((0, 0)), np.zeros((0, 0), np.int64)

    def node_s(self, across_s: Array) -> Array:
        return np.asarray(self.taking_s[self.pick_of] + across_s + self.put_s)

    def settle(self, n: int, place: Place) -> None:
        """Node n's way down is known."""
        self.places[n], self.ends[n], self.leaves[n] = place, place.lower[0], place.retreat[-1]
        at = place.lower[-1]
        self.put_s[n] = straight_s(self.ends[n] - at, self.limits) + straight_s(self.leaves[n] - at, self.limits)
        self.across_s[n] = _hoped_s(straight_s(self.ends[n] - self.lifted[self.pick_of[n]], self.limits))

    def carry(self, before: int, n: int) -> Carry:
        p = int(self.pick_of[n])
        return Carry(self.picks[p], self.places.get(n), self.transits[before, p], self.across[n])


class _Graph:
    """All layers, the start before the first, and what looks at their edges."""

    def __init__(self, cell: Workcell, start: Array, choices: Sequence[Choices], rng: np.random.Generator) -> None:
        chain, limits = cell.arm.chain, cell.robot.arm_limits
        self.cell, self.start, self.limits, self.rng = cell, start, limits, rng
        self.layers = [_Layer(c, chain.lower, chain.upper, limits) for c in choices]
        self.settings = cell.settings.quickest
        self.planned = self.settings.planned * len(self.layers)
        for k, layer in enumerate(self.layers):
            found, leaves = layer.choices.found, self._leaves(k)
            layer.transit_s = _hoped_s(straight_s(layer.enter - leaves[:, None], limits))
            layer.transit_known, layer.sure_transit_s = np.zeros(layer.transit_s.shape, np.int64), np.full(layer.transit_s.shape, np.inf)
            self._know_transit(layer, (0, 0), found.way_in)
            if found.place is not None:
                layer.settle(0, found.place)
            self._know_across(layer, 0, found.across)
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
                self._know_transit(layer, (before, p), self._plan(self._moving(layer, p), self._leaves(k)[before], layer.enter[p]))
                return True
            if layer.known[n] == BENT:
                self._know_across(layer, n, self._plan(layer.picks[p].carrying, layer.lifted[p], layer.ends[n]))
                return True
        return False

    def polish(self, path: Sequence[int]) -> None:
        """Plan the ways of a path that are not straight anew, and make the quickest of each quicker."""
        for k, (before, n) in enumerate(zip([0, *path], path)):
            layer, p = self.layers[k], int(self.layers[k].pick_of[n])
            if len(layer.transits[before, p]) > 2:
                better = self._better(self._moving(layer, p), layer.transits[before, p])
                if self._opens(k, before, p, better) is not None:
                    layer.transits[before, p] = better
            if len(layer.across[n]) > 2:
                layer.across[n] = self._better(layer.picks[p].carrying, layer.across[n])

    def _better(self, query: PlanningQuery, path: Array) -> Array:
        best, misses = self.cell.quickened(query, path, self.rng), 0
        best_s, least_s = polyline_s(best, self.limits), float(straight_s(path[-1] - path[0], self.limits))
        for _ in range(self.settings.again):
            if misses == self.settings.patience or best_s - least_s < self.settings.gain_s:
                break
            misses += 1
            other = self.cell.connect_clear(query, path[0], path[-1], self.rng, self.settings.iterations)
            if other is None or polyline_s(other, self.limits) > WORTH * best_s:
                continue
            other = self.cell.quickened(query, other, self.rng)
            other_s = polyline_s(other, self.limits)
            misses = 0 if other_s < best_s - self.settings.gain_s else misses
            best, best_s = (other, other_s) if other_s < best_s else (best, best_s)
        return best

    def _leaves(self, k: int) -> Array:
        return self.layers[k - 1].leaves if k else self.start[None]

    def _leave_from(self, k: int, n: int) -> None:
        """Transits to layer k from node n of the layer before, which has become known."""
        layer = self.layers[k]
        fresh = layer.transit_known[n] == UNKNOWN
        layer.transit_s[n, fresh] = _hoped_s(straight_s(layer.enter - self.layers[k - 1].leaves[n], self.limits))[fresh]

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
            layer.settle(n, place)
            if k + 1 < len(self.layers):
                self._leave_from(k + 1, n)
        if self.cell.straight(layer.picks[p].carrying, layer.lifted[p], layer.ends[n]):
            self._know_across(layer, n, np.stack([layer.lifted[p], layer.ends[n]]))
        else:
            straight = straight_s(layer.ends[n] - layer.lifted[p], self.limits)
            layer.across_s[n], layer.known[n] = _detour_s(straight), BENT

    def _look_transit(self, k: int, before: int, p: int) -> None:
        layer, q = self.layers[k], self._leaves(k)[before]
        if self.cell.straight(self._moving(layer, p), q, layer.enter[p]):
            self._know_transit(layer, (before, p), self._opens(k, before, p, np.stack([q, layer.enter[p]])))
        else:
            layer.transit_s[before, p] = _detour_s(straight_s(layer.enter[p] - q, self.limits))
            layer.transit_known[before, p] = BENT

    def _opens(self, k: int, before: int, p: int, path: Array) -> Array | None:
        """A transit's path where the fingers can be set to the pick's opening."""
        layer = self.layers[k]
        state = layer.choices.before
        gripper = float(state.q[self.cell.robot.gripper_joint])
        if k:
            last = self.layers[k - 1]
            gripper = last.picks[last.pick_of[before]].gripper_open
        state = replace(state, q=self.cell.robot.with_arm(path[0], gripper))
        return None if isinstance(setting_out(self.cell, state, layer.picks[p], path), Blocked) else path

    def _plan(self, query: PlanningQuery, a: Array, b: Array) -> Array | None:
        if self.planned == 0:
            return None
        self.planned -= 1
        return self.cell.connect_clear(query, a, b, self.rng, self.settings.iterations)

    def _know_transit(self, layer: _Layer, key: tuple[int, int], path: Array | None) -> None:
        layer.transit_known[key] = KNOWN
        layer.transit_s[key] = layer.sure_transit_s[key] = np.inf if path is None else polyline_s(path, self.limits)
        if path is not None:
            layer.transits[key] = path

    def _know_across(self, layer: _Layer, n: int, path: Array | None) -> None:
        layer.known[n] = KNOWN
        layer.across_s[n] = layer.sure_s[n] = np.inf if path is None else polyline_s(path, self.limits)
        if path is not None:
            layer.across[n] = path


def quickest(cell: Workcell, start: Array, moves: Sequence[Choices], rng: np.random.Generator) -> list[Carry]:
    """For moves that follow one another from the arm's configuration `start` (A,), the ways that together take least time."""
    graph = _Graph(cell, start, moves, rng)
    enough_s = graph.settings.gain_s * len(moves)
    sure_s, path = graph.shortest(sure=True)
    for _ in range(graph.settings.looks):
        hoped_s, hopeful = graph.shortest()
        if hoped_s > sure_s - enough_s or not graph.look(hopeful):
            break
        sure_s, path = graph.shortest(sure=True)
    graph.polish(path)
    return [layer.carry(before, n) for layer, before, n in zip(graph.layers, [0, *path], path)]


def _detour_s(straight_s: Array) -> Array:
    """Seconds that a way is taken to need that is not straight, for seconds (...,) of the straight one."""
    return np.asarray(DETOUR * straight_s + DETOUR_S + FLIP * np.maximum(0.0, straight_s - FLIP_S))


def _hoped_s(straight_s: Array) -> Array:
    """Seconds that a way is taken to need which nobody has looked at."""
    return np.asarray(straight_s + DOUBT * (_detour_s(straight_s) - straight_s))


def _nearest_turns(solutions: Array, near: Array, lower: Array, upper: Array) -> Array:
    """Arm configurations (S, A), each joint by whole turns as near to `near` (A,) as limits allow."""
    best, far = solutions.copy(), np.abs(solutions - near)
    for by in (2 * np.pi, -2 * np.pi):
        other = solutions + by
        nearer = (np.abs(other - near) < far) & (other >= lower) & (other <= upper)
        best, far = np.where(nearer, other, best), np.where(nearer, np.abs(other - near), far)
    return best
