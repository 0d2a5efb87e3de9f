# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops over the cells of the beam mesh around the kernels of ``forms.beam_energy``."""

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.core.step_kernels import momentum_force, momentum_tangent, turn_back
from flexfem.elements.energy_inertia import add_mass_tangent, mass_force
from flexfem.la.kernel import tabulate
from flexfem.lie._blocks import triple
from flexfem.lie.compiled import inlined, kernel, subroutine

__all__ = ["add_force", "add_tangent", "relative_frames"]

# positions in the order of forms.beam_energy.BeamEnergyForms.coefficients
_ARM, _ROTATION, _START_ARM, _START_ROTATION = 0, 1, 2, 3
_TWIST, _LAST, _LENGTH, _DAMPING, _STIFFNESS = 4, 5, 6, 7, 8


@inlined
def _put_rotation(
    data: FloatArray, at: int, H: FloatArray, turned: bool, Q: FloatArray, cell: int, side: int
) -> None:
    """Write the rotation of the section at one end of a cell."""
    for i in range(3):
        k = 3 + 3 * i
        for j in range(3):
            if turned:
                data[at + 3 * i + j] = (
                    H[k] * Q[cell, side, j]
                    + H[k + 1] * Q[cell, side, 3 + j]
                    + H[k + 2] * Q[cell, side, 6 + j]
                )
            else:
                data[at + 3 * i + j] = H[k + j]


@inlined
def _put_cell(
    data: FloatArray, offsets: IntArray, c: int, cells: IndexArray, turned: BoolArray,
    turns: FloatArray, frames0: FloatArray, frames: FloatArray, constants: FloatArray,
    section: int, laws: FloatArray,
) -> None:  # fmt: skip
    """Write all data of a cell; ``constants`` (m, 14): twist, last change, length, damping."""
    first, second = cells[c, 0], cells[c, 1]
    for i in range(3):
        data[offsets[_ARM] + i] = frames[second, i] - frames[first, i]
        data[offsets[_START_ARM] + i] = frames0[second, i] - frames0[first, i]
    at = c * turned[c]
    for side in range(2):
        node = cells[c, side]
        _put_rotation(data, offsets[_ROTATION] + 9 * side, frames[node], turned[c], turns, at, side)
        _put_rotation(
            data, offsets[_START_ROTATION] + 9 * side, frames0[node], turned[c], turns, at, side
        )
    for i in range(6):
        data[offsets[_TWIST] + i] = constants[c, i]
        data[offsets[_LAST] + i] = constants[c, 6 + i]
    data[offsets[_LENGTH]] = constants[c, 12]
    data[offsets[_DAMPING]] = constants[c, 13]
    for i in range(21):
        data[offsets[_STIFFNESS] + i] = laws[section, 21 + i]


@inlined
def _node_force(force: FloatArray, side: int, H: FloatArray, out: FloatArray) -> None:
    """Internal force on one end in its axes at the end of the step."""
    sign = 1.0 if side == 1 else -1.0
    f, m = turn_back(H, triple(force, 0)), turn_back(H, triple(force, 3 + 3 * side))
    for i in range(3):
        out[i], out[3 + i] = sign * f[i], m[i]


@kernel
def add_force(
    address: int, offsets: IntArray, law: FloatArray, cells: IndexArray, turned: BoolArray,
    turns: FloatArray, constants: FloatArray, sections: IntArray, laws: FloatArray,
    lumps: FloatArray, centres: FloatArray, frames0: FloatArray, frames: FloatArray,
    rates0: FloatArray, rates: FloatArray, gravity: FloatArray, scale: float,
    residual: FloatArray,
) -> None:  # fmt: skip
    """Add ``scale`` times the mean force of all cells over the step to ``residual`` (n, 6).

    ``law`` (3,) holds half the dissipation, 1/h and the change of rates with increments; ``lumps``
    (m, 2, 12) arms from the ``centres`` (n, 3) of the nodes to those of both ends of each cell and
    the rotary inertia of both halves, in node axes.
    """
    data, force, out = np.empty(offsets[-1]), np.empty(9), np.empty(6)
    total, none, h = np.empty(6), np.zeros(3), 1.0 / law[1]
    points = np.zeros(6)
    points[3] = 1.0  # the form does not depend on the size of the reference cell
    for c in range(cells.shape[0]):
        _put_cell(
            data, offsets, c, cells, turned, turns, frames0, frames, constants, sections[c], laws
        )
        force[:] = 0.0
        tabulate(address, force, data, law, points)  # type: ignore[call-arg]
        mass = laws[sections[c], 0] * constants[c, 12]
        for side in range(2):
            node = cells[c, side]
            _node_force(force, side, frames[node], out)
            for i in range(6):
                residual[node, i] += scale * out[i]
            mass_force(
                side, cells[c], mass, lumps[c], centres, frames0, frames, rates0, rates, gravity,
                h, total, out,
            )  # fmt: skip
            for i in range(6):
                residual[node, i] += scale * out[i]
            momentum_force(
                0.0, 0.0, none, lumps[c, side, 3:].reshape(3, 3), none, frames0[node],
                frames[node], rates0[node], rates[node], gravity, h, total, out,
            )  # fmt: skip
            for i in range(6):
                residual[node, i] += scale * out[i]


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
def add_tangent(
    force_address: int, address: int, offsets: IntArray, law: FloatArray, cells: IndexArray,
    turned: BoolArray, turns: FloatArray, constants: FloatArray, sections: IntArray,
    laws: FloatArray, lumps: FloatArray, centres: FloatArray, frames0: FloatArray,
    frames: FloatArray, increments: FloatArray, rates0: FloatArray, rates: FloatArray,
    gravity: FloatArray, scale: float, values: FloatArray,
) -> None:  # fmt: skip
    """Write ``scale`` times the derivative of :func:`add_force` along local twists (m, 144)."""
    data, force, K = np.empty(offsets[-1]), np.empty(9), np.empty(81)
    out, work, lump, total = np.empty(6), np.empty((6, 6)), np.empty((6, 6)), np.empty(6)
    none, h = np.zeros(3), 1.0 / law[1]
    points = np.zeros(6)
    points[3] = 1.0
    for c in range(cells.shape[0]):
        _put_cell(
            data, offsets, c, cells, turned, turns, frames0, frames, constants, sections[c], laws
        )
        force[:], K[:] = 0.0, 0.0
        tabulate(force_address, force, data, law, points)  # type: ignore[call-arg]
        tabulate(address, K, data, law, points)
        mass = laws[sections[c], 0] * constants[c, 12]
        result = values[c].reshape(12, 12)
        for a in range(2):
            node = cells[c, a]
            mass_force(
                a, cells[c], mass, lumps[c], centres, frames0, frames, rates0, rates, gravity, h,
                total, out,
            )  # fmt: skip
            for b in range(2):
                _turn_blocks(K, frames[cells[c, 0]], frames[cells[c, 1]], a, b, work, result)
                add_mass_tangent(
                    a, b, cells[c], mass, lumps[c], centres, frames0, frames, increments, rates0,
                    rates, h, law[2], total, out, result,
                )  # fmt: skip
            _node_force(force, a, frames[node], out)
            momentum_tangent(
                0.0, 0.0, none, lumps[c, a, 3:].reshape(3, 3), none, frames0[node], frames[node],
                increments[node, 3:], rates0[node], rates[node], gravity, h, law[2], lump,
            )  # fmt: skip
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
def relative_frames(
    cells: IndexArray, turned: BoolArray, turns: FloatArray, frames: FloatArray, out: FloatArray
) -> None:
    """Frames (m, 12) of the second ends of all cells relative to the first ones."""
    R = np.empty((2, 9))
    for c in range(cells.shape[0]):
        for side in range(2):
            H = frames[cells[c, side]]
            _put_rotation(R[side], 0, H, turned[c], turns, c * turned[c], side)
        for i in range(3):
            out[c, i] = 0.0
            for k in range(3):
                arm = frames[cells[c, 1], k] - frames[cells[c, 0], k]
                out[c, i] += R[0, 3 * k + i] * arm
            for j in range(3):
                total = 0.0
                for k in range(3):
                    total += R[0, 3 * k + i] * R[1, 3 * k + j]
                out[c, 3 + 3 * i + j] = total
