"""Functions are compiled once, and get machine code where Python calls them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from kinematics.jit.decorators import PLAIN, jit_entry, jit_inline
from kinematics.jit.record import record
from kinematics.transforms import Array

ROOT = Path(__file__).resolve().parents[3]

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
    assert len(cast(Any, _twice).calls) == 0, "it is a part of the compiled code that calls it"
    assert _twice(x, 2) == 6.0
    assert len(cast(Any, _twice).calls) == 1
    assert _all(x) == 24.0  # 20 + 2 + 2


@jit_entry
def _mixed(x: Array, k: int, share: float, wanted: bool, twice: int = 2) -> tuple[float, int, bool]:
    x[k] = twice * share
    return float(x[k]) + x.shape[0], k * twice, wanted


def test_arguments_of_every_kind_go_in_and_come_out() -> None:
    """Also numpy's numbers, defaults, keywords, rows with gaps between, and arrays of another dtype, which get code of their own."""
    for wanted in (True, False, np.bool_(True)):
        x = np.zeros(4)
        assert _mixed(x, 1, 0.5, wanted) == (5.0, 2, bool(wanted))
        assert x.tolist() == [0.0, 1.0, 0.0, 0.0]
    assert _mixed(np.zeros(3), np.int64(2), np.float64(1.5), True, twice=4) == (9.0, 8, True)
    table = np.zeros((4, 3))
    assert _mixed(table[:, 1], 3, 2.0, False) == (8.0, 6, False)
    assert table[3].tolist() == [0.0, 4.0, 0.0]
    small = np.zeros(2, np.float32)
    assert _mixed(small, 0, 0.5, True)[0] == 3.0
    assert small.tolist() == [1.0, 0.0]
    answer = _mixed(np.zeros(1), 0, 1.0, True)
    assert [type(a) for a in answer] == [float, int, bool]


def test_what_machine_code_does_not_take_is_no_crash() -> None:
    """It answers NotImplemented: to another number of arguments, to other types, other dimensions, and numbers that don't fit."""
    x = np.zeros(4)
    _mixed(x, 1, 0.5, True)
    call = cast(Any, _mixed).calls[0]
    assert call(x, 1, 0.5, True, 2) == (5.0, 2, True)
    swapped = x.astype(x.dtype.newbyteorder())
    unaligned = np.frombuffer(bytes(33), np.uint8)[1:].view(np.float64)
    wrong = (None, 1, "x", [0.0], object(), x[None], swapped, unaligned, x.astype(np.int64), x.view(_Sub))
    for args in [(), (x, 1, 0.5, True), *((w, 1, 0.5, True, 2) for w in wrong), (x, 2**63, 0.5, True, 2), (x, 1.0, 0.5, True, 2)]:
        assert call(*args) is NotImplemented
    for args in [(x, None, 0.5, True, 2), (x, 1, 1, True, 2), (x, 1, None, True, 2), (x, 1, 0.5, 1, 2), (x, 1, 0.5, None, 2)]:
        assert call(*args) is NotImplemented
    assert not np.any(x[[0, 2, 3]])


class _Sub(np.ndarray):
    """An array of another type."""


def test_a_record_of_other_fields_is_another_kind() -> None:
    a, b = _Pair(np.arange(3.0), 1), _Pair(np.arange(3), 1)
    assert (_sum(a), _sum(b)) == (4.0, 4.0)
    first, second = cast(Any, _sum).calls
    assert first(b) is NotImplemented
    assert second(a) is NotImplemented
    assert first(cast(Any, object)()) is NotImplemented
    assert first(_Address(12)) is NotImplemented


class _Address:
    """Something else that has an address."""

    def __init__(self, address: int) -> None:
        self.address = address


@record
class _Pair(NamedTuple):
    values: NDArray[Any]
    count: int


@jit_entry
def _sum(pair: _Pair) -> float:
    total = 0.0 + pair.count
    for i in range(pair.values.shape[0]):
        total += pair.values[i]
    return total


def test_references_are_neither_lost_nor_kept() -> None:
    x, pair = np.zeros(4), _Pair(np.arange(3.0), 1)
    _mixed(x, 1, 0.5, True), _sum(pair)
    before = [sys.getrefcount(thing) for thing in (x, x.dtype, pair, True, None, NotImplemented)]
    for _ in range(1000):
        _mixed(x, 1, 0.5, True), _sum(pair), cast(Any, _sum).calls[0](x)
    after = [sys.getrefcount(thing) for thing in (x, x.dtype, pair, True, None, NotImplemented)]
    assert max(abs(b - a) for a, b in zip(before, after)) < 100


@jit_entry
def _every(x: Array, step: int) -> float:
    total = 0.0
    for i in range(0, x.shape[0], step):
        total += x[i]
    return total


def test_an_exception_in_compiled_code_is_numbas_own() -> None:
    """It has to be understood by whoever has made it: so numba calls the function once more, by its own way in."""
    assert _every(np.ones(5), 2) == 3.0
    with pytest.raises(ValueError, match="range"):
        _every(np.ones(5), 0)


PROGRAM = """
import os, sys
import numpy as np
from kinematics.jit import support
from kinematics.jit.decorators import jit_entry, jit_inline

support.METHODS += ("get_overlord",) if "MISSING" in os.environ else ()

@jit_inline
def nth(x, k):
    return x[k]

@jit_entry
def twice(x, k):
    return 2.0 * nth(x, k)

print(twice(np.arange(4.0), 3), "numba" in sys.modules)
"""


def test_the_next_process_calls_it_without_numba(tmp_path: Path) -> None:
    """Also when the file was damaged meanwhile: then it is compiled again."""
    (tmp_path / "program.py").write_text(PROGRAM)
    env = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"} | {"PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(tmp_path)}

    def run() -> str:
        return subprocess.run(
            [sys.executable, "program.py"], cwd=tmp_path, env=env, capture_output=True, text=True, check=True
        ).stdout.strip()

    assert [run(), run()] == ["6.0 True", "6.0 False"]
    (file,) = (tmp_path / "retrieve").rglob("*.code")
    whole = file.read_bytes()
    for damaged in (whole[:100], whole[:-40] + bytes(40), b""):
        file.write_bytes(damaged)
        assert [run(), run()] == ["6.0 True", "6.0 False"]
    assert file.read_bytes() == whole, "the same code"
