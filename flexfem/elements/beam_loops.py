# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops over the cells of the beam mesh around the FFCx kernels of ``forms.beam``."""

import numpy as np

from flexfem.la.kernel import tabulate
from flexfem.lie.compiled import kernel
from flexfem.lie.se3 import inverse_tangent_apply, inverse_tangent_into

__all__ = ["add_action", "add_residual", "add_tangent", "cell_resultants"]

# positions in the order of forms.beam.BeamForms.coefficients
_POSITION, _ROTATION, _VELOCITY, _ACCELERATION = 0, 1, 2, 3
_TWIST, _LENGTH, _DAMPING, _STIFFNESS, _INERTIA = 4, 5, 6, 7, 8
_TURN, _CHANGE = 9, 10


@kernel
def _turn(Q, v, out, at):
    """``Q^T v`` for both halves of a twist."""
    for half in range(0, 6, 3):
        for i in range(3):
            out[at + half + i] = (
                Q[i] * v[half] + Q[i + 3] * v[half + 1] + Q[i + 6] * v[half + 2]
            )


@kernel
def _pack_node(data, offsets, side, frame, velocity, acceleration, turned, Q):
    """Write the nodal data of one end of a cell, turned into the section axes if need be."""
    at = offsets[_POSITION] + 3 * side
    data[at : at + 3] = frame[:3]
    at = offsets[_ROTATION] + 9 * side
    if turned:
        for i in range(3):
            for j in range(3):
                k = 3 + 3 * i
                data[at + 3 * i + j] = (
                    frame[k] * Q[j] + frame[k + 1] * Q[3 + j] + frame[k + 2] * Q[6 + j]
                )
    else:
        data[at : at + 9] = frame[3:]
    at = offsets[_VELOCITY] + 6 * side
    if turned:
        _turn(Q, velocity, data, at)
    else:
        data[at : at + 6] = velocity
    if offsets[_ACCELERATION] >= 0:
        at = offsets[_ACCELERATION] + 6 * side
        if turned:
            _turn(Q, acceleration, data, at)
        else:
            data[at : at + 6] = acceleration


@kernel
def _pack_cell(data, offsets, twist, length, damping, laws):
    """Write the constant data of one cell; ``laws`` (2, 21) stiffness and inertia."""
    if offsets[_TWIST] >= 0:
        data[offsets[_TWIST] : offsets[_TWIST] + 6] = twist
    data[offsets[_LENGTH]] = length
    if offsets[_DAMPING] >= 0:
        data[offsets[_DAMPING]] = damping
    if offsets[_STIFFNESS] >= 0:
        data[offsets[_STIFFNESS] : offsets[_STIFFNESS] + 21] = laws[0]
    data[offsets[_INERTIA] : offsets[_INERTIA] + 21] = laws[1]


@kernel
def _add_force(nodes, turned, turns, force, scale, residual):
    """Add the force on both ends of a cell to its nodes, turned back into their axes."""
    for side in range(2):
        node, Q = nodes[side], turns[side]
        for half in range(0, 6, 3):
            at = 6 * side + half
            for i in range(3):
                value = force[at + i]
                if turned:
                    value = (
                        Q[3 * i] * force[at]
                        + Q[3 * i + 1] * force[at + 1]
                        + Q[3 * i + 2] * force[at + 2]
                    )
                residual[node, half + i] += scale * value


@kernel
def add_residual(
    address, offsets, gravity, cells, turned, turns, twists, lengths, damping, sections, laws,
    frames, velocity, acceleration, scale, residual,
):  # fmt: skip
    """Add ``scale`` times the force residual of all cells to ``residual`` (n, 6)."""
    data, force = np.empty(offsets[-1]), np.empty(12)
    points = np.zeros(6)
    points[3] = 1.0  # the form does not depend on the size of the reference cell
    for c in range(cells.shape[0]):
        for side in range(2):
            node = cells[c, side]
            _pack_node(
                data, offsets, side, frames[node], velocity[node], acceleration[node],
                turned[c], turns[c * turned[c], side],
            )  # fmt: skip
        _pack_cell(data, offsets, twists[c], lengths[c], damping[c], laws[sections[c]])
        force[:] = 0.0
        tabulate(address, force, data, gravity, points)
        _add_force(cells[c], turned[c], turns[c * turned[c]], force, scale, residual)


@kernel
def add_action(
    address, offsets, constants, stiffness_factor, cells, turned, turns, twists, lengths, damping,
    sections, laws, frames, velocity, increments, step, scale, residual,
):  # fmt: skip
    """Add ``scale (k K + (c C + m M) T^-1) step`` of all cells to ``residual`` (n, 6).

    ``constants`` holds gravity, c and m, ``stiffness_factor`` is k.
    """
    data, force = np.empty(offsets[-1]), np.empty(12)
    turn, change = np.empty(6), np.empty(6)
    points, nothing = np.zeros(6), np.zeros(6)
    points[3] = 1.0
    for c in range(cells.shape[0]):
        for side in range(2):
            node, Q = cells[c, side], turns[c * turned[c], side]
            _pack_node(
                data, offsets, side, frames[node], velocity[node], nothing, turned[c], Q
            )
            inverse_tangent_apply(increments[node], step[node], change)
            for i in range(6):
                turn[i] = stiffness_factor * step[node, i]
            at, to = offsets[_TURN] + 6 * side, offsets[_CHANGE] + 6 * side
            if turned[c]:
                _turn(Q, turn, data, at)
                _turn(Q, change, data, to)
            else:
                data[at : at + 6] = turn
                data[to : to + 6] = change
        _pack_cell(data, offsets, twists[c], lengths[c], damping[c], laws[sections[c]])
        force[:] = 0.0
        tabulate(address, force, data, constants, points)
        _add_force(cells[c], turned[c], turns[c * turned[c]], force, scale, residual)


@kernel
def _turn_matrix(Q1, Q2, K, work):
    """``K <- P K P^T`` with the block diagonal P of both ends' turns."""
    for block in range(4):
        Q = Q1 if block < 2 else Q2
        for j in range(12):
            for i in range(3):
                work[i] = 0.0
                for k in range(3):
                    work[i] += Q[3 * i + k] * K[(3 * block + k) * 12 + j]
            for i in range(3):
                K[(3 * block + i) * 12 + j] = work[i]
    for block in range(4):
        Q = Q1 if block < 2 else Q2
        for i in range(12):
            for j in range(3):
                work[j] = 0.0
                for k in range(3):
                    work[j] += K[i * 12 + 3 * block + k] * Q[3 * j + k]
            for j in range(3):
                K[i * 12 + 3 * block + j] = work[j]


@kernel
def add_tangent(
    stiffness, stiffness_offsets, gravity, inertia, inertia_offsets, shifts, cells, turned, turns,
    twists, lengths, damping, sections, laws, frames, velocity, increments, scale, values,
):  # fmt: skip
    """Write ``scale (k K + (c C + m M) T^-1)`` of all cells to ``values`` (m, 144).

    ``shifts`` holds c, m and k. T is the tangent operator of each node's increment over the step:
    velocities depend on the increment, and ``T^-1`` turns local twists into its change.
    """
    k_data, m_data = np.empty(stiffness_offsets[-1]), np.empty(inertia_offsets[-1])
    K, M, T, work = np.empty(144), np.empty(144), np.empty((2, 36)), np.empty(6)
    points = np.zeros(6)
    points[3] = 1.0
    nothing = np.zeros(6)
    for c in range(cells.shape[0]):
        for side in range(2):
            node, Q = cells[c, side], turns[c * turned[c], side]
            _pack_node(
                k_data, stiffness_offsets, side, frames[node], velocity[node], nothing,
                turned[c], Q,
            )  # fmt: skip
            _pack_node(
                m_data, inertia_offsets, side, frames[node], velocity[node], nothing,
                turned[c], Q,
            )  # fmt: skip
            inverse_tangent_into(increments[node], T[side])
        law = laws[sections[c]]
        _pack_cell(k_data, stiffness_offsets, twists[c], lengths[c], damping[c], law)
        _pack_cell(m_data, inertia_offsets, twists[c], lengths[c], damping[c], law)
        K[:], M[:] = 0.0, 0.0
        tabulate(stiffness, K, k_data, gravity, points)
        tabulate(inertia, M, m_data, shifts, points)
        if turned[c]:
            _turn_matrix(turns[c, 0], turns[c, 1], K, work)
            _turn_matrix(turns[c, 0], turns[c, 1], M, work)
        for i in range(12):
            for side in range(2):
                for j in range(6):
                    total = shifts[2] * K[12 * i + 6 * side + j]
                    for k in range(6):
                        total += M[12 * i + 6 * side + k] * T[side, 6 * k + j]
                    values[c, 12 * i + 6 * side + j] = scale * total


@kernel
def cell_resultants(twists, initial, lengths, sections, stiffness, strain, resultant):
    """Strain and resultants (m, 6) from the relative twists of all cells (without damping)."""
    for c in range(lengths.size):
        D = stiffness[sections[c]]
        for i in range(6):
            strain[c, i] = (twists[c, i] - initial[c, i]) / lengths[c]
        for i in range(6):
            resultant[c, i] = 0.0
            for j in range(6):
                resultant[c, i] += D[i, j] * strain[c, j]
