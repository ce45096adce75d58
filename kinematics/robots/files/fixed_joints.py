"""Joints of a URDF that stand still from now on."""

from __future__ import annotations

import numpy as np
from lxml import etree

from kinematics.transforms import rotation_about, rotation_rpy, rpy_from_rotation, transform


def fix(joint: etree._Element) -> None:
    """Make a joint fixed where it is at 0, in place: what only joints that move have goes."""
    joint.set("type", "fixed")
    for tag in ("axis", "limit", "mimic", "safety_controller"):
        for element in joint.findall(tag):
            joint.remove(element)


def freeze(root: etree._Element, name: str, value: float) -> None:
    """Make a joint of a URDF, and all that mimic it, fixed where it is at a value, in place."""
    joint = next(j for j in root.iter("joint") if j.get("name") == name)
    for other in root.findall("joint"):
        mimic = other.find("mimic")
        if mimic is not None and mimic.get("joint") == name:
            freeze(root, other.get("name", ""), float(mimic.get("multiplier", "1")) * value + float(mimic.get("offset", "0")))
    axis, origin = joint.find("axis"), joint.find("origin")
    along = np.array([float(v) for v in (axis.get("xyz", "1 0 0") if axis is not None else "1 0 0").split()])
    along /= np.linalg.norm(along)
    T = np.eye(4)
    if origin is not None:
        xyz, rpy = (np.array([float(v) for v in origin.get(key, "0 0 0").split()]) for key in ("xyz", "rpy"))
        T = transform(rotation_rpy(rpy), xyz)
        joint.remove(origin)
    slides = joint.get("type") == "prismatic"
    T = T @ (transform(p=value * along) if slides else transform(rotation_about(tuple(along), value)))
    numbers = (" ".join(repr(float(v)) for v in part) for part in (T[:3, 3], rpy_from_rotation(T[:3, :3])))
    etree.SubElement(joint, "origin", xyz=next(numbers), rpy=next(numbers))
    fix(joint)
