# SPDX-License-Identifier: LGPL-3.0-or-later
"""Small distributed matrices as arrays."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from flexfem._types import FloatArray

__all__ = ["gather_rows"]


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
