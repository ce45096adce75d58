"""Objects from views: how many are found, and how well their boxes fit, by mask and by geometry alone, clean and with a D435i's noise.

Scenes are generated (specs paper and shelf); eight cameras look into each from before its front, at two heights and from several sides.
Demanded are objects of which the frames together show at least 200 pixels. By mask an object is found when a box bears its name; by
geometry alone when its pixels and those of one found object have more than half of their union in common.
Times are processor time for all eight frames together.
Usage: PYTHONPATH=. python benchmarks/segment.py [-n 50] [--seed 90] [--gap-m 0.01]. The last line is one JSON object.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace

import numpy as np

from kinematics.robots.load import load
from kinematics.scene import Cabinet, RobotRef, Scene, object_box
from kinematics.transforms import Array
from perception.camera import DepthNoise, look_at, realsense_d435i
from perception.frames import Frame
from perception.objects.clustering import cluster_instances
from perception.objects.prepared_frames import prepare
from perception.objects.segment import iou, segment
from perception.rendering.raycast import raycast
from perception.rendering.surfaces import surfaces
from planning.scenes.generation import generate, load_spec

CAMERA = realsense_d435i(640, 480)
ENOUGH_PX = 200
NOISE = 2  # this benchmark's own stage in the seeds


def poses(cabinet: Cabinet) -> list[Array]:
    """Eight camera poses before the opening, three of them high, that look at the middle of the floor or at one side of it."""
    height = cabinet.size_m[2]
    eyes = [
        (-0.10, -0.35, 0.8 * height, 0.35, 0.10, 0.0),
        (-0.10, 0.35, 0.8 * height, 0.35, -0.10, 0.0),
        (0.02, 0.0, 0.9 * height, 0.40, 0.0, 0.0),
        (-0.05, -0.20, 0.5 * height, 0.45, -0.20, 0.05),
        (-0.05, 0.20, 0.5 * height, 0.45, 0.20, 0.05),
        (0.08, -0.30, 0.9 * height, 0.40, 0.05, 0.0),
        (0.08, 0.30, 0.9 * height, 0.40, -0.05, 0.0),
        (-0.15, 0.0, 0.6 * height, 0.30, 0.0, 0.05),
    ]
    T = cabinet.T_world_cabinet
    to_world = lambda p: T[:3, :3] @ np.array(p) + T[:3, 3]  # noqa: E731
    return [look_at(to_world(e[:3]), to_world(e[3:])) for e in eyes]


def frames_of(scene: Scene, noise: DepthNoise | None, rng: np.random.Generator) -> list[Frame]:
    """What the eight cameras see of a scene."""
    bodies = [*scene.objects, *scene.cabinet.walls()]
    packed = surfaces([b.shape for b in bodies], np.array([b.T_world_body for b in bodies]))
    names = tuple(b.name for b in scene.objects)
    frames = []
    for T in poses(scene.cabinet):
        view = raycast(packed, T, CAMERA)
        depth = view.depth if noise is None else noise.apply(view.depth, rng)
        frames.append(Frame(depth, np.where(view.instance < len(names), view.instance, -1).astype(np.int32), names, CAMERA, T))
    return frames


def pixels_in_common(truth: list[Frame], found: list[Frame], name: str) -> float:
    """The best share of the union that a found object's pixels have in common with the named one's, where something was measured."""
    k = truth[0].names.index(name)
    hers = np.concatenate([((f.instance == k) & (f.depth > 0)).ravel() for f in truth])
    theirs = np.concatenate([f.instance.ravel() for f in found])
    best = 0.0
    for other in np.unique(theirs[hers & (theirs >= 0)]):
        it = theirs == other
        best = max(best, float(np.count_nonzero(hers & it) / np.count_nonzero(hers | it)))
    return best


def measure(scenes: list[Scene], noise: DepthNoise | None, seed: int) -> dict[str, dict[str, float]]:
    """Per way of telling objects apart: shares found, box IoUs, boxes too many, time a scene."""
    rows: dict[str, list[tuple[bool, float]]] = {"mask": [], "geometry": []}
    times: dict[str, list[float]] = {"mask": [], "geometry": []}
    extra = 0
    for i, scene in enumerate(scenes):
        frames = frames_of(scene, noise, np.random.default_rng([seed, NOISE, i]))
        bare = [Frame(f.depth, None, (), f.intrinsics, f.T_world_camera) for f in frames]
        shown = {b.name: sum(int(np.count_nonzero(f.instance == k)) for f in frames) for k, b in enumerate(scene.objects)}
        demanded = [b for b in scene.objects if shown[b.name] >= ENOUGH_PX]
        for by, given in (("mask", frames), ("geometry", bare)):
            began = time.process_time()
            boxes = segment(given, scene.cabinet, by=by)
            times[by].append(time.process_time() - began)
            found = list(cluster_instances(prepare(bare, scene.cabinet)).frames) if by == "geometry" else []
            for body in demanded:
                true = object_box(body)
                best = (
                    max((iou(true, b) for b in boxes.values()), default=0.0)
                    if by == "geometry"
                    else iou(true, boxes.get(body.name, np.zeros(6)))
                )
                rows[by].append((body.name in boxes if by == "mask" else pixels_in_common(frames, found, body.name) > 0.5, best))
            if by == "geometry":
                extra += max(len(boxes) - sum(n > 0 for n in shown.values()), 0)
    return {
        by: {
            "demanded": len(r),
            "found_share": float(np.mean([f for f, _ in r])),
            "iou_median": float(np.median([q for _, q in r])),
            "iou_p10": float(np.percentile([q for _, q in r], 10)),
            "too_many": extra if by == "geometry" else 0,
            "median_ms": 1e3 * float(np.median(times[by])),
        }
        for by, r in rows.items()
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=50, help="scenes a spec")
    parser.add_argument("--seed", type=int, default=90)
    parser.add_argument("--gap-m", type=float, default=0.01, help="least distance between objects")
    args = parser.parse_args()
    robot, ref = load("ur5e"), RobotRef(np.eye(4), "ur5e")
    table: dict[str, dict[str, dict[str, float]]] = {}
    print(f"{'spec, depth, by':32}{'objects':>8}{'found':>8}{'IoU':>7}{'p10':>7}{'too many':>10}{'ms':>8}")
    for which in ("paper", "shelf"):
        spec = replace(load_spec(which), objects_gap_m=args.gap_m)
        scenes = [generate(spec, robot, ref, args.seed, i) for i in range(args.n)]
        for label, noise in (("clean", None), ("noise", DepthNoise())):
            table[f"{which} {label}"] = measure(scenes, noise, args.seed)
            for by, m in table[f"{which} {label}"].items():
                numbers = f"{m['demanded']:8.0f}{100 * m['found_share']:7.1f}%{m['iou_median']:7.3f}{m['iou_p10']:7.3f}"
                print(f"{f'{which}, {label}, {by}':32}{numbers}{m['too_many']:10.0f}{m['median_ms']:8.1f}")
    print(json.dumps(table))


if __name__ == "__main__":
    main()
