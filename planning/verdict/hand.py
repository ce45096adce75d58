"""The hand as the verdict sees it: which links it has, where the two pads are and which of their faces close on an object."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from kinematics.robots.plain_urdf import Arm, poses, read
from kinematics.robots.robot import Robot
from kinematics.transforms import Array, inverse, transform
from planning.verdict import polygons
from planning.verdict.polyhedra import Int, Window

FACING = np.cos(np.radians(30))  # a face that looks this much along the closing direction can be a pad's
SIDEWAYS = np.cos(np.radians(75))  # a face that looks further away than that is a finger's side
JAW_FACING = np.cos(np.radians(50))  # of a jaw against a fixed one, which turns as it closes, any that looks so
LEAST_FACE_M2, LEAST_JAW_FACE_M2 = 2e-5, 2e-6
BESIDE_M = 0.015  # the pads are within so much of the hand frame's origin, along its z
CUP_FACE_M = 1e-3  # what of a cup ends so near to its end is its lip
FLAT_M = 3e-4  # corners this near to a plane belong to the face
_VALUES = 17


@dataclass(frozen=True, eq=False)
class Pad:
    """The face of a finger that closes on objects, on one side of the hand.

    T_carrier_face (4, 4): z out of the finger, towards the other one. window: the face in x and y. side: 1 or -1, where it is along the
    hand's y.
    """

    link: str
    side: int
    carrier: int
    T_carrier_face: Array
    window: Window


@dataclass(frozen=True, eq=False)
class Hand:
    """arm: the whole robot; carrier, T_carrier_hand: where the hand frame is. gripper: index of the joint that opens it.

    links: all that goes with the hand, whatever the arm does; fingers: those of them that the gripper moves. pads: one on each side, +y
    first; of a jaw that moves alone, of fingers that turn, and of such in convex parts, more of them follow, for what is held may touch
    any; of a suction cup one alone. beside: other cups, which may touch what that one holds.
    values, widths (G,): the gripper's joint and how far the pads are apart there, by rising width.
    """

    arm: Arm
    carrier: int
    T_carrier_hand: Array
    gripper: int
    links: frozenset[str]
    fingers: frozenset[str]
    pads: tuple[Pad, ...]
    values: Array
    widths: Array
    beside: frozenset[str] = frozenset()

    @cached_property
    def holding(self) -> frozenset[str]:
        """The links that touch what is held: the fingers, and what a jaw closes on; and cups beside the one that holds."""
        return self.fingers | {pad.link for pad in self.pads} | self.beside

    @property
    def max_width_m(self) -> float:
        """How far the pads come apart, m."""
        return float(self.widths[-1])

    def width(self, values: Array) -> Array:
        """How far (G,) the pads are apart at values (G,) of the gripper's joint."""
        frames = _at(self.arm, self.carrier, self.T_carrier_hand, self.gripper, values, frozenset(p.carrier for p in self.pads[:2]))
        y = [(frames[p.carrier] @ p.T_carrier_face)[:, 1, 3] for p in self.pads[:2]]
        return np.asarray(y[0] - y[1])


def in_hand(hand: Hand, value: float) -> dict[int, Array]:
    """Poses (4, 4) in the hand's frame of the carriers that go with it, at a value of the gripper's joint."""
    own = frozenset(hand.arm.links[link][0] for link in hand.links)
    return {c: T[0] for c, T in _at(hand.arm, hand.carrier, hand.T_carrier_hand, hand.gripper, np.array([value]), own).items()}


@lru_cache(maxsize=8)
def hand_of(robot: Robot) -> Hand:
    """The hand of a robot. Raises: ValueError when no two faces of its fingers close on each other."""
    arm = read(robot.urdf)
    carrier, T_carrier_hand = arm.links["hand"]
    gripper = arm.joints.index(robot.joint_names[robot.gripper_joint])
    solid = {h.link for h in robot.hulls}
    fingers = frozenset(link for link in solid if gripper in arm.driven_by(arm.links[link][0]))
    own = arm.driven_by(carrier)
    links = frozenset(link for link in solid if arm.driven_by(arm.links[link][0]) - {gripper} == own) | fingers
    if robot.opening.cup_m:
        cup = _cup(robot, arm, carrier, T_carrier_hand)
        beside = robot.pads - {cup.link}
        return Hand(arm, carrier, T_carrier_hand, gripper, links, fingers, (cup,), robot.opening.value, robot.opening.width_m, beside)
    low, high = float(arm.lower[gripper]), float(arm.upper[gripper])
    if robot.opening.round_only and not robot.opening.jaw:  # beyond its table such fingers look past each other
        low, high = float(robot.opening.value.min()), float(robot.opening.value.max())
    pads = _on_both_sides(robot, arm, fingers, _at(arm, carrier, T_carrier_hand, gripper, np.array([(low + high) / 2])))
    values = np.linspace(low, high, _VALUES)
    half = Hand(arm, carrier, T_carrier_hand, gripper, links, fingers, pads, values, values)
    widths = half.width(values)
    order = np.argsort(widths)
    return replace(half, values=values[order], widths=widths[order])


def _at(
    arm: Arm, carrier: int, T_carrier_hand: Array, gripper: int, values: Array, wanted: frozenset[int] | None = None
) -> dict[int, Array]:
    """Poses (G, 4, 4) of carriers in the hand frame at gripper values (G,), the arm anywhere; of all, or of those wanted."""
    q = np.zeros((len(values), len(arm.joints)))
    q[:, gripper] = values
    at = poses(arm, q, np.eye(4), None if wanted is None else wanted | {carrier})
    T_hand = inverse(at[carrier] @ T_carrier_hand)
    return {c: T_hand @ T for c, T in at.items()}


def _on_both_sides(robot: Robot, arm: Arm, fingers: frozenset[str], at: dict[int, Array]) -> tuple[Pad, ...]:
    """The innermost face on either side, +y first; then the others, where any of them may be what holds. at: the carriers' poses (1, 4, 4)
    in the hand. fingers: those that the gripper moves; the fixed one of a jaw is a pad, too."""
    jaw = robot.opening.jaw
    movers = {side: fingers if jaw in (0, side) else frozenset(robot.pads) - fingers for side in (1, -1)}
    found = [_pads(robot, arm, movers[side], at, side) for side in (1, -1)]
    any_holds = [bool(jaw) or robot.opening.round_only or _in_parts(robot, side[0].link) for side in found]
    return (*(side[0] for side in found), *(pad for side, holds in zip(found, any_holds) if holds for pad in side[1:]))


def _pads(robot: Robot, arm: Arm, fingers: frozenset[str], at: dict[int, Array], side: int) -> list[Pad]:
    """The faces of the fingers on one side, the innermost first; at: the carriers' poses (1, 4, 4) in the hand. The first looks along
    the way they close, the others of a jaw roughly."""
    jaw, inward = robot.opening.jaw != 0, np.array([0.0, -float(side), 0.0])
    facing, least = (JAW_FACING, LEAST_JAW_FACE_M2) if jaw else (FACING, LEAST_FACE_M2)
    out = list[tuple[bool, float, Pad]]()
    for link, carrier, normal, outline, area in _beside_hand(robot, arm, fingers, at, inward, facing, least):
        middle = outline.mean(0)
        if middle[1] * side < 0 and not jaw:
            continue
        T_hand_face = transform(_frame(normal), middle)
        flat = (outline - middle) @ T_hand_face[:3, :2]
        pad = Pad(link, side, carrier, inverse(at[carrier][0]) @ T_hand_face, Window(polygons.hull(flat)))
        main = normal @ inward >= FACING and area >= LEAST_FACE_M2 and middle[1] * side >= 0
        out.append((not main, abs(float(middle[1])), pad))
    out.sort(key=lambda found: found[:2])
    if not out or out[0][0]:
        words = f"robot {robot.name}: no face of its fingers closes along the hand frame's y, on the side of {'-+'[side > 0]}y"
        off = _least_off(robot, arm, fingers, at, inward)
        raise ValueError(words if off is None else f"{words}: the best one there looks {off:.1f}° away from it")
    return [pad for *_, pad in out]


def _least_off(robot: Robot, arm: Arm, fingers: frozenset[str], at: dict[int, Array], inward: Array) -> float | None:
    """How far, in degrees, the face of a finger beside the hand frame looks away from `inward` (3,) that does so least; None where none
    faces the other side at all."""
    faces = _beside_hand(robot, arm, fingers, at, inward, SIDEWAYS, LEAST_FACE_M2)
    best = max((float(normal @ inward) for *_, normal, outline, _ in faces if outline[:, 1].mean() * inward[1] <= 0), default=None)
    return None if best is None else float(np.degrees(np.arccos(best)))


def _beside_hand(
    robot: Robot, arm: Arm, fingers: frozenset[str], at: dict[int, Array], inward: Array, facing: float, least_m2: float
) -> Iterator[tuple[str, int, Array, Array, float]]:
    """The faces of fingers that look along `inward` (3,) beside the hand frame's origin: link, carrier, and what `_faces` says of each."""
    for hull in robot.hulls:
        if hull.link in fingers:
            carrier, T_carrier_link = arm.links[hull.link]
            T = at[carrier][0] @ T_carrier_link
            points = hull.vertices @ T[:3, :3].T + T[:3, 3]
            for normal, outline, area in _faces(points, hull.faces, inward, facing, least_m2):
                if outline[:, 2].min() <= BESIDE_M and outline[:, 2].max() >= -BESIDE_M:
                    yield hull.link, carrier, normal, outline, area


def _in_parts(robot: Robot, link: str) -> bool:
    """Whether a link of a robot of one's own was taken apart, or is one of two fingers on a side: then no part has all of its face."""
    if robot.grip is None:
        return False
    return robot.grip.kind == "three fingers" or sum(h.link == link for h in robot.hulls) > 1


def _cup(robot: Robot, arm: Arm, carrier: int, T_carrier_hand: Array) -> Pad:
    """The face of the suction cup, of several, that is at the hand frame, z out of it."""
    faces = dict[str, tuple[float, Array]]()
    for link in sorted(robot.pads):
        own, T_carrier_link = arm.links[link]
        if own != carrier:
            raise ValueError(f"robot {robot.name}: the suction cup {link!r} does not go with the hand frame")
        T = inverse(T_carrier_hand) @ T_carrier_link
        hulls = [h.vertices @ T[:3, :3].T + T[:3, 3] for h in robot.hulls if h.link == link]
        end = float(max(points[:, 2].max() for points in hulls))
        faces[link] = end, np.concatenate([points[points[:, 2] >= end - CUP_FACE_M] for points in hulls])
    link = min(faces, key=lambda at: float(np.hypot(*faces[at][1][:, :2].mean(0))))
    end, face = faces[link]
    return Pad(link, 0, carrier, T_carrier_hand @ transform(p=[0.0, 0.0, end]), Window(polygons.hull(face[:, :2])))


def _faces(points: Array, triangles: Int, inward: Array, facing: float, least_m2: float) -> list[tuple[Array, Array, float]]:
    """The plane faces of a convex solid that look along `inward` (3,): outward normal (3,), corners (N, 3) and area of each."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=1) / 2
    normal = normal / np.maximum(2 * area, 1e-30)[:, None]
    normal *= np.sign(np.einsum("ij,ij->i", normal, a - points.mean(0)))[:, None]
    out = []
    left = normal @ inward >= facing
    while left.any():
        seed = int(np.argmax(np.where(left, area, -1.0)))
        out_of = points @ normal[seed] - a[seed] @ normal[seed]
        same = left & (np.abs(out_of[triangles]) <= FLAT_M).all(1)
        if area[same].sum() >= least_m2:
            out.append((normal[seed], points[np.unique(triangles[same])], float(area[same].sum())))
        same[seed] = True
        left &= ~same
    return out


def _frame(z: Array) -> Array:
    """A rotation (3, 3) whose last column is z (3,), its first as near to the hand's z as can be."""
    x = np.array([0.0, 0.0, 1.0]) - z[2] * z
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], -1)
