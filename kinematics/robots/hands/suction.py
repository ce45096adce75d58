"""A suction cup: a link that no joint moves, with a flat face that holds what it touches while the vacuum is on.

The vacuum is an actuated joint like a gripper's, from 0 (off) to ON_M (on), that moves nothing but the empty link `suction_valve` of the
joined URDF. So configurations, plans and replays say when it holds. The hand frame is in the middle of the face, z out of it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from lxml import etree

from kinematics.robots.hands.find_gripper import CUP, rigid
from kinematics.robots.hands.hand_model import Model, NoGripper
from kinematics.robots.hands.opening import Opening
from kinematics.robots.tree import FIXED, LinkHull, Tree
from kinematics.transforms import Array, apply, inverse, transform

SUCTION, VALVE = "suction", "suction_valve"
"""What the joint and the link are called; and the word that declares a cup where a gripper's joints are named."""
ON_M, SPEED_M_S = 0.001, 0.005
"""The valve's stroke, and how fast it is: the vacuum takes some tenths of a second."""
FACE_M, LEAST_RADIUS_M = 0.001, 0.003
OFF_M, MARK_M = 0.003, 0.03
"""The face is no further than that from a hand frame that is given; and than that from a link without geometry that marks a cup."""
WIDER_M = 0.02
"""By which a cup that is off counts as wider than one that holds: the width by which grasps and grippers understand each other."""
NEVER_DEEP_M = 1.0


def cup_links(model: Model, links: Sequence[int]) -> list[int]:
    """Those of some links that are called like a cup."""
    return [i for i in links if CUP.search(model.tree.names[i])]


def cup_frame(model: Model, link: int) -> Array:
    """T_link_hand (4, 4) of the cup that a link is, or marks on what it is fixed to: where its geometry ends, away from the wrist.

    Raises: NoGripper where there is no face.
    """
    tree, q = model.tree, model.rest
    own = model.points([link], q, link)
    points = own if len(own) else model.points(rigid(model, model.group(link)), q, link)
    if not len(points):
        raise NoGripper(
            f"no gripper that can be used: the suction cup {tree.names[link]!r} and what it is fixed to have no collision geometry"
        )
    poses = tree.poses(q)
    wrist = (inverse(poses[link]) @ poses[model.group(link)])[:3, 3]
    out = (points.mean(0) if len(own) else np.zeros(3)) - wrist
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    z = axes[int(np.argmax(axes @ out + 1e-9 * axes[:, 2]))]
    face = points[points @ z >= (points @ z).max() - FACE_M]
    x = np.eye(3)[(int(np.argmax(np.abs(z))) + 1) % 3]
    R = np.stack([x, np.cross(z, x), z], -1)
    flat = face @ R
    middle = np.append((flat[:, :2].min(0) + flat[:, :2].max(0)) / 2, flat[:, 2].max())
    if not len(own) and np.linalg.norm(middle) > MARK_M:
        raise NoGripper(
            f"no gripper that can be used: nothing that {tree.names[link]!r} is fixed to ends within 30 mm of it, as a cup's face would"
        )
    return transform(R, R @ middle)


def at_face(model: Model, link: int) -> bool:
    """Whether a link's frame is in a face already, z out of it."""
    points = model.points(rigid(model, model.group(link)), model.rest, link)
    ends = len(points) > 0 and abs(float(points[:, 2].max())) <= OFF_M
    return ends and _inscribed(points[np.abs(points[:, 2]) <= OFF_M][:, :2]) >= LEAST_RADIUS_M


def measure_cup(tree: Tree, hulls: Sequence[LinkHull], rest: Array, name: str) -> tuple[Opening, frozenset[str]]:
    """The table of a cup whose face is at the hand frame, and its link, with those of other cups that end in its plane: they may touch what
    it holds. Raises: ValueError where there is no face that holds the frame."""
    poses, hand = tree.poses(rest), tree.index["hand"]
    mover = max(i for i in tree.path(hand) if tree.kind[i] != FIXED)
    best, outer, link, nearest, ends = 0.0, 0.0, "", np.inf, dict[str, float]()
    for hull in hulls:
        if mover in tree.path(tree.index[hull.link]):
            points = apply(inverse(poses[hand]) @ poses[tree.index[hull.link]], hull.vertices)
            ends[hull.link] = max(ends.get(hull.link, -np.inf), float(points[:, 2].max()))
            nearest = min(nearest, float(abs(points[:, 2].max())))
            face = points[np.abs(points[:, 2]) <= OFF_M]
            radius = _inscribed(face[:, :2])
            if radius > best:
                best, outer, link = radius, float(np.linalg.norm(face[:, :2], axis=1).max()), hull.link
    if best < LEAST_RADIUS_M:
        raise ValueError(
            f"robot {name}: no flat face of a suction cup is at the hand frame, z out of it; the nearest end of what is fixed there is "
            f"{1000 * nearest:.0f} mm away along z"
        )
    across = float(np.ceil(2e6 * outer)) / 1e6
    width = np.array([across, round(across + WIDER_M, 6)])
    flat = np.zeros(2)
    return Opening(np.array([ON_M, 0.0]), width, flat, np.full(2, NEVER_DEEP_M), flat, cup_m=across), frozenset(
        name for name, end in ends.items() if name == link or (CUP.search(name) and abs(end) <= FACE_M)
    )


def _inscribed(points: Array) -> float:
    """The radius of the largest circle about the origin in the hull of points (N, 2); 0 where it is outside, or they have no area."""
    from scipy.spatial import ConvexHull, QhullError

    if len(points) < 3:
        return 0.0
    try:
        return max(0.0, float(-ConvexHull(points).equations[:, 2].max()))
    except QhullError:
        return 0.0


def add_valve(root: etree._Element, link: str) -> None:
    """Write the vacuum's joint into a URDF, in place: it moves a link without geometry."""
    etree.SubElement(root, "link", name=VALVE)
    joint = etree.SubElement(root, "joint", name=SUCTION, type="prismatic")
    etree.SubElement(joint, "parent", link=link)
    etree.SubElement(joint, "child", link=VALVE)
    etree.SubElement(joint, "axis", xyz="0 0 1")
    etree.SubElement(joint, "limit", lower="0", upper=repr(ON_M), velocity=repr(SPEED_M_S), effort="1")
