# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reduced bodies with modal derivatives: their forces, against nonlinear solids, on any ranks."""

from dataclasses import replace
from functools import cache
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, jit, mesh

import flexfem as ff
from flexfem.families.floating.inertia import room_for
from flexfem.families.floating.loops import tangents_into
from flexfem.families.floating.nodes import body_data
from flexfem.lie import se3, so3
from flexfem.reduction.fem.body.strain_energy import law_energy
from flexfem.reduction.fem.modes.derivatives import NonlinearBasis
from tests.unit.reduction_bodies import at
from tests.unit.refusals import assert_on_page
from tests.unit.test_floating_element import _state as node_state

LENGTH, HEIGHT, WIDTH = 1.0, 0.02, 0.05
DENSITY, LOAD = 7850.0, 2e4
STEEL = ff.laws.SaintVenantKirchhoff(2.1e11, 0.3)
CELLS = (6, 1, 1)
LOW = (0.0, -HEIGHT / 2, -WIDTH / 2)
serial = pytest.mark.serial


def clamped(x: Any) -> Any:
    """Both ends."""
    return np.isclose(x[0], 0.0) | np.isclose(x[0], LENGTH)


ENDS = {"root": at(0, 0.0), "tip": at(0, LENGTH)}


def beam(law: Any = STEEL, comm: Any = MPI.COMM_WORLD) -> Any:
    """A beam along x of quadratic hexahedra."""
    high = (LENGTH, HEIGHT / 2, WIDTH / 2)
    domain = mesh.create_box(comm, [LOW, high], CELLS, mesh.CellType.hexahedron)
    return ff.solid_body(domain, law, density=DENSITY)


@cache
def both_ends(derivatives: int, alone: bool = False) -> ff.ReducedBody:
    """The beam with both ends in one interface, of all ranks or of each."""
    comm = MPI.COMM_SELF if alone else MPI.COMM_WORLD
    middle = {"axis": [(0.0, 0.0, 0.0), (LENGTH / 2, 0.0, 0.0), (LENGTH, 0.0, 0.0)]}
    return ff.reduce_body(
        beam(comm=comm), {"ends": clamped}, modes=8, derivatives=derivatives,
        positions={"ends": (0.0, 0.0, 0.0)}, lines=middle,
    )  # fmt: skip


def solid(**fixed: Any) -> ff.Solid:
    """The same beam, not reduced."""
    sizes = (LENGTH, HEIGHT, WIDTH)
    grid = ff.SolidMesh.box(sizes, CELLS, origin=LOW)
    return ff.Solid("beam", STEEL, grid, density=DENSITY, fixed=fixed)


# -- forces --


@serial
@pytest.mark.parametrize(
    ("law", "places"),
    [
        pytest.param(STEEL, ENDS, id="steel"),
        pytest.param(
            ff.laws.NeoHookean(1e6, 2e6), {"ends": clamped}, id="rubber", marks=pytest.mark.slow
        ),
    ],
)
def test_forces_are_those_of_all_cells(
    law: Any, places: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In any displacement of the functions; other laws than Saint Venant's to third order."""
    body, bases = beam(law), []
    usual = NonlinearBasis.polynomial

    def seen(basis: Any, *given: Any) -> Any:
        bases.append(basis)
        return usual(basis, *given)

    monkeypatch.setattr(NonlinearBasis, "polynomial", seen)
    reduced = ff.reduce_body(body, places, modes=2, derivatives=3)
    own, (basis,), polynomial = body.energy, bases, reduced.polynomial
    assert own is not None
    assert polynomial is not None
    functions = np.hstack([basis._static, basis.inner, basis.turned])
    beside = basis._measured()
    u, v = fem.Function(body.space), ufl.TestFunction(body.space)
    F = ufl.Identity(3) + ufl.grad(u)
    measure = ufl.dx(metadata={"quadrature_degree": own.quadrature})
    density = own.density(F, own._values(body.space.mesh))
    work = fem.form(ufl.derivative(density * measure, u, v))
    scale = 1.0 / np.sqrt(np.diagonal(polynomial.stiffness))
    start = scale * np.random.default_rng(1).normal(size=len(scale))
    start /= np.abs(functions @ start).max()
    errors = []
    for size in (0.2 * HEIGHT, 0.1 * HEIGHT):
        u.x.array[:] = functions @ (size * start)
        force = fem.assemble_vector(work).array
        found, expected = polynomial.forces(size * start), functions.T @ force
        errors.append(np.abs(scale * (found - expected)).max() / np.abs(scale * expected).max())
        at_once = size * start[np.newaxis]
        missing, moved = polynomial.displacements(at_once, np.zeros((1, 12 + len(start))))
        stored = fem.assemble_scalar(fem.form(density * measure))
        assert moved == pytest.approx((2.0 * stored) ** 0.5, rel=1e-6 if law is STEEL else 0.02)
        # the residual is the force on the other functions; the linear part alone would be zero
        exact = np.linalg.norm(beside.T @ force)
        assert missing == pytest.approx(exact, rel=1e-6 if law is STEEL else 0.02)
        assert missing > 1e-3 * moved
    if law is STEEL:  # without any part of third order the error is above 1e-3
        assert max(errors) < 1e-9
    else:  # what is left is of fourth order, 8 times smaller at half the size; of third order: 4
        assert errors[0] < 1e-3
        assert errors[0] / errors[1] == pytest.approx(8.0, rel=0.25)


@serial
def test_small_motions_are_linear() -> None:
    """Modes and stiffness at rest are those of the linear body of the same material."""
    body = ff.solid_body(beam().space.mesh, ff.Material(2.1e11, 0.3, DENSITY))
    linear, found = ff.reduce_body(body, {"ends": clamped}, modes=8), both_ends(0)
    # round-off of the solver; plane stress in the place of the solid's would be off by 9 %
    np.testing.assert_allclose(found.frequencies, linear.frequencies, rtol=1e-6)
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(linear.stiffness), 1.0))
    defect = scale[:, np.newaxis] * (found.stiffness - linear.stiffness) * scale
    assert np.abs(defect).max() < 1e-6
    assert found.polynomial is not None
    own = found.stiffness[6:, 6:]
    np.testing.assert_allclose(found.polynomial.stiffness, own, atol=1e-6 * own.max())


def averaged(comm: Any, modes: int = 1, derivatives: int = 0, law: Any = STEEL) -> ff.ReducedBody:
    """The beam with the mean motions of its ends as interfaces."""
    return ff.reduce_body(beam(law, comm), ENDS, modes=modes, derivatives=derivatives,
                          ties=dict.fromkeys(ENDS, "average"))  # fmt: skip


@pytest.mark.three_ranks
@pytest.mark.parametrize("kind", ["rigid", "average"])
def test_any_ranks_give_the_same_numbers(kind: str) -> None:
    if kind == "rigid":
        found, alone = both_ends(6), both_ends(6, alone=True)
    else:
        found, alone = averaged(MPI.COMM_WORLD), averaged(MPI.COMM_SELF)
    assert found.polynomial is not None
    assert alone.polynomial is not None
    for name, values in alone.polynomial.arrays.items():
        # modes of another sign, or a share of the cells left out, would be another order of size
        np.testing.assert_allclose(
            found.polynomial.arrays[name],
            values,
            rtol=0,
            atol=1e-8 * np.abs(values).max(initial=0.0),
        )


# -- bodies --


def sagging(derivatives: int) -> tuple[float, float, list[str]]:
    """Deflection of the middle under its weight in heights, what is missing, and warnings."""
    reduced, model = both_ends(derivatives), ff.Model("sagging")
    model.add(
        ff.FloatingBody("beam", reduced),
        ff.Gravity((0.0, -LOAD, 0.0)),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("beam", "ends")),
        ff.ReductionErrorProbe("missing", "beam"),
    )
    numbers = range(0, reduced.modes, 3)
    model.add(*[ff.PositionProbe(f"a{k}", ff.AmplitudeMarker("beam", k)) for k in numbers])
    outcome = ff.solve_static(model, ff.StaticOptions(quiet=True, load_steps=1))
    end = {name: values[-1] for name, values in outcome.history.items()}
    amplitudes = np.array([end[f"a{k}_{axis}"] for k in numbers for axis in "xyz"])
    middle = reduced.lines["axis"].displacement[1, 1, 6:]
    deflection = middle @ amplitudes[: reduced.modes] / HEIGHT
    lines = [line for line in outcome.summary["warnings"] if "deforms as its modes cannot" in line]
    return float(deflection), float(end["missing"]), lines


@serial
def test_clamped_beam_stiffens_as_it_sags() -> None:
    model = ff.Model("solid")
    model.add(
        solid(x0="xyz", x1="xyz"),
        ff.Gravity((0.0, -LOAD, 0.0)),
        ff.PositionProbe("middle", ff.Marker("beam", (LENGTH / 2, 0.0, 0.0))),
    )
    history = ff.solve_static(model, ff.StaticOptions(quiet=True, load_steps=1)).history
    exact = history["middle_y"][-1] / HEIGHT
    found, missing, lines = sagging(6)
    assert exact < -1.2
    assert found == pytest.approx(exact, rel=0.01)
    assert missing < 0.08
    assert lines == []
    # modes alone do not let the axis lengthen evenly: membrane locking, and the run says so
    locked, missing, lines = sagging(0)
    assert locked > 0.7 * exact
    assert missing > 0.5
    (line,) = lines
    assert line.startswith('FloatingBody "beam": it deforms as its modes cannot: they miss 0.')
    assert_on_page(line)


def under(body: Any, gravity: Any, *parts: Any) -> dict[str, float]:
    """Values at the end of statics."""
    model = ff.Model("hanging")
    model.add(body, ff.Gravity(gravity), ff.EnergyProbe("e"), *parts)
    outcome = ff.solve_static(model, ff.StaticOptions(quiet=True, load_steps=1))
    assert outcome.history is not None
    lines = [line for line in outcome.summary["warnings"] if "deforms as its modes cannot" in line]
    return {name: values[-1] for name, values in outcome.history.items()} | {"lines": len(lines)}


@pytest.mark.slow
@serial
def test_what_modes_miss_of_a_weight() -> None:
    """The exact error of small deflections, whose squares in the energy norm add up."""
    base = ff.Rigid("clamp", ff.Ground(), ff.Marker("beam", "ends"))
    probe = ff.ReductionErrorProbe("missing", "beam")
    found = []
    for gravity, modes in (((0.0, -1.0, 0.0), 1), ((0.0, -1.0, 0.0), 4), ((0.0, 0.0, -100.0), 1)):
        exact = under(solid(x0="xyz", x1="xyz"), gravity)["e_strain"]
        reduced = ff.reduce_body(beam(), {"ends": clamped}, modes=modes, derivatives=0,
                                 positions={"ends": (0.0, 0.0, 0.0)})  # fmt: skip
        end = under(ff.FloatingBody("beam", reduced), gravity, base, probe)
        true = max(1.0 - end["e_strain"] / exact, 0.0) ** 0.5
        # without the inertia forces in the residual it would be below 1e-4
        assert end["missing"] == pytest.approx(true, abs=2e-5)
        found.append(end)
    one, four, across = found
    assert four["missing"] < 0.7 * one["missing"]
    assert one["missing"] < 0.12
    # the one mode bends the beam the other way: nothing moves
    assert across["missing"] > 0.99
    assert across["lines"] == 1


@serial
def test_tetrahedra_have_points_enough() -> None:
    """Gradients of quadratic ones are linear: their energy of second order takes degree two."""
    made = ff.solid_body(mesh.create_unit_cube(MPI.COMM_SELF, 1, 1, 1), STEEL, density=DENSITY)
    assert made.energy is not None
    # a rule of degree one would let cells hourglass
    assert made.energy.quadrature == 2


@serial
def test_derivatives_of_a_law_are_compiled_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The second body with the law takes the file of the first: a second for each of them else."""
    names, compiled = set(), jit.ffcx_jit

    def noted(*arguments: Any, **more: Any) -> Any:
        found = compiled(*arguments, **more)
        names.add(found[1].__name__)
        return found

    monkeypatch.setattr(jit, "ffcx_jit", noted)
    for _ in range(2):
        energy = law_energy("body", STEEL, 2)
        assert energy is not None
        assert energy.derivatives
    assert len(names) == 1


@serial
def test_a_region_turns_rigidly() -> None:
    """With its line for sliders and its picture, by a radian in the frame of the other end."""
    across = [(LENGTH, y, 0.02) for y in (-HEIGHT / 2, 0.0, HEIGHT / 2)]
    body = ff.reduce_body(
        beam(comm=MPI.COMM_SELF), ENDS, modes=1, derivatives=0, lines={"across": across}
    )
    t = np.array([0.3, -0.5, 0.8])
    R, turned = so3.exp(t), np.zeros(body.functions)
    turned[9:12] = np.sin(np.linalg.norm(t)) / np.linalg.norm(t) * t
    turned[body.size :] = (R + R.T - (np.trace(R) - 1.0) * np.eye(3))[np.triu_indices(3)]
    assert body.recovery is not None
    line, face = body.lines["across"], np.isclose(body.recovery.points[:, 0], LENGTH)
    for points, moves in (
        (line.points, line.displacement),
        (body.recovery.points[face], body.recovery.displacement[face]),
    ):
        # the rotation vector without products would be off by 0.4 of the height
        away = moves @ turned - (points - [LENGTH, 0.0, 0.0]) @ (R - np.eye(3)).T
        assert np.abs(away).max() < 1e-9 * HEIGHT


def cap(x: Any) -> Any:
    """Vertices of the last cell: of its end face and the sides around it."""
    return x[0] > 0.8


@serial
@pytest.mark.parametrize(("where", "stretches"), [(ENDS["tip"], 3), (cap, 6)], ids=["end", "cap"])
def test_a_mean_turns_as_a_rigid_region(
    where: Any, stretches: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its moments of order zero and one, about another place than its centre, at any angle."""
    body, bases, usual = beam(comm=MPI.COMM_SELF), [], NonlinearBasis.polynomial

    def seen(basis: Any, *given: Any) -> Any:
        bases.append(basis)
        return usual(basis, *given)

    monkeypatch.setattr(NonlinearBasis, "polynomial", seen)
    place, domain = np.array([1.1, 0.02, -0.01]), body.space.mesh
    facets = mesh.locate_entities_boundary(domain, 2, where)
    tags = mesh.meshtags(domain, 2, facets, np.ones(len(facets), dtype=np.int32))
    ff.reduce_body(
        body, {"root": ENDS["root"], "tip": (tags, 1)}, modes=1, derivatives=0,
        ties={"tip": "average"}, positions={"tip": place},
    )  # fmt: skip
    (basis,) = bases
    assert basis._pieces.ties.conditions.shape[1] == 6 + stretches
    u, ds = fem.Function(body.space), ufl.ds(domain, subdomain_data=tags)
    arm = ufl.SpatialCoordinate(domain) - ufl.as_vector(place)
    which = fem.Constant(domain, np.zeros((3, 4)))
    by = which * ufl.as_vector([1.0, *(arm[i] for i in range(3))])
    t = np.array([1.0, -0.8, 1.5])
    R, sine = so3.exp(t), np.sin(np.linalg.norm(t)) / np.linalg.norm(t) * t
    products = (R + R.T - (np.trace(R) - 1.0) * np.eye(3))[np.triu_indices(3)]
    u.x.array[:] = basis._static[:, 3:] @ sine + basis.turned @ products
    rigid = fem.Constant(domain, R - np.eye(3)) * arm
    forms = [fem.form(ufl.dot(by, field) * ds(1)) for field in (u, rigid)]
    found = np.empty((12, 2))
    for i, moments in enumerate(found):
        which.value[:] = np.arange(12).reshape(3, 4) == i
        moments[:] = [fem.assemble_scalar(form) for form in forms]
    # a mean rotation alone is half of the moments' size off
    assert found[:, 0] == pytest.approx(found[:, 1], abs=1e-9 * np.abs(found).max())


@serial
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_mean_rotation_has_inertia_at_a_right_angle(axis: int) -> None:
    reduced = averaged(MPI.COMM_SELF)
    data, nodes = body_data(ff.FloatingBody("beam", reduced)), 3
    still, out = np.zeros((nodes, 6)), np.empty((1, 6 * nodes, 6 * nodes))
    least = []
    for angle in (0.0, 0.5 * np.pi):
        frames = np.tile(se3.frame(np.zeros(3), np.eye(3)), (nodes, 1))
        frames[1] = se3.frame(data.rest[0], so3.exp(angle * np.eye(3)[axis]))
        state = node_state(frames=frames, velocity=still, acceleration=still, increment=still)
        tangents_into(
            data.memory, room_for(data, nodes).memory, np.arange(3, dtype=np.int32)[np.newaxis],
            state.memory, np.zeros(3), np.array([0.0, 1.0, 0.0]), False, out,
        )  # fmt: skip
        # six of the tip and the one amplitude
        least.append(np.linalg.eigvalsh(out[0, 6:13, 6:13])[0])
    # its sine alone has none: 1e-16; the rigid tie has 0.03 to 0.15 of that at rest
    assert least[1] > 0.01 * least[0]
    if axis == 2:  # as of a tie by the mean rotation alone
        polynomial = reduced.polynomial
        assert polynomial is not None
        products = polynomial.products.copy()
        products[..., -6:], products[:, :, -6:] = 0.0, 0.0
        with pytest.raises(ValueError, match="no inertia where it is turned by a ri") as raised:
            replace(reduced, polynomial=replace(polynomial, products=products))
        assert_on_page(str(raised.value))


@pytest.mark.slow
def test_an_average_end_bends_past_a_right_angle() -> None:
    """A moment rolls a beam up, which then springs back; its tip is tied on average, or rigidly."""
    law, angles = ff.laws.SaintVenantKirchhoff(2e7, 0.3), []
    moment = 3.0 * 2e7 * WIDTH * HEIGHT**3 / 12.0
    bodies = (
        averaged(MPI.COMM_WORLD, 4, 8, law),
        ff.reduce_body(beam(law), ENDS, modes=4, derivatives=8),
    )
    for reduced in bodies:
        model, tip = ff.Model("rolled"), ff.Marker("beam", "tip")
        model.add(
            ff.FloatingBody("beam", reduced),
            ff.Rigid("clamp", ff.Ground(), ff.Marker("beam", "root")),
            ff.PointMoment("roll", tip, (0.0, 0.0, moment), amplitude=lambda t: float(t <= 0.0)),
            ff.PositionProbe("tip", tip),
            ff.PositionProbe("ahead", ff.Marker("beam", "tip", offset=(1.0, 0.0, 0.0))),
            ff.EnergyProbe("energy"),
        )
        options = ff.RunOptions(dt=1e-3, t_end=0.05, start="equilibrium", rho_inf=0.8, quiet=True)
        outcome = ff.simulate(model, options)
        assert outcome.status == "ok"
        if not (history := outcome.history):  # of other ranks
            continue
        x, y = (history[f"ahead_{axis}"] - history[f"tip_{axis}"] for axis in "xy")
        angles.append(np.arctan2(y, x))
        energy = history["energy_kinetic"] + history["energy_strain"]
        # by a mean rotation alone there is no equilibrium; what is lost is the scheme's damping
        assert energy.max() < (1.0 + 1e-6) * energy[0]
        assert energy[-1] > 0.99 * energy[0]
        assert angles[-1][0] > 1.02 * np.pi / 2
        assert angles[-1][-1] < 0.98 * np.pi / 2
    # warping of the end is all that differs
    if angles:
        np.testing.assert_allclose(*angles, atol=0.03)


@serial
def test_stresses_are_those_of_the_law() -> None:
    """A stretched block whose ends may contract: Saint Venant's second law in closed form."""
    block = mesh.create_box(MPI.COMM_SELF, [(0, 0, 0), (LENGTH, 1, 1)], (1, 1, 1),
                            mesh.CellType.hexahedron)  # fmt: skip
    body = ff.reduce_body(
        ff.solid_body(block, STEEL, degree=1, density=DENSITY), {"root": at(0, 0.0)},
        basis="full", derivatives=0, ties={"root": "average"},
    )  # fmt: skip
    assert body.recovery is not None
    stretch = 0.1
    H = np.diag([stretch, -0.3 * stretch, -0.3 * stretch])
    F, lame, shear = np.eye(3) + H, 2.1e11 * 0.3 / (1.3 * 0.4), 2.1e11 / 2.6
    green = 0.5 * (F.T @ F - np.eye(3))
    second = lame * np.trace(green) * np.eye(3) + 2.0 * shear * green
    stress = F @ second @ F.T / np.linalg.det(F)
    expected = [*np.diagonal(stress), 0.0, 0.0, 0.0]
    # the mean displacement of the root is zero, and its centre at (0, 1/2, 1/2)
    moved = (body.recovery.points - [0.0, 0.5, 0.5]) @ H
    functions = body.recovery.displacement.reshape(moved.size, -1)
    strains = np.linalg.lstsq(functions[:, 6:], moved.ravel())[0]
    assert functions[:, 6:] @ strains == pytest.approx(moved.ravel(), abs=1e-9)
    found = body.recovery.stresses(np.concatenate([np.zeros(6), strains]))
    # linear stresses would be off by a fifth
    np.testing.assert_allclose(found, np.tile(expected, (len(found), 1)), atol=1e-6 * expected[0])


# -- refusals --

MU, BULK = 8e10, 1.7e11


def refused(law: Any, message: str) -> None:
    """A law is refused in one line that is on the page of errors."""
    with pytest.raises(ValueError, match=message) as raised:
        beam(law, MPI.COMM_SELF)
    assert_on_page(str(raised.value))


@pytest.mark.slow
@serial
def test_laws_that_have_no_polynomial() -> None:
    laws, elastic = ff.laws, ff.laws.NeoHookean(MU, BULK)
    refused(laws.J2Plasticity(MU, BULK, 2e8, 1e9), "J2Plasticity has internal variables")
    refused(laws.ActiveStress(elastic, lambda t: t), '"tension" must not change with time')
    many = laws.NeoHookean(np.linspace(MU, 2.0 * MU, 6), BULK)
    refused(many, '"mu" must be one number for the whole body')
    refused(laws.ActiveStress(elastic, 1e5), "stress of 1e.05 Pa at rest")
    fibres = laws.HolzapfelGasserOgden(MU, MU, 2.0, BULK, [(1.0, 0.0, 0.0)])
    refused(fibres, "its law has a kink")
    damped = laws.Hyperelastic(elastic.energy, {"mu": MU, "bulk": BULK}, lambda F, rate, p: p.mu)
    refused(damped, "Hyperelastic has viscosity")
    change = ufl.Identity(3)
    turning = laws.Hyperelastic(lambda F, p: MU * ufl.inner(F - change, F - change), {})
    refused(turning, "changes as the body rotates")


@serial
def test_bodies_that_have_no_derivatives(monkeypatch: pytest.MonkeyPatch) -> None:
    body, one = beam(comm=MPI.COMM_SELF), {"ends": clamped}
    linear = ff.solid_body(body.space.mesh, ff.Material(2.1e11, 0.3, DENSITY))
    for make, message in {
        lambda: ff.reduce_body(linear, one, modes=1, derivatives=1): "linear body has no deriv",
        lambda: ff.reduce_body(body, one, modes=0, derivatives=1): "derivatives need modes, or a",
        lambda: ff.reduce_body(body, one, modes=1, derivatives=2): "derivatives must be at most 1",
    }.items():
        with pytest.raises(ValueError, match=message) as raised:
            make()
        assert_on_page(str(raised.value))
    with monkeypatch.context() as little:
        little.setattr("flexfem.reduction.fem.modes.derivatives.available", lambda: 100.0)
        with pytest.raises(ValueError, match="in 2 coordinates need ") as raised:
            ff.reduce_body(body, one, modes=1, derivatives=1)
    assert_on_page(str(raised.value))
    reduced = ff.reduce_body(body, ENDS, modes=0, derivatives=1, geometric_stiffness=True)
    for given, message in {
        "tip": 'nonlinear in the frame of "root"', "mean_axes": 'nonlinear in the frame of "root"'
    }.items():  # fmt: skip
        with pytest.raises(ValueError, match=message) as raised:
            ff.FloatingBody("beam", reduced, frame=given)
        assert_on_page(str(raised.value))
    with pytest.raises(ValueError, match="stiffen already") as raised:
        ff.FloatingBody("beam", reduced, stiffening=True)
    assert_on_page(str(raised.value))
    model = ff.Model("m")
    model.add(ff.FloatingBody("beam", ff.reduce_body(linear, one, modes=1)))
    probe = ff.ReductionErrorProbe("e", "beam")
    with pytest.raises(ValueError, match='no body "beam" that was reduced with') as raised:
        probe.check(model)
    assert_on_page(str(raised.value))
