# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rows of numbers of a block's nodes, with ghosts: nodes that other ranks own."""

from copy import copy
from typing import Any

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.la.counting_comm import CountingComm
from flexfem.mesh.distributed.nodes import shared_counts

__all__ = ["GhostedRows"]


class GhostedRows:
    """An array of all nodes of a rank, and its halo exchange by DOLFINx.

    Attributes:
        values: (n, width) numbers of the local nodes, ghosts last.
    """

    def __init__(self, comm: MPI.Intracomm, index_map: Any, width: int) -> None:
        """Allocate the rows (collective), of a communicator that counts if it is one."""
        from dolfinx import la

        self._vector, self._add = la.vector(index_map, width), la.InsertMode.add
        self.values: FloatArray = self._vector.array.reshape(-1, width)
        self._counter = comm if isinstance(comm, CountingComm) else None
        self._reverse, self._forward = (
            (int(np.count_nonzero(counts)), 8 * width * int(counts.sum()))
            for counts in shared_counts(comm, index_map.owners)
        )

    def beside(self) -> "GhostedRows":
        """Other rows of the same nodes, by the same communicators: to make them takes longest."""
        from dolfinx import la

        other = copy(self)
        vector = self._vector._cpp_object
        other._vector = la.Vector(type(vector)(vector))
        other.values = other._vector.array.reshape(self.values.shape)
        other.values[:] = 0.0
        return other

    def spread(self) -> None:
        """Copy the owners' rows to ghosts (forward halo exchange)."""
        if self._counter is not None:
            self._counter.count(*self._forward)
        self._vector.scatter_forward()

    def add_ghosts(self) -> None:
        """Add the rows of ghosts to their owners' (reverse halo exchange)."""
        if self._counter is not None:
            self._counter.count(*self._reverse)
        self._vector.scatter_reverse(self._add)
