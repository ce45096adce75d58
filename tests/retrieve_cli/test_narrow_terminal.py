"""Tables on a narrow terminal come in parts, each with the first column; nothing is folded and nothing is lost."""

from __future__ import annotations

import io

import pytest
from rich.console import Console
from rich.table import Table

from retrieve_cli.terminal import parted


def table() -> Table:
    out = Table(title="what was found", caption="all of it")
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
    assert [part.title for part in parts] == ["what was found", *[None] * (len(parts) - 1)]
    assert [part.caption for part in parts] == [*[None] * (len(parts) - 1), "all of it"]
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
