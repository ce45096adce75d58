"""`retrieve export`: plans as files that a controller takes, a folder a plan."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from kinematics.errors import InputError, choose
from kinematics.names import free_name
from planning.io.files import read_plans
from planning.io.outputs import alone_in, naming, replacing, write_text
from planning.plan import Plan
from retrieve_cli.robot_options import NO_OPTIONS, RobotOptions, other_robot
from retrieve_cli.terminal import announce_first_run, say

FORMATS = ("ros2", "urscript", "franka", "csv", "npz")


def run(
    *,
    plans: Path | None,
    to: str,
    out: Path,
    rate_hz: float | None = None,
    joints: str | None = None,
    scenes: Path | None = None,
    limits: Path | None = None,
    robot: RobotOptions = NO_OPTIONS,
    unverified: bool = False,
) -> int | None:
    """Write every successful plan of a file below `out`; those that failed are named.

    scenes: what the plans were made for; each is judged anew by its scene before it is written, whatever it says of itself. limits and
    robot: by which they were made, where the scenes don't say so. Raises: InputError when none is left, for a plan that is not verified
    or is judged to be false, and for one that does not fit the format.
    """
    choose("format", to, FORMATS)
    if rate_hz is not None and to not in ("csv", "npz"):
        raise InputError(f"export: --rate is for csv and npz; {to} has its own")
    if rate_hz is not None and not 1 <= rate_hz <= 10_000:
        raise InputError(f"export: --rate: {rate_hz:g} is not within 1 to 10000 Hz")
    wanted = None if joints is None else [name.strip() for name in joints.split(",")]
    if scenes is not None and unverified:
        raise InputError("export: --scenes refuses what --unverified would export; leave one of them out")
    if scenes is None and (limits is not None or robot.given):
        raise InputError(f"export: {'--limits' if limits else '--robot'} is what --scenes judges by; name the scenes, too")
    if scenes is not None and str(scenes) == "-" and (plans is None or str(plans) == "-"):
        raise InputError("export: plans and scenes can't both come from stdin; give one of them as a file")
    check = _take_its_word if scenes is None else _judge_by(scenes, limits, robot)
    with alone_in(out):
        _export_all(plans, to, out, rate_hz, wanted, _export_any if unverified else check)
    return None


Check = Callable[[str, Plan], None]
"""Raises InputError for a plan, and where it stands, that is not to be exported."""


def _export_any(where: str, plan: Plan) -> None:
    pass


def _take_its_word(where: str, plan: Plan) -> None:
    if not plan.verified:
        raise InputError(f"{where}: the plan of {plan.scene} is not verified; --unverified exports it all the same, at your own risk")


def _judge_by(scenes: Path, limits: Path | None, robot: RobotOptions) -> Check:
    """A check that passes a verdict of its own."""
    from planning.io.settling import NOISE_M
    from planning.verdict import Settings
    from retrieve_cli.verify import by_id, examined

    announce_first_run()
    known, refused = by_id(scenes, NOISE_M)

    def check(where: str, plan: Plan) -> None:
        if plan.scene not in known:
            raise InputError(f"{where}: " + refused.get(plan.scene, f"none of the {len(known)} scenes in {scenes} is {plan.scene}"))
        scene = known[plan.scene]
        if robot.given:
            scene = replace(scene, robot=other_robot(scene.robot, robot, where))
        faults = examined(Settings(), None if limits is None else str(limits), (where, scene, plan, None)).faults
        if faults:
            more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
            raise InputError(f"{where}: the plan of {plan.scene} is false: {faults[0]}{more}; retrieve verify --json lists every fault")

    return check


def _export_all(plans: Path | None, to: str, out: Path, rate_hz: float | None, joints: list[str] | None, check: Check) -> None:
    names, failed = set[str](), list[str]()
    for where, plan in read_plans(plans, "export"):
        if not plan.success:
            failed.append(f"{where}: the plan of {plan.scene} failed ({plan.reason}); there is nothing to carry out")
            say(failed[-1])
            continue
        check(where, plan)
        name = free_name(re.sub(r"[^\w.-]+", "_", plan.scene).strip(".") or "plan", names)
        names.add(name)
        folder = out / name
        with alone_in(folder), naming(folder):
            written = export(plan, to, folder, rate_hz, joints)
        say(f"{plan.scene}: {len(written)} file{'' if len(written) == 1 else 's'} in {folder}")
    if not names:
        raise InputError(failed[0] if failed else "export: there is no plan to export")


def export(plan: Plan, to: str, folder: Path, rate_hz: float | None = None, joints: list[str] | None = None) -> list[Path]:
    """Write one plan into a folder that exists, and return the files.

    Raises: InputError as `steps` does, and for an arm that doesn't fit.
    """
    from retrieve_cli.export import ros2, tables, urscript
    from retrieve_cli.export.steps import steps

    todo = steps(plan, joints)
    match to:
        case "ros2":
            return ros2.write(folder, todo, plan.scene)
        case "urscript":
            return [_text(folder / "plan.script", urscript.program(todo, plan.scene))]
        case "franka":
            rows, commands = tables.franka(todo)
            return [_text(folder / "trajectory.txt", rows), _text(folder / "gripper.jsonl", commands)]
        case "csv":
            return [_text(folder / "trajectory.csv", tables.csv(todo, rate_hz or 1000.0))]
        case _:
            with replacing(folder / "trajectory.npz") as part:
                part.write_bytes(tables.npz(todo, rate_hz, plan.scene))
            return [folder / "trajectory.npz"]


def _text(file: Path, text: str) -> Path:
    write_text(file, text)
    return file
