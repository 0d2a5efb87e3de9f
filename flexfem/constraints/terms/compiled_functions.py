# SPDX-License-Identifier: LGPL-3.0-or-later
"""User-defined functions compiled with their derivatives, called by address from kernels.

Every kind of function becomes a C function ``f(x, data, out)`` of arrays, with derivatives by
hyper-dual numbers (``kernels.users.hyperdual``):

- of the speed: ``x`` = (speed), ``out`` = (value, slope);
- forces: ``x`` = (x, v), ``data`` = (t, parameters), ``out`` = (F, dF/dx, dF/dv);
- of the relative pose: ``x`` = (p, R row by row, order), ``data`` = (component, parameters),
  ``out`` = the value, derivatives (6) along local twists (V, Omega) of the second marker and, of
  order 2, ``out[7 + 6 i + j]``, those of derivative i along twist j.

A function that fails leaves NaN.
"""

from collections.abc import Callable
from itertools import pairwise
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import ufl
from llvmlite import ir
from numba import carray, cfunc, njit, types
from numba.extending import intrinsic
from numba.np.unsafe.ndarray import to_fixed_tuple

from flexfem import _checks
from flexfem._faults import located
from flexfem._types import FloatArray
from flexfem.core.row import Term
from flexfem.core.user_function import FunctionKind, UserFunction
from flexfem.kernels.compiled import kernel
from flexfem.kernels.ffcx import tabulate
from flexfem.kernels.users.compiled_law import not_compiled
from flexfem.kernels.users.hyperdual import component, hyperdual
from flexfem.kernels.users.ufl_function import UFLFunction, uses_ufl
from flexfem.lie import se3

__all__ = ["address", "call", "check", "kind_number"]

_POINTER = types.CPointer(types.float64)
_SIGNATURE = types.void(_POINTER, _POINTER, _POINTER)
#: Value and first derivatives in ``out``.
_SIZES = {
    FunctionKind.SPEED: 2,
    FunctionKind.FORCE: 3,
    FunctionKind.POSE: 7,
    FunctionKind.CURVE: 3,
}
#: Step of differences, and tolerance of derivatives relative to these (curvature, round-off).
_STEP, _GAP = 1e-6, 1e-4
#: Where they differ by more, steps at which the difference must decrease by a factor of two each.
_STEPS = (100.0 * _STEP, _STEP, 0.01 * _STEP)

#: Compiled functions by the Python function, kind and number of parameters: addresses stay valid.
_KEPT: WeakKeyDictionary[Callable[..., Any], dict[tuple[FunctionKind, int], Any]] = (
    WeakKeyDictionary()
)
#: They are kept for the life of the process, since holders of their addresses may live as long.
_ALIVE: list[object] = []


@intrinsic
def _called(typingctx, address, x, data, out):  # type: ignore
    """Call the compiled function at ``address`` with three arrays of floats in C order."""
    signature = types.void(address, x, data, out)

    def codegen(context, builder, sig, arguments):  # type: ignore
        double = ir.DoubleType().as_pointer()
        function = ir.FunctionType(ir.VoidType(), [double] * 3)
        pointer = builder.inttoptr(arguments[0], function.as_pointer())
        arrays = zip(sig.args[1:], arguments[1:], strict=True)
        builder.call(
            pointer,
            [context.make_array(kind)(context, builder, value).data for kind, value in arrays],
        )
        return context.get_dummy_value()

    return signature, codegen


#: ``call(address, x, data, out)``: call a compiled function with three arrays of floats in C order
call: Any = _called
_fixed: Any = to_fixed_tuple


def address(user: UserFunction) -> int:
    """Address of the compiled function; it is compiled once a process.

    Raises:
        ValueError: it does not compile; the message names the function and the line.
    """
    kept = _KEPT.setdefault(user.function, {})
    key = user.kind, len(user.parameters)
    if key not in kept:
        kept[key] = _compiled(user)
        _ALIVE.append(kept[key])
    return int(kept[key].address)


def kind_number(term: Term) -> int:
    """Return the number of a term's function in compiled loops: a ``RowKind`` or an address."""
    return int(term.kind) if term.function is None else address(term.function)


def check(user: UserFunction, place: FloatArray, data: FloatArray) -> None:
    """Compile a function and compare its derivatives with differences at one place.

    Where a second derivative jumps, as that of ``x abs(x)`` at zero, differences are off by a part
    of the step, however large; at a jump or a corner they come no closer with smaller steps.

    Args:
        user: the function.
        place: its arguments: (1,) speed, (2,) x and v, (13,) relative pose and 1.
        data: (9,) time or component, and parameters.

    Raises:
        ValueError: it does not compile, is not finite, or has other derivatives than its
            differences, as where it jumps; the message names function, file and line.
    """
    size, name = _SIZES[user.kind], user.place
    out = np.empty(43)
    _call(address(user), place, data, out)
    found, slopes = out[1:size], _differences(user, place, data, _STEP)
    if not np.isfinite(out[:size]).all():
        values = _checks.show(out[:size].tolist())
        raise ValueError(
            f"{user.owner}: {user.what}: {name}: must have a finite value and finite "
            f"derivatives at the start, got {values}"
        )
    most = _GAP * max(1.0, float(np.abs(out[:size]).max()), float(np.abs(slopes).max()))
    off = np.abs(found - slopes) > most
    if not off.any():
        return
    gaps = [np.abs(found - _differences(user, place, data, step))[off] for step in _STEPS]
    closer = [after <= 0.5 * before for before, after in pairwise(gaps)]
    if not np.all(closer):
        raise ValueError(
            f"{user.owner}: {user.what}: {name}: derivatives {_checks.show(found.tolist())} at "
            f"the start differ from differences {_checks.show(slopes.tolist())}; is there a "
            "jump or a corner?"
        )


def _differences(
    user: UserFunction, place: FloatArray, data: FloatArray, step: float
) -> FloatArray:
    """Central differences of a function in all directions, shape (1,), (2,) or (6,)."""
    entry, ends = address(user), np.empty((2, 43))
    slopes = np.empty(_SIZES[user.kind] - 1)
    for k in range(len(slopes)):
        for end, sign in zip(ends, (1.0, -1.0), strict=True):
            _call(entry, _moved(user.kind, place, k, sign * step), data, end)
        slopes[k] = (ends[0, 0] - ends[1, 0]) / (2.0 * step)
    return slopes


@kernel
def _call(entry: int, x: FloatArray, data: FloatArray, out: FloatArray) -> None:
    call(entry, x, data, out)


def _moved(kind: FunctionKind, place: FloatArray, k: int, step: float) -> FloatArray:
    """Arguments moved along their k-th direction."""
    out: FloatArray = place.copy()
    if kind is not FunctionKind.POSE:
        out[k] = abs(place[k] + step) if kind is FunctionKind.SPEED else place[k] + step
        return out
    twist = np.zeros(6)
    twist[k] = step
    pose = se3.compose(place[:12], se3.exp(twist))
    out[:12] = pose
    return out


def _compiled(user: UserFunction) -> Any:
    if user.kind is not FunctionKind.POSE and uses_ufl(user.function):
        return _from_ufl(user)
    # where it fails, the caller finds NaN
    function = njit(error_model="numpy")(user.function)
    make = {
        FunctionKind.SPEED: _speed,
        FunctionKind.FORCE: _force,
        FunctionKind.POSE: _pose,
        FunctionKind.CURVE: _force,
    }[user.kind]
    try:
        return cfunc(_SIGNATURE, error_model="numpy")(make(function, user))
    except Exception as error:  # numba raises many kinds
        why = not_compiled(user.function, error)
        raise ValueError(f"{user.owner}: {user.what}: {why}") from error


def _from_ufl(user: UserFunction) -> Any:
    """The same of a function in UFL.

    Raises:
        ValueError: it does not return UFL expressions of UFL arguments.
    """
    kinematic = _SIZES[user.kind] - 1
    compiled = UFLFunction(kinematic + 1 + len(user.parameters))
    try:
        numbers = [compiled.x[i] for i in range(len(compiled.x))]
        parameters = tuple(numbers[kinematic + 1 :])
        given = [*numbers[: kinematic + (user.kind is FunctionKind.FORCE)], parameters]
        value = ufl.as_ufl(user.function(*given[: user.count]))
        compiled.compile([value, *compiled.slopes([value])[:kinematic]])
    except Exception as error:  # UFL raises many kinds
        why = located(user.function, error)
        raise ValueError(f"{user.owner}: {user.what}: {why}") from error
    _ALIVE.append(compiled)
    address, count, n = compiled.addresses[0], len(compiled.x), _SIZES[user.kind]

    def tabulated(x, data, out):  # type: ignore[no-untyped-def]
        values, given = np.zeros(n + 1), np.empty(count)
        given[:kinematic] = carray(x, (kinematic,))
        given[kinematic:] = carray(data, (count - kinematic,))
        tabulate(address, values, given, given, given)  # type: ignore[call-arg]
        for i in range(n):
            out[i] = values[1 + i]

    return cfunc(_SIGNATURE, error_model="numpy")(tabulated)


def _speed(function: Any, user: UserFunction) -> Callable[..., None]:
    def compiled(x, data, out):  # type: ignore[no-untyped-def]
        out[0] = out[1] = np.nan
        y = component(function(hyperdual(x[0], 1.0, 0.0, 0.0)), 0)
        out[0], out[1] = y.value, y.first

    return compiled


def _force(function: Any, user: UserFunction) -> Callable[..., None]:
    n = len(user.parameters)

    @njit(error_model="numpy")
    def one(x, v, data):  # type: ignore[no-untyped-def]
        return function(x)

    @njit(error_model="numpy")
    def two(x, v, data):  # type: ignore[no-untyped-def]
        return function(x, v)

    @njit(error_model="numpy")
    def three(x, v, data):  # type: ignore[no-untyped-def]
        return function(x, v, data[0])

    @njit(error_model="numpy")
    def four(x, v, data):  # type: ignore[no-untyped-def]
        return function(x, v, data[0], _fixed(data[1:], n))

    every = {1: one, 2: two, 3: three, 4: four}[user.count]

    def compiled(x, data, out):  # type: ignore[no-untyped-def]
        out[0] = out[1] = out[2] = np.nan
        given = carray(data, (n + 1,))
        first, second = hyperdual(x[0], 1.0, 0.0, 0.0), hyperdual(x[1], 0.0, 1.0, 0.0)
        y = component(every(first, second, given), 0)
        out[0], out[1], out[2] = y.value, y.first, y.second

    return compiled


@kernel
def _move(x: FloatArray, d: int, out: FloatArray) -> None:
    """Change ``out`` (12) of a pose (12) along the unit local twist ``d``."""
    for i in range(12):
        out[i] = 0.0
    if d < 3:
        for i in range(3):
            out[i] = x[3 + 3 * i + d]
        return
    i, j = (d + 1) % 3, (d + 2) % 3
    for k in range(3):
        out[3 + 3 * k + j] = -x[3 + 3 * k + i]
        out[3 + 3 * k + i] = x[3 + 3 * k + j]


@njit(error_model="numpy")
def _seed(x, a, b, both, i):  # type: ignore[no-untyped-def]
    return hyperdual(x[i], a[i], b[i], both[i])


def _pose(function: Any, user: UserFunction) -> Callable[..., None]:
    n = len(user.parameters)

    @njit(error_model="numpy")
    def two(p, R, data):  # type: ignore[no-untyped-def]
        return function(p, R)

    @njit(error_model="numpy")
    def three(p, R, data):  # type: ignore[no-untyped-def]
        return function(p, R, _fixed(data[1:], n))

    every = {2: two, 3: three}[user.count]

    @njit(error_model="numpy")
    def value(x, a, b, both, data):  # type: ignore[no-untyped-def]
        p = (_seed(x, a, b, both, 0), _seed(x, a, b, both, 1), _seed(x, a, b, both, 2))
        R = (
            (_seed(x, a, b, both, 3), _seed(x, a, b, both, 4), _seed(x, a, b, both, 5)),
            (_seed(x, a, b, both, 6), _seed(x, a, b, both, 7), _seed(x, a, b, both, 8)),
            (_seed(x, a, b, both, 9), _seed(x, a, b, both, 10), _seed(x, a, b, both, 11)),
        )
        return component(every(p, R, data), int(data[0]))

    def compiled(x, data, out):  # type: ignore[no-untyped-def]
        order = int(x[12])
        for i in range(43 if order == 2 else 7):
            out[i] = np.nan
        given, pose = carray(data, (n + 1,)), carray(x, (12,))
        first, second, both = np.zeros(12), np.zeros(12), np.zeros(12)
        for j in range(6):
            _move(pose, j, first)
            for i in range(6):
                if order == 1 and (j % 2 == 1 or i != j + 1):
                    continue
                _move(pose, i, second)
                _move(first, i, both)
                y = value(pose, first, second, both, given)
                out[0], out[1 + j], out[1 + i] = y.value, y.first, y.second
                if order == 2:
                    out[7 + 6 * i + j] = y.mixed

    return compiled
