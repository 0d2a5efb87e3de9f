# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps that the kernels of director triangles share.

The 24 covariant strains of ``tables`` are, for each of three points, membrane and
curvature (6), then the shear at the midpoints of the edges (6). They are quadratic forms, hence
with stresses ``s`` the force on the relative position ``q_i`` is ``sum_j a_ij q_j + sum_k b_ik
d_k`` and that on ``d_k`` is ``sum_i b_ik q_i`` with sums ``a``, ``b`` of fixed coefficients times
stresses.

A node moves by ``R u`` and rotates by ``R <- R exp(theta)``; a director ``d = R d_0`` changes by
``P theta``, the columns of ``P`` being ``R (e_a x d_0)``. The unknowns of a triangle are the
translations of its six nodes, then the rotations of the three that carry the directors: nine
vectors, with ``U_i`` the R of the first six and the P of the others. Forces are ``U_i^T f_i``, in
axes of the nodes.

All numbers are those of several triangles, see ``kernels.vectors``. Kernels take as constants the
factors of the derivatives by positions and by velocities, and whether stresses are given; as
coefficients strains at the start, given stresses of membrane and bending times what their points
weigh, positions, rotations and twists of the nodes, and work space; and in place of coordinates the
result of :func:`constant_data`.
"""

from typing import Any

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.families.shell_director.tables import CROSSED, MEMBRANE
from flexfem.kernels.compiled import inlined_fused
from flexfem.kernels.lanes import LANES, in_rows, lanes
from flexfem.kernels.vectors import add_to, load, store

__all__ = [
    "CHANGES",
    "CROSSES",
    "DAMPING",
    "FORCES",
    "FORCE_CHANGES",
    "PLACES",
    "SIZES",
    "SPINS",
    "SQUARES",
    "STEPS",
    "STRAIN",
    "STRESS",
    "TO_INERTIAL",
    "WORK",
    "add_on_nodes",
    "along_unknown",
    "clear",
    "constant_data",
    "place",
    "stiffness",
    "write_products",
    "write_response",
    "write_spins",
    "write_strain",
    "write_stress",
    "write_sums",
]

#: Sizes of the coefficients, without the work space.
SIZES = {
    "starts": 24, "given": 18, "positions": 27, "rotations": 81, "steps": 54
}  # fmt: skip
_GIVEN, _POSITIONS, _ROTATIONS, STEPS, _BEHIND = 24, 42, 69, 150, 204
#: Columns of the constant data.
_DIRECTORS, _SAME, DAMPING, _SHEARS, _PLANES = 0, 9, 12, 13, 49
#: Places in the work space, of q (5, 3) and d (3, 3), their changes, the U (9, 3, 3), products or
#: sums (5, 5) and (5, 3), strains, stresses, forces on positions and directors (9, 3) and changes.
PLACES, CHANGES, TO_INERTIAL, SQUARES, CROSSES, STRAIN, STRESS, FORCES, FORCE_CHANGES = (
    0, 24, 48, 129, 154, 169, 193, 217, 244
)  # fmt: skip
#: Number of places in the work space.
WORK = 271
#: First entry of the spins, which overwrite stresses that are no longer needed.
SPINS = STRESS


def constant_data(
    nodes: IntArray, directors: FloatArray, damping: FloatArray, shears: FloatArray,
    planes: FloatArray,
) -> FloatArray:  # fmt: skip
    """Constant data of triangles, a row for each call of a kernel.

    Args:
        nodes: (m, 9) corners, midside nodes opposite to them, nodes that carry the directors.
        directors: (m, 3, 3) d_0 in the axes of the frames that carry them.
        damping: (m,) stiffness-proportional, s.
        shears: (m, 6, 6) stiffness of the shear, relaxed, times areas, N m.
        planes: (m, 3, 6, 6) stiffness of membrane and bending at the points, times areas.
    """
    own = (nodes[:, 3:6] == nodes[:, 6:]).astype(np.float64)
    pieces = directors, own, damping, shears, planes
    return in_rows(lanes(np.concatenate([in_rows(piece) for piece in pieces], axis=1)))


@inlined_fused
def place(coefficients: FloatArray, coordinates: FloatArray) -> FloatArray:
    """Write q, d and the U to the work space, which is returned."""
    work = coefficients[LANES * _BEHIND :]
    for i in range(5):
        for a in range(3):
            base = load(coefficients, _POSITIONS + a)
            store(work, PLACES + 3 * i + a, load(coefficients, _POSITIONS + 3 * i + 3 + a) - base)
    for k in range(54):
        store(work, TO_INERTIAL + k, load(coefficients, _ROTATIONS + k))
    for k in range(3):
        e0, e1 = load(coordinates, _DIRECTORS + 3 * k), load(coordinates, _DIRECTORS + 3 * k + 1)
        e2 = load(coordinates, _DIRECTORS + 3 * k + 2)
        for a in range(3):
            R, P = _ROTATIONS + 54 + 9 * k + 3 * a, TO_INERTIAL + 54 + 9 * k + 3 * a
            r0, r1, r2 = load(coefficients, R), load(coefficients, R + 1), load(coefficients, R + 2)
            store(work, PLACES + 15 + 3 * k + a, r0 * e0 + r1 * e1 + r2 * e2)
            store(work, P, r2 * e1 - r1 * e2)
            store(work, P + 1, r0 * e2 - r2 * e0)
            store(work, P + 2, r1 * e0 - r0 * e1)
    return work


@inlined_fused
def along_unknown(work: FloatArray, i: int, a: int, f: int) -> Any:
    """Component a of ``U_i^T f`` of a vector at ``f`` in the work space."""
    U = TO_INERTIAL + 9 * i + a
    value = load(work, U) * load(work, f) + load(work, U + 3) * load(work, f + 1)
    return value + load(work, U + 6) * load(work, f + 2)


@inlined_fused
def write_products(work: FloatArray, one: int, other: int) -> None:
    """Write ``(q_i . r_j + r_i . q_j) / 2`` and ``(q_i . e_k + r_i . d_k) / 2``.

    ``one`` and ``other`` are the places of q and d, and of r and e.
    """
    for i in range(5):
        for j in range(i, 8):
            total = 0.0
            for a in range(3):
                total += load(work, one + 3 * i + a) * load(work, other + 3 * j + a)
                total += load(work, other + 3 * i + a) * load(work, one + 3 * j + a)
            if j < 5:
                store(work, SQUARES + 5 * i + j, 0.5 * total)
                store(work, SQUARES + 5 * j + i, 0.5 * total)
            else:
                store(work, CROSSES + 3 * i + j - 5, 0.5 * total)


@inlined_fused
def write_strain(work: FloatArray, to: FloatArray) -> None:
    """Write the strains (24,), which are sums of the products, to the front of ``to``."""
    for s in range(9):
        total = 0.0
        for i in range(5):
            for j in range(5):
                total += 0.5 * MEMBRANE[s, i, j] * load(work, SQUARES + 5 * i + j)
        store(to, 6 * (s // 3) + s % 3, total)
    for s in range(15):
        total = 0.0
        for i in range(5):
            for k in range(3):
                total += CROSSED[s, i, k] * load(work, CROSSES + 3 * i + k)
        store(to, 6 * (s // 3) + 3 + s % 3 if s < 9 else 9 + s, total)


@inlined_fused
def stiffness(coordinates: FloatArray, s: int, j: int) -> Any:
    """Stiffness between strain s and strain j of the six of its point or of the shear."""
    at = _PLANES + 6 * s if s < 18 else _SHEARS + 6 * (s - 18)
    return load(coordinates, at + j)


@inlined_fused
def write_stress(coordinates: FloatArray, scale: Any, work: FloatArray) -> None:
    """Write ``scale`` times the stresses of the stiffness for the strains in the work space."""
    for s in range(24):
        total = 0.0
        for j in range(6):
            total += stiffness(coordinates, s, j) * load(work, STRAIN + 6 * (s // 6) + j)
        store(work, STRESS + s, scale * total)


@inlined_fused
def write_response(
    coefficients: FloatArray, constants: FloatArray, coordinates: FloatArray, work: FloatArray
) -> None:
    """Write the strains since the start and the stresses, or the given stresses if any."""
    write_products(work, PLACES, PLACES)
    write_strain(work, work[LANES * STRAIN :])
    for s in range(24):
        add_to(work, STRAIN + s, -load(coefficients, s))
    write_stress(coordinates, constants[0], work)
    if constants[2] > 0.0:
        for s in range(18):
            store(work, STRESS + s, constants[0] * load(coefficients, _GIVEN + s))


@inlined_fused
def write_sums(work: FloatArray) -> None:
    """Write the sums (5, 5) and (5, 3) of coefficients times stresses."""
    for i in range(5):
        for j in range(i, 5):
            total = 0.0
            for s in range(9):
                total += MEMBRANE[s, i, j] * load(work, STRESS + 6 * (s // 3) + s % 3)
            store(work, SQUARES + 5 * i + j, total)
            store(work, SQUARES + 5 * j + i, total)
        for k in range(3):
            total = 0.0
            for s in range(15):
                at = 6 * (s // 3) + 3 + s % 3 if s < 9 else 9 + s
                total += CROSSED[s, i, k] * load(work, STRESS + at)
            store(work, CROSSES + 3 * i + k, total)


@inlined_fused
def add_on_nodes(work: FloatArray, places: int, forces: int) -> None:
    """Add the forces of the sums on the six nodes and three directors at some places."""
    for c in range(3):
        for i in range(5):
            total = 0.0
            for j in range(5):
                total += load(work, SQUARES + 5 * i + j) * load(work, places + 3 * j + c)
            for k in range(3):
                total += load(work, CROSSES + 3 * i + k) * load(work, places + 15 + 3 * k + c)
            add_to(work, forces + 3 + 3 * i + c, total)
            add_to(work, forces + c, -total)
        for k in range(3):
            total = 0.0
            for i in range(5):
                total += load(work, CROSSES + 3 * i + k) * load(work, places + 3 * i + c)
            add_to(work, forces + 18 + 3 * k + c, total)


@inlined_fused
def clear(work: FloatArray, first: int, count: int) -> None:
    """Set places of the work space to zero."""
    for i in range(count):
        store(work, first + i, 0.0)


@inlined_fused
def write_spins(
    coefficients: FloatArray, coordinates: FloatArray, work: FloatArray, k: int
) -> None:
    """Write changes of a midside node's force and moment with its rotation, (2, 3, 3).

    The forces in inertial axes are fixed. The first matrix is zero where the node has Dirichlet
    conditions along axes that do not rotate with its director.
    """
    R = _ROTATIONS + 54 + 9 * k
    inner = 0.0
    for a in range(3):
        r = m = 0.0
        for c in range(3):
            r += load(coefficients, R + 3 * c + a) * load(work, FORCES + 9 + 3 * k + c)
            m += load(coefficients, R + 3 * c + a) * load(work, FORCES + 18 + 3 * k + c)
        r *= load(coordinates, _SAME + k)
        inner += load(coordinates, _DIRECTORS + 3 * k + a) * m
        # rows b and c of the skew matrix of r
        b, c = (a + 1) % 3, (a + 2) % 3
        store(work, SPINS + 4 * a, 0.0)
        store(work, SPINS + 3 * b + c, -r)
        store(work, SPINS + 3 * c + b, r)
        for j in range(3):
            store(work, SPINS + 9 + 3 * a + j, m * load(coordinates, _DIRECTORS + 3 * k + j))
    for a in range(3):
        add_to(work, SPINS + 9 + 4 * a, -inner)
