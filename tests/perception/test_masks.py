"""Masks as segmenters write them: COCO's run-length encodings and polygons, label images; and what is wrong with a bad one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from perception.camera import Intrinsics, look_at
from perception.frames import Frame, read_frames, write_frames
from perception.masks import decoded, numbered_names

CAMERA = Intrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
FROM_PYCOCOTOOLS = "01ak04gUO6K4M2N2N2O0O2O000O2O00000001N10001N101N2N2N3L5JY;3gD0000000000000000000000000"


def painted() -> np.ndarray[Any, np.dtype[np.bool_]]:
    """The mask that FROM_PYCOCOTOOLS encodes: a disc, a corner and one pixel, (48, 64)."""
    v, u = np.mgrid[:48, :64]
    mask = (v - 20) ** 2 + (u - 30) ** 2 < 150
    mask[40:, 50:] = mask[0, 0] = True
    return mask


def runs_of(mask: np.ndarray[Any, np.dtype[np.bool_]]) -> list[int]:
    """How many pixels column by column are out, in, out, …"""
    flat = np.concatenate([[False], mask.T.ravel()])
    ends = np.flatnonzero(flat[1:] != flat[:-1])
    return np.diff(np.concatenate([[0], ends, [mask.size]])).tolist()


def recording(folder: Path) -> Path:
    """A recording of one frame without masks."""
    pose = look_at(np.array([0.0, 0.0, 0.3]), np.array([0.5, 0.0, 0.1]))
    return write_frames(folder, [Frame(np.full((48, 64), 0.5, np.float32), None, (), CAMERA, pose)])


def test_run_lengths_are_read_as_pycocotools_writes_them() -> None:
    assert np.array_equal(decoded({"size": [48, 64], "counts": FROM_PYCOCOTOOLS}, (48, 64)), painted())


@pytest.mark.parametrize("seed", range(5))
def test_plain_run_lengths_are_a_mask(seed: int) -> None:
    mask = np.random.default_rng(seed).random((7, 9)) < 0.4
    assert np.array_equal(decoded({"size": [7, 9], "counts": runs_of(mask)}, (7, 9)), mask)


def test_coco_annotations_name_the_objects(tmp_path: Path) -> None:
    home = recording(tmp_path)
    annotations = [
        {"image_id": 0, "category_id": 3, "segmentation": {"size": [48, 64], "counts": FROM_PYCOCOTOOLS}},
        {"image_id": 0, "category_id": 3, "segmentation": [[2, 2, 10, 2, 10, 9, 2, 9]]},
        {"image_id": 7, "category_id": 3, "segmentation": [[2, 2, 10, 2, 10, 9]]},
    ]
    (home / "scene_gt_coco.json").write_text(json.dumps({"annotations": annotations, "categories": [{"id": 3, "name": "mug"}]}))
    (frame,) = read_frames(tmp_path)
    assert sorted(frame.names) == ["mug", "mug_1"]
    assert frame.instance is not None
    assert np.array_equal(frame.instance == 0, painted())
    assert (frame.instance[3:9, 3:10] == 1).all()


def test_the_surer_of_two_results_wins_where_they_overlap(tmp_path: Path) -> None:
    home = recording(tmp_path)
    everything, middle = [[0, 0, 63, 0, 63, 47, 0, 47]], [[20, 10, 40, 10, 40, 30, 20, 30]]
    results = [
        {"image_id": 0, "category_id": 1, "score": 0.9, "segmentation": middle},
        {"image_id": 0, "category_id": 1, "score": 0.4, "segmentation": everything},
    ]
    (home / "coco_results.json").write_text(json.dumps(results))
    (frame,) = read_frames(tmp_path)
    assert frame.instance is not None
    assert frame.names[frame.instance[20, 30]] == "object_1"
    assert frame.names[frame.instance[40, 60]] == "object_1_1"


def test_label_images_say_nothing_with_0_and_255(tmp_path: Path) -> None:
    home = recording(tmp_path)
    label = np.zeros((48, 64), np.uint8)
    label[5:20, 5:20], label[30:40, 30:40], label[:, 60:] = 4, 9, 255
    (home / "label").mkdir()
    Image.fromarray(label).save(home / "label" / "000000.png")
    (frame,) = read_frames(tmp_path)
    assert frame.names == ("object_4", "object_9")
    assert frame.instance is not None
    assert np.array_equal(frame.instance >= 0, np.isin(label, [4, 9]))
    (home / "label" / "names.json").write_text('{"4": "mug", "9": "mug"}')
    assert read_frames(tmp_path)[0].names == ("mug", "mug_1")


@pytest.mark.parametrize(
    ("segmentation", "complaint"),
    [
        ({"size": [40, 64], "counts": [40 * 64]}, "64 × 40 pixels, the depth image 64 × 48"),
        ({"size": [48, 64], "counts": [5, 6]}, "count 11 pixels, and the image has 3072"),
        ({"size": [48, 64]}, "neither a run-length encoding"),
        ([[1, 2, 3]], "at least three points"),
    ],
)
def test_a_bad_mask_is_told(segmentation: Any, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        decoded(segmentation, (48, 64))


def test_names_are_numbered_where_they_repeat() -> None:
    assert numbered_names(["a", "b", "a", "a"]) == ["a", "b", "a_1", "a_2"]
