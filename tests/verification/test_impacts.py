# SPDX-License-Identifier: LGPL-3.0-or-later
"""Impacts on stops: closed forms, energy over many bounces, order, constraints, restart and ranks.

Where a stop's force is evaluated at the end of a step instead, the bouncing body here has up to 70
times its energy after 20 bounces, and the elastic arm 1.8 times.
"""

from math import atan, cos, hypot, pi, sin, sqrt

from mpi4py import MPI

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import flexfem as ff
from flexfem.analyses.dynamics import INTEGRATORS
from flexfem.core.status import Status
from flexfem.integrators.split.unilateral import UnilateralRows
from flexfem.mesh.line_mesh import LineMesh
from flexfem.simulation.motion.stepping import Simulation

WORLD, ALONE = MPI.COMM_WORLD, MPI.COMM_SELF
X, Z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def started(model: ff.Model, h: float, comm: MPI.Intracomm = ALONE, **options) -> Simulation:
    """A motion at its start."""
    given = {"t_end": 100.0, "tolerance": 1e-10, "quiet": True} | options
    return Simulation(model, ff.RunOptions(dt=h, **given), comm)


def energy(simulation: Simulation) -> float:
    """Kinetic and stored energy of rigid bodies, J."""
    rows, total = simulation.system.constraints, 0.0
    simulation.system.interface.update()
    rows.place_markers()
    total += float(rows.stored()[0] @ rows.owned)
    for part in simulation.system.parts:
        for node, mass in zip(part.masses.nodes, part.masses.matrices, strict=True):
            v = part.block.velocity[node]
            total += 0.5 * float(v @ mass @ v)
    return total


def between_walls(force=None) -> ff.Model:
    """A body that turns as it flies between two stops 10 mm away; 50 bounces a second."""
    law = {"force": force} if force else {"stiffness": 1e6}
    model = ff.Model("walls")
    model.add(
        ff.RigidBody("ball", 1.0, (0.1, 0.2, 0.3), velocity=X, angular_velocity=(0.0, 0.0, 2.0)),
        ff.LimitStop("walls", ff.Ground(), ff.Marker("ball"), axis=X, lower=-0.01, upper=0.01,
                     **law),
    )  # fmt: skip
    return model


@pytest.mark.serial
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_mass_on_elastic_ground(integrator: str) -> None:
    """Free flight and a sine, in closed form: m = 1, k = 100, g = 10, v = -1, 2 m above."""

    def place(t: float) -> float:
        fall = (sqrt(41.0) - 1.0) / 10.0
        if t <= fall:
            return -t - 5.0 * t * t
        late, v = t - fall, -sqrt(41.0)
        # -0.1 + 0.1 cos + v/10 sin vanishes again where tan(5 s) = v
        sinking = 2.0 * (pi + atan(v)) / 10.0
        if late <= sinking:
            x = -0.1 + 0.1 * cos(10.0 * late) + 0.1 * v * sin(10.0 * late)
            return x - 2.0
        late -= sinking
        return -2.0 - v * late - 5.0 * late**2

    model = ff.Model("ground")
    model.add(
        ff.RigidBody("mass", 1.0, (1.0, 1.0, 1.0), velocity=(0.0, 0.0, -1.0)),
        ff.LimitStop("floor", ff.Ground(), ff.Marker("mass"), axis=Z, lower=-2.0, stiffness=100.0),
        ff.Gravity((0.0, 0.0, -10.0)),
    )
    errors = []
    for steps in (40, 80):
        h, worst = 1.2 / steps, 0.0
        simulation = started(model, h, rho_inf=1.0, integrator=integrator)
        for k in range(steps):
            assert simulation.advance(h) is Status.OK
            z = simulation.system.parts[0].block.frames[0, 2]
            worst = max(worst, abs(z - place(h * (k + 1))))
        errors.append(worst)
    # a stop that begins a step too late is off by 0.2 m and of first order
    assert errors[1] < 5e-3
    assert errors[0] / errors[1] > 2.5


@pytest.mark.serial
@pytest.mark.parametrize(
    ("force", "bounces"), [(None, 1000), (lambda d: 3e7 * d**1.5, 100)], ids=["spring", "Hertz"]
)
def test_energy_of_many_bounces(force, bounces: int) -> None:
    """Each impact lies within a step."""
    simulation = started(between_walls(force), 1e-2, rho_inf=1.0)
    start = energy(simulation)
    for _ in range(2 * bounces):
        simulation.advance(1e-2)
    # rounding is 1e-14 a bounce, what the default tolerance of positions leaves 1e-7
    assert energy(simulation) == pytest.approx(start, rel=1e-12 * bounces)
    # at 1 m/s for 2 s and longer: it has not passed through
    assert abs(simulation.system.parts[0].block.frames[0, 0]) < 0.02


@pytest.mark.serial
@pytest.mark.parametrize("h", [1e-4, 1e-3, 5e-3])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_dissipative_schemes_never_gain(h: float, integrator: str) -> None:
    simulation = started(between_walls(), h, rho_inf=0.9, integrator=integrator)
    start = energy(simulation)
    for _ in range(round(max(60, 0.03 / h))):
        simulation.advance(h)
        # the body gained 0.003, 0.6 and 61 of its energy with the force at the end
        assert energy(simulation) <= start * (1.0 + 1e-6)


@pytest.mark.serial
def test_impulses_are_the_reported_forces() -> None:
    """Mean forces times steps change the momentum; a damper takes energy and never makes any."""
    model = between_walls()
    model.add(ff.ReactionProbe("wall", "walls"), ff.EnergyProbe("energy"))
    found = ff.simulate(
        model, ff.RunOptions(dt=1e-3, t_end=0.02, tolerance=1e-10, rho_inf=1.0, quiet=True)
    ).history
    # one bounce from +1 to -1 m/s of 1 kg; the direction of a body that turns is of second order
    assert 1e-3 * float(np.sum(found["wall_fx"])) == pytest.approx(-2.0, rel=1e-5)
    assert np.abs(found["energy_balance"]).max() < 1e-12


@pytest.mark.serial
def test_a_stop_under_a_weight_from_the_start() -> None:
    """The accelerations of the start have the stop's force in them: it must not count twice."""
    model = ff.Model("resting")
    model.add(
        ff.RigidBody("block", 2.0, (0.1, 0.1, 0.1), position=(0.0, 0.0, -0.02)),
        ff.LimitStop("floor", ff.Ground(), ff.Marker("block"), axis=Z, lower=0.0, stiffness=1e3),
        ff.Gravity((0.0, 0.0, -10.0)),
    )
    simulation = started(model, 1e-3)
    for _ in range(20):
        simulation.advance(1e-3)
    block = simulation.system.parts[0].block
    np.testing.assert_allclose(block.frames[0, 2], -0.02, atol=1e-13)
    np.testing.assert_allclose(block.acceleration[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(np.abs(simulation.system.reported_forces()), 20.0, rtol=1e-9)


@pytest.mark.serial
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_order_with_a_soft_stop(integrator: str) -> None:
    """A turning body swings on a slack spring: second order, as of a smooth force."""

    def slopes(t: float, y: np.ndarray) -> np.ndarray:
        stretch = max(hypot(*y[:2]) - 1.0, 0.0)
        return np.array([*y[2:], *(-200.0 * stretch * y[:2] / hypot(*y[:2]) + [0.0, -3.0])])

    exact = solve_ivp(
        slopes, (0, 0.5), [1.05, 0.0, 0.3, 2.0], rtol=1e-10, atol=1e-11, max_step=1e-2
    )
    model = ff.Model("rope")
    model.add(
        ff.RigidBody("p", 1.0, (0.1, 0.2, 0.3), position=(1.05, 0.0, 0.0),
                     velocity=(0.3, 2.0, 0.0), angular_velocity=(0.0, 0.0, 1.0)),
        ff.LimitStop("rope", ff.Ground(), ff.Marker("p"), "distance", upper=1.0, stiffness=200.0),
        ff.Gravity((0.0, -3.0, 0.0)),
    )  # fmt: skip
    errors = []
    for steps in (25, 50):
        simulation = started(model, 0.5 / steps, rho_inf=1.0, integrator=integrator)
        start = energy(simulation)
        for _ in range(steps):
            simulation.advance(0.5 / steps)
        x = simulation.system.parts[0].block.frames[0]
        # a force along the line at the end of the step instead of the mean one makes 1e-2
        assert energy(simulation) + 3.0 * x[1] == pytest.approx(start, abs=1e-3)
        errors.append(float(np.abs(x[:2] - exact.y[:2, -1]).max()))
    assert errors[0] / errors[1] > 3.5


def arm(drop: float = 0.02) -> ff.Model:
    """An elastic arm on a hinge falls with its end onto a stiff stop."""
    count = 4
    points = np.linspace(0.0, 1.0, count + 1)[:, np.newaxis] * np.array(X)
    cells = np.stack([np.arange(count), np.arange(1, count + 1)], axis=1)
    model = ff.Model("arm", mesh=LineMesh(points, cells, {"arm": np.arange(count)}))
    end = ff.Marker("arm", "end")
    model.add(
        ff.Gravity((0.0, -9.81, 0.0)),
        ff.Beam("arm", ff.Section.rectangle(0.02, 0.02, ff.Material(2e9, 0.3, 1200.0))),
        ff.RigidBody("bob", 0.1, (1e-4, 1e-4, 1e-4), position=(1.0, 0.0, 0.0)),
        ff.Rigid("weld", end, ff.Marker("bob")),
        ff.Revolute("hinge", ff.Ground(), ff.Marker("arm", "start"), axis=Z),
        ff.LimitStop("stop", ff.Ground((1.0, -drop, 0.0)), ff.Marker("bob"), axis=(0.0, 1.0, 0.0),
                     lower=0.0, stiffness=1e6),
        ff.EnergyProbe("energy"),
        ff.ReactionProbe("pin", "hinge"),
    )  # fmt: skip
    return model


@pytest.mark.serial
@pytest.mark.parametrize("rho_inf", [1.0, 0.9])
def test_an_elastic_arm_on_a_stop(rho_inf: float) -> None:
    options = ff.RunOptions(dt=1e-3, t_end=0.12, tolerance=1e-9, rho_inf=rho_inf, quiet=True)
    found = ff.simulate(arm(), options).history
    total = sum(found[f"energy_{name}"] for name in ("kinetic", "strain", "gravity"))
    # the beam is not linear, and the scheme no energy method for it: 2e-5 without the stop; with
    # the force at the end of the step half of the energy is made
    assert (total - total[0]).max() < 1e-3 * found["energy_kinetic"].max()


@pytest.mark.serial
def test_constraints_and_factors() -> None:
    """Rates of the joints vanish after impulses, whose masses are factorised once in a run."""
    simulation = started(arm(), 1e-3, integrator="stabilized_index2", rho_inf=0.9)
    factorised, worst, hits = simulation.system.counters.mass_factorizations, 0.0, 0
    rows = simulation.system.constraints
    for _ in range(110):
        simulation.advance(1e-3)
        hits += bool(rows.impulses.any())
        rows.evaluate(np.ones(2))
        worst = max(worst, float(np.abs(rows.rates()[rows.rigid]).max()))
    assert hits > 5
    assert simulation.system.counters.mass_factorizations == factorised + 1
    # velocities are 1 m/s; without the constraints' share of the impulse rates are 0.1
    assert worst < 1e-7


@pytest.mark.serial
def test_adaptive_steps_and_restart() -> None:
    """An impact does not drive step sizes to nothing; a state in contact goes on as it would."""
    options = {"adaptive": True, "error_tolerance": 1e-4, "rho_inf": 0.9}
    simulation, again = (started(arm(), 2e-3, **options) for _ in range(2))
    while not simulation.system.constraints.impulses.any():
        simulation.advance(2e-3)
    again.restore(simulation.state())
    for _ in range(8):
        simulation.advance(2e-3)
        again.advance(2e-3)
    for name, values in simulation.system.parts[0].block.state().items():
        np.testing.assert_allclose(
            again.system.parts[0].block.state()[name],
            values,
            rtol=1e-9,
            atol=1e-9 * np.abs(values).max(),
        )
    assert simulation.rejected < 60


@pytest.mark.serial
def test_friction_sees_the_normal_force_once() -> None:
    """A stop across a rail presses the block on it: ``v_1/v_0 = ((1 - mu)/(1 + mu))^1/2``."""
    mu, bob = 0.2, ff.Marker("bob")
    rail = ff.Prismatic("rail", ff.Ground(), bob, axis=X)
    model = ff.Model("wedge")
    model.add(
        ff.RigidBody("bob", 1.0, (0.1, 0.1, 0.1), velocity=(1.0, 0.0, 0.0)),
        rail,
        ff.LimitStop("stop", ff.Ground(), bob, axis=(sqrt(0.5), 0.0, sqrt(0.5)), upper=5e-3,
                     stiffness=2e4),
        ff.JointFriction("rubs", rail, coefficient=mu),
    )  # fmt: skip
    simulation = started(model, 1e-3, rho_inf=0.9)
    for _ in range(60):
        assert simulation.advance(1e-3) is Status.OK
    v = simulation.system.parts[0].block.velocity[0, 0]
    # 25 steps in contact; with twice the normal force 0.65 of the velocity is left, not 0.82
    assert v == pytest.approx(-sqrt((1.0 - mu) / (1.0 + mu)), rel=1e-2)


@pytest.mark.serial
@pytest.mark.parametrize("integrator", ["generalized_alpha", "independent_coordinates"])
def test_a_stop_that_stays_closed_is_a_part_of_the_scheme(integrator: str) -> None:
    """A block comes to rest on a damped stop, is pulled off it later, also after a restart."""
    model = ff.Model("lift")
    model.add(
        ff.RigidBody("block", 2.0, (0.1, 0.1, 0.1), position=(0.0, 0.0, 1e-3)),
        ff.LimitStop("floor", ff.Ground(), ff.Marker("block"), axis=Z, lower=0.0, stiffness=1e4,
                     damping=100.0),
        ff.Gravity((0.0, 0.0, -10.0)),
        ff.PointForce("lift", ff.Marker("block"), (0.0, 0.0, 60.0),
                      amplitude=ff.Table([0, 0.5, 0.6], [0, 0, 1])),
    )  # fmt: skip
    simulation = started(model, 2e-3, integrator=integrator)
    rows, block = simulation.system.constraints, simulation.system.parts[0].block
    while rows.settled.max() < 10:
        assert simulation.advance(2e-3) is Status.OK
    again = started(model, 2e-3, integrator=integrator)
    again.restore(simulation.state())
    while simulation.time < 0.45:
        simulation.advance(2e-3)
        again.advance(2e-3)
    np.testing.assert_array_equal(again.system.constraints.forces, rows.forces)
    # an impulse that joins the scheme twice, or not at all, leaves accelerations of 10 m/s^2
    np.testing.assert_allclose(np.abs(rows.forces), 20.0, rtol=1e-3)
    assert not rows.impulses.any()
    np.testing.assert_allclose(block.acceleration[0], 0.0, atol=1e-2)
    while simulation.time < 0.65:
        simulation.advance(2e-3)
    assert not rows.forces.any()
    np.testing.assert_allclose(block.acceleration[0, 2], 20.0, rtol=1e-9)

    def slopes(t: float, y: np.ndarray) -> list[float]:
        lift, push = 600.0 * (min(t, 0.6) - 0.5), 1e4 * max(-y[0], 0.0)
        push *= 1.0 - np.tanh(100.0 * y[1] / push) if push else 1.0
        return [y[1], 0.5 * (lift + push) - 10.0]

    exact = solve_ivp(slopes, (0.5, simulation.time), [-2e-3, 0.0], rtol=1e-9, max_step=1e-3)
    # second order in the step, 2e-4
    np.testing.assert_allclose(block.velocity[0, 2], exact.y[1, -1], rtol=1e-3)


@pytest.mark.several_ranks
@pytest.mark.three_ranks
@pytest.mark.parametrize("drop", [1e-3, -1e-4], ids=["falls", "leaves"])
def test_ranks(drop: float) -> None:
    """Bodies on other ranks than the stop: the same motion, and the same impulses."""
    options = ff.RunOptions(dt=1e-3, t_end=0.02, tolerance=1e-11, rho_inf=0.9, quiet=True)
    found = []
    for comm in (ALONE, WORLD):
        simulation = Simulation(arm(drop), options, comm)
        hits = 0.0
        for _ in range(20):
            simulation.advance(1e-3)
            rows = simulation.system.constraints
            hits += float(rows.owned @ np.abs(rows.impulses))
        sums = [hits, float(rows.owned @ np.abs(simulation.system.reported_forces()))]
        sums += [
            float(np.abs(p.block.frames[: p.block.owned]).sum()) for p in simulation.system.parts
        ]
        sums += [
            float(np.abs(p.block.velocity[: p.block.owned]).sum()) for p in simulation.system.parts
        ]
        found.append(comm.allreduce(np.array(sums)))
    assert found[0][0] > 0.0
    np.testing.assert_allclose(found[1], found[0], rtol=1e-9)


@pytest.mark.serial
def test_open_stops_are_looked_at_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps within the limits evaluate no forces over them, and all steps are those that do."""
    evaluated = []
    usual = UnilateralRows.evaluate
    monkeypatch.setattr(
        UnilateralRows, "evaluate", lambda *given: (evaluated.append(1), usual(*given))
    )
    quick, slow = (started(between_walls(), 1e-3) for _ in range(2))
    counts = [0, 0]
    for _ in range(100):
        slow.system.constraints.slack = False
        for i, one in enumerate((quick, slow)):
            evaluated.clear()
            one.advance(1e-3)
            counts[i] += bool(evaluated)
    # five bounces of 3 steps and the ones after them; the other steps are plain
    assert counts[0] <= 35
    assert counts[1] == 100
    # a step that misses a wall is off by 1
    for one, other in zip(quick.system.parts, slow.system.parts, strict=True):
        np.testing.assert_allclose(one.block.velocity, other.block.velocity, rtol=0, atol=1e-12)
        np.testing.assert_allclose(one.block.frames, other.block.frames, rtol=0, atol=1e-13)
