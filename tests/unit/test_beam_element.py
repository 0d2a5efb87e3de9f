# SPDX-License-Identifier: LGPL-3.0-or-later
"""The SE(3) beam: exact derivatives, compiled loops, objectivity, states of constant strain."""

import basix.ufl
import numpy as np
import pytest

import flexfem as ff
from flexfem.forms.beam import beam_forms
from flexfem.kernels.ffcx import cell_form
from flexfem.lie import se3
from tests.unit.sections import coupled_section

GRAVITY = np.array([3.0, -7.0, 2.0])
SCALE = 0.3


def _arc(n: int) -> np.ndarray:
    s = np.linspace(0.0, 2.0, n + 1)
    return np.stack([2.0 * np.sin(s), 2.0 - 2.0 * np.cos(s), 0.0 * s], axis=1)


def _helix(n: int) -> np.ndarray:
    s = np.linspace(0.0, 3.0, n + 1)
    return np.stack([np.cos(s), np.sin(s), 0.4 * s], axis=1)


CORNERS = [[0, 0, 0], [0.5, 0, 0], [1, 0, 0], [1, 0.6, 0], [1, 0.6, 0.7], [1, 1.2, 0.7]]
SHAPES = {
    "straight": np.linspace([0.1, 0.2, -0.1], [1.3, 0.9, 0.8], 6),
    "arc": _arc(5),
    "helix": _helix(5),
    "corner": np.array(CORNERS, dtype=float),
}


SECTION = coupled_section()
SIMPLE = ff.Section.general((1e3, 400.0, 300.0, 20.0, 10.0, 5.0), (2.0, 2.0, 2.0, 0.3, 0.2, 0.1))


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("damping", [0.0, 0.03])
@pytest.mark.parametrize("moving", [True, False], ids=["moving", "stiffness"])
@pytest.mark.parametrize("inertial", [False, True], ids=["se3", "inertial"])
def test_tangent_and_action_are_the_derivative_of_the_residual(
    one_beam, shape, damping, moving, inertial, rng
):
    beam = one_beam(SHAPES[shape], SECTION, damping, inertial)
    shifts = beam.shifts if moving else np.array([0.0, 0.0, 1.0])
    beam.gravity = GRAVITY
    beam.disturb(rng)
    state, eps = beam.state(), 2e-6
    for _ in range(2):
        step, sides = beam.random(rng, 1.0), []
        for sign in (1.0, -1.0):
            beam.move(state, sign * eps * step, shifts)
            sides.append(beam.residual(SCALE))
        beam.move(state, 0.0 * step, shifts)
        expected = (sides[0] - sides[1]) / (2.0 * eps)
        # differences are good to about 1e-9; a missing term (gravity, gyroscopic, damping, turned
        # axes, T^-1) is of the order of the term itself, more than 1e-3 here
        bound = 1e-7 * beam.largest(expected)
        assert beam.largest(beam.product(step, shifts, SCALE) - expected) <= bound
        assert beam.largest(beam.action(step, shifts, SCALE) - expected) <= bound


def test_corner_turns_the_section_axes_of_some_cell_ends(one_beam):
    beam = one_beam(SHAPES["corner"], SECTION)
    # otherwise no test here would ever see the branch with rotated axes
    assert beam.comm.allreduce(beam.beams.turned) >= 2


def test_section_axes_follow_the_line_at_a_corner(one_beam):
    """A stretch of the second leg along its own direction is extension and nothing else."""
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0]], dtype=float)
    beam = one_beam(points, SECTION)
    last = beam.block.node_ids == 2
    beam.block.frames[last, :3] += [0.0, 0.1, 0.0]
    strain = np.zeros((2, 6))
    strain[1, 0] = 0.1
    sums = beam.comm.allreduce(beam.strain().sum(axis=0))
    # with the axes of the first leg the stretch would appear as shear
    np.testing.assert_allclose(sums, strain.sum(axis=0), atol=1e-14)


@pytest.mark.parametrize("shape", SHAPES)
def test_internal_force_is_the_gradient_of_the_strain_energy(one_beam, shape, rng):
    beam = one_beam(SHAPES[shape], SECTION)
    beam.disturb(rng)
    beam.block.velocity[:], beam.block.acceleration[:] = 0.0, 0.0
    state, step, eps, energies = beam.state(), beam.random(rng, 1.0), 1e-5, []
    for sign in (1.0, -1.0):
        beam.move(state, sign * eps * step, np.zeros(3))
        energies.append(beam.energy())
    beam.move(state, 0.0 * step, np.zeros(3))
    power = beam.total((beam.residual() * step[: beam.block.owned]).ravel())
    # differences of the energy are good to 1e-9; strains (NumPy) and forces (UFL) that disagree, at
    # rotated axes for instance, differ by 1e-2 and more
    assert power == pytest.approx((energies[0] - energies[1]) / (2.0 * eps), rel=1e-7)


@pytest.mark.parametrize("shape", SHAPES)
def test_every_initial_shape_is_free_of_stress(one_beam, shape):
    beam = one_beam(SHAPES[shape], SECTION)
    # round-off of the logarithm; a curvature of the line taken for strain is of order 1
    assert beam.largest(beam.strain()) <= 1e-13
    assert beam.largest(beam.residual()) <= 1e-12


@pytest.mark.parametrize("shape", SHAPES)
def test_superposed_rigid_motion_changes_neither_strain_nor_local_force(one_beam, shape, rng):
    beam = one_beam(SHAPES[shape], SECTION)
    beam.disturb(rng)
    strain, force = beam.strain(), beam.residual()
    rigid = se3.exp(np.array([7.0, -4.0, 2.0, 1.9, -0.8, 1.7]))
    beam.block.frames[:] = se3.compose(rigid, beam.block.frames)
    # interpolated rotation vectors would change strains by 1e-2; round-off grows with the distance
    assert beam.largest(beam.strain() - strain) <= 1e-13
    # inertia too: without gravity the local residual does not depend on the orientation
    assert beam.largest(beam.residual() - force) <= 1e-12 * beam.largest(force)


@pytest.mark.parametrize("cuts", [np.linspace(0, 3, 4), np.array([0, 0.2, 1.7, 3.0])])
def test_nodes_on_a_helix_have_exactly_constant_strain(one_beam, cuts):
    """Every state of constant strain is exact on any mesh: H(s) = H(0) exp(s (e1 + strain))."""
    beam = one_beam(cuts[:, np.newaxis] * np.eye(3)[0], SIMPLE)
    strain = np.array([0.05, -0.1, 0.2, 0.4, -0.3, 0.5])
    _bend(beam, strain)
    # chords for arcs would be off by (kappa h)^2/24, more than 1e-2 here
    assert beam.largest(beam.strain() - strain) <= 1e-12


def _bend(beam, strain: np.ndarray) -> None:
    """Give a straight beam along x a constant strain."""
    block = beam.block
    first = beam.gather(block.start_frames)[0]
    block.frames[:] = se3.compose(
        first, se3.exp(block.start_frames[:, :1] * (np.eye(6)[0] + strain))
    )


def test_roll_up_to_a_circle_needs_the_end_moment_only(one_beam):
    """Pure bending of a straight cantilever: M = E I 2 pi / L bends it to a full circle."""
    beam = one_beam(np.linspace([0.0, 0, 0], [2.0, 0, 0], 6), SIMPLE)
    kappa = 2.0 * np.pi / 2.0
    _bend(beam, kappa * np.eye(6)[5])
    ends = beam.gather(beam.block.frames)
    # the last node is back at the first: a wrong exponential or strain misses it by 1e-2
    np.testing.assert_allclose(ends[-1], ends[0], atol=1e-13)
    expected = np.zeros((6, 6))
    expected[0, 5], expected[-1, 5] = -5.0 * kappa, 5.0 * kappa
    # a wrong map from element to nodes leaves shear forces of order E I kappa / h at inner nodes
    np.testing.assert_allclose(beam.gather(beam.residual()), expected, atol=1e-11)


@pytest.mark.parametrize(
    ("shape", "damping"),
    [
        pytest.param("straight", 0.03, marks=pytest.mark.serial),
        pytest.param("arc", 0.0, marks=pytest.mark.serial),
        ("helix", 0.03),
    ],
)
def test_compiled_loops_equal_dolfinx_assembly(one_beam, shape, damping, rng):
    """Residual and both tangents of the same forms, assembled by DOLFINx on its own mesh."""
    beam = one_beam(SHAPES[shape], SECTION, damping)
    beam.gravity = GRAVITY
    beam.disturb(rng)
    block = beam.block
    block.increment[:] = 0.0  # DOLFINx has no T^-1
    table = {
        "position": block.frames[:, :3],
        "rotation": block.frames[:, 3:],
        "velocity": block.velocity,
        "acceleration": block.acceleration,
    }
    table = {name: beam.gather(values) for name, values in table.items()}
    start = beam.gather(block.start_frames)
    vector, stiffness, inertia = _dolfinx(beam, SHAPES[shape], table, start, damping)
    # the same kernels on the same numbers: only the order of sums differs
    np.testing.assert_allclose(
        beam.gather(beam.residual()), vector, atol=1e-12 * np.abs(vector).max()
    )
    for factors, expected in (((0.0, 0.0, 1.0), stiffness), ((*beam.shifts[:2], 0.0), inertia)):
        matrices = beam.beams.tangent(block, GRAVITY, np.array(factors), 1.0)
        dense = np.zeros((36, 36))
        for cell, matrix in zip(block.node_ids[beam.beams.data.cells], matrices, strict=True):
            at = (6 * cell[:, np.newaxis] + np.arange(6)).ravel()
            dense[np.ix_(at, at)] += matrix
        dense = beam.comm.allreduce(dense)
        np.testing.assert_allclose(dense, expected, atol=1e-12 * np.abs(expected).max())


def _dolfinx(beam, points, table, start, damping):
    """Dense residual and matrices in input order from an ordinary interval mesh."""
    import dolfinx

    n, comm, first = len(points), beam.comm, beam.comm.rank == 0
    cells = np.stack([np.arange(n - 1), np.arange(1, n)], axis=1)
    element = basix.ufl.element("Lagrange", "interval", 1, shape=(3,))
    mesh = dolfinx.mesh.create_mesh(
        comm, cells if first else cells[:0], element, points if first else np.empty((0, 3))
    )
    scalar = dolfinx.fem.functionspace(mesh, ("Lagrange", 1))
    geometry = mesh.geometry.input_global_indices[mesh.geometry.dofmaps[0]]
    count = scalar.dofmap.index_map.size_local + scalar.dofmap.index_map.num_ghosts
    nodes = np.empty(count, dtype=np.int64)
    nodes[scalar.dofmap.list] = geometry
    twist = se3.log(se3.compose(se3.inverse(start[geometry[:, 0]]), start[geometry[:, 1]]))
    m, upper = len(geometry), np.triu_indices(6)
    constant = {
        "relative_twist": twist,
        "length": np.linalg.norm(twist[:, :3], axis=1),
        "damping": np.full(m, damping),
        "stiffness": np.tile(SECTION.stiffness[upper], (m, 1)),
        "inertia": np.tile(SECTION.inertia[upper], (m, 1)),
    }
    forms, fields = beam_forms(damped=damping > 0.0), {}
    for name, field in forms.coefficients.items():
        space = dolfinx.fem.functionspace(mesh, field.ufl_element())
        fields[field] = dolfinx.fem.Function(space)
        if name in table:
            fields[field].x.array[:] = table[name][nodes].ravel()
        elif name in constant:
            fields[field].x.array[:] = constant[name].ravel()
    space = dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (6,)))
    results = []
    for form in (forms.residual, forms.stiffness, forms.inertia):
        values = {c: GRAVITY if c.ufl_shape == (3,) else beam.shifts[:2] for c in form.constants()}
        constants = {c: dolfinx.fem.Constant(mesh, v) for c, v in values.items()}
        used = {c: f for c, f in fields.items() if c in form.coefficients()}
        spaces = [space] * len(form.arguments())
        compiled = cell_form(comm, form)
        ready = dolfinx.fem.create_form(compiled, spaces, mesh, {}, used, constants)
        results.append(comm.allreduce(_dense(dolfinx, ready, space, nodes, n)))
    return results


def _dense(dolfinx, form, space, nodes, n):
    """This rank's rows of a vector or matrix in the order of the input."""
    owned = space.dofmap.index_map.size_local
    if form.rank == 1:
        vector = dolfinx.fem.assemble_vector(form)
        vector.scatter_reverse(dolfinx.la.InsertMode.add)
        out = np.zeros((n, 6))
        out[nodes[:owned]] = vector.array.reshape(-1, 6)[:owned]
        return out
    matrix = dolfinx.fem.assemble_matrix(form)
    matrix.scatter_reverse()
    every, (begin, end) = np.zeros(n, dtype=np.int64), matrix.index_map(0).local_range
    every[begin:end] = nodes[:owned]
    every = space.mesh.comm.allreduce(every)
    # rows are this rank's, columns all of them
    to, at = ((6 * k[:, np.newaxis] + np.arange(6)).ravel() for k in (every, nodes[:owned]))
    out = np.zeros((6 * n, 6 * n))
    out[np.ix_(at, to)] = matrix.to_dense()[: 6 * owned]
    return out
