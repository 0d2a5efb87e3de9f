# SPDX-License-Identifier: LGPL-3.0-or-later
"""Small dense matrices."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from flexfem._types import FloatArray

__all__ = ["SMALLEST_PIVOT", "gather_rows", "inverted"]

#: A smaller pivot, relative to the largest entry, is one of a singular matrix.
SMALLEST_PIVOT = 1e-14


def gather_rows(matrix: PETSc.Mat) -> FloatArray:
    """A small distributed matrix as an array, the same on every rank (collective)."""
    rows, columns = matrix.getSize()
    first, last = matrix.getOwnershipRange()
    full = np.zeros((rows, columns))
    for i in range(first, last):
        index, values = matrix.getRow(i)
        full[i, index] = values
    comm = matrix.comm.tompi4py()
    comm.Allreduce(MPI.IN_PLACE, full, op=MPI.SUM)
    return full


def inverted(matrices: FloatArray) -> tuple[FloatArray, bool]:
    """Inverses of square matrices (k, n, n), zeros if one is singular, and whether none is."""
    try:
        inverses = np.linalg.inv(matrices)
    except np.linalg.LinAlgError:
        return np.zeros_like(matrices), False
    flat = len(matrices), matrices.shape[1] ** 2
    own, other = (np.abs(m).reshape(flat).max(axis=1) for m in (matrices, inverses))
    return inverses, bool((own * other < 1.0 / SMALLEST_PIVOT).all())
