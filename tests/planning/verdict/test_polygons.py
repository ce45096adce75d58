"""Polygons against what sampling and linear programming say of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from planning.verdict.polygons import clip, contains, hull, least_width, nearest

SEEDS = st.integers(0, 10**6)


def cloud(seed: int, n: int = 12, at: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(n, 2)) + at


def area(polygon: np.ndarray) -> float:
    x, y = polygon.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


@given(SEEDS)
def test_hulls_are_those_of_qhull(seed: int) -> None:
    points = cloud(seed)
    ours, theirs = hull(points), ConvexHull(points)
    assert area(ours) == pytest.approx(theirs.volume)
    assert {tuple(p) for p in ours} == {tuple(points[i]) for i in theirs.vertices}


def test_hulls_of_points_in_line_have_no_area() -> None:
    assert least_width(hull(np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [0.5, 0.5]]))) == 0.0
    assert len(hull(np.zeros((1, 2)))) == 1


@given(SEEDS)
def test_hulls_of_rectangles_whose_sides_stand_but_for_rounding_are_whole(seed: int) -> None:
    """Points on upright sides, whose x differs in the last digits only: their order by x goes up and down the side."""
    rng = np.random.default_rng(seed)
    points = np.stack([rng.choice([-0.01275, 0.02999], 12), rng.uniform(-0.02, 0.11, 12)], -1)
    points = np.concatenate([points, [[-0.01275, -0.02], [-0.01275, 0.11], [0.02999, -0.02], [0.02999, 0.11]]])
    shaken = points + rng.integers(-2, 3, points.shape) * [4e-18, 0.0]
    assert area(hull(shaken)) == pytest.approx(0.04274 * 0.13, rel=1e-9)


@given(SEEDS)
def test_what_is_clipped_is_in_both(seed: int) -> None:
    a, b = hull(cloud(seed)), hull(cloud(seed + 1, at=(1.0, 0.5)))
    common, points = clip(a, b), cloud(seed + 2, 200)
    both = np.array([contains(a, p) and contains(b, p) for p in points])
    inside = np.array([len(common) > 2 and contains(hull(common), p) for p in points])
    assert np.array_equal(both, inside)


@given(SEEDS)
def test_the_nearest_points_are_the_nearest(seed: int) -> None:
    a, b = hull(cloud(seed)), hull(cloud(seed + 1, at=(float(seed % 7), 1.0)))
    p, q = nearest(a, b)
    n, m = len(a), len(b)
    # min t subject to |A'u - B'v| <= t in a polygonal norm bounds the distance from below and above within its accuracy
    angle = np.linspace(0, 2 * np.pi, 96, endpoint=False)
    rows = np.stack([np.cos(angle), np.sin(angle)], -1)
    block = np.c_[rows @ a.T, -rows @ b.T, -np.ones(len(rows))]
    sums = np.array([[1.0] * n + [0.0] * m + [0.0], [0.0] * n + [1.0] * m + [0.0]])
    found = linprog(np.r_[np.zeros(n + m), 1.0], A_ub=block, b_ub=np.zeros(len(rows)), A_eq=sums, b_eq=[1, 1])
    assert np.linalg.norm(p - q) == pytest.approx(found.fun, rel=2e-3, abs=1e-9)


@given(SEEDS)
def test_the_least_width_is_that_of_all_directions(seed: int) -> None:
    polygon = hull(cloud(seed))
    angle = np.linspace(0, np.pi, 20000, endpoint=False)
    widths = np.ptp(polygon @ np.stack([np.cos(angle), np.sin(angle)]), axis=0)
    assert least_width(polygon) == pytest.approx(widths.min(), rel=1e-3)


def test_a_corner_is_no_polygon_to_be_near_to() -> None:
    with pytest.raises(ValueError, match="without corners"):
        nearest(np.zeros((0, 2)), np.zeros((1, 2)))


# -------------------------------------------------------------------------------------------------------------------------------- by hand

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])


def corners(polygon: np.ndarray) -> set[tuple[float, ...]]:
    return {tuple(float(x) for x in p) for p in polygon}


def test_a_hull_runs_counter_clockwise_from_its_leftmost_corner() -> None:
    """Points in its sides, in it, and twice are left out; two points stay as they are."""
    points = np.array([[2, 2], [1, 0], [0, 2], [0, 0], [2, 0], [2, 2], [1, 1], [0, 1], [2, 1], [1, 2.0]])
    assert hull(points).tolist() == SQUARE.tolist()
    assert hull(points[:2]).tolist() == [[2, 2], [1, 0]]
    assert hull(np.array([[1, 3], [1, 1], [1, 2.0]])).tolist() == [[1, 1], [1, 3]]
    assert hull(np.array([[0, 0], [1, 2], [2, 0.0]])).tolist() == [[0, 0], [2, 0], [1, 2]]


def test_what_lies_in_a_square() -> None:
    assert corners(clip(SQUARE + 1.0, SQUARE)) == {(1, 1), (2, 1), (2, 2), (1, 2)}
    assert corners(clip(SQUARE, SQUARE)) == corners(SQUARE)
    assert len(clip(SQUARE + 3.0, SQUARE)) == 0
    assert clip(SQUARE + 3.0, SQUARE).shape == (0, 2)
    assert corners(clip(SQUARE + np.array([2.0, 0.0]), SQUARE)) == {(2, 0), (2, 2)}  # a side in common
    assert corners(clip(SQUARE + 2.0, SQUARE)) == {(2, 2)}
    assert corners(clip(np.array([[-1, 1], [3, 1.0]]), SQUARE)) == {(0, 1), (2, 1)}  # a line
    assert corners(clip(np.array([[1.0, 1.0]]), SQUARE)) == {(1, 1)}
    assert len(clip(np.array([[3.0, 1.0]]), SQUARE)) == 0
    assert corners(clip(np.array([[1, -1], [3, 1], [1, 3], [-1, 1.0]]), SQUARE)) == {(0, 0), (2, 0), (2, 2), (0, 2)}
    lozenge = np.round(clip(np.array([[1, -2], [2, 1], [1, 4], [0, 1.0]]), SQUARE), 6)  # it is 2 wide at y = 1, 4/3 at y = 0 and 2
    assert corners(lozenge) == {(0.333333, 0), (1.666667, 0), (2, 1), (1.666667, 2), (0.333333, 2), (0, 1)}


def test_what_a_polygon_contains() -> None:
    """Edges and corners, too, to a millionth of a millionth; what has no area contains nothing."""
    for point, inside in (
        ((1, 1), True),
        ((0, 1), True),
        ((2, 2), True),
        ((1, 0), True),
        ((2.1, 1), False),
        ((1, 2.1), False),
        ((-1e-9, 1), False),
    ):
        assert contains(SQUARE, np.array(point, float)) is inside
    for y, inside in ((-0.5e-12, True), (-0.6e-12, False)):
        assert contains(SQUARE, np.array([1.0, y])) is inside
    assert contains(SQUARE[:2], np.array([1.0, 0.0])) is False
    assert not contains(SQUARE[:0], np.array([1.0, 0.0]))
    assert contains(SQUARE[:3], np.array([1.5, 0.5]))
    assert not contains(SQUARE[:3], np.array([0.5, 1.5]))


def test_the_least_width_of_plain_figures() -> None:
    assert least_width(SQUARE * [3.0, 1.0]) == 2.0
    assert least_width(SQUARE * [0.5, 1.0]) == 1.0
    assert least_width(np.array([[0, 0], [3, 0], [0, 4.0]])) == pytest.approx(2.4)  # over the hypotenuse
    assert least_width(SQUARE[:2]) == 0.0
    assert least_width(np.array([[0, 0], [0, 0], [2, 0], [2, 1], [0, 1.0]])) == 1.0
    assert least_width(np.zeros((3, 2))) == 0.0
    assert least_width(np.array([[0, 0], [1e-12, 0], [2, 1], [0, 1.0]])) == pytest.approx(2 / np.sqrt(5))  # a triangle, nearly
    assert least_width(np.array([[0, 0], [1, 0], [0.5, 2.0]])) == pytest.approx(2 / np.hypot(0.5, 2))


def nearest_of(a: object, b: object) -> list[list[float]]:
    return [p.tolist() for p in nearest(np.array(a, float), np.array(b, float))]


def test_the_nearest_points_of_plain_figures() -> None:
    low = [[3, 1], [5, 0.5], [5, 1.5]]
    assert nearest_of(SQUARE, low) == [[2, 1], [3, 1]]
    assert nearest_of(low, SQUARE) == [[3, 1], [2, 1]]
    assert nearest_of([[0, 0]], [[3, 4]]) == [[0, 0], [3, 4]]
    assert nearest_of([[1, 5]], [[0, 0], [2, 0]]) == [[1, 5], [1, 0]]
    assert nearest_of([[0, 0], [2, 0]], [[1, 5]]) == [[1, 0], [1, 5]]
    assert nearest_of([[5, 5]], [[0, 0], [2, 0]]) == [[5, 5], [2, 0]]
    assert nearest_of([[-4, 1]], [[0, 0], [2, 0]]) == [[-4, 1], [0, 0]]
    assert nearest_of([[5, 0]], [[0, 0], [2, 0]]) == [[5, 0], [2, 0]]  # on the line, and beyond its end
    assert nearest_of([[1.5, 0.5]], SQUARE[:3]) == [[1.5, 0.5], [1.5, 0.5]]  # in a triangle
    assert nearest_of([[0.5e-6, 1]], [[0, 0], [1e-6, 0]])[1] == pytest.approx([0.5e-6, 0], abs=1e-9)
    assert nearest_of(SQUARE, SQUARE + 1.0) == [[1.5, 1.5], [1.5, 1.5]]  # the middle of what they share
    assert nearest_of([[1, 1]], SQUARE) == nearest_of(SQUARE, [[1, 1]]) == [[1, 1], [1, 1]]
    assert nearest_of([[1, 1], [1, 1.5]], SQUARE) == [[1, 1.25], [1, 1.25]]
    for a, b in (([[0, 0]], np.zeros((0, 2))), (np.zeros((0, 2)), [[0, 0]])):
        with pytest.raises(ValueError, match=r"^a polygon without corners is near to nothing$"):
            nearest_of(a, b)
