# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modes: solutions ``exp(lambda t) u`` of the linearised equations of motion.

See :class:`~flexfem.solvers.modal.pencil.Pencil` for the problem. Without C it is linear in
``lambda^2``. Multipliers make infinite eigenvalues, which the shift-and-invert transformation maps
to zero, the end of the spectrum that is never used (Meerbergen, Spence 1997). Small problems are
solved densely.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import Any

from petsc4py import PETSc
from slepc4py import SLEPc

import numpy as np
import numpy.typing as npt
import scipy.linalg

from flexfem._types import BoolArray, FloatArray
from flexfem.la.dense import gather_rows
from flexfem.solvers.modal.linearization import Linearization
from flexfem.solvers.modal.mode_count import missing_modes
from flexfem.solvers.modal.mode_errors import (
    ZERO,
    ComplexArray,
    Solution,
    independent,
    moving,
    square_errors,
    square_noise,
)
from flexfem.solvers.modal.pencil import Pencil
from flexfem.solvers.modal.shifted_inverse import ShiftedInverse, SingularShiftError

__all__ = ["solve_pencil"]

type _Found = tuple[ShiftedInverse, ComplexArray, ComplexArray]

#: Unknowns and multipliers up to which every rank solves the problem densely: always, or if more
#: than a quarter of all modes is requested.
_DENSE, _DENSE_FOR_MANY = 100, 400
#: Least first shift of dense problems relative to the largest frequency, without a quadratic term.
_DENSE_SHIFT = 1e-3
#: Restarts of the iteration at the last shift that is tried, and at those before.
_ITERATIONS, _FIRST = 500, 50
#: Least inverted eigenvalue of dense problems, times the largest frequency squared, that is not
#: zero.
_FINITE = 3e-3
#: Number of shifts, factor of the iteration's tolerance from one to the next, least tolerance.
_PASSES, _TIGHTER, _FINEST = 4, 1e-2, 1e-15
#: The next shift where nothing but zeros is found, and where the first one is singular.
_LOWER, _HIGHER = 1e-2, 10.0
#: Distance of the first shift from a target that may be an eigenvalue, relative.
_BESIDE = 1e-7
#: Double zeros relative to the square of the shift.
_DOUBLE = 1e-12
#: Number of modes beyond those of frequency zero, which show that these are complete.
_BEYOND = 3
#: Shift relative to the slowest mode, and how often it is applied until free motions are left.
_SLOWER, _POWERS = 0.1, 8
#: Parts of a vector that are not given back: of one that is free, and of others.
_GIVEN_BACK, _OTHERS = 1e-2, 0.5
#: Part of a vector beyond a basis that is no round-off.
_NEW = 1e-12
#: Squared norm of a vector, relative to the largest, that counts as zero.
_CONJUGATE = 1e-12


def solve_pencil(
    pencil: Pencil, count: int, more: int, target: float, accuracy: float
) -> Solution:  # fmt: skip
    """Eigenpairs nearest to a frequency, with their errors (collective).

    If residuals of the first ``count`` are too large, the problem is inverted again at the distance
    of these eigenvalues from zero: eigenvalues far below the shift are lost in rounding. If modes
    are missing among those found, more are computed.

    Args:
        pencil: the problem.
        count: number of eigenvalues, conjugate pairs counted once, whose residuals are checked.
        more: number of eigenvalues beyond them.
        target: rad/s.
        accuracy: relative residual of the eigenvalues.

    Returns:
        The eigenpairs; none, and the reason, if the problem is singular wherever it was inverted.
    """
    size = pencil.linearization.sizes[1]
    dense = size <= _DENSE or (size <= _DENSE_FOR_MANY and 4 * (count + more) > size)
    shift, tolerance = _first_shift(pencil, target, dense), accuracy
    free: ComplexArray | None = None
    sought, beside, failure = False, _BESIDE, ""
    found: list[tuple[int, int, Solution]] = []
    for k in range(_PASSES):
        limits = tolerance, _FIRST if k < _PASSES - 1 else _ITERATIONS
        try:
            solution = _solve(pencil, count + more, (shift, target), limits, dense)
        except SingularShiftError as error:
            if found:
                break
            failure, beside = str(error), _HIGHER * beside
            shift = 1j * target * (1.0 + beside) if target > 0.0 else _HIGHER * shift
            continue
        if not sought and pencil.quadratic and solution.zero.any():
            free = _without_stiffness(pencil, solution, accuracy)
            sought = True
        solution = _with_zeros(pencil, solution, free, count + more)
        first = solution.pairs(count)
        doubtful = solution.doubtful(accuracy)[:first]
        lacking = count + solution.twins - len(solution.values)
        if not dense and lacking <= 0 and not doubtful.any():
            missing, uncounted = missing_modes(pencil, solution, first, target)
            solution = replace(solution, missing=missing, uncounted=uncounted)
        bad = int(doubtful.sum()) + max(lacking, 0) + (solution.missing or 0)
        found.append((bad, len(found), solution))
        if bad == 0:
            break
        more += 2 * (solution.missing or 0)
        if lacking <= 0:
            tolerance = max(_TIGHTER * tolerance, _FINEST)
        if target == 0.0 and (doubtful.any() or lacking > 0):
            shift = complex(solution.scale(doubtful) or _LOWER * shift.real)
    return min(found)[2] if found else Solution.failed(pencil, shift, failure)


def _first_shift(pencil: Pencil, target: float, dense: bool) -> complex:
    """Return the first shift: a little off the target, which may be an eigenvalue."""
    if target > 0.0:
        return 1j * target * (1.0 + _BESIDE)
    return complex(max(pencil.shift, _DENSE_SHIFT * pencil.fastest if dense else 0.0))


def _solve(
    pencil: Pencil, count: int, at: tuple[complex, float], limits: tuple[float, int], dense: bool
) -> Solution:  # fmt: skip
    """Eigenpairs by one factorisation, at a shift near a target (collective).

    Raises:
        SingularShiftError: on all ranks.
    """
    shift, target = at
    if dense:
        inverse, values, vectors = _solve_densely(pencil, abs(shift))
    elif pencil.quadratic:
        inverse, values, vectors = _solve_quadratic(pencil, 2 * count, shift, limits)
    else:
        inverse, values, vectors = _solve_linear(pencil, count, shift, limits)
    keep = np.flatnonzero((values.imag >= 0.0) & moving(pencil, vectors))
    distance = np.abs(values[keep] - 1j * target)
    # zeros may be there twice
    most = 2 * count if pencil.quadratic else count
    order = keep[np.argsort(distance, kind="stable")][:most]
    values, vectors = values[order], vectors[order]
    errors = square_errors(inverse, values, vectors)
    noise, squares = square_noise(pencil, vectors), np.abs(values) ** 2
    # double zeros are roots of round-off at the shift; far beyond it large errors make no zero
    near = np.where(squares <= abs(shift) ** 2, errors, 0.0)
    zero = squares <= ZERO * noise + near + _DOUBLE * abs(shift) ** 2
    missing, uncounted = (0, "") if dense else (None, "not all modes are as accurate as asked for")
    return Solution(
        values, vectors, zero, errors, noise, missing, uncounted, inverse.shift, pencil.inert,
        vectors[:0],
    )  # fmt: skip


def _with_zeros(
    pencil: Pencil, solution: Solution, free: ComplexArray | None, count: int
) -> Solution:  # fmt: skip
    """The nearest eigenpairs, with all motions of frequency zero (collective).

    Args:
        pencil: the problem.
        solution: its eigenpairs.
        free: (m, n) motions without stiffness, if they are known; vectors of several double zeros
            may be nearly dependent or, as rounding parts them, one and the same.
        count: number of modes, to which zeros that are there twice are added.
    """
    vectors = solution.vectors[solution.zero]
    if free is not None:
        vectors = np.concatenate([free[moving(pencil, free)], vectors])
    whole = replace(solution, still=independent(pencil, vectors, real=True, zero=True))
    own = slice(whole.pairs(count))
    return replace(
        whole, values=whole.values[own], vectors=whole.vectors[own], zero=whole.zero[own],
        errors=whole.errors[own], noise=whole.noise[own],
    )  # fmt: skip


def _without_stiffness(pencil: Pencil, solution: Solution, accuracy: float) -> ComplexArray | None:
    """Motions (m, n) of frequency zero, without the term in lambda if that can be (collective).

    Args:
        pencil: the problem.
        solution: its eigenpairs, some of them zero.
        accuracy: relative residual of the eigenvalues.

    Returns:
        The motions, None if they cannot be found apart from the eigenpairs.
    """
    count = int(solution.zero.sum())
    undamped = pencil.undamped()
    while undamped.symmetric:
        still = solve_pencil(undamped, count, _BEYOND, 0.0, accuracy)
        if still.failure:  # as where rates of states depend on no state
            break
        if not still.zero.all() or len(still.values) < count + _BEYOND:
            return still.vectors[still.zero]
        count *= 2
    slowest = np.abs(solution.values).min(initial=np.inf, where=~solution.zero)
    with suppress(SingularShiftError):
        return _null_space(pencil, count, min(pencil.shift, _SLOWER * float(slowest)))
    return None


def _null_space(pencil: Pencil, count: int, shift: float) -> ComplexArray:
    """Motions and states (m, n) that the inverse gives back: no force resists them (collective).

    ``(K + sigma C + sigma^2 M)^-1 (sigma C + sigma^2 M)`` leaves those that K does not resist as
    they are, and nearly nothing of others if sigma is far below their eigenvalues. A block of
    vectors, of which some are others, finds how many there are. Eigenvectors do not: an iteration
    from one vector sees multiple zeros by rounding alone.

    Args:
        pencil: the problem.
        count: expected number of them.
        shift: sigma, 1/s.

    Raises:
        SingularShiftError: on all ranks.
    """
    lin, given, inverse = pencil.linearization, pencil.matrices, ShiftedInverse(pencil, shift)

    def back(vectors: FloatArray) -> FloatArray:
        forces = [
            shift * inverse.times(given.damping, u) + shift**2 * inverse.times(given.mass, u)
            for u in vectors
        ]
        return np.array([inverse.solve(force) for force in forces]).reshape(vectors.shape)

    width, random = count + _BEYOND, np.random.default_rng(lin.system.comm.rank)
    while True:
        block = random.normal(size=(width, lin.unknowns))
        for _ in range(_POWERS):
            block = _orthonormal(lin, back(block))
        kept = lin.total(back(block) @ block.T)
        with _dense_factors(shift):
            turn, sizes, _ = np.linalg.svd(np.eye(len(kept)) - kept)
        if len(block) < width or np.sum(sizes > _OTHERS) >= _BEYOND:
            return (turn[:, sizes <= _GIVEN_BACK].T @ block).astype(np.complex128)
        width *= 2


def _orthonormal(lin: Linearization, vectors: FloatArray) -> FloatArray:
    """Orthonormal basis (k, n) of vectors (m, n), one after the other (collective)."""
    basis = np.empty((0, lin.unknowns))
    for given in vectors:
        u = given - lin.total(basis @ given) @ basis
        # once more: what the first leaves is round-off of what it takes away
        u -= lin.total(basis @ u) @ basis
        size, rest = np.sqrt(lin.total(np.array([given @ given, u @ u])))
        if rest > _NEW * size:
            basis = np.concatenate([basis, u[np.newaxis] / rest])
    return basis


@contextmanager
def _dense_factors(shift: float) -> Iterator[None]:
    """Raise the error of factors where numpy finds none at a shift."""
    try:
        yield
    except np.linalg.LinAlgError as error:
        raise SingularShiftError.at(shift) from error


def _roots(squares: npt.NDArray[Any]) -> ComplexArray:
    """Upper half plane roots of ``lambda^2``, the growing one of two real roots."""
    roots = np.sqrt(squares.astype(np.complex128) + 0.0)
    return np.where(roots.imag < 0.0, -roots, roots)


def _spectral(transformation: SLEPc.ST, inverse: ShiftedInverse) -> None:
    """Shift-and-invert with the factorised matrix."""
    transformation.setType(SLEPc.ST.Type.SINVERT)
    transformation.setMatMode(SLEPc.ST.MatMode.SHELL)
    ksp = transformation.getKSP()
    ksp.setType(PETSc.KSP.Type.PREONLY)
    pc = ksp.getPC()
    pc.setType(PETSc.PC.Type.PYTHON)
    pc.setPythonContext(inverse)


def _iterate(eps: SLEPc.EPS) -> None:
    """Iterate (collective); LAPACK may fail to sort rounded eigenvalues, at other shifts others."""
    try:
        eps.solve()
    except (PETSc.Error, SystemError) as error:
        if not isinstance(error, PETSc.Error) and not isinstance(error.__cause__, PETSc.Error):
            raise
        raise SingularShiftError("the iteration for modes has failed") from error


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
    _iterate(eps)
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
    conjugate then, which :meth:`mode` distinguishes.
    """

    def __init__(self, inverse: ShiftedInverse) -> None:
        """Store the inverse at the shift."""
        self.inverse, self.unit = inverse, abs(inverse.shift)
        self.paired = inverse.shift.imag != 0.0
        self.shift = inverse.shift / self.unit if self.paired else 1.0
        self._count = inverse.pencil.linearization.unknowns

    @property
    def size(self) -> int:
        """Number of this rank's entries of a vector."""
        return (4 if self.paired else 2) * self._count

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Apply the operator (collective)."""
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
    _iterate(eps)
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
    """A start vector that satisfies the constraints."""
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
    """Eigenpairs without conjugates, whose vectors are zero."""
    shape = len(values), pencil.linearization.unknowns
    found = np.array(vectors, dtype=np.complex128).reshape(shape)
    sizes = pencil.linearization.total(np.einsum("ki,ki->k", found.conj(), found)).real
    own = sizes > _CONJUGATE * sizes.max(initial=0.0)
    return np.array(values, dtype=np.complex128)[own], found[own]


def _solve_densely(pencil: Pencil, shift: float) -> _Found:
    """All finite eigenvalues by the same inverses, the same on every rank."""
    K, C, M, nodal, rigid = _gathered(pencil)
    with _dense_factors(shift):
        if pencil.quadratic:
            free = scipy.linalg.null_space(K[np.ix_(rigid, nodal)])
            values, reduced = _dense_quadratic(K, C, M, nodal, free, shift, pencil.fastest)
        else:
            values, reduced = _dense_linear(K, M, nodal, shift, pencil.fastest)
    return ShiftedInverse(pencil, complex(shift)), values, _owned(pencil, reduced.T)


def _gathered(
    pencil: Pencil,
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray, BoolArray]:
    """K, C and M on every rank, and True for unknowns, and for rigid rows (collective)."""
    lin, given = pencil.linearization, pencil.matrices
    K, C, M = (gather_rows(mat) for mat in (given.stiffness, given.damping, given.mass))
    nodal = np.arange(lin.size) < lin.unknowns
    comm = lin.system.comm
    every, rigid = (np.concatenate(comm.allgather(x)) for x in (nodal, lin.rigid_rows() > 0.0))
    return K, C, M, every, rigid


def _owned(pencil: Pencil, vectors: npt.NDArray[Any]) -> ComplexArray:
    """This rank's columns of vectors (k, n) of all unknowns (collective)."""
    lin = pencil.linearization
    first = lin.system.comm.scan(lin.unknowns) - lin.unknowns
    return vectors[:, first : first + lin.unknowns].astype(np.complex128)


def _dense_linear(
    K: FloatArray, M: FloatArray, nodal: BoolArray, shift: float, fastest: float
) -> tuple[ComplexArray, ComplexArray]:
    """Finite eigenvalues and vectors (n, k) of ``lambda^2 M + K``, both symmetric.

    Inverted, since the lowest frequencies would be lost in the round-off of the highest; the shift
    is larger than elsewhere, since the inverse of rigid motions hides that of the others.
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
    K: FloatArray, C: FloatArray, M: FloatArray, nodal: BoolArray, free: FloatArray, unit: float,
    fastest: float,
) -> tuple[ComplexArray, ComplexArray]:  # fmt: skip
    """Finite eigenvalues and vectors (n, k) of the quadratic problem, see :class:`_Companion`.

    Of the free motions (n, m) alone: the others have zeros in defective pairs, which are round-off,
    and may spoil the vectors of all.
    """
    mass, first, count = unit * unit * M, unit * C + unit * unit * M, free.shape[1]
    inverse = free.T @ np.linalg.inv(K + first)[nodal]
    by_u, by_w = -inverse @ first[:, nodal] @ free, -inverse @ mass[:, nodal] @ free
    found, vectors = np.linalg.eig(np.block([[by_u, by_w], [by_u + np.eye(count), by_w]]))
    # motions without mass have such pairs, too, which round-off moves by its root
    finite = np.abs(found) * fastest > 1e-3 * unit
    values = (unit * (1.0 + 1.0 / found[finite])).astype(np.complex128)
    return values, (free @ vectors[:count, finite]).astype(np.complex128)
