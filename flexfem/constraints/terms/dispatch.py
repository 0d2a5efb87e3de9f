# SPDX-License-Identifier: LGPL-3.0-or-later
"""All elementary functions by their kind: a new one is a module here, and its lines below.

``kind`` is a ``RowKind`` or the address of a compiled user-defined function; ``d`` (3, 3) holds u,
v and p, or the data of that function, see ``Term``. Gradients (12) are along the local twists of
both markers, discrete ones (9) the force on b (on a: opposite) and the moments on a and b.

A discrete gradient gives a term's change over a step exactly, ``g . (increments of its nodes)``:
terms are products of positions and directions fixed to the markers, for which averages of both ends
give this identity if nodes rotate by the Cayley map (see ``core.nodes.step_kernels``).
"""

from math import atan2, sqrt

import numpy as np

import flexfem.constraints.terms.along as along
import flexfem.constraints.terms.angle as angle
import flexfem.constraints.terms.axes as axes
import flexfem.constraints.terms.catenary as catenary
import flexfem.constraints.terms.distance as distance
import flexfem.constraints.terms.inertial as inertial
import flexfem.constraints.terms.span as span
from flexfem._types import FloatArray
from flexfem.constraints.terms.function import evaluate_function, function_hessian
from flexfem.constraints.terms.vectors import put
from flexfem.core.nodes.step_kernels import add, turn
from flexfem.core.row import RowKind
from flexfem.kernels.compiled import kernel, subroutine
from flexfem.lie._blocks import cross, dot, triple
from flexfem.lie._coefficients import Triple

__all__ = ["step_change", "step_gradient", "step_vectors", "term", "term_hessian"]

_INERTIAL, _ALONG, _AXES, _DISTANCE, _ANGLE = (int(kind) for kind in tuple(RowKind)[:5])
_TWIST, _SPAN, _TOUCH, _CATENARY, _FUNCTION = (int(kind) for kind in tuple(RowKind)[6:])


@kernel
def term(
    kind: int, Ha: FloatArray, Hb: FloatArray, d: FloatArray, memory: float, g: FloatArray,
    s: FloatArray,
) -> float:  # fmt: skip
    """Value of a function; its gradient in ``g`` (12), scratch ``s`` (5, 3).

    ``memory`` is the last angle, with which the value is continuous.
    """
    if kind >= _FUNCTION:
        own: float = evaluate_function(kind, Ha, Hb, d, g)
        return own
    g[:] = 0.0
    if kind == _TWIST:
        g[int(d[0, 0])] = 1.0
        return 0.0
    if kind in (_SPAN, _TOUCH, _CATENARY):
        if kind == _CATENARY:
            catenary.evaluate(Ha, Hb, d, s[0], g)
        else:
            span.evaluate(kind, Ha, Hb, d, memory, s[0], g)
        value: float = s[0, 0]
        return value
    if kind == _AXES:
        return axes.value(Ha, Hb, d, g)
    if kind == _ANGLE:
        return angle.value(Ha, Hb, d, memory, g)
    if kind == _ALONG:
        return along.value(Ha, Hb, d, g)
    if kind == _DISTANCE:
        return distance.value(Ha, Hb, g)
    return inertial.value(Ha, Hb, d, g)


@subroutine
def term_hessian(kind: int, Ha: FloatArray, Hb: FloatArray, d: FloatArray, h: FloatArray) -> None:
    """Derivative of a gradient (12) along the local twists (12) in ``h`` (12, 12).

    It is not symmetric: increments of rotation do not commute.
    """
    if kind >= _FUNCTION:
        function_hessian(kind, Ha, Hb, d, h)
        return
    if kind in (_SPAN, _TOUCH):
        span.hessian(kind, Ha, Hb, d, h)
        return
    if kind == _CATENARY:
        catenary.hessian(Ha, Hb, d, h)
        return
    h[:] = 0.0
    if kind == _TWIST:
        return
    turns, s = np.empty((4, 3, 3)), np.empty((5, 3))
    Ra, Rb, Rab, Rba = turns
    for i in range(3):
        for j in range(3):
            Ra[i, j], Rb[i, j] = Ha[3 + 3 * i + j], Hb[3 + 3 * i + j]
    for i in range(3):
        for j in range(3):
            Rab[i, j] = Ra[0, i] * Rb[0, j] + Ra[1, i] * Rb[1, j] + Ra[2, i] * Rb[2, j]
            Rba[j, i] = Rab[i, j]
    if kind == _AXES:
        axes.hessian(Rab, Rba, d, h, s)
    elif kind == _ANGLE:
        angle.hessian(Rab, Rba, d, h)
    elif kind == _ALONG:
        along.hessian(Ha, Hb, Rab, Rba, d, h, s)
    elif kind == _DISTANCE:
        distance.hessian(Ha, Hb, Ra, Rb, h, s)
    else:
        inertial.hessian(Ha, Hb, d, h, s)


@subroutine
def step_vectors(
    kind: int, a: FloatArray, b: FloatArray, d: FloatArray, memory: float, out: FloatArray
) -> float:
    """Value of a function at one end of a step; the vectors of its products in ``out`` (5, 3).

    ``out`` has the arm between the markers, R_a u, R_a p, R_a (u x p) and R_b v.
    """
    u, v, p = triple(d[0], 0), triple(d[1], 0), triple(d[2], 0)
    arm = add(triple(b, 0), -1.0, triple(a, 0))
    put(arm, out[0], 0)
    axis = u if kind == _INERTIAL else turn(a, u)
    put(axis, out[1], 0)
    put(turn(a, p), out[2], 0)
    put(turn(a, cross(u, p)), out[3], 0)
    other = turn(b, v)
    put(other, out[4], 0)
    if kind == _AXES:
        return dot(axis, other)
    if kind == _DISTANCE:
        return sqrt(dot(arm, arm))
    if kind == _ANGLE:
        cosine, sine = dot(triple(out[2], 0), other), dot(triple(out[3], 0), other)
        return angle.wrapped(atan2(sine, cosine), memory)
    return dot(axis, arm)


@subroutine
def step_gradient(
    kind: int, s0: FloatArray, s1: FloatArray, value0: float, value1: float, out: FloatArray
) -> None:
    """Discrete gradient in inertial axes in ``out`` (9), from the vectors at both ends."""
    out[:] = 0.0
    if kind == _AXES:
        axes.step_gradient(s0, s1, out)
    elif kind == _ANGLE:
        angle.step_gradient(s0, s1, value1 - value0, out)
    elif kind == _DISTANCE:
        distance.step_gradient(s0, s1, value0, value1, out)
    elif kind == _ALONG:
        along.step_gradient(s0, s1, out)
    else:
        inertial.step_gradient(s0, s1, out)


@subroutine
def step_change(
    kind: int, s0: FloatArray, s1: FloatArray, value0: float, value1: float, shift: Triple,
    turns: tuple[Triple, Triple], out: FloatArray,
) -> None:  # fmt: skip
    """Derivative of :func:`step_gradient` by the arm and by rotations of a and b at the end."""
    ta, tb = turns
    out[:] = 0.0
    if kind == _AXES:
        axes.step_change(s0, s1, ta, tb, out)
    elif kind == _ANGLE:
        angle.step_change(s0, s1, value1 - value0, ta, tb, out)
    elif kind == _DISTANCE:
        distance.step_change(s0, s1, value0, value1, shift, out)
    elif kind == _ALONG:
        along.step_change(s0, s1, shift, ta, out)
