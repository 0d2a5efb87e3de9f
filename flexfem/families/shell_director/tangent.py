# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops over director triangles for tangents, see ``loops`` for the symbols.

The sums ``a``, ``b`` of coefficients times stresses are the geometric part of a tangent in
positions and directors. In axes of the nodes, forces change besides as their node turns.

The 27 unknowns of a triangle are the translations of its six nodes, then the turns of the three
that carry the directors.
"""

import numpy as np

from flexfem._types import FloatArray, IndexArray
from flexfem.families.shell_director.loops import (
    TriangleData,
    add_to_nodes,
    changes_into,
    given_into,
    levers_into,
    place_into,
    products_into,
    strain_into,
    stress_into,
    sums_into,
    turned_back,
)
from flexfem.families.shell_director.tables import CROSSED, MEMBRANE
from flexfem.kernels.compiled import inlined, kernel
from flexfem.kernels.records import Memory, unpack

__all__ = ["add_action", "tangents_into"]


@inlined
def _turns_of_forces(
    frame: FloatArray, director: FloatArray, f: FloatArray, g: FloatArray, spin: FloatArray
) -> None:
    """Write the derivative (6, 3) of a node's forces by its turn, ``f`` and ``g`` held.

    ``f`` and ``g`` are the forces on its position and on its director. The first three rows are for
    a middle that turns with its director.
    """
    r, m = np.empty(3), np.empty(3)
    turned_back(frame, f, r)
    turned_back(frame, g, m)
    spin[:] = 0.0
    inner = director[0] * m[0] + director[1] * m[1] + director[2] * m[2]
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        spin[a, b], spin[a, c] = -r[c], r[b]
        for k in range(3):
            spin[3 + a, k] = m[a] * director[k]
        spin[3 + a, a] -= inner


@kernel
def add_action(
    frames: FloatArray, steps: FloatArray, triangles: Memory, starts: FloatArray,
    planes: FloatArray, stresses: FloatArray, factors: FloatArray, residual: FloatArray,
) -> None:  # fmt: skip
    """Add the tangents of :func:`tangents_into` times local twists (n, 6) to the residual."""
    own = unpack(TriangleData, triangles)
    nodes, directors, shears, damping = own.nodes, own.directors, own.shears, own.damping
    q, d, dq, dd = np.empty((5, 3)), np.empty((3, 3)), np.empty((5, 3)), np.empty((3, 3))
    squares, crosses, P = np.empty((5, 5)), np.empty((5, 3)), np.empty((3, 3, 3))
    strain, stress, turned, spin = np.empty(24), np.empty(24), np.empty(3), np.empty((6, 3))
    f, df = np.empty((9, 3)), np.empty((9, 3))
    for m in range(len(nodes)):
        place_into(frames, nodes[m], directors[m], q, d)
        levers_into(frames, nodes[m], directors[m], P)
        changes_into(frames, steps, nodes[m], P, dq, dd)
        products_into(q, d, q, d, squares, crosses)
        strain_into(squares, crosses, strain)
        for s in range(24):
            strain[s] -= starts[m, s]
        stress_into(planes[m], shears[m], factors[0], strain, stress)
        given_into(stresses, m, factors[0], stress)
        sums_into(stress, squares, crosses)
        f[:], df[:] = 0.0, 0.0
        add_to_nodes(squares, crosses, q, d, f)
        add_to_nodes(squares, crosses, dq, dd, df)
        products_into(q, d, dq, dd, squares, crosses)
        strain_into(squares, crosses, strain)
        scale = 2.0 * (factors[0] + factors[1] * damping[m])
        stress_into(planes[m], shears[m], scale, strain, stress)
        sums_into(stress, squares, crosses)
        add_to_nodes(squares, crosses, q, d, df)
        for i in range(6):
            node = nodes[m, i]
            turned_back(frames[node], df[i], turned)
            for a in range(3):
                residual[node, a] += turned[a]
        for k in range(3):
            node = nodes[m, 6 + k]
            _turns_of_forces(frames[node], directors[m, k], f[3 + k], f[6 + k], spin)
            for a in range(0 if node == nodes[m, 3 + k] else 3, 6):
                for c in range(3):
                    residual[node, a] += spin[a, c] * steps[node, 3 + c]
                    if a > 2:
                        residual[node, a] += P[k, c, a - 3] * df[6 + k, c]


@inlined
def _rows(q: FloatArray, d: FloatArray, s: int, row: FloatArray) -> None:
    """Write the derivatives (9, 3) of strain s by positions and directors."""
    row[:] = 0.0
    p, c = s // 6, s % 6
    if p < 3 and c < 3:
        for i in range(5):
            for j in range(5):
                for a in range(3):
                    row[1 + i, a] += MEMBRANE[3 * p + c, i, j] * q[j, a]
    else:
        t = 3 * p + c - 3 if p < 3 else s - 9
        for i in range(5):
            for k in range(3):
                for a in range(3):
                    row[1 + i, a] += CROSSED[t, i, k] * d[k, a]
                    row[6 + k, a] += CROSSED[t, i, k] * q[i, a]
    for i in range(5):
        for a in range(3):
            row[0, a] -= row[1 + i, a]


@inlined
def _to_unknowns(
    frames: FloatArray, nodes: IndexArray, P: FloatArray, row: FloatArray, out: FloatArray
) -> None:
    """Write a row (9, 3) in the unknowns (27,): translations of the nodes, turns of the middles."""
    for i in range(6):
        H = frames[nodes[i]]
        for a in range(3):
            out[3 * i + a] = H[3 + a] * row[i, 0] + H[6 + a] * row[i, 1] + H[9 + a] * row[i, 2]
    for k in range(3):
        for a in range(3):
            turned = P[k, 0, a] * row[6 + k, 0] + P[k, 1, a] * row[6 + k, 1]
            out[18 + 3 * k + a] = turned + P[k, 2, a] * row[6 + k, 2]


@inlined
def _material(
    planes: FloatArray, shear: FloatArray, scale: float, B: FloatArray, work: FloatArray,
    K: FloatArray,
) -> None:  # fmt: skip
    """Write ``scale B^T C B`` (27, 27)."""
    for p in range(3):
        np.dot(planes[p], B[6 * p : 6 * p + 6], work[6 * p : 6 * p + 6])
    np.dot(shear, B[18:], work[18:])
    for s in range(24):
        for v in range(27):
            work[s, v] *= scale
    np.dot(B.T, work, K)


@inlined
def _geometric(
    frames: FloatArray, nodes: IndexArray, P: FloatArray, a: FloatArray, b: FloatArray,
    K: FloatArray,
) -> None:  # fmt: skip
    """Add the part of the sums ``a`` (5, 5) and ``b`` (5, 3)."""
    whole = np.zeros((6, 9))
    for i in range(5):
        for j in range(5):
            whole[1 + i, 1 + j] = a[i, j]
            whole[0, 1 + j] -= a[i, j]
            whole[1 + i, 0] -= a[i, j]
            whole[0, 0] += a[i, j]
        for k in range(3):
            whole[1 + i, 6 + k] = b[i, k]
            whole[0, 6 + k] -= b[i, k]
    for i in range(6):
        H = frames[nodes[i]]
        for j in range(9):
            for r in range(3):
                for c in range(3):
                    total = 0.0
                    for k in range(3):
                        if j < 6:
                            total += H[3 + 3 * k + r] * frames[nodes[j], 3 + 3 * k + c]
                        else:
                            total += H[3 + 3 * k + r] * P[j - 6, k, c]
                    K[3 * i + r, 3 * j + c] += whole[i, j] * total
                    if j > 5:
                        K[3 * j + c, 3 * i + r] += whole[i, j] * total


@kernel
def tangents_into(
    frames: FloatArray, triangles: Memory, starts: FloatArray, planes: FloatArray,
    stresses: FloatArray, factors: FloatArray, first: int, tangents: FloatArray,
) -> None:  # fmt: skip
    """Write the first of the factors times the derivatives of the forces, (r, 27, 27).

    The part of the material is multiplied by the second and the damping besides.
    """
    own = unpack(TriangleData, triangles)
    nodes, directors, shears, damping = own.nodes, own.directors, own.shears, own.damping
    q, d, f, spin = np.empty((5, 3)), np.empty((3, 3)), np.empty((9, 3)), np.empty((6, 3))
    squares, crosses, P = np.empty((5, 5)), np.empty((5, 3)), np.empty((3, 3, 3))
    strain, stress, row = np.empty(24), np.empty(24), np.empty((9, 3))
    B, work = np.empty((24, 27)), np.empty((24, 27))
    for m in range(first, first + len(tangents)):
        place_into(frames, nodes[m], directors[m], q, d)
        levers_into(frames, nodes[m], directors[m], P)
        products_into(q, d, q, d, squares, crosses)
        strain_into(squares, crosses, strain)
        for s in range(24):
            strain[s] -= starts[m, s]
            _rows(q, d, s, row)
            _to_unknowns(frames, nodes[m], P, row, B[s])
        stress_into(planes[m], shears[m], factors[0], strain, stress)
        given_into(stresses, m, factors[0], stress)
        sums_into(stress, squares, crosses)
        K = tangents[m - first]
        _material(planes[m], shears[m], factors[0] + factors[1] * damping[m], B, work, K)
        _geometric(frames, nodes[m], P, squares, crosses, K)
        f[:] = 0.0
        add_to_nodes(squares, crosses, q, d, f)
        for k in range(3):
            node = nodes[m, 6 + k]
            _turns_of_forces(frames[node], directors[m, k], f[3 + k], f[6 + k], spin)
            for j in range(3):
                for i in range(3):
                    K[18 + 3 * k + i, 18 + 3 * k + j] += spin[3 + i, j]
                    if node == nodes[m, 3 + k]:
                        K[9 + 3 * k + i, 18 + 3 * k + j] += spin[i, j]
