"""What a decorated function is before anything is compiled."""

from __future__ import annotations

from collections.abc import Callable
from functools import update_wrapper
from typing import Any, cast


class Description:
    """A function, and the options of `numba.njit` that it is compiled with. is_part: whether it becomes a part of what calls it, and has no
    machine code of its own for numba's dispatcher."""

    is_part = False
    __wrapped__: Callable[..., Any]
    __qualname__: str
    dispatcher: Any
    """Numba's dispatcher, which compiled code calls."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        self.options = options
        update_wrapper(cast(Any, self), function)

    def __reduce__(self) -> Any:
        return self.__qualname__
