# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linear algebra below the Newton iteration against dense NumPy solutions."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest

from flexfem._types import FloatArray, IntArray
from flexfem.la import factor as factors_of_bodies
from flexfem.la import whole
from flexfem.la.dense import inverted
from flexfem.la.direct import CountingFactors, DirectSolver, factorise, lu_solver
from flexfem.la.factor import Factor
from flexfem.la.nest import CoordinateMatrix, create_nest_matrix, create_nest_vector
from flexfem.solvers.linear.condensed import CondensedFactor, Solves
from flexfem.solvers.linear.front_elimination import _ROWS, _WIDE
from flexfem.solvers.linear.gmres import minimal_residual
from flexfem.solvers.linear.multifrontal import Fronts
from flexfem.solvers.linear.multiplier_system import (
    InterfaceSystem,
    _directed,
    _elimination,
)
from flexfem.solvers.linear.rank_dissection import RankDissection
from flexfem.solvers.linear.symmetric_fronts import NodeTree, SymmetricFronts

COMM = MPI.COMM_WORLD
NOTHING = np.zeros(0, dtype=np.int64)


@pytest.mark.parametrize("most", [3, 8, 12])
def test_minimal_residual_is_the_best_of_its_krylov_space(most, rng):
    """GMRES without restart: never beaten by any combination of the same vectors."""
    size = 12
    B = np.eye(size) + 0.4 * rng.normal(size=(size, size))
    right = rng.normal(size=size)
    found, _ = minimal_residual(
        lambda v: B @ v, right.copy(), np.linalg.norm(right), np.dot, 0.0, most
    )
    krylov = [right]
    for _ in range(most - 1):
        krylov.append(B @ krylov[-1] / np.linalg.norm(krylov[-1]))
    basis = np.linalg.qr(np.array(krylov).T)[0]
    best = basis @ np.linalg.lstsq(B @ basis, right)[0]
    # a Richardson iteration, or a basis that is not orthogonal, leaves residuals of order 1
    left, least = (np.linalg.norm(right - B @ z) for z in (found, best))
    assert left <= least * (1.0 + 1e-6) + 1e-10
    if most == size:
        np.testing.assert_allclose(B @ found, right, atol=1e-9)


def test_minimal_residual_stops_at_its_tolerance(rng):
    B = np.eye(9) + 0.05 * rng.normal(size=(9, 9))
    right, calls = rng.normal(size=9), []

    def apply(vector):
        calls.append(None)
        return B @ vector

    size = np.linalg.norm(right)
    tolerance = 1e-3 * size
    found, exact = minimal_residual(apply, right, size, np.dot, tolerance, 9)
    assert exact
    assert np.linalg.norm(right - B @ found) <= tolerance * (1.0 + 1e-9)
    assert len(calls) <= 6  # contraction of about 0.15 a vector
    assert not minimal_residual(apply, right, size, np.dot, tolerance, 2)[1]


def test_minimal_residual_of_the_identity_and_of_nothing(rng):
    right = rng.normal(size=5)
    for vector in (right, np.zeros(5)):
        found, _ = minimal_residual(np.copy, vector, np.linalg.norm(vector), np.dot, 0.0, 4)
        np.testing.assert_allclose(found, vector, rtol=1e-13)


def test_minimal_residual_takes_one_reduction_a_vector(rng):
    """The norm comes with the inner products; operators near the identity lose nothing by it."""
    E, right, calls = rng.normal(size=(200, 200)) / 200**0.5, rng.normal(size=200), []

    def products(rows, vector):
        calls.append(len(rows))
        return rows @ vector

    found, exact = minimal_residual(
        lambda v: v + 1e-4 * (E @ v), right, np.linalg.norm(right), products, 1e-13, 6
    )
    # a norm from what cancels against the identity stops at 1e-8
    assert exact
    assert np.linalg.norm(right - found - 1e-4 * (E @ found)) < 2e-13 * np.linalg.norm(right)
    assert calls == list(range(2, len(calls) + 2))
    nothing, exact = minimal_residual(lambda v: v * np.nan, right, 1.0, products, 0.0, 3)
    assert not exact
    assert np.isnan(nothing).all()


@pytest.mark.three_ranks
@pytest.mark.parametrize(
    ("interior", "far"), [(0, 0), (5, 0), (50, 0), (169, 13), (80, 81)],
    ids=["shared only", "small", "band", "grid", "full"],
)  # fmt: skip
@pytest.mark.parametrize("shared", [0, 4], ids=["alone", "shared"])
def test_interface_system_equals_a_dense_solve(interior, far, shared, rng):
    """Interior rows of every rank and rows of several ranks, whose entries add up."""
    rank, size = COMM.rank, COMM.size
    total = interior * size + shared
    if total == 0:
        pytest.skip("nothing to solve")
    # what each rank contributes couples its own rows, banded, and its shared rows
    every, mine = np.zeros((total, total)), None
    for r in range(size):
        numbers = np.concatenate(
            [interior * r + np.arange(interior), interior * size + np.arange(shared)]
        ).astype(np.int64)
        count = len(numbers)
        block = rng.normal(size=(count, count)) + (3.0 + count) * np.eye(count)
        apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
        near = (apart <= 4) | (np.abs(apart - far) <= 4) | (np.abs(apart - 5 * far) <= 1)
        near |= far > interior
        near[interior:] = near[:, interior:] = True
        block *= near
        every[np.ix_(numbers, numbers)] += block
        if r == rank:
            mine = block, near, numbers
    block, near, numbers = mine
    i, j = (k.astype(np.int64) for k in np.nonzero(near))
    # entries given twice add up
    i, j = np.concatenate([i, i[:3]]), np.concatenate([j, j[:3]])
    values = block[i, j].copy()
    values[:3] *= 0.25
    values[-3:] *= 0.75
    others = np.arange(shared if size > 1 else 0)  # one rank shares nothing
    system = InterfaceSystem(
        COMM, i, j, interior + shared - len(others), others, np.full(len(others), size)
    )
    right = rng.normal(size=total)
    expected = np.linalg.solve(every, right)
    for factor in (1.0, 2.0):  # the pattern is kept, the numbers change
        assert system.factor(factor * values)
        x = np.zeros(interior + shared)
        x[:interior] = right[numbers[:interior]]
        if rank == 0:  # right-hand sides of shared rows are summed over the ranks
            x[interior:] = right[numbers[interior:]]
        both = x.copy()
        system.solve(x)
        # round-off; a row summed twice or not at all is wrong by order 1
        np.testing.assert_allclose(factor * x, expected[numbers], atol=1e-11)
        assert system.factor_and_solve(factor * values, True, both)
        np.testing.assert_array_equal(both, x)
    assert not system.factor_and_solve(values, rank < size - 1, both)  # singular on one rank alone


@pytest.mark.three_ranks
@pytest.mark.parametrize("joined", ["chain", "net"])
def test_rank_dissection_equals_a_dense_solve(joined, rng):
    """Rows that two to all ranks have, numbered without regard to the tree of ranks."""
    rank, size = COMM.rank, COMM.size
    if size == 1:
        pytest.skip("one rank shares nothing")
    holders = [[r, r + 1] for r in range(size - 1) for _ in range(3)]
    if joined == "net":
        far = [sorted(rng.choice(size, rng.integers(2, size + 1), False)) for _ in range(4 * size)]
        holders += [[0, size - 1], *far]
    holders = [holders[k] for k in rng.permutation(len(holders))]
    total = len(holders)
    every, right = np.zeros((total, total)), rng.normal(size=total)
    for r in range(size):
        own = np.array([k for k, ranks in enumerate(holders) if r in ranks])
        block = rng.normal(size=(len(own), len(own))) + 2.0 * total * np.eye(len(own))
        every[np.ix_(own, own)] += block
        if r == rank:
            mine, numbers = block, own[::-1].astype(np.int64)
    system = RankDissection(COMM, numbers, np.array([len(holders[k]) for k in numbers]))
    for factor in (1.0, 2.0):
        assert system.factor(factor * mine[::-1, ::-1], True)
        # each right-hand side is given by the first rank that has the row
        x = np.array([right[k] if holders[k][0] == rank else 0.0 for k in numbers])
        at_once = x.copy()
        system.solve(x)
        # round-off; a front without one rank's entries is off by order 1
        np.testing.assert_allclose(factor * x, np.linalg.solve(every, right)[numbers], atol=1e-13)
        assert system.factor_and_solve(factor * mine[::-1, ::-1], True, at_once)
        np.testing.assert_array_equal(at_once, x)
        one = rank < size - 1  # singular on one rank alone
        assert not system.factor(mine[::-1, ::-1], one)
        assert not system.factor_and_solve(mine[::-1, ::-1], one, at_once)


@pytest.mark.three_ranks
def test_interface_system_reports_a_singular_matrix():
    i = j = np.arange(3)
    system = InterfaceSystem(COMM, i, j, 3, NOTHING, NOTHING)
    assert not system.factor(np.array([1.0, 0.0, 2.0]))
    assert system.factor(np.array([1.0, 3.0, 2.0]))


@pytest.mark.parametrize("scale", [0.0, 1e-15, np.nan])
def test_interface_system_reports_singular_shared_rows(scale):
    every, others = np.indices((2, 2)).reshape(2, -1), np.arange(2 if COMM.size > 1 else 0)
    system = InterfaceSystem(
        COMM, *every.astype(np.int64), 2 - len(others), others, np.full(len(others), COMM.size)
    )
    # two rows that are the same but for round-off: solved with, they would give any number
    assert not system.factor(np.array([1.0, 2.0, 1.0, 2.0 + scale]))
    assert system.factor(np.array([1.0, 2.0, 1.0, 2.1]))


@pytest.mark.serial
def test_each_chain_is_eliminated_from_its_ground_or_towards_other_ranks():
    """Chains of three rows: held at the first or last row or nowhere, coupled or not."""
    chain = np.arange(15).reshape(5, 3)
    i, j = np.concatenate([chain[:, :-1].ravel(), chain[:, 1:].ravel()]), chain[:, 1:].ravel()
    j = np.concatenate([j, chain[:, :-1].ravel()])
    order = np.array([2, 1, 0, 6, 7, 8, 3, 4, 5, 9, 10, 11, 14, 13, 12])
    grounded, coupled = np.isin(np.arange(15), (0, 5)), np.isin(np.arange(15), (0, 3, 9, 12))
    found = _directed(order, i, j, grounded, coupled)
    assert found.tolist() == [0, 1, 2, 6, 7, 8, 5, 4, 3, 11, 10, 9, 14, 13, 12]


@pytest.mark.parametrize("ends", [(0,), (59,), (0, 59), (30,), ()], ids=str)
def test_bands_with_rows_that_are_left(ends, rng):
    """A chain of small blocks, with rows left that are coupled to some of them."""
    count, left, half = 180, 7, 5
    size = count + left
    dense = np.triu(np.tril(rng.normal(size=(size, size)), half), -half)
    dense[count:], dense[:, count:] = 0.0, 0.0
    for end in ends:
        dense[count:, 3 * end : 3 * end + 3] = rng.normal(size=(left, 3))
        dense[3 * end : 3 * end + 3, count:] = rng.normal(size=(3, left))
    dense[count:, count:] = rng.normal(size=(left, left))
    dense += 20.0 * np.eye(size)
    i, j = np.nonzero(dense)
    band = _elimination(i, j, count, size, np.zeros(size, dtype=np.bool_))
    assert band.kind == "banded"
    assert band.factor(dense[i, j])
    expected = np.linalg.inv(np.linalg.inv(dense)[count:, count:])
    # round-off; a row that the chain does not reach changes it by order 1e-2
    np.testing.assert_allclose(band.complement, expected, atol=1e-12)
    right = rng.normal(size=size)
    x = right.copy()
    band.reduce(x)
    x[count:] = np.linalg.solve(expected, x[count:])
    band.complete(x)
    np.testing.assert_allclose(x, np.linalg.solve(dense, right), atol=1e-13)


@pytest.mark.serial
def test_inverses_of_small_matrices(rng):
    matrices = rng.normal(size=(5, 6, 6))
    inverses, regular = inverted(matrices)
    assert regular
    # round-off; the inverse of a neighbour differs by order 1
    np.testing.assert_allclose(inverses @ matrices, np.tile(np.eye(6), (5, 1, 1)), atol=1e-11)
    for value in (0.0, np.nan, 1e-15):
        matrices[3] = np.diag([1.0, 1.0, 1.0, 1.0, 1.0, value])
        assert not inverted(matrices)[1]


@pytest.mark.parametrize("left", [0, 3], ids=["all", "some"])
def test_fronts_of_several_trees(left, rng):
    """Graphs of several components, some of one row, rows without neighbours but those left."""
    size = 60
    dense = np.zeros((size, size))
    for a, b in ((0, 7), (7, 8), (8, 30), (31, 40), (41, size - left)):
        dense[a:b, a:b] = rng.normal(size=(b - a, b - a)) * (rng.random((b - a, b - a)) < 0.15)
    dense[size - left :, 5:35] = rng.normal(size=(left, 30))
    dense[5:35, size - left :] = rng.normal(size=(30, left))
    dense += 30.0 * np.eye(size)
    i, j = np.nonzero(dense)
    order = rng.permutation(size - left)
    fronts = Fronts(i, j, order, size)
    assert fronts.factor(dense[i, j])
    expected = np.linalg.inv(np.linalg.inv(dense)[size - left :, size - left :])
    # round-off; an entry that goes to the wrong place of a front is missing by order 1
    np.testing.assert_allclose(fronts.complement, expected, atol=1e-12)
    right = rng.normal(size=size)
    x = right.copy()
    fronts.reduce(x)
    x[size - left :] = np.linalg.solve(fronts.complement, x[size - left :])
    fronts.complete(x)
    np.testing.assert_allclose(x, np.linalg.solve(dense, right), atol=1e-13)
    singular = np.where((i == 33) | (j == 33), 0.0, dense[i, j])
    assert not fronts.factor(singular)


@pytest.mark.serial
def test_fronts_end_at_rows_that_are_left():
    """Wide chains with rows left at one of their ends or the other cost the same, and little."""
    blocks, width, left = 24, 40, 30
    count = blocks * width
    number = np.arange(count) // width
    operations = []
    for end in (0, blocks - 1):
        near = np.abs(number[:, np.newaxis] - number) <= 1
        pattern = np.zeros((count + left, count + left), dtype=np.bool_)
        pattern[:count, :count] = near
        pattern[count:, count:] = True
        pattern[count:, :count] = number == end
        pattern |= pattern.T
        i, j = np.nonzero(pattern)
        every = np.zeros(count + left, dtype=np.bool_)
        fronts = _elimination(i, j, count, count + left, every)
        assert fronts.kind == "multifrontal"
        operations.append(fronts.operations[0])
    # a front of a block and the next one each; with the rows left in all of them twice as many
    np.testing.assert_allclose(operations, blocks * (2.0 / 3.0 + 4.0) * width**3, rtol=0.05)


@pytest.mark.parametrize("difference", [0.0, 1e-8, 1.0], ids=["symmetric", "nearly", "not"])
def test_fronts_of_many_rows(difference, rng):
    """Several blocks of pivots; rows of the complement beyond those of one product."""
    size, left = 300, 140
    dense = rng.normal(size=(size, size))
    dense += dense.T + 80.0 * np.eye(size)
    dense[20, 260] *= 1.0 + difference
    scales = 10.0 ** rng.uniform(-3, 3, size)
    i, j = np.nonzero(dense)
    fronts = Fronts(i, j, rng.permutation(size - left), size)
    assert fronts._tree.pivots[0] > _WIDE
    assert left > _ROWS
    assert fronts.factor(scales[i] * dense[i, j] * scales[j])
    expected = np.linalg.inv(np.linalg.inv(dense)[size - left :, size - left :])
    last = scales[size - left :]
    # round-off; a difference of 1e-8 taken for round-off is missing by 6e-10, a block by 1
    np.testing.assert_allclose(
        fronts.complement / np.outer(last, last), expected, rtol=0.0, atol=1e-12
    )
    right = rng.normal(size=size)
    x = scales * right
    fronts.reduce(x)
    x[size - left :] = np.linalg.solve(fronts.complement, x[size - left :])
    fronts.complete(x)
    np.testing.assert_allclose(scales * x, np.linalg.solve(dense, right), atol=1e-13)


@pytest.mark.serial
def test_fronts_of_a_chain_of_blocks(rng):
    """A front for each block but the last; round-off in couplings makes none a general one."""
    blocks, width = 4, 50
    block = np.arange(blocks * width) // width
    dense = rng.normal(size=(len(block), len(block)))
    dense = np.where(np.abs(block[:, np.newaxis] - block) <= 1, dense + dense.T, 0.0)
    dense += 80.0 * np.eye(len(block))
    i, j = np.nonzero(dense)
    fronts = Fronts(i, j, np.arange(len(block)), len(block))
    assert fronts._tree.pivots.tolist() == [width, width, 2 * width]
    right = rng.normal(size=len(block))
    found = []
    for noise in (0.0, 1e-14):
        assert fronts.factor(dense[i, j] + noise * (block[i] > block[j]))
        found.append(right.copy())
        fronts.reduce(found[-1])
        fronts.complete(found[-1])
    # an entry that is read on both sides of the diagonal changes some bits
    np.testing.assert_array_equal(*found)
    np.testing.assert_allclose(found[0], np.linalg.solve(dense, right), atol=1e-14)


@pytest.mark.parametrize("left", [0, 70], ids=["all", "some"])
def test_fronts_of_nodes(left, rng):
    """A grid and a clique, coupled to more nodes than a product of matrices takes at once."""
    grid = np.arange(36).reshape(6, 6)
    edges = [(a, a + 1) for a in grid[:, :-1].ravel()] + [(a, a + 6) for a in grid[:-1].ravel()]
    edges += [(a, b) for a in range(40, 60) for b in range(a) if b >= 40 or b == 35]
    edges += [(a, b) for a in range(60, 60 + left) for b in (a - 1, *range(42, 60), a - 60)]
    i, j = np.array(edges + [(b, a) for a, b in edges] + [(a, a) for a in range(60 + left)]).T
    i, j = np.divmod(np.unique(i * 200 + j), 200)
    size = 3 * (60 + left)
    pattern = np.zeros((60 + left, 60 + left))
    pattern[i, j] = 1.0
    dense = rng.normal(size=(size, size)) * np.kron(pattern, np.ones((3, 3)))
    dense = dense + dense.T + 120.0 * np.eye(size)
    rows, columns = np.nonzero(np.kron(pattern, np.ones((3, 3))))
    start = np.searchsorted(rows, np.arange(size + 1))
    tree = NodeTree(start, columns, 3, np.arange(60, 60 + left)[::-1])
    fronts = SymmetricFronts(tree, dense[rows, columns])
    last = (3 * tree.left[:, np.newaxis] + np.arange(3)).ravel()
    expected = np.linalg.inv(np.linalg.inv(dense)[np.ix_(last, last)])
    # round-off; an entry that goes to the wrong place of a front is missing by order 1
    np.testing.assert_allclose(fronts.complement, expected, atol=1e-11)
    for count in (1, 3):
        right, moved = rng.normal(size=(count, size // 3, 3)), fronts.room(count)
        x = np.zeros_like(right)
        reduced = fronts.reduce(right, moved)
        fronts.complete(np.linalg.solve(fronts.complement, reduced.T).T, moved, x)
        solved = np.linalg.solve(dense, right.reshape(count, -1).T).T
        # round-off; a right-hand side in the place of another one is wrong by order 1e-2
        np.testing.assert_allclose(x.reshape(count, -1), solved, atol=1e-13)
    dense[100, 100] = -1.0
    with pytest.raises(ArithmeticError, match="positive definite"):
        SymmetricFronts(tree, dense[rows, columns])


def _grid_matrix(rng) -> tuple[NodeTree, FloatArray, IntArray]:
    """Tree, entries and pairs of components of a grid of nodes, of which an edge is left."""
    nodes = np.arange(48).reshape(6, 8)
    edges = [*zip(nodes[:, :-1].ravel(), nodes[:, 1:].ravel(), strict=True)]
    edges += zip(nodes[:-1].ravel(), nodes[1:].ravel(), strict=True)
    pattern = np.eye(48)
    for a, b in edges:
        pattern[a, b] = pattern[b, a] = 1.0
    dense = rng.normal(size=(144, 144))
    # components 0 and 2 are coupled through 1 alone
    uncoupled = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 1.0], [0.0, 1.0, 1.0]])
    dense = (dense + dense.T) * np.kron(pattern, uncoupled) + 40.0 * np.eye(144)
    rows, columns = np.nonzero(np.kron(pattern, np.ones((3, 3))))
    tree = NodeTree(np.searchsorted(rows, np.arange(145)), columns, 3, nodes[0])
    return tree, dense[rows, columns], np.column_stack([rows, columns])


@pytest.mark.parametrize("mirrored", [(1, 1, 1), (1, -1, 1), (1, -1, -1), (1, 1, -1)])
def test_matrices_that_are_equal_but_for_signs(mirrored, rng):
    """And others, of which each differs in a pair of entries alone, or in a sign."""
    tree, values, pairs = _grid_matrix(rng)
    signs = np.array(mirrored)[pairs % 3].prod(axis=1)
    others = signs * values * (1.0 + 1e-15 * rng.normal(size=len(values)))
    np.testing.assert_array_equal(tree.signs(values, others), mirrored)
    coupled = np.flatnonzero((values != 0.0) & (pairs[:, 0] != pairs[:, 1]))
    for k in rng.choice(coupled, 20):
        pair = (np.sort(pairs, axis=1) == np.sort(pairs[k])).all(axis=1)
        # shared factors would be those of a matrix that is wrong by 1e-10, or in one sign
        assert tree.signs(values, others + 1e-10 * 40.0 * pair) is None
        assert tree.signs(values, np.where(pair, -others, others)) is None
    assert tree.signs(values, np.full_like(values, np.nan)) is None


def test_congruent_bodies_share_factors(rng):
    """Solutions are those of their own factors, at the interface and after forces are added."""
    tree, values, pairs = _grid_matrix(rng)
    mirrored = np.array([1, -1, 1])[pairs % 3].prod(axis=1) * values
    nearly = values * (1.0 + 1e-9 * (pairs == 100).all(axis=1))
    rows = pairs[:, 0]
    trees, latest, factors = [], {}, []
    for entries in (values, mirrored, values, nearly, nearly):
        matrix = PETSc.Mat().createAIJ(
            (144, 144), comm=PETSc.COMM_SELF,
            csr=(np.searchsorted(rows, np.arange(145)).astype(PETSc.IntType),
                 pairs[:, 1].astype(PETSc.IntType), entries),
        )  # fmt: skip
        factors.append(CondensedFactor.of(matrix, 3, tree.left, trees, latest))
    # those of a matrix that is nearly the same would be wrong by 1e-9 at one node
    shared = [factor.fronts is factors[0].fronts for factor in factors]
    assert shared == [True, True, True, False, False]
    assert factors[4].fronts is factors[3].fronts
    right = list(rng.normal(size=(3, 48, 3)))
    found = [np.zeros((48, 3)) for _ in right]
    solves = Solves(factors[:3], right, found)
    inverses = []
    for entries in (values, mirrored, values):
        dense = np.zeros((144, 144))
        dense[rows, pairs[:, 1]] = entries
        inverses.append(np.linalg.inv(dense))
    last = (3 * tree.left[:, np.newaxis] + np.arange(3)).ravel()
    solves.respond()
    for factor, one, x, inverse in zip(factors, right, found, inverses, strict=False):
        # round-off; without the signs by order 1e-2
        np.testing.assert_allclose(x[tree.left].ravel(), (inverse @ one.ravel())[last], atol=1e-14)
        np.testing.assert_allclose(
            factor.compliance(np.array([4, 0, 20])),
            inverse[np.ix_(last, last)][np.ix_([4, 0, 20], [4, 0, 20])], atol=1e-14,
        )  # fmt: skip
        one[tree.left] += rng.normal(size=(len(tree.left), 3))
    solves.complete()
    for factor, one, x, inverse in zip(factors, right, found, inverses, strict=False):
        expected = (inverse @ one.ravel()).reshape(48, 3)
        np.testing.assert_allclose(x, expected, atol=1e-14)
        x[:] = 0.0
        factor.solver(one, x)()
        np.testing.assert_allclose(x, expected, atol=1e-14)


@pytest.mark.three_ranks
@pytest.mark.parametrize(
    ("local", "largest"), [(True, 0), (False, 0), (False, 3000)],
    ids=["own factors", "distributed", "whole"],
)  # fmt: skip
def test_factor_equals_a_dense_solve(local, largest, rng, monkeypatch):
    """Unsymmetric banded matrix in blocks of six, with and without couplings between ranks."""
    monkeypatch.setattr(whole, "LARGEST", largest)
    nodes = 4
    size, first = 6 * nodes * COMM.size, 6 * nodes * COMM.rank
    dense = rng.normal(size=(size, size)) + 20.0 * np.eye(size)
    blocks = np.arange(size) // 6
    keep = np.abs(np.subtract.outer(blocks, blocks)) <= 1
    if local:
        ranks = np.arange(size) // (6 * nodes)
        keep &= np.equal.outer(ranks, ranks)
    dense *= keep
    rows = np.arange(first, first + 6 * nodes)
    i, j = np.nonzero(keep[rows])
    shape = (6 * nodes, size)
    matrix = CoordinateMatrix(COMM, shape, shape, i + first, j)
    matrix.assemble(dense[rows][i, j])
    factor = Factor(matrix.mat, 6, local=local)
    right = rng.normal(size=size)
    rhs, solution = right[rows].reshape(-1, 6).copy(), np.zeros((nodes, 6))
    for transposed, A in ((False, dense), (True, dense.T)):
        solve = factor.solver(rhs, solution, transposed=transposed)
        for scale in (1.0, -3.0):  # the same arrays again, with other numbers
            rhs[:] = scale * right[rows].reshape(-1, 6)
            solve()
            expected = scale * np.linalg.solve(A, right)
            # round-off; the transpose in place of the matrix is wrong by order 1
            np.testing.assert_allclose(solution.ravel(), expected[rows], atol=1e-12)


@pytest.mark.parametrize("skew", [0.0, 1e-9], ids=["symmetric", "not quite"])
def test_large_symmetric_matrices_have_half_the_factors(skew, rng, monkeypatch):
    """Indefinite, with entries of very different size, as those of fixed unknowns."""
    monkeypatch.setattr(factors_of_bodies, "_LARGE", 0)
    size, scale = 60, np.logspace(0.0, 8.0, 60)
    dense = rng.normal(size=(size, size))
    dense = (dense + dense.T) * np.sqrt(np.outer(scale, scale)) + np.diag(30.0 * scale)
    dense[3, 3] *= -1.0
    dense[5, 7] += skew * np.sqrt(scale[5] * scale[7])
    i, j = (index.ravel() for index in np.meshgrid(*2 * [np.arange(size)], indexing="ij"))
    matrix = CoordinateMatrix(MPI.COMM_SELF, (size, size), (size, size), i, j)
    matrix.assemble(dense[i, j])
    factor = Factor(matrix.mat, 3, local=True, chained=False, largest=size)
    assert factor._symmetric == (skew == 0.0)
    # a solve reads them twice
    assert factor.entries == pytest.approx(size**2, rel=0.05)
    right, solution = rng.normal(size=size), np.zeros(size)
    for transposed, A in ((False, dense), (True, dense.T)):
        factor.solver(right, solution, transposed=transposed)()
        expected = np.linalg.solve(A, right)
        # round-off; symmetric factors of what is not quite so miss the small one by 1e-10
        np.testing.assert_allclose(solution, expected, rtol=1e-11, atol=1e-13)


@pytest.mark.three_ranks
@pytest.mark.parametrize("kind", ["own", "MUMPS", "whole"])
def test_columns_are_solved_for_together(kind, rng, monkeypatch):
    """A few right-hand sides, fewer than fit; then a single one with the same factors."""
    monkeypatch.setattr(whole, "LARGEST", 3000 if kind == "whole" else 0)
    monkeypatch.setattr(factors_of_bodies, "_LARGE", 6000 if kind == "own" else 0)
    size, first = 8 * COMM.size, 8 * COMM.rank
    dense = rng.normal(size=(size, size)) + 20.0 * np.eye(size)
    if kind == "own":
        dense *= np.equal.outer(np.arange(size) // 8, np.arange(size) // 8)
    rows = np.arange(first, first + 8)
    i, j = (index.ravel() for index in np.meshgrid(rows, np.arange(size), indexing="ij"))
    matrix = CoordinateMatrix(COMM, (8, size), (8, size), i, j)
    matrix.assemble(dense[i, j])
    factors = Factor(matrix.mat, 2, local=kind == "own", chained=False, largest=size)
    assert (factors.together > 1) == (kind == "MUMPS" or (kind == "whole" and COMM.size == 1))
    count = min(3, factors.together)
    right = rng.normal(size=(count, size))
    own, found = right[:, rows].copy(), np.zeros((count, 8))
    for transposed, A in ((True, dense.T), (False, dense)):
        factors.solve_columns(own, found, transposed=transposed)
        # round-off; the transpose in place of the matrix is wrong by order 1
        np.testing.assert_allclose(found, np.linalg.solve(A, right.T).T[:, rows], atol=1e-12)
    factors.solver(own[0], found[0])()
    np.testing.assert_allclose(found[0], np.linalg.solve(dense, right[0])[rows], atol=1e-12)


@pytest.mark.parametrize("symmetric", [True, False])
def test_columns_of_few_numbers_are_given_without_zeros(symmetric, rng, monkeypatch):
    """The first column has two numbers, the second none, the third one."""
    monkeypatch.setattr(factors_of_bodies, "_LARGE", 0)
    given = []
    sparse = factors_of_bodies._sparse
    monkeypatch.setattr(
        factors_of_bodies, "_sparse", lambda rows: given.append(len(rows)) or sparse(rows)
    )
    size = 200
    dense = rng.normal(size=(size, size)) + 40.0 * np.eye(size)
    if symmetric:
        dense += dense.T
    i, j = (index.ravel() for index in np.meshgrid(*2 * [np.arange(size)], indexing="ij"))
    matrix = CoordinateMatrix(MPI.COMM_SELF, (size, size), (size, size), i, j)
    matrix.assemble(dense[i, j])
    factors = Factor(matrix.mat, 2, local=True, chained=False, largest=size)
    right, found = np.zeros((3, size // 2, 2)), np.ones((3, size // 2, 2))
    right[0, 7, 1], right[0, 90, 0], right[2, 99, 1] = 2.0, -1.0, 3.0
    for transposed, A in ((True, dense.T), (False, dense)):
        factors.solve_columns(right, found, transposed=transposed)
        expected = np.linalg.solve(A, right.reshape(3, -1).T).T.reshape(found.shape)
        # round-off; the transpose in place of the matrix is wrong by 1e-3
        np.testing.assert_allclose(found, expected, atol=1e-14)
    assert given == [3, 3]


@pytest.mark.three_ranks
@pytest.mark.parametrize("largest", [0, 3000], ids=["distributed", "whole"])
@pytest.mark.parametrize("empty", [False, True], ids=["all ranks", "last rank empty"])
def test_nest_is_solved_and_counted_in_any_layout(largest, empty, rng, monkeypatch):
    """Blocks [[A, B^T], [B, 0]] whose rows lie on all ranks, or on all but the last one."""
    monkeypatch.setattr(whole, "LARGEST", largest)
    few = COMM.size - 1 if empty and COMM.size > 1 else COMM.size
    sizes, own = (24, 7), []
    for size in sizes:
        parts = [*np.array_split(np.arange(size), few), *[np.arange(0)] * (COMM.size - few)]
        own.append(parts[COMM.rank])
    dense = rng.normal(size=(31, 31))
    dense = dense + dense.T
    dense[24:, 24:] = 0.0
    places, nests = [slice(0, 24), slice(24, 31)], []
    some = (np.abs(dense) > 1.0) | np.eye(31, dtype=bool)
    for kept in (some, np.ones_like(some)):  # two patterns
        grid = []
        for a, rows in zip(places, own, strict=True):
            line = []
            for b, columns in zip(places, own, strict=True):
                block = np.where(kept, dense, 0.0)[a, b][rows]
                i, j = np.nonzero(kept[a, b][rows])
                shapes = (len(rows), a.stop - a.start), (len(columns), b.stop - b.start)
                line.append(CoordinateMatrix(COMM, *shapes, rows[i], j))
                line[-1].assemble(block[i, j])
            grid.append([entry.mat for entry in line])
        nests.append((create_nest_matrix(grid, COMM), np.where(kept, dense, 0.0)))
    layout = [(len(rows), size) for rows, size in zip(own, sizes, strict=True)]
    right, found = (create_nest_vector(layout, COMM) for _ in range(2))
    every = rng.normal(size=31)
    right.setArray(np.concatenate([every[:24][own[0]], every[24:][own[1]]]))
    solver = DirectSolver(nests[0][0], "nest_")
    for nest, full in (*nests, nests[0]):
        nest.assemble()
        assert solver.factor(nest)
        assert solver.solve(right, found)
        expected = np.linalg.solve(full, every)
        expected = np.concatenate([expected[:24][own[0]], expected[24:][own[1]]])
        # round-off; a row in the wrong place, or numbers of the other pattern, are off by order 1
        np.testing.assert_allclose(found.getArray(), expected, atol=1e-10)
        matrix = nest.convert("aij", PETSc.Mat())
        counting = CountingFactors(matrix, symmetric=True)
        assert counting.factor(matrix)
        values = np.linalg.eigvalsh(full)
        assert counting.negative_pivots == np.sum(values < 0.0)
        assert np.sign(counting.determinant) == np.sign(np.prod(values))
    for entry in (nests[0][0].getNestSubMatrix(i, j) for i in range(2) for j in range(2)):
        entry.scale(0.0)
    nests[0][0].assemble()
    assert not solver.factor(nests[0][0])
    assert solver.factor(nests[1][0])


def test_factorisation_asks_for_more_memory():
    size = 40 * COMM.size
    dense = np.zeros((size, size))
    dense[: size // 2, size // 2 :] = np.random.default_rng(1).normal(size=(size // 2, size // 2))
    dense += dense.T  # no pivot on the diagonal
    lines = np.array_split(np.arange(size), COMM.size)[COMM.rank]
    i, j = (index.ravel() for index in np.meshgrid(lines, np.arange(size), indexing="ij"))
    matrix = CoordinateMatrix(COMM, (len(lines), size), (len(lines), size), i, j)
    matrix.assemble(dense[i, j])
    ksp = lu_solver(COMM, "short_")
    pc = ksp.getPC()
    pc.setOperators(matrix.mat)
    pc.setFactorSetUpSolverType()
    pc.getFactorMatrix().setMumpsIcntl(14, -95)
    # without a second attempt the factorisation fails, as if the matrix were singular
    assert factorise(ksp, matrix.mat)
    assert pc.getFactorMatrix().getMumpsIcntl(14) > 0
    right, solution = matrix.mat.createVecs()
    right.set(1.0)
    ksp.solve(right, solution)
    residual = matrix.mat * solution - right
    # round-off of a random matrix; a wrong solution is off by 1
    assert residual.norm() < 1e-8
    matrix.assemble(np.where(i == 0, 0.0, dense[i, j]))
    assert not factorise(ksp, matrix.mat)
