"""A robot's kinematics read from its URDF text alone, for many configurations at once in numpy: what checks others, and no planner uses.

Links that are fixed to one another go together: what moves are `carriers`, one for each joint that moves, and carrier 0, the base.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from kinematics.transforms import Array, rotation_rpy, transform


@dataclass(frozen=True, eq=False)
class Joint:
    """What moves carrier `index + 1` in carrier `parent`, and how actuated joint `source` drives it.

    Its pose at value x = scale · q[source] + offset is basis (4, 4, 4) weighted with 1, sin(x), 1 - cos(x) and x.
    """

    parent: int
    basis: Array
    source: int
    scale: float
    offset: float


@dataclass(frozen=True, eq=False)
class Arm:
    """joints (J names): the actuated ones, mimic joints left out, in the URDF's order; lower, upper, velocity (J,): their limits, infinite
    where there is none; units (J,): what their values count, "rad" or "m". effort (J,): at most so hard, in N or Nm, they are driven
    together with their mimic joints; infinite where the URDF gives none. moving: one `Joint` for each carrier but the base. links: by name,
    the carrier and the pose (4, 4) in it.

    above[c]: the carriers on the way from the base to carrier c, itself included. followers: mimic joints by name, and what they follow:
    the index of an actuated joint, scale and offset.
    """

    joints: tuple[str, ...]
    lower: Array
    upper: Array
    velocity: Array
    effort: Array
    units: tuple[str, ...]
    moving: tuple[Joint, ...]
    links: dict[str, tuple[int, Array]]
    parent_link: dict[str, str]
    above: tuple[frozenset[int], ...]
    followers: dict[str, tuple[int, float, float]]

    @cached_property
    def drives(self) -> tuple[NDArray[np.int64], Array, Array, Array]:
        """Of all that moves: source, scale and offset (C,), basis (C, 4, 16), each in a row."""
        source = np.array([j.source for j in self.moving], np.int64)
        scale, offset = (np.array([x for j in self.moving for x in (j.scale, j.offset)]).reshape(-1, 2)).T
        return source, scale, offset, np.array([j.basis.reshape(4, 16) for j in self.moving]).reshape(-1, 4, 16)

    def driven_by(self, carrier: int) -> frozenset[int]:
        """The actuated joints that move a carrier."""
        return frozenset(self.moving[c - 1].source for c in self.above[carrier] if c)


def poses(arm: Arm, q: Array, T_world_base: Array, wanted: frozenset[int] | None = None) -> dict[int, Array]:
    """Poses (N, 4, 4) of carriers in the world at configurations q (N, J); of all of them, or of those wanted and what carries these."""
    needed = None if wanted is None else frozenset().union(*(arm.above[c] for c in wanted))
    out = {0: np.broadcast_to(T_world_base, (len(q), 4, 4))}
    chosen = [c for c in range(1, len(arm.moving) + 1) if needed is None or c in needed]
    source, scale, offset, basis = (of_all[[c - 1 for c in chosen]] for of_all in arm.drives)
    x = (scale * q[:, source] + offset).T
    weights = np.stack([np.ones_like(x), np.sin(x), 1 - np.cos(x), x], axis=-1)
    for c, local in zip(chosen, (weights @ basis).reshape(-1, len(q), 4, 4)):
        parent = arm.moving[c - 1].parent
        out[c] = (T_world_base if parent == 0 else out[parent]) @ local
    return out


@lru_cache(maxsize=8)
def read(urdf: str) -> Arm:
    """The arm of a cleaned URDF text, as `kinematics.robots` keeps it. Raises: ValueError for joints that it can't follow."""
    root = ElementTree.fromstring(urdf)
    by_name = {j.attrib["name"]: j for j in root.findall("joint")}
    by_child = {_link(j, "child"): j for j in by_name.values()}
    parents = {child: _link(j, "parent") for child, j in by_child.items()}
    order = _from_the_root([e.attrib["name"] for e in root.findall("link")], parents)
    joints = [by_child[link] for link in order[1:]]
    actuated = [j.attrib["name"] for j in joints if j.get("type") != "fixed" and j.find("mimic") is None]
    limits = np.array([_limits(by_name[n]) for n in actuated])
    units = tuple("m" if by_name[n].get("type") == "prismatic" else "rad" for n in actuated)
    moving: list[Joint] = []
    links, above = {order[0]: (0, np.eye(4))}, [frozenset({0})]
    for link in order[1:]:
        joint = by_child[link]
        carrier, T = links[parents[link]]
        T = T @ _origin(joint)
        if joint.get("type") == "fixed":
            links[link] = (carrier, T)
            continue
        source, scale, offset = _source(by_name, joint)
        moving.append(_joint(joint, carrier, T, actuated.index(source), scale, offset))
        above.append(above[carrier] | {len(moving)})
        links[link] = (len(moving), np.eye(4))
    low, high, speed, effort = limits.T
    follow = {name: _source(by_name, joint) for name, joint in by_name.items() if joint.find("mimic") is not None}
    followers = {name: (actuated.index(source), scale, offset) for name, (source, scale, offset) in follow.items() if source in actuated}
    for name, (k, scale, _) in followers.items():
        own = _limits(by_name[name])[3]
        effort[k] += abs(scale) * own if own < np.inf else 0.0
    return Arm(tuple(actuated), low, high, speed, effort, units, tuple(moving), links, parents, tuple(above), followers)


def _from_the_root(names: list[str], parents: dict[str, str]) -> list[str]:
    """The links, parents before children. Raises: ValueError when there is more than one root, or none."""
    roots = [n for n in names if n not in parents]
    if len(roots) != 1:
        raise ValueError(f"the URDF has {len(roots)} root links, and a tree has one")
    children: dict[str, list[str]] = {}
    for child, parent in parents.items():
        children.setdefault(parent, []).append(child)
    order = roots
    for link in order:
        order += children.get(link, [])
    return order


def _joint(element: ElementTree.Element, parent: int, T: Array, source: int, scale: float, offset: float) -> Joint:
    """A moving joint. Raises: ValueError for one that neither turns nor slides."""
    kind = element.attrib["type"]
    if kind not in ("revolute", "continuous", "prismatic"):
        raise ValueError(f"joint {element.get('name')!r} is of type {kind!r}; revolute, continuous, prismatic and fixed can be followed")
    at = element.find("axis")
    axis = np.array([1.0, 0.0, 0.0]) if at is None else _numbers(at.get("xyz", "1 0 0"))
    x, y, z = axis / np.linalg.norm(axis)
    K = np.zeros((4, 4))
    K[:3, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    basis = np.zeros((4, 4, 4))
    basis[0] = T
    if kind == "prismatic":
        basis[3, :3, 3] = T[:3, :3] @ [x, y, z]
    else:
        basis[1:3] = T @ K, T @ K @ K
    return Joint(parent, basis, source, scale, offset)


def _source(by_name: dict[str, ElementTree.Element], joint: ElementTree.Element) -> tuple[str, float, float]:
    """The actuated joint behind one, and how it follows. Raises: ValueError for one that follows itself, or nothing."""
    scale, offset, seen = 1.0, 0.0, set[str]()
    while (mimic := joint.find("mimic")) is not None:
        name = mimic.attrib["joint"]
        if name in seen or name not in by_name:
            raise ValueError(f"joint {joint.get('name')!r} mimics {name!r}, which leads nowhere")
        seen.add(name)
        offset += scale * float(mimic.get("offset") or 0.0)
        scale *= float(mimic.get("multiplier") or 1.0)
        joint = by_name[name]
    return joint.attrib["name"], scale, offset


def _limits(joint: ElementTree.Element) -> tuple[float, float, float, float]:
    """Lower and upper limit, those of velocity and effort; infinite where the URDF says nothing. The last two say nothing with 0, too."""
    limit = joint.find("limit")
    given = {} if limit is None else limit.attrib
    endless = joint.get("type") == "continuous"
    low, high = (-np.inf, np.inf) if endless else (float(given.get("lower", 0.0)), float(given.get("upper", 0.0)))
    return low, high, float(given.get("velocity", 0.0)) or np.inf, float(given.get("effort", 0.0)) or np.inf


def _origin(joint: ElementTree.Element) -> Array:
    at = joint.find("origin")
    if at is None:
        return np.eye(4)
    return transform(rotation_rpy(_numbers(at.get("rpy", "0 0 0"))), _numbers(at.get("xyz", "0 0 0")))


def _link(joint: ElementTree.Element, which: str) -> str:
    """The name of a joint's parent or child."""
    return next(joint.iter(which)).attrib["link"]


def _numbers(text: str) -> Array:
    return np.array([float(x) for x in text.split()])
