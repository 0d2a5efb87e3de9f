# SPDX-License-Identifier: LGPL-3.0-or-later
"""The one triangle mesh of all shells, distributed with the ghosts of their patches."""

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from flexfem._types import IntArray
from flexfem.mesh.distributed.distribute import distributed_mesh
from flexfem.mesh.geometry.topology import edge_keys
from flexfem.mesh.surface_mesh import SurfaceMesh

__all__ = ["ShellMesh", "create_shell_mesh"]


@dataclass(frozen=True)
class ShellMesh:
    """This rank's part of the mesh of all shells.

    Cells are numbered as in the DOLFINx mesh, owned ones first. The ghosts are the cells that are
    neighbours of owned cells, or of these neighbours, but belong to other ranks. The patch of an
    owned cell is its three nodes and those in its row of `opposite`.

    Attributes:
        mesh: The DOLFINx mesh.
        space: Its space of continuous linear functions; degrees of freedom are local nodes.
        index_map: Distribution of the nodes (owned first, then ghosts).
        owned: Number of owned cells.
        cells: Local nodes of each cell, in the order of the input, shape (c, 3).
        opposite: Local node over each edge of the owned cells, -1 without, shape (owned, 3).
        cell_ids: Index of each cell in the input, shape (c,).
        node_ids: Index of each local node in the input, shape (n,).
        body: Number of each cell's body, shape (c,).
    """

    mesh: Any
    space: Any
    index_map: Any
    owned: int
    cells: npt.NDArray[np.int32]
    opposite: npt.NDArray[np.int32]
    cell_ids: IntArray
    node_ids: IntArray
    body: IntArray

    def local(self, nodes: IntArray) -> npt.NDArray[np.int32]:
        """Return the local nodes of nodes of the input, which are all here."""
        order = np.argsort(self.node_ids)
        return order[np.searchsorted(self.node_ids, nodes, sorter=order)].astype(np.int32)


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
    triangles, topology = surface.triangles, surface.topology
    ranks, offsets = _ranks(topology.neighbours, destination, rings)
    mesh, space, nodes = distributed_mesh(
        comm, "triangle", surface.points, triangles, ranks, offsets, _edge_cells(triangles)
    )
    owned = mesh.topology.index_map(2).size_local
    ids = np.asarray(mesh.topology.original_cell_index, dtype=np.int64)
    order = np.argsort(nodes)

    def local(wanted: IntArray) -> npt.NDArray[np.int32]:
        return order[np.searchsorted(nodes, wanted, sorter=order)].astype(np.int32)

    far = topology.opposite[ids[:owned]]
    opposite = np.full(far.shape, -1, dtype=np.int32)
    opposite[far >= 0] = local(far[far >= 0])
    return ShellMesh(
        mesh, space, space.dofmap.index_map, owned, local(triangles[ids]), opposite, ids, nodes,
        surface.body[ids],
    )  # fmt: skip


def _ranks(neighbours: IntArray, destination: IntArray, rings: int) -> tuple[IntArray, IntArray]:
    """Return owner and ghost ranks of each cell one after the other, and where each cell begins."""
    ranks = destination[:, np.newaxis]
    for _ in range(rings):
        around = np.where(
            neighbours[:, :, np.newaxis] >= 0, ranks[neighbours], ranks[:, np.newaxis]
        )
        ranks = np.column_stack([ranks, around.reshape(len(ranks), -1)])
    chosen = np.ones(ranks.shape, dtype=bool)
    for k in range(1, ranks.shape[1]):
        chosen[:, k] = (ranks[:, :k] != ranks[:, k : k + 1]).all(axis=1)
    return ranks[chosen], np.concatenate([[0], np.cumsum(chosen.sum(axis=1))])


def _edge_cells(triangles: IntArray) -> int:
    """Return the largest number of triangles at one edge, those of other bodies included."""
    pairs = triangles[:, [[1, 2], [2, 0], [0, 1]]].reshape(-1, 2)
    keys = edge_keys(pairs, int(triangles.max()) + 1)
    return int(np.unique(keys, return_counts=True)[1].max())
