"""Quintic Hermite splines: between two rows a polynomial of degree five that meets position, velocity and acceleration at both ends.

Pieces are kept in Bernstein form. A polynomial lies within the hull of its Bernstein coefficients, so its extremes are bounded at once, and
found to any accuracy by cutting the interval in halves (de Casteljau). Source: Farin, Curves and Surfaces for CAGD, chapters 5 and 7.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinematics.array_checks import checked
from kinematics.transforms import Array

DEGREE = 5
_HALVINGS = 24  # each divides the distance between a polynomial and its coefficients by four


@dataclass(frozen=True, eq=False)
class QuinticSpline:
    """t_s (K,): rising times of the rows, in s; control (K - 1, 6, J): Bernstein coefficients of each piece, in rad or m."""

    t_s: Array
    control: Array


def hermite(t_s: Array, q: Array, qd: Array, qdd: Array) -> QuinticSpline:
    """The spline through rows q (K, J) with velocities qd (K, J) and accelerations qdd (K, J) at times t_s (K,).

    Raises: ValueError when the shapes differ, K < 1, or the times do not rise.
    """
    t, q, qd, qdd = (np.ascontiguousarray(a, float) for a in (t_s, q, qd, qdd))
    if q.ndim != 2 or not len(q) or t.shape != (len(q),) or qd.shape != q.shape or qdd.shape != q.shape:
        raise ValueError(f"t_s {t.shape}, q {q.shape}, qd {qd.shape}, qdd {qdd.shape}: (K,) and three times (K, J) are needed")
    from kinematics.spline_kernel import hermite_control  # here, for who only reads plans needs no compiled code

    control = np.empty((len(q) - 1, DEGREE + 1, q.shape[1]))
    if not hermite_control(t, q, qd, qdd, control):
        raise ValueError("t_s: the times of a spline's rows must rise")
    return QuinticSpline(t, control)


def coefficients(spline: QuinticSpline, order: int = 0) -> Array:
    """Bernstein coefficients (K - 1, 6 - order, J) of a derivative of the pieces with respect to time."""
    h, out = np.diff(spline.t_s)[:, None, None], spline.control
    for n in range(order):
        out = (DEGREE - n) / h * np.diff(out, axis=1)
    return out


def evaluate(spline: QuinticSpline, t_s: Array, order: int = 0) -> Array:
    """Position (order 0), velocity (1) or acceleration (2) at times t_s (N,): (N, J). Times outside the spline are moved to its ends.

    A joint that rests in a piece of the spline has the very same position all along it: rounding moves nothing.
    Raises: ValueError when the spline has one row only, or for another order.
    """
    if len(spline.t_s) < 2:
        raise ValueError("a spline of one row has no pieces to evaluate")
    if not 0 <= order < DEGREE:
        raise ValueError(f"a spline has derivatives of order 0 to {DEGREE - 1}, not {order}")
    from kinematics.spline_kernel import evaluate_rows

    t, J = checked("t_s", t_s, -1, finite=False), spline.control.shape[2]
    out = np.empty((len(t), J))
    evaluate_rows(spline.t_s, spline.control, t, order, np.empty((DEGREE + 1, J)), out)
    return out


def extremes(spline: QuinticSpline, order: int = 0, tolerance: float = 1e-9) -> tuple[Array, Array]:
    """The least and the greatest value (K - 1, J) of each piece, or of a derivative of it.

    tolerance: the low ones are at most so much too low, the high ones so much too high, relative to the largest coefficient.
    """
    control = coefficients(spline, order)
    pieces, n, joints = control.shape
    rows = np.swapaxes(control, 1, 2).reshape(-1, n)
    slack = tolerance * max(1.0, float(np.abs(rows).max(initial=0.0)))
    high, low = _greatest(rows, slack), -_greatest(-rows, slack)
    return low.reshape(pieces, joints), high.reshape(pieces, joints)


def _greatest(rows: Array, slack: float) -> Array:
    """An upper bound (S,), at most `slack` too high, of the polynomials with Bernstein coefficients rows (S, n) on their intervals."""
    reached = np.maximum(rows[:, 0], rows[:, -1])  # the values at the ends
    owner, halves = np.arange(len(rows)), rows
    for _ in range(_HALVINGS):
        left = halves.max(1) > reached[owner] + slack
        if not left.any():
            return reached + slack
        halves, owner = np.concatenate(_cut(halves[left])), np.tile(owner[left], 2)
        np.maximum.at(reached, owner, np.maximum(halves[:, 0], halves[:, -1]))
    bound = reached + slack
    np.maximum.at(bound, owner, halves.max(1))
    return bound


def _cut(rows: Array) -> tuple[Array, Array]:
    """The Bernstein coefficients of both halves."""
    left, right, middle = [rows[:, 0]], [rows[:, -1]], rows
    while middle.shape[1] > 1:
        middle = (middle[:, :-1] + middle[:, 1:]) / 2
        left.append(middle[:, 0])
        right.append(middle[:, -1])
    return np.stack(left, 1), np.stack(right[::-1], 1)
