"""How long plans take on the robot, whether they stop on the way, whether they keep the limits, and what it costs to make them smooth.

Plans scenes of a spec with a policy, and prints one JSON line: `duration_s`, the mean over solved scenes, and `moves`, of how many
relocations; the same waypoints driven from stop to stop with the same limits (`stopping_s`) and with no limit of the jerk (`no_jerk_s`, the
time-optimal bound of the polyline that stops at its corners), and `stopped_ratio`, the duration over that bound; `through_share`, what
would be left of the arm's time at least if it did not stop between motions where no contact changes, their corners rounded as far as it
likes; `stops` inside motions, median and mean; `velocity`, `acceleration`, `jerk`: the largest shares of their limits at 1 kHz; `make_ms`:
processor time to make all trajectories of a plan, and `quickest_ms`, to choose and quicken its ways before, medians; `hand_travel_m` and,
of the moves before the target alone, `relocation_travel_m`; `free_3mm`, `all_3mm`: the share of plans whose free motions, and whose motions
besides grasping and releasing, all keep 3 mm; `straight_ratio`: the joints' way in free motions over the straight joint line;
`off_line_mm`: the furthest that the hand is from its line where it is to move straight. With toppra installed (it is no dependency)
`toppra_ratio`: duration over that of the same paths without a limit of the jerk.

Usage: python benchmarks/trajectories.py [-n 100] [--seed 20261122] [--spec paper] [--robot ur5e] [--policy neural] [--hand-speed 100]
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from kinematics.quintic_spline import evaluate
from kinematics.robots.load import load, to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Scene, State
from kinematics.transforms import Array
from planning.conclusion import hand_travel
from planning.motion.checking.verify import hand_poses
from planning.motion.handling.carry import Done
from planning.motion.pick_place import Motions
from planning.motion.smoothing.blending import choose_speeds, make_corners, write_rows
from planning.motion.trajectory import STRAIGHT, Pace
from planning.plan import Motion, Plan
from planning.policies import make_policy
from planning.retrieval import retrieve
from planning.rules import Rule
from planning.scenes.generation import generate, load_spec

PATH_POINTS = 60
CLEAR_M = 0.003
FREE = ("transit", "transfer")


class Recorded(Motions):
    """Motions that note the waypoints they are asked to make smooth, and how long that takes."""

    def __init__(self, robot: Robot, scene: Scene, pace: Pace) -> None:
        super().__init__(robot, scene, pace=pace)
        self.waypoints, self.seconds, self.quickest_seconds = list[Motion](), 0.0, 0.0

    def quickest(self, found: Sequence[tuple[State, Done]], rng: np.random.Generator) -> list[tuple[State, Done]]:
        began = time.process_time()
        out = super().quickest(found, rng)
        self.quickest_seconds += time.process_time() - began
        return out

    def trajectories(self, state: State, motions: Sequence[Motion]) -> tuple[Motion, ...]:
        began = time.process_time()
        out = super().trajectories(state, motions)
        self.seconds += time.process_time() - began
        self.waypoints += motions
        return out


def shares(robot: Robot, motion: Motion) -> list[float]:
    """The largest shares of the limits of velocity, acceleration and jerk at 1 kHz."""
    assert motion.spline is not None
    at = np.arange(0.0, motion.t_s[-1], 1e-3)
    limits = (robot.velocity, robot.acceleration, robot.jerk)
    return [float((np.abs(evaluate(motion.spline, at, order)) / limit).max()) for order, limit in enumerate(limits, 1)]


def joint_way_s(robot: Robot, q: Array) -> float:
    """The length of waypoints q (K, J) in seconds at full speed."""
    return float((np.abs(np.diff(robot.arm_q(q), axis=0)) / robot.arm_q(robot.velocity)).max(1).sum())


def stops(motion: Motion) -> int:
    """Rows inside a motion at which nothing moves."""
    assert motion.qd is not None
    return int((np.abs(motion.qd[1:-1]).max(1, initial=0.0) < 1e-9).sum())


def from_stop_to_stop(robot: Robot, q: Array, jerk: Array) -> float:
    """Seconds for waypoints q (K, J), stopping at each."""
    q = q[np.append(True, np.abs(np.diff(q, axis=0)).max(1) > 1e-9)]
    if len(q) < 2:
        return 0.0
    t, rows = np.empty(10 * len(q)), np.empty((10 * len(q), 3, q.shape[1]))
    return float(t[write_rows(make_corners(q, robot.velocity, robot.acceleration, jerk, np.ones(q.shape[1])), t, rows) - 1])


def through_s(robot: Robot, motions: Sequence[Motion]) -> tuple[float, float]:
    """Seconds of waypoints that are driven motion by motion, and of the same if the arm ran through where one motion goes over into the
    next without a contact that changes, its corners there rounded as far as it likes: what joining motions could bring at most. Straight
    ways of the hand are taken to be straight in joint space."""
    arm, chains = list(robot.arm_joints), [list[Array]()]
    for m in motions:
        if np.ptp(m.q[:, arm], axis=0).max() < 1e-9:
            chains.append([])
        else:
            chains[-1].append(m.q[:, arm] if m.stage in FREE else m.q[[0, -1]][:, arm])
    parts = [q for chain in chains for q in chain]
    joined = [np.concatenate([chain[0][:1], *(q[1:] for q in chain)]) for chain in chains if chain]
    apart_s, joined_s = (sum(rounded_s(robot, q) for q in ways) for ways in (parts, joined))
    return apart_s, joined_s


def rounded_s(robot: Robot, q: Array) -> float:
    """Seconds along the arm's waypoints q (K, A), the corners rounded as is quickest."""
    q = q[np.append(True, np.abs(np.diff(q, axis=0)).max(1) > 1e-9)]
    return float(choose_speeds(make_corners(q, *robot.arm_limits, np.ones(q.shape[1])))) if len(q) > 1 else 0.0


def off_line_mm(robot: Robot, scene: Scene, motion: Motion) -> float:
    """How far the hand is from its straight line at most."""
    p = hand_poses(robot, scene, motion.at(np.arange(0.0, motion.t_s[-1], 2e-3)))[:, :3, 3]
    along = (p[-1] - p[0]) / np.linalg.norm(p[-1] - p[0])
    return float(1000 * np.linalg.norm((p - p[0]) - np.outer((p - p[0]) @ along, along), axis=1).max())


def toppra_s(robot: Robot, motion: Motion) -> float:
    """Seconds that toppra needs for the same path within the limits of velocity and acceleration."""
    import toppra
    from toppra import algorithm, constraint

    toppra.setup_logging("ERROR")
    q = motion.at(np.linspace(0, motion.t_s[-1], 2000))
    s = np.append(0.0, np.cumsum(np.abs(np.diff(q, axis=0)).max(1)))
    keep = np.append(True, np.diff(s) > 1e-12)
    at = np.linspace(0, s[-1], PATH_POINTS)
    path = toppra.SplineInterpolator(at, np.stack([np.interp(at, s[keep], column[keep]) for column in q.T], axis=1))
    bounds = (np.stack([-limit, limit], axis=1) for limit in (robot.velocity, robot.acceleration))
    limits = [make(b) for make, b in zip((constraint.JointVelocityConstraint, constraint.JointAccelerationConstraint), bounds)]
    found = algorithm.TOPPRA(limits, path, gridpoints=np.linspace(0, s[-1], 4 * PATH_POINTS)).compute_trajectory(0, 0)
    return float("nan") if found is None else float(found.duration)


def clear(plan: Plan, stages: Sequence[str]) -> bool:
    """Whether a plan's motions of these stages all keep 3 mm."""
    return all(m.clearance_m is None or m.clearance_m >= CLEAR_M for m in plan.motions if m.stage in stages)


def plans(args: argparse.Namespace) -> list[tuple[Scene, Plan, Recorded]]:
    robot, spec, out = load(args.robot), load_spec(args.spec), []
    for index in range(args.n):
        scene = generate(spec, robot, to_ref(robot), args.seed, index)
        motions = Recorded(robot, scene, Pace(1.0, args.hand_speed))
        rng = np.random.default_rng([args.seed, index])
        plan = retrieve(scene, make_policy(args.policy, motions), motions, name=args.policy, rule=Rule.DEEP, rng=rng)
        if plan.success:
            out.append((scene, plan, motions))
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=100)
    parser.add_argument("--seed", type=int, default=20261122)
    parser.add_argument("--spec", default="paper")
    parser.add_argument("--robot", default="ur5e")
    parser.add_argument("--policy", default="neural")
    parser.add_argument("--hand-speed", type=float, default=100.0, help="m/s; by default none, to compare with earlier figures")
    args = parser.parse_args()
    robot, solved = load(args.robot), plans(args)
    every = [motion for _, plan, _ in solved for motion in plan.motions]
    names = dict.fromkeys(m.stage for m in every)
    stages = {name: round(sum(m.t_s[-1] for m in every if m.stage == name) / len(solved), 3) for name in names}
    relocations = []
    for scene, plan, _ in solved:
        grasps = [i for i, m in enumerate(plan.motions) if m.stage == "retreat"]
        relocations.append(hand_travel(robot, scene, plan.motions[: grasps[-1] + 1]) if grasps else 0.0)
    worst = np.max([shares(robot, motion) for motion in every], axis=0)
    rigid = np.full_like(robot.jerk, 1e9)
    duration_s = float(np.mean([plan.duration_s for _, plan, _ in solved]))
    no_jerk_s = float(np.mean([sum(from_stop_to_stop(robot, m.q, rigid) for m in r.waypoints) for *_, r in solved]))
    free = [m for *_, r in solved for m in r.waypoints if m.stage in FREE]
    ways = [through_s(robot, r.waypoints) for *_, r in solved]
    found: dict[str, Any] = {
        "robot": args.robot, "spec": args.spec, "policy": args.policy, "scenes": args.n, "solved": len(solved),
        "verified": sum(plan.verified is True for _, plan, _ in solved),
        "moves": round(float(np.mean([sum(m.done for m in plan.moves) for _, plan, _ in solved])), 2),
        "duration_s": round(duration_s, 2),
        "stopping_s": round(float(np.mean([sum(from_stop_to_stop(robot, m.q, robot.jerk) for m in r.waypoints) for *_, r in solved])), 2),
        "no_jerk_s": round(no_jerk_s, 2), "stopped_ratio": round(duration_s / no_jerk_s, 3),
        "through_share": round(sum(t for _, t in ways) / sum(t for t, _ in ways), 3),
        "stops": float(np.median([sum(map(stops, plan.motions)) for _, plan, _ in solved])),
        "stops_mean": round(float(np.mean([sum(map(stops, plan.motions)) for _, plan, _ in solved])), 2),
        "velocity": round(worst[0], 6), "acceleration": round(worst[1], 6), "jerk": round(worst[2], 6),
        "make_ms": round(1000 * float(np.median([r.seconds for *_, r in solved])), 2),
        "quickest_ms": round(1000 * float(np.median([r.quickest_seconds for *_, r in solved])), 2),
        "straight_ratio": round(sum(joint_way_s(robot, m.q) for m in free) / sum(joint_way_s(robot, m.q[[0, -1]]) for m in free), 3),
        "hand_travel_m": round(float(np.mean([plan.hand_travel_m for _, plan, _ in solved])), 3),
        "relocation_travel_m": round(float(np.mean(relocations)), 3),
        "free_3mm": round(float(np.mean([clear(plan, FREE) for _, plan, _ in solved])), 3),
        "all_3mm": round(float(np.mean([clear(plan, (*FREE, *STRAIGHT)) for _, plan, _ in solved])), 3),
        "off_line_mm": round(max(off_line_mm(robot, s, m) for s, plan, _ in solved for m in plan.motions if m.stage in STRAIGHT), 4),
        "rows": int(np.median([sum(len(m.q) for m in plan.motions) for _, plan, _ in solved])),
        "stages_s": stages,
    }  # fmt: skip
    if importlib.util.find_spec("toppra"):
        moving = [m for m in every if (np.ptp(m.q[:, list(robot.arm_joints)], axis=0) > 1e-9).any()]
        pairs = np.array([(m.t_s[-1], toppra_s(robot, m)) for m in moving[:: max(1, len(moving) // 200)]])
        pairs = pairs[np.isfinite(pairs).all(1)]
        found["toppra_ratio"] = round(float(pairs[:, 0].sum() / pairs[:, 1].sum()), 3)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
