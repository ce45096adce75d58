"""Streams that are closed or have no room: nothing is written where it does not belong, and one line says what is wrong."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from pathlib import Path

import documents
import pytest

ROOT = Path(__file__).resolve().parents[2]
RETRIEVE = f"{sys.executable} -W error -m retrieve_cli"


def bash(line: str, folder: Path, **options: object) -> tuple[int, str, str]:
    """Run a line of bash in a folder, with `retrieve` in it: (exit code, stdout, stderr)."""
    script = f'set -o pipefail; retrieve() {{ {RETRIEVE} "$@"; }}; {line}'
    done = subprocess.run(  # type: ignore[call-overload]
        ["bash", "-c", script],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120,
        **options,
    )
    return done.returncode, done.stdout, done.stderr


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "plans.jsonl").write_text(documents.lines(*(documents.plan(f"0-{i}") for i in range(3))))
    (tmp_path / "scenes.jsonl").write_text(documents.lines(documents.scene()))
    return tmp_path


@pytest.mark.parametrize(
    ("line", "code", "out", "err"),
    [
        ("retrieve report <&-", 2, "", "no file is named, and stdin is closed: name a file of plans or pipe them in"),
        ("retrieve report - <&-", 2, "", "no file is named, and stdin is closed"),
        ("retrieve report plans.jsonl --json >&-", 2, "", "stdout: can't be written: bad file descriptor"),
        ("retrieve report plans.jsonl >&-", 2, "", "stdout: can't be written: bad file descriptor"),
        ("retrieve report plans.jsonl > /dev/full", 2, "", "stdout: can't be written: no space left on device"),
        ("retrieve report plans.jsonl --json > /dev/full", 2, "", "stdout: can't be written: no space left on device"),
        ("retrieve robots --json > /dev/full", 2, "", "stdout: can't be written: no space left on device"),
        ("retrieve --help > /dev/full", 2, "", "stdout: can't be written: no space left on device"),
        ("retrieve plan scenes.jsonl -o ./scenes.jsonl", 2, "", "scenes.jsonl: is read, and would be overwritten; write to another file"),
        (
            "retrieve plan scenes.jsonl --html page.png",
            2,
            "",
            "plan: page.png: the page is an HTML file; give it a name that ends in .html",
        ),
        ("retrieve show scenes.jsonl --html page", 2, "", "show: page: the page is an HTML file; give it a name that ends in .html"),
        ("ln plans.jsonl p.json; retrieve report plans.jsonl -o p.json", 2, "", "p.json: is read, and would be overwritten"),
        ("retrieve report plans.jsonl -o report.md 2>&-", 0, "", ""),
        ("retrieve report plans.jsonl -o report.md 2>/dev/full", 0, "", ""),
        ("retrieve report nowhere.jsonl 2>&-", 2, "", ""),
        ("retrieve report nowhere.jsonl 2>/dev/full", 2, "", ""),
        ("retrieve report plans.jsonl -o report.md <&- >&- 2>&-", 0, "", ""),
        ("retrieve --version <&- 2>&-", 0, "retrieve ", ""),
        ("retrieve robots ur5e --urdf /dev/full", 2, "", "/dev/full: can't be written: no space left on device"),
    ],
)
def test_streams(line: str, code: int, out: str, err: str, folder: Path) -> None:
    before = {p.name: p.read_bytes() for p in folder.iterdir()}
    found = bash(line, folder)
    assert (found[0], found[1][: len(out)], found[2][: len(err)]) == (code, out, err)
    assert found[2].count("\n") == bool(err)
    assert bool(found[1]) == bool(out)
    assert {p.name: p.read_bytes() for p in folder.iterdir() if p.name in before} == before
    if "report.md" in line:
        assert (folder / "report.md").read_text().startswith("# Retrieval report\n")


def test_a_file_that_grows_too_large_is_named(folder: Path) -> None:
    """As a full disk is: the message names the file, what was there before stays, and no part is left behind."""
    for name in ("report.html", "report.md"):
        (folder / name).write_text("before")
        code, _, err = bash(
            f"retrieve report plans.jsonl -o {name}", folder, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
        )
        assert (code, err) == (2, f"{name}: can't be written: file too large\n")
        assert (folder / name).read_text() == "before"
    assert {p.name for p in folder.iterdir()} == {"plans.jsonl", "scenes.jsonl", "report.html", "report.md"}
