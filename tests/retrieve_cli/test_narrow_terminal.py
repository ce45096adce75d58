"""Tables on a narrow terminal come in parts, each with the first column; nothing is folded and nothing is lost."""

from __future__ import annotations

import io
import sys

import documents
import pytest
from rich.console import Console
from rich.table import Table

from planning.episodes import Episode
from planning.io.plan_documents import plan_from_json
from retrieve_cli.report import collect
from retrieve_cli.reporting.forms import to_terminal
from retrieve_cli.reporting.tables import tables
from retrieve_cli.terminal import parted


def table() -> Table:
    out = Table()
    for k in range(8):
        out.add_column(f"column {k}")
    for row in ("a", "b"):
        out.add_row(*(f"{row}{k} ± 0.12" for k in range(8)))
    return out


@pytest.mark.parametrize("width", [40, 80, 240])
def test_all_columns_are_there_and_none_is_folded(width: int) -> None:
    console = Console(file=io.StringIO(), width=width)
    parts = parted(table(), console)
    assert (len(parts) == 1) == (width == 240)
    assert [part.columns[0].header for part in parts] == ["column 0"] * len(parts)
    assert [c.header for part in parts for c in part.columns[1:]] == [f"column {k}" for k in range(1, 8)]
    for part in parts:
        console.print(part)
    file = console.file
    assert isinstance(file, io.StringIO)
    text = file.getvalue()
    assert all(f"{row}{k} ± 0.12" in text for row in "ab" for k in range(8))
    assert max(map(len, text.splitlines())) <= width


def test_a_column_too_wide_for_any_terminal_stands_alone() -> None:
    console = Console(file=io.StringIO(), width=12)
    assert [len(part.columns) for part in parted(table(), console)] == [2] * 7


class Terminal(io.StringIO):
    """A stdout of 80 columns."""

    def isatty(self) -> bool:
        return True


def test_what_is_said_of_a_table_is_as_wide_as_the_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not as narrow as the last part of its table."""
    report = collect([Episode.of(plan_from_json(documents.plan(f"0-{i:06d}", "local", "deep", success=i < 2))) for i in range(4)])
    out = Terminal()
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("TERM", "dumb")
    to_terminal(report)
    lines = [line.rstrip() for line in out.getvalue().splitlines()]
    assert max(map(len, lines)) <= 80
    for table in tables(report):
        assert table.title in lines
        first, *words = table.note.split()
        while words and len(first) + 1 + len(words[0]) <= 80:
            first += " " + words.pop(0)
        assert first in lines
