# SPDX-License-Identifier: LGPL-3.0-or-later
"""``u . (x_b - x_a)``, u in inertial axes."""

from flexfem._types import FloatArray
from flexfem.constraints.terms.vectors import force_gradient, force_hessian, mean, put
from flexfem.core.nodes.step_kernels import add
from flexfem.core.row import RowKind
from flexfem.kernels.compiled import on_demand, subroutine
from flexfem.lie._blocks import dot, triple

__all__ = ["KIND", "hessian", "step_gradient", "value"]

KIND = int(RowKind.INERTIAL)


@subroutine
def value(Ha: FloatArray, Hb: FloatArray, d: FloatArray, g: FloatArray) -> float:
    """Value, and gradient in ``g``."""
    u, arm = triple(d[0], 0), add(triple(Hb, 0), -1.0, triple(Ha, 0))
    force_gradient(Ha, Hb, u, g)
    return dot(u, arm)


@on_demand
def hessian(Ha: FloatArray, Hb: FloatArray, d: FloatArray, h: FloatArray, s: FloatArray) -> None:
    """Derivative of the gradient."""
    force_hessian(Ha, Hb, d[0], h, s)


@subroutine
def step_gradient(s0: FloatArray, s1: FloatArray, out: FloatArray) -> None:
    """Discrete gradient: the constant u."""
    put(mean(triple(s0[1], 0), triple(s1[1], 0)), out, 0)
