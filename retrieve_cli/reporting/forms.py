"""The forms of a report: tables on the terminal, Markdown, LaTeX, CSV, JSON and HTML."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

from planning.episodes import KINDS
from planning.metrics import MEASURES, PAPER, SHARES
from planning.statistics import Share, Spread
from retrieve_cli import terminal
from retrieve_cli.reporting.tables import Report, is_figures, tables


def to_terminal(report: Report) -> None:
    """Tables on stdout."""
    from rich import box
    from rich.table import Table as RichTable
    from rich.text import Text

    for k, table in enumerate(tables(report)):
        rich = RichTable(box=box.SIMPLE_HEAD)
        for i, column in enumerate(table.columns):
            rich.add_column(Text(column), justify="right" if is_figures(table, i) else "left", overflow="fold", no_wrap=i == 0)
        for i, cells in enumerate(table.rows):
            rich.add_row(*(Text(c) for c in cells), style="dim" if i in table.quiet else None)
        terminal.show(*([""] if k else []), Text(table.title, style="italic"), rich, Text(table.note, style="dim italic"))


def to_markdown(report: Report) -> str:
    """Tables in GitHub's Markdown."""
    parts = ["# Retrieval report\n"]
    for t in tables(report):
        lines = [
            "| " + " | ".join(_md(c) for c in t.columns) + " |",
            "|" + "|".join("---:" if is_figures(t, i) else "---" for i in range(len(t.columns))) + "|",
        ]
        lines += ["| " + " | ".join(_md(c) for c in row) + " |" for row in t.rows]
        parts.append(f"## {t.title}\n\n" + "\n".join(lines) + f"\n\n{t.note[0].upper()}{t.note[1:]}.\n")
    parts += [f"- Note: {_md(r)}." for r in report.remarks]
    return "\n".join(parts).rstrip() + "\n"


def _md(text: str) -> str:
    """A text as Markdown shows it: no names become markup, tables or HTML."""
    return re.sub(r"([\\`*_<>|&])", r"\\\1", " ".join(text.split())).replace("](", "]\\(")


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
    text = "".join(c if c.isprintable() else " " for c in text)
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
    """A line for every planner, rule and set of runs (successes, all, scenes of so many objects), the paper's too; figures in full."""
    head = ["source", "policy", "rule", "over", "scenes", "solved", "success", "success_low", "success_high"]
    head += [f"{m}_{part}" for m in MEASURES for part in ("mean", "sd")]
    head += [f"{time}_p{100 * share:.0f}" for time in ("planning_time_s", "whole_time_s") for share in SHARES]
    head += [f"failed_{kind}" for kind in KINDS]
    stream = io.StringIO()
    writer = csv.DictWriter(stream, head, restval="", lineterminator="\n")
    writer.writeheader()
    for r in report.rows:
        who = {"source": "ours", "policy": r.policy, "rule": r.rule}
        writer.writerow({**who, "over": "successes", **_figures(r.success, r.over_successes), **_quantiles("whole_time_s", r.whole_s)})
        failed = {f"failed_{kind}": r.failures.get(kind, 0) for kind in KINDS}
        planning = _quantiles("planning_time_s", r.planning_s)
        writer.writerow({**who, "over": "all", **_figures(r.success, r.over_all), **planning, **failed})
        for n, share in r.by_objects.items():
            writer.writerow({**who, "over": f"{n} objects", **_figures(share, {})})
    for p in PAPER:
        writer.writerow({"source": "paper", "policy": p.policy, "over": "successes", **_figures(p.success, p.spreads())})
    return stream.getvalue()


def _figures(s: Share, spreads: Mapping[str, Spread | None]) -> dict[str, Any]:
    share = s.k / s.n if s.n else ""
    cells: dict[str, Any] = {"scenes": s.n, "solved": s.k, "success": share, "success_low": s.low, "success_high": s.high}
    for measure, spread in spreads.items():
        if spread is not None:
            cells |= {f"{measure}_mean": spread.mean, f"{measure}_sd": "" if spread.sd is None else spread.sd}
    return cells


def _quantiles(time: str, values: tuple[float, ...]) -> dict[str, float]:
    return {f"{time}_p{100 * share:.0f}": value for share, value in zip(SHARES, values)}


def to_json(report: Report) -> str:
    """Everything, figures in full."""
    document = {
        "rows": [asdict(r) for r in report.rows],
        "pairs": [asdict(p) for p in report.pairs],
        "headlines": [{"first": h.first, "second": h.second, "rule": h.rule, "points": asdict(h.points)} for h in report.headlines],
        "paper": [asdict(p) for p in PAPER],
        "remarks": list(report.remarks),
    }
    return json.dumps(document, indent=2, ensure_ascii=False) + "\n"


def to_html(report: Report) -> str:
    """One page that needs nothing else."""
    from retrieve_cli.reporting.html import page

    return page(report, tables(report))


WRITERS: dict[str, Callable[[Report], str]] = {
    ".md": to_markdown,
    ".csv": to_csv,
    ".tex": to_tex,
    ".html": to_html,
    ".json": to_json,
}
