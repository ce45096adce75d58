"""An arm and its gripper from two URDFs, as makers publish them, put together at the flange."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from copy import deepcopy
from pathlib import Path
from types import MappingProxyType

import numpy as np
from lxml import etree

from kinematics.robots.files import urdf
from kinematics.robots.files.dialects import UnknownArgument
from kinematics.transforms import Array, rotation_about, rotation_rpy, transform

FLANGE = re.compile(r"(^|_)(tool0|flange|ee|eef|tcp|attachment)($|_)", re.IGNORECASE)
"""What the link that tools are screwed to is often called."""
ALONG = np.cos(np.radians(10))
"""An axis is along another that leads so near to it, at least: the cosine."""
Approach = Callable[[etree._Element], tuple[str, Array] | None]
"""The link of a robot's last joint, and the direction (3,) in it along which its gripper takes things; None where no gripper is found."""


def with_tool(
    arm: Path, tool: Path, at: str | None = None, arguments: Mapping[str, str] = MappingProxyType({}), approach: Approach = lambda _: None
) -> tuple[etree._Element, str, str]:
    """An arm with a gripper of another URDF or xacro: its root link is at the link `at`, turned as that is; by default at the arm's flange,
    with the axis along which it takes things away from the arm: z, unless another one is measured. Where that root link is called world,
    it is no part of the gripper, but where it is shown, and what is fixed to it takes its place.

    arguments: by name, of the arm's xacro, or the gripper's, or both. approach: measures a robot's gripper.
    Returns the URDF's root element, mesh names absolute, the link, and in words which of the gripper's axes is along which of its. The
    gripper's names that the arm has too get `tool_` before them.
    Raises: ValueError for a file that is no URDF, an argument that neither has, a link that the arm does not have, and an arm that ends in
    several places.
    """
    (root, unknown), (gripper, unknown_there) = (_read(file, arguments) for file in (arm, tool))
    if neither := [unknown[name] for name in arguments if name in unknown and name in unknown_there]:
        raise neither[0]
    links = [link.get("name", "") for link in root.iter("link")]
    R, along, axis, named = np.eye(3), "z", "z", at is not None
    at = at or _flange(root, arm)
    if at not in links:
        raise ValueError(f"{arm} has no link {at!r} to hang a tool on; it has {', '.join(links)}")
    _off_the_world(gripper)
    if not named:
        if abs(_last_axis(root, at)[0]) > ALONG:
            R, along = rotation_rpy((np.pi / 2, 0.0, np.pi / 2)), "x"
        tried = deepcopy(root)
        urdf.join(tried, deepcopy(gripper), at, transform(R), "tool_")
        R_turn = _turn(root, at, R[:, 2], approach(tried))
        R, axis = R_turn @ R, _axis_name(R.T @ R_turn.T @ R[:, 2])
    urdf.join(root, gripper, at, transform(R), "tool_")
    return root, at, f"its {axis} along that link's {along}"


def _turn(root: etree._Element, at: str, out: Array, found: tuple[str, Array] | None) -> Array:
    """The rotation (3, 3) in the flange's frame that turns the axis next to a measured approach to the way out (3,)."""
    R_at, last = _in_last(root, at)
    if found is None or found[0] != last:
        return np.eye(3)
    way = R_at.T @ found[1]
    k = int(np.argmax(np.abs(way)))
    if abs(way[k]) < ALONG:
        return np.eye(3)
    near = np.sign(way[k]) * np.eye(3)[k]
    if near @ out > 0.5:
        return np.eye(3)
    across = np.cross(near, out) if near @ out > -0.5 else np.roll(out, 1)
    return np.asarray(rotation_about(across, np.pi / 2 if near @ out > -0.5 else np.pi))


def _axis_name(axis: Array) -> str:
    """What an axis (3,) of a frame is called."""
    k = int(np.argmax(np.abs(axis)))
    return ("-" if axis[k] < 0 else "") + "xyz"[k]


def _read(file: Path, arguments: Mapping[str, str]) -> tuple[etree._Element, dict[str, UnknownArgument]]:
    """A file with those of some arguments that it has, and what is said of the others, by name."""
    known, unknown = dict(arguments), dict[str, UnknownArgument]()
    while True:
        try:
            return urdf.read(file, known)[0], unknown
        except UnknownArgument as e:
            unknown[e.name] = e
            del known[e.name]


def _off_the_world(tool: etree._Element) -> None:
    """Take a root link called world, on which nothing is, and the fixed joint on it away, in place."""
    worlds = [link for link in tool.iter("link") if link.get("name") == "world" and link.find("collision") is None]
    below = [joint for joint in tool.iter("joint") if joint.find("parent").get("link") == "world"]
    if worlds and len(below) == 1 and below[0].get("type") == "fixed":
        tool.remove(worlds[0])
        tool.remove(below[0])


def _flange(root: etree._Element, arm: Path) -> str:
    """The link at the end of the longest chain of moving joints: called like a flange, of several the one whose z is the last joint's axis,
    or the only one that ends there."""
    above = dict[str, tuple[str, bool]]()
    for joint in root.iter("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is not None and child is not None:
            above[child.get("link", "")] = (parent.get("link", ""), joint.get("type") != "fixed")

    def moving(link: str) -> int:
        return 0 if link not in above else above[link][1] + moving(above[link][0])

    links = [link.get("name", "") for link in root.iter("link")]
    most = max(map(moving, links))
    last = [link for link in links if moving(link) == most]
    ends = [link for link in last if not any(link == parent for parent, _ in above.values())]
    named = [link for link in last if FLANGE.search(link)]
    tool0 = [link for link in named if link.endswith("tool0")]
    ahead = [link for link in named if abs(_last_axis(root, link)[2]) > ALONG]
    choice = next((found for found in (tool0, named, ahead, ends) if len(found) == 1), [])
    if not choice:
        raise ValueError(f"{arm} ends in several places ({', '.join(ends)}); say with --at on which link the tool is")
    return str(choice[0])


def _last_axis(root: etree._Element, link: str) -> Array:
    """The axis (3,) of the joint that moves a link, in the link's frame, a unit vector; 0 where none does."""
    R, last = _in_last(root, link)
    joint = next((joint for joint in root.iter("joint") if joint.find("child").get("link", "") == last), None)
    if joint is None:
        return np.zeros(3)
    said = joint.find("axis")
    axis = R.T @ _numbers("1 0 0" if said is None else said.get("xyz", "1 0 0"))
    return np.asarray(axis / np.linalg.norm(axis))


def _in_last(root: etree._Element, link: str) -> tuple[Array, str]:
    """How a link is turned (3, 3) in the one above it that a joint moves, or the root, and that one's name."""
    above = {joint.find("child").get("link", ""): joint for joint in root.iter("joint")}
    R = np.eye(3)
    while (joint := above.get(link)) is not None and joint.get("type") == "fixed":
        origin = joint.find("origin")
        R = (np.eye(3) if origin is None else rotation_rpy(_numbers(origin.get("rpy", "0 0 0")))) @ R
        link = joint.find("parent").get("link", "")
    return R, link


def _numbers(text: str) -> Array:
    return np.array([float(value) for value in text.split()])
