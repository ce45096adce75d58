"""A policy of one's own, on one of the paper's real trials.

    python examples/07_own_policy.py [SCENES.jsonl]

A policy is a pair of functions. `select` ranks the objects to move, `place` ranks the regions to put one in; both see an Observation,
boxes and floor cells, and nothing else. The loop tries them in that order, so a policy need not know what an arm can do.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from perception import Observation
from planning import Motions, Policy, plan_scene, read_scenes
from planning.policies.regions import free_regions

TRIAL = Path(__file__).with_name("02_plum_behind_cylinders.jsonl")


def nearest_object(seen: Observation, rng: np.random.Generator) -> Sequence[str]:
    """select: what stands nearest to the way of the hand, the line from one metre before x_g to x_g, is moved first."""
    goal = seen.grasp.T_world_hand[:2, 3]
    along = seen.grasp.T_world_hand[:2, 2] / np.linalg.norm(seen.grasp.T_world_hand[:2, 2])

    def off_the_way(name: str) -> float:
        offset = seen.boxes[name][:2] - goal
        return float(np.linalg.norm(offset - np.clip(offset @ along, -1.0, 0.0) * along))

    return sorted(seen.movable, key=off_the_way)


def outermost_region(seen: Observation, name: str, rng: np.random.Generator) -> Sequence[int]:
    """place: free cells far from the target, to the left or right of it."""
    free = free_regions(seen, name)
    sideways = np.abs(seen.regions[free, 1] - seen.boxes[seen.target][1])
    return [int(i) for i in free[np.argsort(-sideways, kind="stable")]]


def side(motions: Motions) -> Policy:
    return Policy(nearest_object, outermost_region)


def main(file: Path = TRIAL) -> None:
    for scene in read_scenes(file):
        plan = plan_scene(scene, side, on_step=lambda step: print(f"  {step}"))
        print(f"{scene.id}: " + ("solved" if plan.success else f"not solved, {plan.reason}"))
        for move in plan.moves:
            x, y, _ = move.T_world_to[:3, 3]
            print(f"  {move.object} to ({x:.2f}, {y:.2f})" + ("" if move.done else f": {move.reason}"))
        print(f"  {len(plan.motions)} motions that take the arm {plan.duration_s:.0f} s; the hand travels {plan.hand_travel_m:.1f} m")
        print(f"  verified: {plan.verified}")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
