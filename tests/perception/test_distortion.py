"""Lenses: OpenCV's formula, and frames that come back as a pinhole camera would have recorded them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from photographs import CABINET, box, can, photograph, placed

from perception.calibration import Calibration
from perception.camera import Intrinsics, points_in_camera
from perception.distortion import distorted, pinhole_pixel, recorded_pixels
from perception.frames import Frame, read_frames, undistorted, write_frames

CAMERA = Intrinsics(320, 240, 227.5, 227.5, 158.0, 121.0)
LENS = (-0.25, 0.06, 0.004, -0.003, 0.0)
BODIES = (can("can", 0.2, 0.1, 0.03, 0.15), box("carton", 0.34, -0.15, [0.05, 0.06, 0.2], 0.3))


def through(lens: tuple[float, ...], frame: Frame) -> Frame:
    """What a camera with this lens records in the place of a pinhole's frame: for each recorded pixel its ray is found by iteration, and
    the pinhole's nearest pixel has what it sees."""
    k = frame.intrinsics
    a, b = np.meshgrid((np.arange(k.width) - k.cx) / k.fx, (np.arange(k.height) - k.cy) / k.fy)
    x, y = a.copy(), b.copy()
    for _ in range(60):
        xd, yd = distorted(x, y, lens)
        x, y = x + a - xd, y + b - yd
    u, v = np.rint(x * k.fx + k.cx).astype(int), np.rint(y * k.fy + k.cy).astype(int)
    there = (u >= 0) & (u < k.width) & (v >= 0) & (v < k.height)
    u, v = np.clip(u, 0, k.width - 1), np.clip(v, 0, k.height - 1)
    assert frame.instance is not None
    depth, instance = np.where(there, frame.depth[v, u], 0), np.where(there, frame.instance[v, u], -1)
    return replace(frame, depth=depth.astype(np.float32), instance=instance.astype(np.int32))


def test_the_formula_is_opencvs() -> None:
    """By hand for x = 0.5, y = -0.25: r² = 0.3125."""
    x, y, r2 = 0.5, -0.25, 0.3125
    radial = (1 + 0.1 * r2 - 0.2 * r2**2 + 0.3 * r2**3) / (1 + 0.4 * r2 + 0.5 * r2**2 - 0.1 * r2**3)
    found = distorted(np.array(x), np.array(y), (0.1, -0.2, 0.01, -0.02, 0.3, 0.4, 0.5, -0.1, 0.001, 0.002, 0.003, 0.004))
    assert float(found[0]) == pytest.approx(x * radial + 2 * 0.01 * x * y - 0.02 * (r2 + 2 * x * x) + 0.001 * r2 + 0.002 * r2**2)
    assert float(found[1]) == pytest.approx(y * radial + 0.01 * (r2 + 2 * y * y) - 2 * 0.02 * x * y + 0.003 * r2 + 0.004 * r2**2)
    same = distorted(np.array(x), np.array(y), ())
    assert (float(same[0]), float(same[1])) == (x, y)


def test_no_lens_is_the_same_frame() -> None:
    (frame,) = photograph(placed(BODIES, CABINET), camera=CAMERA, eyes=[(-0.1, 0.0, 0.4)])
    assert undistorted(frame, ()) is frame
    rows, columns = recorded_pixels(CAMERA, (0.0, 0.0, 0.0, 0.0))
    assert (rows == np.arange(240)[:, None]).all()
    assert (columns == np.arange(320)).all()


def test_points_are_where_they_were() -> None:
    """Within the pixel that a nearest neighbour may be off, and where the lens's picture shows anything."""
    (frame,) = photograph(placed(BODIES, CABINET), camera=CAMERA, eyes=[(-0.1, 0.0, 0.4)])
    raw = through(LENS, frame)
    back = undistorted(raw, LENS)
    assert back.instance is not None
    assert frame.instance is not None
    wrong, right = (float(np.mean(f.instance != frame.instance)) for f in (raw, back))  # type: ignore[arg-type]
    assert right < 0.25 * wrong
    both = (back.depth > 0) & (frame.depth > 0)
    assert both.mean() > 0.9
    off = np.linalg.norm(points_in_camera(back.depth, CAMERA) - points_in_camera(frame.depth, CAMERA), axis=-1)[both]
    assert np.percentile(off, 95) < 0.02  # one pixel at 1 m is 4 mm, more on what is seen at a grazing angle
    raw_off = np.linalg.norm(points_in_camera(raw.depth, CAMERA) - points_in_camera(frame.depth, CAMERA), axis=-1)[both & (raw.depth > 0)]
    assert np.median(off) < 0.1 * np.median(raw_off)


def test_a_polynomial_that_turns_back_shows_nothing_twice() -> None:
    """k1 = −0.3 turns back at 1.054 from the middle: of a camera of 127°, what is beyond is not known."""
    wide = Intrinsics(320, 240, 80.0, 80.0, 159.5, 119.5)
    rows, columns = recorded_pixels(wide, (-0.3, 0.0, 0.0, 0.0))
    beyond = np.hypot(*np.meshgrid((np.arange(320) - 159.5) / 80, (np.arange(240) - 119.5) / 80)) > 1.06
    assert (rows[beyond] == -1).all()
    assert (columns[beyond] == -1).all()
    assert (rows[~beyond] >= 0).mean() > 0.98


def test_a_pixel_of_the_recorded_image_is_found_in_the_other() -> None:
    for u, v in ((160, 120), (40, 60), (280, 200)):
        a, b = pinhole_pixel(CAMERA, LENS, u, v)
        x, y = distorted(np.array((a - CAMERA.cx) / CAMERA.fx), np.array((b - CAMERA.cy) / CAMERA.fy), LENS)
        assert abs(float(x) * CAMERA.fx + CAMERA.cx - u) < 1.0
        assert abs(float(y) * CAMERA.fy + CAMERA.cy - v) < 1.0
    assert pinhole_pixel(CAMERA, LENS, 40, 60) != (40, 60)


def test_a_recording_is_read_with_the_lens_that_a_file_tells(tmp_path: Path) -> None:
    frames = photograph(placed(BODIES, CABINET), camera=CAMERA)[:2]
    home = write_frames(tmp_path, [through(LENS, f) for f in frames])
    cameras = json.loads((home / "scene_camera.json").read_text())
    for entry in cameras.values():
        del entry["cam_K"]
    (home / "scene_camera.json").write_text(json.dumps(cameras))
    with pytest.raises(ValueError, match=r"cam_K is missing \(or give a file that says it, sense --camera FILE"):
        read_frames(tmp_path)
    camera = Calibration((CAMERA.fx, CAMERA.fy), (CAMERA.cx, CAMERA.cy), (320, 240), LENS, "lens.yaml")
    for read, true in zip(read_frames(tmp_path, camera=camera), frames):
        assert read.intrinsics == CAMERA
        assert read.instance is not None
        assert read.names == true.names
        assert np.mean(read.instance != true.instance) < 0.02
    with pytest.raises(ValueError, match=r"image 0: lens.yaml is for images of 640 × 480 pixels"):
        read_frames(tmp_path, camera=replace(camera, size=(640, 480)))
    with pytest.raises(ValueError, match=r"image 0: the principal point of lens.yaml, 958, 121,"):
        read_frames(tmp_path, camera=replace(camera, size=None, centre=(958.0, 121.0)))
