"""The columns of the paper's Table I from plans: success with its interval, objects moved, times, hand travel, return.

The paper gives means over *successful* runs; those flatter a weak planner, which succeeds on easy scenes only, so the same columns over all
scenes stand beside them. Planners that ran on the same scenes are compared scene by scene.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import comb, sqrt

import numpy as np

from planning.plan import Plan

MEASURES = ("moved", "planning_time_s", "motion_time_s", "hand_travel_m", "value")
"""The fields of `Episode` that are averaged: objects moved, times of choosing and of motion planning, length of the hand's way, eq. 1."""

Z_95 = 1.959963984540054
RESAMPLES = 4000


@dataclass(frozen=True)
class Episode:
    """What is counted of one plan.

    moved: relocations carried out; reason: the stage that stopped it, None for a success; blocked: the stages of failed attempts.
    """

    scene: str
    policy: str
    rule: str
    success: bool
    verified: bool
    moved: int
    planning_time_s: float
    motion_time_s: float
    hand_travel_m: float
    value: float
    reason: str | None
    blocked: tuple[str, ...]

    @staticmethod
    def of(plan: Plan) -> Episode:
        """The figures of a plan, without its motions, so that many fit in memory."""
        return Episode(
            scene=plan.scene,
            policy=plan.policy,
            rule=plan.rule,
            success=plan.success,
            verified=plan.verified,
            moved=sum(move.done for move in plan.moves),
            planning_time_s=plan.planning_time_s,
            motion_time_s=plan.motion_time_s,
            hand_travel_m=plan.hand_travel_m,
            value=plan.value,
            reason=None if plan.success else plan.reason.stage if plan.reason else "unknown",
            blocked=tuple(move.reason.stage for move in plan.moves if not move.done and move.reason),
        )


@dataclass(frozen=True)
class Spread:
    """Mean and standard deviation (of the sample; None when n < 2) of n values."""

    mean: float
    sd: float | None
    n: int


@dataclass(frozen=True)
class Share:
    """k of n, with the 95 % Wilson interval: low and high as shares."""

    k: int
    n: int
    low: float
    high: float


@dataclass(frozen=True)
class Row:
    """One planner under one rule. by_moves: successes by number of objects moved; failed_at and blocked_at: counts by stage.

    unverified: successes whose motions did not pass the exact check; repeated: plans for a scene that was counted before.
    """

    policy: str
    rule: str
    success: Share
    over_successes: Mapping[str, Spread | None]
    over_all: Mapping[str, Spread | None]
    by_moves: Mapping[int, int]
    failed_at: Mapping[str, int]
    blocked_at: Mapping[str, int]
    unverified: int
    repeated: int


@dataclass(frozen=True)
class Difference:
    """The mean of a − b over n scenes, with its 95 % interval."""

    mean: float
    low: float
    high: float
    n: int


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
    """A row of the paper's Table I: 100 scenes, at most 5 moves, means ± sd over successful runs. printed: False if commented out there."""

    policy: str
    success: Share
    moved: Spread
    planning_time_s: Spread
    hand_travel_m: Spread
    printed: bool = True

    def spreads(self) -> dict[str, Spread | None]:
        """The measures by name; None for those that the paper does not give."""
        return {m: getattr(self, m, None) for m in MEASURES}


def wilson(k: int, n: int) -> Share:
    """The share k / n with its 95 % Wilson score interval (E. B. Wilson, JASA 22, 1927); [0, 1] when n = 0."""
    if n == 0:
        return Share(0, 0, 0.0, 1.0)
    p, zz = k / n, Z_95**2
    centre, half = (p + zz / (2 * n)) / (1 + zz / n), Z_95 * sqrt(p * (1 - p) / n + zz / (4 * n * n)) / (1 + zz / n)
    return Share(k, n, 0.0 if k == 0 else centre - half, 1.0 if k == n else centre + half)


def spread(values: Sequence[float]) -> Spread | None:
    """Mean and sample standard deviation; None of nothing."""
    if not values:
        return None
    return Spread(float(np.mean(values)), float(np.std(values, ddof=1)) if len(values) > 1 else None, len(values))


def rows(episodes: Iterable[Episode]) -> list[Row]:
    """One row for every (policy, rule), in the order of Table I."""
    groups: dict[tuple[str, str], list[Episode]] = {}
    for e in episodes:
        groups.setdefault((e.policy, e.rule), []).append(e)
    return [_row(*key, groups[key]) for key in sorted(groups, key=_rank)]


def _row(policy: str, rule: str, episodes: Sequence[Episode]) -> Row:
    solved = [e for e in episodes if e.success]
    return Row(
        policy=policy,
        rule=rule,
        success=wilson(len(solved), len(episodes)),
        over_successes={m: spread([getattr(e, m) for e in solved]) for m in MEASURES},
        over_all={m: spread([getattr(e, m) for e in episodes]) for m in MEASURES},
        by_moves=dict(sorted(Counter(e.moved for e in solved).items())),
        failed_at=dict(Counter(e.reason for e in episodes if e.reason).most_common()),
        blocked_at=dict(Counter(stage for e in episodes for stage in e.blocked).most_common()),
        unverified=sum(not e.verified for e in solved),
        repeated=len(episodes) - len({e.scene for e in episodes}),
    )


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
        measures={m: _bootstrap([getattr(x, m) - getattr(y, m) for x, y in solved]) for m in MEASURES},
    )


def newcombe(both: int, only_a: int, only_b: int, neither: int) -> Difference:
    """The difference of two paired shares with its 95 % interval: method 10 of R. G. Newcombe, Statistics in Medicine 17, 1998.

    It joins the Wilson intervals of both shares by their correlation, and holds for few scenes and for shares near 0 and 1.
    """
    n = both + only_a + only_b + neither
    a, b = wilson(both + only_a, n), wilson(both + only_b, n)
    pa, pb = a.k / n, b.k / n
    product = a.k * (n - a.k) * b.k * (n - b.k)
    excess = both * neither - only_a * only_b
    phi = 0.0 if product == 0 else (max(excess - n / 2, 0) if excess > 0 else excess) / sqrt(product)
    below, above = (pa - a.low, b.high - pb), (a.high - pa, pb - b.low)
    low, high = (sqrt(max(x * x - 2 * phi * x * y + y * y, 0.0)) for x, y in (below, above))
    return Difference(pa - pb, pa - pb - low, pa - pb + high, n)


def mcnemar(only_a: int, only_b: int) -> float:
    """How likely a split of the scenes that just one planner solved would be at least so uneven by chance: exact, two-sided."""
    n = only_a + only_b
    return min(1.0, sum(comb(n, i) for i in range(min(only_a, only_b) + 1)) / 2 ** (n - 1)) if n else 1.0


def _bootstrap(differences: Sequence[float]) -> Difference | None:
    """Percentile bootstrap of the mean, with a fixed seed: the same plans give the same report."""
    n = len(differences)
    if n < 2:
        return None
    values = np.array(differences, float)
    means = values[np.random.default_rng(0).integers(n, size=(RESAMPLES, n))].mean(1)
    low, high = np.quantile(means, [0.025, 0.975])
    return Difference(float(values.mean()), float(low), float(high), n)


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


def _rank(key: tuple[str, str]) -> tuple[int, str, str]:
    order = [row.policy for row in PAPER]
    return (order.index(key[0]) if key[0] in order else len(order), *key)
