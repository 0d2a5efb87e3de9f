# SPDX-License-Identifier: LGPL-3.0-or-later
"""Director triangles: derivatives, the form, rigid motions, patches, masses."""

from mpi4py import MPI

import basix.ufl
import dolfinx
import numpy as np
import pytest
import ufl
from scipy.spatial.transform import Rotation

from flexfem.core.nodes.motion import ANGULAR, FIRST, KINETIC, LINEAR, MASS
from flexfem.families.shell_director.inertia import add_motion
from flexfem.families.shell_director.triangles import DirectorTriangles
from flexfem.forms.director_shell import DirectorFields, director_energy
from tests.unit.director_triangles import (
    flat_held,
    forces,
    moved,
    quadratic,
    rigidly,
    sparse_tangent,
    upright,
)
from tests.unit.references import QUICKLY
from tests.unit.triangles import PATTERNS, isotropic, rectangle

pytestmark = pytest.mark.serial
DIRECTION = np.array([0.2, 0.9, 0.1])


def rolled(parameters):
    x, y = parameters[:, 0], parameters[:, 1]
    return np.stack([np.sin(x), y + 0.1 * x * x, np.cos(x)], 1)


def shell(seed=3):
    """A curved, laminated shell on any axes; its parameters; twists that lead far away."""
    rng = np.random.default_rng(seed)
    parameters, triangles = rectangle((4, 3), "perturbed", (1.0, 0.8))
    parameters, nodes, edges = quadratic(parameters, triangles)
    places = rolled(parameters)
    turns = Rotation.random(len(places), rng).as_matrix()
    frames = np.concatenate([places, turns.reshape(-1, 9)], 1)
    normals = places[-len(edges) :] * [1.0, 0.0, 1.0]
    factors = rng.normal(size=(2, 6, 6))
    stiffness = factors @ np.swapaxes(factors, 1, 2) + np.eye(6)
    shear = np.array([[[2.0, 0.3], [0.3, 1.5]], [[0.7, 0.0], [0.0, 0.9]]])
    corners = len(places) - len(edges)
    made = DirectorTriangles.build(
        nodes.astype(np.int32), frames, normals[nodes[:, 3:] - corners], stiffness, shear,
        rng.integers(0, 2, len(nodes)), np.tile(DIRECTION, (len(nodes), 1)),
    )  # fmt: skip
    return made, parameters, frames, moved(frames, 0.1 * rng.normal(size=(len(frames), 6)))


def differences(function, frames, direction, step=1e-4):
    """Derivative of fourth order along local twists."""
    values = [function(moved(frames, k * step * direction)) for k in (-2, -1, 1, 2)]
    return np.tensordot([1, -8, 8, -1], values, 1) / (12 * step)


def test_forces_are_differences_of_the_energy():
    made, _, _, frames = shell()
    direction = np.random.default_rng(5).normal(size=(len(frames), 6))
    slope = differences(lambda at: made.energies(at)[:, 3].sum(), frames, direction)
    # differences of fourth order; a term left out is of order 1e-2
    np.testing.assert_allclose(np.sum(forces(made, frames) * direction), slope, rtol=1e-9)


def test_tangents_and_actions_are_differences_of_the_forces():
    made, _, _, frames = shell()
    direction = np.random.default_rng(5).normal(size=(len(frames), 6))
    direction[np.unique(made.nodes[:, :3]), 3:] = 0.0  # corners do not rotate
    slope = differences(lambda at: forces(made, at), frames, direction)
    action = np.zeros_like(slope)
    made.add_action(frames, direction, action)
    product = (sparse_tangent(made, frames) @ direction.ravel()).reshape(-1, 6)
    # as above; axes that rotate with their nodes change moments by as much as they are
    np.testing.assert_allclose(product, slope, atol=1e-9 * abs(slope).max())
    np.testing.assert_allclose(action, product, atol=1e-13 * abs(slope).max())


def test_strain_rates_are_differences_of_the_strains():
    made, _, _, frames = shell()
    direction = np.random.default_rng(5).normal(size=(len(frames), 6))
    slope = differences(made.changes, frames, direction)
    # as above
    np.testing.assert_allclose(made.rates(frames, direction), slope, atol=1e-9 * abs(slope).max())


@pytest.mark.slow
def test_loops_equal_the_assembled_form():
    """Energy, and forces on positions and directors as DOLFINx assembles them."""
    made, parameters, start, frames = shell()
    corners = made.nodes[:, :3].max() + 1
    domain = ufl.Mesh(basix.ufl.element("Lagrange", "triangle", 1, shape=(2,)))
    mesh = dolfinx.mesh.create_mesh(
        MPI.COMM_SELF, made.nodes[:, :3].astype(np.int64), domain, parameters[:corners, :2]
    )
    cells = mesh.topology.original_cell_index
    P = basix.ufl.element("Lagrange", "triangle", 2, shape=(3,))
    Q = basix.ufl.element("CR", "triangle", 1, shape=(3,))
    spaces = [dolfinx.fem.functionspace(mesh, element) for element in (P, Q)]
    # which of our nodes the degrees of freedom are, by their parameters
    at = [parameters, parameters[corners:]]
    order = []
    for own, space in zip(at, spaces, strict=True):
        dofs = space.tabulate_dof_coordinates()
        order.append(abs(own[:, None, :2] - dofs[None, :, :2]).sum(2).argmin(0))
    directors = np.zeros((len(frames), 3))
    d0 = np.zeros((len(frames), 3))
    d0[made.nodes[:, 6:]] = made.directors

    def fields(now):
        places, turned = dolfinx.fem.Function(spaces[0]), dolfinx.fem.Function(spaces[1])
        places.x.array[:] = now[order[0], :3].ravel()
        directors[:] = np.einsum("nij,nj->ni", now[:, 3:].reshape(-1, 3, 3), d0)
        turned.x.array[:] = directors[corners + order[1]].ravel()
        return places, turned

    def constant(values):
        space = dolfinx.fem.functionspace(mesh, ("DG", 0, values.shape[1:]))
        function = dolfinx.fem.Function(space)
        function.x.array[:] = values[cells].ravel()
        return function

    jacobian = ufl.Jacobian(mesh)
    origins = np.empty((len(cells), 2))
    origins[cells] = mesh.geometry.x[mesh.geometry.dofmaps[0][:, 0], :2]
    place = ufl.dot(ufl.inv(jacobian), ufl.SpatialCoordinate(mesh) - constant(origins))
    first, present = fields(start), fields(frames)
    energy = director_energy(
        DirectorFields.of(*first, jacobian, place), DirectorFields.of(*present, jacobian, place),
        constant(made.stiffness[made.sections]), constant(made.shear[made.sections]),
        ufl.as_vector(DIRECTION.tolist()),
    )  # fmt: skip
    energy = energy / abs(ufl.det(jacobian)) * ufl.dx(mesh, degree=2)
    total = dolfinx.fem.assemble_scalar(dolfinx.fem.form(energy, jit_options=QUICKLY))
    # one energy in two ways: another quadrature or a missing factor is of order 1e-2
    np.testing.assert_allclose(made.energies(frames)[:, 3].sum(), total, rtol=1e-12)
    own = forces(made, frames)
    turns = frames[:, 3:].reshape(-1, 3, 3)
    for k, field in enumerate(present):
        force = np.zeros((len(at[k]), 3))
        form = dolfinx.fem.form(ufl.derivative(energy, field), jit_options=QUICKLY)
        force[order[k]] = dolfinx.fem.assemble_vector(form).array.reshape(-1, 3)
        nodes = np.arange(len(frames))[-len(force) :]
        local = np.einsum("nji,nj->ni", turns[nodes], force)
        expected = local if k == 0 else np.cross(d0[nodes], local)
        np.testing.assert_allclose(
            own[nodes, 3 * k : 3 * k + 3], expected, atol=1e-12 * abs(expected).max()
        )


def test_rigid_motions_leave_the_shell_free_of_stress():
    made, _, frames, _ = shell()
    turn = Rotation.from_rotvec([1.0, -2.0, 0.7]).as_matrix()
    rigid = rigidly(frames, turn, np.array([100.0, -50.0, 30.0]))
    # rounding of positions near 100; a strain that is not objective is of order 1
    assert abs(made.strains(rigid)).max() < 1e-11


def test_forces_stay_as_they_are_in_axes_that_move_along():
    made, _, _, frames = shell()
    turn = Rotation.from_rotvec([1.0, -2.0, 0.7]).as_matrix()
    turned, expected = forces(made, rigidly(frames, turn, np.zeros(3))), forces(made, frames)
    # any axis fixed in space changes forces by as much as they are
    np.testing.assert_allclose(turned, expected, atol=1e-12 * abs(expected).max())


def test_free_shell_has_no_resultant_and_six_rigid_motions():
    made, _, start, frames = shell()
    force, corners = forces(made, frames), made.nodes[:, :3].max() + 1
    turns = frames[:, 3:].reshape(-1, 3, 3)
    pull, moment = (np.einsum("nij,nj->ni", turns, part) for part in np.split(force, 2, axis=1))
    # equilibrium; an interpolation that is not the same for all components leaves order 1
    assert abs(pull.sum(0)).max() < 1e-12 * abs(pull).max()
    assert abs((moment + np.cross(frames[:, :3], pull)).sum(0)).max() < 1e-12 * abs(pull).max()
    # no drilling stiffness: one zero more for each edge, three for each corner, and no others
    K = sparse_tangent(made, start).toarray()
    values = np.linalg.eigvalsh(K)
    idle = 6 + 3 * corners + (len(frames) - corners)
    assert abs(values[:idle]).max() < 1e-12 * values[-1]
    assert values[idle] > 1e-6 * values[-1]


@pytest.mark.parametrize("pattern", PATTERNS)
def test_patches_of_constant_strain(pattern):
    """Stretched and bent at the boundary, a flat plate of any mesh takes the same everywhere."""
    parameters, triangles = rectangle((4, 3), pattern)
    places, nodes, _ = quadratic(parameters, triangles)
    frames, corners = upright(places), len(parameters)
    stiffness = isotropic(0.1)
    made = DirectorTriangles.build(
        nodes, frames, np.tile([0.0, 0, 1], (len(nodes), 3, 1)), stiffness, np.eye(2),
        directions=np.tile([1.0, 0, 0], (len(nodes), 1)),
    )  # fmt: skip
    size, (x, y, _) = 1e-7, places.T
    wanted = size * np.array([1.0, -0.5, 0.8, 0.7, 1.2, -0.6, 0.0, 0.0])
    k11, k22, k12 = -wanted[3:6] * [1, 1, 0.5]
    exact = np.zeros((len(places), 6))
    exact[:, 0], exact[:, 1] = wanted[0] * x + wanted[2] * y, wanted[1] * y
    exact[:, 2] = (k11 * x * x + k22 * y * y) / 2 + k12 * x * y
    # d = e3 + theta x e3 = -grad w
    exact[:, 3], exact[:, 4] = k22 * y + k12 * x, -(k11 * x + k12 * y)
    inner = ((places[:, :2] > 1e-9) & (places[:, :2] < 1 - 1e-9)).all(1)
    free = ~flat_held(len(places), corners) & inner[:, None]
    exact[:corners, 3:] = 0.0
    K = sparse_tangent(made, frames)
    given = np.where(free, 0.0, exact).ravel()
    free = free.ravel()
    found = exact.ravel().copy()
    found[free] = np.linalg.solve(K[free][:, free].toarray(), -(K @ given)[free])
    # linear: what the size of the strains leaves of second order is 1e-7 of them
    np.testing.assert_allclose(found, exact.ravel(), atol=1e-9 * size)
    strains = made.strains(moved(frames, found.reshape(-1, 6)))
    np.testing.assert_allclose(strains, np.tile(wanted, (len(nodes), 1)), atol=1e-5 * size)


def test_masses_and_rods_of_a_flat_plate():
    parameters, triangles = rectangle((3, 2), "perturbed", (2.0, 1.0))
    places, nodes, _ = quadratic(parameters, triangles)
    made = DirectorTriangles.build(
        nodes, upright(places), np.tile([0.0, 0, 1], (len(nodes), 3, 1)), isotropic(0.1), np.eye(2)
    )
    masses = made.masses(np.full(len(nodes), 3.0))
    x = places[nodes, 0]
    # integrals of 3 and 3 x^2 over the rectangle, exact for quadratic functions
    np.testing.assert_allclose(masses.sum(), 6.0, rtol=1e-13)
    np.testing.assert_allclose(np.einsum("mi,mij,mj->", x, masses, x), 8.0, rtol=1e-13)
    square = np.einsum("mi,mij,mj->", x * x, masses, x * x)
    np.testing.assert_allclose(square, 3 * 2**5 / 5, rtol=1e-12)
    rods = made.rods(np.full(len(nodes), 0.6)).sum((0, 1))
    np.testing.assert_allclose(rods, np.diag([1.2, 1.2, 0.0]), atol=1e-14)


def test_motion_of_a_thick_plate_is_that_of_a_solid():
    """Energy and momenta of a box that flies and spins; its directors carry a third of them."""
    sides, density = np.array([2.0, 1.0, 1.5]), 4.0
    parameters, triangles = rectangle((3, 2), "perturbed", sides[:2])
    places, nodes, _ = quadratic(parameters, triangles)
    places = places - [0.5 * sides[0], 0.5 * sides[1], 0.0]
    made = DirectorTriangles.build(
        nodes, upright(places), np.tile([0.0, 0, 1], (len(nodes), 3, 1)), isotropic(0.1), np.eye(2)
    )
    turn, centre = Rotation.from_rotvec([0.4, -0.7, 1.1]).as_matrix(), np.array([0.3, 2.0, -1.0])
    velocity, spin = np.array([1.0, -2.0, 0.5]), np.array([3.0, 1.0, -2.0])
    frames = rigidly(upright(places), turn, centre)
    speeds = velocity + np.cross(spin, frames[:, :3] - centre)
    local = np.concatenate([speeds @ turn, np.tile(turn.T @ spin, (len(frames), 1))], 1)
    count, thickness = len(nodes), sides[2]
    masses = made.masses(np.full(count, density * thickness))
    rods = made.rods(np.full(count, density * thickness**3 / 12.0))
    cells = np.concatenate([nodes[:, :6], nodes[:, 6:]], 1) if nodes.shape[1] == 9 else made.nodes
    found = np.zeros(11)
    add_motion(cells, masses, rods, np.ones(count, dtype=bool), frames, local, found)
    mass = density * sides.prod()
    # a box, less what turning about their own axes would give the directors
    moments = mass / 12.0 * np.array([
        sides[1] ** 2 + sides[2] ** 2, sides[0] ** 2 + sides[2] ** 2, sides[0] ** 2 + sides[1] ** 2
    ])  # fmt: skip
    angular = turn @ (moments * (turn.T @ spin))
    energy = 0.5 * mass * velocity @ velocity + 0.5 * spin @ angular
    # round-off: all integrands are quadratic; one per cent of the directors' part is 4e-3
    assert found[KINETIC] == pytest.approx(energy, rel=1e-12)
    assert found[MASS] == pytest.approx(mass, rel=1e-13)
    np.testing.assert_allclose(found[FIRST : FIRST + 3], mass * centre, rtol=1e-12)
    np.testing.assert_allclose(found[LINEAR : LINEAR + 3], mass * velocity, rtol=1e-12)
    about_origin = angular + mass * np.cross(centre, velocity)
    np.testing.assert_allclose(found[ANGULAR : ANGULAR + 3], about_origin, rtol=1e-12)


def test_each_director_has_its_own_spin_in_the_energy(rng):
    """A rigid motion gives all three of a triangle the same."""
    cells = np.arange(9)[np.newaxis]
    masses, rods = rng.random((1, 6, 6)), rng.random((1, 3, 3, 3))
    frames = np.concatenate(
        [rng.random((9, 3)), Rotation.random(9, rng=rng).as_matrix().reshape(9, 9)], axis=1
    )
    local, found = rng.random((9, 6)), np.zeros(11)
    add_motion(cells, masses, rods, np.ones(1, dtype=bool), frames, local, found)
    speeds = np.einsum("nij,nj->ni", frames[:6, 3:].reshape(6, 3, 3), local[:6, :3])
    energy = 0.5 * np.einsum("ij,ia,ja->", masses[0], speeds, speeds)
    energy += 0.5 * np.einsum("ka,kab,kb->", local[6:, 3:], rods[0], local[6:, 3:])
    assert found[KINETIC] == pytest.approx(energy, rel=1e-13)  # the same spin: 1e-2 off
    angular = np.einsum("ij,ia,jb->ab", masses[0], frames[:6, :3], speeds)
    momentum = np.array([angular[i - 2, i - 1] - angular[i - 1, i - 2] for i in range(3)])
    turns = frames[6:, 3:].reshape(3, 3, 3)
    momentum += np.einsum("kca,kab,kb->c", turns, rods[0], local[6:, 3:])
    np.testing.assert_allclose(found[ANGULAR : ANGULAR + 3], momentum, rtol=1e-12)
