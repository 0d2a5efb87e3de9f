# SPDX-License-Identifier: LGPL-3.0-or-later
"""Hyper-dual numbers in compiled code: exact first and second derivatives of functions.

A number ``x = x_0 + x_1 e_1 + x_2 e_2 + x_12 e_1 e_2`` with ``e_1^2 = e_2^2 = 0`` carries the
derivatives along two directions and the mixed second one through every operation (Fike and Alonso
2011, AIAA 2011-886), without differences and their round-off. A plain Python function
of numbers that numba compiles takes them as they are: operators, comparisons (of values), and the
functions of ``math`` and NumPy listed in ``_UNARY``, ``atan2``, ``hypot``, ``min`` and ``max``.
"""

import builtins
import math
import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from numba.core import cgutils, types
from numba.core.typeconv import Conversion
from numba.extending import (
    intrinsic,
    lower_cast,
    make_attribute_wrapper,
    models,
    overload,
    register_jitable,
    register_model,
)

__all__ = ["HyperDual", "component", "hyperdual", "promoted"]

_PARTS = ("value", "first", "second", "mixed")


class HyperDual(types.Type):
    """Type of hyper-dual numbers for numba; four floats."""

    def __init__(self) -> None:
        """Set the name of the type, of which there is only one."""
        super().__init__(name="HyperDual")

    def can_convert_from(self, typingctx: Any, other: Any) -> Any:
        """Convert constants to numbers with zero derivatives, as in sums that begin with zero."""
        return Conversion.promote if isinstance(other, types.Number | types.Boolean) else None

    def unify(self, typingctx: Any, other: Any) -> Any:
        """Type of variables with constants or such numbers: such numbers."""
        return self if isinstance(other, types.Number | types.Boolean | HyperDual) else None


_TYPE = HyperDual()


@register_model(HyperDual)
class _Model(models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, [(part, types.float64) for part in _PARTS])


for _part in _PARTS:
    make_attribute_wrapper(HyperDual, _part, _part)


@intrinsic
def _made(typingctx, value, first, second, mixed):  # type: ignore
    """The number with these four parts."""

    def codegen(context, builder, signature, arguments):  # type: ignore
        out = cgutils.create_struct_proxy(_TYPE)(context, builder)
        for part, argument in zip(_PARTS, arguments, strict=True):
            setattr(out, part, argument)
        return out._getvalue()

    return _TYPE(types.float64, types.float64, types.float64, types.float64), codegen


#: ``hyperdual(value, first, second, mixed)``: the number with these four parts
hyperdual: Any = _made


@lower_cast(types.Number, HyperDual)
@lower_cast(types.Boolean, HyperDual)
def _lowered(context: Any, builder: Any, given: Any, wanted: Any, value: Any) -> Any:
    out = cgutils.create_struct_proxy(_TYPE)(context, builder)
    for part in _PARTS:
        setattr(out, part, context.get_constant(types.float64, 0.0))
    out.value = context.cast(builder, value, given, types.float64)
    return out._getvalue()


def _bare[F: Callable[..., Any]](function: F) -> F:
    """A function without annotations: numba compares signatures of overloads literally."""
    function.__annotations__ = {}
    return function


def _overload(function: Any) -> Callable[[Callable[..., Any]], object]:
    """Register numba's implementation of ``function`` with arguments of certain types."""
    return lambda typed: overload(function)(_bare(typed))


def promoted(x: Any) -> Any:
    """The number, or the constant ``x`` as a hyper-dual number."""
    raise NotImplementedError


@_overload(promoted)
def _promoted(x: Any) -> Any:
    if isinstance(x, HyperDual):
        return lambda x: x
    if isinstance(x, types.Number | types.Boolean):
        return lambda x: hyperdual(float(x), 0.0, 0.0, 0.0)
    return None


def component(result: Any, k: int) -> Any:
    """The k-th number of a tuple, as a hyper-dual one; a number counts as a tuple of one."""
    raise NotImplementedError


@_overload(component)
def _component(result: Any, k: Any) -> Any:
    if not isinstance(result, types.BaseTuple):
        return lambda result, k: promoted(result)
    if len(result) == 1:
        return lambda result, k: promoted(result[0])
    return lambda result, k: promoted(result[0]) if k == 0 else component(result[1:], k - 1)


def _is_number(*kinds: Any) -> bool:
    """Return True if one is hyper-dual and the others are that, or plain real numbers."""
    plain = (HyperDual, types.Float, types.Integer, types.Boolean)
    return any(isinstance(kind, HyperDual) for kind in kinds) and all(
        isinstance(kind, plain) for kind in kinds
    )


def _binary(function: Callable[..., Any], rule: Callable[..., Any]) -> None:
    """Overload a function of two numbers by a rule for hyper-dual ones."""
    rule = register_jitable(rule)

    @_overload(function)
    def typed(a: Any, b: Any) -> Any:
        if _is_number(a, b):
            return lambda a, b: rule(promoted(a), promoted(b))
        return None


@register_jitable
def _chain(x: Any, f: float, slope: float, curvature: float) -> Any:
    """A function of a number, given its value and two derivatives."""
    return hyperdual(
        f, slope * x.first, slope * x.second, slope * x.mixed + curvature * x.first * x.second
    )


def _add(a: Any, b: Any) -> Any:
    return hyperdual(a.value + b.value, a.first + b.first, a.second + b.second, a.mixed + b.mixed)


def _subtract(a: Any, b: Any) -> Any:
    return hyperdual(a.value - b.value, a.first - b.first, a.second - b.second, a.mixed - b.mixed)


@register_jitable
def _multiply(a: Any, b: Any) -> Any:
    return hyperdual(
        a.value * b.value,
        a.first * b.value + a.value * b.first,
        a.second * b.value + a.value * b.second,
        a.mixed * b.value + a.first * b.second + a.second * b.first + a.value * b.mixed,
    )


def _divide(a: Any, b: Any) -> Any:
    r = 1.0 / b.value
    return _multiply(a, _chain(b, r, -r * r, 2.0 * r * r * r))


def _arctan2(y: Any, x: Any) -> Any:
    """Derivatives are those of ``(x dy - y dx) / (x^2 + y^2)``."""
    square = x.value * x.value + y.value * y.value
    fx, fy = -y.value / square, x.value / square
    fxx = 2.0 * x.value * y.value / (square * square)
    fxy = (y.value * y.value - x.value * x.value) / (square * square)
    return hyperdual(
        math.atan2(y.value, x.value),
        fx * x.first + fy * y.first,
        fx * x.second + fy * y.second,
        fx * x.mixed + fy * y.mixed + fxx * (x.first * x.second - y.first * y.second)
        + fxy * (x.first * y.second + x.second * y.first),
    )  # fmt: skip


def _hypot(a: Any, b: Any) -> Any:
    return math.sqrt(a * a + b * b)


def _larger(a: Any, b: Any) -> Any:
    return a if a.value >= b.value else b


def _smaller(a: Any, b: Any) -> Any:
    return a if a.value <= b.value else b


def _real_power(a: Any, b: Any) -> Any:
    return math.exp(b * math.log(a))


for _function, _rule in (
    (operator.add, _add),
    (operator.iadd, _add),
    (operator.sub, _subtract),
    (operator.isub, _subtract),
    (operator.mul, _multiply),
    (operator.imul, _multiply),
    (operator.truediv, _divide),
    (operator.itruediv, _divide),
    (math.atan2, _arctan2),
    (np.arctan2, _arctan2),
    (math.hypot, _hypot),
    (np.hypot, _hypot),
    (builtins.max, _larger),
    (builtins.min, _smaller),
    (np.maximum, _larger),
    (np.minimum, _smaller),
):
    _binary(_function, _rule)


def _power(a: Any, b: Any) -> Any:
    if not _is_number(a, b):
        return None
    if isinstance(b, HyperDual):
        rule = register_jitable(_real_power)
        return lambda a, b: rule(promoted(a), b)

    def constant(a: Any, b: Any) -> Any:
        n, x = float(b), a.value
        slope = 0.0 if n == 0.0 else n * x ** (n - 1.0)
        curvature = 0.0 if n == 0.0 or n == 1.0 else n * (n - 1.0) * x ** (n - 2.0)
        return _chain(a, x**n, slope, curvature)

    return _bare(constant)


for _function in (operator.pow, operator.ipow, builtins.pow, np.power):
    _overload(_function)(_power)


def _compare(function: Any) -> None:
    """Overload a comparison by that of the values."""

    @_overload(function)
    def typed(a: Any, b: Any) -> Any:
        if _is_number(a, b):
            return lambda a, b: function(promoted(a).value, promoted(b).value)
        return None


for _function in (
    operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne
):  # fmt: skip
    _compare(_function)


def _unary(names: tuple[Callable[..., Any], ...], rule: Callable[..., Any]) -> None:
    """Overload functions of one number by ``rule(value) -> (value, slope, curvature)``."""
    rule = register_jitable(rule)
    for name in names:

        @_overload(name)
        def typed(x: Any) -> Any:
            if not isinstance(x, HyperDual):
                return None

            def impl(x: Any) -> Any:
                f, slope, curvature = rule(x.value)
                return _chain(x, f, slope, curvature)

            return _bare(impl)


def _sqrt(x: float) -> tuple[float, float, float]:
    root = math.sqrt(x)
    return root, 0.5 / root, -0.25 / (root * x)


def _tan(x: float) -> tuple[float, float, float]:
    t = math.tan(x)
    return t, 1.0 + t * t, 2.0 * t * (1.0 + t * t)


def _asin(x: float) -> tuple[float, float, float]:
    r = 1.0 / math.sqrt(1.0 - x * x)
    return math.asin(x), r, x * r * r * r


def _acos(x: float) -> tuple[float, float, float]:
    r = 1.0 / math.sqrt(1.0 - x * x)
    return math.acos(x), -r, -x * r * r * r


def _atan(x: float) -> tuple[float, float, float]:
    r = 1.0 / (1.0 + x * x)
    return math.atan(x), r, -2.0 * x * r * r


def _tanh(x: float) -> tuple[float, float, float]:
    t = math.tanh(x)
    return t, 1.0 - t * t, -2.0 * t * (1.0 - t * t)


def _log1p(x: float) -> tuple[float, float, float]:
    r = 1.0 / (1.0 + x)
    return math.log1p(x), r, -r * r


def _abs(x: float) -> tuple[float, float, float]:
    return abs(x), (1.0 if x >= 0.0 else -1.0), 0.0


#: Functions of one number, and their rules for value, slope and curvature.
_UNARY: tuple[tuple[tuple[Any, ...], Callable[[float], tuple[float, float, float]]], ...] = (
    ((operator.neg,), lambda x: (-x, -1.0, 0.0)),
    ((operator.pos, builtins.float), lambda x: (x, 1.0, 0.0)),
    ((builtins.abs, math.fabs, np.abs, np.fabs), _abs),
    ((math.sqrt, np.sqrt), _sqrt),
    ((math.sin, np.sin), lambda x: (math.sin(x), math.cos(x), -math.sin(x))),
    ((math.cos, np.cos), lambda x: (math.cos(x), -math.sin(x), -math.cos(x))),
    ((math.tan, np.tan), _tan),
    ((math.asin, np.arcsin), _asin),
    ((math.acos, np.arccos), _acos),
    ((math.atan, np.arctan), _atan),
    ((math.sinh, np.sinh), lambda x: (math.sinh(x), math.cosh(x), math.sinh(x))),
    ((math.cosh, np.cosh), lambda x: (math.cosh(x), math.sinh(x), math.cosh(x))),
    ((math.tanh, np.tanh), _tanh),
    ((math.exp, np.exp), lambda x: (math.exp(x), math.exp(x), math.exp(x))),
    ((math.expm1, np.expm1), lambda x: (math.expm1(x), math.exp(x), math.exp(x))),
    ((math.log, np.log), lambda x: (math.log(x), 1.0 / x, -1.0 / (x * x))),
    ((math.log1p, np.log1p), _log1p),
    ((np.square,), lambda x: (x * x, 2.0 * x, 2.0)),
    ((np.sign,), lambda x: (float(np.sign(x)), 0.0, 0.0)),
)
for _names, _expansion in _UNARY:
    _unary(_names, _expansion)
