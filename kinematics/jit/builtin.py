"""A builtin function of Python's, in LLVM's form: the frame of what compiled code is called by (`kinematics.jit.trampoline`) and of what
writes records' tables (`kinematics.jit.record_table`).

It has the signature of CPython's METH_FASTCALL, and answers NotImplemented to what it does not take. Of Python it knows the functions and
objects of `machine_code.TABLE`. Numba is not needed.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]

from kinematics.jit import numpy_abi
from kinematics.jit.machine_code import TABLE

WORD, INT, BYTE, DOUBLE = ir.IntType(64), ir.IntType(32), ir.IntType(8), ir.DoubleType()
OBJECT = BYTE.as_pointer()
_SIGNATURES = {
    "PyType_IsSubtype": (INT, [OBJECT, OBJECT]),
    "PyObject_GetAttr": (OBJECT, [OBJECT, OBJECT]),
    "PyLong_AsVoidPtr": (OBJECT, [OBJECT]),
    "PyLong_AsLongLong": (WORD, [OBJECT]),
    "PyFloat_AsDouble": (DOUBLE, [OBJECT]),
    "PyObject_IsTrue": (INT, [OBJECT]),
    "PyErr_Occurred": (OBJECT, []),
    "PyErr_Clear": (ir.VoidType(), []),
    "PyLong_FromLongLong": (OBJECT, [WORD]),
    "PyFloat_FromDouble": (OBJECT, [DOUBLE]),
    "PyBool_FromLong": (OBJECT, [WORD]),
    "PyTuple_New": (OBJECT, [WORD]),
    "PyTuple_SetItem": (INT, [OBJECT, WORD, OBJECT]),
    "PyEval_SaveThread": (OBJECT, []),
    "PyEval_RestoreThread": (ir.VoidType(), [OBJECT]),
    "Py_IncRef": (ir.VoidType(), [OBJECT]),
    "Py_DecRef": (ir.VoidType(), [OBJECT]),
}
NULL: Any = ir.Constant(OBJECT, None)


class Builtin:
    """Builds one, into a module: what it does goes between the constructor, which begins it, and `finish`. b: the builder."""

    def __init__(self, module: Any, symbol: str, arguments: int) -> None:
        self.module = module
        self.table = ir.GlobalVariable(self.module, ir.ArrayType(WORD, len(TABLE)), f"{symbol}.table")
        self.table.initializer = ir.Constant(self.table.value_type, None)
        shape = ir.FunctionType(OBJECT, [OBJECT, OBJECT.as_pointer(), WORD])
        self.function = ir.Function(self.module, shape, symbol)
        self.b = ir.IRBuilder(self.function.append_basic_block("begin"))
        self.mismatch = self.function.append_basic_block("mismatch")
        self.need(self.b.icmp_unsigned("==", self.function.args[2], ir.Constant(WORD, arguments)))

    def finish(self) -> None:
        """What has to hold and does not ends here."""
        self.b.position_at_end(self.mismatch)
        self.b.ret(self.counted(self.known("NotImplemented")))

    def argument(self, i: int) -> Any:
        return self.b.load(self.b.gep(self.function.args[1], [ir.Constant(WORD, i)]))

    def known(self, name: str) -> Any:
        """An object of the table."""
        return self.b.inttoptr(self._word(name), OBJECT)

    def call(self, name: str, *args: Any) -> Any:
        """The answer of a function of the table."""
        shape = ir.FunctionType(*_SIGNATURES[name])
        return self.b.call(self.b.inttoptr(self._word(name), shape.as_pointer()), args)

    def _word(self, name: str) -> Any:
        return self.b.load(self.b.gep(self.table, [ir.Constant(INT, 0), ir.Constant(INT, TABLE.index(name))]))

    def counted(self, thing: Any) -> Any:
        self.call("Py_IncRef", thing)
        return thing

    def field(self, thing: Any, at: int, t: Any) -> Any:
        return self.b.load(self.b.bitcast(self.b.gep(thing, [ir.Constant(WORD, at)]), t.as_pointer()))

    def is_one(self, given: Any, *names: str) -> Any:
        """Whether an object is of one of some types."""
        found = self.field(given, numpy_abi.TYPE, OBJECT)
        same = [self.b.icmp_unsigned("==", found, self.known(name)) for name in names]
        return same[0] if len(same) == 1 else self.b.or_(*same)

    def whole(self, given: Any) -> Any:
        """The word that a whole number is; one that does not fit is a mismatch."""
        out = self.call("PyLong_AsLongLong", given)
        with self.b.if_then(self.b.icmp_signed("==", out, ir.Constant(WORD, -1))):
            error = self.b.icmp_unsigned("!=", self.call("PyErr_Occurred"), NULL)
            with self.b.if_then(error):
                self.call("PyErr_Clear")
                self.b.branch(self.mismatch)
        return out

    def table_of(self, given: Any) -> Any:
        """A record's table; what is no record, and one that has none, is a mismatch."""
        is_record = self.call("PyType_IsSubtype", self.field(given, numpy_abi.TYPE, OBJECT), self.known("Record"))
        self.need(self.b.icmp_signed("!=", is_record, ir.Constant(INT, 0)))
        number = self.call("PyObject_GetAttr", given, self.known("attribute"))
        with self.b.if_then(self.b.icmp_unsigned("==", number, NULL)):
            self.call("PyErr_Clear")
            self.b.branch(self.mismatch)
        table = self.b.bitcast(self.call("PyLong_AsVoidPtr", number), WORD.as_pointer())
        self.call("Py_DecRef", number)
        return table

    def need(self, holds: Any) -> None:
        """Go on if something holds; else it is a mismatch."""
        on = self.function.append_basic_block("on")
        self.b.cbranch(holds, on, self.mismatch)
        self.b.position_at_end(on)
