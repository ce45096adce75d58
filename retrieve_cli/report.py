"""`retrieve report`: Table I of plans beside the paper's, as a table on the terminal, Markdown, CSV, LaTeX, HTML or JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from math import floor, log10
from pathlib import Path
from typing import Any

from planning import metrics
from planning.metrics import MEASURES, PAPER, Difference, Episode, Pair, Row, Share, Spread
from retrieve_cli import terminal
from retrieve_cli.errors import InputError
from retrieve_cli.files import read_plans, write_text

HEADINGS = {
    "moved": "objects moved",
    "planning_time_s": "planning time, s",
    "motion_time_s": "motion time, s",
    "hand_travel_m": "hand travel, m",
    "value": "return",
}
NOTHING = "–"


@dataclass(frozen=True)
class Report:
    """All that a report says: what the plans gave, and remarks on what is odd about them."""

    rows: Sequence[Row]
    pairs: Sequence[Pair]
    remarks: Sequence[str]


@dataclass(frozen=True)
class Table:
    """A table in words, for whatever prints it. quiet: the numbers of rows that are for comparison only."""

    title: str
    note: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    quiet: frozenset[int] = frozenset()


def run(*, plans: Sequence[Path], out: Path | None, as_json: bool) -> int | None:
    """Report on plans from files, or from stdin if none is named; to `out`, or to stdout."""
    ending = out.suffix.lower() if out else ""
    if out and ending not in WRITERS:
        raise InputError(f"{out}: the ending says the form, and {ending or 'none'!r} is not one of {', '.join(WRITERS)}")
    sources: Sequence[Path | None] = plans or [None]
    report = collect([Episode.of(plan) for source in sources for _, plan in read_plans(source)])
    for remark in report.remarks:
        terminal.say(f"note: {remark}")
    if out:
        write_text(out, WRITERS[ending](report))
        terminal.say(f"wrote {out}")
    if as_json:
        print(to_json(report), end="")
    elif not out:
        _print(report)
    return None


def collect(episodes: Sequence[Episode]) -> Report:
    """The report on these episodes."""
    rows = metrics.rows(episodes)
    remarks = []
    for r in rows:
        if r.repeated:
            remarks.append(f"{_name(r)}: {r.repeated} plans are for scenes already counted; all are counted, but not compared in pairs")
        if r.unverified:
            remarks.append(f"{_name(r)}: {r.unverified} of the successes were not verified")
    return Report(rows, metrics.pairs(episodes), remarks)


# Tables in words ------------------------------------------------------------------------------------------------------------------------


def tables(report: Report) -> list[Table]:
    """The report's tables: over successes beside the paper's, over all scenes, the reasons, and the pairs where there are any."""
    found = [_table_one(report.rows), _table_all(report.rows), _table_reasons(report.rows)]
    return [*found, _table_pairs(report.pairs)] if report.pairs else found


def _table_one(rows: Sequence[Row]) -> Table:
    """Our rows; each of the paper's after our row of that policy under the rule deep, those of planners that did not run at the end."""
    body: list[tuple[str, ...]] = []
    quiet: set[int] = set()
    waiting = {p.policy: p for p in PAPER}

    def add_paper(policy: str) -> None:
        quiet.add(len(body))
        body.append(_paper_row(waiting.pop(policy)))

    for r in rows:
        body.append((_name(r), _share(r.success), *(_spread(r.over_successes[m]) for m in MEASURES)))
        if r.rule == "deep" and r.policy in waiting:
            add_paper(r.policy)
    for policy in list(waiting):
        add_paper(policy)
    note = "mean ± sd over successful runs; the paper's rows are for 100 scenes of its own; rrt is commented out in its source"
    return Table("Over successes, as in the paper's Table I", note, _columns("success, % [95 %]"), tuple(body), frozenset(quiet))


def _paper_row(p: metrics.PaperRow) -> tuple[str, ...]:
    return (f"{p.policy}, paper", _share(p.success), *(_spread(s, exact=True) for s in p.spreads().values()))


def _table_all(rows: Sequence[Row]) -> Table:
    body = tuple((_name(r), f"{r.success.k} of {r.success.n}", *(_spread(r.over_all[m]) for m in MEASURES)) for r in rows)
    return Table(
        "Over all scenes", "means over successes alone flatter a planner that solves the easy scenes only", _columns("solved"), body
    )


def _table_reasons(rows: Sequence[Row]) -> Table:
    most = max((n for r in rows for n in r.by_moves), default=0)
    columns = ("planner", *(f"{n} moved" for n in range(most + 1)), "unsolved because of", "attempts blocked at")
    body = tuple(
        (_name(r), *(str(r.by_moves.get(n, 0)) for n in range(most + 1)), _counts(r.failed_at), _counts(r.blocked_at)) for r in rows
    )
    return Table("Successes by number of objects moved, and why the others failed", "stages are those of a plan's reason", columns, body)


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
            _difference(p.success, scale=100),
            f"{p.p:.2g}",
            *(_difference(p.measures[m]) for m in measures),
        )
        for p in pairs
    )
    note = (
        "first minus second; success on all scenes that both tried (Newcombe; McNemar's exact p), the rest where both succeeded (bootstrap)"
    )
    return Table("On the same scenes", note, columns, body)


def _columns(second: str) -> tuple[str, ...]:
    return ("planner", second, *HEADINGS.values())


def _name(r: Row) -> str:
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


def _difference(d: Difference | None, scale: float = 1) -> str:
    if d is None:
        return NOTHING
    n = 1 if scale == 100 else _decimals(max(abs(d.low), abs(d.high)))
    return f"{scale * d.mean:+.{n}f} [{scale * d.low:+.{n}f}, {scale * d.high:+.{n}f}]"


def _decimals(value: float) -> int:
    """Two digits after the point, and more where the value is small: two that count, up to a microsecond."""
    return 2 if value == 0 else min(6, max(2, 1 - floor(log10(abs(value)))))


# Forms ----------------------------------------------------------------------------------------------------------------------------------


def _print(report: Report) -> None:
    from rich import box
    from rich.table import Table as RichTable
    from rich.text import Text

    for k, table in enumerate(tables(report)):
        rich = RichTable(title=table.title, caption=table.note, box=box.SIMPLE_HEAD, title_justify="left", caption_justify="left")
        for i, column in enumerate(table.columns):
            rich.add_column(Text(column), justify="right" if is_figures(table, i) else "left", overflow="fold", no_wrap=i == 0)
        for i, cells in enumerate(table.rows):
            rich.add_row(*(Text(c) for c in cells), style="dim" if i in table.quiet else None)
        terminal.show(*(["", rich] if k else [rich]))


def is_figures(table: Table, column: int) -> bool:
    """Whether a column holds figures."""
    return all(row[column][:1] in "0123456789+-–" for row in table.rows)


def to_markdown(report: Report) -> str:
    """Tables in GitHub's Markdown."""
    parts = ["# Retrieval report\n"]
    for t in tables(report):
        lines = [
            "| " + " | ".join(t.columns) + " |",
            "|" + "|".join("---:" if is_figures(t, i) else "---" for i in range(len(t.columns))) + "|",
        ]
        lines += ["| " + " | ".join(c.replace("|", "\\|") for c in row) + " |" for row in t.rows]
        parts.append(f"## {t.title}\n\n" + "\n".join(lines) + f"\n\n{t.note[0].upper()}{t.note[1:]}.\n")
    parts += [f"- Note: {r}." for r in report.remarks]
    return "\n".join(parts).rstrip() + "\n"


def to_tex(report: Report) -> str:
    """Tables for LaTeX with the package booktabs."""
    parts = ["% needs \\usepackage{booktabs}"]
    for t in tables(report):
        align = "".join("r" if is_figures(t, i) else "l" for i in range(len(t.columns)))
        lines = [" & ".join(_tex(c) for c in row) + r" \\" for row in (t.columns, *t.rows)]
        parts += [
            r"\begin{table}[ht]",
            r"  \centering",
            rf"  \caption{{{_tex(t.title)}: {_tex(t.note)}.}}",
            rf"  \begin{{tabular}}{{{align}}}",
        ]
        parts += ["    " + line for line in (r"\toprule", lines[0], r"\midrule", *lines[1:], r"\bottomrule")]
        parts += [r"  \end{tabular}", r"\end{table}", ""]
    return "\n".join(parts)


def _tex(text: str) -> str:
    for char in "\\{}":
        text = text.replace(char, {"\\": "\0", "{": r"\{", "}": r"\}"}[char])
    for char, word in {
        "%": r"\%",
        "_": r"\_",
        "&": r"\&",
        "#": r"\#",
        "$": r"\$",
        "±": r"$\pm$",
        "–": "--",
        "^": r"\^{}",
        "~": r"\~{}",
    }.items():
        text = text.replace(char, word)
    return text.replace("\0", r"\textbackslash{}")


def to_csv(report: Report) -> str:
    """One line for every planner, rule and set of runs (successes, all), the paper's too; figures in full."""
    head = ["source", "policy", "rule", "over", "scenes", "solved", "success", "success_low", "success_high"]
    head += [f"{m}_{part}" for m in MEASURES for part in ("mean", "sd")]
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(head)
    for r in report.rows:
        for over, spreads in (("successes", r.over_successes), ("all", r.over_all)):
            writer.writerow(["ours", r.policy, r.rule, over, *_figures(r.success, spreads)])
    for p in PAPER:
        writer.writerow(["paper", p.policy, "", "successes", *_figures(p.success, p.spreads())])
    return stream.getvalue()


def _figures(success: Share, spreads: Mapping[str, Spread | None]) -> list[Any]:
    share = success.k / success.n if success.n else ""
    cells: list[Any] = [success.n, success.k, share, success.low, success.high]
    for s in spreads.values():
        cells += ["", ""] if s is None else [s.mean, "" if s.sd is None else s.sd]
    return cells


def to_json(report: Report) -> str:
    """Everything, figures in full."""
    document = {
        "rows": [asdict(r) for r in report.rows],
        "pairs": [asdict(p) for p in report.pairs],
        "paper": [asdict(p) for p in PAPER],
        "remarks": list(report.remarks),
    }
    return json.dumps(document, indent=2, ensure_ascii=False) + "\n"


def to_html(report: Report) -> str:
    """One page that needs nothing else."""
    from retrieve_cli.report_html import page

    return page(tables(report), report.rows, report.remarks)


WRITERS: dict[str, Callable[[Report], str]] = {
    ".md": to_markdown,
    ".csv": to_csv,
    ".tex": to_tex,
    ".html": to_html,
    ".json": to_json,
}
