"""Batches: a scene's plan is its own whatever stands around it, a bad line does not end one, and what was broken off is gone on with."""

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


# Invalid lines ----------------------------------------------------------------------------------------------------------------------------


def mixed(scenes: Path, file: Path) -> Path:
    """Four scenes among lines that are none: broken JSON, a wrong size, an object with the name of a link, and no text at all."""
    good = scenes.read_text().splitlines()
    sized, named = json.loads(good[1]), json.loads(good[2])
    sized["id"], sized["cabinet"]["size_m"][0] = "sized", -0.5
    named["id"], named["objects"][0]["name"] = "named", "forearm_link"
    named["target"] = named["objects"][0]["name"] if named["target"] not in [o["name"] for o in named["objects"]] else named["target"]
    lines = ['{"id": "cut off', good[0], json.dumps(sized), good[1], good[2], json.dumps(named), good[3]]
    write(file, lines)
    file.write_bytes(file.read_bytes() + b"\xff\xfe\n")
    return file


def test_a_line_that_is_no_scene_gets_a_plan_that_says_so(scenes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The others are planned as if it were not there, by one process and by two; --strict counts it as unsolved."""
    assert main(["plan", str(scenes), "--policy", "local", "-o", str(tmp_path / "good.jsonl")]) == 0
    file, whole = mixed(scenes, tmp_path / "mixed.jsonl"), results(tmp_path / "good.jsonl")
    capsys.readouterr()
    for workers in ("1", "2"):
        out = tmp_path / f"plans-{workers}.jsonl"
        assert main(["plan", str(file), "--policy", "local", "--workers", workers, "--strict", "-o", str(out)]) == 1
        found = results(out)
        assert {name: found[name] for name in whole} == whole
        assert [json.loads(line)["scene"] for line in out.read_text().splitlines()][::2] == [
            "line 1",
            "sized",
            list(whole)[2],
            list(whole)[3],
        ]
        refused = {name: json.loads(text) for name, text in found.items() if name not in whole}
        assert set(refused) == {"line 1", "sized", "named", "line 8"}
        assert all(plan["reason"]["stage"] == "scene" and not plan["success"] and plan["policy"] == "local" for plan in refused.values())
        assert refused["sized"]["reason"]["detail"] == "cabinet.size_m: -0.5 is not positive"
        assert refused["named"]["reason"]["detail"].startswith("object 'forearm_link' has the name of a link of the robot ur5e")
        told = [line for line in capsys.readouterr().err.splitlines() if line.endswith("(its plan says so)")]
        assert [line.split(": ")[0] for line in told] == [f"{file}:{n}" for n in (1, 3, 6, 8)]
    assert main(["report", str(tmp_path / "plans-1.jsonl"), "-o", str(tmp_path / "report.md")]) == 0
    assert "Scene: it is invalid" in (tmp_path / "report.md").read_text()
    judged_with_what_can_not_be_meant(file, tmp_path / "plans-1.jsonl", tmp_path, capsys)


def judged_with_what_can_not_be_meant(file: Path, plans: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What did not end the batch keeps nobody from judging, reporting and showing its plans; but motions need a scene."""
    capsys.readouterr()
    assert main(["verify", str(file), str(plans)]) == 0
    verdicts = [line.split(": ")[2] for line in capsys.readouterr().out.splitlines()]
    assert len(verdicts) == 8
    assert {verdicts[i] for i in (0, 2, 5, 7)} == {"null"}
    assert "true" in verdicts
    assert main(["report", str(plans), "--scenes", str(file), "-o", str(tmp_path / "more.md")]) == 0
    assert main(["show", str(plans), "--scenes", str(file), "--index", "4", "--html", str(tmp_path / "page.html")]) == 0
    assert main(["show", str(plans), "--scenes", str(file), "--index", "2", "--html", str(tmp_path / "page.html")]) == 2
    assert capsys.readouterr().err.splitlines()[-1] == f"{file}:3: cabinet.size_m: -0.5 is not positive"
    moving = json.loads(next(line for line in plans.read_text().splitlines() if json.loads(line)["motions"]))
    strange = write(tmp_path / "strange.jsonl", [json.dumps(moving | {"scene": "sized"})])
    assert main(["verify", str(file), str(strange)]) == 2
    assert capsys.readouterr().err.splitlines()[-1] == (
        f"{strange}:1: its scene is invalid: {file}:3: cabinet.size_m: -0.5 is not positive"
    )


def test_failing_fast_and_nothing_but_bad_lines(scenes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Both are bad input, told in one line; results that were there before stay."""
    file, out = mixed(scenes, tmp_path / "mixed.jsonl"), tmp_path / "plans.jsonl"
    write(tmp_path / "late.jsonl", [scenes.read_text().splitlines()[0], "{"])
    bad = write(tmp_path / "bad.jsonl", ["{", "[]"])
    for args, says in (
        ([file, "--fail-fast"], f"{file}:1: broken JSON at column 8"),
        ([tmp_path / "late.jsonl", "--fail-fast"], f"{tmp_path / 'late.jsonl'}:2: broken JSON at column 2"),
        ([bad], f"{bad}:1: broken JSON at column 2"),
    ):
        capsys.readouterr()
        assert main(["plan", *map(str, args), "--policy", "random", "-o", str(out)]) == 2
        assert capsys.readouterr().err.splitlines()[-1].startswith(says)
        assert not out.exists()
    assert len((tmp_path / "plans.part.jsonl").read_text().splitlines()) == 1
    assert main(["plan", str(tmp_path / "nowhere.jsonl"), "-o", str(out)]) == 2
    assert len((tmp_path / "plans.part.jsonl").read_text().splitlines()) == 1


def test_a_batch_goes_on_where_it_was_broken_off(scenes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Plans and scenes: what is there is not made again, and the bytes are those of a run in one go."""
    import retrieve_cli.plan as command

    file, out = mixed(scenes, tmp_path / "mixed.jsonl"), tmp_path / "plans.jsonl"
    plan = ["plan", str(file), "--policy", "random", "--strict", "-o"]
    assert main([*plan, str(tmp_path / "whole.jsonl")]) == 1
    made: list[str] = []
    one = command.plan_line

    def mortal(job: command.Job, line: command.SceneLine) -> command.Answer:
        if len(made) == 4:
            raise KeyboardInterrupt
        made.append(line.id)
        return one(job, line)

    monkeypatch.setattr(command, "plan_line", mortal)
    assert main([*plan, str(out)]) == 130
    assert len(made) == 4
    monkeypatch.setattr(command, "plan_line", one)
    assert main([*plan, str(out), "--resume", "--html", str(tmp_path / "plan.html")]) == 1
    assert list(results(out).items()) == list(results(tmp_path / "whole.jsonl").items())
    assert json.loads(scenes.read_text().splitlines()[0])["id"] in (tmp_path / "plan.html").read_text()
    assert main([*plan, str(out), "--seed", "4", "--resume"]) == 1  # nothing is left to go on with: a run of its own
    out.unlink()
    assert main(["gen", "-n", "4", "--seed", "5", "-o", str(out), "--resume"]) == 0
    assert out.read_text().splitlines()[:3] == scenes.read_text().splitlines()[:3]


# Limits of one's own --------------------------------------------------------------------------------------------------------------------


def limits_file(folder: Path, text: str) -> Path:
    file = folder / "limits.toml"
    file.write_text(text)
    return file


def test_plans_by_raised_limits_are_true_by_these_alone(scenes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An acceleration that a URDF does not give is assumed; who knows better says so to `verify`, too."""
    limits, plans = limits_file(tmp_path, "[all]\nacceleration = 12\njerk = 120\n"), tmp_path / "plans.jsonl"
    assert main(["plan", str(scenes), "--policy", "local", "--limits", str(limits), "-o", str(plans)]) == 0
    assert any(json.loads(line)["verified"] for line in plans.read_text().splitlines())
    assert main(["verify", str(scenes), str(plans), "--limits", str(limits)]) == 0
    assert ": true" in capsys.readouterr().out
    assert main(["verify", str(scenes), str(plans)]) == 1
    assert "the limit of its acceleration is" in capsys.readouterr().out


@pytest.mark.parametrize("workers", [1, 2])
def test_limits_above_the_urdf_end_it_at_once(scenes: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], workers: int) -> None:
    """No scene is to blame, so none is named, and none gets a plan."""
    limits, plans = limits_file(tmp_path, "[elbow_joint]\nvelocity = 5\n"), tmp_path / "plans.jsonl"
    assert main(["plan", str(scenes), "--limits", str(limits), "--workers", str(workers), "-o", str(plans)]) == 2
    said = f"--limits for the robot ur5e: {limits}: elbow_joint.velocity: 5 is above the URDF's 3.14159, by which every plan is judged"
    assert capfd.readouterr().err.splitlines()[-1].startswith(said)
    assert [p.name for p in tmp_path.iterdir()] == ["limits.toml"]


def test_resume_compares_limits_by_what_they_say(scenes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The same words in another file are the same limits, other words in the same file are others."""
    cut, plans = write(tmp_path / "cut.jsonl", [*scenes.read_text().splitlines()[:1], "no scene"]), tmp_path / "plans.jsonl"
    limits = limits_file(tmp_path, "[elbow_joint]\nvelocity = 2\n")

    def plan(file: Path, *more: str) -> int:
        return main(["plan", str(file), "--policy", "random", "--limits", str(limits), "-o", str(plans), *more])

    assert plan(cut, "--fail-fast") == 2
    limits.write_text("[elbow_joint]\nvelocity = 1\n")
    assert plan(scenes, "--resume") == 2
    assert "was made otherwise: limits was " in capsys.readouterr().err
    limits = limits_file(tmp_path / ".." / tmp_path.name, "[elbow_joint]\nvelocity = 2\n").rename(tmp_path / "other.toml")
    assert plan(scenes, "--resume") == 0
    assert "1 result is there; going on" in capsys.readouterr().err
    assert len(plans.read_text().splitlines()) == 4
