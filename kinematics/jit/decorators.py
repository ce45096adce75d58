"""How functions are compiled: `jit_entry` for those that Python calls, `jit_inline` for those that only compiled code calls, `njit` for
those that make arrays.

A decorated function is a description. Numba is not imported before something has to be compiled: machine code that an earlier run has left
in the cache is called without it (`kinematics.jit.machine_code`), which saves a command most of a second.
"""

from __future__ import annotations

import inspect
import threading
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, TypeVar, cast

from numpy.typing import NDArray

from kinematics.jit import machine_code, record_table
from kinematics.jit.description import Description
from kinematics.jit.record import written_by
from kinematics.jit.support import PLAIN

Function = TypeVar("Function", bound=Callable[..., Any])
PLAIN_OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy"}
ENTRY_OPTIONS = {**PLAIN_OPTIONS, "_nrt": False, "no_cfunc_wrapper": True}
_lock = threading.RLock()
written_by(record_table.writer)


class Deferred(Description):
    """A function that numba compiles when it is first called, from Python or from compiled code."""

    @cached_property
    def dispatcher(self) -> Any:
        """Numba's dispatcher, which compiled code calls."""
        from kinematics.jit.compiler import dispatcher

        with _lock:
            return dispatcher(self)

    def __call__(self, *args: Any, **kws: Any) -> Any:
        return self.dispatcher(*args, **kws)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name == "dispatcher":
            raise AttributeError(name)
        return getattr(self.dispatcher, name)


class Inline(Deferred):
    """A function that only compiled code calls."""

    is_part = True


class Entry(Deferred):
    """A function that Python calls: by its machine code, one for each kind of arguments."""

    is_part = True

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        super().__init__(function, options)
        self.calls: list[Callable[..., Any]] = []
        self._tried: set[str] = set()

    def __call__(self, *args: Any, **kws: Any) -> Any:
        if not kws:
            for call in self.calls:
                answer = call(*args)
                if answer is not NotImplemented:
                    return answer
        return self._call_otherwise(args, kws)

    def _call_otherwise(self, args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
        """Fill in defaults, or load or compile the code for such arguments; or leave the call to numba where that is not possible."""
        if kws or len(args) < len(self._signature.parameters):
            bound = self._signature.bind(*args, **kws)
            bound.apply_defaults()
            return self(*bound.args)
        fresh = self.prepare(*args)
        if fresh:
            return self(*args)
        for call in self.calls:  # another thread may have brought it meanwhile
            answer = call(*args)
            if answer is not NotImplemented:
                return answer
        return self.checked(*args)

    def prepare(self, *args: Any) -> bool:
        """Load or compile the code for arguments like these; whether that was still to be done."""
        kinds = machine_code.kinds(args)
        with _lock:
            if kinds is None or kinds in self._tried:
                return False
            self._tried.add(kinds)
            code = self.bring(args, kinds)
            if code is not None:
                self.calls.append(code)
        return True

    def bring(self, args: tuple[Any, ...], kinds: str) -> Callable[..., Any] | None:
        """Machine code for such arguments, from the cache, of what ships, or compiled; None where there can't be any."""
        symbol = machine_code.symbol_of(self.__module__, self.__qualname__, kinds)
        code = machine_code.load(symbol)
        if code is None:
            from kinematics.jit import shipped

            code = machine_code.load(symbol) if shipped.bring(symbol, self, args) else None
        if code is None:
            from kinematics.jit.compiler import compile_entry

            code = compile_entry(self, args, kinds)
        return code

    @cached_property
    def _signature(self) -> inspect.Signature:
        return inspect.signature(self.__wrapped__)

    @cached_property
    def checked(self) -> Any:
        """Numba's own way of calling it, for arguments that machine code does not take, or that it fails on with an exception."""
        from kinematics.jit.compiler import plain_dispatcher

        return plain_dispatcher(self)


def jit_entry(function: Function, *, fastmath: Sequence[str] = ()) -> Function:
    """Compiled without reference counts, for functions that make no array: of queries that consist of dozens of arrays, counting them would
    take most of the time, the compiler's and the function's own.

    It gets machine code, with all that it calls, when Python first calls it; compiled code makes it
    a part of itself, like `jit_inline` ones. fastmath: what LLVM may do to its float arithmetic, by LLVM's names.
    """
    options = {**(PLAIN_OPTIONS if PLAIN else ENTRY_OPTIONS), **({"fastmath": set(fastmath)} if fastmath else {})}
    return cast(Function, (Deferred if PLAIN else Entry)(function, options))


def jit_inline(function: Function, *, forceinline: bool = False) -> Function:
    """The same, for functions that only compiled code calls: they get no way in from Python and no machine code of their own.

    They are not compiled anew for a number that is written out where it is called, nor for one of which the compiler has only seen yet
    that it starts at 0.
    """
    options = {**(PLAIN_OPTIONS if PLAIN else ENTRY_OPTIONS), "forceinline": forceinline}
    return cast(Function, (Deferred if PLAIN else Inline)(function, options))


def njit(**options: Any) -> Callable[[Function], Function]:
    """`numba.njit` with a checked cache, for functions that make arrays; without the check where numba's inner parts are not used."""

    def decorate(function: Function) -> Function:
        return cast(Function, Deferred(function, options))

    return decorate


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
