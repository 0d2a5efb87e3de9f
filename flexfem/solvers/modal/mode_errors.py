# SPDX-License-Identifier: LGPL-3.0-or-later
"""Error bounds of eigenpairs: their residuals, and round-off."""

from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from flexfem._types import BoolArray, FloatArray
from flexfem.solvers.modal.pencil import Pencil
from flexfem.solvers.modal.shifted_inverse import ShiftedInverse

__all__ = [
    "STEADY", "ZERO", "ComplexArray", "Solution", "independent", "moving", "square_errors",
    "square_noise",
]  # fmt: skip

ComplexArray = npt.NDArray[np.complex128]

#: Factor by which residuals may exceed the iteration's own estimates.
_LOOSE = 10.0
#: Number of estimates of round-off up to which errors are round-off, and the largest such residual.
_ROUNDED, _ROUGH = 10.0, 1e-5
#: Number of estimates of the round-off of their own stiffness below which eigenvalues are zero.
ZERO = 1e3
#: Growth of modes, relative to their frequency, that is round-off.
STEADY = 1e-6
#: Size of a real or imaginary part, of vectors of size one, that is round-off.
_PART = 1e-3
#: Share of the largest Gram eigenvalue below which vectors are dependent; vectors of a double zero
#: come in nearly equal pairs, whose difference is the root of round-off.
_DEPENDENT, _DEPENDENT_AT_ZERO = 1e-8, 1e-4
#: Residual of zeros, relative to the largest eigenvalue, that is always too large.
_NEAR_ZERO = 1e-6
#: Square of the motion of a vector, relative to its states, that is round-off.
_UNMOVED = 1e-20


@dataclass(frozen=True)
class Solution:
    """Computed eigenpairs, nearest first.

    Attributes:
        values: (k,) lambda in the upper half plane or real, 1/s. Of undamped problems ``i omega``,
            or real where ``omega^2`` is negative.
        vectors: (k, n) of this rank's nodes.
        zero: (k,) True for those that are zero within rounding.
        errors: (k,) of ``lambda^2``, to first order, by the residuals, 1/s^2.
        noise: (k,) estimate of the round-off in ``lambda^2``, 1/s^2.
        missing: modes among those found that were not found; None where they cannot be counted.
        uncounted: reason why they cannot, empty if they are counted.
        shift: shift of the inverted problem, 1/s.
        inert: True where every frequency is zero, of which no residual says that it is.
        still: (m, n) independent motions of frequency zero, orthonormal in the mass.
        failure: reason why there are no eigenpairs at all, else empty.
    """

    values: ComplexArray
    vectors: ComplexArray
    zero: BoolArray
    errors: FloatArray
    noise: FloatArray
    missing: int | None
    uncounted: str
    shift: complex
    inert: bool
    still: ComplexArray
    failure: str = ""

    @classmethod
    def failed(cls, pencil: Pencil, shift: complex, failure: str) -> "Solution":
        """No eigenpairs, for a reason."""
        none, vectors = np.empty(0), np.empty((0, pencil.linearization.unknowns), np.complex128)
        return cls(
            none.astype(np.complex128), vectors, none > 0.0, none, none, None, failure, shift,
            pencil.inert, vectors, failure,
        )  # fmt: skip

    @property
    def twins(self) -> int:
        """Number of zeros more than there are modes of frequency zero.

        With a term in lambda each is double, and rounding parts it into a conjugate pair or into
        two real ones.
        """
        return int(self.zero.sum()) - len(self.still)

    def pairs(self, count: int) -> int:
        """Number of eigenpairs of the first modes, with the twins of those of frequency zero."""
        return count + max(self.twins, 0)

    @property
    def residuals(self) -> FloatArray:
        """(k,) errors relative to the eigenvalues, those of zeros to the largest of all.

        Where nothing but zeros was found to the shift, and infinite where nothing else exists.
        """
        squares = np.abs(self.values) ** 2
        scale = float(squares.max(initial=0.0, where=~self.zero))
        if self.inert:
            return np.full(len(squares), np.inf)
        found = 0.5 * self.errors / np.where(self.zero, scale or abs(self.shift) ** 2, squares)
        rounded = self.zero & (scale == 0.0) & (self.errors <= ZERO * self.noise)
        return np.where(rounded, 0.0, found)

    def doubtful(self, accuracy: float) -> BoolArray:
        """(k,) True for errors that are neither below the tolerance nor round-off."""
        squares = np.abs(self.values) ** 2
        softest = float(squares.min(initial=np.inf, where=~self.zero))
        ratio = np.maximum(squares / softest, 1.0)
        # digits kept by one shift for all; the inverse has the noise of the softest
        size = np.where(self.zero | (squares == 0.0), 1.0, squares)
        rounded = _ROUNDED * (
            np.finfo(float).eps * ratio.max(initial=1.0) + self.noise * ratio / size
        )
        asked = _LOOSE * np.where(self.zero, min(accuracy, _NEAR_ZERO), accuracy)
        enough = np.maximum(asked, np.minimum(rounded, _ROUGH))
        nothing = self.zero & (self.errors <= ZERO * self.noise) & (not self.inert)
        found: BoolArray = (self.residuals > enough) & ~nothing
        return found

    @property
    def zero_below(self) -> float:
        """Eigenvalues below this modulus count as zero, 1/s.

        The limit of those that do, and of the slowest one that does not: limits of faster modes
        rise with their stiffness, and with the errors of those beyond the ones requested.
        """
        squares = np.abs(self.values) ** 2
        slowest = squares <= squares.min(initial=np.inf, where=~self.zero)
        limits = ZERO * self.noise + self.errors
        return float(np.sqrt(limits.max(initial=0.0, where=self.zero | slowest)))

    def scale(self, doubtful: BoolArray) -> float:
        """Geometric mean of the first ones that are not zero, 1/s; zero if there are none.

        Of the doubtful ones if there are any.
        """
        first = slice(len(doubtful))
        chosen = (doubtful | ~doubtful.any()) & ~self.zero[first]
        sizes = np.abs(self.values[first])[chosen]
        return float(np.exp(np.log(sizes).mean())) if len(sizes) else 0.0


def square_errors(
    inverse: ShiftedInverse, values: ComplexArray, vectors: ComplexArray
) -> FloatArray:
    """Errors (k,) of ``lambda^2`` to first order, 1/s^2 (collective).

    The residual of the problem itself, ``P(lambda) u``, is measured by the motion that it causes at
    the shift, ``r = P(sigma)^-1 P(lambda) u``, in the norm of the mass: that of an error d of an
    undamped eigenvalue is ``2 |lambda d| / |lambda^2 - sigma^2|``. Measured as a force, errors of
    the stiffest motions would hide those of soft bending.

    Args:
        inverse: inverse at the shift.
        values: (k,) lambda, 1/s.
        vectors: (k, n) on this rank's nodes.
    """
    pencil, sigma = inverse.pencil, inverse.shift
    M, C = pencil.matrices.mass, pencil.matrices.damping
    rows, whole = [], []
    for value, u in zip(values, vectors, strict=True):
        if pencil.quadratic:
            force = (value**2 - sigma**2) * inverse.times(M, u)
            force += (value - sigma) * inverse.times(C, u)
            rest = u + inverse.solve(force)
        else:
            rest = u.real + inverse.solve((value**2 - sigma**2).real * inverse.times(M, u.real))
        rows.append(rest)
        whole.append(u)
    length = _mass_norms(pencil, np.array(rows, dtype=np.complex128).reshape(vectors.shape))
    size = _mass_norms(pencil, vectors)
    share = length / np.where(size > 0.0, size, 1.0)
    found: FloatArray = np.where(size > 0.0, share, np.inf)
    return found * np.abs(values - sigma) * (np.abs(values) + abs(sigma))


def _mass_norms(pencil: Pencil, vectors: ComplexArray) -> FloatArray:
    """(k,) square roots of ``u^H M u`` (collective)."""
    moved = pencil.linearization.multiply(pencil.matrices.mass, vectors)
    squares = pencil.linearization.total(np.einsum("ki,ki->k", vectors.conj(), moved))
    found: FloatArray = np.sqrt(np.maximum(squares.real, 0.0))
    return found


def square_noise(pencil: Pencil, vectors: ComplexArray) -> FloatArray:
    """Round-off (k,) in ``|lambda|^2``: that of sums in ``u^H K u``, over ``u^H M u``, 1/s^2."""
    lin, K = pencil.linearization, pencil.matrices.stiffness
    start, index, values = K.getValuesCSR()
    sizes = PETSc.Mat().createAIJ(
        (lin.sizes, lin.sizes), csr=(start, index, np.abs(values)), comm=lin.system.comm
    )
    absolute = np.abs(vectors).astype(np.complex128)
    forces = lin.multiply(sizes, absolute, laws=sizes)
    energy = lin.total(np.einsum("ki,ki->k", absolute, forces)).real
    mass = _mass_norms(pencil, vectors) ** 2
    noise: FloatArray = np.finfo(float).eps * energy / np.where(mass > 0.0, mass, 1.0)
    return noise


def moving(pencil: Pencil, vectors: ComplexArray) -> BoolArray:
    """(k,) True for vectors (k, n) in which something moves (collective).

    Eigenvectors of states that act on nothing, such as those of a measurement, are states alone.
    """
    lin, M = pencil.linearization, pencil.matrices.mass
    if not lin.system.comm.allreduce(lin.states.count):
        return np.ones(len(vectors), dtype=np.bool_)
    own = float(M.getDiagonal().getArray().max(initial=0.0))
    largest = max(lin.system.comm.allgather(own))
    whole = lin.total(np.einsum("ki,ki->k", vectors.conj(), vectors)).real
    found: BoolArray = _mass_norms(pencil, vectors) ** 2 > _UNMOVED * largest * whole
    return found


def independent(
    pencil: Pencil, vectors: ComplexArray, *, real: bool, zero: bool
) -> ComplexArray:  # fmt: skip
    """Basis (m, n) of the span of vectors (k, n) of one eigenvalue, orthonormal in the mass.

    Args:
        pencil: the problem.
        vectors: on this rank's nodes.
        real: True for the span of their real and imaginary parts (collective).
        zero: True if the eigenvalue is.
    """
    lin, M = pencil.linearization, pencil.matrices.mass
    if real:  # scaled by its part of the vector, since one of them may be round-off
        whole = lin.total(np.einsum("ki,ki->k", vectors.conj(), lin.multiply(M, vectors))).real
        vectors = vectors[whole > 0.0] / np.sqrt(whole[whole > 0.0])[:, np.newaxis]
        vectors = np.concatenate([vectors.real, vectors.imag]).astype(np.complex128)
    gram = lin.total(vectors.conj() @ lin.multiply(M, vectors).T)
    sizes = np.sqrt(np.abs(np.diag(gram)))
    used = sizes > (_PART if real else 0.0)
    vectors = vectors[used] / sizes[used, np.newaxis]
    gram = gram[np.ix_(used, used)] / np.outer(sizes[used], sizes[used])
    weights, turn = np.linalg.eigh(0.5 * (gram + gram.conj().T))
    limit = _DEPENDENT_AT_ZERO if zero else _DEPENDENT
    kept = weights > limit * weights.max(initial=0.0)
    basis: ComplexArray = (turn[:, kept] / np.sqrt(weights[kept])).T @ vectors
    return basis
