"""URScript: one program for a Universal Robots controller, a stream of servoj at 500 Hz; the gripper is two functions to fill in, a
suction cup one."""

from __future__ import annotations

from collections.abc import Sequence

from retrieve_cli.export.steps import ArmStep, GripperStep, Step, check_count

RATE_HZ = 500.0
JOINTS = 6
NEAR_RAD = 0.005
"""The program stops when the arm is not where a trajectory begins, by more than this in some joint."""

FINGERS = (
    "  # Fill in: what moves your gripper, and returns when it is done. A force of 0 is the gripper's own.",
    "  def retrieve_grip(width_m, force_N):",
    '    popup("close the gripper to " + to_str(width_m) + " m with " + to_str(force_N) + " N", blocking=True)',
    "  end",
    "  def retrieve_release(width_m):",
    '    popup("open the gripper to " + to_str(width_m) + " m", blocking=True)',
    "  end",
)
VACUUM = (
    "  # Fill in: what switches your vacuum, and returns when it holds, or has let go.",
    "  def retrieve_vacuum(on):",
    "    set_standard_digital_out(0, on)",
    "    sleep(0.5)",
    "  end",
)


def program(steps: Sequence[Step], scene: str) -> str:
    """A whole URScript program. Raises: InputError for an arm that does not have six joints."""
    check_count(steps, JOINTS, "urscript")
    vacuum = any(isinstance(step, GripperStep) and step.vacuum is not None for step in steps)
    lines = [
        f"# Plan of scene {_comment(scene)}, written by retrieve export. Joints in rad, servoj every {1000 / RATE_HZ:g} ms.",
        "def retrieve_plan():",
        *(VACUUM if vacuum else FINGERS),
        "  def retrieve_check(q):",
        "    here = get_actual_joint_positions()",
        "    i = 0",
        f"    while i < {JOINTS}:",
        f"      if norm(here[i] - q[i]) > {NEAR_RAD}:",
        '        popup("the arm is not where the trajectory begins", error=True, blocking=True)',
        "        halt",
        "      end",
        "      i = i + 1",
        "    end",
        "  end",
    ]
    for step in steps:
        if isinstance(step, ArmStep):
            _, q, _, _ = step.sampled(RATE_HZ)
            lines += [f"  # {', '.join(stage for stage, _ in step.stages)}", f"  retrieve_check({_row(q[0])})"]
            lines += [f"  servoj({_row(row)}, t={1 / RATE_HZ:g}, lookahead_time=0.03, gain=2000)" for row in q[1:]]
            lines.append("  stopj(10.0)")
        elif step.vacuum is not None:
            lines.append(f"  retrieve_vacuum({step.vacuum})" + (f"  # takes {_comment(step.holds)}" if step.holds else ""))
        elif step.holds is not None:
            lines.append(f"  retrieve_grip({step.width_m:.6f}, {step.force_N or 0.0:.1f})  # takes {_comment(step.holds)}")
        else:
            lines.append(f"  retrieve_release({step.width_m:.6f})")
    return "\n".join([*lines, "end", "retrieve_plan()", ""])


def _row(values: Sequence[float]) -> str:
    return "[" + ",".join(f"{v:.9f}" for v in values) + "]"


def _comment(text: str) -> str:
    """A name inside a comment: one line."""
    return " ".join(text.split())
