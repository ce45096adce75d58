"""All that takes long to find out about a cleaned URDF, as plain arrays that are kept on disk: the tree, the hulls, what always touches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from kinematics import cache
from kinematics.robots.link_geometry import check_sizes, link_hulls, take_apart
from kinematics.robots.tree import FIXED, SLIDES, TURNS, LinkHull, Tree
from kinematics.transforms import Array


def fingerprint(data: dict[str, NDArray[Any]]) -> str:
    """A hash of all that forward kinematics depends on; robots.toml has those of the named robots, which the tests check."""
    arrays = [np.round(np.asarray(data[k], float), 9) + 0.0 for k in ("parent", "T_joint", "kind", "axis", "q_index", "scale", "offset")]
    return cache.key(*(str(n) for n in data["links"]), *(a.tobytes() for a in arrays))


@dataclass(frozen=True, eq=False)
class Description:
    """A URDF as read: the tree, its actuated joints' names, limits (J, 3), lower, upper and velocity, the link hulls; notes about these."""

    tree: Tree
    joints: tuple[str, ...]
    limits: Array
    hulls: tuple[LinkHull, ...]
    notes: tuple[str, ...]


def read_description(text: str, name: str, *, apart: bool = True) -> Description:
    """The tree and the hulls of a cleaned URDF. apart: concave meshes are taken apart.

    Raises: ValueError where it has no collision geometry, or a mesh that is invalid.
    """
    import yourdfpy

    model = yourdfpy.URDF.load(
        BytesIO(text.encode()), filename_handler=lambda fname: fname, load_meshes=False, build_scene_graph=True, load_collision_meshes=False
    )
    check_sizes(model)
    tree, joints = _tree(model)
    at_grippers = _at_grippers(tree)
    if apart:
        take_apart((model.link_map[link] for link in tree.names), at_grippers)
    found = [link_hulls(model.link_map[link], at_grippers, apart=apart) for link in tree.names]
    hulls, notes = tuple(h for hulls, _ in found for h in hulls), tuple(note for _, notes in found for note in notes)
    if not hulls:
        raise ValueError(f"robot {name} has links but no collision geometry: add <collision> elements to its URDF")
    limits = np.array([_limits(model.joint_map[j]) for j in joints]).reshape(-1, 3)
    return Description(tree, tuple(joints), limits, hulls, notes)


def derive(text: str, name: str, srdf: Path | None, renamed: Mapping[str, str], *, apart: bool = True) -> dict[str, NDArray[Any]]:
    """All that takes long: the tree, the link hulls and the pairs that always touch, as plain arrays. apart: see `read_description`."""
    from kinematics.collision.fcl_solids import always_touching

    known = read_description(text, name, apart=apart)
    tree, joints, limits, hulls = known.tree, known.joints, known.limits, known.hulls
    skip = _neighbours(tree, {h.link for h in hulls}) | _from_srdf(srdf, renamed)
    rng = np.random.default_rng(0)
    low, high = np.where(np.isinf(limits[:, 0]), -np.pi, limits[:, 0]), np.where(np.isinf(limits[:, 1]), np.pi, limits[:, 1])
    samples = [dict(zip(tree.names, tree.poses(rng.uniform(low, high)))) for _ in range(200)]
    skip |= always_touching(hulls, samples, skip)
    return {
        "joints": np.array(joints, dtype=np.str_),
        "limits": limits,
        "links": np.array(tree.names, dtype=np.str_),
        **{k: getattr(tree, k) for k in ("parent", "T_joint", "kind", "axis", "q_index", "scale", "offset")},
        "hull_link": np.array([h.link for h in hulls], dtype=np.str_),
        "hull_vertices": np.concatenate([h.vertices for h in hulls]),
        "hull_faces": np.concatenate([h.faces for h in hulls]),
        "hull_counts": np.array([(len(h.vertices), len(h.faces)) for h in hulls]),
        "notes": np.array(known.notes, dtype=np.str_),
        "skip": np.array(sorted(tuple(sorted(pair)) for pair in skip if len(pair) == 2), dtype=np.str_).reshape(-1, 2),
    }


def _at_grippers(tree: Tree) -> frozenset[str]:
    """The links that the last moving joints of every branch carry, and those that carry these, with all that is fixed to them: jaws and
    palms, where there is a gripper."""
    moving = [int(i) for i in np.flatnonzero(tree.kind != FIXED)]
    ends = [i for i in moving if not any(i in tree.path(k)[:-1] for k in moving)]
    group = {i: next((k for k in tree.path(i)[::-1] if tree.kind[k] != FIXED), 0) for i in range(len(tree.names))}
    at = set(ends) | {group[int(tree.parent[i])] for i in ends}
    return frozenset(name for i, name in enumerate(tree.names) if group[i] in at)


def _tree(model: Any) -> tuple[Tree, list[str]]:
    """yourdfpy's links in topological order, and the names of the actuated joints (mimic joints left out)."""
    by_child = {j.child: j for j in model.joint_map.values()}
    roots = [name for name in model.link_map if name not in by_child]
    order = [roots[0]]
    children: dict[str, list[str]] = {}
    for j in model.joint_map.values():
        children.setdefault(j.parent, []).append(j.child)
    for link in order:
        order += children.get(link, [])
    movable = {"revolute": TURNS, "continuous": TURNS, "prismatic": SLIDES, "fixed": FIXED}
    joints = [j.name for link in order[1:] if (j := by_child[link]).type != "fixed" and j.mimic is None]
    n = len(order)
    parent, kind, q_index = np.full(n, -1), np.zeros(n, np.int64), np.full(n, -1)
    T, axis, scale, offset = np.tile(np.eye(4), (n, 1, 1)), np.tile([1.0, 0.0, 0.0], (n, 1)), np.ones(n), np.zeros(n)
    for i, link in enumerate(order[1:], 1):
        j = by_child[link]
        parent[i], kind[i] = order.index(j.parent), movable[j.type]
        T[i] = np.eye(4) if j.origin is None else j.origin
        if kind[i] != FIXED:
            axis[i] = np.asarray(j.axis, float) / np.linalg.norm(j.axis)
            source = j
            while source.mimic is not None:  # a mimic of a mimic follows the first
                scale[i], offset[i] = scale[i] * _or(source.mimic.multiplier, 1.0), offset[i] + scale[i] * _or(source.mimic.offset, 0.0)
                source = model.joint_map[source.mimic.joint]
            q_index[i] = joints.index(source.name)
    return Tree(tuple(order), parent.astype(np.int64), T, kind, axis, q_index.astype(np.int64), scale, offset), joints


def _or(value: float | None, default: float) -> float:
    return default if value is None else float(value)


def _limits(joint: Any) -> tuple[float, float, float]:
    limit = joint.limit
    speed = _or(limit.velocity if limit else None, 1.0) or 1.0
    if joint.type == "continuous":
        return -np.inf, np.inf, speed
    return _or(limit.lower, 0.0), _or(limit.upper, 0.0), speed


def _neighbours(tree: Tree, solid: set[str]) -> set[frozenset[str]]:
    """Links with geometry that are joined directly, or through links without any."""
    pairs = set()
    for i, name in enumerate(tree.names):
        above = int(tree.parent[i])
        while above >= 0 and tree.names[above] not in solid:
            above = int(tree.parent[above])
        if above >= 0 and name in solid:
            pairs.add(frozenset((name, tree.names[above])))
    return pairs


def _from_srdf(srdf: Path | None, renamed: Mapping[str, str]) -> set[frozenset[str]]:
    """The pairs of links that an SRDF switches off; renamed: links that have another name by now."""
    if srdf is None:
        return set()
    root = etree.fromstring(srdf.read_bytes(), etree.XMLParser(recover=True))
    pairs = ((e.get("link1", ""), e.get("link2", "")) for e in root.iter("disable_collisions"))
    return {frozenset(renamed.get(name, name) for name in pair) for pair in pairs}
