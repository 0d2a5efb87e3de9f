# SPDX-License-Identifier: LGPL-3.0-or-later
"""The four formalisms as equations for accelerations.

With F the equations of motion without constraints, F + G^T lambda = Q, and A a basis of the null
space of G:

lagrange       M q'' = Q - F(q, q', 0) - G^T lambda, F by three derivatives of L
gibbs_appell   the same, F by one derivative of the energy of accelerations
maggi          A^T (F - Q) = 0: one equation for each independent speed, no multipliers
hamilton       q' = dH/dp = M^-1 p, p' = -dH/dq + Q - G^T lambda

M may be singular where the constraints see to it that nothing moves without inertia: q' = dH/dp is
the solution of M q' = p on the constraints.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from flexfem._checks import InputError
from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.research.formalisms.equations import MechanismEquations

__all__ = ["Partition", "accelerations", "consistent_start", "null_space", "saddle", "unknowns"]

#: Smallest pivot, relative to the largest, of constraints that are independent.
_RANK = 1e-10


def unknowns(formalism: str, equations: MechanismEquations) -> int:
    """Unknowns of a formalism: coordinates or independent speeds, momenta and multipliers."""
    n, m = equations.size, equations.constraints
    return {"lagrange": n + m, "gibbs_appell": n + m, "maggi": n - m, "hamilton": 2 * n + m}[
        formalism
    ]


def saddle(A: FloatArray, G: FloatArray, transposed: FloatArray | None = None) -> FloatArray:
    """[[A, B^T], [G, 0]], with B = G unless it is given."""
    n, m = len(A), len(G)
    K = np.zeros((n + m, n + m))
    K[:n, :n], K[n:, :n] = A, G
    K[:n, n:] = (G if transposed is None else transposed).T
    return K


def solve_constrained(M: FloatArray, G: FloatArray, f: FloatArray, g: FloatArray) -> FloatArray:
    """Accelerations a (n) with M a + G^T lambda = f and G a = g, without the multipliers.

    Coordinates are scaled to unit mass, constraints to unit gradient: lengths, angles and nodal
    displacements differ by orders of magnitude.
    """
    scale = 1.0 / np.sqrt(np.diag(M))
    scaled = G * scale
    size = 1.0 / np.linalg.norm(scaled, axis=1)
    matrix = saddle(scale[:, None] * M * scale, size[:, None] * scaled)
    solution = np.linalg.solve(matrix, np.concatenate([scale * f, size * g]))
    result: FloatArray = scale * solution[: len(f)]
    return result


@dataclass(frozen=True)
class Partition:
    """Coordinates split into dependent ones, which the constraints determine, and the others."""

    dependent: IntArray
    independent: IntArray


def partition(G: FloatArray, preferred: BoolArray) -> Partition:
    """Choose dependent coordinates by pivoting, largest first.

    Those of frames are preferred: elastic forces do not depend on them, so that the stiff part of
    A^T K A stays the same while a body rotates, and a matrix can be kept.

    Args:
        G: constraint Jacobian (m, n).
        preferred: (n,) coordinates that are taken where they are not a tenth of others.

    Raises:
        InputError: the constraints are redundant.
    """
    m, n = G.shape
    if m == 0:
        return Partition(np.zeros(0, dtype=np.int64), np.arange(n))
    R, order = scipy.linalg.qr(np.where(preferred, 10.0, 1.0) * G, pivoting=True, mode="r")
    pivots = np.abs(np.diag(R))
    if m > n or pivots[-1] <= _RANK * pivots[0]:
        excess = m - int((pivots > _RANK * pivots[0]).sum())
        raise InputError(
            f"Mechanism: {excess} of {m} constraints are redundant (joints constrain the "
            "same motion twice, or the configuration is singular); remove the duplicates, or "
            "start from another configuration"
        )
    return Partition(np.sort(order[:m]), np.sort(order[m:]))


def null_space(G: FloatArray, split: Partition) -> FloatArray:
    """A (n, n - m) with G A = 0; its columns are Maggi's a_kj for independent speeds q'_j."""
    A = np.zeros((G.shape[1], len(split.independent)))
    A[split.independent, np.arange(len(split.independent))] = 1.0
    if len(split.dependent):
        A[split.dependent] = -np.linalg.solve(G[:, split.dependent], G[:, split.independent])
    return A


def accelerations(
    formalism: str, equations: MechanismEquations, q: FloatArray, qd: FloatArray, t: float = 0.0
) -> FloatArray:
    """Second derivatives q'' (n) of the coordinates at a state.

    Args:
        formalism: one of `FORMALISMS`.
        equations: of the mechanism.
        q: coordinates that satisfy the constraints.
        qd: their rates, which do so as well.
        t: time, s.
    """
    G, given = equations.jacobian(q), equations.prescribed_accelerations(q, qd, t)
    zero, n = np.zeros_like(q), equations.size
    applied = equations.forces(q, t)
    if formalism == "hamilton":
        # the state of this formalism is (q, p), and its rate is (q', p')
        p = equations.vector("momentum", q, qd)
        M = equations.matrix("hamilton", (1.0,), q, qd)
        speeds = solve_constrained(M, G, p, equations.prescribed_rates(t))
        change = equations.matrix("hamilton", (0.0, 1.0), q, speeds) @ speeds
        f = equations.vector("force", q, speeds) + applied
        return solve_constrained(M, G, f - change, given)
    M = equations.matrix("tangent", (0.0, 0.0, 1.0), q, qd, zero)
    name = "gibbs_appell" if formalism == "gibbs_appell" else "lagrange"
    F = equations.vector(name, q, qd, zero) - applied
    if formalism != "maggi":
        return solve_constrained(M, G, -F, given)
    split = partition(G, equations.of_frames)
    A, particular = null_space(G, split), np.zeros(n)
    if len(split.dependent):
        particular[split.dependent] = np.linalg.solve(G[:, split.dependent], given)
    own = scipy.linalg.solve(A.T @ M @ A, -A.T @ (F + M @ particular), assume_a="pos")
    result: FloatArray = A @ own + particular
    return result


def consistent_start(
    equations: MechanismEquations, t: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Declared coordinates and rates, moved the least until they satisfy the constraints.

    "The least" is measured by the kinetic energy of the change.

    Raises:
        InputError: the bodies cannot be brought together, or their frames are not held.
    """
    q, qd = (part.copy() for part in equations.start)
    M = equations.matrix("hamilton", (1.0,), q, qd)
    _check_inertia(equations, M, equations.jacobian(q))
    for _ in range(50):
        gap = equations.gaps(q, t)
        G = equations.jacobian(q)
        partition(G, equations.of_frames)
        step = solve_constrained(M, G, np.zeros(equations.size), -gap)
        q += step
        if np.abs(step).max() <= 1e-13 * max(1.0, np.abs(q).max()):
            break
    else:
        raise InputError(
            f'Mechanism "{equations.mechanism.name}": its joints cannot be closed at the start, '
            f"a gap of {np.abs(gap).max():g} remains; place its bodies closer to each other"
        )
    G = equations.jacobian(q)
    wanted = equations.prescribed_rates(t) - G @ qd
    return q, qd + solve_constrained(M, G, np.zeros(equations.size), wanted)


def _check_inertia(equations: MechanismEquations, M: FloatArray, G: FloatArray) -> None:
    """Refuse motions without inertia that the constraints allow.

    Raises:
        InputError: there is one.
    """
    A = null_space(G, partition(G, equations.of_frames))
    own = A.T @ M @ A
    scale = 1.0 / np.sqrt(np.maximum(np.diag(own), 1e-300))
    if len(own) and np.linalg.eigvalsh(scale[:, None] * own * scale)[0] < 1e-13:
        raise InputError(
            f'Mechanism "{equations.mechanism.name}": the mass matrix is singular; a body has no '
            "mass, or elastic coordinates that move it like its frame must be fixed (held)"
        )
