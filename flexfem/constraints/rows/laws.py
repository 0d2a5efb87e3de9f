# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled force laws of rows: force, and its slopes with respect to value and rate."""

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.constraints.terms.compiled_functions import call
from flexfem.core.laws import LawKind
from flexfem.kernels.compiled import kernel, subroutine

__all__ = [
    "CAPSTAN",
    "CURVE",
    "ELEMENT",
    "FUNCTION",
    "LIMIT",
    "PRESS",
    "RIGID",
    "SPRING",
    "elastic_part",
    "force_law",
    "function_beyond",
    "static_forces",
    "stored",
]

(
    RIGID,
    SPRING,
    LIMIT,
    FUNCTION,
    FRICTION,
    NORMAL_FRICTION,
    ELEMENT,
    CURVE,
    PRESS,
    CAPSTAN,
    POTENTIAL,
) = (int(kind) for kind in LawKind)
#: Rule for the energy of a function: panels, and points and weights in each.
_PANELS = 8
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(6)
#: Part of the largest exponent at which the tangent of a cable's friction is still taken.
_MOST = 1.5


@subroutine
def _limit(law: FloatArray, value: float, rate: float, out: FloatArray) -> None:
    k, c, lower, upper = law[1], law[2], law[3], law[4]
    if value > upper:
        depth, sign = value - upper, 1.0
    elif value < lower:
        depth, sign = lower - value, -1.0
    else:
        out[:] = 0.0
        return
    ratio = sign * c * rate / (k * depth)
    part = np.tanh(ratio)
    slope = 1.0 - part * part
    turning = ratio * slope if abs(ratio) < 20.0 else 0.0  # infinity times zero at first contact
    out[0] = sign * k * depth * (1.0 + part)
    out[1] = k * (1.0 + part - turning)
    out[2] = c * slope
    out[3] = 0.0


@subroutine
def function_beyond(
    law: FloatArray, function: int, data: FloatArray, value: float, rate: float, out: FloatArray
) -> None:
    """Force of a function beyond a slack range; one that presses does not pull."""
    beyond = value - min(max(value, law[3]), law[4])
    out[:] = 0.0
    if beyond == 0.0 and law[3] < law[4]:
        return
    sign = -1.0 if law[0] == PRESS and beyond < 0.0 else 1.0
    given = np.empty(2)
    given[0], given[1] = sign * beyond, sign * rate
    call(function, given, data, out)
    out[3] = 0.0
    if law[0] == PRESS and out[0] < 0.0:
        out[:] = 0.0
    out[0] *= sign


@subroutine
def _point_on_tanh(weight: float, z: float) -> float:
    """Solution y of ``weight y + tanh(y) = z``.

    For z > 0 the left side is concave: Newton's method from zero rises to the solution.
    """
    size, y = abs(z), 0.0
    for _ in range(60):
        t = np.tanh(y)
        step = (size - weight * y - t) / (weight + 1.0 - t * t)
        y += step
        if step <= 1e-15 * y:
            break
    return y if z > 0.0 else -y


@subroutine
def _friction(
    limit: float, velocity: float, viscous: float, rate: float, force: float, out: FloatArray
) -> None:
    """Tangent of ``F = limit tanh(rate / velocity) + viscous rate`` near an iterate.

    At a sliding velocity the law is flat, so that Newton's method would repeatedly overshoot when a
    body comes to rest. The tangent is therefore taken at that point of the curve on which force and
    rate together project, the rate scaled to the force: the iteration tries sticking where both
    disagree, as an active-set method does. On the curve it is the law itself.
    """
    if limit <= 0.0:
        out[0], out[1], out[2], out[3] = viscous * rate, 0.0, viscous, 0.0
        return
    y = rate / velocity
    weight = 1.0 / (1.0 + abs(y))
    at = _point_on_tanh(weight, weight * y + (force - viscous * rate) / limit)
    t = np.tanh(at)
    slope = 1.0 - t * t
    part = t + slope * (y - at)
    out[0] = limit * part + viscous * rate
    out[1] = 0.0
    out[2] = limit * slope / velocity + viscous
    out[3] = min(max(part, -1.0), 1.0)


@subroutine
def _capstan(
    exponent: float, velocity: float, rate: float, force: float, tension: float, out: FloatArray
) -> None:
    """Friction around a guide: ``ln(1 + F/T) = exponent tanh(rate / velocity)``.

    The tangent is taken where force and rate together project on the curve, as in ``_friction``.
    """
    if tension <= 0.0 or exponent <= 0.0:
        out[:] = 0.0
        return
    y = rate / velocity
    weight = 1.0 / (1.0 + abs(y))
    least = np.exp(-_MOST * exponent)
    part = np.log(max(1.0 + force / tension, least)) / exponent
    at = _point_on_tanh(weight, weight * y + min(part, _MOST))
    t = np.tanh(at)
    slope = 1.0 - t * t
    part = min(max(t + slope * (y - at), -_MOST), _MOST)
    ratio = np.exp(exponent * part)
    out[0] = tension * (ratio - 1.0)
    out[1] = 0.0
    out[2] = tension * ratio * exponent * slope / velocity
    out[3] = ratio - 1.0


@subroutine
def force_law(
    law: FloatArray, function: int, data: FloatArray, value: float, rate: float, force: float,
    normal: float, out: FloatArray,
) -> None:  # fmt: skip
    """Force of a row in ``out``: (F, dF/dvalue, dF/drate, dF/dnormal), see ``LawKind``.

    Args:
        law: (5,) kind, stiffness, damping and two more.
        function: address of a user-defined function, 0 for none.
        data: (9,) time and parameters of that function.
        value: value of the row, less its target.
        rate: its time derivative.
        force: present iterate of the force.
        normal: normal force for ``NORMAL_FRICTION``, tension for ``CAPSTAN``.
        out: (4,).
    """
    if law[0] == SPRING:
        out[0] = law[3] + law[1] * value + law[2] * rate
        out[1], out[2], out[3] = law[1], law[2], 0.0
    elif law[0] == LIMIT:
        _limit(law, value, rate, out)
    elif law[0] == CURVE or law[0] == PRESS:
        function_beyond(law, function, data, value, rate, out)
    elif law[0] == FUNCTION:
        given = np.empty(2)
        given[0], given[1] = value, rate
        call(function, given, data, out)
        out[3] = 0.0
    elif law[0] == FRICTION or law[0] == NORMAL_FRICTION:
        press, size, slope = 1.0, law[3], 0.0
        if law[0] == NORMAL_FRICTION:
            press = normal
        if function != 0:
            given, found = np.empty(1), np.empty(2)
            given[0] = abs(rate)
            call(function, given, data, found)
            slope = size * press * (found[1] if rate >= 0.0 else -found[1])
            size *= found[0]
        _friction(size * press, law[4], law[2], rate, force, out)
        out[2] += slope * out[3]
        out[3] = size * out[3] if law[0] == NORMAL_FRICTION else 0.0
    elif law[0] == POTENTIAL:
        out[0], out[1], out[2], out[3] = law[3], 0.0, 0.0, 0.0
    elif law[0] == CAPSTAN:
        _capstan(law[3], law[4], rate, force, normal, out)
    else:
        out[:] = np.nan


@kernel
def static_forces(
    laws: FloatArray, functions: IntArray, data: FloatArray, values: FloatArray, out: FloatArray
) -> None:
    """Forces at rest and their slopes in ``out`` (r, 2).

    They are zero for rigid rows, for friction and for laws of whole elements.
    """
    force = np.empty(4)
    out[:] = 0.0
    for r in range(values.size):
        kind = laws[r, 0]
        if kind not in (RIGID, FRICTION, NORMAL_FRICTION, ELEMENT, CAPSTAN):
            force_law(laws[r], functions[r], data[r], values[r], 0.0, 0.0, 0.0, force)
            out[r, 0], out[r, 1] = force[0], force[1]


@subroutine
def stored(law: FloatArray, function: int, data: FloatArray, value: float) -> float:
    """Energy of a function: the integral of its force at rest, by Gauss's rule in panels."""
    rest = min(max(value, law[3]), law[4])
    half, total, out = 0.5 * (value - rest) / _PANELS, 0.0, np.empty(4)
    if half == 0.0:
        return 0.0
    for panel in range(_PANELS):
        for k in range(_POINTS.size):
            at = rest + half * (2 * panel + 1 + _POINTS[k])
            function_beyond(law, function, data, at, 0.0, out)
            total += half * _WEIGHTS[k] * out[0]
    return total


@kernel
def elastic_part(
    laws: FloatArray, functions: IntArray, data: FloatArray, active: BoolArray,
    values: FloatArray, energies: FloatArray, pulls: FloatArray,
) -> None:  # fmt: skip
    """Stored energy and elastic force of every row; zero for rigid and released ones.

    Functions of the time and laws of whole elements count as work, friction as dissipation.
    """
    out = np.empty(4)
    for r in range(active.size):
        kind, stretch = int(laws[r, 0]), 0.0
        pulls[r] = energies[r] = 0.0
        if not active[r]:
            continue
        if kind in (CURVE, PRESS):
            function_beyond(laws[r], functions[r], data[r], values[r], 0.0, out)
            pulls[r] = out[0]
            energies[r] = stored(laws[r], functions[r], data[r], values[r])
            continue
        if kind == SPRING:
            stretch = values[r]
        elif kind == LIMIT:
            stretch = values[r] - min(max(values[r], laws[r, 3]), laws[r, 4])
        elif kind == POTENTIAL:
            pulls[r], energies[r] = laws[r, 3], laws[r, 3] * values[r]
            continue
        elif kind > POTENTIAL:
            stretch = np.nan
        pulls[r] = laws[r, 1] * stretch
        energies[r] = 0.5 * pulls[r] * stretch
