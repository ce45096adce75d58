"""The report's curves as inline SVG: one panel a rule, one line a planner. Success by number of objects, and success against time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from html import escape
from math import ceil, floor, log10

from planning.metrics import Row, rule_rank

WIDTH, GAP, LEFT, RIGHT = 1040.0, 28.0, 46.0, 10.0
TOP, HEIGHT, BOTTOM = 30.0, 220.0, 50.0
"""The picture's width, the room between panels and beside a plot; above it, its own height, and below it: SVG units."""

COLOURS = {
    "random": "#8a95a1",
    "local": "#3b74b9",
    "neural": "#0f8a5f",
    "neural-paper": "#2a97a8",
    "osnet-only": "#8a5fbf",
    "rpnet-only": "#c2577b",
    "search": "#1d2733",
}
OTHERS = ("#b98a1d", "#7a5c3a", "#6b7f2a")
CEILING = ("search",)  # drawn dashed: it shows what can be solved, and is no competitor

Point = tuple[float, float]


class Panel:
    """Where a plot lies in the picture: x and y in data become SVG units."""

    def __init__(self, left: float, width: float, low: float, high: float) -> None:
        self.left, self.right, self.low, self.high = left + LEFT, left + width - RIGHT, low, high

    def x(self, value: float) -> float:
        """A value's place on the page, from the left."""
        return self.left + (self.right - self.left) * (value - self.low) / (self.high - self.low)

    @staticmethod
    def y(share: float) -> float:
        """The place on the page of a share of 1, from the top."""
        return TOP + HEIGHT * (1 - share)


def legend(rows: Sequence[Row]) -> str:
    """Which colour is whose, in the order of the table."""
    names = list(dict.fromkeys(r.policy for r in rows))
    kinds = {name: "line dash" if name in CEILING else "line" for name in names}
    return (
        '<div class="key">'
        + "".join(f'<span class="{kinds[n]}" style="--ink:{_colour(n, names)}">{escape(n)}</span>' for n in names)
        + "</div>"
    )


def by_objects(rows: Sequence[Row]) -> str:
    """The share of scenes solved, by how many objects there are."""
    counts = sorted({n for r in rows for n in r.by_objects})
    ticks = [(float(n), str(n)) for n in counts]

    def curve(panel: Panel, r: Row, colour: str, dash: str) -> str:
        points = [(panel.x(n), panel.y(s.k / s.n)) for n, s in r.by_objects.items()]
        dots = "".join(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{colour}">'
            f"<title>{escape(r.policy)}, {n} objects: {s.k} of {s.n}</title></circle>"
            for (x, y), (n, s) in zip(points, r.by_objects.items())
        )
        return _path(points, colour, dash, r.policy) + dots

    return _panels(rows, counts[0] - 0.4, counts[-1] + 0.4, ticks, "objects in the cabinet", "Success by number of objects", curve)


def by_time(rows: Sequence[Row]) -> str:
    """The share of all scenes that are solved within a time, on a logarithmic axis; empty where nothing was solved."""
    times = [t for r in rows for t in r.solved_s if t > 0]
    if not times:
        return ""
    low, high, ticks = time_axis(min(times), max(times))

    def curve(panel: Panel, r: Row, colour: str, dash: str) -> str:
        points, n = [(panel.x(low), panel.y(0.0))], max(r.success.n, 1)
        for i, t in enumerate(r.solved_s):
            x = panel.x(log10(max(t, 10**low)))
            points += [(x, panel.y(i / n)), (x, panel.y((i + 1) / n))]
        points.append((panel.x(high), panel.y(len(r.solved_s) / n)))
        return _path(points, colour, dash, f"{r.policy}: {len(r.solved_s)} of {r.success.n}")

    return _panels(rows, low, high, ticks, "seconds of choosing and motion planning", "Share of scenes solved within a time", curve)


def time_axis(least: float, most: float) -> tuple[float, float, list[tuple[float, str]]]:
    """Ends of a logarithmic axis that holds both times, at 1, 2 or 5 times a power of ten, and its ticks: (log10, label)."""
    steps = [m * 10.0**e for e in range(floor(log10(least)) - 1, ceil(log10(most)) + 2) for m in (1, 2, 5)]
    first = max((i for i, s in enumerate(steps) if s <= least * (1 + 1e-9)), default=0)
    last = min(i for i, s in enumerate(steps) if s >= most * (1 - 1e-9) and i > first)
    wide = log10(steps[last] / steps[first]) > 2.1
    shown = [s for s in steps[first : last + 1] if not wide or abs(log10(s) - round(log10(s))) < 1e-9]
    return log10(steps[first]), log10(steps[last]), [(log10(s), f"{s:g}") for s in shown]


def _panels(
    rows: Sequence[Row],
    low: float,
    high: float,
    ticks: Iterable[tuple[float, str]],
    axis: str,
    what: str,
    curve: Callable[[Panel, Row, str, str], str],
) -> str:
    rules = sorted({r.rule for r in rows}, key=rule_rank)
    names = list(dict.fromkeys(r.policy for r in rows))
    across = max(2, min(3, len(rules)))
    width = (WIDTH - GAP * (across - 1)) / across
    tall = TOP + HEIGHT + BOTTOM
    ticks, parts = list(ticks), []
    for k, rule in enumerate(rules):
        panel = Panel((k % across) * (width + GAP), width, low, high)
        inside = _frame(panel, rule, ticks, axis)
        inside += "".join(curve(panel, r, _colour(r.policy, names), _dash(r.policy)) for r in rows if r.rule == rule)
        parts.append(f'<g transform="translate(0 {(k // across) * tall:.0f})">{inside}</g>')
    height = tall * ceil(len(rules) / across)
    label = f"{what}: {', '.join(names)}; rules {', '.join(rules)}"
    return (
        f'{legend(rows)}\n<div class="scroll"><svg class="panels" viewBox="0 0 {WIDTH:.0f} {height:.0f}" role="img" '
        f'aria-label="{escape(label, quote=True)}">{"".join(parts)}</svg></div>'
    )


def _frame(panel: Panel, rule: str, ticks: Iterable[tuple[float, str]], axis: str) -> str:
    """A panel's title, grid and ticks."""
    parts = [f'<text class="rule" x="{panel.left:.1f}" y="14">{escape(rule)}</text>']
    for share in (0, 0.25, 0.5, 0.75, 1):
        y, colour = panel.y(share), "#e3e7ec" if share else "#b6bec8"
        parts.append(f'<line x1="{panel.left:.1f}" y1="{y:.1f}" x2="{panel.right:.1f}" y2="{y:.1f}" stroke="{colour}"/>')
        parts.append(f'<text class="soft" x="{panel.left - 8:.1f}" y="{y + 4:.1f}" text-anchor="end">{100 * share:.0f} %</text>')
    bottom = panel.y(0)
    for value, word in ticks:
        x = panel.x(value)
        parts.append(f'<line x1="{x:.1f}" y1="{bottom:.1f}" x2="{x:.1f}" y2="{bottom + 5:.1f}" stroke="#b6bec8"/>')
        parts.append(f'<text class="soft" x="{x:.1f}" y="{bottom + 19:.1f}" text-anchor="middle">{word}</text>')
    middle = (panel.left + panel.right) / 2
    parts.append(f'<text class="soft" x="{middle:.1f}" y="{bottom + 38:.1f}" text-anchor="middle">{escape(axis)}</text>')
    return "".join(parts)


def _path(points: Sequence[Point], colour: str, dash: str, title: str) -> str:
    d = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
    return (
        f'<path d="{d}" stroke="{colour}" stroke-width="2" stroke-linejoin="round" fill="none"{dash}><title>{escape(title)}</title></path>'
    )


def _colour(policy: str, names: Sequence[str]) -> str:
    strangers = [n for n in names if n not in COLOURS]
    return COLOURS.get(policy) or OTHERS[strangers.index(policy) % len(OTHERS)]


def _dash(policy: str) -> str:
    return ' stroke-dasharray="6 4"' if policy in CEILING else ""
