"""Plans replayed by a stranger, tests/second_engine.py: pinocchio moves the arm, coal says what touches, nothing of ours is imported.

Every plan is checked at samples so near to each other that no point of the arm or of what it holds moves further than --step between them;
the planner's own last word on a plan takes ten times as much. Problems are printed as they are found.

Usage: python benchmarks/replay.py scenes.jsonl plans.jsonl robot.urdf [--step 0.0002] [--workers 1]. `retrieve robots NAME --urdf FILE`
writes the URDF. The last line is one JSON object; its samples are those that the step stands for, not those that had to be looked at.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Iterator
from multiprocessing import Pool
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from second_engine import Problem, Replay

Json = dict[str, Any]


class Job(NamedTuple):
    """One plan and what it takes to replay it."""

    scene: Json
    plan: Json
    urdf: Path
    step_m: float
    folder: Path


class Found(NamedTuple):
    """What a replay said, how many samples it stands for and the processor time it took."""

    plan: Json
    problems: list[Problem]
    samples: int
    cpu_s: float


def check(job: Job) -> Found:
    began = time.process_time()
    engine = Replay(job.scene, job.plan, job.urdf, job.step_m, job.folder)
    return Found(job.plan, engine.run(), engine.samples, time.process_time() - began)


def jobs(args: argparse.Namespace) -> Iterator[Job]:
    """One for each plan. Raises SystemExit where a plan's scene is not among the scenes."""
    with args.scenes.open() as lines:
        scenes = {scene["id"]: scene for scene in map(json.loads, lines)}
    with args.plans.open() as lines:
        for number, plan in enumerate(map(json.loads, lines), 1):
            if plan["scene"] not in scenes:
                raise SystemExit(f"{args.plans}:{number}: scene {plan['scene']!r} is not in {args.scenes}")
            yield Job(scenes[plan["scene"]], plan, args.urdf, args.step, args.scenes.parent)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", type=Path)
    parser.add_argument("plans", type=Path)
    parser.add_argument("urdf", type=Path)
    parser.add_argument("--step", type=float, default=0.0002, metavar="M")
    parser.add_argument("--workers", type=int, default=1, metavar="N")
    args = parser.parse_args()
    kinds, total = Counter[str](), Counter[str]()
    cpu_s, slowest_s, deepest_m = 0.0, 0.0, 0.0
    with Pool(args.workers) as pool:
        for found in pool.imap(check, jobs(args)):
            total.update(plans=1, successes=bool(found.plan["success"]), motions=len(found.plan["motions"]), samples=found.samples)
            total.update(plans_with_problems=bool(found.problems))
            kinds.update(p.kind for p in found.problems)
            cpu_s, slowest_s = cpu_s + found.cpu_s, max(slowest_s, found.cpu_s)
            deepest_m = max([deepest_m, *(p.depth_m for p in found.problems)])
            for problem in found.problems:
                print(found.plan["scene"], problem, flush=True)
            if total["plans"] % 20 == 0:
                print(f"{total['plans']} plans, {sum(kinds.values())} problems, {cpu_s:.0f} s", file=sys.stderr, flush=True)
    measured = {"problems": dict(kinds), "deepest_m": deepest_m, "step_m": args.step}
    measured |= {"cpu_s": round(cpu_s, 1), "slowest_s": round(slowest_s, 2)}
    print(json.dumps({**total, **measured}))


if __name__ == "__main__":
    main()
