# SPDX-License-Identifier: LGPL-3.0-or-later
"""The one mesh of all beams, distributed by bodies."""

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from flexfem._types import IndexArray, IntArray
from flexfem.mesh.distributed.nodes import distributed_along

__all__ = ["BeamMesh", "create_beam_mesh"]


@dataclass(frozen=True)
class BeamMesh:
    """This rank's part of the mesh of all beams.

    Attributes:
        index_map: distribution of the nodes (owned first, then ghosts).
        cells: (m, 2) nodes of each cell as local indices; the cells of a body run along it.
        cell_ids: (m,) index of each cell in the input.
        node_ids: (n,) index of each local node in the input.
    """

    index_map: Any
    cells: npt.NDArray[np.int32]
    cell_ids: IntArray
    node_ids: IntArray


def create_beam_mesh(comm: MPI.Intracomm, cells: IndexArray, destination: IntArray) -> BeamMesh:
    """Distribute the cells of beams (collective).

    Args:
        comm: communicator.
        cells: (m, 2) all cells, the same on every rank.
        destination: (m,) rank of each cell.
    """
    ids = np.flatnonzero(destination == comm.rank)
    nodes, local, index_map = distributed_along(comm, cells, destination, ids)
    return BeamMesh(index_map, local, ids, nodes)
