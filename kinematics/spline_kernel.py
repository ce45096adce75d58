"""The compiled part of quintic_spline.py: from rows to Bernstein coefficients, and from these to values."""

from __future__ import annotations

from kinematics.jit.decorators import copy_row, copy_rows, jit_entry
from kinematics.transforms import Array

_DEGREE = 5


@jit_entry
def hermite_control(t: Array, q: Array, qd: Array, qdd: Array, control: Array) -> bool:
    """Fill in the coefficients (K - 1, 6, J) between rows q, qd, qdd (K, J) at times t (K,). Returns whether the times rise."""
    for k in range(control.shape[0]):
        h = t[k + 1] - t[k]
        if not h > 0:
            return False
        for j in range(q.shape[1]):
            control[k, 0, j] = q[k, j]
            control[k, 1, j] = q[k, j] + h / 5 * qd[k, j]
            control[k, 2, j] = q[k, j] + 2 * h / 5 * qd[k, j] + h**2 / 20 * qdd[k, j]
            control[k, 3, j] = q[k + 1, j] - 2 * h / 5 * qd[k + 1, j] + h**2 / 20 * qdd[k + 1, j]
            control[k, 4, j] = q[k + 1, j] - h / 5 * qd[k + 1, j]
            control[k, 5, j] = q[k + 1, j]
    return True


@jit_entry
def evaluate_rows(rows: Array, control: Array, t: Array, order: int, work: Array, out: Array) -> None:
    """`quintic_spline.evaluate` at times t (N,) into out (N, J): differences, then de Casteljau's scheme. work (6, J): scratch.

    Each step is a + u (b - a), which leaves what is equal as it is.
    """
    K, J, piece = rows.shape[0], control.shape[2], 0
    for i in range(t.shape[0]):
        at = min(max(t[i], rows[0]), rows[K - 1])
        while piece > 0 and at < rows[piece]:
            piece -= 1
        while piece < K - 2 and at >= rows[piece + 1]:
            piece += 1
        h = rows[piece + 1] - rows[piece]
        u, n = (at - rows[piece]) / h, _DEGREE
        copy_rows(control[piece], work)
        for _ in range(order):
            for k in range(n):
                for j in range(J):
                    work[k, j] = n / h * (work[k + 1, j] - work[k, j])
            n -= 1
        while n > 0:
            for k in range(n):
                for j in range(J):
                    work[k, j] += u * (work[k + 1, j] - work[k, j])
            n -= 1
        copy_row(work[0], out[i])
