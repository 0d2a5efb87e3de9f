# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops for the inertia and the weight of NURBS elements.

The kinetic energy is that of masses that move with the interpolated inertial velocities of the
control points, ``1/2 sum_IJ m_IJ (R_I V_I) . (R_J V_J)`` with the constants ``m_IJ``, the integral
of ``rho A N_I N_J``, plus that of the rotary inertia lumped at the control points, as in
``forms.beam``. The force on node I is ``R_I^T sum_J m_IJ (b_J - g)`` with the inertial acceleration
``b_J = R_J (dV_J/dt + Omega_J x V_J)``, and what the lump there adds. Where mass centres lie off
the axis, velocities, accelerations and forces are those of the centres.

``nodes`` (u,) are the nodes of a group's elements, ``lumps`` (u, 6, 6) their lumps, in local axes.
"""

import numpy as np

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.core.frame_kernels import step_rates_into
from flexfem.lie._blocks import cross, triple
from flexfem.lie._coefficients import Triple
from flexfem.lie.compiled import inlined, kernel, subroutine

__all__ = [
    "accelerations_into",
    "add_inertia",
    "add_inertia_action",
    "add_inertia_tangent",
    "add_products",
    "nodal_tangent",
    "step_changes",
    "step_rates",
]


@inlined
def _sum(u: Triple, v: Triple) -> Triple:
    return u[0] + v[0], u[1] + v[1], u[2] + v[2]


@inlined
def _turned(H: FloatArray, v: Triple) -> Triple:
    """``R v`` of a frame."""
    return (
        H[3] * v[0] + H[4] * v[1] + H[5] * v[2],
        H[6] * v[0] + H[7] * v[1] + H[8] * v[2],
        H[9] * v[0] + H[10] * v[1] + H[11] * v[2],
    )


@inlined
def _turned_back(H: FloatArray, v: Triple) -> Triple:
    """``R^T v`` of a frame."""
    return (
        H[3] * v[0] + H[6] * v[1] + H[9] * v[2],
        H[4] * v[0] + H[7] * v[1] + H[10] * v[2],
        H[5] * v[0] + H[8] * v[1] + H[11] * v[2],
    )


@inlined
def _acceleration(v: FloatArray, a: FloatArray) -> Triple:
    """Inertial acceleration in local axes."""
    return _sum(triple(a, 0), cross(triple(v, 3), triple(v, 0)))


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
def accelerations_into(
    nodes: IntArray, gravity: FloatArray, frames: FloatArray, velocity: FloatArray,
    acceleration: FloatArray, b: FloatArray,
) -> None:  # fmt: skip
    """Inertial accelerations (n, 3) less that of gravity."""
    for node in nodes:
        turned = _turned(frames[node], _acceleration(velocity[node], acceleration[node]))
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
    weight = _turned_back(H, triple(gravity, 0))
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
    M: FloatArray, H: FloatArray, v: FloatArray, gravity: FloatArray, turn: Triple,
    dv: FloatArray, da: FloatArray, scale: float, work: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Add the change of :func:`_add_lump` as the node turns and ``v`` and ``a`` change."""
    weight = cross(_turned_back(H, triple(gravity, 0)), turn)
    for i in range(3):
        work[i], work[3 + i] = da[i] - weight[i], da[3 + i]
    _add(out, 0, scale, _product(M, work, 0))
    _add(out, 3, scale, _product(M, work, 3))
    linear, change = _product(M, v, 0), _product(M, dv, 0)
    spin, spin_change = triple(v, 3), triple(dv, 3)
    _add(out, 0, scale, _sum(cross(spin_change, linear), cross(spin, change)))
    angular = cross(spin_change, _product(M, v, 3))
    _add(out, 3, scale, _sum(angular, cross(spin, _product(M, dv, 3))))
    both = _sum(cross(triple(dv, 0), linear), cross(triple(v, 0), change))
    _add(out, 3, scale, both)


@inlined
def _acceleration_change(
    H: FloatArray, v: FloatArray, a: FloatArray, turn: Triple, dv: FloatArray, da: FloatArray
) -> Triple:
    """Change of the inertial acceleration, inertial axes."""
    change = _sum(triple(da, 0), cross(triple(dv, 3), triple(v, 0)))
    change = _sum(change, cross(triple(v, 3), triple(dv, 0)))
    return _turned(H, _sum(change, cross(turn, _acceleration(v, a))))


@kernel
def step_rates(
    nodes: IntArray, inertial: bool, increments: FloatArray, velocity: FloatArray,
    acceleration: FloatArray, shifts: FloatArray, by_v: FloatArray, by_w: FloatArray,
) -> None:  # fmt: skip
    """Write dv, dw (n, 6, 6) of the nodes along their twists, see ``frame_kernels``."""
    v, w = np.empty(36), np.empty(36)
    for node in nodes:
        step_rates_into(
            inertial, increments[node], velocity[node], acceleration[node], shifts, v, w
        )
        for i in range(6):
            for j in range(6):
                by_v[node, i, j], by_w[node, i, j] = v[6 * i + j], w[6 * i + j]


@kernel
def step_changes(
    nodes: IntArray, inertial: bool, increments: FloatArray, velocity: FloatArray,
    acceleration: FloatArray, shifts: FloatArray, steps: FloatArray, turns: FloatArray,
    dv: FloatArray, dw: FloatArray,
) -> None:  # fmt: skip
    """Write what :func:`step_rates` gives along ``steps`` (n, 6) to ``dv``, ``dw`` (n, 6).

    ``turns`` (n, 6) gets k times the steps.
    """
    v, w = np.empty(36), np.empty(36)
    for node in nodes:
        step_rates_into(
            inertial, increments[node], velocity[node], acceleration[node], shifts, v, w
        )
        for i in range(6):
            turns[node, i] = shifts[2] * steps[node, i]
            dv[node, i], dw[node, i] = 0.0, 0.0
            for j in range(6):
                dv[node, i] += v[6 * i + j] * steps[node, j]
                dw[node, i] += w[6 * i + j] * steps[node, j]


@kernel
def add_inertia(
    nodes: IntArray, cells: IndexArray, masses: FloatArray, lumps: FloatArray,
    gravity: FloatArray, frames: FloatArray, velocity: FloatArray, acceleration: FloatArray,
    scale: float, residual: FloatArray,
) -> None:  # fmt: skip
    """Add ``scale`` times inertia forces less weights to ``residual`` (n, 6)."""
    b, force, work = np.zeros((len(frames), 3)), np.zeros((len(frames), 3)), np.empty(6)
    accelerations_into(nodes, gravity, frames, velocity, acceleration, b)
    add_products(cells, masses, b, force)
    for u, node in enumerate(nodes):
        H = frames[node]
        _add(residual[node], 0, scale, _turned_back(H, triple(force[node], 0)))
        _add_lump(
            lumps[u], H, velocity[node], acceleration[node], gravity, scale, work, residual[node]
        )


@kernel
def add_inertia_action(
    nodes: IntArray, cells: IndexArray, masses: FloatArray, lumps: FloatArray,
    gravity: FloatArray, frames: FloatArray, velocity: FloatArray, acceleration: FloatArray,
    steps: FloatArray, dv: FloatArray, dw: FloatArray, scale: float, residual: FloatArray,
) -> None:  # fmt: skip
    """Add the change of :func:`add_inertia` to ``residual`` (n, 6).

    ``steps`` (n, 6) are local twists by which the nodes move, ``dv`` and ``dw`` (n, 6) the changes
    of their local velocities and accelerations.
    """
    b, force, work = np.zeros((len(frames), 3)), np.zeros((len(frames), 3)), np.empty(6)
    db, change = np.zeros((len(frames), 3)), np.zeros((len(frames), 3))
    accelerations_into(nodes, gravity, frames, velocity, acceleration, b)
    add_products(cells, masses, b, force)
    for node in nodes:
        turn = triple(steps[node], 3)
        moved = _acceleration_change(
            frames[node], velocity[node], acceleration[node], turn, dv[node], dw[node]
        )
        db[node, 0], db[node, 1], db[node, 2] = moved
    add_products(cells, masses, db, change)
    for u, node in enumerate(nodes):
        H, turn = frames[node], triple(steps[node], 3)
        local = _turned_back(H, triple(force[node], 0))
        moved = _sum(_turned_back(H, triple(change[node], 0)), cross(local, turn))
        _add(residual[node], 0, scale, moved)
        _add_lump_change(
            lumps[u], H, velocity[node], gravity, turn, dv[node], dw[node], scale, work,
            residual[node],
        )  # fmt: skip


@subroutine
def nodal_tangent(
    nodes: IntArray, lumps: FloatArray, gravity: FloatArray, frames: FloatArray,
    velocity: FloatArray, acceleration: FloatArray, by_v: FloatArray, by_w: FloatArray,
    force: FloatArray, stiffness: float, moved: FloatArray, own: FloatArray,
) -> None:  # fmt: skip
    """Changes (n, 3, 6) of accelerations along local twists, and of nodal forces at fixed ones.

    ``own`` (u, 6, 6) gets the latter.
    """
    work, dv, dw, column = np.empty(6), np.empty(6), np.empty(6), np.empty(6)
    for u, node in enumerate(nodes):
        H, v, a = frames[node], velocity[node], acceleration[node]
        local = _turned_back(H, triple(force[node], 0))
        for j in range(6):
            dv[:], dw[:], column[:] = by_v[node, :, j], by_w[node, :, j], 0.0
            turn = (stiffness * (j == 3), stiffness * (j == 4), stiffness * (j == 5))
            change = _acceleration_change(H, v, a, turn, dv, dw)
            _add(column, 0, 1.0, cross(local, turn))
            _add_lump_change(lumps[u], H, v, gravity, turn, dv, dw, 1.0, work, column)
            for i in range(3):
                moved[node, i, j] = change[i]
            for i in range(6):
                own[u, i, j] = column[i]


@kernel
def add_inertia_tangent(
    nodes: IntArray, cells: IndexArray, masses: FloatArray, lumps: FloatArray,
    gravity: FloatArray, homes: IntArray, frames: FloatArray, velocity: FloatArray,
    acceleration: FloatArray, by_v: FloatArray, by_w: FloatArray, stiffness: float, scale: float,
    values: FloatArray,
) -> None:  # fmt: skip
    """Add the derivatives of :func:`add_inertia` to the elements' matrices (m, 36 k k).

    What belongs to a node alone goes to one of its elements: ``homes`` (u, 2) are the number of
    that element and the node's place there.
    """
    n, k = len(frames), cells.shape[1]
    b, force, width = np.zeros((n, 3)), np.zeros((n, 3)), 6 * cells.shape[1]
    moved, own = np.zeros((n, 3, 6)), np.zeros((len(nodes), 6, 6))
    accelerations_into(nodes, gravity, frames, velocity, acceleration, b)
    add_products(cells, masses, b, force)
    nodal_tangent(
        nodes, lumps, gravity, frames, velocity, acceleration, by_v, by_w, force, stiffness, moved,
        own,
    )  # fmt: skip
    for c in range(cells.shape[0]):
        for I in range(k):  # noqa: E741
            H = frames[cells[c, I]]
            for J in range(k):
                P, mass = moved[cells[c, J]], scale * masses[c, I, J]
                for i in range(3):
                    at = (6 * I + i) * width + 6 * J
                    for j in range(6):
                        turned = H[3 + i] * P[0, j] + H[6 + i] * P[1, j] + H[9 + i] * P[2, j]
                        values[c, at + j] += mass * turned
    for u in range(len(nodes)):
        c, I = homes[u, 0], homes[u, 1]  # noqa: E741
        for i in range(6):
            for j in range(6):
                values[c, (6 * I + i) * width + 6 * I + j] += scale * own[u, i, j]
