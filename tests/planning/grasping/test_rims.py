"""Bowls by their rims: a wall that leans outwards is held from above by a hand that leans as it does."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from kinematics.robots.robot import Robot
from kinematics.scene import APPROACHES, Body, Cabinet, RobotRef, Scene
from kinematics.shapes import ConvexMesh
from kinematics.transforms import transform
from planning.grasping.cup_grasps import grasps_on
from planning.grasping.sampling import Sampling
from planning.verdict import judge_grasp

FOOT_M, HIGH_M, THICK_M, PARTS = 0.035, 0.05, 0.003, 16


def bowl(lean: float) -> Body:
    """A foot and a wall of plates that leans outwards by so much (rad), too wide for a 2F-85 to span."""
    yaws = np.arange(PARTS + 1) * 2 * np.pi / PARTS
    rim, wall = FOOT_M + HIGH_M * np.tan(lean), THICK_M / np.cos(lean)
    parts = []
    for two in pairwise(yaws):
        rows = [
            (r * np.cos(a), r * np.sin(a), z)
            for a in two
            for r, z in ((FOOT_M, 0), (FOOT_M - wall, 0), (rim, HIGH_M), (rim - wall, HIGH_M))
        ]
        parts.append(np.array(rows))
    foot = np.array([(FOOT_M * np.cos(a), FOOT_M * np.sin(a), z) for a in yaws[1:] for z in (0, THICK_M)])
    return Body("bowl", ConvexMesh((*parts, foot)), transform(p=[0.6, 0.05, 0.10]))


def held(robot: Robot, body: Body) -> list[np.ndarray]:
    """The hand's poses that the verdict lets hold it."""
    cabinet = Cabinet(np.array([0.56, 0.86, 0.50]), transform(p=[0.35, 0.0, 0.10]), wall_m=0.03)
    scene = Scene("rims", RobotRef(np.eye(4), "ur5e"), cabinet, (body,), body.name, None)
    found = grasps_on(body, robot, APPROACHES, 0.10, 0.0, Sampling(yaws=8))
    return [g.T_world_hand for g in found if judge_grasp(robot, scene, g) is None]


@pytest.mark.parametrize("degrees", [12, 25, 40])
def test_a_bowl_is_held_by_its_rim_all_round(ur5e: Robot, degrees: int) -> None:
    body = bowl(np.radians(degrees))
    hands = held(ur5e, body)
    assert len(hands) >= 16
    yaws = set()
    for T in hands:
        out = T[:2, 3] - body.T_world_body[:2, 3]
        outward = np.append(out / np.linalg.norm(out), 0.0)
        assert np.degrees(np.arccos(-T[2, 2])) == pytest.approx(degrees, abs=1.0)  # from straight down
        assert -T[:3, 2] @ outward > 0  # it comes from further out
        assert abs(T[:3, 1] @ np.cross(outward, (0, 0, 1))) < 0.02  # and closes across the wall
        yaws.add(round(float(np.arctan2(out[1], out[0])), 2))
    assert len(yaws) == 16


def test_a_dish_that_is_flatter_is_not(ur5e: Robot) -> None:
    assert held(ur5e, bowl(np.radians(60))) == []
