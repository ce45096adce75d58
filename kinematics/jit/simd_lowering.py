"""What the operations of `kinematics.jit.simd` are to numba: LLVM's <16 x float>, one AVX-512 register or what the machine has instead."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils, types
from numba.core.typing import templates
from numba.extending import intrinsic, lower_builtin, models, register_model

from kinematics.jit.simd import WIDTH

_FLAGS = ("contract", "nsz", "reassoc", "arcp")
_VECTOR = ir.VectorType(ir.FloatType(), WIDTH)


_infer_global: Any = templates.infer_global  # numba's own functions are untyped
_signature: Any = templates.signature
_lower_builtin: Any = lower_builtin
_declared: Any = cgutils.get_or_insert_function


def _intrinsic(function: Callable[..., Any]) -> Any:
    return intrinsic(function)


class Float32x16(types.Type):
    """The type of such a value."""

    def __init__(self) -> None:
        super().__init__(name="float32x16")


float32x16 = Float32x16()


@register_model(Float32x16)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, fe_type: Any) -> None:
        super().__init__(manager, fe_type, _VECTOR)  # type: ignore[no-untyped-call]


def _repeat(builder: Any, value: Any) -> Any:
    one = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(one, ir.Constant(_VECTOR, ir.Undefined), ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH))


def _arithmetic(op: Any, instruction: str) -> None:
    @_infer_global(op)
    class _Template(templates.AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            if len(args) == 2 and float32x16 in args and all(a in (float32x16, types.float32) for a in args):
                return _signature(float32x16, *args)
            return None

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        a, b = (x if t == float32x16 else _repeat(builder, x) for x, t in zip(args, sig.args, strict=True))
        return getattr(builder, instruction)(a, b, flags=_FLAGS)

    for pair in ((float32x16, float32x16), (float32x16, types.float32), (types.float32, float32x16)):
        _lower_builtin(op, *pair)(lower)


for _op, _instruction in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul"), (operator.truediv, "fdiv")):
    _arithmetic(_op, _instruction)


def _address(context: Any, builder: Any, array_type: Any, array: Any, index: Any) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), _VECTOR.as_pointer())


@_intrinsic
def load(typing: Any, array: Any, index: Any) -> Any:
    """The 16 numbers array[index:index + 16]."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        value = builder.load(_address(context, builder, sig.args[0], args[0], args[1]))
        value.align = 4
        return value

    return float32x16(array, types.uint64), code


@_intrinsic
def store(typing: Any, array: Any, index: Any, value: Any) -> Any:
    """array[index:index + 16] = value."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.store(args[2], _address(context, builder, sig.args[0], args[0], args[1]), align=4)
        return context.get_dummy_value()

    return types.void(array, types.uint64, float32x16), code


@_intrinsic
def spread(typing: Any, x: Any) -> Any:
    """x in every lane."""
    return float32x16(types.float32), lambda context, builder, sig, args: _repeat(builder, args[0])


@_intrinsic
def below(typing: Any, a: Any, b: Any) -> Any:
    """A bit per lane, the lowest for lane 0: whether a < b, or either is not a number. b may be one float32 for all."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        b = args[1] if sig.args[1] == float32x16 else _repeat(builder, args[1])
        bits = builder.bitcast(builder.fcmp_unordered("<", args[0], b), ir.IntType(WIDTH))
        return builder.zext(bits, ir.IntType(64))

    return types.uint64(float32x16, float32x16 if b == float32x16 else types.float32), code


@_intrinsic
def largest(typing: Any, a: Any, b: Any) -> Any:
    """The larger one, lane by lane; b may be one float32 for all."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        b = args[1] if sig.args[1] == float32x16 else _repeat(builder, args[1])
        return builder.select(builder.fcmp_unordered("<", args[0], b), b, args[0])

    return float32x16(float32x16, float32x16 if b == float32x16 else types.float32), code


@_intrinsic
def chosen(typing: Any, bits: Any, a: Any, b: Any) -> Any:
    """a in the lanes whose bit is set, b in the others."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        lanes = builder.bitcast(builder.trunc(args[0], ir.IntType(WIDTH)), ir.VectorType(ir.IntType(1), WIDTH))
        return builder.select(lanes, args[1], args[2])

    return float32x16(types.uint64, float32x16, float32x16), code


def _unary(builder: Any, name: str, value: Any) -> Any:
    function = _declared(builder.module, ir.FunctionType(_VECTOR, [_VECTOR]), f"llvm.{name}.v{WIDTH}f32")
    return builder.call(function, [value])


@_intrinsic
def size(typing: Any, a: Any) -> Any:
    """The absolute value."""
    return float32x16(float32x16), lambda context, builder, sig, args: _unary(builder, "fabs", args[0])


@_intrinsic
def root(typing: Any, a: Any) -> Any:
    """The square root."""
    return float32x16(float32x16), lambda context, builder, sig, args: _unary(builder, "sqrt", args[0])


@_intrinsic
def nearest_int(typing: Any, a: Any) -> Any:
    """The nearest whole number."""
    return float32x16(float32x16), lambda context, builder, sig, args: _unary(builder, "rint", args[0])
