# SPDX-License-Identifier: LGPL-3.0-or-later
"""How far eigenpairs can be trusted: residuals, round-off, and a count of the modes in a range."""

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from flexfem._types import FloatArray
from flexfem.la.nest import counting_factorisation
from flexfem.solvers.pencil import Pencil
from flexfem.solvers.shifted_inverse import ShiftedInverse

__all__ = ["ComplexArray", "count_below", "square_errors", "square_noise"]

ComplexArray = npt.NDArray[np.complex128]


def square_errors(
    inverse: ShiftedInverse, values: ComplexArray, vectors: ComplexArray
) -> FloatArray:
    """Errors (k,) of ``lambda^2`` to first order, 1/s^2 (collective).

    The residual of the problem itself, ``P(lambda) u``, is measured by the motion that it would
    make at the shift, ``r = P(sigma)^-1 P(lambda) u``, in the norm of the mass: that of an error d
    of an undamped eigenvalue is ``2 |lambda d| / |lambda^2 - sigma^2|``. Measured as a force, the
    stiffest motions would hide those that bend softly.

    Args:
        inverse: at the shift.
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


def count_below(pencil: Pencil, square: float) -> int | None:
    """Number of modes of an undamped symmetric problem with ``omega^2`` below a value (collective).

    None where the matrix is singular.
    """
    lin = pencil.linearization
    matrix = pencil.matrices.stiffness.copy()
    matrix.axpy(-square, pencil.matrices.mass)
    pc = counting_factorisation(matrix, symmetric=True)
    pc.setUp()
    if pc.getFailedReason() != 0:
        return None
    # INFOG(12) is the number of negative pivots
    return int(pc.getFactorMatrix().getMumpsInfog(12)) - lin.system.constraints.size_global
