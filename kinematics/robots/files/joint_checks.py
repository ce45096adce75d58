"""What is wrong with a URDF's joints and links, in one line that names them, before anything is made of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from lxml import etree

from kinematics.errors import did_you_mean

MOVABLE = ("revolute", "continuous", "prismatic")
_NUMBERS = {"origin": ("xyz", "rpy", "quat_xyzw"), "axis": ("xyz",), "limit": ("lower", "upper", "velocity", "effort"), "box": ("size",),
            "cylinder": ("radius", "length"), "capsule": ("radius", "length"), "sphere": ("radius",), "mesh": ("scale",),
            "mimic": ("multiplier", "offset"), "safety_controller": ("soft_lower_limit", "soft_upper_limit")}  # fmt: skip
_NEEDS = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",), "capsule": ("radius", "length"), "mesh": ("filename",)}
_COUNTS = {"xyz": (3,), "rpy": (3,), "quat_xyzw": (4,), "size": (3,), "scale": (1, 3)}
_POSITIVE = ("radius", "length", "size")
DEGREES = (40.0, 720.0)  # limits of a joint that turns: between so many rad they are meant in degrees
MOST_RPY = 4 * np.pi  # and of an origin's angles those beyond


def check_shapes(root: etree._Element) -> None:
    """Raises: ValueError that names the link whose geometry is of no known shape, lacks what a shape needs, or is of several at once."""
    for link in root.iter("link"):
        for element in link.iter("visual", "collision"):
            shapes = [e for e in element.findall("geometry/*") if isinstance(e.tag, str) and "{" not in e.tag and ":" not in e.tag]
            where = f"link {link.get('name', '')!r}: its <{element.tag}>"
            for shape in shapes:
                if shape.tag not in _NEEDS:
                    raise ValueError(f"{where} has a <{shape.tag}> for geometry; {', '.join(_NEEDS)} can be used")
                if missing := [key for key in _NEEDS[shape.tag] if not shape.get(key, "").strip()]:
                    raise ValueError(f"{where} has a <{shape.tag}> without {missing[0]}")
            if len(shapes) > 1:
                each = " and ".join(f"<{shape.tag}>" for shape in shapes)
                raise ValueError(f"{where} has a <geometry> with {each}; give each a <{element.tag}> of its own")


def check_numbers(root: etree._Element) -> None:
    """Raises: ValueError that names the joint or link, where something that must be a number is none, or there are too few or too many."""
    for part in root.iter("link", "joint"):
        where = f"{part.tag} {part.get('name', '')!r}"
        for element in part.iter(*_NUMBERS):
            for key in _NUMBERS[element.tag]:
                if key in element.attrib:
                    _check_number(f"{where}: <{element.tag} {key}={element.get(key)!r}>", key, element.get(key, ""))


def _check_number(where: str, key: str, text: str) -> None:
    try:
        values = np.array([float(v) for v in text.split()])
    except ValueError:
        xacro = "; is this xacro? Then its file's name ends with .xacro" if "$" in text else ""
        raise ValueError(f"{where} is no number{xacro}") from None
    if len(values) not in _COUNTS.get(key, (1,)):
        raise ValueError(f"{where} must hold {_COUNTS.get(key, (1,))[-1]} numbers")
    if not np.isfinite(values).all():
        raise ValueError(f"{where} is not finite")
    if key == "rpy" and (np.abs(values) > MOST_RPY).any():
        raise ValueError(f'{where} is in rad; are these degrees? Then it is rpy="{" ".join(f"{v:.6g}" for v in np.radians(values))}"')
    if key == "scale" and (values == 0).any():
        raise ValueError(f"{where} leaves nothing of it")
    if key in _POSITIVE and (values <= 0).any() and not (key == "length" and (values == 0).all()):
        raise ValueError(f"{where} is not positive")


def check_joints(root: etree._Element) -> None:
    """Raises: ValueError that names the joint whose links, type, axis, limits or mimic make no sense, or the link that has two parents."""
    links, joints = ([e.get("name", "") for e in root.findall(tag)] for tag in ("link", "joint"))
    for what, names in (("link", links), ("joint", joints)):
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"there are {names.count(name)} {what}s called {name!r}; call all but one something else")
    carried = dict[str, str]()
    for joint in root.findall("joint"):
        name = joint.get("name", "")
        ends = [(end, "" if (e := joint.find(end)) is None else e.get("link", "")) for end in ("parent", "child")]
        for end, link in ends:
            if not link or link not in links:
                near = did_you_mean(link, links) if link else ""
                mend = f'; where the file is a part of a robot, give it <link name="{link}"/>' if link and not near else ""
                raise ValueError(f"joint {name!r}: its {end} is the link {link!r}, which does not exist{near}{mend}")
        child = ends[1][1]
        if child in carried:
            raise ValueError(f"link {child!r} has two parents, by the joints {carried[child]!r} and {name!r}; take one of them away")
        carried[child] = name
        for check in _CHECKS:
            if complaint := check(joint, joints):
                raise ValueError(f"joint {name!r}: {complaint}")
    check_loops(root)
    check_mimics(root)


def _type(joint: etree._Element, _: list[str]) -> str | None:
    kind = joint.get("type")
    if kind in (*MOVABLE, "fixed"):
        return None
    return f"its type is {kind!r}; {', '.join(MOVABLE)} and fixed can be used"


def _axis(joint: etree._Element, _: list[str]) -> str | None:
    axis = joint.find("axis")
    if joint.get("type") == "fixed" or axis is None:
        return None
    if np.linalg.norm([float(v) for v in axis.get("xyz", "1 0 0").split()]) < 1e-9:
        return f"its axis is {axis.get('xyz')}, which points nowhere; along the parent's z it would be 0 0 1"
    return None


def _limits(joint: etree._Element, _: list[str]) -> str | None:
    if joint.get("type") not in ("revolute", "prismatic") or joint.find("mimic") is not None:
        return None
    limit = joint.find("limit")
    if limit is None or not {"lower", "upper"} & set(limit.attrib):
        return "it has no limits; give it <limit lower=… upper=…>, or make it continuous if it turns without end"
    lower, upper = float(limit.get("lower", "0")), float(limit.get("upper", "0"))
    if lower > upper:
        return f"its lower limit {lower:g} is above its upper limit {upper:g}; swap them"
    if lower == upper:
        return f"its limits are both {lower:g}, so it can't move; make it fixed if it never does, continuous if it turns without end"
    if joint.get("type") == "revolute" and DEGREES[0] < max(-lower, upper) <= DEGREES[1]:
        radians = f'lower="{np.radians(lower):.4g}" upper="{np.radians(upper):.4g}"'
        turns = f"its limits {lower:g} and {upper:g} rad are {(upper - lower) / (2 * np.pi):.0f} turns apart"
        return f"{turns}; are they in degrees? Then it is {radians}; make it continuous if it turns without end"
    return None


def _mimic(joint: etree._Element, joints: list[str]) -> str | None:
    mimic = joint.find("mimic")
    if mimic is None or mimic.get("joint") in joints:
        return None
    return f"it mimics {mimic.get('joint')!r}, which does not exist{did_you_mean(mimic.get('joint', ''), joints)}"


_CHECKS: tuple[Callable[[etree._Element, list[str]], str | None], ...] = (_type, _axis, _limits, _mimic)


def check_mimics(root: etree._Element) -> None:
    """Raises: ValueError when a joint mimics itself, by way of others or at once, or one that is fixed: none of them would have a motor.
    What is fixed itself follows nothing, whatever its <mimic> says."""
    fixed = [j.get("name") for j in root.iter("joint") if j.get("type") == "fixed"]
    moving = [j for j in root.iter("joint") if j.get("type") != "fixed"]
    follows = {j.get("name", ""): m.get("joint", "") for j in moving if (m := j.find("mimic")) is not None}
    for first in follows:
        way = [first]
        while (after := follows.get(way[-1])) is not None:
            if after in way:
                raise ValueError(f"joint {after!r} mimics itself ({' mimics '.join([*way[way.index(after) :], after])}); one needs a motor")
            if after in fixed:
                raise ValueError(f"joint {way[-1]!r} mimics {after!r}, which is fixed; one needs a motor")
            way.append(after)


def check_loops(root: etree._Element) -> None:
    """Raises: ValueError when links carry each other in a circle, or when there is not just one link that nothing carries."""
    above = {j.find("child").get("link"): (j.find("parent").get("link"), j.get("name")) for j in root.findall("joint")}
    links = [e.get("name", "") for e in root.findall("link")]
    for first in links:
        link, seen = first, list[str]()
        while link in above:
            if link in seen:
                raise ValueError(f"joint {above[link][1]!r} closes a circle of links ({' on '.join([*seen[seen.index(link) :], link])})")
            seen.append(link)
            link = above[link][0]
    roots = [link for link in links if link not in above]
    if len(roots) > 1:
        raise ValueError(f"the URDF has {len(roots)} root links ({', '.join(roots)}); it needs just one: join the others by fixed joints")
