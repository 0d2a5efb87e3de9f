# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nested dissection of the rows that ranks share, over a binary tree of the ranks.

The ranks are halved again and again, as bodies are when they are distributed. From the leaves of
this tree upwards two halves exchange the complements on the rows that they have left, add them up,
and eliminate the rows that no further rank has (George 1973, 10.1137/0710032). All ranks of both
halves do the same with the same numbers: so a right-hand side takes one message a level upwards,
and nothing downwards. A rank stores the fronts of its own levels, each as large as the cuts around
its half, and a chain of bodies over n ranks takes log2(n) messages of a few rows.
"""

from typing import NamedTuple

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.kernels.compiled import kernel
from flexfem.la.exchange import exchange
from flexfem.mesh.distributed.rank_tree import Merge, merges
from flexfem.solvers.linear.dense_elimination import DenseElimination

__all__ = ["RankDissection"]

_TAG = 1203


class _Rows(NamedTuple):
    """Rows that a half has left: their numbers, and how many ranks have them, in it and in all."""

    numbers: IntArray
    here: IntArray
    holders: IntArray


@kernel
def _join(
    own: IntArray, part: FloatArray, other: IntArray, received: FloatArray, out: FloatArray
) -> None:
    """Add the parts of two halves; ``own`` and ``other`` are their places in what both have."""
    out[:] = 0.0
    for k in range(own.size):
        out[own[k]] = part[k]
    for k in range(other.size):
        out[other[k]] += received[k]


def _places(rows: IntArray, size: int) -> IntArray:
    """Places of all pairs of rows in a full matrix (size, size)."""
    return (rows[:, np.newaxis] * size + rows).ravel()


class _Message:
    """What one half of the ranks tells the other one of its rows.

    Attributes:
        whole: all of the following; ``factors`` is what comes before ``right``.
        complement: (r r,) of its rows, followed by a flag of failure.
        right: (r,) its part of the right-hand side.
    """

    def __init__(self, size: int) -> None:
        """Number of rows."""
        self.whole = np.zeros(size * size + 1 + size)
        self.factors, self.right = np.split(self.whole, [size * size + 1])
        self.complement = self.factors[:-1]

    def set(self, complement: FloatArray, regular: bool) -> None:
        """Write the complement, and whether the factors that left it are regular."""
        self.complement[:] = complement.reshape(-1)
        self.factors[-1] = 0.0 if regular else 1.0

    @property
    def failed(self) -> bool:
        """True if factors were singular."""
        return bool(self.factors[-1] > 0.0)


class _Level:
    """Two halves that are joined, with the rows that both have left.

    Attributes:
        size: number of these rows.
        left: those that other ranks have as well.
        operations: numbers of floating-point operations of a factorisation and of a solve.
    """

    def __init__(self, comm: MPI.Intracomm, merge: Merge, own: _Rows) -> None:
        """Exchange the rows with the other half (collective among both)."""
        self._comm, self._merge = comm, merge
        requests = [comm.isend(own, dest=rank, tag=_TAG) for rank in merge.to]
        other: _Rows = comm.recv(source=merge.source, tag=_TAG)
        MPI.Request.waitall(requests)
        numbers = np.union1d(own.numbers, other.numbers)
        here, holders = np.zeros((2, len(numbers)), dtype=np.int64)
        for half in (own, other):
            at = np.searchsorted(numbers, half.numbers)
            here[at] += half.here
            holders[at] = half.holders
        order = np.argsort(here < holders, kind="stable")
        place = np.argsort(order)
        self._own, self._other = (
            place[np.searchsorted(numbers, half.numbers)] for half in (own, other)
        )
        count, self.size = int((here == holders).sum()), len(numbers)
        self._count = count
        left = order[count:]
        self.left = _Rows(numbers[left], here[left], holders[left])
        self._front = DenseElimination(count, self.size)
        self.operations = self._front.operations
        # of both halves: complements, a flag of failure, parts of the right-hand side
        self._mine, self._others = (_Message(len(rows)) for rows in (self._own, self._other))
        self._own_pairs, self._other_pairs = (
            _places(rows, self.size) for rows in (self._own, self._other)
        )
        self._matrix, self._vector = np.zeros((self.size, self.size)), np.zeros(self.size)

    def factor(self, complement: FloatArray, regular: bool) -> tuple[FloatArray, bool]:
        """Join the complements of both halves: that of the rows left then, False if singular."""
        self._mine.set(complement, regular)
        self._exchange(self._mine.factors, self._others.factors)
        return self._eliminate()

    def reduce(self, right: FloatArray) -> FloatArray:
        """Join the right-hand sides of both halves: that of the rows left."""
        self._mine.right[:] = right
        self._exchange(self._mine.right, self._others.right)
        return self._reduce()

    def factor_and_reduce(
        self, complement: FloatArray, regular: bool, right: FloatArray
    ) -> tuple[FloatArray, bool, FloatArray]:
        """What :meth:`factor` and :meth:`reduce` do, by one message."""
        self._mine.set(complement, regular)
        self._mine.right[:] = right
        self._exchange(self._mine.whole, self._others.whole)
        complement, regular = self._eliminate()
        return complement, regular, self._reduce() if regular else self._vector[self._count :]

    def _eliminate(self) -> tuple[FloatArray, bool]:
        mine, others = self._mine, self._others
        if mine.failed or others.failed:
            return self._front.complement, False
        parts = self._own_pairs, mine.complement, self._other_pairs, others.complement
        _join(*parts, self._matrix.reshape(-1))
        regular = self._front.eliminate(self._matrix)
        return self._front.complement, regular

    def _reduce(self) -> FloatArray:
        _join(self._own, self._mine.right, self._other, self._others.right, self._vector)
        self._front.reduce(self._vector)
        return self._vector[self._count :]

    def complete(self, left: FloatArray) -> FloatArray:
        """Solution of the own half's rows from that of the rows left."""
        self._vector[self._count :] = left
        self._front.complete(self._vector)
        return self._vector[self._own]

    def _exchange(self, sent: FloatArray, received: FloatArray) -> None:
        """Send a vector to the other half and receive that of it; empty ones are not sent."""
        merge = self._merge
        exchange(
            self._comm, [(merge.source, received)] if len(received) else [],
            [(rank, sent) for rank in merge.to] if len(sent) else [], _TAG,
        )  # fmt: skip


class RankDissection:
    """Solver for the rows that several ranks have, whose entries and right-hand sides add up.

    Attributes:
        largest_front: number of rows of the largest front of this rank.
        operations: numbers of floating-point operations of a factorisation and of a solve.
    """

    def __init__(self, comm: MPI.Intracomm, numbers: IntArray, holders: IntArray) -> None:
        """Join the rows of all ranks, level by level (collective).

        Args:
            comm: communicator of two ranks or more.
            numbers: of the rows of this rank, the same on all ranks that have a row.
            holders: number of ranks that have each of them.
        """
        order = np.argsort(numbers, kind="stable")
        self._order, self._place = order, np.argsort(order)
        self._pairs = _places(order, len(order))
        rows = _Rows(numbers[order], np.ones(len(order), dtype=np.int64), holders[order])
        self._levels: list[_Level] = []
        for merge in merges(comm.rank, comm.size):
            self._levels.append(_Level(comm, merge, rows))
            rows = self._levels[-1].left
        self.largest_front = max(level.size for level in self._levels)
        factors, solves = zip(*(level.operations for level in self._levels), strict=True)
        self.operations = sum(factors), sum(solves)
        assert not len(rows.numbers)  # every row is complete where all ranks are joined

    def factor(self, matrix: FloatArray, regular: bool) -> bool:
        """Factorise (collective); False on all ranks if the sum is singular, or a rank's part.

        Args:
            matrix: (r, r) entries of this rank.
            regular: False if this rank's part is singular.
        """
        matrix = matrix.reshape(-1)[self._pairs]
        for level in self._levels:
            matrix, regular = level.factor(matrix, regular)
        return regular

    def solve(self, right: FloatArray) -> None:
        """Solve in place for this rank's part of the right-hand side (collective)."""
        part = right[self._order]
        for level in self._levels:
            part = level.reduce(part)
        self._complete(part, right)

    def factor_and_solve(self, matrix: FloatArray, regular: bool, right: FloatArray) -> bool:
        """What :meth:`factor` and :meth:`solve` do, with half of their messages (collective)."""
        matrix, part = matrix.reshape(-1)[self._pairs], right[self._order]
        for level in self._levels:
            matrix, regular, part = level.factor_and_reduce(matrix, regular, part)
        if regular:
            self._complete(part, right)
        return regular

    def _complete(self, part: FloatArray, right: FloatArray) -> None:
        for level in reversed(self._levels):
            part = level.complete(part)
        right[:] = part[self._place]
