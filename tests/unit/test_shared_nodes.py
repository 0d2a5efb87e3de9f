# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nodes of cells on the ranks: their order, their owners, and what is sent between them."""

from mpi4py import MPI

import numpy as np
import pytest

from flexfem._types import IntArray
from flexfem.core.nodes.ghosted_rows import GhostedRows
from flexfem.la.counting_comm import CountingComm
from flexfem.mesh.distributed.nodes import distributed_along, index_map_of, shared_counts

COMM = CountingComm(MPI.COMM_WORLD)


def line(count: int) -> IntArray:
    """Cells of a line whose nodes have numbers in no order."""
    names = np.random.default_rng(1).permutation(count + 1)
    return np.stack([names[:-1], names[1:]], axis=1)


def net(count: int) -> IntArray:
    """Cells of a square net, two between knots, lines in one direction before the others."""
    names = np.arange(count**2).reshape(count, count)
    rows = np.stack([names[:, :-1], names[:, 1:]], axis=-1).reshape(-1, 2)
    whole = np.concatenate([rows, rows % count * count + rows // count])
    between = count**2 + np.arange(len(whole))
    return np.stack([whole[:, 0], between, between, whole[:, 1]], axis=1).reshape(-1, 2)


@pytest.mark.three_ranks
def test_nodes_of_a_line_follow_it() -> None:
    """Their matrices are eliminated in this order."""
    cells = line(12)
    ranks = np.arange(12) * COMM.size // 12
    here = np.flatnonzero(ranks == COMM.rank)
    ids, local, index_map = distributed_along(COMM, cells, ranks, here)
    np.testing.assert_array_equal(ids[local], cells[here])
    owned = index_map.size_local
    assert index_map.size_global == 13
    along = [cells[0, 0], *cells[:, 1]]
    firsts = [along.index(node) for node in ids[:owned]]
    assert firsts == list(range(firsts[0], firsts[0] + owned))
    every = COMM.allreduce(np.bincount(ids[:owned], minlength=13))
    np.testing.assert_array_equal(every, 1)


@pytest.mark.serial
def test_nodes_of_a_net_are_in_a_narrow_band() -> None:
    """Line after line the band is as wide as the net is large, and its factors fill it."""
    cells = net(12)
    here = np.arange(len(cells))
    _, local, _ = distributed_along(MPI.COMM_SELF, cells, np.zeros_like(here), here)
    # line after line 276
    assert np.abs(local[:, 0] - local[:, 1]).max() <= 40


@pytest.mark.three_ranks
def test_what_owners_send_is_what_ghosts_return() -> None:
    """Each rank has the first node of all others; the last one owns nothing, and asks for two."""
    size, rank = COMM.size, COMM.rank
    owned = 0 if rank == size - 1 and size > 1 else 3
    owners = np.setdiff1d(np.arange(max(size - 1, 1)), rank)
    index_map = index_map_of(COMM, owned, 3 * owners, owners)
    rows, before = GhostedRows(COMM, index_map, 2), COMM.sent
    other = rows.beside()
    rows.values[:], other.values[:] = rank + 1.0, 1.0
    rows.spread()
    np.testing.assert_array_equal(rows.values[owned:, 0], owners + 1.0)
    forward = COMM.sent
    other.add_ghosts()
    expected = np.ones(owned)
    expected[:1] += size - 1
    np.testing.assert_array_equal(other.values[:owned, 1], expected)
    back = COMM.sent
    ask = size - 1 if owned else 0
    assert (forward.messages - before.messages, forward.bytes - before.bytes) == (ask, 16 * ask)
    assert (back.messages - forward.messages) == len(owners)
    assert (back.bytes - forward.bytes) == 16 * len(owners)
    np.testing.assert_array_equal(shared_counts(COMM, owners)[0][owners], 1)
