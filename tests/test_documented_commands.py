"""Every `retrieve …` that README.md and docs/ show is a command line that the program takes, and every module and name in them is there."""

from __future__ import annotations

import pkgutil
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from kinematics.errors import InputError
from retrieve_cli.app import parse

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
STANDS_FOR = {"RULE": "deep", "88062K": "1"}
"""What stands in a page for a word of many."""


def command_lines(text: str) -> Iterator[str]:
    """The lines of a page's blocks, and its spans of code, that call the program: parts of a pipe apart, without comments."""
    blocks = re.findall(r"(?:^    .*\n)+", text, re.MULTILINE)
    lines = [line.strip() for block in blocks for line in re.sub(r"\\\n\s*", "", block).splitlines()]
    spans = re.findall(r"`(retrieve [^`]+)`", text)
    for line in (*lines, *spans):
        for part in re.split(r" \| |; ", line.partition(" #")[0]):
            if part.startswith("retrieve ") and "…" not in part:
                yield part


LINES = sorted({(page.name, line) for page in PAGES for line in command_lines(page.read_text(encoding="utf-8"))})


def test_the_pages_show_commands() -> None:
    assert len(LINES) > 60
    assert {name for name, _ in LINES} >= {"README.md", "own-robot.md", "own-cell.md", "running.md", "sensing.md", "model-card.md"}


@pytest.mark.parametrize(("page", "line"), LINES)
def test_the_program_takes_it(page: str, line: str) -> None:
    _, *args = [STANDS_FOR.get(word, word) for word in shlex.split(line)]
    if "--install-completion" in args:
        return
    try:
        assert callable(parse(args))
    except InputError as e:
        if not re.search(r"Missing argument|requires an argument|Missing option", str(e)):  # a part of one, in a sentence
            raise


NAMES = sorted(
    {
        (page.name, name)
        for page in PAGES
        for name in re.findall(r"`((?:kinematics|perception|planning|retrieve_cli)(?:\.\w+)+)`", page.read_text(encoding="utf-8"))
    }
)


@pytest.mark.parametrize(("page", "name"), NAMES)
def test_what_a_page_names_is_there(page: str, name: str) -> None:
    assert pkgutil.resolve_name(name) is not None


def test_the_paper_page_says_where_things_are() -> None:
    assert len([name for page, name in NAMES if page == "paper.md"]) > 5
