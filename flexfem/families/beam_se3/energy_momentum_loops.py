# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops over the cells of the beam mesh around the kernels of ``forms.beam_energy``."""

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.nodes.step_kernels import StepNodes, momentum_force, momentum_tangent, turn_back
from flexfem.families.beam_se3.energy_momentum_inertia import (
    StepCells,
    add_mass_tangent,
    mass_force,
)
from flexfem.kernels.compiled import inlined, kernel, subroutine
from flexfem.kernels.ffcx import tabulate
from flexfem.kernels.records import Memory, unpack
from flexfem.lie._blocks import triple

__all__ = ["add_force", "add_tangent", "relative_frames"]

# positions in the order of forms.beam_energy.BeamEnergyForms.coefficients
_ARM, _ROTATION, _START_ARM, _START_ROTATION = 0, 1, 2, 3
_TWIST, _LAST, _LENGTH, _DAMPING, _STIFFNESS = 4, 5, 6, 7, 8


@inlined
def _put_rotation(
    data: FloatArray, at: int, H: FloatArray, cells: StepCells, c: int, side: int
) -> None:
    """Write the rotation of the section at one end of a cell."""
    turned = cells.turned[c]
    Q = cells.turns[c * turned, side]
    for i in range(3):
        k = 3 + 3 * i
        for j in range(3):
            if turned:
                data[at + 3 * i + j] = H[k] * Q[j] + H[k + 1] * Q[3 + j] + H[k + 2] * Q[6 + j]
            else:
                data[at + 3 * i + j] = H[k + j]


@inlined
def _put_cell(cells: StepCells, c: int, nodes: StepNodes, data: FloatArray) -> None:
    """Write all data of a cell."""
    frames0, frames, offsets = nodes.frames0, nodes.frames, cells.offsets
    first, second, section = cells.nodes[c, 0], cells.nodes[c, 1], cells.section[c]
    for i in range(3):
        data[offsets[_ARM] + i] = frames[second, i] - frames[first, i]
        data[offsets[_START_ARM] + i] = frames0[second, i] - frames0[first, i]
    for side in range(2):
        node, at = cells.nodes[c, side], 9 * side
        _put_rotation(data, offsets[_ROTATION] + at, frames[node], cells, c, side)
        _put_rotation(data, offsets[_START_ROTATION] + at, frames0[node], cells, c, side)
    for i in range(6):
        data[offsets[_TWIST] + i] = cells.constants[c, i]
        data[offsets[_LAST] + i] = cells.constants[c, 6 + i]
    data[offsets[_LENGTH]] = cells.constants[c, 12]
    data[offsets[_DAMPING]] = cells.constants[c, 13]
    for i in range(21):
        data[offsets[_STIFFNESS] + i] = cells.sections[section, 21 + i]


@inlined
def _node_force(force: FloatArray, side: int, H: FloatArray, out: FloatArray) -> None:
    """Internal force on one end in its axes at the end of the step."""
    sign = 1.0 if side == 1 else -1.0
    f, m = turn_back(H, triple(force, 0)), turn_back(H, triple(force, 3 + 3 * side))
    for i in range(3):
        out[i], out[3 + i] = sign * f[i], m[i]


@kernel
def add_force(cells: Memory, nodes: Memory, scale: float) -> None:
    """Add ``scale`` times the mean force of all cells over the step to the residual of the nodes.

    Args:
        cells: ``StepCells``.
        nodes: ``StepNodes``.
        scale: see above.
    """
    own, state = unpack(StepCells, cells), unpack(StepNodes, nodes)
    frames, residual, law = state.frames, state.residual, state.law
    data, force, out = np.empty(own.offsets[-1]), np.empty(9), np.empty(12)
    points, h = np.zeros(6), 1.0 / law[1]
    points[3] = 1.0  # the form does not depend on the size of the reference cell
    for c in range(own.nodes.shape[0]):
        _put_cell(own, c, state, data)
        force[:] = 0.0
        tabulate(own.force, force, data, law, points)  # type: ignore[call-arg]
        for side in range(2):
            node = own.nodes[c, side]
            _node_force(force, side, frames[node], out)
            for i in range(6):
                residual[node, i] += scale * out[i]
            mass_force(own, c, side, state, h, out)
            for i in range(6):
                residual[node, i] += scale * out[6 + i]
            momentum_force(own.ends[c, side, 3:], state, node, h, out)
            for i in range(6):
                residual[node, i] += scale * out[6 + i]


@inlined
def _entry(K: FloatArray, a: int, i: int, b: int, j: int) -> float:
    """Entry of the stiffness between components i, j (0 to 5) of both ends, inertial axes."""
    row, column = i if i < 3 else 3 * a + i, j if j < 3 else 3 * b + j
    sign = 1.0
    if i < 3 and a == 0:
        sign = -sign
    if j < 3 and b == 0:
        sign = -sign
    value: float = sign * K[9 * row + column]
    return value


@subroutine
def _turn_blocks(
    K: FloatArray, first: FloatArray, second: FloatArray, a: int, b: int, work: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Write the 6x6 block of ends (a, b) in their own axes to ``out`` (12, 12)."""
    Ha, Hb = (first if a == 0 else second), (first if b == 0 else second)
    for i in range(6):
        for half in range(0, 6, 3):
            for k in range(3):
                work[i, half + k] = _entry(K, a, i, b, half + k)
            v = turn_back(Hb, (work[i, half], work[i, half + 1], work[i, half + 2]))
            for k in range(3):
                work[i, half + k] = v[k]
    for j in range(6):
        for half in range(0, 6, 3):
            v = turn_back(Ha, (work[half, j], work[half + 1, j], work[half + 2, j]))
            for k in range(3):
                out[6 * a + half + k, 6 * b + j] = v[k]


@kernel
def add_tangent(cells: Memory, nodes: Memory, scale: float, values: FloatArray) -> None:
    """Write the derivatives of :func:`add_force` along local twists to ``values`` (m, 144)."""
    own, state = unpack(StepCells, cells), unpack(StepNodes, nodes)
    frames, law = state.frames, state.law
    data, force, K = np.empty(own.offsets[-1]), np.empty(9), np.empty(81)
    out, work, lump = np.empty(12), np.empty((6, 6)), np.empty((6, 6))
    points, h = np.zeros(6), 1.0 / law[1]
    points[3] = 1.0
    for c in range(own.nodes.shape[0]):
        _put_cell(own, c, state, data)
        force[:], K[:] = 0.0, 0.0
        tabulate(own.force, force, data, law, points)  # type: ignore[call-arg]
        tabulate(own.stiffness, K, data, law, points)
        first, second = frames[own.nodes[c, 0]], frames[own.nodes[c, 1]]
        result = values[c].reshape(12, 12)
        for a in range(2):
            node = own.nodes[c, a]
            mass_force(own, c, a, state, h, out)
            for b in range(2):
                _turn_blocks(K, first, second, a, b, work, result)
                add_mass_tangent(own, c, a, b, state, h, out, result)
            _node_force(force, a, frames[node], out)
            momentum_tangent(own.ends[c, a, 3:], state, node, h, lump)
            for half in range(0, 6, 3):  # the node's axes turn: f x theta
                for k in range(3):
                    p, q = (k + 1) % 3, (k + 2) % 3
                    lump[half + k, 3 + q] += out[half + p]
                    lump[half + k, 3 + p] -= out[half + q]
            for i in range(6):
                for j in range(6):
                    result[6 * a + i, 6 * a + j] += lump[i, j]
        for i in range(144):
            values[c, i] *= scale


@kernel
def relative_frames(cells: Memory, frames: FloatArray, out: FloatArray) -> None:
    """Frames (m, 12) of the second ends of all cells relative to the first ones."""
    own, R = unpack(StepCells, cells), np.empty((2, 9))
    nodes = own.nodes
    for c in range(nodes.shape[0]):
        for side in range(2):
            _put_rotation(R[side], 0, frames[nodes[c, side]], own, c, side)
        for i in range(3):
            out[c, i] = 0.0
            for k in range(3):
                arm = frames[nodes[c, 1], k] - frames[nodes[c, 0], k]
                out[c, i] += R[0, 3 * k + i] * arm
            for j in range(3):
                total = 0.0
                for k in range(3):
                    total += R[0, 3 * k + i] * R[1, 3 * k + j]
                out[c, 3 + 3 * i + j] = total
