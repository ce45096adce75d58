"""Finds the gripper of an arm in its tree of joints: which joints move fingers, how they go together, and where the hand frame is.

The hand is where the tree branches into fingers, or where its last joint moves a jaw against what carries it. Fingers with motors of their
own are driven as one: each as far as the first. Where nobody says where the hand frame is, it is measured: y is the way the fingers
close, z leads from the wrist to the tips, and the origin lies between the pads.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.robots.hands.hand_model import Branch, Model, NoGripper
from kinematics.robots.hands.three_fingers import are_three, closing_motors, in_two_sides
from kinematics.robots.tree import SLIDES
from kinematics.transforms import Array, inverse

ARM_LEAST, FINGER_MOST = 4, 3
"""A branch with so many motors is an arm; a finger has fewer."""
THREE = "three fingers"
JAW = re.compile(r"grip|jaw|finger|claw|hand|pinch|clamp|grasp", re.IGNORECASE)
WRIST = re.compile(r"wrist|elbow|forearm|(roll|pitch|yaw)(_joint)?$", re.IGNORECASE)
"""A joint that is called so turns a whole hand, whatever its link is called."""
CUP = re.compile(r"suction|vacuum|cup", re.IGNORECASE)
HINGE_RAD = 0.6
"""How far a hinged jaw is opened, at most: further, it faces the tip of what it closes on no more."""


THROUGH_M = 0.005  # fingers whose middles are as far apart on the one side before, and on the other after, have passed through each other


class CupFound(NoGripper):
    """There are no fingers, but a link that is called like a suction cup: the message, and the link's index."""

    def __init__(self, message: str, link: int) -> None:
        super().__init__(message)
        self.link = link


class SeveralFound(NoGripper):
    """Several arms have grippers: the options that say which, a word for each."""

    def __init__(self, ways: list[str]) -> None:
        super().__init__(f"there are {len(ways)} arms with grippers; say which with {' or '.join(ways)}")
        self.ways = ways


@dataclass(frozen=True, eq=False)
class Motors:
    """Which actuated joints move the fingers on the link `palm`, and what goes with it: the first, and how the others follow it, by name
    (multiplier, offset). limits: of the first, where none of the others leaves its own. branches: links of each finger; a jaw is alone, and
    of three fingers two are one. kind: in words. frozen: motors of the hand that stand still."""

    palm: int
    first: int
    followers: dict[int, tuple[float, float]]
    limits: tuple[float, float]
    branches: tuple[tuple[int, ...], ...]
    opens_upwards: bool
    kind: str = "two fingers"
    frozen: tuple[int, ...] = ()


def find_palm(model: Model, named: Sequence[int] = ()) -> int:
    """The group that carries the fingers, where nobody says which it is: down the one branch that is an arm, to where it ends. Of several
    arms it is the one that ends in a gripper. named: actuated joints of the arm that is meant, or of its hand.

    Raises: NoGripper, where there is none, or several arms have one.
    """
    return _down(model, next(i for i in range(len(model.tree.names)) if model.tree.parent[i] < 0), [], named)


def _down(model: Model, group: int, way: list[int], named: Sequence[int] = ()) -> int:
    """`find_palm` from a group on, to which the links `way` lead."""
    while True:
        movers = model.moved_on(group)
        arms = [m for m in movers if len(model.motors(m)) >= ARM_LEAST]
        arms = [m for m in arms if named and set(named) <= set(model.motors(m))] or arms
        if len(arms) > 1:
            return _one_of(model, arms)
        if not arms and len(way) >= 2 and len(movers) > 1:
            return group
        going = arms or (movers if len(movers) == 1 else [])
        if not going:
            return _jaw_or_nothing(model, way, group)
        group = going[0]
        way = [*way, group]


def _one_of(model: Model, arms: list[int]) -> int:
    """The palm of the one arm among several that ends in a gripper: others are legs, or heads."""
    names = [_joint_behind(model, m) for m in arms]
    if all(CUP.search(model.tree.names[m]) or JAW.search(model.tree.names[m]) for m in arms):
        raise NoGripper(
            f"no gripper found: a hand of {len(arms)} fingers with {ARM_LEAST} motors and more each ({', '.join(names)}) can't be used: "
            "give all joints but one a <mimic> of that, or make them fixed"
        )
    palms, cups, others, ways = list[int](), list[CupFound](), list[NoGripper](), list[str]()
    for m in arms:
        try:
            palm = _down(model, m, [m])
            ways.append(f"--gripper-joint {model.joints[drive(model, palm).first]}")
            palms.append(palm)
        except CupFound as e:
            cups.append(e)
            ways.append(f"--hand-frame {model.tree.names[e.link]}")
        except SeveralFound as e:
            ways += e.ways
        except NoGripper as e:
            others.append(e)
    if len(ways) > 1:
        raise SeveralFound(ways)
    if palms:
        return palms[0]
    if cups:
        raise cups[0]
    first = str(others[0]).removeprefix("no gripper found: ").split(";")[0]
    raise NoGripper(
        f"no gripper found: on none of {len(arms)} arms, which begin with the joints {', '.join(names)}, is one that can be used, for "
        f"{first}; name one's joints with --gripper-joint, or a suction cup with --hand-frame LINK --gripper-joint suction"
    )


def _jaw_or_nothing(model: Model, way: list[int], group: int) -> int:
    """The group before the last joint, when that joint moves a jaw by its name or its link's."""
    if not way and (movers := model.moved_on(group)):
        names = ", ".join(_joint_behind(model, m) for m in movers)
        raise NoGripper(
            f"no arm found: {len(movers)} branches begin on {model.tree.names[group]!r}, with the joints {names}, and none has {ARM_LEAST} "
            "motors"
        )
    last = way[-1] if way else group
    carrier = model.group(int(model.tree.parent[last])) if len(way) > 1 else last
    marked = [i for i in rigid(model, carrier) if CUP.search(model.tree.names[i])]
    if carrier != last and marked and not model.points(model.tree.below(last), model.rest, last).size:  # a joint that stands for a vacuum
        raise CupFound(f"{model.tree.names[marked[-1]]!r} looks like a suction cup", marked[-1])
    words = [model.tree.names[last], _joint_behind(model, last)] if way else []
    if len(way) > 2 and any(JAW.search(word) for word in words) and not WRIST.search(words[1]):
        return carrier
    after = [model.tree.names[i] for i in model.tree.below(last)]
    cups = [i for i in model.tree.below(last) if CUP.search(model.tree.names[i])]
    if cups:
        raise CupFound(f"{model.tree.names[cups[-1]]!r} looks like a suction cup", cups[-1])
    raise NoGripper(
        f"no gripper found: no joint moves a finger after the last one of the arm, {_joint_behind(model, last)!r} (links there: "
        f"{', '.join(after)}); give the URDF a gripper (retrieve robots ARM --tool GRIPPER.urdf --urdf OUT.urdf), or name the joints of "
        "one with --gripper-joint or the scene's robot.gripper_joints; a suction cup is declared by --gripper-joint suction"
    )


def _joint_behind(model: Model, link: int) -> str:
    """The name of the actuated joint that moves a link."""
    q = int(model.tree.q_index[link])
    return model.joints[q] if q >= 0 else "none"


def drive(model: Model, palm: int, named: Sequence[int] = ()) -> Motors:
    """How the fingers on a group are driven: the first of `drives`. Raises: NoGripper, as that."""
    return next(drives(model, palm, named))


def drives(model: Model, palm: int, named: Sequence[int] = ()) -> Iterator[Motors]:
    """How the fingers on a group may be driven, the likeliest first; several ways where fingers have several motors, and not all of them
    may close on anything. named: actuated joints that move them, where somebody says so.

    Raises: NoGripper where nothing moves on it, or too much.
    """
    tree = model.tree
    movers = [m for m in model.moved_on(palm) if model.points(model.tree.below(m), model.rest, palm).size]
    spinning = [m for m in movers if not np.isfinite([model.lower[tree.q_index[m]], model.upper[tree.q_index[m]]]).all()]
    if len(spinning) < len(movers) and not set(named) & {
        int(tree.q_index[m]) for m in spinning
    }:  # what turns without end is a motor's wheel, and no finger
        movers = [m for m in movers if m not in spinning]
    if named:
        movers = [m for m in movers if set(model.motors(m)) & set(named)] + [
            m for m in movers if not set(model.motors(m)) & set(named) and len(model.motors(m)) <= FINGER_MOST
        ]
    arms = [m for m in movers if len(model.motors(m)) > FINGER_MOST]
    if arms:
        raise NoGripper(
            f"no gripper found: what moves on the link {tree.names[palm]!r} is an arm, by the joint {_joint_behind(model, arms[0])!r}"
        )
    motors = list(dict.fromkeys([*named, *(int(tree.q_index[m]) for m in movers)]))
    if not motors or not movers:
        bare = [tree.names[m] for m in model.moved_on(palm)]
        if bare:
            what = (
                f"what moves on the link {tree.names[palm]!r} has no collision geometry ({', '.join(bare)}): give these links their fingers"
            )
        else:
            after = ", ".join(tree.names[i] for i in tree.below(palm))
            what = f"nothing moves on the link {tree.names[palm]!r} (links there: {after})"
        raise NoGripper(f"no gripper found: {what}")
    branches = tuple(tuple(model.tree.below(m)) for m in movers)
    if len(branches) in (2, 3) and len(motors) >= 3:
        yield from _driven_apart(model, palm, branches, named)
        return
    if len(motors) == 1 and len(branches) == 3 and are_three(model, palm, branches):
        yield _closed_by(model, palm, branches, 3 * motors)
        return
    bodies = _fingers(model, palm, branches, motors)
    if len(bodies) > 2 or len(motors) > 2:
        names = ", ".join(model.joints[j] for j in motors)
        raise NoGripper(
            f"no gripper that can be used: {len(bodies)} fingers with {len(motors)} motors ({names}) move on {tree.names[palm]!r}; two "
            "or three fingers, or one jaw, can be used"
        )
    endless = [model.joints[j] for j in motors if not np.isfinite([model.lower[j], model.upper[j]]).all()]
    if endless:
        raise NoGripper(f"no gripper that can be used: its joint {endless[0]!r} has no limits, so it is never open or closed")
    yield _coupled(model, palm, motors, bodies)


def _driven_apart(model: Model, palm: int, branches: tuple[Branch, ...], named: Sequence[int]) -> Iterator[Motors]:
    """Two or three fingers with motors of their own, some of them still. Raises: NoGripper, of the first way, where there is none."""
    refused, some = None, False
    for closing in closing_motors(model, palm, branches, named):
        try:
            motors = _closed_by(model, palm, branches, list(closing))
        except NoGripper as e:
            refused = refused or e
        else:
            some = True
            yield motors
    if refused is not None and not some:
        raise refused


def _closed_by(model: Model, palm: int, branches: tuple[Branch, ...], closing: list[int]) -> Motors:
    """Fingers that are closed by one motor each, which may be one and the same; the others stand still."""
    sides = in_two_sides(model, palm, branches, closing) if len(branches) == 3 else branches
    endless = [model.joints[j] for j in closing if not np.isfinite([model.lower[j], model.upper[j]]).all()]
    if endless:
        raise NoGripper(f"no gripper that can be used: its joint {endless[0]!r} has no limits, so it is never open or closed")
    others = tuple(j for branch in branches for j in model.motors(branch[0]) if j not in closing)
    kind = THREE if len(branches) == 3 else "two fingers"
    return replace(_coupled(model, palm, list(dict.fromkeys(closing)), sides), kind=kind, frozen=others)


def _fingers(model: Model, palm: int, branches: tuple[tuple[int, ...], ...], motors: Sequence[int]) -> tuple[tuple[int, ...], ...]:
    """The branches put together to fingers: those of one motor by the side on which they are (a finger of a four-bar has two branches)."""
    if len(branches) <= 2:
        return branches
    if len(motors) == 1:
        ends = [model.rest.copy(), model.rest.copy()]
        ends[0][motors[0]], ends[1][motors[0]] = model.lower[motors[0]], model.upper[motors[0]]
        places = [np.array([model.points(b, q, palm).mean(0) for b in branches]) for q in ends]
        wide = max(places, key=lambda p: float(np.ptp(p, axis=0).max()))
        apart = wide - wide.mean(0)
        across = np.linalg.svd(apart)[2][0]
        sides = [tuple(i for b, s in zip(branches, apart @ across) if (s > 0) == side for i in b) for side in (True, False)]
        if all(sides):
            return tuple(sides)
    if len(motors) == 2:
        driven = [{int(model.tree.q_index[i]) for i in b} & set(motors) for b in branches]
        if all(len(d) == 1 for d in driven):
            return tuple(tuple(i for b, d in zip(branches, driven) if j in d for i in b) for j in motors)
    return branches


def _coupled(model: Model, palm: int, motors: list[int], fingers: tuple[tuple[int, ...], ...]) -> Motors:
    """The motors as one, so that all fingers are open, or closed, at once."""
    ends = [(float(model.lower[j]), float(model.upper[j])) for j in motors]
    corners = list(itertools.product((0, 1), repeat=len(motors)))
    spread = []
    for corner in corners:
        q = model.rest.copy()
        q[motors] = [end[k] for end, k in zip(ends, corner)]
        spread.append(_spread(model, palm, fingers, q))
    opened = corners[int(np.argmax(spread))]
    first, (low, high) = motors[0], ends[0]
    start, stop = ends[0][1 - opened[0]], ends[0][opened[0]]  # closed, and open
    followers = dict[int, tuple[float, float]]()
    for j, end, side in zip(motors[1:], ends[1:], opened[1:]):
        their_start, their_stop = end[1 - side], end[side]
        same = _slides(model, j) == _slides(model, first)
        ways = (abs(stop - start), abs(their_stop - their_start))
        way = ways if not same else (min(ways), min(ways))
        rate = float(np.sign(their_stop - their_start) * np.sign(stop - start)) * way[1] / way[0]
        followers[j] = (rate, their_start - rate * start)
        stop = start + float(np.sign(stop - start)) * way[0]
    low, high = sorted((start, float(stop)))
    _check_side(model, palm, fingers, first, {first: (start, float(stop)), **_followed(followers, start, float(stop))})
    return Motors(palm, first, followers, (low, high), fingers, stop > start)


def _followed(followers: Mapping[int, tuple[float, float]], start: float, stop: float) -> dict[int, tuple[float, float]]:
    """Where followers are when the first motor is at two values."""
    return {j: (rate * start + offset, rate * stop + offset) for j, (rate, offset) in followers.items()}


def _check_side(model: Model, palm: int, fingers: tuple[Branch, ...], first: int, ends: Mapping[int, tuple[float, float]]) -> None:
    """Raises: NoGripper for two sliding fingers that pass through each other between closed and open. ends: where each motor is then."""
    if len(fingers) != 2 or not all(_slides(model, j) for j in ends):
        return
    places = list[list[Array]]()
    for k in (0, 1):
        q = model.rest.copy()
        q[list(ends)] = [values[k] for values in ends.values()]
        places.append([model.points(f, q, palm).mean(0) for f in fingers])
    between = [plus - minus for plus, minus in places]
    if min(np.linalg.norm(d) for d in between) > THROUGH_M and between[0] @ between[1] < 0:
        names = [model.tree.names[f[0]] for f in fingers]
        middle = np.mean(places, axis=(0, 1))
        sides = [[(p - middle) @ between[0] for p in there] for there in places]
        over = " and ".join(name for name, a, b in zip(names, *sides) if a * b < 0)
        raise NoGripper(
            f"no gripper that can be used: its fingers {names[0]} and {names[1]} pass through each other as {model.joints[first]} goes "
            f"from {min(ends[first]):g} to {max(ends[first]):g}: give the <axis> of what moves {over} the other sign"
        )


def _slides(model: Model, joint: int) -> bool:
    return any(model.tree.kind[i] == SLIDES for i in range(len(model.tree.names)) if model.tree.q_index[i] == joint)


def _spread(model: Model, palm: int, fingers: tuple[tuple[int, ...], ...], q: Array) -> float:
    """How far fingers are apart; of a jaw, how far its tip is from what it closes on."""
    if len(fingers) > 1:
        middles = [model.points(f, q, palm).mean(0) for f in fingers]
        return float(np.linalg.norm(middles[0] - middles[1]))
    jaw = model.points(fingers[0], q, palm)
    pivot = _pivot(model, palm, fingers[0][0], q)
    reach = np.linalg.norm(jaw - pivot, axis=1)
    fixed = model.points(rigid(model, palm), q, palm)
    if not len(fixed):
        return 0.0
    return float(np.mean([np.linalg.norm(fixed - tip, axis=1).min() for tip in jaw[reach > 0.6 * reach.max()]]))


def rigid(model: Model, palm: int) -> list[int]:
    """The links that are fixed to a group."""
    return [i for i in range(len(model.tree.names)) if model.group(i) == palm]


def _pivot(model: Model, palm: int, link: int, q: Array) -> Array:
    poses = model.tree.poses(q)
    return np.asarray((inverse(poses[palm]) @ poses[link])[:3, 3])
