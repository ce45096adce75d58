"""Scenes out of recorded frames: bodies, unseen space as obstacles, pixels, grasps; stacked objects go from the top."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from photographs import box, can, lifted, photograph, placed, without_masks

from kinematics.errors import InputError
from kinematics.robots.load import load
from kinematics.scene import Body, Cabinet, Grasp, RobotRef, Scene, State, object_box
from kinematics.shapes import ConvexMesh
from kinematics.transforms import Array, transform
from perception.camera import realsense_d435i
from perception.frames import Frame, write_frames
from perception.observation import is_seen, observe
from planning.grasping.hand_poses import level_hand
from planning.io.files import read_scenes
from planning.io.results import scene_writer
from planning.motion.pick_place import Motions
from planning.plan import Blocked
from planning.sensing.recording import box_at_pixel
from planning.sensing.unknown_space import unknown_boxes
from planning.verdict import judge_hold
from retrieve_cli.plan_line import plan_scene
from retrieve_cli.sense import parse_pixel, run

CABINET = Cabinet(np.array([0.56, 0.86, 0.50]), transform(p=[0.3, 0.0, 0.1]), 0.03)
CAMERA = realsense_d435i(320, 240)
BODIES = (can("can", 0.2, 0.1, 0.03, 0.15), box("carton", 0.34, -0.15, [0.05, 0.06, 0.2], 0.3))


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, tuple[Frame, ...]]:
    """Seven frames of a can and a carton, without masks."""
    folder = tmp_path_factory.mktemp("recording")
    frames = tuple(without_masks(photograph(placed(BODIES, CABINET), CABINET, camera=CAMERA)))
    write_frames(folder, frames)
    return folder, frames


def blank(file: Path, **more: object) -> Path:
    """A scene of which nothing is known but robot and cabinet."""
    scene = Scene("blank", RobotRef(np.eye(4), "ur5e"), CABINET, (), None, None)
    with scene_writer(file) as write:
        write(replace(scene, **more))  # type: ignore[arg-type]
    return file


def sensed(scenes: Path, folder: Path, out: Path, **more: object) -> Scene:
    given = {"views": None, "max_views": 8, "share": 0.97, "noise": False, "by": "geometry", "target_box": None, "seed": 0}
    run(scenes=scenes, from_views=folder, out=out, **{**given, **more})  # type: ignore[arg-type]
    ((_, scene),) = read_scenes(out)
    return scene


def test_frames_become_bodies_a_target_and_a_grasp_that_can_be_planned_on(
    recording: tuple[Path, tuple[Frame, ...]], tmp_path: Path
) -> None:
    from retrieve_cli.plan_job import Job

    true = object_box(placed(BODIES, CABINET)[0])
    scene = sensed(blank(tmp_path / "a.jsonl", target_box=true), recording[0], tmp_path / "b.jsonl")
    assert json.loads((tmp_path / "b.jsonl").read_text())["schema"] == "retrieve/scene@2"
    assert is_seen(scene)
    assert scene.target == "target"
    assert len(scene.objects) == 2
    assert all(b.source == "seen" for b in scene.objects)
    assert np.abs(object_box(scene.target_body) - true).max() < 0.01
    assert scene.grasp is not None
    flags = observe(scene, State(np.zeros(1), scene.poses())).regions[:, 3]
    assert 0 < flags.mean() < 1
    plan = plan_scene(Job("local", "deep", 0, None, None, 5), "here", scene)
    free = plan_scene(Job("local", "deep", 0, None, None, 5, unseen="free"), "here", scene)
    assert free.success
    assert plan.success
    assert plan.verified


def test_what_no_frame_has_shown_is_an_obstacle_and_the_reason_says_where_to_look(
    recording: tuple[Path, tuple[Frame, ...]], tmp_path: Path
) -> None:
    from retrieve_cli.plan import Job

    write_frames(tmp_path / "few", recording[1][:2])
    true = object_box(placed(BODIES, CABINET)[1])
    shown = {
        n: sensed(blank(tmp_path / "a.jsonl", target_box=true), tmp_path / "few", tmp_path / "b.jsonl", smallest_mm=n) for n in (0.0, 40.0)
    }
    least, most = (sum(float(np.prod(b.shape.size_m)) for b in unknown_boxes(shown[n])) for n in (40.0, 0.0))  # type: ignore[union-attr]
    assert 0 < least < most
    plan = plan_scene(Job("local", "deep", 0, None, None, 5), "here", shown[0.0])
    assert plan.reason is not None
    assert plan.reason.stage == "look"
    assert plan.unsolvable is None
    assert "unseen space" in str(plan.reason.detail)
    assert "look from (" in str(plan.reason.detail)


def test_a_pixel_says_which_object_is_wanted(recording: tuple[Path, tuple[Frame, ...]], tmp_path: Path) -> None:
    folder, frames = recording
    carton = object_box(placed(BODIES, CABINET)[1])
    near = [np.abs(box_at_pixel(frames, 2, u, v)[:3] - carton[:3]).max() for u in range(0, 320, 8) for v in range(0, 240, 8)]
    k = int(np.argmin(near))
    pixel = f"2,{8 * (k // 30)},{8 * (k % 30)}"
    scene = sensed(blank(tmp_path / "a.jsonl"), folder, tmp_path / "b.jsonl", target_pixel=pixel)
    assert np.abs(object_box(scene.target_body)[:2] - carton[:2]).max() < 0.01
    with pytest.raises(ValueError, match="there is no frame 9"):
        box_at_pixel(frames, 9, 0, 0)
    with pytest.raises(ValueError, match="no pixel 320, 0"):
        box_at_pixel(frames, 0, 320, 0)
    dark = [replace(f, depth=np.zeros_like(f.depth)) for f in frames]
    with pytest.raises(ValueError, match="measured nothing"):
        box_at_pixel(dark, 0, 5, 5)
    assert parse_pixel("3,4") == (0, 3, 4)
    for text in ("3", "a,b", "1,2,3,4", "-1,2"):
        with pytest.raises(InputError, match="whole numbers"):
            parse_pixel(text)


def test_a_file_says_the_intrinsics_of_recorded_frames(
    recording: tuple[Path, tuple[Frame, ...]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As cam_K does; a lens in it is undone, and a pixel is that of the recorded image."""
    folder, _ = recording
    home, said = tmp_path / "views", tmp_path / "camera_info.yaml"
    shutil.copytree(folder / "000000", home)
    cameras = json.loads((home / "scene_camera.json").read_text())
    K = cameras["0"]["cam_K"]
    for entry in cameras.values():
        del entry["cam_K"]
    (home / "scene_camera.json").write_text(json.dumps(cameras))
    info = f"height: 240\nwidth: 320\ndistortion_model: plumb_bob\nk: {K}\nd: "
    said.write_text(f"{info}[0.0, 0.0, 0.0, 0.0, 0.0]\n---\n")
    scenes, pixel = blank(tmp_path / "a.jsonl"), "0,150,120"
    sensed(scenes, home, tmp_path / "b.jsonl", camera=said, target_pixel=pixel)
    sensed(scenes, folder, tmp_path / "c.jsonl", target_pixel=pixel)
    assert (tmp_path / "b.jsonl").read_text() == (tmp_path / "c.jsonl").read_text()
    assert "distortion" not in capsys.readouterr().err
    said.write_text(f"{info}[0.02, 0.0, 0.0, 0.0, 0.0]\n---\n")
    sensed(scenes, home, tmp_path / "b.jsonl", camera=said, target_pixel=pixel)
    assert "its lens's distortion is taken out of depths and masks; for images that are rectified" in capsys.readouterr().err
    said.write_text(said.read_text().replace("width: 320", "width: 640"))
    with pytest.raises(InputError, match=r"camera_info.yaml is for images of 640 × 240 pixels, and the depth image has 320 × 240"):
        sensed(scenes, home, tmp_path / "b.jsonl", camera=said)
    with pytest.raises(InputError, match=r"sense: --camera: .*nowhere.json: no such file"):
        sensed(scenes, home, tmp_path / "b.jsonl", camera=tmp_path / "nowhere.json")
    with pytest.raises(InputError, match=r"--camera says the intrinsics of recorded frames: give them, --from-views DIR"):
        run(
            scenes=scenes,
            views=None,
            from_views=None,
            camera=said,
            max_views=1,
            share=0.5,
            noise=False,
            by="mask",
            target_box=None,
            seed=0,
            out=None,
        )


def test_unseen_space_is_that_of_the_observation(recording: tuple[Path, tuple[Frame, ...]], tmp_path: Path) -> None:
    scene = sensed(blank(tmp_path / "a.jsonl"), recording[0], tmp_path / "b.jsonl")
    assert scene.target is None
    assert scene.observation is not None
    boxes = unknown_boxes(scene)
    cells = np.array([b.shape.size_m for b in boxes]) / (CABINET.size_m / [112, 172, 100])
    assert len(boxes)
    assert np.allclose(cells, np.round(cells))
    seen = np.array([0.45, 0.1, 0.35])  # over the can, before the back
    assert not any((np.abs(seen - b.T_world_body[:3, 3]) < b.shape.half).all() for b in boxes)
    for b in boxes:
        low, high = object_box(b)[:3] - object_box(b)[3:] / 2, object_box(b)[:3] + object_box(b)[3:] / 2
        assert (low >= np.array([0.3, -0.43, 0.1]) - 1e-9).all()
        assert (high <= np.array([0.86, 0.43, 0.6]) + 1e-9).all()


def test_without_objects_and_without_frames_nothing_can_be_sensed(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="give recorded frames"):
        sensed(blank(tmp_path / "a.jsonl"), None, tmp_path / "b.jsonl")  # type: ignore[arg-type]


def test_what_carries_something_is_not_picked_before_that() -> None:
    lower, upper = placed((box("lower", 0.25, 0.0, [0.06, 0.08, 0.1]), lifted(can("upper", 0.25, 0.0, 0.025, 0.1), 0.1007)), CABINET)
    scene = Scene("stack", RobotRef(np.eye(4), "ur5e"), CABINET, (lower, upper), "upper", None)
    motions = Motions(load("ur5e"), scene, target_grasps=())
    state = motions.start()
    picks, why = motions.picks(state, "lower")
    assert not picks
    assert isinstance(why, Blocked)
    assert why.body == "upper"
    assert "upper rests on lower" in str(why.detail)
    assert motions.picks(state, "upper")[0]
    alone = State(state.q, {"lower": state.poses["lower"]})
    assert motions.picks(alone, "lower")[0]


def test_a_bottle_that_was_seen_is_held_below_its_neck(tmp_path: Path) -> None:
    """Its solid is as wide at the neck, where pads would stop before it: neither grasps that are proposed nor a given one close there."""

    def ring(radius_m: float, z: float) -> Array:
        angle = np.arange(32) * np.pi / 16
        return np.column_stack([radius_m * np.cos(angle), radius_m * np.sin(angle), np.full(32, z)])

    rings = [ring(0.03, -0.1), ring(0.03, 0.01), ring(0.013, 0.06), ring(0.013, 0.1)]
    bottle = Body("bottle", ConvexMesh(tuple(np.concatenate(pair) for pair in pairwise(rings))), transform(p=[0.25, 0.05, 0.1]))
    (true,) = placed([bottle], CABINET)
    write_frames(tmp_path / "frames", without_masks(photograph(placed([bottle], CABINET), CABINET, camera=CAMERA)))
    robot, shoulder_z = load("ur5e"), float(true.T_world_body[2, 3]) + 0.01
    at_neck = Grasp(transform(level_hand(np.array([1.0, 0.0, 0.0]), 0.0), [*true.T_world_body[:2, 3], shoulder_z + 0.075]), 0.026)
    T = at_neck.T_world_hand.copy()
    T[:3, 3] -= robot.opening.pad_z_at(0.026) * T[:3, 2]
    assert judge_hold(robot, true, replace(at_neck, T_world_hand=T)) is None
    for given in (None, replace(at_neck, T_world_hand=T)):
        file = blank(tmp_path / "blank.jsonl", grasp=given, target_box=object_box(true))
        seen = sensed(file, tmp_path / "frames", tmp_path / "seen.jsonl")
        (body,) = seen.objects
        assert body.sides_m is not None
        assert body.sides_m[1] == pytest.approx(0.11, abs=0.012)
        for grasp in (seen.x_g, *(grasp for grasp, _ in seen.grasps)):
            middle_z = (grasp.T_world_hand @ [*robot.opening.middle(grasp.width_m), 1.0])[2]
            assert middle_z < shoulder_z
