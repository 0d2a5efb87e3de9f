# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops for the inertia, the weight and the momenta of NURBS elements.

The kinetic energy is that of masses that move with the interpolated inertial velocities of the
control points, ``1/2 sum_IJ m_IJ (R_I V_I) . (R_J V_J)`` with the constants ``m_IJ``, the integral
of ``rho A N_I N_J``, plus that of the rotary inertia lumped at the control points, as in
``forms.beam``. The force on node I is ``R_I^T sum_J m_IJ (b_J - g)`` with the inertial acceleration
``b_J = R_J (dV_J/dt + Omega_J x V_J)``, plus the inertia force of the lump there. Where mass
centres are eccentric, velocities, accelerations and forces are those of the centres.
"""

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.core.nodes.frame_kernels import Nodes, step_rates_into
from flexfem.core.nodes.motion import ANGULAR, KINETIC, add_motion, centre_into
from flexfem.core.nodes.step_kernels import add, turn, turn_back
from flexfem.kernels.compiled import inlined, kernel, subroutine
from flexfem.kernels.records import Float3D, Float4D, Int1D, Int2D, Memory, Record, unpack
from flexfem.lie._blocks import cross, triple
from flexfem.lie._coefficients import Triple

__all__ = [
    "MassiveElements",
    "NodalMasses",
    "accelerations_into",
    "add_element_motion",
    "add_inertia",
    "add_inertia_action",
    "add_inertia_tangent",
    "add_products",
    "nodal_tangent",
    "step_changes",
    "step_rates",
]


class NodalMasses(Record):
    """Masses of m elements with k nodes each, u nodes in all.

    Attributes:
        nodes: (u,) the nodes.
        lumps: (u, 6, 6) inertia lumped at them, in local axes.
        cells: (m, k) nodes of the elements.
        masses: (m, k, k) consistent masses, kg.
    """

    nodes: Int1D
    lumps: Float3D
    cells: Int2D
    masses: Float3D


@inlined
def _acceleration(v: FloatArray, a: FloatArray) -> Triple:
    """Inertial acceleration in local axes."""
    return add(triple(a, 0), 1.0, cross(triple(v, 3), triple(v, 0)))


@inlined
def _product(M: FloatArray, v: FloatArray, row: int) -> Triple:
    """Three rows of ``M v``."""
    first, second, third = 0.0, 0.0, 0.0
    for j in range(6):
        first += M[row, j] * v[j]
        second += M[row + 1, j] * v[j]
        third += M[row + 2, j] * v[j]
    return first, second, third


@inlined
def _add(out: FloatArray, at: int, scale: float, v: Triple) -> None:
    out[at] += scale * v[0]
    out[at + 1] += scale * v[1]
    out[at + 2] += scale * v[2]


@inlined
def accelerations_into(nodes: IntArray, state: Nodes, gravity: FloatArray, b: FloatArray) -> None:
    """Inertial accelerations (n, 3) of some nodes less that of gravity."""
    frames, velocity, acceleration = state.frames, state.velocity, state.acceleration
    for node in nodes:
        turned = turn(frames[node], _acceleration(velocity[node], acceleration[node]))
        for i in range(3):
            b[node, i] = turned[i] - gravity[i]


@inlined
def add_products(cells: IndexArray, masses: FloatArray, b: FloatArray, force: FloatArray) -> None:
    """Add the consistent masses (m, k, k) times accelerations (n, 3) to forces (n, 3)."""
    count, k = cells.shape
    for c in range(count):
        for I in range(k):  # noqa: E741
            for J in range(k):
                for i in range(3):
                    force[cells[c, I], i] += masses[c, I, J] * b[cells[c, J], i]


@inlined
def _add_lump(
    M: FloatArray, H: FloatArray, v: FloatArray, a: FloatArray, gravity: FloatArray, scale: float,
    work: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Add ``scale (M (a - g) - ad_v^T M v)`` to ``out`` (6,)."""
    weight = turn_back(H, triple(gravity, 0))
    for i in range(3):
        work[i], work[3 + i] = a[i] - weight[i], a[3 + i]
    _add(out, 0, scale, _product(M, work, 0))
    _add(out, 3, scale, _product(M, work, 3))
    linear, spin = _product(M, v, 0), triple(v, 3)
    _add(out, 0, scale, cross(spin, linear))
    _add(out, 3, scale, cross(spin, _product(M, v, 3)))
    _add(out, 3, scale, cross(triple(v, 0), linear))


@inlined
def _add_lump_change(
    M: FloatArray, v: FloatArray, weight: Triple, dv: FloatArray, da: FloatArray, scale: float,
    work: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Add the change of :func:`_add_lump` as ``v`` and ``a`` change, and ``weight``, gravity's."""
    for i in range(3):
        work[i], work[3 + i] = da[i] - weight[i], da[3 + i]
    _add(out, 0, scale, _product(M, work, 0))
    _add(out, 3, scale, _product(M, work, 3))
    linear, change = _product(M, v, 0), _product(M, dv, 0)
    spin, spin_change = triple(v, 3), triple(dv, 3)
    _add(out, 0, scale, add(cross(spin_change, linear), 1.0, cross(spin, change)))
    angular = cross(spin_change, _product(M, v, 3))
    _add(out, 3, scale, add(angular, 1.0, cross(spin, _product(M, dv, 3))))
    both = add(cross(triple(dv, 0), linear), 1.0, cross(triple(v, 0), change))
    _add(out, 3, scale, both)


@inlined
def _acceleration_change(
    H: FloatArray, v: FloatArray, a: FloatArray, theta: Triple, dv: FloatArray, da: FloatArray
) -> Triple:
    """Change of the inertial acceleration, inertial axes."""
    change = add(triple(da, 0), 1.0, cross(triple(dv, 3), triple(v, 0)))
    change = add(change, 1.0, cross(triple(v, 3), triple(dv, 0)))
    return turn(H, add(change, 1.0, cross(theta, _acceleration(v, a))))


@kernel
def step_rates(
    nodes: IntArray, state: Memory, shifts: FloatArray, inertial: bool, rates: FloatArray
) -> None:
    """Write dv, dw (2, n, 6, 6) of some nodes along their twists.

    See ``core.nodes.frame_kernels``.
    """
    own, v, w = unpack(Nodes, state), np.empty(36), np.empty(36)
    velocity, acceleration = own.velocity, own.acceleration
    for node in nodes:
        step_rates_into(
            inertial, own.increment[node], velocity[node], acceleration[node], shifts, v, w
        )
        for i in range(6):
            for j in range(6):
                rates[0, node, i, j], rates[1, node, i, j] = v[6 * i + j], w[6 * i + j]


@kernel
def step_changes(nodes: IntArray, state: Memory, shifts: FloatArray, inertial: bool) -> None:
    """Write the changes of velocities and accelerations of some nodes along their steps.

    See ``core.nodes.frame_kernels.step_changes``.
    """
    own, v, w = unpack(Nodes, state), np.empty(36), np.empty(36)
    velocity, acceleration, steps = own.velocity, own.acceleration, own.step
    turns, dv, dw = own.turn, own.velocity_change, own.acceleration_change
    for node in nodes:
        step_rates_into(
            inertial, own.increment[node], velocity[node], acceleration[node], shifts, v, w
        )
        for i in range(6):
            turns[node, i] = shifts[2] * steps[node, i]
            dv[node, i], dw[node, i] = 0.0, 0.0
            for j in range(6):
                dv[node, i] += v[6 * i + j] * steps[node, j]
                dw[node, i] += w[6 * i + j] * steps[node, j]


@kernel
def add_inertia(masses: Memory, state: Memory, gravity: FloatArray, scale: float) -> None:
    """Add ``scale`` times inertia forces less weights to the residual of the nodes.

    Args:
        masses: :class:`NodalMasses`.
        state: ``Nodes`` that the masses move with.
        gravity: acceleration in inertial axes.
        scale: see above.
    """
    own, nodes = unpack(NodalMasses, masses), unpack(Nodes, state)
    frames, velocity, acceleration = nodes.frames, nodes.velocity, nodes.acceleration
    residual, work = nodes.residual, np.empty(6)
    b, force = np.zeros((len(frames), 3)), np.zeros((len(frames), 3))
    accelerations_into(own.nodes, nodes, gravity, b)
    add_products(own.cells, own.masses, b, force)
    for u, node in enumerate(own.nodes):
        H, v, a = frames[node], velocity[node], acceleration[node]
        _add(residual[node], 0, scale, turn_back(H, triple(force[node], 0)))
        _add_lump(own.lumps[u], H, v, a, gravity, scale, work, residual[node])


@kernel
def add_inertia_action(masses: Memory, state: Memory, gravity: FloatArray, scale: float) -> None:
    """Add the change of :func:`add_inertia` as the nodes move, see :func:`step_changes`."""
    own, nodes = unpack(NodalMasses, masses), unpack(Nodes, state)
    frames, velocity, acceleration = nodes.frames, nodes.velocity, nodes.acceleration
    steps, dv, dw = nodes.turn, nodes.velocity_change, nodes.acceleration_change
    residual, work = nodes.residual, np.empty(6)
    b, force = np.zeros((len(frames), 3)), np.zeros((len(frames), 3))
    db, change = np.zeros((len(frames), 3)), np.zeros((len(frames), 3))
    accelerations_into(own.nodes, nodes, gravity, b)
    add_products(own.cells, own.masses, b, force)
    for node in own.nodes:
        theta = triple(steps[node], 3)
        moved = _acceleration_change(
            frames[node], velocity[node], acceleration[node], theta, dv[node], dw[node]
        )
        db[node, 0], db[node, 1], db[node, 2] = moved
    add_products(own.cells, own.masses, db, change)
    for u, node in enumerate(own.nodes):
        H, theta = frames[node], triple(steps[node], 3)
        local = turn_back(H, triple(force[node], 0))
        moved = add(turn_back(H, triple(change[node], 0)), 1.0, cross(local, theta))
        _add(residual[node], 0, scale, moved)
        weight = cross(turn_back(H, triple(gravity, 0)), theta)
        _add_lump_change(
            own.lumps[u], velocity[node], weight, dv[node], dw[node], scale, work, residual[node]
        )


@subroutine
def nodal_tangent(
    masses: NodalMasses, state: Nodes, gravity: FloatArray, rates: FloatArray, stiffness: float,
    moved: FloatArray, own: FloatArray,
) -> None:  # fmt: skip
    """Changes of accelerations along local twists, and of nodal forces at fixed ones.

    Args:
        masses: with their nodes.
        state: of all nodes.
        gravity: acceleration in inertial axes.
        rates: (2, n, 6, 6) see :func:`step_rates`.
        stiffness: factor of the rotations.
        moved: (n, 3, 6) gets the changes of inertial accelerations.
        own: (u, 6, 6) gets those of the nodal forces.
    """
    work, dv, dw, column = np.empty(6), np.empty(6), np.empty(6), np.empty(6)
    frames, velocity, acceleration = state.frames, state.velocity, state.acceleration
    b, force = np.zeros((len(frames), 3)), np.zeros((len(frames), 3))
    accelerations_into(masses.nodes, state, gravity, b)
    add_products(masses.cells, masses.masses, b, force)
    for u, node in enumerate(masses.nodes):
        H, v, a = frames[node], velocity[node], acceleration[node]
        pull = turn_back(H, triple(gravity, 0))
        local = turn_back(H, triple(force[node], 0))
        for j in range(6):
            for i in range(6):
                dv[i], dw[i], column[i] = rates[0, node, i, j], rates[1, node, i, j], 0.0
            theta = (stiffness * (j == 3), stiffness * (j == 4), stiffness * (j == 5))
            change = _acceleration_change(H, v, a, theta, dv, dw)
            _add(column, 0, 1.0, cross(local, theta))
            _add_lump_change(masses.lumps[u], v, cross(pull, theta), dv, dw, 1.0, work, column)
            for i in range(3):
                moved[node, i, j] = change[i]
            for i in range(6):
                own[u, i, j] = column[i]


@kernel
def add_inertia_tangent(
    masses: Memory, homes: IntArray, state: Memory, gravity: FloatArray, rates: FloatArray,
    factors: FloatArray, values: FloatArray,
) -> None:  # fmt: skip
    """Add ``s`` times the derivatives of :func:`add_inertia` to the elements' matrices.

    Args:
        masses: :class:`NodalMasses`.
        homes: (u, 2) element that gets the terms of a node alone, and the node's local number
            there.
        state: ``Nodes`` that the masses move with.
        gravity: acceleration in inertial axes.
        rates: (2, n, 6, 6) see :func:`step_rates`.
        factors: (2,) factor of the stiffness, and s.
        values: (m, 36 k k).
    """
    of, nodes, scale = unpack(NodalMasses, masses), unpack(Nodes, state), factors[1]
    cells, frames = of.cells, nodes.frames
    k, width = cells.shape[1], 6 * cells.shape[1]
    moved, own = np.zeros((len(frames), 3, 6)), np.zeros((len(of.nodes), 6, 6))
    nodal_tangent(of, nodes, gravity, rates, factors[0], moved, own)
    for c in range(cells.shape[0]):
        for I in range(k):  # noqa: E741
            H = frames[cells[c, I]]
            for J in range(k):
                P, mass = moved[cells[c, J]], scale * of.masses[c, I, J]
                for i in range(3):
                    at = (6 * I + i) * width + 6 * J
                    for j in range(6):
                        turned = H[3 + i] * P[0, j] + H[6 + i] * P[1, j] + H[9 + i] * P[2, j]
                        values[c, at + j] += mass * turned
    for u in range(len(of.nodes)):
        c, I = homes[u, 0], homes[u, 1]  # noqa: E741
        for i in range(6):
            for j in range(6):
                values[c, (6 * I + i) * width + 6 * I + j] += scale * own[u, i, j]


class MassiveElements(Record):
    """Masses of m elements with k nodes each.

    Attributes:
        nodes: (m, k) control points.
        masses: (m, k, k) consistent masses, kg.
        inertias: (m, k, 6, 6) inertia of each node if all masses were lumped, in local axes.
    """

    nodes: Int2D
    masses: Float3D
    inertias: Float4D


@kernel
def add_element_motion(
    elements: Memory, chosen: BoolArray, nodes: Memory, motion: FloatArray
) -> None:
    """Add energy and momenta of the chosen elements to ``motion``.

    See ``flexfem.core.nodes.motion``.
    """
    own, state = unpack(MassiveElements, elements), unpack(Nodes, nodes)
    cells, frames, velocity = own.nodes, state.frames, state.velocity
    count, k = cells.shape
    p, way, speed, x, u = np.empty(6), np.empty(3), np.empty(3), np.empty((k, 3)), np.empty((k, 3))
    for c in range(count):
        if not chosen[c]:
            continue
        for I in range(k):  # noqa: E741
            H, v, M = frames[cells[c, I]], velocity[cells[c, I]], own.inertias[c, I]
            add_motion(H, v, M, 1.0, p, motion)
            centre_into(H, v, M, x[I], u[I])
        # from masses at the nodes to masses along the line
        for I in range(k):  # noqa: E741
            for J in range(I):
                mass = own.masses[c, I, J]
                for i in range(3):
                    way[i] = x[I, i] - x[J, i]
                    speed[i] = u[I, i] - u[J, i]
                    motion[KINETIC] -= 0.5 * mass * speed[i] * speed[i]
                for i in range(3):
                    i1, i2 = (i + 1) % 3, (i + 2) % 3
                    motion[ANGULAR + i] -= mass * (way[i1] * speed[i2] - way[i2] * speed[i1])
