# SPDX-License-Identifier: LGPL-3.0-or-later
"""Distribution of nodes over the ranks."""

from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from flexfem._types import IndexArray, IntArray

__all__ = ["distributed", "distributed_along", "index_map_of", "shared_counts"]


def distributed(comm: MPI.Intracomm, owner: IntArray, touched: IntArray) -> tuple[IntArray, Any]:
    """Nodes of this rank, ghosts last, and their distribution (collective).

    Args:
        comm: communicator.
        owner: rank of every node.
        touched: nodes of the elements of this rank; nodes may occur more than once.
    """
    number = np.empty(len(owner), dtype=np.int64)
    number[np.argsort(owner, kind="stable")] = np.arange(len(owner))
    mine = np.flatnonzero(owner == comm.rank)
    ghosts = np.setdiff1d(touched, mine)
    ids = np.concatenate([mine, ghosts]).astype(np.int64)
    return ids, index_map_of(comm, len(mine), number[ghosts], owner[ghosts])


def distributed_along(
    comm: MPI.Intracomm, cells: IndexArray, destination: IntArray, here: IntArray
) -> tuple[IntArray, npt.NDArray[np.int32], Any]:
    """Nodes of the cells of this rank, and their distribution (collective).

    Nodes are numbered along the cells, and belong to the lowest rank with a cell at them.

    Args:
        comm: communicator.
        cells: (m, k) all cells, the same on every rank.
        destination: (m,) rank of each cell.
        here: cells of this rank, and those that it has as ghosts.

    Returns:
        Numbers of the nodes in the input, ghosts last; nodes of the cells ``here`` as local
        indices; and the distribution.
    """
    nodes, first, along = np.unique(cells, return_index=True, return_inverse=True)
    along = along.reshape(cells.shape)
    order = np.argsort(first)
    if cells.shape[1] == 2 and np.bincount(along.ravel()).max() > 2:
        order = _narrow(along, len(nodes))
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    along = place[along]
    owner = np.full(len(nodes), comm.size)
    np.minimum.at(owner, along, np.broadcast_to(destination[:, np.newaxis], along.shape))
    places, index_map = distributed(comm, owner, along[here].ravel())
    local = np.empty(len(nodes), dtype=np.int32)
    local[places] = np.arange(len(places))
    return nodes[order[places]].astype(np.int64), local[along[here]], index_map


def _narrow(cells: IntArray, count: int) -> IntArray:
    """Order of the nodes of lines that branch: rows of lines are eliminated one after the other."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    ends = np.concatenate([cells, cells[:, ::-1]]).T
    graph = coo_array((np.ones(len(ends[0])), (ends[0], ends[1])), shape=(count, count))
    order: IntArray = reverse_cuthill_mckee(graph.tocsr(), symmetric_mode=True).astype(np.int64)
    return order


def index_map_of(comm: MPI.Intracomm, owned: int, ghosts: IntArray, owners: IntArray) -> Any:
    """DOLFINx's index map (collective).

    Which ranks have nodes of this one as ghosts is told to DOLFINx, which would find it by polling:
    where ranks share a core, each keeps the others from answering.

    Args:
        comm: communicator.
        owned: number of nodes of this rank.
        ghosts: (g,) numbers of ghosts among the nodes of all ranks.
        owners: (g,) their ranks.
    """
    from dolfinx.common import IndexMap

    ranks = [np.flatnonzero(counts).astype(np.int32) for counts in shared_counts(comm, owners)]
    return IndexMap(comm, owned, ranks, ghosts.astype(np.int64), owners.astype(np.int32))


def shared_counts(comm: MPI.Intracomm, owners: IntArray) -> tuple[IntArray, IntArray]:
    """Numbers (p,) of ghosts that each rank owns, and of those that each has here (collective).

    Args:
        comm: communicator.
        owners: ranks of the ghosts of this rank.
    """
    from_others = np.bincount(owners, minlength=comm.size)
    to_others = np.empty_like(from_others)
    comm.Alltoall(from_others, to_others)
    return from_others, to_others
