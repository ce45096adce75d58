"""The spline meets its rows, its derivatives are the slopes of what is below them, and its extremes are those of dense samples."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinematics.quintic_spline import evaluate, extremes, hermite


def random_rows(seed: int, rows: int = 5, joints: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.05, 0.8, rows))
    return t, rng.normal(size=(rows, joints)), rng.normal(size=(rows, joints)), 5 * rng.normal(size=(rows, joints))


@given(st.integers(0, 10**6))
def test_it_meets_every_row_and_its_derivatives(seed: int) -> None:
    t, q, qd, qdd = random_rows(seed)
    spline = hermite(t, q, qd, qdd)
    for order, rows in enumerate((q, qd, qdd)):
        assert np.allclose(evaluate(spline, t, order), rows, atol=1e-9)


@given(st.integers(0, 10**6))
def test_a_joint_that_rests_has_the_very_same_position_everywhere(seed: int) -> None:
    """Whoever looks for joints that move looks for any difference, and rounding must not be one."""
    t, q, qd, qdd = random_rows(seed)
    q[:, 1], qd[:, 1], qdd[:, 1] = q[0, 1], 0.0, 0.0
    at = np.random.default_rng(seed).uniform(t[0], t[-1], 50)
    assert (evaluate(hermite(t, q, qd, qdd), at)[:, 1] == q[0, 1]).all()


@given(st.integers(0, 10**6))
def test_derivatives_are_slopes(seed: int) -> None:
    t, q, qd, qdd = random_rows(seed)
    spline = hermite(t, q, qd, qdd)
    at, h = np.random.default_rng(seed).uniform(t[0] + 1e-3, t[-1] - 1e-3, 20), 1e-6
    away = np.abs(at[:, None] - t).min(1) > 2 * h  # the third derivative jumps at the rows
    for order in (0, 1):
        slope = (evaluate(spline, at + h, order) - evaluate(spline, at - h, order)) / (2 * h)
        assert np.allclose(slope[away], evaluate(spline, at, order + 1)[away], rtol=1e-4, atol=1e-4)


@given(st.integers(0, 10**6), st.sampled_from([0, 1, 2]))
def test_extremes_are_those_of_dense_samples(seed: int, order: int) -> None:
    t, q, qd, qdd = random_rows(seed, rows=3)
    spline = hermite(t, q, qd, qdd)
    low, high = extremes(spline, order)
    for piece in range(2):
        at = np.linspace(t[piece], t[piece + 1], 4001)
        at[-1] = np.nextafter(t[piece + 1], t[piece])
        values = evaluate(spline, at, order)
        scale = max(1.0, float(np.abs(values).max()))
        assert (values.max(0) <= high[piece] + 1e-12 * scale).all()
        assert (values.min(0) >= low[piece] - 1e-12 * scale).all()
        assert np.allclose(values.max(0), high[piece], atol=1e-4 * scale)
        assert np.allclose(values.min(0), low[piece], atol=1e-4 * scale)


def test_a_straight_move_from_rest_to_rest() -> None:
    """The minimum-jerk profile: it never turns back, and is fastest in the middle, at 15/8 of the mean speed."""
    zero = np.zeros((2, 1))
    spline = hermite(np.array([0.0, 2.0]), np.array([[0.0], [1.0]]), zero, zero)
    low, high = extremes(spline, 1)
    assert low[0, 0] == pytest.approx(0.0, abs=1e-8)
    assert high[0, 0] == pytest.approx(15 / 16)
    assert evaluate(spline, np.array([1.0]))[0, 0] == pytest.approx(0.5)
    assert extremes(spline, 2)[1][0, 0] == pytest.approx(10 / np.sqrt(3) / 4)  # acceleration peaks at 10/√3 · way / time²


def test_times_outside_are_moved_to_the_ends() -> None:
    spline = hermite(*random_rows(4))
    assert np.array_equal(evaluate(spline, np.array([-9.0, 99.0])), evaluate(spline, spline.t_s[[0, -1]]))


@pytest.mark.parametrize(
    ("t", "rows"), [([0.0, 0.0], (2, 1)), ([1.0, 0.5], (2, 1)), ([0.0, 1.0], (3, 1)), ([0.0], (0, 1)), ([0.0, np.nan], (2, 1))], ids=str
)
def test_rows_that_make_no_spline_are_refused(t: list[float], rows: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match=r"t_s|needed"):
        hermite(np.array(t), *(np.zeros(rows) for _ in range(3)))


def test_one_row_has_nothing_to_evaluate() -> None:
    spline = hermite(np.zeros(1), np.ones((1, 2)), np.zeros((1, 2)), np.zeros((1, 2)))
    assert extremes(spline)[0].shape == (0, 2)
    with pytest.raises(ValueError, match="one row"):
        evaluate(spline, np.zeros(1))
