"""`retrieve robots`: the named robots, what was understood of one or of a URDF of one's own, and the joined, cleaned URDF."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kinematics.errors import InputError, blame, choose
from planning.io.outputs import write_text
from retrieve_cli.terminal import say, show

if TYPE_CHECKING:
    from kinematics.robots.robot import Robot

SHOWN = 12
"""So many pairs of links that are not looked at are listed for the reader; --json has all."""


def run(
    *,
    name: str | None,
    hand_frame: str | None,
    gripper_joint: str | None,
    tool: Path | None,
    at: str | None,
    urdf: Path | None,
    png: Path | None,
    as_json: bool,
    xacro_args: Sequence[str] = (),
) -> None:
    """List the robots, or tell about one; write its URDF or a picture when asked."""
    from kinematics.robots.load import load
    from kinematics.robots.named import named_robots

    if name is None:
        asked = next((word for word, value in (("--urdf", urdf), ("--png", png), ("--hand-frame", hand_frame)) if value is not None), None)
        if asked == "--urdf":
            raise InputError("robots: say which robot's URDF to write, e.g. retrieve robots ur5e --urdf ur5e.urdf")
        if asked is not None or gripper_joint is not None:
            word = asked or "--gripper-joint"
            raise InputError(f"robots: say which robot {word} is about, e.g. retrieve robots ur5e {word}")
        _list(as_json)
        return
    if tool is not None or at is not None or xacro_args:
        out, joined = _made(name, tool, at, xacro_args, urdf)
        with _written_if_it_serves(out, joined):
            run(name=str(out), hand_frame=hand_frame, gripper_joint=gripper_joint, tool=None, at=None, urdf=None, png=png, as_json=as_json)
        return
    own = name.endswith((".urdf", ".xml", ".xacro")) or "/" in name
    if not own:
        choose("robot", name, named_robots())
        if hand_frame or gripper_joint:
            raise InputError(f"robots: {name} has a hand frame and a gripper joint of its own; leave --hand-frame and --gripper-joint out")
    if not own and not _installed(name) and urdf is None and png is None:
        _one(_missing(name), as_json)
        return
    with blame("robots"):
        arm = load(name, hand_frame, gripper_joint, on_step=_say_steps if own else None)  # its notes are in what is printed
    if urdf is not None:
        if str(urdf) == "-":
            sys.stdout.write(arm.urdf)
        else:
            write_text(urdf, arm.urdf)
    if png is not None:
        from retrieve_cli.drawing.portrait import write_portrait

        write_portrait(arm, png)
    if urdf is None:
        _one(about(arm, own), as_json)


def _say_steps(step: str) -> None:
    """Say what takes long; a robot's notes are told with all else that was understood of it."""
    if not step.startswith("robot "):
        say(step)


def _made(name: str, tool: Path | None, at: str | None, xacro_args: Sequence[str], out: Path | None) -> tuple[Path, str]:
    """An arm of a xacro with such arguments, or with a gripper of another URDF, or both: where the robot goes, which is one of one's own
    from then on, and its URDF."""
    from kinematics.robots.named import named_robots

    if name in named_robots():
        raise InputError(f"robots: --tool, --at and --xacro-arg are for an arm's URDF file, and {name} is a named robot, with its gripper")
    if at is not None and tool is None:
        raise InputError(f"robots: --at says where a tool is; say which: retrieve robots {name} --tool GRIPPER.urdf --urdf OUT.urdf")
    if out is None or str(out) == "-":
        words = [
            *(["--tool", str(tool)] if tool else []),
            *(["--at", at] if at else []),
            *(w for a in xacro_args for w in ("--xacro-arg", a)),
        ]
        what, command = "arm with its tool" if tool else "robot", shlex.join(["retrieve", "robots", name, *words, "--urdf", "OUT.urdf"])
        raise InputError(f"robots: say where the {what} goes: {command}")
    from kinematics.robots.files import urdf
    from kinematics.robots.files.hang_tool import with_tool
    from kinematics.robots.load import approach_of

    arguments = dict(map(_argument, xacro_args))
    with blame("robots"):
        if tool is None:
            root, _ = urdf.read(Path(name), arguments)
            say(f"the robot is {out}")
        else:
            root, link, how = with_tool(Path(name), tool, at, arguments, lambda joined: approach_of(out, joined))
            say(f"{tool.name} hangs on the link {link!r}, {how}; the robot is {out}")
    return out, urdf.to_string(root)


def _argument(text: str) -> tuple[str, str]:
    """NAME:=VALUE, as xacro's own command line has it. Raises: InputError for anything else."""
    name, said, value = text.partition(":=")
    if not said or not name:
        raise InputError(f"robots: --xacro-arg {text}: NAME:=VALUE is expected")
    return name, value


@contextmanager
def _written_if_it_serves(out: Path, urdf: str) -> Iterator[None]:
    """A robot's URDF, written; where what is done with it fails, `out` is again what it was before."""
    before = out.read_bytes() if out.is_file() else None
    write_text(out, urdf)
    try:
        yield
    except BaseException:
        if before is not None:
            out.write_bytes(before)
        elif out.is_file():
            out.unlink()
        raise


def _installed(name: str) -> bool:
    from kinematics.robots.named import installed

    return installed(name)


def _missing(name: str) -> dict[str, Any]:
    from kinematics.robots.named import named_robots

    entry = named_robots()[name]
    install = f"pip install 'retrieve[{entry['extra']}]'" if "extra" in entry else None
    return {"name": name, "title": entry["title"], "package": entry["distribution"], "installed": False, "install": install}


def about(arm: Robot, own: bool) -> dict[str, Any]:
    """What was understood of a robot, as JSON has it; lengths in metres, angles in radians."""
    import numpy as np

    from kinematics.robots.named import named_robots
    from kinematics.robots.own import CAMERA_ALONG_HAND
    from planning.io.documents import pose_to_json

    entry = {} if own else {"package": named_robots()[arm.name]["distribution"]}
    limits = {
        joint: {"lower": _finite(low), "upper": _finite(high), "velocity": round(float(speed), 4)}
        for joint, low, high, speed in zip(arm.joint_names, arm.lower, arm.upper, arm.velocity)
    }
    poses = arm.link_poses(arm.home)
    last = next(i for i in arm.tree.path(arm.tree.index["hand"])[::-1] if arm.tree.kind[i] != 0)
    T_wrist_hand = np.linalg.inv(poses[arm.tree.names[last]]) @ poses["hand"]
    T_hand_camera = np.linalg.inv(poses["hand"]) @ poses["camera"]
    grip = arm.grip
    motors = list(grip.joints) if grip else [arm.joint_names[arm.gripper_joint]]
    jaw = arm.opening.jaw != 0
    return {
        "name": arm.name, "title": arm.title, **entry, "installed": True,
        "joints": list(arm.joint_names),
        "arm_joints": [arm.joint_names[j] for j in arm.arm_joints],
        "limits": limits,
        "hand": {"link": grip.link if grip else None, "measured": bool(grip and grip.measured), "in_link": arm.tree.names[last],
                 "T_link_hand": pose_to_json(T_wrist_hand)},
        "gripper": {"kind": grip.kind if grip else "one jaw against a fixed one" if jaw else "two fingers", "joints": motors,
                    "pads": sorted(arm.pads), "force_N": arm.grip_force_N,
                    **({"cup_m": round(arm.opening.cup_m, 4)} if arm.opening.cup_m else {})},
        "opening_m": round(arm.opening.max_m, 4),
        "closes_to_m": round(float(arm.opening.width_m[0]), 4) + 0.0,
        "camera": arm.has_camera or not np.allclose(T_hand_camera, CAMERA_ALONG_HAND, atol=1e-6),
        "camera_in_link": arm.carrier("camera"),
        "optical_frames": [link for link in arm.tree.names if "optical" in link.lower()],
        "home": [round(float(q), 4) for q in arm.home],
        "links": list(dict.fromkeys(h.link for h in arm.hulls)),
        "hulls": len(arm.hulls),
        "ignored_pairs": sorted(sorted(pair) for pair in arm.skip),
        "notes": list(arm.notes),
    }  # fmt: skip


def _finite(value: float) -> float | None:
    """A limit, None where there is none."""
    return round(float(value), 4) if abs(value) < 1e9 else None


def _list(as_json: bool) -> None:
    """All named robots."""
    from kinematics.robots.load import load
    from kinematics.robots.named import named_robots

    rows = [about(load(name), own=False) if _installed(name) else _missing(name) for name in named_robots()]
    if as_json:
        json.dump(rows, sys.stdout, indent=2)
        print()
        return
    from rich.table import Table

    view = Table("robot", "what it is", "joints", "opening", "package", header_style="bold", box=None, pad_edge=False)
    for row in rows:
        there = row["installed"]
        opening = f"{1000 * row['opening_m']:.0f} mm" if there else "–"
        package = row["package"] if there else f"missing: {row['install']}"
        view.add_row(row["name"], row["title"], str(len(row["joints"])) if there else "–", opening, package)
    show(view)


def _one(row: dict[str, Any], as_json: bool) -> None:
    """One robot."""
    if as_json:
        json.dump(row, sys.stdout, indent=2)
        print()
        return
    if not row["installed"]:
        show(f"{row['name']}: {row['title']}", f"missing: {row['install']}")
        return
    from rich.table import Table

    view = Table("joint", "from", "to", "speed", "home", "", header_style="bold", box=None, pad_edge=False)
    for name, home in zip(row["joints"], row["home"]):
        limit = row["limits"][name]
        low, high = ("–" if limit[key] is None else f"{limit[key]:.3f}" for key in ("lower", "upper"))
        what = "arm" if name in row["arm_joints"] else "gripper" if name == row["gripper"]["joints"][0] else "stays"
        view.add_row(name, low, high, f"{limit['velocity']:.2f}", f"{home:.3f}", what)
    show(f"{row['name']}: {row['title']}", view, *_lines(row))


def _camera(row: dict[str, Any]) -> str:
    if not row["camera"]:
        frames = row["optical_frames"]
        named = f" (rename the link {frames[0]!r} to camera, and it looks from there)" if frames else ""
        return f"none; where one is needed it looks along the hand{named}"
    if row["camera_in_link"] == row["hand"]["in_link"]:
        return "a link of its own"
    return f"a link of its own, which goes with {row['camera_in_link']} and not with the hand: --sense needs one that does"


def _lines(row: dict[str, Any]) -> list[str]:
    from kinematics.robots.own import pose_words
    from kinematics.transforms import rotation_from_wxyz, transform

    grip, hand = row["gripper"], row["hand"]
    T = transform(rotation_from_wxyz(hand["T_link_hand"]["q_wxyz"]), hand["T_link_hand"]["p"])
    first, *others = grip["joints"]
    moved = f"{first}, and {', '.join(others)} with it" if others else first
    force = f", {grip['force_N']:g} N" if grip["force_N"] is not None else ""
    where = "measured" if hand["measured"] else "given"
    pairs = [" + ".join(pair) for pair in row["ignored_pairs"]]
    more = f" and {len(pairs) - SHOWN} more" if len(pairs) > SHOWN else ""
    lines = [
        f"gripper: {grip['kind']}, by {moved}; pads {', '.join(grip['pads'])}",
        f"cup: {1000 * grip['cup_m']:.0f} mm across, holds while the joint {first} is up"
        if "cup_m" in grip
        else f"opening: {1000 * abs(row['closes_to_m']):.0f} to {1000 * row['opening_m']:.0f} mm{force}",
        f"hand frame ({where}): {pose_words(T)} in {hand['in_link']}",
        f"camera: {_camera(row)}",
        f"links: {', '.join(row['links'])} ({row['hulls']} convex hulls)",
        f"pairs that may touch: {', '.join(pairs[:SHOWN])}{more}",
    ]
    lines += [f"note: {note}" for note in row["notes"]]
    return [*lines, f"write its URDF: retrieve robots {row['name']} --urdf {Path(row['name']).name.partition('.')[0]}-joined.urdf"]
