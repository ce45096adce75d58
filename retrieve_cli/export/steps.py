"""A plan as what a controller does one after the other: trajectories of the arm, and commands to the gripper between them.

Motions of the arm that follow one another without a gripper's command between them are one trajectory: each starts and ends at rest, so the
next may begin where the one before ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from kinematics.errors import InputError
from kinematics.quintic_spline import QuinticSpline, evaluate, hermite
from kinematics.robots.hands.suction import ON_M, SUCTION
from kinematics.transforms import Array
from planning.plan import Motion, Plan, jump

STILL = 1e-9  # rad or m that a joint which stands still may move


@dataclass(frozen=True, eq=False)
class ArmStep:
    """One trajectory of the arm, from rest to rest. joints: A names; t_s (K,) from 0, rising; q, qd, qdd (K, A), rad and m.

    Between two rows runs the quintic Hermite spline. stages: the motions that it consists of, and when each begins.
    """

    joints: tuple[str, ...]
    t_s: Array
    q: Array
    qd: Array
    qdd: Array
    stages: tuple[tuple[str, float], ...]

    @property
    def spline(self) -> QuinticSpline:
        """The trajectory: a quintic Hermite spline through the rows."""
        return hermite(self.t_s, self.q, self.qd, self.qdd)

    def sampled(self, rate_hz: float) -> tuple[Array, Array, Array, Array]:
        """Times (N,) and position, velocity, acceleration (N, A), 1 / rate apart; the last row is the trajectory's end."""
        end = float(self.t_s[-1])
        t = np.append(np.arange(0.0, end - 0.5 / rate_hz, 1.0 / rate_hz), end)
        q, qd, qdd = (evaluate(self.spline, t, order) for order in range(3))
        return t, q, qd, qdd


@dataclass(frozen=True)
class GripperStep:
    """One command to the gripper: its joint and value, in rad or m; the width between the pads; how hard to close (None: as it is).

    holds: what is in the hand afterwards, None for nothing. duration_s: how long the plan gives the fingers while the arm stands; 0 when
    they move while the arm makes its next step, which is free whether they are done before it begins or only at its end.
    """

    joint: str
    value: float
    width_m: float
    force_N: float | None
    holds: str | None
    duration_s: float

    @property
    def vacuum(self) -> bool | None:
        """Whether a suction cup's vacuum is on afterwards; None where fingers move."""
        return None if self.joint != SUCTION else self.value > ON_M / 2


Step = ArmStep | GripperStep


def steps(plan: Plan, joints: Sequence[str] | None = None) -> list[Step]:
    """What a plan's robot does, in order. joints: the arm's joints in the order that the controller wants, by default the plan's.

    Raises: InputError for a plan without trajectories (version 1, or not successful), for one with a motion that does not begin where the
    one before it ended (a controller would jump, or stop), and for joints that are not the arm's.
    """
    if not plan.motions:
        raise InputError(f"{plan.scene}: the plan has no motions" + (f": {plan.reason}" if plan.reason else ""))
    missing = next((m.stage for m in plan.motions if m.qd is None or m.qdd is None or m.gripper is None), None)
    if missing is not None:
        raise InputError(f"{plan.scene}: {missing}: has waypoints and no trajectory; plan the scene anew, `retrieve plan` writes plan@2")
    _check_joined(plan)
    names, grip = plan.motions[0].joint_names, {m.gripper.joint for m in plan.motions if m.gripper}
    arm = _arm_joints(plan, names, grip, joints)
    columns = [names.index(name) for name in arm]
    out: list[Step] = _opened(plan.motions[0])
    for motion in plan.motions:
        arm_moves = np.ptp(motion.q[:, columns], axis=0).max() > STILL
        if motion.gripper and motion.gripper.before.value != motion.gripper.after.value:
            after, held = motion.gripper.after, _holds(plan, motion)
            seconds = 0.0 if arm_moves else float(motion.t_s[-1])
            value = after.value if after.command is None else after.command
            out.append(GripperStep(motion.gripper.joint, value, after.width_m, after.force_N, held, seconds))
        if arm_moves:
            _append_arm(out, motion, arm, columns)
    return out


def _opened(first: Motion) -> list[Step]:
    """Where the plan has the gripper at its beginning, which nobody else may have told it; nothing where it is told at once, anyway."""
    told = first.gripper
    if told is None or told.before.value != told.after.value:
        return []
    at = told.before
    held = first.held.body if first.held else None
    return [GripperStep(told.joint, at.value if at.command is None else at.command, at.width_m, at.force_N, held, 0.0)]


def check_count(steps: Sequence[Step], count: int, to: str) -> None:
    """Raises: InputError for an arm of another number of joints; where the plan moves as many, for another arm stands still, it says how
    these alone are written, or else which other forms do."""
    arm = [step for step in steps if isinstance(step, ArmStep)]
    joints = arm[0].joints if arm else ()
    if not arm or len(joints) == count:
        return
    moved = [name for i, name in enumerate(joints) if any(np.ptp(step.q[:, i]) > STILL for step in arm)]
    mend = f"--joints {','.join(moved)} writes those that it moves" if len(moved) == count else "--to ros2, csv and npz take any number"
    raise InputError(f"export: --to {to} is for arms with {count} joints, and this plan has {len(joints)}: {mend}")


def _check_joined(plan: Plan) -> None:
    """Each motion has the joints of the one before, and begins where that ended. Raises InputError."""
    for before, motion in pairwise(plan.motions):
        if motion.joint_names != before.joint_names:
            raise InputError(f"{plan.scene}: {motion.stage}: has other joints than the motion before it")
        if (jumped := jump(before.q[-1], motion.q[0])) is not None:
            worst, far = jumped
            raise InputError(
                f"{plan.scene}: {motion.stage}: starts {far:.3g} from where {motion.joint_names[worst]} ended before; was the plan edited? "
                "retrieve verify judges it, and retrieve plan makes it anew"
            )


def _arm_joints(plan: Plan, names: Sequence[str], gripper: set[str], joints: Sequence[str] | None) -> tuple[str, ...]:
    moved = [n for i, n in enumerate(names) if n not in gripper and any(np.ptp(m.q[:, i]) > STILL for m in plan.motions)]
    own = tuple(n for n in names if n not in gripper)
    if joints is None:
        return own
    unknown = [j for j in joints if j not in own]
    if unknown:
        raise InputError(f"--joints: {unknown[0]!r} is no joint of the arm; the plan {plan.scene} has {', '.join(own)}")
    if len(set(joints)) < len(joints):
        raise InputError("--joints: a joint stands there twice")
    left = [n for n in moved if n not in joints]
    if left:
        raise InputError(f"--joints: {left[0]!r} is missing, and the plan {plan.scene} moves it")
    return tuple(joints)


def _append_arm(out: list[Step], motion: Motion, joints: tuple[str, ...], columns: list[int]) -> None:
    assert motion.qd is not None
    assert motion.qdd is not None
    q, qd, qdd = (rows[:, columns] for rows in (motion.q, motion.qd, motion.qdd))
    last = out[-1] if out else None
    if not isinstance(last, ArmStep):
        out.append(ArmStep(joints, motion.t_s - motion.t_s[0], q, qd, qdd, ((motion.stage, 0.0),)))
        return
    start = float(last.t_s[-1])
    t = start + motion.t_s[1:] - motion.t_s[0]
    joined = [np.concatenate([before, rows[1:]]) for before, rows in ((last.q, q), (last.qd, qd), (last.qdd, qdd))]
    stages = (*last.stages, (motion.stage, start))
    out[-1] = ArmStep(joints, np.concatenate([last.t_s, t]), joined[0], joined[1], joined[2], stages)


def _holds(plan: Plan, motion: Motion) -> str | None:
    """What is in the hand after the fingers have moved: what the next motion holds."""
    after = plan.motions[plan.motions.index(motion) + 1 :]
    return after[0].held.body if after and after[0].held else None
