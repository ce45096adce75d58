"""How large a pad is, read off a hand whose fingers are written down."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from kinematics.robots.opening import Opening
from kinematics.robots.robot import Robot
from kinematics.transforms import Array, rotation_about, transform
from planning.grasping.pads import Pad, pad_of

T_BASE_HAND = transform(rotation_about((0.0, 1.0, 0.0), 0.3), [0.4, 0.1, 0.2])


class Hand:
    """Stands for a robot: links in the hand's frame, half open by 5 cm, the pads' middle 2 cm along the approach; its links stay
    where they are, however far it is open."""

    def __init__(self, **links: Array) -> None:
        self.opening = Opening(np.array([0.8, 0.0]), np.array([0.0, 0.10]), np.array([0.03, 0.01]), np.full(2, 0.5), np.zeros(2))
        self.home, self.gripper_joint, self.fingers = np.zeros(1), 0, frozenset(links) - {"palm"}
        self.hand_links = frozenset(links)
        self.asked: list[float] = []
        self.hulls = [SimpleNamespace(link=name, vertices=vertices) for name, vertices in links.items()]

    def link_poses(self, q: Array) -> dict[str, Array]:
        self.asked = [*self.asked, float(q[0])]
        return {"hand": T_BASE_HAND, **{h.link: T_BASE_HAND for h in self.hulls}}


def finger(y: float, x: tuple[float, float], z: tuple[float, float], *, wider: float = 0.0) -> Array:
    """A finger (8, 3), a centimetre thick, whose inner face is at y; behind it is wider all round."""
    near = [[a, y, b] for a in x for b in z]
    far = [[a, y + np.copysign(0.01, y), b] for a in (x[0] - wider, x[1] + wider) for b in (z[0] - wider, z[1] + wider)]
    return np.array(near + far)


def pad(**links: Array) -> Pad:
    hand = Hand(**links)
    found = pad_of(cast("Robot", hand))
    assert hand.asked == pytest.approx([0.4, *np.linspace(0.8, 0.0, 9)])  # the face half open, the tips at all openings
    return found


def approximately(half_x_m: float, low_z_m: float, high_z_m: float) -> object:
    return pytest.approx((half_x_m, low_z_m, high_z_m), abs=1e-9)


def numbers(found: Pad) -> tuple[float, float, float]:
    return found.half_x_m, found.low_z_m, found.high_z_m


def test_the_face_that_closes_is_measured_from_the_pads_middle() -> None:
    """Of the left finger: half its width on the wider side, and its ends along the approach; what is wider behind it does not count."""
    left, right = finger(0.025, (-0.012, 0.008), (0.01, 0.04), wider=0.005), finger(-0.025, (-0.02, 0.02), (0.0, 0.05))
    assert numbers(pad(left=left, right=right)) == approximately(0.012, -0.01, 0.02)


def test_the_innermost_link_between_the_tips_is_the_pad() -> None:
    knuckle, behind = finger(0.03, (-0.03, 0.03), (0.0, 0.04)), finger(0.001, (-0.03, 0.03), (-0.2, -0.1))
    left, palm = finger(0.025, (-0.01, 0.01), (0.01, 0.03)), finger(0.002, (-0.05, 0.05), (0.0, 0.04))
    assert numbers(pad(knuckle=knuckle, behind=behind, left=left, palm=palm)) == approximately(0.01, -0.01, 0.01)


def test_no_more_of_a_long_finger_counts_than_the_pad_reaches() -> None:
    assert numbers(pad(left=finger(0.025, (-0.01, 0.01), (-0.1, 0.1)))) == approximately(0.01, -0.025, 0.025)


def test_a_pad_holds_the_pads_middle() -> None:
    """A face that begins beyond the middle is taken to begin there."""
    assert numbers(pad(left=finger(0.025, (-0.01, 0.01), (0.03, 0.04)))) == approximately(0.01, 0.0, 0.02)
    assert numbers(pad(left=finger(0.025, (-0.01, 0.01), (0.0, 0.01)))) == approximately(0.01, -0.02, 0.0)


def test_without_a_finger_on_the_left_the_pads_are_lines() -> None:
    assert numbers(pad(right=finger(-0.025, (-0.01, 0.01), (0.01, 0.03)))) == (0.0, 0.0, 0.0)
    assert numbers(pad(left=finger(0.025, (-0.01, 0.01), (0.1, 0.2)))) == (0.0, 0.0, 0.0)


def test_the_tips_reach_furthest_beyond_the_pads_middle_where_that_is_least_far() -> None:
    """The middle is 1 to 3 cm along the approach, the tip of a finger that holds nothing at 6 cm."""
    left, right = finger(0.025, (-0.01, 0.01), (0.01, 0.04)), finger(-0.025, (-0.01, 0.01), (0.01, 0.06))
    assert pad(left=left, right=right).tip_z_m == pytest.approx(0.05)
    assert pad(palm=finger(0.025, (-0.01, 0.01), (0.01, 0.02))).tip_z_m == pytest.approx(0.01)
