# SPDX-License-Identifier: LGPL-3.0-or-later
"""``R_a u . (x_b - x_a)``."""

from flexfem._types import FloatArray
from flexfem.constraints.terms.vectors import (
    add_block,
    force_gradient,
    mean,
    multiply,
    product,
    put,
    rotate_back_into,
    skew,
    skew_into,
)
from flexfem.core.nodes.step_kernels import add, turn, turn_back
from flexfem.core.row import RowKind
from flexfem.kernels.compiled import on_demand, subroutine
from flexfem.lie._blocks import cross, dot, triple
from flexfem.lie._coefficients import Triple

__all__ = ["KIND", "hessian", "step_change", "step_gradient", "value"]

KIND = int(RowKind.ALONG)


@subroutine
def value(Ha: FloatArray, Hb: FloatArray, d: FloatArray, g: FloatArray) -> float:
    """Value, and gradient in ``g``."""
    u = triple(d[0], 0)
    p = turn_back(Ha, add(triple(Hb, 0), -1.0, triple(Ha, 0)))  # R_a^T (x_b - x_a)
    put(cross(u, p), g, 3)
    force_gradient(Ha, Hb, turn(Ha, u), g)
    return dot(u, p)


@on_demand
def hessian(
    Ha: FloatArray, Hb: FloatArray, Rab: FloatArray, Rba: FloatArray, d: FloatArray,
    h: FloatArray, s: FloatArray,
) -> None:  # fmt: skip
    """Derivative of the gradient."""
    u = d[0]
    for i in range(3):
        s[0, i] = Hb[i] - Ha[i]
    rotate_back_into(Ha, s[0], s[1], 0)
    multiply(Rba, u, s[2])
    U = skew(u)
    add_block(h, 3, 6, 1.0, product(U, Rab))
    add_block(h, 3, 0, -1.0, U)
    add_block(h, 3, 3, 1.0, product(U, skew(s[1])))
    add_block(h, 6, 3, -1.0, product(Rba, U))
    skew_into(s[2], 1.0, h, 6, 9)


@subroutine
def step_gradient(s0: FloatArray, s1: FloatArray, out: FloatArray) -> None:
    """Discrete gradient: the mean axis, and its moment with the mean arm on a."""
    arm = mean(triple(s0[0], 0), triple(s1[0], 0))
    axis = mean(triple(s0[1], 0), triple(s1[1], 0))
    put(axis, out, 0)
    put(cross(axis, arm), out, 3)


@subroutine
def step_change(s0: FloatArray, s1: FloatArray, shift: Triple, ta: Triple, out: FloatArray) -> None:
    """Derivative of the discrete gradient."""
    arm = mean(triple(s0[0], 0), triple(s1[0], 0))
    axis = mean(triple(s0[1], 0), triple(s1[1], 0))
    da = add((0.0, 0.0, 0.0), 0.5, cross(ta, triple(s1[1], 0)))
    put(da, out, 0)
    put(add(cross(da, arm), 0.5, cross(axis, shift)), out, 3)
