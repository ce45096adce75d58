"""How functions that own no array are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit
from numpy.typing import NDArray

from kinematics.inlay import Inlay

Function = TypeVar("Function", bound=Callable[..., Any])
_COMPILE: Any = njit
BARE = {"cache": True, "nogil": True, "error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True}


def bare(function: Function) -> Function:
    """Compiled without reference counts, for functions that make no array: of queries that consist of dozens of arrays, counting them would
    take most of the time, the compiler's and the function's own."""
    return cast(Function, _COMPILE(**BARE)(function))


def inner(function: Function) -> Function:
    """The same, for functions that only compiled code calls: they get no way in from Python and no machine code of their own."""
    return cast(Function, _COMPILE(**BARE, no_cpython_wrapper=True, pipeline_class=Inlay)(function))


@inner
def copy_row(source: NDArray[Any], to: NDArray[Any]) -> None:
    """Copy numbers (n,): `to[:] = source` would make a copy on the way, in case both overlap."""
    for i in range(source.shape[0]):
        to[i] = source[i]


@inner
def copy_rows(source: NDArray[Any], to: NDArray[Any]) -> None:
    """Copy numbers (n, m)."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            to[i, j] = source[i, j]
