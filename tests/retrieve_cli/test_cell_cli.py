"""A cell of one's own at the command line: from words to a plan, starts and pose noise in a batch, grasps from a file, schemas."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import documents
import jsonschema
import numpy as np
import pytest
import trimesh
import yaml

from kinematics.robots.named import installed, named_robots
from kinematics.scene import Grasp, Scene
from kinematics.transforms import rotation_from_wxyz, transform
from planning.scenes import sources
from retrieve_cli import warmup
from retrieve_cli.grasp import looks
from retrieve_cli.schema import KINDS

Spoken = tuple[int, str, str]
CAN = "can:0.025x0.12@0.6,0.05"
TABLE = "table:box:1.6x1.2x0.04@-0.55,0,top=0"


def lines(text: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in text.splitlines()]


def test_from_words_to_a_plan(retrieve: Callable[..., Spoken], tmp_path: Path) -> None:
    """The scene comes with x_g and alternatives, obeys its schema and is planned; a YAML of the same words is the same scene."""
    file = tmp_path / "cell.jsonl"
    words = ("--object", CAN, "--object", "box:0.06x0.06x0.15@0.45,-0.15", "--target", "can", "--obstacle", TABLE)
    code, _, err = retrieve("scene", *words, "-o", file)
    assert code == 0
    assert "object can: 50 × 50 × 120 mm, middle at 0.600, 0.050, 0.160 on the floor" in err
    (scene,) = lines(file.read_text())
    jsonschema.validate(scene, json.loads((documents.SCHEMAS / "scene.schema.json").read_text()))
    assert scene["grasps"]
    scores = [g["score"] for g in scene["grasps"]]
    assert scores == sorted(scores, reverse=True)
    (tmp_path / "cell.yaml").write_text(
        yaml.safe_dump({"objects": [CAN, "box:0.06x0.06x0.15@0.45,-0.15"], "target": "can", "obstacles": [TABLE]})
    )
    code, out, _ = retrieve("scene", tmp_path / "cell.yaml")
    assert (code, lines(out)) == (0, [scene])
    code, out, _ = retrieve("plan", file, "--policy", "local")
    (plan,) = lines(out)
    assert (code, plan["success"], plan["verified"]) == (0, True, True)
    (tmp_path / "plans.jsonl").write_text(out)
    assert retrieve("verify", file, tmp_path / "plans.jsonl")[0] == 0  # though the base stands on a table that is declared
    code, _, err = retrieve("plan", tmp_path / "cell.yaml")
    assert code == 2
    assert f"from a YAML of words, `retrieve scene {tmp_path / 'cell.yaml'} -o cell.jsonl` makes a scene" in err


def test_words_say_where_the_arm_is(retrieve: Callable[..., Spoken], tmp_path: Path) -> None:
    start = "elbow_joint=1.5, wrist_1_joint=-0.4"
    code, out, _ = retrieve("scene", "--object", CAN, "--no-grasp", "--q-start", start)
    assert code == 0
    assert lines(out)[0]["robot"]["q_start"] == {"elbow_joint": 1.5, "wrist_1_joint": -0.4}
    (tmp_path / "cell.yaml").write_text(yaml.safe_dump({"objects": [CAN], "q_start": start}))
    assert retrieve("scene", tmp_path / "cell.yaml", "--no-grasp")[1] == out
    jsonschema.validate({"q_start": start}, json.loads((documents.SCHEMAS / "words.schema.json").read_text()))


def test_what_will_keep_a_plan_from_its_beginning_is_said_at_once(retrieve: Callable[..., Spoken]) -> None:
    """An arm beyond its limits, or in its mount; a door that keeps it from every grasp, or a target without sides that face each other."""
    begin, alone = "scene: no plan can begin where the arm is: ", ("scene", "--object", CAN)
    assert f"{begin}transit (at the start, joint elbow_joint is at 9, outside" in retrieve(*alone, "--q-start", "elbow_joint=9")[2]
    assert f"{begin}camera would touch mount" in retrieve(*alone, "--q-start", "elbow_joint=2.2,shoulder_lift_joint=-0.9")[2]
    assert begin not in retrieve(*alone, "--q-start", "elbow_joint=1.5")[2]
    door = "door:box:0.02x0.86x0.5@0.33,0,0.1"
    assert (
        "an obstacle, a wall or the distance keeps the arm from it; retrieve grasp --from FILE" in retrieve(*alone, "--obstacle", door)[2]
    )
    assert "two of its sides have to face each other, 2 to 86 mm apart" in retrieve("scene", "--object", "can:0.06x0.06@0.6,0")[2]


def test_a_cabinet_that_leans_and_a_post_through_the_base_are_told(retrieve: Callable[..., Spoken], scenes: Callable[..., Path]) -> None:
    post, beside = "post:box:0.1x0.1x0.05@0,0", "post:box:0.1x0.1x0.05@-0.2,0"
    noted = "note: the obstacle post stands through base_link_inertia, which never moves and may touch it; is its place right?"
    assert noted in retrieve("scene", "--object", CAN, "--no-grasp", "--obstacle", post)[2]
    assert "note: " not in retrieve("scene", "--object", CAN, "--no-grasp", "--obstacle", beside)[2]

    def leaning(document: dict[str, Any]) -> None:
        document["cabinet"]["T_world_cabinet"]["q_wxyz"] = [float(np.cos(0.03)), float(np.sin(0.03)), 0.0, 0.0]

    err = retrieve("plan", scenes(leaning), "--policy", "local")[2]
    assert "scenes.jsonl:1: note: the cabinet leans by 3.4° from upright; if yours does not, see its q_wxyz" in err


def test_scenes_of_meshes_that_find_no_room_are_told_and_the_others_made(
    retrieve: Callable[..., Spoken], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bad input only where none of them could be made."""
    trimesh.creation.box((0.04, 0.06, 0.09)).export(tmp_path / "block.stl")
    random_scene, without_room = sources.random_scene, {1}

    def some(words: Any, files: Any, count: int, scale: float, load: Any, seed: int, index: int, say: Any) -> Scene:
        if index in without_room:
            raise sources.NoRoom("1 of 2 meshes fit")
        return random_scene(words, files, count, scale, load, seed, index, say)

    monkeypatch.setattr(sources, "random_scene", some)
    asked = ("scene", tmp_path, "-n", 3, "--count", 2, "--no-grasp")
    code, out, err = retrieve(*asked)
    assert (code, [line["id"] for line in lines(out)]) == (0, ["0-000000", "0-000002"])
    assert "scene 1 was not made: 1 of 2 meshes fit" in err
    without_room |= {0, 2}
    code, out, err = retrieve(*asked)
    assert (code, out) == (2, "")
    assert "scene 0 was not made" in err
    assert err.splitlines()[-1].endswith("1 of 2 meshes fit")


def test_what_was_made_is_said_with_its_name(retrieve: Callable[..., Spoken]) -> None:
    _, out, err = retrieve("scene", "--object", "can:0.03x0.12@0.5,0", "--no-grasp")
    assert [line["id"] for line in lines(out)] == ["scene"]
    assert "scene: 'scene', a cabinet of 0.56 × 0.86 × 0.5 m, robot ur5e, target can\n" in err


def test_wrong_words_are_one_line(retrieve: Callable[..., Spoken], tmp_path: Path) -> None:
    (tmp_path / "bad.yaml").write_text("objcts: []\n")
    for args, says in (
        (("scene",), "scene: name at least one object: --object can:0.03x0.12@0.6,0"),
        (("scene", "--object", "can:0.03x0.12@0.1,0"), "scene: 'can' stands outside: its middle is 200 mm in front of the cabinet"),
        (("scene", "--object", CAN, "--q-start", "elbow=1"), "q_start: there is no joint 'elbow' (did you mean 'elbow_joint'?)"),
        (("scene", "--object", CAN, "--q-start", "elbow_joint"), "scene: --q-start: 'elbow_joint' is no joint's value; write JOINT=1.57"),
        (("scene", "--object", CAN, "--q-start", "elbow_joint=nan"), "'elbow_joint=nan' is no joint's value"),
        (("scene", tmp_path / "bad.yaml"), f"{tmp_path}/bad.yaml: unknown word 'objcts' (did you mean 'objects'?)"),
        (("grasp", tmp_path / "none.jsonl"), f"{tmp_path}/none.jsonl: no such file"),
        (("schema", "sene"), "unknown kind of file 'sene' (did you mean 'scene'?)"),
        (("warmup", "ur6e"), "unknown robot 'ur6e' (did you mean 'ur5e'?)"),
    ):
        code, out, err = retrieve(*args)
        assert (code, out) == (2, "")
        assert says in err


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("cabinet: [0.56, 0.86, 0.5]\n", "cabinet: [0.56, 0.86, 0.5] is no text; write cabinet: 0.56x0.86x0.5"),
        ("at: [0.3, 0, 0.1]\n", "at: [0.3, 0, 0.1] is no text; write at: 0.3,0,0.1"),
        ("q_start: {elbow_joint: 1.5}\n", "q_start: {'elbow_joint': 1.5} is no text; write q_start: elbow_joint=1.5"),
        ("target: 7\n", "target: 7 is no text; write it in quotes"),
        ("objects: can:0.03x0.12@0.6,0\n", "objects: a list of texts is expected, a line each: - can:0.03x0.12@0.6,0"),
    ],
)
def test_what_a_yaml_says_otherwise_is_told_with_how_to_write_it(
    text: str, says: str, retrieve: Callable[..., Spoken], tmp_path: Path
) -> None:
    (tmp_path / "cell.yaml").write_text(text)
    code, out, err = retrieve("scene", tmp_path / "cell.yaml")
    assert (code, out, err) == (2, "", f"{tmp_path}/cell.yaml: {says}\n")


def test_a_hand_frame_or_a_tool_of_a_named_robot_is_refused(retrieve: Callable[..., Spoken], tmp_path: Path) -> None:
    """It was left unheeded; a tool's was "URDF file ur5e does not exist"."""
    for args, says in (
        (("gen", "-n", 1, "--robot", "ur5e", "--hand-frame", "tcp"), "robot ur5e has a hand frame of its own; another is for a URDF"),
        (("robots", "ur5e", "--tool", "g.urdf", "--urdf", tmp_path / "out.urdf"), "--xacro-arg are for an arm's URDF file, and ur5e is a"),
    ):
        code, out, err = retrieve(*args)
        assert (code, out) == (2, "")
        assert says in err


@pytest.fixture
def scenes(tmp_path: Path) -> Callable[..., Path]:
    """Writes scenes of a can in the cabinet, one for each change."""

    def write(*changes: Callable[[dict[str, Any]], object]) -> Path:
        out = []
        for i, change in enumerate(changes):
            scene = documents.scene(f"s{i}") | {"schema": "retrieve/scene@2", "target": "can", "approaches": ["horizontal"]}
            shape = {"type": "cylinder", "radius_m": 0.025, "height_m": 0.12}
            scene["objects"] = [{"name": "can", "shape": shape, "T_world_object": documents.pose(0.6, 0.0, 0.16)}]
            hand = documents.pose(0.6, 0.0, 0.17, q_wxyz=(0.0, 0.7071067811865475, 0.0, 0.7071067811865475))
            scene["grasp"] = {"T_world_hand": hand, "width_m": 0.05}
            change(scene)
            out.append(scene)
        file = tmp_path / "scenes.jsonl"
        file.write_text(documents.lines(*out))
        return file

    return write


def test_pose_noise_does_not_end_a_batch(retrieve: Callable[..., Spoken], scenes: Callable[..., Path]) -> None:
    """A can 1.5 mm in the floor is lifted, which stderr and the plan say; one 15 mm deep is a plan that failed at stage `scene`."""

    def at(z: float) -> Callable[[dict[str, Any]], object]:
        return lambda scene: scene["objects"][0].update(T_world_object=documents.pose(0.6, 0.0, z))

    file = scenes(at(0.16), at(0.1585), at(0.145), at(0.16))
    code, out, err = retrieve("plan", file, "--policy", "local")
    plans = lines(out)
    assert (code, [p["success"] for p in plans]) == (0, [True, True, False, True])
    assert f"{file}:2: can was moved by 1.5 mm: it stood 1.5 mm in the floor" in err
    (settled,) = plans[1]["settled"]
    assert (settled["object"], settled["reason"]) == ("can", "it stood 1.5 mm in the floor")
    assert settled["by_m"] == pytest.approx([0, 0, 0.0015], abs=1e-6)
    assert plans[2]["reason"]["stage"] == "scene"
    assert "'can' overlaps the cabinet's wall 'floor' by 15.0 mm" in plans[2]["reason"]["detail"]
    code, out, _ = retrieve("plan", file, "--policy", "local", "--pose-noise", "16")
    assert [p["success"] for p in lines(out)] == [True] * 4


def test_the_plan_begins_at_q_start(retrieve: Callable[..., Spoken], scenes: Callable[..., Path]) -> None:
    def start(**q: float) -> Callable[[dict[str, Any]], object]:
        return lambda scene: scene["robot"].update(q_start=q)

    file = scenes(start(shoulder_pan_joint=0.8), start(elbow_joint=4.0), lambda scene: scene.update(grasp=None))
    code, out, err = retrieve("plan", file, "--policy", "local")
    begun, beyond, without = lines(out)
    assert f"{file}:3: scene " in err
    assert (code, begun["success"], beyond["success"]) == (0, True, False)
    motion = begun["motions"][0]
    assert motion["q"][0][motion["joint_names"].index("shoulder_pan_joint")] == pytest.approx(0.8)
    assert (beyond["reason"]["stage"], beyond["motions"]) == ("transit", [])
    assert "joint elbow_joint is at 4, outside its limits" in beyond["reason"]["detail"]
    assert without["reason"]["stage"] == "scene"
    assert "has no grasp for its target: retrieve grasp proposes one" in without["reason"]["detail"]


def test_grasps_from_a_network(retrieve: Callable[..., Spoken], scenes: Callable[..., Path], tmp_path: Path) -> None:
    """Contact-GraspNet's poses in a camera's frame come out as hand poses, the network's best first, those beside the can left out."""
    T_camera = transform(rotation_from_wxyz(np.array([0.5, -0.5, 0.5, -0.5])), [0.1, 0.0, 0.3])
    hand = transform(rotation_from_wxyz(np.array([0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)])), [0.6, 0.0, 0.17])
    lower = transform(p=[0.0, 0.0, -0.01]) @ hand
    beside = transform(p=[0.0, 0.0, 0.2]) @ hand
    network = np.array([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, -0.1034], [0, 0, 0, 1]], float)  # its gripper in a hand: y from x
    poses = np.linalg.inv(T_camera) @ np.array([beside, lower, hand]) @ network
    np.savez(tmp_path / "g.npz", pred_grasps_cam=poses, scores=np.array([0.9, 0.2, 0.8]))
    frame = "0.1,0,0.3,0.5,-0.5,0.5,-0.5"
    file = scenes(lambda scene: scene.update(grasp=None))
    code, out, err = retrieve("grasp", file, "--from", tmp_path / "g.npz", "--convention", "contact-graspnet", "--frame", frame)
    assert (code, "1 that miss the target" in err) == (0, True)
    assert "1. score" in err
    assert "50 mm wide, the hand looks along yaw 0°, level" in err
    (scene,) = lines(out)
    assert len(scene["grasps"]) == 1
    assert scene["grasp"]["T_world_hand"]["p"][2] == pytest.approx(0.17, abs=1e-6)
    assert scene["grasps"][0]["T_world_hand"]["p"][2] == pytest.approx(0.16, abs=1e-6)
    assert scene["grasp"]["width_m"] == pytest.approx(0.05, abs=1e-6)
    code, _, err = retrieve("grasp", file, "--from", tmp_path / "g.npz")
    assert (code, "--from and --convention go together" in err) == (2, True)


def test_schemas_are_schemas(retrieve: Callable[..., Spoken]) -> None:
    for kind in KINDS:
        code, out, err = retrieve("schema", kind)
        assert (code, err) == (0, "")
        jsonschema.Draft202012Validator.check_schema(json.loads(out))
    jsonschema.validate(documents.observed()["observation"], json.loads(retrieve("schema", "observation")[1]))
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({}, json.loads(retrieve("schema", "observation")[1]))


def test_warm_up_is_for_robots_that_are_there(retrieve: Callable[..., Spoken], monkeypatch: pytest.MonkeyPatch) -> None:
    warmed: list[str] = []
    monkeypatch.setattr(warmup, "warm", warmed.append)
    code, out, err = retrieve("warmup")
    assert (code, out, "ur5e: ready after" in err) == (0, "", True)
    assert warmed == [name for name in named_robots() if installed(name)]
    warmed.clear()
    assert retrieve("warmup", "ur5e")[0] == 0
    assert warmed == ["ur5e"]


@pytest.mark.parametrize(
    ("ahead", "closing", "words"),
    [
        ((0.0, 0.0, -1.0), (0.0, 1.0, 0.0), "straight down, its fingers close along yaw 90°"),
        ((0.0, 0.0, -1.0), (0.0, -1.0, 0.0), "straight down, its fingers close along yaw 90°"),
        ((0.0, 0.0, 1.0), (-1.0, -1e-9, 0.0), "straight up, its fingers close along yaw 0°"),
        ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), "along yaw -90°, level"),
        ((1.0, -1e-9, 0.0), (0.0, -1.0, 0.0), "along yaw 0°, level"),
        ((0.5**0.5, 0.0, -(0.5**0.5)), (0.0, -1.0, 0.0), "along yaw 0°, 45° down"),
    ],
)
def test_where_a_hand_looks_is_said_by_what_can_be_seen(ahead: Sequence[float], closing: Sequence[float], words: str) -> None:
    """A hand that looks straight down has no yaw, but its fingers close along one."""
    R = np.stack([np.cross(closing, ahead), closing, ahead], -1)
    assert looks(Grasp(transform(R), 0.05)) == words


@pytest.mark.parametrize("target", ["can_1", "box_0"])
def test_what_touches_its_neighbour_and_what_it_stands_on_can_be_lifted(
    target: str, retrieve: Callable[..., Spoken], tmp_path: Path
) -> None:
    """Poses told to the millimetre touch: a can on a board, and two boxes side by side before it."""
    document = documents.scene() | {"schema": "retrieve/scene@2", "target": target, "grasp": None}
    board = {"type": "box", "size_m": [0.3, 0.3, 0.04]}
    document["obstacles"] = [{"name": "board", "shape": board, "T_world_object": documents.pose(0.6, 0.1, 0.12)}]
    for body, y, z in zip(document["objects"], (0.1, 0.1, 0.15), (0.19, 0.2, 0.24)):
        body["T_world_object"]["p"] = [0.6 if body["name"] == "can_1" else 0.5, y, z]
    (tmp_path / "cell.jsonl").write_text(documents.lines(document))
    code, out, _ = retrieve("plan", tmp_path / "cell.jsonl", "--policy", "local", "--grasp", "any")
    (plan,) = lines(out)
    assert (code, plan["success"], plan["verified"]) == (0, True, True)
    assert {note["object"] for note in plan["settled"]} == {"box_0", "can_1", "box_2"}
    (tmp_path / "plans.jsonl").write_text(out)
    assert retrieve("verify", tmp_path / "cell.jsonl", tmp_path / "plans.jsonl")[0] == 0


def test_what_the_robot_may_lift_is_said_in_a_yaml(tmp_path: Path, retrieve: Callable[..., Spoken]) -> None:
    said = {"objects": [f"{CAN},mass=4"], "payload_kg": 3.5}
    jsonschema.validate(said, json.loads((documents.SCHEMAS / "words.schema.json").read_text()))
    (tmp_path / "cell.yaml").write_text(yaml.safe_dump(said))
    code, _, _ = retrieve("scene", tmp_path / "cell.yaml", "-o", tmp_path / "cell.jsonl")
    (scene,) = lines((tmp_path / "cell.jsonl").read_text())
    assert (code, scene["robot"]["payload_kg"], scene["objects"][0]["mass_kg"]) == (0, 3.5, 4.0)
    (plan,) = lines(retrieve("plan", tmp_path / "cell.jsonl", "--policy", "local")[1])
    assert plan["reason"] == {"stage": "lift", "body": "can", "detail": "can weighs 4 kg, and the robot's payload is 3.5 kg"}
    (tmp_path / "cell.yaml").write_text(yaml.safe_dump(said | {"payload_kg": "much"}))
    assert "payload_kg: 'much' is no positive number" in retrieve("scene", tmp_path / "cell.yaml")[2]


def test_what_a_yaml_says_wrong_is_told_with_the_file_and_the_word(tmp_path: Path, retrieve: Callable[..., Spoken]) -> None:
    """An option that takes the place of a word is told as an option."""
    file = tmp_path / "cell.yaml"
    for said, options, told in (
        ({"objects": [f"{CAN},hight=3"]}, (), f"{file}: object {CAN},hight=3: unknown key 'hight'"),
        ({"objects": [CAN], "obstacles": ["post.stl@0,0"]}, (), f"{file}: obstacle post.stl@0,0: an obstacle is NAME:SHAPE@x,y,z"),
        ({"objects": [CAN], "cabinet": "450x900x700"}, (), f"{file}: cabinet 450x900x700: 900 is beyond 100 m"),
        ({"objects": [CAN, CAN]}, (), f"{file}: target is missing: say which object is wanted, e.g. can (the objects: can, can_2)"),
        ({"objects": [CAN], "at": "0.3"}, ("--at", "0,0"), "--at 0,0: a place is x,y,z"),
    ):
        file.write_text(yaml.safe_dump(said))
        code, _, err = retrieve("scene", file, *options)
        assert (code, err.strip().splitlines()[-1][: len(told)]) == (2, told)


def test_the_yaml_that_the_documents_show(tmp_path: Path, retrieve: Callable[..., Spoken]) -> None:
    shown = re.search(
        r"```yaml\n(.*?)```", (Path(__file__).resolve().parents[2] / "docs" / "own-cell.md").read_text(encoding="utf-8"), re.DOTALL
    )
    assert shown is not None
    (tmp_path / "cell.yaml").write_text(shown[1], encoding="utf-8")
    trimesh.creation.cylinder(30.0, 90.0).export(tmp_path / "mug.stl")
    code, out, _ = retrieve("scene", tmp_path / "cell.yaml")
    assert code == 0
    scene = json.loads(out)
    assert [body["name"] for body in scene["objects"]] == ["mug", "can", "carton"]
    assert [body["name"] for body in scene["obstacles"]] == ["table"]
    assert scene["robot"]["q_start"]["elbow_joint"] == 1.5
    assert scene["grasp"] is not None
