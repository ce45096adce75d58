"""What a sensed scene carries beside the truth, to JSON and back: boxes, regions, views, and what nobody has seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinematics.transforms import Array
from perception.camera import Intrinsics
from planning.io.checked import Node
from planning.io.documents import number, numbers, pose_to_json, rows_of_numbers

MOST_CELLS = 10**8


def observation_from_node(node: Node) -> dict[str, Any]:
    """What a sensed scene carries: checked, and passed on as it is."""
    f = node.record(("objects", "regions", "views", "known"))
    for item in f["objects"].items(most=500):
        o = item.record(("name", "box"), extra=True)
        o["name"].text()
        o["box"].vector(6, lengths=True)
    for item in f["regions"].items(most=10_000):
        item.vector(4, lengths=True)
    for item in f["views"].items():
        v = item.record(("T_world_camera", "known"), ("unknown", "intrinsics"), extra=True)
        if "unknown" in v:
            _unknown(v["unknown"])
        if "intrinsics" in v:
            intrinsics_from(v["intrinsics"])
        v["T_world_camera"].pose()
        v["known"].number(least=0, most=1)
    f["known"].number(least=0, most=1)
    return dict(node.value)


def intrinsics_from(node: Node) -> Intrinsics:
    """A camera out of its six numbers. Raises: InputError for one without pixels, or without a focal length."""
    width, height, fx, fy, cx, cy = node.vector(6).tolist()
    if width % 1 or height % 1 or min(width, height) < 1 or min(fx, fy) <= 0:
        raise node.error("width and height are whole numbers of pixels, and focal lengths are positive")
    return Intrinsics(int(width), int(height), fx, fy, cx, cy)


def _unknown(node: Node) -> None:
    """Raises InputError for boxes that are not of whole cells within the cabinet."""
    u = node.record(("cells", "boxes"))
    cells = u["cells"].vector(3)
    if (cells % 1 != 0).any() or (cells < 1).any() or np.prod(cells) > MOST_CELLS:
        raise u["cells"].error(f"three whole numbers from 1 on are needed, whose product is at most {MOST_CELLS}")
    for item in u["boxes"].items():
        box = item.vector(6)
        if (box % 1 != 0).any() or (box[:3] < 0).any() or (box[:3] >= box[3:]).any() or (box[3:] > cells).any():
            raise item.error("a box is six whole numbers, its first cell and the one after its last along x, y and z, within the cells")


def observation_to_json(
    boxes: Mapping[str, Array],
    regions: Array,
    views: Sequence[tuple[Array, float]],
    known: float,
    cells: tuple[int, ...],
    unknown: NDArray[np.int64],
    intrinsics: Intrinsics | None = None,
) -> dict[str, Any]:
    """What a sensed scene carries: boxes by name (6,), regions (n², 4), each view's T_world_camera and the share known after it.

    cells (3,): into how many cells the cabinet's depth, width and height are divided; unknown (B, 6): boxes that fill what nobody has seen
    after the last view, which tells of them: their first cell and the one after their last, along each. intrinsics: of the camera that took
    the last view.
    """
    seen: list[dict[str, Any]] = [{"T_world_camera": pose_to_json(T), "known": float(share)} for T, share in views]
    if seen:
        seen[-1]["unknown"] = {"cells": [int(n) for n in cells], "boxes": [[int(i) for i in row] for row in unknown]}
    if seen and intrinsics is not None:
        c = intrinsics
        seen[-1]["intrinsics"] = [c.width, c.height, *(number(x) for x in (c.fx, c.fy, c.cx, c.cy))]
    return {
        "objects": [{"name": name, "box": numbers(box)} for name, box in boxes.items()],
        "regions": rows_of_numbers(regions),
        "views": seen,
        "known": float(known),
    }
