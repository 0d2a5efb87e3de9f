# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Inertia of a beam with assumed modes on a moving base: all modal integrals, computed once.

Kane, Ryan, Banerjee, "Dynamics of a cantilever beam attached to a moving base", J. Guidance 10(2)
(1987) 139-151, written with the kinetic energy. A section at x has the mass centre and rotation

``r = x a1 + e + u + theta x e + 1/2 theta x (theta x e) - 1/2 a1 int_0^x (u2'^2 + u3'^2)``,
``R = exp(theta)``,

with (u, theta) = (s, u2, u3, theta1, theta2, theta3) linear in q: exact to second order in q, which
is what is needed for equations linear in q, in whatever way they are derived. With nu the velocity
of the root and the angular velocity of the base (components along a1, a2, a3),

``T = 1/2 nu.A(q) nu + nu.B(q) q' + 1/2 q'.M q'``,
``A = A0 + A1 q + 1/2 q.A2 q``, ``B = B0 + B1 q``,

where nothing of second order in (q, q') is missing. Lagrange's equations with prescribed nu are

``M q'' + G q' + K q = F``, ``G = B(nu) - B(nu)^T``, ``K = H + B(nu') - 1/2 A2(nu, nu)``,
``F = 1/2 A1(nu, nu) - B0^T nu'``, ``B(nu)_ij = nu_r B1_rij``.

For mass centres alone this is the published form: ``G_ij = 2 int rho phi_i.(omega x phi_j)``,
``K_ij = H_ij + int rho phi_i.(omega' x phi_j + omega x (omega x phi_j)) - int rho (a_b.a1)(b_ij +
g_ij)``, ``F_i = -int rho phi_i.a_b``, a_b the acceleration of the beam were it rigid.

The kinetic energy depends on neither place nor orientation of the base, also when cut off after the
second order: with a free base linear and angular momentum, and the energy, are kept exactly.
"""

from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray
from flexfem.moving_base.basis import Basis
from flexfem.moving_base.effects import Effects
from flexfem.moving_base.fields import centre_displacements

__all__ = ["Inertia", "inertia_of", "rigid_inertia"]

#: Permutation symbol.
_EPS = np.zeros((3, 3, 3))
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _EPS[_i, _j, _k], _EPS[_i, _k, _j] = 1.0, -1.0


@dataclass(frozen=True, eq=False)
class Inertia:
    """Coefficients of the kinetic energy.

    Attributes:
        A0, A1, A2: (6, 6), (6, 6, n), (6, 6, n, n).
        B0, B1: (6, n), (6, n, n); ``B1[r, i, j]`` belongs to q'_i q_j.
        M: (n, n).
    """

    A0: FloatArray
    A1: FloatArray
    A2: FloatArray
    B0: FloatArray
    B1: FloatArray
    M: FloatArray


def _symmetric(a: FloatArray) -> FloatArray:
    """Symmetric part in the last two indices."""
    return 0.5 * (a + np.swapaxes(a, -1, -2))


def inertia_of(basis: Basis, effects: Effects) -> Inertia:
    """Integrals of the functions of a basis."""
    centres, rotary = _of_centres(basis, effects), _of_rotations(basis, effects)
    names = ("A0", "A1", "A2", "B0", "B1", "M")
    return Inertia(*(getattr(centres, k) + getattr(rotary, k) for k in names))


def _of_centres(basis: Basis, effects: Effects) -> Inertia:
    """Of the mass centres."""
    s, psi = basis.sections, basis.fields[3:]
    w, e = basis.quadrature.weights * s.mass, s.eccentricity
    n = basis.size
    r0 = e + np.array([basis.quadrature.x, 0.0 * w, 0.0 * w])
    P = np.array(centre_displacements(list(basis.fields), e))
    Q = np.zeros((3, len(w), n, n))
    if effects.section_rotations:
        # 1/2 theta x (theta x e) = 1/2 (theta (e.theta) - e theta^2)
        along = np.einsum("ap,api->pi", e, psi)
        Q += _symmetric(np.einsum("api,pj->apij", psi, along))
        Q -= np.einsum("ap,bpi,bpj->apij", e, psi, psi)
    if effects.stiffening:
        Q[0] -= basis.shortening
    S0, S1 = r0 @ w, np.einsum("p,api->ai", w, P)
    S2 = np.einsum("p,apij->aij", w, Q)
    # second moments r_a r_b, and r_a r_b' with the rate last
    weighted = w * r0
    W0 = weighted @ r0.T
    N0 = np.einsum("ap,bpi->abi", weighted, P)
    W1 = N0 + np.swapaxes(N0, 0, 1)
    PP = np.einsum("p,api,bpj->abij", w, P, P)  # i of a, j of b
    rQ = np.einsum("ap,bpij->abij", weighted, Q)
    W2 = PP + np.swapaxes(PP, 0, 1) + rQ + np.swapaxes(rQ, 0, 1)
    N1 = np.swapaxes(PP, -1, -2) + rQ  # i of the rate, of b; j of a
    A0, A1, A2 = (
        _rigid(m, s, w2)
        for m, s, w2 in ((w.sum(), S0, W0), (0.0, S1, W1), (0.0, S2, _symmetric(W2)))
    )
    B0 = np.concatenate([S1, np.einsum("cab,abi->ci", _EPS, N0)])
    B1 = np.concatenate([S2, np.einsum("cab,abij->cij", _EPS, N1)])
    return Inertia(A0, A1, A2, B0, B1, np.einsum("aaij->ij", PP))


def _rigid(mass: float, first: FloatArray, second: FloatArray) -> FloatArray:
    """Inertia (6, 6, ...) from mass, first moments (3, ...) and second ones (3, 3, ...)."""
    out = np.zeros((6, 6, *first.shape[1:]))
    for a in range(3):
        out[a, a] = mass
        out[3 + a, 3 + a] = np.einsum("bb...->...", second)
    out[3:, 3:] -= second
    # V.(omega x S)
    cross = np.einsum("abc,c...->ab...", _EPS, first)
    out[:3, 3:] = cross
    out[3:, :3] = np.swapaxes(cross, 0, 1)
    return out


def rigid_inertia(mass: float, centre: FloatArray, inertia: FloatArray) -> FloatArray:
    """Inertia (6, 6) about the root of a rigid body with moments about its own mass centre."""
    out = _rigid(mass, mass * centre, mass * np.outer(centre, centre))
    out[3:, 3:] += inertia
    return out


def _of_rotations(basis: Basis, effects: Effects) -> Inertia:
    """Of the sections' rotations, ``1/2 w.J w`` with w = R^T omega + (rate of R)."""
    J, psi, n = basis.sections.rotary, basis.fields[3:], basis.size
    w = basis.quadrature.weights
    first = np.einsum("p,cp,kpi->cki", w, J, psi)  # int J_c theta_k
    second = np.einsum("p,cp,kpi,lpj->cklij", w, J, psi, psi)  # int J_c theta_k theta_l
    A0, A1, A2 = np.zeros((6, 6)), np.zeros((6, 6, n)), np.zeros((6, 6, n, n))
    B0, B1 = np.zeros((6, n)), np.zeros((6, n, n))
    A0[3:, 3:] = np.diag(J @ w)
    # theta~ J - J theta~, theta~_ab = -eps_abk theta_k
    A1[3:, 3:] = np.einsum("abk,aki->abi", _EPS, first) - np.einsum("abk,bki->abi", _EPS, first)
    B0[3:] = np.einsum("cci->ci", first)
    # |omega x theta|_J: -theta~ J theta~
    turned = -np.einsum("ack,cbl,cklij->abij", _EPS, _EPS, second)
    # (omega x theta).J theta': omega_c eps_cab theta_a J_b theta'_b
    B1[3:] = np.einsum("cab,bbaij->cij", _EPS, second)
    if effects.section_rotations:
        # J omega.(1/2 theta x (theta x omega)): 1/2 (theta theta^T - theta^2) J and transposed
        half = 0.5 * np.einsum("babij->abij", second)
        square = np.einsum("bkkij->bij", second)
        for b in range(3):
            half[b, b] -= 0.5 * square[b]
        turned = turned + half + np.swapaxes(half, 0, 1)
        # -1/2 J omega.(theta x theta'): -1/2 omega_c J_c eps_cab theta_a theta'_b
        B1[3:] -= 0.5 * np.einsum("cab,cbaij->cij", _EPS, second)
    A2[3:, 3:] = 2.0 * _symmetric(turned)
    M = np.einsum("cccij->ij", second)
    return Inertia(A0, A1, A2, B0, B1, M)
