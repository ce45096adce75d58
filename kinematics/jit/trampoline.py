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
from kinematics.jit.builtin import BYTE, INT, OBJECT, WORD, Builtin
from kinematics.jit.record import Record
from kinematics.jit.record_type import RecordType, make_array

_alloca: Any = cgutils.alloca_once_value


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


class _Builder(Builtin):
    """Builds one."""

    def __init__(self, compiled: Any, args: Sequence[Any], symbol: str) -> None:
        self.context, self.compiled = compiled.target_context, compiled
        super().__init__(self.context.codegen()._create_empty_module(symbol), symbol, len(args))
        self._body(args)
        self.finish()

    def _body(self, args: Sequence[Any]) -> None:
        signature, b = self.compiled.signature, self.b
        values = []
        for i, (value, t) in enumerate(zip(args, signature.args)):
            values.append(self.taken(self.argument(i), value, t))
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
            self.need(self.is_one(given, "bool", "bool_"))
            return self.b.trunc(self.call("PyObject_IsTrue", given), ir.IntType(1))
        number = "int" if t == types.int64 else "float"
        self.need(self.is_one(given, number, f"{number}64"))
        return self.whole(given) if t == types.int64 else self.call("PyFloat_AsDouble", given)

    def taken_record(self, given: Any, value: Record) -> Any:
        table = self.table_of(given)
        self.need(self.b.icmp_signed("==", self.b.load(table), ir.Constant(WORD, value.type_hash)))
        return table

    def taken_array(self, given: Any, value: Any, t: Any) -> Any:
        b = self.b
        self.need(self.is_one(given, "ndarray"))
        self.need(b.icmp_signed("==", self.field(given, numpy_abi.NDIM, INT), ir.Constant(INT, t.ndim)))
        wanted = ir.Constant(INT, numpy_abi.ALIGNED | (numpy_abi.CONTIGUOUS if t.layout == "C" else 0))
        self.need(b.icmp_signed("==", b.and_(self.field(given, numpy_abi.FLAGS, INT), wanted), wanted))
        dtype = self.field(given, numpy_abi.DESCR, OBJECT)
        self.need(b.icmp_signed("==", self.field(dtype, numpy_abi.TYPE_NUMBER, INT), ir.Constant(INT, value.dtype.num)))
        self.need(b.icmp_signed("==", self.field(dtype, numpy_abi.BYTE_ORDER, BYTE), ir.Constant(BYTE, ord(value.dtype.byteorder))))
        shape, strides = (self.field(given, at, WORD.as_pointer()) for at in (numpy_abi.SHAPE, numpy_abi.STRIDES))

        def words(where: Any) -> list[Any]:
            return [b.load(b.gep(where, [ir.Constant(WORD, i)])) for i in range(t.ndim)]

        data = self.field(given, numpy_abi.DATA, self.context.get_data_type(t.dtype).as_pointer())
        return make_array(self.context, b, t, data, words(shape), None if t.layout == "C" else words(strides))

    # The answer

    def given(self, answer: Any, t: Any) -> Any:
        """What compiled code returned, as Python takes it."""
        if t == types.none:
            return self.counted(self.known("None"))
        if isinstance(t, types.BaseTuple):
            out = self.call("PyTuple_New", ir.Constant(WORD, len(t)))
            for i, part in enumerate(_parts(t)):
                self.call("PyTuple_SetItem", out, ir.Constant(WORD, i), self.given(self.b.extract_value(answer, i), part))
            return out
        if t == types.boolean:
            return self.call("PyBool_FromLong", self.b.zext(answer, WORD))
        if t == types.float64:
            return self.call("PyFloat_FromDouble", answer)
        whole = answer if answer.type.width == 64 else (self.b.sext if t.signed else self.b.zext)(answer, WORD)
        return self.call("PyLong_FromLongLong", whole)
