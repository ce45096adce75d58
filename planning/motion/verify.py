"""The last word on a plan: FCL, at a resolution at which no point of the arm moves more than 2 mm between two samples of its trajectory.

It works on states built again from the motions themselves, every object where they say it is, and asks another engine than the planner:
FCL. Pairs that the sphere covers prove apart (kinematics.collision.robot_model) are not asked about.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from kinematics.collision.broad_phase import BroadPhase
from kinematics.collision.fcl_check import Verdict
from kinematics.quintic_spline import extremes
from kinematics.robots.joints import WITHIN
from kinematics.robots.names import check_names
from kinematics.robots.robot import Robot
from kinematics.robots.start import start_q
from kinematics.scene import Held, Scene
from kinematics.transforms import Array, angle_between, inverse
from planning.motion.replay import hand_poses
from planning.motion.sampling import samples, while_fingers_move
from planning.motion.settings import MOST_TILT_DEG, tilt_limit_deg
from planning.plan import Blocked, Motion

SAME_M, SAME_RAD = 1e-3, 1e-3  # how far an object may jump when the hand takes it
SAME_DEG = 0.01  # what a tilt may exceed its limit by, for rounding


def verify(
    robot: Robot,
    scene: Scene,
    motions: Sequence[Motion],
    *,
    max_tilt_deg: float = MOST_TILT_DEG,
    bodies: BroadPhase | None = None,
    sampled: Callable[[Motion], Array] | None = None,
) -> Blocked | None:
    """Replay motions from the scene's first state. None when all is well, else the first thing that is not.

    Checked: the scene's q_start, joint limits, no gap between motions, held objects taken from where they stand, kept as they are held and
    upright, and no contact outside the allowed ones. max_tilt_deg: how far what is carried may lean, where the object itself does not say.
    bodies: the scene's, packed before. sampled: `sampling.samples` of this scene's motions, if they are known already.
    Raises: ValueError when two things have one name, for then nobody can tell what may touch what.
    """
    check_names(robot, scene)
    verdict, sieve = Verdict(robot, scene), bodies or BroadPhase(robot, scene)
    poses, start = scene.poses(), start_q(robot, scene.robot)
    if start is not None and len(motions) and np.abs(motions[0].q[0] - start).max() > WITHIN:
        return Blocked("verify", detail=f"motion 0, {motions[0].stage}: it does not begin where the scene says that the arm is")
    before: Motion | None = None
    for number, motion in enumerate(motions):
        where = f"motion {number}, {motion.stage}"
        if not _within_limits(robot, motion):
            return Blocked("verify", detail=f"{where}: a joint leaves its limits")
        if before is not None and np.abs(before.q[-1] - motion.q[0]).max() > 1e-9:
            return Blocked("verify", detail=f"{where}: it does not start where the one before ends")
        if before is not None and before.held:
            poses[before.held.body] = hand_poses(robot, scene, before.q[-1]) @ before.held.T_hand_body
        if motion.held and motion.held.body in poses:
            jump = inverse(poses.pop(motion.held.body)) @ hand_poses(robot, scene, motion.q[0]) @ motion.held.T_hand_body
            if np.linalg.norm(jump[:3, 3]) > SAME_M or angle_between(np.eye(3), jump[:3, :3]) > SAME_RAD:
                return Blocked("verify", "hand", motion.held.body, detail=f"{where}: the object is not where the hand takes it")
        rows = samples(robot, scene, motion) if sampled is None else sampled(motion)
        if motion.held and (leans := _leans_too_far(robot, scene, motion.held, rows, max_tilt_deg)):
            return Blocked("verify", "hand", motion.held.body, detail=f"{where}: {leans}")
        for some in while_fingers_move(robot, rows):
            judged = sieve.judge(some, poses, motion.held, motion.allowed_contacts)
            found = verdict.first_contacts(some, poses, motion.held, motion.allowed_contacts, judged)
            if found is not None:
                worst = found[1][0]
                return Blocked("verify", worst.a, worst.b, worst.depth_m, where)
        before = motion
    return None


def _within_limits(robot: Robot, motion: Motion) -> bool:
    """Whether no joint leaves its limits anywhere on a motion's way."""
    low, high = robot.lower - 1e-9, robot.upper + 1e-9
    if not (np.isfinite(motion.q).all() and (motion.q >= low).all() and (motion.q <= high).all()):
        return False
    spline = motion.spline
    if spline is None or ((spline.control >= low).all() and (spline.control <= high).all()):  # it stays within its coefficients
        return True
    least, most = extremes(spline, 0, 1e-10)
    return bool((least >= low).all() and (most <= high).all())


def _leans_too_far(robot: Robot, scene: Scene, held: Held, q: Array, max_tilt_deg: float) -> str | None:
    """How far a held object leans from how it stood, in words, when that is too far at one of configurations q (N, J)."""
    body = scene.body(held.body)
    limit = tilt_limit_deg(body, max_tilt_deg)
    if limit >= MOST_TILT_DEG:
        return None
    axis = held.T_hand_body[:3, :3] @ body.T_world_body[2, :3]
    leans = float(np.degrees(np.arccos(np.clip((hand_poses(robot, scene, q)[:, 2, :3] @ axis).min(), -1.0, 1.0))))
    return f"it leans by {leans:.1f}°, and {limit:g}° is its limit" if leans > limit + SAME_DEG else None
