"""Records in compiled code hold what they hold in Python, and their arrays are the same memory."""

from __future__ import annotations

import pickle
from array import array
from copy import deepcopy
from typing import Any, NamedTuple, cast

import numpy as np
import pytest

from kinematics.jit.decorators import jit_entry, jit_inline, njit
from kinematics.jit.record import ROOM, _writer, record
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


@record
class Pair(NamedTuple):
    leaf: Leaf
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


@pytest.mark.parametrize(
    "fields",
    [
        (np.zeros((2, 3), np.float32), np.uint8(3), 0.25),
        (np.arange(6).reshape(1, 2, 3), -(2**62), np.float64(-0.5)),
        (np.zeros(0), np.int64(-1), np.inf),
    ],
    ids=["float32", "integers", "empty"],
)
def test_a_table_is_the_same_written_by_machine_code_and_in_python(fields: tuple[Any, ...]) -> None:
    made = Branch(Leaf(*fields), (leaf(1), leaf(2), leaf(3)), np.zeros((2, 4)))
    for one in (made.leaf, made, Pair(Leaf(*fields), made.table)):
        again, slowly = (cast(Any, type(one)(*one)) for _ in range(2))
        slowly._written()
        assert again.address == again.__dict__["table"].buffer_info()[0]
        assert again.type_hash == slowly.type_hash
        words = slowly.__dict__["table"]
        assert again.__dict__["table"][: len(words)] == words


@pytest.mark.skipif(_writer() is None, reason="records are written in Python here")
def test_machine_code_tells_kinds_apart_and_leaves_the_rest_to_python() -> None:
    write, table = cast(Any, _writer()), array("q", bytes(8 * ROOM))
    at = table.buffer_info()[0]
    kinds = [
        Leaf(np.zeros((2, 3)), 1, 1.0), Leaf(np.zeros(3), 1, 1.0), Leaf(np.zeros((2, 3), np.float32), 1, 1.0),
        Leaf(np.zeros((2, 3)), cast(Any, 1.0), 1.0), Leaf(np.zeros((2, 3)), 1, cast(Any, 1)),
    ]  # fmt: skip
    told = [write(one, at) for one in kinds]
    assert NotImplemented not in told
    assert len(set(told)) == len(kinds)
    assert write(Leaf(np.ones((2, 3)), 5, 7.0), at) == told[0]
    strange = [
        Leaf(np.zeros((3, 4))[:, 1:], 1, 1.0), Leaf(np.zeros(3), 2**63, 1.0), Leaf(np.zeros(3), 1, cast(Any, None)),
        Branch(leaf(0), (leaf(1), leaf(2), leaf(3)), np.zeros((2, 4))), Leaf(cast(Any, tuple(np.zeros(3))), 1, 1.0),
    ]  # fmt: skip
    assert [write(one, at) for one in strange] == [NotImplemented] * len(strange)
    with pytest.raises(TypeError, match="must be contiguous"):
        _ = cast(Any, strange[0]).address


@pytest.mark.skipif(_writer() is None, reason="records are written in Python here")
def test_a_table_that_is_too_long_is_left_to_python() -> None:
    many = record(NamedTuple("Many", [(f"f{i}", Array) for i in range(ROOM // 2 + 1)]))
    one = many(*(np.full(i, float(i)) for i in range(ROOM // 2 + 1)))
    table = array("q", bytes(8 * ROOM))
    assert cast(Any, _writer())(one, table.buffer_info()[0]) is NotImplemented
    assert one.address == one.table.buffer_info()[0]
    assert len(one.table) == 2 * len(one) + 1
