# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solutions of the frozen operator as vectors: steps of all blocks and of the multipliers."""

from itertools import pairwise

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.runs import starts
from flexfem.system.system import System

__all__ = ["StepVectors"]


class StepVectors:
    """Blocks' steps and multipliers in one vector: owned unknowns of all parts, then rows here.

    Attributes:
        sizes: (n_parts + 1,) first unknown of each part in vectors; the last is that of the rows.
    """

    def __init__(self, system: System) -> None:
        """Store the system."""
        self._system = system
        self.sizes = starts([p.block.sizes[0] for p in system.parts])

    def __len__(self) -> int:
        """Number of entries of a vector on this rank."""
        return int(self.sizes[-1]) + self._system.constraints.size

    def put(self, solution: FloatArray) -> FloatArray:
        """Write the blocks' parts of a solution to their steps; the multipliers' part."""
        for part, (start, end) in zip(self._system.parts, pairwise(self.sizes), strict=True):
            part.block.owned_step[:] = solution[start:end].reshape(-1, part.block.width)
        return solution[self.sizes[-1] :]

    def collect(self, correction: FloatArray, out: FloatArray | None = None) -> FloatArray:
        """Steps of the owned nodes of all blocks, then of this rank's multipliers, as a vector.

        ``S dL = Phi - G~ y`` is the correction; steps are to be subtracted.
        """
        steps = [p.block.owned_step.ravel() for p in self._system.parts]
        return np.concatenate([*steps, -correction], out=out)

    def squares(self, *vectors: FloatArray) -> FloatArray:
        """Squares of the norms of the blocks' parts over all ranks (collective)."""
        count = self.sizes[-1]
        return self.sum(np.array([v[:count] @ v[:count] for v in vectors]))

    def products(self, rows: FloatArray, vector: FloatArray) -> FloatArray:
        """Inner products (k,) of rows (k, n) with a vector: the blocks' parts, over all ranks."""
        count = self.sizes[-1]
        return self.sum(rows[:, :count] @ vector[:count])

    def gram(self, rows: FloatArray) -> FloatArray:
        """Inner products (k, k) of rows (k, n): the blocks' parts, over all ranks (collective)."""
        own = rows[:, : self.sizes[-1]]
        return self.sum(own @ own.T)

    def sum(self, values: FloatArray) -> FloatArray:
        """Sum over all ranks, in place (collective)."""
        if self._system.comm.size > 1:
            self._system.comm.Allreduce(MPI.IN_PLACE, values)
        return values
