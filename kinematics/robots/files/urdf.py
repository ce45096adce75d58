"""URDF files made fit for every reader: cleaned of foreign tags, joined, with absolute mesh paths and extra frames.

yourdfpy, pytorch-kinematics and pinocchio each stumble over something else (undeclared XML prefixes, transmissions, package URIs,
capsules); what leaves this module is plain URDF that all of them read.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from copy import deepcopy
from itertools import count
from pathlib import Path
from types import MappingProxyType

import numpy as np
from lxml import etree

from kinematics.git_lfs import refuse_pointer
from kinematics.robots.files.dialects import (
    UnknownArgument,
    apply_soft_limits,
    drop_points,
    expand_xacro,
    frozen_mimics,
    in_plain_words,
    is_xacro,
    visuals_collide,
)
from kinematics.robots.files.joint_checks import check_joints, check_numbers, check_shapes
from kinematics.robots.files.mesh_files import find_mesh
from kinematics.robots.files.mobile_base import hold_base
from kinematics.transforms import Array, rpy_from_rotation

_KEEP = {"link", "joint", "visual", "collision", "inertial", "geometry", "origin", "mass", "inertia", "parent", "child", "axis", "limit"}
_KEEP |= {"mimic", "mesh", "box", "cylinder", "sphere", "material", "color"}
NO_TRIANGLE = (80, 84)
"""Bytes of an STL file with nothing but its head, without or with the number of triangles, as some exporters write one for a frame."""
_BROKEN = {"ERR_TAG_NOT_FINISHED", "ERR_TAG_NAME_MISMATCH", "ERR_ATTRIBUTE_NOT_FINISHED", "ERR_GT_REQUIRED"}
"""What libxml2 says of XML whose elements don't end where they should."""
_MISPLACED = {("link", "origin"), ("collision", "material")}  # pytorch-kinematics prints a line for each


def read(file: Path, arguments: Mapping[str, str] = MappingProxyType({})) -> tuple[etree._Element, tuple[str, ...]]:
    """Read and clean a URDF or xacro file: only kinematics, inertia and geometry stay, mesh names become absolute paths.

    arguments: of a xacro file, by name; the others are at their defaults.
    Returns the root element and notes: what was changed or left out, a line each.
    Raises: ValueError when the file is missing, is no URDF, has invalid values, or names a collision mesh that does not exist.
    """
    if not file.is_file():
        raise ValueError(f"URDF file {file} does not exist")
    refuse_pointer(file, "URDF")
    text, said = file.read_bytes(), dict[str, str]()
    if is_xacro(file, text):
        text, said = expand_xacro(file, arguments)
    elif arguments:
        raise UnknownArgument(f"{file}: arguments are for xacro, and this is none", next(iter(arguments)))
    root = _parsed(file, text)
    if root.find("link") is None:
        macros = "; it defines macros: give the file that calls them" if b"xacro:macro" in file.read_bytes() else ""
        raise ValueError(f"{file} has no links{macros}")
    try:
        drop_points(root)
        check_shapes(root)
        check_numbers(root)
        notes = [f"xacro arguments: {' '.join(f'{name}:={value}' for name, value in said.items())} (others: --xacro-arg)"] if said else []
        notes += [f"joint {name} stands still: the scene's robot pose says where the robot is" for name in hold_base(root)]
        notes += [f"joint {name} keeps to the soft limits of its safety_controller" for name in apply_soft_limits(root)]
        check_joints(root)
        if frozen := frozen_mimics(root):
            notes.append(f"joints with <mimic> that are fixed stand still; where they move, say their type: {', '.join(frozen)}")
        if drawn := visuals_collide(root):
            notes.append(f"what is drawn is taken for the collision geometry that is missing of the links {', '.join(drawn)}")
        in_plain_words(root)
        _drop_foreign(root)
        notes += _find_meshes(root, file)
    except ValueError as e:
        raise ValueError(f"{file}: {e}") from e
    return root, tuple(notes)


def _parsed(file: Path, text: bytes) -> etree._Element:
    """The root element of a URDF's text, its name the file's where it has none, its tags without a default namespace.

    Raises: ValueError when it is no URDF, or is cut off: an XML parser that goes on would leave out what does not end.
    """
    parser = etree.XMLParser(recover=True, remove_comments=True, remove_pis=True)
    try:
        root = etree.fromstring(text, parser)
    except etree.XMLSyntaxError as e:
        raise ValueError(f"{file} is no URDF: {e}") from e
    if broken := next((e for e in parser.error_log if e.type_name in _BROKEN), None):
        raise ValueError(f"{file} is broken, or cut off: line {broken.line}: {broken.message.strip()}")
    if root is not None and (default := root.nsmap.get(None)):  # as Drake's has
        for element in root.iter(f"{{{default}}}*"):
            element.tag = etree.QName(element).localname
        etree.cleanup_namespaces(root)
    if root is None or root.tag != "robot":
        raise ValueError(f"{file} is no URDF: its root element is {f'<{root.tag}>, ' if root is not None else ''}not <robot>")
    if not root.get("name"):
        root.set("name", file.stem)
    return root


def _find_meshes(root: etree._Element, file: Path) -> list[str]:
    """Make mesh names absolute paths, in place; links whose visual meshes are missing are drawn by their collision geometry, and noted.

    Raises: ValueError for a collision mesh that is missing, with the places that were looked at.
    """
    missing, hollow = list[tuple[str, str]](), dict[str, str]()
    for link in root.iter("link"):
        for kind in ("collision", "visual"):
            for element in link.findall(kind):
                mesh = element.find("geometry/mesh")
                if mesh is None:
                    continue
                name = mesh.get("filename", "")
                try:
                    path = find_mesh(name, file)
                    mesh.set("filename", str(path))
                    if path.suffix.lower() == ".stl" and path.stat().st_size in NO_TRIANGLE:
                        link.remove(element)
                        hollow[name] = link.get("name", "")
                except FileNotFoundError as e:
                    if kind == "collision":
                        raise ValueError(f"link {link.get('name')!r} names the mesh {name}, which does not exist: {e}") from e
                    missing.append((name, link.get("name", "")))
                    link.remove(element)
        if missing and missing[-1][1] == link.get("name", "") and link.find("visual") is None:
            _draw_collision(link)
    notes = [f"the mesh {name} of the link {link} has no triangles, and is left out" for name, link in hollow.items()]
    links = ", ".join(link for _, link in missing)
    if len(missing) > 1:
        words = f"{len(missing)} visual meshes, {missing[0][0]} the first, do not exist"
        notes.append(f"{words}; of the links {links} collision geometry is drawn")
    elif missing:
        notes.append(f"the visual mesh {missing[0][0]} of the link {links} does not exist; its collision geometry is drawn")
    return notes


def _draw_collision(link: etree._Element) -> None:
    """Draw a link's collision geometry, in place."""
    for element in link.findall("collision"):
        drawn = deepcopy(element)
        drawn.tag = "visual"
        link.append(drawn)


def join(root: etree._Element, tool: etree._Element, at: str, T: Array, prefix: str) -> None:
    """Hang `tool` on link `at` of `root` at the fixed pose T (4, 4), in place; names that both have get the prefix."""
    taken = {e.get("name") for e in root if e.tag in ("link", "joint")}
    rename = {n: prefix + n for e in tool if e.tag in ("link", "joint") and (n := e.get("name", "")) in taken}
    for e in tool.iter("link", "joint"):
        e.set("name", rename.get(e.get("name", ""), e.get("name", "")))
    for e in tool.iter("parent", "child"):
        e.set("link", rename.get(e.get("link", ""), e.get("link", "")))
    for e in tool.iter("mimic"):
        e.set("joint", rename.get(e.get("joint", ""), e.get("joint", "")))
    children = {e.get("link") for e in tool.iter("child")}
    base = next(e.get("name", "") for e in tool.iter("link") if e.get("name") not in children)
    for e in list(tool):
        root.append(e)
    add_fixed_joint(root, f"{at}_to_{base}", at, base, T)


def add_fixed_joint(root: etree._Element, name: str, parent: str, child: str, T: Array) -> None:
    """Append a fixed joint that puts `child` at pose T (4, 4) in `parent`; where there is a joint of that name, with a number behind it."""
    joint = etree.SubElement(root, "joint", name=_free(name, {e.get("name", "") for e in root.iter("joint")}), type="fixed")
    _origin(joint, T)
    etree.SubElement(joint, "parent", link=parent)
    etree.SubElement(joint, "child", link=child)


def add_link(root: etree._Element, name: str, parent: str, T: Array, boxes: tuple[tuple[Array, Array], ...] = ()) -> None:
    """Append a link at pose T (4, 4) in `parent`, with boxes (size (3,), centre (3,)) as its visual and collision geometry.

    A link that has the name already steps aside: it is called `<name>_original` from then on, with a number behind it where that is taken.
    """
    names = {e.get("name", "") for e in root.iter("link")}
    if name in names:
        aside = _free(f"{name}_original", names)
        for e in root.iter("link"):
            if e.get("name") == name:
                e.set("name", aside)
        for e in root.iter("parent", "child"):
            if e.get("link") == name:
                e.set("link", aside)
        parent = aside if parent == name else parent
    link = etree.SubElement(root, "link", name=name)
    for size, centre in boxes:
        for kind in ("visual", "collision"):
            element = etree.SubElement(link, kind)
            etree.SubElement(element, "origin", xyz=_numbers(centre), rpy="0 0 0")
            etree.SubElement(etree.SubElement(element, "geometry"), "box", size=_numbers(size))
    add_fixed_joint(root, f"{parent}_to_{name}", parent, name, T)


def rename_links(root: etree._Element, taken: Collection[str]) -> dict[str, str]:
    """Give links whose names are taken another one, in place: `left` becomes `left_link`. Returns the new names by the old ones."""
    names = {e.get("name", "") for e in root.iter("link")}
    renamed = dict[str, str]()
    for old in sorted(names & set(taken)):
        new = f"{old}_link"
        while new in names or new in taken:
            new += "_link"
        names.add(new)
        renamed[old] = new
    for tags, key in ((("link",), "name"), (("parent", "child"), "link")):
        for e in root.iter(*tags):
            e.set(key, renamed.get(e.get(key, ""), e.get(key, "")))
    return renamed


def to_string(root: etree._Element) -> str:
    """The URDF as text, indented."""
    etree.indent(root)
    return str(etree.tostring(root, encoding="unicode", pretty_print=True))


def _drop_foreign(element: etree._Element) -> None:
    for child in list(element):
        colourless = (element.tag, child.tag) == ("robot", "material") and child.find("color") is None
        if not isinstance(child.tag, str) or child.tag not in _KEEP or (element.tag, child.tag) in _MISPLACED or colourless:
            element.remove(child)
        else:
            unwanted = [k for k in child.attrib if ":" in k or k.startswith("{") or (k == "name" and child.tag in ("visual", "collision"))]
            unwanted += [k for k in child.attrib if child.tag == "link" and k != "name" and k not in unwanted]
            for key in unwanted:
                del child.attrib[key]
            _drop_foreign(child)


def _free(name: str, taken: Collection[str]) -> str:
    """The name, or where it is taken, the first that is not with a number from 2 on behind it."""
    return next(n for n in (name if i == 1 else f"{name}_{i}" for i in count(1)) if n not in taken)


def _origin(element: etree._Element, T: Array) -> None:
    etree.SubElement(element, "origin", xyz=_numbers(T[:3, 3]), rpy=_numbers(rpy_from_rotation(T[:3, :3])))


def _numbers(values: Array) -> str:
    return " ".join(repr(float(v)) for v in np.asarray(values, float))
