# SPDX-License-Identifier: LGPL-3.0-or-later
"""From meshes and forms to reduced bodies: spaces, ties, choices of modes, ranks, refusals."""

import dataclasses
import subprocess
import sys
from typing import Any

from mpi4py import MPI

import basix.ufl
import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import flexfem as ff
from tests.unit.reduction_bodies import (
    ENDS,
    LENGTH,
    NODES,
    SECTION,
    STEEL,
    at,
    beam,
    box,
    differences,
    frequencies,
    sheet,
)
from tests.unit.refusals import assert_on_page

serial = pytest.mark.serial
# Static functions come from a direct solver: condition (length/height)^2 (cells)^2, times 1e-16
SOLVED = 1e-8


# -- mass properties ---


@serial
def test_mass_properties_of_a_turned_and_shifted_box() -> None:
    a, b, c = size = np.array([0.4, 0.2, 0.1])
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    centre = np.array([0.3, -0.2, 0.5])
    domain = mesh.create_box(MPI.COMM_WORLD, [-size / 2, size / 2], (2, 1, 1))
    domain.geometry.x[:] = domain.geometry.x @ turn.T + centre
    body = ff.reduce_body(ff.solid_body(domain, STEEL, 1), modes=0)
    mass = 7850.0 * a * b * c
    own = mass / 12.0 * np.diag([b * b + c * c, a * a + c * c, a * a + b * b])
    about = turn @ own @ turn.T + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    # integrals of polynomials are exact; a missing product of inertia changes the second digit
    assert body.mass == pytest.approx(mass, rel=1e-12)
    np.testing.assert_allclose(body.mass_centre, centre, rtol=1e-12)
    np.testing.assert_allclose(body.inertia, about, rtol=1e-11)


@pytest.mark.slow
@serial
def test_inertia_of_eccentric_sections_is_that_of_their_masses() -> None:
    section = ff.Section.rectangle(0.03, 0.02, STEEL, mass_centre=(0.01, -0.02))
    body = ff.reduce_body(beam(1, section), {"left": NODES["left"]}, modes=0)
    length, m = LENGTH, section.mass_per_length
    np.testing.assert_allclose(body.mass_centre, [length / 2, 0.01, -0.02], atol=1e-14)
    # J of the section, and the line's own inertia; without Steiner's part it is 3 times smaller
    expected = length * section.inertia[3:, 3:]
    expected += m * np.diag([0.0, length**3, length**3]) / 3.0
    expected[0, 1:] -= m * length**2 / 2.0 * np.array([0.01, -0.02])
    expected[1:, 0] = expected[0, 1:]
    np.testing.assert_allclose(body.inertia, expected, rtol=1e-12, atol=1e-15)
    rigid = body.rigid_motions
    np.testing.assert_allclose((rigid.T @ body.mass_matrix @ rigid)[3:, 3:], expected, atol=1e-12)


@serial
def test_sections_that_no_masses_have_are_refused() -> None:
    section = ff.Section.general(np.ones(6), (1.0, 1.0, 1.0, 1.0, 0.1, 0.1))
    with pytest.raises(ValueError, match="no masses have the section's rotary inertia"):
        beam(1, section)


@pytest.mark.slow
@serial
def test_inertia_of_moving_frames_is_that_of_the_nodes() -> None:
    """Coriolis, Euler and centrifugal matrices against the mass matrix of the mesh itself."""
    body = box((3, 1, 1), degree=1)
    reduced = ff.reduce_body(body, ENDS, modes=4)
    surface = reduced.recovery
    assert surface is not None  # for linear cells it has all nodes and all data
    space = fem.functionspace(body.space.mesh, ("Lagrange", 1))
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    nodes = fem.assemble_matrix(fem.form(7850.0 * u * v * ufl.dx)).to_dense()
    order = [
        int(np.argmin(np.linalg.norm(surface.points - x, axis=1)))
        for x in space.tabulate_dof_coordinates()
    ]
    points, shapes = surface.points[order], surface.displacement[order]
    omega, epsilon = np.array([1.0, 2.0, -3.0]), np.array([0.5, -1.0, 2.0])
    spin, turn = (np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
                  for w in (omega, epsilon))  # fmt: skip
    p = reduced.products
    for matrix in (2.0 * spin, turn, spin @ spin):
        ours = np.einsum("ab,abij->ij", matrix, p[:, :, 1:, 1:])
        theirs = np.einsum("pq,pai,ab,qbj->ij", nodes, shapes, matrix, shapes)
        # sums of the same numbers: a wrong order of indices changes signs
        np.testing.assert_allclose(ours, theirs, atol=1e-11 * np.abs(theirs).max())
        # skew or symmetric as the matrix is
        np.testing.assert_allclose(ours, ours.T * (1 if matrix[0, 0] else -1), atol=1e-12)
        force = np.einsum("ab,abi->i", matrix.T, p[:, :, 0, 1:])
        nodal = np.einsum("pq,pai,ab,qb->i", nodes, shapes, matrix, points)
        np.testing.assert_allclose(force, nodal, atol=1e-11 * np.abs(nodal).max())


# -- statics ---


@serial
def test_one_cell_of_a_beam_has_the_exact_stiffness() -> None:
    body = ff.reduce_body(beam(1), NODES, modes=0)
    assert SECTION.stiffness is not None
    ea, _, ga, gj, ei2, _ = np.diag(SECTION.stiffness)
    # Timoshenko 1921: shear makes the bending stiffness smaller by 1 + 12 EI/(GA L^2)
    phi = 12.0 * ei2 / ga
    expected = [ea, gj, 12.0 * ei2 / (1 + phi), (4 + phi) * ei2 / (1 + phi)]
    found = body.stiffness[[0, 3, 2, 4], [0, 3, 2, 4]]
    # the functions are in the space: what is left is round-off; linear ones lock by 1e3
    np.testing.assert_allclose(found, expected, rtol=SOLVED)


@pytest.mark.slow
@serial
@pytest.mark.parametrize("kind", ["beam", "solid", "plane", "shell"])
def test_six_motions_cost_nothing_and_move_the_surface_as_one(kind: str) -> None:
    domain = mesh.create_rectangle(MPI.COMM_WORLD, [[0, -0.05], [LENGTH, 0.05]], (8, 1))
    bodies: dict[str, Any] = {
        "beam": lambda: (beam(2), NODES),
        "solid": lambda: (box((4, 1, 1)), ENDS),
        "plane": lambda: (ff.plane_body(domain, 0.02, STEEL), ENDS),
        "shell": lambda: (
            ff.shell_body(sheet((4, 1), (LENGTH, 0.1)), ff.ShellSection.isotropic(0.02, STEEL)),
            ENDS,
        ),
    }
    body = ff.reduce_body(*bodies[kind](), modes=3)
    count = 3 if kind == "plane" else 6
    assert body.held.sum() == 2 * (6 - count)
    free = np.flatnonzero(~np.concatenate([body.held, np.zeros(3, dtype=bool)]))
    scale = 1.0 / np.sqrt(np.diag(body.stiffness)[free])
    values = np.linalg.eigvalsh(scale[:, None] * body.stiffness[np.ix_(free, free)] * scale)
    # zeros by construction, the next is the softest bending: (height/length)^2 or so
    assert np.abs(values[:count]).max() < 1e-12
    assert values[count] > 1e-5
    assert body.recovery is not None
    turn = body.rigid_motions[:, 5]
    moved = body.recovery.displacement @ turn
    expected = np.cross([0.0, 0.0, 1.0], body.recovery.points)
    np.testing.assert_allclose(moved, expected, atol=SOLVED)
    if body.recovery.stress is not None:
        pulled = body.recovery.stress @ body.rigid_motions[:, 0]
        assert np.abs(pulled).max() < 1e-6 * STEEL.youngs_modulus


@serial
def test_means_leave_the_ends_free_to_contract() -> None:
    pull = {tie: ff.reduce_body(box(), ENDS, modes=0, ties=dict.fromkeys(ENDS, tie)).stiffness[0, 0]
            for tie in ("rigid", "average")}  # fmt: skip
    exact = STEEL.youngs_modulus * 0.1 * 0.08 / LENGTH
    # uniaxial stress is in the space; rigid ends hinder contraction and are stiffer by a per cent
    assert pull["average"] == pytest.approx(exact, rel=SOLVED)
    assert 1.005 * exact < pull["rigid"] < 1.05 * exact


@serial
@pytest.mark.parametrize("kind", ["rigid", "average"])
def test_frames_may_be_anywhere(kind: str) -> None:
    shift = np.array([0.1, -0.2, 0.3])
    ties = dict.fromkeys(ENDS, kind)
    here = ff.reduce_body(box((4, 1, 1)), ENDS, modes=0, ties=ties)
    there = ff.reduce_body(box((4, 1, 1)), ENDS, modes=0, ties=ties, positions={"right": shift})
    np.testing.assert_array_equal(there.interfaces[1].position, shift)
    # the frame here moves and rotates as the one there
    x, y, z = here.interfaces[1].position - shift
    move = np.eye(12)
    move[6:9, 9:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    expected = move.T @ here.stiffness @ move
    np.testing.assert_allclose(there.stiffness, expected, atol=1e-9 * np.abs(expected).max())


@serial
def test_stress_of_a_pulled_bar() -> None:
    body = ff.reduce_body(box(), ENDS, modes=0, ties=dict.fromkeys(ENDS, "average"))
    assert body.recovery is not None
    assert body.recovery.stress is not None
    stress = body.recovery.stress[:, :, 6]  # by a unit displacement of the right end
    expected = np.zeros(6)
    expected[0] = STEEL.youngs_modulus / LENGTH
    np.testing.assert_allclose(stress, np.broadcast_to(expected, stress.shape), atol=1e4)


# -- internal functions ---


@serial
@pytest.mark.parametrize("basis", ["craig_bampton", "free_free"])
def test_frequencies_approach_those_of_the_whole_mesh_from_above(basis: str) -> None:
    whole = frequencies(ff.reduce_body(beam(4), NODES, basis="full"))[6:14]
    errors = []
    for modes in (4, 12):
        few = frequencies(ff.reduce_body(beam(4), NODES, basis=basis, modes=modes))[6:14]
        # Rayleigh: never below; 1e-9 is the round-off of the rigid motions' zeros
        assert (few > whole * (1.0 - 1e-9)).all()
        errors.append(np.abs(few / whole - 1.0)[:4].max())
    if basis == "free_free":
        # the modes of the free body are in the space themselves
        assert max(errors) < 1e-9
    else:
        assert errors[1] < 0.2 * errors[0] < 2e-3


@serial
def test_free_body_has_the_modes_of_the_averaged_one() -> None:
    free = ff.reduce_body(box((4, 1, 1)), modes=4)
    assert free.interfaces == ()
    np.testing.assert_allclose(free.moments[:, 1:], 0.0, atol=1e-9)
    assert np.abs(free.mass_matrix - np.eye(4)).max() < 1e-12
    tied = ff.reduce_body(
        box((4, 1, 1)), ENDS, modes=4, basis="free_free", ties=dict.fromkeys(ENDS, "average")
    )
    # means tie nothing: one mesh, one spectrum
    np.testing.assert_allclose(frequencies(tied)[6:10], free.frequencies, rtol=1e-8)


@serial
def test_choices_of_modes() -> None:
    every = ff.reduce_body(beam(), {"left": NODES["left"]}, modes=30)
    hertz = every.frequencies / (2.0 * np.pi)
    some = ff.reduce_body(beam(), {"left": NODES["left"]}, frequency=0.5 * (hertz[6] + hertz[7]))
    assert some.modes == 7
    part = ff.reduce_body(beam(), {"left": NODES["left"]}, participation=0.8)
    # effective masses of a cantilever along its axis: 8/pi^2 in the first mode (a clamped bar)
    momenta = part.moments[:, 7:] ** 2 / part.mass
    assert (momenta.sum(axis=1) >= 0.8).all()
    assert (momenta[:, :-1].sum(axis=1) < 0.8).any()
    assert momenta[0].max() == pytest.approx(8.0 / np.pi**2, rel=1e-3)


@serial
def test_damping_ratio_is_that_of_the_free_modes() -> None:
    import scipy.linalg

    body = ff.reduce_body(beam(4), NODES, modes=6, damping_ratio=0.02)
    squares, modes = scipy.linalg.eigh(body.stiffness, body.mass_matrix)
    omega = np.sqrt(np.maximum(squares, 0.0))
    modal = modes.T @ body.damping @ modes
    expected = np.diag(np.where(np.arange(body.size) < 6, 0.0, 0.04 * omega))
    np.testing.assert_allclose(modal, expected, atol=1e-6 * omega[6])
    by_stiffness = ff.reduce_body(beam(4), NODES, modes=0, stiffness_damping=1e-4)
    np.testing.assert_array_equal(by_stiffness.damping, 1e-4 * by_stiffness.stiffness)


# -- any form ---


def _orthotropic(domain: mesh.Mesh, moduli: Any, shear: float, name: str = "wood") -> Any:
    """Solid without contraction across, three moduli: a form of the user's own."""
    space = fem.functionspace(domain, ("Lagrange", 2, (3,)))

    def stress(u: Any) -> Any:
        e = ufl.sym(ufl.grad(u))
        entries = [
            [float(moduli[i]) * e[i, j] if i == j else 2.0 * shear * e[i, j] for j in range(3)]
            for i in range(3)
        ]
        return ufl.as_matrix(entries)

    return ff.LinearBody(
        space,
        lambda u, v: ufl.inner(stress(u), ufl.sym(ufl.grad(v))) * ufl.dx,
        [ff.MassField(500.0, ufl.SpatialCoordinate(domain), lambda u: u)],
        stress=stress,
        name=name,
    )


@serial
def test_a_form_of_the_users_own() -> None:
    moduli, shear = (12e9, 0.6e9, 0.3e9), 0.7e9
    domain = mesh.create_box(MPI.COMM_WORLD, [[0, 0, 0], [1.0, 0.1, 0.1]], (4, 1, 1),
                             mesh.CellType.hexahedron)  # fmt: skip
    body = ff.reduce_body(_orthotropic(domain, moduli, shear), ENDS, modes=2)
    # without contraction rigid ends hinder nothing: exact in tension
    assert body.stiffness[0, 0] == pytest.approx(moduli[0] * 0.01, rel=SOLVED)
    with pytest.raises(
        ValueError, match=r'"wood": geometric_stiffness needs the body\'s prestress'
    ):
        ff.reduce_body(_orthotropic(domain, moduli, shear), ENDS, modes=2, geometric_stiffness=True)


# -- ranks ---


@pytest.mark.several_ranks
def test_all_ranks_have_the_data_of_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beam and solid on all ranks and on one; a section of equal stiffnesses has mode pairs."""
    square = ff.Section.rectangle(0.03, 0.03, STEEL)
    pairs = []
    for comm in (MPI.COMM_WORLD, MPI.COMM_SELF):
        plate = ff.shell_body(
            sheet((4, 2), (1.0, 0.5), comm), ff.ShellSection.isotropic(0.01, STEEL)
        )
        options = {"modes": 5, "geometric_stiffness": True, "damping_ratio": 0.01}
        solid = box((6, 1, 1), (0, -0.05, -0.05), (LENGTH, 0.05, 0.05), comm=comm)
        mixed = {"left": "average", "right": "rigid"}
        bodies = [
            ff.reduce_body(beam(8, square, comm), NODES, **options),
            ff.reduce_body(solid, ENDS, ties=mixed, **options),
            ff.reduce_body(plate, ENDS, basis="free_free", **options),
        ]
        with monkeypatch.context() as patch:
            patch.setattr("flexfem.la.whole.LARGEST", 0)  # as if it were large: ranks share it
            bodies.append(ff.reduce_body(solid, modes=5, recovery=False))
            bodies.append(ff.reduce_body(beam(8, square, comm), NODES, modes=2))
        pairs.append(bodies)
    for many, one in zip(*pairs, strict=True):
        found = differences(one, many)
        # direct solvers that sum in another order; modes of a pair in other directions, or other
        # signs, make differences near one
        assert max(found.values()) < 1e-9, found
    cells = MPI.COMM_WORLD.allreduce(len(pairs[0][1].recovery.cells))
    assert cells == len(pairs[1][1].recovery.cells)


@serial
def test_files_can_be_written_after_reducing() -> None:
    """PETSc's HDF5 library must not be the one that h5py finds: it cannot be imported then."""
    program = "import flexfem as ff; ff.reduce_body, ff.shell_body; import h5py"
    subprocess.run([sys.executable, "-c", program], check=True)


# -- refusals ---


@serial
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "give one of modes, frequency and participation"),
        ({"modes": 2, "frequency": 10.0}, "give one of modes"),
        ({"modes": -1}, "modes must be at least 0, got -1"),
        ({"modes": 10**4}, "at most 45 modes of this mesh can be found, the number"),
        ({"frequency": 1e9}, "modes of this mesh can be found, the frequency 1e.09 Hz asks"),
        ({"participation": 0.5, "basis": "free_free"}, "participation is that of modes with"),
        ({"participation": 1.5}, "participation must be less than 1, got 1.5"),
        ({"modes": 2, "basis": "guyan"}, "basis must be one of .* got 'guyan'"),
        ({"modes": 2, "basis": "full"}, '"full" has all modes'),
        ({"modes": 2, "ties": {"tip": "rigid"}}, "ties has the name 'tip', which no interface has"),
        ({"modes": 2, "ties": {"left": "glued"}}, "tie of \"left\" must be one of .* got 'glued'"),
        ({"modes": 2, "ties": {"left": "average"}}, "a mean needs facets"),
        ({"modes": 2, "positions": {"left": (0, 1)}}, 'position of "left" must hold 3 numbers'),
        ({"modes": 2, "damping_ratio": -0.1}, "damping_ratio must not be negative"),
    ],
)
def test_wrong_options_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message) as raised:
        ff.reduce_body(beam(24), NODES, **options)
    assert_on_page(str(raised.value))


@serial
def test_full_bases_of_large_meshes_are_refused() -> None:
    with pytest.raises(
        ValueError, match='"full" can have 1500 unknowns at most, the mesh has 2025'
    ):
        ff.reduce_body(box((13, 2, 2)), ENDS, basis="full")


@serial
def test_wrong_regions_are_refused() -> None:
    solid = box((2, 1, 1), degree=1)
    cases: list[tuple[Any, str]] = [
        ({"a": at(0, 5.0)}, 'interface "a": the mesh has no facets at the points'),
        ({"a": (0.0, 0.0, 0.0)}, "cannot carry all rotations"),
        ({"a": at(0, 0.0), "b": at(1, 0.05)}, 'interface "b": its region shares points'),
        ({"a": lambda x: x[0]}, "must give a truth value"),
    ]
    for interfaces, message in cases:
        with pytest.raises(ValueError, match=message):
            ff.reduce_body(solid, interfaces, modes=1)
    with pytest.raises(TypeError, match="a region must be"):
        ff.reduce_body(solid, {"a": "left"}, modes=1)


@serial
def test_bodies_in_pieces_and_wrong_rigid_motions_are_refused() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [3, 0, 0], [4, 0, 0]])
    whole = beam(1)
    element = basix.ufl.element("Lagrange", "interval", 1, shape=(3,))
    domain = mesh.create_mesh(MPI.COMM_WORLD, np.array([[0, 1], [2, 3]]), element, points)
    with pytest.raises(
        ValueError, match=r"in pieces|do not constrain all rigid motions of the body"
    ):
        ff.reduce_body(ff.beam_body(domain, SECTION), {"a": (0, 0, 0)}, modes=1)

    def without_turning(shift: Any, turn: Any) -> fem.Function:
        assert whole.rigid is not None
        function = whole.rigid(shift, turn)
        function.sub(1).interpolate(lambda x: np.zeros((3, x.shape[1])))
        return function

    with pytest.raises(ValueError, match="rigid motions must have no strain energy"):
        ff.reduce_body(dataclasses.replace(whole, rigid=without_turning), modes=1)
