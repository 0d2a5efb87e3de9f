# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled inertia forces of bodies in a floating frame, in their coordinates.

A particle is at ``x_F + R y`` with ``y = r + sum_i Phi_i eta_i``. Its acceleration in the frame's
axes, less gravity's, is ``A + W y + 2 Omega x dy + ddy`` with ``A = dV/dt + Omega x V - R^T g`` and
``W = skew(dOmega/dt) + skew(Omega)^2``. With the integrals of :class:`BodyData` sums over particles
become sums over coordinates.

A body with geometric stiffening also moves by ``z = 1/2 sum_ij u_ij eta_i eta_j``, as a beam gets
shorter when it bends. Only the work of accelerations ``a + B r`` on z matters: z is replaced by
the field of this kind with the same work, whose twelve coefficients are further coordinates,
``zeta_k = 1/2 eta Z_k eta``. So inertia forces remain those of particles that move: the mass matrix
is positive definite, and momentum and energy are conserved.

Sources: Shabana, Dynamics of Multibody Systems (2005), ch. 5 (integrals); Wallrapp, Schwertassek,
Int. J. Numer. Methods Eng. 32 (1991) 1833 (geometric stiffening).
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.kernels.compiled import inlined, subroutine
from flexfem.kernels.records import Float1D, Float2D, Float3D, Record

__all__ = [
    "BodyData", "Room", "body_acceleration", "extend", "fields_into", "fold", "forces_into",
    "moment", "put_skew", "room_for",
]  # fmt: skip


class BodyData(Record):
    """Integrals over a body about its frame, in the frame's axes.

    There are n elastic coordinates, and N = n, or n + 12 with the coordinates zeta. Those of a
    nonlinear body end with six products of rotations for each interface, see
    ``core.places.floating_frames``: n = 12 k + m with its m amplitudes, otherwise 6 k + m.

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
        quadratic: (P, n), cubic: (P, P) of nonlinear elastic forces, see ``elastic``; none of
            linear bodies.
        conditions: (6, n) mean displacement and rotation of the body, which are zero; none where
            the frame is that of a node.
    """

    rest: Float2D
    mass: float
    moments: Float2D
    products: Float2D
    stiffness: Float2D
    damping: Float2D
    bending: Float2D
    pulling: Float2D
    compliance: Float2D
    quadratic: Float2D
    cubic: Float2D
    conditions: Float2D


class Room(Record):
    """Work space for one body after the other: k interfaces, s unknowns of nodes and frame.

    Attributes:
        base: (24,) frame, its local twist and the rate of that.
        X: (k, 3, 12) interfaces relative to the frame, and the derivatives of these in time.
        g: (k, 4) factors of the derivatives of their rotations, see
            ``core.places.floating_frames``.
        eta: (n, 3) coordinates with their derivatives in time.
        G: (12 n, 3) see :func:`extend`; none without geometric stiffening.
        P: (3, N) integrals of ``rho Phi_i``.
        S: (3, 3) of ``rho y`` and its two derivatives in time, as columns.
        D, L, N: (9,) of ``rho y_a y_b``, ``rho y_a dy_b`` and ``rho y_a ddy_b``.
        Y, U, Q: (9, N) of ``rho Phi_i,a`` times ``y_b``, ``dy_b`` and ``ddy_b``.
        A, W, C, weight: (3,), (9,), (9,) and (3,), see :func:`body_acceleration`.
        units, columns: (k, 12, 12) and (k, 6, 12), of nonlinear bodies (k, 12, 12), see
            ``core.places.floating_frames.write_columns``.
        to_nodes: (6 + n, s) derivatives of frame and coordinates by all steps.
        places: (n, s) changes of the coordinates along these steps.
        rates, jerks: (6 + n, s) of twist of the frame and elastic rates, and of their rates.
        turned: (n, 6) of the rates of the elastic rates by the twist of a frame without node.
        moved: (6, s) steps of the frame.
    """

    base: Float1D
    X: Float3D
    g: Float2D
    eta: Float2D
    G: Float2D
    P: Float2D
    S: Float2D
    D: Float1D
    L: Float1D
    N: Float1D
    Y: Float2D
    U: Float2D
    Q: Float2D
    A: Float1D
    W: Float1D
    C: Float1D
    weight: Float1D
    units: Float3D
    columns: Float3D
    to_nodes: Float2D
    places: Float2D
    rates: Float2D
    jerks: Float2D
    turned: Float2D
    moved: Float2D


def room_for(data: BodyData, nodes: int) -> Room:
    """Work space for a body with this number of nodes."""
    k, n, every = len(data.rest), len(data.stiffness), data.moments.shape[1] - 1
    size = 6 * nodes + (6 if len(data.conditions) else 0)
    width = 12 if len(data.quadratic) else 6
    return Room(
        base=np.zeros(24), X=np.zeros((k, 3, 12)), g=np.zeros((k, 4)), eta=np.zeros((n, 3)),
        G=np.zeros((len(data.bending), 3)), P=np.zeros((3, every)), S=np.zeros((3, 3)),
        D=np.zeros(9), L=np.zeros(9), N=np.zeros(9), Y=np.zeros((9, every)),
        U=np.zeros((9, every)), Q=np.zeros((9, every)), A=np.zeros(3), W=np.zeros(9),
        C=np.zeros(9), weight=np.zeros(3), units=np.zeros((k, 12, 12)),
        columns=np.zeros((k, width, 12)), to_nodes=np.zeros((6 + n, size)),
        places=np.zeros((n, size)), rates=np.zeros((6 + n, size)), jerks=np.zeros((6 + n, size)),
        turned=np.zeros((n, 6)), moved=np.zeros((6, size)),
    )  # fmt: skip


@subroutine
def extend(data: BodyData, room: Room) -> FloatArray:
    """All coordinates with their derivatives (N, 3) from the elastic ones (n, 3).

    ``room.G`` gets the products of ``bending`` with these.
    """
    eta, G = room.eta, room.G
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
def fields_into(data: BodyData, eta: FloatArray, f: Room) -> None:
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
def body_acceleration(room: Room, gravity: FloatArray) -> None:
    """Write A, W, ``C = 2 skew(Omega)`` and gravity in the axes of the frame."""
    A, W, C, weight = room.A, room.W, room.C, room.weight
    frame, velocity, acceleration = room.base[:12], room.base[12:18], room.base[18:]
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
def forces_into(data: BodyData, f: Room, force: FloatArray) -> None:
    """Write inertia forces (6 + N,) on frame and all coordinates."""
    A, W, C, Z = f.A, f.W, f.C, np.empty(9)
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
