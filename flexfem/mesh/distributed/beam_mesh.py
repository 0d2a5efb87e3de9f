# SPDX-License-Identifier: LGPL-3.0-or-later
"""The one interval mesh of all beams, distributed by bodies."""

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.mesh.distributed.distribute import distributed_mesh

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


def create_beam_mesh(
    comm: MPI.Intracomm, points: FloatArray, cells: IndexArray, destination: IntArray
) -> BeamMesh:
    """Distribute an interval mesh (collective).

    Args:
        comm: communicator.
        points: (n, 3) all points, the same on every rank; each is used by a cell.
        cells: (m, 2) all cells, the same on every rank.
        destination: (m,) rank of each cell.
    """
    most = int(np.bincount(cells.ravel(), minlength=1).max())
    mesh, space, nodes = distributed_mesh(
        comm, "interval", points, cells, destination, np.arange(len(cells) + 1), most
    )
    dofs = space.dofmap.list
    # a cell keeps the order of its two nodes
    ids = np.asarray(mesh.topology.original_cell_index, dtype=np.int64)
    order = np.argsort(ids, kind="stable")
    ids, dofs = ids[order], dofs[order]
    flipped = nodes[dofs[:, 0]] != cells[ids, 0]
    dofs = np.where(flipped[:, np.newaxis], dofs[:, ::-1], dofs)
    return BeamMesh(space.dofmap.index_map, np.ascontiguousarray(dofs), ids, nodes)
