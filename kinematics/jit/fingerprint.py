"""What the machine code of an entry depends on, in a hash: the code of all functions that it calls, the constants that they read, the
fields of the records that it takes, and how functions are compiled here. It is the same on any machine, and for any version of Python."""

from __future__ import annotations

import hashlib
import inspect
import io
import textwrap
import tokenize
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, cast

import numpy as np

from kinematics.jit.description import Description
from kinematics.jit.record import Record

_COMPILING = (
    "builtin", "compiler", "decorators", "fingerprint", "machine_code", "numpy_abi", "pipeline", "record", "record_type", "simd_lowering",
    "trampoline",
)  # fmt: skip
_BETWEEN = (tokenize.INDENT, tokenize.DEDENT, tokenize.NEWLINE)
"""What stands between statements."""
_HOME = __name__.partition(".")[0]


def fingerprint(entry: Description, args: Sequence[Any]) -> str:
    """Of an entry, for arguments like these."""
    parts: dict[str, str] = {}
    _gather(entry, parts)
    fields = [_fields(a) for a in args]
    return hashlib.sha256(repr([way_of_compiling(), sorted(parts.items()), fields]).encode()).hexdigest()[:24]


@cache
def way_of_compiling() -> str:
    """A hash of the modules that say how functions are compiled."""
    texts = [code_of(Path(__file__).with_name(f"{name}.py").read_text(encoding="utf-8")) for name in _COMPILING]
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()


def code_of(source: str) -> str:
    """A text in Python without what does not run: comments, docstrings, and where lines are broken."""
    kept: list[tokenize.TokenInfo] = []
    for token in _tokens(source):
        alone = len(kept) == 1 or (len(kept) > 1 and kept[-2].type in _BETWEEN)
        if token.type == tokenize.NEWLINE and alone and kept[-1].type == tokenize.STRING:
            kept.pop()
        elif token.type not in (tokenize.COMMENT, tokenize.NL):
            kept.append(token)
    return " ".join(tokenize.tok_name[token.type] if token.type in _BETWEEN else token.string for token in kept)


def _tokens(source: str) -> Iterator[tokenize.TokenInfo]:
    """The tokens of a text. An f-string is one, as it was before Python 3.12."""
    lines = source.splitlines(keepends=True)
    opened: list[tokenize.TokenInfo] = []
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if tokenize.tok_name[token.type] == "FSTRING_START":
            opened.append(token)
        elif tokenize.tok_name[token.type] == "FSTRING_END":
            first = opened.pop()
            if not opened:
                yield tokenize.TokenInfo(tokenize.STRING, _between(lines, first.start, token.end), first.start, token.end, first.line)
        elif not opened:
            yield token


def _between(lines: Sequence[str], start: tuple[int, int], end: tuple[int, int]) -> str:
    """The text from one place (line from 1, column) to another."""
    (first, left), (last, right) = start, end
    if first == last:
        return lines[first - 1][left:right]
    return "".join((lines[first - 1][left:], *lines[first : last - 1], lines[last - 1][:right]))


def _fields(value: Any) -> Any:
    """The names of a record's fields, and so on for records in it."""
    if isinstance(value, Record):
        return [list(cast(Any, value)._fields), [_fields(field) for field in cast(Any, value)]]
    return [_fields(part) for part in value] if isinstance(value, tuple) else None


def _gather(described: Description, parts: dict[str, str]) -> None:
    """Add the text of a function, and all that it reads, under their names."""
    name = f"{described.__module__}.{described.__qualname__}"
    if name in parts:
        return
    function = cast(FunctionType, described.__wrapped__)
    parts[name] = _text(function)
    for read, value in _reads(function):
        if isinstance(value, Description):
            _gather(value, parts)
        else:
            parts[f"{name}: {read}"] = _constant(value)


@cache
def _text(function: FunctionType) -> str:
    return code_of(textwrap.dedent(inspect.getsource(function)))


def _reads(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """The values from outside that a function reads, with their names: globals, those of the functions around it, and what is read from
    modules and classes of ours."""
    names = sorted(set(_names(function.__code__)))
    around = dict(zip(function.__code__.co_freevars, (cell.cell_contents for cell in function.__closure__ or ())))
    outside = {**function.__globals__, **around}
    for name in names:
        if name in outside:
            value = outside[name]
            yield name, value
            if isinstance(value, (ModuleType, type)) and _is_ours(value):
                yield from ((f"{name}.{n}", getattr(value, n)) for n in names if hasattr(value, n))


def _names(code: CodeType) -> Iterator[str]:
    yield from (*code.co_names, *code.co_freevars)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names(constant)


def _is_ours(value: Any) -> bool:
    return str(getattr(value, "__module__", value.__name__)).partition(".")[0] in (_HOME, "perception", "planning")


def _constant(value: Any) -> str:
    """What tells a value apart. Of functions and classes it is the name."""
    if isinstance(value, (bool, int, float, str, tuple, np.generic)) or value is None:
        return repr(value)
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}"
    return f"{type(value).__name__} {getattr(value, '__name__', '')} {getattr(value, '_fields', '')}"
