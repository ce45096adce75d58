"""How a loop's plan ends: the final check, the verdict, the clearances, and the figures of the whole."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import Grasp, Scene
from planning.motion.checking.replay import hand_poses, replayed, with_clearances
from planning.motion.checking.verify import first_touch
from planning.motion.settings import DEFAULTS, MotionSettings
from planning.plan import SCENE, Blocked, Fault, Motion, Move, Plan
from planning.rules import MAX_MOVES
from planning.stopwatch import Stopwatch
from planning.verdict import Settings, Verdict, examine


def conclude(
    robot: Robot,
    scene: Scene,
    reason: Blocked | None,
    moves: Sequence[Move],
    way: Sequence[Motion],
    *,
    name: str,
    rule: str,
    thinking: Stopwatch,
    moving: Stopwatch,
    settings: MotionSettings = DEFAULTS,
    grasp: Grasp | None = None,
    is_truth: bool = True,
    max_moves: int = MAX_MOVES,
) -> Plan:
    """The plan that a loop ends with, after the final check and the verdict, with the clearances measured.

    reason: why the target was not taken, None when it was. grasp: how it was taken, by default the scene's x_g. is_truth: whether
    the scene is as things were when the motions began; otherwise nothing is judged by it. max_moves: how many moves were allowed.
    """
    success = reason is None
    travel = hand_travels(robot, scene, way)
    plan = Plan(
        scene.id, name, str(rule), success, reason, tuple(moves), tuple(way), thinking.seconds, moving.seconds,
        sum(travel, 0.0), objective(scene, moves, success), None, grasp=grasp, settled=scene.settled, max_moves=max_moves,
        relocation_travel_m=sum((length for length, counts in zip(travel, relocating(way)) if counts), 0.0),
    )  # fmt: skip
    if not way:
        return plan
    if not is_truth:
        return replace(plan, verified=True)
    faults: tuple[Fault, ...] = ()
    notes: tuple[Fault, ...] = ()
    with moving:
        sampled = replayed(robot, scene, way)
        touch = first_touch(robot, scene, way, sampled)
        if touch is None:  # all besides contacts is for the verdict to judge
            verdict = _verdict(robot, scene, plan, settings)
            faults, notes = verdict.faults, verdict.notes
        motions = with_clearances(way, sampled)
    plan = replace(plan, motions=motions, motion_time_s=moving.seconds, faults=faults, notes=notes)
    plan = replace(plan, verified=touch is None and not faults)
    return _judged(scene, plan, touch)


def judged_again(robot: Robot, scene: Scene, plan: Plan, settings: MotionSettings) -> Plan:
    """A plan that was verified where all was turned, and is still where the verdict on the scene as it is finds nothing: contacts are the
    same in both."""
    if not plan.verified:
        return plan
    verdict = _verdict(robot, scene, plan, settings)
    plan = replace(plan, faults=verdict.faults, notes=verdict.notes, verified=not verdict.faults)
    return _judged(scene, plan, None)


def _verdict(robot: Robot, scene: Scene, plan: Plan, settings: MotionSettings) -> Verdict:
    """On all besides contacts."""
    return examine(scene, plan, robot, Settings(contact=False, max_tilt_deg=settings.max_tilt_deg))


def _judged(scene: Scene, plan: Plan, touch: Blocked | None) -> Plan:
    """The plan, which fails if it is not verified: touch is why, or its first fault."""
    if plan.verified:
        return plan
    why = touch or Blocked("verify", detail=str(plan.faults[0]))
    return replace(plan, success=False, reason=why, value=objective(scene, plan.moves, False))


def failed(scene: str, detail: str, *, name: str, rule: str) -> Plan:
    """The plan of a scene, told by its id, that is invalid: nothing was tried."""
    return Plan(scene, name, str(rule), False, Blocked(SCENE, detail=detail), (), (), 0.0, 0.0, 0.0, 0.0, None)


def relocating(motions: Sequence[Motion]) -> list[bool]:
    """Which motions the paper counts as travel: those of the relocations, before the target is gone for. Looks are none of them."""
    last = max((i for i, motion in enumerate(motions) if motion.stage == "retreat"), default=-1)
    return [i <= last and motion.stage != "look" for i, motion in enumerate(motions)]


def hand_travel(robot: Robot, scene: Scene, motions: Sequence[Motion], step: float = 0.05) -> float:
    """Length in metres of the hand's path, measured along chords of about `step` rad (or m) in any joint."""
    return sum(hand_travels(robot, scene, motions, step), 0.0)


def hand_travels(robot: Robot, scene: Scene, motions: Sequence[Motion], step: float = 0.05) -> list[float]:
    """The same for each motion."""
    if not motions:
        return []
    q, t_s = (np.concatenate([getattr(motion, name) for motion in motions]) for name in ("q", "t_s"))
    ends = np.cumsum([len(motion.q) for motion in motions])
    parts = np.maximum(1, np.ceil(np.abs(q[1:] - q[:-1]).max(1, initial=0.0) / step)).astype(np.int64)
    parts[ends[:-1] - 1] = 0  # from one motion to the next
    piece = np.repeat(np.arange(len(parts)), parts)
    share = (np.arange(len(piece)) - (np.cumsum(parts) - parts)[piece]) / parts[piece]
    times = t_s[piece] + share * (t_s[piece + 1] - t_s[piece])
    of_each = np.split(times, np.searchsorted(piece, ends[:-1]))
    rows = [motion.at(np.append(some, motion.t_s[-1])) for motion, some in zip(motions, of_each)]
    at = hand_poses(robot, scene, np.concatenate(rows))[:, :3, 3]
    chords, last = np.sqrt(((at[1:] - at[:-1]) ** 2).sum(1)), np.cumsum([len(some) for some in rows])
    return [float(chords[end - len(some) : end - 1].sum()) for some, end in zip(rows, last)]


def objective(scene: Scene, moves: Sequence[Move], success: bool) -> float:
    """The paper's return (eq. 1): the sum over steps of I − d, d = |l_r → object| + |object → region|, over the moves carried out."""
    base = scene.robot.T_world_base[:3, 3]
    ends = [(m.T_world_from[:3, 3], m.T_world_to[:3, 3]) for m in moves if m.done]
    d = [np.linalg.norm(start - base) + np.linalg.norm(end - start) for start, end in ends]
    return float(success) - float(sum(d))
