# SPDX-License-Identifier: LGPL-3.0-or-later
"""Matrices of cells and their transposes times nodal values, for all families that keep them."""

import numpy as np
import pytest

from flexfem.families.shell_director.triangles import UNKNOWNS
from flexfem.families.ufl_body.elements import Points
from flexfem.kernels.driver import ALL_COLUMNS, Cells, add_products, plain_cells
from tests.unit import test_director_triangles as directors
from tests.unit import test_rotation_free as rotation_free
from tests.unit import test_ufl_bodies as ufl_bodies
from tests.unit.test_beam_element import GRAVITY, SECTION, SHAPES

pytestmark = pytest.mark.serial


class Products:
    """Products with the matrices of cells, some of which have missing nodes."""

    def __init__(self, cells: Cells, matrices: np.ndarray, columns: int, unknowns=ALL_COLUMNS):
        self.cells, self.unknowns, self.columns = cells, unknowns, columns
        self.matrices = np.ascontiguousarray(matrices.reshape(len(matrices), -1))
        self.count = int(cells.nodes.max()) + 1

    def __call__(self, values: np.ndarray, transposed: bool = False) -> np.ndarray:
        out = np.zeros((self.count, self.columns))
        memory = self.cells.memory
        add_products(self.unknowns, memory, self.matrices, values, 0.7, transposed, out)
        return out


def adjoint_defect(product: Products) -> float:
    """Difference of ``x . K y`` and ``K^T x . y``, relative."""
    rng = np.random.default_rng(4)
    x, y = rng.normal(size=(2, product.count, product.columns))
    forwards, backwards = np.sum(x * product(y)), np.sum(product(x, transposed=True) * y)
    return abs(forwards - backwards) / abs(forwards)


def asymmetry(product: Products) -> float:
    """How much a product with the transposes differs from one with the matrices, relative."""
    y = np.random.default_rng(5).normal(size=(product.count, product.columns))
    return abs(product(y) - product(y, transposed=True)).max() / abs(product(y)).max()


@pytest.mark.parametrize("shape", ["straight", "corner"])
def test_beams(one_beam, shape, rng):
    beam = one_beam(SHAPES[shape], SECTION, 0.03)
    beam.gravity = GRAVITY
    beam.disturb(rng)
    ((_, group),), block = beam.beams.groups, beam.block
    matrices = group.tangent(block, GRAVITY, beam.shifts, 1.0)
    product = Products(group.cells, matrices, 6)
    assert adjoint_defect(product) < 1e-12
    assert asymmetry(product) > 1e-3  # gyroscopic terms: one for the other would be noticed
    block.step[:], block.residual[:] = beam.random(rng, 1.0), 0.0
    group.add_action(block, GRAVITY, beam.shifts, 0.7)
    # the axes of some cells are turned from those of their nodes at a corner
    expected = block.residual[: product.count]
    found = product(block.step[: product.count].copy())
    np.testing.assert_allclose(found, expected, atol=1e-11 * abs(expected).max())


@pytest.mark.parametrize("degree", [1, 3])
def test_nurbs_beams(one_nurbs, degree, rng):
    line = np.linspace(0.0, 1.0, 9 * degree + 1)
    points = np.stack([line, line**2, -0.3 * line**3], axis=1)
    beam = one_nurbs(points, degree, SECTION, 0.03)
    beam.gravity = GRAVITY
    beam.disturb(rng)
    (group,), block = beam.beams.groups, beam.block
    matrices = np.empty((9, (6 * (degree + 1)) ** 2))
    group.tangent_into(block, GRAVITY, beam.shifts, 1.0, matrices)
    product = Products(group.cells, matrices, 6)
    assert adjoint_defect(product) < 1e-12
    assert asymmetry(product) > 1e-3  # gyroscopic terms
    block.step[:], block.residual[:] = beam.random(rng, 1.0), 0.0
    group.add_action(block, GRAVITY, beam.shifts, 0.7)
    found, expected = product(block.step), block.residual
    np.testing.assert_allclose(found, expected, atol=1e-11 * abs(expected).max())


def test_rotation_free_triangles():
    made, _, points = rotation_free.shell()
    nodes = np.ascontiguousarray(made.patches.nodes, dtype=np.int32)
    assert (nodes < 0).any()
    product = Products(plain_cells(np.empty((0, 0)), nodes), made.tangents(points), 3)
    assert adjoint_defect(product) < 1e-12
    steps, action = np.random.default_rng(6).normal(size=points.shape), np.zeros_like(points)
    made.add_action(points, steps, action, (0.7, 0.0))
    np.testing.assert_allclose(product(steps), action, atol=1e-12 * abs(action).max())


def test_director_triangles():
    made, _, _, frames = directors.shell()
    cells = plain_cells(np.empty((0, 0)), made.nodes.astype(np.int32))
    product = Products(cells, made.tangents(frames), 6, UNKNOWNS)
    assert adjoint_defect(product) < 1e-12
    assert asymmetry(product) > 1e-3  # moments in axes that turn with their nodes
    steps = np.random.default_rng(6).normal(size=(len(frames), 6))
    action = np.zeros_like(steps)
    made.add_action(frames, steps, action, (0.7, 0.0))
    np.testing.assert_allclose(product(steps), action, atol=1e-12 * abs(action).max())


@pytest.mark.parametrize("name", ["curved bar", "solid"])
def test_energies_in_ufl(name):
    system = ufl_bodies.system(name)
    ufl_bodies.deform(system)
    (group,) = system.elements.groups
    points = np.ascontiguousarray(system.block.frames[:, :3])
    cells = plain_cells(np.empty((0, 0)), group.nodes)
    product = Products(cells, group.stiffnesses(Points(points=points)), 3)
    assert adjoint_defect(product) < 1e-12
    steps, action = np.random.default_rng(6).normal(size=points.shape), np.zeros_like(points)
    group.add_action(Points(points=points), steps, 0.7, action)
    np.testing.assert_allclose(product(steps), action, atol=1e-12 * abs(action).max())
