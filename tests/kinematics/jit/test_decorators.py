"""Functions are compiled once, and get machine code where Python calls them."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest

from kinematics.jit.decorators import PLAIN, jit_entry, jit_inline
from kinematics.transforms import Array

pytestmark = pytest.mark.skipif(PLAIN is not None, reason="functions are compiled plainly")


@jit_inline
def _nth(x: Array, n: int) -> float:
    return float(x[n])


@jit_entry
def _twice(x: Array, n: int) -> float:
    return 2.0 * _nth(x, n)


@jit_entry
def _all(x: Array) -> float:
    n, total = 0, _twice(x, 0) + _nth(x, 1)
    while n < x.shape[0]:
        total += _twice(x, n)
        n += 1
    return total


def test_a_number_that_is_written_out_costs_no_second_compilation() -> None:
    x = np.arange(1.0, 5.0)
    assert _all(x) == 2 * x.sum() + 2 * x[0] + x[1]
    assert len(cast(Any, _nth).overloads) <= 1  # none when `_all` comes from the cache


def test_machine_code_is_made_when_python_calls() -> None:
    x = np.arange(1.0, 5.0)
    _all(x)
    assert len(cast(Any, _twice).overloads) == 0, "compiled code has a part of its own"
    assert _twice(x, 2) == 6.0
    assert len(cast(Any, _twice).overloads) == 1
    assert _all(x) == 24.0  # 20 + 2 + 2
