# SPDX-License-Identifier: LGPL-3.0-or-later
"""Distribution of a block's nodes over the ranks."""

from typing import Any

from mpi4py import MPI

import numpy as np

from flexfem._types import IntArray

__all__ = ["distributed"]

#: of the messages that set up the exchange of ghosts
_TAG = 1201


def distributed(comm: MPI.Intracomm, owner: IntArray, touched: IntArray) -> tuple[IntArray, Any]:
    """Nodes of this rank, ghosts last, and their distribution (collective).

    Args:
        comm: communicator.
        owner: rank of every node.
        touched: nodes of the elements of this rank; nodes may occur more than once.
    """
    from dolfinx.common import IndexMap

    number = np.empty(len(owner), dtype=np.int64)
    number[np.argsort(owner, kind="stable")] = np.arange(len(owner))
    mine = np.flatnonzero(owner == comm.rank)
    ghosts = np.setdiff1d(touched, mine)
    ids = np.concatenate([mine, ghosts]).astype(np.int64)
    index_map = IndexMap(
        comm, len(mine), number[ghosts].astype(np.int64), owner[ghosts].astype(np.int32), _TAG
    )
    return ids, index_map
