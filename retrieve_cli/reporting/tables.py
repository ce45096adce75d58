"""What a report says, as tables in words for whatever prints them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import floor, log10

from planning import metrics
from planning.episodes import KINDS, SAID
from planning.metrics import MEASURES, PAPER, SHARES, Headline, Pair, Row
from planning.statistics import Difference, Share, Spread, quantiles

HEADINGS = {
    "moved": "objects moved",
    "planning_time_s": "planning time, s",
    "motion_time_s": "motion time, s",
    "relocation_travel_m": "relocation travel, m",
    "hand_travel_m": "hand travel, m",
    "duration_s": "execution, s",
    "value": "return",
}
NOTHING = "–"
RARE = SAID  # kinds of failure with a column only where there are some
WITHIN_S = (0.1, 1, 10)
MOST_REASONS = 3
CLEAR_MM = (3, 5)


@dataclass(frozen=True)
class Report:
    """All that a report says: what the plans gave, and remarks on what is odd about them."""

    rows: Sequence[Row]
    pairs: Sequence[Pair]
    headlines: Sequence[Headline]
    remarks: Sequence[str]


@dataclass(frozen=True)
class Table:
    """A table in words, for whatever prints it. key: what it is about; quiet: the numbers of rows that are for comparison only."""

    key: str
    title: str
    note: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    quiet: frozenset[int] = frozenset()


def tables(report: Report) -> list[Table]:
    """The report's tables; those that would be empty are left out."""
    rows = report.rows
    found = [_table_headlines(report.headlines)] if report.headlines else []
    found += [_table_one(rows), _table_all(rows)]
    if any(r.by_objects for r in rows):
        found.append(_table_objects(rows))
    found += [_table_times(rows), _table_moves(rows)]
    if any(r.clearance_m for r in rows):
        found.append(_table_clearance(rows))
    if any(r.pushed_m for r in rows):
        found.append(_table_pushes(rows))
    if any(r.least[2] or r.proved for r in rows):
        found.append(_table_bounds(rows))
    if any(r.failures for r in rows):
        found.append(_table_failures(rows))
    if any(r.kept_in or r.stopped for r in rows):
        found.append(_table_reasons(rows))
    return [*found, _table_pairs(report.pairs)] if report.pairs else found


def _table_headlines(headlines: Sequence[Headline]) -> Table:
    body = tuple((f"{h.first} over {h.second}, {h.rule}", _difference(h.points, digits=1), str(h.points.n)) for h in headlines)
    note = "difference of the success shares on the same scenes, in points, with Newcombe's 95 % interval for paired shares"
    return Table("headlines", "The networks over the baselines", note, ("planners, rule", "points [95 %]", "scenes"), body)


def _table_one(rows: Sequence[Row]) -> Table:
    """Our rows; each of the paper's after our row of that policy under the rule deep, those of planners that did not run at the end."""
    body: list[tuple[str, ...]] = []
    quiet: set[int] = set()
    waiting = {p.policy: p for p in PAPER}

    def add_paper(policy: str) -> None:
        quiet.add(len(body))
        body.append(_paper_row(waiting.pop(policy)))

    for r in rows:
        body.append((name(r), _share(r.success), *(_spread(r.over_successes[m]) for m in MEASURES)))
        if r.rule == "deep" and r.policy in waiting:
            add_paper(r.policy)
    for policy in list(waiting):
        add_paper(policy)
    note = (
        "mean ± sd over successful runs; the paper's rows are for 100 scenes of its own, and its travel is that of the relocations; "
        "rrt is commented out in its source"
    )
    return Table(
        "successes", "Over successes, as in the paper's Table I", note, _columns("success, % [95 %]"), tuple(body), frozenset(quiet)
    )


def _paper_row(p: metrics.PaperRow) -> tuple[str, ...]:
    return (f"{p.policy}, paper", _share(p.success), *(_spread(s, exact=True) for s in p.spreads().values()))


def _table_all(rows: Sequence[Row]) -> Table:
    body = tuple((name(r), f"{r.success.k} of {r.success.n}", *(_spread(r.over_all[m]) for m in MEASURES)) for r in rows)
    return Table(
        "all", "Over all scenes", "means over successes alone flatter a planner that solves the easy scenes only", _columns("solved"), body
    )


def _table_objects(rows: Sequence[Row]) -> Table:
    counts = sorted({n for r in rows for n in r.by_objects})
    body = tuple((name(r), *(_of(r.by_objects.get(n)) for n in counts)) for r in rows)
    columns = ("planner", *(f"{n} objects" for n in counts))
    return Table("objects", "Success by number of objects", "solved of tried; the target is one of the objects", columns, body)


def _of(s: Share | None) -> str:
    return f"{s.k} of {s.n}" if s is not None else NOTHING


def _table_times(rows: Sequence[Row]) -> Table:
    """Quantiles of the times, and how many of all scenes are solved within a time."""
    columns = ("planner", "choosing: median", "95 %", *(f"plan: {_quantile(s)}" for s in SHARES), *(f"within {t:g} s" for t in WITHIN_S))
    body = []
    for r in rows:
        choosing = dict(zip(SHARES, r.planning_s))
        within = [sum(t <= limit for t in r.solved_s) / max(r.success.n, 1) for limit in WITHIN_S]
        whole = r.whole_s or (None,) * len(SHARES)
        body.append(
            (name(r), *(_seconds(choosing.get(s)) for s in (0.5, 0.95)), *map(_seconds, whole), *(f"{100 * w:.0f} %" for w in within))
        )
    note = (
        "seconds; choosing objects and regions, over all scenes; the whole time to a verified plan, over successes; "
        "and the share of all scenes that are solved within a time"
    )
    return Table("times", "Time to a plan", note, columns, tuple(body))


def _quantile(share: float) -> str:
    return "median" if share == 0.5 else f"{100 * share:.0f} %"


def _seconds(t: float | None) -> str:
    return NOTHING if t is None else f"{t:.{_decimals(t)}f}"


def _table_moves(rows: Sequence[Row]) -> Table:
    most = max((n for r in rows for n in r.by_moves), default=0)
    body = tuple((name(r), *(str(r.by_moves.get(n, 0)) for n in range(most + 1))) for r in rows)
    columns = ("planner", *(f"{n} moved" for n in range(most + 1)))
    return Table("moves", "Successes by number of objects moved", "how many scenes were solved with so many moves", columns, body)


def _table_clearance(rows: Sequence[Row]) -> Table:
    """Quantiles of the least distance that a plan keeps, and how many plans keep so much."""
    body = tuple((name(r), *_clearances(r.free_clearance_m), *_clearances(r.clearance_m)) for r in rows)
    figures = ("5 %", "median", *(f"≥ {mm} mm" for mm in CLEAR_MM))
    columns = ("planner", *(f"{motions}: {figure}" for motions in ("free", "all") for figure in figures))
    note = (
        "in mm: the least distance that a successful plan keeps from what it may not touch: of its free motions (transit, transfer, look), "
        "and of all, which reach between objects"
    )
    return Table("clearance", "Clearance", note, columns, body)


def _clearances(ascending: Sequence[float]) -> tuple[str, ...]:
    """Quantiles, and the shares of what is at least so much: to a tenth of a millimetre, as it is measured."""
    if not ascending:
        return (NOTHING,) * (2 + len(CLEAR_MM))
    shares = (sum(d >= mm / 1000 - 5e-5 for d in ascending) / len(ascending) for mm in CLEAR_MM)
    return (*(f"{1000 * d:.1f}" for d in quantiles(ascending, (0.05, 0.5))), *(f"{100 * share:.0f} %" for share in shares))


def _table_pushes(rows: Sequence[Row]) -> Table:
    """How far fingers pushed what they closed on, where plans tell of it."""
    body = []
    for r in rows:
        far = (f"{1000 * d:.1f}" for d in quantiles(r.pushed_m, (0.5, 1.0))) if r.pushed_m else (NOTHING,) * 2
        body.append((name(r), str(r.pushing), str(len(r.pushed_m)), *far))
    note = (
        "mm; where only a camera knew an object, fingers go on until both are at it, and push it: in simulation, where the truth is known; "
        "objects that were pushed by less than 0.2 mm are not counted"
    )
    return Table("pushes", "Pushed by the fingers", note, ("planner", "plans", "objects", "median", "most"), tuple(body))


def _table_bounds(rows: Sequence[Row]) -> Table:
    body = []
    for r in rows:
        moved, bound, scenes = r.least
        over = f"{moved / bound:.3f}" if bound else NOTHING
        unsolved = r.success.n - r.success.k
        share = f"{100 * r.proved / unsolved:.0f} %" if unsolved else NOTHING
        body.append((name(r), str(scenes), over, str(r.at_least), str(unsolved), str(r.proved), share))
    columns = ("planner", "solved, bound known", "moves ÷ bound", "at the bound", "unsolved", "proved unsolvable", "of the unsolved")
    note = (
        "lower bounds on the moves, and proofs that no picks help or more are needed than are allowed, from whichever planner found them; "
        "all relative to the grasps that were sampled"
    )
    return Table("bounds", "Against what is possible", note, columns, tuple(body))


def _table_reasons(rows: Sequence[Row]) -> Table:
    body = tuple((name(r), _most(r.kept_in), _most(r.stopped)) for r in rows)
    note = f"the {MOST_REASONS} most frequent reasons, each with how often: of the unsolved scenes, and of all attempts to move an object"
    return Table("reasons", "In words", note, ("planner", "what keeps the target in", "what stopped attempts"), body)


def _most(reasons: Mapping[str, int]) -> str:
    return "; ".join(f"{words} ({n})" for words, n in list(reasons.items())[:MOST_REASONS]) or NOTHING


def _table_failures(rows: Sequence[Row]) -> Table:
    kinds = [kind for kind in KINDS if kind not in RARE or any(kind in r.failures for r in rows)]
    body = tuple(
        (
            name(r), str(r.success.n - r.success.k), *(str(r.failures.get(kind, 0)) for kind in kinds), _counts(r.failed_at),
            _counts(r.blocked_at),
        )
        for r in rows
    )  # fmt: skip
    note = (
        "how far the attempts got in the state where it ended. Selection: nothing was proposed; pick: nothing proposed could be taken hold "
        "of; region: every proposed place was taken; place: nothing could be carried to a free one; retrieve: all moves were made, and the "
        "target is still blocked. Then the stages that block the target at the end, and those of all failed attempts"
    )
    if "scene" in kinds:
        note += ". Scene: it is invalid"
    columns = ("planner", "unsolved", *kinds, "target blocked at", "attempts blocked at")
    return Table("failures", "Why the others failed", note, columns, body)


def _table_pairs(pairs: Sequence[Pair]) -> Table:
    measures = ("moved", "hand_travel_m")
    columns = (
        "first against second",
        "scenes",
        "first only",
        "second only",
        "success, points [95 %]",
        "p",
        *(HEADINGS[m] for m in measures),
    )
    body = tuple(
        (
            f"{' '.join(p.a)} against {' '.join(p.b)}",
            *(str(n) for n in (p.success.n, p.only_a, p.only_b)),
            _difference(p.success, scale=100, digits=1),
            f"{p.p:.2g}",
            *(_difference(p.measures[m]) for m in measures),
        )
        for p in pairs
    )
    note = (
        "first minus second; success on all scenes that both tried (Newcombe; McNemar's exact p), the rest where both succeeded (bootstrap)"
    )
    return Table("pairs", "On the same scenes", note, columns, body)


def _columns(second: str) -> tuple[str, ...]:
    return ("planner", second, *HEADINGS.values())


def name(r: Row) -> str:
    """What a row is called: its policy and its rule."""
    return f"{r.policy} {r.rule}"


def _counts(stages: Mapping[str, int]) -> str:
    return ", ".join(f"{stage} {n}" for stage, n in stages.items()) or NOTHING


def _share(s: Share) -> str:
    return f"{_percent(s.k / s.n)} [{_percent(s.low)}, {_percent(s.high)}]" if s.n else NOTHING


def _percent(share: float) -> str:
    return f"{100 * share:.0f}" if abs(100 * share - round(100 * share)) < 1e-9 else f"{100 * share:.1f}"


def _spread(s: Spread | None, *, exact: bool = False) -> str:
    if s is None:
        return NOTHING
    d = 3 if exact else _decimals(s.mean)
    return f"{s.mean:.{d}f}" if s.sd is None else f"{s.mean:.{d}f} ± {s.sd:.{d}f}"


def _difference(d: Difference | None, scale: float = 1, digits: int | None = None) -> str:
    if d is None:
        return NOTHING
    n = _decimals(max(abs(d.low), abs(d.high))) if digits is None else digits
    mean, low, high = (round(scale * v, n) + 0.0 for v in (d.mean, d.low, d.high))  # no minus before a zero
    return f"{mean:+.{n}f} [{low:+.{n}f}, {high:+.{n}f}]"


def _decimals(value: float) -> int:
    """Two digits after the point, and more where the value is small: two that count, up to a microsecond."""
    return 2 if abs(value) < 1e-6 else min(6, max(2, 1 - floor(log10(abs(value)))))


def is_figures(table: Table, column: int) -> bool:
    """Whether a column holds figures."""
    return all(row[column][:1] in "0123456789+-–" for row in table.rows)
