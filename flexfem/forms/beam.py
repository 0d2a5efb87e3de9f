# SPDX-License-Identifier: LGPL-3.0-or-later
"""UFL forms of the two-node geometrically exact beam on SE(3).

One element lies between the frames ``H_1 = (x_1, R_1)`` and ``H_2 = (x_2, R_2)`` of its ends. Its
relative twist ``d = log(H_1^-1 H_2)`` (translation first) is constant along the element, and so is
its strain ``(d - d_0) / L``: the element is a helix, objective by construction, free of locking and
exact for every state of constant strain (Sonneville, Cardona, Brüls 2014, section 3; the relative
twist as an element coordinate goes back to Borri and Bottasso 1994).

The fields are continuous piecewise linears; on an interval their nodal values come out of UFL
exactly as ``f(1/2) -/+ 1/2 df/dxi``, so one quadrature point carries the whole element. All
increments and residuals are components in the nodes' own frames.

The kinetic energy is that of masses that move with the linear field of the inertial velocities of
the nodes' mass centres c, ``1/2 sum_ij M_ij m (R_i V_ci) . (R_j V_cj)`` with
``M = L/6 [[2, 1], [1, 2]]`` and ``V_c = V + Omega x c``, plus that of the rotary inertia about c,
lumped at the nodes. Translation is exact in any bent state; interpolated local velocities would
lose the mass ``theta^2/6`` of an element whose ends are rotated by ``theta`` against each other.
Both parts are positive wherever c lies; masses along the axis with their first moment lumped at the
nodes would not be: where neighbours rotate against each other, that moment meets a third of its
mass only. The Euler–Poincaré equations of this energy keep linear and angular momentum exactly
(Noether).
"""

from dataclasses import dataclass
from functools import cache

import basix.ufl
import ufl

from flexfem.forms.beam_law import LawExpressions, constant_field, interval_mesh, symmetric
from flexfem.forms.lie import Expr, se3_log, se3_relative_rate

__all__ = ["BeamForms", "beam_forms"]


#: Mass per length that is lost in the rounding of any other.
_NO_MASS = 1e-100
#: values at both ends of an element
_Pair = tuple[Expr, Expr]


@dataclass(frozen=True)
class BeamForms:
    """Forms of one family of beams and the order in which they expect their data.

    Attributes:
        residual: rank 1, internal and inertia forces minus the weight.
        stiffness: rank 2, exact derivative of ``residual`` with respect to the configuration.
        inertia: rank 2, ``shift_v * dr/dv + shift_a * dr/da``.
        action: rank 1, ``stiffness`` applied to "turn" plus the derivatives by velocity and by
            acceleration applied to their changes.
        coefficients: the fields by name, in the order in which a cell's data is packed; those that
            a form does not need are left out there.
    """

    residual: ufl.Form
    stiffness: ufl.Form
    inertia: ufl.Form
    action: ufl.Form
    coefficients: dict[str, ufl.Coefficient]


def _ends(field: Expr, jacobian: Expr) -> tuple[Expr, Expr]:
    """Values of a linear field at both ends of the interval cell."""
    half = 0.5 * ufl.dot(ufl.grad(field), jacobian[:, 0])
    return field - half, field + half


def _frame_rows(rotation: Expr) -> Expr:
    return ufl.as_matrix([[rotation[3 * i + j] for j in range(3)] for i in range(3)])


def _linear_field(mesh: ufl.Mesh, size: int) -> ufl.Coefficient:
    """A coefficient with values at the nodes."""
    element = basix.ufl.element("Lagrange", "interval", 1, shape=(size,))
    return ufl.Coefficient(ufl.FunctionSpace(mesh, element))


def _coefficients(
    mesh: ufl.Mesh, law: LawExpressions | None, damped: int
) -> dict[str, ufl.Coefficient]:
    """Data of a cell: nodal values as linear fields, the rest as constants of the cell."""
    material = ("stiffness", 21) if law is None else ("parameters", max(law.count, 1))
    return {
        "position": _linear_field(mesh, 3),
        "rotation": _linear_field(mesh, 9),
        "velocity": _linear_field(mesh, 6),
        "acceleration": _linear_field(mesh, 6),
        "relative_twist": constant_field(mesh, 6),
        "length": constant_field(mesh),
        "damping": constant_field(mesh, 6) if damped > 1 else constant_field(mesh),
        material[0]: constant_field(mesh, material[1]),
        "inertia": constant_field(mesh, 21),
        "turn": _linear_field(mesh, 6),
        "velocity_change": _linear_field(mesh, 6),
        "acceleration_change": _linear_field(mesh, 6),
    }


def _work(mesh: ufl.Mesh, integrand: Expr) -> ufl.Form:
    """Form of the virtual work of a whole element, which is divided by the cell's length."""
    form: ufl.Form = integrand / ufl.CellVolume(mesh) * ufl.dx(mesh, degree=0)
    return form


def _halves(twist: Expr) -> tuple[Expr, Expr]:
    """Translation and rotation of a twist."""
    return ufl.as_vector([twist[i] for i in range(3)]), ufl.as_vector(
        [twist[i] for i in range(3, 6)]
    )


def _about_centre(m: Expr) -> tuple[Expr, Expr, Expr]:
    """Mass, mass centre and rotary inertia about it, all per length, of a section inertia."""
    mass = m[0, 0]
    # without mass the centre does not matter; a branch would keep the kernel from vectors
    c = ufl.as_vector([m[5, 1], m[3, 2], m[4, 0]]) / (mass + _NO_MASS)
    turning = ufl.as_matrix([[m[3 + i, 3 + j] for j in range(3)] for i in range(3)])
    steiner = mass * (ufl.dot(c, c) * ufl.Identity(3) - ufl.outer(c, c))
    return mass, c, turning - steiner


def _moved(twist: Expr, c: Expr) -> tuple[Expr, Expr]:
    """Translation and rotation of a local twist, or of its rate, referred to the point ``c``."""
    translation, rotation = _halves(twist)
    return translation + ufl.cross(rotation, c), rotation


def _inertial_work(
    length: Expr, m: Expr, R_12: Expr, v: _Pair, a: _Pair, w: _Pair, dw: _Pair
) -> _Pair:
    """Work of the inertia force on the twists ``w`` of both ends, and its change as they rotate.

    Args:
        length: of the element.
        m: section inertia, 6x6.
        R_12: rotation from the axes of the second end to those of the first.
        v: local twists of both ends.
        a: their rates.
        w: test twists.
        dw: local twists of the ends.
    """
    mass, c, rotary = _about_centre(m)
    # local twists of the mass centres, their rates, and the centres' inertial accelerations
    twists, rates, tests = ([_moved(x, c) for x in pair] for pair in (v, a, w))
    b = [dV + ufl.cross(omega, V) for (V, omega), (dV, _) in zip(twists, rates, strict=True)]
    force, change = [], []
    for i, R in enumerate((R_12, R_12.T)):  # R maps the other end's components to this one's
        j = 1 - i
        (u, spun), spin = tests[i], twists[i][1]
        turn, other = _halves(dw[i])[1], _halves(dw[j])[1]
        moment = rotary * rates[i][1] + ufl.cross(spin, rotary * spin)
        force.append(length / 2 * ufl.dot(spun, moment))
        force.append(length / 6 * mass * ufl.dot(u, 2 * b[i] + R * b[j]))
        turned = R * ufl.cross(other, b[j]) - ufl.cross(turn, R * b[j])
        change.append(length / 6 * mass * ufl.dot(u, turned))
    return sum(force[1:], force[0]), change[0] + change[1]


def _weight_work(half: Expr, g: Expr, w: Expr) -> Expr:
    """Work on the twist ``w`` of one end in the local acceleration ``g``; ``half`` is ``L/2 m``."""
    return ufl.dot(w, half * ufl.as_vector([g[0], g[1], g[2], 0, 0, 0]))


def _stress(
    fields: dict[str, ufl.Coefficient], stretch: Expr, rate: Expr, damped: int,
    law: LawExpressions | None,
) -> Expr:  # fmt: skip
    """Stress resultants from the change of the relative twist and its rate."""
    length = fields["length"]
    if law is not None:
        return law.stress(stretch / length, rate / length, fields["parameters"])
    stiffness = symmetric(fields["stiffness"])
    if damped == 1:
        stretch += fields["damping"] * rate
    stress = stiffness * (stretch / length)
    if damped > 1:
        root = fields["damping"]
        viscous = stiffness * ufl.as_vector([root[i] * rate[i] / length for i in range(6)])
        stress += ufl.as_vector([root[i] * viscous[i] for i in range(6)])
    return stress


@cache
def beam_forms(damped: int, law: LawExpressions | None = None) -> BeamForms:
    """Build the forms of the SE(3) beam on an abstract interval mesh in three dimensions.

    Args:
        damped: how many numbers the stiffness-proportional damping has: none, for which kernels are
            shorter, one, or the roots of one for each strain.
        law: the law of the section, None for the linear one of a stiffness matrix.
    """
    mesh = interval_mesh()
    fields = _coefficients(mesh, law, damped)
    space = ufl.FunctionSpace(mesh, basix.ufl.element("Lagrange", "interval", 1, shape=(6,)))
    gravity = ufl.Constant(mesh, shape=(3,))
    shifts = ufl.Constant(mesh, shape=(2,))
    test, trial = ufl.TestFunction(space), ufl.TrialFunction(space)

    jacobian = ufl.Jacobian(mesh)
    x_1, x_2 = _ends(fields["position"], jacobian)
    R_1, R_2 = (_frame_rows(r) for r in _ends(fields["rotation"], jacobian))
    v, a = (_ends(fields[name], jacobian) for name in ("velocity", "acceleration"))
    w, dw = _ends(test, jacobian), _ends(trial, jacobian)
    length, m = fields["length"], symmetric(fields["inertia"])

    d = ufl.variable(se3_log(R_1.T * (x_2 - x_1), R_1.T * R_2))

    def rate(twists: tuple[Expr, Expr]) -> Expr:
        """Change of ``d`` along the local twists of both ends."""
        return se3_relative_rate(d, *twists)

    stress = _stress(fields, d - fields["relative_twist"], rate(v), damped, law)
    internal = ufl.dot(stress, rate(w))
    inertial, inertial_change = _inertial_work(length, m, R_1.T * R_2, v, a, w, dw)

    gravitational, turning = [], []
    for R, w_i, dw_i in ((R_1, w[0], dw[0]), (R_2, w[1], dw[1])):
        g = R.T * gravity
        turn = ufl.as_vector([dw_i[3], dw_i[4], dw_i[5]])
        gravitational.append(_weight_work(length / 2 * m, g, w_i))
        turning.append(_weight_work(length / 2 * m, ufl.cross(g, turn), w_i))

    stiffness = _work(
        mesh,
        ufl.dot(ufl.diff(internal, d), rate(dw)) + inertial_change - turning[0] - turning[1],
    )
    # without viscosity this form is the same for all laws: it is compiled once
    viscous = damped > 0 if law is None else law.dissipation is not None
    moving = internal + inertial if viscous else inertial
    by_velocity = ufl.derivative(_work(mesh, moving), fields["velocity"], trial)
    by_acceleration = ufl.derivative(_work(mesh, inertial), fields["acceleration"], trial)
    inertia = shifts[0] * by_velocity + shifts[1] * by_acceleration
    return BeamForms(
        residual=_work(mesh, internal + inertial + (-gravitational[0] - gravitational[1])),
        stiffness=stiffness,
        inertia=inertia,
        action=ufl.action(stiffness, fields["turn"])
        + ufl.action(by_velocity, fields["velocity_change"])
        + ufl.action(by_acceleration, fields["acceleration_change"]),
        coefficients=fields,
    )
