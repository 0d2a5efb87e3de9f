# SPDX-License-Identifier: LGPL-3.0-or-later
"""Multifrontal factors of a symmetric positive definite matrix of small blocks, without pivoting.

Rows of a node are eliminated together; some nodes are left, as the interface of a body, and get
their Schur complement. Forward and backward substitution are calls of their own, so that what is
between them, the interface, may be solved for with other bodies. They read each number of the
factors once for all of their right-hand sides, in the order in which these lie in memory.
"""

import numpy as np

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.core.runs import starts
from flexfem.kernels.compiled import kernel, subroutine
from flexfem.kernels.records import Index1D, Int1D, Memory, Record, unpack
from flexfem.solvers.linear.front_elimination import copy, eliminate_pivots, subtract_products
from flexfem.solvers.linear.multifrontal import deepest, elimination, gathered, ordering

__all__ = ["NodeTree", "SymmetricFronts"]

#: Nodes that a front may have more than the next one with which it is merged: zeros, against calls
#: for small fronts.
_MORE = 4
#: Pivot relative to the diagonal entry before elimination that counts as zero.
_ZERO = 1e-14
#: Difference of entries, relative to the diagonal, of matrices that are the same up to round-off.
_SAME = 1e-12
#: Entries of a block of factors from which BLAS multiplies with it: a call costs as much as some.
_CALL = 256


class Tree(Record):
    """Fronts of nodes in the order of elimination.

    Attributes:
        width: rows of a node.
        eliminated: number of eliminated nodes, the first ones; the others are the last front.
        order: (n,) node at each place of the order.
        places: (n,) place of each node.
        first: (f + 1,) place of the first node that each front eliminates.
        row_start: (f + 1,) first of its other nodes in ``rows``.
        rows: their places, ascending.
        parents: (f,) front that takes the complement of each, -1 without one.
        at: (f + 1,) first entry of the factors of each front.
        entry_start: (width n + 1,) first entry of each row of the matrix.
        columns: column of each entry.
    """

    width: int
    eliminated: int
    order: Int1D
    places: Int1D
    first: Int1D
    row_start: Int1D
    rows: Int1D
    parents: Int1D
    at: Int1D
    entry_start: Int1D
    columns: Index1D


class NodeTree:
    """Fronts of a pattern, which matrices of equal patterns share.

    Attributes:
        tree: the fronts, for the loops.
        left: (k,) nodes that are not eliminated.
    """

    def __init__(self, start: IndexArray, columns: IndexArray, width: int, left: IntArray) -> None:
        """Set up the fronts.

        Args:
            start: first entry of each row of the matrix, and the end; rows of a node follow one
                another.
            columns: column of each entry.
            width: rows of a node.
            left: nodes that are not eliminated, in the order of the complement.
        """
        self._start, self._columns, self.left = start, columns, left
        count = (len(start) - 1) // width
        row = np.repeat(np.arange(len(start) - 1), np.diff(start))
        key = np.unique((row // width) * count + columns // width)
        i, j = key // count, key % count
        inner = np.setdiff1d(np.arange(count), left)
        order = np.concatenate([inner[_dissection(i, j, inner, count)], left])
        places = np.empty(count, dtype=np.int64)
        places[order] = np.arange(count)
        touched, sequence = elimination(i, j, places, len(inner))
        order[: len(inner)] = order[: len(inner)][sequence]
        places[order] = np.arange(count)
        fronts, pivots = gathered(touched, count, _MORE, count)
        if len(left):
            pivots[-1] = len(left)
        first = starts(pivots)
        owner = np.repeat(np.arange(len(fronts)), pivots)
        others = [front[m:] for front, m in zip(fronts, pivots, strict=True)]
        sizes = np.array([len(other) for other in others], dtype=np.int64)
        parents = np.array([owner[other[0]] if len(other) else -1 for other in others])
        m, r = width * np.array(pivots, dtype=np.int64), width * sizes
        stored = m * (m + r)
        if len(left):
            stored[-1] = 0  # the complement is not among the factors
        self.tree = Tree(
            width=width,
            eliminated=len(inner),
            order=order,
            places=places,
            first=first,
            row_start=starts(sizes),
            rows=np.concatenate([np.empty(0, np.int64), *others]).astype(np.int64),
            parents=parents.astype(np.int64),
            at=starts(stored),
            entry_start=start.astype(np.int64),
            columns=columns.astype(np.int32),
        )
        self._largest = int((m + r).max(initial=0))
        self._deepest = deepest(r, parents)

    def fits(self, start: IndexArray, columns: IndexArray, left: IntArray) -> bool:
        """True if a matrix has this pattern, and these nodes are left."""
        return (
            np.array_equal(start, self._start)
            and np.array_equal(columns, self._columns)
            and np.array_equal(left, self.left)
        )

    def signs(self, values: FloatArray, others: FloatArray) -> FloatArray | None:
        """Signs (width,) of components by which a matrix becomes another one; None if by none.

        Args:
            values: entries of the matrix.
            others: those of the other one, the same up to round-off relative to the diagonal.
        """
        width = self.tree.width
        scales, products = np.empty(len(self._start) - 1), np.zeros((width, width))
        _compare(self.tree.memory, values, others, scales, products)
        found = np.zeros(width)
        found[0] = 1.0
        while not found.all():  # by the largest products: others are those of round-off
            new = np.outer(found != 0.0, found == 0.0)
            weights = np.where(new, np.abs(products), -1.0)
            i, j = np.unravel_index(weights.argmax(), weights.shape)
            found[j] = found[i] * (-1.0 if products[i, j] < 0.0 else 1.0)
        return found if _same(self.tree.memory, values, others, scales, found) else None

    def room(self) -> tuple[FloatArray, FloatArray]:
        """Memory for a factorisation: the largest front, and complements that wait for theirs."""
        return np.empty(self._largest**2), np.empty(self._deepest)


class SymmetricFronts:
    """Factors of one matrix.

    Attributes:
        nodes: its fronts.
        complement: (k width, k width) Schur complement of the nodes that are left.
    """

    def __init__(self, nodes: NodeTree, values: FloatArray) -> None:
        """Factorise the matrix of these entries, of which one triangle is read.

        Raises:
            ArithmeticError: It is not positive definite.
        """
        self.nodes, self._memory = nodes, nodes.tree.memory
        self._factors = np.empty(nodes.tree.at[-1])
        rows = nodes.tree.width * len(nodes.left)
        self.complement = np.empty((rows, rows))
        if not _factor(self._memory, values, *nodes.room(), self._factors, self.complement):
            raise ArithmeticError("the matrix is not positive definite")
        lower = np.tril_indices(rows, -1)
        self.complement[lower] = self.complement.T[lower]

    def room(self, count: int) -> FloatArray:
        """Memory for so many right-hand sides that are solved for together: (count, n width)."""
        return np.empty((count, len(self.nodes.tree.order) * self.nodes.tree.width))

    def reduce(self, right: FloatArray, moved: FloatArray) -> FloatArray:
        """Eliminate from right-hand sides (s, n, width), in memory of :meth:`room`.

        Returns:
            Right-hand sides (s, k width) of the complement.
        """
        _reduce(self._memory, self._factors, right, moved)
        return moved[:, moved.shape[1] - self.nodes.tree.width * len(self.nodes.left) :].copy()

    def complete(self, left: FloatArray, moved: FloatArray, solution: FloatArray) -> None:
        """Solutions (s, n, width) after :meth:`reduce`, given those (s, k width) of the others."""
        moved[:, moved.shape[1] - left.shape[1] :] = left
        _complete(self._memory, self._factors, moved, solution)


def _dissection(i: IntArray, j: IntArray, inner: IntArray, count: int) -> IntArray:
    """Sequence of elimination of some nodes of a graph, by nested dissection."""
    place = np.full(count, -1)
    place[inner] = np.arange(len(inner))
    kept = (place[i] >= 0) & (place[j] >= 0)
    return ordering("nd", place[i[kept]], place[j[kept]], len(inner))


@kernel
def _factor(
    memory: Memory, values: FloatArray, work: FloatArray, stack: FloatArray, factors: FloatArray,
    complement: FloatArray,
) -> bool:  # fmt: skip
    """Eliminate all fronts but the last one, which becomes the complement.

    The factors of a front are the upper triangle of its pivots, and its rows to the other columns.
    """
    tree = unpack(Tree, memory)
    width, fronts = tree.width, tree.parents.size
    local = np.zeros(tree.order.size, dtype=np.int64)  # first row of each node in the front
    waiting = np.empty(fronts, dtype=np.int64)
    over, least = np.empty((2, width * np.diff(tree.first).max()))
    depth = top = 0
    for f in range(fronts):
        a, e = tree.first[f], tree.first[f + 1]
        rest = tree.rows[tree.row_start[f] : tree.row_start[f + 1]]
        m, r = width * (e - a), width * rest.size
        n = m + r
        F = work[: n * n].reshape(n, n)
        F[:] = 0.0
        for k in range(a, e):
            local[k] = width * (k - a)
        for k in range(rest.size):
            local[rest[k]] = m + width * k
        _assemble(memory, values, a, e, local, F)
        while depth > 0 and tree.parents[waiting[depth - 1]] == f:
            depth -= 1
            child = waiting[depth]
            own = tree.rows[tree.row_start[child] : tree.row_start[child + 1]]
            count = width * own.size
            top -= count * count
            _take_over(stack[top : top + count * count].reshape(count, count), own, local, width, F)
        if a == tree.eliminated:
            complement[:] = F
            continue
        for p in range(m):
            least[p] = _ZERO * F[p, p]
        if not eliminate_pivots(F[:m], over[:m], least[:m]):
            return False
        at = tree.at[f]
        pivots = factors[at : at + m * m].reshape(m, m)
        others = factors[at + m * m : tree.at[f + 1]].reshape(m, r)
        for i in range(m):
            if not over[i] > 0.0:
                return False
            root = np.sqrt(over[i])
            for j in range(i, m):
                pivots[i, j] = root * F[i, j]
            for j in range(r):
                others[i, j] = root * F[i, m + j]
        if tree.parents[f] >= 0:
            waiting[depth] = f
            depth += 1
            subtract_products(F[:m, m:], over[:m], F[m:, m:])
            copy(F[m:, m:], stack[top : top + r * r].reshape(r, r))
            top += r * r
    return True


@subroutine
def _assemble(
    memory: Memory, values: FloatArray, a: int, e: int, local: IntArray, F: FloatArray
) -> None:
    """Add the entries of the nodes at places a to e and all later ones, of the upper triangle."""
    tree = unpack(Tree, memory)
    width = tree.width
    for k in range(a, e):
        first = width * tree.order[k]
        for c in range(width):
            row = local[k] + c
            for q in range(tree.entry_start[first + c], tree.entry_start[first + c + 1]):
                node = tree.columns[q] // width
                place = tree.places[node]
                if place >= a:
                    column = local[place] + tree.columns[q] - width * node
                    if column >= row:
                        F[row, column] += values[q]


@subroutine
def _take_over(
    given: FloatArray, own: IntArray, local: IntArray, width: int, F: FloatArray
) -> None:
    """Add the complement of a front to its parent's; ``own`` are the places of its nodes."""
    for i in range(own.size):
        for j in range(i, own.size):
            row, column = local[own[i]], local[own[j]]
            for k in range(width):
                for l in range(width):  # noqa: E741
                    F[row + k, column + l] += given[width * i + k, width * j + l]


@kernel
def _compare(
    memory: Memory, values: FloatArray, others: FloatArray, scales: FloatArray, products: FloatArray
) -> None:
    """Scales of rows, and sums of products of the entries of two matrices by their components."""
    tree = unpack(Tree, memory)
    for row in range(scales.size):
        for q in range(tree.entry_start[row], tree.entry_start[row + 1]):
            if tree.columns[q] == row:
                scales[row] = 1.0 / np.sqrt(values[q])
    for row in range(scales.size):
        for q in range(tree.entry_start[row], tree.entry_start[row + 1]):
            scale = scales[row] * scales[tree.columns[q]]
            product = (values[q] * scale) * (others[q] * scale)
            products[row % tree.width, tree.columns[q] % tree.width] += product


@kernel
def _same(
    memory: Memory, values: FloatArray, others: FloatArray, scales: FloatArray, signs: FloatArray
) -> bool:
    """True if two matrices are the same but for signs of components."""
    tree = unpack(Tree, memory)
    for row in range(scales.size):
        for q in range(tree.entry_start[row], tree.entry_start[row + 1]):
            column = tree.columns[q]
            sign = signs[row % tree.width] * signs[column % tree.width]
            missed = abs(others[q] - sign * values[q]) * scales[row] * scales[column]
            if not missed <= _SAME:
                return False
    return True


@kernel
def _reduce(memory: Memory, factors: FloatArray, right: FloatArray, x: FloatArray) -> None:
    """Forward substitution: ``x`` becomes the reduced right-hand sides, in the order of places."""
    tree = unpack(Tree, memory)
    width, sides = tree.width, x.shape[0]
    for s in range(sides):
        for k in range(tree.order.size):
            for c in range(width):
                x[s, width * k + c] = right[s, tree.order[k], c]
    pivots, others = np.empty(x.size), np.empty(x.size)
    for f in range(tree.parents.size):
        a = tree.first[f]
        if a == tree.eliminated:
            break
        rest = tree.rows[tree.row_start[f] : tree.row_start[f + 1]]
        m, r, at = width * (tree.first[f + 1] - a), width * rest.size, tree.at[f]
        y, t = pivots[: sides * m].reshape(sides, m), others[: sides * r].reshape(sides, r)
        for s in range(sides):
            for p in range(m):
                y[s, p] = x[s, width * a + p]
        for p in range(m):
            row = factors[at + p * m : at + (p + 1) * m]
            for s in range(sides):
                y[s, p] /= row[p]
                value = y[s, p]
                for i in range(p + 1, m):
                    y[s, i] -= row[i] * value
        _multiply(y, factors[at + m * m : at + m * (m + r)].reshape(m, r), t)
        for s in range(sides):
            for p in range(m):
                x[s, width * a + p] = y[s, p]
            for k in range(rest.size):
                for c in range(width):
                    x[s, width * rest[k] + c] -= t[s, width * k + c]


@subroutine
def _multiply(left: FloatArray, matrix: FloatArray, out: FloatArray) -> None:
    """Write ``left matrix`` for rows (s, m)."""
    m, r = matrix.shape
    if m * r < _CALL:
        out[:] = 0.0
        for s in range(left.shape[0]):
            for p in range(m):
                for j in range(r):
                    out[s, j] += matrix[p, j] * left[s, p]
    elif left.shape[0] == 1:
        np.dot(left[0], matrix, out[0])
    else:
        np.dot(left, matrix, out)


@kernel
def _complete(memory: Memory, factors: FloatArray, x: FloatArray, solution: FloatArray) -> None:
    """Backward substitution in ``x``, and the solutions in the order of nodes."""
    tree = unpack(Tree, memory)
    width, sides = tree.width, x.shape[0]
    pivots, others = np.empty(x.size), np.empty(x.size)
    for f in range(tree.parents.size - 1, -1, -1):
        a = tree.first[f]
        if a == tree.eliminated:
            continue
        rest = tree.rows[tree.row_start[f] : tree.row_start[f + 1]]
        m, r, at = width * (tree.first[f + 1] - a), width * rest.size, tree.at[f]
        y, t = pivots[: sides * m].reshape(sides, m), others[: sides * r].reshape(sides, r)
        for s in range(sides):
            for k in range(rest.size):
                for c in range(width):
                    t[s, width * k + c] = x[s, width * rest[k] + c]
        _multiply_transposed(t, factors[at + m * m : at + m * (m + r)].reshape(m, r), y)
        for p in range(m - 1, -1, -1):
            row = factors[at + p * m : at + (p + 1) * m]
            for s in range(sides):
                value = x[s, width * a + p] - y[s, p]
                for i in range(p + 1, m):
                    value -= row[i] * x[s, width * a + i]
                x[s, width * a + p] = value / row[p]
    for s in range(sides):
        for k in range(tree.order.size):
            for c in range(width):
                solution[s, tree.order[k], c] = x[s, width * k + c]


@subroutine
def _multiply_transposed(left: FloatArray, matrix: FloatArray, out: FloatArray) -> None:
    """Write ``left matrix^T`` for rows (s, r)."""
    m, r = matrix.shape
    if m * r < _CALL:
        for s in range(left.shape[0]):
            for p in range(m):
                total = 0.0
                for j in range(r):
                    total += matrix[p, j] * left[s, j]
                out[s, p] = total
    elif left.shape[0] == 1:
        np.dot(matrix, left[0], out[0])
    else:
        np.dot(left, matrix.T, out)
