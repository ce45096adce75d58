"""Speed profiles, rounded corners and straight lines in one piece: limits hold, nothing is slower than it must be, curves stay near."""

from __future__ import annotations

import numpy as np
import pytest
import ruckig
from scipy.interpolate import CubicSpline

from kinematics.quintic_spline import evaluate, extremes, hermite
from planning.motion.smoothing.blending import choose_speeds, make_corners, write_corner, write_rows
from planning.motion.smoothing.spline_rows import chords, keep_limits, slow_down
from planning.motion.smoothing.straight_line import write_line
from planning.motion.trajectory import MOST_USED

V, A, J = np.array([3.0, 2.0, 1.0]), np.array([9.0, 5.0, 4.0]), np.array([60.0, 40.0, 20.0])
WEIGHT = np.array([1.0, 0.7, 0.3])


def rounded(q: np.ndarray, allowed: float = np.inf) -> tuple[np.ndarray, np.ndarray]:
    """Times (R,) and rows (R, 3, A) of a polyline whose corners may be left by so much."""
    corners = make_corners(q, V, A, J, WEIGHT)
    corners.allowed[:] = allowed
    total = choose_speeds(corners)
    t, rows = np.empty(10 * len(q)), np.empty((10 * len(q), 3, q.shape[1]))
    n = write_rows(corners, t, rows)
    assert t[n - 1] == pytest.approx(total, abs=1e-3)
    keep_limits(V, A, J, MOST_USED, n, t, rows)
    return t[:n], rows[:n]


def shares(t: np.ndarray, rows: np.ndarray) -> list[float]:
    """The largest shares of the limits of velocity, acceleration and jerk."""
    spline = hermite(t, rows[:, 0], rows[:, 1], rows[:, 2])
    return [float((np.abs(np.stack(extremes(spline, order))) / limit).max()) for order, limit in enumerate((V, A, J), 1)]


def polylines(n: int, corners: int) -> list[np.ndarray]:
    rng = np.random.default_rng(corners)
    return [np.cumsum(rng.normal(size=(corners + 2, 3)) * rng.uniform(0.01, 1.5), axis=0) for _ in range(n)]


def test_a_straight_move_takes_as_long_as_ruckig_needs() -> None:
    for q in polylines(40, 0):
        t, rows = rounded(q)
        d = q[1] - q[0]
        share = float((np.abs(d) / V).max())
        move, profile = ruckig.InputParameter(1), ruckig.Trajectory(1)
        move.current_position, move.target_position, move.max_velocity = [0.0], [share], [1.0]
        move.max_acceleration, move.max_jerk = ([float((limit * share / np.abs(d)).min())] for limit in (A, J))
        assert ruckig.Ruckig(1).calculate(move, profile) >= 0
        assert t[-1] == pytest.approx(profile.duration, rel=2e-3)
        line = evaluate(hermite(t, rows[:, 0], rows[:, 1], rows[:, 2]), np.linspace(0, t[-1], 200)) - q[0]
        assert np.abs(line - np.outer(line @ d / (d @ d), d)).max() < 1e-9


@pytest.mark.parametrize("corners", [1, 2, 5])
def test_rounded_polylines_keep_all_limits_and_meet_both_ends_at_rest(corners: int) -> None:
    for q in polylines(30, corners):
        t, rows = rounded(q)
        assert (np.diff(t) > 0).all()
        assert max(shares(t, rows)) <= 1
        assert np.array_equal(rows[[0, -1], 0], q[[0, -1]])
        assert not rows[[0, -1], 1:].any()


def test_rounding_saves_time_and_the_more_it_may_stray_the_more() -> None:
    for q in polylines(20, 3):
        stopping, little, free = (rounded(q, allowed)[0][-1] for allowed in (0.0, 0.01, np.inf))
        assert free <= little + 1e-3
        assert little <= stopping + 1e-3
    total = sum(rounded(q)[0][-1] for q in polylines(20, 3))
    assert total < 0.95 * sum(rounded(q, 0.0)[0][-1] for q in polylines(20, 3))


def test_a_corner_stays_in_its_triangle_and_within_what_is_allowed() -> None:
    for q in polylines(40, 1):
        corners = make_corners(q, V, A, J, WEIGHT)
        corners.allowed[:] = 0.05
        choose_speeds(corners)
        assert corners.strays[1] <= 0.05
        t, rows = np.empty(9), np.empty((9, 3, 3))
        n = write_corner(corners, 1, t, rows)
        if n < 2:
            continue
        curve = evaluate(hermite(t[:n], *np.moveaxis(rows[:n], 1, 0)), np.linspace(0, t[n - 1], 50))
        first, last = rows[0, 0] - q[1], rows[n - 1, 0] - q[1]
        share, *_ = np.linalg.lstsq(np.stack([first, last], 1), (curve - q[1]).T, rcond=None)
        assert np.abs(np.stack([first, last], 1) @ share - (curve - q[1]).T).max() < 1e-9
        assert share.min() > -1e-9
        assert share.sum(0).max() < 1 + 1e-9
        assert (np.abs(curve - q[1]) @ WEIGHT).min() <= 0.05


def test_two_switches_that_nearly_coincide_leave_no_rows_too_close_to_tell_apart() -> None:
    for scale in np.geomspace(1e-4, 3, 60):
        t, rows = rounded(np.array([[0.0, 0.0, 0.0], [scale, 0.3 * scale, 0.0], [scale, scale, 0.1]]))
        assert np.diff(t).min() > 1.5e-4 or len(t) <= 4
        assert max(shares(t, rows)) <= 1


@pytest.mark.parametrize("n", [3, 4, 5, 9])
def test_a_line_follows_the_spline_through_its_waypoints_within_limits(n: int) -> None:
    rng = np.random.default_rng(n)
    for length in (0.03, 0.08, 0.3):
        s = np.linspace(0, 1, n)[:, None]
        q = rng.normal(size=3) + length * (4 * s * rng.normal(size=3) + s**2 * rng.normal(size=3) + 0.5 * np.sin(2 * s))
        t, rows = np.empty(600), np.empty((600, 3, 3))
        count = write_line(q, length, 0.5, V, A, J, np.empty_like(q), np.empty(n), np.empty((4, 3)), t, rows)
        t, rows = t[:count], rows[:count]
        keep_limits(V, A, J, MOST_USED, count, t, rows)
        assert max(shares(t, rows)) <= 1
        assert max(shares(t, rows)) > 0.9 or length / t[-1] > 0.2
        assert np.array_equal(rows[[0, -1], 0], q[[0, -1]])
        assert not rows[[0, -1], 1:].any()
        curve = evaluate(hermite(t, *np.moveaxis(rows, 1, 0)), np.linspace(0, t[-1], 300))
        spline = CubicSpline(np.linspace(0, 1, n), q, bc_type="not-a-knot")(np.linspace(0, 1, 20001))
        assert np.abs(curve[:, None] - spline[None, ::1]).max(2).min(1).max() < 1e-4


def test_chords_enclose_the_curve() -> None:
    for q in polylines(15, 2):
        t, rows = rounded(q)
        points = np.empty((500, 3))
        n = chords(t, rows, len(t), WEIGHT, 1e-3, np.empty((2, 3, 3)), points)
        assert n > 0
        assert np.array_equal(points[[0, n - 1]], q[[0, -1]])
        curve = evaluate(hermite(t, *np.moveaxis(rows, 1, 0)), np.linspace(0, t[-1], 400))
        share = np.linspace(0, 1, 60)[:, None, None]
        along = points[: n - 1] + share * np.diff(points[:n], axis=0)
        off = (np.abs(curve[:, None, None] - along) @ WEIGHT).min((1, 2))
        step = (np.abs(np.diff(points[:n], axis=0)) @ WEIGHT).max() / 59
        assert off.max() <= 1e-3 + step
    assert chords(t, rows, len(t), WEIGHT, 1e-12, np.empty((2, 3, 3)), points) == 0


def test_slower_is_the_same_curve() -> None:
    t, rows = rounded(polylines(1, 3)[0])
    slow_t, slow_rows = t.copy(), rows.copy()
    slow_down(4.0, len(t), slow_t, slow_rows)
    at = np.linspace(0, t[-1], 100)
    fast, slow = (hermite(x, *np.moveaxis(r, 1, 0)) for x, r in ((t, rows), (slow_t, slow_rows)))
    assert np.abs(evaluate(fast, at) - evaluate(slow, 4 * at)).max() < 1e-9
    assert np.allclose(evaluate(fast, at, 2), 16 * evaluate(slow, 4 * at, 2), atol=1e-6)
