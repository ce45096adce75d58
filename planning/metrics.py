"""The columns of the paper's Table I from plans: success with its interval, objects moved, times, hand travel, return.

The paper gives means over *successful* runs; those flatter a weak planner, which succeeds on easy scenes only, so the same columns over all
scenes stand beside them. Planners that ran on the same scenes are compared scene by scene.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple

from planning.episodes import KINDS, SENSED, Episode
from planning.rules import Rule
from planning.statistics import Difference, Share, Spread, bootstrap, mcnemar, newcombe, quantiles, spread, wilson

MEASURES = ("moved", "planning_time_s", "motion_time_s", "relocation_travel_m", "hand_travel_m", "duration_s", "value")
"""The fields of `Episode` that are averaged: objects moved, times of choosing and of motion planning, length of the hand's way before the
target is gone for (the paper's moving distance) and in all, how long the arm moves, eq. 1."""

SHARES = (0.1, 0.5, 0.9, 0.95)
"""Of which the quantiles of times are given."""


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
