# SPDX-License-Identifier: LGPL-3.0-or-later
"""Constraints that say the same thing twice, found before they make a matrix singular.

With a regular mass matrix the multipliers are determined exactly if the gradients of all rigid rows
are linearly independent. Rows without a common node are, so that every connected group of nodes is
looked at by itself: two nodes for joints between beams, whole mechanisms of rigid bodies.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray, IntArray
from flexfem.system.placement import KINDS
from flexfem.system.system import System

__all__ = ["check_independence"]

#: Rows of the largest group whose singular values are computed: their cost grows with the cube.
_DENSE = 300
#: Singular values below this are zero; the rows have length one. Two pins a micrometre apart on
#: bodies of a metre give 1e-6.
_ZERO = 1e-9
#: The same for larger groups, where only squares of singular values are within reach.
_ZERO_SPARSE = 1e-7
#: Vectors and sweeps of the inverse iteration for larger groups.
_VECTORS, _SWEEPS = 8, 4
#: Weight of a row in a dependence below which its joint has no part in it.
_PART = 1e-6
_NAMES = 4


@dataclass(frozen=True)
class _Rows:
    """Rigid rows of all ranks as sums of terms.

    Attributes:
        joint: (r,) joint of each row.
        row: (t,) row of each term.
        nodes: (t, 2) node on either side of each term, -1 for the ground.
        gradient: (t, 2, 6) with respect to the twists of both nodes.
    """

    joint: IntArray
    row: IntArray
    nodes: IntArray
    gradient: FloatArray


def check_independence(system: System) -> None:
    """Raise for joints that constrain the same motion twice (collective).

    The first rank receives twelve numbers a row.

    Raises:
        InputError: rigid rows are linearly dependent; names the joints.
    """
    rows, comm = system.constraints, system.comm
    mine = np.flatnonzero((rows.owned * rows.rigid)[rows.row_of_term] > 0.0)
    row = rows.row_of_term[mine]
    face = system.interface
    keys = np.append(len(KINDS) * face.number + face.kind, -1)  # -1: ground
    joints = np.array([joint.index for joint in rows.joints], dtype=np.int64)
    parts = comm.gather(
        (
            joints[rows.joint_of_row[row]],
            rows.numbers[row],
            keys[rows.term_slots[mine]],
            rows.force_jacobian[mine],
        )
    )
    found = None
    if parts is not None:
        joint, number, nodes, gradient = (np.concatenate(p) for p in zip(*parts, strict=True))
        _, first, number = np.unique(number, return_index=True, return_inverse=True)
        found = _dependence(_Rows(joint[first], number.reshape(-1), nodes, gradient))
    found = comm.bcast(found)
    if found is None:
        return
    excess, total, guilty = found
    own = {j.index: j.joint.owner for j in rows.joints if j.owned and j.index in guilty}
    every = sorted(kv for part in comm.allgather(own) for kv in part.items())
    # joints of lines are several under one name
    names = list(dict.fromkeys(name for _, name in every))
    more = f" and {len(names) - _NAMES} more" if len(names) > _NAMES else ""
    raise InputError(
        f"{', '.join(names[:_NAMES])}{more}: {excess} of {total} constraints are redundant "
        "(the joints hold the same motion twice, or the position is singular); leave out what "
        "others hold already, or let a motion carry it with redundant_constraints least_norm"
    )


def _dependence(rows: _Rows) -> tuple[int, int, list[int]] | None:
    """Excess and number of rows, and the joints of the first group with dependent rows."""
    for terms in _groups(rows):
        group = np.unique(rows.row[terms])
        if len(group) <= _DENSE:
            null = _null_vectors(rows, terms, group)
        else:
            null = _null_vectors_of_many(rows, terms, group)
        if null.shape[1]:
            part = np.abs(null).max(axis=1) > _PART
            guilty = np.unique(rows.joint[group[part]]).tolist()
            return null.shape[1], int(np.isin(rows.joint[group], guilty).sum()), guilty
    return None


def _entries(
    rows: _Rows, terms: IntArray, group: IntArray
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


def _null_vectors(rows: _Rows, terms: IntArray, group: IntArray) -> FloatArray:
    """Combinations (n, k) of the rows of a group that vanish, from singular values."""
    i, j, values = _entries(rows, terms, group)
    matrix = np.zeros((len(group), int(j.max(initial=-1)) + 1))
    np.add.at(matrix, (i, j), values)
    length = np.linalg.norm(matrix, axis=1, keepdims=True)
    left, sizes, _ = np.linalg.svd(matrix / np.where(length > 0.0, length, 1.0))
    return np.asarray(left[:, int(np.sum(sizes > _ZERO)) :])


def _null_vectors_of_many(rows: _Rows, terms: IntArray, group: IntArray) -> FloatArray:
    """The same by inverse iteration with ``G G^T``, sparse: linear in the length of a chain.

    At most as many as the iteration has vectors are found.
    """
    i, j, values = _entries(rows, terms, group)
    matrix = _sparse(i, j, values, (len(group), int(j.max()) + 1))
    product = matrix.matTransposeMult(matrix)
    length = np.sqrt(product.getDiagonal().getArray())
    scaling = PETSc.Vec().createWithArray(1.0 / np.where(length > 0.0, length, 1.0))
    matrix.diagonalScale(L=scaling)
    product = matrix.matTransposeMult(matrix)
    product.shift(_ZERO_SPARSE**2)
    solver = PETSc.PC().create(comm=PETSc.COMM_SELF)
    solver.setType(PETSc.PC.Type.LU)
    solver.setFactorOrdering("nd")
    solver.setFactorPivot(zeropivot=1e-30)  # the smallest pivots are what is looked for
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


def _sparse(i: IntArray, j: IntArray, values: FloatArray, shape: tuple[int, int]) -> PETSc.Mat:
    """Matrix of this process from entries, repeated ones summed."""
    matrix = PETSc.Mat().createAIJ(shape, comm=PETSc.COMM_SELF)
    matrix.setPreallocationCOO(i.astype(PETSc.IntType), j.astype(PETSc.IntType))
    matrix.setValuesCOO(values, PETSc.InsertMode.INSERT)
    return matrix


def _groups(rows: _Rows) -> Iterator[IntArray]:
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
