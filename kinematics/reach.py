"""How far an arm reaches, at most: what no configuration brings to a place is told without a search for one.

Each joint's axis is a line that its link and the next have in common. A point on each line, fixed in both links, makes the arm a string of
straight pieces of lengths that no configuration changes: the last point is never further from the first than all of them together. Any
points do; those are taken that make the string short, so that shoulder and wrist count as the points that they mostly are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinematics.chain import Chain
from kinematics.transforms import Array, inverse

_ROUNDS = 50
_ON_AXIS_M = 1e-12


class Reach(NamedTuple):
    """No point `wrist` (3,), in the frame that the last joint moves, is ever further than most_m from the point `shoulder` (3,) of the
    world."""

    shoulder: Array
    wrist: Array
    most_m: float

    def beyond_m(self, T_frame_hand: Array, T_world_hand: Array, *, any_heading: bool = False) -> Array:
        """How far hands at poses (..., 4, 4) are out of reach, at least: (...); 0 or less where they may be reached. T_frame_hand (4, 4):
        the hand in that frame; any_heading: it may be turned about the vertical, as an arm of few joints has to."""
        to_hand = T_world_hand[..., :3, 3] - self.shoulder
        to_wrist = T_world_hand[..., :3, :3] @ (T_frame_hand[:3, :3].T @ (self.wrist - T_frame_hand[:3, 3]))
        if any_heading:
            aside_m = np.linalg.norm(to_hand[..., :2], axis=-1) - np.linalg.norm(to_wrist[..., :2], axis=-1)
            return np.asarray(np.hypot(aside_m, to_hand[..., 2] + to_wrist[..., 2]) - self.most_m)
        return np.asarray(np.linalg.norm(to_hand + to_wrist, axis=-1) - self.most_m)


def reach_of(chain: Chain) -> Reach:
    """The reach of a chain's arm, its points where they make the string short."""
    K = len(chain.q_index)
    origins, axes = chain.T_prev[:, :3, 3], chain.T_prev[:, :3, 2]  # of each joint, in the frame that the one before moves
    along = np.zeros(K)  # where on its axis each joint's point is

    def before(k: int) -> Array:
        """Joint k's point in the frame that the joint before moves."""
        return np.asarray(origins[k] + along[k] * axes[k])

    for _ in range(_ROUNDS):
        for k in range(K):
            # the neighbours' points in the frame of joint k at 0, whose z is the axis
            neighbours = [inverse(chain.T_prev[k])[:3] @ np.array([0.0, 0.0, along[k - 1], 1.0])] if k else []
            neighbours += [before(k + 1)] if k < K - 1 else []
            if neighbours:
                z, r = np.array([p[2] for p in neighbours]), np.array([np.hypot(*p[:2]) for p in neighbours])
                # where the shortest way from one neighbour to the other by the axis meets it
                along[k] = (z * r[::-1]).sum() / r.sum() if r.sum() > _ON_AXIS_M else z.mean()
    pieces = [np.linalg.norm(before(k + 1) - np.array([0.0, 0.0, along[k]])) for k in range(K - 1)]
    furthest = np.maximum(np.abs(chain.lower), np.abs(chain.upper))[chain.q_index]
    strokes = np.where(chain.prismatic == 1, np.abs(chain.scale) * furthest + np.abs(chain.offset), 0.0)
    return Reach(before(0), np.array([0.0, 0.0, along[-1]]), float(sum(pieces) + strokes.sum()))
