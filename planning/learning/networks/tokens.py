"""What the networks see of a state, as arrays; and the geometry between boxes that the `objects` form is told outright.

Frame: the cabinet's, so that it doesn't matter where the cabinet stands. Unit: all lengths are divided by `LENGTH_M`; rotations and flags
stay as they are. Floats are float32. The functions of the second half are plain arithmetic: they take torch's tensors (training) and
numpy's arrays (inference) alike, with any number of leading axes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinematics.scene import APPROACHES
from kinematics.transforms import inverse
from perception.observation import Observation, boxes_in

F32 = NDArray[np.float32]
LENGTH_M = 0.3
GRASP, CONTEXT = 10, 9  # numbers in Tokens.grasp and Tokens.context
OBJECT, PAIR = 13, 11  # numbers that `box_features` and `pair_features` make


@dataclass(frozen=True, eq=False)
class Tokens:
    """One state, or many with a leading axis.

    context (…, 9): robot base l_r, the cabinet's inner size, and 1 for each of `APPROACHES` that may be used to move objects.
    grasp (…, 10): x_g as position and 6-D rotation (the first two columns), and the width between the pads.
    boxes (…, m + 1, 6): centre and size of each object, the target's first. regions (…, B, 4): x, y, z and 1 where observed.
    """

    context: F32
    grasp: F32
    boxes: F32
    regions: F32


def tokens(seen: Observation) -> Tokens:
    """The tokens of an observation; the non-target objects in the order of `seen.movable`."""
    T = inverse(seen.cabinet.T_world_cabinet)
    R, p = T[:3, :3], T[:3, 3]
    boxes = boxes_in(T, np.array([seen.boxes[name] for name in (seen.target, *seen.movable)])) / LENGTH_M
    hand = T @ seen.grasp.T_world_hand
    grasp = np.concatenate([hand[:3, 3] / LENGTH_M, hand[:3, 0], hand[:3, 1], [seen.grasp.width_m / LENGTH_M]])
    may = [float(kind in seen.approaches) for kind in APPROACHES]
    context = np.concatenate([(R @ seen.robot_base + p) / LENGTH_M, seen.cabinet.size_m / LENGTH_M, may])
    regions = np.column_stack([(seen.regions[:, :3] @ R.T + p) / LENGTH_M, seen.regions[:, 3]])
    return Tokens(*(np.ascontiguousarray(a, np.float32) for a in (context, grasp, boxes, regions)))


def placed_boxes(box: Any, regions: Any, xp: Any) -> Any:
    """The object `box` (…, 6) as it would stand in each region (…, 3 or 4), one for one: (…, 6). xp: numpy or torch."""
    half_height = box[..., 5] / 2
    columns = [regions[..., 0], regions[..., 1], regions[..., 2] + half_height, box[..., 3], box[..., 4], box[..., 5]]
    return xp.stack(columns, -1)


def box_features(boxes: Any, context: Any, grasp: Any, xp: Any) -> Any:
    """A box (…, n, 6) as a token: itself, and where it is for the hand at x_g, for the robot's base and for the walls (…, n, 13).

    context (…, 9), grasp (…, 10). Along and beside the approach of x_g; range and sine of the bearing from the base; room to the nearer
    side wall, the back and the ceiling.
    """
    context, grasp = context[..., None, :], grasp[..., None, :]
    x, y, z = boxes[..., 0], boxes[..., 1], boxes[..., 2]
    ahead_x = grasp[..., 4] * grasp[..., 8] - grasp[..., 5] * grasp[..., 7]  # the third column of x_g's rotation is its approach
    ahead_y = grasp[..., 5] * grasp[..., 6] - grasp[..., 3] * grasp[..., 8]
    from_hand_x, from_hand_y = x - grasp[..., 0], y - grasp[..., 1]
    from_base_x, from_base_y = x - context[..., 0], y - context[..., 1]
    away = (from_base_x**2 + from_base_y**2 + 1e-6) ** 0.5
    columns = [
        *(boxes[..., k] for k in range(6)),
        from_hand_x * ahead_x + from_hand_y * ahead_y,
        from_hand_y * ahead_x - from_hand_x * ahead_y,
        away,
        from_base_y / away,
        context[..., 4] / 2 - abs(y) - boxes[..., 4] / 2,
        context[..., 3] - x - boxes[..., 3] / 2,
        context[..., 5] - z - boxes[..., 5] / 2,
    ]
    return xp.stack(columns, -1)


def pair_features(ours: Any, others: Any, kinds: Any, same: Any, context: Any, xp: Any) -> Any:
    """How each of our boxes (…, n, 6) stands to each of the others (…, k, 6): (…, n, k, 11).

    The way to the other, how far its top is above ours, the gaps along x and y, the way along and beside our bearing from the robot's
    base; kinds (…, k, 3): 1 for the robot's base, the hand at x_g, the target; same (…, n, k): 1 where both are the same object.
    """
    a, b = ours[..., :, None, :], others[..., None, :, :]
    way_x, way_y = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    from_base_x, from_base_y = ours[..., 0] - context[..., None, 0], ours[..., 1] - context[..., None, 1]
    away = (from_base_x**2 + from_base_y**2 + 1e-6) ** 0.5
    ux, uy = (from_base_x / away)[..., None], (from_base_y / away)[..., None]
    plain = xp.ones_like(way_x)
    columns = [
        way_x,
        way_y,
        b[..., 2] + b[..., 5] / 2 - a[..., 2] - a[..., 5] / 2,
        abs(way_x) - (a[..., 3] + b[..., 3]) / 2,
        abs(way_y) - (a[..., 4] + b[..., 4]) / 2,
        way_x * ux + way_y * uy,
        way_y * ux - way_x * uy,
        *(kinds[..., None, :, k] * plain for k in range(3)),
        same,
    ]
    return xp.stack(columns, -1)


def with_base_and_hand(boxes: Any, context: Any, grasp: Any, xp: Any) -> Any:
    """The robot's base and the hand at x_g as boxes of zero size, in front of the objects: (…, m + 3, 6)."""
    ends = xp.stack([context[..., :3], grasp[..., :3]], -2)
    zero = xp.zeros_like(ends)
    return xp.concatenate([xp.concatenate([ends, zero], -1), boxes], -2)


def token_kinds(tokens: int) -> F32:
    """(tokens, 3): 1 for the robot's base, the hand, the target, which come first; zeros for all others."""
    return np.eye(tokens, 3, dtype=np.float32)
