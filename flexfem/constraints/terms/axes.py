# SPDX-License-Identifier: LGPL-3.0-or-later
"""``R_a u . R_b v``."""

from flexfem._types import FloatArray
from flexfem.constraints.terms.vectors import (
    add_block,
    mean,
    multiply,
    product,
    put,
    skew,
)
from flexfem.core.nodes.step_kernels import add, turn, turn_back
from flexfem.core.row import RowKind
from flexfem.kernels.compiled import on_demand, subroutine
from flexfem.lie._blocks import cross, dot, triple
from flexfem.lie._coefficients import Triple

__all__ = ["KIND", "hessian", "step_change", "step_gradient", "value"]

KIND = int(RowKind.AXES)


@subroutine
def value(Ha: FloatArray, Hb: FloatArray, d: FloatArray, g: FloatArray) -> float:
    """Value, and gradient in ``g``."""
    u, v = triple(d[0], 0), triple(d[1], 0)
    axis, other = turn(Ha, u), turn(Hb, v)
    put(cross(u, turn_back(Ha, other)), g, 3)
    put(cross(v, turn_back(Hb, axis)), g, 9)
    return dot(axis, other)


@on_demand
def hessian(Rab: FloatArray, Rba: FloatArray, d: FloatArray, h: FloatArray, s: FloatArray) -> None:
    """Derivative of the gradient."""
    u, v = d[0], d[1]
    multiply(Rab, v, s[0])
    multiply(Rba, u, s[1])
    U, V = skew(u), skew(v)
    add_block(h, 3, 9, -1.0, product(U, product(Rab, V)))
    add_block(h, 3, 3, 1.0, product(U, skew(s[0])))
    add_block(h, 9, 3, -1.0, product(V, product(Rba, U)))
    add_block(h, 9, 9, 1.0, product(V, skew(s[1])))


@subroutine
def step_gradient(s0: FloatArray, s1: FloatArray, out: FloatArray) -> None:
    """Discrete gradient: opposite moments of the mean axes."""
    axis = mean(triple(s0[1], 0), triple(s1[1], 0))
    other = mean(triple(s0[4], 0), triple(s1[4], 0))
    put(cross(axis, other), out, 3)
    put(cross(other, axis), out, 6)


@subroutine
def step_change(s0: FloatArray, s1: FloatArray, ta: Triple, tb: Triple, out: FloatArray) -> None:
    """Derivative of the discrete gradient."""
    nothing = (0.0, 0.0, 0.0)
    axis = mean(triple(s0[1], 0), triple(s1[1], 0))
    other = mean(triple(s0[4], 0), triple(s1[4], 0))
    da = add(nothing, 0.5, cross(ta, triple(s1[1], 0)))
    db = add(nothing, 0.5, cross(tb, triple(s1[4], 0)))
    m = add(cross(da, other), 1.0, cross(axis, db))
    put(m, out, 3)
    put((-m[0], -m[1], -m[2]), out, 6)
