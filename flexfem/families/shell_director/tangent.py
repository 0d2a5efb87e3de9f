# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kernel of the tangents of director triangles.

Notation, data and constants as in ``steps``. The sums ``a``, ``b`` of coefficients times stresses
are the geometric part of a tangent in positions and directors. In axes of the nodes, forces also
change with the rotation of their node.
"""

from flexfem._types import FloatArray
from flexfem.families.shell_director.steps import (
    CROSSES,
    DAMPING,
    FORCES,
    PLACES,
    SPINS,
    SQUARES,
    TO_INERTIAL,
    WORK,
    add_on_nodes,
    along_unknown,
    clear,
    place,
    stiffness,
    write_response,
    write_spins,
    write_sums,
)
from flexfem.families.shell_director.tables import CROSSED, MEMBRANE
from flexfem.kernels.by_hand import batched_by_hand
from flexfem.kernels.compiled import inlined_fused
from flexfem.kernels.vectors import add_to, load, store

__all__ = ["TANGENT_WORK", "tangent"]

#: Positions in the work space of the derivatives (24, 27) of the strains by the unknowns, of those
#: times the stiffness, and of the coefficients (9, 9) between positions and directors.
_RATES, _TIMES, _WHOLE = WORK, WORK + 648, WORK + 1296
#: Number of places in the work space of tangents.
TANGENT_WORK = _WHOLE + 81


@inlined_fused
def _write_rates(work: FloatArray) -> None:
    """Write the derivatives of the strains by the unknowns."""
    for s in range(24):
        clear(work, FORCES, 27)
        p, c = s // 6, s % 6
        for i in range(5):
            for a in range(3):
                total = 0.0
                if p < 3 and c < 3:
                    for j in range(5):
                        total += MEMBRANE[3 * p + c, i, j] * load(work, PLACES + 3 * j + a)
                else:
                    t = 3 * p + c - 3 if p < 3 else s - 9
                    for k in range(3):
                        factor = CROSSED[t, i, k]
                        total += factor * load(work, PLACES + 15 + 3 * k + a)
                        q = load(work, PLACES + 3 * i + a)
                        add_to(work, FORCES + 18 + 3 * k + a, factor * q)
                store(work, FORCES + 3 + 3 * i + a, total)
                add_to(work, FORCES + a, -total)
        for i in range(9):
            for a in range(3):
                store(work, _RATES + 27 * s + 3 * i + a, along_unknown(work, i, a, FORCES + 3 * i))


@inlined_fused
def _write_times(constants: FloatArray, coordinates: FloatArray, work: FloatArray) -> None:
    """Write the stiffness times the derivatives of the strains."""
    factor = constants[0] + constants[1] * load(coordinates, DAMPING)
    for s in range(24):
        row = _RATES + 162 * (s // 6)
        d0, d1 = stiffness(coordinates, s, 0), stiffness(coordinates, s, 1)
        d2, d3 = stiffness(coordinates, s, 2), stiffness(coordinates, s, 3)
        d4, d5 = stiffness(coordinates, s, 4), stiffness(coordinates, s, 5)
        for v in range(27):
            total = d0 * load(work, row + v) + d1 * load(work, row + 27 + v)
            total += d2 * load(work, row + 54 + v) + d3 * load(work, row + 81 + v)
            total += d4 * load(work, row + 108 + v) + d5 * load(work, row + 135 + v)
            store(work, _TIMES + 27 * s + v, factor * total)


@inlined_fused
def _write_whole(work: FloatArray) -> None:
    """Write the coefficients of the six positions and three directors."""
    clear(work, _WHOLE, 81)
    for i in range(5):
        for j in range(8):
            value = (
                load(work, SQUARES + 5 * i + j) if j < 5 else load(work, CROSSES + 3 * i + j - 5)
            )
            store(work, _WHOLE + 9 * (1 + i) + 1 + j, value)
            add_to(work, _WHOLE + 1 + j, -value)
            if j < 5:
                add_to(work, _WHOLE, value)


@inlined_fused
def _put_block(tensor: FloatArray, work: FloatArray, i: int, j: int) -> None:
    """Write the block of two unknowns, and its transpose."""
    for a in range(3):
        left, U = 3 * i + a, TO_INERTIAL + 9 * i + a
        k0 = k1 = k2 = 0.0
        for s in range(24):
            B, C = load(work, _RATES + 27 * s + left), _TIMES + 27 * s + 3 * j
            k0 += B * load(work, C)
            k1 += B * load(work, C + 1)
            k2 += B * load(work, C + 2)
        if i < 6:
            factor = load(work, _WHOLE + 9 * i + j)
            for c in range(3):
                u, V = factor * load(work, U + 3 * c), TO_INERTIAL + 9 * j + 3 * c
                k0 += u * load(work, V)
                k1 += u * load(work, V + 1)
                k2 += u * load(work, V + 2)
        right = 3 * j
        store(tensor, 27 * left + right, k0)
        store(tensor, 27 * left + right + 1, k1)
        store(tensor, 27 * left + right + 2, k2)
        store(tensor, 27 * right + left, k0)
        store(tensor, 27 * (right + 1) + left, k1)
        store(tensor, 27 * (right + 2) + left, k2)


@batched_by_hand
def tangent(
    tensor: FloatArray, coefficients: FloatArray, constants: FloatArray, coordinates: FloatArray
) -> None:
    """Write the derivatives of the forces (27, 27).

    They are those by local twists and by local velocities, times the factors, without the change of
    strain rates by the rotation of the triangles.
    """
    work = place(coefficients, coordinates)
    _write_rates(work)
    write_response(coefficients, constants, coordinates, work)
    write_sums(work)
    clear(work, FORCES, 27)
    add_on_nodes(work, PLACES, FORCES)
    _write_times(constants, coordinates, work)
    _write_whole(work)
    for i in range(9):
        for j in range(i, 9):
            _put_block(tensor, work, i, j)
    for k in range(3):
        write_spins(coefficients, coordinates, work, k)
        for i in range(2):
            for a in range(3):
                for c in range(3):
                    at = 27 * (9 * (1 + i) + 3 * k + a) + 18 + 3 * k + c
                    add_to(tensor, at, load(work, SPINS + 9 * i + 3 * a + c))
