"""Frames as folders in the BOP layout, there and back; what a foreign folder lacks; the fused cloud as PLY."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from kinematics.shapes import Box, Cylinder
from kinematics.transforms import rotation_about, transform
from perception.camera import Intrinsics, cloud, look_at
from perception.frames import Frame, checked, read_frames, write_frames, write_ply
from perception.rendering.raycast import raycast
from perception.rendering.surfaces import surfaces

CAMERA = Intrinsics(80, 60, 70.0, 71.0, 38.5, 30.0)
NAMES = ("box_0", "can_1")


@pytest.fixture
def frames() -> tuple[Frame, ...]:
    """Two views of a box and a can, the lowest rows showing the robot in the second."""
    T = np.array([transform(rotation_about((0, 0, 1), 0.3), [0.5, 0.1, 0.1]), transform(p=[0.6, -0.1, 0.05])])
    world = surfaces([Box(np.array([0.06, 0.05, 0.2])), Cylinder(0.03, 0.1)], T)
    out = []
    for i, eye in enumerate(([0.0, 0.2, 0.3], [0.1, -0.1, 0.4])):
        pose = look_at(np.array(eye), np.array([0.55, 0.0, 0.1]))
        view = raycast(world, pose, CAMERA)
        arm = np.zeros(view.depth.shape, bool)
        arm[-5:] = True
        out.append(Frame(view.depth, view.instance, NAMES, CAMERA, pose, arm if i else None, np.array([0.1, -2.0, 0.3]) if i else None))
    return tuple(out)


def test_frames_come_back_as_they_were(frames: tuple[Frame, ...], tmp_path: Path) -> None:
    home = write_frames(tmp_path / "views", frames, scene=3)
    assert home == tmp_path / "views" / "000003"
    for back in (read_frames(tmp_path / "views"), read_frames(home), read_frames(tmp_path / "views", scene=3)):
        assert len(back) == 2
        for a, b in zip(frames, back):
            assert np.abs(a.depth - b.depth).max() <= 0.5e-4 + 1e-7
            assert np.array_equal(a.depth > 0, b.depth > 0)
            assert b.instance is not None
            assert np.array_equal(a.instance, b.instance)
            assert b.names == a.names
            assert b.intrinsics == a.intrinsics
            assert np.allclose(a.T_world_camera, b.T_world_camera, atol=1e-9)
            assert (a.arm is None) == (b.arm is None)
            assert a.arm is None or np.array_equal(a.arm, b.arm)
            assert (a.q is None) == (b.q is None)
            assert a.q is None or np.array_equal(a.q, b.q)


def test_the_layout_is_the_one_that_bop_describes(frames: tuple[Frame, ...], tmp_path: Path) -> None:
    home = write_frames(tmp_path, frames)
    camera = json.loads((home / "scene_camera.json").read_text())["1"]
    depth = np.asarray(Image.open(home / "depth" / "000001.png"))
    assert depth.dtype == np.uint16
    v, u = np.argwhere(frames[1].instance == 1)[20]
    z_mm = depth[v, u] * camera["depth_scale"]
    in_camera = z_mm * np.linalg.inv(np.reshape(camera["cam_K"], (3, 3))) @ [u, v, 1]
    R, t = np.reshape(camera["cam_R_w2c"], (3, 3)), np.array(camera["cam_t_w2c"])
    single = np.zeros_like(frames[1].depth)
    single[v, u] = frames[1].depth[v, u]
    assert z_mm > 0
    assert np.allclose(R.T @ (in_camera - t), 1e3 * cloud(single, CAMERA, frames[1].T_world_camera)[0], atol=0.2)
    mask = np.asarray(Image.open(home / "mask_visib" / "000001_000001.png"))
    assert np.array_equal(mask == 255, frames[1].instance == 1)
    assert [o["obj_id"] for o in json.loads((home / "scene_gt.json").read_text())["1"]] == [1, 2]


def test_an_older_recording_of_ours_leaves_nothing_behind(frames: tuple[Frame, ...], tmp_path: Path) -> None:
    write_frames(tmp_path, frames)
    home = write_frames(tmp_path, [replace(frames[0], instance=None, names=())])
    (back,) = read_frames(tmp_path)
    assert back.instance is None
    assert [p.name for p in (home / "depth").iterdir()] == ["000000.png"]
    assert not list(home.glob("**/*.part*"))


def test_a_recording_with_colour_images_is_not_overwritten(frames: tuple[Frame, ...], tmp_path: Path) -> None:
    (write_frames(tmp_path, frames) / "rgb").mkdir()
    with pytest.raises(ValueError, match="colour"):
        write_frames(tmp_path, frames[:1])
    assert len(read_frames(tmp_path)) == 2


def test_far_depths_take_a_coarser_scale(frames: tuple[Frame, ...], tmp_path: Path) -> None:
    far = replace(frames[0], depth=np.where(frames[0].depth > 0, frames[0].depth + 20, 0).astype(np.float32))
    write_frames(tmp_path, [far])
    assert np.abs(read_frames(tmp_path)[0].depth - far.depth).max() <= 0.5e-3 + 1e-5
    with pytest.raises(ValueError, match="70"):
        write_frames(tmp_path, [replace(far, depth=np.full((60, 80), 70, np.float32))])


def test_a_foreign_recording_is_named_by_its_object_ids(frames: tuple[Frame, ...], tmp_path: Path) -> None:
    home = write_frames(tmp_path, frames)
    (home / "scene_gt.json").write_text(json.dumps({k: [{"obj_id": 7}, {"obj_id": 7}] for k in "01"}))
    assert read_frames(tmp_path)[0].names == ("obj_000007", "obj_000007_1")
    (home / "scene_gt.json").unlink()
    assert read_frames(tmp_path)[1].names == ("object_0", "object_1")


def test_what_is_no_depth_is_nothing_measured(frames: tuple[Frame, ...], tmp_path: Path) -> None:
    depth = np.full(frames[0].depth.shape, 0.6)
    depth[:3] = np.array([np.nan, np.inf, -1.0])[:, None]
    write_frames(tmp_path, [replace(frames[0], depth=depth)])
    (back,) = read_frames(tmp_path)
    assert (back.depth[:3] == 0).all()
    assert np.allclose(back.depth[3:], 0.6)
    assert checked(replace(frames[0], depth=depth)).depth.dtype == np.float32


@pytest.mark.parametrize("ending", [".tif", ".tiff", ".npy", ".whole.npy", ".whole.tif"])
def test_depths_in_files_of_other_kinds(frames: tuple[Frame, ...], ending: str, tmp_path: Path) -> None:
    """Metres as floating-point numbers, as ROS has them (32FC1), with NaN for nothing; millimetres as whole ones."""
    home = write_frames(tmp_path, frames)
    cameras = json.loads((home / "scene_camera.json").read_text())
    for i, frame in enumerate(frames):
        (home / "depth" / f"{i:06d}.png").unlink()
        whole = ending.startswith(".whole")
        depth = np.round(frame.depth * 1e3).astype(np.uint16) if whole else np.where(frame.depth > 0, frame.depth, np.float32(np.nan))
        cameras[str(i)]["depth_scale"] = 1.0 if whole else 1000.0
        file = home / "depth" / f"{i:06d}.{ending.rpartition('.')[2]}"
        np.save(file, depth) if ending.endswith("npy") else Image.fromarray(depth).save(file)
    (home / "scene_camera.json").write_text(json.dumps(cameras))
    for a, b in zip(frames, read_frames(tmp_path)):
        assert np.abs(a.depth - b.depth).max() <= (0.51e-3 if whole else 1e-6)


@pytest.mark.parametrize(
    ("array", "told"),
    [
        (np.zeros((60, 80, 3), np.float32), r"holds float32 of shape \(60, 80, 3\): expected are depths of shape \(rows, columns\)"),
        (np.zeros((60, 80), np.uint8), "holds uint8"),
        (np.array([{}]), "no array of NumPy that can be read"),
    ],
)
def test_arrays_that_are_no_depths_are_told(frames: tuple[Frame, ...], array: np.ndarray, told: str, tmp_path: Path) -> None:
    home = write_frames(tmp_path, frames)
    (home / "depth" / "000000.png").unlink()
    np.save(home / "depth" / "000000.npy", array)
    with pytest.raises(ValueError, match=told):
        read_frames(tmp_path)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda f: {"depth": f.depth[::2, ::2]}, "shape 30 × 40, and its intrinsics are for 60 × 80"),
        (lambda f: {"depth": f.depth[..., None]}, "shape 60 × 80 × 1"),
        (lambda f: {"depth": (f.depth * 1000).astype(np.uint16)}, "type uint16: metres are expected"),
        (lambda f: {"depth": f.depth * 1000}, "metres are expected, and are these millimetres"),
        (lambda f: {"instance": np.zeros((3, 4), np.int32)}, "instance is of shape 3 × 4, and the depth image of 60 × 80"),
        (lambda f: {"T_world_camera": f.T_world_camera[:3]}, "T_world_camera is no pose"),
        (lambda f: {"T_world_camera": f.T_world_camera @ np.diag([-1, 1, 1, 1])}, "T_world_camera is no pose"),
    ],
)  # fmt: skip
def test_a_frame_that_is_none_is_told(
    frames: tuple[Frame, ...], tmp_path: Path, change: Callable[[Frame], dict[str, np.ndarray]], told: str
) -> None:
    with pytest.raises(ValueError, match="frame 1: .*" + told):
        write_frames(tmp_path, [frames[0], replace(frames[1], **change(frames[1]))])


def _edit(key: str, value: object) -> Callable[[Path], None]:
    def change(home: Path) -> None:
        file = home / "scene_camera.json"
        cameras = json.loads(file.read_text())
        if value is None:
            del cameras["0"][key]
        else:
            cameras["0"][key] = value
        file.write_text(json.dumps(cameras))

    return change


def _put(name: str, data: bytes) -> Callable[[Path], object]:
    return lambda home: (home / name).write_bytes(data)


def _image(name: str, image: np.ndarray) -> Callable[[Path], object]:
    return lambda home: Image.fromarray(image).save(home / name)


@pytest.mark.parametrize(
    ("harm", "told"),
    [
        (lambda home: (home / "scene_camera.json").unlink(), "scene_camera.json"),
        (_put("scene_camera.json", b"{"), "no JSON"),
        (_put("scene_camera.json", b"{}"), "names no image"),
        (_put("scene_camera.json", b'{"x": {}}'), "'x' is no number"),
        (_put("scene_camera.json", b'{"0": 1}'), "cam_K, depth_scale"),
        (_edit("cam_R_w2c", None), "image 0: cam_R_w2c is missing .*world to camera"),
        (_edit("cam_K", [1, 2]), "image 0: cam_K is not 9"),
        (_edit("cam_K", [1, 5, 3, 0, 1, 3, 0, 0, 1]), "no camera matrix"),
        (_edit("cam_R_w2c", [1, 0, 0, 0, 1, 0, 0, 0, -1]), "no rotation"),
        (_edit("depth_scale", 0), "depth_scale: 0 is not positive"),
        (_edit("cam_t_w2c", ["a", 0, 0]), "cam_t_w2c is not 3"),
        (lambda home: (home / "depth" / "000000.png").unlink(), r"depth.000000.png: no such file; expected is a PNG of 16 bits"),
        (_put("depth/000000.png", b"no png"), "no image that can be read"),
        (_image("depth/000000.png", np.zeros((60, 80), np.uint8)), "16 bits"),
        (_image("mask_visib/000000_000000.png", np.zeros((10, 20), np.uint8)), "20 × 10 pixels, the depth image 80 × 60"),
        (lambda home: (home / "mask_visib" / "000000_000001.png").unlink(), "000000_000001.png: no such file"),
        (_put("scene_gt.json", b'{"0": [{}]}'), "scene_gt.json: image 0: is no list of objects with an obj_id"),
    ],
)
def test_what_is_missing_or_wrong_is_said_with_its_file(
    frames: tuple[Frame, ...], tmp_path: Path, harm: Callable[[Path], object], told: str
) -> None:
    harm(write_frames(tmp_path, frames))
    with pytest.raises(ValueError, match=told) as error:
        read_frames(tmp_path)
    assert str(tmp_path) in str(error.value)


def test_which_scene_must_be_clear(frames: tuple[Frame, ...], tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no such folder"):
        read_frames(tmp_path / "nowhere")
    with pytest.raises(ValueError, match="holds no scene"):
        read_frames(tmp_path)
    write_frames(tmp_path, frames, scene=0)
    write_frames(tmp_path, frames[:1], scene=1)
    with pytest.raises(ValueError, match="several scenes; there are 000000, 000001"):
        read_frames(tmp_path)
    with pytest.raises(ValueError, match="no scene 000005"):
        read_frames(tmp_path, scene=5)
    assert len(read_frames(tmp_path, scene=1)) == 1


def test_the_cloud_is_a_ply_that_others_read(frames: tuple[Frame, ...], tmp_path: Path) -> None:
    n = write_ply(tmp_path / "cloud.ply", frames)
    read = trimesh.load(tmp_path / "cloud.ply")
    expected = [cloud(np.where(f.arm, 0, f.depth) if f.arm is not None else f.depth, f.intrinsics, f.T_world_camera) for f in frames]
    assert len(read.vertices) == n == sum(map(len, expected))
    assert np.allclose(read.vertices, np.concatenate(expected), atol=1e-5)
    instance = np.ravel(read.metadata["_ply_raw"]["vertex"]["data"]["instance"])
    assert set(np.unique(instance)) == {0, 1}
    colours = {tuple(c) for c in np.asarray(read.colors)[instance == 0]}
    assert len(colours) == 1
    assert colours != {tuple(c) for c in np.asarray(read.colors)[instance == 1]}


def test_objects_are_numbered_by_name_across_frames(frames: tuple[Frame, ...], tmp_path: Path) -> None:
    a, b = frames[0], frames[0]
    swapped = replace(b, names=NAMES[::-1], instance=np.where(b.instance >= 0, 1 - b.instance, -1).astype(np.int32))
    write_ply(tmp_path / "a.ply", [a, a])
    write_ply(tmp_path / "b.ply", [a, swapped])
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()
    assert write_ply(tmp_path / "empty.ply", []) == 0


def test_a_recording_in_a_folder_of_the_folder_is_meant(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"holds no scene in the BOP layout; expected is .*scene_camera.json$"):
        read_frames(tmp_path)
    (tmp_path / "views" / "000000").mkdir(parents=True)
    (tmp_path / "views" / "000000" / "scene_camera.json").write_text("{}")
    with pytest.raises(ValueError, match=rf"\(did you mean {tmp_path / 'views'}\?\)$"):
        read_frames(tmp_path)
