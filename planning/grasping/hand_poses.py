"""How a hand stands to an object: where it looks, how high and how deep its pads are, and how low they may be."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from kinematics.robots.hands.opening import ROOM_M, SLICES, TILTS, Opening
from kinematics.robots.robot import Robot
from kinematics.transforms import Array, apply, inverse

LOWEST_M = {"horizontal": 0.040, "diagonal": 0.020, "downward": 0.015}
"""The pads' centre above the floor, so that the hand clears it: of the named robots. Others are measured."""
IN_CABINET_M, CLEAR_M = 0.08, 0.003  # so much of a hand is in the cabinet with its fingers, and keeps so far from the floor
BELOW_TOP_M = 0.015
BEHIND_M = ROOM_M  # room between an object and what lies behind the pads: knuckles, palm
STEEP = 1.5  # rad: a hand of this pitch looks straight down
ALONG = 1e-6  # what leads along a direction has at least that cosine with it
LEAST_BITE_M = 0.010  # how far the pads' middle reaches over an object's near end along the approach, at least
MOST_BESIDE_M = 0.005  # how far behind the middle of what is round the pads' middle is, at most
UP = np.array([0.0, 0.0, 1.0])
Lowest = Callable[[str, float], float]
"""How high the pads' centre is above the floor, at least, by the approach and its pitch (rad), in metres."""


def level_across(u: Array) -> Array:
    """The level vector (3,) that stands square on what u (3,) has that is level, and is as long."""
    return np.array([-u[1], u[0], 0.0])


def ahead_of(R: Array, pitch: float, there: Array) -> Array:
    """The level direction (3,) in which a hand R (3, 3) looks; where it looks straight down, the nearer to `there` of its two."""
    level = level_across(R[:, 1])
    return np.asarray(level * np.sign(level @ (R[:, 2] if pitch < STEEP else there)))


def usual_lowest(kind: str, pitch: float) -> float:
    """Of the named robots."""
    return LOWEST_M[kind]


def hand_points(robot: Robot, width_m: float, links: Collection[str]) -> Array:
    """The corners (N, 3), in the hand's frame, of some of its links when it is open by a width."""
    q = robot.home.copy()
    q[robot.gripper_joint] = robot.opening.value_at(width_m)
    poses = robot.link_poses(q)
    T_hand = inverse(poses["hand"])
    return np.concatenate([apply(T_hand @ poses[h.link], h.vertices) for h in robot.hulls if h.link in links])


@lru_cache(maxsize=16)
def lowest_of(robot: Robot) -> Lowest:
    """How low a robot's pads may be."""
    if robot.grip is None:
        return usual_lowest
    width = robot.opening.max_m / 2
    points = hand_points(robot, width, robot.hand_links) - [0.0, 0.0, robot.opening.pad_z_at(width)]
    points = points[points[:, 2] > -IN_CABINET_M]

    def lowest(kind: str, pitch: float) -> float:
        if pitch > STEEP:
            return float(points[:, 2].max()) + CLEAR_M
        return float((points[:, 2] * np.sin(pitch) - points[:, 0] * np.cos(pitch)).max()) + CLEAR_M

    return lowest


def hand_looking(z: Array, ahead: Array | None = None) -> Array:
    """Rotation (3, 3) of a hand that looks along z (3,), its y level and its x up; ahead (3,): level, where it looks straight down."""
    level = z * [1.0, 1.0, 0.0] if ahead is None else ahead
    y = np.cross(level, UP) if ahead is None else np.cross(ahead, z)
    y = y / np.linalg.norm(y)
    return np.stack([np.cross(y, z), y, z], -1)


def level_hand(ahead: Array, pitch: float) -> Array:
    """Rotation (3, 3) of a hand that looks along `ahead` (3,), level, and down by `pitch`: it closes level, its x is up, or
    opposite to `ahead` if it looks straight down."""
    co, si = np.cos(pitch), np.sin(pitch)
    a, b = float(ahead[0]), float(ahead[1])
    y = (b, -a) if pitch < STEEP else (-b, a)  # approach × up, or ahead × approach
    z = (co * a, co * b, -si)
    x = (y[1] * z[2], -y[0] * z[2], y[0] * z[1] - y[1] * z[0])
    return np.array([[x[0], y[0], z[0]], [x[1], y[1], z[1]], [x[2], 0.0, z[2]]])


def height_of(kind: str, low: float, high: float, floor: float, share: float, least: float = -np.inf) -> float | None:
    """The height of the pads' centre, or None when the body is too low for this approach. share: of the body's height; 1 is as high as the
    pads hold it. floor: the lowest that the pads may be, world.
    least: from here on the body's top fits before what lies behind the pads of a pitched hand; where the pads can't be as high as that,
    they are as high as they can."""
    highest = high - min(BELOW_TOP_M, 0.3 * (high - low))
    wanted = high - 0.02 if kind == "downward" else low + share * (high - low)
    z = max(highest if share >= 1 and kind != "downward" else wanted, floor, min(least, highest))
    return round(z, 6) if z <= highest else None


def set_back(reach: float, width_m: float, opening: Opening) -> float:
    """How far before an object's middle the pads must close, so that what lies behind them fits: metres along the approach.

    reach: how far the object extends from its middle towards the hand; its shape is taken for a box.
    """
    return fit_box(reach, 0.0, 0.0, width_m, opening, 0.0).along_m


@dataclass(frozen=True)
class Move:
    """How a hand moves from where its pads' middle is in an object's: back along the approach, up, and back on a level, in metres."""

    along_m: float = 0.0
    up_m: float = 0.0
    level_m: float = 0.0

    def by(self, R: Array) -> Array:
        """The same (3,) for a hand that is turned by R (3, 3), its y level."""
        return np.asarray(-self.along_m * R[:, 2] + [self.level_m * R[1, 1], -self.level_m * R[0, 1], self.up_m])


STAY = Move()


@lru_cache(maxsize=256)
def fit_box(reach: float, above: float, pitch: float, width_m: float, opening: Opening, more: float, room_m: float = BEHIND_M) -> Move:
    """So far back that what lies behind the pads fits, if the pads' middle may stay over the object.

    reach: how far the object, taken for a box, extends from its middle towards the hand; above: from there upwards. more: by so much more,
    for a level hand. A pitched one moves upwards as it goes back; room_m: what it is to keep.
    """
    moves = fit_boxes(np.array([reach]), np.array([above]), pitch, np.array([width_m]), opening, more, room_m)
    return Move(*(float(move[0]) for move in moves))


def fit_boxes(
    reach: Array, above: Array, pitch: float, width_m: Array, opening: Opening, more: float, room_m: float = BEHIND_M
) -> tuple[Array, Array, Array]:
    """The same for many objects (N,): a move's three lengths, (N,) each."""
    nothing = np.zeros(len(reach))
    if pitch == 0.0:
        most = np.maximum(0.0, reach - LEAST_BITE_M)
        back = np.minimum(np.maximum(0.0, reach + BEHIND_M - opening.depth_at(width_m)), most)
        return np.minimum(back + more, most), nothing, nothing
    co, si, planes = max(float(np.cos(pitch)), 1e-9), float(np.sin(pitch)), _planes(pitch)
    depths = opening.depths_at(width_m)[:, planes.between].min(2).T - room_m
    along = planes.needed(_lacking(reach, above, planes, depths), planes.tilts)
    most = np.minimum(np.maximum(0.0, reach / co - LEAST_BITE_M), np.maximum(0.0, above - BELOW_TOP_M) / si)
    if pitch > STEEP:
        return np.minimum(along, most), nothing, nothing
    reach, above = reach - most * co, above - most * si
    up = np.minimum(planes.needed(_lacking(reach, above, planes, depths), planes.rises), np.maximum(0.0, above - BELOW_TOP_M))
    level = planes.needed(_lacking(reach, above - up, planes, depths), planes.faces)
    enough = along <= most
    level = np.minimum(level, np.maximum(0.0, reach - LEAST_BITE_M * co))
    return np.where(enough, along, most), np.where(enough, 0.0, up), np.where(enough, 0.0, level)


@lru_cache(maxsize=256)
def fit_round(radius: float, above: float, pitch: float, opening: Opening, room_m: float = BEHIND_M) -> Move:
    """The same for an upright cylinder: the pads meet it in one line on either side, and it stays between them."""
    if opening.round_only:
        return STAY  # it is held where the table says
    planes = _planes(pitch)
    lacks = _lacking(_chords(radius), above, planes, opening.depths_at(np.array([2 * radius]))[0, planes.between] - room_m)
    return Move(min(float(planes.needed(lacks, planes.tilts).max()), MOST_BESIDE_M))


@lru_cache(maxsize=256)
def fit_lying(radius: float, reach: float, above: float, pitch: float, opening: Opening, room_m: float = BEHIND_M) -> Move:
    """The same for a cylinder that lies along the way in which a pitched hand looks. reach: half its length; above: of its top."""
    planes = _planes(pitch)
    depths = opening.depths_at(np.array([2 * radius]))[0, planes.between] - room_m
    lacks = _lacking(reach, above - radius + _chords(radius), planes, depths)
    return Move(min(float(planes.needed(lacks, planes.tilts).max()), MOST_BESIDE_M))


def most_above(radius: float, pitch: float, opening: Opening, room_m: float = BEHIND_M) -> float:
    """How far an upright cylinder may extend above the pads' middle, so that it fits before what lies behind them."""
    planes = _planes(pitch)
    lacks, rises = (
        _lacking(_chords(radius), 0.0, planes, opening.depths_at(np.array([2 * radius]))[0, planes.between] - room_m),
        planes.rises,
    )
    some = rises > ALONG
    return float((-lacks[some] / rises[some, None]).max(0).min())


def _chords(radius: float) -> Array:
    """How far each slice (S,) across a cylinder reaches from its axis."""
    return np.asarray(radius * np.sqrt(1 - SLICES**2))


@dataclass(frozen=True, eq=False)
class _Planes:
    """The planes, across some of TILTS, that may lie between an object's near and upper sides and a pitched hand.

    between (T,): across which. tilts, rises, faces (P,): the cosines between them and the approach, the vertical, and the level ahead.
    """

    between: NDArray[np.bool_]
    tilts: Array
    rises: Array
    faces: Array

    def needed(self, lacks: Array, gains: Array) -> Array:
        """How far (S,) the hand has to move for nothing to be lacking (P, S): a metre gains so much across each plane (P,)."""
        some = gains > ALONG
        return np.asarray(np.maximum(0.0, (lacks[some] / gains[some, None]).min(0)))


@lru_cache(maxsize=64)
def _planes(pitch: float) -> _Planes:
    between = np.abs(TILTS - (pitch - np.pi / 4)) < np.pi / 4 + ALONG
    tilts = TILTS[between]
    return _Planes(between, np.cos(tilts), np.sin(pitch - tilts), np.cos(pitch - tilts))


def _lacking(reach: float | Array, above: float | Array, planes: _Planes, depths: Array) -> Array:
    """By how much slices of an object that reach so far (S,) towards a pitched hand, and up, reach too far for depths (P, S) behind the
    pads: (P, S)."""
    return np.asarray(reach * planes.faces[:, None] + above * planes.rises[:, None] - depths)
