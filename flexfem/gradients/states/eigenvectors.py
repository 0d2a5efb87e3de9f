# SPDX-License-Identifier: LGPL-3.0-or-later
"""Right and left eigenvectors of an eigenvalue, and its derivative.

With ``P(lambda) x = 0`` and ``P(lambda)^H y = 0`` a simple eigenvalue changes with a parameter by
``dlambda = - y^H dP x / (y^H P' x)``, P' the derivative by lambda and dP the change of the matrix
at fixed lambda (Lancaster, Numer. Math. 6 (1964) 377-387). Rows of constraints are a part of P, and
so are their changes of dP. m equal eigenvalues with vectors X, Y have the derivatives of
``- (Y^H P' X)^-1 Y^H dP X`` as eigenvalues along one parameter (Lancaster, the same), which are no
gradient; their mean, the trace over m, has one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from flexfem.la.direct import DirectSolver
from flexfem.solvers.modal.linearization import Matrices
from flexfem.solvers.modal.shifted_inverse import real_form

__all__ = [
    "SHIFT",
    "ComplexArray",
    "Inverse",
    "Vectors",
    "classes_of",
    "equal",
    "pencil_change",
    "pencil_inverse",
    "pencil_times",
    "times",
    "vectors_of",
]

ComplexArray = npt.NDArray[np.complex128]

#: Distance of the shift from an eigenvalue, and of eigenvalues that count as equal, relative.
SHIFT, _EQUAL = 1e-7, 1e-5
#: Part of a square of an eigenvalue that is round-off.
_REAL = 1e-9
#: Sweeps of inverse iteration, each of which gains the digits by which the shift is nearer to this
#: eigenvalue than to others.
_SWEEPS = 3


def times(matrix: PETSc.Mat, x: ComplexArray, *, transposed: bool = False) -> ComplexArray:
    """A real matrix, or its transpose, times this rank's part of a complex vector (collective)."""
    a, b = matrix.createVecs()
    act = matrix.multTranspose if transposed else matrix.mult
    parts = []
    for values in (x.real, x.imag):
        a.setArray(values)
        act(a, b)
        parts.append(b.getArray(readonly=True).copy())
    return np.asarray(parts[0] + 1j * parts[1], dtype=np.complex128)


class Inverse:
    """Inverse of a complex matrix and of its Hermitian transpose, both from factors.

    With an imaginary part the matrix is factorised as a real one of twice the size, whose transpose
    is that of the Hermitian transpose.
    """

    def __init__(self, real: PETSc.Mat, imaginary: PETSc.Mat | None = None) -> None:
        """Factorise (collective)."""
        self._paired = imaginary is not None
        matrix = real if imaginary is None else real_form(real, imaginary, 1.0)
        turned = matrix.transpose(PETSc.Mat())
        self._solvers = [DirectSolver(one, "modes_") for one in (matrix, turned)]
        self.regular = all(
            own.factor(one) for own, one in zip(self._solvers, (matrix, turned), strict=True)
        )
        self._x, self._y = matrix.createVecs()

    def solve(self, right: ComplexArray, *, transposed: bool = False) -> ComplexArray:
        """Solution, or that with the Hermitian transpose, on this rank's range (collective)."""
        if self._paired:
            return self._solved(np.concatenate([right.real, right.imag]), transposed, len(right))
        real, imaginary = (
            self._solved(part, transposed, len(right)) for part in (right.real, right.imag)
        )
        return real + 1j * imaginary

    def _solved(self, right: npt.NDArray[np.float64], transposed: bool, size: int) -> ComplexArray:
        self._x.setArray(right)
        self._solvers[int(transposed)].solve(self._x, self._y)
        found = np.array(self._y.getArray(readonly=True))
        if not self._paired:
            return np.asarray(found, dtype=np.complex128)
        return np.asarray(found[:size] + 1j * found[size:], dtype=np.complex128)


def pencil_times(matrices: Matrices, value: complex, x: ComplexArray) -> ComplexArray:
    """``P(value) x`` with ``P(s) = s^2 M + s C + K`` on this rank's range (collective)."""
    undamped = value**2 * times(matrices.mass, x) + times(matrices.stiffness, x)
    found: ComplexArray = undamped + value * times(matrices.damping, x)
    return found


def pencil_change(before: Matrices, after: Matrices) -> Matrices:
    """Difference of matrices, in place of the later ones (collective).

    Products with it have the rounding of its entries alone: vectors of modes make sums of far
    smaller size than these.
    """
    pairs = (
        (before.mass, after.mass), (before.damping, after.damping),
        (before.stiffness, after.stiffness),
    )  # fmt: skip
    for old, new in pairs:
        new.axpy(-1.0, old, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    return after


def pencil_inverse(matrices: Matrices, value: complex, *, damped: bool) -> Inverse | None:
    """Inverse of ``P(value)``, None if it is singular (collective).

    Args:
        matrices: those of P.
        value: any number.
        damped: False if C is zero.
    """
    square = value**2
    real = matrices.stiffness.copy()
    real.axpy(square.real, matrices.mass)
    real.axpy(value.real, matrices.damping)
    imaginary = None
    if damped or abs(square.imag) > _REAL * abs(square):
        imaginary = matrices.mass.copy()
        imaginary.scale(square.imag)
        imaginary.axpy(value.imag, matrices.damping)
    inverse = Inverse(real, imaginary)
    return inverse if inverse.regular else None


def equal(values: Sequence[complex] | ComplexArray, number: int) -> tuple[int, ...]:
    """Numbers, from 1, of the eigenvalues that are equal to one, itself included."""
    own = values[number - 1]
    distances = [abs(other - own) for other in values]
    return tuple(k for k, off in enumerate(distances, 1) if off <= _EQUAL * abs(own) or k == number)


def classes_of(
    values: Sequence[complex] | ComplexArray, groups: Sequence[Sequence[int]]
) -> list[tuple[int, ...]]:
    """Numbers, from 1, of equal eigenvalues, for all that are in some group."""
    every = sorted({number for group in groups for number in group})
    return list(dict.fromkeys(equal(values, number) for number in every))


@dataclass(frozen=True)
class Vectors:
    """m equal eigenvalues with vectors (n, m) for which ``Y^H P' X = 1``.

    Attributes:
        value: their mean.
        right, left: X and Y.
        rounding: what rounding leaves of the trace over m of ``Y^H P X``.
    """

    value: complex
    right: ComplexArray
    left: ComplexArray
    rounding: float

    def mean(self, change: Callable[[ComplexArray], ComplexArray]) -> complex:
        """This rank's part of the trace over m of ``Y^H dP X``.

        Args:
            change: dP times a vector.
        """
        pairs = zip(self.right.T, self.left.T, strict=True)
        return complex(np.mean([np.vdot(y, change(x)) for x, y in pairs]))


def vectors_of(
    value: complex, inverse: Inverse, starts: Sequence[ComplexArray],
    total: Callable[[ComplexArray], ComplexArray],
    apply: Callable[[ComplexArray], ComplexArray],
    weigh: Callable[[ComplexArray, bool], ComplexArray],
) -> Vectors:  # fmt: skip
    """Right and left eigenvectors of m equal eigenvalues (collective).

    Args:
        value: their mean.
        inverse: of P at a value much nearer to the eigenvalues than to others.
        starts: m right vectors (n,) to begin the inverse iteration with; their part of the
            constraints need not be known.
        total: sums over the ranks.
        apply: P at the mean times a vector.
        weigh: P' times a vector, or its Hermitian transpose.
    """
    found = []
    for transposed in (False, True):
        vectors = np.stack(starts, axis=1)
        if transposed:  # P' may see the part of the constraints alone
            vectors = np.stack([inverse.solve(x, transposed=True) for x in vectors.T], axis=1)
        for _ in range(_SWEEPS):
            vectors = np.stack(
                [inverse.solve(weigh(x, transposed), transposed=transposed) for x in vectors.T],
                axis=1,
            )
            lower = np.linalg.cholesky(total(vectors.conj().T @ vectors))
            vectors = vectors @ np.linalg.inv(lower).conj().T
        found.append(vectors)
    right, left = found
    weighed = np.stack([weigh(x, False) for x in right.T], axis=1)
    size = total(left.conj().T @ weighed)
    left = left @ np.linalg.inv(size).conj().T
    applied = np.stack([apply(x) for x in right.T], axis=1)
    applied -= weighed @ total(left.conj().T @ applied)  # eigenvalues differ from their mean
    rounding = total(np.array([(np.abs(left) * np.abs(applied)).sum()])) / len(starts)
    return Vectors(value, right, left, float(rounding[0]))
