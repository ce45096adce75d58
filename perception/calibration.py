"""A camera's intrinsics as other programs write them down: ROS's camera_info and calibration files, Open3D, OpenCV, RealSense, BOP, Kalibr.

What a file is, its content says, not its name. JSON or YAML, OpenCV's form of it and several documents (`ros2 topic echo`) among them:
- a camera matrix of nine numbers (`k`, `K`, `camera_matrix`, `intrinsic_matrix`, `cam_K`), by itself, in rows or under `data`. Row by row
  or, as Open3D has it, column by column: the zeros tell which; or four numbers fx, fy, cx, cy (`intrinsics`, Kalibr's);
- else `fx`, `fy`, and `cx`, `cy` or `ppx`, `ppy`;
- the size of its images, if it is told: `width`, `height`, or `image_width`, `image_height`, or `resolution`;
- distortion coefficients (`d`, `D`, `distortion_coefficients`, `coeffs`, `dist_coeffs`) in OpenCV's order, and the name of their model.
The camera may lie deeper in the document (Open3D's `intrinsic`, Kalibr's `cam0`), if it is the only one there.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from kinematics.git_lfs import refuse_pointer
from kinematics.transforms import Array
from perception.camera import Intrinsics
from perception.distortion import COUNTS, has_effect

MOST_BYTES, DEEPEST = 16_000_000, 5
SAME, RESIZED = 0.1, 0.25
"""A camera's matrix of images of another size has its principal point off alike in both directions, but for the first share, and by more
than the second one."""
MATRIX = ("k", "cameramatrix", "intrinsicmatrix", "camk", "intrinsics", "mtx")
FX, FY, CX, CY = ("fx",), ("fy",), ("cx", "ppx"), ("cy", "ppy")
WIDTH, HEIGHT = ("width", "imagewidth"), ("height", "imageheight")
COEFFICIENTS = ("d", "distortioncoefficients", "distortioncoeffs", "coeffs", "distcoeffs", "distcoeff", "dist")
MODEL = ("distortionmodel", "model")
PINHOLE = ("", "none", "plumbbob", "rationalpolynomial", "radtan", "brownconrady", "inversebrownconrady", "modifiedbrownconrady", "opencv")
"""Models whose coefficients are OpenCV's. RealSense's library projects points, and so aligns depth to colour, by the same formula whichever
of its three it names, but for whether the tangential part sees the radial one: some hundredths of a pixel."""
UNRECTIFIED = "undistort the images first (image_proc's rectify, cv2.remap with the nearest pixel) and give what they have then"


@dataclass(frozen=True)
class Calibration:
    """What a file says of a camera. focal: fx, fy; centre: cx, cy; size: width, height, None where it does not say; all in pixels.

    distortion: see `perception.distortion`; empty where there is none. source: the file, for messages.
    """

    focal: tuple[float, float]
    centre: tuple[float, float]
    size: tuple[int, int] | None = None
    distortion: tuple[float, ...] = ()
    source: str = "calibration"

    def intrinsics(self, width: int, height: int) -> Intrinsics:
        """Of images of a size."""
        return Intrinsics(width, height, *self.focal, *self.centre)

    def misfit(self, width: int, height: int) -> str | None:
        """Why it can't be the camera of images of a size; None when it may be."""
        if self.size is not None and self.size != (width, height):
            return (
                f"{self.source} is for images of {self.size[0]} × {self.size[1]} pixels, and the depth image has {width} × {height}: "
                "the intrinsics of its own stream and resolution are needed"
            )
        return _not_of_this_size(self.intrinsics(width, height), self.source)


def read_calibration(file: Path) -> Calibration:
    """The camera that a file describes. Raises: ValueError with the file, what is wrong with it and what is expected."""
    document = _document(file)
    cameras = dict(_cameras(document, "", 0))
    if not cameras:
        raise ValueError(
            f"{file}: names no camera: expected is a camera matrix (K, camera_matrix, intrinsic_matrix) or fx, fy, cx, cy, as ROS's "
            "camera_info, Open3D, OpenCV or RealSense have them"
        )
    found = {name: _calibration(entry, f"{file}{': ' if name else ''}{name}") for name, entry in cameras.items()}
    first = next(iter(found.values()))
    if any((c.focal, c.centre, c.size, c.distortion) != (first.focal, first.centre, first.size, first.distortion) for c in found.values()):
        names = ", ".join(list(found)[:6])
        raise ValueError(f"{file}: describes several cameras ({names}): give a file with the one alone whose pixels the depth images have")
    return first


def _not_of_this_size(camera: Intrinsics, source: str) -> str | None:
    """Why intrinsics are not those of images of this size; None when they may be. A principal point that is off in both directions alike is
    the middle of images of another size; one of an image that was cropped is off anyhow. source: where they are told."""
    point = f"the principal point of {source}, {camera.cx:g}, {camera.cy:g},"
    if not (0 < camera.cx < camera.width and 0 < camera.cy < camera.height):
        where = f"lies outside the depth image of {camera.width} × {camera.height} pixels: is {source} for another resolution?"
        return f"{point} {where}"
    wide, high = 2 * camera.cx + 1, 2 * camera.cy + 1
    times = (wide / camera.width, high / camera.height)
    if abs(times[0] - times[1]) < SAME * max(times) and abs(times[0] - 1.0) > RESIZED:
        return (
            f"{point} is the middle of images of {wide:.0f} × {high:.0f} pixels, and this one has {camera.width} × {camera.height}: is "
            f"{source} for another resolution? Then divide its first rows by {times[0]:.3g}"
        )
    return None


# Parsing --------------------------------------------------------------------------------------------------------------------------------


def _document(file: Path) -> Any:
    """The JSON, or the first document of the YAML, in a file."""
    import yaml

    if not file.is_file():
        raise ValueError(f"{file}: no such file; expected is a camera's calibration, YAML or JSON")
    refuse_pointer(file, "calibration")
    if file.stat().st_size > MOST_BYTES:
        raise ValueError(f"{file}: has {file.stat().st_size / 1e6:.0f} MB, and is no camera's calibration")
    try:
        text = file.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as e:
        raise ValueError(f"{file}: is no text: a camera's calibration is YAML or JSON") from e
    if text.lstrip().startswith("<"):
        raise ValueError(f"{file}: is XML: expected is YAML or JSON (cv2.FileStorage writes them to names that end so)")
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        pass
    if text.startswith("%YAML:"):  # OpenCV's own spelling of the directive
        text = text.partition("\n")[2]
    try:
        return next((d for d in yaml.load_all(text, Loader=_loader()) if d is not None), None)
    except (yaml.YAMLError, RecursionError, ValueError) as e:
        mark = getattr(e, "problem_mark", None)
        where = f"{file}:{mark.line + 1}" if mark is not None else str(file)
        raise ValueError(f"{where}: is neither YAML nor JSON ({getattr(e, 'problem', None) or e})") from e


def _loader() -> type[Any]:
    """YAML's safe loader, which knows what OpenCV calls a matrix."""
    import yaml

    class Loader(yaml.SafeLoader):  # type: ignore[misc]
        pass

    Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", lambda loader, node: loader.construct_mapping(node, deep=True))
    return Loader


def _plain(key: object) -> str:
    return str(key).lower().replace("_", "").replace("-", "").replace(" ", "")


def _cameras(value: Any, name: str, depth: int) -> Iterator[tuple[str, dict[str, Any]]]:
    """The cameras of a document, the outermost ones, by where they are in it; their keys in lower case, without underscores."""
    if isinstance(value, Mapping):
        entry = {_plain(k): v for k, v in value.items()}
        if _said(entry, MATRIX) is not None or all(_said(entry, some) is not None for some in (FX, FY, CX, CY)):
            yield name, entry
            return
    inner = value.items() if isinstance(value, Mapping) else enumerate(value) if isinstance(value, list) else ()
    if depth < DEEPEST:
        for key, deeper in inner:
            yield from _cameras(deeper, f"{name}.{key}" if name else str(key), depth + 1)


def _said(entry: Mapping[str, Any], names: tuple[str, ...]) -> Any:
    """The value of the first of these names that an entry has; a matrix under `data` is what is there."""
    value = next((entry[n] for n in names if entry.get(n) is not None), None)
    return value.get("data") if isinstance(value, Mapping) else value


# Values ---------------------------------------------------------------------------------------------------------------------------------


def _calibration(entry: Mapping[str, Any], where: str) -> Calibration:
    fx, fy, cx, cy = _pinhole(entry, where).tolist()
    if not (fx > 0 and fy > 0):
        raise ValueError(f"{where}: the focal lengths are {fx:g} and {fy:g} pixels: the camera is not calibrated")
    size = _size(entry, where)
    _whole_image(entry, size, where)
    coefficients = tuple(_numbers(_said(entry, COEFFICIENTS), "the distortion coefficients", where).tolist())
    model = str(_said(entry, MODEL) or "").lower().replace("rs2_distortion_", "").rpartition(".")[2]
    fisheye = bool(entry.get("fisheyemodel")) or _plain(model) not in PINHOLE
    if any(coefficients):
        if fisheye:
            known = "none, plumb_bob and rational_polynomial (OpenCV's, and RealSense's Brown-Conrady)"
            raise ValueError(f"{where}: a lens of the model {model or 'fisheye'} is not supported, only {known}: {UNRECTIFIED}")
        if len(coefficients) not in COUNTS or any(coefficients[12:]):
            counts = f"{len(coefficients)} distortion coefficients, of which OpenCV has {', '.join(map(str, COUNTS))}"
            raise ValueError(f"{where}: has {counts} (the 13th and 14th, a tilted sensor, must be 0): {UNRECTIFIED}")
    return Calibration((fx, fy), (cx, cy), size, coefficients[:12] if has_effect(coefficients) else (), where)


def _pinhole(entry: Mapping[str, Any], where: str) -> Array:
    """fx, fy, cx, cy."""
    matrix = _said(entry, MATRIX)
    if matrix is None:
        values = [_numbers(_said(entry, some), some[-1], where) for some in (FX, FY, CX, CY)]
        if any(len(v) != 1 for v in values):
            raise ValueError(f"{where}: fx, fy, cx and cy are not a number each")
        return np.concatenate(values)
    numbers = _numbers(matrix, "the camera matrix", where)
    if len(numbers) == 4:
        return numbers
    if len(numbers) != 9:
        raise ValueError(f"{where}: the camera matrix has {len(numbers)} numbers, and nine are expected: fx, 0, cx, 0, fy, cy, 0, 0, 1")
    K = numbers.reshape(3, 3)
    K = K.T if not K[:2, 2].any() else K  # Open3D's stand column by column
    if not (np.allclose(K[2], [0, 0, 1]) and np.allclose(K[[0, 1], [1, 0]], 0)):
        raise ValueError(f"{where}: the camera matrix is none, fx, 0, cx, 0, fy, cy, 0, 0, 1 (skew is not supported)")
    return K[[0, 1, 0, 1], [0, 1, 2, 2]]


def _size(entry: Mapping[str, Any], where: str) -> tuple[int, int] | None:
    """Width and height; 0, as an unset message has them, is not told."""
    told = _said(entry, ("resolution",)) or [_said(entry, WIDTH), _said(entry, HEIGHT)]
    values = _numbers([v for v in told if v is not None] if isinstance(told, list) else told, "the size of its images", where)
    if len(values) != 2 or not values.any():
        return None
    if (values != np.round(values)).any() or (values <= 0).any():
        raise ValueError(f"{where}: images of {values[0]:g} × {values[1]:g} pixels can't be")
    return int(values[0]), int(values[1])


def _whole_image(entry: Mapping[str, Any], size: tuple[int, int] | None, where: str) -> None:
    """Raises: ValueError where the images are a part of the calibrated ones, or have fewer pixels, as ROS's camera_info may say."""
    roi = {_plain(k): v for k, v in entry["roi"].items()} if isinstance(entry.get("roi"), Mapping) else {}
    part = [_numbers(roi.get(n), f"roi.{n}", where) for n in ("xoffset", "yoffset")]
    of = [_numbers(roi.get(n), f"roi.{n}", where) for n in ("width", "height")]
    binned = [_numbers(entry.get(n), n, where) for n in ("binningx", "binningy")]
    cut = any(v.any() for v in part) or any(v.any() and (size is None or v[0] != s) for v, s in zip(of, size or (0, 0)))
    if cut or any((v > 1).any() for v in binned):
        raise ValueError(
            f"{where}: the images are {'a part (roi)' if cut else 'binned pixels'} of those that were calibrated: give the camera matrix "
            "of the images themselves, and no roi or binning"
        )


def _numbers(value: Any, what: str, where: str) -> Array:
    """The finite numbers of a value, a list, or a list of rows, (N,); none of what is not told."""
    try:
        flat = np.array([] if value is None else value, dtype=object).ravel()
        if any(isinstance(v, bool) for v in flat):
            raise TypeError
        out = np.array([float(v) for v in flat])
    except (TypeError, ValueError, OverflowError):
        out = np.array([np.nan])
    if not np.isfinite(out).all():
        raise ValueError(f"{where}: {what} are not finite numbers")
    return out
