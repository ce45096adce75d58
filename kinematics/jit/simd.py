"""Sixteen float32 side by side as one value in compiled code; for Python these are names only.

`load(S, i)` and `store(S, i, v)` move 16 neighbours of a float32 array, `spread(x)` repeats a number; + - * / work between vectors and with
float32 numbers; `largest`, `size`, `root` and `nearest_int` are max, abs, sqrt and rint lane by lane; `below(a, b)` is an integer whose bit
w says that a < b in lane w, or that one of them is not a number; `chosen(bits, a, b)` has a where the lane's bit is set, else b. None of
them checks an index.
"""

from __future__ import annotations

from typing import Any

WIDTH = 16


class Operation:
    """One of them; `simd_lowering` has what it means, under its name."""

    def __init__(self, name: str) -> None:
        self.name = self.__name__ = name

    def __call__(self, *args: Any) -> Any:
        raise TypeError(f"simd.{self.name} is for compiled code")


load, store, spread, below = Operation("load"), Operation("store"), Operation("spread"), Operation("below")
largest, size, root, nearest_int = Operation("largest"), Operation("size"), Operation("root"), Operation("nearest_int")
chosen = Operation("chosen")
