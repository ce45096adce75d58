"""A robot's arm at one place: its collision model, with what inverse kinematics starts from, and its fingers on their way."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from kinematics import inverse
from kinematics.chain import Int, forward
from kinematics.collision.posed_geometry import PosedGeometry, join_posed, make_geometry_model
from kinematics.collision.robot_model import OPENINGS, RobotCollisionModel
from kinematics.robots.robot import Robot
from kinematics.transforms import Array

FINGERS_AT = (1 / 3, 2 / 3, 1.0)  # shares of the fingers' way at which they are looked at


class Arm(RobotCollisionModel):
    """A robot at one place, with what inverse kinematics starts from."""

    def __init__(self, robot: Robot, T_world_base: Array) -> None:
        super().__init__(robot, T_world_base)
        self.seeds = inverse.make_seeds(self.chain, self.T_frame_hand)
        self.self_pairs: Int = robot.self_pairs()
        self.fingers: Int = np.flatnonzero(np.isin(self.links, sorted(robot.fingers)))
        self._finger_pieces = make_geometry_model([robot.hulls[i].vertices for i in self.fingers])
        self._moving: dict[tuple[float, float], tuple[PosedGeometry, tuple[str, ...], Int, NDArray[np.bool_]]] = {}

    def moving_fingers(self, opened: float, closed: float) -> tuple[PosedGeometry, tuple[str, ...], Int, NDArray[np.bool_]]:
        """The arm with its fingers at several gripper values on the way from `opened` to `closed` at once: the posed geometry, its links,
        the pairs (S, 2) of them in which a finger takes part, and which of the links (P,) are fingers."""
        key = (opened, closed)
        if key not in self._moving:
            if len(self._moving) == OPENINGS:
                self._moving.pop(next(iter(self._moving)))  # the oldest
            *before, last = (opened + share * (closed - opened) for share in FINGERS_AT)
            own, posed, links = self.fingers, self.posed(last), self.links
            pairs = [self.self_pairs[np.isin(self.self_pairs, own).any(1)]]
            for gripper in before:
                posed = join_posed(posed, self.posed_links(own, self._finger_pieces, gripper))
                copies = np.arange(len(self.links))
                copies[own] = len(links) + np.arange(len(own))
                links += tuple(self.links[i] for i in own)
                pairs.append(copies[pairs[0]])
            self._moving[key] = posed, links, np.concatenate(pairs), np.isin(links, sorted(self.robot.fingers))
        return self._moving[key]

    def hand_pose(self, q: Array) -> Array:
        """T_world_hand (4, 4) at the arm's configuration q (A,)."""
        frames = np.empty((len(self.chain.q_index) + 1, 4, 4))
        forward(self.chain, q, frames)
        return np.asarray(frames[-1] @ self.T_frame_hand)


def arm_at(robot: Robot, T_world_base: Array) -> Arm:
    """The arm standing at T_world_base (4, 4), made once."""
    return _arm(robot, T_world_base.tobytes())


@lru_cache(maxsize=8)
def _arm(robot: Robot, base: bytes) -> Arm:
    return Arm(robot, np.frombuffer(base).reshape(4, 4))
