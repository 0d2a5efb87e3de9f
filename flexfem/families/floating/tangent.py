# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled matrices of bodies in a floating frame, in the twist of the frame and all coordinates.

The forces depend on elastic coordinates, rates (twist of the frame, then those of the coordinates)
and the rates of these; see ``inertia`` for the notation. The room ``f`` holds the state of
the body, integrals with it and the accelerations of its particles.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.families.floating.inertia import BodyData, Room, moment, put_skew
from flexfem.kernels.compiled import inlined, subroutine

__all__ = ["damping_into", "fold_matrices", "mass_into", "stiffness_into"]


@subroutine
def _put_field(W: FloatArray, C: FloatArray, f: Room, Z: FloatArray, out: FloatArray) -> None:
    """Write the forces (6 + n,) of accelerations ``W y + C dy``; ``Z`` (9,) is work space."""
    for i in range(3):
        out[i] = 0.0
        for j in range(3):
            out[i] += W[3 * i + j] * f.S[j, 0] + C[3 * i + j] * f.S[j, 1]
            Z[3 * i + j] = 0.0
            for m in range(3):
                Z[3 * i + j] += W[3 * j + m] * f.D[3 * i + m] + C[3 * j + m] * f.L[3 * i + m]
    for i in range(3):
        out[3 + i] = moment(Z, i)
    for i in range(len(out) - 6):
        total = 0.0
        for ab in range(9):
            total += W[ab] * f.Y[ab, i] + C[ab] * f.U[ab, i]
        out[6 + i] = total


@inlined
def _products(data: BodyData, ab: int, i: int) -> FloatArray:
    """Row of the integrals of ``rho Phi_i,a Phi_j,b``, j from 1."""
    return data.products[ab * data.moments.shape[1] + 1 + i, 1:]


@subroutine
def mass_into(data: BodyData, f: Room, M: FloatArray) -> None:
    """Write the mass matrix (6 + N, 6 + N); its first three columns are the derivatives by A."""
    n = f.P.shape[1]
    W, none, Z = np.zeros(9), np.zeros(9), np.empty(9)
    unit, column = np.zeros(3), np.empty(6 + n)
    M[:3, :3] = 0.0
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        M[i, i] = data.mass
        M[3 + i, i] = 0.0
        M[3 + i, b], M[3 + i, a] = f.S[a, 0], -f.S[b, 0]
        M[6:, i] = f.P[i]
        unit[i] = 1.0
        put_skew(unit, W)
        unit[i] = 0.0
        _put_field(W, none, f, Z, column)
        M[:, 3 + i] = column
    for j in range(n):
        for i in range(3):
            a, b = (i + 1) % 3, (i + 2) % 3
            M[i, 6 + j] = f.P[i, j]
            M[3 + i, 6 + j] = f.Y[3 * b + a, j] - f.Y[3 * a + b, j]
    for i in range(n):
        M[6 + i, 6:] = _products(data, 0, i) + _products(data, 4, i) + _products(data, 8, i)


@subroutine
def damping_into(data: BodyData, f: Room, M: FloatArray, out: FloatArray) -> None:
    """Write the derivatives (6 + N, 6 + N) by twist of the frame and rates; ``M``: mass matrix."""
    n, C, velocity = f.P.shape[1], f.C, f.base[12:18]
    W, twice, Z, S = np.zeros(9), np.empty(9), np.empty(9), np.empty(9)
    unit, column = np.zeros(3), np.empty(6 + n)
    spin = 0.5 * C
    put_skew(velocity[:3], S)
    for d in range(3):
        unit[d] = 1.0
        put_skew(unit, twice)
        unit[d] = 0.0
        for i in range(3):
            for j in range(3):
                total = 0.0
                for m in range(3):
                    total += twice[3 * i + m] * spin[3 * m + j]
                    total += spin[3 * i + m] * twice[3 * m + j]
                W[3 * i + j] = total
        twice *= 2.0
        _put_field(W, twice, f, Z, column)
        for i in range(6 + n):
            by_v, by_omega = 0.0, column[i]
            for m in range(3):
                by_v += M[i, m] * spin[3 * m + d]
                by_omega -= M[i, m] * S[3 * m + d]
            out[i, d], out[i, 3 + d] = by_v, by_omega
    for j in range(n):
        for i in range(3):
            out[i, 6 + j] = 0.0
            for m in range(3):
                out[i, 6 + j] += C[3 * i + m] * f.P[m, j]
        for a in range(3):
            for b in range(3):
                Z[3 * a + b] = 0.0
                for m in range(3):
                    Z[3 * a + b] += C[3 * b + m] * f.Y[3 * m + a, j]
        for i in range(3):
            out[3 + i, 6 + j] = moment(Z, i)
    for i in range(n):
        out[6 + i, 6:] = 0.0
        for ab in range(9):
            if C[ab] != 0.0:
                out[6 + i, 6:] += C[ab] * _products(data, ab, i)


@subroutine
def stiffness_into(data: BodyData, f: Room, out: FloatArray) -> None:
    """Write the derivatives (6 + N, N) by all coordinates, see ``forces_into``."""
    n, A, W, C = f.P.shape[1], f.A, f.W, f.C
    Z = np.empty(9)
    for j in range(n):
        for i in range(3):
            out[i, j] = 0.0
            for m in range(3):
                out[i, j] += W[3 * i + m] * f.P[m, j]
        for a in range(3):
            for b in range(3):
                Z[3 * a + b] = f.Q[3 * a + b, j]
                for m in range(3):
                    both = f.Y[3 * a + m, j] + f.Y[3 * m + a, j]
                    Z[3 * a + b] += W[3 * b + m] * both + C[3 * b + m] * f.U[3 * a + m, j]
        for i in range(3):
            a, b = (i + 1) % 3, (i + 2) % 3
            out[3 + i, j] = f.P[a, j] * A[b] - f.P[b, j] * A[a] + moment(Z, i)
    for i in range(n):
        out[6 + i] = 0.0
        for ab in range(9):
            if W[ab] != 0.0:
                out[6 + i] += W[ab] * _products(data, ab, i)


@subroutine
def fold_matrices(
    data: BodyData, G: FloatArray, force: FloatArray, M: FloatArray, D: FloatArray, K: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Matrices in frame and elastic coordinates from those in all of them.

    Args:
        data: of the body.
        G: (12 n, 3) see ``inertia.extend``.
        force: (6 + N,) forces on frame and all coordinates.
        M: (6 + N, 6 + N) derivatives by accelerations.
        D: (6 + N, 6 + N) derivatives by rates.
        K: (6 + N, N) derivatives by coordinates.
    """
    if not len(data.bending):
        return M, D, K
    n = len(data.stiffness)
    slopes = np.zeros((3, len(force), 6 + n))  # of all coordinates, their rates and rates of these
    for i in range(6 + n):
        slopes[0, i, i] = 1.0
    for k in range(12):
        for i in range(n):
            for t in range(3):
                slopes[t, 6 + n + k, 6 + i] = G[k * n + i, t]
    back = slopes[0].T.copy()
    bent = np.dot(K, np.ascontiguousarray(slopes[0, 6:, 6:]))
    bent += np.dot(D, np.ascontiguousarray(slopes[1, :, 6:]))
    bent += np.dot(M, np.ascontiguousarray(slopes[2, :, 6:]))
    turned = np.dot(D, slopes[0]) + 2.0 * np.dot(M, slopes[1])
    K, D, M = np.dot(back, bent), np.dot(back, turned), np.dot(back, np.dot(M, slopes[0]))
    for k in range(12):
        K[6:] += force[6 + n + k] * data.bending[k * n : (k + 1) * n]
    return M, D, K
