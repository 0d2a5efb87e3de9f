# SPDX-License-Identifier: LGPL-3.0-or-later
"""Distributed blocks of vectors as arrays: each rank has its own rows, (rows, columns)."""

from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem, la

from flexfem._types import FloatArray, IntArray
from flexfem.kernels.ffcx_options import compiled_form

__all__ = [
    "ProjectedForm",
    "assemble_rows",
    "assembled_matrix",
    "global_rows",
    "multiply",
    "own_rows",
    "projected",
    "same_everywhere",
    "set_rows",
    "total",
    "with_neighbours",
]


def total(comm: MPI.Intracomm, values: FloatArray) -> FloatArray:
    """Sum over the ranks, the same to the last bit on all of them (collective)."""
    result = np.ascontiguousarray(values, dtype=np.float64)
    summed = np.empty_like(result) if comm.rank == 0 else None
    comm.Reduce(result, summed, op=MPI.SUM)
    return same_everywhere(comm, result if summed is None else summed)


def same_everywhere(comm: MPI.Intracomm, values: FloatArray) -> FloatArray:
    """The first rank's values (collective)."""
    result = np.array(values, dtype=np.float64, order="C")
    comm.Bcast(result)
    return result


def projected(comm: MPI.Intracomm, left: FloatArray, right: FloatArray) -> FloatArray:
    """Product ``left^T right`` over all ranks (collective)."""
    return total(comm, left.T @ right)


def multiply(matrix: PETSc.Mat, block: FloatArray) -> FloatArray:
    """A matrix times a block of vectors (collective)."""
    columns = block.shape[1]
    rows = matrix.getLocalSize()[0]
    if columns == 0:
        return np.zeros((rows, 0))
    dense = PETSc.Mat().createDense(
        (matrix.getSizes()[1], (None, columns)),
        array=np.asfortranarray(block),
        comm=matrix.comm,
    )
    product = matrix.matMult(dense)
    result: FloatArray = product.getDenseArray()[:rows].copy()
    product.destroy()
    dense.destroy()
    return result


def own_rows(space: fem.FunctionSpace) -> int:
    """Number of rows of this rank."""
    return int(space.dofmap.index_map.size_local * space.dofmap.index_map_bs)


def set_rows(function: fem.Function, rows: FloatArray) -> None:
    """Fill a function from this rank's rows and its neighbours' (collective)."""
    function.x.array[: len(rows)] = rows
    function.x.scatter_forward()


def assemble_rows(form: fem.Form, rows: int) -> FloatArray:
    """Assemble a linear form (collective)."""
    vector = fem.assemble_vector(form)
    vector.scatter_reverse(la.InsertMode.add)
    values: FloatArray = vector.array[:rows].copy()
    return values


def assembled_matrix(form: ufl.Form, comm: MPI.Intracomm) -> PETSc.Mat:
    """Assemble a bilinear form to an AIJ matrix (collective).

    Not by dolfinx.fem.petsc: importing it makes all symbols of PETSc's libraries global, where the
    HDF5 library of h5py then finds those of another one. This way is also three times as fast.
    """
    matrix = fem.assemble_matrix(compiled_form(form))
    matrix.scatter_reverse()
    width = matrix.block_size[0]
    own = matrix.to_scipy().tocsr()
    index_map = matrix.index_map(1)
    count = index_map.size_local + index_map.num_ghosts
    blocks = index_map.local_to_global(np.arange(count, dtype=np.int32))
    columns = (width * blocks[:, np.newaxis] + np.arange(width)).ravel()[own.indices]
    size = width * index_map.size_local, width * index_map.size_global
    kind = PETSc.IntType
    return PETSc.Mat().createAIJ(
        (size, size), csr=(own.indptr.astype(kind), columns.astype(kind), own.data), comm=comm
    )


def with_neighbours(space: fem.FunctionSpace, rows: FloatArray) -> FloatArray:
    """This rank's rows and those that its cells have of other ranks (collective)."""
    function = fem.Function(space)
    whole = np.zeros((len(function.x.array), rows.shape[1]))
    for j in range(rows.shape[1]):
        set_rows(function, rows[:, j])
        whole[:, j] = function.x.array
    return whole


class ProjectedForm:
    """A bilinear form in a basis, again and again with other data.

    Every rank multiplies the contributions of its own cells, without assembling them to a matrix
    of all ranks: in blocks as the space has them this takes a third of the time.
    """

    def __init__(self, form: ufl.Form, comm: MPI.Intracomm) -> None:
        """Compile the form and create the matrix (collective)."""
        self._comm = comm
        self._form: Any = compiled_form(form)
        self._matrix = fem.create_matrix(self._form)
        self._scipy = self._matrix.to_scipy(ghosted=True)

    def project(self, basis: FloatArray) -> FloatArray:
        """(n, n) with the present data of the form (collective).

        Args:
            basis: as from :func:`with_neighbours`.
        """
        self._matrix.set_value(0.0)
        fem.assemble_matrix(self._matrix, self._form)
        # columns that only other ranks' cells use follow at the end, and are zero here
        padded = np.zeros((self._scipy.shape[1] - len(basis), basis.shape[1]))
        product = self._scipy @ (np.vstack([basis, padded]) if len(padded) else basis)
        return projected(self._comm, basis, product[: len(basis)])


def global_rows(matrix: PETSc.Mat, local: IntArray) -> IntArray:
    """Numbers in the whole matrix of rows of this rank."""
    rows: IntArray = (local + matrix.getOwnershipRange()[0]).astype(PETSc.IntType)
    return rows
