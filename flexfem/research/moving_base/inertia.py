# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Inertia of a beam with assumed modes on a moving base: all modal integrals, computed once.

Kane, Ryan, Banerjee, "Dynamics of a cantilever beam attached to a moving base", J. Guidance 10(2)
(1987) 139-151, written with the kinetic energy. A section at x has the mass centre and rotation

``r = (x - 1/2 int_0^x (u2'^2 + u3'^2)) a1 + u + R e``, ``R = R3(theta3) R2(theta2) R1(theta1)``,

with (u, theta) = (s, u2, u3, theta1, theta2, theta3) linear in q, and both expanded to second order
in q, as equations linear in q need. The derivation of these does not matter, but which parameters
of the rotation are linear in q does: another choice changes r by terms of second order, on which
the inertia of the undeformed beam does work. The sequence of rotations about the axes a1, a2, a3 of
the base, in this order, is

``R = 1 + theta~ + 1/2 (theta~ theta~ + c~)``, ``c = (-theta2 theta3, theta1 theta3, -theta1
theta2)``,

with ``theta~ e = theta x e``; the rotation about the vector theta is the same without c. Sections
have the angular velocity ``R^T omega + theta' - 1/2 theta x theta' + 1/2 c'``. With nu the velocity
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

from dataclasses import dataclass, replace

import numpy as np

from flexfem._types import FloatArray
from flexfem.research.moving_base.basis import Basis
from flexfem.research.moving_base.effects import Effects
from flexfem.research.moving_base.fields import centre_displacements
from flexfem.research.moving_base.rotations import PERMUTATION, second_derivatives

__all__ = ["Inertia", "inertia_of", "rigid_inertia"]

#: Mass matrices with smaller eigenvalues, in parts of the largest, are singular but for rounding.
_SINGULAR = 1e-13


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
    """Integrals of the functions of a basis.

    Raises:
        ValueError: mass points on the axis leave a function without mass.
    """
    if not effects.section_inertia:
        axis = replace(basis.sections, rotary=np.zeros_like(basis.sections.rotary),
                       eccentricity=np.zeros_like(basis.sections.eccentricity))  # fmt: skip
        basis = replace(basis, sections=axis)
        masses = np.linalg.eigvalsh(_of_centres(basis, effects).M)
        if masses[0] <= _SINGULAR * masses[-1]:
            raise ValueError(
                f"Effects: without section_inertia {basis.size} functions move the axis in fewer "
                "ways; take fewer modes, or leave out torsion"
            )
    centres, rotary = _of_centres(basis, effects), _of_rotations(basis, effects)
    names = ("A0", "A1", "A2", "B0", "B1", "M")
    return Inertia(*(getattr(centres, k) + getattr(rotary, k) for k in names))


def _of_centres(basis: Basis, effects: Effects) -> Inertia:
    """Of the mass centres."""
    s, psi = basis.sections, basis.fields[3:]
    w, e = basis.quadrature.weights * s.mass, s.eccentricity
    r0 = e + np.array([basis.quadrature.x, 0.0 * w, 0.0 * w])
    P = np.array(centre_displacements(list(basis.fields), e))
    # the second derivative of R e
    Q = np.einsum(
        "abkl,bp,kpi,lpj->apij", second_derivatives(effects.rotations), e, psi, psi, optimize=True
    )
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
    B0 = np.concatenate([S1, np.einsum("cab,abi->ci", PERMUTATION, N0)])
    B1 = np.concatenate([S2, np.einsum("cab,abij->cij", PERMUTATION, N1)])
    return Inertia(A0, A1, A2, B0, B1, np.einsum("aaij->ij", PP))


def _rigid(mass: float, first: FloatArray, second: FloatArray) -> FloatArray:
    """Inertia (6, 6, ...) from mass, first moments (3, ...) and second ones (3, 3, ...)."""
    out = np.zeros((6, 6, *first.shape[1:]))
    for a in range(3):
        out[a, a] = mass
        out[3 + a, 3 + a] = np.einsum("bb...->...", second)
    out[3:, 3:] -= second
    # V.(omega x S)
    cross = np.einsum("abc,c...->ab...", PERMUTATION, first)
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
    A1[3:, 3:] = np.einsum("abk,aki->abi", PERMUTATION, first) - np.einsum(
        "abk,bki->abi", PERMUTATION, first
    )
    B0[3:] = np.einsum("cci->ci", first)
    # |omega x theta|_J: -theta~ J theta~
    turned = -np.einsum("ack,cbl,cklij->abij", PERMUTATION, PERMUTATION, second)
    # (omega x theta).J theta': omega_c eps_cab theta_a J_b theta'_b
    B1[3:] = np.einsum("cab,bbaij->cij", PERMUTATION, second)
    S = second_derivatives(effects.rotations)
    # 1/2 (S J + J S^T)
    half = 0.5 * np.einsum("abkl,bklij->abij", S, second)
    turned = turned + half + np.swapaxes(half, 0, 1)
    if effects.rotations != "linear":
        # J omega.(the vector of S(theta, theta') - 1/2 theta x theta')
        vector = -0.5 * (np.einsum("cab,abkl->ckl", PERMUTATION, S) + PERMUTATION)
        B1[3:] += np.einsum("ckl,cklij->cji", vector, second)
    A2[3:, 3:] = 2.0 * _symmetric(turned)
    M = np.einsum("cccij->ij", second)
    return Inertia(A0, A1, A2, B0, B1, M)
