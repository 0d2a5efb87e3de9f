# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interface system: the dual Schur complement of the multipliers, distributed over the ranks.

Every rank has the entries between the rows that it evaluates. It eliminates its unshared rows; the
complements on the rows shared with other ranks are summed and eliminated by levels of a tree of the
ranks (``rank_dissection``).
"""

from typing import Any, Protocol

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.kernels.compiled import kernel
from flexfem.kernels.sequence import Call, Step
from flexfem.solvers.linear.banded import (
    band_backward,
    band_eliminate,
    band_factor,
    band_forward,
    band_solve,
)
from flexfem.solvers.linear.dense_elimination import DenseElimination
from flexfem.solvers.linear.multifrontal import Fronts, distinct_pairs, ordering
from flexfem.solvers.linear.rank_dissection import RankDissection

__all__ = ["InterfaceSystem"]

#: Part of all entries from which LAPACK's dense factors are faster than any sparse ones.
_FULL = 0.4
#: Rows that are added in the order of elimination, to which those left are coupled.
_ADDED = 300
#: Half bandwidth, and number of rows that are left, up to which a banded factorisation is faster
#: than a multifrontal one.
_WIDEST = 64

#: A compiled loop and its arguments.
_Loop = tuple[Any, ...]


class _Elimination(Protocol):
    """Elimination of the first rows of a matrix.

    Attributes:
        kind: name of the method.
        complement: (n, n) Schur complement of the other rows, after :meth:`factor`.
        operations: numbers of floating-point operations of a factorisation and of a solve, about.
    """

    @property
    def kind(self) -> str:
        """See above."""
        ...

    @property
    def operations(self) -> tuple[float, float]:
        """See above."""
        ...

    @property
    def complement(self) -> FloatArray:
        """See above."""
        ...

    def factor(self, values: FloatArray) -> bool:
        """Factorise the matrix of the given entries; False if it is singular."""
        ...

    def reduce(self, x: FloatArray) -> None:
        """Eliminate from a right-hand side: the other rows get that of the complement."""
        ...

    def complete(self, x: FloatArray) -> None:
        """Solve for the first rows after :meth:`reduce`; the others contain their solution."""
        ...


@kernel
def _scatter(index: IntArray, select: IntArray, values: FloatArray, out: FloatArray) -> None:
    """Sums of the selected values: ``out[index[k]] += values[select[k]]`` from zero on."""
    out[:] = 0.0
    for k in range(index.size):
        out[index[k]] += values[select[k]]


class Band:
    """Elimination in an order of Cuthill and McKee: narrow bands for chains and trees."""

    kind = "banded"

    def __init__(self, i: IntArray, j: IntArray, order: IntArray, half: int, size: int) -> None:
        """Entries (i, j), order of the first rows, their half bandwidth then, number of rows."""
        count = len(order)
        left = size - count
        rank = np.empty(size, dtype=np.int64)
        rank[order], rank[count:] = np.arange(count), np.arange(left)
        first, last = i < count, j < count
        self._order, self._work, self._left = order, np.empty(count), left
        self._band = np.zeros((count, 2 * half + 1))
        self._index = rank[i] * (2 * half + 1) + rank[j] - rank[i] + half
        self._index[~(first & last)] = -1
        right, below = first & ~last, ~first & last
        coupled = np.concatenate([rank[i[right]], rank[j[below]]])
        self._begin = begin = int(coupled.min(initial=count))
        self._blocks = []
        for rows, row, column, shape in (
            (right, rank[i] - begin, rank[j], (count - begin, left)),
            (below, rank[j] - begin, rank[i], (count - begin, left)),
            (~first & ~last, rank[i], rank[j], (left, left)),
        ):
            select = np.flatnonzero(rows)
            index = row[select] * left + column[select]
            self._blocks.append((index, select, np.zeros(shape)))
        self._right, self._below, self.complement = (block[2] for block in self._blocks)
        tail = float(count - begin)
        self.operations = (
            4.0 * count * half**2 + tail * left * (4.0 * half + 2.0 * left),
            4.0 * count * half + 4.0 * tail * left,
        )

    def factor(self, values: FloatArray) -> bool:
        """See :class:`_Elimination`."""
        regular: bool = band_factor(self._index, values, self._band)
        if regular:
            for loop, *arguments in self._eliminating(values):
                loop(*arguments)
        return regular

    def factorisation(self, values: FloatArray) -> list[Call]:
        """What :meth:`factor` does with these values; the first call returns what it returns."""
        test = Call(band_factor, self._index, values, self._band)
        return [test, *(Call(*one) for one in self._eliminating(values))]

    def _eliminating(self, values: FloatArray) -> list[_Loop]:
        """What follows the factorisation of the band, if other rows are left."""
        if not self._left:
            return []
        couplings = self._right, self._below, self.complement
        return [
            *((_scatter, at, select, values, out.reshape(-1)) for at, select, out in self._blocks),
            (band_eliminate, self._band, self._begin, *couplings),
        ]

    def reduce(self, x: FloatArray) -> None:
        """See :class:`_Elimination`."""
        loop, *arguments = self._reducing(x)
        loop(*arguments)

    def _reducing(self, x: FloatArray) -> _Loop:
        """What :meth:`reduce` does; the whole solve if no other rows are left."""
        own = self._band, self._order, self._work
        if not self._left:
            return band_solve, *own, x
        return band_forward, *own, self._begin, self._below, x

    def complete(self, x: FloatArray) -> None:
        """See :class:`_Elimination`."""
        for loop, *arguments in self._completing(x):
            loop(*arguments)

    def _completing(self, x: FloatArray) -> list[_Loop]:
        """What :meth:`complete` does."""
        if not self._left:
            return []
        own = self._band, self._order, self._work
        return [(band_backward, *own, self._begin, self._right, x)]

    def solution(self, x: FloatArray) -> tuple[list[Call], list[Call]]:
        """What :meth:`reduce` and :meth:`complete` do."""
        return [Call(*self._reducing(x))], [Call(*one) for one in self._completing(x)]


class _Dense(DenseElimination):
    """Elimination by LAPACK: bodies that are bonded by many nodes couple all of their rows."""

    kind = "dense"

    def __init__(self, i: IntArray, j: IntArray, count: int, size: int) -> None:
        """Entries (i, j), number of the first rows, number of rows."""
        super().__init__(count, size)
        self._index, self._size = i * size + j, size

    def factor(self, values: FloatArray) -> bool:
        """See :class:`_Elimination`."""
        size = self._size
        return self.eliminate(np.bincount(self._index, values, size * size).reshape(size, size))


def _is_full(first: IndexArray, second: IndexArray, count: int) -> bool:
    """True if the entries fill most of a matrix that is not small."""
    if count <= _WIDEST or len(first) < _FULL * count**2:
        return False
    filled = np.zeros((count, count), dtype=np.bool_)
    filled[first, second] = True
    return bool(filled.mean() >= _FULL)


def _directed(
    order: IntArray, i: IndexArray, j: IndexArray, grounded: BoolArray, coupled: BoolArray
) -> IntArray:
    """Turn an order round in some of its connected components.

    The pivot of a joint is the mobility of what it connects, as far as it has been eliminated. From
    the ground outwards it is that of the next body at least. Towards the ground it is in the end
    that of a free chain of n bodies alone, 1 / n^3 of a body's, which is left of terms of a body's:
    round-off beyond some 100,000 of them. Components that the ground does not hold end at the rows
    that are coupled to rows outside of the order, so that these meet the last pivots alone.

    Args:
        order: of the rows, in which the components follow one another.
        i: row of every entry.
        j: its column.
        grounded: True for the rows at the ground.
        coupled: True for those that are coupled to rows which are not in the order.
    """
    place = np.arange(len(order))
    rank = np.empty_like(order)
    rank[order] = place
    reach = place.copy()
    np.maximum.at(reach, rank[i], rank[j])
    last = np.flatnonzero(np.maximum.accumulate(reach) == place)
    begin = np.append(0, last + 1)[:-1]

    def distances(chosen: BoolArray) -> IntArray:
        """From the ends of each component to the next of some rows, len(order) without one."""
        at = rank[chosen]
        component = np.searchsorted(last, at)
        found = np.full((2, len(last)), len(order))
        np.minimum.at(found[0], component, at - begin[component])
        np.minimum.at(found[1], component, last[component] - at)
        return found

    ground, others = distances(grounded), distances(coupled)
    held = ground[0] < len(order)
    turned = np.where(held, ground[1] < ground[0], others[0] < others[1])
    component = np.searchsorted(last, place)
    return order[np.where(turned[component], (begin + last)[component] - place, place)]


def _elimination(
    i: IndexArray, j: IndexArray, count: int, size: int, grounded: BoolArray
) -> _Elimination:
    """Elimination of the first rows: dense, banded if their order allows it, or by fronts."""
    rows, columns = distinct_pairs(i, j, size)
    inner = (rows < count) & (columns < count)
    first, second = (rows, columns) if inner.all() else (rows[inner], columns[inner])
    if _is_full(first, second, count):
        return _Dense(i.astype(np.int64), j.astype(np.int64), count, size)
    order = ordering("rcm", first, second, count)
    rank = np.empty(count, dtype=np.int32)
    rank[order] = np.arange(count)
    half = int(np.abs(rank[first] - rank[second]).max(initial=0))
    if max(half, size - count) <= _WIDEST:
        coupled = np.zeros(count, dtype=np.bool_)
        coupled[rows[(rows < count) & (columns >= count)]] = True
        order = _directed(order, first, second, grounded[:count], coupled)
        return Band(i.astype(np.int64), j.astype(np.int64), order, half, size)
    del first, second, inner  # there may be very many
    # minimum degree: for some thousand rows of trees, lattices and grids less fill than dissection;
    # the other rows are coupled to each other and to more rows than most of the first ones, so that
    # they come late, and what is coupled to them
    others = np.arange(count, size + (_ADDED if size > count else 0))
    full = np.repeat(others, len(others)), np.tile(others, len(others))
    rows, columns = np.concatenate([rows, full[0]]), np.concatenate([columns, full[1]])
    number = count + len(others)
    order = ordering("qmd", *distinct_pairs(rows, columns, number), number)
    del rows, columns
    return Fronts(i, j, order[order < count], size)


class InterfaceSystem:
    """Solver of the multipliers' system.

    Attributes:
        kind: name of the method that eliminates this rank's unshared rows.
        largest_front: number of rows of the largest front of shared rows of this rank.
    """

    def __init__(
        self, comm: MPI.Intracomm, i: IndexArray, j: IndexArray, interior: int,
        shared: IntArray, holders: IntArray, grounded: BoolArray | None = None,
    ) -> None:  # fmt: skip
        """Set up the pattern (collective).

        Args:
            comm: communicator.
            i: row of every entry, numbered on this rank.
            j: its column.
            interior: number of rows of this rank alone, the first ones.
            shared: number of each other row, the same on all ranks that have it.
            holders: number of these ranks.
            grounded: True for the rows of this rank that act on the ground; None for no rows.
        """
        self._count = interior
        if grounded is None:
            grounded = np.zeros(interior + len(shared), dtype=np.bool_)
        self._own = _elimination(i, j, interior, interior + len(shared), grounded)
        self.kind = self._own.kind if interior else ""
        self._shared = RankDissection(comm, shared, holders) if comm.size > 1 else None
        self.largest_front = 0 if self._shared is None else self._shared.largest_front

    @property
    def operations(self) -> tuple[float, float]:
        """Floating-point operations of a factorisation and of a solve on this rank, about."""
        counts = [self._own.operations]
        if self._shared is not None:
            counts.append(self._shared.operations)
        return sum(count[0] for count in counts), sum(count[1] for count in counts)

    @property
    def band(self) -> Band | None:
        """The factors of this rank's unshared rows if these are a narrow band."""
        return self._own if isinstance(self._own, Band) else None

    @property
    def alone(self) -> bool:
        """True if there are no other ranks."""
        return self._shared is None

    def factor(self, values: FloatArray, regular: bool = True) -> bool:
        """Factorise (collective); False on all ranks when the system is singular on one.

        Args:
            values: one number per entry of the pattern.
            regular: False if this rank's part is singular.
        """
        return self.factor_shared(self._own.factor(values) and regular)

    def factor_and_solve(self, values: FloatArray, regular: bool, right: FloatArray) -> bool:
        """What :meth:`factor` and :meth:`solve` do, with half of their messages (collective)."""
        regular = self._own.factor(values) and regular
        if regular:
            self._own.reduce(right)
        if self._shared is not None:
            part = right[self._count :]
            regular = self._shared.factor_and_solve(self._own.complement, regular, part)
        if regular:
            self._own.complete(right)
        return regular

    def factor_shared(self, regular: bool) -> bool:
        """Second part of :meth:`factor`, after the elimination of the unshared rows."""
        if self._shared is None:
            return regular
        return self._shared.factor(self._own.complement, regular)

    def solve(self, right: FloatArray) -> None:
        """Solve in place for this rank's part of the right-hand side (collective if shared)."""
        self._own.reduce(right)
        if self._shared is not None:
            self._shared.solve(right[self._count :])
        self._own.complete(right)

    def solution(self, right: FloatArray, regular: BoolArray | None = None) -> list[Step]:
        """What :meth:`solve` does for this array, if the unshared rows are a narrow ``band``.

        Args:
            right: the array.
            regular: (1,) True if this rank's factors have become regular, for what
                :meth:`factor_shared` and :meth:`solve` do; True if all have, then.
        """
        assert self.band is not None
        (reduce, complete), shared = self.band.solution(right), self._shared
        if shared is None:
            return [*reduce, *complete]
        part = right[self._count :]
        if regular is None:
            return [*reduce, lambda: shared.solve(part), *complete]
        complement, all_regular = self.band.complement, regular

        def factor_and_solve() -> None:
            all_regular[0] = shared.factor_and_solve(complement, bool(all_regular[0]), part)

        return [*reduce, factor_and_solve, *complete]
