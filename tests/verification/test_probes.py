# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energies, momenta, joint reactions and beam resultants in the history.

History columns exist on the first rank only: comparisons run there, simulations everywhere.
"""

import importlib.util
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.analyses.dynamics import RunOptions
from flexfem.simulation.dynamics import simulate

ROOT = Path(__file__).parents[2]
G = 9.81
STEEL = ff.Material(youngs_modulus=2e7, poisson_ratio=0.3, density=1000.0)


def _run(model: ff.Model, dt: float, t_end: float, rho_inf: float = 0.9, **more) -> dict:
    """History of a run on all ranks; empty on ranks other than the first."""
    options = RunOptions(dt=dt, t_end=t_end, rho_inf=rho_inf, tolerance=1e-10, **more)
    outcome = simulate(model, options)
    assert outcome.status == "ok"
    return outcome.history


def _xyz(history: dict, name: str, labels: str = "x y z") -> np.ndarray:
    return np.stack([history[f"{name}{label}"] for label in labels.split()], axis=1)


def _bob(*probes, mass: float = 2.0, **more) -> ff.Model:
    """A nearly pointlike bob, 1 m from the inertial origin along x."""
    model = ff.Model("pendulum")
    body = ff.RigidBody("bob", mass, (1e-9, 1e-9, 1e-9), position=(1.0, 0.0, 0.0), **more)
    model.add(ff.Gravity((0.0, 0.0, -G)), body, *probes)
    return model


PIVOT = ff.Marker("bob", offset=(-1.0, 0.0, 0.0))


def _reaction_error(h: float) -> float:
    model = _bob(
        ff.Revolute("pin", ff.Ground(), PIVOT, axis=(0.0, 1.0, 0.0)),
        ff.ReactionProbe("pull", "pin"),
        ff.ReactionProbe("in_bob", "pin", axes="b"),
        ff.PositionProbe("at", ff.Marker("bob")),
    )
    history = _run(model, h, 0.5)
    if not history:
        return 0.0
    # released level: along the string act 3 m g times the depth, whatever the motion
    x = _xyz(history, "at_")
    expected = 3.0 * 2.0 * G * x[:, 2:] * x
    local = _xyz(history, "in_bob_", "fx fy fz")
    error = np.abs(_xyz(history, "pull_", "fx fy fz") - expected)[1:]
    along = 3.0 * 2.0 * G * x[1:, 2]
    error = np.maximum(error, np.abs(local[1:] - along[:, np.newaxis] * (1.0, 0.0, 0.0)))
    return float(error.max())


@pytest.mark.serial
def test_pendulum_reaction():
    coarse, fine = _reaction_error(4e-3), _reaction_error(2e-3)
    if fine:
        # of 58.86 N; a wrong sign or multipliers of another iterate are off by newtons
        assert fine <= 0.02
        assert np.log2(coarse / fine) >= 1.8


@pytest.mark.three_ranks
def test_reaction_of_a_weight_at_rest():
    """Hung by a weld from a marker beside it, in both orders of the markers and in tilted axes."""
    tilt = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    wall = ff.Ground((0.4, 0.0, 0.0), rotation=tilt)
    held = ff.Marker("bob", offset=(-0.6, 0.0, 0.0))
    model = _bob(
        ff.Rigid("weld", wall, held),
        ff.ReactionProbe("r", "weld"),
        ff.ReactionProbe("tilted", "weld", axes="a"),
    )
    history = _run(model, 0.01, 0.03)
    turned = _bob(ff.Rigid("weld", held, wall), ff.ReactionProbe("r", "weld"))
    other = _run(turned, 0.01, 0.03)
    if history:
        labels = "fx fy fz mx my mz"
        found = _xyz(history, "r_", labels)
        # minus the weight, and minus its moment about the marker, 0.6 m inside
        expected = np.array([0.0, 0.0, 2.0 * G, 0.0, -0.6 * 2.0 * G, 0.0])
        # round-off; a moment about the bob's own origin would vanish
        np.testing.assert_allclose(found, np.tile(expected, (4, 1)), atol=1e-8)
        expected = np.concatenate([expected[:3] @ tilt, expected[3:] @ tilt])
        np.testing.assert_allclose(_xyz(history, "tilted_", labels)[-1], expected, atol=1e-8)
        # on the ground instead: the opposite
        np.testing.assert_allclose(_xyz(other, "r_", labels), -found, atol=1e-8)


def _cantilever(*things, damping: float = 0.0) -> ff.Model:
    model = ff.Model("cantilever", mesh=ff.build_mesh("chain", links=1, elements=8))
    model.add(
        ff.Beam("link_1", ff.Section.circle(0.01, STEEL), damping=damping),
        ff.Rigid("root", ff.Ground(), ff.Marker("link_1", "start")),
        ff.PositionProbe("tip", ff.Marker("link_1", "end")),
        ff.ReactionProbe("r", "root"),
        *things,
    )
    return model


@pytest.mark.serial
def test_cantilever_root_reaction_balances_static_load():
    """Steps much longer than the periods, with annihilation, end in equilibrium."""
    force = np.array([0.0, 0.006, -0.01])
    model = _cantilever(
        ff.PointForce("load", ff.Marker("link_1", "end"), force),
        ff.StrainProbe("s", "link_1", 1.0),
        ff.StrainProbe("first", "link_1", 0.0),
        ff.EnergyProbe("e"),
        damping=0.05,
    )
    history = _run(model, 0.5, 20.0, rho_inf=0.0)
    if history:
        tip = _xyz(history, "tip_")[-1]
        # 2 % of the length: the deformed place counts
        assert np.linalg.norm(tip[1:]) > 0.01
        # equilibrium is reached to 1e-9; multiplying with the gradient of the wrong side is a sign
        np.testing.assert_allclose(_xyz(history, "r_", "fx fy fz")[-1], -force, atol=1e-8)
        moment = -np.cross(tip, force)
        np.testing.assert_allclose(_xyz(history, "r_", "mx my mz")[-1], moment, atol=1e-8)
        # the element at the tip carries the moment of half its length, that at the root 15/16
        last = _xyz(history, "s_m", "1 2 3")[-1]
        first = _xyz(history, "first_m", "1 2 3")[-1]
        np.testing.assert_allclose(np.linalg.norm(last) * 15.0, np.linalg.norm(first), rtol=0.01)
        resultant = np.linalg.norm(_xyz(history, "s_n", "1 2 3")[-1])
        assert resultant == pytest.approx(np.linalg.norm(force), rel=0.01)
        stiffness = ff.Section.circle(0.01, STEEL).stiffness[5, 5]
        assert history["first_m3"][-1] == pytest.approx(stiffness * history["first_kappa3"][-1])
        # a dead load's work is its force times the displacement, however the beam swung
        work = force @ (tip - (0.5, 0.0, 0.0))
        assert history["e_work"][-1] == pytest.approx(work, rel=1e-9)
        # half of it is stored but for geometry's share, seen by a factor two in either
        assert history["e_strain"][-1] == pytest.approx(0.5 * work, rel=0.05)


@pytest.mark.serial
def test_turn_since_the_start_does_not_depend_on_axes():
    """Of body and marker axes that are turned at the start; the rotation itself is another."""
    axes = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    marker, angle = ff.Marker("bob", rotation=axes), ff.SmoothStep(0.0, 0.1, 0.0, 0.8)
    fired = []

    def seen(t, state):
        fired.append(state.turn[1, 0] - np.sin(angle(t)))
        return 1.0

    model = _bob(
        ff.Revolute("pin", ff.Ground(), PIVOT, axis=(0.0, 0.0, 1.0)),
        ff.PrescribedAngle("motor", ff.Ground(), PIVOT, axis=(0.0, 0.0, 1.0), angle=angle),
        ff.Probe("p", marker, ("sin", "own"), lambda t, m: (m.turn[1, 0], m.rotation[1, 0])),
        ff.Event("seen", marker, seen, ff.Stop()),
    )
    history = _run(model, 0.01, 0.1)
    # constraints hold to the tolerance of the steps; axes of the marker would be off by 0.3
    assert np.abs(fired).max() < 1e-9
    if history:
        expected = np.sin([angle(t) for t in history["t"]])
        np.testing.assert_allclose(history["sin"], expected, rtol=0.0, atol=1e-9)
        assert abs(history["own"][0]) > 0.1


@pytest.mark.slow_on_ranks
@pytest.mark.serial
def test_impulses_change_momenta():
    """Root reaction and loads, integrated, are the change of both momenta."""
    force = np.array([0.1, 0.3, -0.5])
    errors = []
    for h in (2e-3, 1e-3):
        model = _cantilever(
            ff.PointForce("load", ff.Marker("link_1", "end"), force, amplitude=lambda t: 20.0 * t),
            ff.MomentumProbe("p"),
        )
        history = _run(model, h, 0.1)
        if not history:
            continue
        load = 20.0 * history["t"][:, np.newaxis] * force
        wrench = np.concatenate(
            [
                load + _xyz(history, "r_", "fx fy fz"),
                np.cross(_xyz(history, "tip_"), load) + _xyz(history, "r_", "mx my mz"),
            ],
            axis=1,
        )
        impulse = np.cumsum(0.5 * h * (wrench[1:] + wrench[:-1]), axis=0)
        momenta = _xyz(history, "p_", "px py pz lx ly lz")
        # impulses reach 0.03 N s; lumped instead of consistent masses show in the angular one
        errors.append(np.abs(momenta[1:] - momenta[0] - impulse).max())
    if errors:
        assert errors[1] <= 1e-4
        assert np.log2(errors[0] / errors[1]) >= 1.8


def _swing(**more) -> ff.Model:
    """Flexible link with a bob, a spring, dampers, a follower force and a drive at the bob."""
    model = ff.Model("swing", mesh=ff.build_mesh("chain", links=1, elements=6))
    tip = ff.Marker("link_1", "end")
    model.add(
        ff.Gravity((0.0, 0.0, -G)),
        ff.Beam("link_1", ff.Section.circle(0.01, STEEL), damping=1e-3),
        ff.RigidBody("bob", 0.3, (1e-3, 2e-3, 2e-3), position=(0.5, 0.0, 0.0)),
        ff.PointMass("extra", 0.1, ff.Marker("bob", offset=(0.0, 0.1, 0.0))),
        ff.RigidBody("fan", 0.1, (1e-3, 1e-3, 2e-3), position=(0.5, 0.0, 0.1)),
        ff.Spherical("hinge", ff.Ground(), ff.Marker("link_1", "start")),
        ff.Rigid("weld", tip, ff.Marker("bob")),
        ff.Revolute("axle", ff.Marker("bob", offset=(0, 0, 0.1)), ff.Marker("fan"), axis=(0, 0, 1)),
        ff.PrescribedAngle(
            "motor", ff.Marker("bob"), ff.Marker("fan"), axis=(0, 0, 1),
            angle=lambda t: 30.0 * t * t,
        ),
        ff.SpringDamper("spring", ff.Ground((0.2, 0.1, 0.5)), tip, stiffness=20.0, damping=0.3),
        ff.PointForce("push", tip, (0.5, 1.0, 0.5), follower=True),
        ff.PointMoment("twist", tip, (0.0, 0.0, 0.1)),
        ff.LineLoad("wind", "link_1", (0.0, 1.0, 0.0), amplitude=lambda t: t),
        ff.EnergyProbe(),
        ff.EnergyProbe("part", bodies=["link_1", "fan"]),
        ff.EnergyProbe("rest", bodies=["bob"]),
        ff.MomentumProbe("momentum"),
        ff.ReactionProbe("hinge_force", "hinge"),
        ff.ReactionProbe("weld_force", "weld", axes="b"),
        ff.StrainProbe("strain", "link_1", 0.4),
    )  # fmt: skip
    return model


def _balances(rho_inf: float, h: float) -> dict[str, float]:
    history = _run(_swing(), h, 0.2, rho_inf=rho_inf)
    names = ("energy", "part", "rest")
    return {name: np.abs(history[f"{name}_balance"]).max() for name in names if history}


@pytest.mark.serial
def test_energy_balance_closes():
    coarse, fine = _balances(1.0, 2e-3), _balances(1.0, 1e-3)
    for name, error in fine.items():
        # energies and works of some tenths of a joule: leaving one term out shows at once
        assert error <= 2e-4, name
        assert np.log2(coarse[name] / error) >= 1.8, name


@pytest.mark.serial
def test_energy_balance_closes_with_mean_forces():
    """The energy-momentum method conserves the energy and reports mean forces over the step."""

    def build() -> ff.Model:
        model, bob = ff.Model("pump"), ff.Marker("bob")
        model.add(
            ff.RigidBody("bob", 1.0, (0.1, 0.1, 0.1), velocity=(0.0, 0.0, 1.0)),
            ff.RigidBody("fan", 0.1, (1e-3, 1e-3, 2e-3), position=(0.0, 0.0, 0.1)),
            ff.Revolute("axle", ff.Marker("bob", offset=(0, 0, 0.1)), ff.Marker("fan"), (0, 0, 1)),
            ff.PrescribedAngle("motor", bob, ff.Marker("fan"), (0, 0, 1), lambda t: 10.0 * t * t),
            ff.SpringDamper("spring", ff.Ground((0, 0.5, 1)), bob, stiffness=99.0, damping=1.0),
            ff.EnergyProbe(), ff.EnergyProbe("part", bodies=["fan"]),
        )  # fmt: skip
        return model

    errors = []
    for h in (0.02, 0.01):
        history = _run(build(), h, 1.0, rho_inf=1.0, integrator="energy_momentum")
        names = ("energy_balance", "part_balance")
        errors.append([np.abs(history[name]).max() for name in names])
    # of 0.6 J; mean forces taken for those at the ends of steps: 0.1 J off, of first order
    assert max(errors[1]) <= 1e-3
    assert (np.log2(np.divide(*errors)) >= 1.8).all()


@pytest.mark.serial
def test_a_spring_that_is_cut_stores_nothing():
    model, bob = ff.Model("cut"), ff.Marker("bob")
    model.add(
        ff.RigidBody("bob", 1.0, (0.1, 0.1, 0.1), velocity=(1.0, 0.0, 0.0)),
        ff.SpringDamper("spring", ff.Ground((-1, 0, 0)), bob, stiffness=1.0, damping=0.1),
        ff.Event("cut", bob, lambda t, s: t - 0.105, ff.ReleaseJoint("spring")),
        ff.EnergyProbe(),
    )
    history = _run(model, 0.01, 0.5)
    cut = history["t"] > 0.11
    # 5 mJ before, 0.12 J at the end if it were stretched on
    assert np.abs(history["energy_strain"][cut]).max() == 0.0
    assert np.ptp(history["energy_dissipation"][cut]) == 0.0


@pytest.mark.serial
def test_a_weight_that_grows_has_done_work():
    """A beam that bends as its weight grows: half the weight times the sag, and no balance left."""
    model = _cantilever(ff.Gravity((0.0, 0.0, -G)), ff.EnergyProbe(), ff.MomentumProbe("p"))
    history = ff.solve_static(model, ff.StaticOptions(quiet=True, load_steps=20)).history
    if history:
        weight, sag = history["r_fz"], -history["p_cz"]
        work = np.concatenate([[0], np.cumsum(0.5 * (weight[1:] + weight[:-1]) * np.diff(sag))])
        assert work[-1] > 0.0
        np.testing.assert_allclose(history["energy_gravity"], -work, rtol=1e-9, atol=1e-15)
        # the whole weight times the sag would be twice as much
        np.testing.assert_allclose(history["energy_strain"], work, rtol=0.01, atol=1e-6 * work[-1])


@pytest.mark.serial
def test_loss_grows_with_numerical_dissipation():
    """A beam swinging freely in its higher modes, whose energy the scheme is to take."""
    losses = []
    for rho_inf in (1.0, 0.9, 0.5):
        kick = ff.PointForce(
            "kick", ff.Marker("link_1", 0.5), (0.0, 2.0, 0.0), amplitude=lambda t: float(t < 2e-3)
        )
        history = _run(_cantilever(kick, ff.EnergyProbe()), 1e-3, 0.1, rho_inf=rho_inf)
        losses.append(-history["energy_balance"][-1] / history["energy_work"][-1])
    # a balance without strain or kinetic energy would be of order one and not ordered
    assert abs(losses[0]) <= 0.01
    assert np.all(np.diff(losses) > 0.01)
    assert losses[-1] < 1.0


@pytest.mark.slow_on_ranks
@pytest.mark.serial
def test_damped_oscillator():
    """Mass on spring and damper: what the damper took is the energy that is gone."""
    m, k, c, x0 = 2.0, 200.0, 4.0, 0.1
    model = ff.Model("oscillator")
    model.add(
        ff.RigidBody("mass", m, (0.1, 0.1, 0.1), position=(1.0 + x0, 0.0, 0.0)),
        ff.Prismatic("guide", ff.Ground((1.0 + x0, 0, 0)), ff.Marker("mass"), axis=(1, 0, 0)),
        ff.SpringDamper(
            "spring", ff.Ground(), ff.Marker("mass"), stiffness=k, damping=c, rest_length=1.0
        ),
        ff.EnergyProbe(),
        ff.ReactionProbe("pull", "spring"),
    )
    history = _run(model, 2e-3, 0.4, rho_inf=1.0)
    if history:
        t, decay = history["t"], c / (2.0 * m)
        omega = np.sqrt(k / m - decay**2)
        x = x0 * np.exp(-decay * t) * (np.cos(omega * t) + decay / omega * np.sin(omega * t))
        v = -x0 * np.exp(-decay * t) * (k / m) / omega * np.sin(omega * t)
        # period error (omega h)^2/12 = 3e-5; the wrong factor of a half is 0.5 J
        np.testing.assert_allclose(history["energy_strain"], 0.5 * k * x**2, atol=2e-4)
        np.testing.assert_allclose(history["energy_kinetic"], 0.5 * m * v**2, atol=2e-4)
        lost = 0.5 * k * x0**2 - 0.5 * k * x**2 - 0.5 * m * v**2
        np.testing.assert_allclose(history["energy_dissipation"], lost, atol=2e-4)
        # linear motion by the trapezoidal rule: exact but for the tolerance of the iteration
        assert np.abs(history["energy_balance"]).max() <= 1e-8
        # of 20 N: a spring without its damper is off by 3 N
        np.testing.assert_allclose(history["pull_fx"], -k * x - c * v, atol=0.02)


@pytest.mark.slow
@pytest.mark.serial
def test_friction_and_stop():
    """A block that slides with friction against a stop, is thrown back and comes to rest."""
    model = ff.Model("block")
    model.add(
        ff.RigidBody("block", 2.0, (0.1, 0.1, 0.1), velocity=(3.0, 0.0, 0.0)),
        guide := ff.Prismatic("guide", ff.Ground(), ff.Marker("block"), axis=(1, 0, 0)),
        ff.JointFriction("rub", guide, force=4.0, velocity=1e-3),
        ff.LimitStop(
            "stop", ff.Ground(), ff.Marker("block"), axis=(1, 0, 0), upper=1.0, stiffness=2e4
        ),
        ff.EnergyProbe(),
        ff.PositionProbe("at", ff.Marker("block")),
    )
    history = _run(model, 2e-4, 2.0, rho_inf=1.0)
    if history:
        energy = {name[7:]: history[name] for name in history if name.startswith("energy_")}
        way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(history["at_x"])))])
        # 9 J in all; friction takes its force times the way but at the turning point
        np.testing.assert_allclose(energy["dissipation"], 4.0 * way, atol=0.02)
        depth = np.maximum(history["at_x"] - 1.0, 0.0)
        # at most 5 J, 22 mm deep: stiffness times depth, squared
        np.testing.assert_allclose(energy["strain"], 1e4 * depth**2, atol=1e-6)
        assert energy["strain"].max() > 4.0
        assert energy["kinetic"][-1] < 1e-4
        assert np.abs(energy["balance"]).max() <= 0.01


@pytest.mark.serial
def test_flying_spaghetti_gains_the_work_of_its_loads():
    spec = importlib.util.spec_from_file_location("spaghetti", ROOT / "cases/flying_spaghetti.py")
    case = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(case)
    errors = []
    for h in (0.05, 0.025):
        model = case.CASE.model(elements=8)
        model.add(ff.EnergyProbe(), ff.MomentumProbe("p"))
        history = _run(model, h, 6.0, rho_inf=1.0)
        if history:
            end = {name: column[-1] for name, column in history.items()}
            # impulse of the force: 1/10 of the area under the pulse, 500
            np.testing.assert_allclose(
                [end["p_px"], end["p_py"], end["p_pz"]], [50.0, 0.0, 0.0], atol=1e-6
            )
            # 125 of 440 joules are translation, the rest rotation and bending
            assert end["energy_work"] > 300.0
            errors.append(abs(end["energy_balance"] / end["energy_work"]))
    if errors:
        # second order; a dead moment whose work is taken in body axes is off by a tenth
        assert errors[1] <= 5e-3
        assert np.log2(errors[0] / errors[1]) >= 1.5


@pytest.mark.slow_on_ranks
@pytest.mark.serial
def test_drive_of_a_slider_crank_does_the_work():
    """A crank turned by a law of time: its moment times its rate is what the bodies gain."""
    model = ff.Model("crank")
    model.add(
        ff.RigidBody("crank", 1.0, (0.01, 0.01, 0.01), position=(0.1, 0.0, 0.0)),
        ff.RigidBody("rod", 2.0, (0.01, 0.05, 0.05), position=(0.45, 0.0, 0.0)),
        ff.Revolute(
            "bearing", ff.Ground(), ff.Marker("crank", offset=(-0.1, 0, 0)), axis=(0, 0, 1)
        ),
        ff.PrescribedAngle(
            "motor", ff.Ground(), ff.Marker("crank"), axis=(0, 0, 1), angle=lambda t: 10.0 * t * t
        ),
        ff.Spherical(
            "pin", ff.Marker("crank", offset=(0.1, 0, 0)), ff.Marker("rod", offset=(-0.25, 0, 0))
        ),
        ff.PointOnLine(
            "guide", ff.Ground((0.7, 0, 0)), ff.Marker("rod", offset=(0.25, 0, 0)), axis=(1, 0, 0)
        ),
        ff.EnergyProbe(),
        ff.ReactionProbe("drive", "motor"),
    )
    history = _run(model, 2e-3, 0.6)
    if history:
        # from rest to 12 rad/s
        gained = history["energy_kinetic"] - history["energy_kinetic"][0]
        assert gained[-1] > 1.0
        # a sign or a missing time derivative would leave all of it
        assert np.abs(history["energy_work"] - gained).max() <= 5e-3 * gained.max()
        moment, rate = history["drive_mz"], 20.0 * history["t"]
        work = np.cumsum(1e-3 * (moment[1:] * rate[1:] + moment[:-1] * rate[:-1]))
        assert np.abs(work - history["energy_work"][1:]).max() <= 5e-3 * gained.max()


@pytest.mark.three_ranks
def test_ranks_agree():
    """On all ranks together as on one alone, with the beam split."""
    options = RunOptions(dt=1e-3, t_end=0.03, tolerance=1e-10, split_above=2)
    alone = simulate(_swing(), options, comm=MPI.COMM_SELF).history
    together = simulate(_swing(), options).history
    for name, column in together.items():
        scale = np.abs(alone[name]).max()
        if name.endswith("_balance"):  # a difference of energies
            scale = np.abs(alone[name.replace("balance", "kinetic")]).max()
        # nodes or rows counted on two ranks would double a part of a column
        np.testing.assert_allclose(column, alone[name], rtol=0.0, atol=1e-9 * scale + 1e-11)


@pytest.mark.serial
def test_losses_of_elements_of_unequal_length_close_the_balance():
    """A damped rod that vibrates along its axis, which is linear: the balance is exact."""
    x = np.array([0.0, 0.1, 0.7, 1.0])[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    mesh = ff.LineMesh(x, [[0, 1], [1, 2], [2, 3]], {"rod": [0, 1, 2]})
    model = ff.Model("rod", mesh=mesh)
    model.add(
        ff.Beam("rod", ff.Section.circle(0.02, STEEL), damping=2e-3),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("rod", "start")),
        ff.PointForce("pull", ff.Marker("rod", "end"), (2.0, 0.0, 0.0)),
        ff.EnergyProbe(),
    )
    history = _run(model, 1e-3, 0.03, rho_inf=1.0)
    lost = history["energy_dissipation"][-1]
    assert lost > 1e-5
    balance = history["energy_balance"]
    # at the start, of accelerations by a sudden load, what damping ends within a step is left out
    assert -0.02 * lost <= balance[1] <= 0.0
    # per cents with the mean length instead of each element's own
    assert np.ptp(balance[1:]) <= 1e-6 * lost
