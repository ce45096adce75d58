"""An arm and its gripper from two URDFs, as makers publish them, put together at the flange."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
from lxml import etree

from kinematics.robots.files import urdf

FLANGE = re.compile(r"(^|_)(tool0|flange|ee|eef|tcp|attachment)($|_)", re.IGNORECASE)
"""What the link that tools are screwed to is often called."""


def with_tool(
    arm: Path, tool: Path, at: str | None = None, arguments: Mapping[str, str] = MappingProxyType({})
) -> tuple[etree._Element, str]:
    """An arm with a gripper of another URDF or xacro: its root link is at the link `at`, turned as that is; by default the arm's flange.

    arguments: of the arm's xacro, by name.
    Returns the URDF's root element, mesh names absolute, and the link. The gripper's names that the arm has too get `tool_` before them.
    Raises: ValueError for a file that is no URDF, a link that the arm does not have, and an arm that ends in several places.
    """
    root, _ = urdf.read(arm, arguments)
    links = [link.get("name", "") for link in root.iter("link")]
    if at is None:
        at = _flange(root, arm)
    if at not in links:
        raise ValueError(f"{arm} has no link {at!r} to hang a tool on; it has {', '.join(links)}")
    urdf.join(root, urdf.read(tool)[0], at, np.eye(4), "tool_")
    return root, at


def _flange(root: etree._Element, arm: Path) -> str:
    """The link at the end of the longest chain of moving joints: called like a flange, or the only one that ends there."""
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
    choice = next((found for found in (tool0, named, ends) if len(found) == 1), [])
    if not choice:
        raise ValueError(f"{arm} ends in several places ({', '.join(ends)}); say with --at on which link the tool is")
    return str(choice[0])
