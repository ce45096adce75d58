"""How a hand stands to an object: where it looks, how high and how deep its pads are, and how low they may be."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from kinematics.robots.opening import ROOM_M, Opening
from kinematics.robots.robot import Robot
from kinematics.transforms import Array, apply, inverse

LOWEST_M = {"horizontal": 0.040, "diagonal": 0.020, "downward": 0.015}
"""The pads' centre above the floor, so that the hand clears it: of the named robots. Others are measured."""
IN_CABINET_M, CLEAR_M = 0.08, 0.003  # so much of a hand is in the cabinet with its fingers, and keeps so far from the floor
BELOW_TOP_M = 0.015
BEHIND_M = ROOM_M  # room between an object and what lies behind the pads: knuckles, palm
KNUCKLE_M = 0.020  # half of how wide a knuckle is, across the way the fingers close
STEEP = 1.5  # rad: a hand of this pitch looks straight down
LEAST_BITE_M = 0.010  # how far the pads' middle reaches over an object's near end, at least
UP = np.array([0.0, 0.0, 1.0])
Lowest = Callable[[str, float], float]
"""How high the pads' centre is above the floor, at least, by the approach and its pitch (rad), in metres."""


def usual_lowest(kind: str, pitch: float) -> float:
    """Of the named robots."""
    return LOWEST_M[kind]


@lru_cache(maxsize=16)
def lowest_of(robot: Robot) -> Lowest:
    """How low a robot's pads may be."""
    if robot.grip is None:
        return usual_lowest
    width = robot.opening.max_m / 2
    q = robot.home.copy()
    q[robot.gripper_joint] = robot.opening.value_at(width)
    poses, hand = robot.link_poses(q), robot.hand_links
    T_hand, middle = inverse(poses["hand"]), [0.0, 0.0, robot.opening.pad_z_at(width)]
    points = np.concatenate([apply(T_hand @ poses[h.link], h.vertices) - middle for h in robot.hulls if h.link in hand])
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


def _behind(reach: float, above: float, pitch: float) -> float:
    """How far a box reaches behind the pads' middle along the approach of a pitched hand, between its knuckles: `reach` towards the hand
    and `above` upwards. Its near face ends that, or its top."""
    by_face = (reach + KNUCKLE_M * np.sin(pitch)) / max(np.cos(pitch), 1e-9)
    return float(min(by_face, reach * np.cos(pitch) + above * np.sin(pitch)))


def set_back(reach: float, width_m: float, opening: Opening) -> float:
    """How far before an object's middle the pads must close, so that what lies behind them fits: metres along the approach.

    reach: how far the object extends from its middle towards the hand; its shape is taken for a box.
    """
    return min(max(0.0, reach + BEHIND_M - opening.depth_at(width_m)), _most_back(reach))


def _most_back(reach: float) -> float:
    """The most that a grasp may be set back."""
    return max(0.0, reach - LEAST_BITE_M)


def set_back_pitched(reach: float, above: float, pitch: float, width_m: float, opening: Opening, more: float) -> float:
    """`set_back`, for a level hand by so much more; for a pitched one, which moves upwards with it, so that the pads stay on the body."""
    if pitch == 0.0:
        return min(set_back(reach, width_m, opening) + more, _most_back(reach))
    back = max(0.0, _behind(reach, above, pitch) + BEHIND_M - opening.depth_at(width_m))
    over = _most_back(reach) / max(np.cos(pitch), 1e-9)
    return float(min(back, over, max(0.0, above - BELOW_TOP_M) / np.sin(pitch)))
