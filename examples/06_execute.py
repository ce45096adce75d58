"""Execute a plan: check that the arm is where it begins, stream, watch the deviation, stop on a fault, and hand back where it stopped.

    python examples/06_execute.py PLANS.jsonl                    on a simulated controller
    python examples/06_execute.py PLANS.jsonl --rtde 192.168.0.2   on a Universal Robots arm (pip install ur_rtde)

`execute` takes a plan and a robot, an object with three methods. What it returns says where the arm stopped; written into the scene's
`robot.q_start`, it is where `retrieve plan` goes on from.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from planning import Motion, Plan, read_plans

PERIOD_S = 0.002
NEAR_RAD = 0.01  # so near must the arm be to where a motion begins
DEVIATION_RAD = 0.05  # beyond this, in any joint, it is stopped


class Arm(Protocol):
    """What a robot has to offer. q, qd: positions and velocities in the order of the plan's joints, the gripper's left out."""

    def read(self) -> np.ndarray: ...

    def send(self, q: np.ndarray, qd: np.ndarray) -> None: ...

    def grip(self, width_m: float, force_n: float | None) -> None: ...


@dataclass(frozen=True)
class Stopped:
    """How an execution ended: done, or why not, in which motion, how long after its start, and where the arm is (by joint)."""

    done: bool
    why: str | None
    motion: int
    t_s: float
    q: dict[str, float]
    largest_rad: float


def execute(plan: Plan, arm: Arm) -> Stopped:
    """Carry out every motion of a verified plan; stop at the first thing that is not as it should be."""
    if not plan.success or not plan.verified:
        raise ValueError(f"the plan of {plan.scene} is not one to be carried out: success {plan.success}, verified {plan.verified}")
    largest = 0.0
    for number, motion in enumerate(plan.motions):
        columns, names = _arm_columns(motion)
        rows_q, rows_qd = (_sampled(motion, order)[:, columns] for order in (0, 1))
        off = np.abs(arm.read() - rows_q[0]).max()
        if off > NEAR_RAD:
            why = f"the arm is {off:.3f} rad from where {motion.stage} begins"
            return Stopped(False, why, number, 0.0, _here(arm, names), largest)
        if motion.gripper and motion.gripper.before != motion.gripper.after:
            arm.grip(motion.gripper.after.width_m, motion.gripper.after.force_N)
        for k, (q, qd) in enumerate(zip(rows_q, rows_qd)):
            arm.send(q, qd)
            largest = max(largest, float(np.abs(arm.read() - q).max()))
            if largest > DEVIATION_RAD:
                why = f"{motion.stage}: the arm is {largest:.3f} rad from its trajectory"
                return Stopped(False, why, number, k * PERIOD_S, _here(arm, names), largest)
    return Stopped(True, None, len(plan.motions) - 1, float(motion.t_s[-1]), _here(arm, names), largest)


def _here(arm: Arm, names: list[str]) -> dict[str, float]:
    return dict(zip(names, map(float, arm.read())))


def _arm_columns(motion: Motion) -> tuple[list[int], list[str]]:
    gripper = motion.gripper.joint if motion.gripper else None
    columns = [i for i, name in enumerate(motion.joint_names) if name != gripper]
    return columns, [motion.joint_names[i] for i in columns]


def _sampled(motion: Motion, order: int) -> np.ndarray:
    from kinematics.quintic_spline import evaluate

    t = np.append(np.arange(0.0, motion.t_s[-1], PERIOD_S), motion.t_s[-1])
    if motion.spline is None:
        raise ValueError("the plan has waypoints and no trajectories: plan the scene anew")
    return evaluate(motion.spline, t, order)


class SimulatedArm:
    """A controller with a lag, noise in what it reads, a speed limit, and, if told, a collision after so many seconds."""

    def __init__(
        self, q: np.ndarray, *, lag: float = 0.2, noise_rad: float = 1e-4, most_rad_s: float = np.inf, stuck_after_s: float = np.inf
    ):
        self.q, self.lag, self.noise_rad, self.most = np.array(q, float), lag, noise_rad, most_rad_s
        self.stuck_after_s, self.now_s, self.gripped = stuck_after_s, 0.0, list[tuple[float, float | None]]()
        self.rng = np.random.default_rng(0)

    def read(self) -> np.ndarray:
        return self.q + self.rng.normal(0.0, self.noise_rad, self.q.shape)

    def send(self, q: np.ndarray, qd: np.ndarray) -> None:
        self.now_s += PERIOD_S
        if self.now_s < self.stuck_after_s:
            step = (1 - self.lag) * (q - self.q)
            self.q += np.clip(step, -self.most * PERIOD_S, self.most * PERIOD_S)

    def grip(self, width_m: float, force_n: float | None) -> None:
        self.gripped.append((width_m, force_n))


class RtdeArm:
    """A Universal Robots arm through ur_rtde, which is imported when it is asked for. The gripper is yours to fill in."""

    def __init__(self, host: str) -> None:
        import rtde_control
        import rtde_receive

        self._control, self._receive = rtde_control.RTDEControlInterface(host), rtde_receive.RTDEReceiveInterface(host)

    def read(self) -> np.ndarray:
        return np.array(self._receive.getActualQ())

    def send(self, q: np.ndarray, qd: np.ndarray) -> None:
        start = self._control.initPeriod()
        self._control.servoJ(list(q), 0.0, 0.0, PERIOD_S, 0.03, 2000)
        self._control.waitPeriod(start)

    def grip(self, width_m: float, force_n: float | None) -> None:
        input(f"move the gripper to {1000 * width_m:.0f} mm" + (f", {force_n:.0f} N" if force_n else "") + ", then press Enter ")


def main(file: Path, host: str | None = None) -> None:
    for plan in read_plans(file):
        if not plan.success:
            print(f"{plan.scene}: nothing to carry out, {plan.reason}")
            continue
        columns, _ = _arm_columns(plan.motions[0])
        arm: Arm = RtdeArm(host) if host else SimulatedArm(plan.motions[0].q[0, columns])
        end = execute(plan, arm)
        print(f"{plan.scene}: " + ("done" if end.done else f"stopped in motion {end.motion} after {end.t_s:.2f} s: {end.why}"))
        print(f"  largest deviation {1000 * end.largest_rad:.1f} mrad")
        if not end.done:
            print(f'  to go on from there: "q_start": {end.q}')


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), sys.argv[3] if sys.argv[2:3] == ["--rtde"] else None)
