"""Scenes and plans in files: they come back as they were written, obey the schemas, stream, and every mistake is told with its place."""

from __future__ import annotations

import copy
import gzip
import io
import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import documents
import jsonschema
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinematics.errors import InputError
from kinematics.transforms import rotation_from_wxyz, transform, wxyz_from_rotation
from planning.io.files import count_lines, read_either, read_plans, read_scenes
from planning.io.outputs import replacing
from planning.io.plan_documents import plan_from_json, plan_to_json
from planning.io.results import plan_line, plan_writer, scene_writer
from planning.io.scene_documents import scene_from_json, scene_to_json
from planning.io.settling import ROOM_M
from planning.plan import Blocked, Gripper, GripperState

Change = Callable[[dict[str, Any]], object]


def schema(kind: str) -> Any:
    return json.loads((documents.SCHEMAS / f"{kind}.schema.json").read_text())


@pytest.fixture
def complaint(tmp_path: Path) -> Callable[[str], str]:
    """What read_scenes says about a text, the folder cut off."""

    def read(text: str) -> str:
        file = tmp_path / "scenes.jsonl"
        file.write_text(text)
        with pytest.raises(InputError) as caught:
            list(read_scenes(file))
        assert "\n" not in str(caught.value)
        return str(caught.value).replace(f"{tmp_path}/", "")

    return read


# There and back -------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("document", [documents.scene(), documents.observed()], ids=["scene", "observed"])
def test_scene_comes_back_as_it_was(document: dict[str, Any]) -> None:
    written = scene_to_json(scene_from_json(document))
    assert written == document
    jsonschema.validate(written, schema("scene"))


@pytest.mark.parametrize("success", [True, False])
def test_plan_comes_back_as_it_was(success: bool) -> None:
    document = documents.plan(success=success)
    written = plan_to_json(plan_from_json(document))
    assert written == document
    jsonschema.validate(written, schema("plan"))


@pytest.mark.parametrize("success", [True, False])
def test_a_timed_plan_comes_back_as_it_was(success: bool) -> None:
    document = documents.timed_plan(success=success)
    written = plan_to_json(plan_from_json(document))
    assert written == document
    jsonschema.validate(written, schema("plan"))


def test_a_plan_without_motions_is_of_the_newest_version() -> None:
    document = {**documents.plan(success=False), "motions": []}
    written = plan_to_json(plan_from_json(document))
    assert (written["schema"], written["duration_s"]) == ("retrieve/plan@2", 0.0)
    jsonschema.validate(written, schema("plan"))


@given(st.lists(st.floats(-100, 100), min_size=3, max_size=3))
def test_numbers_keep_every_digit(p: list[float]) -> None:
    document = documents.plan()
    document["motions"][0]["q"][0] = p
    document["moves"][0]["T_world_from"]["p"] = p
    written = json.loads(json.dumps(plan_to_json(plan_from_json(json.loads(json.dumps(document))))))
    assert written == document


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_rotations_come_back(q: list[float]) -> None:
    q = list(np.array(q) / np.linalg.norm(q))
    document = documents.plan()
    document["moves"][0]["T_world_from"]["q_wxyz"] = q
    back = plan_to_json(plan_from_json(document))["moves"][0]["T_world_from"]["q_wxyz"]
    assert min(np.abs(np.subtract(back, q)).max(), np.abs(np.add(back, q)).max()) < 1e-14


def test_a_rounded_quaternion_is_normalised() -> None:
    document = documents.scene()
    document["grasp"]["T_world_hand"]["q_wxyz"] = [0.7071, 0.7071, 0, 0]
    R = scene_from_json(document).grasp.T_world_hand[:3, :3]
    assert np.allclose(R @ R.T, np.eye(3), atol=1e-15)


def test_what_may_be_left_out() -> None:
    document = documents.scene()
    del document["seed"], document["approaches"]
    scene = scene_from_json(document)
    assert (scene.seed, scene.approaches, scene.observation) == ((), ("horizontal", "diagonal", "downward"), None)
    jsonschema.validate(scene_to_json(scene), schema("scene"))


def test_a_reason_may_be_a_text() -> None:
    document = documents.plan(success=False)
    document["reason"] = "gave up"
    assert plan_from_json(document).reason == Blocked("gave up")


def test_meshes_and_urdfs_are_relative_to_the_file(tmp_path: Path) -> None:
    import trimesh

    (tmp_path / "parts").mkdir()
    trimesh.creation.icosphere(radius=40).export(tmp_path / "parts" / "ball.stl")
    (tmp_path / "arm.urdf").write_text("<robot name='arm'/>")
    document = documents.scene()
    document["robot"] = {"urdf": "arm.urdf", "hand_frame": "tip", "gripper_joint": "finger", "T_world_base": documents.pose(0.0, 0.0, 0.0)}
    document["objects"][0]["shape"] = {"type": "mesh", "file": "parts/ball.stl", "scale": 0.001}
    document["objects"][0]["T_world_object"] = documents.pose(0.5, 0.0, 0.14)
    file = tmp_path / "scenes.jsonl"
    file.write_text(documents.lines(document, document))
    (_, first), (_, second) = read_scenes(file)
    assert first.robot.urdf == str(tmp_path / "arm.urdf")
    assert first.objects[0].shape is second.objects[0].shape  # read once
    assert scene_to_json(first, tmp_path) == document
    elsewhere = scene_to_json(first, tmp_path / "parts")
    assert elsewhere["objects"][0]["shape"]["file"] == "ball.stl"
    assert elsewhere["robot"]["urdf"] == str(tmp_path / "arm.urdf")


def test_writers_and_readers_agree(tmp_path: Path) -> None:
    scene, plan = scene_from_json(documents.scene()), plan_from_json(documents.plan())
    with scene_writer(tmp_path / "s.jsonl") as write:
        write(scene)
        write(scene)
    with plan_writer(tmp_path / "p.jsonl") as write_plan:
        write_plan(plan)
    assert [where for where, _ in read_scenes(tmp_path / "s.jsonl")] == [f"{tmp_path}/s.jsonl:1", f"{tmp_path}/s.jsonl:2"]
    assert [p.moves[0].reason for _, p in read_plans(tmp_path / "p.jsonl")] == [Blocked("transfer", "forearm", "box_2", 0.004)]
    (tmp_path / "both.jsonl").write_text((tmp_path / "s.jsonl").read_text() + (tmp_path / "p.jsonl").read_text())
    assert [type(x).__name__ for _, x in read_either(tmp_path / "both.jsonl")] == ["Scene", "Scene", "Plan"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["both.jsonl", "p.jsonl", "s.jsonl"]


def test_blank_lines_windows_ends_and_a_byte_order_mark_are_no_matter(tmp_path: Path) -> None:
    line = json.dumps(documents.scene())
    (tmp_path / "s.jsonl").write_bytes(b"\xef\xbb\xbf" + f"{line}\r\n\r\n{line}".encode())
    assert [where.rpartition(":")[2] for where, _ in read_scenes(tmp_path / "s.jsonl")] == ["1", "3"]


def test_scenes_arrive_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first scene is there before the second line is read."""

    class Pipe(io.BytesIO):
        taken = 0

        def __next__(self) -> bytes:
            self.taken += 1
            return super().__next__()

    pipe = Pipe(documents.lines(documents.scene("a"), documents.scene("b")).encode())
    monkeypatch.setattr("sys.stdin", type("Stdin", (), {"buffer": pipe, "isatty": lambda self: False})())
    scenes = read_scenes(None)
    where, scene = next(scenes)
    assert (where, scene.id, pipe.taken) == ("stdin:1", "a", 1)


# Mistakes in a scene --------------------------------------------------------------------------------------------------------------------


def _set(path: str, value: object) -> Change:
    """A change of one place in a document, such as objects.2.shape.size_m."""

    def change(document: Any) -> None:
        *way, last = path.split(".")
        for step in way:
            document = document[int(step) if step.isdigit() else step]
        document[int(last) if last.isdigit() else last] = value

    return change


def _drop(path: str) -> Change:
    def change(document: Any) -> None:
        *way, last = path.split(".")
        for step in way:
            document = document[int(step) if step.isdigit() else step]
        del document[last]

    return change


MISTAKES: list[tuple[Change, str]] = [
    (_set("objects.2.shape.size_m", [0.05, -0.04, 0.1]), "objects[2].shape.size_m: -0.04 is not positive"),
    (_set("objects.1.shape.radius_m", 0), "objects[1].shape.radius_m: 0 is not positive"),
    (_set("objects.1.shape.radius_m", 1e-9), "objects[1].shape.radius_m: 1e-09 is below 0.0001"),
    (_set("objects.2.shape.size_m", [50, 40, 1e4]), "objects[2].shape.size_m: 10000.0 is beyond 100 m; are these millimetres?"),
    (
        _set("cabinet.size_m", [56, 86, 50]),
        "cabinet: the cabinet is 56 m deep: are its sizes in centimetres or millimetres? they are metres",
    ),
    (_set("cabinet.T_world_cabinet.p", [300, 0, 100]), "cabinet.T_world_cabinet.p: 300 is beyond 100 m; are these millimetres?"),
    (_set("grasp.width_m", 1e300), "grasp.width_m: 1e+300 is above 100"),
    (_set("regions.n", 101), "regions.n: 101 is above 100"),
    (_set("id", "half \ud800"), "id: 'half \\ud800' holds half a character (a lone surrogate)"),
    (_set("cabinet.wall_m", -1), "cabinet.wall_m: -1 is not positive"),
    (_set("objects.0.T_world_object.p", [float("nan"), 0, 0]), "objects[0].T_world_object.p: nan is not a finite number"),
    (_set("grasp.width_m", float("inf")), "grasp.width_m: inf is not a finite number"),
    (_set("objects.0.T_world_object.p", [0.5, 0.0]), "objects[0].T_world_object.p: holds 2 numbers, and 3 are needed"),
    (_set("objects.0.T_world_object.q_wxyz", [0, 0, 0, 0]), "objects[0].T_world_object.q_wxyz: has length 0, which is no rotation; "),
    (_set("objects.0.T_world_object.q_wxyz", [1, 1, 0, 0]), "objects[0].T_world_object.q_wxyz: has length 1.41421, and a rotation has 1; "),
    (_set("targt", "can_1"), "unknown field 'targt' (did you mean 'target'?)"),
    (_set("colour", "red"), "unknown field 'colour'; the fields are schema, id, robot, "),
    (_set("objects.1.shape.size_m", [1, 1, 1]), "objects[1].shape: unknown field 'size_m'; the fields are type, radius_m, height_m"),
    (_drop("grasp"), "missing field 'grasp'"),
    (_drop("schema"), "missing field 'schema'"),
    (_drop("objects.0.shape.size_m"), "objects[0].shape: missing field 'size_m'"),
    (_drop("objects.0.shape.type"), "objects[0].shape: missing field 'type'"),
    (_set("objects.0.shape.type", "bxo"), "objects[0].shape.type: 'bxo' is not one of box, cylinder, mesh (did you mean 'box'?)"),
    (_set("objects.0.shape", "box"), "objects[0].shape: the text 'box' stands where an object with type is expected"),
    (_set("id", 7), "id: the number 7 stands where a text is expected"),
    (_set("id", ""), "id: is empty"),
    (_set("regions.n", 2.5), "regions.n: the number 2.5 stands where a whole number is expected"),
    (_set("regions.n", 0), "regions.n: 0 is below 1"),
    (_set("grasp.width_m", True), "grasp.width_m: true stands where a number is expected"),
    (_set("grasp.width_m", 10**400), "grasp.width_m: 1000"),
    (_set("objects", []), 'objects: is empty, which came with version 2: write "schema": "retrieve/scene@2"'),
    (_set("grasp", None), 'grasp: is empty, which came with version 2: write "schema": "retrieve/scene@2"'),
    (_set("objects", {}), "objects: an object stands where an array [...] is expected"),
    (
        _set("cabinet.T_world_cabinet.q_wxyz", [0, 0, 0.6, 0.8]),
        "cabinet.T_world_cabinet: leans by 74° (its z points up, to 15°), and nothing",
    ),
    (_set("approaches", ["sideways"]), "approaches[0]: 'sideways' is not one of horizontal, diagonal, downward"),
    (_set("target", "can_7"), "target: 'can_7' is not among the objects (box_0, can_1, box_2) (did you mean 'can_1'?)"),
    (_set("objects.2.name", "box_0"), "objects[2].name: 'box_0' is the name of an object before it; "),
    (_set("objects.2.name", "left"), "objects[2].name: 'left' is a wall of the cabinet; choose another name"),
    (_set("robot.urdf", "arm.urdf"), "robot: must say either 'name' (a named robot) or 'urdf' (a file), not both"),
    (_drop("robot.name"), "robot: must say either 'name' (a named robot) or 'urdf' (a file), and says neither"),
    (_set("robot", {"urdf": "arm.urdf", "T_world_base": documents.pose(0, 0, 0)}), "robot.urdf: the file FOLDER/arm.urdf does not exist; "),
    (_set("objects.0.shape", {"type": "mesh", "file": "mug.stl"}), "objects[0].shape.file: mesh file FOLDER/mug.stl does not exist"),
    (_set("objects.0.shape", {"type": "mesh", "file": "m", "scale": 0}), "objects[0].shape.scale: 0 is not positive"),
    (_set("objects.0.T_world_object.p", [0.6, 0.06, 0.15]), "objects[0]: 'box_0' overlaps 'can_1' by 20.0 mm; move one of them"),
    (_set("objects.0.T_world_object.p", [0.5, 0.0, 0.145]), "objects[0]: 'box_0' overlaps the cabinet's wall 'floor' by 5.0 mm; "),
    (_set("objects.0.T_world_object.p", [0.6, 0.1, 0.15]), "objects[0]: 'box_0' overlaps 'can_1' by "),
    (_set("objects.0.T_world_object.p", [0.5, 0.0, 0.16]), "objects[0]: 'box_0' floats 10.0 mm above the floor, and nothing carries it"),
    (_set("objects.0.T_world_object.p", [0.2, 0.0, 0.15]), "objects[0]: 'box_0' stands outside: its middle is 100 mm in front of the"),
    (_set("schema", "retrieve/scene@3"), "schema: 'retrieve/scene@3' is too new: update the program; this program reads "),
    (
        _set("schema", "retrieve/scene@0"),
        "schema: 'retrieve/scene@0' is too old: write the file again; this program reads ",
    ),
    (
        _set("schema", "retrieve/plan@1"),
        "schema: this is a plan, and a scene is expected; plans go to `retrieve report` and `retrieve show`, and after their scenes to",
    ),
    (_set("schema", "scene"), "schema: 'scene' is unknown; this program reads retrieve/scene@1 and retrieve/scene@2 and "),
    (_set("schema", 1), "schema: the number 1 stands where a text is expected"),
    (_set("observation", {}), "observation: missing field 'objects'"),
    (_set("observation", {**documents.observed()["observation"], "known": 1.5}), "observation.known: 1.5 is above 1"),
    (
        _set("observation", {**documents.observed()["observation"], "regions": [[0, 0, 1]]}),
        "observation.regions[0]: holds 3 numbers",
    ),
]


@pytest.mark.parametrize(("change", "says"), MISTAKES, ids=[says[:50] for _, says in MISTAKES])
def test_a_mistake_is_told_with_its_place(change: Change, says: str, complaint: Callable[[str], str], tmp_path: Path) -> None:
    wrong = copy.deepcopy(documents.scene())
    change(wrong)
    text = documents.lines(documents.scene(), wrong)
    assert complaint(text).startswith("scenes.jsonl:2: " + says.replace("FOLDER/", ""))


def test_a_touch_is_no_overlap() -> None:
    document = documents.scene()
    document["objects"][0]["T_world_object"]["p"] = [0.6, 0.0405, 0.15]  # half a millimetre inside the can
    scene = scene_from_json(document)
    assert [s.object for s in scene.settled] == ["box_0"]
    assert scene.objects[0].T_world_body[1, 3] == pytest.approx(0.04 - ROOM_M, abs=1e-4)  # so far off that both can be lifted


def test_a_wall_is_named_whichever_side_it_is() -> None:
    document = documents.scene()
    for p, wall in (([0.5, 0.42, 0.15], "left"), ([0.5, -0.42, 0.15], "right"), ([0.85, 0, 0.15], "back"), ([0.5, 0, 0.36], "ceiling")):
        document["objects"][0]["shape"]["size_m"][2] = 0.52 if wall == "ceiling" else 0.1
        document["objects"][0]["T_world_object"]["p"] = p
        with pytest.raises(InputError, match=f"the cabinet's wall '{wall}'"):
            scene_from_json(document)


BROKEN = [
    ('{"schema": "retrieve/scene@1", }', "scenes.jsonl:1: broken JSON at column 3"),
    (
        "{\n",
        "scenes.jsonl:1: broken JSON at column 2: Expecting property name enclosed in double quotes; one document a line is ",
    ),
    ("[1, 2]", "scenes.jsonl:1: this is an array; one document a line is expected: `jq -c '.[]'` makes a line of each"),
    ("[\n  {}\n]", "scenes.jsonl:1: broken JSON at column 2: Expecting value; one document a line is expected: `jq -c '.[]'` makes"),
    ("null", "scenes.jsonl:1: null stands where an object with schema is expected"),
    ('{"schema": "retrieve/scene@1", "id": "a", "id": "b"}', "scenes.jsonl:1: the field 'id' stands twice in one object"),
    ("[" * 100000, "scenes.jsonl:1: broken JSON: "),
    ("", "scenes.jsonl: there is nothing in it; name a file of scenes or pipe them in: retrieve gen -n 20 | retrieve plan"),
    ("\n \n", "scenes.jsonl: there is nothing in it; "),
]


@pytest.mark.parametrize(("text", "says"), BROKEN, ids=[text[:20] for text, _ in BROKEN])
def test_broken_lines(text: str, says: str, complaint: Callable[[str], str]) -> None:
    assert complaint(text).startswith(says)


def test_files_that_are_none(tmp_path: Path) -> None:
    (tmp_path / "scenes.jsonl").write_bytes(b"\x89PNG\r\n")
    with pytest.raises(InputError, match=r"scenes.jsonl:1: byte 1 is not UTF-8 text; is this a JSON Lines file\?"):
        list(read_scenes(tmp_path / "scenes.jsonl"))
    (tmp_path / "scenes.jsonl").write_text("{}\n", encoding="utf-16")
    with pytest.raises(InputError, match=r"scenes.jsonl:1: this is UTF-16, as PowerShell's > writes it: iconv -f UTF-16 -t UTF-8 FILE"):
        list(read_scenes(tmp_path / "scenes.jsonl"))
    with pytest.raises(InputError, match=r"scene.jsonl: no such file \(did you mean 'scenes.jsonl'\?\)"):
        list(read_scenes(tmp_path / "scene.jsonl"))
    with pytest.raises(InputError, match=r"nowhere/scenes.jsonl: no such file$"):
        list(read_scenes(tmp_path / "nowhere" / "scenes.jsonl"))


# Mistakes in a plan ---------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (_set("schema", "retrieve/scene@1"), "schema: this is a scene, and a plan is expected; scenes go to `retrieve plan`"),
        (_set("schema", "retrieve/plan@3"), "schema: 'retrieve/plan@3' is too new"),
        (_drop("success"), "missing field 'success'"),
        (_set("success", 1), "success: the number 1 stands where true or false is expected"),
        (_set("rule", "depe"), "rule: 'depe' is not one of deep, region, strict (did you mean 'deep'?)"),
        (_set("moves.0.region", -1), "moves[0].region: -1 is below 0"),
        (_set("moves.0.reason", {}), "moves[0].reason: missing field 'stage'"),
        (_set("motions.1.q.0", [0.1]), "motions[1].q[0]: holds 1 numbers, and 3 are needed"),
        (_set("motions.1.t_s", [0.0]), "motions[1].t_s: holds 1 numbers, and 2 are needed"),
        (_set("motions.1.t_s", [1.0, 0.5]), "motions[1].t_s: runs backwards"),
        (_set("motions.1.stage", "jump"), "motions[1].stage: 'jump' is not one of transit, "),
        (_set("motions.1.may_touch", [["a", "b", "c"]]), "motions[1].may_touch[0]: holds 3 names, and 2 are needed"),
        (_set("planning_time_s", -0.1), "planning_time_s: -0.1 is below 0"),
        (_set("return", None), "return: null stands where a number is expected"),
    ],
)
def test_a_mistake_in_a_plan(change: Change, says: str) -> None:
    document = documents.plan()
    change(document)
    with pytest.raises(InputError) as caught:
        plan_from_json(document, "plans.jsonl:1")
    assert str(caught.value).startswith(f"plans.jsonl:1: {says}")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (_drop("motions.0.qd"), "motions[0]: missing field 'qd'"),
        (_set("motions.0.qd", [[0.0, 0.0, 0.0]]), "motions[0].qd: has 1 rows, and q has 2"),
        (_set("motions.1.qdd.0", [0.0]), "motions[1].qdd[0]: holds 1 numbers, and 3 are needed"),
        (_set("motions.1.t_s", [0.0, 0.0]), "motions[1].t_s: must rise from row to row"),
        (_set("motions.0.gripper.after", {}), "motions[0].gripper.after: missing field 'value'"),
        (_set("motions.0.gripper.after.force_N", -1), "motions[0].gripper.after.force_N: -1 is below 0"),
    ],
)
def test_a_mistake_in_a_timed_plan(change: Change, says: str) -> None:
    document = documents.timed_plan()
    change(document)
    with pytest.raises(InputError) as caught:
        plan_from_json(document, "plans.jsonl:1")
    assert str(caught.value).startswith(f"plans.jsonl:1: {says}")


def test_a_misspelt_field_of_a_plan_is_pointed_out() -> None:
    document = documents.plan()
    document["succes"] = document.pop("success")
    with pytest.raises(InputError, match=r"plan: missing field 'success', and 'succes' is unknown: is it meant\?"):
        plan_from_json(document)


# Writing --------------------------------------------------------------------------------------------------------------------------------


def test_a_file_appears_only_when_it_is_whole(tmp_path: Path) -> None:
    out, scene = tmp_path / "s.jsonl", scene_from_json(documents.scene())
    out.write_text("before\n")

    def break_off() -> None:
        with scene_writer(out) as write:
            write(scene)
            raise RuntimeError

    with pytest.raises(RuntimeError):
        break_off()
    assert out.read_text() == "before\n"
    assert len((tmp_path / "s.part.jsonl").read_text().splitlines()) == 1  # hours of work are not thrown away
    with scene_writer(out) as write:
        write(scene)
    assert {p.name for p in tmp_path.iterdir()} == {"s.jsonl", "s.part-1.jsonl"}


def test_other_files_leave_nothing_behind(tmp_path: Path) -> None:
    def break_off() -> None:
        with replacing(tmp_path / "a.png") as part:
            part.write_bytes(b"half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        break_off()
    assert list(tmp_path.iterdir()) == []


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "s.jsonl").symlink_to(tmp_path / "real" / "s.jsonl")
    with replacing(tmp_path / "s.jsonl") as part:
        part.write_text("x")
    assert (tmp_path / "s.jsonl").is_symlink()
    assert (tmp_path / "real" / "s.jsonl").read_text() == "x"


def test_places_that_can_not_be_written_to(tmp_path: Path) -> None:
    with (
        pytest.raises(InputError, match=r"the folder .*nowhere does not exist; make it first"),
        scene_writer(tmp_path / "nowhere" / "s.jsonl"),
    ):
        pass
    with pytest.raises(InputError, match="is a folder, not a file"), scene_writer(tmp_path):
        pass
    with scene_writer(Path("/dev/null")) as write:
        write(scene_from_json(documents.scene()))


def test_nan_is_never_written(tmp_path: Path) -> None:
    scene = scene_from_json(documents.scene())
    scene.grasp.T_world_hand[0, 3] = np.nan
    with pytest.raises(ValueError, match=r"can't be written"), scene_writer(tmp_path / "s.jsonl") as write:
        write(scene)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("path", ["motions.0.q", "motions.0.t_s", "planning_time_s", "motions.0.gripper.before.value"])
def test_nan_is_never_written_in_a_plan(tmp_path: Path, path: str) -> None:
    plan = plan_from_json(documents.plan())
    motion = plan.motions[0]
    bad = {
        "motions.0.q": replace(plan, motions=(replace(motion, q=motion.q * np.nan),)),
        "motions.0.t_s": replace(plan, motions=(replace(motion, t_s=motion.t_s * np.nan),)),
        "planning_time_s": replace(plan, planning_time_s=np.inf),
        "motions.0.gripper.before.value": replace(
            plan, motions=(replace(motion, gripper=Gripper("finger", GripperState(np.nan, 0.0), GripperState(0.0, 0.0))),)
        ),
    }
    with pytest.raises(ValueError, match=r"can't be written"), plan_writer(tmp_path / "p.jsonl") as write:
        write(bad[path])


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=2, max_size=2))
def test_numbers_of_a_plan_are_read_as_they_were_to_the_last_digit(figures: list[float]) -> None:
    plan = replace(plan_from_json(documents.plan()), hand_travel_m=figures[0], value=figures[1])
    document = json.loads(plan_line(plan))
    assert [document["hand_travel_m"], document["return"]] == figures
    assert document == plan_to_json(plan)


def test_poses_follow_the_contract() -> None:
    q = np.array([0.5, -0.5, 0.5, -0.5])
    T = transform(rotation_from_wxyz(q), [1.0, 2.0, 3.0])
    document = documents.plan()
    document["moves"][0]["T_world_to"] = {"p": [1.0, 2.0, 3.0], "q_wxyz": list(q)}
    assert np.allclose(plan_from_json(document).moves[0].T_world_to, T)
    assert np.allclose(wxyz_from_rotation(T[:3, :3]), q)


def test_a_document_is_not_deep(complaint: Callable[[str], str]) -> None:
    for deep in ("[" * 5000 + "]" * 5000, '{"a": ' * 40 + "1" + "}" * 40, json.dumps({**documents.observed(), "x": [[[[]]]]}) + "["):
        assert complaint(deep).startswith("scenes.jsonl:1: ")
    document = documents.scene("[" * 5000)  # in a text they are no matter
    assert scene_from_json(json.loads(json.dumps(document))).id == "[" * 5000


def test_lines_are_counted_where_that_takes_nothing_away(tmp_path: Path) -> None:
    file = tmp_path / "scenes.jsonl"
    file.write_bytes(b"{}\r\n\n  \n{}")
    assert count_lines(file) == 2
    assert [count_lines(source) for source in (None, Path("-"), tmp_path, tmp_path / "none")] == [None] * 4
    os.mkfifo(tmp_path / "pipe")
    assert count_lines(tmp_path / "pipe") is None


def test_what_is_compressed_says_so(tmp_path: Path) -> None:
    file = tmp_path / "scenes.jsonl.gz"
    file.write_bytes(gzip.compress(b"{}\n"))
    with pytest.raises(InputError, match=r"scenes\.jsonl\.gz:1: this is compressed \(gzip\): gunzip -c FILE"):
        list(read_scenes(file))
