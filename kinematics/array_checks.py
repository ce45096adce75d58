"""Checks of arrays before compiled code gets them, which reads and writes where it is told: shapes, finite numbers, indices.

Once for each call from Python, never in an inner loop: a check takes some microseconds.
"""

from __future__ import annotations

from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def checked(name: str, value: Any, *shape: int, finite: bool = True) -> Array:
    """An array of floats, contiguous, of a shape in which -1 stands for any number. Raises: ValueError for any other, and for NaN and
    infinity when it is to be finite."""
    try:
        array = np.ascontiguousarray(value, np.float64)
    except (TypeError, ValueError, OverflowError) as e:
        raise ValueError(f"{name} is no array of numbers: {e}") from e
    if array.shape != shape and (array.ndim != len(shape) or any(n not in (-1, m) for n, m in zip(shape, array.shape))):
        wanted = ", ".join("any" if n < 0 else str(n) for n in shape)
        raise ValueError(f"{name} {np.shape(value)} must be ({wanted})")
    if finite and not (isfinite((flat := array.ravel()).dot(flat)) or np.isfinite(array).all()):  # the first is faster, and may overflow
        raise ValueError(f"{name} holds what is no finite number")
    return array


def indices(name: str, value: Any, count: int) -> NDArray[np.int64]:
    """Whole numbers from 0 to below count, of any shape. Raises: ValueError for any other."""
    given = np.asarray(value)
    if given.size and given.dtype.kind not in "iu":
        raise ValueError(f"{name} are no whole numbers, but {given.dtype}")
    array = np.ascontiguousarray(given, np.int64)
    if array.size and not (array.min() >= 0 and array.max() < count):
        raise ValueError(f"{name} run from {array.min()} to {array.max()}, and there are {count}")
    return array
