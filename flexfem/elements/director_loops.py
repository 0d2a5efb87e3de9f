# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops over director triangles: strains, internal forces, tangents.

The 24 covariant strains of ``director_tables`` are, for each of three points, membrane and
curvature (6), then the shear at the middles of the edges (6). They are quadratic forms, hence with
stresses ``s`` the force on the relative position ``q_i`` is ``sum_j a_ij q_j + sum_k b_ik d_k`` and
that on ``d_k`` is ``sum_i b_ik q_i`` with sums ``a``, ``b`` of fixed coefficients times stresses,
and ``a``, ``b`` are also the geometric part of the tangent.

A node moves by ``R u`` and turns by ``R <- R exp(theta)``; a director ``d = R d_0`` changes by
``P theta``, the columns of ``P`` being ``R (e_a x d_0)``. Forces on nodes are in their own axes:
``R^T f`` and ``P^T f_d``.

``nodes`` (m, 6) are those of the triangles, ``directors`` (m, 3, 3) their ``d_0``, ``planes``
(m, 3, 6, 6) the stiffness of membrane and bending at the points and ``shears`` (m, 6, 6) that of
the shear, times what the points weigh.
"""

import numpy as np

from flexfem._types import FloatArray, IndexArray
from flexfem.elements.director_tables import CROSSED, MEMBRANE
from flexfem.lie.compiled import inlined, kernel

__all__ = ["add_action", "add_forces", "strain_rates_into", "strains_into", "tangents_into"]


@inlined
def _turned_back(H: FloatArray, v: FloatArray, out: FloatArray) -> None:
    """Write ``R^T v`` of a frame."""
    for a in range(3):
        out[a] = H[3 + a] * v[0] + H[6 + a] * v[1] + H[9 + a] * v[2]


@inlined
def _place(
    frames: FloatArray, nodes: IndexArray, directors: FloatArray, q: FloatArray, d: FloatArray
) -> None:
    """Write relative positions (5, 3) and directors (3, 3)."""
    first = frames[nodes[0]]
    for i in range(5):
        H = frames[nodes[1 + i]]
        for a in range(3):
            q[i, a] = H[a] - first[a]
    for k in range(3):
        H, e = frames[nodes[3 + k]], directors[k]
        for a in range(3):
            d[k, a] = H[3 + 3 * a] * e[0] + H[4 + 3 * a] * e[1] + H[5 + 3 * a] * e[2]


@inlined
def _levers(frames: FloatArray, nodes: IndexArray, directors: FloatArray, P: FloatArray) -> None:
    """Write the maps (3, 3, 3) from turns to changes of directors."""
    for k in range(3):
        H, e = frames[nodes[3 + k]], directors[k]
        for a in range(3):
            r0, r1, r2 = H[3 + 3 * a], H[4 + 3 * a], H[5 + 3 * a]
            P[k, a, 0] = r2 * e[1] - r1 * e[2]
            P[k, a, 1] = r0 * e[2] - r2 * e[0]
            P[k, a, 2] = r1 * e[0] - r0 * e[1]


@inlined
def _change(
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
            if i > 2:
                d[i - 3, a] = P[i - 3, a, 0] * u[3] + P[i - 3, a, 1] * u[4] + P[i - 3, a, 2] * u[5]


@inlined
def _products(
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
def _strain(squares: FloatArray, crosses: FloatArray, strain: FloatArray) -> None:
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
def _stress(
    planes: FloatArray, shear: FloatArray, scale: float, strain: FloatArray, stress: FloatArray
) -> None:
    """Write the stresses (24,)."""
    for p in range(4):
        for i in range(6):
            total = 0.0
            for j in range(6):
                D = planes[p, i, j] if p < 3 else shear[i, j]
                total += D * strain[6 * p + j]
            stress[6 * p + i] = scale * total


@inlined
def _sums(stress: FloatArray, a: FloatArray, b: FloatArray) -> None:
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
def _add_to_nodes(
    a: FloatArray, b: FloatArray, q: FloatArray, d: FloatArray, f: FloatArray
) -> None:
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
        _place(frames, nodes[m], directors[m], q, d)
        _products(q, d, q, d, squares, crosses)
        _strain(squares, crosses, strains[m])


@kernel
def strain_rates_into(
    frames: FloatArray, steps: FloatArray, nodes: IndexArray, directors: FloatArray,
    rates: FloatArray,
) -> None:  # fmt: skip
    """Write the derivatives (m, 24) of the strains along local twists (n, 6) of the nodes."""
    q, d, dq, dd = np.empty((5, 3)), np.empty((3, 3)), np.empty((5, 3)), np.empty((3, 3))
    squares, crosses, P = np.empty((5, 5)), np.empty((5, 3)), np.empty((3, 3, 3))
    for m in range(len(nodes)):
        _place(frames, nodes[m], directors[m], q, d)
        _levers(frames, nodes[m], directors[m], P)
        _change(frames, steps, nodes[m], P, dq, dd)
        _products(q, d, dq, dd, squares, crosses)
        _strain(squares, crosses, rates[m])
        rates[m] *= 2.0


@kernel
def add_forces(
    frames: FloatArray, nodes: IndexArray, directors: FloatArray, starts: FloatArray,
    planes: FloatArray, shears: FloatArray, scale: float, residual: FloatArray,
) -> None:  # fmt: skip
    """Add ``scale`` times the internal forces to the residual (n, 6), in axes of the nodes."""
    q, d, f, turned = np.empty((5, 3)), np.empty((3, 3)), np.empty((9, 3)), np.empty(3)
    squares, crosses, P = np.empty((5, 5)), np.empty((5, 3)), np.empty((3, 3, 3))
    strain, stress = np.empty(24), np.empty(24)
    for m in range(len(nodes)):
        _place(frames, nodes[m], directors[m], q, d)
        _levers(frames, nodes[m], directors[m], P)
        _products(q, d, q, d, squares, crosses)
        _strain(squares, crosses, strain)
        for s in range(24):
            strain[s] -= starts[m, s]
        _stress(planes[m], shears[m], scale, strain, stress)
        _sums(stress, squares, crosses)
        f[:] = 0.0
        _add_to_nodes(squares, crosses, q, d, f)
        for i in range(6):
            node = nodes[m, i]
            _turned_back(frames[node], f[i], turned)
            for a in range(3):
                residual[node, a] += turned[a]
                if i > 2:
                    for c in range(3):
                        residual[node, 3 + a] += P[i - 3, c, a] * f[3 + i, c]


@inlined
def _turns_of_forces(
    frame: FloatArray, director: FloatArray, f: FloatArray, g: FloatArray, spin: FloatArray
) -> None:
    """Write the derivative (6, 3) of a node's forces by its turn, ``f`` and ``g`` held.

    ``f`` and ``g`` are the forces on its position and on its director.
    """
    r, m = np.empty(3), np.empty(3)
    _turned_back(frame, f, r)
    _turned_back(frame, g, m)
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
    frames: FloatArray, steps: FloatArray, nodes: IndexArray, directors: FloatArray,
    starts: FloatArray, planes: FloatArray, shears: FloatArray, factors: FloatArray,
    damping: FloatArray, residual: FloatArray,
) -> None:  # fmt: skip
    """Add the tangents of :func:`tangents_into` times local twists (n, 6) to the residual."""
    q, d, dq, dd = np.empty((5, 3)), np.empty((3, 3)), np.empty((5, 3)), np.empty((3, 3))
    squares, crosses, P = np.empty((5, 5)), np.empty((5, 3)), np.empty((3, 3, 3))
    strain, stress, turned, spin = np.empty(24), np.empty(24), np.empty(3), np.empty((6, 3))
    f, df = np.empty((9, 3)), np.empty((9, 3))
    for m in range(len(nodes)):
        _place(frames, nodes[m], directors[m], q, d)
        _levers(frames, nodes[m], directors[m], P)
        _change(frames, steps, nodes[m], P, dq, dd)
        _products(q, d, q, d, squares, crosses)
        _strain(squares, crosses, strain)
        for s in range(24):
            strain[s] -= starts[m, s]
        _stress(planes[m], shears[m], factors[0], strain, stress)
        _sums(stress, squares, crosses)
        f[:], df[:] = 0.0, 0.0
        _add_to_nodes(squares, crosses, q, d, f)
        _add_to_nodes(squares, crosses, dq, dd, df)
        _products(q, d, dq, dd, squares, crosses)
        _strain(squares, crosses, strain)
        scale = 2.0 * (factors[0] + factors[1] * damping[m])
        _stress(planes[m], shears[m], scale, strain, stress)
        _sums(stress, squares, crosses)
        _add_to_nodes(squares, crosses, q, d, df)
        for i in range(6):
            node = nodes[m, i]
            _turned_back(frames[node], df[i], turned)
            for a in range(3):
                residual[node, a] += turned[a]
            if i > 2:
                _turns_of_forces(frames[node], directors[m, i - 3], f[i], f[3 + i], spin)
                for a in range(6):
                    for c in range(3):
                        residual[node, a] += spin[a, c] * steps[node, 3 + c]
                        if a > 2:
                            residual[node, a] += P[i - 3, c, a - 3] * df[3 + i, c]


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
    frames: FloatArray, nodes: IndexArray, directors: FloatArray, starts: FloatArray,
    planes: FloatArray, shears: FloatArray, factors: FloatArray, damping: FloatArray, first: int,
    tangents: FloatArray,
) -> None:  # fmt: skip
    """Write the first of the factors times the derivatives of the forces, (r, 36, 36).

    The part of the material is multiplied by the second and the damping besides.
    """
    q, d, f, spin = np.empty((5, 3)), np.empty((3, 3)), np.empty((9, 3)), np.empty((6, 3))
    squares, crosses, P = np.empty((5, 5)), np.empty((5, 3)), np.empty((3, 3, 3))
    strain, stress, row = np.empty(24), np.empty(24), np.empty((9, 3))
    B, work, K = np.empty((24, 27)), np.empty((24, 27)), np.empty((27, 27))
    at = np.empty(27, np.int64)
    for i in range(9):
        for a in range(3):
            at[3 * i + a] = 6 * i + a if i < 6 else 6 * (i - 3) + 3 + a
    for m in range(first, first + len(tangents)):
        _place(frames, nodes[m], directors[m], q, d)
        _levers(frames, nodes[m], directors[m], P)
        _products(q, d, q, d, squares, crosses)
        _strain(squares, crosses, strain)
        for s in range(24):
            strain[s] -= starts[m, s]
            _rows(q, d, s, row)
            _to_unknowns(frames, nodes[m], P, row, B[s])
        _stress(planes[m], shears[m], factors[0], strain, stress)
        _sums(stress, squares, crosses)
        _material(planes[m], shears[m], factors[0] + factors[1] * damping[m], B, work, K)
        _geometric(frames, nodes[m], P, squares, crosses, K)
        f[:] = 0.0
        _add_to_nodes(squares, crosses, q, d, f)
        out = tangents[m - first]
        out[:] = 0.0
        for u in range(27):
            for v in range(27):
                out[at[u], at[v]] = K[u, v]
        for k in range(3):
            _turns_of_forces(frames[nodes[m, 3 + k]], directors[m, k], f[3 + k], f[6 + k], spin)
            for i in range(6):
                for j in range(3):
                    out[18 + 6 * k + i, 21 + 6 * k + j] += spin[i, j]
