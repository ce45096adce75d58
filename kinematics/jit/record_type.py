"""What compiled code sees of a record: numba's type of it, how its fields are read, and how it is taken from Python."""

from __future__ import annotations

from typing import Any, cast

from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils, types
from numba.core.typing import templates
from numba.core.typing.typeof import typeof_impl
from numba.extending import NativeValue, lower_getattr_generic, models, register_model, unbox

from kinematics.jit.record import Record

WORD = ir.IntType(64)
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


class RecordType(types.Type):
    """Numba's type of a record: its class, the types of its fields, and its hash, see `Record.type_hash`."""

    def __init__(self, cls: type, fields: tuple[types.Type, ...], type_hash: int) -> None:
        self.cls, self.fields, self.type_hash = cls, fields, type_hash
        super().__init__(name=f"{cls.__name__}:{type_hash & 0xFFFFFFFF:08x}")  # short, as it becomes part of every symbol

    @property
    def key(self) -> Any:
        """What tells this type from others."""
        return self.cls, self.fields

    def place(self, name: str) -> tuple[Any, int]:
        """A field's type, and the word of the table where it begins."""
        at = cast(Any, self.cls)._fields.index(name)
        return self.fields[at], 1 + sum(_words(f) for f in self.fields[:at])


def _words(field: Any) -> int:
    return 1 + field.ndim if isinstance(field, types.Array) else field.count if isinstance(field, types.UniTuple) else 1


@_on_typeof(Record)  # type: ignore[untyped-decorator]
def _typeof_record(value: Any, context: Any) -> RecordType:
    return RecordType(type(value), tuple(_field_type(_typeof(x, context)) for x in value), value.type_hash)


def _field_type(found: Any) -> Any:
    """Arrays that may be written to and those that may not are one type, lest every function be compiled for both."""
    return types.Array(found.dtype, found.ndim, "C") if isinstance(found, types.Array) else found


@register_model(RecordType)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, fe_type: Any) -> None:
        super().__init__(manager, fe_type, WORD.as_pointer())  # type: ignore[no-untyped-call]


@_infer_getattr
class _Attributes(_Template):  # type: ignore[misc]
    key = RecordType

    def generic_resolve(self, record_type: RecordType, name: str) -> Any:
        return record_type.place(name)[0] if name in cast(Any, record_type.cls)._fields else None


@_lower_getattr(RecordType)  # type: ignore[untyped-decorator]
def _read(context: Any, builder: Any, record_type: RecordType, table: Any, name: str) -> Any:
    field, first = record_type.place(name)

    def word(i: int, as_type: Any = WORD) -> Any:
        address = builder.gep(table, [ir.Constant(ir.IntType(32), first + i)])
        loaded = builder.load(builder.bitcast(address, as_type.as_pointer()))
        loaded.set_metadata("invariant.load", builder.module.add_metadata([]))  # so that no store to an array makes LLVM read it again
        return loaded

    if isinstance(field, types.Array):
        data = word(0, context.get_data_type(field.dtype).as_pointer())
        return make_array(context, builder, field, data, [word(1 + i) for i in range(field.ndim)])
    if isinstance(field, types.UniTuple):
        return context.make_tuple(builder, field, [word(i, WORD.as_pointer()) for i in range(field.count)])
    return word(0, context.get_value_type(field))


def make_array(context: Any, builder: Any, array_type: Any, data: Any, shape: list[Any], strides: list[Any] | None = None) -> Any:
    """An array that owns nothing; without strides it is contiguous."""
    array = context.make_array(array_type)(context, builder)
    item = ir.Constant(WORD, context.get_abi_sizeof(context.get_data_type(array_type.dtype)))
    if strides is None:
        strides, size = [], item
        for extent in reversed(shape):
            strides.insert(0, size)
            size = builder.mul(size, extent)
    context.populate_array(
        array,
        data=data,
        shape=_pack(builder, shape, WORD),
        strides=_pack(builder, strides, WORD),
        itemsize=item,
        meminfo=None,
    )
    return array._getvalue()


@_unbox(RecordType)  # type: ignore[untyped-decorator]
def _unbox_record(record_type: RecordType, value: Any, c: Any) -> Any:
    number = c.pyapi.object_getattr_string(value, "address")
    failed = _is_null(c.builder, number)
    table = _alloca(c.builder, ir.Constant(WORD.as_pointer(), None))
    with c.builder.if_then(c.builder.not_(failed)):
        c.builder.store(c.builder.bitcast(c.pyapi.long_as_voidptr(number), WORD.as_pointer()), table)
        c.pyapi.decref(number)
    return _native(c.builder.load(table), is_error=failed)
