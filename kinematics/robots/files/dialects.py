"""What URDFs hold beyond URDF 1.0, said in its words: xacro, capsules, quaternions, soft limits, solids of no size."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from copy import deepcopy
from pathlib import Path
from types import MappingProxyType

import numpy as np
from lxml import etree

from kinematics.errors import did_you_mean
from kinematics.robots.files.mesh_files import find_package
from kinematics.transforms import rotation_from_wxyz, rotation_rpy, rpy_from_rotation

NO_PACKAGE = "there is no package"
DRAKE = "package://drake"
_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
GREY = "0.7 0.7 0.7 1"
"""Of what has no colour that can be read."""


def is_xacro(file: Path, text: bytes) -> bool:
    """Whether a file has to be run through xacro before it is a URDF."""
    return file.suffix == ".xacro" or b"<xacro:" in text


class UnknownArgument(ValueError):
    """An argument that a file does not have: the message, and its name."""

    def __init__(self, message: str, name: str) -> None:
        super().__init__(message)
        self.name = name


class _Arguments(dict[str, str]):
    """Arguments of a xacro file by name, to which it adds those that it declares, at their defaults. asked: the names that it looks for."""

    def __init__(self, given: Mapping[str, str]) -> None:
        super().__init__(given)
        self.asked: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.asked.add(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.asked.add(name)
        return super().__getitem__(name)


def expand_xacro(file: Path, arguments: Mapping[str, str] = MappingProxyType({})) -> tuple[bytes, dict[str, str]]:
    """The URDF that a xacro file makes, and all its arguments; those that are not given are at their defaults.

    Raises: ValueError when the package xacro is missing or does not understand the file, and UnknownArgument for one that the file does
    not have.
    """
    try:
        import xacro
        from xacro import substitution_args
    except ImportError:
        mend = f"pip install xacro; or run: xacro {file.name} > {file.name.split('.')[0]}.urdf"
        raise ValueError(f"{file}: this is xacro, and the package xacro is not installed: {mend}") from None
    known = _Arguments(arguments)
    try:
        with _finding_packages(substitution_args, file):
            text = bytes(xacro.process_file(str(file), mappings=known).toxml(encoding="utf-8"))
    except Exception as e:  # xacro raises many kinds, all of them "this is no xacro"
        why = " ".join(str(e).split()) or type(e).__name__
        mend = "where it needs arguments: retrieve robots FILE --xacro-arg NAME:=VALUE … --urdf OUT.urdf (of a gripper: ARM --tool FILE)"
        if why.startswith(NO_PACKAGE):
            mend = "put it there, its folder called like it"
        raise ValueError(f"{file}: xacro does not understand it: {why}; {mend}") from e
    for name in set(arguments) - known.asked:
        has = sorted(set(known) - set(arguments))
        words = f"{file}: there is no xacro argument {name!r}{did_you_mean(name, has)}: it has {', '.join(has) or 'none'}"
        raise UnknownArgument(words, name)
    return text, dict(known)


@contextmanager
def _finding_packages(substitutions: object, file: Path) -> Iterator[None]:
    """Let xacro's $(find PACKAGE) look where meshes are looked for, which needs no ROS."""
    from unittest.mock import patch

    missing = list[str]()

    def find(package: str) -> str:
        folder = find_package(package, file)
        if folder is None:
            missing.append(f"{NO_PACKAGE} {package!r} in the folders above {file.parent}, nor on ROS_PACKAGE_PATH")
            raise ValueError(missing[-1])
        return str(folder)

    with patch.object(substitutions, "_eval_find", find):
        try:
            yield
        except Exception as e:  # xacro wraps what it meets in words of its own
            raise ValueError(missing[-1]) if missing else e from e


def drop_points(root: etree._Element) -> None:
    """Take out visual and collision elements without geometry, and those whose box is 0 0 0 or whose ball has the radius 0, in place: some
    exporters draw frames so."""
    for link in root.iter("link"):
        for element in (*link.findall("visual"), *link.findall("collision")):
            if (geometry := element.find("geometry")) is None or not len(geometry):
                link.remove(element)
                continue
            box, ball = element.find("geometry/box"), element.find("geometry/sphere")
            sizes = ["" if box is None else box.get("size", ""), "" if ball is None else ball.get("radius", "")]
            if any(text.split() and set(text.split()) <= {"0", "0.0", "0."} for text in sizes):
                link.remove(element)


def in_plain_words(root: etree._Element) -> None:
    """Say quaternions, capsules, colours, mimics and inertias as all readers of URDFs understand them, in place."""
    plain_mimics(root)
    _whole_inertials(root)
    _plain_origins(root)
    _turn_drakes_meshes(root)
    _plain_capsules(root)
    _plain_colours(root)


def plain_mimics(root: etree._Element) -> None:
    """Let each joint that mimics one that mimics another follow that one itself, in place: not all readers follow such chains. They are
    known to end."""
    follows = {j.get("name", ""): m for j in root.findall("joint") if (m := j.find("mimic")) is not None}
    for mimic in follows.values():
        while (after := follows.get(mimic.get("joint", ""))) is not None:
            rate = float(mimic.get("multiplier", "1"))
            mimic.set("multiplier", repr(rate * float(after.get("multiplier", "1"))))
            mimic.set("offset", repr(float(mimic.get("offset", "0")) + rate * float(after.get("offset", "0"))))
            mimic.set("joint", after.get("joint", ""))


def _whole_inertials(root: etree._Element) -> None:
    """Take out inertial elements without a mass or a whole inertia, in place: ROS's reader leaves out the links that have such."""
    for link in root.iter("link"):
        for element in link.findall("inertial"):
            mass, inertia = element.find("mass"), element.find("inertia")
            numbers = [None if mass is None else mass.get("value"), *(None if inertia is None else inertia.get(key) for key in _INERTIA)]
            if not all(_is_number(text) for text in numbers):
                link.remove(element)


def _is_number(text: str | None) -> bool:
    try:
        return text is not None and bool(np.isfinite(float(text)))
    except ValueError:
        return False


def _turn_drakes_meshes(root: etree._Element) -> None:
    """Turn the glTF meshes of Drake's models, whose y axis is up, as Drake does, in place. Those of others are in their link's frame."""
    for element in root.iter("visual", "collision"):
        mesh = element.find("geometry/mesh")
        name = "" if mesh is None else mesh.get("filename", "")
        if name.startswith(DRAKE) and name.endswith((".gltf", ".glb")):
            origin = element.find("origin")
            origin = etree.SubElement(element, "origin") if origin is None else origin
            R = rotation_rpy(np.array([float(v) for v in origin.get("rpy", "0 0 0").split()]))
            origin.set("rpy", " ".join(repr(float(v)) for v in rpy_from_rotation(R @ rotation_rpy((np.pi / 2, 0.0, 0.0)))))


def _plain_origins(root: etree._Element) -> None:
    """Turn `quat_xyzw` of origins (URDF 1.2) into `rpy`, in place."""
    for origin in root.iter("origin"):
        if (quaternion := origin.attrib.pop("quat_xyzw", None)) is not None:
            x, y, z, w = (float(v) for v in quaternion.split())
            size = float(np.linalg.norm([x, y, z, w]))
            if not size > 0:
                raise ValueError(f"quat_xyzw {quaternion!r} is no rotation")
            R = rotation_from_wxyz(np.array([w, x, y, z]) / size)
            origin.set("rpy", " ".join(repr(float(v)) for v in rpy_from_rotation(R)))


def _plain_capsules(root: etree._Element) -> None:
    """Turn each capsule (URDF 1.2: `length` is its cylinder's) into that cylinder and a ball at either end, in place: the same solid."""
    for capsule in list(root.iter("capsule")):
        geometry = capsule.getparent()
        element = geometry.getparent()
        radius, length = capsule.get("radius", ""), capsule.get("length", "")
        geometry.replace(capsule, etree.Element("cylinder", radius=radius, length=length))
        for end in (-1, 1):
            ball = etree.Element(element.tag)
            _origin_along(ball, element.find("origin"), end * float(length) / 2)
            etree.SubElement(etree.SubElement(ball, "geometry"), "sphere", radius=radius)
            element.addnext(ball)


def visuals_collide(root: etree._Element) -> list[str]:
    """Take what is drawn for collision geometry, in place: in a URDF that has none at all, and of fingers, jaws and palms that have none.

    Returns the links' names. The joints are known to make a tree.
    """
    drawn = {link: [v for v in link.iter("visual") if v.find("geometry") is not None] for link in root.iter("link")}
    if next(root.iter("collision"), None) is not None:
        bare = _bare_ends(root)
        drawn = {link: visuals for link, visuals in drawn.items() if link.get("name") in bare}
    for visuals in drawn.values():
        _collide(visuals)
    return [link.get("name", "") for link, visuals in drawn.items() if visuals]


def visuals_instead(root: etree._Element, names: Collection[str]) -> list[str]:
    """Take what is drawn of links in place of their collision geometry, in place. Returns those of the links of which anything is drawn."""
    replaced = list[str]()
    for link in root.iter("link"):
        visuals = [v for v in link.iter("visual") if v.find("geometry") is not None]
        if link.get("name") in names and visuals:
            for collision in link.findall("collision"):
                link.remove(collision)
            _collide(visuals)
            replaced.append(link.get("name", ""))
    return replaced


def drop_covers(root: etree._Element, names: Collection[str]) -> list[str]:
    """Take away the collision geometry of links of which nothing is drawn, in place: coarse solids around another link, as Franka's
    `hand_sc` are. Returns those links."""
    covers = [link for link in root.iter("link") if link.get("name") in names and link.find("visual") is None]
    for link in covers:
        for collision in link.findall("collision"):
            link.remove(collision)
    return [link.get("name", "") for link in covers]


def _collide(visuals: Iterable[etree._Element]) -> None:
    """Put collision geometry beside each visual element, the same as it."""
    for visual in visuals:
        collision = etree.Element("collision")
        collision.extend([deepcopy(part) for part in visual if part.tag in ("origin", "geometry")])
        visual.addnext(collision)


def frozen_mimics(root: etree._Element) -> list[str]:
    """The names of fixed joints that have a <mimic> all the same, which is taken away: converters freeze what they can't drive."""
    frozen = [(joint, mimic) for joint in root.iter("joint") if joint.get("type") == "fixed" for mimic in joint.findall("mimic")]
    for joint, mimic in frozen:
        joint.remove(mimic)
    return [joint.get("name", "") for joint, _ in frozen]


def _bare_ends(root: etree._Element) -> set[str]:
    """The links at the ends of a tree, moved by the last joints, and those that carry these, where nothing that is fixed to them has
    collision geometry."""
    ends = {j: tuple(j.find(end).get("link", "") for end in ("parent", "child")) for j in root.iter("joint") if j.find("child") is not None}
    above = {child: (parent, j.get("type") == "fixed") for j, (parent, child) in ends.items()}

    def group(link: str) -> str:
        while link in above and above[link][1]:
            link = above[link][0]
        return link

    moved = {child for child, (_, fixed) in above.items() if not fixed}
    carried_by = {child: group(above[child][0]) for child in moved}
    last = moved - set(carried_by.values())
    at_ends = (last | {carried_by[link] for link in last}) & moved
    solid = {group(link.get("name", "")) for link in root.iter("link") if link.find("collision") is not None}
    return {name for link in root.iter("link") if group(name := link.get("name", "")) in at_ends - solid}


def _plain_colours(root: etree._Element) -> None:
    """Make each colour four numbers, in place: readers refuse a robot for a colour of three or five, which only pictures show."""
    for colour in root.iter("color"):
        words = colour.get("rgba", "").split()
        try:
            values = [float(word) for word in words]
        except ValueError:
            values = []
        if len(values) != 4:
            colour.set("rgba", " ".join([*words[:3], words[-1] if len(words) > 4 else "1"]) if len(values) > 2 else GREY)


def _origin_along(element: etree._Element, origin: etree._Element | None, along_z: float) -> None:
    """Give an element the origin of another one, moved along that one's z."""
    given = {} if origin is None else origin.attrib
    xyz, rpy = (np.array([float(v) for v in given.get(key, "0 0 0").split()]) for key in ("xyz", "rpy"))
    p = xyz + along_z * rotation_rpy(rpy)[:, 2]
    etree.SubElement(element, "origin", xyz=" ".join(repr(float(v)) for v in p), rpy=" ".join(repr(float(v)) for v in rpy))


def apply_soft_limits(root: etree._Element) -> list[str]:
    """Narrow joints' limits to the soft limits of their `safety_controller`, in place. Returns the names of the joints that it narrowed."""
    narrowed = list[str]()
    for joint in root.iter("joint"):
        safety = joint.find("safety_controller")
        if safety is None:
            continue
        soft_lower, soft_upper = (float(safety.get(key, "0")) for key in ("soft_lower_limit", "soft_upper_limit"))
        if soft_lower >= soft_upper:  # 0 and 0 where they are not given
            continue
        limit = joint.find("limit")
        if limit is None:
            limit = etree.SubElement(joint, "limit")
        endless = joint.get("type") == "continuous"
        lower, upper = (-np.inf, np.inf) if endless else (float(limit.get(key, "0")) for key in ("lower", "upper"))
        if soft_lower > lower or soft_upper < upper:
            limit.set("lower", repr(max(lower, soft_lower)))
            limit.set("upper", repr(min(upper, soft_upper)))
            joint.set("type", "revolute" if endless else joint.get("type", ""))
            narrowed.append(joint.get("name", ""))
    return narrowed
