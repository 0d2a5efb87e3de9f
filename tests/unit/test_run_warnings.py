# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs have the warnings of ``flexfem info``, too: on stderr and in the summary."""

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff

STEEL = ff.Material(2.1e11, 0.3, 7850.0)


def of_model(outcome: ff.Outcome) -> list[str]:
    """Warnings of a run except for the number of its ranks."""
    return [line for line in outcome.summary["warnings"] if " ranks " not in line]


def wheels(speeds: tuple[float, float]) -> ff.Model:
    """Two equal wheels that mesh externally."""
    model = ff.Model("wheels")
    hinges = []
    for k, speed in enumerate(speeds):
        at, name = (float(k), 0.0, 0.0), f"wheel_{k}"
        model.add(
            ff.RigidBody(name, 1.0, (0.1, 0.1, 0.2), position=at, angular_velocity=(0, 0, speed))
        )
        ends = ff.Ground(at), ff.Marker(name)
        hinges.append(ff.Revolute(f"hinge_{k}", *ends, axis=(0, 0, 1)))
    a, b = hinges
    gear = ff.Gear("gear", a.a, a.b, b.a, b.b, axis=(0, 0, 1), ratio=-1.0)
    model.add(*hinges, gear)
    return model


@pytest.mark.parametrize("quiet", [False, True])
def test_velocities_that_a_gear_does_not_allow(
    quiet: bool, capfd: pytest.CaptureFixture[str]
) -> None:
    """Both wheels turn the same way, which their gear turns into rest: said once, by one rank."""
    options = ff.RunOptions(dt=1e-3, t_end=2e-3, quiet=quiet)
    outcome = ff.simulate(wheels((10.0, 10.0)), options)
    said = capfd.readouterr().err
    (line,) = of_model(outcome)
    assert 'RigidBody "wheel_0" and 1 more' in line
    assert "0 rad/s instead of 10, off by 10" in line
    assert said.count(f"warning: {line}\n") == int(MPI.COMM_WORLD.rank == 0 and not quiet)


def test_velocities_that_fit_are_not_told() -> None:
    options = ff.RunOptions(dt=1e-3, t_end=2e-3, quiet=True)
    assert of_model(ff.simulate(wheels((10.0, -10.0)), options)) == []


def beam(gravity: float) -> ff.Model:
    """A clamped beam of eight elements."""
    model = ff.Model("arm", mesh=ff.LineMesh.straight({"rod": [(0, 0, 0), (1, 0, 0)]}, 8))
    model.add(
        ff.Beam("rod", ff.Section.circle(0.01, STEEL)),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("rod", "start")),
        ff.Gravity((0.0, 0.0, -gravity)),
    )
    return model


@pytest.mark.parametrize(
    "options",
    [ff.StaticOptions(load_steps=1), ff.ModeOptions(modes=1), ff.RunOptions(dt=1e-3, t_end=1e-3)],
)
def test_every_analysis_tells_what_the_checks_find(options: ff.StaticOptions) -> None:
    """Gravity in mm/s^2, which ``flexfem info`` finds too; in m/s^2 there is no warning."""
    drivers = {
        ff.StaticOptions: ff.solve_static, ff.ModeOptions: ff.find_modes,
        ff.RunOptions: ff.simulate,
    }  # fmt: skip
    found = [str(finding) for finding in ff.check(beam(1e3), options)]
    assert len(found) == 1
    options = type(options)(**{**vars(options), "quiet": True})
    driver = drivers[type(options)]
    assert of_model(driver(beam(1e3), options)) == found
    assert of_model(driver(beam(9.81), options)) == []


def test_fast_starts_are_told_with_their_steps() -> None:
    """A wheel that rotates by two radians in a step: the same line as ``flexfem info`` has."""
    options = ff.RunOptions(dt=1e-3, t_end=2e-3, quiet=True)
    model = wheels((2000.0, -2000.0))
    (found,) = ff.check(model, options)
    assert found.check == "steps"
    warned = ff.simulate(model, options).summary["warnings"]
    assert str(found) in warned
    assert np.isclose(2.0, 2000.0 * options.dt)


def sliding(tolerance: float) -> ff.Outcome:
    """A light sheet that begins to slide down a plane, in small steps."""
    angle = 0.5
    R = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    t = np.linspace(-0.1, 0.1, 3)
    mesh = ff.SurfaceMesh.grid("sheet", t, t, lambda p: np.c_[p, np.full(len(p), 1e-3)] @ R.T)
    model = ff.Model("sliding", surface=mesh)
    plastic = ff.Material(2e9, 0.3, 1200.0)
    slope = ff.RigidPlane(ff.Ground(rotation=R))
    model.add(
        ff.Shell("sheet", ff.ShellSection.isotropic(2e-3, plastic)),
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Contact("slope", "sheet", surfaces=slope, friction=0.3),
    )
    return ff.simulate(model, ff.RunOptions(dt=2e-4, t_end=4e-3, tolerance=tolerance, quiet=True))


def test_penetrations_below_the_tolerance_are_told_where_bodies_rub() -> None:
    """With 1e-6 m the sheet would slide 7 % too little in 0.2 s, with 1e-9 m 0.3 %."""
    told = [line for line in of_model(sliding(1e-6)) if "nodes that rub" in line]
    assert len(told) == 1
    assert told[0].startswith('Contact "slope": nodes that rub sink in by ')
    assert of_model(sliding(1e-9)) == []
