"""Tables of numbers: CSV at any rate, Franka's rows at 1 kHz, NumPy arrays."""

from __future__ import annotations

import json
from collections.abc import Sequence
from io import BytesIO, StringIO

import numpy as np

from kinematics.transforms import Array
from retrieve_cli.export.steps import ArmStep, GripperStep, Step, check_count

FRANKA_HZ = 1000.0
FRANKA_JOINTS = 7
FORMAT = ".12g"


def csv(steps: Sequence[Step], rate_hz: float) -> str:
    """One row an instant over the whole plan: time, step, stage, position, velocity, acceleration of each joint, gripper's command.

    While the fingers move, the arm's row is repeated at both ends of the time that the plan gives them.
    """
    t, step, stage, q, qd, qdd, grip = _whole(steps, rate_hz)
    joints = _joints(steps)
    out = StringIO()
    units = [f"{name}_{what}" for what in ("rad_or_m", "per_s", "per_s2") for name in joints]
    out.write(",".join(["t_s", "step", "stage", *units, "gripper_rad_or_m"]) + "\n")
    for k in range(len(t)):
        numbers = (*q[k], *qd[k], *qdd[k], grip[k])
        out.write(f"{t[k]:{FORMAT}},{step[k]},{stage[k]}," + ",".join(f"{x:{FORMAT}}" for x in numbers) + "\n")
    return out.getvalue()


def franka(steps: Sequence[Step]) -> tuple[str, str]:
    """Rows for a 1 kHz control loop, seven positions and seven velocities each, and the gripper's commands as JSON Lines.

    A command comes after the row that it names, -1 for one before the first, and the loop waits there until the gripper is done.
    Raises: InputError for another arm.
    """
    check_count(steps, FRANKA_JOINTS, "franka")
    out, commands, row = StringIO(), list[str](), 0
    for step in steps:
        if isinstance(step, GripperStep):
            told = {"width_m": step.width_m, "force_N": step.force_N} if step.vacuum is None else {"vacuum": step.vacuum}
            commands.append(json.dumps({"after_row": row - 1, **told, "holds": step.holds}))
            continue
        _, q, qd, _ = step.sampled(FRANKA_HZ)
        for position, velocity in zip(q, qd):
            out.write(" ".join(f"{x:{FORMAT}}" for x in (*position, *velocity)) + "\n")
        row += len(q)
    return out.getvalue(), "".join(c + "\n" for c in commands)


def npz(steps: Sequence[Step], rate_hz: float | None, scene: str) -> bytes:
    """t_s (N,), step (N,), stage (N,), q, qd, qdd (N, A), gripper (N,), joint_names (A,), scene; without a rate the plan's own rows."""
    t, step, stage, q, qd, qdd, grip = _whole(steps, rate_hz)
    buffer = BytesIO()
    np.savez(
        buffer, t_s=t, step=step, stage=np.array(stage), q=q, qd=qd, qdd=qdd, gripper=grip, joint_names=np.array(_joints(steps)),
        scene=np.array(scene),
    )  # fmt: skip
    return buffer.getvalue()


def _joints(steps: Sequence[Step]) -> tuple[str, ...]:
    return next((s.joints for s in steps if isinstance(s, ArmStep)), ())


def _whole(steps: Sequence[Step], rate_hz: float | None) -> tuple[Array, list[int], list[str], Array, Array, Array, Array]:
    """All steps one after the other, with the time that each begins added."""
    t, q, qd, qdd, grip = list[Array](), list[Array](), list[Array](), list[Array](), list[Array]()
    number, stage = list[int](), list[str]()
    start, value = 0.0, float("nan")
    at = next((s.q[0] for s in steps if isinstance(s, ArmStep)), np.zeros(0))
    for i, step in enumerate(steps):
        if isinstance(step, ArmStep):
            times, *rows = (step.t_s, step.q, step.qd, step.qdd) if rate_hz is None else step.sampled(rate_hz)
            names = [[name for name, begins in step.stages if begins <= x + 1e-12][-1] for x in times]
            at, duration = rows[0][-1], float(step.t_s[-1])
        else:
            value = step.value
            if step.duration_s == 0.0:  # the fingers move beside the arm's next step
                continue
            times, rows = np.array([0.0, step.duration_s]), [np.stack([at, at]), np.zeros((2, len(at))), np.zeros((2, len(at)))]
            names, duration = ["grasp" if step.holds else "open"] * 2, step.duration_s
        t.append(start + times)
        for table, block in zip((q, qd, qdd), rows):
            table.append(block)
        number += [i] * len(times)
        stage += names
        grip.append(np.full(len(times), value))
        start += duration
    return np.concatenate(t), number, stage, np.concatenate(q), np.concatenate(qd), np.concatenate(qdd), np.concatenate(grip)
