# SPDX-License-Identifier: LGPL-3.0-or-later
"""UFL forms of the SE(3) beam for a step that conserves energy.

Element and strain are those of :mod:`flexfem.forms.beam`. Over a step the relative twist ``d`` of
the element goes from ``d_0`` to ``d_1``. With frames that turn by the Cayley map, the relative
position ``r = R_1^T (x_2 - x_1)`` and the relative rotation ``Q = R_1^T R_2`` have exact discrete
derivatives along the motion of the nodes, and so has the logarithm, whose pieces are products,
roots and polynomials (:mod:`flexfem.forms.discrete`). The element force is the stress at the mean
twist along that derivative: its work over the step is exactly the change of the strain energy,
and it vanishes for rigid motions about the mean positions, which keeps both momenta.

Test motions are constants of the cell: the translations and rotations of both nodes in their own
axes at the end of the step, from which the axes of the sections may be turned. Internal forces and
their derivatives are found for nine motions in fixed axes, the difference of the translations and
both rotations, and turned into those of the nodes last, which costs least.

The masses move with the linear field of the velocities ``u_i`` of the mass centres of a cell's
ends, ``1/2 sum_ij M_ij u_i . u_j`` as in ``forms.beam``. A node's rates are those of its own centre
c; where the section of a cell is turned against the node, its centre lies at the further arm s, and
``u = r + R (Omega x s)``. The mean forces ``f_i = sum_j M_ij Du_j / h`` at the ends and the moments
``(R_0 + R_1)/2 (c + s + h/4 DOmega x s) x f_i`` do the work by which this energy changes; without
arms they are the balance of angular momentum, too. The rotary inertia is that of
``core.nodes.step_kernels``.
"""

from dataclasses import dataclass
from functools import cache

import ufl

from flexfem.forms.beam import _about_centre, _work
from flexfem.forms.beam_law import constant_field, interval_mesh, symmetric
from flexfem.forms.discrete import Change, cross, inverse, polynomial, root
from flexfem.forms.lie import _ARC, _POLE, _REST, Expr, skew

__all__ = ["BeamEnergyForms", "beam_energy_forms"]


@dataclass(frozen=True)
class BeamEnergyForms:
    """Forms of one family of beams over a step and the order in which they expect their data.

    Attributes:
        residual: rank 1, mean internal and inertia forces minus the weight over the step.
        tangent: rank 2, its exact derivative along the same motions of the end of the step.
        coefficients: the fields by name, in the order in which a cell's data is packed.
    """

    residual: ufl.Form
    tangent: ufl.Form
    coefficients: dict[str, ufl.Coefficient]


def _coefficients(mesh: ufl.Mesh) -> dict[str, ufl.Coefficient]:
    """Data of a cell: what its nodes have, rotations to their axes from the sections', the rest."""
    layout = {
        "position": 6,
        "rotation": 18,
        "start_position": 6,
        "start_rotation": 18,
        "turn": 18,
        "increments": 12,
        "rates": 12,
        "start_rates": 12,
        "centres": 6,
        "relative_twist": 6,
        "last_change": 6,
        "inertia": 21,
        "stiffness": 21,
    }
    fields = {name: constant_field(mesh, size) for name, size in layout.items()}
    return fields | {name: constant_field(mesh) for name in ("length", "damping")}


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
    r, a = (Change(*(_part(v, first) for v in y.values)) for first in (0, 3))
    turn, second = (Change(*(v[i] for v in y.values)) for i in (6, 7))
    p = cross(a, r)
    u = r - 0.5 * (turn * p) + second * cross(a, p)
    theta = turn * a
    return Change(*(_join(v, w) for v, w in zip(u.values, theta.values, strict=True)))


def _part(values: Expr, first: int) -> Expr:
    """Three entries in a row."""
    return ufl.as_vector([values[first + i] for i in range(3)])


def _join(*vectors: Expr) -> Expr:
    return ufl.as_vector([v[i] for v in vectors for i in range(3)])


def _invariants(r: Expr, Q: Expr) -> Expr:
    """Position, twice the axial vector and the trace of a relative frame, or of its change."""
    axial = [Q[2, 1] - Q[1, 2], Q[0, 2] - Q[2, 0], Q[1, 0] - Q[0, 1]]
    return ufl.as_vector([r[0], r[1], r[2], *axial, ufl.tr(Q)])


def _extend(y: Expr, factors: list[Expr]) -> Expr:
    """Position and axial vector with both factors in the place of the trace."""
    return ufl.as_vector([*(y[i] for i in range(6)), *factors])


def _extension(slopes: list[Expr]) -> Expr:
    """Derivatives (8, 7) of what :func:`_extend` returns, given those of both factors."""
    same = [[1.0 if i == j else 0.0 for j in range(7)] for i in range(6)]
    return ufl.as_matrix([*same, *([0.0] * 6 + [slope] for slope in slopes)])


def _thirds(motion: Expr) -> list[Expr]:
    """Difference of translations and both rotations."""
    return [_part(motion, 3 * k) for k in range(3)]


def _relative(fields: dict[str, ufl.Coefficient], test: Expr, shift: Expr) -> Change:
    """Invariants of the relative frame, the end of the step moved by ``shift``."""
    (stretch, *turns), (e, *phi) = _thirds(shift), _thirds(test)
    before, after = (
        _part(fields[name], 3) - _part(fields[name], 0) for name in ("start_position", "position")
    )
    arm = Change(before, after + stretch, e)
    R_0, R_1 = _sections(fields, "start_rotation"), _sections(fields, "rotation")
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


def _sections(fields: dict[str, ufl.Coefficient], name: str) -> list[Expr]:
    """Rotations of the sections at both nodes."""
    return [_rows(fields[name], 9 * k) * _rows(fields["turn"], 9 * k) for k in range(2)]


def _in_fixed_axes(rotations: list[Expr], motion: Expr) -> Expr:
    """Difference of translations and both rotations in fixed axes from those of the nodes."""
    u, theta = (
        [R * _part(motion, 6 * side + first) for side, R in enumerate(rotations)]
        for first in (0, 3)
    )
    return _join(u[1] - u[0], *theta)


@dataclass(frozen=True)
class _End:
    """An end of a cell over the step.

    Attributes:
        start, end: rotations of the node.
        lever: mass centre of the section in node axes.
        speed: change of the inertial velocity of that.
        swing: the arm from the node's own centre to that, turned by the change of the angular
            velocity, in node axes.
        momentum: change of the angular momentum about the centre, per length.
    """

    start: Expr
    end: Expr
    lever: Expr
    speed: Expr
    swing: Expr
    momentum: Expr


def _end(fields: dict[str, ufl.Coefficient], side: int, shift: Expr, rate: Expr) -> _End:
    """One end; its node moves by ``shift`` at the end of the step, and its rates ``rate`` times."""

    def triples(name: str) -> tuple[Expr, Expr]:
        return _part(fields[name], 6 * side), _part(fields[name], 6 * side + 3)

    (u, theta), phi = (_part(shift, 6 * side + i) for i in (0, 3)), triples("increments")[1]
    start, end = (_rows(fields[name], 9 * side) for name in ("start_rotation", "rotation"))
    _, c, rotary = _about_centre(symmetric(fields["inertia"]))
    turn, centre = _rows(fields["turn"], 9 * side), _part(fields["centres"], 3 * side)
    lever, J = turn * c, turn * rotary * turn.T
    arm = lever - centre
    (v_0, o_0), (v_1, o_1) = triples("start_rates"), triples("rates")
    v_1 += rate * end * (u + ufl.cross(theta, centre))
    # with the change of the Cayley vector
    o_1 += rate * (theta + 0.5 * ufl.cross(phi, theta) + 0.25 * ufl.dot(phi, theta) * phi)
    end += end * skew(theta)
    return _End(
        start, end, lever,
        speed=v_1 - v_0 + end * ufl.cross(o_1, arm) - start * ufl.cross(o_0, arm),
        swing=ufl.cross(o_1 - o_0, arm),
        momentum=end * J * o_1 - start * J * o_0,
    )  # fmt: skip


def _mass_work(
    fields: dict[str, ufl.Coefficient], constants: Expr, gravity: Expr, test: Expr, shift: Expr
) -> Expr:
    """Work of the mean inertia forces less weights on a test motion of the nodes."""
    per_step, length = constants[1], fields["length"]
    mass = length * fields["inertia"][0]
    ends = [_end(fields, side, shift, constants[2]) for side in range(2)]
    work = 0
    for side, (own, other) in enumerate((ends, ends[::-1])):
        force = per_step / 6 * mass * (2 * own.speed + other.speed)
        loaded = force - mass / 2 * gravity
        mean = 0.5 * (own.start + own.end)
        moment = ufl.cross(mean * own.lever, loaded) + per_step * length / 2 * own.momentum
        moment += ufl.cross(mean * own.swing / (4 * per_step), force)
        work += ufl.dot(own.end * _part(test, 6 * side), loaded)
        work += ufl.dot(own.end * _part(test, 6 * side + 3), moment)
    return work


def _stress(fields: dict[str, ufl.Coefficient], constants: Expr, d: Change) -> Expr:
    """Stress at the mean twist, with damping and with numerical dissipation."""
    change = d.end - d.start
    stretch = d.mean - fields["relative_twist"] + fields["damping"] * constants[1] * change
    stretch += constants[0] * (change - fields["last_change"])
    return symmetric(fields["stiffness"]) * (stretch / fields["length"])


@cache
def beam_energy_forms() -> BeamEnergyForms:
    """Build the forms on an abstract interval mesh in three dimensions.

    Their constants are half the dissipation, 1/h, the change of rates with increments, and gravity.
    """
    mesh = interval_mesh()
    fields, local = _coefficients(mesh), constant_field(mesh, 12)
    test, trial = (
        make(local.ufl_function_space()) for make in (ufl.TestFunction, ufl.TrialFunction)
    )
    # small motions from the state at the end in fixed axes, for the derivatives alone
    motion, shift = (constant_field(mesh, 9) for _ in range(2))
    constants, gravity = ufl.Constant(mesh, shape=(3,)), ufl.Constant(mesh, shape=(3,))
    y = _relative(fields, motion, shift)

    def still(expression: Expr) -> Expr:
        expanded = ufl.algorithms.expand_derivatives(expression)
        return ufl.replace(expanded, {motion: ufl.zero(9), shift: ufl.zero(9), local: ufl.zero(12)})

    by_motion = ufl.diff(y.d, motion)
    bent = still(ufl.diff(by_motion, shift))
    by_motion, by_shift = still(by_motion), still(ufl.diff(y.end, shift))
    trace = ufl.variable(still(y.end[6]))
    factors = _factors(Change(y.start[6], trace, ufl.as_ufl(1.0)))
    first, last, rates = ([v[k] for v in (f.values for f in factors)] for k in range(3))
    # the work is linear in the change of the invariants: eight forces, 8 x 8 second derivatives
    end = ufl.variable(_extend(still(y.end), last))
    d = ufl.variable(ufl.as_vector([ufl.as_ufl(0.0)] * 8))
    twist = _log(Change(_extend(y.start, first), end, d))
    force = ufl.diff(ufl.dot(_stress(fields, constants, twist), twist.d), d)
    # the same with the trace in the place of both factors, and by small motions
    change = _extension(rates)
    own, slopes = change.T * force, [ufl.diff(f, trace) for f in last]
    steepening = sum(force[6 + k] * ufl.diff(rate, trace) for k, rate in enumerate(rates))
    last_entry = [[steepening if i == j == 6 else 0.0 for j in range(7)] for i in range(7)]
    K = change.T * ufl.diff(force, end) * _extension(slopes) + ufl.as_matrix(last_entry)
    fixed_force = by_motion.T * own
    fixed_K = by_motion.T * K * by_shift + ufl.dot(own, bent)
    # and in the axes of the nodes, which turn with them
    rotations = [_rows(fields["rotation"], 9 * side) for side in range(2)]
    turned = [R * skew(_part(trial, 6 * side + 3)) for side, R in enumerate(rotations)]
    work, change_of_axes = _in_fixed_axes(rotations, test), _in_fixed_axes(turned, test)
    tangent = ufl.dot(work, fixed_K * _in_fixed_axes(rotations, trial))
    tangent += ufl.dot(fixed_force, change_of_axes)
    masses = _mass_work(fields, constants, gravity, test, local)
    tangent += still(ufl.derivative(masses, local, trial))
    residual = ufl.dot(fixed_force, work) + still(masses)
    return BeamEnergyForms(_work(mesh, residual), _work(mesh, tangent), fields)
