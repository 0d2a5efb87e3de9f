# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modes, Campbell diagrams and linear models against closed forms and other formulations."""

import importlib
import re

import numpy as np
import pytest

import flexfem as ff

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


@pytest.mark.three_ranks
@pytest.mark.parametrize("spin", [0.0, 20.0])
@pytest.mark.parametrize(("damping", "dense"), [(0.0, 0), (2e-4, 100)])
def test_any_number_of_ranks_gives_the_same_modes(spin, damping, dense, monkeypatch):
    from mpi4py import MPI

    from flexfem.solvers import modes as solver

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


@pytest.mark.serial
def test_modes_near_a_target():
    straight = _straight_beam()
    model = straight.beam_model(straight.slender(flap=1e4, chord=1.0), 20)
    model.add(ff.Rigid("clamp", ff.Ground(), ff.Marker("beam", "start")))
    low = straight.angular_frequencies(model, 6)
    near = straight.angular_frequencies(model, 1, target=low[3] / (2 * np.pi) * 1.02)
    # without the shift it would be the first one
    np.testing.assert_allclose(near, low[3], rtol=1e-8)


def test_whirls_are_followed_through_zero_frequency_in_turning_axes():
    """Forward and backward whirls of an overhung disk, named and tracked, against Stodola."""
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
    options = ff.CampbellOptions(modes=4, spin_end=60.0, speeds=7, quiet=True)
    outcome = ff.sweep_spin(model, options)
    assert outcome.status == "ok"
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
                           'Spherical "tip": does not let the model turn about the axis (0, 0, 1)'),
    "target": ({"modes": 1, "spin": 1.0, "target": 2.0}, {}, "target 2 Hz needs a model at rest"),
}  # fmt: skip


@pytest.mark.parametrize("what", MISTAKES)
def test_mistakes_are_named_on_every_rank(what):
    options, model, message = MISTAKES[what]
    with pytest.raises(ValueError, match=re.escape(message)) as error:
        ff.find_modes(_top(**model), ff.ModeOptions(quiet=True, **options))
    assert "\n" not in str(error.value)


@pytest.mark.serial
@pytest.mark.parametrize(("options", "message"), [
    ({"modes": 0}, "modes must be a whole number >= 1, got 0"),
    ({"axis": "0,0,0"}, "axis must not be zero"),
    ({"axis": "up"}, "axis must be x, y, z or three finite numbers with commas, got 'up'"),
    ({"centre": "1,2"}, "centre must be three finite numbers with commas, got '1,2'"),
    ({"spin": float("nan")}, "spin must be a finite number"),
    ({"accuracy": 0.0}, "accuracy must be"),
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
    with pytest.raises(ValueError, match=r"modes must be given .* with 606 > 600 unknowns"):
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
