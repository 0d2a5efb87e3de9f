# SPDX-License-Identifier: LGPL-3.0-or-later
"""Multifrontal LU factors of sparse matrices (Duff and Reid, 1983), without pivoting.

Rows that are eliminated together, and the rows to which they are coupled, form a dense matrix, a
front. The Schur complement of its other rows is added to the front that eliminates the first of
them. Rows that are not to be eliminated form the last front, which becomes their Schur complement.

Rows shared between ranks need this complement. PETSc's LU computes none, and petsc4py has no call
for that of MUMPS. Where no rows are shared, a factorisation and two solves take 58, 205, 761 and
2760 us for 108, 300, 768 and 1728 rows of grids, in PETSc's LU 28, 165, 863 and 3840 us, and in
MUMPS 140, 377, 1180 and 3070 us (``tests/benchmarks/fronts_against_petsc.py``).
"""

from typing import NamedTuple

from petsc4py import PETSc

import numpy as np

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.core.runs import starts
from flexfem.kernels.compiled import kernel, subroutine, summed
from flexfem.solvers.linear.front_elimination import copy, eliminate

__all__ = ["Fronts", "deepest", "distinct_pairs", "elimination", "gathered", "ordering"]

#: Limits for merging fronts: difference of their other rows, number of eliminated rows, and the
#: part of these in the others: zeros cost less than further passes over the rest, until the pivots'
#: rows cost more.
_MORE, _MOST, _PART = 8, 18, 0.4
#: Pivots of a front that are solved for one after the other. Sums of what is known before are
#: vectors, which would wait for each number that was just stored.
_FEW = 8
#: Entries of a matrix whose places are found at once.
_AT_ONCE = 1_000_000


class _Tree(NamedTuple):
    """Fronts in the order of elimination.

    Attributes:
        sizes: (f,) rows of each front.
        pivots: (f,) number of them, the first ones, that it eliminates.
        parents: (f,) parent front, to which the complement is added, -1 without one.
        start: (f + 1,) first row of each front.
        rows: rows of all fronts.
        into: place of each of them in the front's parent.
        at: (f + 1,) first entry of the factors of each front.
        entry_start: (f + 1,) first matrix entry of each front.
        entries: entries of the matrix by front, numbers of 32 bits where these suffice.
        to: position of each of them in its front, likewise.
        diagonal: entries on the diagonal.
        diagonal_rows: their rows.
    """

    sizes: IntArray
    pivots: IntArray
    parents: IntArray
    start: IntArray
    rows: IntArray
    into: IntArray
    at: IntArray
    entry_start: IntArray
    entries: IndexArray
    to: IndexArray
    diagonal: IntArray
    diagonal_rows: IntArray


class Fronts:
    """Factors of a matrix of which some rows are eliminated.

    Attributes:
        complement: (n, n) Schur complement of the remaining rows, after :meth:`factor`.
        operations: numbers of floating-point operations of a factorisation and of a solve, about.
    """

    kind = "multifrontal"

    def __init__(self, i: IndexArray, j: IndexArray, order: IntArray, size: int) -> None:
        """Set up the fronts.

        Args:
            i: row of every entry.
            j: its column; the pattern is taken as symmetric.
            order: the rows to eliminate, which come first, in a sequence of small fill.
            size: number of rows.
        """
        count = len(order)
        position = np.arange(size)
        position[order] = np.arange(count)
        touched, sequence = elimination(i, j, position, count)
        position[order[sequence]] = np.arange(count)
        fronts, pivots = gathered(touched, size)
        owner = np.repeat(np.arange(len(fronts)), [m or size - count for m in pivots])
        self._tree = _tree(fronts, pivots, owner, position, i, j)
        self._values = np.zeros(self._tree.at[-1])
        largest = int(self._tree.sizes.max(initial=0))
        self._front, self._work = np.zeros(largest**2), np.zeros(largest)
        self._stack = np.zeros(deepest(self._tree.sizes - self._tree.pivots, self._tree.parents))
        self._scales = np.zeros(size)
        self.complement = np.zeros((size - count, size - count))
        m, n = self._tree.pivots.astype(float), self._tree.sizes - self._tree.pivots
        products = float(2.0 * (m * (m**2 / 3.0 + n * (m + n))).sum())
        self.operations = products, 2.0 * len(self._values)

    def factor(self, values: FloatArray) -> bool:
        """Factorise the matrix of these entries, duplicates summed; False if a pivot vanishes."""
        regular: bool = _factor(
            self._tree,
            values,
            self._front,
            self._stack,
            self._scales,
            self._values,
            self.complement,
        )
        return regular

    def reduce(self, x: FloatArray) -> None:
        """Eliminate from a right-hand side: the remaining rows get that of the complement."""
        _reduce(self._tree, self._values, self._work, x)

    def complete(self, x: FloatArray) -> None:
        """Solve for the eliminated rows after :meth:`reduce`; the others contain their solution."""
        _complete(self._tree, self._values, self._work, x)


def ordering(kind: str, i: IndexArray, j: IndexArray, size: int) -> IntArray:
    """Sequence of elimination of the rows of a matrix with the given entries, in order.

    Args:
        kind: PETSc's name of the method.
        i: row of every entry, ascending.
        j: its column.
        size: number of rows.
    """
    pattern = starts(np.bincount(i, minlength=size)), j
    start, column = (index.astype(PETSc.IntType) for index in pattern)
    matrix = PETSc.Mat().createAIJ(
        (size, size), csr=(start, column, np.ones(len(j))), comm=PETSc.COMM_SELF
    )
    return np.array(matrix.getOrdering(kind)[0].getIndices(), dtype=np.int64)


def distinct_pairs(i: IndexArray, j: IndexArray, size: int) -> tuple[IndexArray, IndexArray]:
    """Pairs of numbers below ``size``, each once, in order."""
    keys = i.astype(np.int64)
    keys *= size
    keys += j
    keys.sort()
    new = np.ones(len(keys), dtype=np.bool_)
    np.not_equal(keys[1:], keys[:-1], out=new[1:])
    keys = keys[new]
    row = (keys // size).astype(np.int32)
    keys %= size
    return row, keys.astype(np.int32)


def elimination(
    i: IndexArray, j: IndexArray, position: IntArray, count: int
) -> tuple[list[IntArray], IntArray]:
    """Rows coupled to each eliminated row at its elimination, in a postorder of the tree.

    Args:
        i: row of every entry.
        j: its column.
        position: of every row in the order of elimination.
        count: number of eliminated rows.

    Returns:
        Sorted later rows of each eliminated row, and the old positions of the eliminated rows, both
        in a new order of these with children before their parents.
    """
    size = len(position)
    a, b = distinct_pairs(i, j, size)
    a, b = position[a], position[b]
    a, b = np.minimum(a, b), np.maximum(a, b)
    a, b = distinct_pairs(a[a != b], b[a != b], size)
    first = np.searchsorted(a, np.arange(size + 1)).tolist()
    children: list[list[int]] = [[] for _ in range(size)]
    roots: list[int] = []
    later, waiting = list[IntArray](), dict[int, set[int]]()  # sets until their parents take them
    for k in range(count):
        rows = set(b[first[k] : first[k + 1]].tolist())
        for child in children[k]:
            rows |= waiting.pop(child)
        rows.discard(k)
        later.append(np.fromiter(rows, np.int64, len(rows)))
        parent = min(rows, default=size)
        if parent < count:
            waiting[k] = rows
        (children[parent] if parent < count else roots).append(k)
    sequence = []
    while roots:
        sequence.append(roots.pop())
        roots += children[sequence[-1]]
    sequence.reverse()
    position = np.arange(size)
    position[sequence] = np.arange(count)
    touched = [np.sort(position[later[k]]) for k in sequence]
    return touched, np.array(sequence, dtype=np.int64)


def gathered(
    touched: list[IntArray], size: int, more: int = _MORE, most: int = _MOST, part: float = _PART
) -> tuple[list[IntArray], list[int]]:
    """Rows of every front, and the number that it eliminates; the last has the remaining rows.

    A row is merged into the front of the row before it if both have nearly the same rows, and
    always if they have the same ones.

    Args:
        touched: later rows to which each eliminated row is coupled, as of :func:`elimination`.
        size: number of rows.
        more: limit of the difference of their other rows.
        most: number of eliminated rows of a front that are always merged.
        part: the same as a part of the other rows.
    """
    fronts, pivots = [], []
    first = 0
    for k, rows in enumerate(touched):
        follows = k + 1 < len(touched) and len(rows) > 0 and rows[0] == k + 1
        zeros = 1 + len(touched[k + 1]) - len(rows) if follows else size
        if zeros > more or (zeros and k + 1 >= first + max(most, int(part * len(rows)))):
            fronts.append(np.concatenate([np.arange(first, k + 1), rows]).astype(np.int64))
            pivots.append(k + 1 - first)
            first = k + 1
    if size > len(touched):
        fronts.append(np.arange(len(touched), size))
        pivots.append(0)
    return fronts, pivots


def _tree(
    fronts: list[IntArray], pivots: list[int], owner: IntArray, position: IntArray, i: IndexArray,
    j: IndexArray,
) -> _Tree:  # fmt: skip
    """The fronts in arrays.

    Args:
        fronts: positions of the rows of each front, ascending.
        pivots: number of eliminated unknowns.
        owner: front of every position.
        position: of every row.
        i: row of every entry.
        j: its column.
    """
    sizes, numbers = np.array([len(front) for front in fronts], dtype=np.int64), np.array(pivots)
    start, listed = starts(sizes), np.concatenate(fronts)
    size = len(position)
    keys = np.repeat(np.arange(len(fronts)), sizes) * size + listed  # ascending

    def places(front: IntArray, row: IntArray) -> IntArray:
        """Places of positions in fronts that contain them."""
        return np.asarray(np.searchsorted(keys, front * size + row) - start[front])

    has_rest = (numbers > 0) & (numbers < sizes)
    parents = np.full(len(fronts), -1, dtype=np.int64)
    parents[has_rest] = owner[listed[(start[:-1] + numbers)[has_rest]]]
    rest = np.arange(len(listed)) - np.repeat(start[:-1] + numbers, sizes) >= 0
    rest &= np.repeat(has_rest, sizes)
    into = np.full(len(listed), -1, dtype=np.int64)
    into[rest] = places(np.repeat(parents, sizes)[rest], listed[rest])
    first = owner[np.minimum(position[i], position[j])]
    # read at every factorisation, and most of the memory beside values and factors
    largest = max(len(i), int(sizes.max(initial=0)) ** 2)
    kind: type[np.signedinteger] = np.int32 if largest <= np.iinfo(np.int32).max else np.int64
    entries, to = np.argsort(first, kind="stable").astype(kind), np.empty(len(i), dtype=kind)
    for k in range(0, len(i), _AT_ONCE):
        some = slice(k, k + _AT_ONCE)
        front = first[entries[some]]
        row, column = (places(front, position[rows[entries[some]]]) for rows in (i, j))
        to[some] = row * sizes[front] + column
    diagonal = np.flatnonzero(i == j)
    return _Tree(
        sizes=sizes,
        pivots=numbers,
        parents=parents,
        start=start,
        rows=np.argsort(position)[listed],
        into=into,
        at=starts(numbers * (2 * sizes - numbers)),
        entry_start=starts(np.bincount(first, minlength=len(fronts))),
        entries=entries,
        to=to,
        diagonal=diagonal,
        diagonal_rows=i[diagonal].astype(np.int64),
    )


def deepest(sizes: IntArray, parents: IntArray) -> int:
    """Largest size of the stack of complements during the elimination, in entries.

    Args:
        sizes: rows of the complement of each front.
        parents: front that takes it, -1 without one; the fronts are in a postorder.
    """
    waiting: list[tuple[int, int]] = []
    total = most = 0
    for f, parent in enumerate(parents.tolist()):
        while waiting and waiting[-1][0] == f:
            total -= waiting.pop()[1]
        if parent >= 0:
            waiting.append((parent, int(sizes[f]) ** 2))
            total += waiting[-1][1]
        most = max(most, total)
    return most


@kernel
def _factor(
    tree: _Tree, entries: FloatArray, work: FloatArray, stack: FloatArray, scales: FloatArray,
    values: FloatArray, complement: FloatArray,
) -> bool:  # fmt: skip
    """Eliminate the pivots of all fronts.

    The factors of a front are the rows of its pivots, then their columns in its other rows.
    """
    waiting = np.empty(tree.sizes.size, dtype=np.int64)
    _scale(tree, entries, scales)
    depth = top = 0
    for f in range(tree.sizes.size):
        n, m = tree.sizes[f], tree.pivots[f]
        F = work[: n * n].reshape(n, n)
        F[:] = 0.0
        for k in range(tree.entry_start[f], tree.entry_start[f + 1]):
            work[tree.to[k]] += entries[tree.entries[k]]
        while depth > 0 and tree.parents[waiting[depth - 1]] == f:
            depth -= 1
            top = _take_over(tree, waiting[depth], stack, top, F)
        upper = values[tree.at[f] : tree.at[f] + m * n].reshape(m, n)
        lower = values[tree.at[f] + m * n : tree.at[f + 1]].reshape(m, n - m)
        if not eliminate(F, scales[tree.rows[tree.start[f] : tree.start[f + 1]]], upper, lower):
            return False
        if tree.parents[f] >= 0:
            waiting[depth] = f
            depth += 1
            rest = (n - m) * (n - m)
            copy(F[m:, m:], stack[top : top + rest].reshape(n - m, n - m))
            top += rest
        elif m == 0:
            copy(F, complement)
    return True


@subroutine
def _scale(tree: _Tree, entries: FloatArray, scales: FloatArray) -> None:
    """Write the square roots of the diagonal of the matrix, one for each row."""
    scales[:] = 0.0
    for k in range(tree.diagonal.size):
        scales[tree.diagonal_rows[k]] += entries[tree.diagonal[k]]
    for row in range(scales.size):
        scales[row] = np.sqrt(abs(scales[row]))


@subroutine
def _take_over(tree: _Tree, child: int, stack: FloatArray, top: int, F: FloatArray) -> int:
    """Add the complement of a front on top of the stack to its parent's; the new top."""
    m = tree.sizes[child] - tree.pivots[child]
    top -= m * m
    into = tree.into[tree.start[child + 1] - m : tree.start[child + 1]]
    for i in range(m):
        row = F[into[i]]
        for j in range(m):
            row[into[j]] += stack[top + i * m + j]
    return top


@summed
def _reduce(tree: _Tree, values: FloatArray, work: FloatArray, x: FloatArray) -> None:
    """Forward substitution."""
    for f in range(tree.sizes.size):
        n, m, at = tree.sizes[f], tree.pivots[f], tree.at[f]
        rows = tree.rows[tree.start[f] : tree.start[f + 1]]
        for i in range(n):
            work[i] = x[rows[i]]
        for begin in range(0, m, _FEW):
            end = min(begin + _FEW, m)
            for p in range(begin, end):
                row, total = values[at + p * n :], work[p]
                for k in range(begin):
                    total -= row[k] * work[k]
                work[p] = total
            for p in range(begin, end):
                total = work[p]
                for k in range(begin, p):
                    total -= values[at + p * n + k] * work[k]
                work[p] = total
        lower, others = at + m * n, work[m:n]
        for p in range(0, m - m % 4, 4):
            a, b = values[lower + p * (n - m) :], values[lower + (p + 1) * (n - m) :]
            c, d = values[lower + (p + 2) * (n - m) :], values[lower + (p + 3) * (n - m) :]
            for i in range(n - m):
                others[i] -= (
                    a[i] * work[p] + b[i] * work[p + 1] + c[i] * work[p + 2] + d[i] * work[p + 3]
                )
        for p in range(m - m % 4, m):
            a = values[lower + p * (n - m) :]
            for i in range(n - m):
                others[i] -= a[i] * work[p]
        for i in range(n):
            x[rows[i]] = work[i]


@summed
def _complete(tree: _Tree, values: FloatArray, work: FloatArray, x: FloatArray) -> None:
    """Backward substitution."""
    for f in range(tree.sizes.size - 1, -1, -1):
        n, m, at = tree.sizes[f], tree.pivots[f], tree.at[f]
        rows = tree.rows[tree.start[f] : tree.start[f + 1]]
        for i in range(n):
            work[i] = x[rows[i]]
        for begin in range(m - 1 - (m - 1) % _FEW, -1, -_FEW):
            end = min(begin + _FEW, m)
            later = work[end:n]
            for p in range(begin, end):
                row, total = values[at + p * n + end :], work[p]
                for j in range(n - end):
                    total -= row[j] * later[j]
                work[p] = total
            for p in range(end - 1, begin - 1, -1):
                total = work[p]
                for j in range(p + 1, end):
                    total -= values[at + p * n + j] * work[j]
                work[p] = total / values[at + p * n + p]
        for p in range(m):
            x[rows[p]] = work[p]
