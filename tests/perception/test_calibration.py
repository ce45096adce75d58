"""Intrinsics as ROS, Open3D, OpenCV, RealSense, BOP and Kalibr write them; what is wrong with a file is one line with its remedy."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from perception.calibration import Calibration, read_calibration

K = [615.5, 0.0, 320.25, 0.0, 616.5, 240.75, 0.0, 0.0, 1.0]
COLUMNS = [615.5, 0.0, 0.0, 0.0, 616.5, 0.0, 320.25, 240.75, 1.0]
PLAIN = {"width": 640, "height": 480, "fx": 615.5, "fy": 616.5, "ppx": 320.25, "ppy": 240.75}
ECHO = """header:
  stamp:
    sec: 1764340000
    nanosec: 5000
  frame_id: camera_depth_optical_frame
height: 480
width: 640
distortion_model: plumb_bob
d:
- 0.0
- 0.0
- 0.0
- 0.0
- 0.0
k:
- 615.5
- 0.0
- 320.25
- 0.0
- 616.5
- 240.75
- 0.0
- 0.0
- 1.0
r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
p: [615.5, 0.0, 320.25, 0.0, 0.0, 616.5, 240.75, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 0
binning_y: 0
roi:
  x_offset: 0
  y_offset: 0
  height: 0
  width: 0
  do_rectify: false
---
"""
CALIBRATOR = """image_width: 640
image_height: 480
camera_name: hand
camera_matrix:
  rows: 3
  cols: 3
  data: [615.5, 0, 320.25, 0, 616.5, 240.75, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0, 0, 0, 0, 0]
"""
STORAGE = """%YAML:1.0
---
calibration_time: "Sat 28 Nov 2026"
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 6.1550000000000000e+02, 0., 3.2025000000000000e+02, 0.,
       6.1650000000000000e+02, 2.4075000000000000e+02, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ 0., 0., 0., 0., 0. ]
avg_reprojection_error: 2.3e-01
"""
SIZED = {"width": 640, "height": 480}
STORED = {"type_id": "opencv-matrix", "rows": 3, "cols": 3, "dt": "d", "data": K}
OPEN3D = {**SIZED, "intrinsic_matrix": COLUMNS}
FILES = {
    "ros 2, echoed": ECHO + ECHO,
    "ros 1, echoed": f"height: 480\nwidth: 640\ndistortion_model: plumb_bob\nD: [0.0, 0.0, 0.0, 0.0, 0.0]\nK: {K}\nbinning_x: 0\n---\n",
    "ros, calibrated": CALIBRATOR,
    "opencv, yaml": STORAGE,
    "opencv, json": json.dumps({"camera_matrix": STORED, "image_width": 640, "image_height": 480}),
    "open3d": json.dumps(OPEN3D),
    "open3d, by tabs": '{\n\t"width": 640,\n\t"height": 480,\n\t"intrinsic_matrix": ' + json.dumps(COLUMNS) + "\n}",
    "open3d, row by row": json.dumps({**SIZED, "intrinsic_matrix": K}),
    "open3d, parameters": json.dumps({"class_name": "PinholeCameraParameters", "extrinsic": [1.0] * 16, "intrinsic": OPEN3D}),
    "open3d, trajectory": json.dumps({"parameters": [{"extrinsic": [], "intrinsic": OPEN3D}] * 2}),
    "realsense": json.dumps({**PLAIN, "model": "distortion.inverse_brown_conrady", "coeffs": [0.0] * 5}),
    "realsense, in rows": json.dumps({**SIZED, "K": [K[:3], K[3:6], K[6:]]}),
    "realsense, depth alone": json.dumps({"depth": PLAIN, "serial": "f1"}),
    "bop": json.dumps({"cx": 320.25, "cy": 240.75, "depth_scale": 0.1, "fx": 615.5, "fy": 616.5, "height": 480, "width": 640}),
    "kalibr": "cam0:\n  camera_model: pinhole\n  intrinsics: [615.5, 616.5, 320.25, 240.75]\n  distortion_model: radtan\n"
    "  distortion_coeffs: [0, 0, 0, 0]\n  resolution: [640, 480]\n",
}  # fmt: skip


def read(text: str, folder: Path, name: str = "camera.txt") -> Calibration:
    (folder / name).write_text(text)
    return read_calibration(folder / name)


@pytest.mark.parametrize("text", FILES.values(), ids=FILES.keys())
def test_every_program_writes_the_same_camera(text: str, tmp_path: Path) -> None:
    found = read(text, tmp_path)
    assert found.focal == (615.5, 616.5)
    assert found.centre == (320.25, 240.75)
    assert found.size == (640, 480)
    assert found.distortion == ()
    of = found.intrinsics(640, 480)
    assert (of.width, of.height, of.fx, of.fy, of.cx, of.cy) == (640, 480, 615.5, 616.5, 320.25, 240.75)


def test_the_size_may_be_left_out_and_is_checked_where_it_is_told(tmp_path: Path) -> None:
    told = read(json.dumps(PLAIN), tmp_path)
    assert "camera.txt is for images of 640 × 480 pixels, and the depth image has 1280 × 720" in str(told.misfit(1280, 720))
    assert told.misfit(640, 480) is None
    untold = read(json.dumps({k: v for k, v in PLAIN.items() if k not in ("width", "height")}), tmp_path)
    assert untold.size is None
    assert untold.misfit(848, 480) is None
    assert "is the middle of images of 642 × 482 pixels, and this one has 424 × 320" in str(untold.misfit(424, 320))


@pytest.mark.parametrize(
    ("more", "kept"),
    [
        ({"distortion_model": "plumb_bob", "d": [-0.05, 0.06, 0.001, -0.002, 0.0]}, 5),
        ({"distortion_model": "rational_polynomial", "d": [0.1, 0.2, 0, 0, 0.3, 0.4, 0.5, 0.6]}, 8),
        ({"model": "distortion.inverse_brown_conrady", "coeffs": [-0.05, 0.06, 0, 0, 0]}, 5),
        ({"dist_coeffs": [[-0.05, 0.06, 0, 0]]}, 4),
        ({"d": [0.1] * 12 + [0, 0]}, 12),
        ({"distortion_model": "equidistant", "d": [0.0, 0.0, 0.0, 0.0]}, 0),
        ({"distortion_model": "", "d": []}, 0),
    ],
)
def test_coefficients_of_a_lens_are_kept(more: dict[str, object], kept: int, tmp_path: Path) -> None:
    assert len(read(json.dumps({**PLAIN, **more}), tmp_path).distortion) == kept


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "names no camera: expected is a camera matrix"),
        ("just words", "names no camera"),
        ("a: [1, 2", r"camera.txt:1: is neither YAML nor JSON"),
        ("<opencv_storage></opencv_storage>", "is XML: expected is YAML or JSON"),
        (json.dumps({**PLAIN, "fx": 0.0}), "focal lengths are 0 and 616.5 pixels: the camera is not calibrated"),
        (json.dumps({**PLAIN, "fx": "wide"}), "fx are not finite numbers"),
        (json.dumps({**PLAIN, "fx": True}), "fx are not finite numbers"),
        (json.dumps({**PLAIN, "fx": [1.0, 2.0]}), "not a number each"),
        (json.dumps({"K": K[:6]}), "the camera matrix has 6 numbers, and nine are expected"),
        (json.dumps({"K": [615.5, 3.0, 320.25, *K[3:]]}), "skew is not supported"),
        (json.dumps({"K": {"rows": 3}}), "names no camera"),
        (json.dumps({**PLAIN, "width": 640.5}), "images of 640.5 × 480 pixels can't be"),
        (json.dumps({"color": PLAIN, "depth": {**PLAIN, "fx": 400.0}}), r"describes several cameras \(color, depth\): give a file"),
        (json.dumps({**PLAIN, "distortion_model": "equidistant", "d": [0.1, 0, 0, 0]}), "equidistant is not supported.*undistort"),
        (json.dumps({**PLAIN, "fisheye_model": 1, "d": [0.1, 0, 0, 0]}), "fisheye is not supported"),
        (json.dumps({**PLAIN, "d": [0.1, 0, 0]}), "3 distortion coefficients, of which OpenCV has 0, 4, 5, 8, 12, 14"),
        (json.dumps({**PLAIN, "d": [0.1] * 14}), "a tilted sensor, must be 0"),
        (json.dumps({**PLAIN, "binning_x": 2, "binning_y": 2}), "binned pixels of those that were calibrated"),
        (json.dumps({**PLAIN, "roi": {"x_offset": 10, "y_offset": 0, "width": 600, "height": 480}}), r"a part \(roi\) of those"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_file_is_said(text: str, complaint: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=complaint) as error:
        read(text, tmp_path)
    assert "\n" not in str(error.value)
    assert str(tmp_path) in str(error.value)


def test_files_that_are_none_are_said(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no such file"):
        read_calibration(tmp_path / "nowhere.yaml")
    (tmp_path / "a.npy").write_bytes(b"\x93NUMPY\xff\xfe")
    with pytest.raises(ValueError, match="is no text"):
        read_calibration(tmp_path / "a.npy")
    (tmp_path / "b.yaml").write_text("version https://git-lfs.github.com/spec/v1\n")
    with pytest.raises(ValueError, match="pointer of Git LFS"):
        read_calibration(tmp_path / "b.yaml")
    whole = json.dumps({**PLAIN, "roi": {"x_offset": 0, "y_offset": 0, "width": 640, "height": 480, "do_rectify": False}})
    assert read(whole, tmp_path).size == (640, 480)
