"""Records in compiled code hold what they hold in Python, and their arrays are the same memory."""

from __future__ import annotations

import pickle
from copy import deepcopy
from typing import Any, NamedTuple

import numpy as np
import pytest

from kinematics.jit.decorators import jit_entry, jit_inline, njit
from kinematics.jit.record import record
from kinematics.transforms import Array


@record
class Leaf(NamedTuple):
    values: Array
    count: int
    share: float


@record
class Branch(NamedTuple):
    leaf: Leaf
    three: tuple[Leaf, Leaf, Leaf]
    table: Array


def leaf(k: int) -> Leaf:
    return Leaf(np.arange(3.0) + k, 10 * k, 0.5 + k)


@jit_inline
def _sum(x: Leaf) -> float:
    total = x.count * x.share
    for i in range(x.values.shape[0]):
        total += x.values[i]
    return total


@jit_entry
def _look(branch: Branch, out: Array) -> None:
    at = 0
    for x in branch.three:
        out[at] = _sum(x)
        at += 1
    out[at], out[at + 1], out[at + 2] = branch.leaf.values[2], branch.table.shape[1], branch.table[1, 0]
    branch.table[0, 1] = 7.0


def test_compiled_code_reads_all_fields_and_writes_to_the_arrays() -> None:
    branch, out = Branch(leaf(0), (leaf(1), leaf(2), leaf(3)), np.arange(8.0).reshape(2, 4)), np.zeros(6)
    _look(branch, out)
    sums = [float(10 * k * (0.5 + k) + np.sum(np.arange(3.0) + k)) for k in (1, 2, 3)]
    assert out.tolist() == [*sums, 2.0, 4.0, 4.0]
    assert branch.table[0, 1] == 7.0


def test_a_copy_has_a_table_of_its_own() -> None:
    branch, out = Branch(leaf(0), (leaf(1), leaf(2), leaf(3)), np.arange(8.0).reshape(2, 4)), np.zeros(6)
    _look(branch, out)
    for other in (deepcopy(branch), pickle.loads(pickle.dumps(branch))):
        other.table[1, 0], other.leaf.values[2] = 5.0, 6.0
        _look(other, out)
        assert out.tolist()[3:] == [6.0, 4.0, 5.0]
        assert branch.table[1, 0] == 4.0


def test_a_replaced_field_is_seen_and_the_old_record_stays() -> None:
    a, out = leaf(1), np.zeros(1)
    values: Any = njit()(lambda x, to: to.fill(_sum(x)))
    values(a, out)
    first = out[0]
    values(a._replace(count=0), out)
    assert out[0] == 6.0 != first
    values(a, out)
    assert out[0] == first


def test_read_only_arrays_are_the_same_type() -> None:
    frozen = np.frombuffer(np.arange(3.0).tobytes())
    values: Any = njit()(lambda x: _sum(x))
    assert values(leaf(0)) == values(Leaf(frozen, 0, 0.5)) == 3.0
    assert len(values.signatures) == 1


def test_arrays_must_be_contiguous() -> None:
    values: Any = njit()(lambda x: _sum(x))
    with pytest.raises(TypeError, match=r"Leaf\.values must be contiguous"):
        values(Leaf(np.arange(6.0)[::2], 1, 1.0))
