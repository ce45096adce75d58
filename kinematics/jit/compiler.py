"""What a decorated function is to numba, and how an entry is compiled. Importing this imports numba."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import llvmlite.binding as llvm  # type: ignore[import-untyped]
import numba
import numpy as np
from numba.core import types
from numba.core.codegen import JITCodeLibrary
from numba.core.registry import cpu_target
from numba.core.typing.typeof import typeof_impl

from kinematics.jit import machine_code, simd, simd_lowering
from kinematics.jit import record_type as record_type  # registers itself
from kinematics.jit.cache_files import check
from kinematics.jit.description import Description
from kinematics.jit.support import PLAIN, missing_part, tell
from kinematics.jit.trampoline import trampoline

_Base: Any = JITCodeLibrary  # numba's own classes and functions are untyped
_njit: Any = numba.njit
_typeof: Any = typeof_impl
_on_typeof: Any = typeof_impl.register
_plain: Any = types.unliteral
_number = {"i": types.int64, "d": types.float64, "b": types.boolean}
MISSING = None if PLAIN else missing_part()
"""The inner part that this numba lacks: functions are then compiled plainly after all."""
if MISSING:
    tell(MISSING)


@_on_typeof(Description)  # type: ignore[untyped-decorator]
def _typeof_described(value: Description, context: Any) -> Any:
    return types.Dispatcher(value.dispatcher)


@_on_typeof(simd.Operation)  # type: ignore[untyped-decorator]
def _typeof_operation(value: simd.Operation, context: Any) -> Any:
    return cpu_target.typing_context.resolve_value_type(getattr(simd_lowering, value.name))


def dispatcher(described: Description) -> Any:
    """What compiled code calls. Of an entry it is the part that becomes a part of the caller, as an inline function does."""
    function, options = described.__wrapped__, described.options
    if PLAIN or MISSING or not described.is_part:
        if MISSING and described.is_part:  # what the cache has of it is in another form
            options = {k: v for k, v in options.items() if k not in ("_nrt", "no_cfunc_wrapper", "cache")}
        made: Any = _njit(**options)(function)
        if not (PLAIN or MISSING):
            check(made)
        return made
    from kinematics.jit.pipeline import BitcodeCompiler

    part: Any = _njit(**options, no_cpython_wrapper=True, pipeline_class=BitcodeCompiler)(function)
    check(part)
    usual = part.get_call_template
    part.get_call_template = lambda args, kws: usual([_plain(a) for a in args], {name: _plain(a) for name, a in kws.items()})
    return part


def plain_dispatcher(entry: Description) -> Any:
    """Numba's own way into an entry from Python, for arguments that machine code does not take; and where it ended in an exception."""
    if MISSING:
        return entry.dispatcher
    return _njit(**{**entry.options, "cache": False})(entry.__wrapped__)


def compile_entry(entry: Description, args: Sequence[Any], kinds: str) -> Callable[..., Any] | None:
    """Compile an entry for arguments like these, keep its machine code, and make it callable; None where that is not possible."""
    if MISSING:
        return None
    with rarely_collecting():
        symbol = machine_code.symbol_of(entry.__module__, entry.__qualname__, kinds)
        library = Library([(entry, args, symbol)])
        if symbol not in library.symbols:
            return None
        code = library.emit(symbol)
    machine_code.store(code)
    return machine_code.activate(code)


def _type(value: Any) -> Any:
    """Numba's type of an argument. Arrays that may be written to and those that may not are one, as in records."""
    if isinstance(value, np.ndarray):
        found = _typeof(value, None)
        return types.Array(found.dtype, found.ndim, "C" if value.flags.c_contiguous else "A")
    kind = machine_code.kinds([value])
    return _number[kind] if kind in _number else _typeof(value, None)


class Library(_Base):  # type: ignore[misc]
    """Entries for arguments like some, with all that they call: a library whose machine code is not for numba's own use."""

    def __init__(self, entries: Sequence[tuple[Description, Sequence[Any], str]]) -> None:
        """entries: each with arguments and the symbol that it gets. One that can't be handed over to Python is left out of `symbols`."""
        super().__init__(cpu_target.target_context.codegen(), entries[0][2])
        self.symbols: list[str] = []
        for entry, args, symbol in entries:
            argument_types = tuple(_type(a) for a in args)
            part = entry.dispatcher
            part.compile(argument_types)
            compiled = part.overloads[argument_types]
            module = trampoline(compiled, args, symbol)
            if module is not None:
                self.symbols.append(symbol)
                self.add_ir_module(module)
                self.add_linking_library(compiled.library)

    def optimised(self) -> Any:
        """LLVM's module of all that is needed, of which only the entries can be seen from outside."""
        final: Any = self._final_module
        for other in dict.fromkeys(self._linking_libraries):
            final.link_in(other._get_module_for_linking(), preserve=True)
        self._optimize_final_module()
        seen = {name for symbol in self.symbols for name in (symbol, f"{symbol}.table")}
        for thing in (*final.functions, *final.global_variables):  # not before: LLVM would make one piece of them, in twice the time
            if not thing.is_declaration and thing.name not in seen:
                thing.linkage = llvm.Linkage.internal
        remove_unused = llvm.create_new_module_pass_manager()
        remove_unused.add_global_dead_code_eliminate_pass()
        remove_unused.run(final, self._codegen._pass_builder())
        final.verify()
        return final

    def emit(self, symbol: str) -> machine_code.Code:
        """Machine code of its only entry."""
        final = self.optimised()
        outside = [f.name for f in final.functions if f.is_declaration and not f.name.startswith("llvm.")]
        outside += [g.name for g in final.global_variables if g.is_declaration]
        return machine_code.Code(symbol, outside, [], self._codegen._tm.emit_object(final))


@contextmanager
def rarely_collecting() -> Iterator[None]:
    """Compiling makes millions of objects that live as long as it does; to look for garbage among them all the time is a tenth of it."""
    usual = gc.get_threshold()
    gc.set_threshold(100_000, *usual[1:])
    try:
        yield
    finally:
        gc.set_threshold(*usual)
