# SPDX-License-Identifier: LGPL-3.0-or-later
"""UFL forms of the SE(3) beam for a step that conserves energy.

Element and strain are those of :mod:`flexfem.forms.beam`. Over a step the relative twist ``d`` of
the element goes from ``d_0`` to ``d_1``. With frames that rotate by the Cayley map, the relative
position ``r = R_1^T (x_2 - x_1)`` and the relative rotation ``Q = R_1^T R_2`` have exact discrete
derivatives along the motion of the nodes, and so has the logarithm, whose pieces are products,
roots and polynomials (:mod:`flexfem.forms.discrete`). The element force is the stress at the mean
twist along that derivative: its work over the step is exactly the change of the strain energy, and
it vanishes for rigid motions about the mean positions, which keeps both momenta.

Test motions are constants of the cell, nine in number: the difference of the translations of both
ends and their rotations, all in inertial axes.
"""

from dataclasses import dataclass

import basix.ufl
import ufl

from flexfem.forms.beam import _work
from flexfem.forms.beam_law import symmetric
from flexfem.forms.discrete import Change, cross, inverse, polynomial, root
from flexfem.forms.lie import _ARC, _POLE, _REST, Expr, skew

__all__ = ["BeamEnergyForms", "beam_energy_forms"]


@dataclass(frozen=True)
class BeamEnergyForms:
    """Forms of one family of beams over a step and the order in which they expect their data.

    Attributes:
        residual: rank 1, mean internal force over the step.
        tangent: rank 2, its exact derivative along the same nine motions of the end of the step.
        coefficients: the fields by name, in the order in which a cell's data is packed.
    """

    residual: ufl.Form
    tangent: ufl.Form
    coefficients: dict[str, ufl.Coefficient]


def _constant(mesh: ufl.Mesh, size: int) -> ufl.FunctionSpace:
    """Space of ``size`` numbers a cell."""
    shape = (size,) if size > 1 else ()
    return ufl.FunctionSpace(mesh, basix.ufl.element("DG", "interval", 0, shape=shape))


def _coefficients(mesh: ufl.Mesh) -> dict[str, ufl.Coefficient]:
    """Data of a cell; rotations are those of both ends."""
    layout = {
        "arm": 3,
        "rotation": 18,
        "start_arm": 3,
        "start_rotation": 18,
        "relative_twist": 6,
        "last_change": 6,
        "length": 1,
        "damping": 1,
        "stiffness": 21,
    }
    return {name: ufl.Coefficient(_constant(mesh, size)) for name, size in layout.items()}


def _rows(values: Expr, first: int) -> Expr:
    """Matrix of nine entries, row by row."""
    return ufl.as_matrix([[values[first + 3 * i + j] for j in range(3)] for i in range(3)])


def _factors(trace: Change) -> tuple[Change, Change]:
    """Factors F and E with ``theta = F a`` and ``u = r - F/2 a x r + E a x (a x r)``.

    They depend on the trace of the relative rotation alone; ``a`` is twice its axial vector. The
    steps are those of :func:`flexfem.forms.lie.se3_log`.
    """
    double_cos = root(trace + 1.0)
    quarter = inverse(double_cos * (double_cos + 2.0))
    # |a|^2 = (1 + tr) (3 - tr)
    size = quarter * quarter * (trace + 1.0) * (-trace + 3.0)
    shrink = inverse(root(size + 1.0) + 1.0)
    turn = 8.0 * shrink * polynomial(_ARC, size * shrink * shrink) * quarter
    square = turn * turn
    x = square * (trace + 1.0) * (-trace + 3.0)
    return turn, square * (2.0 * inverse(-x + _POLE) + polynomial(_REST, x))


def _log(y: Change) -> Change:
    """Twist of a frame; ``y`` (8,) holds its position r, a and both factors."""
    r, a = _part(y, 0), _part(y, 3)
    turn, second = (Change(*(v[i] for v in y.values)) for i in (6, 7))
    p = cross(a, r)
    u = r - 0.5 * (turn * p) + second * cross(a, p)
    theta = turn * a
    return Change(*(_join(v, w) for v, w in zip(u.values, theta.values, strict=True)))


def _part(y: Change, first: int) -> Change:
    """Three entries in a row."""
    return Change(*(ufl.as_vector([v[first + i] for i in range(3)]) for v in y.values))


def _join(*vectors: Expr) -> Expr:
    return ufl.as_vector([v[i] for v in vectors for i in range(3)])


def _invariants(r: Expr, Q: Expr) -> Expr:
    """Position, twice the axial vector and the trace of a relative frame, or of its change."""
    axial = [Q[2, 1] - Q[1, 2], Q[0, 2] - Q[2, 0], Q[1, 0] - Q[0, 1]]
    return ufl.as_vector([r[0], r[1], r[2], *axial, ufl.tr(Q)])


def _extend(y: Expr, factors: list[Expr]) -> Expr:
    """Position and axial vector with both factors in the place of the trace."""
    return ufl.as_vector([*(y[i] for i in range(6)), *factors])


def _thirds(motion: Expr) -> list[Expr]:
    """Difference of translations and both rotations."""
    return [ufl.as_vector([motion[3 * k + i] for i in range(3)]) for k in range(3)]


def _relative(fields: dict[str, ufl.Coefficient], test: Expr, shift: Expr) -> Change:
    """Invariants of the relative frame, the end of the step moved by ``shift``."""
    (stretch, *turns), (e, *phi) = _thirds(shift), _thirds(test)
    arm = Change(fields["start_arm"], fields["arm"] + stretch, e)
    R_0 = [_rows(fields["start_rotation"], 9 * side) for side in range(2)]
    R_1 = [_rows(fields["rotation"], 9 * side) for side in range(2)]
    R_1 = [R + skew(turn) * R for R, turn in zip(R_1, turns, strict=True)]
    mean = [0.5 * (a + b) for a, b in zip(R_0, R_1, strict=True)]
    return Change(
        _invariants(R_0[0].T * arm.start, R_0[0].T * R_0[1]),
        _invariants(R_1[0].T * arm.end, R_1[0].T * R_1[1]),
        _invariants(
            mean[0].T * (e - ufl.cross(phi[0], arm.mean)),
            mean[0].T * skew(phi[1] - phi[0]) * mean[1],
        ),
    )


def _stress(fields: dict[str, ufl.Coefficient], constants: Expr, d: Change) -> Expr:
    """Stress at the mean twist, with damping and with numerical dissipation."""
    change = d.end - d.start
    stretch = d.mean - fields["relative_twist"] + fields["damping"] * constants[1] * change
    stretch += constants[0] * (change - fields["last_change"])
    return symmetric(fields["stiffness"]) * (stretch / fields["length"])


def beam_energy_forms() -> BeamEnergyForms:
    """Build the forms on an abstract interval mesh in three dimensions.

    Their constants are half the dissipation and 1/h.
    """
    mesh = ufl.Mesh(basix.ufl.element("Lagrange", "interval", 1, shape=(3,)))
    fields, space = _coefficients(mesh), _constant(mesh, 9)
    test, trial = ufl.TestFunction(space), ufl.TrialFunction(space)
    # a small motion from the state at the end, for the derivative alone
    shift = ufl.Coefficient(space)
    constants = ufl.Constant(mesh, shape=(2,))
    y = _relative(fields, test, shift)

    def still(expression: Expr) -> Expr:
        return ufl.replace(expression, {shift: ufl.zero(9)})

    def moved(expression: Expr) -> Expr:
        change = ufl.derivative(expression, shift, trial)
        return still(ufl.algorithms.expand_derivatives(change))

    trace = ufl.variable(still(y.end[6]))
    turned, slope = moved(y.end[6]), still(y.d[6])
    factors = _factors(Change(y.start[6], trace, ufl.as_ufl(1.0)))
    first, last = [f.start for f in factors], [f.end for f in factors]
    # the work is linear in the change of the invariants: eight forces, 8 x 8 second derivatives
    end = ufl.variable(_extend(still(y.end), last))
    d = ufl.variable(ufl.as_vector([ufl.as_ufl(0.0)] * 8))
    twist = _log(Change(_extend(y.start, first), end, d))
    force = ufl.diff(ufl.dot(_stress(fields, constants, twist), twist.d), d)
    change = _extend(still(y.d), [f.d * slope for f in factors])
    end_turned = _extend(moved(y.end), [ufl.diff(f, trace) * turned for f in last])
    change_turned = _extend(
        moved(y.d),
        [ufl.diff(f.d, trace) * turned * slope + f.d * moved(y.d[6]) for f in factors],
    )
    tangent = ufl.dot(change, ufl.diff(force, end) * end_turned) + ufl.dot(force, change_turned)
    return BeamEnergyForms(_work(mesh, ufl.dot(force, change)), _work(mesh, tangent), fields)
