"""The last word on a plan: FCL, at a resolution at which no point of the arm moves more than 2 mm between two samples of its trajectory.

It works on states built again from the motions themselves, every object where they say it is, and asks another engine than the planner:
FCL. Pairs that the sphere covers prove apart (kinematics.collision.robot_model) are not asked about.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kinematics.collision.broad_phase import broad_phase
from kinematics.collision.fcl_check import Verdict
from kinematics.quintic_spline import extremes
from kinematics.robots.joints import WITHIN
from kinematics.robots.names import check_names
from kinematics.robots.robot import Robot
from kinematics.robots.start import start_q
from kinematics.scene import Held, Scene
from kinematics.transforms import Array, angle_between, inverse
from planning.motion.checking.replay import Replayed, hand_poses, replayed
from planning.motion.settings import MOST_TILT_DEG, tilt_limit_deg
from planning.plan import Blocked, Motion

SAME_M, SAME_RAD = 1e-3, 1e-3  # how far an object may jump when the hand takes it
SAME_DEG = 0.01  # what a tilt may exceed its limit by, for rounding


def verify(
    robot: Robot, scene: Scene, motions: Sequence[Motion], *, max_tilt_deg: float = MOST_TILT_DEG, way: Replayed | None = None
) -> Blocked | None:
    """Replay motions from the scene's first state. None when all is well, else the first thing that is not.

    Checked: the scene's q_start, joint limits, no gap between motions, held objects taken from where they stand, kept as they are held and
    upright, and no contact outside the allowed ones. max_tilt_deg: how far what is carried may lean, where the object itself does not say.
    way: the motions as `replayed` has them, if that is known already.
    Raises: ValueError when two things have one name, for then nobody can tell what may touch what.
    """
    check_names(robot, scene)
    start = start_q(robot, scene.robot)
    if start is not None and len(motions) and np.abs(motions[0].q[0] - start).max() > WITHIN:
        return Blocked("verify", detail=f"motion 0, {motions[0].stage}: it does not begin where the scene says that the arm is")
    sound, wrong = _sound(robot, scene, motions)
    motions = motions[:sound]
    way = way or replayed(robot, scene, motions)
    for number, (motion, rows) in enumerate(zip(motions, way.rows)):
        if motion.held and (leans := _leans_too_far(robot, scene, motion.held, rows, max_tilt_deg)):
            sound, wrong = number, Blocked("verify", "hand", motion.held.body, detail=f"{_where(number, motion)}: {leans}")
            break
    return first_touch(robot, scene, motions[:sound], way) or wrong


def first_touch(robot: Robot, scene: Scene, motions: Sequence[Motion], way: Replayed) -> Blocked | None:
    """The first contact outside the allowed ones, and how deep it is; None when there is none.

    way: the motions as `replayed` has them, and perhaps more of them, which are left out.
    """
    kept = sum(number < len(motions) for number in way.number)
    found = Verdict(robot, scene).along(way.packed.stretches[:kept], broad_phase(way.packed)[:kept])
    if found is None:
        return None
    number, worst = way.number[found[0]], found[2][0]
    return Blocked("verify", worst.a, worst.b, worst.depth_m, _where(number, motions[number]))


def _where(number: int, motion: Motion) -> str:
    return f"motion {number}, {motion.stage}"


def _sound(robot: Robot, scene: Scene, motions: Sequence[Motion]) -> tuple[int, Blocked | None]:
    """How many motions keep to the joints' limits, begin where the one before ends and take what is there; and what the next one does."""
    within = next((number for number, motion in enumerate(motions) if not _within_limits(robot, motion)), len(motions))
    ends = [motion.q[[0, -1]] for motion in motions[:within]]
    T_hand, poses = hand_poses(robot, scene, np.concatenate(ends)) if ends else np.zeros((0, 4, 4)), scene.poses()
    before: Motion | None = None
    for number, motion in enumerate(motions[:within]):
        where = _where(number, motion)
        if before is not None and np.abs(before.q[-1] - motion.q[0]).max() > 1e-9:
            return number, Blocked("verify", detail=f"{where}: it does not start where the one before ends")
        if before is not None and before.held:
            poses[before.held.body] = T_hand[2 * number - 1] @ before.held.T_hand_body
        if motion.held:
            jump = inverse(poses.pop(motion.held.body)) @ T_hand[2 * number] @ motion.held.T_hand_body
            if np.linalg.norm(jump[:3, 3]) > SAME_M or angle_between(np.eye(3), jump[:3, :3]) > SAME_RAD:
                return number, Blocked("verify", "hand", motion.held.body, detail=f"{where}: the object is not where the hand takes it")
        before = motion
    if within < len(motions):
        return within, Blocked("verify", detail=f"{_where(within, motions[within])}: a joint leaves its limits")
    return within, None


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
