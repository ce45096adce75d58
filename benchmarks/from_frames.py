"""Frames in, plan out: scenes planned from a folder of noisy frames, with no truth given, beside the same scenes planned from the truth.

Scenes are generated; the camera in the hand looks into each with a D435i's noise, and its frames are written without masks. Then all that
is kept of a scene are the robot, the cabinet and x_g: `retrieve sense --from-views DIR --by geometry` finds the objects, `retrieve plan`
plans among them. A plan is carried out on the truth, the fingers closing on what is there, with each object where it truly is in the hand;
`verify` says whether anything touches that must not, the verdict whether everything is held and stands. Truth and plans are written for a
stranger's replay: benchmarks/replay.py OUT/truth.jsonl OUT/carried_out_solid.jsonl URDF.

Usage: PYTHONPATH=. python benchmarks/from_frames.py [-n 50] [--seed 61] [--spec paper | --scenes FILE] [--policy local] -o OUT. The last
line is one JSON object. A second run into the same folder keeps the recorded frames. Scenes of a file, with cans that lie, say, need an x_g
(`retrieve grasp` finds one), for it tells which object is the target. The robot is UR5e.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from kinematics.robots.load import load
from kinematics.robots.robot import Robot
from kinematics.scene import Scene
from perception.frames import write_frames
from planning.io.files import read_plans, read_scenes
from planning.io.results import plan_writer, scene_writer
from planning.motion.checking.verify import verify
from planning.plan import Plan
from planning.sensing.on_truth import on_truth
from planning.sensing.survey import RECORDING
from planning.statistics import wilson
from planning.verdict import Settings, judge_motions
from retrieve_cli.gen import run as gen
from retrieve_cli.plan import run as plan
from retrieve_cli.plan_job import Job
from retrieve_cli.robot_options import RobotOptions
from retrieve_cli.sense import record as recorded
from retrieve_cli.sense import run as sense

STAGE = 9  # this benchmark's own word in the seeds


def record(truth: Path, folder: Path) -> None:
    """Noisy frames of every scene, in folders of their own, without masks of the objects; those that are there already are kept."""
    robot = load("ur5e")
    for index, (_, scene) in enumerate(read_scenes(truth)):
        if (folder / f"{index:06d}" / "scene_camera.json").is_file():
            continue
        frames, _, _ = recorded(scene, robot, RECORDING, True, "geometry", np.random.default_rng([STAGE, index]))
        write_frames(folder, frames, scene=index)


def forget(truth: Path, out: Path) -> None:
    """The scenes without their objects and without the target's name."""
    with scene_writer(out) as write:
        for _, scene in read_scenes(truth):
            write(replace(scene, objects=(), target=None))


def planned(scenes: Path, out: Path, policy: str, unseen: str = "solid") -> list[Plan]:
    """The plans of a file of scenes, which are also written to `out`."""
    plan(Job(policy, unseen=unseen), scenes=scenes, out=out)
    return [made for _, made in read_plans(out)]


def judged(robot: Robot, known: list[Scene], seen: list[Scene], plans: list[Plan], out: Path) -> dict[str, object]:
    """How many plans there are, and what they touch when they are carried out on the truth."""
    reasons, touched, wrong = Counter[str](), Counter[str](), Counter[str]()
    with plan_writer(out) as write:
        for scene, believed, made in zip(known, seen, plans):
            if not made.success:
                why = made.reason
                reasons[
                    "?" if why is None else f"{why.stage}: {'unseen space' if (why.body or '').startswith('unknown_') else 'other'}"
                ] += 1
                continue
            done = on_truth(robot, scene, believed, made)
            write(done)
            touch = verify(robot, scene, done.motions)
            touched["nothing" if touch is None else f"{touch.link} {touch.body}"] += 1
            found = judge_motions(scene, done.motions, robot, Settings(contact=False))  # contacts were judged just now
            wrong[str(found[0]) if found else "nothing"] += 1
    share = wilson(sum(p.success for p in plans), len(plans))
    return {
        "solved": share.k,
        "interval": [round(share.low, 3), round(share.high, 3)],
        "clean_on_the_truth": touched.pop("nothing", 0),
        "touched": dict(touched),
        "holds_on_the_truth": wrong.pop("nothing", 0),
        "wrong": dict(wrong),
        "unsolved": dict(reasons),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=50)
    parser.add_argument("--seed", type=int, default=61)
    parser.add_argument("--spec", default="paper")
    parser.add_argument("--scenes", type=Path, help="a file of scenes with an x_g each, instead of generated ones")
    parser.add_argument("--policy", default="local")
    parser.add_argument("-o", "--out", type=Path, required=True)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    truth, views, blank, out = (args.out / name for name in ("truth.jsonl", "views", "blank.jsonl", "seen.jsonl"))
    if args.scenes:
        truth.write_bytes(args.scenes.read_bytes())
    else:
        gen(n=args.n, seed=args.seed, robot=RobotOptions(), spec=args.spec, out=truth)
    views.mkdir(exist_ok=True)
    record(truth, views)
    forget(truth, blank)
    given = {"views": None, "max_views": None, "share": None, "noise": False, "by": "geometry", "target_box": None, "seed": 0}
    sense(scenes=blank, from_views=views, out=out, **given)  # type: ignore[arg-type]
    robot, known, seen = load("ur5e"), [s for _, s in read_scenes(truth)], [s for _, s in read_scenes(out)]
    table: dict[str, object] = {
        "scenes": len(known),
        "objects": sum(len(s.objects) for s in known),
        "seen": sum(len(s.objects) for s in seen),
        "target_right": sum(found_right(a, b) for a, b in zip(known, seen)),
        "from_truth": sum(p.success for p in planned(truth, args.out / "from_truth.jsonl", args.policy)),
    }
    for unseen in ("solid", "free"):
        plans = planned(out, args.out / f"from_frames_{unseen}.jsonl", args.policy, unseen)
        table[f"from_frames, unseen space {unseen}"] = judged(robot, known, seen, plans, args.out / f"carried_out_{unseen}.jsonl")
    print(json.dumps(table))


def found_right(truth: Scene, seen: Scene) -> bool:
    """Whether what was taken for the target stands where the target does."""
    target = next((b for b in seen.objects if b.name == seen.target), None)
    if target is None:
        return False
    at = target.T_world_body[:2, 3]
    return min(truth.objects, key=lambda b: float(np.linalg.norm(b.T_world_body[:2, 3] - at))).name == truth.target


if __name__ == "__main__":
    main()
