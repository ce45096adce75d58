"""What an installed `retrieve` has: the packages that are listed, the data beside them, the entry point; nothing is built or downloaded."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from collections.abc import Callable
from fnmatch import fnmatch
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest

from kinematics.robots.named import named_robots
from planning.scenes.generation import SPECS
from retrieve_cli.__main__ import OURS

ROOT = Path(__file__).resolve().parent.parent
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PINNED = dict(
    re.fullmatch(r"([A-Za-z0-9._-]+)==(\S+)", line).groups()  # type: ignore[union-attr]
    for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    if line.strip() and not line.startswith("#")
)


def _canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def _names(requirements: list[str]) -> set[str]:
    return {_canonical(re.match(r"[A-Za-z0-9._-]+", r).group()) for r in requirements}  # type: ignore[union-attr]


def test_our_packages_are_listed_and_no_other() -> None:
    """Top-level names as plain as ours must not catch a tests/ or build/ folder."""
    find = PROJECT["tool"]["setuptools"]["packages"]["find"]
    assert find["include"] == [f"{name}*" for name in OURS]
    setuptools = pytest.importorskip("setuptools")
    found = setuptools.find_packages(str(ROOT), include=find["include"])
    assert {name.split(".")[0] for name in found} == set(OURS)
    modules = {".".join(p.parent.relative_to(ROOT).parts) for name in OURS for p in (ROOT / name).rglob("*.py")}
    assert modules == set(found)  # a folder without __init__.py would be left at home


def test_data_travels_with_the_packages() -> None:
    """Every file that is no Python below our packages, robots.toml and the specs among them."""
    patterns = PROJECT["tool"]["setuptools"]["package-data"]
    data = [p.relative_to(ROOT) for name in OURS for p in (ROOT / name).rglob("*") if p.is_file() and "__pycache__" not in p.parts]
    data = [p for p in data if p.suffix != ".py" and not p.name.startswith(".")]
    assert {Path("kinematics/robots/robots.toml"), *(Path(f"planning/scenes/specs/{name}.toml") for name in SPECS)} <= set(data)
    for path in data:
        inside = path.relative_to(path.parts[0]).as_posix()
        assert any(fnmatch(inside, pattern) for pattern in patterns.get(path.parts[0], ())), f"{path} would be left out of the wheel"


def test_the_entry_point_resolves() -> None:
    point = EntryPoint("retrieve", PROJECT["project"]["scripts"]["retrieve"], "console_scripts")
    load: Callable[[list[str]], int] = point.load()
    assert load(["--version"]) == 0


def test_version_from_the_command_line() -> None:
    program = [sys.executable, "-W", "error", "-m", "retrieve_cli"]
    done = subprocess.run([*program, "--version"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, f"retrieve {PROJECT['project']['version']}\n", "")


def test_the_changelog_and_the_readme_know_the_version() -> None:
    assert f"## {PROJECT['project']['version']}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert (ROOT / PROJECT["project"]["readme"]).is_file()


def test_robots_are_dependencies_or_extras() -> None:
    """The default robot comes along; the others by an extra of their own name."""
    for name, entry in named_robots().items():
        required = PROJECT["project"]["optional-dependencies"][entry["extra"]] if "extra" in entry else PROJECT["project"]["dependencies"]
        assert _canonical(entry["distribution"]) in _names(required), name
    assert "extra" not in named_robots()["ur5e"]


@pytest.mark.parametrize("extra", [None, *PROJECT["project"]["optional-dependencies"]])
def test_what_is_required_is_pinned(extra: str | None) -> None:
    required = PROJECT["project"]["dependencies"] if extra is None else PROJECT["project"]["optional-dependencies"][extra]
    assert _names(required) <= {_canonical(name) for name in PINNED}


def test_torch_is_pinned_as_agreed() -> None:
    assert PINNED["torch"] == "2.13.0"


def test_make_test_is_the_test_command() -> None:
    """One command, in the README, in CI and in the Makefile."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert "make test" in readme
    assert "make demo" in readme
    assert "make test" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert {"demo", "test"} <= set(re.findall(r"^([a-z]+):", makefile, re.MULTILINE))


def test_the_readme_names_what_exists() -> None:
    """Every path that the README writes in code is there."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    for path in re.findall(r"`((?:examples|kinematics|perception|planning|retrieve_cli|tests|benchmarks)/[\w./-]*)`", readme):
        assert (ROOT / path).exists(), path


def test_the_readme_has_the_figures_of_the_results() -> None:
    """Of each planner success deep and strict, on both specs."""
    results = (ROOT / "docs" / "results.md").read_text(encoding="utf-8").split("\n## Planners")[1].split("\n## ")[0]
    tables = [dict(re.findall(r"^\| ([\w-]+) \| (\d+ \| \d+) ", part, re.M)) for part in results.split("\nSpec `")[1:3]]
    row = r"^\| \**([\w-]+)\** \| \**(\d+)\** \((\d+)\) \| \**(\d+)\** \((\d+)\) \|"
    said = re.findall(row, (ROOT / "README.md").read_text(encoding="utf-8"), re.M)
    assert len(said) == 4
    for planner, *figures in said:
        assert " | ".join(figures) == " | ".join(table[planner] for table in tables), planner
