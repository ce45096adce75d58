"""`retrieve verify`: a line a plan, exit 1 where one is false, one line and exit 2 for bad input; and x_g judged by `retrieve plan`."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import Handmade, Json

from kinematics.robots.robot import Robot
from planning.conclusion import hand_travel, objective
from planning.io.plan_documents import plan_from_json
from planning.io.scene_documents import scene_from_json
from retrieve_cli.__main__ import main

Files = Callable[..., tuple[str, str]]


@pytest.fixture
def files(handmade: Handmade, ur5e: Robot, tmp_path: Path) -> Files:
    """Writes the scene and plans made by hand: files(change, …), a plan for each change."""
    scene, plan = scene_from_json(handmade.scene), plan_from_json(handmade.plan)
    honest = {**handmade.plan, "hand_travel_m": hand_travel(ur5e, scene, plan.motions), "return": objective(scene, plan.moves, True)}
    honest["moves"] = [{**honest["moves"][0], "region": 18}]

    def write(*changes: Callable[[Json], object]) -> tuple[str, str]:
        plans = []
        for change in changes:
            plan = json.loads(json.dumps(honest))
            change(plan)
            plans.append(json.dumps(plan) + "\n")
        (tmp_path / "scenes.jsonl").write_text(json.dumps(handmade.scene) + "\n")
        (tmp_path / "plans.jsonl").write_text("".join(plans))
        return str(tmp_path / "scenes.jsonl"), str(tmp_path / "plans.jsonl")

    return write


def as_it_is(plan: Json) -> None:
    pass


def without_motions(plan: Json) -> None:
    plan.update(motions=[], moves=[], success=False)


def longer(plan: Json) -> None:
    plan["hand_travel_m"] += 1.0


def test_a_line_a_plan(files: Files, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", *files(as_it_is, without_motions)]) == 0
    out, err = capsys.readouterr()
    lines = out.splitlines()
    assert [line.split(": ")[1:3] for line in lines] == [["handmade", "true"], ["handmade", "null"]]
    assert "Traceback" not in err


def test_one_that_is_false_decides_the_exit_code(files: Files, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", *files(as_it_is, longer)]) == 1
    assert "plans.jsonl:2: handmade: false: plan: its hand_travel_m is" in capsys.readouterr().out


def test_a_plan_on_what_was_seen_is_judged_on_the_truth(files: Files, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Under the true names; without being told what was seen it is false, and the remedy is named. Fingers that stop short are told."""

    def renamed(plan: Json) -> None:
        text = json.dumps(plan)
        for body in scene["objects"]:
            text = text.replace(json.dumps(body["name"]), json.dumps(f"seen_{body['name']}"))
        plan.update(json.loads(text))

    scene = json.loads(Path(files(as_it_is)[0]).read_text())
    truth, plans = files(renamed)
    seen = tmp_path / "seen.jsonl"
    for body in scene["objects"]:
        body["name"] = f"seen_{body['name']}"
        body["T_world_object"]["p"][0] += 0.002
    scene["target"] = f"seen_{scene['target']}"
    seen.write_text(json.dumps(scene) + "\n")
    assert main(["verify", truth, plans]) == 1
    assert "--seen FILE says on what" in capsys.readouterr().err
    assert main(["verify", truth, plans, "--seen", str(seen)]) == 0
    assert ": handmade: true" in capsys.readouterr().out
    slim = json.loads(_read(truth))
    for body in slim["objects"]:
        body["shape"] |= _slimmer(body["shape"])
    Path(truth).write_text(json.dumps(slim) + "\n")
    assert main(["verify", truth, plans, "--seen", str(seen)]) == 1
    assert "stops" in capsys.readouterr().out
    seen.write_text(json.dumps({**scene, "id": "another"}) + "\n")
    assert main(["verify", truth, plans, "--seen", str(seen)]) == 2
    assert "none of the 1 scenes in --seen" in capsys.readouterr().err


def _read(file: str) -> str:
    return Path(file).read_text(encoding="utf-8")


def _slimmer(shape: Json) -> Json:
    """By 8 mm, so that pads that close as planned don't reach it."""
    return (
        {"radius_m": shape["radius_m"] - 0.004}
        if shape["type"] == "cylinder"
        else {"size_m": [*np.subtract(shape["size_m"][:2], 0.008), shape["size_m"][2]]}
    )


def test_json_lists_every_fault(files: Files, capsys: pytest.CaptureFixture[str]) -> None:
    def more(plan: Json) -> None:
        longer(plan)
        plan["return"] = 3.0

    assert main(["verify", *files(more), "--json"]) == 1
    (line,) = capsys.readouterr().out.splitlines()
    found = json.loads(line)
    assert (found["scene"], found["verified"], found["notes"]) == ("handmade", False, [])
    assert [f["stage"] for f in found["faults"]] == ["plan", "plan"]
    assert found["faults"][1]["amount"] == pytest.approx(1.0)


def test_workers_say_the_same(files: Files, capsys: pytest.CaptureFixture[str]) -> None:
    given = files(as_it_is, longer, without_motions)
    assert main(["verify", *given]) == 1
    alone = capsys.readouterr().out
    assert main(["verify", *given, "--workers", "2"]) == 1
    assert capsys.readouterr().out == alone


def test_what_is_asked_can_be_set(files: Files, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", *files(as_it_is), "--mu", "0.1", "--max-tilt", "5"]) == 0
    assert main(["verify", *files(as_it_is), "--robot", "panda"]) in (1, 2)
    capsys.readouterr()
    assert main(["verify", *files(as_it_is), "--mu", "-1"]) == 2


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda p: p.update(scene="another"), "none of the 1 scenes"),
        (lambda p: p["motions"][0].update(q=[[1.0]]), "numbers"),
        (lambda p: p["motions"][0].update(stage="dance"), "not one of"),
        (lambda p: p.pop("moves"), "missing field 'moves'"),
        (lambda p: p.update(schema="retrieve/plan@99"), "too new"),
    ],
)
def test_bad_input_is_one_line(files: Files, capsys: pytest.CaptureFixture[str], change: Callable[[Json], object], word: str) -> None:
    assert main(["verify", *files(change)]) == 2
    out, err = capsys.readouterr()
    told = [line for line in err.splitlines() if "getting ready" not in line]
    assert len(told) == 1
    assert word in told[0]
    assert out == ""


def test_two_scenes_of_one_name_are_refused(files: Files, capsys: pytest.CaptureFixture[str]) -> None:
    scenes, plans = files(as_it_is)
    line = Path(scenes).read_text()
    Path(scenes).write_text(line + line)
    assert main(["verify", scenes, plans]) == 0  # the same one twice
    other = json.loads(line)
    other["objects"][0]["shape"]["radius_m"] = 0.02
    Path(scenes).write_text(line + json.dumps(other) + "\n")
    assert main(["verify", scenes, plans]) == 2
    assert "another scene is called handmade" in capsys.readouterr().err


def test_both_from_stdin_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", "-"]) == 2
    assert "can't both come from stdin" in capsys.readouterr().err


def test_plans_that_anyone_wrote_are_judged_and_never_crash(files: Files, capsys: pytest.CaptureFixture[str]) -> None:
    """Numbers, names and lists of a plan replaced at random: a verdict or one line."""
    rng = np.random.default_rng(8)
    odd = [1e300, -1e300, 1e-300, 0.01, -2.5, 7.0, 0, -1, 10**18, "", "left", "can", "nobody", None, True, [], {}, [1.0], 0.5]

    def scramble(plan: Json) -> None:
        for _ in range(int(rng.integers(1, 3))):
            at: object = plan
            while isinstance(at, (dict, list)) and at:
                key = list(at)[rng.integers(len(at))] if isinstance(at, dict) else int(rng.integers(len(at)))
                inner = at[key]  # type: ignore[index, call-overload]
                if not isinstance(inner, (dict, list)) or not inner or rng.random() < 0.05:
                    like = [x for x in odd if isinstance(x, float)] if isinstance(inner, float) and rng.random() < 0.8 else odd
                    at[key] = like[rng.integers(len(like))]  # type: ignore[index, call-overload]
                    break
                at = inner

    codes = {0: 0, 1: 0, 2: 0}
    for _ in range(60):
        code = main(["verify", *files(scramble)])
        codes[code] += 1
        out, err = capsys.readouterr()
        assert len(out.splitlines()) == (0 if code == 2 else 1)
        assert "Traceback" not in err
    assert min(codes[1], codes[2]) > 5


# --------------------------------------------------------------------------------------------------- x_g, judged before anything is moved


def beside(scene: Json) -> Json:
    grasp = {**scene["grasp"], "T_world_hand": {**scene["grasp"]["T_world_hand"], "p": [0.6, 0.15, 0.3]}}
    return {**scene, "id": "beside", "grasp": grasp}


def test_one_scene_whose_grasp_misses_is_an_input_error(handmade: Handmade, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "scenes.jsonl").write_text(json.dumps(beside(handmade.scene)) + "\n")
    assert main(["plan", str(tmp_path / "scenes.jsonl"), "--policy", "local", "-o", str(tmp_path / "plans.jsonl")]) == 2
    err = capsys.readouterr().err
    assert "scenes.jsonl:1: grasp: x_g does not hold box: the pads close" in err
    assert not (tmp_path / "plans.jsonl").exists()


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_in_a_batch_it_is_a_plan_that_failed(
    handmade: Handmade, tmp_path: Path, capsys: pytest.CaptureFixture[str], order: tuple[int, ...]
) -> None:
    both = (beside(handmade.scene), handmade.scene)
    (tmp_path / "scenes.jsonl").write_text("".join(json.dumps(both[i]) + "\n" for i in order))
    assert main(["plan", str(tmp_path / "scenes.jsonl"), "--policy", "local", "-o", str(tmp_path / "plans.jsonl")]) == 0
    plans = [json.loads(line) for line in (tmp_path / "plans.jsonl").read_text().splitlines()]
    assert [p["scene"] for p in plans] == [both[i]["id"] for i in order]
    for plan, i in zip(plans, order):
        if i == 0:
            assert plan["reason"]["stage"] == "scene"
            assert (plan["success"], plan["verified"], plan["motions"], plan["moves"]) == (False, None, [], [])
        else:
            assert plan["reason"] is None or plan["reason"]["stage"] != "scene"
