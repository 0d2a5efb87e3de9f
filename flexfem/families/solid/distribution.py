# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells and nodes of solids on the ranks, of stored meshes without those of other ranks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from mpi4py import MPI

import numpy as np

from flexfem._types import IntArray
from flexfem.families.solid.body import Solid
from flexfem.families.solid.meshes.stored import StoredFigure
from flexfem.mesh.distributed.nodes import index_map_of

__all__ = ["distributed_nodes", "pieces_of", "shared"]


def pieces_of(body: Solid) -> int:
    """Number of pieces of which ranks take some: cells, or the pieces of a stored mesh."""
    pieces: int = body.mesh.pieces if body.stored else body.elements
    return pieces


class _Share(Protocol):
    """Distribution of a body: a node belongs to the lowest rank with a cell around it.

    Attributes:
        cells: (m,) those of this rank, ascending; mine: (n,) its nodes, ascending.
        counts: (p,) number of nodes of each rank.
    """

    cells: IntArray
    mine: IntArray
    counts: IntArray

    def owned(self, nodes: IntArray) -> tuple[IntArray, IntArray]:
        """Rank (k,) of some nodes, and their numbers (k,) among the nodes of that rank."""


class _WholeShare:
    """See :class:`_Share`: of a mesh in memory."""

    def __init__(self, body: Solid, ranks: IntArray, comm: MPI.Intracomm) -> None:
        """Find the ranks of all nodes; ``ranks`` (m,) of the cells."""
        nodes = body.nodes.cells
        owner = np.full(body.figure.count, np.iinfo(np.int64).max)
        np.minimum.at(owner, nodes, np.broadcast_to(ranks[:, np.newaxis], nodes.shape))
        self.cells = np.flatnonzero(ranks == comm.rank)
        self.counts = np.bincount(owner, minlength=comm.size)
        order = np.argsort(owner, kind="stable")
        starts = np.cumsum([0, *self.counts])
        self._owner, self._number = owner, np.empty_like(owner)
        self._number[order] = np.arange(len(owner)) - np.repeat(starts[:-1], self.counts)
        self.mine = np.flatnonzero(owner == comm.rank)

    def owned(self, nodes: IntArray) -> tuple[IntArray, IntArray]:
        """See :meth:`_Share.owned`."""
        return self._owner[nodes], self._number[nodes]


class _StoredShare:
    """See :class:`_Share`: of a stored mesh, where cells and nodes of a rank are in a row."""

    def __init__(self, body: Solid, ranks: IntArray, comm: MPI.Intracomm) -> None:
        """Find the first nodes of the ranks; ``ranks`` (p,) of the pieces, ascending."""
        figure = body.figure
        assert isinstance(figure, StoredFigure)
        pieces = np.searchsorted(ranks, np.arange(comm.size + 1))
        self._first = figure.first_nodes(pieces)
        self.counts = np.diff(self._first)
        ends = np.minimum(pieces[comm.rank : comm.rank + 2] * figure.piece, body.elements)
        self.cells = np.arange(*ends.tolist())
        self.mine = np.arange(*self._first[comm.rank : comm.rank + 2].tolist())

    def owned(self, nodes: IntArray) -> tuple[IntArray, IntArray]:
        """See :meth:`_Share.owned`."""
        owner = np.searchsorted(self._first, nodes, side="right") - 1
        return owner, nodes - self._first[owner]


def shared(bodies: Sequence[Solid], ranks: IntArray, comm: MPI.Intracomm) -> list[_Share]:
    """Distribution of each body.

    Args:
        bodies: of the family.
        ranks: rank of each piece, body after body.
        comm: communicator.
    """
    ends = np.cumsum([pieces_of(body) for body in bodies])
    parts = np.split(ranks, ends[:-1])
    return [
        (_StoredShare if body.stored else _WholeShare)(body, own, comm)
        for body, own in zip(bodies, parts, strict=True)
    ]


def distributed_nodes(
    bodies: Sequence[Solid], shares: Sequence[_Share], first: IntArray, comm: MPI.Intracomm
) -> tuple[IntArray, Any]:
    """Nodes of this rank, ghosts last, and their distribution (collective).

    Args:
        bodies: of the family.
        shares: their distributions.
        first: (b + 1,) first node of each body in the family.
        comm: communicator.
    """
    counts = np.array([share.counts for share in shares])
    # nodes are numbered rank after rank, those of a rank body after body
    start = np.concatenate([[0], np.cumsum(counts.T)])[:-1].reshape(comm.size, len(bodies))
    mine, ghosts, numbers, owners = [], [], [], []
    for k, (body, share) in enumerate(zip(bodies, shares, strict=True)):
        touched = np.unique(body.figure.cell_nodes(share.cells))
        owner, number = share.owned(touched)
        far = owner != comm.rank
        mine.append(first[k] + share.mine)
        ghosts.append(first[k] + touched[far])
        numbers.append(start[owner[far], k] + number[far])
        owners.append(owner[far])
    own = np.concatenate(mine)
    index_map = index_map_of(comm, len(own), np.concatenate(numbers), np.concatenate(owners))
    return np.concatenate([own, *ghosts]).astype(np.int64), index_map
