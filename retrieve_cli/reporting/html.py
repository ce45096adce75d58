"""The report as one page that needs nothing else: a chart of success with its intervals, the curves, and the tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape
from itertools import pairwise

from planning.metrics import PAPER, Row
from planning.statistics import Share
from retrieve_cli.reporting.plots import CEILING, by_objects, by_time
from retrieve_cli.reporting.tables import Report, Table, is_figures

LABEL, PLOT, VALUE, BAND, TOP, RULE_GAP = 170, 560, 150, 30, 34, 14
"""Widths of the chart's three columns, the height of a bar with its gap, the room for the axis, and between rules, in SVG units."""

LETTER = 8.5
"""SVG units that a letter of a label takes at most, as a rule."""

CSS = """
:root { --ink: #1d2733; --quiet: #66727f; --line: #e3e7ec; --page: #f6f7f9; --card: #fff; --bar: #3b74b9; --paper: #d9822b;
  --shade: #1d273338; }
* { box-sizing: border-box; }
body { margin: 0; background: var(--page); color: var(--ink);
  font: 16px/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", sans-serif; }
main { max-width: 1240px; margin: 0 auto; padding: 48px 24px 72px; }
h1 { font-size: 2rem; line-height: 1.2; letter-spacing: -.02em; margin: 0 0 8px; }
h2 { font-size: 1.1rem; margin: 0 0 4px; }
p { margin: 0 0 16px; color: var(--quiet); max-width: 75ch; }
.lead { font-size: 1.05rem; margin-bottom: 28px; }
.lead b { color: var(--ink); font-weight: 600; }
section { background: var(--card); border: 1px solid var(--line); border-radius: 12px; padding: 22px 24px; margin-bottom: 20px; }
.scroll { overflow-x: auto; background: linear-gradient(to right, var(--card) 50%, transparent) left / 48px 100% no-repeat local,
  linear-gradient(to left, var(--card) 50%, transparent) right / 48px 100% no-repeat local,
  linear-gradient(to right, var(--shade), transparent) left / 16px 100% no-repeat scroll,
  linear-gradient(to left, var(--shade), transparent) right / 16px 100% no-repeat scroll; }
table { border-collapse: collapse; width: 100%; font-size: .9rem; font-variant-numeric: tabular-nums; }
th, td { padding: 8px 14px 8px 0; text-align: left; white-space: nowrap; border-bottom: 1px solid var(--line); }
th { font-weight: 600; color: var(--quiet); font-size: .8rem; vertical-align: bottom; }
th.n { white-space: normal; }
tr:last-child td { border-bottom: 0; }
.n { text-align: right; padding: 8px 0 8px 12px; }
.n + :not(.n) { padding-left: 28px; }
td:first-child { font-weight: 600; }
td:last-child:not(.n) { white-space: normal; }
tr.quiet td { color: var(--quiet); font-weight: 400; }
svg { display: block; width: 100%; height: auto; min-width: 620px; max-width: 880px; }
svg text { font-size: 14px; font-variant-numeric: tabular-nums; fill: var(--ink); }
svg text.soft, svg tspan.soft { fill: var(--quiet); font-size: 12px; }
.key { display: flex; gap: 24px; flex-wrap: wrap; font-size: .85rem; color: var(--quiet); margin: 4px 0 14px; }
.key span::before { content: ""; display: inline-block; width: 12px; height: 12px; margin-right: 8px; vertical-align: -1px;
  background: var(--bar); border-radius: 2px; }
.key .diamond::before { background: var(--paper); transform: rotate(45deg) scale(.75); }
.key .whisker::before { background: var(--ink); height: 2px; vertical-align: 4px; }
.key .line::before { background: none; border-top: 3px solid var(--ink); border-radius: 0; width: 20px; height: 0; vertical-align: 4px; }
.key .dash::before { border-top-style: dashed; }
svg.panels { max-width: none; min-width: 720px; }
svg text.rule { font-weight: 600; }
.scroll + .scroll { margin-top: 14px; }
summary { cursor: pointer; color: var(--quiet); font-size: .9rem; }
details[open] summary { margin-bottom: 10px; }
ul { margin: 0; padding-left: 20px; }
@media print { body { background: #fff; } section { break-inside: avoid; } }
"""


PLOTS: dict[str, Callable[[Sequence[Row]], str]] = {"objects": by_objects, "times": by_time}
"""By the key of the table that they stand above."""

FOLDED = {"objects": "in figures", "times": "in figures", "pairs": "all pairs"}
LONG = 12
"""By their keys, the tables that are folded away when they have more rows than that, and the words to open them."""


def page(report: Report, tables: Sequence[Table]) -> str:
    """The whole document."""
    rows, remarks = report.rows, report.remarks
    sections = [_section("Success", "", _chart(rows))]
    for t in tables:
        plot = PLOTS[t.key](rows) + "\n" if t.key in PLOTS else ""
        sections.append(_section(t.title, f"{t.note[0].upper()}{t.note[1:]}.", plot + _table(t)))
    if remarks:
        sections.append(_section("Remarks", "", "<ul>" + "".join(f"<li>{escape(r)}</li>" for r in remarks) + "</ul>"))
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>Retrieval report</title>\n<style>{CSS}</style>\n</head>\n<body>\n<main>\n"
        f'<h1>Retrieval report</h1>\n<p class="lead">{_lead(rows)}</p>\n' + "\n".join(sections) + "\n</main>\n</body>\n</html>\n"
    )


def _lead(rows: Sequence[Row]) -> str:
    ceiling = max((r for r in rows if r.policy in CEILING), key=_share_of, default=None)
    others = [r for r in rows if r.policy not in CEILING] or rows
    best = max(others, key=_share_of)
    total = sum(r.success.n for r in rows)
    name = escape(f"{best.policy} {best.rule}")
    among = f"The best of {len(others)} planners" if len(others) > 1 else "The planner"
    s = best.success
    plans = "1 plan" if total == 1 else f"{total} plans"
    above = f" Search, the ceiling, did so in {ceiling.success.k} of {ceiling.success.n}." if ceiling and ceiling is not best else ""
    return (
        f"{plans} for taking a blocked target out of a cabinet. {among}, <b>{name}</b>, retrieved it in "
        f"<b>{s.k} of {s.n}</b> scenes, that is {100 * s.k / max(s.n, 1):.0f} % (95 % interval {100 * s.low:.0f} to {100 * s.high:.0f} %)."
        f"{above}"
    )


def _share_of(r: Row) -> float:
    return r.success.k / max(r.success.n, 1)


def _section(title: str, note: str, content: str) -> str:
    words = f"<p>{escape(note)}</p>\n" if note else ""
    return f"<section>\n<h2>{escape(title)}</h2>\n{words}{content}\n</section>"


def _table(table: Table) -> str:
    classes = [' class="n"' if is_figures(table, i) else "" for i in range(len(table.columns))]
    head = "".join(f"<th{c}>{escape(name)}</th>" for c, name in zip(classes, table.columns))
    body = "\n".join(
        ('<tr class="quiet">' if i in table.quiet else "<tr>")
        + "".join(f"<td{c}>{escape(cell)}</td>" for c, cell in zip(classes, row))
        + "</tr>"
        for i, row in enumerate(table.rows)
    )
    whole = f'<div class="scroll"><table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>\n</table></div>'
    fold = table.key in FOLDED and len(table.rows) > LONG
    return f"<details><summary>{FOLDED[table.key]}</summary>\n{whole}\n</details>" if fold else whole


def _chart(rows: Sequence[Row]) -> str:
    """Horizontal bars with 95 % intervals; a diamond where the paper's planner stands (its rows belong beside the rule deep)."""
    gaps = [sum(a.rule != b.rule for a, b in pairwise(rows[: i + 1])) for i in range(len(rows))]
    tops = [TOP + BAND * i + RULE_GAP * gap for i, gap in enumerate(gaps)]
    height = tops[-1] + BAND + 6
    paper = {p.policy: p.success for p in PAPER}
    grid = "".join(
        f'<line x1="{_x(s):.1f}" y1="{TOP - 6}" x2="{_x(s):.1f}" y2="{height - 4}" stroke="#e3e7ec"/>'
        f'<text class="soft" x="{_x(s):.1f}" y="{TOP - 14}" text-anchor="middle">{100 * s:.0f} %</text>'
        for s in (0, 0.2, 0.4, 0.6, 0.8, 1.0)
    )
    bars = "".join(_bar(r, top, paper.get(r.policy) if r.rule == "deep" else None) for r, top in zip(rows, tops))
    words = "; ".join(f"{r.policy} {r.rule}: {r.success.k} of {r.success.n}" for r in rows)
    marked = any(r.policy in paper and r.rule == "deep" for r in rows)
    key = '<div class="key"><span>retrieved</span><span class="whisker">95 % Wilson interval</span>'
    key += '<span class="diamond">the paper, 100 scenes of its own</span></div>' if marked else "</div>"
    label = escape(f"Success: {words}", quote=True)
    more = max(0, round(max(LETTER * len(f"{r.policy} {r.rule}") for r in rows)) + 14 - LABEL)  # that long names reach further to the left
    drawing = f'<svg viewBox="{-more} 0 {more + LABEL + PLOT + VALUE} {height}" role="img" aria-label="{label}">{grid}{bars}</svg>'
    return f'{key}\n<div class="scroll">{drawing}</div>'


def _bar(r: Row, top: float, paper: Share | None) -> str:
    s, middle, thick = r.success, top + BAND / 2, 18
    share = s.k / max(s.n, 1)
    low, high = _x(s.low), _x(s.high)
    whisker = f"M{low:.1f} {middle}H{high:.1f}M{low:.1f} {middle - 5}v10M{high:.1f} {middle - 5}v10"
    parts = [
        f'<text x="{LABEL - 14}" y="{middle + 5}" text-anchor="end">{escape(r.policy)} <tspan class="soft">{escape(r.rule)}</tspan></text>',
        f'<rect x="{LABEL}" y="{middle - thick / 2}" width="{PLOT * share:.1f}" height="{thick}" rx="2" fill="#3b74b9"/>',
        f'<path d="{whisker}" stroke="#1d2733" stroke-width="1.5" fill="none"/>',
        f'<text x="{LABEL + PLOT + 16}" y="{middle + 5}">{100 * share:.0f} % <tspan class="soft">{s.k} of {s.n}</tspan></text>',
    ]
    if paper is not None:
        x = _x(paper.k / paper.n)
        diamond = f"M{x:.1f} {middle - 7}l7 7l-7 7l-7 -7z"
        parts.append(f'<path d="{diamond}" fill="#d9822b" stroke="#fff" stroke-width="1.5"><title>the paper: {paper.k} %</title></path>')
    return "<g>" + "".join(parts) + "</g>"


def _x(share: float) -> float:
    return LABEL + PLOT * share
