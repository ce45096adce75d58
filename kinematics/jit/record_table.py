"""Writes the table of a record (`kinematics.jit.record`) in a microsecond or two, by machine code that walks over its fields: Python takes
as long for each of the eighty arrays of a motion query.

The machine code reads arrays and tuples by CPython's and numpy's ABI (`numpy_abi`) and is kept like that of entries. Where it is not to be
had, and for fields that it does not know, `Record.address` does the same in Python.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]

from kinematics.jit import machine_code, numpy_abi
from kinematics.jit.builtin import INT, OBJECT, WORD, Builtin
from kinematics.jit.record import ROOM, Write
from kinematics.jit.support import PLAIN

SYMBOL = f"{__name__}.write"
_ODD = 0x9E3779B97F4A7C15  # spreads what is different over all of a word (Knuth's multiplicative hashing)
_FLOAT, _INTEGER = 1, 2


def writer() -> Write | None:
    """A function that writes the words of a record's fields behind the first word of a table of `ROOM` words, given the record and the
    table's address, and answers with a number that tells apart the types of all fields; NotImplemented for a field of another type than
    array, number or record, or one that is not contiguous. None where there is no such machine code."""
    if PLAIN or not numpy_abi.layout_known():
        return None
    found = machine_code.load(SYMBOL)
    if found is None:
        from kinematics.jit.shipped import emit_module

        code = machine_code.Code(SYMBOL, [], [], emit_module(str(_Writer().module)))
        machine_code.store(code)
        found = machine_code.activate(code)
    return found


class _Writer(Builtin):
    """Builds it."""

    def __init__(self) -> None:
        super().__init__(ir.Module(SYMBOL), SYMBOL, 2)
        b, record = self.b, self.argument(0)
        self.words = b.bitcast(self.call("PyLong_AsVoidPtr", self.argument(1)), WORD.as_pointer())
        self.used, self.kind = (self._variable(1) for _ in range(2))
        self._for_each(self.field(record, numpy_abi.SIZE, WORD), lambda i: self._field(self._item(record, i)))
        b.ret(self.call("PyLong_FromLongLong", b.load(self.kind)))
        self.finish()

    def _item(self, record: Any, i: Any) -> Any:
        items = self.b.bitcast(self.b.gep(record, [ir.Constant(WORD, numpy_abi.ITEMS)]), OBJECT.as_pointer())
        return self.b.load(self.b.gep(items, [i]))

    def _field(self, thing: Any) -> None:
        b = self.b
        with b.if_else(self.is_one(thing, "ndarray")) as (array, other):
            with array:
                self._array(thing)
            with other, b.if_else(self.is_one(thing, "float", "float64")) as (number, rest):
                with number:
                    self._tell(ir.Constant(WORD, _FLOAT))
                    self._write(b.bitcast(self.call("PyFloat_AsDouble", thing), WORD))
                with rest, b.if_else(self.is_one(thing, "int", "int64")) as (whole, record):
                    with whole:
                        self._tell(ir.Constant(WORD, _INTEGER))
                        self._write(self.whole(thing))
                    with record:
                        table = self.table_of(thing)
                        self._tell(b.load(table))
                        self._write(b.ptrtoint(table, WORD))

    def _array(self, array: Any) -> None:
        b, contiguous = self.b, ir.Constant(INT, numpy_abi.CONTIGUOUS)
        self.need(b.icmp_signed("==", b.and_(self.field(array, numpy_abi.FLAGS, INT), contiguous), contiguous))
        dimensions = b.zext(self.field(array, numpy_abi.NDIM, INT), WORD)
        number = b.zext(self.field(self.field(array, numpy_abi.DESCR, OBJECT), numpy_abi.TYPE_NUMBER, INT), WORD)
        self._tell(b.add(b.shl(number, ir.Constant(WORD, 32)), dimensions))
        self._write(self.field(array, numpy_abi.DATA, WORD))
        shape = self.field(array, numpy_abi.SHAPE, WORD.as_pointer())
        self._for_each(dimensions, lambda k: self._write(b.load(b.gep(shape, [k]))))

    def _write(self, word: Any) -> None:
        b = self.b
        at = b.load(self.used)
        self.need(b.icmp_unsigned("<", at, ir.Constant(WORD, ROOM)))
        b.store(word, b.gep(self.words, [at]))
        b.store(b.add(at, ir.Constant(WORD, 1)), self.used)

    def _tell(self, what: Any) -> None:
        b = self.b
        mixed = b.mul(b.xor(b.load(self.kind), what), ir.Constant(WORD, _ODD))
        b.store(b.xor(mixed, b.lshr(mixed, ir.Constant(WORD, 32))), self.kind)

    def _variable(self, first: int) -> Any:
        variable = self.b.alloca(WORD)
        self.b.store(ir.Constant(WORD, first), variable)
        return variable

    def _for_each(self, count: Any, do: Callable[[Any], None]) -> None:
        """Build what is done for each number from 0 to below count."""
        b, (ask, body, after) = self.b, (self.function.append_basic_block(name) for name in ("ask", "body", "after"))
        with b.goto_entry_block():
            i = b.alloca(WORD)
        b.store(ir.Constant(WORD, 0), i)
        b.branch(ask)
        b.position_at_end(ask)
        b.cbranch(b.icmp_unsigned("<", b.load(i), count), body, after)
        b.position_at_end(body)
        do(b.load(i))
        b.store(b.add(b.load(i), ir.Constant(WORD, 1)), i)
        b.branch(ask)
        b.position_at_end(after)
