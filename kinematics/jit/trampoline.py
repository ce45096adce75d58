"""The way from Python into an entry's machine code: a builtin function, in LLVM's form, that checks its arguments, takes them apart, calls,
and puts the answer together.

It has the signature of CPython's METH_FASTCALL. An argument that is not of the kind that the entry was compiled for, and an exception in
compiled code, give NotImplemented. Of Python it knows the functions and objects of `machine_code.TABLE`; of an array what numpy's ABI says
(`numpy_abi`); of a record its address. The interpreter's lock is released meanwhile.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils, types

from kinematics.jit import numpy_abi
from kinematics.jit.machine_code import TABLE
from kinematics.jit.record import Record
from kinematics.jit.record_type import RecordType, make_array

_WORD, _INT, _BYTE, _DOUBLE = ir.IntType(64), ir.IntType(32), ir.IntType(8), ir.DoubleType()
_OBJECT = _BYTE.as_pointer()
_SIGNATURES = {
    "PyType_IsSubtype": (_INT, [_OBJECT, _OBJECT]),
    "PyObject_GetAttr": (_OBJECT, [_OBJECT, _OBJECT]),
    "PyLong_AsVoidPtr": (_OBJECT, [_OBJECT]),
    "PyLong_AsLongLong": (_WORD, [_OBJECT]),
    "PyFloat_AsDouble": (_DOUBLE, [_OBJECT]),
    "PyObject_IsTrue": (_INT, [_OBJECT]),
    "PyErr_Occurred": (_OBJECT, []),
    "PyErr_Clear": (ir.VoidType(), []),
    "PyLong_FromLongLong": (_OBJECT, [_WORD]),
    "PyFloat_FromDouble": (_OBJECT, [_DOUBLE]),
    "PyBool_FromLong": (_OBJECT, [_WORD]),
    "PyTuple_New": (_OBJECT, [_WORD]),
    "PyTuple_SetItem": (_INT, [_OBJECT, _WORD, _OBJECT]),
    "PyEval_SaveThread": (_OBJECT, []),
    "PyEval_RestoreThread": (ir.VoidType(), [_OBJECT]),
    "Py_IncRef": (ir.VoidType(), [_OBJECT]),
    "Py_DecRef": (ir.VoidType(), [_OBJECT]),
}
_alloca: Any = cgutils.alloca_once_value
_null: Any = ir.Constant(_OBJECT, None)


def trampoline(compiled: Any, args: Sequence[Any], symbol: str) -> Any:
    """An IR module with the function `symbol` around what numba compiled for arguments like these; None for an answer or an argument of a
    type that it can't hand over."""
    signature = compiled.signature
    if not _can_return(signature.return_type) or not all(_can_take(t) for t in signature.args):
        return None
    return _Builder(compiled, args, symbol).module


def _can_return(t: Any) -> bool:
    if isinstance(t, types.BaseTuple):
        return all(_can_return(part) and not isinstance(part, types.BaseTuple) for part in _parts(t))
    return t in (types.none, types.boolean, types.float64) or isinstance(t, types.Integer)


def _parts(t: Any) -> list[Any]:
    return list(t)


def _can_take(t: Any) -> bool:
    return isinstance(t, (types.Array, RecordType)) or t in (types.int64, types.float64, types.boolean)


class _Builder:
    """Builds one."""

    def __init__(self, compiled: Any, args: Sequence[Any], symbol: str) -> None:
        self.context, self.compiled = compiled.target_context, compiled
        self.module = self.context.codegen()._create_empty_module(symbol)
        self.table = ir.GlobalVariable(self.module, ir.ArrayType(_WORD, len(TABLE)), f"{symbol}.table")
        self.table.initializer = ir.Constant(self.table.value_type, None)
        shape = ir.FunctionType(_OBJECT, [_OBJECT, _OBJECT.as_pointer(), _WORD])
        self.function = ir.Function(self.module, shape, symbol)
        self.b = ir.IRBuilder(self.function.append_basic_block("begin"))
        self.mismatch = self.function.append_basic_block("mismatch")
        self._body(args)
        self.b.position_at_end(self.mismatch)
        self.b.ret(self.counted(self.known("NotImplemented")))

    def _body(self, args: Sequence[Any]) -> None:
        signature, b = self.compiled.signature, self.b
        self.need(b.icmp_unsigned("==", self.function.args[2], ir.Constant(_WORD, len(args))))
        values = []
        for i, (value, t) in enumerate(zip(args, signature.args)):
            given = b.load(b.gep(self.function.args[1], [ir.Constant(_WORD, i)]))
            values.append(self.taken(given, value, t))
        callee_type = self.context.call_conv.get_function_type(signature.return_type, signature.args)
        callee = ir.Function(self.module, callee_type, self.compiled.fndesc.llvm_func_name)
        thread = self.call("PyEval_SaveThread")
        status, answer = self.context.call_conv.call_function(b, callee, signature.return_type, signature.args, values)
        self.call("PyEval_RestoreThread", thread)
        self.need(b.not_(status.is_error))
        b.ret(self.given(answer, signature.return_type))

    # Arguments

    def taken(self, given: Any, value: Any, t: Any) -> Any:
        """An argument as compiled code takes it, if it is of the same kind as the value."""
        if isinstance(t, RecordType):
            return self.taken_record(given, value)
        if isinstance(t, types.Array):
            return self.taken_array(given, value, t)
        if t == types.boolean:
            self.need_type(given, "bool", "bool_")
            return self.b.trunc(self.call("PyObject_IsTrue", given), ir.IntType(1))
        number = "int" if t == types.int64 else "float"
        self.need_type(given, number, f"{number}64")
        out = self.call("PyLong_AsLongLong" if t == types.int64 else "PyFloat_AsDouble", given)
        failed = self.b.icmp_signed("==", out, ir.Constant(_WORD, -1)) if t == types.int64 else None
        if failed is not None:  # a number that does not fit, perhaps
            with self.b.if_then(failed):
                error = self.b.icmp_unsigned("!=", self.call("PyErr_Occurred"), _null)
                with self.b.if_then(error):
                    self.call("PyErr_Clear")
                    self.b.branch(self.mismatch)
        return out

    def taken_record(self, given: Any, value: Record) -> Any:
        is_record = self.call("PyType_IsSubtype", self.field(given, numpy_abi.TYPE, _OBJECT), self.known("Record"))
        self.need(self.b.icmp_signed("!=", is_record, ir.Constant(_INT, 0)))
        number = self.call("PyObject_GetAttr", given, self.known("attribute"))
        with self.b.if_then(self.b.icmp_unsigned("==", number, _null)):
            self.call("PyErr_Clear")
            self.b.branch(self.mismatch)
        table = self.b.bitcast(self.call("PyLong_AsVoidPtr", number), _WORD.as_pointer())
        self.call("Py_DecRef", number)
        self.need(self.b.icmp_signed("==", self.b.load(table), ir.Constant(_WORD, value.type_hash)))
        return table

    def taken_array(self, given: Any, value: Any, t: Any) -> Any:
        b = self.b
        self.need_type(given, "ndarray")
        self.need(b.icmp_signed("==", self.field(given, numpy_abi.NDIM, _INT), ir.Constant(_INT, t.ndim)))
        wanted = ir.Constant(_INT, numpy_abi.ALIGNED | (numpy_abi.CONTIGUOUS if t.layout == "C" else 0))
        self.need(b.icmp_signed("==", b.and_(self.field(given, numpy_abi.FLAGS, _INT), wanted), wanted))
        dtype = self.field(given, numpy_abi.DESCR, _OBJECT)
        self.need(b.icmp_signed("==", self.field(dtype, numpy_abi.TYPE_NUMBER, _INT), ir.Constant(_INT, value.dtype.num)))
        self.need(b.icmp_signed("==", self.field(dtype, numpy_abi.BYTE_ORDER, _BYTE), ir.Constant(_BYTE, ord(value.dtype.byteorder))))
        shape, strides = (self.field(given, at, _WORD.as_pointer()) for at in (numpy_abi.SHAPE, numpy_abi.STRIDES))

        def words(where: Any) -> list[Any]:
            return [b.load(b.gep(where, [ir.Constant(_WORD, i)])) for i in range(t.ndim)]

        data = self.field(given, numpy_abi.DATA, self.context.get_data_type(t.dtype).as_pointer())
        return make_array(self.context, b, t, data, words(shape), None if t.layout == "C" else words(strides))

    # The answer

    def given(self, answer: Any, t: Any) -> Any:
        """What compiled code returned, as Python takes it."""
        if t == types.none:
            return self.counted(self.known("None"))
        if isinstance(t, types.BaseTuple):
            out = self.call("PyTuple_New", ir.Constant(_WORD, len(t)))
            for i, part in enumerate(_parts(t)):
                self.call("PyTuple_SetItem", out, ir.Constant(_WORD, i), self.given(self.b.extract_value(answer, i), part))
            return out
        if t == types.boolean:
            return self.call("PyBool_FromLong", self.b.zext(answer, _WORD))
        if t == types.float64:
            return self.call("PyFloat_FromDouble", answer)
        whole = answer if answer.type.width == 64 else (self.b.sext if t.signed else self.b.zext)(answer, _WORD)
        return self.call("PyLong_FromLongLong", whole)

    # Python's own

    def known(self, name: str) -> Any:
        """An object of the table."""
        return self.b.inttoptr(self._word(name), _OBJECT)

    def call(self, name: str, *args: Any) -> Any:
        """The answer of a function of the table."""
        shape = ir.FunctionType(*_SIGNATURES[name])
        return self.b.call(self.b.inttoptr(self._word(name), shape.as_pointer()), args)

    def _word(self, name: str) -> Any:
        return self.b.load(self.b.gep(self.table, [ir.Constant(_INT, 0), ir.Constant(_INT, TABLE.index(name))]))

    def counted(self, thing: Any) -> Any:
        self.call("Py_IncRef", thing)
        return thing

    def field(self, thing: Any, at: int, t: Any) -> Any:
        return self.b.load(self.b.bitcast(self.b.gep(thing, [ir.Constant(_WORD, at)]), t.as_pointer()))

    def need_type(self, given: Any, *names: str) -> None:
        """Go on if an object is of one of some types."""
        found = self.field(given, numpy_abi.TYPE, _OBJECT)
        same = [self.b.icmp_unsigned("==", found, self.known(name)) for name in names]
        self.need(same[0] if len(same) == 1 else self.b.or_(*same))

    def need(self, holds: Any) -> None:
        """Go on if something holds; else it is a mismatch."""
        on = self.function.append_basic_block("on")
        self.b.cbranch(holds, on, self.mismatch)
        self.b.position_at_end(on)
