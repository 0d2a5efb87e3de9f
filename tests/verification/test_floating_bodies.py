# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motion of bodies in floating frames: against exact beams, among formulations, on ranks."""

from functools import cache

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.families.floating.nodes import body_data
from flexfem.mesh.line_mesh import LineMesh
from tests.unit.particle_body import bar
from tests.verification.motions import run

COMM = MPI.COMM_WORLD
AXIS = (0.0, 1.0, 0.0)
ALUMINIUM = ff.Material(7e10, 0.3, 2700.0)


@cache
def _bar(stiffening=False, modes=4, side=0.02):
    return bar(modes=modes, stiffening=stiffening, side=side)


def _joined(model, bodies):
    """A double pendulum of two bars of 1 m with a push out of its plane."""
    ends = {name: (ff.Marker(name, bodies[0]), ff.Marker(name, bodies[1])) for name in "ab"}
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Spherical("root", ff.Ground(), ends["a"][0]),
        ff.Revolute("elbow", ends["a"][1], ends["b"][0], axis=AXIS),
        ff.PointForce("push", ends["b"][1], (0.0, 20.0, 0.0), amplitude=lambda t: float(t < 0.05)),
        ff.PositionProbe("tip", ends["b"][1]),
        ff.EnergyProbe("energy"),
        ff.MomentumProbe("momentum"),
    )
    return model


def _floating(**options):
    model = ff.Model("double pendulum")
    reduced = _bar(options.get("stiffening", False), side=options.pop("side", 0.02))
    for name, x in (("a", 0.0), ("b", 1.0)):
        model.add(ff.FloatingBody(name, reduced, position=(x, 0.0, 0.0), **options))
    return _joined(model, ("left", "right"))


def _beams(cells=8, side=0.02):
    points = np.linspace(0.0, 1.0, cells + 1)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    lines = np.stack([np.arange(cells), np.arange(1, cells + 1)], axis=1)
    mesh = LineMesh(
        np.concatenate([points, points + np.array([1.0, 0.0, 0.0])]),
        np.concatenate([lines, lines + cells + 1]),
        {"a": np.arange(cells), "b": np.arange(cells, 2 * cells)},
    )
    model = ff.Model("double pendulum", mesh=mesh)
    for name in "ab":
        section = ff.Section.rectangle(side, side, ALUMINIUM)
        model.add(ff.Beam(name, section, orientation=AXIS))
    return _joined(model, ("start", "end"))


def _tip(history):
    return np.stack([history[f"tip_{axis}"] for axis in "xyz"])


@pytest.mark.slow
@pytest.mark.serial
def test_double_pendulum_is_that_of_exact_beams():
    """Bars of 12 mm that a push bends by 5 % of their length, in all frames."""
    settings = {"dt": 5e-4, "t_end": 0.1}
    exact = _tip(run(_beams(16, side=0.012), **settings))
    kinds = [
        {"frame": "left"}, {"frame": "mean_axes"}, {"frame": "left", "stiffening": True},
        {"frame": "mean_axes", "stiffening": True},
    ]  # fmt: skip
    gaps = []
    for kind in kinds:
        history = run(_floating(side=0.012, **kind), **settings)
        gaps.append(np.abs(_tip(history) - exact).max())
        # of 2 J; the scheme's own error is 0.02 J at this step and falls with its square
        assert np.abs(history["energy_balance"]).max() < 0.04
    # bars that keep their length end 4 mm off; a rigid body of one more term 30 mm
    assert gaps[0] < 6e-3
    # those that get shorter as they bend 1 mm, of a tip that moves 0.2 m, in either frame
    assert max(gaps[2:]) < 1.5e-3


@pytest.mark.three_ranks
@pytest.mark.parametrize("frame", ["left", "mean_axes"])
def test_ranks_agree(frame):
    """Bodies on other ranks than the ground and each other."""
    settings = {"dt": 1e-3, "t_end": 0.02}
    model = _floating(frame=frame, stiffening=True)
    here = run(model, **settings)
    alone = ff.simulate(
        model, ff.RunOptions(tolerance=1e-10, quiet=True, **settings), comm=MPI.COMM_SELF
    ).history
    # round-off of the sums; a joint that misses a rank's motion is off by millimetres
    for column in here:
        size = np.abs(alone[column]).max() + 1e-3
        assert here[column] == pytest.approx(alone[column], rel=0, abs=1e-9 * size)


@pytest.mark.serial
@pytest.mark.parametrize("matrix", ["frozen", "updated"])
def test_kept_and_fresh_matrices_agree(matrix):
    model = _floating(frame="mean_axes", stiffening=True)
    options = {"dt": 1e-3, "t_end": 0.05}
    kept, other = run(model, **options), run(model, iteration_matrix=matrix, **options)
    # Newton's tolerance; a state lost by the frame would show at once
    assert _tip(kept) == pytest.approx(_tip(other), rel=0, abs=1e-8)


@pytest.mark.serial
@pytest.mark.parametrize("ends", [("left", "right"), ()])
def test_free_body_conserves_momenta(ends):
    """A tumbling bar, with ends and without, whose modes then do not stretch it."""
    reduced, stretched = bar(ends, modes=4 if ends else 7), bool(ends)
    drifts = []
    for dt in (1e-4, 5e-5):
        model = ff.Model("free")
        model.add(
            ff.FloatingBody(
                "bar", reduced, frame="mean_axes", velocity=(1.0, 0.2, 0.0),
                angular_velocity=(30.0, 90.0, 50.0),
            ),
            ff.EnergyProbe("energy"),
            ff.MomentumProbe("momentum"),
        )  # fmt: skip
        history = run(model, dt, 0.02)
        for column in (f"momentum_p{axis}" for axis in "xyz"):
            # generalized-alpha keeps linear momentum to round-off
            assert np.ptp(history[column]) < 1e-10
        turned = [np.ptp(history[f"momentum_l{axis}"]) for axis in "xyz"]
        drifts.append([np.abs(history["energy_balance"]).max(), max(turned)])
    # of 32 kg m^2/s and 700 J; what the scheme loses falls with the square of the step, what a
    # missing coupling loses does not
    assert (np.array(drifts[0]) > 3.0 * np.array(drifts[1])).all()
    assert drifts[1][1] < 1e-3
    # centrifugal forces stretch and bend it
    assert stretched == (np.ptp(history["energy_strain"]) > 1e-2)


@pytest.mark.serial
def test_static_tip_of_a_cantilever():
    """F L^3 / 3 EI, and turned with the base."""
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    for rotation in (np.eye(3), turn):
        model = ff.Model("cantilever")
        model.add(
            ff.FloatingBody("bar", _bar(), rotation=rotation),
            ff.Rigid("wall", ff.Ground(), ff.Marker("bar", "left")),
            ff.PointForce("push", ff.Marker("bar", "right"), (0.0, 0.0, 1.0)),
            ff.PositionProbe("tip", ff.Marker("bar", "right")),
        )
        outcome = ff.solve_static(model, ff.StaticOptions(load_steps=1, quiet=True))
        # shear adds 3e-4
        expected = 1.0 / (3.0 * 7e10 * 0.02**4 / 12.0)
        assert outcome.history["tip_z"][-1] == pytest.approx(expected, rel=1e-3)


@pytest.mark.serial
def test_frequencies_of_a_pinned_bar():
    """pi^2 sqrt(EI/mu L^4) between two hinges."""
    model = ff.Model("pinned")
    model.add(
        ff.FloatingBody("bar", _bar(modes=8)),
        ff.Revolute("left", ff.Ground(), ff.Marker("bar", "left"), axis=AXIS),
        ff.PointOnLine("right", ff.Ground((1.0, 0.0, 0.0)), ff.Marker("bar", "right"), (1, 0, 0)),
    )
    outcome = ff.find_modes(model, ff.ModeOptions(modes=2, quiet=True))
    first = 0.5 * np.pi * np.sqrt(7e10 * 0.02**2 / 12.0 / 2700.0)
    found = min(outcome.history["frequency"])
    # rotary inertia and shear lower it by 1e-3; a clamped end would be 1.56 times as high
    assert found == pytest.approx(first, rel=2e-3)


@pytest.mark.serial
def test_rotating_bar_stiffens_as_southwell_says():
    """Out of the plane of rotation omega^2 = omega_0^2 + c Omega^2, first bending of a cantilever.

    Wright, Smith, Thresher, Wang (1982): 3.5160 at rest, 6.4495 at five times the reference speed.
    """
    section_moment, mu = 0.02**4 / 12.0, 2700.0 * 0.02**2
    unit = np.sqrt(7e10 * section_moment / mu)
    reduced = bar(("left",), modes=12, stiffening=True, cells=6)
    body = ff.FloatingBody("bar", reduced, stiffening=True)
    data, own = body_data(body), body.coordinates
    n = len(own)
    count = data.moments.shape[1]
    E = data.products.reshape(3, 3, count, count)[:, :, 1 : n + 1, 1 : n + 1]
    mass = np.einsum("aaij->ij", E)
    assert reduced.acceleration_stiffness is not None
    G = reduced.acceleration_stiffness[:, own][..., own]
    for speed, expected in ((0.0, 3.5160), (5.0, 6.4495), (12.0, 13.1702)):
        square = (speed * unit) ** 2
        stiffness = data.stiffness - square * (E[0, 0] + E[1, 1] + G[3] + G[7])
        values = np.sqrt(np.abs(np.linalg.eigvals(np.linalg.solve(mass, stiffness))))
        # without stiffening the frequency stays 3.516; shear and rotary inertia change it by 1e-3
        assert np.abs(values - expected * unit).min() < 5e-3 * expected * unit
