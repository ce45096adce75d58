"""The scripts in benchmarks/ still fit what they measure: each begins, and the one that reaches into the loop finds all its parts."""

from __future__ import annotations

import os
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
SCRIPTS = sorted(file for file in (ROOT / "benchmarks").glob("*.py") if "ArgumentParser(" in file.read_text(encoding="utf-8"))
DEVELOPERS_OWN = ("mujoco",)
"""What a script may need that no extra of `dev` installs."""


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda file: file.stem)
def test_a_script_says_what_it_does(script: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", [str(script), "--help"])
    monkeypatch.setattr(sys, "path", [str(script.parent), *sys.path])
    environment = dict(os.environ)
    try:
        with pytest.raises(SystemExit) as end:
            runpy.run_path(str(script), run_name="__main__")
    except ModuleNotFoundError as e:
        if e.name not in DEVELOPERS_OWN:
            raise
        pytest.skip(f"{e.name} is not installed")
    finally:
        os.environ.clear()
        os.environ.update(environment)
    assert end.value.code == 0
    assert "usage:" in capsys.readouterr().out


def test_the_time_of_a_plan_is_told_stage_by_stage(tmp_path: Path) -> None:
    """In a process of its own: it puts a clock into the loop's parts, by name."""
    scenes, run = tmp_path / "scenes.jsonl", [sys.executable, "-m", "retrieve_cli", "gen", "--seed", "5", "-o"]
    subprocess.run([*run, str(scenes)], cwd=ROOT, check=True, capture_output=True)
    told = subprocess.run(
        [sys.executable, "benchmarks/whole_time.py", str(scenes), "--rounds", "1"],
        cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)}, check=True, capture_output=True, text=True,
    ).stdout.splitlines()  # fmt: skip
    stages = {line.split()[0]: [float(ms) for ms in line.split()[1:]] for line in told[2:]}
    whole = stages.pop("whole")[0]
    assert sum(ms[0] for ms in stages.values()) == pytest.approx(whole, abs=0.1 * len(stages))
    assert {"motions", "verify", "verdict", "trajectories"} <= {name for name, ms in stages.items() if ms[0] > 0}
