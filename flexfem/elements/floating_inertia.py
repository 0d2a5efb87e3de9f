# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled inertia, elastic and damping forces of bodies in a floating frame, in their coordinates.

A particle is at ``x_F + R y`` with ``y = r + sum_i Phi_i eta_i``. Its acceleration in the frame's
axes, less gravity's, is ``A + W y + 2 Omega x dy + ddy`` with ``A = dV/dt + Omega x V - R^T g`` and
``W = skew(dOmega/dt) + skew(Omega)^2``. With the integrals of :class:`BodyData` sums over particles
become sums over coordinates.

A body that stiffens geometrically also moves by ``z = 1/2 sum_ij u_ij eta_i eta_j``, as a beam gets
shorter when it bends. What counts is the work of accelerations ``a + B r`` on z: z is replaced by
the field of this kind with the same work, whose twelve coefficients are further coordinates,
``zeta_k = 1/2 eta Z_k eta``. So inertia forces remain those of particles that move: the mass matrix
is positive definite, and momentum and energy are conserved.

Sources: Shabana, Dynamics of Multibody Systems (2005), ch. 5 (integrals); Wallrapp, Schwertassek,
Int. J. Numer. Methods Eng. 32 (1991) 1833 (geometric stiffening).
"""

from typing import NamedTuple

import numpy as np

from flexfem._types import FloatArray
from flexfem.lie.compiled import inlined, kernel, subroutine

__all__ = [
    "BodyData", "Fields", "add_elastic", "add_elastic_tangent", "body_acceleration", "extend",
    "fields_into", "fold", "forces_into", "interface_strains", "moment", "new_fields", "put_skew",
]  # fmt: skip


class BodyData(NamedTuple):
    """Integrals over a body about its frame, in the frame's axes.

    There are n elastic coordinates, and N = n, or n + 12 with the coordinates zeta.

    Attributes:
        rest: (k, 3) interfaces at rest.
        mass: kg.
        moments: (3, N + 1) integrals of ``rho Phi_j``, ``Phi_0 = r``.
        products: (9 (N + 1), N + 1) of ``rho Phi_i,a Phi_j,b``, rows by (a, b, i).
        stiffness, damping: (n, n).
        bending: (12 n, n) matrices Z_k one below the other; none without geometric stiffening.
        pulling: (6 k n, n) derivatives of the stiffness by the coordinates of the interfaces; none
            without geometric stiffening.
        compliance: (6 k, 6 k) inverse of the stiffness of these coordinates.
        conditions: (6, n) mean displacement and rotation of the body, which are zero; none where
            the frame is that of a node.
    """

    rest: FloatArray
    mass: float
    moments: FloatArray
    products: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    bending: FloatArray
    pulling: FloatArray
    compliance: FloatArray
    conditions: FloatArray


class Fields(NamedTuple):
    """Integrals with the present elastic displacement, see :func:`fields_into`.

    Attributes:
        P: (3, N) integrals of ``rho Phi_i``.
        S: (3, 3) of ``rho y`` and its two derivatives in time, as columns.
        D, L, N: (9,) of ``rho y_a y_b``, ``rho y_a dy_b`` and ``rho y_a ddy_b``.
        Y, U, Q: (9, N) of ``rho Phi_i,a`` times ``y_b``, ``dy_b`` and ``ddy_b``.
    """

    P: FloatArray
    S: FloatArray
    D: FloatArray
    L: FloatArray
    N: FloatArray
    Y: FloatArray
    U: FloatArray
    Q: FloatArray


@subroutine
def new_fields(data: BodyData) -> Fields:
    """Room for the fields of a body."""
    n = data.moments.shape[1] - 1
    return Fields(
        np.empty((3, n)), np.empty((3, 3)), np.empty(9), np.empty(9), np.empty(9),
        np.empty((9, n)), np.empty((9, n)), np.empty((9, n)),
    )  # fmt: skip


@subroutine
def extend(data: BodyData, eta: FloatArray, G: FloatArray) -> FloatArray:
    """All coordinates with their derivatives (N, 3) from the elastic ones (n, 3).

    ``G`` (12 n, 3) gets the products of ``bending`` with these.
    """
    if not len(data.bending):
        return eta
    n = len(eta)
    every = np.empty((n + 12, 3))
    every[:n] = eta
    G[:] = np.dot(data.bending, eta)
    for k in range(12):
        every[n + k] = 0.0
        for i in range(n):
            at = k * n + i
            every[n + k, 0] += 0.5 * eta[i, 0] * G[at, 0]
            every[n + k, 1] += eta[i, 1] * G[at, 0]
            every[n + k, 2] += eta[i, 1] * G[at, 1] + eta[i, 0] * G[at, 2]
    return every


@subroutine
def fold(data: BodyData, G: FloatArray, every: FloatArray, force: FloatArray) -> None:
    """Forces (6 + n,) on frame and elastic coordinates from those on all coordinates (6 + N,)."""
    n = len(force) - 6
    force[:] = every[: 6 + n]
    for k in range(len(every) - 6 - n):
        for i in range(n):
            force[6 + i] += every[6 + n + k] * G[k * n + i, 0]


@subroutine
def fields_into(data: BodyData, eta: FloatArray, f: Fields) -> None:
    """Write the fields for all coordinates and their derivatives (N, 3)."""
    n = len(eta)
    full = np.zeros((n + 1, 3))
    full[0, 0] = 1.0
    full[1:] = eta
    products = np.dot(data.products, full)
    sums = f.D, f.L, f.N
    for ab in range(9):
        first = ab * (n + 1)
        for t in range(3):
            total = 0.0
            for i in range(n + 1):
                total += full[i, 0] * products[first + i, t]
            sums[t][ab] = total
        for i in range(n):
            f.Y[ab, i] = products[first + 1 + i, 0]
            f.U[ab, i] = products[first + 1 + i, 1]
            f.Q[ab, i] = products[first + 1 + i, 2]
    f.S[:] = np.dot(data.moments, full)
    f.P[:] = data.moments[:, 1:]


@inlined
def put_skew(v: FloatArray, out: FloatArray) -> None:
    """Write ``skew(v)`` (9,)."""
    for i in range(3):
        p, q = (i + 1) % 3, (i + 2) % 3
        out[4 * i] = 0.0
        out[3 * i + p], out[3 * i + q] = -v[q], v[p]


@subroutine
def body_acceleration(
    base: FloatArray, gravity: FloatArray, A: FloatArray, W: FloatArray, C: FloatArray,
    weight: FloatArray,
) -> None:  # fmt: skip
    """Write A (3,), W (9,), ``C = 2 skew(Omega)`` and gravity in the axes of the frame.

    ``base`` (24,) holds the frame, its local twist and the rate of that.
    """
    frame, velocity, acceleration = base[:12], base[12:18], base[18:]
    for i in range(3):
        p, q = (i + 1) % 3, (i + 2) % 3
        weight[i] = (
            frame[3 + i] * gravity[0] + frame[6 + i] * gravity[1] + frame[9 + i] * gravity[2]
        )
        turned = velocity[3 + p] * velocity[q] - velocity[3 + q] * velocity[p]
        A[i] = acceleration[i] + turned - weight[i]
    put_skew(acceleration[3:], W)
    put_skew(velocity[3:], C)
    for i in range(3):
        for j in range(3):
            for m in range(3):
                W[3 * i + j] += C[3 * i + m] * C[3 * m + j]
    for m in range(9):
        C[m] *= 2.0


@inlined
def moment(Z: FloatArray, i: int) -> float:
    """Component of the integral of ``y x a`` from those of ``y_a a_b`` (9,)."""
    a, b = (i + 1) % 3, (i + 2) % 3
    component: float = Z[3 * a + b] - Z[3 * b + a]
    return component


@subroutine
def forces_into(
    data: BodyData, f: Fields, A: FloatArray, W: FloatArray, C: FloatArray, force: FloatArray
) -> None:
    """Write inertia forces (6 + N,) on frame and all coordinates."""
    Z = np.empty(9)
    for i in range(3):
        force[i] = data.mass * A[i] + f.S[i, 2]
        for j in range(3):
            force[i] += W[3 * i + j] * f.S[j, 0] + C[3 * i + j] * f.S[j, 1]
            Z[3 * i + j] = f.N[3 * i + j]
            for m in range(3):
                Z[3 * i + j] += W[3 * j + m] * f.D[3 * i + m] + C[3 * j + m] * f.L[3 * i + m]
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        force[3 + i] = f.S[a, 0] * A[b] - f.S[b, 0] * A[a] + moment(Z, i)
    for i in range(len(force) - 6):
        total = f.Q[0, i] + f.Q[4, i] + f.Q[8, i]
        for a in range(3):
            total += f.P[a, i] * A[a]
        for ab in range(9):
            total += W[ab] * f.Y[ab, i] + C[ab] * f.U[ab, i]
        force[6 + i] = total


@kernel
def interface_strains(data: BodyData, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """``T_k eta`` (6k, n) and the strains (6k,) of the interfaces' coordinates with it.

    Only for bodies that stiffen geometrically.
    """
    count, n = len(data.compliance), len(x)
    pulls = np.dot(data.pulling, x).reshape(count, n)
    strains = x[:count] + np.dot(data.compliance, 0.5 * np.dot(pulls, x))
    return pulls, strains


@subroutine
def add_elastic(data: BodyData, eta: FloatArray, force: FloatArray) -> None:
    """Add elastic and damping forces (n,).

    With geometric stiffening the potential is ``1/2 eta K eta + eta_c tau + 1/2 tau F tau``,
    ``tau_k = 1/2 eta T_k eta`` and F the compliance of the interfaces' coordinates eta_c: the
    square of their strains, which what stretches by bending counts in.
    """
    x, rates = eta[:, 0].copy(), eta[:, 1].copy()
    own = np.dot(data.stiffness, x) + np.dot(data.damping, rates)
    for i in range(len(x)):
        force[i] += own[i]
    if len(data.pulling):
        pulls, strains = interface_strains(data, x)
        for k in range(len(strains)):
            force[k] += 0.5 * np.dot(pulls[k], x)
            for i in range(len(x)):
                force[i] += strains[k] * pulls[k, i]


@subroutine
def add_elastic_tangent(data: BodyData, eta: FloatArray, K: FloatArray) -> None:
    """Add the derivatives (n, n) of the elastic forces by the coordinates."""
    n = len(eta)
    K += data.stiffness
    if not len(data.pulling):
        return
    pulls, strains = interface_strains(data, eta[:, 0].copy())
    for k in range(len(strains)):
        for i in range(n):
            K[k, i] += pulls[k, i]
            K[i, k] += pulls[k, i]
            for j in range(n):
                K[i, j] += strains[k] * data.pulling[k * n + i, j]
    K += np.dot(pulls.T.copy(), np.dot(data.compliance, pulls))
