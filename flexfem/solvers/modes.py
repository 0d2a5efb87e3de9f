# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modes: solutions ``exp(lambda t) u`` of the linearised equations of motion.

``(lambda^2 M + lambda C + K) u + G^T mu = 0, G u = 0`` with the matrices of ``linearization``.
Without C it is a linear problem in ``lambda^2``. Multipliers make infinite eigenvalues, which the
shift-and-invert transformation maps to zero, the end of the spectrum that is never looked at
(Meerbergen, Spence 1997). Small problems are solved densely.
"""

from dataclasses import dataclass
from typing import Any

from petsc4py import PETSc
from slepc4py import SLEPc

import numpy as np
import numpy.typing as npt

from flexfem._types import BoolArray, FloatArray
from flexfem.la.dense import gather_rows
from flexfem.la.nest import direct_solver, factorise
from flexfem.solvers.linearization import Linearization, Matrices

__all__ = ["ComplexArray", "Pencil", "solve_pencil"]

ComplexArray = npt.NDArray[np.complex128]

#: Unknowns and multipliers up to which every rank solves the problem densely: always, or when more
#: than a quarter of all modes is asked for.
_DENSE, _DENSE_FOR_MANY = 100, 400
#: The shift relative to the largest frequency: far above round-off, far below what is looked for.
_SHIFT, _DENSE_SHIFT = 1e-6, 1e-3
#: Asymmetry of the stiffness, relative, that is round-off.
_ASYMMETRY = 1e-12
_ITERATIONS = 500
#: Inverted eigenvalues of dense problems, times the largest frequency squared, that are not zero.
_FINITE = 3e-3


@dataclass(frozen=True)
class Pencil:
    """What is known of an eigenproblem before it is solved.

    Attributes:
        linearization: numbering of the unknowns.
        matrices: at the state.
        damped: there is a term in lambda: the problem is quadratic.
        symmetric: the stiffness is symmetric.
        fastest: estimate of the largest frequency, rad/s.
    """

    linearization: Linearization
    matrices: Matrices
    damped: bool
    symmetric: bool
    fastest: float

    @classmethod
    def of(cls, linearization: Linearization) -> "Pencil":
        """The problem at the state of the last evaluation (collective)."""
        matrices = linearization.matrices()
        K, C, M = matrices.stiffness, matrices.damping, matrices.mass
        _hold(linearization, matrices)
        damped = C.norm(PETSc.NormType.FROBENIUS) > 0.0
        transposed = K.copy()
        transposed.transpose()
        transposed.axpy(-1.0, K)
        size = K.norm(PETSc.NormType.FROBENIUS)
        symmetric = transposed.norm(PETSc.NormType.FROBENIUS) <= _ASYMMETRY * size
        count = linearization.unknowns
        k, m = (mat.getDiagonal().getArray()[:count] for mat in (K, M))
        k = np.abs(k) + _spring_diagonal(linearization, K)
        held = m > 0.0
        own = float(np.max(k[held] / m[held], initial=0.0))
        fastest = max(linearization.system.comm.allgather(own)) ** 0.5
        return cls(linearization, matrices, damped, symmetric, fastest or 1.0)

    @property
    def shift(self) -> float:
        """Distance from zero at which the problem is inverted, 1/s."""
        return _SHIFT * self.fastest * (100.0 if self.damped else 1.0)


def _hold(linearization: Linearization, matrices: Matrices) -> None:
    """Give unknowns that are held no mass: their frequencies are infinite, as those of rows."""
    masks = [
        np.zeros(p.block.sizes[0], dtype=np.bool_)
        if p.block.held is None
        else p.block.held[: p.block.owned].ravel()
        for p in linearization.system.parts
    ]
    if all(p.block.held is None for p in linearization.system.parts):
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


def _spring_diagonal(linearization: Linearization, K: PETSc.Mat) -> FloatArray:
    """Diagonal of what rows with force laws add to the stiffness of this rank's nodes."""
    start, index, values = K.getValuesCSR()
    squares = PETSc.Mat().createAIJ(
        (linearization.sizes, linearization.sizes), csr=(start, index, values**2), comm=K.comm
    )
    soft = linearization.softness()
    x, y = linearization.vector(), linearization.vector()
    x.setArray(np.where(soft > 0.0, 1.0 / np.where(soft > 0.0, soft, 1.0), 0.0))
    squares.mult(x, y)
    found: FloatArray = y.getArray()[: linearization.unknowns].copy()
    return found


def solve_pencil(
    pencil: Pencil, count: int, target: float, tolerance: float
) -> tuple[ComplexArray, ComplexArray]:
    """Eigenvalues nearest to a frequency and their vectors (collective).

    Args:
        pencil: the problem.
        count: number of eigenvalues, conjugate pairs counted once.
        target: rad/s; undamped problems only.
        tolerance: relative residual of the eigenvalues.

    Returns:
        Eigenvalues lambda (k,), k >= 1, in the upper half plane or real, and vectors (k, n) on
        this rank's range. Of undamped problems lambda is ``i omega``, or real where ``omega^2`` is
        negative.
    """
    size = pencil.linearization.sizes[1]
    if size <= _DENSE or (size <= _DENSE_FOR_MANY and 4 * count > size):
        values, vectors = _solve_densely(pencil)
    elif pencil.damped or not pencil.symmetric:
        values, vectors = _solve_quadratic(pencil, 2 * count, tolerance)
    else:
        values, vectors = _solve_linear(pencil, count, target, tolerance)
    keep = values.imag >= 0.0
    values, vectors = values[keep], vectors[keep]
    distance = np.abs(values) if pencil.damped else np.abs(values**2 + target**2)
    order = np.argsort(distance, kind="stable")[:count]
    return values[order], vectors[order]


def _roots(squares: npt.NDArray[Any]) -> ComplexArray:
    """Upper half plane roots of ``lambda^2``, the growing one of two real roots."""
    roots = np.sqrt(squares.astype(np.complex128) + 0.0)
    return np.where(roots.imag < 0.0, -roots, roots)


def _spectral(transformation: SLEPc.ST) -> None:
    """Shift-and-invert with MUMPS."""
    transformation.setType(SLEPc.ST.Type.SINVERT)
    ksp = transformation.getKSP()
    ksp.setType(PETSc.KSP.Type.PREONLY)
    pc = ksp.getPC()
    pc.setType(PETSc.PC.Type.LU)
    pc.setFactorSolverType(PETSc.Mat.SolverType.MUMPS)


def _solve_linear(
    pencil: Pencil, count: int, target: float, tolerance: float
) -> tuple[ComplexArray, ComplexArray]:
    """Krylov-Schur in ``lambda^2``."""
    K, M = pencil.matrices.stiffness, pencil.matrices.mass
    eps = SLEPc.EPS().create(comm=pencil.linearization.system.comm)
    eps.setOptionsPrefix("modes_")
    eps.setOperators(K, M)
    eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    eps.setType(SLEPc.EPS.Type.KRYLOVSCHUR)
    eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    # K u = omega^2 M u, a little off the target, which may be an eigenvalue itself
    eps.setTarget(target**2 * (1.0 + 1e-7) if target > 0.0 else -(pencil.shift**2))
    eps.setDimensions(count, PETSc.DECIDE, PETSc.DECIDE)
    eps.setTolerances(tolerance, _ITERATIONS)
    _spectral(eps.getST())
    eps.setFromOptions()
    eps.solve()
    real, imaginary = K.createVecs()
    values, vectors = [], []
    for i in range(eps.getConverged()):
        square = complex(eps.getEigenpair(i, real, imaginary))
        if square.imag < 0.0:
            continue
        values.append(-square)
        vectors.append(_complex(real, imaginary, square.imag != 0.0))
    return _roots(np.array(values)), np.array(vectors).reshape(len(values), -1)


def _complex(real: PETSc.Vec, imaginary: PETSc.Vec, paired: bool) -> ComplexArray:
    vector: ComplexArray = real.getArray().astype(np.complex128)
    if paired:
        vector += 1j * imaginary.getArray()
    return vector


class _Inverse:
    """``(A - B)^-1 B`` of ``A z = lambda B z``, ``z = (u, lambda u)``, time in units of the shift.

    The multipliers are solved for and left out of z. Both halves of the result satisfy the
    constraints if both halves of the argument do, so that infinite eigenvalues never show. (In a
    companion form that keeps the multipliers in z they spoil the digits of the finite ones.)
    """

    def __init__(self, pencil: Pencil) -> None:
        """Factorise the equations at the shift (collective)."""
        unit = pencil.shift
        self._linearization = pencil.linearization
        self._mass, self._first = pencil.matrices.mass.copy(), pencil.matrices.damping.copy()
        self._mass.scale(unit * unit)
        self._first.scale(unit)
        self._first.axpy(1.0, self._mass)  # C + M at the shift one
        matrix = pencil.matrices.stiffness.copy()
        matrix.axpy(1.0, self._first)
        self._ksp = direct_solver(matrix, "modes_")
        factorise(self._ksp, matrix)
        lin = self._linearization
        self._u, self._w, self._rhs, self._part, self._solution = (lin.vector() for _ in range(5))

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Apply it (collective)."""
        count = self._linearization.unknowns
        given = x.getArray(readonly=True)
        self._u.getArray()[:count], self._w.getArray()[:count] = given[:count], given[count:]
        self._first.mult(self._u, self._rhs)
        self._mass.mult(self._w, self._part)
        self._rhs.axpy(1.0, self._part)
        self._rhs.scale(-1.0)
        self._ksp.solve(self._rhs, self._solution)
        result, found = y.getArray(), self._solution.getArray(readonly=True)[:count]
        result[:count] = found
        result[count:] = found + given[:count]


def _solve_quadratic(
    pencil: Pencil, count: int, tolerance: float
) -> tuple[ComplexArray, ComplexArray]:
    """Krylov-Schur in ``1/(lambda - shift)``; conjugates are counted singly."""
    lin = pencil.linearization
    local, everywhere = 2 * lin.unknowns, 2 * lin.system.unknowns
    operator = PETSc.Mat().createPython(
        ((local, everywhere), (local, everywhere)), _Inverse(pencil), comm=lin.system.comm
    )
    operator.setUp()
    eps = SLEPc.EPS().create(comm=lin.system.comm)
    eps.setOptionsPrefix("modes_")
    eps.setOperators(operator)
    eps.setProblemType(SLEPc.EPS.ProblemType.NHEP)
    eps.setType(SLEPc.EPS.Type.KRYLOVSCHUR)
    eps.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_MAGNITUDE)
    eps.setDimensions(min(count, everywhere), PETSc.DECIDE, PETSc.DECIDE)
    eps.setTolerances(tolerance, _ITERATIONS)
    start = operator.createVecRight()
    rng = np.random.default_rng(lin.system.comm.rank)
    start.setArray(rng.normal(size=local))
    image = start.duplicate()
    for _ in range(2):  # into the constraints
        operator.mult(start, image)
        start, image = image, start
    eps.setInitialSpace(start)
    eps.setFromOptions()
    eps.solve()
    real, imaginary = operator.createVecs()
    values, vectors = [], []
    for i in range(eps.getConverged()):
        value = complex(eps.getEigenpair(i, real, imaginary))
        values.append(pencil.shift * (1.0 + 1.0 / value))
        vector = _complex(real, imaginary, value.imag != 0.0)
        vectors.append(np.append(vector[: lin.unknowns], np.zeros(lin.size - lin.unknowns)))
    return (
        np.array(values, dtype=np.complex128),
        np.array(vectors, dtype=np.complex128).reshape(len(values), lin.size),
    )


def _solve_densely(pencil: Pencil) -> tuple[ComplexArray, ComplexArray]:
    """All finite eigenvalues by the same inverses, alike on every rank."""
    lin = pencil.linearization
    K, C, M = (
        gather_rows(mat)
        for mat in (pencil.matrices.stiffness, pencil.matrices.damping, pencil.matrices.mass)
    )
    kinds = np.zeros(lin.size, dtype=np.int64)
    kinds[lin.unknowns :] = 1
    nodal = np.concatenate(lin.system.comm.allgather(kinds)) == 0
    if pencil.damped or not pencil.symmetric:
        values, reduced = _dense_quadratic(K, C, M, nodal, pencil)
    else:
        values, reduced = _dense_linear(K, M, nodal, pencil)
    vectors = np.zeros((len(values), len(nodal)), dtype=np.complex128)
    vectors[:, nodal] = reduced.T
    first = lin.system.comm.scan(lin.size) - lin.size
    return values, vectors[:, first : first + lin.size]


def _dense_linear(
    K: FloatArray, M: FloatArray, nodal: BoolArray, pencil: Pencil
) -> tuple[ComplexArray, ComplexArray]:
    """Finite eigenvalues and vectors (n, k) of ``lambda^2 M + K``, both symmetric.

    Inverted, since the lowest frequencies would drown in the round-off of the highest; the shift is
    larger than elsewhere, since the inverse of rigid motions hides that of the others.
    """
    shift = (_DENSE_SHIFT * pencil.fastest) ** 2
    inverse = np.linalg.inv(K + shift * M)[np.ix_(nodal, nodal)]
    weights, turn = np.linalg.eigh(M[np.ix_(nodal, nodal)])
    root = turn * np.sqrt(np.maximum(weights, 0.0))
    half = root.T @ inverse @ root
    found, vectors = np.linalg.eigh(0.5 * (half + half.T))
    finite = np.abs(found) * pencil.fastest**2 > _FINITE
    columns = inverse @ (root @ vectors[:, finite])
    return _roots(shift - 1.0 / found[finite]), columns.astype(np.complex128)


def _dense_quadratic(
    K: FloatArray, C: FloatArray, M: FloatArray, nodal: BoolArray, pencil: Pencil
) -> tuple[ComplexArray, ComplexArray]:
    """Finite eigenvalues and vectors (n, k) of the quadratic problem, see :class:`_Inverse`."""
    unit, n = pencil.shift, int(nodal.sum())
    mass, first = unit * unit * M, unit * C + unit * unit * M
    inverse = np.linalg.inv(K + first)[nodal]
    by_u, by_w = -inverse @ first[:, nodal], -inverse @ mass[:, nodal]
    found, vectors = np.linalg.eig(np.block([[by_u, by_w], [by_u + np.eye(n), by_w]]))
    # eigenvalues of constraints come in defective pairs, which round-off moves by its root
    finite = np.abs(found) * pencil.fastest > 1e-3 * unit
    values = (unit * (1.0 + 1.0 / found[finite])).astype(np.complex128)
    return values, vectors[:n, finite].astype(np.complex128)
