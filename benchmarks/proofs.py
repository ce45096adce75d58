"""Proofs that no picks take a target out, attacked: every proof of some plans is searched for a way around it, for a while each.

    retrieve gen -n 1000 --seed 606060 -o scenes.jsonl && retrieve plan scenes.jsonl --policy lookahead -o plans.jsonl
    python benchmarks/proofs.py scenes.jsonl plans.jsonl -o attacked.jsonl [--seconds 600] [--most 300] [--seed 0]

A proof names a set of objects of which none can be picked while the others of them stand, and which keeps the target in. Half of the time
goes to that claim, where it is easiest to break: with all other objects gone, grasps on each of the set are drawn at random (directions,
heights, pitches, depths, by an edge), the arm's solutions are sought from ten times as many starts as planning has, those of a redundant
arm from 2,000 and nearer together, and the target is tried with as many for x_g. The planner's picks judge them, which share no code with
the obstructions that the proof rests on. The other half is a search without any guidance in the whole scene: any object that can be picked
goes anywhere, and the target is tried after each move, from the start again after MOST_MOVES.

Both look for more than plans ever try, but they are no proof themselves: what was not found may still be there. A line for each proof goes
to `-o`, where a run goes on that was stopped; the line on stdout has the totals. Exit code 1 when a proof was broken.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from kinematics.robots.load import from_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Grasp, Scene, State
from planning import read_plans, read_scenes
from planning.grasping.sampling import PITCHES, Sampling
from planning.motion.cell.workcell import IkSearch
from planning.motion.handling.object_grasps import sampled_grasps
from planning.motion.handling.picking import Picking, PickSettings
from planning.motion.pick_place import Done, Motions
from planning.motion.settings import UNCONSTRAINED
from planning.plan import Plan

IK, IK_REDUNDANT = IkSearch(240), IkSearch(2000, 0.03)
MOST_MOVES = 6


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("scenes", type=Path)
    parser.add_argument("plans", type=Path)
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--seconds", type=float, default=600.0, help="of processor time for each proof")
    parser.add_argument("--most", type=int, default=10**9, help="proofs at most")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    kept = {(d["scene"], d["policy"]): d for d in map(json.loads, asked.out.read_text().splitlines())} if asked.out.is_file() else {}
    scenes = {scene.id: scene for scene in read_scenes(asked.scenes)}
    proved = [plan for plan in read_plans(asked.plans) if plan.unsolvable is not None and plan.scene in scenes][: asked.most]
    found = []
    with asked.out.open("a") as out:
        for plan in proved:
            line = kept.get((plan.scene, plan.policy))
            if line is None:
                line = attack(scenes[plan.scene], plan, asked.seconds, asked.seed)
                out.write(json.dumps(line) + "\n")
                out.flush()
            found.append(line)
    broken = [line for line in found if line["broken"]]
    totals = {name: sum(line[name] for line in found) for name in ("grasps", "moves", "targets_tried")}
    print(json.dumps({"proofs": len(found), "broken": len(broken), "seconds_each": asked.seconds, **totals}))
    return 1 if broken else 0


def attack(scene: Scene, plan: Plan, seconds: float, seed: int) -> dict[str, Any]:
    """Look for a way around a plan's proof; what was tried, and how it was broken if it was."""
    assert plan.unsolvable is not None
    robot, rng = from_ref(scene.robot), np.random.default_rng([seed, scene.random_word])
    poses = {**scene.poses(), **{m.object: m.T_world_to for m in plan.moves if m.done}}
    began = time.process_time()
    line: dict[str, Any] = {"scene": scene.id, "policy": plan.policy, "stuck": list(plan.unsolvable.stuck)}
    line |= {"broken": None, "grasps": 0, "moves": 0, "targets_tried": 0}
    _attack_claim(robot, scene, poses, line, lambda: time.process_time() - began > seconds / 2, rng)
    if line["broken"] is None:
        _search(robot, scene, poses, line, lambda: time.process_time() - began > seconds, rng)
    print(json.dumps(line), file=sys.stderr)
    return line


def _attack_claim(robot: Robot, scene: Scene, poses: Any, line: dict[str, Any], over: Any, rng: np.random.Generator) -> None:
    """Pick one of the stuck objects while only they and the target stand, or the target with x_g."""
    stuck = line["stuck"]
    alone = replace(scene, objects=tuple(replace(scene.body(n), T_world_body=poses[n]) for n in (*stuck, scene.target_name)))
    motions = Motions(robot, alone, settings=UNCONSTRAINED)
    patient = Picking(motions.cell, PickSettings(ik=IK_REDUNDANT if motions.cell.arm.redundant else IK, enough_grasps=10**9))
    state, home = motions.start(), robot.arm_q(motions.start().q)
    standing = dict(state.poses)

    def picked(name: str, grasps: list[Grasp]) -> bool:
        rest = {other: T for other, T in standing.items() if other != name}
        return bool(patient.picks_with(grasps, standing, rest, name, home)[0])

    if picked(scene.target_name, [scene.x_g]):
        line["broken"] = f"{scene.target_name} can be picked while {', '.join(stuck)} stand"
    while line["broken"] is None and stuck and not over():
        for name in stuck:
            grasps = list(_random_grasps(robot, alone, name, standing[name], rng))
            line["grasps"] += len(grasps)
            if picked(name, grasps):
                line["broken"] = f"{name} can be picked while the others stand"
                return


def _random_grasps(robot: Robot, scene: Scene, name: str, T: Any, rng: np.random.Generator) -> Iterator[Grasp]:
    """Some grasps on an object, from a sampling that is drawn at random within what the scene's approaches mean."""
    diagonal = tuple(rng.uniform(np.pi / 6, np.pi / 3, 2))
    steps = tuple(rng.uniform(0.004, 0.02, 2))
    sampling = Sampling(
        yaws=int(rng.integers(5, 40)),
        backs_m=(0.0, *rng.uniform(0.0, 0.03, 2)),
        heights=tuple(rng.uniform(0.1, 1.0, 3)),
        pitches={**PITCHES, "diagonal": diagonal},
        steps_m=(float(steps[0]), float(steps[1])),
    )
    return sampled_grasps(robot, scene, name, T, sampling=sampling)


def _search(robot: Robot, scene: Scene, poses: Any, line: dict[str, Any], over: Any, rng: np.random.Generator) -> None:
    """Random moves of whatever can be picked to anywhere; the target is tried after each."""
    here = replace(scene, objects=tuple(replace(b, T_world_body=poses[b.name]) for b in scene.objects))
    others = [b.name for b in scene.objects if b.name != scene.target_name]
    while not over():
        motions = Motions(robot, here, settings=UNCONSTRAINED).thorough
        state, made = motions.start(), 0
        while made < MOST_MOVES and not over():
            name, region = str(rng.choice(others)), int(rng.integers(here.regions_n**2))
            done = motions.relocate(state, name, region, rng)
            if not isinstance(done, Done):
                if rng.random() < 0.02:
                    break  # perhaps nothing goes on from here
                continue
            state, made = State(done.after.q, done.after.poses), made + 1
            line["moves"] += 1
            line["targets_tried"] += 1
            if isinstance(motions.retrieve_target(state, rng), Done):
                line["broken"] = f"{scene.target_name} comes out after {made} random moves"
                return


if __name__ == "__main__":
    raise SystemExit(main())
