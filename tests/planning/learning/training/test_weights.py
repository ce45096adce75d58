"""From scenes to a model that plans, as `make weights` makes it, on a handful of scenes: killed at random points, the same bytes."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from planning.io.files import read_plans
from planning.learning.networks.model import from_pretrained
from planning.policies import POLICIES
from retrieve_cli.__main__ import main

ROOT = Path(__file__).resolve().parents[4]
LABEL = ("label", "-n", "6", "--paths", "4", "--moves", "1", "--objects", "1", "--seed", "3", "--spec", "paper", "--spec", "shelf")
TRAIN = ("--epochs", "2", "--width", "16", "--threads", "1", "--device", "cpu")
MORTAL = """
import os, signal, sys
import retrieve_cli.label
from retrieve_cli.__main__ import main

retrieve_cli.label.SHARD = 2
left = int(sys.argv[1])

def mortal(function):
    def call(*args):
        global left
        result = function(*args)
        left -= 1
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return result
    return call

retrieve_cli.label.label_item = mortal(retrieve_cli.label.label_item)
if sys.argv[2] == "train":  # labels need no torch
    import planning.learning.training.train as train
    train._save = mortal(train._save)
raise SystemExit(main(sys.argv[2:]))
"""


def run(kill_after: int, *args: str | Path) -> int:
    """The program in a process of its own, shards of two scenes; it kills itself after so many scenes or checkpoints (0: never)."""
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-W", "error", "-c", MORTAL, str(kill_after), *map(str, args)]
    done = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode in (0, -signal.SIGKILL), done.stderr
    return done.returncode


def folder_bytes(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in folder.iterdir() if p.suffix != ".png"}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """labels/ and model/, made without interruption."""
    folder = tmp_path_factory.mktemp("made")
    assert run(0, *LABEL, "-o", folder / "labels") == 0
    assert run(0, "train", folder / "labels", "-o", folder / "model", *TRAIN) == 0
    return folder


def test_labels_killed_at_random_points(made: Path, tmp_path: Path) -> None:
    points, kills = np.random.default_rng(20).integers(3, 5, 8), 0
    for point in points:  # at least one shard of two scenes more each time
        if run(int(point), *LABEL, "-o", tmp_path / "labels") == 0:
            break
        kills += 1
        assert not json.loads((tmp_path / "labels" / "manifest.json").read_text())["complete"]
    assert kills >= 2
    assert folder_bytes(tmp_path / "labels") == folder_bytes(made / "labels")


@pytest.mark.parametrize("point", [1, 3])
def test_training_killed_after_an_epoch(point: int, made: Path, tmp_path: Path) -> None:
    """In the first network's first epoch, and in the second's."""
    assert run(point, "train", made / "labels", "-o", tmp_path / "model", *TRAIN) == -signal.SIGKILL
    assert not (tmp_path / "model" / "config.json").exists()
    assert run(0, "train", made / "labels", "-o", tmp_path / "model", *TRAIN, "--resume") == 0
    assert folder_bytes(tmp_path / "model") == folder_bytes(made / "model")


def test_the_model_plans(made: Path, tmp_path: Path) -> None:
    assert from_pretrained(made / "model").robot == "ur5e"
    assert main(["gen", "-n", "1", "--seed", "4", "-o", str(tmp_path / "scene.jsonl")]) == 0
    plan = ["plan", str(tmp_path / "scene.jsonl"), "--policy", "neural", "--model", str(made / "model"), "-o", str(tmp_path / "plan.jsonl")]
    assert main(plan) == 0
    ((_, found),) = read_plans(tmp_path / "plan.jsonl")
    assert found.policy == "neural"
    assert found.verified


# The Makefile ---------------------------------------------------------------------------------------------------------------------------


def dry_run(*args: str) -> str:
    command = ["make", "--dry-run", "--always-make", *args]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60, check=True).stdout.replace("\\\n", " ")


def commands(text: str) -> list[list[str]]:
    """The calls of `retrieve` in a dry run, without what the shell finds out."""
    lines = (re.sub(r"\$\(.*|\|\|.*", "", line).split() for line in text.splitlines())
    return [line[1:] for line in lines if line and line[0] == ".venv/bin/retrieve"]


def test_make_weights_says_what_it_does() -> None:
    found = commands(dry_run("weights", "SCALE=0.01"))
    labels = {c[c.index("--robot") + 1]: c for c in found if c[0] == "label"}
    trained = [c for c in found if c[0] == "train"]
    assert [c[0] for c in found].index("train") > 0
    assert (len(labels), len(trained), len(found)) == (2, 3, 5)
    assert [c[1] for c in trained if "paper" in c] == [labels["ur5e"][-1]]
    for robot, label in labels.items():
        train = next(c for c in trained if c[1] == label[-1] and "paper" not in c)
        scenes = int(re.search(rf"LABEL_SCENES_{robot} \?= (\d+)", (ROOT / "Makefile").read_text())[1])  # type: ignore[index]
        assert int(label[label.index("-n") + 1]) == max(8, int(scenes / 100 + 0.5))
        assert found.index(train) > found.index(label)
    assert "planning/learning/weights" not in dry_run("weights", "SCALE=0.01")
    assert "planning/learning/weights" in dry_run("weights")


def test_make_table_plans_every_policy_on_every_spec_under_every_rule() -> None:
    found = commands(dry_run("table", "TABLE_SCENES=7", "TABLE_SEED=5"))
    made, plans = [c for c in found if c[0] == "gen"], [c for c in found if c[0] == "plan"]
    specs = {file.stem for file in (ROOT / "planning" / "scenes" / "specs").glob("*.toml")}
    assert [(c[c.index("-n") + 1], c[c.index("--seed") + 1]) for c in made] == [("7", "5")] * len(specs)
    assert {c[c.index("--spec") + 1] for c in made} == specs
    sensed = [c for c in plans if "--sense" in c]
    asked = {(c[1], c[c.index("--policy") + 1], c[c.index("--rule") + 1]) for c in plans if c not in sensed}
    assert len(asked) == len(plans) - len(sensed) == len(specs) * 2 * len(POLICIES)
    assert {policy for _, policy, _ in asked} == set(POLICIES)
    assert {rule for *_, rule in asked} == {"deep", "strict"}
    assert {Path(c[1]).parent.name for c in sensed} == {"paper", "paper-any"}
    assert {c[c.index("--policy") + 1] for c in sensed} == {"random", "local", "neural"}
    assert len({c[-1] for c in plans}) == len(plans)
