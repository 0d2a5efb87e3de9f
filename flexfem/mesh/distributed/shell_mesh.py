# SPDX-License-Identifier: LGPL-3.0-or-later
"""The one triangle mesh of all shells, distributed with the ghosts of their patches."""

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from flexfem._types import IntArray
from flexfem.mesh.distributed.nodes import distributed_along
from flexfem.mesh.surface_mesh import SurfaceMesh

__all__ = ["ShellMesh", "create_shell_mesh"]


@dataclass(frozen=True)
class ShellMesh:
    """This rank's part of the mesh of all shells.

    Owned cells are the first. The ghosts are the cells that are neighbours of owned cells, or of
    these neighbours, but belong to other ranks. The patch of an owned cell is its three nodes and
    those in its row of `opposite`.

    Attributes:
        index_map: Distribution of the nodes (owned first, then ghosts).
        owned: Number of owned cells.
        cells: Local nodes of each cell, in the order of the input, shape (c, 3).
        opposite: Local node over each edge of the owned cells, -1 without, shape (owned, 3).
        cell_ids: Index of each cell in the input, shape (c,).
        node_ids: Index of each local node in the input, shape (n,).
        body: Number of each cell's body, shape (c,).
    """

    index_map: Any
    owned: int
    cells: npt.NDArray[np.int32]
    opposite: npt.NDArray[np.int32]
    cell_ids: IntArray
    node_ids: IntArray
    body: IntArray

    def local(self, nodes: IntArray) -> npt.NDArray[np.int32]:
        """Return the local nodes of nodes of the input, which are all here."""
        return _local(self.node_ids, nodes)


def _local(node_ids: IntArray, nodes: IntArray) -> npt.NDArray[np.int32]:
    order = np.argsort(node_ids)
    return order[np.searchsorted(node_ids, nodes, sorter=order)].astype(np.int32)


def create_shell_mesh(
    comm: MPI.Intracomm, surface: SurfaceMesh, destination: IntArray, rings: int = 1
) -> ShellMesh:
    """Distribute a surface mesh (collective).

    Args:
        comm: Communicator.
        surface: The whole mesh, the same on every rank.
        destination: Rank of each triangle, the same on every rank, shape (m,).
        rings: Ghosts are the neighbours (1), or these and their neighbours (2).
    """
    topology, mine = surface.topology, destination == comm.rank
    own = around = np.flatnonzero(mine)
    ghosts = np.zeros_like(mine)
    for _ in range(rings):
        near = topology.neighbours[around]
        around = np.unique(near[near >= 0])
        ghosts[around] = True
    ids = np.concatenate([own, np.flatnonzero(ghosts & ~mine)])
    nodes, cells, index_map = distributed_along(comm, surface.triangles, destination, ids)
    far = topology.opposite[own]
    opposite = np.full(far.shape, -1, dtype=np.int32)
    opposite[far >= 0] = _local(nodes, far[far >= 0])
    return ShellMesh(index_map, len(own), cells, opposite, ids, nodes, surface.body[ids])
