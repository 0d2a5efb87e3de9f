# SPDX-License-Identifier: LGPL-3.0-or-later
"""Power series of the scalar coefficients of the Lie maps, in ``x = |theta|^2``.

With ``t = |theta|`` the coefficients are

    a = sin(t) / t,  b = (1 - cos(t)) / t^2,  c = (t - sin(t)) / t^3,
    e = 1 / t^2 - (1 + cos(t)) / (2 t sin(t)) = (1 - t/2 cot(t/2)) / t^2,

and their derivatives are taken as ``f1 = (df/dt) / t = 2 df/dx`` and ``f2 = 2 df1/dx``, which are
even and analytic like ``f`` itself. All tables hold the factor of ``x^k`` at place ``k``.
"""

from math import factorial, pi

__all__ = ["B1", "B2", "C1", "C2", "E1_REST", "E2_REST", "E_POLE", "E_REST", "B", "C", "derivative"]

# 4 * 12 * 11 * 4^10 / 27! < 1e-19 is the last term of C2 at x = 4: below rounding
_TERMS = 13


def derivative(series: tuple[float, ...]) -> tuple[float, ...]:
    """Series of ``2 df/dx`` from the series of ``f``."""
    return tuple(2.0 * k * series[k] for k in range(1, len(series)))


B = tuple((-1.0) ** k / factorial(2 * k + 2) for k in range(_TERMS))
C = tuple((-1.0) ** k / factorial(2 * k + 3) for k in range(_TERMS))
B1, C1 = derivative(B), derivative(C)
B2, C2 = derivative(B1), derivative(C1)

#: From the partial fractions of the cotangent, ``e = sum_n 2 / ((2 pi n)^2 - x)``. The first pole
#: is kept as it is, ``2 / (E_POLE - x)``, and the rest is a series that converges like ``16^-k`` up
#: to ``|theta| = pi``: no cancellation, no branch, no singular derivative anywhere in between.
E_POLE = 4.0 * pi**2

#: ``2 (zeta(2k + 2) - 1) / (4 pi^2)^(k + 1)``, from 60-digit arithmetic.
E_REST = (
    0.032672741512164447611,
    0.00010564110705334699024,
    5.6373702828768453026e-7,
    3.3571419266574513601e-9,
    2.0742872904166045537e-11,
    1.3000482138698973965e-13,
    8.1960520556910085984e-16,
    5.1801181961697243152e-18,
    3.2775391747017918398e-20,
    2.0747401878593604517e-22,
    1.3136241807166533778e-24,
    8.3180031951892640914e-27,
    5.2672629968342308728e-29,
    3.3354842988221443313e-31,
)
E1_REST = derivative(E_REST)
E2_REST = derivative(E1_REST)
