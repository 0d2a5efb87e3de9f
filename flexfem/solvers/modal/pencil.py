# SPDX-License-Identifier: LGPL-3.0-or-later
"""Quadratic eigenvalue problem of the linearised equations of motion.

``(lambda^2 M + lambda C + K) u + G^T mu = 0, G u = 0`` with the matrices of ``linearization``.
"""

from dataclasses import dataclass, replace

from petsc4py import PETSc

import numpy as np

from flexfem._types import FloatArray
from flexfem.solvers.modal.linearization import Linearization, Matrices

__all__ = ["Pencil"]

#: The first shift relative to the largest frequency: far above round-off.
_SHIFT = 1e-6
#: The same for quadratic problems, whose double zeros are roots of round-off.
_QUADRATIC_SHIFT = 1e-5
#: Asymmetry of the stiffness, relative, that is round-off.
_ASYMMETRY = 1e-12
#: The same of a symmetric part beside a skew one.
_DISSIPATION = 1e-12


@dataclass(frozen=True)
class Pencil:
    """Properties of an eigenproblem that are known before it is solved.

    Attributes:
        linearization: numbering of the unknowns.
        matrices: matrices at the state.
        damped: True if there is a term in lambda: the problem is quadratic.
        symmetric: True if the stiffness is symmetric.
        gyroscopic: True if the term in lambda is skew: it does no work.
        fastest: estimate of the largest frequency, rad/s.
        inert: True if there are neither stiffness nor a term in lambda: every frequency is zero.
    """

    linearization: Linearization
    matrices: Matrices
    damped: bool
    symmetric: bool
    gyroscopic: bool
    fastest: float
    inert: bool

    @classmethod
    def of(cls, linearization: Linearization) -> "Pencil":
        """The problem at the state of the last evaluation (collective)."""
        matrices = linearization.of_modes()
        K, C, M = matrices.stiffness, matrices.damping, matrices.mass
        _hold(linearization, matrices)
        damped = C.norm(PETSc.NormType.FROBENIUS) > 0.0
        symmetric = _turned(K, -1.0) <= _ASYMMETRY
        gyroscopic = damped and _turned(C, 1.0) <= _DISSIPATION
        count = linearization.unknowns
        k, m = (mat.getDiagonal().getArray()[:count] for mat in (K, M))
        k = np.abs(k) + _spring_diagonal(linearization, K)
        held = m > 0.0
        own = float(np.max(k[held] / m[held], initial=0.0))
        fastest = max(linearization.system.comm.allgather(own)) ** 0.5
        inert = fastest == 0.0 and not damped
        return cls(linearization, matrices, damped, symmetric, gyroscopic, fastest or 1.0, inert)

    def undamped(self) -> "Pencil":
        """The problem without the term in lambda, in which dampers have no forces (collective)."""
        none = self.matrices.damping.copy()
        none.zeroEntries()
        stiffness = _without_dampers(self.linearization, self.matrices.stiffness)
        symmetric = _turned(stiffness, -1.0) <= _ASYMMETRY
        matrices = replace(self.matrices, damping=none, stiffness=stiffness)
        return replace(
            self, matrices=matrices, damped=False, symmetric=symmetric, gyroscopic=False
        )  # fmt: skip

    def overdamped_rate(self) -> float:
        """Least rate, 1/s, at which stiff motions decay without oscillation (collective).

        Damping proportional to stiffness gathers them at one rate, where they are as many as the
        mesh has unknowns, too near to one another to be told apart. Infinite if there are none.
        """
        lin, given = self.linearization, self.matrices
        k, c, m = (
            mat.getDiagonal().getArray()[: lin.unknowns]
            for mat in (given.stiffness, given.damping, given.mass)
        )
        over = (m > 0.0) & (k > 0.0) & (c > 0.0) & (c**2 > 4.0 * k * m)
        own = float(np.min(k[over] / c[over], initial=np.inf))
        return float(min(lin.system.comm.allgather(own)))

    @property
    def shift(self) -> float:
        """Distance from zero at which the problem is inverted first, 1/s."""
        return self.fastest * (_QUADRATIC_SHIFT if self.quadratic else _SHIFT)

    @property
    def quadratic(self) -> bool:
        """True unless it is linear in ``lambda^2`` with symmetric matrices."""
        return self.damped or not self.symmetric


def _turned(matrix: PETSc.Mat, sign: float) -> float:
    """Norm of ``A^T + sign A`` relative to that of A (collective)."""
    turned = matrix.copy()
    turned.transpose()
    turned.axpy(sign, matrix)
    size = matrix.norm(PETSc.NormType.FROBENIUS)
    return float(turned.norm(PETSc.NormType.FROBENIUS) / size) if size > 0.0 else 0.0


def _hold(linearization: Linearization, matrices: Matrices) -> None:
    """Set the mass of fixed unknowns to zero: their frequencies are infinite, as for rows."""
    masks = [
        np.zeros(p.block.sizes[0], dtype=np.bool_)
        if p.block.dirichlet is None
        else p.block.dirichlet[: p.block.owned].ravel()
        for p in linearization.system.parts
    ]
    if all(p.block.dirichlet is None for p in linearization.system.parts):
        return
    held = np.concatenate([np.empty(0, dtype=np.bool_), *masks])
    for matrix, value in (
        (matrices.stiffness, 1.0),
        (matrices.damping, 0.0),
        (matrices.mass, 0.0),
    ):
        diagonal = matrix.getDiagonal()
        diagonal.getArray()[: len(held)][held] = value
        matrix.setDiagonal(diagonal)


def _without_dampers(linearization: Linearization, stiffness: PETSc.Mat) -> PETSc.Mat:
    """Copy of a stiffness without the columns of forces that do not depend on positions."""
    start, column, values = stiffness.getValuesCSR()
    first, count = stiffness.getOwnershipRange()[0], linearization.unknowns
    row = np.repeat(np.arange(linearization.size), np.diff(start))
    others = (values != 0.0) & (column != first + row)
    free = np.bincount(row[others], minlength=linearization.size) == 0
    free[:count] = False
    copy, diagonal = stiffness.copy(), stiffness.getDiagonal()
    # those of dampers of modes are no conditions, which pivots are counted for
    diagonal.getArray()[count + linearization.system.constraints.owned_count :] = 1.0
    numbers = (first + np.flatnonzero(free)).astype(PETSc.IntType)
    copy.zeroRowsColumns(numbers, diag=1.0)
    copy.setDiagonal(diagonal)
    return copy


def _spring_diagonal(linearization: Linearization, K: PETSc.Mat) -> FloatArray:
    """Diagonal of the stiffness that rows with force laws add to this rank's nodes."""
    start, index, values = K.getValuesCSR()
    squares = PETSc.Mat().createAIJ(
        (linearization.sizes, linearization.sizes), csr=(start, index, values**2), comm=K.comm
    )
    soft = linearization.softness()
    x, y = linearization.vector(), linearization.vector()
    stiff = np.where(soft > 0.0, 1.0 / np.where(soft > 0.0, soft, 1.0), 0.0)
    x.setArray(stiff + linearization.stiffness_by_states())
    squares.mult(x, y)
    found: FloatArray = y.getArray()[: linearization.unknowns].copy()
    return found
