# SPDX-License-Identifier: LGPL-3.0-or-later
"""Barrier of contacts: a potential that is infinite where two primitives would touch.

With the gap g and q = g / dhat < 1 it is, over an area,

    b = -kappa dhat^2 (q - 1)^2 ln q,

and zero beyond: twice continuously differentiable (Li and others, Incremental potential contact,
2020; scaled with dhat, so that kappa is a stiffness per volume).
"""

import numpy as np

from flexfem.kernels.compiled import inlined

__all__ = ["barrier", "curvature", "quotient", "secant", "slope"]

#: Gaps that differ by less than this part of the smaller one count as equal.
_EQUAL = 1e-7
#: The same for its slope.
_NEARLY = 1e-4


@inlined
def barrier(gap: float, dhat: float, kappa: float) -> float:
    """Potential, J/m^2; infinite for gaps that are not positive."""
    if gap >= dhat:
        return 0.0
    if gap <= 0.0:
        return np.inf
    q = gap / dhat
    return float(-kappa * dhat * dhat * (q - 1.0) ** 2 * np.log(q))


@inlined
def slope(gap: float, dhat: float, kappa: float) -> float:
    """Derivative by the gap, N/m^2: negative, and minus infinity for gaps not positive."""
    if gap >= dhat:
        return 0.0
    if gap <= 0.0:
        return -np.inf
    q = gap / dhat
    return float(-kappa * dhat * (q - 1.0) * (2.0 * np.log(q) + (q - 1.0) / q))


@inlined
def curvature(gap: float, dhat: float, kappa: float) -> float:
    """Second derivative by the gap, N/m^3: positive, and infinite for gaps not positive."""
    if gap >= dhat:
        return 0.0
    if gap <= 0.0:
        return np.inf
    q = gap / dhat
    rest = (q - 1.0) / q
    return float(-kappa * (2.0 * np.log(q) + 4.0 * rest - rest * rest))


@inlined
def quotient(before: float, after: float, change: float, dhat: float, kappa: float) -> float:
    """Difference quotient of the barrier by the gap."""
    if abs(after - before) <= _EQUAL * min(before, after):
        return slope(0.5 * (before + after), dhat, kappa)
    return change / (after - before)


@inlined
def secant(before: float, after: float, change: float, dhat: float, kappa: float) -> float:
    """Derivative of the difference quotient by the gap at the end; not negative."""
    way = after - before
    if abs(way) <= _NEARLY * min(before, after):
        return 0.5 * curvature(0.5 * (before + after), dhat, kappa)
    return max((slope(after, dhat, kappa) * way - change) / (way * way), 0.0)
