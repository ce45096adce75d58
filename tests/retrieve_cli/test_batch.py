"""Batches: a scene's plan is its own whatever stands around it."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

import pytest

from kinematics.scene import Scene
from planning.io.scene_documents import scene_from_json
from retrieve_cli.__main__ import main

MEASURED = ("planning_time_s", "motion_time_s")


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four generated scenes, the last one without its seed."""
    file = tmp_path_factory.mktemp("scenes") / "scenes.jsonl"
    assert main(["gen", "-n", "4", "--seed", "5", "-o", str(file)]) == 0
    *others, last = file.read_text().splitlines(keepends=True)
    plain = json.loads(last)
    del plain["seed"]
    file.write_text("".join([*others, json.dumps(plain) + "\n"]))
    return file


def write(file: Path, lines: Iterable[str]) -> Path:
    file.write_text("".join(line.rstrip("\n") + "\n" for line in lines))
    return file


def results(file: Path) -> dict[str, str]:
    """The plans of a file by scene, without what was measured with a clock."""
    plans = [json.loads(line) for line in file.read_text().splitlines()]
    return {plan["scene"]: json.dumps({k: v for k, v in plan.items() if k not in MEASURED}) for plan in plans}


def test_a_scene_is_planned_alike_wherever_it_stands(scenes: Path, tmp_path: Path) -> None:
    """In a file, in the file turned round, alone, and by another process."""

    def plan(*args: str | Path) -> dict[str, str]:
        assert main(["plan", *map(str, args), "--policy", "random", "-o", str(tmp_path / "plans.jsonl")]) == 0
        return results(tmp_path / "plans.jsonl")

    lines = scenes.read_text().splitlines()
    whole = plan(scenes)
    assert len(whole) == 4
    assert plan(write(tmp_path / "reversed.jsonl", reversed(lines))) == whole
    assert plan(scenes, "--workers", "2") == whole
    for line in lines[1::2]:
        alone = plan(write(tmp_path / "alone.jsonl", [line]))
        assert alone == {name: text for name, text in whole.items() if name in alone}
    assert plan(scenes, "--seed", "1") != whole


def test_random_words_come_from_id_and_seed(scenes: Path) -> None:
    documents = [json.loads(line) for line in scenes.read_text().splitlines()]

    def word(**changes: object) -> int:
        return scene_from_json({**documents[0], **changes}).random_word

    words = [scene_from_json(d).random_word for d in documents]
    words += [word(id="other"), word(seed=[5, 9]), word(seed=[59]), word(seed=[-5, 10**30]), word(seed=[]), word(id="ü" * 500)]
    assert len(set(words)) == len(words)
    assert all(0 <= w < 2**63 for w in words)
    scene = scene_from_json(documents[0])
    assert Scene(**{**vars(scene), "target": "x", "regions_n": 3}).random_word == scene.random_word == words[0]
