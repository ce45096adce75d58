"""Active sensing: what share of what 200 random reachable views show is known after how many views, against both baselines; and how long.

Every scene is generated, sensed from nothing with the views chosen by gain, at random and in a fixed sweep, and compared with all of 200
random views that the arm can reach in that scene. Usage: python benchmarks/sensing.py [--scenes 50] [--seed 1] [--spec paper] [--most 12].
The last line is one JSON object.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace

import numpy as np

from kinematics.robots.load import load, to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Scene
from perception.mapping.voxels import unknown_voxels
from perception.rendering.synthetic_camera import synthetic_camera
from planning.motion.cell.workcell import Workcell
from planning.motion.handling import waiting
from planning.scenes.generation import generate, load_spec
from planning.sensing.look_around import CHOICES, ITERATIONS, Limits, look_around
from planning.sensing.reachable_views import reachable_views

ALL, SHARE = 200, 0.97


def everything(scene: Scene, robot: Robot) -> float:
    """The share of the space that 200 random reachable views show together, of another draw than the views that are chosen from."""
    cell = Workcell(robot, scene, iterations=ITERATIONS, time_budget_s=None)
    gripper = float(robot.home[robot.gripper_joint])
    here = cell.problem(scene.poses(), gripper)
    spots = reachable_views(robot, replace(scene, objects=()), seed=1)
    camera, voxels = synthetic_camera(robot, scene, scene.poses()), unknown_voxels(scene.cabinet)
    taken = 0
    for i in np.random.default_rng(0).permutation(len(spots.q)):
        if cell.touch(here, spots.q[i]) is None:
            frame = camera(spots.T[i], robot.with_arm(spots.q[i], gripper))
            depth = frame.depth if frame.arm is None else np.where(frame.arm, np.float32(0), frame.depth)
            voxels = voxels.fuse(depth, frame.intrinsics, frame.T_world_camera)
            taken += 1
        if taken == ALL:
            break
    return voxels.known


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--spec", default="paper")
    parser.add_argument("--most", type=int, default=12)
    given = parser.parse_args()
    robot = load("ur5e")
    ref, spec = to_ref(robot), load_spec(given.spec)
    rows: dict[str, list[list[float]]] = {c: [] for c in CHOICES}
    seconds: dict[str, list[float]] = {c: [] for c in CHOICES}
    stopped: list[tuple[int, float, float]] = []
    for index in range(given.scenes):
        scene = generate(spec, robot, ref, given.seed, index)
        empty_scene, most = replace(scene, objects=()), everything(scene, robot)
        camera = synthetic_camera(robot, scene, scene.poses())
        home = waiting.home(Workcell(robot, empty_scene, iterations=ITERATIONS, time_budget_s=None))
        for choice in CHOICES:
            rng = np.random.default_rng([given.seed, 2, index])
            start = time.process_time()
            nothing = unknown_voxels(scene.cabinet)
            seen = look_around(empty_scene, robot, camera, home, nothing, rng, choose=choice, limits=Limits(1.0, 0.0, given.most))
            seconds[choice].append(time.process_time() - start)
            shares = [known / most for _, known in seen.views]
            rows[choice].append(shares + shares[-1:] * (given.most - len(shares)))
        start = time.process_time()
        rng = np.random.default_rng([given.seed, 2, index])
        seen = look_around(empty_scene, robot, camera, home, unknown_voxels(scene.cabinet), rng)
        stopped.append((len(seen.views), seen.voxels.known / most, time.process_time() - start))
        v, known, cpu = stopped[-1]
        print(f"scene {index}: all views {most:.3f}; by gain {v} views, {known:.3f} of that, {cpu:.2f} s; {seen.reason}", flush=True)
    print(f"\nmedian share of what {ALL} random views show, after each view")
    result: dict[str, object] = {}
    for choice in CHOICES:
        median = np.median(rows[choice], axis=0)
        needed = [next((k + 1 for k, s in enumerate(r) if s >= SHARE), given.most + 1) for r in rows[choice]]
        print(f"{choice:7} {' '.join(f'{m:.3f}' for m in median)}   views to {SHARE}: median {np.median(needed):g}")
        result[choice] = {"median_share": [round(float(m), 4) for m in median], "median_views": float(np.median(needed))}
    views, share, s = (np.array(column) for column in zip(*stopped))
    late = np.quantile(s, 0.9)
    print(
        f"stopping by itself: {np.median(views):g} views, share {np.median(share):.3f}, {np.median(s):.2f} s on one core (p90 {late:.2f})"
    )
    result["stopped"] = {"views": float(np.median(views)), "share": float(np.median(share)), "seconds": round(float(np.median(s)), 3)}
    result["seconds_per_view"] = {c: round(float(np.median(t)) / given.most, 4) for c, t in seconds.items()}
    print(json.dumps(result))


if __name__ == "__main__":
    main()
