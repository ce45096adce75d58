"""The scripts in benchmarks/ still fit what they measure: each begins, and the one that reaches into the loop finds all its parts."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
SCRIPTS = sorted(file for file in (ROOT / "benchmarks").glob("*.py") if "ArgumentParser(" in file.read_text(encoding="utf-8"))
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}
DEVELOPERS_OWN = ("mujoco",)
"""What a script may need that no extra of `dev` installs."""


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda file: file.stem)
def test_a_script_says_what_it_does(script: Path) -> None:
    """In a process of its own: scripts set the environment, and one starts itself anew."""
    told = subprocess.run([sys.executable, str(script), "--help"], cwd=ROOT, env=ENVIRONMENT, capture_output=True, text=True)
    if any(f"No module named '{name}'" in told.stderr for name in DEVELOPERS_OWN):
        pytest.skip("it needs what is not installed")
    assert told.returncode == 0, told.stderr
    assert told.stdout.startswith("usage:")


def test_the_time_of_a_plan_is_told_stage_by_stage(tmp_path: Path) -> None:
    """The clock is put into the loop's parts by name."""
    scenes, run = tmp_path / "scenes.jsonl", [sys.executable, "-m", "retrieve_cli", "gen", "--seed", "5", "-o"]
    subprocess.run([*run, str(scenes)], cwd=ROOT, check=True, capture_output=True)
    told = subprocess.run(
        [sys.executable, "benchmarks/whole_time.py", str(scenes), "--rounds", "1"],
        cwd=ROOT, env=ENVIRONMENT, check=True, capture_output=True, text=True,
    ).stdout.splitlines()  # fmt: skip
    stages = {line.split()[0]: [float(ms) for ms in line.split()[1:]] for line in told[2:]}
    whole, first = (stages.pop(name)[0] for name in ("whole", "first"))
    assert first > 0  # of the same scene, whatever was made and loaded then
    assert sum(ms[0] for ms in stages.values()) == pytest.approx(whole, abs=0.1 * len(stages))
    assert {"motions", "verify", "verdict", "trajectories"} <= {name for name, ms in stages.items() if ms[0] > 0}


def test_listed_mutants_are_of_lines_that_are_there() -> None:
    """A line that was changed or moved takes its entry along, or its mutants would count as survivors."""
    for module, entries in tomllib.loads((ROOT / "benchmarks" / "mutate_equivalent.toml").read_text(encoding="utf-8")).items():
        lines = {line.strip() for line in (ROOT / module).read_text(encoding="utf-8").splitlines()}
        assert {entry["line"] for entry in entries} <= lines, module
