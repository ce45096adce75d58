"""What a plan tells the gripper: it is its joint, where that is, as wide as it then is, and as hard as it can close."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.robots.hands.opening import Opening
from kinematics.robots.robot import Robot
from planning.plan import GripperState, Motion
from planning.verdict.faults import Fault
from planning.verdict.hand import Hand

GRIPPER = 1e-4  # rad or m, by which the value that is told may differ from where the joint is
WIDTH_M = 5e-4  # by which the width that a gripper is told may differ from the one that it then has
ROUNDED = 1e-3  # of a force, by which what is told may be larger


@dataclass(frozen=True, eq=False)
class _Told:
    """What motion `number` tells the gripper. when: "before" it, or "after" it, at its end, in the table's row `row`; holds: whether the
    hand holds something then."""

    number: int
    motion: Motion
    joint: str
    when: str
    row: int
    state: GripperState
    holds: bool

    def fault(self, words: str, amount: float | None = None) -> Fault:
        return Fault(self.motion.stage, (), f"motion {self.number} tells {words}", amount)


def _told(motions: Sequence[Motion]) -> Iterator[_Told]:
    held = [False, *(m.held is not None for m in motions), False]
    for number, (motion, before, during, after) in enumerate(zip(motions, held, held[1:], held[2:])):
        if motion.gripper is not None:
            joint, at_first, at_last = motion.gripper.joint, motion.gripper.before, motion.gripper.after
            yield _Told(number, motion, joint, "before", 0, at_first, before or during)
            yield _Told(number, motion, joint, "after", -1, at_last, during or after)


def place_faults(motions: Sequence[Motion]) -> list[Fault]:
    """What the gripper is told before a motion and for its end is where its joint is then."""
    out = []
    for told in _told(motions):
        names = told.motion.joint_names
        if told.joint not in names:
            if told.when == "before":  # once is enough
                out.append(told.fault(f"a gripper's joint {told.joint!r}, which is none of its joints"))
            continue
        is_at = float(told.motion.q[told.row, names.index(told.joint)])
        off = abs(told.state.value - is_at)
        if not off <= GRIPPER:
            out.append(told.fault(f"the gripper {told.state.value:.4g} {told.when} it, and {told.joint} is at {is_at:.4g}", off))
    return out


def width_faults(motions: Sequence[Motion], opening: Opening) -> list[Fault]:
    """The width that the gripper is told is the one that it has there, and no wider than where the plan has its joint."""
    out = []
    for told in _told(motions):
        stands_m, closes_to_m = opening.width_at(told.state.value), opening.width_at(_command(told.state))
        said_m = max(told.state.width_m, float(opening.width_m[0]))  # what it can't close further
        off = max(abs(said_m - closes_to_m), closes_to_m - stands_m)
        if not off <= WIDTH_M:
            words = f"the gripper a width of {1000 * told.state.width_m:.1f} mm {told.when} it"
            joint = f"its joint is told {1000 * closes_to_m:.1f} mm and stands at {1000 * stands_m:.1f} mm"
            out.append(told.fault(f"{words}; {joint}", off))
    return out


def told_faults(motions: Sequence[Motion], robot: Robot) -> list[Fault]:
    """The gripper that is told is the robot's, it is told a force while it holds, and to close further than the plan has it only there."""
    out, own = [], robot.joint_names[robot.gripper_joint]
    width_at, tells_force = robot.opening.width_at, robot.grip_force_N and not robot.opening.cup_m
    for told in _told(motions):
        if told.joint != own and told.joint in told.motion.joint_names:
            if told.when == "before":  # once is enough
                out.append(told.fault(f"a gripper's joint {told.joint!r}, and the gripper's is {own!r}"))
            continue
        closes_to_m = width_at(_command(told.state))
        if not told.holds and closes_to_m < width_at(told.state.value) - WIDTH_M:
            words = f"the gripper to close to {1000 * closes_to_m:.1f} mm {told.when} it, and it holds nothing there"
            out.append(told.fault(words, closes_to_m))
        if told.holds and tells_force and not told.state.force_N:
            out.append(told.fault(f"the gripper no force {told.when} it, and it holds something there"))
    return out


def force_faults(motions: Sequence[Motion], robot: Robot, hand: Hand) -> list[Fault]:
    """No gripper of fingers is told a larger force than it has by its data sheet or, where there is none, by its URDF."""
    out, sheet_N = list[Fault](), robot.most_grip_force_N
    for told in _told(motions) if not robot.opening.cup_m else ():
        most_N, force_N = urdf_force_N(hand, told.state.value) if sheet_N is None else sheet_N, told.state.force_N or 0.0
        if force_N > (1 + ROUNDED) * most_N:
            why = "its data sheet gives" if sheet_N is not None else f"the effort of {told.joint} in the URDF comes to"
            out.append(told.fault(f"the gripper a force of {force_N:.4g} N {told.when} it, and {why} {most_N:.4g} N at most", force_N))
    return out


def urdf_force_N(hand: Hand, value: float) -> float:
    """What the effort of the gripper's joint comes to between the pads at a value of it, in N, by virtual work: force · change of width =
    effort · change of value. Infinite where the URDF gives no effort."""
    order = np.argsort(hand.values)
    values, widths = hand.values[order], hand.widths[order]
    change = float(np.interp(value, values, np.abs(np.gradient(widths, values))))
    return float(np.divide(hand.arm.effort[hand.gripper], change))


def _command(state: GripperState) -> float:
    """The value that the joint is told."""
    return state.value if state.command is None else state.command
