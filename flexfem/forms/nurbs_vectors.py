# SPDX-License-Identifier: LGPL-3.0-or-later
"""Strains of a NURBS beam that interpolates relative rotation vectors, as UFL expressions.

The rotation vectors ``log(R_r^T R_I)`` of the control points relative to the reference node r are
interpolated by the shape functions (Crisfield, Jelenic, Proc. R. Soc. Lond. A 455 (1999)
1125-1147), and ``R(s) = R_r exp(v)``. With the right tangent map T the strains are

    gamma = exp(-v) y' - gamma_0,    kappa = T(v) v' - kappa_0 .

They are objective and do not depend on the path. Interpolated vectors are no longer than those of
the nodes, at most pi, so that all coefficients are polynomials. Where elements share more than an
end, each has its own reference node, and R jumps from one to the next by a little.

The unknowns of a point are ``(y', 0, v, 0, v')``, in the places of those of quaternions.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import factorial
from typing import Self

import ufl

from flexfem.forms.lie import Expr

__all__ = ["VectorKinematics"]

#: Terms of the series at up to pi^2: the first that is left out is 1e-18.
_TERMS = 14


def _series(shift: int) -> tuple[float, ...]:
    """Of the sum of ``(-x)^k / (2k + shift)!``."""
    return tuple((-1.0) ** k / factorial(2 * k + shift) for k in range(_TERMS))


def _sum(series: tuple[float, ...], x: Expr) -> Expr:
    value = ufl.as_ufl(series[-1])
    for factor in reversed(series[:-1]):
        value = value * x + factor
    return value


def _slope(series: tuple[float, ...]) -> tuple[float, ...]:
    """Of twice the derivative by ``x = t^2``, which is that by t over t."""
    return tuple(2.0 * k * a for k, a in enumerate(series) if k)


#: ``(1 - cos t) / t^2`` and ``(t - sin t) / t^3`` in powers of ``t^2``.
_B, _C = _series(2), _series(3)


@dataclass(frozen=True)
class VectorKinematics:
    """Kinematics made of y', v, v' and the coefficients of the maps at ``|v|^2``."""

    y: Expr
    v: Expr
    slope: Expr

    @classmethod
    def of(cls, unknowns: Expr) -> Self:
        """Kinematics at the unknowns p."""
        y, v, v_s = (ufl.as_vector([unknowns[first + i] for i in range(3)]) for first in (0, 4, 8))
        return cls(y, v, v_s)

    @classmethod
    def derivative(cls, vector: Callable[[Self], Expr], unknowns: Expr) -> Expr:
        """Derivative by the unknowns of a function of the kinematics."""
        p = ufl.variable(unknowns)
        return ufl.diff(vector(cls.of(p)), p)

    @property
    def _x(self) -> Expr:
        return ufl.dot(self.v, self.v)

    def _turned(self, sign: float, a: Expr) -> Expr:
        """``exp(+-v) a``."""
        p, x = ufl.cross(self.v, a), self._x
        return a + sign * (1 - x * _sum(_C, x)) * p + _sum(_B, x) * ufl.cross(self.v, p)

    def _map(self, sign: float, a: Expr) -> Expr:
        """``T(+-v) a``; T(-v) is the transpose."""
        p, x = ufl.cross(self.v, a), self._x
        return a - sign * _sum(_B, x) * p + _sum(_C, x) * ufl.cross(self.v, p)

    def strain(self) -> tuple[Expr, Expr]:
        """Both strains, those of the start included."""
        return self._turned(-1.0, self.y), self._map(1.0, self.slope)

    def rate(self, rates: Expr) -> Expr:
        """Change (6,) of the strains along rates (11,) of the unknowns."""
        y, u, u_s = (ufl.as_vector([rates[first + i] for i in range(3)]) for first in (0, 4, 8))
        gamma, x = self._turned(-1.0, self.y), self._x
        sheared = self._turned(-1.0, y) + ufl.cross(gamma, self._map(1.0, u))
        w = ufl.cross(self.v, self.slope)
        bent = self._map(1.0, u_s) - _sum(_B, x) * ufl.cross(u, self.slope)
        bent += _sum(_C, x) * (ufl.cross(u, w) + ufl.cross(self.v, ufl.cross(u, self.slope)))
        bent += ufl.dot(self.v, u) * self._along(w)
        return ufl.as_vector([*(sheared[i] for i in range(3)), *(bent[i] for i in range(3))])

    def _along(self, w: Expr) -> Expr:
        """Return the change of ``T v'`` by the coefficients of T, per ``v . dv``."""
        x = self._x
        return -_sum(_slope(_B), x) * w + _sum(_slope(_C), x) * ufl.cross(self.v, w)

    def force(self, stress: Expr) -> Expr:
        """Force (11,) of stress resultants (6,): the transpose of :meth:`rate`."""
        n, m = (ufl.as_vector([stress[first + i] for i in range(3)]) for first in (0, 3))
        gamma, x, w = self._turned(-1.0, self.y), self._x, ufl.cross(self.v, self.slope)
        turning = self._map(-1.0, ufl.cross(n, gamma)) - _sum(_B, x) * ufl.cross(self.slope, m)
        turning += _sum(_C, x) * (ufl.cross(w, m) + ufl.cross(self.slope, ufl.cross(m, self.v)))
        turning += ufl.dot(self._along(w), m) * self.v
        along, bent = self._turned(1.0, n), self._map(-1.0, m)
        parts = [[part[i] for i in range(3)] for part in (along, turning, bent)]
        return ufl.as_vector([*parts[0], 0, *parts[1], 0, *parts[2]])
