"""Masks of recorded frames, as segmenters write them: BOP's mask_visib, COCO annotations or results (RLE or polygons), label images.

Beside depth/ in the folder of a scene stands one of
- mask_visib/000000_000000.png (image, object), with the objects' ids or names in scene_gt.json;
- scene_gt_coco.json or another *coco*.json: COCO annotations, or a bare list of results; `segmentation` is a run-length encoding,
  compressed (a string, as pycocotools writes it) or not (a list), or a list of polygons; names are those of the categories. An image is
  the frame whose number its file's name is or ends in, where `images` says so, else the frame whose number is its id;
- label/000000.png: a number an object, 0 and (of 8 bits) 255 nobody's; label/names.json may name them: {"1": "mug"}.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinematics.git_lfs import refuse_pointer
from kinematics.names import free_name
from perception.image_files import DEPTH_FILES, read_grey

Instances = tuple[NDArray[np.int32], tuple[str, ...]]
VOID = 255
"""What label images of 8 bits write where they say nothing."""


def read_json(file: Path) -> Any:
    """The document in a file. Raises: ValueError."""
    refuse_pointer(file, "JSON")
    try:
        return json.loads(file.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError) as e:
        raise ValueError(f"{file}: is no JSON: {e}") from e


def mask_reader(home: Path, objects: dict[str, Any] | None) -> Callable[[int, tuple[int, ...]], Instances] | None:
    """What reads the masks of one image (its number and its shape) of a scene's folder: an image of instances, and their names.

    None when the folder has no masks. objects: what scene_gt.json says by image. Raises: ValueError.
    """
    if any((home / "mask_visib").glob("*.png")):
        return lambda k, shape: _bop(home, k, None if objects is None else objects.get(str(k)), shape)
    coco = sorted(home.glob("*coco*.json"))
    if coco:
        frames = {int(file.stem) for file in (home / "depth").glob("*") if file.suffix in DEPTH_FILES and file.stem.isdigit()}
        by_image, categories = _annotations(coco[0], frames)
        if by_image and not frames & set(by_image):
            said, there = (", ".join(map(str, sorted(some)[:4])) for some in (by_image, frames))
            raise ValueError(f"{coco[0]}: has masks of the images {said} …, and the frames are {there} …; `images` may say which is which")
        return lambda k, shape: _coco(by_image.get(k, []), categories, shape, f"{coco[0]}: image {k}")
    if any((home / "label").glob("*.png")):
        names = read_json(home / "label" / "names.json") if (home / "label" / "names.json").is_file() else {}
        return lambda k, shape: _labels(read_grey(home / "label" / f"{k:06d}.png", shape, numbers=True), names, home / "label")
    return None


# BOP ------------------------------------------------------------------------------------------------------------------------------------


def _bop(home: Path, k: int, objects: Any, shape: tuple[int, ...]) -> Instances:
    """The masks of one image as one image of instances, and the instances' names."""
    if objects is None and (home / "scene_gt.json").is_file() and any((home / "mask_visib").glob(f"{k:06d}_*.png")):
        raise ValueError(f"{home / 'scene_gt.json'}: says nothing of image {k}, of which there are masks")
    if objects is None:
        names = [f"object_{j}" for j in range(len(list((home / "mask_visib").glob(f"{k:06d}_*.png"))))]
    else:
        names = _bop_names(objects, f"{home / 'scene_gt.json'}: image {k}")
    out = np.full(shape, -1, np.int32)
    for j in range(len(names)):
        out[read_grey(home / "mask_visib" / f"{k:06d}_{j:06d}.png", shape) > 0] = j
    return out, tuple(names)


def _bop_names(objects: Any, where: str) -> list[str]:
    if not isinstance(objects, list) or not all(isinstance(o, dict) and isinstance(o.get("obj_id"), int) for o in objects):
        raise ValueError(f"{where}: is no list of objects with an obj_id")
    return numbered_names([str(o.get("name") or f"obj_{o['obj_id']:06d}") for o in objects])


def numbered_names(names: Sequence[str]) -> list[str]:
    """The names, of which a second one that is the same is called name_1, a third one name_2."""
    out: list[str] = []
    for base in names:
        out.append(free_name(base, out))
    return out


# COCO -----------------------------------------------------------------------------------------------------------------------------------


def _annotations(file: Path, frames: set[int]) -> tuple[dict[int, list[dict[str, Any]]], dict[int, str]]:
    """The annotations by frame number, those of lesser score first, and the categories' names."""
    document = read_json(file)
    listed = document.get("annotations") if isinstance(document, dict) else document
    if not isinstance(listed, list) or not all(isinstance(a, dict) and "image_id" in a and "segmentation" in a for a in listed):
        raise ValueError(f"{file}: is neither a COCO file with `annotations` nor a list of results, each with image_id and segmentation")
    groups = document.get("categories", []) if isinstance(document, dict) else []
    images = document.get("images", []) if isinstance(document, dict) else []
    by_image: dict[int, list[dict[str, Any]]] = {}
    try:
        number = _numbers(file, {i["id"]: Path(str(i["file_name"])).stem for i in images if "file_name" in i}, frames)
        for a in sorted(listed, key=lambda a: float(a.get("score", 1.0))):
            by_image.setdefault(int(number.get(a["image_id"], a["image_id"])), []).append(a)
        return by_image, {int(c["id"]): str(c.get("name", c["id"])) for c in groups}
    except _WhichFrame:
        raise
    except (TypeError, ValueError, KeyError, AttributeError) as e:
        raise ValueError(f"{file}: ids of images and categories are whole numbers, and scores are numbers ({_said(e)})") from e


class _WhichFrame(ValueError):
    """An image of which no telling is what frame it shows."""


def _numbers(file: Path, stems: dict[Any, str], frames: set[int]) -> dict[Any, int]:
    """The frame that each image shows, by its id: the number that its file's name is, or ends in; its id where names have none.

    Raises: _WhichFrame when names have none, and neither are all ids frames' numbers nor have all frames an image: most often ids begin at
    1 and frames at 0.
    """
    for pattern in (r"(\d+)", r"(?:.*\D)?(\d+)"):
        found = {i: int(m[1]) for i, stem in stems.items() if (m := re.fullmatch(pattern, stem, re.ASCII))}
        if len(found) == len(stems) == len(set(found.values())) and frames.intersection(found.values()):
            return found
    plain = {i: int(stem if stem.isdecimal() else i) for i, stem in stems.items()}
    for i, stem in stems.items():
        if not stem.isdecimal() and plain[i] not in frames and frames.intersection(plain.values()) and frames.difference(plain.values()):
            raise _WhichFrame(
                f"{file}: the name of image {i}, {stem!r}, says no frame's number, and there is no frame {i}: give `file_name` the "
                "number of the depth image, such as 000000.png"
            )
    return plain


def _said(e: Exception) -> str:
    return f"there is no {e}" if isinstance(e, KeyError) else str(e)


def _coco(annotations: Sequence[dict[str, Any]], categories: dict[int, str], shape: tuple[int, ...], where: str) -> Instances:
    kinds = [a.get("category_id") for a in annotations]
    plain = ["object" if k is None else categories.get(k, f"object_{k}") for k in kinds]
    names = [str(a.get("name", kind)) for a, kind in zip(annotations, plain)]
    best_first = numbered_names(names[::-1])[::-1]  # of two of a kind, the surer one keeps the plain name
    out = np.full(shape, -1, np.int32)
    for j, a in enumerate(annotations):
        out[decoded(a["segmentation"], shape, where)] = j
    return out, tuple(best_first)


def decoded(segmentation: Any, shape: tuple[int, ...], where: str = "segmentation") -> NDArray[np.bool_]:
    """A mask (H, W) from a COCO segmentation: a run-length encoding {"size": [H, W], "counts": …} or polygons. Raises: ValueError."""
    if isinstance(segmentation, list):
        return _polygons(segmentation, shape, where)
    if not isinstance(segmentation, dict) or "counts" not in segmentation:
        raise ValueError(f"{where}: a segmentation is neither a run-length encoding with `counts` nor a list of polygons")
    size, counts = segmentation.get("size", list(shape)), segmentation["counts"]
    if not isinstance(size, list) or len(size) != 2:
        raise ValueError(f"{where}: a mask's size is [height, width], not {size!r}")
    if tuple(size) != tuple(shape):
        raise ValueError(f"{where}: a mask has {size[1]} × {size[0]} pixels, the depth image {shape[1]} × {shape[0]}")
    try:
        runs = np.array(_runs(counts) if isinstance(counts, str) else counts, np.int64)
    except (TypeError, ValueError, OverflowError) as e:
        raise ValueError(f"{where}: the `counts` of a mask are neither a string nor a list of whole numbers ({e})") from e
    if runs.ndim != 1 or (runs < 0).any() or runs.sum() != shape[0] * shape[1]:
        raise ValueError(f"{where}: the runs of a mask count {runs.sum()} pixels, and the image has {shape[0] * shape[1]}")
    flat = np.repeat(np.arange(len(runs)) % 2 == 1, runs)
    return np.ascontiguousarray(flat.reshape(shape[1], shape[0]).T)  # column by column


def _runs(text: str) -> list[int]:
    """The lengths of runs in COCO's compressed form: groups of five bits, least first, from the fourth on less the length two before."""
    runs: list[int] = []
    value = shift = 0
    for character in text:
        bits = ord(character) - 48
        value |= (bits & 31) << shift
        shift += 5
        if not bits & 32:
            if bits & 16:
                value -= 1 << shift
            runs.append(value + (runs[-2] if len(runs) > 2 else 0))
            value = shift = 0
    return runs


def _polygons(polygons: Sequence[Any], shape: tuple[int, ...], where: str) -> NDArray[np.bool_]:
    from PIL import Image, ImageDraw

    canvas = Image.new("1", (shape[1], shape[0]))
    for polygon in polygons:
        if not isinstance(polygon, list) or len(polygon) < 6 or len(polygon) % 2 or not all(isinstance(p, int | float) for p in polygon):
            raise ValueError(f"{where}: a polygon is a list of at least three points, x and y in turn")
        ImageDraw.Draw(canvas).polygon([float(p) for p in polygon], fill=1)
    return np.array(canvas, bool)


# Label images ---------------------------------------------------------------------------------------------------------------------------


def _labels(label: NDArray[Any], names: Any, folder: Path) -> Instances:
    if not isinstance(names, dict):
        raise ValueError(f'{folder / "names.json"}: is no object by number: {{"1": "mug"}}')
    nobody = [0, VOID] if label.dtype == np.uint8 else [0]
    numbers = [int(k) for k in np.unique(label) if k not in nobody]
    out = np.full(label.shape, -1, np.int32)
    for j, k in enumerate(numbers):
        out[label == k] = j
    return out, tuple(numbered_names([str(names.get(str(k), f"object_{k}")) for k in numbers]))
