"""Lenses that bend straight lines: which pixel of a recorded image shows what a pixel of a pinhole camera's would.

A ray x, y (z = 1) meets the image where the distorted ray does: radial k1, k2, k3 over k4, k5, k6, tangential p1, p2, thin prism s1 to s4,
in OpenCV's order k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 (Brown 1966, and OpenCV's documentation). Depth is z, and stays so: a pixel
only moves. It is taken from the nearest pixel and never averaged, as the mean of two sides of an edge is in the air.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from kinematics.transforms import Array
from perception.camera import Intrinsics

COUNTS = (0, 4, 5, 8, 12, 14)
"""So many coefficients OpenCV's models have."""
STEPS = 2000  # radii at which the radial part is looked at


def has_effect(coefficients: Sequence[float]) -> bool:
    """Whether any coefficient is other than 0."""
    return any(c != 0 for c in coefficients)


def distorted(x: Array, y: Array, coefficients: Sequence[float]) -> tuple[Array, Array]:
    """Where rays x, y (...), z = 1, meet the image plane z = 1 behind a lens of these coefficients."""
    _, _, p1, p2, *_, s1, s2, s3, s4 = _twelve(coefficients)
    r2 = x * x + y * y
    radial = _radial(r2, coefficients)
    along, across = 2 * x * y, r2 + 2 * x * x
    down = r2 + 2 * y * y
    return (
        x * radial + p1 * along + p2 * across + r2 * (s1 + r2 * s2),
        y * radial + p1 * down + p2 * along + r2 * (s3 + r2 * s4),
    )


@lru_cache(maxsize=2)
def recorded_pixels(camera: Intrinsics, coefficients: tuple[float, ...]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Row and column (H, W) of the recorded image that shows what a pixel of the pinhole's does; −1 where none does.

    A polynomial that was fitted to the image's middle may turn back further out, where another ray has the same pixel already: none.
    """
    x, y = np.meshgrid((np.arange(camera.width) - camera.cx) / camera.fx, (np.arange(camera.height) - camera.cy) / camera.fy)
    a, b = distorted(x, y, coefficients)
    u, v = np.rint(a * camera.fx + camera.cx), np.rint(b * camera.fy + camera.cy)
    there = np.hypot(x, y) < _turning_back(float(np.hypot(x, y).max()), coefficients)
    there &= (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
    return np.where(there, v, -1).astype(np.int64), np.where(there, u, -1).astype(np.int64)


def pinhole_pixel(camera: Intrinsics, coefficients: tuple[float, ...], u: int, v: int) -> tuple[int, int]:
    """The pinhole image's column and row that show what the recorded image's do, or the nearest that there is."""
    rows, columns = recorded_pixels(camera, coefficients)
    off = np.where(rows >= 0, np.hypot(rows - v, columns - u), np.inf)
    row, column = divmod(int(np.argmin(off)), camera.width)
    return column, row


def _twelve(coefficients: Sequence[float]) -> Array:
    return np.append(np.asarray(coefficients, float)[:12], np.zeros(12))[:12]


def _radial(r2: Array, coefficients: Sequence[float]) -> Array:
    """How many times further from the middle rays of a radius's square r2 (...) meet the image, by the radial part alone."""
    k1, k2, _, _, k3, k4, k5, k6, *_ = _twelve(coefficients)
    return np.asarray((1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6))))


def _turning_back(most: float, coefficients: Sequence[float]) -> float:
    """The radius, at z = 1, from which on the radial part leads inwards again; infinite when it does not before `most`."""
    r = np.linspace(0.0, 1.01 * most, STEPS)
    back = np.flatnonzero(np.diff(r * _radial(r * r, coefficients)) <= 0)
    return float(r[back[0]]) if len(back) else np.inf
