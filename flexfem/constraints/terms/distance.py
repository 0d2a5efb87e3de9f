# SPDX-License-Identifier: LGPL-3.0-or-later
"""``|x_b - x_a|``."""

import numpy as np

from flexfem._types import FloatArray
from flexfem.constraints.terms.vectors import (
    add_block,
    force_gradient,
    force_hessian,
    mean,
    product,
    put,
    scaled,
)
from flexfem.core.nodes.step_kernels import add
from flexfem.core.row import RowKind
from flexfem.kernels.compiled import on_demand, subroutine
from flexfem.lie._blocks import dot, triple
from flexfem.lie._coefficients import Triple

__all__ = ["KIND", "hessian", "step_change", "step_gradient", "value"]

KIND = int(RowKind.DISTANCE)


@subroutine
def value(Ha: FloatArray, Hb: FloatArray, g: FloatArray) -> float:
    """Value, and gradient in ``g``."""
    arm = add(triple(Hb, 0), -1.0, triple(Ha, 0))
    length: float = np.sqrt(dot(arm, arm))
    force_gradient(Ha, Hb, scaled(1.0 / length, arm), g)
    return length


@on_demand
def hessian(
    Ha: FloatArray, Hb: FloatArray, Ra: FloatArray, Rb: FloatArray, h: FloatArray, s: FloatArray
) -> None:  # fmt: skip
    """Derivative of the gradient: both the direction and the axes change."""
    direction, length = s[0], 0.0
    for i in range(3):
        direction[i] = Hb[i] - Ha[i]
        length += direction[i] * direction[i]
    length = np.sqrt(length)
    P = np.empty((3, 3))
    for i in range(3):
        direction[i] /= length
    for i in range(3):
        for j in range(3):
            P[i, j] = ((1.0 if i == j else 0.0) - direction[i] * direction[j]) / length
    PRa, PRb = product(P, Ra), product(P, Rb)
    RaT, RbT = Ra.T.copy(), Rb.T.copy()
    add_block(h, 0, 0, 1.0, product(RaT, PRa))
    add_block(h, 0, 6, -1.0, product(RaT, PRb))
    add_block(h, 6, 0, -1.0, product(RbT, PRa))
    add_block(h, 6, 6, 1.0, product(RbT, PRb))
    force_hessian(Ha, Hb, direction, h, s)


@subroutine
def step_gradient(
    s0: FloatArray, s1: FloatArray, value0: float, value1: float, out: FloatArray
) -> None:
    """Discrete gradient: the sum of both arms over that of their lengths."""
    arm, scale = mean(triple(s0[0], 0), triple(s1[0], 0)), 2.0 / (value0 + value1)
    put((scale * arm[0], scale * arm[1], scale * arm[2]), out, 0)


@subroutine
def step_change(
    s0: FloatArray, s1: FloatArray, value0: float, value1: float, shift: Triple, out: FloatArray
) -> None:
    """Derivative of the discrete gradient."""
    arm, total = mean(triple(s0[0], 0), triple(s1[0], 0)), value0 + value1
    grown = dot(triple(s1[0], 0), shift) / value1
    f = add(shift, -2.0 * grown / total, arm)
    put((f[0] / total, f[1] / total, f[2] / total), out, 0)
