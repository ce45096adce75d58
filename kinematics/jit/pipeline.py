"""A numba compiler for functions that only compiled code calls.

Numba emits machine code for every compiled function together with all that it calls. For a function that is always a part of others this
is done once more in each of its callers, all the way up, and most of that code never runs. With `pipeline_class=BitcodeCompiler` a function
stops at LLVM's intermediate form; machine code is emitted for what is called from Python, whole, once.
"""

from __future__ import annotations

from typing import Any

from numba import _dynfunc  # type: ignore[attr-defined]
from numba.core import compiler, typed_passes
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_machinery import LoweringPass, register_pass

_Library: Any = JITCodeLibrary  # numba's own classes are untyped
_Compiler: Any = compiler.Compiler
_Pass: Any = LoweringPass
_register: Any = register_pass


class _BitcodeLibrary(_Library):  # type: ignore[misc]
    """A library without machine code. In numba's cache, too, it is kept in LLVM's form."""

    def _optimize_final_module(self) -> None:
        """Each function is optimised alone when it is added, and all of them together where machine code is emitted: here would be once
        more at every level on the way up."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def serialize_using_object_code(self) -> Any:
        return self.serialize_using_bitcode()


@_register(mutates_CFG=False, analysis_only=False)
class _DeclareFunction(_Pass):  # type: ignore[misc]
    """Tell numba about a function that was lowered but not emitted; whoever called it from Python would fail."""

    _name = "offer"

    def __init__(self) -> None:
        _Pass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        lowered, library = state["cr"], state.library
        described = lowered.fndesc
        nothing = _dynfunc.make_function(described.lookup_module(), described.qualname, "", 0, lowered.env, (library,))
        state.targetctx.insert_user_function(nothing, described, [library])
        state["cr"] = lowered._replace(cfunc=nothing)
        return True


class BitcodeCompiler(_Compiler):  # type: ignore[misc]
    """The compiler, for `njit(pipeline_class=BitcodeCompiler, no_cpython_wrapper=True)`."""

    def define_pipelines(self) -> Any:
        state = self.state
        state.library = _BitcodeLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        (pipeline,) = super().define_pipelines()
        pipeline.add_pass_after(_DeclareFunction, typed_passes.NativeLowering)
        pipeline.finalize()
        return [pipeline]
