# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops over director triangles: strains, their rates, internal forces.

The 24 covariant strains of ``tables`` are, for each of three points, membrane and
curvature (6), then the shear at the middles of the edges (6). They are quadratic forms, hence with
stresses ``s`` the force on the relative position ``q_i`` is ``sum_j a_ij q_j + sum_k b_ik d_k`` and
that on ``d_k`` is ``sum_i b_ik q_i`` with sums ``a``, ``b`` of fixed coefficients times stresses.

A node moves by ``R u`` and turns by ``R <- R exp(theta)``; a director ``d = R d_0`` changes by
``P theta``, the columns of ``P`` being ``R (e_a x d_0)``. Forces on nodes are in their own axes:
``R^T f`` and ``P^T f_d``.

Besides :class:`TriangleData`, loops take what a law or given strains may change: ``starts`` (m, 24)
are the strains at the start, ``planes`` (m, 3, 6, 6) the stiffness of membrane and bending at the
points, times what the points weigh, and ``stresses`` (m, 18) those of membrane and bending, times
these weights, where they are not the stiffness times the strains, and (0, 18) else.
"""

import numpy as np

from flexfem._types import FloatArray, IndexArray
from flexfem.families.shell_director.tables import CROSSED, MEMBRANE
from flexfem.kernels.compiled import inlined, kernel
from flexfem.kernels.records import Float1D, Float3D, Int2D, Memory, Record, unpack

__all__ = [
    "TriangleData",
    "add_forces",
    "add_to_nodes",
    "changes_into",
    "given_into",
    "levers_into",
    "place_into",
    "products_into",
    "strain_into",
    "strain_rates_into",
    "strains_into",
    "stress_into",
    "sums_into",
    "turned_back",
]


class TriangleData(Record):
    """Constant data of director triangles.

    Attributes:
        nodes: (m, 9) corners, middles of the opposite edges, and the nodes whose frames turn the
            directors, which are the middles again but where a middle is held along axes that must
            not turn.
        directors: (m, 3, 3) d_0 in the axes of the frames that turn them.
        shears: (m, 6, 6) stiffness of the shear, relaxed, times areas, N m.
        damping: (m,) stiffness-proportional, s.
    """

    nodes: Int2D
    directors: Float3D
    shears: Float3D
    damping: Float1D


@inlined
def turned_back(H: FloatArray, v: FloatArray, out: FloatArray) -> None:
    """Write ``R^T v`` of a frame."""
    for a in range(3):
        out[a] = H[3 + a] * v[0] + H[6 + a] * v[1] + H[9 + a] * v[2]


@inlined
def place_into(
    frames: FloatArray, nodes: IndexArray, directors: FloatArray, q: FloatArray, d: FloatArray
) -> None:
    """Write relative positions (5, 3) and directors (3, 3)."""
    first = frames[nodes[0]]
    for i in range(5):
        H = frames[nodes[1 + i]]
        for a in range(3):
            q[i, a] = H[a] - first[a]
    for k in range(3):
        H, e = frames[nodes[6 + k]], directors[k]
        for a in range(3):
            d[k, a] = H[3 + 3 * a] * e[0] + H[4 + 3 * a] * e[1] + H[5 + 3 * a] * e[2]


@inlined
def levers_into(
    frames: FloatArray, nodes: IndexArray, directors: FloatArray, P: FloatArray
) -> None:
    """Write the maps (3, 3, 3) from turns to changes of directors."""
    for k in range(3):
        H, e = frames[nodes[6 + k]], directors[k]
        for a in range(3):
            r0, r1, r2 = H[3 + 3 * a], H[4 + 3 * a], H[5 + 3 * a]
            P[k, a, 0] = r2 * e[1] - r1 * e[2]
            P[k, a, 1] = r0 * e[2] - r2 * e[0]
            P[k, a, 2] = r1 * e[0] - r0 * e[1]


@inlined
def changes_into(
    frames: FloatArray, steps: FloatArray, nodes: IndexArray, P: FloatArray, q: FloatArray,
    d: FloatArray,
) -> None:  # fmt: skip
    """Write the changes of relative positions and directors along local twists of the nodes."""
    for i in range(6):
        H, u = frames[nodes[i]], steps[nodes[i]]
        for a in range(3):
            moved = H[3 + 3 * a] * u[0] + H[4 + 3 * a] * u[1] + H[5 + 3 * a] * u[2]
            if i > 0:
                q[i - 1, a] += moved
            else:
                for j in range(5):
                    q[j, a] = -moved
    for k in range(3):
        u = steps[nodes[6 + k]]
        for a in range(3):
            d[k, a] = P[k, a, 0] * u[3] + P[k, a, 1] * u[4] + P[k, a, 2] * u[5]


@inlined
def products_into(
    q: FloatArray, d: FloatArray, r: FloatArray, e: FloatArray, squares: FloatArray,
    crosses: FloatArray,
) -> None:  # fmt: skip
    """Write ``(q_i . r_j + r_i . q_j) / 2`` (5, 5) and ``(q_i . e_k + r_i . d_k) / 2`` (5, 3)."""
    for i in range(5):
        for j in range(5):
            squares[i, j] = 0.0
            for a in range(3):
                squares[i, j] += 0.5 * (q[i, a] * r[j, a] + r[i, a] * q[j, a])
        for k in range(3):
            crosses[i, k] = 0.0
            for a in range(3):
                crosses[i, k] += 0.5 * (q[i, a] * e[k, a] + r[i, a] * d[k, a])


@inlined
def strain_into(squares: FloatArray, crosses: FloatArray, strain: FloatArray) -> None:
    """Write the strains (24,) that the products make up."""
    for s in range(9):
        total = 0.0
        for i in range(5):
            for j in range(5):
                total += 0.5 * MEMBRANE[s, i, j] * squares[i, j]
        strain[6 * (s // 3) + s % 3] = total
    for s in range(15):
        total = 0.0
        for i in range(5):
            for k in range(3):
                total += CROSSED[s, i, k] * crosses[i, k]
        strain[6 * (s // 3) + 3 + s % 3 if s < 9 else 9 + s] = total


@inlined
def stress_into(
    planes: FloatArray, shear: FloatArray, scale: float, strain: FloatArray, stress: FloatArray
) -> None:
    """Write the stresses (24,) of the stiffness."""
    for p in range(4):
        for i in range(6):
            total = 0.0
            for j in range(6):
                D = planes[p, i, j] if p < 3 else shear[i, j]
                total += D * strain[6 * p + j]
            stress[6 * p + i] = scale * total


@inlined
def given_into(stresses: FloatArray, m: int, scale: float, stress: FloatArray) -> None:
    """Write the stresses of membrane and bending that are given, if any are."""
    if len(stresses):
        for i in range(18):
            stress[i] = scale * stresses[m, i]


@inlined
def sums_into(stress: FloatArray, a: FloatArray, b: FloatArray) -> None:
    """Write the sums (5, 5) and (5, 3) of coefficients times stresses."""
    for i in range(5):
        for j in range(5):
            a[i, j] = 0.0
        for k in range(3):
            b[i, k] = 0.0
    for s in range(9):
        value = stress[6 * (s // 3) + s % 3]
        for i in range(5):
            for j in range(5):
                a[i, j] += value * MEMBRANE[s, i, j]
    for s in range(15):
        value = stress[6 * (s // 3) + 3 + s % 3] if s < 9 else stress[9 + s]
        for i in range(5):
            for k in range(3):
                b[i, k] += value * CROSSED[s, i, k]


@inlined
def add_to_nodes(a: FloatArray, b: FloatArray, q: FloatArray, d: FloatArray, f: FloatArray) -> None:
    """Add the forces on the six nodes and three directors to ``f`` (9, 3)."""
    for c in range(3):
        for i in range(5):
            total = 0.0
            for j in range(5):
                total += a[i, j] * q[j, c]
            for k in range(3):
                total += b[i, k] * d[k, c]
            f[1 + i, c] += total
            f[0, c] -= total
        for k in range(3):
            for i in range(5):
                f[6 + k, c] += b[i, k] * q[i, c]


@kernel
def strains_into(
    frames: FloatArray, nodes: IndexArray, directors: FloatArray, strains: FloatArray
) -> None:
    """Write the covariant strains (m, 24) of the frames as such."""
    q, d = np.empty((5, 3)), np.empty((3, 3))
    squares, crosses = np.empty((5, 5)), np.empty((5, 3))
    for m in range(len(nodes)):
        place_into(frames, nodes[m], directors[m], q, d)
        products_into(q, d, q, d, squares, crosses)
        strain_into(squares, crosses, strains[m])


@kernel
def strain_rates_into(
    frames: FloatArray, steps: FloatArray, nodes: IndexArray, directors: FloatArray,
    rates: FloatArray,
) -> None:  # fmt: skip
    """Write the derivatives (m, 24) of the strains along local twists (n, 6) of the nodes."""
    q, d, dq, dd = np.empty((5, 3)), np.empty((3, 3)), np.empty((5, 3)), np.empty((3, 3))
    squares, crosses, P = np.empty((5, 5)), np.empty((5, 3)), np.empty((3, 3, 3))
    for m in range(len(nodes)):
        place_into(frames, nodes[m], directors[m], q, d)
        levers_into(frames, nodes[m], directors[m], P)
        changes_into(frames, steps, nodes[m], P, dq, dd)
        products_into(q, d, dq, dd, squares, crosses)
        strain_into(squares, crosses, rates[m])
        rates[m] *= 2.0


@kernel
def add_forces(
    frames: FloatArray, triangles: Memory, starts: FloatArray, planes: FloatArray,
    stresses: FloatArray, scale: float, residual: FloatArray,
) -> None:  # fmt: skip
    """Add ``scale`` times the internal forces to the residual (n, 6), in axes of the nodes."""
    own = unpack(TriangleData, triangles)
    nodes, directors, shears = own.nodes, own.directors, own.shears
    q, d, f, turned = np.empty((5, 3)), np.empty((3, 3)), np.empty((9, 3)), np.empty(3)
    squares, crosses, P = np.empty((5, 5)), np.empty((5, 3)), np.empty((3, 3, 3))
    strain, stress = np.empty(24), np.empty(24)
    for m in range(len(nodes)):
        place_into(frames, nodes[m], directors[m], q, d)
        levers_into(frames, nodes[m], directors[m], P)
        products_into(q, d, q, d, squares, crosses)
        strain_into(squares, crosses, strain)
        for s in range(24):
            strain[s] -= starts[m, s]
        stress_into(planes[m], shears[m], scale, strain, stress)
        given_into(stresses, m, scale, stress)
        sums_into(stress, squares, crosses)
        f[:] = 0.0
        add_to_nodes(squares, crosses, q, d, f)
        for i in range(6):
            node = nodes[m, i]
            turned_back(frames[node], f[i], turned)
            for a in range(3):
                residual[node, a] += turned[a]
        for k in range(3):
            node = nodes[m, 6 + k]
            for a in range(3):
                for c in range(3):
                    residual[node, 3 + a] += P[k, c, a] * f[6 + k, c]
