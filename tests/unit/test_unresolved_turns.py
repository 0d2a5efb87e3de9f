# SPDX-License-Identifier: LGPL-3.0-or-later
"""Flexible bodies that rotate so far in a step that unresolved vibrations grow."""

import numpy as np
import pytest

import flexfem as ff
from flexfem.integrators.generalized_alpha import GeneralizedAlpha
from flexfem.simulation.motion.stepping import Simulation
from flexfem.simulation.watch.unresolved_turns import UnresolvedTurns


def ringing(rho: float, turn: float, soft: float) -> float:
    """Largest factor a step of what alternates: a particle on springs, stiff and soft, that turn.

    Integrated in inertial axes with steps of 1, as the nodes of flexible bodies.
    """
    scheme = GeneralizedAlpha(rho)
    am, af, gamma, beta = scheme.alpha_m, scheme.alpha_f, scheme.gamma, scheme.beta
    springs, weight = np.diag([1e8, soft]), (1.0 - af) / (1.0 - am)
    c, s = np.cos(turn), np.sin(turn)
    columns = []
    for start in np.eye(8):
        # position, velocity, acceleration-like variable and acceleration, in the rotated axes
        x0, v0, a0, w0 = start.reshape(4, 2) @ np.array([[c, -s], [s, c]])
        old = (af * w0 - am * a0) / (1.0 - am)
        reached = x0 + v0 + (0.5 - beta) * a0 + beta * old
        w = -np.linalg.solve(np.eye(2) + beta * weight * springs, springs @ reached)
        a = weight * w + old
        x, v = reached + beta * weight * w, v0 + (1.0 - gamma) * a0 + gamma * a
        columns.append(np.concatenate([x, v, a, w]))
    found = np.linalg.eigvals(np.array(columns).T)
    return float(np.abs(found[found.real < -0.3]).max(initial=0.0))


@pytest.mark.serial
@pytest.mark.parametrize("rho", [0.95, 0.9, 0.8, 0.7])
def test_the_limit_is_where_a_linear_analysis_has_it(rho: float) -> None:
    """Within a tenth: 0.12 rad and 0.9 make 1.062, which a spinning channel shows as well."""
    limit = GeneralizedAlpha(rho).turn_limit

    def worst(turn: float) -> float:
        return max(ringing(rho, turn, k) for k in np.geomspace(1.01 * turn**2, 1e3, 12))

    assert worst(0.9 * limit) < 1.0
    assert worst(1.1 * limit) > 1.005
    if rho == 0.9:
        assert worst(0.12) == pytest.approx(1.062, abs=1e-3)


def spun(rho: float, dt: float) -> tuple[float, list[str]]:
    """A free beam that spins with 6 rad/s: growth of what alternates, and what is warned of."""
    points = np.linspace([0.0, 0.0, 0.0], [4.0, 0.0, 0.0], 5)
    cells = np.stack([np.arange(4), np.arange(1, 5)], axis=1)
    model = ff.Model("spin", mesh=ff.LineMesh(points, cells, {"beam": np.arange(4)}))
    section = ff.Section.rectangle(0.02, 0.01, ff.Material(70e9, 0.3, 2700.0))
    model.add(ff.Beam("beam", section, orientation=(0, 1, 0), angular_velocity=(0, 0, 6.0)))
    options = ff.RunOptions(dt=dt, t_end=1.0, rho_inf=rho, tolerance=1e-9, quiet=True)
    simulation = Simulation(model, options)
    system = simulation.system
    watch = UnresolvedTurns(system, simulation.serial, options, simulation.turn_limit)
    seen = []
    for step in range(80):
        simulation.advance(dt, dt * (step + 1))
        watch.step(simulation.rejected)
        block = system.parts[0].block
        seen.append(block.acceleration[: block.owned].copy())
    assert not simulation.rejected
    assert watch.texts() == []
    rings = np.abs(np.diff(np.array(seen), n=2, axis=0)).max(axis=(1, 2), initial=0.0)
    watch.step(3)  # as if steps had failed
    return float(rings[-5:].max() / rings[25:30].max()) if rings.any() else 1.0, watch.texts()


@pytest.mark.serial
def test_turns_that_let_vibrations_grow_are_told() -> None:
    """Both remedies of the line hold; without the limit nothing tells 0.12 rad from 0.06."""
    growth, (line,) = spun(0.9, 0.02)
    assert growth > 5.0  # 1.06^50 is 18
    # 0.12, and what the vibrations have grown to
    assert line.startswith('Beam "beam": it rotates by 0.13')
    assert "beyond 0.075 rad, with rho_inf 0.9, vibrations grow" in line
    assert line.endswith("use steps of 0.009 s or less or a rho_inf of 0.8")
    for rho, dt in ((0.8, 0.02), (0.9, 0.01)):
        growth, lines = spun(rho, dt)
        assert growth < 1.0
        assert lines == []


@pytest.mark.serial
def test_integrators_have_limits_of_their_own() -> None:
    from flexfem.integrators.integrator import create_integrator

    for name, limit in (
        ("generalized_alpha", 0.15), ("stabilized_index2", 0.15),
        ("independent_coordinates", 0.15), ("energy_momentum", np.inf),
    ):  # fmt: skip
        assert create_integrator(name, 0.8).turn_limit == pytest.approx(limit)
