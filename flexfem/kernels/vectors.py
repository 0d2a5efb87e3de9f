# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numbers of ``LANES`` cells in one register, for hand-written kernels.

Arithmetic in compiled loops takes them like floats: code for one cell evaluates ``LANES`` cells at
once, without relying on the compiler's vectoriser. :func:`load` reads and :func:`store` writes an
entry of arrays in which the values of lane l of entry k are at ``k LANES + l``, as in batched
kernels.
"""

import math
import operator
from typing import Any, ClassVar

from llvmlite import ir
from numba.core import types
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typeconv import Conversion
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, models, register_model
from numba.np.arrayobj import make_array

from flexfem._types import FloatArray
from flexfem.kernels.compiled import inlined
from flexfem.kernels.lanes import LANES

__all__ = ["add_to", "load", "store"]

_REGISTER = ir.VectorType(ir.DoubleType(), LANES)


class _VectorType(types.Type):
    """Numba's type of these numbers."""

    def __init__(self) -> None:
        super().__init__(f"Vector({LANES})")

    def unify(self, typingctx: Any, other: Any) -> Any:
        """Type of a variable that is a number first and a vector later: a vector."""
        return self if isinstance(other, types.Number) else None

    def can_convert_from(self, typingctx: Any, other: Any) -> Any:
        """Convert a number to a vector with this number in all lanes."""
        return Conversion.safe if isinstance(other, types.Number) else None


_VECTOR = _VectorType()


@register_model(_VectorType)
class _VectorModel(models.PrimitiveModel):
    """Data model."""

    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, _REGISTER)


def _spread(builder: Any, value: Any) -> Any:
    """A number in all lanes."""
    one = builder.insert_element(ir.Constant(_REGISTER, ir.Undefined), value, _index(0))
    order = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(one, ir.Constant(_REGISTER, ir.Undefined), order)


def _index(value: int) -> Any:
    return ir.Constant(ir.IntType(32), value)


@lower_cast(types.Number, _VECTOR)
def _cast_number(context: Any, builder: Any, fromty: Any, toty: Any, value: Any) -> Any:
    return _spread(builder, context.cast(builder, value, fromty, types.float64))


class _Binary(ConcreteTemplate):
    """Types of operations of two vectors, or a vector and a number."""

    cases: ClassVar = [
        signature(_VECTOR, _VECTOR, _VECTOR),
        signature(_VECTOR, _VECTOR, types.float64),
        signature(_VECTOR, types.float64, _VECTOR),
    ]


class _Unary(ConcreteTemplate):
    """Types of operations of one vector."""

    cases: ClassVar = [signature(_VECTOR, _VECTOR)]


def _lower_binary(function: Any, name: str) -> None:
    """Register the code of an operation on all lanes."""
    infer_global(function)(type("_Vectors", (_Binary,), {}))

    def lower(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        both = [
            value if kind == _VECTOR else _spread(builder, value)
            for kind, value in zip(sig.args, arguments, strict=True)
        ]
        return getattr(builder, name)(*both)

    for case in _Binary.cases:
        lower_builtin(function, *case.args)(lower)


for _names, _instruction in (
    ("add iadd", "fadd"), ("sub isub", "fsub"), ("mul imul", "fmul"), ("truediv itruediv", "fdiv")
):  # fmt: skip
    for _name in _names.split():
        _lower_binary(getattr(operator, _name), _instruction)


@lower_builtin(operator.neg, _VECTOR)
def _negative(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
    return builder.fneg(arguments[0])


@lower_builtin(math.sqrt, _VECTOR)
def _root(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
    kind = ir.FunctionType(_REGISTER, [_REGISTER])
    name = f"llvm.sqrt.v{LANES}f64"
    root = builder.module.globals.get(name) or ir.Function(builder.module, kind, name)
    return builder.call(root, arguments)


for _function in (operator.neg, math.sqrt):
    infer_global(_function)(type("_Vectors", (_Unary,), {}))


def _place(context: Any, builder: Any, kind: Any, array: Any, at: Any) -> Any:
    """Pointer to the numbers of an entry of an array."""
    data = make_array(kind)(context, builder, array).data
    first = builder.mul(at, ir.Constant(at.type, LANES))
    return builder.bitcast(builder.gep(data, [first]), _REGISTER.as_pointer())


@intrinsic
def _load(typingctx, array, at):  # type: ignore
    def codegen(context, builder, sig, arguments):  # type: ignore
        place = _place(context, builder, sig.args[0], *arguments)
        return builder.load(place, align=8)

    return _VECTOR(array, types.intp), codegen


@intrinsic
def _store(typingctx, array, at, value):  # type: ignore
    def codegen(context, builder, sig, arguments):  # type: ignore
        place = _place(context, builder, sig.args[0], *arguments[:2])
        builder.store(arguments[2], place, align=8)
        return context.get_dummy_value()

    return types.void(array, types.intp, _VECTOR), codegen


@inlined
def load(array: FloatArray, at: int) -> Any:
    """The entry ``at`` of all lanes."""
    return _load(array, at)  # type: ignore[call-arg]


@inlined
def store(array: FloatArray, at: int, value: Any) -> None:
    """Write the entry ``at`` of all lanes."""
    _store(array, at, value)  # type: ignore[call-arg]


@inlined
def add_to(array: FloatArray, at: int, value: Any) -> None:
    """Add to the entry ``at`` of all lanes."""
    _store(array, at, _load(array, at) + value)  # type: ignore[call-arg]
