"""`retrieve sense` and `plan --sense`: files in, files out, the same whoever took the pictures, and bad input in one line."""

from __future__ import annotations

import errno
import json
from dataclasses import replace
from pathlib import Path

import documents
import numpy as np
import pytest

from kinematics.errors import InputError
from perception import Frame, frames
from perception.camera import Intrinsics
from planning.io.outputs import alone_in
from planning.io.scene_documents import scene_from_json
from retrieve_cli.plan import run as plan
from retrieve_cli.plan_job import Job
from retrieve_cli.sense import _why_hardly, parse_box, run


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from retrieve_cli.gen import run as gen
    from retrieve_cli.robot_options import RobotOptions

    file = tmp_path_factory.mktemp("sense") / "scenes.jsonl"
    gen(n=1, seed=71, robot=RobotOptions(), spec="paper", out=file)
    return file


def sensed(scenes: Path, out: Path, **more: object) -> dict[str, object]:
    given = {"views": None, "from_views": None, "max_views": 6, "share": 0.95, "noise": False, "by": "mask", "target_box": None, "seed": 0}
    run(scenes=scenes, out=out, **{**given, **more})  # type: ignore[arg-type]
    document: dict[str, object] = json.loads(out.read_text())
    return document


def test_what_is_observed_is_written_and_recorded_views_give_the_same(scenes: Path, tmp_path: Path) -> None:
    first = sensed(scenes, tmp_path / "a.jsonl", views=tmp_path / "views")
    truth = json.loads(scenes.read_text())
    seen = first.pop("observation")
    assert first.keys() == truth.keys()
    assert [first[k] for k in ("id", "target", "regions", "robot")] == [truth[k] for k in ("id", "target", "regions", "robot")]
    assert isinstance(seen, dict)
    assert {o["name"] for o in seen["objects"]} == {o["name"] for o in truth["objects"]}
    assert len(seen["regions"]) == truth["regions"]["n"] ** 2
    assert seen["views"][-1]["known"] == seen["known"] > 0.8
    assert (tmp_path / "views" / "000000" / "cloud.ply").is_file()
    again = sensed(scenes, tmp_path / "b.jsonl", from_views=tmp_path / "views")["observation"]
    assert isinstance(again, dict)
    assert len(again["views"]) == len(seen["views"])
    assert abs(again["known"] - seen["known"]) < 0.02  # depths are whole tenths of a millimetre in files
    assert {o["name"] for o in again["objects"]} == {o["name"] for o in seen["objects"]}
    unknown = seen["views"][-1]["unknown"]
    cells = np.zeros(unknown["cells"], bool)
    for x0, y0, z0, x1, y1, z1 in unknown["boxes"]:
        cells[x0:x1, y0:y1, z0:z1] = True
    assert 0 < cells.mean() < 1 - seen["known"]  # what an object explains is not among them


def test_the_robot_is_found_in_its_own_pictures_by_how_it_stood(scenes: Path, tmp_path: Path) -> None:
    def box_sizes(document: dict[str, object]) -> dict[str, list[float]]:
        seen = document["observation"]
        assert isinstance(seen, dict)
        return {o["name"]: o["box"][3:] for o in seen["objects"]}

    views = tmp_path / "views"
    first = sensed(scenes, tmp_path / "a.jsonl", views=views)
    marks = list((views / "000000" / "mask_robot").glob("*.png"))
    assert marks
    for mark in marks:
        mark.unlink()
    again = sensed(scenes, tmp_path / "b.jsonl", from_views=views)
    seen, found = first["observation"], again["observation"]
    assert isinstance(seen, dict)
    assert isinstance(found, dict)
    assert abs(found["known"] - seen["known"]) < 0.03
    for name, size in box_sizes(first).items():
        assert box_sizes(again)[name] == pytest.approx(size, abs=0.02)
    cameras = views / "000000" / "scene_camera.json"
    whole = cameras.read_text()
    cameras.write_text(whole.replace('"robot_q": [', '"robot_q": [0.5, '))
    with pytest.raises(InputError, match=r"robot_q has .* actuated joints"):
        sensed(scenes, tmp_path / "c.jsonl", from_views=views)
    cameras.write_text(whole.replace('"robot_q": [', '"robot_q": ["x", '))
    with pytest.raises(InputError, match="robot_q is not a list of finite numbers"):
        sensed(scenes, tmp_path / "c.jsonl", from_views=views)


def test_two_runs_do_not_record_into_one_folder_at_once(scenes: Path, tmp_path: Path) -> None:
    with alone_in(tmp_path / "views"), pytest.raises(InputError, match="another run is writing in it just now"):
        sensed(scenes, tmp_path / "a.jsonl", views=tmp_path / "views")
    assert not (tmp_path / "a.jsonl").exists()
    assert not (tmp_path / "views").exists()


def test_a_full_disk_names_the_folder_of_views(scenes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(frames, "write_frames", full)
    with pytest.raises(InputError, match=rf"{tmp_path}/views: can't be written: no space left on device"):
        sensed(scenes, tmp_path / "a.jsonl", views=tmp_path / "views", max_views=1)


def test_recorded_frames_beside_objects_that_are_told(scenes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Plans are made on the objects that the scene lists, whatever the frames show; that is said."""
    sensed(scenes, tmp_path / "a.jsonl", views=tmp_path / "views", max_views=2)
    assert "objects of its own" not in capsys.readouterr().err
    document = sensed(scenes, tmp_path / "b.jsonl", from_views=tmp_path / "views")
    assert "source" not in str(document["objects"])  # seen ones have it
    assert "it lists objects of its own, and plans are made on those" in capsys.readouterr().err


def test_bad_input_is_told(scenes: Path, tmp_path: Path) -> None:
    for text in ("1,2,3", "a,b,c,d,e,f", "0,0,0,1,1,-1", "0,0,0,1,1,nan"):
        with pytest.raises(InputError, match="six numbers"):
            parse_box(text)
    with pytest.raises(InputError, match="no such folder"):
        sensed(scenes, tmp_path / "c.jsonl", from_views=tmp_path / "nowhere")
    with pytest.raises(InputError, match="--noise is for --sense"):
        plan(Job("local", noise=True), scenes=scenes, out=None)
    with pytest.raises(InputError, match="--smallest is for --sense"):
        plan(Job("local", smallest_mm=20.0), scenes=scenes, out=None)


@pytest.mark.parametrize(
    ("unknown", "says"),
    [
        ({"cells": [56, 86], "boxes": []}, "unknown.cells"),
        ({"cells": [56, 86.5, 50], "boxes": []}, "whole numbers"),
        ({"cells": [5600, 8600, 5000], "boxes": []}, "at most"),
        ({"cells": [56, 86, 50], "boxes": [[0, 0, 0, 1, 1, 51]]}, r"boxes\[0\].*within the cells"),
        ({"cells": [56, 86, 50], "boxes": [[0, 0, 0, 1, 0, 1]]}, "within the cells"),
    ],
)
def test_unknown_cells_are_checked(unknown: dict[str, object], says: str) -> None:
    document = documents.observed()
    document["observation"]["views"][-1]["unknown"] = unknown
    with pytest.raises(InputError, match=says):
        scene_from_json(document)


def test_why_hardly_anything_was_seen_is_told_by_what_was_measured() -> None:
    camera, depth = Intrinsics(8, 6, 7.0, 7.0, 3.5, 2.5), np.ones((6, 8), np.float32)
    whole = Frame(depth, None, (), camera, np.eye(4))
    sparse = replace(whole, depth=np.where(np.arange(8) % 2, depth, np.float32(0)))
    assert "depth_scale" in _why_hardly([whole])
    assert "50 % of the pixels measured nothing" in _why_hardly([sparse])
