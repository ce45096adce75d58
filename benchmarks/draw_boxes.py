"""Boxes of an observation drawn over a recorded depth image: near is bright, nothing measured is black, a colour an object.

Usage: PYTHONPATH=. python benchmarks/draw_boxes.py FRAMES OBSERVED.jsonl OUT.png [--scene 0] [--frame 0]. FRAMES is a recording in the BOP
layout, OBSERVED what `retrieve sense FRAMES --from-views …` has written.
"""

from __future__ import annotations

import argparse
import json
from itertools import combinations
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from kinematics.transforms import Array
from perception.camera import project
from perception.frames import PALETTE, Frame, read_frames


def shaded(frame: Frame) -> Image.Image:
    """The depth image, its middle 98 % from white to dark."""
    depth = np.asarray(frame.depth, float)
    near, far = np.percentile(depth[depth > 0], [1, 99])
    grey = np.where(depth > 0, 235 - 170 * np.clip((depth - near) / max(far - near, 1e-6), 0, 1), 0)
    return Image.fromarray(np.repeat(grey[..., None], 3, 2).astype(np.uint8))


def edges(box: Array) -> Array:
    """The twelve edges (12, 2, 3) of a box (6,), centre and size."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * box[3:] + box[:3]
    pairs = [(a, b) for a, b in combinations(range(8), 2) if (a ^ b).bit_count() == 1]
    return corners[np.array(pairs)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("frames", type=Path)
    parser.add_argument("observed", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--scene", type=int, default=0)
    parser.add_argument("--frame", type=int, default=0)
    args = parser.parse_args()
    one = (args.frames / "scene_camera.json").is_file()
    frame = read_frames(args.frames, scene=None if one else args.scene)[args.frame]
    with args.observed.open() as lines:
        objects = [json.loads(line) for line in lines][args.scene]["observation"]["objects"]
    image = shaded(frame)
    draw = ImageDraw.Draw(image)
    for i, entry in enumerate(objects):
        colour = tuple(int(c) for c in PALETTE[i % len(PALETTE)])
        ends = project(edges(np.array(entry["box"])).reshape(-1, 3), frame.intrinsics, frame.T_world_camera)[:, :2].reshape(-1, 2, 2)
        for a, b in ends[np.isfinite(ends).all((1, 2))]:
            draw.line([*a, *b], fill=colour, width=max(frame.intrinsics.width // 400, 1))
        draw.text(tuple(np.nanmin(ends.reshape(-1, 2), axis=0) + 3), entry["name"], fill=colour)
    image.save(args.out)
    print(f"{args.out}: {len(objects)} boxes")


if __name__ == "__main__":
    main()
