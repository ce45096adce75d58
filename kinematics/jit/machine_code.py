"""Machine code of entries: loaded from the cache into this process and called, without numba.

A file holds an object file that LLVM emitted, the function's name, and what it calls outside: of the C library's, and of other files. An
entry's function (`kinematics.jit.trampoline`) is a builtin function to Python. It takes what was compiled for, arrays, records and numbers
of certain kinds, and answers NotImplemented to anything else. What it needs from Python it finds in a table of addresses, which is filled
when it is loaded.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from llvmlite import binding  # type: ignore[import-untyped]

from kinematics import cache
from kinematics.jit.cache_folder import FOLDER
from kinematics.jit.record import Record

_SCALARS: dict[type, str] = {int: "i", np.int64: "i", float: "d", np.float64: "d", bool: "b", np.bool_: "b"}
_FASTCALL = 0x0080
_KEPT: list[Any] = []
"""What loaded code points to."""
_LINKED: set[str] = set()
"""The symbols of code that is a part of this process."""
ADDRESS = "address"
"""The attribute of a record that compiled code reads."""

OBJECTS: dict[str, Any] = {
    "ndarray": np.ndarray, "int": int, "int64": np.int64, "float": float, "float64": np.float64, "bool": bool, "bool_": np.bool_,
    "True": True, "None": None, "NotImplemented": NotImplemented, "Record": Record, "attribute": ADDRESS,
}  # fmt: skip
FUNCTIONS = (
    "PyType_IsSubtype", "PyObject_GetAttr", "PyLong_AsVoidPtr", "PyLong_AsLongLong", "PyFloat_AsDouble", "PyObject_IsTrue",
    "PyErr_Occurred", "PyErr_Clear",
    "PyLong_FromLongLong", "PyFloat_FromDouble", "PyBool_FromLong", "PyTuple_New", "PyTuple_SetItem", "PyEval_SaveThread",
    "PyEval_RestoreThread", "Py_IncRef", "Py_DecRef",
)  # fmt: skip
TABLE = (*OBJECTS, *FUNCTIONS)
"""What the table of addresses holds, in this order."""


class Code(NamedTuple):
    """What a file holds. symbol: the function's name, and with ".table" behind it that of the table of addresses. needs: the symbols of
    other files that it calls, see `shipped`."""

    symbol: str
    outside: list[str]
    needs: list[str]
    object_file: bytes


class _MethodDef(ctypes.Structure):
    """CPython's PyMethodDef."""

    _fields_ = (("name", ctypes.c_char_p), ("function", ctypes.c_void_p), ("flags", ctypes.c_int), ("doc", ctypes.c_char_p))


def kinds(args: Sequence[Any]) -> str | None:
    """What machine code depends on, of arguments: their types, for arrays with the number of dimensions and whether they are contiguous,
    for records with all of their fields. None when one is of a type that it does not take."""
    out = []
    for a in args:
        if type(a) is np.ndarray and a.flags.aligned and a.dtype.isnative and a.dtype.kind in "biuf":
            out.append(f"{a.dtype.kind}{a.dtype.itemsize}:{a.ndim}{'C' if a.flags.c_contiguous else 'A'}")
        elif isinstance(a, Record):
            out.append(f"{type(a).__name__}:{a.type_hash & 0xFFFFFFFFFFFFFFFF:016x}")
        elif type(a) in _SCALARS:
            out.append(_SCALARS[type(a)])
        else:
            return None
    return ",".join(out)


def symbol_of(module: str, name: str, kinds: str) -> str:
    """The name of an entry's function for some kinds of arguments; different ones have different names."""
    return f"{module}.{name}-{hashlib.sha256(f'{module}.{name}({kinds})'.encode()).hexdigest()[:16]}"


def is_stored(symbol: str) -> bool:
    """Whether this or an earlier run, or a process beside, has left code."""
    return cache.is_kept(_path(symbol))


def load(symbol: str) -> Callable[..., Any] | None:
    """The function that an earlier run has left, or None."""
    code = _stored(symbol)
    return None if code is None else activate(code)


def _stored(symbol: str) -> Code | None:
    data = cache.read(_path(symbol))
    if data is None:
        return None
    head, object_file = data.split(b"\n", 1)
    symbol, outside, needs = json.loads(head)
    return Code(symbol, outside, needs, object_file)


def store(code: Code) -> None:
    """Leave code for later runs; a cache that can't be written is no error."""
    head = json.dumps([code.symbol, code.outside, code.needs]).encode()
    cache.write(_path(code.symbol), head + b"\n" + code.object_file, synced=False)


def _path(symbol: str) -> Path:
    return FOLDER / f"{symbol}.code"


def activate(code: Code) -> Callable[..., Any] | None:
    """Make code a part of this process: a builtin function; None when something that it calls is missing."""
    if not _link(code):
        return None
    engine = _engine()
    table = _addresses()
    ctypes.memmove(engine.get_global_value_address(f"{code.symbol}.table"), table, ctypes.sizeof(table))
    method = _MethodDef(code.symbol.encode(), engine.get_function_address(code.symbol), _FASTCALL, None)
    _KEPT.append(method)
    function: Callable[..., Any] = _new_builtin()(ctypes.byref(method), None, None)
    return function


def _link(code: Code) -> bool:
    """Link code with this process, after what it needs; whether all that it calls is there."""
    if not all(binding.address_of_symbol(name) for name in code.outside):
        return False
    for need in code.needs:
        other = None if need in _LINKED else _stored(need)
        if need not in _LINKED and (other is None or not _link(other)):
            return False
    engine = _engine()
    engine.add_object_file(binding.ObjectFileRef.from_data(code.object_file))
    engine.finalize_object()
    _LINKED.add(code.symbol)
    return True


@lru_cache(maxsize=1)
def _new_builtin() -> Any:
    new = ctypes.pythonapi.PyCFunction_NewEx
    new.argtypes, new.restype = (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p), ctypes.py_object
    return new


@lru_cache(maxsize=1)
def _engine() -> Any:
    """LLVM's linker, with no compiler behind it."""
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    machine = binding.Target.from_triple(binding.get_process_triple()).create_target_machine()
    return binding.create_mcjit_compiler(binding.parse_assembly(""), machine)


@lru_cache(maxsize=1)
def _addresses() -> Any:
    _KEPT.append(OBJECTS)
    functions = [ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value or 0 for name in FUNCTIONS]
    return (ctypes.c_uint64 * len(TABLE))(*map(id, OBJECTS.values()), *functions)
