"""Joints that only say where a robot is in the world, as simulators have them: they stand still, for the scene's robot pose says that."""

from __future__ import annotations

from lxml import etree

from kinematics.robots.files.fixed_joints import fix

FAR_M = 3.0
"""A joint that slides further than that carries no arm along: it places the robot in a room."""
FREE = ("floating", "planar")


def hold_base(root: etree._Element) -> list[str]:
    """Fix, in place, the joints between the root and the first link with geometry, where one of them is free or slides without end: those
    of a mobile base. Returns their names."""
    joints = list(root.findall("joint"))
    below = {joint: child.get("link") for joint in joints if (child := joint.find("child")) is not None}
    links = {link.get("name"): link for link in root.findall("link")}
    at = next((name for name in links if name not in below.values()), None)
    way = list[etree._Element]()
    while at in links and links[at].find("collision") is None and links[at].find("visual") is None:
        carried = [joint for joint in joints if (parent := joint.find("parent")) is not None and parent.get("link") == at]
        if len(carried) != 1 or len(way) == len(joints):
            break
        way += carried
        at = below.get(carried[0])
    held = [joint for joint in way if joint.get("type") != "fixed"]
    if not any(_places(joint) for joint in held):
        return []
    for joint in held:
        fix(joint)
    return [joint.get("name", "") for joint in held]


def _places(joint: etree._Element) -> bool:
    """Whether a joint places a robot in the world."""
    limit = joint.find("limit")
    if joint.get("type") != "prismatic":
        return joint.get("type") in FREE
    return limit is None or float(limit.get("upper", "inf")) - float(limit.get("lower", "-inf")) > FAR_M
