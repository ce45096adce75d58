"""Version 2 of a scene: it comes back as it was written, version 1 stays what it was, and what is missing is said when it is needed."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import documents
import jsonschema
import numpy as np
import pytest

from kinematics.errors import InputError
from planning.io.scene_documents import scene_from_json, scene_to_json

Change = Callable[[dict[str, Any]], object]
SCHEMA = json.loads((documents.SCHEMAS / "scene.schema.json").read_text())


def no_target() -> dict[str, Any]:
    """Nothing is known but where the target is."""
    document = documents.cell() | {"target": None, "target_box": [0.6, 0.1, 0.16, 0.06, 0.06, 0.12], "grasp": None, "objects": []}
    del document["grasps"]
    return document


@pytest.mark.parametrize("document", [documents.cell(), no_target(), no_target() | {"target": "mug"}], ids=["cell", "box", "by name"])
def test_a_scene_of_version_2_comes_back(document: dict[str, Any]) -> None:
    if document["target"] is not None:
        document.pop("target_box", None)
    written = scene_to_json(scene_from_json(document))
    assert written == document
    jsonschema.validate(written, SCHEMA)


def test_what_may_be_null_may_be_left_out_in_version_2() -> None:
    document = no_target()
    short = {key: value for key, value in document.items() if value is not None}
    assert {"target", "grasp"} <= document.keys() - short.keys()
    jsonschema.validate(short, SCHEMA)
    assert scene_to_json(scene_from_json(short)) == document
    for name in ("target", "grasp"):
        first = documents.scene()
        del first[name]
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(first, SCHEMA)
        with pytest.raises(InputError, match=f"missing field '{name}'"):
            scene_from_json(first)


def test_whole_numbers_may_have_a_point() -> None:
    """JSON has but one kind of number, and JSON Schema calls 10.0 an integer."""
    document = documents.scene()
    pointed = document | {"regions": {"n": float(document["regions"]["n"])}, "seed": [float(n) for n in document["seed"]]}
    jsonschema.validate(pointed, SCHEMA)
    assert json.dumps(scene_to_json(scene_from_json(pointed))) == json.dumps(document)
    for wrong in (2.5, 1e300, True, "10"):
        with pytest.raises(InputError, match=r"regions\.n: .* stands where a whole number is expected"):
            scene_from_json(document | {"regions": {"n": wrong}})


def test_what_uses_nothing_of_version_2_is_written_as_version_1() -> None:
    first = documents.scene()
    second = {**first, "schema": "retrieve/scene@2", "obstacles": [], "grasps": []}
    assert json.dumps(scene_to_json(scene_from_json(second))) == json.dumps(first)


def test_each_field_of_version_2_makes_it_version_2() -> None:
    scene, cell = scene_from_json(documents.scene()), scene_from_json(documents.cell())
    robots = [replace(scene.robot, **{f: getattr(cell.robot, f)}) for f in ("q_start", "home", "T_link_hand", "gripper_joints", "mount")]
    body = scene.objects[0]
    others = [
        *(replace(scene, robot=robot) for robot in robots),
        replace(scene, robot=replace(scene.robot, mount=False)),
        replace(scene, robot=replace(scene.robot, payload_kg=3.5)),
        replace(scene, obstacles=cell.obstacles),
        replace(scene, grasps=cell.grasps),
        replace(scene, grasp=None),
        replace(scene, target=None),
        replace(scene, target=None, target_box=np.array([0.5, 0, 0.2, 0.1, 0.1, 0.1])),
        replace(scene, objects=()),
        replace(scene, objects=(replace(body, max_tilt_deg=0.0), *scene.objects[1:])),
        replace(scene, objects=(replace(body, source="seen"), *scene.objects[1:])),
        replace(scene, objects=(replace(body, sides_m=(0.0, 0.05)), *scene.objects[1:])),
        replace(scene, objects=(replace(body, mass_kg=0.0), *scene.objects[1:])),
    ]
    for other in others:
        written = scene_to_json(other)
        assert scene_to_json(scene_from_json(written)) == written
        assert written["schema"] == "retrieve/scene@2"
        jsonschema.validate(written, SCHEMA)
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate({**written, "schema": "retrieve/scene@1"}, SCHEMA)
        with pytest.raises(InputError):
            scene_from_json({**written, "schema": "retrieve/scene@1"})


MISTAKES: list[tuple[Change, str]] = [
    (lambda d: d["objects"][0].update(sides_m=[0.1, 0.05]), "objects[0].sides_m: [0.1, 0.05] is not from a height above the object's"),
    (lambda d: d["objects"][0].update(sides_m=[-0.1, 0.05]), "objects[0].sides_m: [-0.1, 0.05] is not from a height above the object's"),
    (lambda d: d["objects"][0].update(sides_m=[0.1]), "objects[0].sides_m: holds 1 numbers, and 2 are needed"),
    (lambda d: d.update(schema="retrieve/scene@1"), "the field 'obstacles' came with version 2: write \"schema\": \"retrieve/scene@2\""),
    (lambda d: d["obstacles"][0].update(name="box_0"), "obstacles[0].name: 'box_0' is an object; choose another name"),
    (lambda d: d["obstacles"][0].update(name="floor"), "obstacles[0].name: 'floor' is a wall of the cabinet; "),
    (lambda d: d["obstacles"].append(d["obstacles"][0]), "obstacles[1].name: 'table' is the name of an obstacle before it; "),
    (lambda d: d["obstacles"][0].update(source="seen"), "obstacles[0]: unknown field 'source'"),
    (lambda d: d["obstacles"][0].update(T_world_object=documents.pose(0.5, 0, 0.2)), "objects[2]: 'box_2' overlaps the obstacle 'table'"),
    (lambda d: d["objects"][0].update(source="said"), "objects[0].source: 'said' is not one of given, seen"),
    (lambda d: d["objects"][0].update(mass_kg=-1), "objects[0].mass_kg: -1 is below 0"),
    (lambda d: d["obstacles"][0].update(mass_kg=1), "obstacles[0]: unknown field 'mass_kg'"),
    (lambda d: d["robot"].update(payload_kg="5"), "robot.payload_kg: the text '5' stands where a number is expected"),
    (lambda d: d["objects"][0].update(max_tilt_deg=200), "objects[0].max_tilt_deg: 200 is above 180"),
    (lambda d: d["robot"].update(q_start=[0, 1]), 'robot.q_start: values stand by joint name, in rad or m: {"shoulder_pan_joint": 0.0, …}'),
    (lambda d: d["robot"].update(q_start={"elbow_joint": "1"}), "robot.q_start.elbow_joint: the text '1' stands where a number"),
    (lambda d: d["robot"].update(q=[0, 1]), "robot: unknown field 'q'; where the arm is now is said by joint name, with \"q_start\": {"),
    (lambda d: d["robot"].update(gripper_joints=[]), "robot.gripper_joints: holds 0, and at least 1 is needed"),
    (lambda d: d["robot"].update(mount=1), "robot.mount: the number 1 stands where true or false is expected"),
    (lambda d: d["grasps"][1].pop("score"), "grasps[1]: missing field 'score'"),
    (lambda d: d.update(target="can_9"), "target: 'can_9' is not among the objects (box_0, can_1, box_2) (did you mean 'can_1'?)"),
    (lambda d: d.update(target_box=[0.6, 0, 0.2, 0.1, 0.1, 0.1]), "target_box: stands beside a target that is named; "),
    (lambda d: d.update(target=None, target_box=[0.6, 0, 0.2, 0.1, 0.1, 0]), "target_box: its size is not positive; "),
]  # fmt: skip


@pytest.mark.parametrize(("change", "says"), MISTAKES, ids=[says[:40] for _, says in MISTAKES])
def test_a_mistake_is_told_with_its_place(change: Change, says: str) -> None:
    document = documents.cell()
    change(document)
    with pytest.raises(InputError) as caught:
        scene_from_json(document, "cell.jsonl:1")
    assert str(caught.value).startswith(f"cell.jsonl:1: {says}")


def test_what_is_missing_is_said_when_it_is_needed() -> None:
    scene = scene_from_json(no_target())
    with pytest.raises(InputError, match="scene 0-000007 has no target: "):
        _ = scene.target_name
    with pytest.raises(InputError, match="has no grasp for its target: retrieve grasp proposes one"):
        _ = scene.x_g
    with pytest.raises(InputError, match="the target 'mug' is not among its objects: it has none yet; look for it with retrieve sense"):
        _ = replace(scene, target="mug").target_body
    whole = scene_from_json(documents.cell())
    assert (whole.target_name, whole.target_body.name, whole.x_g.width_m) == ("can_1", "can_1", 0.06)
