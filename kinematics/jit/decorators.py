"""How functions that own no array are compiled: by way of numba's inner parts, or plainly where those are not to be had (`PLAIN`)."""

from __future__ import annotations

import gc
from collections.abc import Callable
from types import FunctionType
from typing import Any, TypeVar, cast

from numba.core import types
from numpy.typing import NDArray

from kinematics.jit.cache_files import njit
from kinematics.jit.support import PLAIN

Function = TypeVar("Function", bound=Callable[..., Any])
_COMPILE: Any = njit
_plain: Any = types.unliteral
PLAIN_OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy"}
ENTRY_OPTIONS = {**PLAIN_OPTIONS, "_nrt": False, "no_cfunc_wrapper": True}


def jit_entry(function: Function) -> Function:
    """Compiled without reference counts, for functions that make no array: of queries that consist of dozens of arrays, counting them would
    take most of the time, the compiler's and the function's own.

    It gets machine code, with all that it calls, when Python first calls it; compiled code makes it
    a part of itself, like `jit_inline` ones.
    """
    if PLAIN:
        return cast(Function, _COMPILE(**PLAIN_OPTIONS)(function))
    part: Any = jit_inline(_twin(function))
    entry = _COMPILE(**ENTRY_OPTIONS)(function)
    entry.get_call_template, entry.get_overload = part.get_call_template, part.get_overload
    entry._compile_for_args = _rarely_collecting(entry._compile_for_args)
    return cast(Function, entry)


def jit_inline(function: Function, *, forceinline: bool = False) -> Function:
    """The same, for functions that only compiled code calls: they get no way in from Python and no machine code of their own.

    They are not compiled anew for a number that is written out where it is called, nor for one of which the compiler has only seen yet
    that it starts at 0.
    """
    if PLAIN:
        return cast(Function, _COMPILE(**PLAIN_OPTIONS, forceinline=forceinline)(function))
    from kinematics.jit.pipeline import BitcodeCompiler

    part = _COMPILE(**ENTRY_OPTIONS, forceinline=forceinline, no_cpython_wrapper=True, pipeline_class=BitcodeCompiler)(function)
    usual = part.get_call_template
    part.get_call_template = lambda args, kws: usual([_plain(a) for a in args], {name: _plain(a) for name, a in kws.items()})
    return cast(Function, part)


def _rarely_collecting(compile_: Callable[..., Any]) -> Callable[..., Any]:
    """Compiling makes millions of objects that live as long as it does; to look for garbage among them all the time is a tenth of it."""

    def compile_for_args(*args: Any, **kws: Any) -> Any:
        usual = gc.get_threshold()
        gc.set_threshold(100_000, *usual[1:])
        try:
            return compile_(*args, **kws)
        finally:
            gc.set_threshold(*usual)

    return compile_for_args


def _twin(function: Function) -> Function:
    """The same function under another name, which numba's cache goes by."""
    twin = FunctionType(function.__code__, function.__globals__, function.__name__)
    twin.__module__, twin.__qualname__ = function.__module__, f"{function.__qualname__}.part"
    return cast(Function, twin)


@jit_inline
def copy_row(source: NDArray[Any], to: NDArray[Any]) -> None:
    """Copy numbers (n,): `to[:] = source` would make a copy on the way, in case both overlap."""
    for i in range(source.shape[0]):
        to[i] = source[i]


@jit_inline
def copy_rows(source: NDArray[Any], to: NDArray[Any]) -> None:
    """Copy numbers (n, m)."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            to[i, j] = source[i, j]
