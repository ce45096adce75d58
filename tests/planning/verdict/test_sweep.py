"""Samples of a motion and bounds between boxes, in numbers that are known by hand."""

from __future__ import annotations

import numpy as np
import pytest
from toy_arm import ARM, course, splined

from kinematics.transforms import Array, rotation_about, transform
from planning.verdict.sweep import SLACK, Boxes, Sweep, _moved, least_distance, open_intervals, sweep

BASE = transform(rotation_about((0, 0, 1), 0.7), [0.1, 0.2, 0.3])


def boxes(*carriers: int, half: tuple[float, float, float] = (0.1, 0.1, 0.1), T: Array | None = None) -> Boxes:
    """One box for each carrier, at T in it, and one that stands at (5, 5, 5)."""
    there = np.array([*[np.eye(4) if T is None else T] * len(carriers), transform(p=[5, 5, 5])])
    n = len(there)
    return Boxes(np.array(carriers), there, np.zeros((n, 3)), np.tile(half, (n, 1)))


def test_a_slide_in_even_samples() -> None:
    """10 cm in four pieces of 2.5; each, with a tenth more for safety, in 14 samples of less than 2 mm. The rows are among them."""
    found = sweep(ARM, BASE, course((0,), (0.1,), (0.1,)), boxes(1, 0), 0.002)
    assert found.rows[:15] == pytest.approx(np.arange(15) / 14 / 4)
    assert found.rows[-2:] == pytest.approx([1.0, 2.0])  # in which nothing moves: one piece
    assert len(found.rows) == 1 + 4 * 14 + 1
    assert found.T.shape == (58, 2, 4, 4)
    assert np.allclose(found.T[:57, 0, :3, 3], BASE[:3, 3] + 0.1 * found.rows[:57, None] * BASE[:3, 0])
    assert np.allclose(found.T[:, 1], BASE)
    assert np.allclose(found.T_standing, [transform(p=[5, 5, 5])])
    assert found.gone[:57, 0] == pytest.approx(SLACK * 0.1 * found.rows[:57])
    assert found.gone[57, 0] == pytest.approx(0.11)
    assert found.gone[:, 1:].tolist() == [[0, 0]] * 58
    assert SLACK == 1.1


def test_samples_at_the_step_itself() -> None:
    """A piece is never cut finer than it needs: 1.1 × 2 cm in steps of 2.2 cm is one."""
    assert sweep(ARM, BASE, course((0,), (0.02,)), boxes(1), 0.0221).rows.tolist() == [0, 1]
    assert sweep(ARM, BASE, course((0,), (0.02,)), boxes(1), 0.0219).rows.tolist() == [0, 0.5, 1]


def test_a_box_that_turns_moves_as_far_as_its_furthest_corner() -> None:
    """Over 0.03 rad at a time: the corner 50 cm from the axis, the chord of each piece."""
    found = sweep(ARM, BASE, course((0, 0, 0), (0, 0, 0.06)), boxes(3, half=(0.3, 0.4, 0.1)), 0.001)
    chord = 2 * 0.5 * np.sin(0.015)
    assert found.gone[-1, 0] == pytest.approx(2 * SLACK * chord)
    assert len(found.rows) == 1 + 2 * int(np.ceil(SLACK * chord / 0.001))
    aside = sweep(ARM, BASE, course((0, 0, 0), (0, 0, 0.03)), boxes(3, half=(0.0, 0.0, 0.5), T=transform(p=[0.2, 0, 0])), 0.001)
    assert aside.gone[-1, 0] == pytest.approx(SLACK * 0.4 * np.sin(0.015))


def test_one_row_is_one_sample() -> None:
    found = sweep(ARM, BASE, course((0.5, 0.25)), boxes(2), 0.002)
    assert found.rows.tolist() == [0]
    assert np.allclose(found.T[0, 0], BASE @ transform(p=[0.5, 0.25, 0]))
    assert found.gone.tolist() == [[0, 0]]


def test_a_spline_is_followed_where_it_goes() -> None:
    found = sweep(ARM, np.eye(4), splined((0,), (0.02,)), boxes(1), 0.002)
    s = found.rows
    assert found.T[:, 0, 0, 3] == pytest.approx(0.02 * (10 * s**3 - 15 * s**4 + 6 * s**5))
    # there and back: the joint's way is that of its coefficients, 0, 1, 2, 0 mm
    swing = splined((0,), (0,), qd=np.array([[0.2, 0, 0, 0, 0], [0, 0, 0, 0, 0]]))
    assert len(sweep(ARM, np.eye(4), swing, boxes(1), 0.002).rows) >= 1 + 6


@pytest.mark.parametrize("way", [0.02, 0.03, 0.05, 0.3])
def test_where_joints_speed_up_and_slow_down_no_point_goes_further_than_is_said(way: float) -> None:
    """A spline from rest to rest is nearly twice as fast in its middle as in the mean, and slow at its ends."""
    for moves, half in (((way,), 0.1), ((0, 0, way), 0.8)):
        found = sweep(ARM, BASE, splined((0,), moves), boxes(3, half=(half, half, 0.1)), 0.002)
        corners = found.T[:, 0, :3, :3] @ np.array([[x, y, 0.1] for x in (-half, half) for y in (-half, half)]).T + found.T[:, 0, :3, 3:]
        far = np.linalg.norm(corners[:, None] - corners[None], axis=2).max(-1)
        assert np.diag(far, 1).max() <= 0.002
        assert (far <= np.abs(found.gone[:, None, 0] - found.gone[None, :, 0]) + 1e-12).all()


def test_how_far_a_corner_moves() -> None:
    a, b = np.eye(4), transform(p=[3, 4, 0])
    c = transform(rotation_about((0, 0, 1), 0.2), [3, 4, 0])
    ways = _moved(np.array([[a, a], [b, b], [c, c]]), np.array([[0, 0, 0], [6, 8, 0.0]]), np.array([[3, 4, 1], [0, 0, 5.0]]))
    assert ways == pytest.approx(np.array([[5, 5], [2 * 5 * np.sin(0.1), 2 * 10 * np.sin(0.1)]]))


def test_the_corner_that_moves_furthest_counts() -> None:
    """A box from x = 1 to 3 turns by a quarter about z and goes 1 m along y: its corner at x = 3 goes from (3, 0) to (0, 4)."""
    quarter = transform(rotation_about((0, 0, 1), np.pi / 2), [0, 1, 0])
    ways = _moved(np.array([[np.eye(4)], [quarter]]), np.array([[2.0, 0, 0]]), np.array([[1.0, 0, 0]]))
    assert ways == pytest.approx(np.array([[5.0]]))


# --------------------------------------------------------------------------------------------------------------------------------- bounds


def two(T_a: Array, half_a: object, T_b: Array, half_b: object, middle_a: object = (0, 0, 0)) -> float:
    s = Sweep(
        np.zeros(1), T_a[None, None], T_b[None], np.array([middle_a, (0, 0, 0)], float), np.array([half_a, half_b], float), np.zeros((1, 2))
    )
    one = least_distance(s, np.array([0]), np.array([1]), np.array([0]))
    other = least_distance(s, np.array([1]), np.array([0]), np.array([0]))
    assert one == pytest.approx(other)
    return float(one[0])


def test_boxes_along_their_axes() -> None:
    cube, here = (0.5, 0.5, 0.5), np.eye(4)
    for axis in range(3):
        for sign in (1, -1):
            assert two(here, cube, transform(p=3.0 * sign * np.eye(3)[axis]), (1, 1, 1)) == pytest.approx(1.5)
    assert two(here, (0.5, 0.1, 0.2), transform(p=[0, 0, 3.0]), (1, 2, 0.3)) == pytest.approx(2.5)
    assert two(here, cube, transform(p=[1.2, 0, 0]), cube) == pytest.approx(0.2)
    assert two(here, cube, transform(p=[0.9, 0.1, 0]), cube) < 0
    eighth = rotation_about((0, 0, 1), np.pi / 4)
    assert two(here, cube, transform(eighth, [3.0, 0, 0]), (1, 1, 1)) == pytest.approx(2.5 - np.sqrt(2))
    turned = transform(rotation_about((1, 2, 3), 1.1), [1, 1, 1])
    assert two(turned, cube, turned @ transform(eighth, [3.0, 0, 0]), (1, 1, 1)) == pytest.approx(2.5 - np.sqrt(2))
    quarter = transform(rotation_about((0, 0, 1), np.pi / 2), [3.0, 0, 0])
    assert two(here, cube, quarter, (0.2, 1.0, 0.2)) == pytest.approx(1.5)


def test_a_ball_from_a_box() -> None:
    """Across a corner: the small box's ball is 2 m off both ways, and its radius is √0.03."""
    assert two(np.eye(4), (0.1, 0.1, 0.1), transform(p=[3, 3, 0]), (1, 1, 1)) == pytest.approx(np.sqrt(8) - np.sqrt(0.03))
    assert two(np.eye(4), (0.5, 0.5, 0.5), transform(p=[3, 3, 0]), (0.5, 0.5, 0.5)) == pytest.approx(np.sqrt(12.5) - np.sqrt(0.75))


def test_boxes_are_about_their_middles() -> None:
    assert two(np.eye(4), (0.5, 0.5, 0.5), transform(p=[3, 0, 0]), (1, 1, 1), (1, 0, 0)) == pytest.approx(0.5)
    turned = transform(rotation_about((0, 0, 1), np.pi / 2))
    assert two(turned, (0.5, 0.5, 0.5), transform(p=[0, 3, 0]), (1, 1, 1), (1, 0, 0)) == pytest.approx(0.5)


def points(x: Array, gone: Array | None = None, *standing: tuple[float, float]) -> Sweep:
    """A point that goes along the x axis, and some that stand."""
    T = transform(p=np.stack([x, 0 * x, 0 * x], -1))[:, None]
    T_standing = np.array([transform(p=[*p, 0.0]) for p in standing])
    n = 1 + len(standing)
    ways = np.zeros((len(x), n))
    ways[:, 0] = np.append(0, np.cumsum(np.abs(np.diff(x)))) if gone is None else gone
    return Sweep(np.arange(float(len(x))), T, T_standing, np.zeros((n, 3)), np.zeros((n, 3)), ways)


def intervals(s: Sweep, *pairs: tuple[int, int], still: tuple[bool, ...] | None = None, apart_m: float = 0.0) -> list[tuple[int, int, int]]:
    a, b = np.array(pairs).T
    return open_intervals(s, a, b, np.array(still or [False] * len(pairs)), apart_m)


def test_where_bounds_do_not_tell() -> None:
    """A point passes over the one at x = 4, a metre a sample: what is 2 m off at one sample is sure not to touch within the next 2."""
    s = points(np.arange(9.0), None, (4.0, 0.0), (4.0, 0.5), (100.0, 0.0))
    assert intervals(s, (0, 1)) == [(0, 2, 6)]
    assert intervals(s, (1, 0)) == [(0, 2, 6)]
    assert intervals(s, (0, 2)) == []  # half a metre beside it
    assert open_intervals(s, np.array([0]), np.array([2]), np.array([False])) == []
    assert intervals(s, (0, 2), apart_m=0.3) == [(0, 2, 6)]
    assert intervals(s, (0, 3), (0, 1), (0, 2)) == [(1, 2, 6)]
    assert intervals(s, (0, 3), apart_m=96.5) == [(0, 2, 8)]
    assert intervals(s, (0, 1), (0, 1)) == [(0, 2, 6), (1, 2, 6)]
    assert intervals(s, (0, 1), (0, 1), still=(True, False)) == [(1, 2, 6)]  # 4 m off at the first sample, the only one


def test_an_interval_of_two_samples_is_not_cut() -> None:
    """One of three is: over the point in its middle, the samples from 1 to 4 of 6 are in doubt."""
    assert intervals(points(np.arange(7.0), None, (3.0, 0.0)), (0, 1)) == [(0, 1, 4)]


def test_what_touches_and_does_not_move() -> None:
    s = points(np.array([4.0, 4.0, 4.0]), None, (4.0, 0.0), (4.0, 1.0))
    assert intervals(s, (0, 1), (0, 2), still=(True, True)) == [(0, 0, 0)]
    assert intervals(s, (0, 1), (0, 2)) == [(0, 0, 2)]


def test_intervals_that_do_not_meet_stay_apart() -> None:
    """It passes over the point at x = 4, turns round at 16, and passes over it again."""
    there_and_back = np.concatenate([np.arange(17.0), np.arange(15.0, -1, -1)])
    assert intervals(points(there_and_back, None, (4.0, 0.0)), (0, 1)) == [(0, 2, 6), (0, 26, 30)]


def test_both_may_move() -> None:
    """Two that keep a metre apart along y while both go 8 m along x: their ways count together."""
    x = np.arange(0.0, 9.0)
    one, other = transform(p=np.stack([x, 0 * x, 0 * x], -1)), transform(p=np.stack([x, 0 * x + 5, 0 * x], -1))
    gone = np.stack([x, x], -1)
    s = Sweep(x, np.stack([one, other], 1), np.zeros((0, 4, 4)), np.zeros((2, 3)), np.zeros((2, 3)), gone)
    assert intervals(s, (0, 1)) == []  # 10 m by the ends of half of the way, and 8 m gone
    assert intervals(s, (0, 1), apart_m=3.1) == [(0, 0, 8)]  # 1.9 m twice, and 4 m gone within two samples
    assert intervals(s, (0, 1), apart_m=2.9) == []
    assert np.array_equal(s.pose(3, 1), other[3])
    assert np.array_equal(s.poses(np.array([3, 2]), np.array([1, 0])), [other[3], one[2]])


def test_poses_of_what_stands() -> None:
    s = points(np.arange(3.0), None, (4.0, 0.0), (5.0, 1.0))
    assert np.array_equal(s.pose(2, 0), transform(p=[2.0, 0, 0]))
    assert np.array_equal(s.pose(2, 1), transform(p=[4.0, 0, 0]))
    assert np.array_equal(s.pose(2, 2), transform(p=[5.0, 1.0, 0]))
    assert np.array_equal(s.poses(np.array([2, 1, 0]), np.array([2, 0, 1])), [transform(p=p) for p in ([5, 1, 0], [1, 0, 0], [4, 0, 0])])
