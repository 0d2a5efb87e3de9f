# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scalar coefficients of the Lie maps, compiled; see :mod:`flexfem.lie._series` for their names.

Below two radians the coefficients come from their series, so that nothing cancels there. Above, the
closed forms cancel only where a coefficient is small beside the others of its map. The coefficient
``e`` of the inverse tangent map has a series that holds up to pi.
"""

from math import cos, sin, sqrt

from flexfem.kernels.compiled import inlined
from flexfem.lie import _series

__all__ = [
    "Triple",
    "inverse_coefficient",
    "inverse_derivatives",
    "pose_coefficients",
    "relative_derivatives",
    "tangent_derivatives",
]

Triple = tuple[float, float, float]

_B, _C = _series.B, _series.C
_B1, _C1 = _series.B1, _series.C1
_B2, _C2 = _series.B2, _series.C2
_E, _E1, _E2 = _series.E_REST, _series.E1_REST, _series.E2_REST
_POLE = _series.E_POLE

#: Squared angle up to which the first terms of the series reach round-off: increments over a step
#: hardly ever exceed, in the loops over nodes.
_TINY = 0.03
_TERMS = 5
_B_TINY, _C_TINY, _E_TINY = _B[:_TERMS], _C[:_TERMS], _E[:_TERMS]
#: Squared angle up to which the series of a, b, c are used.
_SMALL = 4.0
#: Squared angle up to which the series of e is used (pi^2 and a little).
_MODERATE = 10.0


@inlined
def _horner(series: tuple[float, ...], x: float) -> float:
    value = series[-1]
    for k in range(len(series) - 2, -1, -1):
        value = value * x + series[k]
    return value


@inlined
def pose_coefficients(x: float) -> Triple:
    """``(a, b, c)`` at the squared angle ``x``."""
    if x < _TINY:
        c = _horner(_C_TINY, x)
        return 1.0 - x * c, _horner(_B_TINY, x), c
    if x < _SMALL:
        c = _horner(_C, x)
        return 1.0 - x * c, _horner(_B, x), c
    t = sqrt(x)
    s, h = sin(0.5 * t), cos(0.5 * t)
    a = 2.0 * s * h / t
    return a, 2.0 * s * s / x, (1.0 - a) / x


@inlined
def tangent_derivatives(x: float) -> tuple[Triple, Triple]:
    """``(b, b1, b2)`` and ``(c, c1, c2)`` at the squared angle ``x``."""
    a, b, c = pose_coefficients(x)
    if x < _SMALL:
        b1, c1 = _horner(_B1, x), _horner(_C1, x)
        return (b, b1, _horner(_B2, x)), (c, c1, _horner(_C2, x))
    a1 = c - b
    b1 = (a - 2.0 * b) / x
    c1 = (b - 3.0 * c) / x
    return (b, b1, (a1 - 4.0 * b1) / x), (c, c1, (b1 - 5.0 * c1) / x)


@inlined
def inverse_coefficient(x: float) -> float:
    """The first of :func:`inverse_derivatives`, quick for small angles."""
    if x < _TINY:
        return 2.0 / (_POLE - x) + _horner(_E_TINY, x)
    e, _, _ = inverse_derivatives(x)
    return e


@inlined
def relative_derivatives(x: float) -> Triple:
    """The next ones, of rotations by up to pi; ``x`` may be a vector of ``kernels.vectors``."""
    p = 1.0 / (_POLE - x)
    return (
        2.0 * p + _horner(_E, x),
        4.0 * p * p + _horner(_E1, x),
        16.0 * p * p * p + _horner(_E2, x),
    )


@inlined
def inverse_derivatives(x: float) -> Triple:
    """``(e, e1, e2)`` at the squared angle ``x``; they have poles at ``t = 2 pi n``, n > 0."""
    if x < _MODERATE:
        return relative_derivatives(x)
    t = sqrt(x)
    s = sin(0.5 * t)
    # g = t/2 cot(t/2), q = 1 / (2 b); (dg/dt)/t = (g - q)/x and (dq/dt)/t = 2 q e
    g = 0.5 * t * cos(0.5 * t) / s
    q = 0.25 * x / (s * s)
    e = (1.0 - g) / x
    e1 = (g - 2.0 + q) / (x * x)
    return e, e1, (((g - q) / x + 2.0 * q * e) / x - 4.0 * e1) / x
