# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kernels of the strains and forces of director triangles, and of their changes along a step.

Notation, data and constants as in ``steps``.
"""

from flexfem._types import FloatArray
from flexfem.families.shell_director.steps import (
    CHANGES,
    DAMPING,
    FORCE_CHANGES,
    FORCES,
    PLACES,
    SPINS,
    STEPS,
    STRAIN,
    TO_INERTIAL,
    add_on_nodes,
    along_unknown,
    clear,
    place,
    write_products,
    write_response,
    write_spins,
    write_strain,
    write_stress,
    write_sums,
)
from flexfem.kernels.by_hand import batched_by_hand
from flexfem.kernels.compiled import inlined_fused
from flexfem.kernels.lanes import LANES
from flexfem.kernels.vectors import add_to, load, store

__all__ = ["action", "forces", "strain_rates", "strains"]


@batched_by_hand
def strains(
    tensor: FloatArray, coefficients: FloatArray, constants: FloatArray, coordinates: FloatArray
) -> None:
    """Write the covariant strains (24,) of the frames, not relative to the start."""
    work = place(coefficients, coordinates)
    write_products(work, PLACES, PLACES)
    write_strain(work, tensor)


@inlined_fused
def _write_changes(coefficients: FloatArray, work: FloatArray) -> None:
    """Write the changes of q and d along local twists of the nodes."""
    for i in range(9):
        twist = STEPS + 6 * i if i < 6 else STEPS + 6 * i + 3
        for a in range(3):
            U = TO_INERTIAL + 9 * i + 3 * a
            moved = load(work, U) * load(coefficients, twist)
            moved += load(work, U + 1) * load(coefficients, twist + 1)
            moved += load(work, U + 2) * load(coefficients, twist + 2)
            if i > 0:
                add_to(work, CHANGES + 3 * i - 3 + a, moved)
            else:
                for j in range(5):
                    store(work, CHANGES + 3 * j + a, -moved)
                for k in range(3):
                    store(work, CHANGES + 15 + 3 * k + a, 0.0)


@batched_by_hand
def strain_rates(
    tensor: FloatArray, coefficients: FloatArray, constants: FloatArray, coordinates: FloatArray
) -> None:
    """Write the derivatives (24,) of the strains along local twists of the nodes."""
    work = place(coefficients, coordinates)
    _write_changes(coefficients, work)
    write_products(work, PLACES, CHANGES)
    write_strain(work, tensor)
    for s in range(24):
        store(tensor, s, 2.0 * load(tensor, s))


@batched_by_hand
def forces(
    tensor: FloatArray, coefficients: FloatArray, constants: FloatArray, coordinates: FloatArray
) -> None:
    """Internal forces (9, 3) along the unknowns, times the first of the factors."""
    work = place(coefficients, coordinates)
    write_response(coefficients, constants, coordinates, work)
    write_sums(work)
    clear(work, FORCES, 27)
    add_on_nodes(work, PLACES, FORCES)
    for i in range(9):
        for a in range(3):
            add_to(tensor, 3 * i + a, along_unknown(work, i, a, FORCES + 3 * i))


@batched_by_hand
def action(
    tensor: FloatArray, coefficients: FloatArray, constants: FloatArray, coordinates: FloatArray
) -> None:
    """Derivatives of the forces, see ``tangent``, times local twists of the nodes, (9, 3)."""
    work = place(coefficients, coordinates)
    _write_changes(coefficients, work)
    write_response(coefficients, constants, coordinates, work)
    write_sums(work)
    clear(work, FORCES, 54)
    add_on_nodes(work, PLACES, FORCES)
    add_on_nodes(work, CHANGES, FORCE_CHANGES)
    write_products(work, PLACES, CHANGES)
    write_strain(work, work[LANES * STRAIN :])
    scale = 2.0 * (constants[0] + constants[1] * load(coordinates, DAMPING))
    write_stress(coordinates, scale, work)
    write_sums(work)
    add_on_nodes(work, PLACES, FORCE_CHANGES)
    for i in range(9):
        for a in range(3):
            add_to(tensor, 3 * i + a, along_unknown(work, i, a, FORCE_CHANGES + 3 * i))
    for k in range(3):
        write_spins(coefficients, coordinates, work, k)
        turn = STEPS + 6 * (6 + k) + 3
        for i in range(2):
            for a in range(3):
                total = 0.0
                for c in range(3):
                    total += load(work, SPINS + 9 * i + 3 * a + c) * load(coefficients, turn + c)
                add_to(tensor, 9 * (1 + i) + 3 * k + a, total)
