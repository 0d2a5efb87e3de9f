# SPDX-License-Identifier: LGPL-3.0-or-later
"""UFL forms of the geometrically exact beam on NURBS, at one quadrature point.

An element of degree p lies between p + 1 control points with frames ``(x_I, R_I)``. Relative to the
reference node r, ``y_I = R_r^T (x_I - x_r)`` and ``Theta_I = log(R_r^T R_I)`` are interpolated by
the rational shape functions, ``R(s) = R_r exp(Theta(s))`` (Crisfield, Jelenic 1999; on NURBS Wu et
al. 2020), so that strains are objective and do not depend on the path. With ' for the derivative by
the arc length of the start, the strains (Simo 1985, Reissner 1973) in the axes of R are

    gamma = exp(Theta)^T y' - gamma_0,    kappa = T(Theta) Theta' - kappa_0,

T being the right tangent map; ``gamma_0``, ``kappa_0`` are their values at the start.

The forms know nothing of the degree: their unknowns are the nine numbers ``p = (y', Theta,
Theta')`` of one point of an element, constants of a space that is discontinuous from one point to
the next. What interpolates them and leads on to the nodes is in ``flexfem.elements.nurbs_loops``.
"""

from dataclasses import dataclass
from functools import cache

import basix.ufl
import ufl

from flexfem.forms.beam_law import LawExpressions, constant_field, interval_mesh, symmetric
from flexfem.forms.lie import Expr, RelativeRotation

__all__ = ["POINT", "NurbsForms", "nurbs_forms", "strain_form"]

#: Number of the unknowns at a point.
POINT = 9


@dataclass(frozen=True)
class NurbsForms:
    """Forms of one material and the order in which they expect their data.

    All have rank 1 and write what they stand for, row by row, per length.

    Attributes:
        residual: force (9,), dual to the unknowns.
        tangent: force (9,), its derivative by the unknowns at fixed rates (9, 9) and, with
            viscosity, by the rates (9, 9).
        action: force (9,) and its change (9,) along the changes of unknowns and rates.
        coefficients: by name, in the order in which a point's data is packed.
    """

    residual: ufl.Form
    tangent: ufl.Form
    action: ufl.Form
    coefficients: dict[str, ufl.Coefficient]


@dataclass(frozen=True)
class _Kinematics:
    """Strains, and what their derivatives are made of."""

    y: Expr
    theta: Expr
    bend: Expr
    turn: RelativeRotation

    @classmethod
    def of(cls, unknowns: Expr, turn: RelativeRotation | None = None) -> "_Kinematics":
        y, theta, bend = (
            ufl.as_vector([unknowns[first + i] for i in range(3)]) for first in (0, 3, 6)
        )
        return cls(y, theta, bend, turn or RelativeRotation.of(theta))

    def strain(self) -> tuple[Expr, Expr]:
        """Both strains, those of the start included."""
        return self.turn.back(self.theta, self.y), self.turn.tangent(self.theta, self.bend)

    def rate(self, rates: Expr) -> Expr:
        """Change (6,) of the strains along rates (9,) of the unknowns."""
        along, t = _Kinematics.of(rates, self.turn), self.turn
        gamma, _ = self.strain()
        sheared = t.back(self.theta, along.y)
        sheared += ufl.cross(gamma, t.tangent(self.theta, along.theta))
        bent = t.tangent(self.theta, along.bend)
        bent += t.tangent_change(self.theta, along.theta, self.bend)
        return _joined(sheared, bent)

    def force(self, stress: Expr) -> Expr:
        """Force (9,) of stress resultants (6,): the transpose of :meth:`rate`."""
        n, m = (ufl.as_vector([stress[first + i] for i in range(3)]) for first in (0, 3))
        gamma, t = self.strain()[0], self.turn
        turning = t.tangent(-self.theta, ufl.cross(n, gamma))
        turning += t.tangent_gradient(self.theta, self.bend, m)
        return _joined(t.back(-self.theta, n), turning, t.tangent(-self.theta, m))


def _joined(*parts: Expr) -> Expr:
    return ufl.as_vector([part[i] for part in parts for i in range(3)])


def _coefficients(mesh: ufl.Mesh, law: LawExpressions | None) -> dict[str, ufl.Coefficient]:
    material = ("stiffness", 21) if law is None else ("parameters", max(law.count, 1))
    return {
        "unknowns": constant_field(mesh, POINT),
        "rates": constant_field(mesh, POINT),
        "start": constant_field(mesh, 6),
        "damping": constant_field(mesh),
        material[0]: constant_field(mesh, material[1]),
        "change": constant_field(mesh, POINT),
        "rate_change": constant_field(mesh, POINT),
    }


def _stress(
    fields: dict[str, ufl.Coefficient], strain: Expr, rate: Expr, damped: bool,
    law: LawExpressions | None,
) -> Expr:  # fmt: skip
    """Stress resultants (6,)."""
    if law is not None:
        return law.stress(strain, rate, fields["parameters"])
    if damped:
        strain += fields["damping"] * rate
    return symmetric(fields["stiffness"]) * strain


def _derivative(vector: Expr, unknowns: Expr, turn: RelativeRotation) -> Expr:
    """Derivative by the unknowns, of which the coefficients of the maps are functions."""
    total = ufl.diff(vector, unknowns)
    theta = ufl.as_vector([unknowns[i] if 3 <= i < 6 else 0 for i in range(POINT)])
    for coefficient, slope in turn.slopes():
        total += ufl.outer(ufl.diff(vector, coefficient), slope * theta)
    return total


def _matrices(
    fields: dict[str, ufl.Coefficient], damped: bool, viscous: bool, law: LawExpressions | None
) -> list[Expr]:
    """Derivatives (9, 9) of the force by the unknowns and, with viscosity, by their rates."""
    at = _Kinematics.of(fields["unknowns"])
    strain = ufl.variable(_joined(*at.strain()) - fields["start"])
    rate = ufl.variable(at.rate(fields["rates"]))
    stress = _stress(fields, strain, rate, damped, law)
    units = [ufl.as_vector([float(i == j) for i in range(POINT)]) for j in range(POINT)]
    columns = [at.rate(unit) for unit in units]
    B = ufl.as_matrix([[column[i] for column in columns] for i in range(6)])

    # the derivative of a series by the unknowns would be one series for each of them
    unknowns, turn = ufl.variable(fields["unknowns"]), at.turn.variables()
    varied = _Kinematics.of(unknowns, turn)
    geometric = _derivative(varied.force(stress), unknowns, turn)
    change = ufl.diff(stress, strain) * B
    if not viscous:
        return [geometric + B.T * change]
    viscosity = ufl.diff(stress, rate)
    change += viscosity * _derivative(varied.rate(fields["rates"]), unknowns, turn)
    return [geometric + B.T * change, B.T * (viscosity * B)]


def _written(mesh: ufl.Mesh, entries: list[Expr]) -> ufl.Form:
    """Form whose vector holds the entries."""
    shape = (len(entries),)
    space = ufl.FunctionSpace(mesh, basix.ufl.element("DG", "interval", 0, shape=shape))
    value = ufl.dot(ufl.as_vector(entries), ufl.TestFunction(space))
    form: ufl.Form = value / ufl.CellVolume(mesh) * ufl.dx(mesh, degree=0)
    return form


@cache
def nurbs_forms(damped: bool, law: LawExpressions | None = None) -> NurbsForms:
    """Build the forms of a material.

    Args:
        damped: with stiffness-proportional damping; without it the kernels are shorter.
        law: the law of the section, None for the linear one of a stiffness matrix.
    """
    mesh = interval_mesh()
    fields = _coefficients(mesh, law)
    viscous = damped or (law is not None and law.dissipation is not None)
    at = _Kinematics.of(fields["unknowns"])
    strain, rate = _joined(*at.strain()) - fields["start"], at.rate(fields["rates"])
    force = at.force(_stress(fields, strain, rate, damped, law))
    entries, matrices = [force[i] for i in range(POINT)], _matrices(fields, damped, viscous, law)
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
        residual=_written(mesh, entries),
        tangent=_written(mesh, entries + [m[i, j] for m in matrices for i, j in places]),
        action=action,
        coefficients=fields,
    )


@cache
def strain_form() -> tuple[ufl.Form, dict[str, ufl.Coefficient]]:
    """Form that writes strains (6,) and their rates (6,), and its coefficients as above."""
    mesh = interval_mesh()
    names = ("unknowns", "rates", "start")
    fields = {name: f for name, f in _coefficients(mesh, None).items() if name in names}
    at = _Kinematics.of(fields["unknowns"])
    strain, rate = _joined(*at.strain()) - fields["start"], at.rate(fields["rates"])
    entries = [part[i] for part in (strain, rate) for i in range(6)]
    return _written(mesh, entries), fields
