"""From a cleaned URDF with a `hand` link to a Robot: derived and checked once, and kept on disk from then on.

What is derived is cached under a key of the URDF's text and the meshes' sizes and dates.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from kinematics import cache
from kinematics.robots.derive import derive, fingerprint
from kinematics.robots.files import urdf
from kinematics.robots.hands.measured import measure_once
from kinematics.robots.hands.suction import VALVE, measure_cup
from kinematics.robots.limits import joint_limits, too_fast
from kinematics.robots.named import named_robots
from kinematics.robots.robot import Robot
from kinematics.robots.selfcheck import check_kinematics
from kinematics.robots.tree import FIXED, TURNS, LinkHull, Tree
from kinematics.scene import WALLS
from kinematics.transforms import Array

CACHE_VERSION = "robot-9"  # raise it when what `derive` computes changes


def stamps(root: etree._Element) -> list[str]:
    """What tells a URDF's meshes from others: their names, sizes and dates."""
    return [f"{f}:{Path(f).stat().st_size}:{Path(f).stat().st_mtime_ns}" for m in root.iter("mesh") if (f := m.get("filename"))]


def assemble(
    name: str,
    title: str,
    root: etree._Element,
    gripper: str,
    home: list[float] | None,
    base_p: Array,
    srdf: Path | None,
    on_step: Callable[[str], None] | None,
    sheet: dict[str, Any] | None = None,
    notes: tuple[str, ...] = (),
) -> Robot:
    """The Robot behind a cleaned URDF with a `hand` link: from the cache, or derived and cached. Links called like a wall of the cabinet
    get another name."""
    renamed = urdf.rename_links(root, WALLS)
    text = urdf.to_string(root)
    name_in_cache = "robot-" + cache.key(CACHE_VERSION, text, *stamps(root), srdf.read_text(encoding="utf-8") if srdf else "")
    data = cache.load(name_in_cache)
    if data is not None:
        return _told(_robot(name, title, text, data, gripper, home, base_p, sheet, notes), on_step)
    if on_step and name in named_robots():  # of one's own they were read for its grip
        on_step(f"reading the meshes of {title}")
    try:
        data = derive(text, name, srdf, renamed, apart=name not in named_robots())  # the named ones' meshes are convex, or meant as hulls
        robot = _robot(name, title, text, data, gripper, home, base_p, sheet, notes)
        if fingerprint(data) != named_robots().get(name, {}).get("checked_kinematics"):
            if on_step:
                on_step(f"comparing the kinematics of {title} with another reading of its URDF")
            check_kinematics(robot)
    except ValueError as e:
        raise e if str(e).startswith((f"robot {name}", "mesh file")) else ValueError(f"robot {name}: {e}") from e
    except Exception as e:  # readers of URDFs and meshes raise many kinds, all of them "this is no robot"
        raise ValueError(f"robot {name}: its URDF can't be understood ({type(e).__name__}: {e})") from e
    cache.store(name_in_cache, data)  # only what passed the check is kept
    return _told(robot, on_step)


def _told(robot: Robot, on_step: Callable[[str], None] | None) -> Robot:
    """The robot, once its notes were told."""
    for note in robot.notes:
        if on_step:
            on_step(f"robot {robot.name}: {note}")
    return robot


def _robot(
    name: str,
    title: str,
    text: str,
    data: dict[str, NDArray[Any]],
    gripper: str,
    home: list[float] | None,
    base_p: Array,
    sheet: dict[str, Any] | None,
    notes: tuple[str, ...],
) -> Robot:
    tree = Tree(
        tuple(str(n) for n in data["links"]), *(data[k] for k in ("parent", "T_joint", "kind", "axis", "q_index", "scale", "offset"))
    )
    joints = tuple(str(j) for j in data["joints"])
    lower, upper = data["limits"].T[:2]
    way = tree.path(tree.index["hand"])
    arm = list(dict.fromkeys(int(tree.q_index[i]) for i in way if tree.kind[i] != FIXED))
    if not arm:
        raise ValueError(f"robot {name}: no joint moves the hand frame")
    g = joints.index(gripper)
    hulls = _hulls(data)
    moved_by_gripper = {i for i in range(len(tree.names)) if any(tree.q_index[k] == g for k in tree.path(i))}
    fingers = frozenset(tree.names[i] for i in moved_by_gripper) & {h.link for h in hulls}
    if not fingers and VALVE not in tree.names:
        raise ValueError(f"robot {name}: joint {gripper!r} moves no link with collision geometry, so there are no fingers to grasp with")
    rest = np.clip(np.zeros(len(joints)), lower, upper)
    if home is not None:
        rest[arm] = home
    if fingers:
        opening, pads = measure_once(tree, tuple(hulls), fingers, g, (lower[g], upper[g]), rest, name)
    else:
        opening, pads = measure_cup(tree, hulls, rest, name)
    rest[g] = opening.value[-1]
    skip = frozenset(frozenset((str(a), str(b))) for a, b in data["skip"])
    limits = joint_limits(etree.fromstring(text), joints, arm, g, sheet)
    turning = [j for j in arm if any(tree.kind[i] == TURNS and tree.q_index[i] == j for i in range(len(tree.names)))]
    notes = (*notes, *too_fast([joints[j] for j in turning], limits.velocity[turning]))
    return Robot(
        name, title, text, joints, lower, upper, limits, tuple(arm), g, rest, tree, tuple(hulls), skip, fingers, pads, opening, base_p,
        has_camera=any(h.link == "camera" for h in hulls),
        notes=(*notes, *(str(note) for note in data["notes"])),
    )  # fmt: skip


def _hulls(data: dict[str, NDArray[Any]]) -> list[LinkHull]:
    """The links' convex hulls, unpacked."""
    vertices, faces, hulls, v, f = data["hull_vertices"], data["hull_faces"], [], 0, 0
    for link, (nv, nf) in zip(data["hull_link"], data["hull_counts"]):
        hulls.append(LinkHull(str(link), vertices[v : v + nv], faces[f : f + nf]))
        v, f = v + nv, f + nf
    return hulls
