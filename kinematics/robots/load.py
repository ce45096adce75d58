"""Robots by name or from a URDF file.

    robot = load("ur5e")                                                   a named robot (robots.toml)
    robot = load("my_arm.urdf", hand_frame="tcp", gripper_joint="grip")    one's own

The first load of a robot reads its meshes with yourdfpy and trimesh and samples which links always touch; see `assemble.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from kinematics import cache
from kinematics.errors import did_you_mean
from kinematics.robots.assemble import CACHE_VERSION, assemble, stamps
from kinematics.robots.derive import read_description
from kinematics.robots.files import urdf
from kinematics.robots.files.dialects import drop_covers, visuals_instead
from kinematics.robots.hands.hand_model import Model, NoGripper
from kinematics.robots.joints import beyond_limits, with_joints
from kinematics.robots.named import locate, named_robots
from kinematics.robots.own import Grip, find_grip, grip_from_arrays, grip_to_arrays, put_in
from kinematics.robots.robot import Robot
from kinematics.scene import RobotRef
from kinematics.transforms import Array, rotation_rpy, transform


def from_ref(ref: RobotRef, on_step: Callable[[str], None] | None = None) -> Robot:
    """The robot that a scene means, with its home and its hand frame. Raises ValueError, see `load`."""
    return load(
        ref.name or ref.urdf or "", ref.hand_frame, ref.gripper_joint,
        home=ref.home, T_link_hand=ref.T_link_hand, gripper_joints=ref.gripper_joints, on_step=on_step,
    )  # fmt: skip


def to_ref(robot: Robot, hand_frame: str | None = None) -> RobotRef:
    """How scenes name a robot that was loaded, with its base where it stands in those that are generated; `from_ref` loads it again.

    hand_frame: as `load` was told.
    """
    T_base = transform(p=robot.base_p)
    if robot.name in named_robots():
        return RobotRef(T_base, name=robot.name)
    urdf_file, grip = str(Path(robot.name).resolve()), robot.grip
    if grip is None or (hand_frame is not None and len(grip.joints) == 1):
        return RobotRef(T_base, urdf=urdf_file, hand_frame=hand_frame, gripper_joint=robot.joint_names[robot.gripper_joint])
    T = grip.T_link_hand if grip.measured else None
    return RobotRef(T_base, urdf=urdf_file, hand_frame=grip.link, T_link_hand=T, gripper_joints=grip.joints)


def load(
    which: str,
    hand_frame: str | None = None,
    gripper_joint: str | None = None,
    *,
    home: Mapping[str, float] | None = None,
    T_link_hand: Array | None = None,
    gripper_joints: Sequence[str] = (),
    on_step: Callable[[str], None] | None = None,
) -> Robot:
    """Load a named robot, or a URDF file; what was loaded before comes back as the same object.

    hand_frame: the link at the grasp point (z along the approach, y the way the fingers close); gripper_joint: the joint that opens the
    fingers. Of a URDF file both are found out where they are not given (`own.py`). T_link_hand (4, 4): the hand in that link, where the
    link is not at the grasp point or is turned; of a named robot: in the hand frame that it has. home: where joints wait by name, if not
    where the description has them. gripper_joints: as gripper_joint, where several joints move fingers. on_step: told what takes
    long.

    Raises: ValueError for an unknown name or joint, a missing package, and a URDF that can't serve, each saying how to mend it.
    """
    T = np.eye(4) if T_link_hand is None else np.ascontiguousarray(T_link_hand, float)
    waits = None if home is None else tuple((name, float(q)) for name, q in home.items())
    return _load(which, hand_frame, gripper_joint, T.tobytes(), tuple(gripper_joints), waits, on_step)


@lru_cache(maxsize=16)
def _load(
    which: str,
    hand_frame: str | None,
    gripper_joint: str | None,
    T_link_hand: bytes,
    gripper_joints: tuple[str, ...],
    home: tuple[tuple[str, float], ...] | None,
    on_step: Callable[[str], None] | None,
) -> Robot:
    """`load`, with arguments that can be remembered."""
    if home is not None:
        robot = _load(which, hand_frame, gripper_joint, T_link_hand, gripper_joints, None, on_step)
        return _waiting_at(robot, dict(home))
    T, table = np.frombuffer(T_link_hand).reshape(4, 4), named_robots()
    named = _gripper_joints(which, gripper_joint, gripper_joints)
    if which in table:
        entry = table[which]
        if named not in ((), (entry["gripper_joint"],)):
            raise ValueError(f"robot {which}: its gripper is opened by {entry['gripper_joint']!r}, not by {', '.join(map(repr, named))}")
        if hand_frame is not None:
            raise ValueError(
                f"robot {which} has a hand frame of its own; another is for a URDF, as retrieve robots {which} --urdf FILE writes it"
            )
        return _load_named(which, entry, T, on_step)
    if which.endswith((".urdf", ".xml", ".xacro")) or "/" in which:
        return _load_urdf(Path(which), hand_frame, named, T, on_step)
    raise ValueError(f"unknown robot {which!r}{did_you_mean(which, table)}: the named ones are {', '.join(table)}; or give a URDF file")


def forget() -> None:
    """Load robots anew from now on, for files that were changed meanwhile."""
    _load.cache_clear()


def _waiting_at(robot: Robot, values: Mapping[str, float]) -> Robot:
    """The robot with another home. Raises: ValueError for joints that it does not have, or beyond their limits."""
    home = with_joints(robot.joint_names, robot.home, values, f"robot {robot.name}: home")
    if beyond := beyond_limits(robot.joint_names, home, robot.lower, robot.upper):
        raise ValueError(f"robot {robot.name}: at home, {beyond}")
    return replace(robot, home=home)


def _gripper_joints(which: str, gripper_joint: str | None, gripper_joints: Sequence[str]) -> tuple[str, ...]:
    """The joints that open the fingers, said in either way. Raises: ValueError when the two contradict each other."""
    if gripper_joint is not None and gripper_joints and gripper_joint not in gripper_joints:
        raise ValueError(f"robot {which}: gripper_joint {gripper_joint!r} is not among its gripper_joints; leave one of the two out")
    return tuple(gripper_joints) if gripper_joints else () if gripper_joint is None else (gripper_joint,)


def _load_named(name: str, entry: dict[str, Any], T_link_hand: Array, on_step: Callable[[str], None] | None) -> Robot:
    file = locate(entry, "file")
    if file is None:
        extra = entry.get("extra")
        what = f"pip install 'retrieve[{extra}]'" if extra else f"pip install {entry['distribution']}"
        raise ValueError(f"robot {name!r} comes with the package {entry['distribution']}, which is not installed: {what}")
    root, notes = urdf.read(file)
    if gripper := entry.get("gripper"):
        tool = locate({**entry, "file": gripper["file"]}, "file")
        assert tool is not None, gripper["file"]
        urdf.join(root, urdf.read(tool)[0], gripper["at"], transform(rotation_rpy(gripper["rpy"])), gripper["prefix"])
    srdf = locate(entry, "srdf")
    for frame in ("camera", "hand"):
        boxes = tuple((np.array(size), np.array(centre)) for size, centre in entry[frame].get("boxes", []))
        T = transform(rotation_rpy(entry[frame]["rpy"]), entry[frame]["xyz"])
        urdf.add_link(root, frame, entry[frame]["link"], T @ T_link_hand if frame == "hand" else T, boxes)
    robot = assemble(
        name, entry["title"], root, entry["gripper_joint"], entry["home"], np.array(entry["stand"], float), srdf, on_step,
        entry.get("limits"), notes,
    )  # fmt: skip
    return replace(robot, grip_force_N=entry["grip_force_N"], most_grip_force_N=entry["most_grip_force_N"])


def _load_urdf(
    file: Path, hand_frame: str | None, named: tuple[str, ...], T_link_hand: Array, on_step: Callable[[str], None] | None
) -> Robot:
    root, notes = urdf.read(file)
    links = [e.get("name", "") for e in root.iter("link")]
    if hand_frame is not None and hand_frame not in links:
        raise ValueError(f"{file} has no link {hand_frame!r} for the hand frame; it has {', '.join(links)}")
    if hand_frame is None and (T_link_hand != np.eye(4)).any():
        raise ValueError(f"{file}: T_link_hand is the hand in a link; say in which with hand_frame (links: {', '.join(links)})")
    try:
        grip = _grip(file, root, hand_frame, named, T_link_hand, on_step)
        if grip.filled_by and (drawn := visuals_instead(root, grip.filled_by)):
            words = f"the collision geometry of {', '.join(drawn)} fills the room between the pads: what is drawn is taken for it"
            grip, notes = _grip(file, root, hand_frame, named, T_link_hand, on_step), (*notes, words)
        if grip.covers and (dropped := drop_covers(root, grip.covers)):
            names = ", ".join(dropped)
            words = f"the collision geometry of {names}, around another link's, fills the room between the pads: it is left out"
            grip, notes = _grip(file, root, hand_frame, named, T_link_hand, on_step), (*notes, words)
    except NoGripper as e:
        reasons = [note for note in notes if "<mimic>" in note or note.startswith("xacro arguments")]
        raise NoGripper("; ".join([str(e), *reasons])) from None
    put_in(root, grip)
    srdf = file.with_suffix(".srdf")
    robot = assemble(
        str(file), file.stem, root, grip.joints[0], None, np.zeros(3), srdf if srdf.is_file() else None, on_step,
        notes=(*notes, *grip.notes),
    )  # fmt: skip
    return replace(robot, grip=grip)


def approach_of(file: Path, root: etree._Element) -> tuple[str, Array] | None:
    """The link of a URDF's last joint before its gripper, and the direction (3,) in it along which that takes things, as measured; None
    where no gripper is found."""
    try:
        grip = _grip(file, root, None, (), np.eye(4), None)
    except ValueError:
        return None
    return grip.link, grip.T_link_hand[:3, 2]


def _grip(
    file: Path,
    root: etree._Element,
    hand_frame: str | None,
    named: tuple[str, ...],
    T_link_hand: Array,
    on_step: Callable[[str], None] | None,
) -> Grip:
    """How the hand of a URDF of one's own closes: from the cache, or found out."""
    text = urdf.to_string(root)
    name_in_cache = "grip-21-" + cache.key(CACHE_VERSION, text, *stamps(root), repr((hand_frame, named)), T_link_hand.tobytes())
    if (data := cache.load(name_in_cache)) is not None:
        return grip_from_arrays(data)
    if on_step:
        on_step(f"reading the meshes of {file.stem}")
    try:
        known = read_description(text, str(file))
        model = Model(known.tree, known.joints, known.limits[:, 0], known.limits[:, 1], known.hulls)
        grip = find_grip(model, f"robot {file}", hand_frame, named, T_link_hand)
    except ValueError as e:
        raise e if str(e).startswith((f"robot {file}", "mesh file")) else ValueError(f"robot {file}: {e}") from e
    except Exception as e:  # readers of URDFs and meshes raise many kinds, all of them "this is no robot"
        raise ValueError(f"robot {file}: its URDF can't be understood ({type(e).__name__}: {e})") from e
    cache.store(name_in_cache, grip_to_arrays(grip))
    return grip
