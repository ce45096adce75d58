"""A URDF of one's own: its gripper is found, its motors are made to go together, and the hand and camera frames are put in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from kinematics.errors import did_you_mean
from kinematics.robots.files import urdf
from kinematics.robots.files.dialects import plain_mimics
from kinematics.robots.files.fixed_joints import freeze
from kinematics.robots.hands.find_gripper import HINGE_RAD, CupFound, Motors, drives, find_palm, rigid
from kinematics.robots.hands.gripper import NotClosing, measure
from kinematics.robots.hands.hand_frame import hand_frame as measured_frame
from kinematics.robots.hands.hand_model import Model, NoGripper
from kinematics.robots.hands.suction import ON_M, SUCTION, add_valve, at_face, cup_frame, cup_links
from kinematics.robots.tree import FIXED, TURNS, LinkHull, Tree
from kinematics.transforms import Array, inverse, rotation_about, transform, wxyz_from_rotation

ALONG = 0.5
"""A link's z that is meant as the approach leads as near to the measured one as that, at least: the cosine."""
CAMERA_ALONG_HAND = transform(rotation_about((0, 0, 1), np.pi / 2))
"""The pose (4, 4) in the hand frame of the camera of a robot that has none of its own."""
AROUND_M = 0.01
"""Collision geometry is around another's that reaches out of its hull by no more."""


@dataclass(frozen=True, eq=False)
class Grip:
    """What was understood of a gripper. joints: its motors by name, the first drives the others: follows, by name (multiplier, offset).
    limits: of the first, where they are narrower than the URDF's. link: what the hand frame is fixed to, and T_link_hand (4, 4) where.
    kind: in words. measured: whether the frame was measured, because nobody said where it is. frozen: motors of the hand that stand still,
    and where. filled_by: links with collision geometry where the pads should hold something; covers: those of them that are solids around
    the link that they are fixed to."""

    joints: tuple[str, ...]
    follows: dict[str, tuple[float, float]]
    limits: tuple[float, float]
    link: str
    T_link_hand: Array
    kind: str
    measured: bool
    frozen: tuple[tuple[str, float], ...] = ()
    filled_by: tuple[str, ...] = ()
    covers: tuple[str, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know."""
        first, *others = self.joints
        several = len(others) > 1
        notes = [f"the motor{'s' * several} {', '.join(others)} go{'es' * (not several)} with {first}"] if others else []
        notes += [f"the motor {name} stands still at {value:.3g}" for name, value in self.frozen]
        if self.filled_by:
            notes.append(f"the collision geometry of {', '.join(self.filled_by)} fills the room between the pads: they can hold nothing")
        if self.measured:
            notes.append(f"{self.kind}, hand frame measured: {pose_words(self.T_link_hand)} in the link {self.link!r}")
        return tuple(notes)


def pose_words(T: Array) -> str:
    """A pose (4, 4) for the reader. Of the two quaternions of one rotation it is that whose first number that is not 0 is positive."""
    q = np.round(wxyz_from_rotation(T[:3, :3]), 4)
    return f"p {_numbers(T[:3, 3])}, q_wxyz {_numbers(q * next(np.sign(v) for v in q if v))}"


def grip_to_arrays(grip: Grip) -> dict[str, NDArray[Any]]:
    """A grip as arrays, for the cache."""
    return {
        "joints": np.array(grip.joints, dtype=np.str_),
        "follows": np.array(list(grip.follows.values()), float).reshape(-1, 2),
        "limits": np.array(grip.limits),
        "words": np.array([grip.link, grip.kind], dtype=np.str_),
        "T_link_hand": grip.T_link_hand,
        "measured": np.array([grip.measured]),
        "frozen": np.array([name for name, _ in grip.frozen], dtype=np.str_),
        "frozen_at": np.array([value for _, value in grip.frozen], float),
        "filled_by": np.array(grip.filled_by, dtype=np.str_),
        "covers": np.array(grip.covers, dtype=np.str_),
    }


def grip_from_arrays(data: Mapping[str, NDArray[Any]]) -> Grip:
    """The inverse of `grip_to_arrays`."""
    joints = tuple(str(j) for j in data["joints"])
    follows = {name: (float(rate), float(offset)) for name, (rate, offset) in zip(joints[1:], data["follows"])}
    (low, high), (link, kind) = data["limits"], data["words"]
    T = np.asarray(data["T_link_hand"], float)
    frozen = tuple((str(name), float(value)) for name, value in zip(data["frozen"], data["frozen_at"]))
    filled_by, covers = (tuple(str(name) for name in data[which]) for which in ("filled_by", "covers"))
    return Grip(joints, follows, (float(low), float(high)), str(link), T, str(kind), bool(data["measured"][0]), frozen, filled_by, covers)


def _numbers(values: Array) -> str:
    return "[" + ", ".join(f"{v + 0.0:.4g}" for v in np.round(values, 4)) + "]"


def find_grip(model: Model, where: str, hand_link: str | None, named: Sequence[str], T_link_hand: Array | None) -> Grip:
    """Find out how the hand closes, and where its frame is.

    where: the file, for messages; hand_link, T_link_hand: the hand frame, where somebody says it; named: the joints that move fingers,
    where somebody says it. Raises: ValueError (NoGripper) that says what was found instead, and how to say it better.
    """
    tree, joints = model.tree, list(model.joints)
    arm = [] if hand_link is None else [joints[int(tree.q_index[i])] for i in tree.path(tree.index[hand_link]) if tree.kind[i] != FIXED]
    if hand_link is not None and not arm:
        raise ValueError(f"{where}: no joint moves the hand frame {hand_link!r}")
    if tuple(named) == (SUCTION,) and SUCTION not in joints:
        if hand_link is None:
            raise NoGripper(f"{where}: say which link the suction cup is, with --hand-frame")
        return _cup(tree.index[hand_link], model, T_link_hand, where)
    others = [j for j in joints if j not in arm]
    for name in named:
        if name not in others:
            known = ", ".join(others) or "none"
            near = did_you_mean(name, others)
            words = f"{name!r} is no joint that can open the fingers{near}; actuated joints besides the arm's: {known}"
            raise ValueError(f"{where}: {words}")
    indices = [joints.index(name) for name in named]
    try:
        palm = _palm(model, hand_link, indices)
        motors = _that_close(model, palm, indices)
        if hand_link is not None:
            T = np.eye(4) if T_link_hand is None else T_link_hand
            _check_frame(model, motors, hand_link, T)
            return _grip(model, motors, hand_link, T, measured=False)
        return _grip(model, motors, tree.names[palm], measured_frame(model, motors), measured=True)
    except NoGripper as e:
        cup = (
            e.link if isinstance(e, CupFound) else next(iter(cup_links(model, [] if hand_link is None else [tree.index[hand_link]])), None)
        )
        if cup is None or named:
            raise NoGripper(f"{where}: {e}") from None
        return _cup(cup, model, T_link_hand, where)


def _cup(link: int, model: Model, T_link_hand: Array | None, where: str) -> Grip:
    """A suction cup on a link: its face is where T_link_hand says, or at the link's frame, or is measured."""
    T = np.eye(4) if T_link_hand is None else T_link_hand
    measured = np.array_equal(T, np.eye(4)) and not at_face(model, link)
    try:
        T = cup_frame(model, link) if measured else T
    except NoGripper as e:
        raise NoGripper(f"{where}: {e}") from None
    cups = [i for i in cup_links(model, rigid(model, model.group(link))) if model.points([i], model.rest, i).size]
    kind = "a suction cup" if len(cups) < 2 else f"one of {len(cups)} suction cups, used alone; the others may touch what it holds"
    return Grip((SUCTION,), {}, (0.0, ON_M), model.tree.names[link], T, kind, measured)


def _palm(model: Model, hand_link: str | None, named: Sequence[int]) -> int:
    """The group on which the fingers move."""
    tree = model.tree
    if named:
        movers = [i for i in range(len(tree.names)) if tree.kind[i] != FIXED and tree.q_index[i] == named[0]]
        palm = model.group(int(tree.parent[min(movers, key=lambda i: len(tree.path(i)))]))
        while not set(named) <= {int(tree.q_index[i]) for i in tree.below(palm)} and tree.parent[palm] >= 0:
            palm = model.group(int(tree.parent[palm]))  # fingers that stand on motors of their own
        return _whole_hand(model, palm, named)
    if hand_link is None:
        return find_palm(model)
    return model.group(tree.index[hand_link])


def _whole_hand(model: Model, palm: int, named: Sequence[int]) -> int:
    """The group on which the hand's other fingers move too, where the one that is named closes as one of several; else `palm`."""
    if len(model.moved_on(palm)) > 1:
        return palm
    try:
        whole = find_palm(model, named)
        return whole if len(model.moved_on(whole)) > 1 and set(named) <= set(model.motors(whole)) else palm
    except NoGripper:
        return palm


def _that_close(model: Model, palm: int, named: Sequence[int]) -> Motors:
    """How the fingers on a group are driven so that they close on something; where they never do, the likeliest way."""
    ways = drives(model, palm, named)
    first = motors = _narrowed(model, next(ways))
    while motors.frozen and not _closes(model, motors):
        if (other := next(ways, None)) is None:
            return first
        motors = _narrowed(model, other)
    return motors


def _closes(model: Model, motors: Motors) -> bool:
    """Whether the fingers close along the y of the hand frame that is measured."""
    try:
        _measure_at(model, motors, motors.palm, measured_frame(model, motors))
    except (NoGripper, NotClosing):
        return False
    return True


def _narrowed(model: Model, motors: Motors) -> Motors:
    """A hinged jaw opens only so far that it still faces what it closes on."""
    low, high = motors.limits
    hinged = len(motors.branches) == 1 and model.tree.kind[motors.branches[0][0]] == TURNS
    if not hinged or high - low <= HINGE_RAD:
        return motors
    return replace(motors, limits=(low, low + HINGE_RAD) if motors.opens_upwards else (high - HINGE_RAD, high))


def _grip(model: Model, motors: Motors, link: str, T: Array, *, measured: bool) -> Grip:
    names = model.joints
    follows = {names[j]: rule for j, rule in motors.followers.items()}
    kind = "one jaw against a fixed one" if len(motors.branches) == 1 else motors.kind
    frozen = tuple((names[j], float(model.rest[j])) for j in motors.frozen)
    filled_by = _filled_by(model, motors, link, T) if len(motors.branches) > 1 else ()
    covers = tuple(name for name in filled_by if _is_around(model, model.tree.index[name]))
    return Grip((names[motors.first], *follows), follows, motors.limits, link, T, kind, measured, frozen, filled_by, covers)


def _filled_by(model: Model, motors: Motors, link: str, T_link_hand: Array) -> tuple[str, ...]:
    """Those of the palm's links in whose collision geometry the hand frame's origin lies, which is between the pads."""
    from scipy.spatial import ConvexHull

    tree = model.tree
    poses = tree.poses(model.rest)
    p = (poses[tree.index[link]] @ T_link_hand)[:3, 3]
    palm = {tree.names[i] for i in rigid(model, motors.palm)}

    def holds(hull: LinkHull) -> bool:
        planes = ConvexHull(hull.vertices, qhull_options="QJ").equations
        return bool(((planes[:, :3] @ (inverse(poses[tree.index[hull.link]])[:3] @ [*p, 1.0]) + planes[:, 3]) < 0.0).all())

    return tuple(dict.fromkeys(hull.link for hull in model.hulls if hull.link in palm and holds(hull)))


def _is_around(model: Model, link: int) -> bool:
    """Whether a link's collision geometry is around all of that of the link which it is fixed to."""
    from scipy.spatial import ConvexHull

    tree, carrier = model.tree, int(model.tree.parent[link])
    inside = model.points([carrier], model.rest, link) if tree.kind[link] == FIXED and carrier >= 0 else np.empty((0, 3))
    planes = ConvexHull(model.points([link], model.rest, link), qhull_options="QJ").equations
    return len(inside) > 0 and bool((inside @ planes[:, :3].T + planes[:, 3] <= AROUND_M).all())


def _check_frame(model: Model, motors: Motors, link: str, T: Array) -> None:
    """Raises: NoGripper with the frame that was measured, where the fingers don't close about the one that was given, or a link's own
    frame, with no T_link_hand, looks elsewhere than they do."""
    try:
        _measure_at(model, motors, model.tree.index[link], T)
    except NotClosing as e:
        raise _elsewhere(model, motors, link, _measured_in(model, motors, link), "", e.fingers) from None
    if np.array_equal(T, np.eye(4)):
        try:
            found = _measured_in(model, motors, link)
        except NoGripper:
            return  # it is good for what it was measured by
        if found[2, 2] < ALONG:
            off = np.degrees(np.arccos(np.clip(found[2, 2], -1.0, 1.0)))
            raise _elsewhere(
                model, motors, link, found, f"the z of the link {link!r} is {off:.0f}° off the approach: ", _fingers(model, motors)
            )


def _fingers(model: Model, motors: Motors) -> list[str]:
    """The fingers' links with geometry."""
    return sorted({model.tree.names[i] for branch in motors.branches for i in branch} & {h.link for h in model.hulls})


def _measure_at(model: Model, motors: Motors, at: int, T: Array) -> None:
    """Measure what the fingers leave free about a hand frame T (4, 4) in the link `at`. Raises: NotClosing where they don't close on it."""
    tree = model.tree
    with_hand = Tree(
        (*tree.names, "hand"), np.append(tree.parent, at), np.concatenate([tree.T_joint, T[None]]), np.append(tree.kind, FIXED),
        np.concatenate([tree.axis, [[1.0, 0.0, 0.0]]]), np.append(tree.q_index, -1), np.append(tree.scale, 1.0),
        np.append(tree.offset, 0.0),
    )  # fmt: skip
    for j, (rate, offset) in motors.followers.items():
        moves = with_hand.q_index == j
        with_hand.offset[moves] += with_hand.scale[moves] * offset
        with_hand.scale[moves] *= rate
        with_hand.q_index[moves] = motors.first
    fingers = frozenset(_fingers(model, motors))
    measure(with_hand, tuple(model.hulls), fingers, motors.first, motors.limits, model.rest[: with_hand.coordinates], "")


def _measured_in(model: Model, motors: Motors, link: str) -> Array:
    """The measured hand frame (4, 4) in a link. Raises: NoGripper where the fingers don't close on anything."""
    return np.asarray(inverse(_pose(model, motors.palm, link)) @ measured_frame(model, motors))


def _elsewhere(model: Model, motors: Motors, link: str, found: Array, why: str, fingers: Sequence[str]) -> NoGripper:
    """What is said of a frame that is none between the pads: where they are."""
    kind = "one jaw" if len(motors.branches) == 1 else "two fingers"
    return NoGripper(
        f"{why}{kind} found ({', '.join(fingers)}), between whose pads {pose_words(found)} is in the link {link!r}, y the way they "
        f"close: say T_link_hand so in the scene's robot, or --gripper-joint {model.joints[motors.first]} without --hand-frame, and it is "
        "measured"
    )


def _pose(model: Model, frame: int, link: str) -> Array:
    """A link's pose (4, 4) in another's frame, to which it is fixed."""
    poses = model.tree.poses(model.rest)
    return np.asarray(inverse(poses[frame]) @ poses[model.tree.index[link]])


def put_in(root: etree._Element, grip: Grip) -> None:
    """Write a grip into a cleaned URDF, in place: motors that follow as mimic joints, limits, and the links `hand` and `camera`."""
    links = [e.get("name", "") for e in root.iter("link")]
    if grip.joints == (SUCTION,) and SUCTION not in {j.get("name") for j in root.iter("joint")}:
        add_valve(root, grip.link)
    for name, value in grip.frozen:
        freeze(root, name, value)
    for joint in root.iter("joint"):
        name = joint.get("name", "")
        if name in grip.follows:
            rate, offset = grip.follows[name]
            etree.SubElement(joint, "mimic", joint=grip.joints[0], multiplier=repr(rate), offset=repr(offset))
        if name == grip.joints[0] and (limit := joint.find("limit")) is not None:
            limit.set("lower", repr(max(grip.limits[0], float(limit.get("lower", "0")))))
            limit.set("upper", repr(min(grip.limits[1], float(limit.get("upper", "0")))))
    plain_mimics(root)
    if "camera" not in links:
        urdf.add_link(root, "camera", grip.link, grip.T_link_hand @ CAMERA_ALONG_HAND)
    if grip.link != "hand" or (grip.T_link_hand != np.eye(4)).any():
        urdf.add_link(root, "hand", grip.link, grip.T_link_hand)
