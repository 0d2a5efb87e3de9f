# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numbers of several cells in one register."""

import math

import numpy as np
import pytest

from flexfem.kernels.by_hand import batched_by_hand
from flexfem.kernels.compiled import inlined
from flexfem.kernels.driver import (
    Nodal,
    add_blocks,
    add_forces,
    cell_kernel,
    evaluate,
    plain_cells,
)
from flexfem.kernels.lanes import lanes
from flexfem.kernels.records import Float2D, Record
from flexfem.kernels.vectors import add_to, load, store

pytestmark = pytest.mark.serial


class Points(Record):
    """Positions of nodes."""

    points: Float2D


@inlined
def root_and_opposite(x, y):
    """A pair, as parts of kernels return them."""
    return math.sqrt(x * x + y), -y


@batched_by_hand
def arithmetic(tensor, coefficients, constants, coordinates):
    """All operations, of vectors with vectors, numbers and integers."""
    total = 0.0
    for i in range(int(constants[0])):
        root, opposite = root_and_opposite(load(coefficients, i), load(coordinates, i))
        total = total + root / (3 - opposite) * constants[1]
        total -= 2.0 * root
        total += 1
        total *= 0.5
        total /= root + 1.0
    store(tensor, 0, total)
    add_to(tensor, 1, 2.0 / total)


@batched_by_hand
def products(tensor, coefficients, constants, coordinates):
    """The matrix ``x_i x_j`` of two nodes' positions."""
    for i in range(6):
        for j in range(6):
            add_to(tensor, 6 * i + j, load(coefficients, i) * load(coefficients, j))


@batched_by_hand
def positions(tensor, coefficients, constants, coordinates):
    """The positions of two nodes."""
    for i in range(6):
        add_to(tensor, i, load(coefficients, i))


def test_arithmetic_is_that_of_every_lane():
    count = 11  # not a multiple of the lanes
    rng = np.random.default_rng(3)
    own, fixed = rng.random((2, count, 3))
    rows = lanes(fixed)
    cells = plain_cells(own, corners=rows.reshape(len(rows), -1))
    kernel = cell_kernel(arithmetic.kernel([3]), 2, ["x"], {}, {"x": (0, 3)})
    found = np.empty((count, 2))
    evaluate(kernel.memory, cells.memory, Points(points=own).memory, np.array([3.0, 1.5]), found)
    total = np.zeros(count)
    for x, y in zip(own.T, fixed.T, strict=True):
        root = np.sqrt(x * x + y)
        total = ((total + root / (3 + y) * 1.5 - 2.0 * root) + 1) * 0.5 / (root + 1.0)
    np.testing.assert_allclose(found, np.column_stack([total, 2.0 / total]), rtol=1e-13)


def test_missing_nodes_take_data_of_the_first_and_get_no_results():
    points = np.arange(1.0, 13.0).reshape(4, 3)
    nodes = np.array([[0, 1], [1, -1], [2, 3]], dtype=np.int32)
    cells, at = plain_cells(np.empty((0, 0)), nodes), Points(points=points)
    nodal = {"points": (Nodal.POSITION, Points.word("points"))}
    # the second node's results go to the last three columns
    unknowns = np.array([(0, 0), (1, 3)])
    kernel = cell_kernel(positions.kernel([6]), 6, ["points"], nodal, {}, unknowns=unknowns)
    sums, none = np.zeros((4, 6)), np.zeros(1)
    add_forces(kernel.memory, cells.memory, at.memory, none, 2.0, sums)
    np.testing.assert_array_equal(sums[:3, :3], 2.0 * points[:3])
    np.testing.assert_array_equal(sums[[1, 3], 3:], 2.0 * points[[1, 3]])
    assert not sums[3, :3].any()
    assert not sums[[0, 2], 3:].any()

    values = np.empty((3, 6))
    evaluate(kernel.memory, cells.memory, at.memory, none, values)
    np.testing.assert_array_equal(values, points[[[0, 1], [1, 1], [2, 3]]].reshape(3, 6))

    index = np.array([[[0, 1], [2, 3]], [[3, -1], [-1, -1]], [[4, 5], [6, 7]]], dtype=np.int32)
    square = cell_kernel(products.kernel([6]), 36, ["points"], nodal, {}, unknowns=unknowns)
    blocks = np.zeros((8, 6, 6))
    add_blocks(square.memory, cells.memory, at.memory, none, index, blocks)
    expected = np.zeros((8, 6, 6))
    for m, (first, second) in enumerate(nodes):
        for (i, j), number in np.ndenumerate(index[m]):
            if number >= 0:
                outer = np.outer(points[(first, second)[i]], points[(first, second)[j]])
                expected[number, 3 * i : 3 * i + 3, 3 * j : 3 * j + 3] += outer
    np.testing.assert_array_equal(blocks, expected)
