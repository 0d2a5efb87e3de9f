# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modes: solutions ``exp(lambda t) u`` of the linearised equations of motion.

See :class:`~flexfem.solvers.pencil.Pencil` for the problem. Without C it is linear in ``lambda^2``.
Multipliers make infinite eigenvalues, which the shift-and-invert transformation maps to zero, the
end of the spectrum that is never looked at (Meerbergen, Spence 1997). Small problems are solved
densely.
"""

from dataclasses import dataclass, replace
from typing import Any

from petsc4py import PETSc
from slepc4py import SLEPc

import numpy as np
import numpy.typing as npt

from flexfem._types import BoolArray, FloatArray
from flexfem.la.dense import gather_rows
from flexfem.solvers.mode_errors import ComplexArray, count_below, square_errors, square_noise
from flexfem.solvers.pencil import Pencil
from flexfem.solvers.shifted_inverse import ShiftedInverse

__all__ = ["Solution", "solve_pencil"]

type _Found = tuple[ShiftedInverse, ComplexArray, ComplexArray]

#: Unknowns and multipliers up to which every rank solves the problem densely: always, or when more
#: than a quarter of all modes is asked for.
_DENSE, _DENSE_FOR_MANY = 100, 400
#: Least first shift of dense problems relative to the largest frequency, without a quadratic term.
_DENSE_SHIFT = 1e-3
#: Restarts of the iteration at the last shift that is tried, and at those before.
_ITERATIONS, _FIRST = 500, 50
#: Inverted eigenvalues of dense problems, times the largest frequency squared, that are not zero.
_FINITE = 3e-3
#: Shifts that are tried, and how the tolerance of the iteration falls from one to the next.
_PASSES, _TIGHTER, _FINEST = 4, 1e-2, 1e-15
#: The next shift where nothing but zeros is found.
_LOWER = 1e-2
#: Residuals may be this much larger than the iteration's own estimates.
_LOOSE = 10.0
#: Errors up to so many estimates of the round-off are round-off, but not above this residual.
_ROUNDED, _ROUGH = 10.0, 1e-5
#: Eigenvalues below so many estimates of the round-off of their own stiffness are zero.
_ZERO = 1e3
#: Double zeros relative to the square of the shift.
_DOUBLE = 1e-12
#: Residual of zeros, relative to the largest eigenvalue, that is always too large.
_NEAR_ZERO = 1e-6
#: Distances that differ less are those of a multiple eigenvalue.
_EQUAL = 1e-6
#: Squares of vectors relative to the largest that are zero.
_CONJUGATE = 1e-12


@dataclass(frozen=True)
class Solution:
    """Eigenpairs as they were found, nearest first.

    Attributes:
        values: (k,) lambda in the upper half plane or real, 1/s. Of undamped problems ``i omega``,
            or real where ``omega^2`` is negative.
        vectors: (k, n) of this rank's nodes.
        zero: (k,) those that are zero for all that rounding lets one know.
        errors: (k,) of ``lambda^2``, to first order, by the residuals, 1/s^2.
        noise: (k,) estimate of the round-off in ``lambda^2``, 1/s^2.
        missing: modes among those found that were not found; None where they cannot be counted.
    """

    values: ComplexArray
    vectors: ComplexArray
    zero: BoolArray
    errors: FloatArray
    noise: FloatArray
    missing: int | None = None

    @property
    def residuals(self) -> FloatArray:
        """(k,) errors relative to the eigenvalues, those of zeros to the largest of all.

        Infinite where nothing but zeros was found that have errors above round-off.
        """
        squares = np.abs(self.values) ** 2
        scale = float(squares.max(initial=0.0, where=~self.zero))
        size = np.where(self.zero, scale, squares)
        known = size > 0.0
        unknown = np.where(self.errors <= _ZERO * self.noise, 0.0, np.inf)
        return np.where(known, 0.5 * self.errors / np.where(known, size, 1.0), unknown)

    def doubtful(self, accuracy: float) -> BoolArray:
        """(k,) those whose errors are neither as small as asked for nor round-off."""
        squares = np.abs(self.values) ** 2
        softest = float(squares.min(initial=np.inf, where=~self.zero))
        ratio = np.maximum(squares / softest, 1.0)
        # one shift for all keeps so many digits; what is inverted has the noise of the softest
        size = np.where(self.zero | (squares == 0.0), 1.0, squares)
        rounded = _ROUNDED * (
            np.finfo(float).eps * ratio.max(initial=1.0) + self.noise * ratio / size
        )
        asked = _LOOSE * np.where(self.zero, min(accuracy, _NEAR_ZERO), accuracy)
        enough = np.maximum(asked, np.minimum(rounded, _ROUGH))
        nothing = self.zero & (self.errors <= _ZERO * self.noise)
        found: BoolArray = (self.residuals > enough) & ~nothing
        return found

    @property
    def zero_below(self) -> float:
        """Eigenvalues below this modulus count as zero, 1/s."""
        return float(np.sqrt((_ZERO * self.noise + self.errors).max(initial=0.0)))

    def scale(self, doubtful: BoolArray) -> float:
        """Geometric mean of the first ones that are not zero, 1/s; zero if there are none.

        Of the doubtful ones if there are any.
        """
        first = slice(len(doubtful))
        chosen = (doubtful | ~doubtful.any()) & ~self.zero[first]
        sizes = np.abs(self.values[first])[chosen]
        return float(np.exp(np.log(sizes).mean())) if len(sizes) else 0.0


def solve_pencil(
    pencil: Pencil, count: int, more: int, target: float, accuracy: float
) -> Solution:  # fmt: skip
    """Eigenpairs nearest to a frequency, with their errors (collective).

    Where residuals of the first ``count`` are too large, the problem is inverted anew at a distance
    from zero that is that of these eigenvalues: what is far below the shift drowns in it. Where
    modes are missing among those found, more are looked for.

    Args:
        pencil: the problem.
        count: number of eigenvalues, conjugate pairs counted once, whose residuals matter.
        more: number of eigenvalues beyond them.
        target: rad/s.
        accuracy: relative residual of the eigenvalues.
    """
    size = pencil.linearization.sizes[1]
    dense = size <= _DENSE or (size <= _DENSE_FOR_MANY and 4 * (count + more) > size)
    shift, tolerance = _first_shift(pencil, target, dense), accuracy
    found: list[tuple[int, int, Solution]] = []
    for k in range(_PASSES):
        limits = tolerance, _FIRST if k < _PASSES - 1 else _ITERATIONS
        solution = _solve(pencil, count + more, shift, limits, dense)
        doubtful, lacking = solution.doubtful(accuracy)[:count], count - len(solution.values)
        if not dense and lacking <= 0 and not doubtful.any():
            solution = replace(solution, missing=_missing(pencil, solution, count, target))
        bad = int(doubtful.sum()) + max(lacking, 0) + (solution.missing or 0)
        found.append((bad, len(found), solution))
        if bad == 0:
            break
        more += 2 * (solution.missing or 0)
        if lacking <= 0:
            tolerance = max(_TIGHTER * tolerance, _FINEST)
        if target == 0.0 and (doubtful.any() or lacking > 0):
            shift = complex(solution.scale(doubtful) or _LOWER * shift.real)
    return min(found)[2]


def _missing(pencil: Pencil, solution: Solution, count: int, target: float) -> int | None:
    """Modes nearer than the last of those found that were not found; None if they cannot be told.

    By Sylvester's law ``K - s M`` with m conditions has as many negative eigenvalues as there are
    ``omega^2`` below s, and m.
    """
    if pencil.quadratic or len(solution.values) == 0:
        return None
    distance = np.abs(solution.values - 1j * target)
    gaps = distance[1:] - distance[:-1] > _EQUAL * distance[1:]
    last = next((k for k in range(count - 1, len(gaps)) if gaps[k]), len(distance) - 1)
    noise = float((_ZERO * solution.noise + solution.errors)[: last + 1].max()) ** 0.5
    reach = distance[last] * (1.0 + _EQUAL) + (noise if solution.zero[last] else 0.0)
    if last < len(gaps):
        reach = max(min(reach, distance[last + 1]), 0.5 * (distance[last] + distance[last + 1]))
    high = count_below(pencil, (target + reach) ** 2)
    if high is None or (target == 0.0 and high == last + 1):
        return None if high is None else 0
    low = reach**2 - target**2  # real eigenvalues lie beside the target
    below = count_below(pencil, -low if low > 0.0 else (target - reach) ** 2)
    more = None if below is None else high - below - (last + 1)
    return None if more is None or more < 0 else more


def _first_shift(pencil: Pencil, target: float, dense: bool) -> complex:
    """Where the problem is inverted first: a little off the target, which may be an eigenvalue."""
    if target > 0.0:
        return 1j * target * (1.0 + 1e-7)
    return complex(max(pencil.shift, _DENSE_SHIFT * pencil.fastest if dense else 0.0))


def _solve(
    pencil: Pencil, count: int, shift: complex, limits: tuple[float, int], dense: bool
) -> Solution:  # fmt: skip
    """Eigenpairs by one factorisation (collective)."""
    if dense:
        inverse, values, vectors = _solve_densely(pencil, abs(shift))
    elif pencil.quadratic:
        inverse, values, vectors = _solve_quadratic(pencil, 2 * count, shift, limits)
    else:
        inverse, values, vectors = _solve_linear(pencil, count, shift, limits)
    keep = np.flatnonzero(values.imag >= 0.0)
    distance = np.abs(values[keep] - 1j * shift.imag)
    order = keep[np.argsort(distance, kind="stable")][:count]
    values, vectors = values[order], vectors[order]
    errors = square_errors(inverse, values, vectors)
    noise, squares = square_noise(pencil, vectors), np.abs(values) ** 2
    # double zeros are roots of round-off at the shift
    zero = squares <= _ZERO * noise + errors + _DOUBLE * abs(shift) ** 2
    return Solution(values, vectors, zero, errors, noise, 0 if dense else None)


def _roots(squares: npt.NDArray[Any]) -> ComplexArray:
    """Upper half plane roots of ``lambda^2``, the growing one of two real roots."""
    roots = np.sqrt(squares.astype(np.complex128) + 0.0)
    return np.where(roots.imag < 0.0, -roots, roots)


def _spectral(transformation: SLEPc.ST, inverse: ShiftedInverse) -> None:
    """Shift-and-invert by what is factorised."""
    transformation.setType(SLEPc.ST.Type.SINVERT)
    transformation.setMatMode(SLEPc.ST.MatMode.SHELL)
    ksp = transformation.getKSP()
    ksp.setType(PETSc.KSP.Type.PREONLY)
    pc = ksp.getPC()
    pc.setType(PETSc.PC.Type.PYTHON)
    pc.setPythonContext(inverse)


def _solve_linear(pencil: Pencil, count: int, shift: complex, limits: tuple[float, int]) -> _Found:
    """Krylov-Schur in ``lambda^2``."""
    inverse = ShiftedInverse(pencil, shift)
    K, M = pencil.matrices.stiffness, pencil.matrices.mass
    eps = SLEPc.EPS().create(comm=pencil.linearization.system.comm)
    eps.setOptionsPrefix("modes_")
    eps.setOperators(K, M)
    eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    eps.setType(SLEPc.EPS.Type.KRYLOVSCHUR)
    eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    eps.setTarget(-(shift**2).real)  # K u = omega^2 M u
    eps.setDimensions(count, PETSc.DECIDE, PETSc.DECIDE)
    eps.setTolerances(*limits)
    _spectral(eps.getST(), inverse)
    eps.setFromOptions()
    eps.solve()
    real, imaginary = K.createVecs()
    values, vectors = [], []
    for i in range(eps.getConverged()):
        square = complex(eps.getEigenpair(i, real, imaginary))
        values.append(-square.real)
        vectors.append(real.getArray()[: pencil.linearization.unknowns].astype(np.complex128))
    shape = len(values), pencil.linearization.unknowns  # some ranks have no unknowns
    found = np.array(vectors, dtype=np.complex128).reshape(shape)
    return inverse, _roots(np.array(values)), found


class _Companion:
    """``(A - B)^-1 B`` of ``A z = lambda B z``, ``z = (u, lambda u)``, time in units of the shift.

    The multipliers are solved for and left out of z. Both halves of the result satisfy the
    constraints if both halves of the argument do, so that infinite eigenvalues never show. (In a
    companion form that keeps the multipliers in z they spoil the digits of the finite ones.)
    Complex vectors have their real parts first, then their imaginary ones; every eigenvalue has its
    conjugate then, of which :meth:`mode` tells one from the other.
    """

    def __init__(self, inverse: ShiftedInverse) -> None:
        """Take the inverse at the shift."""
        self.inverse, self.unit = inverse, abs(inverse.shift)
        self.paired = inverse.shift.imag != 0.0
        self.shift = inverse.shift / self.unit if self.paired else 1.0
        self._count = inverse.pencil.linearization.unknowns

    @property
    def size(self) -> int:
        """Numbers of this rank in a vector."""
        return (4 if self.paired else 2) * self._count

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Apply it (collective)."""
        given = self._split(x.getArray(readonly=True))
        u, w = given[: self._count], given[self._count :]
        matrices = self.inverse.pencil.matrices
        rhs = self.unit * self.inverse.times(matrices.damping, u)
        rhs += self.unit**2 * self.inverse.times(matrices.mass, self.shift * u + w)
        found = -self.inverse.solve(rhs)
        result = np.concatenate([found, u + self.shift * found])
        y.setArray(np.concatenate([result.real, result.imag]) if self.paired else result)

    def _split(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        if not self.paired:
            return values
        half = len(values) // 2
        return values[:half] + 1j * values[half:]

    def value(self, found: complex) -> complex:
        """Lambda (1/s) of an eigenvalue of this operator."""
        return self.unit * (self.shift + 1.0 / found)

    def mode(self, vector: ComplexArray) -> ComplexArray:
        """(n,) u of an eigenvector; zero if the eigenvalue is the conjugate of one."""
        return np.asarray(self._split(vector)[: self._count], dtype=np.complex128)


def _solve_quadratic(
    pencil: Pencil, count: int, shift: complex, limits: tuple[float, int]
) -> _Found:
    """Krylov-Schur in ``1/(lambda - shift)``; conjugates are counted singly."""
    lin, companion = pencil.linearization, _Companion(ShiftedInverse(pencil, shift))
    everywhere = lin.system.comm.allreduce(companion.size)
    operator = PETSc.Mat().createPython(
        ((companion.size, everywhere), (companion.size, everywhere)),
        companion,
        comm=lin.system.comm,
    )
    operator.setUp()
    eps = SLEPc.EPS().create(comm=lin.system.comm)
    eps.setOptionsPrefix("modes_")
    eps.setOperators(operator)
    eps.setProblemType(SLEPc.EPS.ProblemType.NHEP)
    eps.setType(SLEPc.EPS.Type.KRYLOVSCHUR)
    eps.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_MAGNITUDE)
    eps.setDimensions(min(count, everywhere), PETSc.DECIDE, PETSc.DECIDE)
    eps.setTolerances(*limits)
    eps.setInitialSpace(_start(operator, companion, lin.system.comm.rank))
    eps.setFromOptions()
    eps.solve()
    real, imaginary = operator.createVecs()
    values, vectors = [], []
    for i in range(eps.getConverged()):
        found = complex(eps.getEigenpair(i, real, imaginary))
        whole = real.getArray().astype(np.complex128)
        if found.imag != 0.0:
            whole += 1j * imaginary.getArray()
        values.append(companion.value(found))
        vectors.append(companion.mode(whole))
    return companion.inverse, *_proper(pencil, values, vectors)


def _start(operator: PETSc.Mat, companion: _Companion, rank: int) -> PETSc.Vec:
    """Any vector that satisfies the constraints."""
    start = operator.createVecRight()
    start.setArray(np.random.default_rng(rank).normal(size=companion.size))
    image = start.duplicate()
    for _ in range(2):
        operator.mult(start, image)
        start, image = image, start
    return start


def _proper(
    pencil: Pencil, values: list[complex], vectors: list[ComplexArray]
) -> tuple[ComplexArray, ComplexArray]:
    """Leave out conjugates of eigenvalues, whose vectors are zero."""
    shape = len(values), pencil.linearization.unknowns
    found = np.array(vectors, dtype=np.complex128).reshape(shape)
    sizes = pencil.linearization.total(np.einsum("ki,ki->k", found.conj(), found)).real
    own = sizes > _CONJUGATE * sizes.max(initial=0.0)
    return np.array(values, dtype=np.complex128)[own], found[own]


def _solve_densely(pencil: Pencil, shift: float) -> _Found:
    """All finite eigenvalues by the same inverses, alike on every rank."""
    lin = pencil.linearization
    K, C, M = (
        gather_rows(mat)
        for mat in (pencil.matrices.stiffness, pencil.matrices.damping, pencil.matrices.mass)
    )
    kinds = np.zeros(lin.size, dtype=np.int64)
    kinds[lin.unknowns :] = 1
    nodal = np.concatenate(lin.system.comm.allgather(kinds)) == 0
    if pencil.quadratic:
        values, reduced = _dense_quadratic(K, C, M, nodal, shift, pencil.fastest)
    else:
        values, reduced = _dense_linear(K, M, nodal, shift, pencil.fastest)
    first = lin.system.comm.scan(lin.unknowns) - lin.unknowns
    vectors = reduced.T[:, first : first + lin.unknowns].copy()
    return ShiftedInverse(pencil, complex(shift)), values, vectors


def _dense_linear(
    K: FloatArray, M: FloatArray, nodal: BoolArray, shift: float, fastest: float
) -> tuple[ComplexArray, ComplexArray]:
    """Finite eigenvalues and vectors (n, k) of ``lambda^2 M + K``, both symmetric.

    Inverted, since the lowest frequencies would drown in the round-off of the highest; the shift is
    larger than elsewhere, since the inverse of rigid motions hides that of the others.
    """
    inverse = np.linalg.inv(K + shift**2 * M)[np.ix_(nodal, nodal)]
    weights, turn = np.linalg.eigh(M[np.ix_(nodal, nodal)])
    root = turn * np.sqrt(np.maximum(weights, 0.0))
    half = root.T @ inverse @ root
    found, vectors = np.linalg.eigh(0.5 * (half + half.T))
    finite = np.abs(found) * fastest**2 > _FINITE
    columns = inverse @ (root @ vectors[:, finite])
    return _roots(shift**2 - 1.0 / found[finite]), columns.astype(np.complex128)


def _dense_quadratic(
    K: FloatArray, C: FloatArray, M: FloatArray, nodal: BoolArray, unit: float, fastest: float
) -> tuple[ComplexArray, ComplexArray]:
    """Finite eigenvalues and vectors (n, k) of the quadratic problem, see :class:`_Inverse`."""
    n = int(nodal.sum())
    mass, first = unit * unit * M, unit * C + unit * unit * M
    inverse = np.linalg.inv(K + first)[nodal]
    by_u, by_w = -inverse @ first[:, nodal], -inverse @ mass[:, nodal]
    found, vectors = np.linalg.eig(np.block([[by_u, by_w], [by_u + np.eye(n), by_w]]))
    # eigenvalues of constraints come in defective pairs, which round-off moves by its root
    finite = np.abs(found) * fastest > 1e-3 * unit
    values = (unit * (1.0 + 1.0 / found[finite])).astype(np.complex128)
    return values, vectors[:n, finite].astype(np.complex128)
