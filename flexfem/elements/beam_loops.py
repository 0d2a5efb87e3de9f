# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops over the cells of the beam mesh around the FFCx kernels of ``forms.beam``."""

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.core.frame_kernels import step_rates_into
from flexfem.la.kernel import tabulate
from flexfem.la.lanes import LANES
from flexfem.lie.compiled import inlined, kernel, subroutine

__all__ = ["add_action", "add_residual", "add_tangent", "law_values", "linear_resultants"]

# positions in the order of forms.beam.BeamForms.coefficients
_POSITION, _ROTATION, _VELOCITY, _ACCELERATION = 0, 1, 2, 3
_TWIST, _LENGTH, _DAMPING, _MATERIAL, _INERTIA = 4, 5, 6, 7, 8
_TURN, _VELOCITY_CHANGE, _ACCELERATION_CHANGE = 9, 10, 11


@inlined
def _put_twist(
    data: FloatArray, lane: int, at: int, values: FloatArray, node: int, turned: bool,
    Q: FloatArray, cell: int, side: int,
) -> None:  # fmt: skip
    """Write a nodal twist, turned into the section axes if need be."""
    for half in range(0, 6, 3):
        for i in range(3):
            if turned:
                data[at + half + i, lane] = (
                    Q[cell, side, i] * values[node, half]
                    + Q[cell, side, i + 3] * values[node, half + 1]
                    + Q[cell, side, i + 6] * values[node, half + 2]
                )
            else:
                data[at + half + i, lane] = values[node, half + i]


@inlined
def _put_frame(
    data: FloatArray, lane: int, offsets: IntArray, side: int, frames: FloatArray, node: int,
    turned: bool, Q: FloatArray, cell: int,
) -> None:  # fmt: skip
    """Write the section frame at one end of a cell."""
    if offsets[_POSITION] >= 0:
        at = offsets[_POSITION] + 3 * side
        for i in range(3):
            data[at + i, lane] = frames[node, i]
    if offsets[_ROTATION] >= 0:
        to = offsets[_ROTATION] + 9 * side
        for i in range(3):
            k = 3 + 3 * i
            for j in range(3):
                if turned:
                    data[to + 3 * i + j, lane] = (
                        frames[node, k] * Q[cell, side, j]
                        + frames[node, k + 1] * Q[cell, side, 3 + j]
                        + frames[node, k + 2] * Q[cell, side, 6 + j]
                    )
                else:
                    data[to + 3 * i + j, lane] = frames[node, k + j]


@inlined
def _put_cell(
    data: FloatArray, lane: int, offsets: IntArray, c: int, twists: FloatArray, lengths: FloatArray,
    damping: FloatArray,
) -> None:  # fmt: skip
    """Write the constant data of one cell."""
    if offsets[_TWIST] >= 0:
        for i in range(6):
            data[offsets[_TWIST] + i, lane] = twists[c, i]
    data[offsets[_LENGTH], lane] = lengths[c]
    if offsets[_DAMPING] >= 0:
        data[offsets[_DAMPING], lane] = damping[c]


@inlined
def _put_laws(
    data: FloatArray, lane: int, offsets: IntArray, laws: FloatArray, section: int
) -> None:
    """Write inertia and stiffness or parameters of a section: they stay while the section does."""
    for i in range(21):
        data[offsets[_INERTIA] + i, lane] = laws[section, i]
    if offsets[_MATERIAL] >= 0:
        for i in range(laws.shape[1] - 21):
            data[offsets[_MATERIAL] + i, lane] = laws[section, 21 + i]


@inlined
def _add_force(
    cells: IndexArray, c: int, turned: bool, Q: FloatArray, turn: int, force: FloatArray,
    lane: int, scale: float, residual: FloatArray,
) -> None:  # fmt: skip
    """Add the force on both ends of a cell to its nodes, turned back into their axes."""
    for side in range(2):
        node = cells[c, side]
        for half in range(0, 6, 3):
            at = 6 * side + half
            for i in range(3):
                value = force[at + i, lane]
                if turned:
                    value = (
                        Q[turn, side, 3 * i] * force[at, lane]
                        + Q[turn, side, 3 * i + 1] * force[at + 1, lane]
                        + Q[turn, side, 3 * i + 2] * force[at + 2, lane]
                    )
                residual[node, half + i] += scale * value


@kernel
def add_residual(
    address: int, offsets: IntArray, gravity: FloatArray, cells: IndexArray, turned: BoolArray,
    turns: FloatArray, twists: FloatArray, lengths: FloatArray, damping: FloatArray,
    sections: IntArray, laws: FloatArray, frames: FloatArray, velocity: FloatArray,
    acceleration: FloatArray, scale: float, residual: FloatArray,
) -> None:  # fmt: skip
    """Add ``scale`` times the force residual of all cells to ``residual`` (n, 6)."""
    data, force = np.empty((offsets[-1], LANES)), np.empty((12, LANES))
    points, law = np.zeros(6), np.full(LANES, -1)
    points[3] = 1.0  # the form does not depend on the size of the reference cell
    count = cells.shape[0]
    for first in range(0, count, LANES):
        for lane in range(LANES):
            c = min(first + lane, count - 1)  # the last cell fills the last batch
            at, turn = turned[c], c * turned[c]
            for side in range(2):
                node, to = cells[c, side], 6 * side
                _put_frame(data, lane, offsets, side, frames, node, at, turns, turn)
                _put_twist(
                    data, lane, offsets[_VELOCITY] + to, velocity, node, at, turns, turn, side
                )
                _put_twist(
                    data, lane, offsets[_ACCELERATION] + to, acceleration, node, at, turns, turn,
                    side,
                )  # fmt: skip
            _put_cell(data, lane, offsets, c, twists, lengths, damping)
            if sections[c] != law[lane]:
                law[lane] = sections[c]
                _put_laws(data, lane, offsets, laws, law[lane])
        force[:] = 0.0
        tabulate(address, force, data, gravity, points)
        for lane in range(min(LANES, count - first)):
            c = first + lane
            _add_force(cells, c, turned[c], turns, c * turned[c], force, lane, scale, residual)


@kernel
def add_action(
    address: int, offsets: IntArray, gravity: FloatArray, shifts: FloatArray, inertial: bool,
    cells: IndexArray, turned: BoolArray, turns: FloatArray, twists: FloatArray,
    lengths: FloatArray, damping: FloatArray, sections: IntArray, laws: FloatArray,
    frames: FloatArray, velocity: FloatArray, acceleration: FloatArray, increments: FloatArray,
    step: FloatArray, scale: float, residual: FloatArray,
) -> None:  # fmt: skip
    """Add ``scale (k K + C dv + M dw) step`` of all cells to ``residual`` (n, 6).

    ``shifts`` holds dv/dn, dw/dn and k, see ``frame_kernels.step_rates_into`` for dv and dw.
    """
    data, force = np.empty((offsets[-1], 1)), np.empty((12, 1))
    by_v, by_w, change = np.empty(36), np.empty(36), np.empty((2, 6))
    points, law = np.zeros(6), -1
    points[3] = 1.0
    for c in range(cells.shape[0]):
        at, turn = turned[c], c * turned[c]
        for side in range(2):
            node, to = cells[c, side], 6 * side
            _put_frame(data, 0, offsets, side, frames, node, at, turns, turn)
            _put_twist(data, 0, offsets[_VELOCITY] + to, velocity, node, at, turns, turn, side)
            first = offsets[_ACCELERATION] + to
            _put_twist(data, 0, first, acceleration, node, at, turns, turn, side)
            first = offsets[_TURN] + to
            _put_twist(data, 0, first, step, node, at, turns, turn, side)
            for i in range(6):
                data[first + i, 0] *= shifts[2]
            step_rates_into(
                inertial, increments[node], velocity[node], acceleration[node], shifts, by_v, by_w
            )
            for i in range(6):
                change[0, i], change[1, i] = 0.0, 0.0
                for j in range(6):
                    change[0, i] += by_v[6 * i + j] * step[node, j]
                    change[1, i] += by_w[6 * i + j] * step[node, j]
            first = offsets[_VELOCITY_CHANGE] + to
            _put_twist(data, 0, first, change, 0, at, turns, turn, side)
            first = offsets[_ACCELERATION_CHANGE] + to
            _put_twist(data, 0, first, change, 1, at, turns, turn, side)
        _put_cell(data, 0, offsets, c, twists, lengths, damping)
        if sections[c] != law:
            law = sections[c]
            _put_laws(data, 0, offsets, laws, law)
        force[:] = 0.0
        tabulate(address, force, data, gravity, points)
        _add_force(cells, c, at, turns, turn, force, 0, scale, residual)


@subroutine
def _turn_matrix(Q1: FloatArray, Q2: FloatArray, K: FloatArray, work: FloatArray) -> None:
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


@subroutine
def _combine(
    K: FloatArray, C: FloatArray, M: FloatArray, by_v: FloatArray, by_w: FloatArray,
    stiffness: float, scale: float, values: FloatArray,
) -> None:  # fmt: skip
    """``scale (k K + C dv + M dw)`` of one cell; ``by_v``, ``by_w`` (2, 36) of both ends."""
    for i in range(12):
        for side in range(2):
            for j in range(6):
                total = stiffness * K[12 * i + 6 * side + j]
                for k in range(6):
                    total += C[12 * i + 6 * side + k] * by_v[side, 6 * k + j]
                    total += M[12 * i + 6 * side + k] * by_w[side, 6 * k + j]
                values[12 * i + 6 * side + j] = scale * total


@kernel
def add_tangent(
    stiffness: int, stiffness_offsets: IntArray, gravity: FloatArray, inertia: int,
    inertia_offsets: IntArray, shifts: FloatArray, inertial: bool, cells: IndexArray,
    turned: BoolArray, turns: FloatArray, twists: FloatArray, lengths: FloatArray,
    damping: FloatArray, sections: IntArray, laws: FloatArray, frames: FloatArray,
    velocity: FloatArray, acceleration: FloatArray, increments: FloatArray, scale: float,
    values: FloatArray,
) -> None:  # fmt: skip
    """Write ``scale (k K + C dv + M dw)`` of all cells to ``values`` (m, 144).

    ``shifts`` holds dv/dn, dw/dn and k, see ``frame_kernels.step_rates_into`` for dv and dw.
    """
    k_data, m_data = np.empty((stiffness_offsets[-1], 1)), np.empty((inertia_offsets[-1], 1))
    K, C, M, work = np.empty(144), np.empty(144), np.empty(144), np.empty(6)
    by_v, by_w = np.empty((2, 36)), np.empty((2, 36))
    only_v, only_w = np.array([1.0, 0.0]), np.array([0.0, 1.0])
    points, law = np.zeros(6), -1
    points[3] = 1.0
    for c in range(cells.shape[0]):
        at, turn = turned[c], c * turned[c]
        for data, offsets in ((k_data, stiffness_offsets), (m_data, inertia_offsets)):
            for side in range(2):
                node = cells[c, side]
                _put_frame(data, 0, offsets, side, frames, node, at, turns, turn)
                if offsets[_VELOCITY] >= 0:
                    first = offsets[_VELOCITY] + 6 * side
                    _put_twist(data, 0, first, velocity, node, at, turns, turn, side)
                if offsets[_ACCELERATION] >= 0:
                    first = offsets[_ACCELERATION] + 6 * side
                    _put_twist(data, 0, first, acceleration, node, at, turns, turn, side)
            _put_cell(data, 0, offsets, c, twists, lengths, damping)
            if sections[c] != law:
                _put_laws(data, 0, offsets, laws, sections[c])
        law = sections[c]
        for side in range(2):
            node = cells[c, side]
            step_rates_into(
                inertial, increments[node], velocity[node], acceleration[node], shifts, by_v[side],
                by_w[side],
            )  # fmt: skip
        K[:], C[:], M[:] = 0.0, 0.0, 0.0
        tabulate(stiffness, K, k_data, gravity, points)
        tabulate(inertia, C, m_data, only_v, points)
        tabulate(inertia, M, m_data, only_w, points)
        if at:
            for matrix in (K, C, M):
                _turn_matrix(turns[c, 0], turns[c, 1], matrix, work)
        _combine(K, C, M, by_v, by_w, shifts[2], scale, values[c])


@kernel
def linear_resultants(
    strain: FloatArray, sections: IntArray, stiffness: FloatArray, resultant: FloatArray
) -> None:
    """Resultants (m, 6) of all cells from their strains by the stiffness (s, 6, 6)."""
    for c in range(sections.size):
        D = stiffness[sections[c]]
        for i in range(6):
            resultant[c, i] = 0.0
            for j in range(6):
                resultant[c, i] += D[i, j] * strain[c, j]


@kernel
def law_values(
    address: int, offsets: IntArray, strain: FloatArray, rate: FloatArray, sections: IntArray,
    parameters: FloatArray, values: FloatArray,
) -> None:  # fmt: skip
    """Write what ``forms.beam_law.LawForm`` lists to ``values`` (m, k).

    ``parameters`` (s, p) are those of each section.
    """
    data, nothing, points = np.zeros(offsets[-1]), np.zeros(1), np.zeros(6)
    points[3] = 1.0
    for c in range(sections.size):
        if offsets[0] >= 0:
            for i in range(6):
                data[offsets[0] + i] = strain[c, i]
        if offsets[1] >= 0:
            for i in range(6):
                data[offsets[1] + i] = rate[c, i]
        if offsets.size > 3 and offsets[2] >= 0:
            for i in range(parameters.shape[1]):
                data[offsets[2] + i] = parameters[sections[c], i]
        values[c] = 0.0
        tabulate(address, values[c], data, nothing, points)
