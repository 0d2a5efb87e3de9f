# SPDX-License-Identifier: LGPL-3.0-or-later
"""Block matrices and vectors (MATNEST) of blocks and multipliers in PETSc."""

from collections.abc import Sequence
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from flexfem._types import FloatArray, IndexArray, IntArray

__all__ = [
    "CoordinateMatrix",
    "block_indices",
    "create_nest_matrix",
    "create_nest_vector",
]


class CoordinateMatrix:
    """A distributed AIJ matrix with a fixed list of entries (row, column); doubles add up.

    Rows may belong to any rank.
    """

    def __init__(
        self, comm: MPI.Intracomm, rows: tuple[int, int], columns: tuple[int, int],
        i: npt.NDArray[np.integer], j: npt.NDArray[np.integer],
    ) -> None:  # fmt: skip
        """Create the pattern (collective); sizes are (local, global)."""
        self.mat = PETSc.Mat().createAIJ((rows, columns), comm=comm)
        kind = PETSc.IntType
        self.mat.setPreallocationCOO(i.astype(kind, copy=False), j.astype(kind, copy=False))

    def assemble(self, values: FloatArray) -> None:
        """Set all entries (collective)."""
        self.mat.setValuesCOO(np.ascontiguousarray(values).ravel(), PETSc.InsertMode.INSERT)


def block_indices(
    rows: IntArray, columns: IntArray, widths: tuple[int, int] = (6, 6)
) -> tuple[IndexArray, IndexArray]:
    """Entries (row, column) of dense blocks: every row of (k, m) node numbers with its columns.

    ``widths`` are the unknowns of a node in the rows and in the columns. The numbers have PETSc's
    type: there are many.
    """
    i, j = (
        (width * nodes[..., np.newaxis] + np.arange(width))
        .astype(PETSc.IntType)
        .reshape(len(nodes), width * nodes.shape[1])
        for nodes, width in zip((rows, columns), widths, strict=True)
    )
    left = np.repeat(i, j.shape[1], axis=1).ravel()
    right = np.tile(j, (1, i.shape[1])).ravel()
    return left, right


def create_nest_matrix(blocks: Sequence[Sequence[Any]], comm: MPI.Intracomm) -> PETSc.Mat:
    """MATNEST of the given matrices; None for empty blocks."""
    return PETSc.Mat().createNest([list(row) for row in blocks], comm=comm)


def create_nest_vector(sizes: Sequence[tuple[int, int]], comm: MPI.Intracomm) -> PETSc.Vec:
    """VECNEST of vectors with the given (local, global) sizes."""
    return PETSc.Vec().createNest([PETSc.Vec().createMPI(size, comm=comm) for size in sizes])
