# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled matrices of bodies in a floating frame, in frame and elastic coordinates.

The forces depend on elastic coordinates, rates (twist of the frame, then those of the coordinates)
and the rates of these; see ``floating_inertia`` for the notation.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.elements.floating_inertia import (
    BodyData,
    Fields,
    add_elastic_tangent,
    moment,
    put_skew,
)
from flexfem.lie.compiled import inlined

__all__ = ["damping_into", "mass_into", "stiffness_into"]


@inlined
def _put_field(W: FloatArray, C: FloatArray, f: Fields, Z: FloatArray, out: FloatArray) -> None:
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


@inlined
def mass_into(data: BodyData, f: Fields, M: FloatArray) -> None:
    """Write the mass matrix (6 + n, 6 + n); its first three columns are the derivatives by A."""
    n = len(data.stiffness)
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


@inlined
def damping_into(
    data: BodyData, f: Fields, velocity: FloatArray, M: FloatArray, C: FloatArray, out: FloatArray
) -> None:
    """Write the derivatives (6 + n, 6 + n) by twist of the frame and elastic rates.

    Args:
        data: of the body.
        f: its fields.
        velocity: (6,) twist of the frame.
        M: mass matrix.
        C: (9,) ``2 skew(Omega)``.
        out: the matrix.
    """
    n = len(data.stiffness)
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
                out[i, 6 + j] += C[3 * i + m] * f.P[m, j] + 2.0 * (i == m) * f.G[m * n + j, 1]
        for a in range(3):
            for b in range(3):
                Z[3 * a + b] = 2.0 * f.G[(3 + 3 * b + a) * n + j, 1]
                for m in range(3):
                    Z[3 * a + b] += C[3 * b + m] * f.Y[3 * m + a, j]
        for i in range(3):
            out[3 + i, 6 + j] = moment(Z, i)
    for i in range(n):
        out[6 + i, 6:] = data.damping[i]
        for ab in range(9):
            if C[ab] != 0.0:
                out[6 + i, 6:] += C[ab] * _products(data, ab, i)


@inlined
def stiffness_into(
    data: BodyData, eta: FloatArray, f: Fields, A: FloatArray, W: FloatArray, C: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Write the derivatives (6 + n, n) by the elastic coordinates, see ``forces_into``."""
    n = len(eta)
    Z = np.empty(9)
    for j in range(n):
        for i in range(3):
            out[i, j] = f.G[i * n + j, 2]
            for m in range(3):
                out[i, j] += W[3 * i + m] * f.P[m, j] + C[3 * i + m] * f.G[m * n + j, 1]
        for a in range(3):
            for b in range(3):
                Z[3 * a + b] = f.Q[3 * a + b, j] + f.G[(3 + 3 * b + a) * n + j, 2]
                for m in range(3):
                    both = f.Y[3 * a + m, j] + f.Y[3 * m + a, j]
                    rate = f.U[3 * a + m, j] + f.G[(3 + 3 * m + a) * n + j, 1]
                    Z[3 * a + b] += W[3 * b + m] * both + C[3 * b + m] * rate
        for i in range(3):
            a, b = (i + 1) % 3, (i + 2) % 3
            out[3 + i, j] = f.P[a, j] * A[b] - f.P[b, j] * A[a] + moment(Z, i)
    for i in range(n):
        out[6 + i] = 0.0
        for ab in range(9):
            if W[ab] != 0.0:
                out[6 + i] += W[ab] * _products(data, ab, i)
        if len(data.bending):
            for a in range(3):
                out[6 + i] += A[a] * data.bending[a * n + i]
            for ab in range(9):
                out[6 + i] += W[ab] * data.bending[(3 + ab) * n + i]
    add_elastic_tangent(data, eta, out[6:])
