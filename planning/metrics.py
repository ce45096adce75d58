"""The columns of the paper's Table I from plans: success with its interval, objects moved, times, hand travel, return.

The paper gives means over *successful* runs; those flatter a weak planner, which succeeds on easy scenes only, so the same columns over all
scenes stand beside them. Planners that ran on the same scenes are compared scene by scene.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple

from kinematics.mount import MOUNT
from kinematics.scene import WALLS
from planning.plan import PLACE_OUT_OF_REACH, Blocked, Plan
from planning.rules import Rule
from planning.statistics import Difference, Share, Spread, bootstrap, mcnemar, newcombe, quantiles, spread, wilson

MEASURES = ("moved", "planning_time_s", "motion_time_s", "relocation_travel_m", "hand_travel_m", "duration_s", "value")
"""The fields of `Episode` that are averaged: objects moved, times of choosing and of motion planning, length of the hand's way before the
target is gone for (the paper's moving distance) and in all, how long the arm moves, eq. 1."""

KINDS = ("selection", "pick", "region", "place", "retrieve", "look", "verify", "moves", "unsolvable", "scene")
"""Why a scene stays unsolved (`failure`), in the order in which a move gets there; at the end what was proved beforehand."""

SAID = ("look", "verify", "moves", "unsolvable", "scene")
"""Kinds of failure that the reason's stage says outright."""

SHARES = (0.1, 0.5, 0.9, 0.95)
"""Of which the quantiles of times are given."""

SENSED = ", sensed"
"""What the name of a planner ends with when it had to look around first."""

_FIXED = frozenset({*WALLS, MOUNT})
_NAMED = re.compile(r"\b[A-Za-z]+_\d+\b")
_PICK = frozenset({"ik", "grasp", "transit", "approach", "lift"})
_PLACE = frozenset({"transfer", "lower", "release", "retreat"})


@dataclass(frozen=True)
class Episode:
    """What is counted of one plan.

    policy: with `SENSED` behind it where nothing was known but what the camera saw. moved: relocations carried out; reason: the stage that
    stopped it, None for a success; kind: why it failed, one of `KINDS`, None for a success; blocked: the stages of failed attempts.
    kept_in: what keeps the target in at the end, and stopped: what stopped the attempts, in words. least_moves: a lower bound on the moves;
    proved: that no moves help, or none so few. Both where the planner looked. clearance_m, free_clearance_m: the least distance that all
    motions, and the free ones, keep from what they may not touch; None where it was not measured. pushed_m: how far each object was pushed
    by the fingers that closed on what was only seen, where the plan tells of it.
    """

    scene: str
    policy: str
    rule: str
    success: bool
    verified: bool
    moved: int
    planning_time_s: float
    motion_time_s: float
    relocation_travel_m: float | None
    hand_travel_m: float
    duration_s: float
    value: float
    reason: str | None
    kind: str | None
    blocked: tuple[str, ...]
    kept_in: str | None
    stopped: tuple[str, ...]
    least_moves: int | None
    proved: bool
    clearance_m: float | None
    free_clearance_m: float | None
    pushed_m: tuple[float, ...] = ()

    @property
    def whole_time_s(self) -> float:
        """From a scene to its verified plan: choosing, motion planning and the exact check."""
        return self.planning_time_s + self.motion_time_s

    @staticmethod
    def of(plan: Plan) -> Episode:
        """The figures of a plan, without its motions, so that many fit in memory."""
        return Episode(
            scene=plan.scene,
            policy=plan.policy + SENSED * any(motion.stage == "look" for motion in plan.motions),
            rule=plan.rule,
            success=plan.success,
            verified=plan.verified is True,
            moved=sum(move.done for move in plan.moves),
            planning_time_s=plan.planning_time_s,
            motion_time_s=plan.motion_time_s,
            relocation_travel_m=plan.relocation_travel_m,
            hand_travel_m=plan.hand_travel_m,
            duration_s=plan.duration_s,
            value=plan.value,
            reason=None if plan.success else plan.reason.stage if plan.reason else "unknown",
            kind=None if plan.success else failure(plan),
            blocked=tuple(move.reason.stage for move in plan.moves if not move.done and move.reason),
            kept_in=None if plan.success or plan.reason is None else in_general(plan.reason),
            stopped=tuple(in_general(move.reason, move.object) for move in plan.moves if not move.done and move.reason),
            least_moves=plan.least_moves,
            proved=plan.unsolvable is not None or (plan.reason is not None and plan.reason.stage == "moves"),
            clearance_m=plan.clearance_m,
            free_clearance_m=plan.free_clearance_m,
            pushed_m=tuple(n.amount for n in plan.notes if n.stage == "grasp" and len(n.bodies) == 1 and n.amount is not None),
        )


def in_general(why: Blocked, moved: str | None = None) -> str:
    """A reason in words that count alike in all scenes: objects without their names. moved: the object that it was about."""

    def called(name: str) -> str:
        if name in _FIXED:
            return f"the {name}"
        return "the object itself" if name == moved else "unseen space" if name.startswith("unknown_") else "another object"

    if why.stage == "unsolvable":
        return "it is proved that no picks help"
    if why.link and why.body:
        return f"{'the object' if why.link == moved else why.link} would touch {called(why.body)} ({why.stage})"
    return f"{why.stage}: {_NAMED.sub('an object', why.detail)}" if why.detail else why.stage


def failure(plan: Plan) -> str:
    """Why a plan failed, one of `KINDS`.

    scene: it is invalid. verify: the exact check refused its motions. look: the target was not found. moves: more are needed than are
    allowed. unsolvable: no move helps. Else the plan ends in a state where the target can't be taken, and what counts is how far the
    attempts got in that state. pick: no proposed object could be taken hold of; region: one could, but all its proposed places were taken;
    place: one was free, but the object could not be carried there. Where nothing was attempted, retrieve: all moves that are allowed were
    made, and the target is still blocked; selection: the policy proposed nothing.
    """
    if plan.reason is not None and plan.reason.stage in SAID:
        return plan.reason.stage
    last = max((i for i, move in enumerate(plan.moves) if move.done), default=-1)
    got_to = [_attempt_kind(move.reason) for move in plan.moves[last + 1 :] if move.reason]
    if got_to:
        return max(got_to, key=KINDS.index)
    return "retrieve" if _steps(plan) >= plan.max_moves else "selection"


def _steps(plan: Plan) -> int:
    """How many steps of the loop a plan's moves took: a lost one is an attempt (strict), or those on one object (region)."""
    if plan.rule == Rule.STRICT:
        return len(plan.moves)
    done = sum(move.done for move in plan.moves)
    if plan.rule != Rule.REGION:
        return done
    lost = [a for a, b in zip(plan.moves, (*plan.moves[1:], None)) if not a.done and (b is None or a.object != b.object)]
    return done + len(lost)


def _attempt_kind(why: Blocked) -> str:
    """What stopped one attempt to move an object: pick, region or place; selection for what the policy itself refused."""
    if why.stage == "region":
        return "region"
    if why.stage in _PLACE or why.detail == PLACE_OUT_OF_REACH:
        return "place"
    return "pick" if why.stage in _PICK else "selection"


@dataclass(frozen=True)
class Row:
    """One planner under one rule.

    by_moves: successes by number of objects moved. by_objects: success by number of objects in the scene, empty where that is not known.
    failures: unsolved scenes by `KINDS`; failed_at: by the stage that blocks the target; blocked_at: failed attempts by stage. kept_in,
    stopped: both in words, the most frequent first.
    least: moves and the lower bound on them, summed over the solved scenes for which any planner knows a bound of at least one, and how
    many those are; at_least: how many of them were solved with no more. proved: unsolved scenes for which any planner has a proof.
    planning_s: quantiles (`SHARES`) over all scenes of the time of choosing; whole_s: over successes of the time to a verified plan;
    solved_s: that time of each success, in ascending order. clearance_m, free_clearance_m: the least distance that each success keeps, in
    ascending order. pushed_m: how far fingers pushed objects, of all plans, ascending; pushing: how many plans tell of it.
    unverified: successes whose motions did not pass the exact check; repeated: plans for a scene that was counted before.
    """

    policy: str
    rule: str
    success: Share
    over_successes: Mapping[str, Spread | None]
    over_all: Mapping[str, Spread | None]
    by_moves: Mapping[int, int]
    by_objects: Mapping[int, Share]
    failures: Mapping[str, int]
    failed_at: Mapping[str, int]
    blocked_at: Mapping[str, int]
    kept_in: Mapping[str, int]
    stopped: Mapping[str, int]
    least: tuple[int, int, int]
    at_least: int
    proved: int
    planning_s: tuple[float, ...]
    whole_s: tuple[float, ...]
    solved_s: tuple[float, ...]
    clearance_m: tuple[float, ...]
    free_clearance_m: tuple[float, ...]
    pushed_m: tuple[float, ...]
    pushing: int
    unverified: int
    repeated: int


@dataclass(frozen=True)
class Pair:
    """Planners a and b, each (policy, rule), on the scenes that both tried.

    success: difference of the success shares, Newcombe's interval for paired shares; p: McNemar's exact test, two-sided.
    measures: differences on the scenes that both solved, bootstrap intervals; None where there are fewer than two.
    """

    a: tuple[str, str]
    b: tuple[str, str]
    both: int
    only_a: int
    only_b: int
    neither: int
    success: Difference
    p: float
    measures: Mapping[str, Difference | None]


@dataclass(frozen=True)
class PaperRow:
    """A row of the paper's Table I: 100 scenes, at most 5 moves, means ± sd over successful runs. printed: False if commented out there.
    relocation_travel_m: its moving distance, that of the relocations."""

    policy: str
    success: Share
    moved: Spread
    planning_time_s: Spread
    relocation_travel_m: Spread
    printed: bool = True

    def spreads(self) -> dict[str, Spread | None]:
        """The measures by name; None for those that the paper does not give."""
        return {m: getattr(self, m, None) for m in MEASURES}


def rows(episodes: Iterable[Episode], objects: Mapping[str, int] | None = None) -> list[Row]:
    """One row for every (policy, rule): rule by rule, in the order of Table I. objects: how many each scene has, the target among them."""
    groups: dict[tuple[str, str], list[Episode]] = {}
    for e in episodes:
        groups.setdefault((e.policy, e.rule), []).append(e)
    known = _known(chain.from_iterable(groups.values()))
    return [_row(*key, groups[key], objects or {}, known) for key in sorted(groups, key=_rank)]


class _Known(NamedTuple):
    """What any planner knows of scenes, by id: the lower bound on the moves, and whether it is proved that none help, or none so few."""

    least_moves: Mapping[str, int]
    proved: frozenset[str]


def _known(episodes: Iterable[Episode]) -> _Known:
    least, proved = dict[str, int](), set[str]()
    for e in episodes:
        if e.least_moves is not None:
            least[e.scene] = max(e.least_moves, least.get(e.scene, 0))
        if e.proved:
            proved.add(e.scene)
    return _Known(least, frozenset(proved))


def _row(policy: str, rule: str, episodes: Sequence[Episode], objects: Mapping[str, int], known: _Known) -> Row:
    solved = [e for e in episodes if e.success]
    counts = Counter(objects[e.scene] for e in episodes if e.scene in objects)
    solved_with = Counter(objects[e.scene] for e in solved if e.scene in objects)
    bounds = [(e.moved, known.least_moves[e.scene]) for e in solved if known.least_moves.get(e.scene)]
    failures, whole_s = Counter(e.kind for e in episodes), sorted(e.whole_time_s for e in solved)
    return Row(
        policy=policy,
        rule=rule,
        success=wilson(len(solved), len(episodes)),
        over_successes={m: spread(_values(solved, m)) for m in MEASURES},
        over_all={m: spread(_values(episodes, m)) for m in MEASURES},
        by_moves=dict(sorted(Counter(e.moved for e in solved).items())),
        by_objects={n: wilson(solved_with[n], counts[n]) for n in sorted(counts)},
        failures={kind: failures[kind] for kind in KINDS if failures[kind]},
        failed_at=dict(Counter(e.reason for e in episodes if e.reason).most_common()),
        blocked_at=dict(Counter(stage for e in episodes for stage in e.blocked).most_common()),
        kept_in=dict(Counter(e.kept_in for e in episodes if e.kept_in).most_common()),
        stopped=dict(Counter(words for e in episodes for words in e.stopped).most_common()),
        least=(sum(moved for moved, _ in bounds), sum(bound for _, bound in bounds), len(bounds)),
        at_least=sum(moved <= bound for moved, bound in bounds),
        proved=sum(not e.success and e.scene in known.proved for e in episodes),
        planning_s=quantiles([e.planning_time_s for e in episodes], SHARES),
        whole_s=quantiles(whole_s, SHARES),
        solved_s=tuple(whole_s),
        clearance_m=tuple(sorted(_values(solved, "clearance_m"))),
        free_clearance_m=tuple(sorted(_values(solved, "free_clearance_m"))),
        pushed_m=tuple(sorted(way for e in episodes for way in e.pushed_m)),
        pushing=sum(bool(e.pushed_m) for e in episodes),
        unverified=sum(not e.verified for e in solved),
        repeated=len(episodes) - len({e.scene for e in episodes}),
    )


def _values(episodes: Iterable[Episode], measure: str) -> list[float]:
    """A measure of those that know it."""
    return [value for e in episodes if (value := getattr(e, measure)) is not None]


def pairs(episodes: Iterable[Episode]) -> list[Pair]:
    """Compare every two planners that differ either in policy or in rule, on the scenes that each of them tried just once."""
    tried: dict[tuple[str, str], dict[str, list[Episode]]] = {}
    for e in episodes:
        tried.setdefault((e.policy, e.rule), {}).setdefault(e.scene, []).append(e)
    keys = sorted(tried, key=_rank)
    found = []
    for i, b in enumerate(keys):
        for a in keys[i + 1 :]:
            shared = [s for s in tried[a] if len(tried[a][s]) == 1 and len(tried[b].get(s, ())) == 1]
            if shared and (a[0] == b[0]) != (a[1] == b[1]):
                found.append(_pair(a, b, [(tried[a][s][0], tried[b][s][0]) for s in shared]))
    return found


def _pair(a: tuple[str, str], b: tuple[str, str], episodes: Sequence[tuple[Episode, Episode]]) -> Pair:
    count = Counter((x.success, y.success) for x, y in episodes)
    both, only_a, only_b, neither = (count[k] for k in ((True, True), (True, False), (False, True), (False, False)))
    solved = [(x, y) for x, y in episodes if x.success and y.success]
    return Pair(
        a=a,
        b=b,
        both=both,
        only_a=only_a,
        only_b=only_b,
        neither=neither,
        success=newcombe(both, only_a, only_b, neither),
        p=mcnemar(only_a, only_b),
        measures={m: bootstrap([a - b for x, y in solved for a, b in zip(_values([x], m), _values([y], m))]) for m in MEASURES},
    )


class Headline(NamedTuple):
    """One planner over another under one rule, in points of success."""

    rule: str
    first: str
    second: str
    points: Difference


def headlines(pairs: Iterable[Pair], ours: str = "neural", others: Sequence[str] = ("random", "local")) -> list[Headline]:
    """How much better `ours` does than each of the others, under each rule."""
    found = []
    for p in pairs:
        (first, rule), (second, other_rule) = p.a, p.b
        if rule == other_rule and first == ours and second in others:
            d = p.success
            found.append(Headline(rule, first, second, Difference(100 * d.mean, 100 * d.low, 100 * d.high, d.n)))
    return found


PAPER = tuple(
    PaperRow(policy, wilson(k, 100), Spread(*moved, k), Spread(*planning_s, k), Spread(*travel_m, k), printed=policy != "rrt")
    for policy, k, moved, planning_s, travel_m in (
        ("random", 45, (1.689, 0.962), (0.001, 0.001), (1.97, 1.204)),
        ("local", 55, (1.745, 0.976), (3.307, 1.669), (1.62, 0.734)),
        ("neural", 72, (1.722, 0.803), (0.014, 0.006), (1.647, 0.856)),
        ("osnet-only", 71, (1.662, 0.903), (2.987, 1.636), (2.074, 1.185)),
        ("rpnet-only", 47, (1.638, 0.783), (0.010, 0.005), (1.808, 0.913)),
        ("rrt", 71, (1.69, 0.897), (8.957, 7.735), (1.575, 0.836)),
    )
)
"""Table I, and the row that its source has commented out (rrt)."""


def rule_rank(rule: str) -> tuple[int, str]:
    """By what rules are sorted: in their own order, unknown ones behind them."""
    known = [str(r) for r in Rule]
    return (known.index(rule) if rule in known else len(known)), rule


def _rank(key: tuple[str, str]) -> tuple[int, str, int, str]:
    policy, rule = key
    order, plain = [row.policy for row in PAPER], policy.removesuffix(SENSED)
    return (
        *rule_rank(rule),
        order.index(plain) if plain in order else len(order),
        policy,
    )
