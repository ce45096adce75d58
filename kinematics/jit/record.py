"""Named tuples of arrays that compiled code takes as one pointer.

A motion query consists of some fifty arrays. As an ordinary named tuple numba hands them on as four hundred separate arguments, from
function to function and from Python at every call, and the compiler spends most of its time on that. A `record` is the same named tuple in
Python. Compiled code gets the address of a table with the address and the shape of every array, and reads `task.exact.pairs` from there.

In compiled code a record is to be read: its arrays may be written to, its fields not be changed. An array taken from a record must not be
returned to Python, for nothing would keep its memory alive.
"""

from __future__ import annotations

from array import array
from ctypes import c_void_p
from functools import cached_property
from struct import pack, unpack
from typing import Any, TypeVar, cast
from zlib import crc32

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils, types
from numba.core.typing import templates
from numba.core.typing.typeof import typeof_impl
from numba.extending import NativeValue, lower_getattr_generic, models, register_model, unbox

Class = TypeVar("Class", bound=type)

_WORD = ir.IntType(64)
_pointer = c_void_p.from_address
_DATA = object.__basicsize__
"""Where an array object says where its numbers are: right after Python's own header, a part of numpy's ABI (ndarraytypes.h). Its `ctypes`
says the same in ten times the time, and a motion query is dozens of arrays."""
_typeof: Any = typeof_impl
_on_typeof: Any = typeof_impl.register  # numba's own functions are untyped
_infer_getattr: Any = templates.infer_getattr
_lower_getattr: Any = lower_getattr_generic
_unbox: Any = unbox
_pack: Any = cgutils.pack_array
_Template: Any = templates.AttributeTemplate
_native: Any = NativeValue
_is_null: Any = cgutils.is_null
_alloca: Any = cgutils.alloca_once_value


def record(cls: Class) -> Class:
    """A decorator for a NamedTuple of numbers, C-contiguous arrays, other records, and tuples of records."""
    return cast(Class, type(cls.__name__, (_Record, cls), {"__doc__": cls.__doc__, "__module__": cls.__module__}))


class _Record:
    """What `record` adds to a named tuple."""

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy has arrays, and so a table, of its own."""
        return type(self), tuple(cast(Any, self))

    @cached_property
    def address(self) -> int:
        """Where the table starts: for an array its address and its shape, a word each; a number; another record's address."""
        words: list[int] = []
        for name, value in zip(cast(Any, self)._fields, cast(Any, self)):
            if isinstance(value, np.ndarray):
                if not value.flags.c_contiguous:
                    raise TypeError(f"{type(self).__name__}.{name} must be contiguous")
                words += [_pointer(id(value) + _DATA).value or 0, *value.shape]
            elif isinstance(value, tuple):
                words += [cast(Any, r).address for r in (value if type(value) is tuple else [value])]
            else:
                words.append(int(value) if isinstance(value, (int, np.integer)) else unpack("q", pack("d", value))[0])
        self.__dict__["table"] = table = array("q", words)
        return table.buffer_info()[0]


class RecordType(types.Type):
    """Numba's type of a record: its class, and the types of its fields."""

    def __init__(self, cls: type, fields: tuple[types.Type, ...]) -> None:
        self.cls, self.fields = cls, fields
        super().__init__(name=f"{cls.__name__}:{crc32(repr(fields).encode()):08x}")  # short, as it becomes part of every symbol

    @property
    def key(self) -> Any:
        return self.cls, self.fields

    def place(self, name: str) -> tuple[Any, int]:
        """A field's type, and the word of the table where it begins."""
        at = cast(Any, self.cls)._fields.index(name)
        return self.fields[at], sum(_words(f) for f in self.fields[:at])


def _words(field: Any) -> int:
    return 1 + field.ndim if isinstance(field, types.Array) else field.count if isinstance(field, types.UniTuple) else 1


@_on_typeof(_Record)  # type: ignore[untyped-decorator]
def _typeof_record(value: Any, context: Any) -> RecordType:
    return RecordType(type(value), tuple(_field_type(_typeof(x, context)) for x in value))


def _field_type(found: Any) -> Any:
    """Arrays that may be written to and those that may not are one type, lest every function be compiled for both."""
    return types.Array(found.dtype, found.ndim, "C") if isinstance(found, types.Array) else found


@register_model(RecordType)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, fe_type: Any) -> None:
        super().__init__(manager, fe_type, _WORD.as_pointer())  # type: ignore[no-untyped-call]


@_infer_getattr
class _Attributes(_Template):  # type: ignore[misc]
    key = RecordType

    def generic_resolve(self, record_type: RecordType, name: str) -> Any:
        return record_type.place(name)[0] if name in cast(Any, record_type.cls)._fields else None


@_lower_getattr(RecordType)  # type: ignore[untyped-decorator]
def _read(context: Any, builder: Any, record_type: RecordType, table: Any, name: str) -> Any:
    field, first = record_type.place(name)

    def word(i: int, as_type: Any = _WORD) -> Any:
        address = builder.gep(table, [ir.Constant(ir.IntType(32), first + i)])
        loaded = builder.load(builder.bitcast(address, as_type.as_pointer()))
        loaded.set_metadata("invariant.load", builder.module.add_metadata([]))  # so that no store to an array makes LLVM read it again
        return loaded

    if isinstance(field, types.Array):
        return _array(context, builder, field, word)
    if isinstance(field, types.UniTuple):
        return context.make_tuple(builder, field, [word(i, _WORD.as_pointer()) for i in range(field.count)])
    return word(0, context.get_value_type(field))


def _array(context: Any, builder: Any, field: Any, word: Any) -> Any:
    """An array that owns nothing."""
    array = context.make_array(field)(context, builder)
    shape = [word(1 + i) for i in range(field.ndim)]
    item = ir.Constant(_WORD, context.get_abi_sizeof(context.get_data_type(field.dtype)))
    strides: list[Any] = []
    size = item
    for extent in reversed(shape):
        strides.insert(0, size)
        size = builder.mul(size, extent)
    context.populate_array(
        array,
        data=word(0, context.get_data_type(field.dtype).as_pointer()),
        shape=_pack(builder, shape, _WORD),
        strides=_pack(builder, strides, _WORD),
        itemsize=item,
        meminfo=None,
    )
    return array._getvalue()


@_unbox(RecordType)  # type: ignore[untyped-decorator]
def _unbox_record(record_type: RecordType, value: Any, c: Any) -> Any:
    number = c.pyapi.object_getattr_string(value, "address")
    failed = _is_null(c.builder, number)
    table = _alloca(c.builder, ir.Constant(_WORD.as_pointer(), None))
    with c.builder.if_then(c.builder.not_(failed)):
        c.builder.store(c.builder.bitcast(c.pyapi.long_as_voidptr(number), _WORD.as_pointer()), table)
        c.pyapi.decref(number)
    return _native(c.builder.load(table), is_error=failed)
