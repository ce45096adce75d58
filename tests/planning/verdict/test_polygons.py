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
