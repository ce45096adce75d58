"""Places before the cabinet where an arm can wait, with an empty hand or with an object in it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import product

import numpy as np

from kinematics import inverse
from kinematics.collision import edge_check
from kinematics.collision.geometry import Query, make_solids
from kinematics.scene import Cabinet
from kinematics.transforms import Array, rotation_about, transform
from planning.motion.arm import HALF_TURN, Arm
from planning.motion.lazy_list import LazyList

LEVEL = np.stack([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]], -1)  # the hand looks along the cabinet's x, its x is up
LOOKS_DOWN = 0.1  # the horizontal part of the hand's approach, from which on it tells where the hand looks


def waiting(arm: Arm, cabinet: Cabinet, looks: Array = LEVEL) -> Iterable[Array]:
    """Arm configurations (A,) with the hand before the cabinet's front, looking in, free of its walls; the most central first.

    looks (3, 3): how the hand looks in, in the cabinet's frame, but for its yaw. What is found is kept.
    """
    return _waiting(arm, cabinet.size_m.tobytes(), cabinet.T_world_cabinet.tobytes(), cabinet.wall_m, looks.tobytes())


def looking_in(T_world_cabinet: Array, R_world_hand: Array) -> Array:
    """A hand's rotation (3, 3) about the vertical so that it looks into the cabinet, in the cabinet's frame; one that looks straight down
    has its x ahead."""
    ahead = R_world_hand[:, 2] if np.hypot(*R_world_hand[:2, 2]) > LOOKS_DOWN else R_world_hand[:, 0]
    yaw = np.arctan2(T_world_cabinet[1, 0], T_world_cabinet[0, 0]) - np.arctan2(ahead[1], ahead[0])
    return np.round(T_world_cabinet[:3, :3].T @ rotation_about((0.0, 0.0, 1.0), float(yaw)) @ R_world_hand, 9)


@lru_cache(maxsize=32)
def _waiting(arm: Arm, size: bytes, T_cabinet: bytes, wall_m: float, looks: bytes) -> Iterable[Array]:
    cabinet = Cabinet(np.frombuffer(size), np.frombuffer(T_cabinet).reshape(4, 4), wall_m)
    return LazyList(_find_waiting(arm, cabinet, np.frombuffer(looks).reshape(3, 3)))


def _find_waiting(arm: Arm, cabinet: Cabinet, looks: Array) -> Iterator[Array]:
    """See `waiting`."""
    solids, names = make_solids(cabinet.walls())
    posed = arm.posed(float(arm.robot.home[arm.robot.gripper_joint]))
    check = np.ones((len(posed.frame), len(names)), np.uint8)
    check[posed.frame == 0] = 0
    problem = edge_check.pose(arm.chain, posed, solids, Query(check, arm.self_pairs), edge_check.MARGIN_M)
    scratch = edge_check.make_scratch(problem)
    _, width, height = cabinet.size_m
    home = arm.robot.arm_q(arm.robot.home)
    for back, z, y, yaw in product((0.08, 0.16), (0.5, 0.9, 0.2), (0.0, 0.25, -0.25, 0.5, -0.5), (0.0, 0.6, -0.6, 1.2, -1.2)):
        p = [-back, y * width, z * height]
        for R in (looks, looks @ HALF_TURN) if arm.few_joints else (looks,):
            T = cabinet.T_world_cabinet @ transform(rotation_about((0.0, 0.0, 1.0), yaw) @ R, p)
            for q in inverse.solve(arm.backing, arm.T_frame_hand, arm.seeds, T, home, tries=8)[:2]:
                if edge_check.config_free(problem, q, scratch):
                    yield q
