# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rotation-free triangles: derivatives, the form, rigid motions."""

from dataclasses import replace

from mpi4py import MPI

import basix.ufl
import dolfinx
import numba
import numpy as np
import pytest
import ufl
from scipy.spatial.transform import Rotation

from flexfem.families.shell_rotation_free.triangles import RotationFreeTriangles
from flexfem.forms.shell import shell_energy, shell_forms, shell_strains
from flexfem.kernels.ffcx import compile_kernel, tabulate
from flexfem.mesh.shells.patches import EdgeRule, curvature_patches
from tests.unit.references import QUICKLY
from tests.unit.triangles import (
    adjacency,
    isotropic,
    patches_of,
    rectangle,
    sparse_maps,
    sparse_tangent,
)

pytestmark = pytest.mark.serial
KINDS = pytest.mark.parametrize(
    "kind", [{}, {"averaged": True}, {"smoothed": True}, {"averaged": True, "smoothed": True}],
    ids=lambda kind: "-".join(kind) or "constant",
)  # fmt: skip


def shell(averaged=False, smoothed=False, rolled=True):
    """A curved, laminated shell with all kinds of edges, and positions far from its start."""
    rng = np.random.default_rng(3)
    points, triangles = rectangle((4, 3), "perturbed", (1.0, 0.8))
    if rolled:
        points = np.stack([np.sin(points[:, 0]), points[:, 1], np.cos(points[:, 0])], 1)
    factors = rng.normal(size=(2, 6, 6))
    stiffness = factors @ np.swapaxes(factors, 1, 2) + np.eye(6)
    rules = rng.choice([EdgeRule.FREE, EdgeRule.CLAMPED, EdgeRule.HINGED], triangles.shape)
    patches = patches_of(
        points, triangles, stiffness[0, 3:, 3:], averaged, rules=rules, smoothed=smoothed
    )
    sections = rng.integers(0, 2, len(triangles))
    made = RotationFreeTriangles.build(patches, points, stiffness, sections)
    return made, points, points + 0.05 * rng.normal(size=points.shape)


def forces(made, points):
    residual = np.zeros_like(points)
    made.add_forces(points, residual)
    return residual


@KINDS
def test_forces_are_differences_of_the_energy(kind):
    made, _, points = shell(**kind)
    direction = np.random.default_rng(5).normal(size=points.shape)
    step = 1e-4
    energies = [made.energies(points + k * step * direction)[:, 2].sum() for k in (-2, -1, 1, 2)]
    slope = np.array([1, -8, 8, -1]) @ energies / (12 * step)
    # differences of fourth order; a term left out of the turning of n is of order 1e-1
    np.testing.assert_allclose(np.sum(forces(made, points) * direction), slope, rtol=1e-8)


@KINDS
def test_tangents_are_differences_of_the_forces(kind):
    made, _, points = shell(**kind)
    K = sparse_tangent(made, points)
    direction = np.random.default_rng(5).normal(size=points.shape)
    step = 1e-4
    values = [forces(made, points + k * step * direction).ravel() for k in (-2, -1, 1, 2)]
    slope = np.array([1, -8, 8, -1]) @ values / (12 * step)
    # as above; a missing geometric term changes the product by per cents
    np.testing.assert_allclose(K @ direction.ravel(), slope, atol=1e-8 * abs(slope).max())
    # written twice from one value, but for nodes that occur twice: transposed blocks would differ
    assert abs(K - K.T).max() <= 1e-13 * abs(K).max()


@KINDS
def test_rigid_motions_leave_the_shell_free_of_stress(kind):
    made, start, _ = shell(**kind)
    turn = Rotation.from_rotvec([1.0, -2.0, 0.7]).as_matrix()
    moved = start @ turn.T + np.array([100.0, -50.0, 30.0])
    clamped = replace(made, offsets=made.offsets @ turn.T)
    # rounding of positions near 100 over h^2; a strain that is not objective is of order 1
    assert abs(clamped.strains(moved)).max() < 1e-10
    # clamps that stay behind do bend the shell
    assert abs(made.strains(moved)).max() > 0.1


@KINDS
def test_forces_turn_with_the_shell(kind):
    made, _, points = shell(**kind)
    turn = Rotation.from_rotvec([1.0, -2.0, 0.7]).as_matrix()
    turned = forces(replace(made, offsets=made.offsets @ turn.T), points @ turn.T)
    expected = forces(made, points) @ turn.T
    # any axis fixed in space changes forces by as much as they are
    np.testing.assert_allclose(turned, expected, atol=1e-11 * abs(expected).max())


@pytest.mark.parametrize("smoothed", [False, True])
def test_free_shell_has_no_resultant(smoothed):
    points, triangles = rectangle((4, 3), "perturbed")
    stiffness = isotropic(0.1)
    patches = patches_of(points, triangles, stiffness[3:, 3:], True, smoothed=smoothed)
    made = RotationFreeTriangles.build(patches, points, stiffness)
    moved = points + 0.05 * np.random.default_rng(3).normal(size=points.shape)
    force = forces(made, moved)
    largest = abs(force).max()
    # equilibrium of each triangle; a column of B in a wrong place leaves a couple of order 1
    assert abs(force.sum(0)).max() < 1e-12 * largest
    assert abs(np.cross(moved, force).sum(0)).max() < 1e-12 * largest
    eigenvalues = np.linalg.eigvalsh(sparse_tangent(made, points).toarray())
    # six rigid motions and no others: a patch that leaves a ripple free adds a zero
    assert (abs(eigenvalues) < 1e-10 * eigenvalues[-1]).sum() == 6


@KINDS
def test_parts_with_their_ghosts_make_up_the_whole(kind):
    points, triangles = rectangle((6, 5), "perturbed")
    stiffness = isotropic(0.1)
    opposites, neighbours = adjacency(triangles)
    rules = np.full(triangles.shape, EdgeRule.CLAMPED)
    tangents = np.zeros((*triangles.shape, 3))
    tangents[neighbours < 0] = [0.3, 0.2, 0.1]
    moved = points + 0.05 * np.random.default_rng(3).normal(size=points.shape)

    def force_of(own):
        around = np.setdiff1d(neighbours[own], [-1, *own])
        here = np.concatenate([own, around])
        number = np.full(len(triangles) + 1, -1)
        number[here] = np.arange(len(here))
        patches = curvature_patches(
            points, triangles[here], opposites[here], stiffness[3:, 3:], rules=rules[here],
            tangents=tangents[here],
            neighbours=number[neighbours[here]] if kind.get("averaged") else None,
            smoothed=kind.get("smoothed", False),
        ).first(len(own))  # fmt: skip
        return forces(RotationFreeTriangles.build(patches, points, stiffness), moved)

    everything = np.arange(len(triangles))
    whole = force_of(everything)
    parts = force_of(everything[::3]) + force_of(np.setdiff1d(everything, everything[::3]))
    # the same terms in another order; a ghost without its own neighbours changes forces by per
    # cents, a tangent of another triangle by as much as they are
    np.testing.assert_allclose(parts, whole, atol=1e-12 * abs(whole).max())


def test_masses_are_those_of_the_triangles():
    made, start, _ = shell()
    density = np.linspace(1.0, 2.0, len(made.starts))
    masses = np.zeros(len(start))
    made.add_masses(density, masses)
    # the whole mass and its first moment, exact for triangles of constant density: a mass put to
    # a node of a neighbour moves the centre by a cell
    own = density * made.patches.areas
    centres = start[made.patches.nodes[:, :3]].mean(1)
    np.testing.assert_allclose(masses.sum(), own.sum(), rtol=1e-14)
    np.testing.assert_allclose(masses @ start, own @ centres, rtol=1e-13)


@numba.njit
def _tabulate(address, tensor, data, constants, points):
    tabulate(address, tensor, data, constants, points)


@pytest.mark.slow
def test_loops_equal_the_kernels_of_the_form_at_a_point(monkeypatch):
    # to optimise these takes ten times as long as all else here, and no loop calls them
    monkeypatch.setattr(
        "flexfem.kernels.ffcx._COMPILE_ARGUMENTS", QUICKLY["cffi_extra_compile_args"]
    )
    made, _, points = shell(averaged=True, smoothed=True)
    forms = shell_forms()
    kernels = [
        compile_kernel(MPI.COMM_SELF, form, tuple(forms.coefficients.values()))
        for form in (forms.residual, forms.tangent)
    ]
    patches, count = made.patches, points.size
    residual, K = np.zeros(count), np.zeros((count, count))
    for m, section in enumerate(made.sections):
        W = np.zeros((5, len(points)))
        np.add.at(W.T, patches.nodes[m, :6], np.pad(patches.membrane[m].T, ((0, 0), (0, 3))))
        there = patches.nodes[m] >= 0
        bent = np.pad(patches.curvatures[m].T[there], ((0, 0), (2, 0)))
        np.add.at(W.T, patches.nodes[m, there], bent)
        vectors = W @ points
        vectors[2:] += made.offsets[m]
        stiffness = made.stiffness[section][np.triu_indices(6)]
        data = np.concatenate([vectors.ravel(), made.starts[m], stiffness])
        cell = np.array([0.0, 0, 0, 1, 0, 0])
        force, values = np.zeros(15), np.zeros(240)
        for kernel, tensor in zip(kernels, (force, values), strict=True):
            _tabulate(kernel.address, tensor, data, np.zeros(1), cell)
        M = np.kron(W, np.eye(3))
        residual += patches.areas[m] * M.T @ force
        K += patches.areas[m] * M.T @ values[15:].reshape(15, 15) @ M
        # the tangent's kernel writes the force as well: 0 if it were packed otherwise
        np.testing.assert_allclose(values[:15], force, atol=1e-12 * abs(force).max())
    # rounding, as for the assembled form
    expected = forces(made, points).ravel()
    np.testing.assert_allclose(residual, expected, atol=1e-12 * abs(expected).max())
    assert abs(sparse_tangent(made, points) - K).max() <= 1e-12 * abs(K).max()


@pytest.mark.parametrize("averaged", [False, True])
def test_loops_equal_the_assembled_form(averaged):
    """``M^T K M``, M = [I; B], of what DOLFINx assembles on positions and curvature vectors."""
    made, start, points = shell(averaged)
    patches = made.patches
    domain = ufl.Mesh(basix.ufl.element("Lagrange", "triangle", 1, shape=(3,)))
    mesh = dolfinx.mesh.create_mesh(MPI.COMM_SELF, patches.nodes[:, :3], domain, start)
    cells, nodes = mesh.topology.original_cell_index, mesh.geometry.input_global_indices
    P = basix.ufl.element("Lagrange", "triangle", 1, shape=(3,))
    Q = basix.ufl.element("DG", "triangle", 0, shape=(3, 3))
    space = dolfinx.fem.functionspace(mesh, basix.ufl.mixed_element([P, Q]))
    (positions, to_positions), (_, to_curvatures) = space.sub(0).collapse(), space.sub(1).collapse()
    to_positions, to_curvatures = np.ravel(to_positions), np.ravel(to_curvatures)

    def constant(values):
        function = dolfinx.fem.Function(
            dolfinx.fem.functionspace(mesh, ("DG", 0, values.shape[1:]))
        )
        function.x.array[:] = values[cells].ravel()
        return function

    # M = [I; B]: rows are the unknowns of the mixed element, columns the positions of nodes
    order = np.empty(len(nodes), np.int64)
    order[positions.dofmap.list.ravel()] = nodes[mesh.geometry.dofmaps[0].ravel()]
    B = sparse_maps(patches, len(points)).toarray().reshape(-1, 3, len(points))[cells]
    maps = np.concatenate([np.eye(len(points))[order], B.reshape(-1, len(points))])
    M = np.zeros((len(maps) * 3, points.size))
    M[np.concatenate([to_positions, to_curvatures])] = np.kron(maps, np.eye(3))

    unknowns = dolfinx.fem.Function(space)
    unknowns.x.array[:] = M @ points.ravel()
    unknowns.x.array[to_curvatures] += made.offsets[cells].ravel()
    q, k = ufl.split(unknowns)
    axes, material = constant(patches.axes), constant(made.stiffness[made.sections])
    f1, f2 = (ufl.dot(ufl.grad(q), axes[a, :]) for a in (0, 1))
    energy = shell_energy(shell_strains(f1, f2, k, constant(made.starts)), material) * ufl.dx
    residual = ufl.derivative(energy, unknowns)
    tangent = dolfinx.fem.form(ufl.derivative(residual, unknowns), jit_options=QUICKLY)
    vector = dolfinx.fem.assemble_vector(dolfinx.fem.form(residual, jit_options=QUICKLY))
    force = M.T @ vector.array
    K = M.T @ dolfinx.fem.assemble_matrix(tangent).to_scipy() @ M

    # two derivations of one energy: a term that one of them lacks is of order 1e-2
    np.testing.assert_allclose(
        forces(made, points).ravel(), force, atol=1e-12 * abs(force).max(), rtol=0
    )
    assert abs(sparse_tangent(made, points) - K).max() <= 1e-12 * abs(K).max()


def test_membranes_without_compression_keep_tension():
    """Principal forces are those before, or zero where they were negative; moments stay."""
    points, triangles = rectangle((4, 3), "parallel")
    stiffness = isotropic(0.1)
    patches = patches_of(points, triangles, stiffness[3:, 3:], False)
    made = RotationFreeTriangles.build(patches, points, stiffness)
    moved = points + 0.05 * np.random.default_rng(3).normal(size=points.shape)
    stresses = made.stresses(made.strains(moved))
    pulled = made.response(moved, drop_compression=True).stresses
    np.testing.assert_array_equal(pulled[:, 3:], stresses[:, 3:])
    tensor = np.array([[0, 2], [2, 1]])
    values, axes = np.linalg.eigh(stresses[:, tensor])
    assert values.min() < 0.0 < values.max()
    expected = np.einsum("mik,mk,mjk->mij", axes, np.maximum(values, 0.0), axes)
    # round-off; a wrong sign of the shear force would miss by 1e-3
    np.testing.assert_allclose(pulled[:, tensor], expected, rtol=0.0, atol=1e-15)
