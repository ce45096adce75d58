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
from perception.masks import _numbers, decoded, numbered_names, read_json

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


def test_coco_images_are_the_frames_that_their_files_names_say(tmp_path: Path) -> None:
    """Annotation tools number images as they like."""
    home = recording(tmp_path)
    of_41 = {"image_id": 41, "category_id": 3, "segmentation": [[2, 2, 10, 2, 10, 9, 2, 9]]}
    document: dict[str, Any] = {
        "annotations": [of_41],
        "images": [{"id": 41, "file_name": "rgb/000000.png"}, {"id": 0, "file_name": "000041.png"}],
    }
    (home / "masks_coco.json").write_text(json.dumps(document))
    assert read_frames(tmp_path)[0].names == ("object_3",)
    (home / "masks_coco.json").write_text(json.dumps({"annotations": [of_41]}))
    with pytest.raises(ValueError, match="has masks of the images 41 …, and the frames are 0 …; `images` may say which is which"):
        read_frames(tmp_path)


def test_coco_images_whose_names_end_in_a_number_are_the_frames_of_that_number(tmp_path: Path) -> None:
    home = recording(tmp_path)
    square = [[2, 2, 10, 2, 10, 9, 2, 9]]
    document: dict[str, Any] = {
        "annotations": [{"image_id": i, "category_id": i, "segmentation": square} for i in (0, 1)],
        "images": [{"id": 0, "file_name": "rgb/frame_0001.png"}, {"id": 1, "file_name": "rgb/frame_0000.png"}],
    }
    (home / "masks_coco.json").write_text(json.dumps(document))
    assert read_frames(tmp_path)[0].names == ("object_1",)


def test_coco_ids_from_1_are_not_taken_for_frames_from_0() -> None:
    """Each mask would be the one of the frame before."""
    images = {1: "left", 2: "middle", 3: "right"}
    with pytest.raises(ValueError, match="the name of image 3, 'right', says no frame's number, and there is no frame 3: give `file_name`"):
        _numbers(Path("coco.json"), images, {0, 1, 2})
    assert _numbers(Path("coco.json"), images, {1, 2, 3}) == {1: 1, 2: 2, 3: 3}
    assert _numbers(Path("coco.json"), images, {1, 2}) == {1: 1, 2: 2, 3: 3}, "a part of the images"
    assert _numbers(Path("coco.json"), {1: "img-v2", 2: "depth-v2"}, {1, 2}) == {1: 1, 2: 2}, "no numbers of frames"
    assert _numbers(Path("coco.json"), {5: "000000", 6: "000001"}, {0, 1}) == {5: 0, 6: 1}


@pytest.mark.parametrize(
    "change",
    [{"image_id": "left"}, {"image_id": None}, {"score": "high"}, {"score": None}],
    ids=["image", "no image", "score", "no score"],
)
def test_what_is_no_number_in_coco_is_told_with_the_file(change: dict[str, Any], tmp_path: Path) -> None:
    home = recording(tmp_path)
    (home / "coco_results.json").write_text(json.dumps([{"image_id": 0, "category_id": 1, "segmentation": [], **change}]))
    with pytest.raises(ValueError, match=r"coco_results\.json: ids of images and categories are whole numbers"):
        read_frames(tmp_path)


def test_masks_of_an_image_of_which_scene_gt_says_nothing(tmp_path: Path) -> None:
    home = recording(tmp_path)
    (home / "mask_visib").mkdir()
    Image.fromarray(painted().astype(np.uint8) * 255).save(home / "mask_visib" / "000000_000000.png")
    assert read_frames(tmp_path)[0].names == ("object_0",)
    (home / "scene_gt.json").write_text(json.dumps({"4": [{"obj_id": 1}]}))
    with pytest.raises(ValueError, match="says nothing of image 0, of which there are masks"):
        read_frames(tmp_path)


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
        ({"size": [48, 64], "counts": {"a": 1}}, "neither a string nor a list of whole numbers"),
        ({"size": [48, 64], "counts": ["x"]}, "neither a string nor a list of whole numbers"),
        ({"size": "big", "counts": [3072]}, "is \\[height, width\\], not 'big'"),
        ([[1, 2, 3]], "at least three points"),
        ([[1, 2, "x", 3, 4, 5]], "at least three points"),
    ],
)
def test_a_bad_mask_is_told(segmentation: Any, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        decoded(segmentation, (48, 64))


def test_a_byte_order_mark_is_no_part_of_the_text(tmp_path: Path) -> None:
    """What Windows writes."""
    (tmp_path / "scene_camera.json").write_text('{"0": {}}', encoding="utf-8-sig")
    assert read_json(tmp_path / "scene_camera.json") == {"0": {}}


def test_names_are_numbered_where_they_repeat() -> None:
    assert numbered_names(["a", "b", "a", "a"]) == ["a", "b", "a_1", "a_2"]


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_how_opaque_a_pixel_is_says_nothing(channels: int, tmp_path: Path) -> None:
    """The masks of some segmenters have an alpha channel, 255 all over, and became masks of whole images."""
    home = recording(tmp_path)
    label = np.zeros((48, 64), np.uint8)
    label[5:20, 5:20], label[30:40, 30:40] = 4, 9
    opaque = [np.full_like(label, 255)] if channels in (2, 4) else []

    def image(grey: np.ndarray) -> Image.Image:
        return Image.fromarray(np.dstack([grey] * (channels - len(opaque)) + opaque).squeeze())

    (home / "label").mkdir()
    image(label).save(home / "label" / "000000.png")
    (frame,) = read_frames(tmp_path)
    assert frame.names == ("object_4", "object_9")
    assert np.array_equal(frame.instance, np.select([label == 4, label == 9], [0, 1], -1))
    (home / "mask_visib").mkdir()
    image(np.where(label == 4, 255, 0).astype(np.uint8)).save(home / "mask_visib" / "000000_000000.png")
    (frame,) = read_frames(tmp_path)
    assert np.array_equal(frame.instance == 0, label == 4)


def test_labels_that_are_colours_are_refused(tmp_path: Path) -> None:
    home = recording(tmp_path)
    (home / "label").mkdir()
    colours = np.zeros((48, 64, 3), np.uint8)
    colours[5:20, 5:20, 0] = colours[30:40, 30:40, 1] = 255
    Image.fromarray(colours).save(home / "label" / "000000.png")
    with pytest.raises(ValueError, match=r"label.000000.png: its pixels are colours: expected is one channel"):
        read_frames(tmp_path)
