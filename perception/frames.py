"""Frames: what a camera has recorded, one image at a time, wherever it came from; as folders in the BOP layout, and as a fused PLY cloud.

The layout is that of the BOP benchmark's scenes (Hodaň et al., "BOP: Benchmark for 6D object pose estimation", 2018; bop_toolkit,
docs/bop_datasets_format.md): FOLDER/000000/ holds scene_camera.json (cam_K, depth_scale, cam_R_w2c, cam_t_w2c in mm, by image number),
depth/000000.png (16 bits; times depth_scale it is mm), mask_visib/000000_000000.png (image, object) and scene_gt.json (obj_id, by image).
Read are also .tif, .tiff and NumPy's .npy, of whole or of floating-point numbers (metres: a depth_scale of 1000).
Ours say the object's `name` in scene_gt.json as well, mark the robot's own pixels in mask_robot/000000.png, and say in scene_camera.json
how the robot stood: `robot_q`, a number for every actuated joint.
"""

from __future__ import annotations

import io
import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinematics.transforms import Array, inverse, transform
from perception.calibration import Calibration
from perception.camera import Depth, Intrinsics, cloud
from perception.distortion import recorded_pixels
from perception.image_files import read_depth, read_grey
from perception.masks import Instances, mask_reader, read_json

DEPTH_SCALE_MM = 0.1
"""What one step of a written depth image means, unless it shows something further away than 6.5 m."""
SATURATED = 65535
"""A depth with all 16 bits set is none: cameras and converters write it where nothing was measured, or what is too far away."""
NEVER_M = 100.0
"""No depth camera measures so far, nor writes its 16 bits of millimetres as so many metres."""
PALETTE = np.array(
    [
        [31, 119, 180],
        [255, 127, 14],
        [44, 160, 44],
        [214, 39, 40],
        [148, 103, 189],
        [140, 86, 75],
        [227, 119, 194],
        [188, 189, 34],
        [23, 190, 207],
    ],
    np.uint8,
)
GREY = np.array([150, 150, 150], np.uint8)


@dataclass(frozen=True, eq=False)
class Frame:
    """One view of a scene.

    depth (H, W): z in metres, 0 where nothing was measured. instance (H, W): which object a pixel shows, -1 for none; None when nobody has
    told objects apart. names: the object that an instance number means. T_world_camera (4, 4): see `perception.camera` for the axes.
    arm (H, W): pixels of the robot itself; None when nobody has marked them. q (J,): how the robot stood, its actuated joints; None when
    nobody has written that down.
    """

    depth: Depth
    instance: NDArray[np.int32] | None
    names: tuple[str, ...]
    intrinsics: Intrinsics
    T_world_camera: Array
    arm: NDArray[np.bool_] | None = None
    q: Array | None = None


def checked(frame: Frame) -> Frame:
    """The frame as it is used, wherever it was made: float32 depths, and 0 where they are none (NaN, infinite, negative).

    Raises: ValueError for a depth image that is not of the size of its intrinsics, or not in metres; masks of another size; and no pose.
    """
    depth, k = np.asarray(frame.depth), frame.intrinsics
    if depth.shape != (k.height, k.width):
        raise ValueError(
            f"a depth image is of shape {_by(depth.shape)}, and its intrinsics are for {k.height} × {k.width} (rows × columns)"
        )
    if not np.issubdtype(depth.dtype, np.floating):
        raise ValueError(
            f"depths are of type {depth.dtype}: metres are expected, as floating-point numbers (a camera's steps times its scale)"
        )
    depth = np.where(np.isfinite(depth) & (depth > 0), depth, 0).astype(np.float32)
    if (depth > 0).any() and (median := float(np.median(depth[depth > 0]))) > NEVER_M:
        raise ValueError(f"half of the depths are beyond {median:.0f}: metres are expected, and are these millimetres?")
    for what, mask in (("instance", frame.instance), ("arm", frame.arm)):
        if mask is not None and np.shape(mask) != depth.shape:
            raise ValueError(f"{what} is of shape {_by(np.shape(mask))}, and the depth image of {_by(depth.shape)}")
    T = np.asarray(frame.T_world_camera, float)
    rigid = T.shape == (4, 4) and np.isfinite(T).all() and np.allclose(T[3], [0, 0, 0, 1])
    if not (rigid and np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-3) and np.linalg.det(T[:3, :3]) > 0):
        raise ValueError("T_world_camera is no pose: (4, 4), a rotation and a translation in metres")
    return replace(frame, depth=depth, T_world_camera=T)


def undistorted(frame: Frame, coefficients: Sequence[float]) -> Frame:
    """The frame, depths and masks, as a pinhole camera with the same intrinsics would have recorded it, see `perception.distortion`: what
    lies beyond the recorded image is not measured, and nobody's."""
    if not any(coefficients):
        return frame
    v, u = recorded_pixels(frame.intrinsics, tuple(coefficients))
    there = v >= 0
    depth = np.where(there, frame.depth[v, u], np.float32(0))
    instance = None if frame.instance is None else np.where(there, frame.instance[v, u], np.int32(-1))
    arm = None if frame.arm is None else there & frame.arm[v, u]
    return replace(frame, depth=depth, instance=instance, arm=arm)


def _by(shape: tuple[int, ...]) -> str:
    return " × ".join(map(str, shape)) or "()"


# Writing --------------------------------------------------------------------------------------------------------------------------------


def write_frames(folder: Path, frames: Sequence[Frame], *, scene: int = 0) -> Path:
    """Write frames as one scene of the BOP layout, FOLDER/000000 for scene 0, and return that path; an older one of ours is replaced.

    scene_camera.json comes last: a folder without it is not complete. Raises: ValueError where a recording with colour images lies, for a
    frame that is none (see `checked`), and for depths beyond 65 m.
    """
    frames = [_checked(i, frame) for i, frame in enumerate(frames)]
    home = folder / f"{scene:06d}"
    _clear(home)
    cameras, objects = {}, {}
    for i, frame in enumerate(frames):
        scale = DEPTH_SCALE_MM if frame.depth.max(initial=0) * 1e3 / DEPTH_SCALE_MM < SATURATED - 1 else 1.0
        steps = np.round(frame.depth.astype(float) * 1e3 / scale)
        if steps.max(initial=0) >= SATURATED:
            raise ValueError(f"frame {i}: a depth of {frame.depth.max():.1f} m does not fit into 16 bits of millimetres")
        _write_png(home / "depth" / f"{i:06d}.png", steps.astype(np.uint16))
        T = inverse(frame.T_world_camera)
        cameras[str(i)] = {
            "cam_K": frame.intrinsics.K.ravel().tolist(),
            "depth_scale": scale,
            "cam_R_w2c": T[:3, :3].ravel().tolist(),
            "cam_t_w2c": (1e3 * T[:3, 3]).tolist(),
            **({} if frame.q is None else {"robot_q": frame.q.tolist()}),
        }
        if frame.instance is not None:
            objects[str(i)] = [{"obj_id": k + 1, "name": name} for k, name in enumerate(frame.names)]
            for k in range(len(frame.names)):
                _write_png(home / "mask_visib" / f"{i:06d}_{k:06d}.png", np.where(frame.instance == k, 255, 0).astype(np.uint8))
        if frame.arm is not None:
            _write_png(home / "mask_robot" / f"{i:06d}.png", np.where(frame.arm, 255, 0).astype(np.uint8))
    if objects:
        _put(home / "scene_gt.json", _by_line(objects))
    _put(home / "scene_camera.json", _by_line(cameras))
    return home


def write_ply(file: Path, frames: Sequence[Frame]) -> int:
    """Write all measured points but the robot's as one binary PLY cloud in the world, metres, and return how many.

    Every point has its object's number among all the frames' names (-1 for none), and a colour by it.
    """
    names = list(dict.fromkeys(n for f in frames for n in f.names))
    kind = np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3), ("instance", "<i4")])
    parts = [np.zeros(0, kind)]
    for frame in frames:
        shown = frame.depth > 0 if frame.arm is None else (frame.depth > 0) & ~frame.arm
        number = np.array([*(names.index(n) for n in frame.names), -1])
        part = np.zeros(int(np.count_nonzero(shown)), kind)
        part["xyz"] = cloud(np.where(shown, frame.depth, 0), frame.intrinsics, frame.T_world_camera)
        part["instance"] = -1 if frame.instance is None else number[frame.instance[shown]]
        part["rgb"] = np.where(part["instance"][:, None] >= 0, PALETTE[part["instance"] % len(PALETTE)], GREY)
        parts.append(part)
    points = np.concatenate(parts)
    fields = [*(f"float {c}" for c in "xyz"), *(f"uchar {c}" for c in ("red", "green", "blue")), "int instance"]
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}", *(f"property {f}" for f in fields), "end_header"]
    _put(file, ("\n".join(lines) + "\n").encode() + points.tobytes())
    return len(points)


def _checked(number: int, frame: Frame) -> Frame:
    try:
        return checked(frame)
    except ValueError as e:
        raise ValueError(f"frame {number}: {e}") from e


def _clear(home: Path) -> None:
    """Remove what an earlier run of ours may have written there, so that nothing old is read as new."""
    for colour in ("rgb", "gray"):
        if (home / colour).is_dir():
            raise ValueError(f"{home}: holds a recording with colour images ({colour}/), which would be lost; name another folder")
    (home / "scene_camera.json").unlink(missing_ok=True)
    (home / "scene_gt.json").unlink(missing_ok=True)
    for part in ("depth", "mask_visib", "mask_robot"):
        for file in (home / part).glob("[0-9]*.png"):
            file.unlink()


def _write_png(file: Path, image: NDArray[Any]) -> None:
    from PIL import Image

    data = io.BytesIO()
    Image.fromarray(image).save(data, "png", compress_level=1)
    _put(file, data.getvalue())


def _by_line(entries: dict[str, Any]) -> bytes:
    """JSON with one line an image."""
    return ("{\n" + ",\n".join(f"  {json.dumps(k)}: {json.dumps(v)}" for k, v in entries.items()) + "\n}\n").encode()


def _put(file: Path, data: bytes) -> None:
    """Write a file beside its name and rename it."""
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_name(f"{file.stem}.part{file.suffix}")
    part.write_bytes(data)
    os.replace(part, file)


# Reading ------------------------------------------------------------------------------------------------------------------------------


def read_frames(folder: Path, *, scene: int | None = None, camera: Calibration | None = None) -> tuple[Frame, ...]:
    """The frames of one scene in the BOP layout, in the order of their numbers; the folder is the scene's, or the one that holds scenes.

    camera: the intrinsics of all of them, in the place of cam_K; what its lens distorts is undone, in depths and masks.
    The recording's world must be the scene's. Saturated depths measure nothing. Without masks (see `perception.masks`) the instances are
    None. In BOP's, objects take their `name` from scene_gt.json, else obj_000007 after their obj_id (a second one of the same in an image
    obj_000007_1), else object_0 after their mask's number.
    Raises: ValueError with the file, what is wrong with it and what is expected there.
    """
    home = _scene_folder(folder, scene)
    cameras = _json(home / "scene_camera.json")
    objects = _json(home / "scene_gt.json") if (home / "scene_gt.json").is_file() else None
    if not cameras:
        raise ValueError(f"{home / 'scene_camera.json'}: names no image")
    for key in cameras:
        if not key.isdecimal():
            raise ValueError(f"{home / 'scene_camera.json'}: {key!r} is no number of an image")
    masks = mask_reader(home, objects)
    return tuple(_frame(home, int(key), cameras[key], masks, camera) for key in sorted(cameras, key=int))


def _scene_folder(folder: Path, scene: int | None) -> Path:
    if not folder.is_dir():
        raise ValueError(f"{folder}: no such folder; expected is a recording in the BOP layout")
    if scene is None and (folder / "scene_camera.json").is_file():
        return folder
    scenes = sorted(p.parent.name for p in folder.glob("*/scene_camera.json"))
    if scene is None and len(scenes) == 1:
        return folder / scenes[0]
    if scene is not None and f"{scene:06d}" in scenes:
        return folder / f"{scene:06d}"
    if not scenes:
        deeper = next((p.parent.parent for p in sorted(folder.glob("*/*/scene_camera.json"))), None)
        hint = "" if deeper is None else f" (did you mean {deeper}?)"
        raise ValueError(f"{folder}: holds no scene in the BOP layout; expected is {folder / '000000' / 'scene_camera.json'}{hint}")
    missing = "holds several scenes" if scene is None else f"has no scene {scene:06d}"
    raise ValueError(f"{folder}: {missing}; there are {', '.join(scenes)}")


def _frame(
    home: Path, image: int, entry: Any, masks: Callable[[int, tuple[int, ...]], Instances] | None, camera: Calibration | None
) -> Frame:
    where = f"{home / 'scene_camera.json'}: image {image}"
    if not isinstance(entry, dict):
        raise ValueError(f"{where}: is no object with cam_K, depth_scale, cam_R_w2c and cam_t_w2c")
    told = camera or _camera_matrix(entry, where)
    R = _numbers(entry, "cam_R_w2c", 9, where).reshape(3, 3)
    t, scale = _numbers(entry, "cam_t_w2c", 3, where), float(_numbers(entry, "depth_scale", 1, where)[0])
    if not (np.allclose(R @ R.T, np.eye(3), atol=1e-3) and np.linalg.det(R) > 0):
        raise ValueError(f"{where}: cam_R_w2c is no rotation")
    if not scale > 0:
        raise ValueError(f"{where}: depth_scale: {scale:g} is not positive")
    u, _, vt = np.linalg.svd(R)  # the nearest rotation: files round
    depth = read_depth(home / "depth", image)
    intrinsics = told.intrinsics(depth.shape[1], depth.shape[0])
    if fault := told.misfit(intrinsics.width, intrinsics.height):
        raise ValueError(f"{where}: {fault}")
    instance, names = masks(image, depth.shape) if masks else (None, ())
    robot = home / "mask_robot" / f"{image:06d}.png"
    arm = read_grey(robot, depth.shape) > 0 if robot.is_file() else None
    q = _numbers(entry, "robot_q", None, where) if entry.get("robot_q") is not None else None
    nothing = ~np.isfinite(depth) | (depth < 0) | ((depth >= SATURATED) & np.issubdtype(depth.dtype, np.integer))
    metres = np.where(nothing, 0, depth * (scale * 1e-3)).astype(np.float32)
    return undistorted(Frame(metres, instance, names, intrinsics, inverse(transform(u @ vt, t * 1e-3)), arm, q), told.distortion)


def _camera_matrix(entry: dict[str, Any], where: str) -> Calibration:
    """What a scene_camera.json's cam_K says."""
    K = _numbers(entry, "cam_K", 9, where).reshape(3, 3)
    if not (K[0, 0] > 0 and K[1, 1] > 0 and np.allclose(K[2], [0, 0, 1]) and np.allclose(K[[0, 1], [1, 0]], 0)):
        raise ValueError(f"{where}: cam_K is no camera matrix [fx, 0, cx, 0, fy, cy, 0, 0, 1] (skew is not supported)")
    return Calibration((float(K[0, 0]), float(K[1, 1])), (float(K[0, 2]), float(K[1, 2])), source="cam_K")


def _json(file: Path) -> dict[str, Any]:
    value = read_json(file)
    if not isinstance(value, dict):
        raise ValueError(f'{file}: is no object by image number: {{"0": …}}')
    return value


def _numbers(entry: dict[str, Any], name: str, count: int | None, where: str) -> Array:
    """So many finite numbers of an entry; of a list of any length, when no count is given."""
    if name not in entry:
        pose = " (the camera's pose is needed, as world to camera, in millimetres)" if name.endswith("w2c") else ""
        hint = " (or give a file that says it, sense --camera FILE: ROS's camera_info, Open3D's, OpenCV's …)" if name == "cam_K" else pose
        raise ValueError(f"{where}: {name} is missing{hint}")
    try:
        values = np.atleast_1d(np.array(entry[name], float)).ravel()
    except (TypeError, ValueError, OverflowError):
        values = np.zeros(0)
    if len(values) != (count or len(values) or 1) or not np.isfinite(values).all():
        what = "a list of finite numbers" if count is None else f"{count} finite number{'s' if count > 1 else ''}"
        raise ValueError(f"{where}: {name} is not {what}")
    return values
