"""Entries that every plan needs, compiled ahead: in a process beside the one that is at work, from the other end of the list.

`ahead.json` has them in the order in which a first plan calls them, each with what its arguments are like. `python -m
planning.compiling.ahead PID` compiles those of which the cache has no machine code yet, the last first, as long as the process PID that has
started it lives; what it leaves is compiled when it is called. `make ahead` makes the list again, see `make_list`.
"""

from __future__ import annotations

import atexit
import json
import os
import subprocess
import sys
from collections.abc import Iterable
from functools import cache
from importlib import import_module
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from kinematics.jit import machine_code, shipped
from kinematics.jit.record import Record
from kinematics.jit.support import PLAIN

LIST = Path(__file__).with_name("ahead.json")
SHIPPED = 0.08
"""What making machine code of a function that ships takes, where compiling it takes 1."""
_NUMBERS: dict[str, Any] = {"i": 1, "d": 1.0, "b": True}
_STARTED: list[subprocess.Popen[bytes]] = []
"""The processes beside this one."""


class Ahead(NamedTuple):
    """An entry with arguments like those of a call. kinds: of these, see `machine_code.kinds`; loops: what compiling it takes, in
    turns of `loop_s`, whatever the machine."""

    entry: str
    kinds: str
    arguments: list[Any]
    loops: float

    @property
    def symbol(self) -> str:
        """The name of its machine code."""
        module, _, name = self.entry.rpartition(".")
        return machine_code.symbol_of(module, name, self.kinds)


def describe(value: Any) -> Any:
    """What an argument is like, in words that JSON takes: "i", "d", "b" for numbers, "float64:2C" for an array, and so on for a record:
    [module, class, fields], and for a tuple of records: {"tuple": [...]}."""
    if isinstance(value, np.ndarray):
        return f"{value.dtype.name}:{value.ndim}{'C' if value.flags.c_contiguous else 'A'}"
    if isinstance(value, Record):
        return [type(value).__module__, type(value).__qualname__, [describe(field) for field in value]]  # type: ignore[attr-defined]
    if isinstance(value, tuple):
        return {"tuple": [describe(part) for part in value]}
    return machine_code.kinds([value])


def example(words: Any) -> Any:
    """A value that is described by such words."""
    if isinstance(words, dict):
        return tuple(example(part) for part in words["tuple"])
    if isinstance(words, list):
        module, name, fields = words
        return getattr(import_module(module), name)(*map(example, fields))
    if words in _NUMBERS:
        return _NUMBERS[words]
    dtype, shape = words.split(":")
    room = np.zeros((2,) * int(shape[:-1]), dtype)
    return room if shape[-1] == "C" else room[..., ::-1]


@cache
def known() -> list[Ahead]:
    """The list; empty where there is none, or where functions are compiled plainly."""
    if PLAIN or not LIST.is_file():
        return []
    return [Ahead(*row) for row in json.loads(LIST.read_text(encoding="utf-8"))]


def entry_of(ahead: Ahead) -> Any:
    """The decorated function. Raises: what an import raises, and AttributeError, when the list is of an older version."""
    module, _, name = ahead.entry.rpartition(".")
    return getattr(import_module(module), name)


def waiting() -> list[Ahead]:
    """Those of which the cache has no machine code."""
    return [a for a in known() if not machine_code.is_stored(a.symbol)]


def loop_s() -> float:
    """How long this machine takes for a loop that does nothing, some milliseconds: the measure of what compiling takes."""
    times = []
    for _ in range(3):
        began = perf_counter()
        for _ in range(200_000):
            pass
        times.append(perf_counter() - began)
    return min(times)


def loops(entries: Iterable[Ahead]) -> float:
    """What compiling them takes, in loops, see `loop_s`; less where they ship."""
    return sum(a.loops * (SHIPPED if a.symbol in shipped.entries() else 1.0) for a in entries)


def share_done() -> float:
    """How much of the compiling is done, from 0 to 1."""
    whole = loops(known())
    return 1.0 - loops(waiting()) / whole if whole > 0 else 1.0


def compile_now(ahead: Ahead) -> str | None:
    """Compile an entry as a call with such arguments would; what went wrong, for then the list is of another version."""
    try:
        entry_of(ahead).prepare(*map(example, ahead.arguments))
    except Exception as e:
        return f"{ahead.entry}: {type(e).__name__}: {e}"
    return None


def start_beside(*, drawing: bool = False) -> subprocess.Popen[bytes] | None:
    """Start a process that compiles what is not in the cache, and ends with this one; None without a second core for it, or while one
    that was started before is at work. drawing: it begins with what stills need."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if cores < 2 or any(beside.poll() is None for beside in _STARTED) or not waiting():
        return None
    home = str(Path(__file__).resolve().parents[2])
    env = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, [home, os.environ.get("PYTHONPATH")]))}
    quiet = subprocess.DEVNULL
    command = [sys.executable, "-P", "-m", "planning.compiling.ahead", str(os.getpid()), *(["drawing"] if drawing else [])]
    try:
        beside = subprocess.Popen(command, env=env, stdin=quiet, stdout=quiet, stderr=quiet)
    except OSError:
        return None
    _STARTED.append(beside)
    atexit.register(_end, beside)
    return beside


def _end(beside: subprocess.Popen[bytes]) -> None:
    beside.terminate()
    beside.wait()


def main(parent: int, *, drawing: bool = False) -> None:
    """Compile what is missing, from the end of the list, while the parent lives; before that what drawing needs."""
    if drawing:
        from perception.rendering.tiny_still import tiny_still

        tiny_still()
    for ahead in reversed(known()):
        if os.getppid() != parent:
            return
        if not machine_code.is_stored(ahead.symbol):
            compile_now(ahead)


if __name__ == "__main__":
    main(int(sys.argv[1]), drawing="drawing" in sys.argv[2:])
