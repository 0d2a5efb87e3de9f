# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linearly dependent rows of a sparse matrix, by groups of rows with common columns.

The columns are twists of nodes, six each. Rows without a common node are independent, so that every
connected group of nodes is treated separately: two nodes for joints between beams, whole mechanisms
of rigid bodies.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexfem._types import FloatArray, IntArray

__all__ = ["PART", "NodeRows", "dependence_count", "groups", "null_vectors"]

#: Weight of a row in a combination that vanishes below which it has no part in it.
PART = 1e-6
#: Rows of the largest group whose singular values are computed: their cost grows with the cube.
_DENSE = 300
#: Singular values below this are zero; the rows have length one. Two pins a micrometre apart on
#: bodies of a metre give 1e-6.
_ZERO = 1e-9
#: The same where more vanish than the inverse iteration has vectors, and squares are counted.
_ZERO_SQUARED = 1e-7
#: Vectors and sweeps of the inverse iteration for larger groups; shift of a matrix that is singular
#: in all digits.
_VECTORS, _SWEEPS, _SHIFT = 8, 3, 1e-15


@dataclass(frozen=True)
class NodeRows:
    """Rows as sums of terms.

    Attributes:
        row: (t,) row of each term, numbered from zero.
        nodes: (t, 2) node on either side of each term, -1 for the ground.
        gradient: (t, 2, 6) with respect to the twists of both nodes.
    """

    row: IntArray
    nodes: IntArray
    gradient: FloatArray


def groups(rows: NodeRows) -> Iterator[IntArray]:
    """Terms of each group of nodes connected by rows; the ground connects nothing."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    if len(rows.row) == 0:
        return
    # the other node in the place of the ground, and rows with several terms connect all of them
    ends = np.where(rows.nodes >= 0, rows.nodes, rows.nodes[:, ::-1])
    _, first, row = np.unique(rows.row, return_index=True, return_inverse=True)
    known, number = np.unique(ends, return_inverse=True)
    a, b = number.reshape(-1, 2).T
    links = np.concatenate([a, a]), np.concatenate([b, a[first][row.reshape(-1)]])
    graph = coo_array((np.ones(len(links[0])), links), shape=(len(known), len(known)))
    group = connected_components(graph, directed=False)[1][a]
    order = np.argsort(group, kind="stable").astype(np.int64)
    parts = np.split(order, np.flatnonzero(np.diff(group[order])) + 1)
    yield from sorted(parts, key=lambda terms: int(terms[0]))


def null_vectors(rows: NodeRows, terms: IntArray) -> tuple[IntArray, FloatArray]:
    """Rows (n,) of a group, and combinations (n, k) of them that vanish.

    Of large groups at most as many as the inverse iteration has vectors are found.

    Args:
        rows: all rows.
        terms: those of the group, from :func:`groups`.
    """
    group = np.unique(rows.row[terms])
    find = _null_vectors if len(group) <= _DENSE else _null_vectors_of_many
    return group, find(rows, terms, group)


def dependence_count(rows: NodeRows) -> int:
    """Return the number of rows that follow from the others: number of rows less rank."""
    count = 0
    for terms in groups(rows):
        group = np.unique(rows.row[terms])
        find = _null_vectors if len(group) <= _DENSE else _null_vectors_of_many
        found = find(rows, terms, group).shape[1]
        if len(group) > _DENSE and found == _VECTORS:  # perhaps there are more
            found = _small_eigenvalues(rows, terms, group)
        count += found
    return count


def _entries(
    rows: NodeRows, terms: IntArray, group: IntArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Row, column and value of the gradients of a group of rows, unknowns numbered from zero."""
    used = np.unique(rows.nodes[terms])
    used = used[used >= 0]
    at, to, values = [], [], []
    for side in range(2):
        held = terms[rows.nodes[terms, side] >= 0]
        node = np.searchsorted(used, rows.nodes[held, side])
        at.append(np.repeat(np.searchsorted(group, rows.row[held]), 6))
        to.append((6 * node[:, np.newaxis] + np.arange(6)).ravel())
        values.append(rows.gradient[held, side].ravel())
    return np.concatenate(at), np.concatenate(to), np.concatenate(values)


def _null_vectors(rows: NodeRows, terms: IntArray, group: IntArray) -> FloatArray:
    """Combinations (n, k) of the rows of a group that vanish, from singular values."""
    i, j, values = _entries(rows, terms, group)
    matrix = np.zeros((len(group), int(j.max(initial=-1)) + 1))
    np.add.at(matrix, (i, j), values)
    length = np.linalg.norm(matrix, axis=1, keepdims=True)
    left, sizes, _ = np.linalg.svd(matrix / np.where(length > 0.0, length, 1.0))
    return np.asarray(left[:, int(np.sum(sizes > _ZERO)) :])


def _zero(count: int) -> float:
    """Singular values of so many rows of length one that are below this are zero.

    Those of long chains are small: 2.5 / n^2 of n straight links with hinges, five rows each.
    """
    return min(_ZERO, 1.0 / count**2)


def _sparse(rows: NodeRows, terms: IntArray, group: IntArray) -> Any:
    """Gradients of the rows of a group, scaled to the length one, as a sparse matrix."""
    from scipy.sparse import coo_array

    i, j, values = _entries(rows, terms, group)
    matrix = coo_array((values, (i, j)), shape=(len(group), int(j.max()) + 1)).tocsr()
    length = np.sqrt(np.asarray(matrix.multiply(matrix).sum(axis=1)).ravel())
    return matrix.multiply(1.0 / np.where(length > 0.0, length, 1.0)[:, np.newaxis]).tocsr()


def _small_eigenvalues(rows: NodeRows, terms: IntArray, group: IntArray) -> int:
    """Number of singular values of many rows that are zero: linear in the length of a chain.

    By Sylvester's law of inertia it is the number of negative pivots of ``G G^T - s^2 I``, where s
    is what counts as zero.
    """
    from scipy.sparse import eye_array
    from scipy.sparse.linalg import splu

    matrix = _sparse(rows, terms, group)
    shifted = (matrix @ matrix.T - _ZERO_SQUARED**2 * eye_array(len(group))).tocsc()
    # pivots stay on the diagonal, so that their signs are those of the eigenvalues
    options = {"SymmetricMode": True}
    factor = splu(shifted, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    return int(np.sum(factor.U.diagonal() < 0.0))


def _null_vectors_of_many(rows: NodeRows, terms: IntArray, group: IntArray) -> FloatArray:
    """The same by inverse iteration with ``G G^T``, sparse: linear in the length of a chain.

    It solves with the matrix ``[[I, G^T], [G, 0]]``, whose condition is that of G, not its square
    (A. Bjorck, Numerical Methods for Least Squares Problems (1996), section 2.7). At most as many
    as the iteration has vectors are found.
    """
    matrix = _sparse(rows, terms, group)
    solve = _augmented_solver(matrix)
    vectors = np.random.default_rng(1).normal(size=(len(group), _VECTORS))
    right = np.zeros((sum(matrix.shape), _VECTORS))
    for _ in range(_SWEEPS):
        right[matrix.shape[1] :] = vectors
        vectors = np.linalg.qr(solve(right)[matrix.shape[1] :])[0]
    _, sizes, combined = np.linalg.svd(matrix.T @ vectors, full_matrices=False)
    return np.asarray(vectors @ combined[sizes < _zero(len(group))].T)


def _augmented_solver(matrix: Any) -> Any:
    """Solver with ``[[I, G^T], [G, 0]]``, with pivots."""
    from scipy.sparse import block_array, eye_array
    from scipy.sparse.linalg import splu

    count, columns = matrix.shape
    for shift in (0.0, _SHIFT):
        lower = -shift * eye_array(count)
        augmented = block_array([[eye_array(columns), matrix.T], [matrix, lower]])
        try:
            return splu(augmented.tocsc()).solve
        except RuntimeError:  # a pivot is zero in all digits
            continue
    raise AssertionError("a shifted matrix has no pivots that vanish")
