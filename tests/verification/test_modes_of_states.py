# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modes about states that a motion has reached, with contact, against closed forms."""

import importlib
import math
import warnings

import numpy as np
import pytest

import flexfem as ff
from tests.unit.refusals import assert_on_page

STIFFNESS, REST, AWAY, MASS = 300.0, 0.4, 0.5, 2.0


def slider(mass=MASS):
    """A mass on a guide along X, pulled by a spring from a point beside the guide."""
    model = ff.Model("slider")
    model.add(
        ff.RigidBody("mass", mass, (0.1, 0.1, 0.1), velocity=(1.5, 0.0, 0.0)),
        ff.Prismatic("guide", ff.Ground(), ff.Marker("mass"), axis=(1, 0, 0)),
        ff.SpringDamper("spring", ff.Ground((0.0, AWAY, 0.0)), ff.Marker("mass"),
                        stiffness=STIFFNESS, rest_length=REST),
        ff.Probe("at", ff.Marker("mass"), ("x",), lambda t, s: s.position[:1]),
    )  # fmt: skip
    return model


def checkpoint(model, folder, steps, dt):
    """The motion's last checkpoint and history."""
    options = ff.RunOptions(
        dt=dt, t_end=steps * dt, output=folder, checkpoint_every=steps, quiet=True
    )
    outcome = ff.simulate(model, options)
    assert outcome.status == "ok"
    return folder / f"checkpoint_{steps:06d}.h5", outcome.history


def test_frequency_where_a_nonlinear_spring_has_been_stretched(shared_tmp_path):
    """V = k/2 (sqrt(d^2 + x^2) - l)^2, so that the frequency depends on the place reached."""
    folder = shared_tmp_path / "motion"
    folder.mkdir(exist_ok=True)
    file, history = checkpoint(slider(), folder, 40, 2e-3)
    found = ff.find_modes(slider(), ff.ModeOptions(modes=1, state=file, quiet=True))
    given = ff.find_modes(slider(), ff.ModeOptions(modes=1, quiet=True))
    assert found.status == given.status == "ok"
    if found.history:
        for x, outcome in ((history["x"][-1], found), (0.0, given)):
            curvature = STIFFNESS * (1.0 - REST * AWAY**2 / (AWAY**2 + x**2) ** 1.5)
            frequency = math.sqrt(curvature / MASS) / (2.0 * math.pi)
            # eigenvalues are found to 1e-10; the given place has 0.87 of this frequency
            assert outcome.history["frequency"][0] == pytest.approx(frequency, rel=1e-8)
        assert history["x"][-1] > 0.1


def resting(height, fixed=None, law=None):
    """A square sheet on a plane, without gravity."""
    sides = np.linspace(0.0, 0.4, 4)
    sheet = ff.ShellSection.isotropic(2e-3, ff.Material(2e9, 0.3, 1500.0))
    model = ff.Model(
        "resting", surface=ff.SurfaceMesh.grid("sheet", sides, sides, lambda p: lifted(p, height))
    )
    floor = ff.RigidPlane(ff.Ground((0.0, 0.0, -1e-3)))
    contact = ff.Contact("floor", "sheet", surfaces=floor, stiffness=2e6, law=law)
    model.add(ff.Shell("sheet", sheet, fixed=fixed or {}), contact)
    return model


def lifted(parameters, height):
    return np.column_stack([parameters, np.full(len(parameters), height)])


@pytest.mark.three_ranks
@pytest.mark.parametrize(("height", "stiffness"), [(-1e-6, 2e6), (1e-6, 0.0)])
def test_sheet_that_touches_a_plane_bounces_on_the_stiffness_of_contact(height, stiffness):
    """Stiffness and mass per area are those of every node: the square frequency is k / (rho h)."""
    found = ff.find_modes(resting(height), ff.ModeOptions(modes=6, quiet=True))
    assert found.status == "ok"
    if found.history:
        squares = (2.0 * math.pi * found.history["frequency"]) ** 2
        # rocking and lifting; without contact all six rigid motions have none
        expected = [0.0, 0.0, 0.0, *3 * [stiffness / 3.0]]
        assert squares == pytest.approx(expected, rel=1e-7, abs=1.0)


@pytest.mark.three_ranks
def test_sheet_sinks_into_a_plane_until_it_carries_the_weight():
    """Depth rho h g / k, from where contact has the same stiffness as everywhere."""
    model = resting(-1e-6, fixed={"sheet_bottom_left": "xy", "sheet_bottom_right": "y"})
    model.add(ff.Gravity((0.0, 0.0, -10.0)))
    options = ff.ModeOptions(modes=3, start="equilibrium", quiet=True)
    found = ff.find_modes(model, options)
    assert found.status == "ok"
    part = found.modes.linearization.system.parts[0]
    heights = part.block.frames[: part.block.owned, 2]
    # 1.5e-5 m; the given depth of 1e-6 m would be the answer of a search that does not move
    assert heights == pytest.approx(np.full(len(heights), -3.0 * 10.0 / 2e6), rel=1e-9)
    if found.history:
        squares = (2.0 * math.pi * found.history["frequency"]) ** 2
        assert squares == pytest.approx(3 * [2e6 / 3.0], rel=1e-7)


@pytest.mark.three_ranks
def test_sheet_on_a_barrier_bounces_on_its_curvature():
    """With q = gap / reach the pressure is k d (1 - q)^2 (2 + q) / q^3 = rho h g."""
    model = resting(2e-3, {"sheet_bottom_left": "xy", "sheet_bottom_right": "y"}, "barrier")
    model.add(ff.Gravity((0.0, 0.0, -10.0)))
    found = ff.find_modes(model, ff.ModeOptions(modes=3, start="equilibrium", quiet=True))
    assert found.status == "ok"
    k, d = 2e6, 1e-4
    q = max(r.real for r in np.roots([1.0 - 30.0 / (k * d), 0.0, -3.0, 2.0]) if 0 < r.real < 1)
    part = found.modes.linearization.system.parts[0]
    heights = part.block.frames[: part.block.owned, 2]
    # steps that are not cut pass through the plane, and end where nothing holds the sheet
    assert heights == pytest.approx(np.full(len(heights), q * d), rel=1e-8)
    if found.history:
        squares = (2.0 * math.pi * found.history["frequency"]) ** 2
        # forces of a step instead of those at rest have another slope, by a tenth
        assert squares == pytest.approx(3 * [6.0 * k * (1.0 - q) / q**4 / 3.0], rel=1e-7)


@pytest.mark.serial
def test_what_contact_alone_holds_has_modes_where_it_touches(shared_tmp_path):
    """A damped ball on a guide falls onto a plane; its slope is that of heights of two weights."""
    heights, states = [], []
    for gravity in (10.0, 10.001):
        model = ff.Model("ball")
        ball = ff.RigidBody("ball", 1.0, (1, 1, 1), position=(0, 0, 0.1001), shape=ff.Sphere(0.1))
        ends = ff.Ground((0, 0, 5.0)), ff.Marker("ball")
        model.add(
            ball, ff.Gravity((0.0, 0.0, -gravity)),
            ff.Prismatic("guide", ff.Ground((0, 0, 0.1001)), ends[1], axis=(0, 0, 1)),
            ff.SpringDamper("dashpot", *ends, stiffness=0.0, damping=300.0),
            ff.Contact("floor", surfaces=ff.RigidPlane(ff.Ground()), stiffness=1e5),
            ff.Probe("at", ff.Marker("ball"), ("z",), lambda t, s: s.position[2:]),
        )  # fmt: skip
        folder = shared_tmp_path / f"motion_{gravity}"
        folder.mkdir(exist_ok=True)
        file, history = checkpoint(model, folder, 200, 1e-3)
        heights.append(history["z"][-1] if history else 0.0)
        states.append(file)
    # the search has no direction where nothing touches
    apart = ff.find_modes(model, ff.ModeOptions(modes=1, start="equilibrium", quiet=True))
    assert apart.status.endswith(
        "; contact holds bodies that touch: give state, a checkpoint where they do"
    )
    assert_on_page(apart.status)
    options = ff.ModeOptions(modes=1, state=states[1], start="equilibrium", quiet=True)
    found = ff.find_modes(model, options)
    assert found.status == "ok"
    stiffness = 1e-3 / (heights[0] - heights[1])
    # of first order in the change of the weight
    assert abs(found.modes.eigenvalues[0]) ** 2 == pytest.approx(stiffness, rel=1e-3)
    assert found.modes.eigenvalues[0].real == pytest.approx(-150.0, rel=1e-8)


def test_errors_of_equilibria_are_found_and_mended(monkeypatch):
    """A blade that spins and sags: frequencies about a state found too roughly are off."""
    from flexfem.simulation import modes
    from flexfem.solvers.modal import steady_rotation
    from tests.verification import test_modes as others

    straight = importlib.import_module("tests.verification.benchmarks.straight_beam")
    section = ff.Section.general((80.0,) * 3 + (1.0,) * 3, (1.0,) * 6)
    model = straight.beam_model(section, 4)
    ends = ff.Ground(), ff.Marker("beam", "start")
    model.add(ff.Revolute("bearing", *ends, axis=others.AXIS))
    model.add(ff.PrescribedAngle("drive", *ends, axis=others.AXIS), ff.Gravity((0.0, 0.0, -1.0)))
    options = ff.ModeOptions(modes=3, spin=4.0, accuracy=1e-9, split_above=1, quiet=True)

    exact = ff.find_modes(model, options)
    assert exact.status == "ok"
    # quadratic convergence to 1e-8 leaves rounding
    assert exact.summary["checks"]["state_error"] < 1e-12
    linear = ff.LinearOptions(modes=3, spin=4.0, split_above=1, quiet=True)
    assert ff.linearize(model, linear).state_error < 1e-12
    monkeypatch.setattr(steady_rotation, "_CONVERGED", 1e-2)
    mended = ff.find_modes(model, options)
    assert mended.status == "ok"
    np.testing.assert_allclose(
        mended.modes.eigenvalues.imag, exact.modes.eigenvalues.imag, rtol=1e-9
    )
    monkeypatch.setattr(modes, "_SETTLINGS", 1)
    rough = ff.find_modes(model, options)
    assert rough.status.startswith("the error of the equilibrium moves modes by up to ")
    assert_on_page(rough.status)
    told = rough.summary["checks"]["state_error"]
    true = np.abs(rough.modes.eigenvalues.imag / exact.modes.eigenvalues.imag - 1.0).max()
    # of first order and with the error of the shape: never below, and no more than some times above
    assert 1e-6 < true <= told <= 10.0 * true
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # rank 0 says it, too
        reduced = ff.linearize(model, linear)
    assert reduced.status.startswith("the error of the equilibrium moves modes by up to ")
    assert reduced.status.endswith("request fewer modes")  # there is no accuracy to be changed
    assert 0.1 * told < reduced.state_error < 10.0 * told  # three of its modes are those
    assert ff.find_modes(model, ff.ModeOptions(modes=3, quiet=True)).modes.state_error is None


@pytest.mark.serial
def test_bad_states(tmp_path):
    file, _ = checkpoint(slider(), tmp_path, 2, 1e-3)
    wrong = {
        "belongs to another model, other rigid bodies": (slider(mass=3.0), {"state": file}),
        "none.h5.: No such file": (slider(), {"state": tmp_path / "none.h5"}),
        "ModeOptions: a state has its own time, got time 2": (slider(), {"state": file, "time": 2}),
    }
    for message, (model, options) in wrong.items():
        with pytest.raises(ValueError, match=message):
            ff.find_modes(model, ff.ModeOptions(modes=1, quiet=True, **options))
