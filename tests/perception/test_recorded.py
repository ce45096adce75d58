"""Recorded frames as they are: saturated and flying pixels clear nothing; frames that can't be of the cabinet say why."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from photographs import box, can, placed, without_masks
from photographs import photograph as pictures
from PIL import Image
from scipy import ndimage

from kinematics.scene import Body, Cabinet
from kinematics.shapes import Box
from kinematics.transforms import Array, inverse, rotation_about, rotation_from_wxyz, transform, wxyz_from_rotation
from perception.camera import Depth, DepthNoise, depth_edges, look_at, ray_directions, realsense_d435i
from perception.frames import Frame, read_frames, write_frames
from perception.mapping.voxels import FREE, unknown_voxels
from perception.objects.segment import segment
from perception.recorded import misfit, trusted
from perception.rendering.raycast import raycast
from perception.rendering.surfaces import surfaces
from perception.seen_through import without_seen_through

CAMERA = realsense_d435i(320, 240)
CABINET = Cabinet(np.array([0.56, 0.86, 0.50]), transform(p=[0.5, 0.0, 0.1]), 0.03)
BASE = transform(p=[-0.1, 0.3, 0.2])
OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
POSE = look_at(np.array([0.25, -0.2, 0.5]), np.array([0.8, 0.0, 0.15]))


def photograph() -> Frame:
    """A box in a cabinet, seen from before it."""
    bodies = [Body("box", Box(np.array([0.1, 0.1, 0.2])), transform(p=[0.75, 0.0, 0.2])), *CABINET.walls()]
    view = raycast(surfaces([b.shape for b in bodies], np.array([b.T_world_body for b in bodies])), POSE, CAMERA)
    return Frame(view.depth, None, (), CAMERA, POSE)


def free(frame: Frame) -> np.ndarray:
    return unknown_voxels(CABINET).fuse(frame.depth, frame.intrinsics, frame.T_world_camera).state == FREE


def test_saturated_depths_measure_nothing(tmp_path: Path) -> None:
    home = write_frames(tmp_path, [photograph()])
    (before,) = read_frames(tmp_path)
    image = np.array(Image.open(home / "depth" / "000000.png"))
    image[100:140, 150:170] = 65535
    Image.fromarray(image).save(home / "depth" / "000000.png")
    (frame,) = read_frames(tmp_path)
    assert (frame.depth[100:140, 150:170] == 0).all()
    assert not (free(frame) & ~free(before)).any()


def test_what_is_beyond_any_range_measures_nothing() -> None:
    frame = photograph()
    depth = frame.depth.copy()
    depth[100:140, 150:170] = 42.0
    depth[0, 0] = np.nan
    out = trusted(replace(frame, depth=depth)).depth
    assert (out[100:140, 150:170] == 0).all()
    assert np.isfinite(out).all()


def test_flying_pixels_are_dropped_and_clear_nothing() -> None:
    frame = photograph()
    truth, depth = frame.depth, frame.depth.copy()
    edge = np.zeros(depth.shape, bool)
    edge[:, 1:] = (truth[:, 1:] - truth[:, :-1] > 0.05) & (truth[:, :-1] > 0.4)  # right of the box: the first pixel of what is behind
    depth[edge] = (0.5 * truth + 0.5 * np.roll(truth, 1, 1))[edge]
    assert edge.sum() > 50
    out = trusted(replace(frame, depth=depth)).depth
    assert (out[edge] == 0).mean() > 0.75  # at corners nothing is even
    assert not (free(replace(frame, depth=out)) & ~free(frame)).any()


def blurred(depth: Depth, width: int) -> Depth:
    """What a camera makes of edges whose pixels look at what is before and what is behind at once: their mean."""
    near = depth_edges(depth, 0.02, width // 2) & (depth > 0)
    return np.where(near, ndimage.uniform_filter(depth, width), depth).astype(np.float32)


def mixed(depth: Depth, width: int) -> Depth:
    """Half of the pixels so near to an edge measure anything between the two."""
    rng = np.random.default_rng(44010)
    near = depth_edges(depth, 0.02, width // 2) & (depth > 0) & (rng.random(depth.shape) < 0.5)
    low, high = (extreme(depth, width) for extreme in (ndimage.minimum_filter, ndimage.maximum_filter))
    return np.where(near, low + rng.random(depth.shape) * (high - low), depth).astype(np.float32)


@pytest.mark.parametrize(("fly", "width", "left"), [(blurred, 3, 0.01), (blurred, 5, 0.08), (mixed, 3, 0.04), (mixed, 5, 0.04)])
def test_pixels_in_the_air_are_dropped_wherever_their_neighbours_fly_as_well(
    fly: Callable[[Depth, int], Depth], width: int, left: float
) -> None:
    """Of those that are more than 2 cm off; and hardly any of what is right."""
    frame = photograph()
    depth = fly(frame.depth, width)
    wrong = np.abs(depth - frame.depth) > 0.02
    out = trusted(replace(frame, depth=depth)).depth
    assert wrong.sum() > 200
    assert (out[wrong] > 0).mean() < left
    assert (out[~wrong & (depth > 0)] > 0).mean() > 0.995


def test_edges_that_fly_make_no_objects_of_their_own() -> None:
    boxes = [box("c", 0.3, 0.25, [0.06, 0.08, 0.12], 0.3), box("d", 0.15, -0.1, [0.05, 0.07, 0.2])]
    bodies = placed([can("a", 0.2, 0.1), can("b", 0.32, -0.18), *boxes], CABINET)
    frames = [replace(f, depth=blurred(f.depth, 5)) for f in without_masks(pictures(bodies, CABINET, DepthNoise(edge_dropout=0.0)))]
    found = segment(without_seen_through([trusted(f) for f in frames]), CABINET, by="geometry")
    assert len(found) == 4


def test_clean_surfaces_are_no_flying_pixels() -> None:
    """Nor are those seen at a grazing angle, a row of pixels 2 to 40 cm behind the last one; a bar two pixels wide stays."""
    frame = photograph()
    assert (trusted(frame).depth > 0).sum() > 0.999 * (frame.depth > 0).sum()
    grazing = np.broadcast_to((1 / np.linspace(1 / 3, 2.0, 36, dtype=np.float32))[:, None], (36, 50)).copy()
    assert (np.diff(-grazing[:20], axis=0) > 0.02).all()
    assert (trusted(replace(frame, depth=grazing)).depth[2:-2, 2:-2] > 0).all()
    bar = np.full((36, 50), 0.8, np.float32)
    bar[5:30, 20:22] = 0.5
    assert (trusted(replace(frame, depth=bar)).depth > 0).all()


def test_a_recording_that_fits_is_not_complained_of() -> None:
    assert misfit([photograph()], CABINET, BASE) is None
    assert misfit([], CABINET, BASE) is None


@pytest.mark.parametrize(
    ("frame", "cause"),
    [
        (replace(photograph(), T_world_camera=inverse(POSE)), "must be world to camera"),
        (
            replace(photograph(), T_world_camera=inverse(transform(inverse(POSE)[:3, :3], inverse(POSE)[:3, 3] * 1e-3))),
            "must be in millimetres",
        ),
        (replace(photograph(), T_world_camera=POSE @ OPENGL), "axes are OpenGL's (y up, z backwards)"),
        (replace(photograph(), T_world_camera=inverse(POSE @ OPENGL)), "axes are OpenGL's (y up, z backwards)"),
        (replace(photograph(), depth=photograph().depth * np.float32(10)), "depth_scale is wrong by a factor of 0.1"),
        (replace(photograph(), T_world_camera=transform(p=[5, 5, 5])), "is the pose world-to-camera"),
        (replace(photograph(), depth=np.zeros_like(photograph().depth)), "no pixel of the frames measured anything"),
    ],
    ids=["inverted", "metres", "opengl", "opengl, inverted", "scale", "elsewhere", "blind"],
)
def test_a_recording_that_can_not_fit_says_why(frame: Frame, cause: str) -> None:
    why = misfit([frame], CABINET, BASE)
    assert why is not None
    assert cause in why


def looking(rng: np.random.Generator, deep: bool) -> Array:
    """A camera's pose before the cabinet, or within it, that looks into it."""
    high = np.array([0.40, 0.36, 0.44]) if deep else np.array([-0.02, 0.5, 0.6])
    at = rng.uniform([0.05 if deep else -0.4, -high[1], 0.06], high)
    return CABINET.T_world_cabinet @ look_at(at, rng.uniform([0.45, -0.3, 0.0], [0.56, 0.3, 0.4]))


@pytest.mark.parametrize("deep", [False, True], ids=["before it", "within it"])
def test_poses_the_other_way_round_are_found_where_they_show_something_of_the_cabinet(deep: bool) -> None:
    """And poses that are right, but for two degrees and a centimetre, are not complained of, with noise and flying pixels."""
    rng, found, showed = np.random.default_rng(3), 0, 0
    bodies = [Body("box", Box(np.array([0.1, 0.1, 0.2])), transform(p=[0.8, 0.0, 0.2])), *CABINET.walls()]
    seen = surfaces([b.shape for b in bodies], np.array([b.T_world_body for b in bodies]))
    small = realsense_d435i(160, 120)
    for _ in range(60):
        pose, axis = looking(rng, deep), rng.normal(size=3)
        depth = raycast(seen, pose, small).depth
        depth = np.where(depth > 0, depth + rng.normal(scale=0.004, size=depth.shape), 0.0).astype(np.float32)
        off = transform(rotation_about(axis / np.linalg.norm(axis), np.radians(2)), rng.normal(scale=0.006, size=3))
        frame = trusted(Frame(depth, None, (), small, pose @ off))
        assert misfit([frame], CABINET, BASE) is None
        why = misfit([replace(frame, T_world_camera=inverse(pose))], CABINET, BASE) or ""
        found, showed = found + ("must be world to camera" in why), showed + ("hardly show" in why)
    assert found >= (54 if deep else 60)  # a single view from within may lie in the cabinet either way
    assert showed > 5


@pytest.mark.parametrize("middle", [(640.0, 360.0), (319.5, 239.5), (79.5, 59.5)], ids=["outside", "twice", "half"])
def test_intrinsics_of_another_resolution_are_told(middle: tuple[float, float], tmp_path: Path) -> None:
    """Those of images twice as large have their principal point in the last pixel of these."""
    home = write_frames(tmp_path, [photograph()])
    cameras = json.loads((home / "scene_camera.json").read_text())
    cameras["0"]["cam_K"] = [910.0, 0, middle[0], 0, 910.0, middle[1], 0, 0, 1]
    (home / "scene_camera.json").write_text(json.dumps(cameras))
    with pytest.raises(ValueError, match="is cam_K for another resolution"):
        read_frames(tmp_path)


def photographs() -> list[Frame]:
    """Seven views of a cabinet with a box in it, from before it, from aside, from above and from below."""
    bodies = [Body("box", Box(np.array([0.1, 0.1, 0.2])), transform(p=[0.75, 0.1, 0.2])), *CABINET.walls()]
    seen = surfaces([b.shape for b in bodies], np.array([b.T_world_body for b in bodies]))
    small = realsense_d435i(160, 120)
    eyes = [(0.2, -0.3, 0.3), (0.25, -0.2, 0.5), (0.2, 0.0, 0.2), (0.1, 0.1, 0.45), (0.25, 0.3, 0.3), (0.2, 0.2, 0.55), (0.55, 0.0, 0.5)]
    poses = [look_at(np.array(eye), np.array([0.8, 0.1 * k - 0.3, 0.2])) for k, eye in enumerate(eyes)]
    return [Frame(raycast(seen, pose, small).depth, None, (), small, pose) for pose in poses]


def with_rotation(T: Array, R: Array) -> Array:
    return transform(R, T[:3, 3])


def rolled(T: Array, shift: int) -> Array:
    return with_rotation(T, rotation_from_wxyz(np.roll(wxyz_from_rotation(T[:3, :3]), shift)))


def tilted(degrees: float) -> Array:
    return transform(rotation_about((0, 1, 0), np.radians(degrees)))


def aside(rng: np.random.Generator, degrees: float, away_m: float) -> Array:
    """A turn about any axis, and a way in any direction."""
    axis, way = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    return transform(rotation_about(axis, np.radians(degrees)), away_m * way)


def turned(degrees: float) -> Array:
    return transform(rotation_about((0, 0, 1), np.radians(degrees)))


T_BODY_OPTICAL = transform(np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], float))


@pytest.mark.parametrize(
    ("wrong", "cause"),
    [
        (lambda T: rolled(T, -1), "quaternions that say x, y, z, w and were read as w, x, y, z"),
        (lambda T: rolled(T, 1), "quaternions that say w, x, y, z and were read as x, y, z, w"),
        (lambda T: inverse(rolled(inverse(T), -1)), "quaternions that say x, y, z, w and were read as w, x, y, z"),
        (lambda T: inverse(rolled(inverse(T), 1)), "quaternions that say w, x, y, z and were read as x, y, z, w"),
        (lambda T: with_rotation(T, T[:3, :3].T), "rotation in the world is transposed"),
        (lambda T: inverse(with_rotation(inverse(T), T[:3, :3])), "cam_R_w2c is the camera's rotation in the world"),
        (lambda T: inverse(transform(T[:3, :3].T, T[:3, 3])), "cam_t_w2c is where the camera is in the world"),
        (lambda T: T @ inverse(T_BODY_OPTICAL), "its body's in ROS"),
        (lambda T: inverse(T @ inverse(T_BODY_OPTICAL)), "its body's in ROS"),
        (lambda T: T @ turned(180), "turned by 180°"),
        (lambda T: T @ turned(90), "turned by 90°"),
        (lambda T: T @ turned(-90), "turned by 90°"),
        (lambda T: inverse(BASE) @ T, "the robot's base frame"),
        (lambda T: inverse(CABINET.T_world_cabinet) @ T, "the cabinet's frame"),
    ],
)  # fmt: skip
def test_poses_that_other_programs_would_tell_are_recognised(wrong: Callable[[Array], Array], cause: str) -> None:
    """Most of them put a good part of the points into the cabinet, where nobody would notice but by what is found there."""
    frames = photographs()
    assert misfit(frames, CABINET, BASE) is None
    assert cause in (misfit([replace(f, T_world_camera=wrong(f.T_world_camera)) for f in frames], CABINET, BASE) or "")


def test_images_and_depths_that_other_programs_would_write_are_recognised() -> None:
    frames = photographs()
    mirrored = [replace(f, depth=np.ascontiguousarray(f.depth[:, ::-1])) for f in frames]
    along = [replace(f, depth=(f.depth * np.linalg.norm(ray_directions(f.intrinsics), axis=2)).astype(np.float32)) for f in frames]
    near = [replace(f, depth=f.depth * np.float32(0.001)) for f in frames]
    for wrong, cause in ((mirrored, "left and right exchanged"), (along, "distances from the camera"), (near, "factor of 1000")):
        assert cause in (misfit(wrong, CABINET, BASE) or "")


def test_frames_that_look_through_what_others_show_are_refused() -> None:
    """A hand-eye calibration that is 10° off, and a camera matrix of another lens, show the cabinet still; so does one wrong pose."""
    frames, doubts = photographs(), list[str]()
    calibration, doubtful = ([replace(f, T_world_camera=f.T_world_camera @ off) for f in frames] for off in (tilted(10), tilted(4)))
    assert misfit(frames, CABINET, BASE, doubts.append) is None
    assert not doubts
    assert misfit(doubtful, CABINET, BASE, doubts.append) is None
    assert "is where others look through" in doubts[0]
    rng = np.random.default_rng(5)
    loose = [replace(f, T_world_camera=f.T_world_camera @ aside(rng, 2, 0.01)) for f in frames]
    assert misfit(loose, CABINET, BASE) is None
    lens = [replace(f, intrinsics=replace(f.intrinsics, fx=f.intrinsics.fx * 1.5, fy=f.intrinsics.fy * 1.5)) for f in frames]
    for wrong in (calibration, lens):
        assert "the frames contradict one another" in (misfit(wrong, CABINET, BASE) or "")
    frames[4] = replace(frames[4], T_world_camera=transform(p=[0.12, 0.1, 0.05]) @ frames[4].T_world_camera)
    assert "frame 4 and the others contradict one another" in (misfit(frames, CABINET, BASE) or "")


def test_a_robot_s_own_pixels_contradict_nothing() -> None:
    frames = photographs()
    for k, f in enumerate(frames):
        arm = np.zeros(f.depth.shape, bool)
        arm[60:] = True
        frames[k] = replace(f, depth=np.where(arm, np.float32(0.2), f.depth), arm=arm)
    assert misfit(frames, CABINET, BASE) is None
    assert misfit([replace(f, arm=None) for f in frames], CABINET, BASE) is not None
