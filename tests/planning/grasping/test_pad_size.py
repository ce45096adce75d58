"""How large a pad is, read off a hand whose fingers are written down."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from kinematics.robots.hands.opening import Opening
from kinematics.robots.robot import Robot
from kinematics.transforms import Array, rotation_about, transform
from planning.grasping.pads import PAD_FACE_M, PAD_REACH_M, ROUND_M, Pad, inner_pad_of, pad_of

T_BASE_HAND = transform(rotation_about((0.0, 1.0, 0.0), 0.3), [0.4, 0.1, 0.2])


class Hand:
    """Stands for a robot: links in the hand's frame, half open by 5 cm, the pads' middle 2 cm along the approach; its links stay
    where they are, however far it is open."""

    T, z_m = T_BASE_HAND, (0.03, 0.01)

    def __init__(self, **links: Array) -> None:
        self.opening = Opening(np.array([0.8, 0.0]), np.array([0.0, 0.10]), np.array(self.z_m), np.full(2, 0.5), np.zeros(2))
        self.home, self.gripper_joint, self.fingers = np.zeros(1), 0, frozenset(links) - {"palm"}
        self.hand_links = frozenset(links)
        self.asked: list[float] = []
        self.hulls = [SimpleNamespace(link=name, vertices=vertices) for name, vertices in links.items()]

    def link_poses(self, q: Array) -> dict[str, Array]:
        self.asked = [*self.asked, float(q[0])]
        return {"hand": self.T, **{h.link: self.T for h in self.hulls}}


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


# ------------------------------------------------------------------------------------------------------------------------------- to a hair


class Unrounded(Hand):
    """The same with the pads' middle in the hand's origin, and that in the world's."""

    T, z_m = np.eye(4), (0.0, 0.0)


def unrounded(**links: Array) -> tuple[float, float, float]:
    return numbers(pad_of(cast("Robot", Unrounded(**links))))


def test_the_numbers_of_a_pad() -> None:
    assert (PAD_FACE_M, PAD_REACH_M) == (0.001, 0.025)
    assert Pad(0.01, -0.01, 0.01).tip_z_m == 0.0


def test_corners_a_millimetre_behind_the_face_belong_to_it() -> None:
    """Those of a bevel twice as wide; a hair further off they do not."""
    face = np.array([[x, 0.025, z] for x in (-0.01, 0.01) for z in (-0.01, 0.01)])
    for behind, half_x_m in ((0.025 + PAD_FACE_M, 0.02), (np.nextafter(0.025 + PAD_FACE_M, 1.0), 0.01)):
        bevel = np.array([[x, behind, z] for x in (-0.02, 0.02) for z in (-0.01, 0.01)])
        assert unrounded(left=np.concatenate([face, bevel])) == (half_x_m, -0.01, 0.01)


def test_a_face_that_just_touches_where_pads_may_be_is_none() -> None:
    """On the hand's middle plane, or ending where the reach does, on either side."""
    none = (0.0, 0.0, 0.0)
    for y, z, found in (
        (0.0, (-0.01, 0.01), none),
        (1e-9, (-0.01, 0.01), (0.01, -0.01, 0.01)),
        (0.025, (PAD_REACH_M, 0.05), none),
        (0.025, (0.0249, 0.05), (0.01, 0.0, PAD_REACH_M)),
        (0.025, (-0.05, -PAD_REACH_M), none),
        (0.025, (-0.05, -0.0249), (0.01, -PAD_REACH_M, 0.0)),
    ):
        assert unrounded(left=finger(y, (-0.01, 0.01), z)) == found


def test_of_two_links_as_far_inside_the_first_is_the_pad() -> None:
    wide, slim = finger(0.025, (-0.02, 0.02), (-0.01, 0.01)), finger(0.025, (-0.01, 0.01), (-0.02, 0.02))
    assert unrounded(wide=wide, slim=slim) == (0.02, -0.01, 0.01)
    assert unrounded(slim=slim, wide=wide) == (0.01, -0.02, 0.02)


def test_of_a_round_pad_the_largest_square_counts_for_holding_and_all_of_it_for_proofs() -> None:
    angles, radius = np.arange(96) * np.pi / 48, 0.009
    near = np.stack([radius * np.cos(angles), np.full(96, 0.02), 0.02 + radius * np.sin(angles)], -1)
    hand = cast("Robot", Hand(left=np.concatenate([near, near + np.array([0.0, 0.01, 0.0])])))
    assert numbers(pad_of(hand)) == approximately(radius, -radius, radius)
    side = (radius + ROUND_M) * np.sqrt(0.5)
    assert numbers(inner_pad_of(hand)) == pytest.approx((side, -side, side), rel=0.03)


@pytest.mark.parametrize("z", [(0.01, 0.03), (-0.02, 0.028)])
def test_a_pad_that_is_a_rectangle_stays_as_it_is(z: tuple[float, float]) -> None:
    hand = cast("Robot", Hand(left=finger(0.02, (-0.01, 0.01), z)))
    assert inner_pad_of(hand) == pad_of(hand)
