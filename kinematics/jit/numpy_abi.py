"""Where objects, arrays and dtypes say in memory what they are: CPython's and numpy's ABI (PyArrayObject_fields in ndarraytypes.h)."""

from __future__ import annotations

import ctypes

import numpy as np

_HEADER = object.__basicsize__
TYPE = _HEADER - 8
"""Where an object says of what type it is."""
DATA, NDIM, SHAPE, STRIDES, DESCR, FLAGS = (_HEADER + at for at in (0, 8, 16, 24, 40, 48))
"""Where an array says where its numbers are, and so on."""
SIZE, ITEMS = _HEADER, _HEADER + 8
"""Where a tuple says how many items it has, and where these are."""
BYTE_ORDER, TYPE_NUMBER = _HEADER + 10, _HEADER + 12
"""Where a dtype does."""
CONTIGUOUS, ALIGNED = 0x1, 0x100
"""Of an array's flags."""


def layout_known() -> bool:
    """Whether arrays, dtypes and tuples are laid out in memory as this module says."""
    a, pair = np.arange(6.0).reshape(2, 3), (object(), object())
    word, small = ctypes.c_uint64.from_address, ctypes.c_int32.from_address
    base = id(a)
    descr = word(base + DESCR).value
    return (
        word(base + TYPE).value == id(np.ndarray)
        and word(base + DATA).value == a.ctypes.data
        and small(base + NDIM).value == 2
        and word(word(base + SHAPE).value + 8).value == 3
        and word(word(base + STRIDES).value).value == 24
        and descr == id(a.dtype)
        and small(base + FLAGS).value == a.flags.num
        and small(descr + TYPE_NUMBER).value == a.dtype.num
        and [word(id(pair) + at).value for at in (SIZE, ITEMS, ITEMS + 8)] == [2, *map(id, pair)]
        and ctypes.c_char.from_address(descr + BYTE_ORDER).value == b"="
    )
