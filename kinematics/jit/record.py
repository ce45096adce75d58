"""Named tuples of arrays that compiled code takes as one pointer.

A motion query consists of some fifty arrays. As an ordinary named tuple numba hands them on as four hundred separate arguments, from
function to function and from Python at every call, and the compiler spends most of its time on that. A `record` is the same named tuple in
Python. Compiled code gets the address of a table with the address and the shape of every array (`kinematics.jit.record_type`), and reads
`task.exact.pairs` from there.

In compiled code a record is to be read: its arrays may be written to, its fields not be changed. An array taken from a record must not be
returned to Python, for nothing would keep its memory alive.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable
from ctypes import c_void_p
from functools import cached_property, lru_cache
from hashlib import sha256
from struct import pack, unpack
from typing import Any, TypeVar, cast

import numpy as np

from kinematics.jit.numpy_abi import DATA

Class = TypeVar("Class", bound=type)
Write = Callable[[Any, int], Any]
"""What writes a record's table, given the record and where the table is, and answers with a number that tells kinds of records apart."""
_brought: list[Callable[[], Write | None]] = []

_pointer = c_void_p.from_address
_SCALARS: dict[type, str] = {np.int64: "int", np.float64: "float", np.bool_: "bool"}
_KINDS: dict[tuple[Any, ...], int] = {}
ROOM = 128
"""Words of the longest table that `record_table` writes."""
_BLANK = array("q", bytes(8 * ROOM))
_TOLD: dict[tuple[type, int], int] = {}
"""The kinds of records, by what `record_table` says of them."""


def record(cls: Class) -> Class:
    """A decorator for a NamedTuple of numbers, C-contiguous arrays, other records, and tuples of records."""
    return cast(Class, type(cls.__name__, (Record, cls), {"__doc__": cls.__doc__, "__module__": cls.__module__}))


class Record:
    """What `record` adds to a named tuple."""

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy has arrays, and so a table, of its own."""
        return type(self), tuple(cast(Any, self))

    @cached_property
    def address(self) -> int:
        """Where the table starts. Its first word is the record's kind; then for an array its address and its shape, a word each; a number;
        another record's address."""
        write = _writer()
        if write is None:
            return self._written()
        table = _BLANK[:]
        at = table.buffer_info()[0]
        told = write(self, at)
        if told is NotImplemented:
            return self._written()
        kind = _TOLD.get((type(self), told))
        if kind is None:
            self._written()
            kind = _TOLD[type(self), told] = self.__dict__["type_hash"]
        table[0] = self.__dict__["type_hash"] = kind
        self.__dict__["table"] = table
        return at

    def _written(self) -> int:
        """The same in Python."""
        words, kinds = [0], list[Any]()
        for name, value in zip(cast(Any, self)._fields, cast(Any, self)):
            if isinstance(value, np.ndarray):
                if not value.flags.c_contiguous:
                    raise TypeError(f"{type(self).__name__}.{name} must be contiguous")
                words += [_pointer(id(value) + DATA).value or 0, *value.shape]  # as its `ctypes` says, in a tenth of the time
                kinds += [value.dtype.char, value.ndim]
            elif isinstance(value, tuple):
                several = value if type(value) is tuple else (value,)
                words += [cast(Any, r).address for r in several]
                kinds += [len(several), *(cast(Any, r).type_hash for r in several)]
            else:
                words.append(int(value) if isinstance(value, (int, np.integer)) else unpack("q", pack("d", value))[0])
                kinds.append(_SCALARS.get(type(value), type(value).__name__))
        words[0] = self.__dict__["type_hash"] = _hash_of(type(self), tuple(kinds))
        self.__dict__["table"] = table = array("q", words)
        return table.buffer_info()[0]

    @cached_property
    def type_hash(self) -> int:
        """A number that tells apart what compiled code has to tell apart: the class, and the types of all fields."""
        self.address  # noqa: B018  # which sets it
        return cast(int, self.__dict__["type_hash"])


def written_by(bring: Callable[[], Write | None]) -> None:
    """From now on tables are written by the function that `bring` has when the first one is asked for, see `record_table.writer`."""
    _brought.append(bring)


def _writer() -> Write | None:
    return _bring(_brought[-1]) if _brought else None


@lru_cache(maxsize=1)
def _bring(bring: Callable[[], Write | None]) -> Write | None:
    return bring()


def _hash_of(cls: type, fields: tuple[Any, ...]) -> int:
    key = (cls, *fields)
    found = _KINDS.get(key)
    if found is None:
        digest = sha256(repr((cls.__module__, cls.__qualname__, fields)).encode()).digest()
        found = _KINDS[key] = int.from_bytes(digest[:8], "little", signed=True)
    return found
