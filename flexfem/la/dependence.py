# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linearly dependent rows of a sparse matrix, by groups of rows with common columns.

The columns are twists of nodes, six each. Rows without a common node are independent, so that every
connected group of nodes is treated separately: two nodes for joints between beams, whole mechanisms
of rigid bodies.
"""

from collections.abc import Iterator
from dataclasses import dataclass

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
#: The same for larger groups, where only squares of singular values are within reach.
_ZERO_SPARSE = 1e-7
#: Vectors and sweeps of the inverse iteration for larger groups.
_VECTORS, _SWEEPS = 8, 4


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
    parent: dict[int, int] = {}

    def root(node: int) -> int:
        while parent.setdefault(node, node) != node:
            parent[node] = node = parent[parent[node]]
        return node

    nodes = [(a if a >= 0 else b, b if b >= 0 else a) for a, b in rows.nodes.tolist()]
    first: dict[int, int] = {}  # a node of each row: rows with several terms connect all of them
    for row, (a, b) in zip(rows.row.tolist(), nodes, strict=True):
        parent[root(a)] = root(b)
        parent[root(first.setdefault(row, a))] = root(a)
    members: dict[int, list[int]] = {}
    for term, (a, _) in enumerate(nodes):
        members.setdefault(root(a), []).append(term)
    for terms in members.values():
        yield np.array(terms, dtype=np.int64)


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
        if len(group) <= _DENSE:
            count += _null_vectors(rows, terms, group).shape[1]
        else:
            count += _small_eigenvalues(rows, terms, group)
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


def _small_eigenvalues(rows: NodeRows, terms: IntArray, group: IntArray) -> int:
    """Number of singular values of many rows that are zero: linear in the length of a chain.

    By Sylvester's law of inertia it is the number of negative pivots of ``G G^T - s^2 I``, where s
    is what counts as zero.
    """
    from scipy.sparse import coo_array, eye_array
    from scipy.sparse.linalg import splu

    i, j, values = _entries(rows, terms, group)
    matrix = coo_array((values, (i, j)), shape=(len(group), int(j.max()) + 1)).tocsr()
    length = np.sqrt(np.asarray(matrix.multiply(matrix).sum(axis=1)).ravel())
    matrix = matrix.multiply(1.0 / np.where(length > 0.0, length, 1.0)[:, np.newaxis]).tocsr()
    shifted = (matrix @ matrix.T - _ZERO_SPARSE**2 * eye_array(len(group))).tocsc()
    # pivots stay on the diagonal, so that their signs are those of the eigenvalues
    options = {"SymmetricMode": True}
    factor = splu(shifted, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    return int(np.sum(factor.U.diagonal() < 0.0))


def _null_vectors_of_many(rows: NodeRows, terms: IntArray, group: IntArray) -> FloatArray:
    """The same by inverse iteration with ``G G^T``, sparse: linear in the length of a chain.

    At most as many as the iteration has vectors are found.
    """
    from petsc4py import PETSc  # only large groups need it

    i, j, values = _entries(rows, terms, group)
    matrix = PETSc.Mat().createAIJ((len(group), int(j.max()) + 1), comm=PETSc.COMM_SELF)
    matrix.setPreallocationCOO(i.astype(PETSc.IntType), j.astype(PETSc.IntType))
    matrix.setValuesCOO(values, PETSc.InsertMode.INSERT)
    product = matrix.matTransposeMult(matrix)
    length = np.sqrt(product.getDiagonal().getArray())
    scales = 1.0 / np.where(length > 0.0, length, 1.0)
    scaling = PETSc.Vec().createWithArray(scales, comm=PETSc.COMM_SELF)
    matrix.diagonalScale(L=scaling)
    product = matrix.matTransposeMult(matrix)
    product.shift(_ZERO_SPARSE**2)
    solver = PETSc.PC().create(comm=PETSc.COMM_SELF)
    solver.setType(PETSc.PC.Type.LU)
    solver.setFactorOrdering("nd")
    solver.setFactorPivot(zeropivot=1e-30)  # the smallest pivots are the ones searched
    solver.setOperators(product)
    solver.setUp()
    vectors = np.random.default_rng(1).normal(size=(len(group), _VECTORS))
    x, y = product.createVecs()
    for _ in range(_SWEEPS):
        for k in range(_VECTORS):
            x.setArray(vectors[:, k])
            solver.apply(x, y)
            vectors[:, k] = y.getArray()
        vectors = np.linalg.qr(vectors)[0]
    images = np.empty((matrix.size[1], _VECTORS))
    image = matrix.createVecRight()
    for k in range(_VECTORS):
        x.setArray(vectors[:, k])
        matrix.multTranspose(x, image)
        images[:, k] = image.getArray()
    _, sizes, right = np.linalg.svd(images, full_matrices=False)
    return np.asarray(vectors @ right[sizes < _ZERO_SPARSE].T)
