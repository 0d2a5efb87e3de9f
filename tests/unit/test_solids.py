# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nonlinear solids: derivatives, patch tests, masses, laws at a point, on any number of ranks."""

from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

import flexfem as ff
from flexfem.families.solid.laws.energies import trace_of_power
from flexfem.layout.numbered_model import NumberedModel
from flexfem.layout.tangent_request import EXACT, TangentRequest
from flexfem.lie import so3
from flexfem.system.build import build

COMM = MPI.COMM_WORLD
NEO = ff.laws.NeoHookean.from_young(1e6, 0.4)


def damped(F, rate, p):
    """Objective viscosity: the square of the rate of Green's strain."""
    strain = F.T * rate + rate.T * F
    return p.eta * ufl.inner(strain, strain)


LAWS = {
    "mooney": ff.laws.MooneyRivlin(1e5, 2e4, 1e6),
    "ogden": ff.laws.Ogden([1e5, -2e4], [1.3, -2.0], 1e6),
    "tissue": ff.laws.HolzapfelGasserOgden(1e5, 2e5, 1.0, 1e6, [(1, 1, 0), (1, -1, 0.2)]),
    "muscle": ff.laws.ActiveStress(NEO, lambda t: 1e4 * (1.0 + t), (1, 0, 0)),
    "grown": ff.laws.Growth(NEO, 1.01),
    "damped": ff.laws.Hyperelastic(NEO.energy, {"mu": 1e5, "bulk": 1e6, "eta": 100.0}, damped),
    "relaxing": ff.laws.Viscoelastic(NEO, [1e5], [0.3]),
    "plastic": ff.laws.J2Plasticity(4e5, 1e6, 2e4, 1e4),
}
#: Two branches that are together one of 5e5 Pa and 0.3 s, beside 1e6 Pa.
STANDARD = ff.laws.Viscoelastic(ff.laws.NeoHookean(1e6, 2e6), [3e5, 2e5], [0.3, 0.3])
#: A law with conditions and internal variables; the others are slow to compile.
QUICK = ("plastic",)
CELLS = {
    "tetrahedra": ("tetrahedron", 2, "displacement", None),
    "dilated hexahedra": ("hexahedron", 2, "dilatation", None),
    "wedges": ("prism", 1, "displacement", None),
    "cubic triangles": ("triangle", 3, "displacement", "strain"),
    "ring": ("quadrilateral", 2, "dilatation", "axisymmetric"),
    "thin sheet": ("quadrilateral", 1, "displacement", "stress"),
}

COMMON = ("tetrahedra", "wedges", "thin sheet")


def box(cell: str, degree: int = 1) -> ff.SolidMesh:
    """A distorted box or rectangle of some cells, off the axis, with one quadratic geometry."""
    flat = cell in ("triangle", "quadrilateral")
    sizes, counts = ((1.0, 0.7), (2, 2)) if flat else ((1.0, 0.7, 0.5), (2, 2, 1))
    if cell == "prism":
        # each hexahedron as two wedges
        whole = ff.SolidMesh.box(sizes, counts, origin=(0.2, 0.0, 0.0))
        halves = whole.cells[:, [[0, 1, 3, 4, 5, 7], [0, 3, 2, 4, 7, 6]]].reshape(-1, 6)
        mesh = ff.SolidMesh(whole.points, halves, "prism")
    else:
        mesh = ff.SolidMesh.box(sizes, counts, cell, origin=(0.2, 0.0, 0.0))
    x = mesh.points.copy()
    x[:, 0] += 0.05 * np.sin(4.0 * x[:, 1])
    x[:, 1] += 0.04 * x[:, 0] ** 2
    return mesh.moved(x)


def system(solid: ff.Solid) -> SimpleNamespace:
    """System of one body, split over the ranks."""
    model = ff.Model("test")
    model.add(solid)
    model.validate()
    found = build(NumberedModel(model), COMM, split_above=1)
    (part,) = found.parts
    return SimpleNamespace(solid=solid, all=found, block=part.block, elements=part.elements)


def deform(s: SimpleNamespace) -> None:
    """Move all nodes by a smooth large displacement, with velocities."""
    X, flat = s.block.start_frames[:, :3], s.solid.plane is not None
    moved = [X[:, 1] + 0.5 * X[:, 0], np.sin(X[:, 0]), X[:, 0] ** 2 - 0.3 * X[:, 2]]
    moved[2] = 0.0 * moved[2] if flat else moved[2]
    s.block.frames[:, :3] = X + 0.1 * np.column_stack(moved)
    s.block.velocity[:, :3] = np.cos(X) * (1.0, 1.0, not flat)


def check_derivatives(s: SimpleNamespace, conservative: bool = True) -> None:
    """Forces against differences of the energy, matrix and action against those of the forces."""
    block, elements, still = s.block, s.elements, np.zeros(3)
    deform(s)
    frames = block.frames.copy()
    step = np.sin(1.0 + 3.0 * block.start_frames[:, :3] + np.arange(3))
    step[:, 2] *= s.solid.plane is None
    own = step[: block.owned]

    def residual(at: float) -> np.ndarray:
        block.frames[:, :3], block.residual[:] = frames[:, :3] + at * step, 0.0
        elements.add_residual(block, still, 1.0)
        block.add_ghosts()
        return block.owned_residual.copy()

    def energy(at: float) -> float:
        block.frames[:, :3] = frames[:, :3] + at * step
        return COMM.allreduce(float(elements.energies(block.frames).sum()))

    work = COMM.allreduce(float((residual(0.0) * own).sum()))
    if conservative:
        # differences of 1e-6 are good to 1e-8; a wrong force to no digit
        assert work == pytest.approx((energy(1e-6) - energy(-1e-6)) / 2e-6, rel=1e-6)
    change = (residual(1e-6) - residual(-1e-6)) / 2e-6
    largest = COMM.allreduce(np.abs(change).max(initial=0.0), op=MPI.MAX)
    block.frames[:], block.residual[:], block.step[:, :3] = frames, 0.0, step
    block.spread_step()
    elements.add_action(block, still, np.array([0.0, 0.0, 1.0]), 1.0)
    block.add_ghosts()
    # a term missing in the tangent is 1e-2 of it
    assert np.abs(block.owned_residual - change).max(initial=0.0) < 1e-6 * largest
    action = block.owned_residual.copy()
    matrices = elements.values(block, still, np.array([0.0, 0.0, 1.0]), 1.0).reshape(-1, 3, 3)
    ((rows, columns),) = elements.couplings
    block.residual[:] = 0.0
    np.add.at(
        block.residual[:, :3], rows[:, 0], np.einsum("kij,kj->ki", matrices, step[columns[:, 0]])
    )
    block.add_ghosts()
    assert np.abs(block.owned_residual - action).max(initial=0.0) < 1e-12 * largest


KINDS = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in COMMON else pytest.mark.slow) for name in CELLS]
)


@KINDS
def test_forces_and_matrices_are_derivatives_of_the_energy(name):
    """In cells of all shapes, straight and curved, with and without a dilatation."""
    cell, degree, formulation, plane = CELLS[name]
    s = system(
        ff.Solid("body", NEO, box(cell), density=2.0, degree=degree, formulation=formulation,
                 plane=plane)
    )  # fmt: skip
    check_derivatives(s)


@pytest.mark.serial
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in LAWS]
)
def test_laws_have_consistent_derivatives(name):
    """Stored energies, viscous forces, and internal variables that follow the strain."""
    s = system(ff.Solid("body", LAWS[name], box("tetrahedron"), density=2.0, degree=1))
    s.all.set_time(0.1)
    check_derivatives(s, conservative=name not in ("damped", "relaxing", "plastic"))


@pytest.mark.serial
@pytest.mark.parametrize("exponent", [0.65, -0.5, 1.0, 2.5, -6.0])
def test_traces_of_powers_are_those_of_the_eigenvalues(exponent):
    """Of tensors whose eigenvalues are far apart, nearly equal, and equal."""
    for a, b in ((30.0, 0.5), (1.0 + 1e-9, 1.0), (1.0, 1.0)):
        values = np.array([a, b, 1.0 / (a * b)])
        trace = float(trace_of_power(ufl.as_matrix(np.diag(values).tolist()), exponent))
        # the fractions are good to 1e-8, of the largest eigenvalue's power
        assert trace == pytest.approx((values**exponent).sum(), rel=1e-7)


@pytest.mark.slow_on_ranks
@pytest.mark.parametrize(
    "formulation", ["displacement", pytest.param("dilatation", marks=pytest.mark.slow)]
)
def test_patches_of_distorted_cells_strain_uniformly(formulation):
    """A linear motion of quadratic cells gives one stress, and no force on inner nodes."""
    mesh = box("hexahedron")
    if formulation == "displacement":  # of curved cells
        straight = box("tetrahedron").raised(2)
        mesh = straight.moved(straight.points + 0.02 * np.sin(7.0 * straight.points[:, [1, 2, 0]]))
    s = system(ff.Solid("body", NEO, mesh, density=2.0, formulation=formulation))
    F = np.eye(3) + np.array([[0.3, 0.2, 0.0], [-0.1, -0.2, 0.1], [0.0, 0.3, 0.1]])
    X = s.block.start_frames[:, :3]
    s.block.frames[:, :3] = X @ F.T
    (fields,) = s.elements.fields(s.block)
    J, b = np.linalg.det(F), F @ F.T / np.linalg.det(F) ** (2.0 / 3.0)
    mu, bulk = NEO.shear_modulus, NEO.bulk_modulus
    stress = (mu * (b - np.trace(b) / 3.0 * np.eye(3)) + bulk / 2.0 * (J * J - 1.0) * np.eye(3)) / J
    wanted = [stress[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))]
    # round-off of 1e6 Pa; a quadrature or a gradient that is wrong changes percents
    assert fields[..., :6] == pytest.approx(
        np.broadcast_to(wanted, fields[..., :6].shape), rel=1e-9
    )
    s.block.residual[:] = 0.0
    s.elements.add_residual(s.block, np.zeros(3), 1.0)
    s.block.add_ghosts()
    rim = s.solid.figure.nodes_of("test", "boundary")
    inner = ~np.isin(s.block.node_ids[: s.block.owned], rim)
    largest = COMM.allreduce(np.abs(s.block.owned_residual).max(initial=0.0), op=MPI.MAX)
    assert np.abs(s.block.owned_residual[inner]).max(initial=0.0) < 1e-12 * largest


@pytest.mark.parametrize(
    "name",
    [
        "wedges",
        "thin sheet",
        *(pytest.param(k, marks=pytest.mark.slow) for k in ("dilated hexahedra", "ring")),
    ],
)
def test_continued_stresses_are_linear_along_steps(name):
    """Forces of continued stresses have the tangent's change along a step, to any size of it."""
    cell, degree, formulation, plane = CELLS[name]
    s = system(
        ff.Solid("body", NEO, box(cell), density=2.0, degree=degree, plane=plane,
                 formulation=formulation)
    )  # fmt: skip
    block, elements, still = s.block, s.elements, np.zeros(3)
    deform(s)
    step = np.zeros_like(block.velocity)
    step[:, :3] = np.sin(1.0 + 3.0 * block.start_frames[:, :3] + np.arange(3))
    step[:, 2] *= s.solid.plane is None

    def forces(request: TangentRequest = EXACT) -> np.ndarray:
        block.residual[:] = 0.0
        elements.add_residual(block, still, 1.0, request)
        block.add_ghosts()
        return block.owned_residual.copy()

    def continued(size: float) -> TangentRequest:
        return TangentRequest(elements.continued_strains(block.frames, size * step))

    present = forces()
    by_far, by_near = (forces(continued(size)) - present for size in (0.1, 1e-5))
    largest = COMM.allreduce(np.abs(by_far).max(initial=0.0), op=MPI.MAX)
    if formulation == "displacement":
        # at the same place stresses are linear in the step; curvature of the law is tenths here
        assert np.abs(by_far - 1e4 * by_near).max(initial=0.0) < 1e-6 * largest
    block.frames[:, :3] += 1e-2 * step[:, :3]
    moved, request = continued(0.0), continued(0.05)
    # what is continued along no step is what is there
    assert np.abs(forces(moved) - forces()).max(initial=0.0) < 1e-9 * largest
    block.residual[:] = 0.0
    block.step[:] = step
    elements.add_action(block, still, np.array([0.0, 0.0, 1.0]), 1.0, request)
    block.add_ghosts()
    action = block.owned_residual.copy()
    matrices = elements.values(block, still, np.array([0.0, 0.0, 1.0]), 1.0, request)
    ((rows, columns),) = elements.couplings
    block.residual[:] = 0.0
    parts = np.einsum("kij,kj->ki", matrices.reshape(-1, 3, 3), step[columns[:, 0], :3])
    np.add.at(block.residual[:, :3], rows[:, 0], parts)
    block.add_ghosts()
    size = COMM.allreduce(np.abs(action).max(initial=0.0), op=MPI.MAX)
    # without the excess stresses in one of the two they differ by percents
    assert np.abs(block.owned_residual - action).max(initial=0.0) < 1e-12 * size


@pytest.mark.slow_on_ranks
@KINDS
def test_masses_are_those_of_the_figure(name):
    """Mass, centre and momenta of a rotation, by the cells' matrices and by a quadrature."""
    cell, degree, formulation, plane = CELLS[name]
    s = system(
        ff.Solid("body", NEO, box(cell), density=3.0, degree=degree, plane=plane,
                 formulation=formulation)
    )  # fmt: skip
    points, masses = s.solid.masses
    X = s.block.start_frames[:, :3]
    s.block.velocity[:, :3] = np.cross([0.0, 0.0, 1.0], X)
    motion = np.zeros(11)
    s.elements.add_motion(s.block, np.ones(len(s.elements.body), dtype=bool), motion)
    motion = COMM.allreduce(motion)
    if plane == "axisymmetric":  # a ring does not rotate about z in its plane
        assert motion[1] == pytest.approx(masses.sum(), rel=1e-12)
        return
    square = masses @ (points[:, :2] ** 2).sum(axis=1)
    first = masses @ points
    assert motion[1] == pytest.approx(masses.sum(), rel=1e-12)
    assert motion[2:4] == pytest.approx(first[:2], rel=1e-12)
    assert motion[10] == pytest.approx(square, rel=1e-12)
    assert motion[0] == pytest.approx(0.5 * square, rel=1e-12)


@pytest.mark.slow
@pytest.mark.serial
def test_slender_figure_about_its_axis_is_accepted():
    """The trial of the law shears it along the axis: a shear across would turn radii negative."""
    pin = ff.SolidMesh.box((0.1, 30.0), (1, 1), "quadrilateral")
    quick = LAWS["plastic"]
    solid = ff.Solid("pin", quick, pin, density=3.0, degree=2, formulation="dilatation",
                     plane="axisymmetric")  # fmt: skip
    s = system(solid)
    # the volume of a cylinder; the trial at the start used to refuse it as "not finite"
    assert s.solid.masses[1].sum() == pytest.approx(3.0 * np.pi * 0.1**2 * 30.0, rel=1e-12)


@pytest.mark.serial
@pytest.mark.parametrize("name", ["thin sheet", "tetrahedra"])
def test_lumped_masses_are_positive_and_keep_mass_and_centre(name):
    """The diagonal of each cell, scaled; row sums would be negative at corners of tetrahedra."""
    cell, degree, _, plane = CELLS[name]
    mesh = ff.SolidMesh.box(
        (1.0, 0.7) if plane else (1.0, 0.7, 0.5), (2,) * (2 if plane else 3), cell
    )
    s = system(ff.Solid("body", NEO, mesh, density=3.0, degree=degree, plane=plane, mass="lumped"))
    (group,) = s.elements.groups
    diagonal = np.einsum("mii->mi", group.mass)
    assert (diagonal > 0.0).all()
    assert group.mass == pytest.approx(diagonal[:, :, np.newaxis] * np.eye(diagonal.shape[1]))
    volume = 0.7 if plane else 0.35
    assert diagonal.sum() == pytest.approx(3.0 * volume, rel=1e-12)
    # cells are symmetric about the middle of the box
    points = s.block.start_frames[group.nodes][..., :3]
    centre = np.einsum("mi,mia->a", diagonal, points) / (3.0 * volume)
    assert centre[:2] == pytest.approx([0.5, 0.35], rel=0.05)


@pytest.mark.serial
@pytest.mark.parametrize("name", ["elastic", pytest.param("plastic", marks=pytest.mark.slow)])
def test_plane_stress_is_that_of_a_free_thickness(name):
    """A biaxial stretch; the stretch across by a root of the energy's derivative, or szz = 0."""
    law = NEO if name == "elastic" else LAWS["plastic"]
    mesh = ff.SolidMesh.box((1.0, 1.0), (1, 1), "quadrilateral")
    s = system(ff.Solid("body", law, mesh, density=1.0, degree=1, plane="stress", thickness=0.1))
    a, b = 1.3, 0.9
    s.all.set_time(0.1)
    s.block.frames[:, :2] = s.block.start_frames[:, :2] * (a, b)
    (fields,) = s.elements.fields(s.block)
    stress, J = fields[0, 0, :6], float(fields[0, 0, 12])
    largest = np.abs(stress).max()
    # zero to the round-off of the bulk modulus; in plane strain it is tenths of the others
    assert abs(stress[2]) < 1e-9 * largest
    if name == "elastic":
        mu, bulk = NEO.shear_modulus, NEO.bulk_modulus

        def across(c: float) -> float:
            J, mean = a * b * c, (a * a + b * b + c * c) / 3.0
            return mu * J ** (-2.0 / 3.0) * (c * c - mean) + bulk / 2.0 * (J * J - 1.0)

        c = brentq(across, 0.3, 2.0, xtol=1e-14)
        assert pytest.approx(a * b * c, rel=1e-11) == J
        mean = (a * a + b * b + c * c) / 3.0
        xx = mu * J ** (-5.0 / 3.0) * (a * a - mean) + bulk / 2.0 * (J - 1.0 / J)
        assert stress[0] == pytest.approx(xx, rel=1e-9)
    else:
        check_derivatives(s, conservative=False)


def point(law: ff.laws.SolidLaw, formulation: str = "displacement") -> SimpleNamespace:
    """A cube of side one, whose corners are moved by hand."""
    mesh = ff.SolidMesh.box((1.0, 1.0, 1.0), (1, 1, 1))
    degree = 2 if formulation == "dilatation" else 1
    s = system(ff.Solid("cube", law, mesh, density=1.0, degree=degree, formulation=formulation))
    s.start = s.block.start_frames[:, :3].copy()
    return s


def shear(s: SimpleNamespace, t: float, angle: float) -> float:
    """Shear stress at a simple shear, accepted at a time; work is added to ``s.work``."""
    block, elements = s.block, s.elements
    before = block.frames[:, :3].copy()
    block.frames[:, :3] = s.start
    block.frames[:, 0] += angle * s.start[:, 1]
    s.all.set_time(t)
    block.residual[:] = 0.0
    elements.add_residual(block, np.zeros(3), 1.0)
    turn = block.frames[:, 3:].reshape(-1, 3, 3)
    force = np.einsum("nij,nj->ni", turn, block.residual[:, :3])
    way = block.frames[:, :3] - before
    s.work = getattr(s, "work", 0.0) + 0.5 * float(((getattr(s, "force", 0.0) + force) * way).sum())
    s.force = force
    elements.accept(block)
    (fields,) = elements.fields(block)
    return float(fields[..., 5].mean())


@pytest.mark.serial
def test_viscoelastic_shear_relaxes_exponentially():
    """A shear that is held: the sum of the branches' exponentials, whatever the steps."""
    branches, times, angle = [5e5, 2e5], [0.3, 2.0], 1e-4
    elastic = ff.laws.NeoHookean(1e6, 2e6)
    s = point(ff.laws.Viscoelastic(elastic, branches, times))
    shear(s, 1e-12, angle)
    for t in (0.1, 0.15, 0.5, 2.0):
        expected = 1e6 + sum(mu * np.exp(-t / tau) for mu, tau in zip(branches, times, strict=True))
        # the square of the angle is left out, 1e-8; a step of first order would miss by 1e-2
        assert shear(s, t, angle) == pytest.approx(angle * expected, rel=2e-8)
    stored = float(s.elements.energies(s.block.frames).sum())
    # nothing works while the shear is held
    assert stored + s.elements.lost().sum() == pytest.approx(0.5 * angle**2 * 1.7e6, rel=1e-6)


@pytest.mark.serial
def test_viscoelastic_shear_at_a_rate_is_that_of_a_maxwell_body():
    """Constant rate: mu tau rate (1 - exp(-t/tau)); steps are exact for it."""
    s = point(STANDARD)
    for t in (0.1, 0.2, 0.7):
        stress = shear(s, t, 1e-4 * t)
        expected = 1e6 * 1e-4 * t + 5e5 * 0.3 * 1e-4 * (1.0 - np.exp(-t / 0.3))
        assert stress == pytest.approx(expected, rel=1e-7)


@pytest.mark.slow
@pytest.mark.serial
def test_standard_linear_solid_creeps_in_closed_form():
    """A shear stress that is held: steps of statics, whose load factor is the time."""
    mesh = ff.SolidMesh.box((1.0, 1.0, 1.0), (1, 1, 1))
    held = {"boundary": "yz", "y0": "xyz"}
    model = ff.Model("creep")
    model.add(
        ff.Solid("cube", STANDARD, mesh, density=1.0, degree=1, fixed=held),
        ff.SurfaceTraction("pull", "cube", "y1", (20.0, 0.0, 0.0), amplitude=lambda t: 1.0),
        ff.PositionProbe("top", ff.Marker("cube", (1.0, 1.0, 1.0))),
    )
    options = ff.StaticOptions(load_steps=200, t_end=0.5, tolerance=1e-13)
    history = ff.solve_static(model, options).history
    t, angle = history["t"], history["top_x"] - 1.0
    late = 0.3 * 1.5e6 / 1e6
    expected = 20.0 / 1e6 * (1.0 - 5e5 / 1.5e6 * np.exp(-t / late))
    # second order in the steps of 1/120 of the time, and the square of the angle; without the
    # accepted internal variables of the step before they would miss by a tenth
    assert angle == pytest.approx(expected, rel=1e-5)


@pytest.mark.serial
def test_standard_linear_solid_loses_the_area_of_its_loop():
    """A shear that swings: pi angle^2 times the loss modulus in each period."""
    s, angle, omega, count = point(STANDARD), 1e-4, 4.0, 200
    lost = []
    for k in range(1, 6 * count + 1):
        t = 2.0 * np.pi / omega * k / count
        shear(s, t, angle * float(np.sin(omega * t)))
        if k % count == 0:
            lost.append(float(s.elements.lost().sum()))
    modulus = 5e5 * omega * 0.3 / (1.0 + (omega * 0.3) ** 2)
    # transients are exp(-26); the sum is of second order in steps of 1/200 of the period
    assert lost[-1] - lost[-2] == pytest.approx(np.pi * angle**2 * modulus, rel=1e-3)


@pytest.mark.serial
@pytest.mark.parametrize(
    "formulation", ["displacement", pytest.param("dilatation", marks=pytest.mark.slow)]
)
def test_plastic_shear_hardens_and_unloads_elastically(formulation):
    """Von Mises' yield stress in shear, hardening H/3 beside mu, unloading with mu; energies."""
    mu, limit, H = 80e9, 3e8, 1e9
    s = point(ff.laws.J2Plasticity(mu, 160e9, limit, H), formulation)
    angles = np.linspace(0.0, 0.02, 41)[1:]
    for k, angle in enumerate(angles):
        stress = shear(s, 0.1 * (k + 1), float(angle))
    hardened = (limit / np.sqrt(3.0) + H / 3.0 * angle) / (1.0 + H / (3.0 * mu))
    # squares of elastic strains, 1e-5, and of the shear; without hardening 4 % are missing
    assert stress == pytest.approx(hardened, rel=2e-4)
    stored = float(s.elements.energies(s.block.frames).sum())
    # what is not stored has been dissipated; second order in the steps
    assert stored + s.elements.lost().sum() == pytest.approx(s.work, rel=1e-3)
    back = shear(s, 9.0, float(angle) - 1e-4)
    assert stress - back == pytest.approx(mu * 1e-4, rel=1e-3)


@pytest.mark.serial
def test_internal_variables_return_with_the_state():
    """A restored state goes on as if nothing had come between."""
    s = point(ff.laws.J2Plasticity(80e9, 160e9, 3e8, 1e9))
    shear(s, 0.1, 0.01)
    kept = s.all.state()
    copies = {group: {k: v.copy() for k, v in rows.items()} for group, rows in kept.rows.items()}
    first = shear(s, 0.2, 0.005)
    s.all.restore(type(kept)(kept.values, copies))
    assert shear(s, 0.2, 0.005) == pytest.approx(first, rel=1e-14)
    # without the plastic strain the stress would be that of the elastic shear
    assert abs(first) < 0.5 * 80e9 * 0.005


@pytest.mark.serial
def test_energies_do_not_change_with_rotations():
    """Axes of nodes rotate with the material, and nothing is strained."""
    s = system(ff.Solid("body", NEO, box("tetrahedron"), density=2.0, angular_velocity=(0, 0, 1)))
    turn = so3.exp(np.array([1.0, -2.0, 0.5]))
    s.block.frames[:, :3] = s.block.start_frames[:, :3] @ turn.T
    assert np.abs(s.elements.energies(s.block.frames)).max() < 1e-12 * NEO.shear_modulus
    s.elements.accept(s.block)
    assert s.block.frames[:, 3:].reshape(-1, 3, 3) == pytest.approx(
        np.broadcast_to(turn, (len(s.block.frames), 3, 3)), abs=1e-12
    )


KNOTS = np.array([-1.0, 0.0, 0.04, 0.1, 0.3, 0.8])
ENERGIES = 1e5 * (KNOTS + 0.4 * KNOTS**2 - 0.1 * KNOTS**3)


def tabulated(F, p):
    """Energy of the shape from a table over the first invariant, volumetric part as usual."""
    J = ufl.det(F)
    shape = ff.laws.spline(ufl.tr(F.T * F) - 3.0, KNOTS, ENERGIES)
    # without stress at the start
    slope = CubicSpline(KNOTS, ENERGIES, bc_type="natural")(0.0, 1)
    return shape - 2.0 * float(slope) * ufl.ln(J) + p.bulk / 2.0 * ufl.ln(J) ** 2


@pytest.mark.serial
def test_a_law_from_a_table_has_the_slopes_of_its_spline():
    """Simple shear with I1 - 3 = gamma^2: the stress is 2 gamma W'(gamma^2), beyond it too."""
    found = CubicSpline(KNOTS, ENERGIES, bc_type="natural")
    s = point(ff.laws.Hyperelastic(tabulated, {"bulk": 1e6}))
    for angle in (0.1, 0.3, 0.6, 1.2):
        x = angle**2
        slope = float(found(min(x, KNOTS[-1]), 1))
        # a knot that is left out is 1 % and more
        assert shear(s, angle, angle) == pytest.approx(2.0 * angle * slope, rel=1e-9)


@pytest.mark.serial
def test_splines_of_numbers():
    found = CubicSpline(KNOTS, ENERGIES, bc_type="natural")
    for x in (-0.7, 0.02, 0.2, 0.8):
        assert ff.laws.spline(x, KNOTS, ENERGIES) == pytest.approx(float(found(x)), rel=1e-12)
    end = float(found(0.8)) + 2.0 * float(found(0.8, 1))
    assert ff.laws.spline(2.8, KNOTS, ENERGIES) == pytest.approx(end, rel=1e-12)
    for knots, values, text in (
        ([0.0, 1.0], [0.0, 1.0], "knots must be 3 to 40 increasing numbers"),
        ([0.0, 1.0, 1.0], [0.0] * 3, "knots must be 3 to 40 increasing numbers"),
        ([0.0, 1.0, 2.0], [0.0] * 4, "values must be 3 numbers, got 4"),
    ):
        with pytest.raises(ValueError, match="^spline: " + text):
            ff.laws.spline(1.0, knots, values)
