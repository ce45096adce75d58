"""How low a hand may be, and how it looks along a line."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from kinematics.robots.hands.opening import Opening
from kinematics.robots.robot import Robot
from kinematics.transforms import Array, apply, inverse, rotation_about, transform
from planning.grasping.hand_poses import ALONG, CLEAR_M, IN_CABINET_M, LOWEST_M, _Planes, hand_looking, lowest_of

T_BASE_HAND = transform(rotation_about((0.0, 1.0, 0.0), 0.3), [0.4, 0.1, 0.2])
T_HAND_LINK = transform(rotation_about((1.0, 2.0, 3.0), 0.7), [0.01, -0.02, 0.03])
PALM_X_M, TIP_Z_M, PADS_Z_M = 0.05, 0.03, 0.02


class Hand:
    """Stands for a robot: fingers to 3 cm before the hand's origin, the pads' middle 1 cm behind that, a palm 5 cm below it, a long arm."""

    def __init__(self, grip: object) -> None:
        self.opening = Opening(np.array([0.8, 0.0]), np.array([0.0, 0.10]), np.array([0.03, 0.01]), np.full(2, 0.5), np.zeros(2))
        self.home, self.gripper_joint, self.grip = np.zeros(1), 0, grip
        finger = np.array([[x, y, z] for x in (-0.01, 0.01) for y in (0.02, 0.03) for z in (0.0, TIP_Z_M)])
        palm = np.array([[x, y, z] for x in (-PALM_X_M, 0.02) for y in (-0.03, 0.03) for z in (-0.05, -0.04)])
        arm = np.array([[x, 0.0, -IN_CABINET_M - 0.2] for x in (-0.5, 0.5)])
        self.hand_links = frozenset({"finger", "palm", "wrist"})
        links = {"finger": finger, "palm": palm, "wrist": arm, "forearm": palm - [1.0, 0.0, 0.0]}
        self.hulls = [SimpleNamespace(link=name, vertices=apply(inverse(T_HAND_LINK), vertices)) for name, vertices in links.items()]

    def link_poses(self, q: Array) -> dict[str, Array]:
        assert q == pytest.approx([0.4])  # half open
        return {"hand": T_BASE_HAND, **{h.link: T_BASE_HAND @ T_HAND_LINK for h in self.hulls}}


def test_the_named_robots_pads_are_as_high_as_the_table_says() -> None:
    lowest = lowest_of(cast("Robot", Hand(None)))
    assert {kind: lowest(kind, 0.0) for kind in LOWEST_M} == LOWEST_M


def test_the_pads_of_other_hands_are_so_high_that_hand_and_fingers_clear_the_floor() -> None:
    """Level it is the palm's side, straight down the fingertips, between them whichever is lower; the wrist is not in the cabinet."""
    lowest = lowest_of(cast("Robot", Hand("measured")))
    assert lowest("horizontal", 0.0) == pytest.approx(PALM_X_M + CLEAR_M)
    assert lowest("downward", np.pi / 2) == pytest.approx(TIP_Z_M - PADS_Z_M + CLEAR_M)
    for pitch in (np.pi / 6, np.pi / 3):
        palm = (-0.04 - PADS_Z_M) * np.sin(pitch) + PALM_X_M * np.cos(pitch)
        tip = (TIP_Z_M - PADS_Z_M) * np.sin(pitch) + 0.01 * np.cos(pitch)
        assert lowest("diagonal", pitch) == pytest.approx(max(palm, tip) + CLEAR_M)


@pytest.mark.parametrize("z", [[1.0, 0.0, 0.0], [0.48, 0.64, -0.6], [-0.36, 0.48, 0.8]])
def test_a_hand_that_looks_along_a_line_is_level_and_has_its_x_up(z: list[float]) -> None:
    R = hand_looking(np.array(z))
    assert np.allclose(R.T @ R, np.eye(3))
    assert np.allclose(R[:, 2], z)
    assert R[2, 1] == pytest.approx(0.0)
    assert R[2, 0] > 0


def test_a_hand_that_looks_straight_down_has_its_x_against_what_is_ahead() -> None:
    R = hand_looking(np.array([0.0, 0.0, -1.0]), np.array([0.6, 0.8, 0.0]))
    assert np.allclose(R[:, 0], [-0.6, -0.8, 0.0])
    assert np.linalg.det(R) == pytest.approx(1.0)


def test_the_numbers_of_a_hand_in_the_cabinet() -> None:
    assert (IN_CABINET_M, CLEAR_M, ALONG) == (0.08, 0.003, 1e-6)


def test_what_is_just_as_far_behind_the_pads_as_the_cabinet_takes_is_not_in_it() -> None:
    """In the hand's own frame, so that nothing is rounded: a flange 8 cm behind the pads' middle is twice as high as the palm."""
    for behind, higher in ((IN_CABINET_M, False), (np.nextafter(IN_CABINET_M, 0.0), True)):
        hulls = [("palm", [[-0.05, 0.0, -0.04], [0.02, 0.0, 0.0]]), ("flange", [[-0.10, 0.0, -behind]])]
        hand = SimpleNamespace(
            opening=Opening(np.array([0.8, 0.0]), np.array([0.0, 0.10]), np.zeros(2), np.full(2, 0.5), np.zeros(2)),
            home=np.zeros(1), gripper_joint=0, grip="measured", hand_links=frozenset({"palm", "flange"}),
            hulls=[SimpleNamespace(link=name, vertices=np.array(points)) for name, points in hulls],
            link_poses=lambda q: {"hand": np.eye(4), "palm": np.eye(4), "flange": np.eye(4)},
        )  # fmt: skip
        lowest = lowest_of.__wrapped__(cast("Robot", hand))
        assert lowest("horizontal", 0.0) == pytest.approx((0.10 if higher else 0.05) + CLEAR_M)


def test_a_plane_that_hardly_gains_is_not_waited_for() -> None:
    """Across the first a micrometre is lacking, and it gains as little a metre: too little to lead along it, by a hair or not at all."""
    planes = _Planes(np.ones(2, bool), np.zeros(2), np.zeros(2), np.zeros(2))
    for gain, needed in ((ALONG, 3.0), (1.5 * ALONG, 1 / 1.5)):
        assert planes.needed(np.array([[1e-6], [3.0]]), np.array([gain, 1.0])) == pytest.approx(needed)
