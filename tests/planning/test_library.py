"""The library's face: what the packages offer is there, costs nothing until it is used, and plans like the command line."""

from __future__ import annotations

import gc
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import planning
from planning import load_robot, plan_scene, read_plans, read_scenes, verify_plan, write_plans, write_scenes
from planning.io.scene_documents import scene_to_json
from planning.motion.cell.workcell import Workcell
from retrieve_cli.__main__ import main

ROOT = Path(__file__).resolve().parents[2]
TRIAL = ROOT / "examples" / "02_plum_behind_cylinders.jsonl"


@pytest.mark.parametrize("package", ["kinematics", "perception", "planning"])
def test_everything_that_is_offered_is_there(package: str) -> None:
    face = importlib.import_module(package)
    for name in face.__all__:
        assert getattr(face, name).__doc__, name
    assert (ROOT / package / "py.typed").is_file()
    with pytest.raises(AttributeError, match=r"has no attribute 'nothing'"):
        getattr(face, "nothing")  # noqa: B009


def test_importing_a_package_imports_nothing_heavy() -> None:
    code = (
        "import sys, kinematics, perception, planning; print(*sorted({m.split('.')[0] for m in sys.modules} & {'numpy', 'numba', 'torch'}))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_a_scene_is_planned_and_verified_as_the_command_line_does(tmp_path: Path) -> None:
    (scene,) = read_scenes(TRIAL)
    plan = plan_scene(scene, policy="local", seed=3)
    assert plan.success
    assert verify_plan(scene, plan) == ()
    write_plans([plan], tmp_path / "ours.jsonl")
    assert main(["plan", str(TRIAL), "--policy", "local", "--seed", "3", "-o", str(tmp_path / "theirs.jsonl")]) == 0
    ours, theirs = (next(read_plans(tmp_path / f"{who}.jsonl")) for who in ("ours", "theirs"))
    assert [m.q.tolist() for m in ours.motions] == [m.q.tolist() for m in theirs.motions]
    assert load_robot("ur5e").joint_names == ours.motions[0].joint_names


def test_scenes_are_written_as_they_were_read(tmp_path: Path) -> None:
    write_scenes(read_scenes(TRIAL), tmp_path / "ours.jsonl")
    written, read = (list(read_scenes(file)) for file in (tmp_path / "ours.jsonl", TRIAL))
    assert [scene_to_json(scene) for scene in written] == [scene_to_json(scene) for scene in read]


@pytest.mark.parametrize("policy", ["neural", "random"])
def test_what_a_scene_was_planned_with_is_gone_when_the_plan_is_there(policy: str) -> None:
    """Megabytes of packed bodies, that the garbage collector would find much later."""

    def cells() -> int:
        return sum(type(thing) is Workcell for thing in gc.get_objects())

    (scene,) = read_scenes(TRIAL)
    before = cells()
    gc.disable()
    try:
        assert plan_scene(scene, policy=policy).motions
        assert cells() == before
    finally:
        gc.enable()


def test_a_policy_of_ones_own_is_a_function_of_the_motions(monkeypatch: pytest.MonkeyPatch) -> None:
    (scene,) = read_scenes(TRIAL)
    asked = []

    def nobody(motions: planning.Motions) -> planning.Policy:
        asked.append(motions)
        return planning.Policy(lambda seen, rng: [], lambda seen, name, rng: [])

    plan = plan_scene(scene, nobody)
    assert (plan.policy, plan.success, len(asked)) == ("nobody", False, 1)
