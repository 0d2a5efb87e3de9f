# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nets of cables: closed forms, energies and momenta, other bodies with the same energy, ranks."""

import math

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from scipy.integrate import solve_ivp

import flexfem as ff
from flexfem.families.cable_net import kernels
from flexfem.layout.numbered_model import NumberedModel
from flexfem.system.build import build

COMM = MPI.COMM_WORLD
STEPS = {"integrator": "energy_momentum", "tolerance": 1e-12, "quiet": True}


def grid(count: int = 5, size: float = 1.0) -> ff.ElementMesh:
    """A square net in the x-y plane with diagonals, its corners as sets."""
    ticks = np.linspace(0.0, size, count)
    points = np.array([[x, y, 0.0] for y in ticks for x in ticks])
    number = np.arange(count * count).reshape(count, count)
    cells = [
        np.column_stack([number[:, :-1].ravel(), number[:, 1:].ravel()]),
        np.column_stack([number[:-1].ravel(), number[1:].ravel()]),
        np.column_stack([number[:-1, :-1].ravel(), number[1:, 1:].ravel()]),
    ]
    corners = number[[0, 0, -1, -1], [0, -1, 0, -1]]
    sets = {"corners": corners, "middle": [int(number[count // 2, count // 2])]}
    return ff.ElementMesh(points, np.concatenate(cells), "interval", nodes=sets)


def tossed(damping: float, **more) -> ff.Model:
    """A free net that turns and shrinks, whose cables become slack and taut."""
    mesh, model = grid(), ff.Model("tossed")
    wave = 0.05 * np.sin(7.0 * mesh.points[:, [1, 0, 0]])
    moved = ff.ElementMesh(mesh.points + wave, mesh.cells, "interval", nodes=mesh.nodes)
    lengths = np.linalg.norm(np.diff(mesh.points[mesh.cells], axis=1)[:, 0], axis=1)
    model.add(
        ff.CableNet(
            "net", moved, 200.0, mass_per_length=0.05, rest_length=lengths, damping=damping,
            node_mass=0.01, velocity=(0.3, 0.0, 0.1), angular_velocity=(0.5, 0.2, 3.0), **more,
        ),
        ff.EnergyProbe(),
        ff.MomentumProbe("momentum"),
        ff.PositionProbe("middle", ff.Marker("net", "middle")),
    )  # fmt: skip
    return model


@pytest.mark.serial
def test_a_mass_rebounds_from_a_cable():
    """Free until the cable is taut, half a period of the spring, and back at the same speed."""
    mesh = ff.ElementMesh(
        [[0, 0, 0], [0.8, 0, 0]], [[0, 1]], "interval", nodes={"wall": [0], "ball": [1]}
    )
    m, L, EA, v = 0.5, 1.0, 450.0, 2.0

    def last(h: float) -> tuple[float, float, float]:
        model = ff.Model("ball")
        model.add(
            ff.CableNet(
                "rope", mesh, EA, mass_per_length=0.0, rest_length=L, node_mass=[1.0, m],
                velocity=(v, 0.0, 0.0), fixed={"wall": "xyz"},
            ),
            ff.Probe("ball", ff.Marker("rope", "ball"), ("x", "v"),
                     lambda t, at: (at.position[0], at.velocity[0])),
            ff.EnergyProbe(),
        )  # fmt: skip
        found = ff.simulate(model, ff.RunOptions(dt=h, t_end=0.3, rho_inf=1.0, **STEPS)).history
        return found["x"][-1], found["v"][-1], float(np.ptp(found["energy_balance"]))

    taut, rebound = 0.2 / v, math.pi * math.sqrt(m * L / EA)
    exact = L - v * (0.3 - taut - rebound)
    errors = []
    for h in (2e-3, 1e-3):
        x, speed, balance = last(h)
        errors.append(abs(x - exact))
        # an energy that is that of the trapezoidal rule changes by 1e-3 J at both events
        assert abs(speed + v) < 1e-9
        assert balance < 1e-10
    # first order in the mean force of the step with the event would leave 1e-3
    assert errors[1] < 2e-5
    assert errors[1] < 0.4 * errors[0]


@pytest.mark.serial
@pytest.mark.parametrize("slack", [True, False])
def test_energy_and_momenta_stay(slack):
    """A net without damper, cables or bars, conserves all with ``rho_inf`` 1."""
    options = ff.RunOptions(dt=5e-3, t_end=0.4, rho_inf=1.0, **STEPS)
    found = ff.simulate(tossed(0.0, tension_only=slack), options).history
    size = found["energy_kinetic"][0] + found["energy_strain"][0]
    assert np.ptp(found["energy_strain"]) > 0.05 * size
    # the trapezoidal rule changes the energy by a thousandth
    assert np.ptp(found["energy_balance"]) < 1e-10 * size
    for name in ("px", "py", "pz", "lx", "ly", "lz"):
        column = found[f"momentum_{name}"]
        assert np.ptp(column) < 1e-10 * max(1.0, abs(column[0]))


@pytest.mark.serial
@pytest.mark.parametrize("slack", [True, False])
def test_dampers_take_what_is_lost(slack):
    """What the dampers dissipate is what the energy loses, and numerical dissipation adds none."""
    for rho in (1.0, 0.8):
        options = ff.RunOptions(dt=5e-3, t_end=0.3, rho_inf=rho, **STEPS)
        found = ff.simulate(tossed(2e-3, tension_only=slack), options).history
        size = found["energy_kinetic"][0] + found["energy_strain"][0]
        lost = found["energy_dissipation"]
        assert np.diff(lost).min() > -1e-12 * size  # a damper that drives
        assert lost[-1] > 0.02 * size
        balance = found["energy_balance"]
        if rho == 1.0:
            assert np.ptp(balance) < 1e-10 * size
        else:  # the quadratic forms of changes over a step are bounded by the energy
            assert balance.max() < 0.02 * size


@pytest.mark.serial
def test_dampers_in_coarse_steps_take_what_is_recorded():
    """The trapezoidal rule with velocities of a stiff damper that change sign in every step."""
    mesh = ff.ElementMesh(
        [[0, 0, 0], [1.0, 0, 0]], [[0, 1]], "interval", nodes={"wall": [0], "ball": [1]}
    )
    model = ff.Model("pushed")
    model.add(
        ff.CableNet(
            "bar", mesh, 100.0, mass_per_length=0.0, rest_length=1.0, node_mass=[1.0, 0.1],
            fixed={"wall": "xyz"}, damping=1.0, tension_only=False,
        ),
        ff.PointForce("push", ff.Marker("bar", "ball"), (1, 0, 0), amplitude=lambda t: 100.0 * t),
        ff.EnergyProbe(),
    )  # fmt: skip
    options = STEPS | {"integrator": "generalized_alpha", "dt": 1e-2, "t_end": 0.2, "rho_inf": 1.0}
    found = ff.simulate(model, ff.RunOptions(**options)).history
    # 1e-14; the mean power of both ends of the steps is not what these take: 2e-3
    assert abs(found["energy_balance"][-1]) < 1e-9 * found["energy_dissipation"][-1]


@pytest.mark.serial
def test_bars_are_those_of_the_same_energy_in_ufl():
    """Another body with the same energy and mass moves in the same way."""
    mesh = grid(3)
    options = ff.RunOptions(dt=2e-3, t_end=0.1, tolerance=1e-12, quiet=True)

    def stretched(x, X, p):
        F = ufl.grad(x)
        return p.EA / 2 * (ufl.sqrt(ufl.inner(F, F)) - 1) ** 2

    spin = {"angular_velocity": (0.0, 0.0, 8.0)}
    bodies = (
        ff.CableNet("net", mesh, 30.0, mass_per_length=0.2, tension_only=False, **spin),
        ff.UFLBody("net", mesh, stretched, density=0.2, parameters={"EA": 30.0}, **spin),
    )
    found = []
    for body in bodies:
        model = ff.Model("net")
        model.add(body, ff.PositionProbe("at", ff.Marker("net", (1.0, 0.5, 0.0))))
        found.append(ff.simulate(model, options).history)
    for name in ("at_x", "at_y"):
        assert abs(np.ptp(found[0][name])) > 0.1
        # other masses or strains differ by more than 1e-3
        np.testing.assert_allclose(found[0][name], found[1][name], atol=1e-8)


@pytest.mark.serial
def test_a_load_between_two_cables():
    """Equilibrium of a weight on a V of two elastic cables, whose angle is known implicitly."""
    L, EA, weight = 1.0, 400.0, 10.0
    mesh = ff.ElementMesh(
        [[-0.8, 0, 0], [0, 0, -0.7], [0.8, 0, 0]], [[0, 1], [1, 2]], "interval",
        nodes={"ends": [0, 2], "knot": [1]},
    )  # fmt: skip
    model = ff.Model("v")
    model.add(
        ff.CableNet("v", mesh, EA, mass_per_length=1e-9, rest_length=L, fixed={"ends": "xyz"}),
        ff.PointForce("weight", ff.Marker("v", "knot"), (0.0, 0.0, -weight),
                      amplitude=lambda t: 1.0),  # without it both would be slack
        ff.PositionProbe("at", ff.Marker("v", "knot")),
    )  # fmt: skip
    outcome = ff.solve_static(model, ff.StaticOptions(load_steps=1, quiet=True))
    z = outcome.history["at_z"][-1]
    length = math.hypot(0.8, z)
    pulled = 2.0 * EA * (length / L - 1.0) * -z / length
    assert pulled == pytest.approx(weight, rel=1e-8)  # EA times a stretch by l is 3 % more


@pytest.mark.serial
def test_a_taut_string_sounds():
    """Frequencies of a string of linear elements under a preload, in closed form."""
    count, tension, mass = 12, 50.0, 0.02
    points = np.zeros((count + 1, 3))
    points[:, 0] = np.linspace(0.0, 1.2, count + 1)
    cells = np.column_stack([np.arange(count), np.arange(1, count + 1)])
    mesh = ff.ElementMesh(points, cells, "interval", nodes={"ends": [0, count]})
    EA, model = 5e3, ff.Model("string")
    model.add(
        ff.CableNet("string", mesh, EA, mass_per_length=mass, preload=tension,
                    fixed={"ends": "xyz"})
    )  # fmt: skip
    found = ff.find_modes(model, ff.ModeOptions(modes=6, quiet=True)).history["frequency"]
    h = 1.2 / count
    own = mass / (1.0 + tension / EA)  # per present length
    turns = np.arange(1, 4) * math.pi / count
    square = 6.0 * tension / (own * h**2) * (1.0 - np.cos(turns)) / (2.0 + np.cos(turns))
    expected = np.repeat(np.sqrt(square) / (2.0 * math.pi), 2)  # in y and in z
    # lumped masses, or the mass of the stretched cable, are off by more than 1e-3
    np.testing.assert_allclose(found[:6], expected, rtol=1e-7)


@pytest.mark.serial
@pytest.mark.parametrize("slack", [True, False])
def test_matrices_are_derivatives(slack):
    """Residual, matrix and action at a state with taut and slack cables that move."""
    model = ff.Model("net")
    model.add(
        ff.CableNet(
            "net",
            grid(3),
            40.0,
            mass_per_length=0.3,
            damping=3e-2,
            tension_only=slack,
            slack_damping=1e-2 * slack,
        )
    )
    system = build(NumberedModel(model), COMM, split_above=100)
    (part,) = system.parts
    block, elements = part.block, part.elements
    random = np.random.default_rng(3)
    block.frames[:, :3] += 0.08 * random.normal(size=(9, 3))
    block.velocity[:, :3] = random.normal(size=(9, 3))
    shifts, none = np.array([0.3, 1.7, 1.0]), np.zeros(3)
    rows, columns = elements.couplings[0]
    blocks = elements.values(block, none, shifts, 0.9).reshape(-1, 3, 3)
    matrix = np.zeros((27, 27))
    for i, j, K in zip(rows[:, 0], columns[:, 0], blocks, strict=True):
        matrix[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] += K
    step = random.normal(size=(9, 3))
    frames, rate, gain = block.frames.copy(), block.velocity.copy(), block.acceleration.copy()

    def residual(size: float) -> np.ndarray:
        block.frames[:, :3] = frames[:, :3] + size * step
        block.velocity[:, :3] = rate[:, :3] + 0.3 * size * step
        block.acceleration[:, :3] = gain[:, :3] + 1.7 * size * step
        block.residual[:] = 0.0
        elements.add_residual(block, none, 0.9)
        return block.residual[:, :3].ravel().copy()

    expected = (residual(1e-6) - residual(-1e-6)) / 2e-6
    residual(0.0)
    strain, _ = elements.resultants(block.frames)
    assert (strain[:, 0] > 1e-3).any()
    assert (strain[:, 0] < -1e-3).any()
    size = abs(expected).max()
    # a term of the rate left out is a hundredth
    np.testing.assert_allclose(matrix @ step.ravel(), expected, atol=1e-7 * size)
    block.step[:, :3], block.residual[:] = step, 0.0
    elements.add_action(block, none, shifts, 0.9)
    np.testing.assert_allclose(block.residual[:, :3].ravel(), expected, atol=1e-7 * size)


@pytest.mark.serial
@pytest.mark.parametrize(("slack", "catch"), [(1.0, 0.0), (1.0, 1.0), (0.0, 0.0)])
def test_mean_forces_and_their_derivatives(slack, catch):
    """Over a step with cables that stay slack or taut, or change: work, loss and derivatives."""
    random = np.random.default_rng(5)
    count = 40
    nodes = np.arange(2 * count, dtype=np.int32).reshape(count, 2)
    numbers = np.column_stack(
        [np.ones(count), random.uniform(5.0, 9.0, count), np.full(count, 0.02),
         np.full(count, slack), np.full(count, 5e-3 * slack), np.full(count, catch)]
    )  # fmt: skip
    index = np.arange(4 * count, dtype=np.int32).reshape(count, 2, 2)
    ends = [np.zeros((2 * count, 3)) for _ in range(2)]
    for x in ends:
        along = random.normal((4.0, 0.0, 0.0), 1.0, (count, 3))
        along *= random.uniform(0.8, 1.2, (count, 1)) / np.linalg.norm(along, axis=1)[:, None]
        x[0::2] = 0.1 * random.normal(size=(count, 3))
        x[1::2] = x[0::2] + along
    x0, x1 = ends
    last = 0.01 * random.normal(size=count)

    def force(x, change, law):
        out = np.zeros_like(x)
        kernels.add_step_forces(nodes, numbers, x0, x, change, law, out)
        return out

    def energies(x):
        out = np.empty(count)
        kernels.energies(nodes, numbers, x, out)
        return out

    lost = np.empty(count)
    kernels.step_losses(nodes, numbers, x0, x1, 100.0, lost)
    law, plain = np.array([0.03, 100.0, 7.0]), np.array([0.0, 100.0, 7.0])
    work = (force(x1, 0.0 * last, plain) * (x1 - x0)).sum(axis=1).reshape(count, 2).sum(axis=1)
    np.testing.assert_allclose(work, energies(x1) - energies(x0) + lost, atol=1e-13)
    assert (lost >= 0.0).all()
    step, blocks = random.normal(size=x1.shape), np.zeros((4 * count, 3, 3))
    expected = (force(x1 + 1e-6 * step, last, law) - force(x1 - 1e-6 * step, last, law)) / 2e-6
    product = np.zeros_like(x1)
    kernels.add_step_products(nodes, numbers, x0, x1, last, law, step, product)
    np.testing.assert_allclose(product, expected, atol=1e-7)
    kernels.step_tangents(nodes, numbers, x0, x1, last, law, 1.0, index, blocks)
    pairs = step.reshape(count, 2, 3)
    found = np.einsum("mijab,mjb->mia", blocks.reshape(count, 2, 2, 3, 3), pairs)
    np.testing.assert_allclose(found.reshape(-1, 3), expected, atol=1e-7)
    # by the start: the derivative by the end of the step from its end to its start
    turned = law * (-1.0, -1.0, 1.0)

    def from_start(x):
        out = np.zeros_like(x)
        kernels.add_step_forces(nodes, numbers, x, x1, last, law, out)
        return out

    expected = (from_start(x0 + 1e-6 * step) - from_start(x0 - 1e-6 * step)) / 2e-6
    product = np.zeros_like(x1)
    kernels.add_step_products(nodes, numbers, x1, x0, -last, turned, step, product)
    np.testing.assert_allclose(product, expected, atol=1e-7)
    # by the end of the last step, which is the start of this one here
    taut = [np.empty(count) for _ in range(2)]
    moved = [x0 + size * step for size in (1e-6, -1e-6)]
    for out, x in zip(taut, moved, strict=True):
        kernels.taut_parts(nodes, numbers, x, out)
    change = (taut[0] - taut[1]) / 2e-6
    expected = (force(x1, last + 1e-6 * change, law) - force(x1, last - 1e-6 * change, law)) / 2e-6
    blocks[:] = 0.0
    kernels.add_last_blocks(nodes, numbers, x0, x1, last, law, x0, 1.0, index, blocks)
    found = np.einsum("mijab,mjb->mia", blocks.reshape(count, 2, 2, 3, 3), pairs)
    np.testing.assert_allclose(found.reshape(-1, 3), expected, atol=1e-7)


@pytest.mark.serial
def test_slack_damping_in_closed_form():
    """Two masses on a slack cable: their relative speed falls by an exponential, energy with it."""
    m, L, EA, tau, v = 0.3, 1.0, 600.0, 1e-3, 0.4
    mesh = ff.ElementMesh(
        [[0, 0, 0], [0.9, 0, 0]], [[0, 1]], "interval", nodes={"wall": [0], "ball": [1]}
    )
    rate = EA * tau / (L**2 * m)
    for integrator in ("energy_momentum", "generalized_alpha"):
        model = ff.Model("ball")
        model.add(
            ff.CableNet(
                "rope", mesh, EA, mass_per_length=0.0, rest_length=L, node_mass=[1.0, m],
                velocity=(-v, 0.0, 0.0), fixed={"wall": "xyz"}, slack_damping=tau,
            ),
            ff.Probe("ball", ff.Marker("rope", "ball"), ("v",), lambda t, at: (at.velocity[0],)),
            ff.EnergyProbe(),
        )  # fmt: skip
        options = STEPS | {"integrator": integrator}
        found = ff.simulate(model, ff.RunOptions(dt=5e-3, t_end=0.5, rho_inf=1.0, **options))
        speed = -v * np.exp(-rate * found.history["t"])
        # a rate that lacks one of the lengths, or the damper of taut cables alone, is off by 0.1
        np.testing.assert_allclose(found.history["v"], speed, atol=1e-5)
        lost = 0.5 * m * (v**2 - speed**2)
        np.testing.assert_allclose(found.history["energy_dissipation"], lost, atol=2e-5 * m * v**2)


@pytest.mark.serial
def test_a_damped_net_moves_as_by_another_integrator():
    """A net that becomes slack and taut, against Runge and Kutta's method with small errors."""
    EA, mu, tau = 40.0, 0.2, 4e-3
    mesh = grid(3)
    cells, start = mesh.cells, 1.06 * mesh.points + 0.04 * np.sin(9.0 * mesh.points[:, [2, 0, 1]])
    rest = np.linalg.norm(np.diff(mesh.points[cells], axis=1)[:, 0], axis=1)
    mass = np.zeros((9, 9))
    for (i, j), own in zip(cells, mu * rest, strict=True):
        mass[np.ix_([i, j], [i, j])] += own / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
    inverse = np.linalg.inv(mass)

    def slopes(t, y):
        x, v = y.reshape(2, 9, 3)
        d, u = np.diff(x[cells], axis=1)[:, 0], np.diff(v[cells], axis=1)[:, 0]
        length = np.linalg.norm(d, axis=1)
        strain, rates = length / rest - 1.0, (d * u).sum(axis=1) / (length * rest)
        pull = (EA * (np.maximum(strain, 0.0) + tau * rates) / length)[:, None] * d
        forces = np.zeros((9, 3))
        np.add.at(forces, cells[:, 0], pull)
        np.subtract.at(forces, cells[:, 1], pull)
        return np.concatenate([v, inverse @ forces]).ravel()

    first = np.concatenate([start, np.zeros((9, 3))]).ravel()
    exact = solve_ivp(slopes, (0.0, 0.4), first, "DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
    expected, errors = exact.reshape(2, 9, 3)[0, 4], []
    for h in (4e-3, 2e-3):
        model = ff.Model("net")
        moved = ff.ElementMesh(start, cells, "interval", nodes=mesh.nodes)
        model.add(
            ff.CableNet("net", moved, EA, mass_per_length=mu, rest_length=rest, slack_damping=tau),
            ff.PositionProbe("at", ff.Marker("net", "middle")),
            ff.EnergyProbe(),
        )
        found = ff.simulate(model, ff.RunOptions(dt=h, t_end=0.4, rho_inf=1.0, **STEPS)).history
        at = np.array([found[f"at_{axis}"][-1] for axis in "xyz"])
        errors.append(np.abs(at - expected).max())
        # dampers that are counted at the ends of steps leave 1e-3 of what they take
        assert np.ptp(found["energy_balance"]) < 1e-9 * found["energy_strain"][0]
        assert found["energy_dissipation"][-1] > 0.1 * found["energy_strain"][0]
    assert np.abs(expected - start[4]).max() > 0.01
    assert errors[1] < 1e-4  # without the dampers it is another motion
    assert errors[1] < 0.4 * errors[0]


@pytest.mark.serial
def test_a_catch_that_dissipates_in_closed_form():
    """One step from slack to taut: the force of its end acts over it, and takes energy."""
    m, L, EA, v, h, slack = 0.3, 1.0, 600.0, 2.0, 0.1, 0.1
    mesh = ff.ElementMesh(
        [[0, 0, 0], [L - slack, 0, 0]], [[0, 1]], "interval", nodes={"wall": [0], "ball": [1]}
    )
    model = ff.Model("ball")
    model.add(
        ff.CableNet(
            "rope", mesh, EA, mass_per_length=0.0, rest_length=L, node_mass=[1.0, m],
            velocity=(v, 0.0, 0.0), fixed={"wall": "xyz"}, dissipating_catch=True,
        ),
        ff.PositionProbe("ball", ff.Marker("rope", "ball")),
        ff.EnergyProbe(),
    )  # fmt: skip
    found = ff.simulate(model, ff.RunOptions(dt=h, t_end=h, rho_inf=1.0, **STEPS)).history
    # m (2 (x - x_0) / h - 2 v) / h = -EA (x - L) / L
    stretch = 2.0 * m * (v * h - slack) / (2.0 * m + EA * h * h / L)
    assert abs(found["ball_x"][-1] - L - stretch) < 1e-10  # the force of its energy gives 0.05
    lost = EA * stretch / L * (0.5 * stretch + slack)
    assert abs(found["energy_dissipation"][-1] - lost) < 1e-9 * lost
    assert abs(found["energy_balance"][-1]) < 1e-10 * lost


@pytest.mark.serial
def test_slack_damping_saves_iterations():
    """A tossed net in steps that do not resolve the vibrations of its cables."""
    counts = []
    for slack_damping in (0.0, 2e-2):
        options = ff.RunOptions(
            dt=0.05, t_end=2.0, rho_inf=1.0, integrator="energy_momentum", quiet=True,
            iteration_matrix="updated",
        )  # fmt: skip
        found = ff.simulate(tossed(2e-3, slack_damping=slack_damping), options)
        counts.append(found.summary["newton_iterations"])
    assert counts[1] < 0.7 * counts[0]


@pytest.mark.several_ranks
@pytest.mark.three_ranks
def test_ranks_agree():
    """Cables of one net on several ranks move as on one."""
    options = ff.RunOptions(dt=5e-3, t_end=0.1, rho_inf=0.9, split_above=1, **STEPS)
    net = {"slack_damping": 1e-4, "dissipating_catch": True}
    found = ff.simulate(tossed(2e-3, **net), options)
    alone = ff.simulate(tossed(2e-3, **net), options, comm=MPI.COMM_SELF)
    for name, column in alone.history.items():
        size = max(abs(column).max(), 1.0)
        mine = COMM.bcast(found.history[name] if COMM.rank == 0 else None)
        assert abs(mine - column).max() < 1e-9 * size, name


@pytest.mark.serial
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mesh": grid(), "axial_stiffness": -1.0}, "axial_stiffness must not be negative, got -1"),
        ({"axial_stiffness": 0.0}, "axial_stiffness must be positive, got 0"),
        ({"axial_stiffness": [1.0, 2.0]}, "axial_stiffness must hold 56 numbers"),
        ({"rest_length": 0.0}, "rest_length must be positive, got 0"),
        ({"rest_length": 1.0, "preload": 2.0}, "give preload or rest_length, not both"),
        ({"mass_per_length": 0.0}, "node 0 has no mass"),
        ({"mass_per_length": float("nan")}, "mass_per_length must be finite"),
        ({"node_mass": -1.0}, "node_mass must not be negative, got -1"),
        ({"damping": -1.0}, "damping must not be negative"),
        ({"slack_damping": -1.0}, "slack_damping must not be negative"),
        ({"slack_damping": 1.0, "tension_only": False}, "slack_damping is that of cables, got 1"),
        ({"dissipating_catch": True, "tension_only": False}, "is that of cables, got bars"),
        ({"fixed": {"nowhere": "x"}}, "nowhere"),
        ({"fixed": {"middle": "w"}}, 'must be some of "xyz"'),
    ],
)  # fmt: skip
def test_refusals(change, message):
    values = {"axial_stiffness": 1.0, "mass_per_length": 1.0, "mesh": grid(), **change}
    with pytest.raises(ValueError, match=message) as caught:
        ff.CableNet("net", **values)
    assert str(caught.value).startswith('CableNet "net": ')


def test_modes_of_slack_cables_are_told():
    """Nothing is stiff about a state in which all cables are slack; the advice says so."""
    mesh = ff.ElementMesh(
        np.outer(np.linspace(0.0, 1.0, 6), [1.0, 0.0, 0.0]), [[k, k + 1] for k in range(5)],
        "interval", nodes={"ends": [0, 5]},
    )  # fmt: skip
    given = {"mass_per_length": 0.1, "fixed": {"ends": "xyz"}}
    for length, status in ((0.21, "no mode that was found differs from zero; "), (0.199, "ok")):
        model = ff.Model("slack")
        model.add(ff.CableNet("net", mesh, 1e4, rest_length=length, **given))
        assert ff.find_modes(model, ff.ModeOptions(modes=3, quiet=True)).status.startswith(status)


@pytest.mark.serial
def test_nodes_in_one_place():
    """Slack cables may begin between them; without a length of their own, and as bars, none do."""
    mesh = ff.ElementMesh([[0.0, 0, 0], [1.0, 0, 0], [1.0, 0, 0]], [[0, 1], [1, 2]], "interval")
    same = 'CableNet "net": both nodes of cable 1 coincide'
    with pytest.raises(ValueError, match=f"{same}, which needs a rest_length"):
        ff.CableNet("net", mesh, 1.0, mass_per_length=1.0)
    with pytest.raises(ValueError, match=rf"{same}, a bar without a direction \(tension_only"):
        ff.CableNet("net", mesh, 1.0, mass_per_length=1.0, rest_length=0.5, tension_only=False)
    assert ff.CableNet("net", mesh, 1.0, mass_per_length=1.0, rest_length=0.5).elements == 2


@pytest.mark.serial
def test_other_cells_are_refused():
    mesh = ff.ElementMesh(np.eye(3), [[0, 1, 2]], "triangle")
    with pytest.raises(ValueError, match='CableNet "net": mesh must have intervals of degree 1'):
        ff.CableNet("net", mesh, 1.0, mass_per_length=1.0)
