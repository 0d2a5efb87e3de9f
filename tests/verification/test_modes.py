# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modes, Campbell diagrams and linear models against closed forms and other formulations."""

import dataclasses
import importlib
import re
from itertools import product

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
from dolfinx.mesh import CellType, create_box

import flexfem as ff
from flexfem import launch
from tests.unit.particle_body import bar
from tests.unit.refusals import assert_on_page

AXIS = (0.0, 0.0, 1.0)


def _straight_beam():
    return importlib.import_module("tests.verification.benchmarks.straight_beam")


@pytest.mark.serial
@pytest.mark.parametrize("topic", ["beams", "rotating", "rotors", "mechanisms"])
def test_published_values_and_closed_forms(topic):
    module = importlib.import_module(f"tests.verification.benchmarks.modal_{topic}")
    results = module.results()
    # tolerances are the errors of the meshes, (h/wave length)^2; without centrifugal stiffening or
    # gyroscopic terms frequencies are off by percents to factors
    assert results
    assert [r for r in results if not r.passed] == []


def _rotor(damping=0.0, elements=8):
    """A symmetric shaft with a disk at its end, in a driven bearing: pairs of equal frequencies."""
    straight = _straight_beam()
    section = ff.Section.general((1e5, 1e5, 1e5, 80.0, 100.0, 100.0), (1, 1, 1, 2e-3, 1e-3, 1e-3))
    model = straight.beam_model(section, elements, direction=AXIS, damping=damping)
    model.add(
        ff.RigidBody("disk", 2.0, (0.3, 0.3, 0.6), position=(0, 0, 1.0)),
        ff.Rigid("fit", ff.Marker("beam", "end"), ff.Marker("disk")),
        ff.Revolute("bearing", ff.Ground(), ff.Marker("beam", "start"), axis=AXIS),
        ff.PrescribedAngle("drive", ff.Ground(), ff.Marker("beam", "start"), axis=AXIS),
        ff.PointForce("push", ff.Marker("disk"), (1.0, 0, 0), amplitude=lambda t: 0.0),
        ff.PositionProbe("disk_at", ff.Marker("disk")),
    )
    return model


def _shapes(modes):
    """Shapes of all nodes in the order of the input, on every rank."""
    system, parts = modes.linearization.system, []
    local = [modes.linearization.split(shape) for shape in modes.shapes]
    for k, part in enumerate(system.parts):
        block = part.block
        full = np.zeros((len(modes), block.size_global, 6), dtype=complex)
        full[:, block.node_ids[: block.owned]] = [shape[k] for shape in local]
        parts.append(system.comm.allreduce(full))
    return np.concatenate(parts, axis=1)


@pytest.mark.parametrize("spin", [0.0, pytest.param(20.0, marks=pytest.mark.three_ranks)])
@pytest.mark.parametrize(("damping", "dense"), [(0.0, 0), (2e-4, 100)])
def test_any_number_of_ranks_gives_the_same_modes(spin, damping, dense, monkeypatch):
    from flexfem.solvers.modal import modes as solver

    options = ff.ModeOptions(modes=5, spin=spin, split_above=1, quiet=True)
    monkeypatch.setattr(solver, "_DENSE_FOR_MANY", 0)
    monkeypatch.setattr(solver, "_DENSE", dense)
    found = ff.find_modes(_rotor(damping), options).modes
    monkeypatch.setattr(solver, "_DENSE", 1000)  # the other way to solve it, on each rank by itself
    alone = ff.find_modes(_rotor(damping), options, comm=MPI.COMM_SELF).modes
    # round-off of the stiffness, 1e-16 of the largest frequency squared, is 1e-11 of these
    # frequencies; a lost term of one rank or a polluted Krylov space changes the first digits
    np.testing.assert_allclose(found.eigenvalues, alone.eigenvalues, rtol=1e-9, atol=1e-9)
    # pairs of equal frequencies are turned by fixed motions: any other basis differs by order one
    # (modes 1 and 2, 4 and 5 at rest)
    np.testing.assert_allclose(_shapes(found), _shapes(alone), atol=2e-6)
    np.testing.assert_allclose(found.masses, alone.masses, atol=1e-6)


def test_mass_of_rigid_motions_is_that_of_the_model():
    straight = _straight_beam()
    model = straight.beam_model(straight.slender(), 6)
    model.add(ff.PointMass("lump", 0.5, ff.Marker("beam", "end")))
    outcome = ff.find_modes(model, ff.ModeOptions(modes=8, quiet=True))
    modes = outcome.modes
    # six rigid motions, neither five nor seven, with the whole mass of 1 + 0.5 kg in each direction
    assert list(modes.frequencies > 0.0) == 6 * [False] + 2 * [True]
    np.testing.assert_allclose(modes.masses[:6].sum(axis=0), 1.5, rtol=1e-9)


def _soft(elements=20):
    """A blade that bends 10^8 times more easily than it stretches, on a driven hub."""
    straight, stiff = _straight_beam(), (1e8,) * 3
    section = ff.Section.general((*stiff, 1.0, 1.0, 1e4), (1, 1, 1, 2e-8, 1e-8, 1e-8))
    model = straight.beam_model(section, elements)
    model.add(
        ff.RigidBody("hub", 1.0, (1.0, 1.0, 1.0)),
        ff.Revolute("bearing", ff.Ground(), ff.Marker("hub"), axis=AXIS),
        ff.PrescribedAngle("drive", ff.Ground(), ff.Marker("hub"), axis=AXIS),
        ff.Rigid("clamp", ff.Marker("hub"), ff.Marker("beam", "start")),
    )
    return model


def _free_eigenvalues(linearization):
    """All eigenvalues in the upper half plane of the assembled matrices, by LAPACK's pencil."""
    from flexfem.la.dense import gather_rows

    given = linearization.matrices()
    K, C, M = (gather_rows(m) for m in (given.stiffness, given.damping, given.mass))
    n = linearization.unknowns
    free = scipy.linalg.null_space(K[n:, :n])
    K, C, M = (free.T @ matrix[:n, :n] @ free for matrix in (K, C, M))
    eye, nothing = np.eye(len(K)), np.zeros_like(K)
    values = scipy.linalg.eigvals(
        np.block([[nothing, eye], [-K, -C]]), np.block([[eye, nothing], [nothing, M]])
    )
    return np.sort(values.imag[values.imag > 0.0])


@pytest.mark.parametrize(
    "accuracy", [1e-6, *(pytest.param(a, marks=pytest.mark.serial) for a in (1e-10, 1e-3))]
)
def test_soft_blades_have_their_modes_whatever_the_accuracy(accuracy, monkeypatch):
    """Bending far below the stiffest motion: 0, 0 and 22.5 rad/s where the shift hides it."""
    from flexfem.solvers.modal import modes as solver

    monkeypatch.setattr(solver, "_DENSE_FOR_MANY", 0)
    options = ff.ModeOptions(modes=3, spin=2.0, accuracy=accuracy, split_above=1, quiet=True)
    outcome = ff.find_modes(_soft(), options)
    assert outcome.status == "ok"
    assert outcome.summary["checks"]["largest_residual"] <= 10.0 * accuracy
    # Wright et al. (1982), less the mesh's error; the wrong ones were 0, 0, 22.5
    expected, mesh = (4.1373, 22.6149, 62.2732), (5e-4, 7e-3, 2e-2)
    found = outcome.modes.eigenvalues.imag
    assert np.all(np.abs(found / expected - 1.0) <= np.add(mesh, 2.0 * accuracy))
    fine = ff.find_modes(_soft(), ff.ModeOptions(modes=3, spin=2.0, quiet=True)).modes
    # round-off of the stiffness is 1e-6 of the first one
    np.testing.assert_allclose(found, fine.eigenvalues.imag, rtol=3e-6 + 2.0 * accuracy)


@pytest.mark.serial
@pytest.mark.parametrize("accuracy", [1e-10, 1e-6])
def test_a_free_turn_is_one_mode_whatever_the_accuracy(accuracy):
    """Its double zero, which round-off divides into two real ones or conjugates, counts once."""
    rubber = ff.Material(youngs_modulus=2e6, poisson_ratio=0.3, density=1000.0)
    model = ff.Model(mesh=ff.LineMesh.straight({"rod": [(0, 0, 0), (1, 0, 0)]}, 30))
    end = ff.Marker("rod", "start")
    model.add(
        ff.Beam("rod", ff.Section.rectangle(0.02, 0.02, rubber)),
        ff.Revolute("pin", ff.Ground(), end, axis=(0.0, 0.0, 1.0)),
    )
    options = ff.ModeOptions(modes=7, spin=2.0, accuracy=accuracy, quiet=True)
    found = ff.find_modes(model, options).modes.eigenvalues.imag
    # the beam's equation with 60 Hermite elements; it was 0, 0, 2.327
    assert found[0] == 0.0
    assert found[1] == pytest.approx(2.3271, rel=1e-3)
    assert found[2] > 5.0


@pytest.mark.three_ranks
def test_vectors_of_dense_problems_are_not_spoilt_by_constraints(monkeypatch):
    """Round-off of constrained motions, which was in modes of this blade on three ranks."""
    from flexfem.solvers.modal import modes as solver

    section = ff.Section.general((1e5,) * 3 + (80.0, 100.0, 100.0), (1, 1, 1, 2e-3, 1e-3, 1e-3))
    model, hub = _straight_beam().beam_model(section, 10, damping=1e-4), ff.Marker("hub")
    model.add(
        ff.RigidBody("hub", 1.0, (1.0, 1.0, 1.0)),
        ff.Revolute("bearing", ff.Ground(), hub, axis=AXIS),
        ff.PrescribedAngle("drive", ff.Ground(), hub, axis=AXIS),
        ff.Rigid("clamp", hub, ff.Marker("beam", "start")),
    )
    monkeypatch.setattr(solver, "_PASSES", 1)  # other shifts may have other round-off
    found = ff.find_modes(model, ff.ModeOptions(modes=6, spin=5.0, split_above=1, quiet=True))
    assert found.status == "ok"
    assert found.summary["checks"]["largest_residual"] < 1e-10


@pytest.mark.parametrize("count", [8, 10, 14])
def test_damped_free_bars_have_all_their_modes(count):
    """The double zeros of six rigid motions, which round-off parts as it likes, take no place."""
    omega = ff.find_modes(_free_bar(0.0), ff.ModeOptions(modes=count, quiet=True)).modes
    found = ff.find_modes(_free_bar(1e-4), ff.ModeOptions(modes=count, quiet=True))
    assert found.status == "ok"
    w = omega.eigenvalues.imag
    expected = -0.5e-4 * w**2 + 1j * w * np.sqrt(1.0 - (0.5e-4 * w) ** 2)
    # 1e-8 of the highest is left open by the accuracy; a lost mode shifts all that follow
    np.testing.assert_allclose(found.modes.eigenvalues, expected, atol=1e-5, rtol=0.0)


_CHAINS = {
    # springs and dampers before each mass, and the number of motions of frequency zero
    "free": ((3.0, 1.0, 5.0), (0.0, 2.0, 0.0), (0.0, 0.0, 0.3), 2),
    "beside a held one": ((7.0, 5.0, 5.0, 3.0), (30.0, 0, 0, 2.0), (0, 0, 2.0, 0), 2),
    "in pieces": ((3.0, 5.0, 5.0, 7.0, 1.0), (0, 30.0, 0, 0, 0), (0, 0, 2.0, 0, 0), 4),
    "heavily damped": ((4.0, 0.2, 1.0), (0.0, 0.4, 0.1), (0.0, 170.0, 0.03), 1),
}


@pytest.mark.parametrize("kind", _CHAINS)
def test_chains_with_free_parts_have_all_their_modes(kind):
    """Vectors of several double zeros may be one and the same, fast decay is not a zero."""
    masses, springs, dampers, free = _CHAINS[kind]
    model, count = _chain(masses, springs, dampers), len(masses)
    found = ff.find_modes(model, ff.ModeOptions(modes=count, quiet=True))
    assert found.status == "ok"
    step = np.eye(count) - np.eye(count, k=-1)
    stiffness, damping = (step.T @ np.diag(given) @ step for given in (springs, dampers))
    assert np.linalg.matrix_rank(stiffness) == count - free
    over = np.diag(1.0 / np.array(masses))
    eye, nothing = np.eye(count), np.zeros((count, count))
    values = np.linalg.eigvals(np.block([[nothing, eye], [-over @ stiffness, -over @ damping]]))
    # those of zeros are roots of round-off
    values = values[(values.imag >= 0.0) & (np.abs(values) > 1e-5)]
    values = values[np.argsort(np.abs(values))][: count - free]
    expected = np.concatenate([np.zeros(free), values])
    np.testing.assert_allclose(found.modes.eigenvalues, expected, rtol=1e-7, atol=1e-9)


def _chain(masses, springs, dampers):
    """Masses on a line with springs and dampers from each to the one before it, or the ground."""
    model, before = ff.Model(), ff.Ground()
    for k, (mass, spring, damper) in enumerate(zip(masses, springs, dampers, strict=True)):
        place = (3.0 * (k + 1), 0.0, 0.0)
        body = ff.RigidBody(f"body_{k}", mass, (1.0, 1.0, 1.0), position=place)
        slide = ff.Prismatic(f"slide_{k}", ff.Ground(place), ff.Marker(body.name), axis=(1, 0, 0))
        model.add(body, slide)
        if spring or damper:
            ends = before, ff.Marker(body.name)
            model.add(ff.SpringDamper(f"link_{k}", *ends, stiffness=spring, damping=damper))
        before = ff.Marker(body.name)
    return model


_FREE_PARTS = (
    ((1.0, 2.0, 1.0, 2.0), (2.0, 0.0, 0.0, 2.0), (0.0, 0.1, 0.0, 0.1)),
    ((3.0, 1.0, 2.0, 2.0), (0.0, 0.0, 0.0, 30.0), (0.0, 0.0, 0.0, 0.3)),
    ((2.0, 2.0, 3.0, 7.0, 1.0), (0.0, 0.0, 0.0, 30.0, 30.0), (0.0, 2.0, 0.0, 2.0, 0.0)),
    ((1.0, 3.0, 1.0, 1.0, 7.0, 5.0), (0, 30.0, 5.0, 0, 30.0, 30.0), (0.1, 0, 0.3, 0, 0, 0)),
    ((1.0, 3.0, 2.0, 2.0, 7.0, 3.0), (30.0, 0, 0, 2.0, 30.0, 30.0), (0.3, 0.1, 0, 2.0, 2.0, 0.1)),
    ((7.0, 1.0, 5.0, 7.0, 1.0, 5.0), (0, 0, 2.0, 5.0, 0, 30.0), (0, 0.3, 0, 0, 0, 0.1)),
    ((2.0, 1.0, 3.0, 7.0, 7.0), (5.0, 0.0, 2.0, 0.0, 30.0), (0.0, 0.0, 0.0, 0.3, 0.1)),
    ((3.0, 1.0, 7.0, 1.0, 5.0, 1.0), (0, 30.0, 30.0, 0, 0, 2.0), (0.3, 0, 0, 0.1, 0, 0)),
)


@pytest.mark.parametrize("scale", [1.0, 0.9923])
def test_free_parts_beside_a_state_have_all_their_modes(scale):
    """A spring in series with a damper, whose stiffness matrix is not symmetric, on the first."""

    def maxwell(t, ends, z):
        stretch = ends.positions[0, 0] - 3.0 - z[0]
        return np.array([[-5.0 * stretch, 0.0, 0.0]]), None, np.array([2.5 * stretch])

    for masses, springs, dampers in _FREE_PARTS:
        model = _chain([scale * mass for mass in masses], springs, dampers)
        model.add(ff.Force("series", [ff.Marker("body_0")], maxwell, states=1, initial=(0.0,)))
        found = ff.find_modes(model, ff.ModeOptions(modes=len(masses), quiet=True))
        assert found.status == "ok"
        assert np.sum(found.modes.eigenvalues == 0.0) == springs.count(0.0)


@pytest.mark.parametrize("rate", [0.0, 0.5, 5.0])
def test_states_that_act_on_nothing_have_no_modes(rate):
    """Measurements beside a chain: nothing moves in their eigenvectors, which are not free."""

    def filtered(t, ends, z):
        return np.zeros((1, 3)), None, np.array([rate * (ends.positions[0, 0] - 3.0 - z[0])])

    chain = (1.0, 2.0), (3.0, 4.0), (0.0, 0.1)
    alone = ff.find_modes(_chain(*chain), ff.ModeOptions(modes=2, quiet=True))
    model = _chain(*chain)
    model.add(ff.Force("filter", [ff.Marker("body_0")], filtered, states=1, initial=(0.0,)))
    found = ff.find_modes(model, ff.ModeOptions(modes=2, quiet=True))
    assert found.status == "ok"
    np.testing.assert_allclose(found.modes.eigenvalues, alone.modes.eigenvalues, rtol=1e-9)
    assert found.summary["checks"]["zero_below"] < 1e-6


def test_two_free_bars_have_all_their_modes():
    """Bending that the first shift determines badly is no motion of frequency zero."""
    lengths = 0.57079918, 0.81070819
    model = _free_bars(lengths)
    found = ff.find_modes(model, ff.ModeOptions(modes=15, quiet=True))
    assert found.status == "ok"
    # bending of a slender free bar about both axes, less shear, rotary inertia and the mesh's error
    longer = 22.3733 * np.sqrt(2e11 / 7800.0 / 12.0) / lengths[1] ** 2 * np.array([0.02, 0.03])
    shorter = 22.3733 * np.sqrt(2e11 / 7800.0 / 12.0) / lengths[0] ** 2 * np.array([0.02, 0.03])
    expected = np.sort(np.concatenate([longer, shorter]))[:3]
    assert not found.modes.eigenvalues[:12].any()
    np.testing.assert_allclose(found.modes.eigenvalues[12:].imag, expected, rtol=2e-2)


def _free_bars(lengths):
    steel = ff.Material(youngs_modulus=2e11, poisson_ratio=0.3, density=7800.0)
    lines = {f"bar_{k}": [(0, 3.0 * k, 0), (x, 3.0 * k, 0)] for k, x in enumerate(lengths)}
    model = ff.Model(mesh=ff.LineMesh.straight(lines, 20))
    model.add(*(ff.Beam(name, ff.Section.rectangle(0.02, 0.03, steel)) for name in lines))
    return model


@pytest.mark.three_ranks
@pytest.mark.parametrize(("damping", "dense"), [(0.0, 100), (1e-5, 0), (0.0, 1000)])
def test_free_bars_beside_one_under_a_load_that_follows_it_have_all_their_modes(
    damping, dense, monkeypatch
):
    """No count tells of lost ones: the stiffness is not symmetric."""
    from flexfem.solvers.modal import modes as solver

    monkeypatch.setattr(solver, "_DENSE_FOR_MANY", 0)
    monkeypatch.setattr(solver, "_DENSE", dense)
    steel = ff.Material(youngs_modulus=2e11, poisson_ratio=0.3, density=7800.0)
    alone, beside = (
        ff.Model(mesh=ff.LineMesh.straight(lines, 8))
        for lines in ({"a": [(0, 0, 0), (1, 0, 0)]},
                      {"a": [(0, 0, 0), (1, 0, 0)], "b": [(0, 3, 0), (1.3, 3, 0)]})
    )  # fmt: skip
    for model, names in ((alone, "a"), (beside, "ab")):
        section = ff.Section.rectangle(0.02, 0.03, steel)
        model.add(*(ff.Beam(name, section, damping=damping) for name in names))
        model.add(ff.Rigid("clamp", ff.Ground(), ff.Marker("a", "start")))
        model.add(ff.PointForce("push", ff.Marker("a", "end"), (-200.0, 0, 0), follower=True))
    lowest = ff.find_modes(alone, ff.ModeOptions(modes=2, quiet=True)).modes.eigenvalues
    found = ff.find_modes(beside, ff.ModeOptions(modes=10, split_above=1, quiet=True))
    assert found.status == "ok"
    assert not found.modes.eigenvalues[:6].any()
    np.testing.assert_allclose(found.modes.eigenvalues[6:8], lowest, rtol=1e-6, atol=1e-6)


@pytest.mark.serial
def test_nothing_but_free_motions():
    """They are round-off where anything is stiff, and told where nothing is, whatever the mass."""
    options = ff.ModeOptions(modes=1, quiet=True)
    for mass in (2.0, 1.09726233):
        alone = ff.find_modes(_chain((mass,), (0.0,), (0.0,)), options)
        assert alone.status.startswith("no mode that was found differs from zero; ")
    masses = 0.56687331, 1.32243376, 0.12448315, 2.22705086, 9.74964711, 0.50975477
    springs = 13.98822232, 0.0, 0.0, 9.41747299, 0.0, 0.0
    found = ff.find_modes(_chain(masses, springs, (0.0,) * 6), options)
    assert (found.status, found.modes.eigenvalues[0]) == ("ok", 0.0)


@pytest.mark.serial
def test_a_shift_at_which_nothing_can_be_factorised_is_left(monkeypatch):
    from flexfem.solvers.modal import modes as solver
    from flexfem.solvers.modal import pencil

    options = ff.ModeOptions(modes=8, quiet=True)
    expected = ff.find_modes(_free_bar(0.0), options).modes.eigenvalues
    monkeypatch.setattr(pencil, "_SHIFT", 1e-300)
    monkeypatch.setattr(solver, "_HIGHER", 1e294)
    found = ff.find_modes(_free_bar(0.0), options)
    assert found.status == "ok"
    np.testing.assert_allclose(found.modes.eigenvalues, expected, rtol=1e-8)


@pytest.mark.serial
def test_problems_that_no_shift_can_factorise_are_a_status(monkeypatch, tmp_path, capsys):
    """Whoever asks for modes is told the reason, and keeps what was found before."""
    from flexfem.cli.command import command
    from flexfem.solvers.modal import modes as solver

    options, reason = ff.ModeOptions(modes=2, quiet=True), "the linearised equations are singular"
    solve, calls = solver._solve, []

    def singular_from(number):
        def solve_some(*arguments):
            calls.append(0)
            if len(calls) > number:
                raise solver.SingularShiftError.at(3.0)
            return solve(*arguments)

        calls.clear()
        monkeypatch.setattr(solver, "_solve", solve_some)

    singular_from(0)
    outcome = ff.find_modes(_rotor(), dataclasses.replace(options, output=tmp_path / "modes"))
    assert outcome.status.startswith(f"{reason} at the shift 3 1/s; check for bodies without mass")
    assert_on_page(outcome.status)
    assert len(calls) == 4
    assert (len(outcome.modes), len(outcome.history["t"])) == (0, 0)
    assert outcome.summary["checks"]["not_counted"].startswith(reason)
    linear = ff.linearize(_rotor(), ff.LinearOptions(modes=2, quiet=True))
    assert linear.status == outcome.status
    assert linear.A.size == 0
    with pytest.raises(RuntimeError, match=f"gradient: {reason}"):
        ff.gradient(_rotor(), "frequency:1-2", ["disk.mass"], options)
    damped = _rotor()
    damped.add(ff.ModalDamping("damping", 0.01, modes=2))
    with pytest.raises(ValueError, match=f'ModalDamping "damping": {reason}') as raised:
        ff.find_modes(damped, options)
    assert_on_page(str(raised.value))
    assert command(["run", "blade", "--smoke", "--output", str(tmp_path / "case")]) == 1
    assert reason in "".join(capsys.readouterr())
    singular_from(1)
    sweep = ff.CampbellOptions(modes=2, spin=10.0, spin_end=20.0, speeds=3, quiet=True)
    stopped = ff.sweep_spin(_rotor(), sweep)
    assert stopped.status.startswith(f"at the spin 15 rad/s {reason}")
    assert_on_page(stopped.status)
    assert stopped.history["t"].tolist() == [10.0]


@pytest.mark.parametrize("dense", [0, 1000])
def test_next_shifts_are_near_the_target_as_well(dense, monkeypatch):
    """Modes are those of the target, not those of where the equations could be factorised."""
    from flexfem.solvers.modal import modes as solver

    monkeypatch.setattr(solver, "_DENSE_FOR_MANY", 0)
    monkeypatch.setattr(solver, "_DENSE", dense)
    options = ff.ModeOptions(modes=3, target=30.0, split_above=1, quiet=True)
    expected = ff.find_modes(_rotor(2e-4), options).modes.eigenvalues
    solve, calls = solver._solve, []

    def singular_at_first(*arguments):
        calls.append(0)
        if len(calls) < 3:
            raise solver.SingularShiftError.at(3.0)
        return solve(*arguments)

    monkeypatch.setattr(solver, "_solve", singular_at_first)
    found = ff.find_modes(_rotor(2e-4), options)
    assert found.status == "ok"
    np.testing.assert_allclose(found.modes.eigenvalues, expected, rtol=1e-8)


def _damped_cantilevers(damping):
    steel = ff.Material(youngs_modulus=2e11, poisson_ratio=0.3, density=7800.0)
    lines = {f"bar_{k}": [(0, 3.0 * k, 0), (x, 3.0 * k, 0)] for k, x in enumerate((1.0, 1.3))}
    model = ff.Model(mesh=ff.LineMesh.straight(lines, 8))
    for k, name in enumerate(lines):
        model.add(
            ff.Beam(name, ff.Section.rectangle(0.02, 0.03, steel), damping=damping),
            ff.Rigid(f"clamp_{k}", ff.Ground((0, 3.0 * k, 0)), ff.Marker(name, "start")),
        )
    return model


@pytest.mark.slow_on_ranks
@pytest.mark.parametrize(("damping", "count"), [(0.1, 0), (0.01, 3)])
def test_motions_that_damping_keeps_from_oscillating_are_named(damping, count):
    """All that are faster than 2/tau decay at 1/tau, before others: three oscillate more slowly."""
    model = _damped_cantilevers(damping)
    found = ff.find_modes(model, ff.ModeOptions(modes=8, quiet=True))
    rate = f"all decay at about {1.0 / damping:.0f} 1/s, before further modes: "
    assert found.status.startswith(f"only {count} of 8 modes converged; stiff motions that ")
    assert rate in found.status
    assert_on_page(found.status)
    assert len(found.modes) == count
    if count:
        assert f": request {count}, or give a target " in found.status
        fewer = ff.find_modes(model, ff.ModeOptions(modes=count, quiet=True))
        assert fewer.status == "ok"
        omega = ff.find_modes(_damped_cantilevers(0.0), ff.ModeOptions(modes=count, quiet=True))
        w = omega.modes.eigenvalues.imag
        expected = -0.5 * damping * w**2 + 1j * w * np.sqrt(1.0 - (0.5 * damping * w) ** 2)
        np.testing.assert_allclose(fewer.modes.eigenvalues, expected, rtol=1e-7)
    linear = ff.linearize(model, ff.LinearOptions(modes=8, quiet=True)) if not count else None
    assert linear is None or (linear.status.endswith(": take less damping") and not linear.A.size)


def test_campbell_diagrams_keep_the_lowest_modes_beside_motions_that_do_not_oscillate():
    """These have no frequency, but decay faster than the lowest modes oscillate."""
    section = ff.Section.general((1e5,) * 3 + (80.0, 100.0, 100.0), (1, 1, 1, 2e-3, 1e-3, 1e-3))
    ends = ff.Ground(), ff.Marker("beam", "start")
    model = _straight_beam().beam_model(section, 10, damping=0.01)
    model.add(ff.Revolute("bearing", *ends, axis=AXIS), ff.PrescribedAngle("at", *ends, axis=AXIS))
    whole = ff.find_modes(model, ff.ModeOptions(modes=4, quiet=True)).modes
    sweep = ff.CampbellOptions(modes=4, spin=0.0, spin_end=1.0, speeds=2, quiet=True)
    outcome = ff.sweep_spin(model, sweep)
    assert outcome.status == "ok"
    assert list(whole.frequencies > 1.0) == [True, True, False, False]
    if outcome.history:
        found = [outcome.history[f"mode_{k + 1}_frequency"][0] for k in range(4)]
        np.testing.assert_allclose(found, whole.frequencies, rtol=1e-8, atol=1e-4)


def _free_bar(damping):
    steel = ff.Material(youngs_modulus=2e11, poisson_ratio=0.3, density=7800.0)
    model = ff.Model(mesh=ff.LineMesh.straight({"bar": [(0, 0, 0), (2, 0, 0)]}, 40))
    model.add(ff.Beam("bar", ff.Section.rectangle(0.02, 0.03, steel), damping=damping))
    return model


@pytest.mark.serial
@pytest.mark.parametrize("spin", [0.0, 2.0])
def test_soft_blades_have_the_modes_of_their_matrices(spin, monkeypatch):
    from flexfem.solvers.modal import modes as solver

    monkeypatch.setattr(solver, "_DENSE_FOR_MANY", 0)
    options = ff.ModeOptions(modes=6, spin=spin, accuracy=1e-6, start="equilibrium", quiet=True)
    modes = ff.find_modes(_soft(), options).modes
    expected = _free_eigenvalues(modes.linearization)[:6]
    # LAPACK's own error, round-off of the largest frequency: 1e-4; a lost mode shifts all others
    np.testing.assert_allclose(modes.eigenvalues.imag, expected, rtol=2e-3)


@pytest.mark.serial
def test_modes_that_are_not_good_enough_are_no_success(monkeypatch):
    from flexfem.solvers.modal import modes as solver
    from flexfem.solvers.modal import pencil

    monkeypatch.setattr(solver, "_DENSE_FOR_MANY", 0)
    monkeypatch.setattr(solver, "_PASSES", 1)
    monkeypatch.setattr(pencil, "_QUADRATIC_SHIFT", 1e-4)
    once = ff.find_modes(_soft(), ff.ModeOptions(modes=3, spin=2.0, accuracy=1e-6, quiet=True))
    assert re.match(
        r"\d of 3 modes have residuals up to .*, more than accuracy 1e-06; ", once.status
    )
    assert_on_page(once.status)
    solve = solver._solve

    def forgetful(*arguments):
        """The second mode is not found."""
        found = solve(*arguments)
        kept = np.arange(len(found.values)) != 1
        arrays = {name: getattr(found, name)[kept] for name in
                  ("values", "vectors", "zero", "errors", "noise")}  # fmt: skip
        return dataclasses.replace(found, **arrays)

    monkeypatch.setattr(solver, "_solve", forgetful)
    lost = ff.find_modes(_soft(), ff.ModeOptions(modes=3, quiet=True))
    # Sylvester's count is the only one that can tell
    assert lost.status.startswith("1 modes in the range of the 3 found were missed; ")
    assert_on_page(lost.status)


@pytest.mark.parametrize(
    ("spin", "damping"),
    [(20.0, 0.0), pytest.param(20.0, 2e-4, marks=pytest.mark.three_ranks), (0.0, 2e-4)],
)
def test_modes_near_a_target_under_rotation_and_with_damping(spin, damping, monkeypatch):
    from flexfem.solvers.modal import modes as solver

    target = 30.0
    monkeypatch.setattr(solver, "_DENSE_FOR_MANY", 0)
    monkeypatch.setattr(solver, "_DENSE", 0)
    near = ff.ModeOptions(modes=3, spin=spin, target=target, split_above=1, quiet=True)
    found = ff.find_modes(_rotor(damping), near)
    assert found.status == "ok"
    monkeypatch.setattr(solver, "_DENSE", 1000)  # all modes, on each rank by itself
    whole = ff.ModeOptions(modes=40, spin=spin, quiet=True)
    every = ff.find_modes(_rotor(damping), whole, comm=MPI.COMM_SELF).modes.eigenvalues
    order = np.argsort(np.abs(every - 2j * np.pi * target))[:3]
    # round-off of the stiffness; without the shift the first ones are found, at a third of it
    np.testing.assert_allclose(found.modes.eigenvalues, every[np.sort(order)], rtol=1e-9)
    assert every[0] not in every[order]


@pytest.mark.serial
def test_modes_near_a_target():
    straight = _straight_beam()
    model = straight.beam_model(straight.slender(flap=1e4, chord=1.0), 20)
    model.add(ff.Rigid("clamp", ff.Ground(), ff.Marker("beam", "start")))
    low = straight.angular_frequencies(model, 6)
    near = straight.angular_frequencies(model, 1, target=low[3] / (2 * np.pi) * 1.02)
    # without the shift it would be the first one
    np.testing.assert_allclose(near, low[3], rtol=1e-8)


@pytest.mark.parametrize("sign", [1.0, pytest.param(-1.0, marks=pytest.mark.serial)])
def test_whirls_are_followed_through_zero_frequency_in_turning_axes(sign):
    """Forward and backward whirls of an overhung disk, named and tracked, against Stodola.

    Rotation the other way round has the same whirls: forward is with the rotation.
    """
    speeds, m, J_d, J_p, EI = np.linspace(0.0, 60.0, 7), 2.0, 0.3, 0.6, 100.0
    straight = _straight_beam()
    light = 1e-6
    section = ff.Section.general((1e7, 1e7, 1e7, 1e4, EI, EI), (light,) * 3 + (light,) * 3)
    model = straight.beam_model(section, 16, direction=AXIS)
    model.add(
        ff.RigidBody("disk", m, (J_d, J_d, J_p), position=(0, 0, 1.0)),
        ff.Rigid("fit", ff.Marker("beam", "end"), ff.Marker("disk")),
        ff.Revolute("bearing", ff.Ground(), ff.Marker("beam", "start"), axis=AXIS),
        ff.PrescribedAngle("drive", ff.Ground(), ff.Marker("beam", "start"), axis=AXIS),
    )
    options = ff.CampbellOptions(modes=4, spin_end=sign * 60.0, speeds=7, quiet=True)
    outcome = ff.sweep_spin(model, options)
    assert outcome.status == "ok"
    # of seven speeds together: where a frequency passes zero, rounding is all that can be reached,
    # and reported; none is missing
    checks = outcome.summary["checks"]
    assert options.accuracy < checks["largest_residual"] < 1e-6
    assert (checks["missing"], checks["not_counted"]) == (0, None)
    if not outcome.history:
        return
    expected = []
    for spin in speeds:
        left = np.polymul([-m, 0.0, 12 * EI], [-J_d, J_p * spin, 4 * EI])
        expected.append(np.sort(np.roots(np.polysub(left, [(6 * EI) ** 2])).real))
    names = ("backward_2", "backward_1", "forward_1", "forward_2")
    for k, name in enumerate(names):
        values = 2 * np.pi * outcome.history[f"{name}_fixed"][1:]
        # 16 elements; a mode that jumps to another branch, or whose sense is taken for the other,
        # is off by ten percent or more
        np.testing.assert_allclose(values, np.array(expected)[1:, k], rtol=5e-3)
    assert np.abs(outcome.history["forward_1_damping"]).max() < 1e-9


@pytest.mark.parametrize("spin", [4.0, pytest.param(-4.0, marks=pytest.mark.serial)])
def test_spinning_rods_stretch_as_they_should(spin, shared_tmp_path):
    """``r'' + k^2 r = 0, r(0) = 0, r'(L) = 1``, k^2 = spin^2 rho A/EA: r = sin(kx)/(k cos kL)."""
    straight, section = _straight_beam(), ff.Section.general((80.0,) * 3 + (1.0,) * 3, (1.0,) * 6)
    model = straight.beam_model(section, 16)
    model.add(
        ff.Revolute("bearing", ff.Ground(), ff.Marker("beam", "start"), axis=AXIS),
        ff.PrescribedAngle("drive", ff.Ground(), ff.Marker("beam", "start"), axis=AXIS),
        ff.PositionProbe("tip", ff.Marker("beam", "end")),
        ff.StrainProbe("root", "beam", 0.0),
    )
    common = {"split_above": 1, "quiet": True}
    options = ff.ModeOptions(modes=1, spin=spin, output=shared_tmp_path, frames=1, **common)
    outcome = ff.find_modes(model, options)
    assert outcome.status == "ok"
    k = 4.0 / 80.0**0.5
    # the elements' error is k^2 h^2 = 1e-3 of the elongation of 0.073; the linear theory, whose
    # load does not grow with the elongation, has 0.067
    assert outcome.state["tip_x"] == pytest.approx(np.tan(k) / k, rel=1e-4)
    # the first element's mean, half an element from the root where the strain is 1/cos k - 1
    assert outcome.state["root_gamma1"] == pytest.approx(1.0 / np.cos(k) - 1.0, rel=2e-3)
    assert outcome.summary["state"] == outcome.state
    assert (shared_tmp_path / "equilibrium").is_dir()
    swept = ff.sweep_spin(model, ff.CampbellOptions(modes=1, spin_end=spin, speeds=2, **common))
    if swept.history:
        # the last column would be that of the undeformed rod without the equilibrium's
        tips = (1.0, outcome.state["tip_x"])
        np.testing.assert_allclose(swept.history["tip_x"], tips, rtol=1e-9)


def test_poles_of_linear_models_are_the_modes():
    model, spin = _rotor(2e-4, elements=4), 20.0
    modes = ff.find_modes(model, ff.ModeOptions(modes=4, spin=spin, quiet=True)).modes
    whole = ff.linearize(model, ff.LinearOptions(spin=spin))
    reduced = ff.linearize(model, ff.LinearOptions(spin=spin, modes=4))
    for linear in (whole, reduced):
        assert linear.inputs == ("push", "drive")
        for value in modes.eigenvalues:
            # the same matrices, reduced; without the gyroscopic part errors are of order one
            assert np.abs(linear.poles - value).min() <= 1e-6 * abs(value)
    assert len(reduced.A) < len(whole.A)


def _response(linear, column, size, h, count):
    """Response to a step of one input by the implicit midpoint rule."""
    n = len(linear.A)
    left, right = np.eye(n) - 0.5 * h * linear.A, np.eye(n) + 0.5 * h * linear.A
    x, found = np.zeros(n), [linear.y0]
    for _ in range(count):
        x = np.linalg.solve(left, right @ x + h * size * linear.B[:, column])
        found.append(linear.y0 + linear.C @ x)
    return np.array(found)


@pytest.mark.serial
@pytest.mark.parametrize(("name", "modes"), [("load", 0), ("load", 4), ("drive", 0)])
def test_small_motions_of_linear_models_are_those_of_the_model(name, modes):
    straight, size, h, count = _straight_beam(), 1e-3, 1e-3, 150
    section = ff.Section.general((1e6, 1e6, 1e6, 50, 100, 200), (1, 1, 1, 2e-4, 1e-4, 1e-4))

    def model(on: bool) -> ff.Model:
        beam = straight.beam_model(section, 4)
        root, tip = ff.Marker("beam", "start"), ff.Marker("beam", "end")
        spun = size if on and name == "drive" else 0.0
        pushed = size if on and name == "load" else 0.0
        beam.add(
            ff.Revolute("pin", ff.Ground(), root, axis=AXIS),
            ff.PrescribedAngle(
                "drive", ff.Ground(), root, axis=AXIS, angle=lambda t: 0.5 * spun * t * t
            ),
            ff.PointForce("load", tip, (0, 10.0, 0), amplitude=lambda t: pushed),
            ff.PositionProbe("tip", tip),
        )
        return beam

    linear = ff.linearize(model(False), ff.LinearOptions(modes=modes))
    column = linear.inputs.index(name)
    expected = _response(linear, column, size, h, count)[:, linear.outputs.index("tip_y")]
    options = ff.RunOptions(dt=h, t_end=count * h, rho_inf=1.0, tolerance=1e-11, quiet=True)
    found = ff.simulate(model(True), options).history["tip_y"]
    # two integrators of second order, (omega h)^2/12 times some periods, and what the highest modes
    # add: 1 %; a wrong sign or factor of an input or output is off by its whole size
    assert np.abs(found - expected).max() <= 0.02 * np.abs(expected).max()


def test_rates_of_outputs_are_in_the_order_of_the_probes():
    """A tip's velocity depends on rates as its place does on coordinates; strains on no rates."""
    straight = _straight_beam()
    model = straight.beam_model(straight.slender(), 2)
    tip = ff.Marker("beam", "end")
    model.add(
        ff.Rigid("clamp", ff.Ground(), ff.Marker("beam", "start")),
        ff.StrainProbe("strain", "beam", 0.3),
        ff.PositionProbe("place", tip),
        ff.Probe(
            "speed", tip, ("speed_x", "speed_y", "speed_z"), lambda t, at: at.velocity.tolist()
        ),
    )
    linear = ff.linearize(model)
    places, speeds = (
        [k for k, name in enumerate(linear.outputs) if name.startswith(kind)]
        for kind in ("place_", "speed_")
    )
    by_coordinate, by_rate = np.split(linear.C, 2, axis=1)
    assert np.abs(by_coordinate[places]).max() > 0.1
    # differences of the probes' functions; rows of other probes are off by their whole size
    np.testing.assert_allclose(by_rate[speeds], by_coordinate[places], atol=1e-8)
    assert not by_rate[[k for k, name in enumerate(linear.outputs) if "strain" in name]].any()


def _top(**more):
    model = ff.Model("top")
    model.add(
        ff.RigidBody("top", 1.0, (1.0, 1.0, 1.0), position=(0, 0, 0.5)),
        ff.Spherical("tip", ff.Ground(more.get("at", (0, 0, 0))), ff.Marker(
            "top", offset=np.array(more.get("at", (0, 0, 0))) - (0, 0, 0.5))),
        ff.Gravity(more.get("gravity", (0, 0, -9.81))),
    )  # fmt: skip
    return model


MISTAKES = {
    "more than exist": ({"modes": 4}, {}, "modes must not exceed the 3 degrees of freedom"),
    "gravity": ({"modes": 1, "spin": 1.0}, {"gravity": (0, -9.81, 0)}, "gravity is not along"),
    "joint off the axis": ({"modes": 1, "spin": 1.0}, {"at": (0.5, 0, 0.5)},
                           'Spherical "tip": prevents rotation of the model about the axis'),
}  # fmt: skip


@pytest.mark.parametrize("what", MISTAKES)
def test_mistakes_are_named_on_every_rank(what):
    options, model, message = MISTAKES[what]
    with pytest.raises(ValueError, match=re.escape(message)) as error:
        ff.find_modes(_top(**model), ff.ModeOptions(quiet=True, **options))
    assert "\n" not in str(error.value)


SUPPORTS = {
    "bearing": (lambda m: [_bush(m, (80, 80, 50, 20, 20, 0), (1, 1, 1, 0, 0, 0))], ""),
    "two springs": (lambda m: [_spring(m, "x", 80.0), _spring(m, "y", 80.0)], ""),
    "two planes": (lambda m: [_plane(m, "x"), _plane(m, "y")], ""),
    "held": (lambda m: [ff.Revolute("hold", ff.Ground(), m), _spring(m, "x", 80.0)], ""),
    "open": (lambda m: [_spring(m, "x", 9.0), _spring(m, "y", 9.0), _plane(m, "y")], "plane_y"),
    "stiffness": (lambda m: [_bush(m, (80, 90, 50, 0, 0, 0))], 'Bushing "bush": '),
    "tilting": (lambda m: [_bush(m, (80, 80, 50, 20, 21, 0))], 'Bushing "bush": '),
    "damping": (lambda m: [_bush(m, (80, 80, 50, 0, 0, 0), (1, 2, 0, 0, 0, 0))], 'Bushing "'),
    "springs": (lambda m: [_spring(m, "x", 80.0), _spring(m, "y", 70.0)], 'SpringDamper "x": '),
    "plane": (lambda m: [_plane(m, "x"), _spring(m, "y", 70.0)], 'PointOnPlane "plane_x": '),
}


@pytest.mark.parametrize("what", SUPPORTS)
def test_supports_that_turn_with_the_rotor_are_even(what):
    """In rotating axes those of two stiffnesses change with time; they were taken to turn."""
    build, message = SUPPORTS[what]
    model = ff.Model()
    model.add(ff.RigidBody("disk", 2.0, (0.1, 0.1, 0.15)))
    model.add(*build(ff.Marker("disk")))
    options = ff.ModeOptions(modes=1 if what == "held" else 3, spin=3.0, quiet=True)
    if what == "open":
        model.release(message)
    elif message:
        with pytest.raises(ValueError, match=f"^{message}") as error:
            ff.find_modes(model, options)
        assert "holds the model differently in directions across the axis" in str(error.value)
        assert_on_page(str(error.value))
        return
    found = ff.find_modes(model, options)
    assert found.status == "ok"
    if what == "bearing":
        # sqrt(80/2) of the damped disk less the spin in rotating axes
        whirl = np.roots([2.0, 1.0, 80.0])[0] - 3.0j
        np.testing.assert_allclose(found.modes.eigenvalues[1], whirl, rtol=1e-9)


def _bush(marker, stiffness, damping=(0,) * 6):
    return ff.Bushing("bush", ff.Ground(), marker, stiffness, damping)


def _spring(marker, axis, stiffness):
    place = {"x": (-1.0, 0.0, 0.0), "y": (0.0, -1.0, 0.0)}[axis]
    return ff.SpringDamper(axis, ff.Ground(place), marker, stiffness=stiffness)


def _plane(marker, axis):
    normal = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0)}[axis]
    return ff.PointOnPlane(f"plane_{axis}", ff.Ground(), marker, axis=normal)


@pytest.mark.serial
@pytest.mark.parametrize(("options", "message"), [
    ({"modes": 0}, "modes must be a whole number >= 1, got 0"),
    ({"axis": "0,0,0"}, "axis must not be zero"),
    ({"axis": "up"}, "axis must be x, y, z or three finite numbers with commas, got 'up'"),
    ({"centre": "1,2"}, "centre must be three finite numbers with commas, got '1,2'"),
    ({"spin": float("nan")}, "spin must be a finite number"),
    ({"accuracy": 1e-300}, "accuracy must be a finite number >= 1e-15 and <= 0.01, got 1e-300"),
    ({"start": "moving"}, "start must be one of rest, equilibrium"),
])  # fmt: skip
def test_options_are_checked(options, message):
    with pytest.raises(ValueError, match=r"^ModeOptions: ") as error:
        ff.ModeOptions(**options)
    assert message in str(error.value)


def test_open_joints_do_not_hold():
    """A pendulum with a weld that is open from the start swings as if there were none."""
    top, weld = _top(gravity=(0, 0, 9.81)), ff.Rigid("weld", ff.Ground(), ff.Marker(
        "top", offset=(0, 0, -0.5)))  # fmt: skip
    options = ff.ModeOptions(quiet=True, modes=3)
    expected = ff.find_modes(top, options).history
    top.add(weld)
    top.release("weld")
    found = ff.find_modes(top, options).history  # held there are no freedoms at all
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=1e-12, atol=1e-12)


def test_options_of_another_analysis_are_named():
    dynamics = ff.RunOptions(dt=0.1, t_end=1.0)
    modes = ff.ModeOptions()
    for run, options in (
        (ff.find_modes, dynamics), (ff.sweep_spin, modes), (ff.linearize, dynamics),
        (ff.solve_static, dynamics), (ff.simulate, modes),
    ):  # fmt: skip
        with pytest.raises(TypeError, match=f"^{run.__name__}: options must be a .*Options, got"):
            run(_top(), options)
    for name in ("output", "restart"):
        with pytest.raises(TypeError, match=f"^RunOptions: {name} must be a path or None, got 5"):
            ff.RunOptions(dt=0.1, t_end=1.0, **{name: 5})


def test_linear_models_leave_measurements_out():
    top = _top()
    top.add(
        ff.EnergyProbe(), ff.ReactionProbe("force", "tip"),
        ff.PositionProbe("path", ff.Marker("top")), ff.MomentumProbe("momenta"),
    )  # fmt: skip
    linear = ff.linearize(top)
    assert linear.outputs == ("path_x", "path_y", "path_z")
    np.testing.assert_allclose(linear.y0, (0, 0, 0.5), atol=1e-15)
    assert linear.C.shape[0] == 3


def test_large_linear_models_need_a_reduction():
    straight = _straight_beam()
    with pytest.raises(ValueError, match=r"give modes .* with 606 > 600 unknowns"):
        ff.linearize(straight.beam_model(straight.slender(), 100))


def test_no_unique_equilibrium_is_a_status(shared_tmp_path):
    """A body that nothing holds has no equilibrium under its weight."""
    model = ff.Model("free")
    model.add(ff.Gravity((0, 0, -9.81)), ff.RigidBody("body", 1.0, (1.0, 1.0, 1.0)))
    options = ff.ModeOptions(modes=2, start="equilibrium", quiet=True, output=shared_tmp_path)
    outcome = ff.find_modes(model, options)
    assert "in the search for the equilibrium" in outcome.status
    assert outcome.modes is None
    assert dict(outcome.history) == {}


def _toppling(stiffness, start):
    """Modes of 2 kg on top of a hinged rod of 1 m, which a spring holds upright."""
    model, foot = ff.Model("toppling"), ff.Marker("mass", offset=(0.0, 0.0, -1.0))
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.RigidBody("mass", 2.0, 0.02 * np.eye(3), position=(0.0, 0.0, 1.0)),
        ff.Revolute("hinge", ff.Ground(), foot, axis=(0, 1, 0)),
        ff.TorsionalSpringDamper("spring", ff.Ground(), foot, axis=(0, 1, 0), stiffness=stiffness),
    )  # fmt: skip
    return ff.find_modes(model, ff.ModeOptions(modes=1, start=start, quiet=True))


@pytest.mark.serial
def test_an_equilibrium_from_which_the_model_falls_is_told():
    """``(m l^2 + I) x'' = (m g l - k) x``: a frequency of 0 alone would be a rigid motion's."""
    for start, what in (("equilibrium", "the equilibrium"), ("rest", "the given configuration")):
        found = _toppling(15.0, start)
        assert found.status == "ok"
        assert found.history["frequency"] == [0.0]
        rate = np.sqrt((2.0 * 9.81 - 15.0) / 2.02)
        # a linear problem of one unknown
        assert found.history["real"] == pytest.approx([rate], rel=1e-9)
        (line,) = found.summary["warnings"]
        assert line.startswith(f"{what} is unstable: 1 of 1 modes grows, the fastest by exp(1.512 ")
        assert_on_page(line)
    assert _toppling(25.0, "equilibrium").summary["warnings"] == []


@pytest.mark.serial
def test_a_spin_about_the_middle_axis_of_inertia_is_told():
    """Euler's equations: growth by spin ((b - a)(c - b)/(a c))^1/2; about the others none."""
    a, b, c, spin = 1.0, 2.0, 2.5, 3.0
    for axis, rate in (("x", 0.0), ("y", spin * np.sqrt((b - a) * (c - b) / (a * c))), ("z", 0.0)):
        model = ff.Model("tumbler")
        model.add(ff.RigidBody("body", 1.0, np.diag([a, b, c])))
        count = 6 if rate > 0.0 else 5  # pairs that grow and decay are two
        found = ff.find_modes(model, ff.ModeOptions(modes=count, spin=spin, axis=axis, quiet=True))
        assert found.status == "ok"
        lines = [line for line in found.summary["warnings"] if "is unstable" in line]
        assert len(lines) == (rate > 0.0)
        if lines:
            # a dense problem of six unknowns
            assert max(found.history["real"]) == pytest.approx(rate, rel=1e-9)
            assert lines[0].startswith("the steady rotation is unstable: 1 of 6 modes grows")


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_sweeps_and_linear_models_tell_of_growth(axis, capsys):
    """The same as modes, with the largest rate of all speeds; about stable axes nothing."""
    a, b, c, spin = 1.0, 2.0, 2.5, 3.0
    model = ff.Model("tumbler")
    model.add(ff.RigidBody("body", 1.0, np.diag([a, b, c])))
    rate = spin * np.sqrt((b - a) * (c - b) / (a * c)) if axis == "y" else 0.0
    grows = f"1 of 6 modes grows, the fastest by exp({rate:.4g} 1/s t); "
    options = ff.CampbellOptions(modes=6, axis=axis, spin_end=spin, speeds=3, quiet=True)
    told = ff.sweep_spin(model, options).summary["warnings"]
    lines = [line for line in told if "is unstable" in line]
    assert len(lines) == (rate > 0.0)
    if lines:
        assert lines[0].startswith(
            f"the state at 2 of 3 speeds, 1.5 to 3 rad/s, is unstable: {grows}"
        )
        assert_on_page(lines[0])
    for count in (0, 6) if rate > 0.0 else (0, 5):
        linear = ff.linearize(model, ff.LinearOptions(modes=count, axis=axis, spin=spin))
        assert linear.status == "ok"
        if rate > 0.0:
            assert linear.poles.real.max() == pytest.approx(rate, rel=1e-9)
        told = capsys.readouterr().err
        if launch.rank() == 0:
            assert (f"warning: the steady rotation is unstable: {grows}" in told) == (rate > 0.0)


@pytest.mark.serial
@pytest.mark.parametrize(("axis", "spin"), [("x", 2.0), ("y", 50.0)])
def test_sweeps_and_linear_models_do_not_tell_errors_as_growth(axis, spin, capsys):
    """Of the translation of a free bar, see the next test; the largest speed is not special."""
    model, given = _free_bar(1e-4), {"axis": axis, "spin": spin}
    options = ff.CampbellOptions(modes=8, speeds=2, spin_end=2.0 * spin, quiet=True, **given)
    outcome = ff.sweep_spin(model, options)
    assert outcome.status == "ok"
    assert outcome.summary["warnings"] == []
    for count in (0, 8):
        ff.linearize(model, ff.LinearOptions(modes=count, **given))
    assert "unstable" not in capsys.readouterr().err


@pytest.mark.parametrize(("axis", "spin"), [("x", 2.0), ("y", 50.0), ("z", 50.0)])
@pytest.mark.parametrize("damping", [0.0, 1e-4])
def test_errors_of_double_eigenvalues_are_not_told_as_growth(axis, spin, damping):
    """``(lambda + i spin)^2 = 0`` of a free bar's translation: rounding parts it by its root.

    Up to 2e-4 of the spin at residuals of 1e-13. About z, the middle axis of inertia, it grows by
    less than the spin, and nothing else does.
    """
    options = ff.ModeOptions(modes=8, spin=spin, axis=axis, quiet=True)
    found = ff.find_modes(_free_bar(damping), options)
    assert found.status == "ok"
    growth = found.modes.growth
    assert np.count_nonzero(growth) == (axis == "z")
    if axis == "z":
        # Euler's equations of a rectangle of 30 by 20 mm and 2 m, that bends under its rotation
        a, b, c = 0.02**2 + 0.03**2, 2.0**2 + 0.02**2, 2.0**2 + 0.03**2
        rate = spin * np.sqrt((c - b) * (b - a) / (a * c))
        assert growth.max() == pytest.approx(rate, rel=1e-2)


@pytest.mark.parametrize("damping", [0.0, 1e-6, 2e-4])
def test_internal_damping_is_told_above_a_critical_speed_alone(damping):
    """Also that of growth 5e-6 of the frequency."""
    for spin, above in ((5.0, False), (20.0, True)):
        found = ff.find_modes(_rotor(damping), ff.ModeOptions(modes=4, spin=spin, quiet=True))
        assert found.status == "ok"
        lines = [line for line in found.summary["warnings"] if "is unstable" in line]
        assert len(lines) == (above and damping > 0.0)


def test_columns_are_told_to_be_unstable_beyond_their_load():
    """``P = pi^2 EI/4 L^2`` of the mesh, where the square of the frequency is zero, and near it."""

    def found(load):
        section = ff.Section.general((1e7, 1e7, 1e7, 100.0, 1e3, 1e3), (1, 1, 1, 2e-3, 1e-3, 1e-3))
        model = _straight_beam().beam_model(section, 20, direction=AXIS)
        model.add(
            ff.Rigid("clamp", ff.Ground(), ff.Marker("beam", "start")),
            ff.PointForce("push", ff.Marker("beam", "end"), (0.0, 0.0, -load)),
        )
        return ff.find_modes(model, ff.ModeOptions(modes=2, start="equilibrium", quiet=True))

    def square(load):
        return float((found(load).modes.eigenvalues[0] ** 2).real)

    low, high = 2460.0, 2470.0
    for _ in range(3):  # secants
        low, high = high, high - square(high) * (high - low) / (square(high) - square(low))
        if abs(square(high)) < 1e-6:
            break
    assert high == pytest.approx(np.pi**2 * 1e3 / 4.0, rel=2e-3)
    for ratio, beyond in ((1 - 1e-5, False), (1.0, False), (1 + 1e-5, True), (1.01, True)):
        outcome = found(high * ratio)
        assert outcome.modes is not None  # the equilibrium is too inaccurate for those near zero
        assert any("is unstable" in line for line in outcome.summary["warnings"]) == beyond


@pytest.mark.serial
def test_of_pairs_that_grow_and_decay_alike_the_growing_one_is_found():
    """With so few modes that one of the two is left out, rounding chose it."""
    model = ff.Model("tumbler")
    model.add(ff.RigidBody("body", 1.0, np.diag([1.0, 2.0, 2.5])))
    found = ff.find_modes(model, ff.ModeOptions(modes=3, spin=3.0, axis="y", quiet=True))
    assert found.status == "ok"
    assert np.count_nonzero(found.modes.growth) == 1


@pytest.mark.parametrize("axis", ["x", "z"])
@pytest.mark.parametrize(
    ("kind", "mass"),
    [("solid", 0.0), ("rotation_free", 0.0), ("director", 0.0), ("solid", 20.0),
     ("rotation_free", 2.0), pytest.param("director", 2.0, marks=pytest.mark.serial)],
)  # fmt: skip
def test_bodies_without_nodal_rotations_precess_as_rigid_ones(kind, mass, axis):
    """Translations at i spin, precession by Euler's equations; without Coriolis' forces zeros.

    So they do with masses at the corners, which are those of nodes without axes that turn.
    """
    spin, sides = 2.0, np.array([1.0, 0.6, 0.3 if kind == "solid" else 0.004])
    if kind == "solid":
        law, mesh = ff.laws.NeoHookean.from_young(1e9, 0.3), ff.SolidMesh.box(sides, (3, 2, 1))
        model = ff.Model()
        model.add(ff.Solid("body", law, mesh, density=1e3, degree=2))
    else:
        steel = ff.Material(youngs_modulus=2e11, poisson_ratio=0.3, density=7800.0)
        model = ff.Model(surface=ff.SurfaceMesh.rectangle("body", sides[:2], (5, 4)))
        model.add(ff.Shell("body", ff.ShellSection.isotropic(sides[2], steel), element=kind))
    centre = f"0.5,0.3,{0.15 if kind == 'solid' else 0.0}"
    heights = (0.0, sides[2]) if kind == "solid" else (0.0,)
    corners = list(product((0.0, sides[0]), (0.0, sides[1]), heights))
    for number, corner in enumerate(corners if mass else ()):
        model.add(ff.PointMass(f"mass {number}", mass, ff.Marker("body", corner)))
    options = ff.ModeOptions(
        modes=6, spin=spin, axis=axis, centre=centre, split_above=1, accuracy=1e-6, quiet=True
    )
    found = ff.find_modes(model, options)
    assert found.status == "ok"
    squares, density = sides**2, 1e3 if kind == "solid" else 7800.0
    if kind != "solid":
        squares[2] = 0.0
    squares = np.prod(sides) * density * squares / 12.0 + len(corners) * mass * squares / 4.0
    a, b, c = np.roll(np.sum(squares) - squares, 0 if axis == "x" else 1)
    precession = spin * np.sqrt((a - b) * (a - c) / (b * c))
    expected = np.sort([0.0, 0.0, spin, spin, spin, precession])
    # double ones are parted by the root of round-off; triangles with masses at their corners have
    # another inertia by 2 %
    np.testing.assert_allclose(found.modes.eigenvalues.imag, expected, rtol=2e-2)


@pytest.mark.parametrize("frame", ["left", "mean_axes"])
def test_bodies_in_floating_frames_precess_as_rigid_ones(frame):
    """As above, wherever the axis is: amplitudes have no place that turns about it."""
    spin, sides, at = 2.0, np.array([1.0, 0.6, 0.3]), np.array([3.0, -2.0, 1.0])
    cells = CellType.hexahedron
    box = create_box(MPI.COMM_SELF, [-0.5 * sides, 0.5 * sides], (4, 3, 2), cells)
    soft = ff.solid_body(box, ff.Material(1e7, 0.3, 1e3))
    reduced = ff.reduce_body(soft, {"left": lambda x: np.isclose(x[0], -0.5)}, modes=5)
    model = ff.Model()
    model.add(ff.FloatingBody("body", reduced, frame=frame, position=at))
    centre = ",".join(map(str, at))
    found = ff.find_modes(model, ff.ModeOptions(modes=6, spin=spin, centre=centre, quiet=True))
    # with amplitudes that turn no equilibrium is found
    assert found.status == "ok"
    a, b, c = np.roll((np.sum(sides**2) - sides**2) / 12.0, 1)
    precession = spin * np.sqrt((a - b) * (a - c) / (b * c))
    expected = np.sort([0.0, 0.0, spin, spin, spin, precession])
    # double ones are parted by the root of round-off; vibrations are above 100 rad/s
    rates = found.modes.eigenvalues.imag
    np.testing.assert_allclose(rates, expected, rtol=1e-2, atol=1e-4)


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (2.0, 3.0, 1.0)])
def test_blades_in_floating_frames_have_the_modes_of_beams(place):
    """On a hub that spins, at the origin and elsewhere."""
    spin, place, rates = 60.0, np.array(place), []
    aluminium = ff.Material(7e10, 0.3, 2700.0)
    ends = np.array([place, place + np.array([1.0, 0.0, 0.0])]).tolist()
    blade = ff.LineMesh.straight({"blade": [tuple(end) for end in ends]}, 20)
    for floating in (False, True):
        model, root = ff.Model(mesh=blade), ff.Marker("blade", "start")
        if floating:
            reduced, root = bar(modes=9, stiffening=True), ff.Marker("blade", "left")
            model = ff.Model()
            model.add(ff.FloatingBody("blade", reduced, position=place, stiffening=True))
        else:
            section = ff.Section.rectangle(0.02, 0.02, aluminium)
            model.add(ff.Beam("blade", section, orientation=(0.0, 1.0, 0.0)))
        model.add(
            ff.RigidBody("hub", 1.0, (0.1, 0.1, 0.1), position=place),
            ff.Rigid("root", ff.Marker("hub"), root),
            ff.Revolute("bearing", ff.Ground(place), ff.Marker("hub")),
            ff.PrescribedAngle("motor", ff.Ground(place), ff.Marker("hub"), angle=lambda t: 0.0),
        )
        centre = ",".join(map(str, place))
        options = ff.ModeOptions(modes=4, spin=spin, centre=centre, quiet=True)
        rates.append(ff.find_modes(model, options).modes.eigenvalues.imag)
    # elements, and a stiffness of first order in the stress; amplitudes that turn: 3e-2 and 11
    np.testing.assert_allclose(rates[1], rates[0], rtol=5e-3)


def test_sliders_on_bodies_in_floating_frames_rotate_anywhere():
    """The line of a body that turns as a whole keeps its amplitudes, and the joint holds."""
    line = np.linspace([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], 5)
    section = ff.Section.rectangle(0.02, 0.02, ff.Material(7e10, 0.3, 2700.0))
    body = ff.beam_body(line, section, orientation=(0.0, 1.0, 0.0), comm=MPI.COMM_SELF)
    reduced = ff.reduce_body(body, {"left": line[0]}, modes=4, lines={"axis": line})
    rates = []
    for place in np.array([[0.0, 0.0, 0.0], [2.0, 3.0, 1.0]]):
        model, bead = ff.Model(), ff.Marker("bead")
        slide = ff.Sliding("slide", ff.Carrier("bar", "axis"), bead, tied=True)
        model.add(
            ff.FloatingBody("bar", reduced, position=place),
            ff.Revolute("bearing", ff.Ground(place), ff.Marker("bar", "left")),
            ff.RigidBody("bead", 0.1, (1e-3,) * 3, position=place + np.array([0.6, 0.0, 0.0])),
            slide,
            ff.PrescribedSlide("drive", slide, zeta=lambda t: 0.6),
        )
        centre = ",".join(map(str, place))
        options = ff.ModeOptions(modes=3, spin=10.0, centre=centre, quiet=True)
        rates.append(ff.find_modes(model, options).modes.eigenvalues.imag)
    assert rates[0][-1] > 10.0
    np.testing.assert_allclose(rates[1], rates[0], rtol=1e-6, atol=1e-4)


@pytest.mark.serial
@pytest.mark.parametrize("kind", ["solid", "rotation_free"])
def test_bodies_without_nodal_rotations_are_stretched_by_their_spin(kind):
    """``rho spin^2 l^3 / 3 E`` of half a bar; without centrifugal forces it has its length."""
    spin, half, width = 60.0, 1.0, 0.05
    if kind == "solid":
        law = ff.laws.NeoHookean.from_young(2e9, 0.3)
        mesh = ff.SolidMesh.box((2.0, width, width), (8, 1, 1))
        model = ff.Model()
        model.add(ff.Solid("body", law, mesh, density=1e3, degree=2))
    else:
        model = ff.Model(surface=ff.SurfaceMesh.rectangle("body", (2.0, width), (40, 2)))
        section = ff.ShellSection.isotropic(2e-3, ff.Material(2e9, 0.3, 1e3))
        model.add(ff.Shell("body", section))
    height = 0.5 * width if kind == "solid" else 0.0
    model.add(ff.PositionProbe("tip", ff.Marker("body", (2.0 * half, 0.5 * width, height))))
    options = ff.ModeOptions(
        modes=6, spin=spin, axis="z", centre=f"1,{width / 2},{height}", accuracy=1e-2, quiet=True
    )
    found = ff.find_modes(model, options)
    assert found.status == "ok"
    # the stretch of 6e-4 adds as much of itself
    stretch = 1e3 * spin**2 * half**3 / 3.0 / 2e9
    assert found.state["tip_x"] - 2.0 * half == pytest.approx(stretch, rel=5e-3)


@pytest.mark.serial
@pytest.mark.parametrize("element", ["rotation_free", "director"])
def test_frequencies_of_a_spinning_sheet_have_gradients(element):
    """By its stretch and stiffness; clamped at its axis, it needs no spring against rotations.

    With one, which holds a corner, the equilibrium is another one, and gradients are off by 1e-2.
    """

    def build(youngs_modulus):
        model = ff.Model(surface=ff.SurfaceMesh.rectangle("body", (1.0, 0.1), (12, 2)))
        section = ff.ShellSection.isotropic(2e-3, ff.Material(youngs_modulus, 0.3, 1e3))
        model.add(ff.Shell("body", section, element=element, edges={"body_left": "clamped"}))
        return model

    options = ff.ModeOptions(modes=2, spin=30.0, centre="0,0.05,0", quiet=True, accuracy=1e-9)
    numbers, of = {"youngs_modulus": 2e9}, ["frequency:1", "frequency:2"]
    gradient = ff.gradient(build, of, numbers, options).gradient
    values = []
    for step in (-0.04, -0.02, 0.02, 0.04):
        values.append(ff.find_modes(build((1.0 + step) * 2e9), options).modes.frequencies)
    wide, narrow = (values[3] - values[0]) / 0.08, (values[2] - values[1]) / 0.04
    found = [2e9 * gradient[name]["youngs_modulus"] for name in of]
    # the error of the extrapolated differences, of fourth order
    np.testing.assert_allclose(found, (4.0 * narrow - wide) / 3.0, rtol=1e-5)


@pytest.mark.serial
def test_modes_that_are_not_zero_are_not_below_what_counts_as_zero():
    """Limits of the fastest modes of a nearly massless shaft are a thousand times the first one."""
    steel = ff.Material(2e11, 0.3, 1e-3)
    model = _straight_beam().beam_model(ff.Section.circle(0.02, steel), 20, direction=(0, 0, 1))
    model.add(
        ff.RigidBody("disk", 10.0, (0.01, 0.01, 0.02), position=(0, 0, 0.5)),
        ff.Rigid("fit", ff.Marker("beam", 0.5), ff.Marker("disk")),
        ff.Spherical("left", ff.Ground(), ff.Marker("beam", "start")),
        ff.PointOnLine("right", ff.Ground((0, 0, 1)), ff.Marker("beam", "end"), axis=(0, 0, 1)),
    )
    found = ff.find_modes(model, ff.ModeOptions(modes=4, spin=30.0, quiet=True))
    assert found.status == "ok"
    first = found.history["frequency"][found.history["frequency"] > 0.0].min()
    assert found.summary["checks"]["zero_below"] < 0.01 * first
