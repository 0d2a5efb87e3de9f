# SPDX-License-Identifier: LGPL-3.0-or-later
"""UFL forms of the geometrically exact beam on NURBS, at one quadrature point.

An element of degree p lies between p + 1 control points with frames ``(x_I, R_I)``. Relative to the
reference node r, the places ``y_I = R_r^T (x_I - x_r)`` and the unit quaternions ``q_I`` of ``R_r^T
R_I`` are interpolated by the rational shape functions, and ``R(s) = R_r R(q)`` is the rotation by
``q / |q|``. With ' for the derivative by the arc length of the start, the strains (Simo 1985,
Reissner 1973) in the axes of R are

    gamma = R(q)^T y' - gamma_0,    kappa = 2 vec(q^* q') / |q|^2 - kappa_0,

``q^*`` being the conjugate; a change of ``|q|`` is in the scalar part of ``q^* q'`` alone.
``gamma_0``, ``kappa_0`` are the values at the start.

Normalised sums of rotations are objective and do not depend on the path (Romero, Comput. Mech. 34
(2004) 121-133; with quaternions Zupan, Saje, Zupan, Comput. Methods Appl. Mech. Eng. 198 (2009)
3944-3956). Another reference node multiplies ``q`` from the left by a constant quaternion only, so
that R is as smooth along the beam as the shape functions. Nodes rotated by an angle t against each
other have the curvature ``4 tan(t/4) / h`` in the middle of an element of degree 1 and length h,
not ``t / h``: of second order like the element.

With ``vectors`` the rotation vectors of ``R_r^T R_I`` are interpolated in their place, see
``flexfem.forms.nurbs_vectors``.

The forms do not depend on the degree: their unknowns are the eleven numbers ``p = (y', q - 1, q')``
of one point of an element, constants of a space that is discontinuous from one point to the next.
Their interpolation and the nodal forces are in ``flexfem.families.beam_nurbs.kernels``.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Protocol, Self

import basix.ufl
import ufl

from flexfem.forms.beam_law import (
    LawExpressions,
    constant_field,
    interval_mesh,
    symmetric,
    written,
)
from flexfem.forms.lie import Expr
from flexfem.forms.nurbs_vectors import VectorKinematics

__all__ = ["POINT", "NurbsForms", "nurbs_forms", "strain_form"]

#: Number of the unknowns at a point.
POINT = 11


@dataclass(frozen=True)
class NurbsForms:
    """Forms of one material and the order in which they expect their data.

    All have rank 1 and write their quantities, row by row, per length.

    Attributes:
        residual: force (11,), work-conjugate to the unknowns.
        tangent: force (11,), its derivative by the unknowns at fixed rates (11, 11) and, with
            viscosity, by the rates (11, 11).
        action: force (11,) and its change (11,) along the changes of unknowns and rates.
        coefficients: by name, in the order in which a point's data is packed.
    """

    residual: ufl.Form
    tangent: ufl.Form
    action: ufl.Form
    coefficients: dict[str, ufl.Coefficient]


@dataclass(frozen=True)
class NurbsStrain:
    """Form of strains (6,) and their rates (6,).

    Attributes:
        strain: the form.
        coefficients: as of :class:`NurbsForms`, those that it needs.
    """

    strain: ufl.Form
    coefficients: dict[str, ufl.Coefficient]


@dataclass(frozen=True)
class _Quaternion:
    """Scalar and vector part."""

    w: Expr
    v: Expr

    def spin(self, other: "_Quaternion") -> Expr:
        """Vector part of ``q^* o``."""
        return self.w * other.v - other.w * self.v - ufl.cross(self.v, other.v)

    def spin_force(self, moment: Expr) -> Expr:
        """Force (4,) on ``o`` of a moment: the transpose of :meth:`spin`."""
        return _joined(-ufl.dot(self.v, moment), self.w * moment + ufl.cross(self.v, moment))


class _Kinematics(Protocol):
    """Strains at the unknowns p, and the parts of their derivatives."""

    @classmethod
    def of(cls, unknowns: Expr) -> Self:
        """Kinematics at the unknowns p."""

    @classmethod
    def derivative(cls, vector: Callable[[Self], Expr], unknowns: Expr) -> Expr:
        """Derivative by the unknowns of a function of the kinematics."""

    def strain(self) -> tuple[Expr, Expr]:
        """Both strains, those of the start included."""

    def rate(self, rates: Expr) -> Expr:
        """Change (6,) of the strains along rates (11,) of the unknowns."""

    def force(self, stress: Expr) -> Expr:
        """Force (11,) of stress resultants (6,): the transpose of :meth:`rate`."""


@dataclass(frozen=True)
class _QuaternionKinematics:
    """Kinematics made of y', q, q' and ``f = 2 / |q|^2``."""

    y: Expr
    q: _Quaternion
    slope: _Quaternion
    f: Expr

    @classmethod
    def of(cls, unknowns: Expr, f: Expr | None = None) -> Self:
        """Kinematics at the unknowns p, or with a given ``f``."""
        y, v, v_s = (ufl.as_vector([unknowns[first + i] for i in range(3)]) for first in (0, 4, 8))
        q = _Quaternion(1 + unknowns[3], v)
        return cls(y, q, _Quaternion(unknowns[7], v_s), _factor(unknowns) if f is None else f)

    @classmethod
    def derivative(cls, vector: Callable[[Self], Expr], unknowns: Expr) -> Expr:
        """See the protocol; one product for |q|^2 instead of its derivative in each entry."""
        p = ufl.variable(unknowns)
        f = ufl.variable(_factor(unknowns))
        varied = vector(cls.of(p, f))
        q = ufl.as_vector([0, 0, 0, 1 + p[3], *(p[i] for i in (4, 5, 6)), 0, 0, 0, 0])
        return ufl.diff(varied, p) - ufl.outer(ufl.diff(varied, f), f**2 * q)

    def strain(self) -> tuple[Expr, Expr]:
        """See the protocol."""
        return self._turned(-self.q.v, self.y), self.f * self.q.spin(self.slope)

    def _turned(self, v: Expr, a: Expr) -> Expr:
        """``R(w, v) a``."""
        p = ufl.cross(v, a)
        return a + self.f * (self.q.w * p + ufl.cross(v, p))

    def rate(self, rates: Expr) -> Expr:
        """See the protocol."""
        y, v, v_s = (ufl.as_vector([rates[first + i] for i in range(3)]) for first in (0, 4, 8))
        along, along_s = _Quaternion(rates[3], v), _Quaternion(rates[7], v_s)
        gamma, kappa = self.strain()
        sheared = self._turned(-self.q.v, y) + ufl.cross(gamma, self.f * self.q.spin(along))
        stretched = self.q.w * along.w + ufl.dot(self.q.v, along.v)
        bent = self.q.spin(along_s) + along.spin(self.slope) - stretched * kappa
        return _joined(sheared, self.f * bent)

    def force(self, stress: Expr) -> Expr:
        """See the protocol."""
        n, m = (ufl.as_vector([stress[first + i] for i in range(3)]) for first in (0, 3))
        gamma, kappa = self.strain()
        shrunk = ufl.dot(kappa, m)
        turning = self.q.spin_force(ufl.cross(n, gamma)) - self.slope.spin_force(m)
        turning -= shrunk * _joined(self.q.w, self.q.v)
        return _joined(self._turned(self.q.v, n), self.f * turning, self.f * self.q.spin_force(m))


def _factor(unknowns: Expr) -> Expr:
    """``2 / |q|^2`` at the unknowns p."""
    return 2 / ((1 + unknowns[3]) ** 2 + sum(unknowns[i] ** 2 for i in (4, 5, 6)))


def _joined(*parts: Expr) -> Expr:
    """Vector of scalars and vectors."""
    return ufl.as_vector([
        entry for part in parts for entry in (part if part.ufl_shape else [part])
    ])  # fmt: skip


def _coefficients(
    mesh: ufl.Mesh, law: LawExpressions | None, damped: int
) -> dict[str, ufl.Coefficient]:
    material = ("stiffness", 21) if law is None else ("parameters", max(law.count, 1))
    return {
        "unknowns": constant_field(mesh, POINT),
        "rates": constant_field(mesh, POINT),
        "start": constant_field(mesh, 6),
        "damping": constant_field(mesh, 6) if damped > 1 else constant_field(mesh),
        material[0]: constant_field(mesh, material[1]),
        "change": constant_field(mesh, POINT),
        "rate_change": constant_field(mesh, POINT),
    }


def _stress(
    fields: dict[str, ufl.Coefficient], strain: Expr, rate: Expr, damped: int,
    law: LawExpressions | None,
) -> Expr:  # fmt: skip
    """Stress resultants (6,)."""
    if law is not None:
        return law.stress(strain, rate, fields["parameters"])
    stiffness = symmetric(fields["stiffness"])
    if damped == 1:
        strain += fields["damping"] * rate
    stress = stiffness * strain
    if damped > 1:
        root = fields["damping"]
        viscous = stiffness * ufl.as_vector([root[i] * rate[i] for i in range(6)])
        stress += ufl.as_vector([root[i] * viscous[i] for i in range(6)])
    return stress


def _matrices(
    kind: type[_Kinematics], fields: dict[str, ufl.Coefficient], damped: int, viscous: bool,
    law: LawExpressions | None,
) -> list[Expr]:  # fmt: skip
    """Derivatives (11, 11) of the force by the unknowns and, with viscosity, by their rates."""
    at = kind.of(fields["unknowns"])
    strain = ufl.variable(_joined(*at.strain()) - fields["start"])
    rate = ufl.variable(at.rate(fields["rates"]))
    stress = _stress(fields, strain, rate, damped, law)
    units = [ufl.as_vector([float(i == j) for i in range(POINT)]) for j in range(POINT)]
    columns = [at.rate(unit) for unit in units]
    B = ufl.as_matrix([[column[i] for column in columns] for i in range(6)])

    geometric = kind.derivative(lambda varied: varied.force(stress), fields["unknowns"])
    change = ufl.diff(stress, strain) * B
    if not viscous:
        return [geometric + B.T * change]
    viscosity = ufl.diff(stress, rate)
    change += viscosity * kind.derivative(
        lambda varied: varied.rate(fields["rates"]), fields["unknowns"]
    )
    return [geometric + B.T * change, B.T * (viscosity * B)]


@cache
def nurbs_forms(
    damped: int, law: LawExpressions | None = None, vectors: bool = False
) -> NurbsForms:
    """Build the forms of a material.

    Args:
        damped: how many numbers the stiffness-proportional damping has: none, for which kernels are
            shorter, 1, or 6, the roots of those of each strain.
        law: the law of the section, None for the linear one of a stiffness matrix.
        vectors: with relative rotation vectors in place of quaternions.
    """
    mesh, kind = interval_mesh(), _kind(vectors)
    fields = _coefficients(mesh, law, damped)
    viscous = damped > 0 or (law is not None and law.dissipation is not None)
    at = kind.of(fields["unknowns"])
    strain, rate = _joined(*at.strain()) - fields["start"], at.rate(fields["rates"])
    force = at.force(_stress(fields, strain, rate, damped, law))
    entries = [force[i] for i in range(POINT)]
    matrices = _matrices(kind, fields, damped, viscous, law)
    places = [(i, j) for i in range(POINT) for j in range(POINT)]

    space = ufl.FunctionSpace(mesh, basix.ufl.element("DG", "interval", 0, shape=(2 * POINT,)))
    test = ufl.TestFunction(space)
    halves = [ufl.as_vector([test[first + i] for i in range(POINT)]) for first in (0, POINT)]
    works = [
        ufl.dot(force, half) / ufl.CellVolume(mesh) * ufl.dx(mesh, degree=0) for half in halves
    ]
    action = works[0]
    for name, change in (("unknowns", "change"), ("rates", "rate_change")):
        if name == "unknowns" or viscous:
            action += ufl.derivative(works[1], fields[name], fields[change])
    return NurbsForms(
        residual=written(mesh, entries),
        tangent=written(mesh, entries + [m[i, j] for m in matrices for i, j in places]),
        action=action,
        coefficients=fields,
    )


def _kind(vectors: bool) -> type[_Kinematics]:
    return VectorKinematics if vectors else _QuaternionKinematics


@cache
def strain_form(vectors: bool = False) -> NurbsStrain:
    """Form that writes strains (6,) and their rates (6,)."""
    mesh = interval_mesh()
    names = ("unknowns", "rates", "start")
    fields = {name: f for name, f in _coefficients(mesh, None, 0).items() if name in names}
    at = _kind(vectors).of(fields["unknowns"])
    strain, rate = _joined(*at.strain()) - fields["start"], at.rate(fields["rates"])
    entries = [part[i] for part in (strain, rate) for i in range(6)]
    return NurbsStrain(written(mesh, entries), fields)
