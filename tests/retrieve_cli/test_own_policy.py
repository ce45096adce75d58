"""`plan --policy MODULE:FUNCTION`: a policy of the user's own plans like those that ship, and answers for what it does wrong."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from planning import Policy, plan_scene, read_scenes
from planning.io.results import Results
from planning.policies.random import random_object, random_region
from retrieve_cli.__main__ import main

ROOT = Path(__file__).resolve().parents[2]
TRIAL = ROOT / "examples" / "02_plum_behind_cylinders.jsonl"
OWN = """
from planning import Policy
from planning.policies.random import random_object, random_region
def mine(motions):
    return Policy(random_object, random_region)
def raises(motions):
    raise KeyError("no\\nsuch thing")
def none(motions):
    return None
def late(motions):
    def select(seen, rng):
        yield from []
        raise RuntimeError("out of ideas")
    return Policy(select, random_region)
def strange(motions):
    return Policy(lambda seen, rng: ["nobody"], random_region)
def beyond(motions):
    return Policy(random_object, lambda seen, name, rng: [len(seen.regions)])
"""


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "ways_of_mine.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def planned(*args: str | Path) -> dict[str, Any]:
    assert main(["plan", str(TRIAL), *map(str, args), "-o", "plans.jsonl"]) == 0
    (line,) = Path("plans.jsonl").read_text().splitlines()
    return {name: value for name, value in json.loads(line).items() if name not in ("planning_time_s", "motion_time_s")}


@pytest.mark.parametrize("spec", ["ways_of_mine:mine", "ways_of_mine.py:mine"])
def test_resume_compares_its_code(module: Path, spec: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    scenes, call = Path("scenes.jsonl"), ["plan", "scenes.jsonl", "--policy", spec, "--rule", "strict", "-o", "plans.jsonl"]
    shutil.copy(TRIAL.with_name("plum.obj"), module)
    scenes.write_text(TRIAL.read_text() + TRIAL.read_text().replace('"id": "', '"id": "again-', 1))
    write, calls = Results.__call__, list[object]()

    def once(self: Results[Any], value: object) -> None:
        calls.append(value)
        if len(calls) == 2:
            raise KeyboardInterrupt
        write(self, value)

    with monkeypatch.context() as stopped:
        stopped.setattr(Results, "__call__", once)
        assert main(call) == 130
    file = Path("ways_of_mine.py")
    file.write_text(OWN + "# other code\n")
    capsys.readouterr()
    assert main([*call, "--resume"]) == 2
    assert "plans.part.jsonl: was made otherwise: code of --policy was '" in capsys.readouterr().err
    file.write_text(OWN)
    assert main([*call, "--resume"]) == 0
    assert len(Path("plans.jsonl").read_text().splitlines()) == 2


@pytest.mark.parametrize("spec", ["ways_of_mine:mine", "ways_of_mine.py:mine"])
def test_it_plans_as_the_same_policy_does_that_ships(module: Path, spec: str) -> None:
    own, shipped = planned("--policy", spec, "--rule", "region"), planned("--policy", "random", "--rule", "region")
    assert own.pop("policy") == "mine"
    assert shipped.pop("policy") == "random"
    assert own == shipped
    (scene,) = read_scenes(TRIAL)
    library = plan_scene(scene, lambda motions: Policy(random_object, random_region), rule="region")
    assert [move.object for move in library.moves] == [move["object"] for move in own["moves"]]


def test_it_is_known_to_other_processes_and_to_the_loop_that_looks(module: Path) -> None:
    assert planned("--policy", "ways_of_mine:mine", "--workers", "2") == planned("--policy", "ways_of_mine:mine")
    assert planned("--policy", "ways_of_mine:mine", "--sense")["policy"] == "mine"


@pytest.mark.parametrize(
    ("spec", "says"),
    [
        ("ways_of_mine:main", "ways_of_mine has no function 'main' (did you mean 'mine'?)"),
        ("nowhere.py:mine", "--policy: nowhere.py: no such file"),
        ("nowhere:mine", "ModuleNotFoundError: No module named 'nowhere'"),
        ("ways_of_mine:", "MODULE:FUNCTION is expected"),
        ("ways_of_mine:raises", "--policy ways_of_mine:raises: KeyError: 'no\\nsuch thing'"),
        ("ways_of_mine:none", "returned a NoneType, and a planning.Policy is expected"),
        ("ways_of_mine:late", "--policy ways_of_mine:late: select: RuntimeError: out of ideas"),
        ("ways_of_mine:strange", "select: 'nobody' is not an object that can be moved"),
        ("ways_of_mine:beyond", "place: 100 is not the number of a region"),
    ],
)
def test_what_it_does_wrong_ends_the_run_in_one_line(module: Path, spec: str, says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(TRIAL), "--policy", spec, "-o", "plans.jsonl"]) == 2
    assert says in capsys.readouterr().err.splitlines()[-1]
    assert not Path("plans.jsonl").exists()


def test_its_networks_are_its_own_affair(module: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(TRIAL), "--policy", "ways_of_mine:mine", "--model", str(tmp_path)]) == 2
    assert "the policy ways_of_mine:mine asks no network" in capsys.readouterr().err
