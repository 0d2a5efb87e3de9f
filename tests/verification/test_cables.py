# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cables over eyelets and sheaves against closed forms and equations of other origin."""

from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import flexfem as ff
from tests.histories import columns

G = 9.81
UP, ACROSS = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)
SMALL = (0.01, 0.01, 0.01)


def run(model: ff.Model, dt: float, t_end: float, **given: Any) -> dict[str, np.ndarray]:
    """History on all ranks, after it was compared with that of one process."""
    options = ff.RunOptions(dt=dt, t_end=t_end, quiet=True, **given)
    alone = ff.simulate(model, options, comm=MPI.COMM_SELF).history
    shared = columns(ff.simulate(model, options)) if MPI.COMM_WORLD.size > 1 else {}
    for name, values in shared.items():
        # round-off; a term that no rank or two ranks evaluate is of the order of the values
        np.testing.assert_allclose(
            values, alone[name], atol=1e-9 * np.abs(values).max() + 1e-12, err_msg=name
        )
    return {name: np.asarray(values) for name, values in alone.items()}


def sheave(marker: ff.Marker | ff.Ground, radius: float, sense: float, **given: Any) -> ff.Sheave:
    """A sheave in the plane y = 0."""
    return ff.Sheave(marker, radius, (0.0, sense, 0.0), **given)


M1, M2, INERTIA, RADIUS = 3.0, 2.0, 0.05, 0.2


def atwood(**cable: Any) -> ff.Model:
    """Two masses on a cable over a wheel with inertia, which it turns."""
    model = ff.Model("atwood")
    wheel = sheave(ff.Marker("wheel"), RADIUS, 1.0, grip=True)
    model.add(
        ff.Gravity((0.0, 0.0, -G)),
        ff.RigidBody("heavy", M1, SMALL, position=(-RADIUS, 0.0, -1.0)),
        ff.RigidBody("light", M2, SMALL, position=(RADIUS, 0.0, -1.0)),
        ff.RigidBody("wheel", 1.0, (INERTIA,) * 3),
        ff.Revolute("bearing", ff.Ground(), ff.Marker("wheel"), axis=ACROSS),
        ff.Cable("cable", [ff.Marker("heavy"), wheel, ff.Marker("light")], **cable),
        ff.PositionProbe("heavy_at", ff.Marker("heavy")),
        ff.CableProbe("left", "cable"),
        ff.CableProbe("right", "cable", part=1),
        ff.EnergyProbe(),
    )
    return model


@pytest.mark.slow_on_ranks
def test_atwoods_machine_with_a_wheel_that_has_inertia() -> None:
    """``a = (m1 - m2) g / (m1 + m2 + I/r^2)``, and two tensions that turn the wheel."""
    found = run(atwood(tension_only=False), 1e-3, 0.4)
    a = (M1 - M2) * G / (M1 + M2 + INERTIA / RADIUS**2)
    t = found["t"]
    # round-off; without the wheel's inertia a is a quarter larger
    np.testing.assert_allclose(found["heavy_at_z"], -1.0 - 0.5 * a * t**2, atol=1e-11)
    np.testing.assert_allclose(found["left_tension"][1:], M1 * (G - a), rtol=1e-9)
    np.testing.assert_allclose(found["right_tension"][1:], M2 * (G + a), rtol=1e-9)


@pytest.mark.slow_on_ranks
@pytest.mark.serial
def test_atwoods_machine_with_an_elastic_cable() -> None:
    """The same on average with a stiff cable; its energy stays."""
    found = run(atwood(axial_stiffness=1e6), 1e-3, 0.4)
    a = (M1 - M2) * G / (M1 + M2 + INERTIA / RADIUS**2)
    # stretch of 23 N over 1.3 m / 1e6 N, twice where the load is sudden: 6e-5 m
    assert found["heavy_at_z"][-1] == pytest.approx(-1.0 - 0.08 * a, abs=1e-4)
    assert np.abs(found["energy_balance"]).max() < 1e-4 * np.abs(found["energy_gravity"]).max()


def tackle(hand: float, load: float, **cable: Any) -> ff.Model:
    """Four falls: two sheaves overhead, two on the load, and a hand that weighs on the rope.

    All sheaves are in one plane and a diameter apart, so that all falls are vertical.
    """
    r = 0.05
    model = ff.Model("tackle")
    overhead = [ff.Ground((x * r, 0.0, 0.0)) for x in (0.0, 4.0)]
    below = [ff.Marker("load", offset=((x - 4.0) * r, 0.0, 0.0)) for x in (2.0, 6.0)]
    guides = [
        sheave(overhead[0], r, 1.0), sheave(below[0], r, -1.0),
        sheave(overhead[1], r, 1.0), sheave(below[1], r, -1.0),
    ]  # fmt: skip
    becket = ff.Ground((7.0 * r, 0.0, 0.0))
    model.add(
        ff.Gravity((0.0, 0.0, -G)),
        ff.RigidBody("hand", hand, SMALL, position=(-r, 0.0, -0.5)),
        ff.RigidBody("load", load, SMALL, position=(4.0 * r, 0.0, -1.0)),
        ff.Prismatic("pull", ff.Ground((-r, 0.0, 0.0)), ff.Marker("hand"), axis=UP),
        ff.Prismatic("guide", ff.Ground((4.0 * r, 0.0, 0.0)), ff.Marker("load"), axis=UP),
        ff.Cable("rope", [ff.Marker("hand"), *guides, becket], **cable),
        ff.PositionProbe("hand_at", ff.Marker("hand")),
        ff.PositionProbe("load_at", ff.Marker("load")),
        ff.CableProbe("rope_pull", "rope"),
        ff.EnergyProbe(),
    )
    return model


@pytest.mark.slow_on_ranks
@pytest.mark.serial
def test_block_and_tackle_multiplies_the_force_by_its_falls() -> None:
    """The load rises by a quarter of what the hand sinks: ``a = (4 m - M) g / (16 m + M)``."""
    m, load = 2.0, 5.0
    found = run(tackle(m, load, tension_only=False), 1e-3, 0.2)
    a = (4.0 * m - load) * G / (16.0 * m + load)
    rise = 0.5 * a * found["t"] ** 2
    # round-off; falls that do not touch the sheaves vertically are longer by 1e-3 m and more
    np.testing.assert_allclose(found["load_at_z"], -1.0 + rise, atol=1e-11)
    np.testing.assert_allclose(found["hand_at_z"], -0.5 - 4.0 * rise, atol=1e-11)
    np.testing.assert_allclose(found["rope_pull_tension"][1:], load * (G + a) / 4.0, rtol=1e-8)


def test_block_and_tackle_at_rest_stretches() -> None:
    """A hand of a quarter of the load keeps balance; the rope is longer by its stretch.

    The hand hangs on a spring, without which it could be anywhere.
    """
    load, stiffness, k, preload = 8.0, 5e4, 400.0, 15.0
    model = tackle(2.0, load, axial_stiffness=stiffness, preload=preload)
    top = ff.Ground((-0.05, 0.0, 0.0))
    model.add(ff.SpringDamper("spring", top, ff.Marker("hand"), k))
    options = ff.StaticOptions(load_steps=1, gravity_load="constant", quiet=True)
    found = {name: np.asarray(v) for name, v in columns(ff.solve_static(model, options)).items()}
    assert found["rope_pull_tension"][-1] == pytest.approx(load * G / 4.0, rel=1e-9)
    rest = (0.5 + 4.0 * 1.0 + 4.0 * np.pi * 0.05) / (1.0 + preload / stiffness)
    stretch = load * G / 4.0 / stiffness * rest
    assert found["rope_pull_stretch"][-1] == pytest.approx(stretch, rel=1e-9)
    # four falls share the stretch where the hand stays
    more = stretch - preload / stiffness * rest
    assert found["load_at_z"][-1] == pytest.approx(-1.0 - more / 4.0, abs=1e-9)


def hoist(**cable: Any) -> ff.Model:
    """A load that swings on a cable from a fixed point while it is hauled up."""
    model = ff.Model("hoist")
    start = 2.0 * np.array([np.sin(0.3), 0.0, -np.cos(0.3)])
    model.add(
        ff.Gravity((0.0, 0.0, -G)),
        ff.RigidBody("load", 5.0, SMALL, position=start),
        ff.Cable("cable", [ff.Ground(), ff.Marker("load")], **cable),
        ff.PositionProbe("at", ff.Marker("load")),
        ff.CableProbe("pull", "cable"),
        ff.EnergyProbe(),
    )
    return model


def hauled(t: float) -> float:
    """Rest length, m."""
    return 2.0 - 0.3 * t - 0.05 * np.sin(3.0 * t)


@pytest.mark.slow_on_ranks
@pytest.mark.serial
@pytest.mark.parametrize("damping", [pytest.param(0.0, marks=pytest.mark.slow), 40.0])
def test_a_load_swings_on_a_cable_that_is_hauled_in(damping: float) -> None:
    """Against the equations of a mass on an elastic pendulum of changing rest length.

    The stiffness grows as the cable becomes shorter; the winch pays for that, too.
    """
    stiffness = 4e3
    model = hoist(axial_stiffness=stiffness, rest_length=hauled, damping=damping)
    found = run(model, 1e-3, 2.0)

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        x, v = y[:2], y[2:]
        length, rest = np.hypot(*x), hauled(t)
        rate = -0.3 - 0.15 * np.cos(3.0 * t)
        depth = stiffness * (length - rest) / rest
        if depth <= 0.0:
            return np.array([*v, 0.0, -G])
        c = damping * 2.0 / rest
        force = depth * (1.0 + np.tanh(c * (x @ v / length - rate) / depth))
        return np.array([*v, *(-force / 5.0 * x / length + np.array([0.0, -G]))])

    start = [2.0 * np.sin(0.3), -2.0 * np.cos(0.3), 0.0, 0.0]
    exact = solve_ivp(rates, (0.0, 2.0), start, t_eval=found["t"], rtol=1e-10, atol=1e-12).y
    # of second order in the step: 1e-4 m; a stiffness that stays as it is at the start is off by
    # 4e-3 m, a damper that brakes the winch by 3e-3 m
    np.testing.assert_allclose(found["at_x"], exact[0], atol=4e-4)
    np.testing.assert_allclose(found["at_z"], exact[1], atol=4e-4)
    # without the part of the stiffness it is off by 0.2 J
    assert np.abs(found["energy_balance"]).max() < 2e-3 * np.abs(found["energy_work"]).max()


def rubbing(
    masses: tuple[float, float], friction: float, speed: float = 0.0, **cable: Any
) -> ff.Model:
    """Two masses on a cable over a sheave that does not turn."""
    model = ff.Model("rubbing")
    guide = sheave(ff.Ground(), RADIUS, 1.0, friction=friction)
    model.add(ff.Gravity((0.0, 0.0, -G)))
    for name, mass, x in zip(("one", "two"), masses, (-RADIUS, RADIUS), strict=True):
        model.add(
            ff.RigidBody(name, mass, SMALL, position=(x, 0.0, -1.0),
                         velocity=(0.0, 0.0, np.sign(x) * speed)),
            ff.PositionProbe(f"{name}_at", ff.Marker(name)),
        )  # fmt: skip
    model.add(
        ff.Cable("cable", [ff.Marker("one"), guide, ff.Marker("two")], **cable),
        ff.CableProbe("pull", "cable"),
        ff.EnergyProbe(),
    )
    return model


@pytest.mark.slow_on_ranks
@pytest.mark.serial
@pytest.mark.parametrize("masses", [(3.0, 1.5), (1.5, 3.0)], ids=["down", "up"])
def test_a_cable_slides_over_a_sheave_with_friction(masses: tuple[float, float]) -> None:
    """Euler and Eytelwein: the falling side pulls ``exp(mu pi)`` times as much as the other."""
    friction, speed = 0.1, 0.4 * np.sign(masses[0] - masses[1])
    found = run(rubbing(masses, friction, speed, tension_only=False), 1e-3, 0.3)
    ratio = np.exp(friction * np.pi * np.sign(speed))
    a = G * (masses[0] - masses[1] * ratio) / (masses[0] + masses[1] * ratio)
    t = found["t"]
    # round-off; without friction a is twice that
    np.testing.assert_allclose(found["one_at_z"], -1.0 - speed * t - 0.5 * a * t**2, atol=1e-12)
    tensions = found["pull_tension"][1:] / found["pull_end_tension"][1:]
    np.testing.assert_allclose(tensions, ratio, rtol=1e-8)
    lost = found["energy_dissipation"][-1]
    slid = abs(found["one_at_z"][-1] + 1.0)
    first, last = masses[0] * (G - a), masses[1] * (G + a)
    assert lost == pytest.approx(abs(first - last) * slid, rel=1e-6)
    assert np.abs(found["energy_balance"]).max() < 1e-6 * lost


@pytest.mark.slow_on_ranks
def test_a_cable_sticks_on_a_sheave() -> None:
    """It creeps at the speed at which the regularised law carries the difference of the weights."""
    masses, friction = (2.0, 1.8), 0.1
    found = run(rubbing(masses, friction, axial_stiffness=1e6), 2e-3, 0.6)
    speed = 1e-3 * np.arctanh(np.log(masses[0] / masses[1]) / (friction * np.pi))
    t, z = found["t"], found["one_at_z"]
    late = t > 0.3
    # without friction it falls by 0.09 m
    assert np.polyfit(t[late], z[late], 1)[0] == pytest.approx(-speed, rel=2e-2)


SLIDER, WEIGHT, RUBS, BESIDE, ABOVE, FIRST = 2.0, 3.0, 0.3, 0.4, 0.5, 0.8


def rail() -> ff.Model:
    """A slider on a rail that is pulled by a weight through a hole beside and below the rail."""
    place, sinks = (-1.0, BESIDE, ABOVE), FIRST / np.sqrt(1.0 + BESIDE**2 + ABOVE**2)
    model = ff.Model("rail")
    path = [ff.Marker("slider"), ff.Eyelet(ff.Ground(), RUBS), ff.Marker("weight")]
    model.add(
        ff.Gravity((0.0, 0.0, -G)),
        ff.RigidBody("slider", SLIDER, SMALL, position=place, velocity=(FIRST, 0.0, 0.0)),
        ff.Prismatic("rail", ff.Ground(place), ff.Marker("slider"), axis=(1, 0, 0)),
        ff.RigidBody("weight", WEIGHT, SMALL, position=(0.0, 0.0, -1.0),
                     velocity=(0.0, 0.0, -sinks)),
        ff.Cable("cable", path, tension_only=False),
        ff.PositionProbe("at", ff.Marker("slider")),
    )  # fmt: skip
    return model


def test_a_cable_through_an_eyelet_rubs_by_the_angle_it_has_there() -> None:
    """Against SciPy; the angle at the hole changes as the slider comes nearer."""
    found = run(rail(), 1e-3, 0.4)

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        x, v = y
        length = np.sqrt(x * x + BESIDE**2 + ABOVE**2)
        ratio = np.exp(-RUBS * np.arccos(ABOVE / length))
        # length' = x v / l = -w', w of the weight; T1 = ratio T2
        bent = (BESIDE**2 + ABOVE**2) * v * v / length**3
        # slider a = -T1 x / l, weight w a = T2 - weight g, length'' = x a / l + bent = -w''
        tension = WEIGHT * (G + bent) / (1.0 + WEIGHT / SLIDER * ratio * x * x / length**2)
        return np.array([v, -ratio * tension / SLIDER * x / length])

    exact = solve_ivp(rates, (0.0, 0.4), [-1.0, FIRST], t_eval=found["t"], rtol=1e-10).y
    # angles are those before each step, which is of first order: 7e-5 m; with the angle at the
    # start the slider is off by 8e-3 m
    np.testing.assert_allclose(found["at_x"], exact[0], atol=2e-4)


@pytest.mark.slow_on_ranks
def test_a_restart_knows_the_angles_at_eyelets(shared_tmp_path: Path) -> None:
    """The angle of the first step after it is that of the state, not that of the start."""
    given = {"dt": 1e-3, "quiet": True}
    whole = columns(ff.simulate(rail(), ff.RunOptions(t_end=0.21, **given)))
    more = {"output": shared_tmp_path, "checkpoint_every": 200}
    ff.simulate(rail(), ff.RunOptions(t_end=0.2, **given, **more))
    file = shared_tmp_path / "checkpoint_000200.h5"
    again = columns(ff.simulate(rail(), ff.RunOptions(t_end=0.21, restart=file, **given)))
    # the start's angle in that step would change it by 1e-6 m
    assert again["at_x"][-1] == pytest.approx(whole["at_x"][-1], abs=1e-12)


@pytest.mark.slow_on_ranks
@pytest.mark.parametrize(
    "speed", [pytest.param(-0.4, marks=pytest.mark.serial), 0.4], ids=["up", "down"]
)
def test_a_winch_pulls_against_the_friction_of_a_sheave(speed: float) -> None:
    """A load that is hauled up at a constant speed, or let down, over a quarter of a turn."""
    mass, friction = 3.0, 0.2
    model = ff.Model("winch")
    guide = sheave(ff.Ground((1.0, 0.0, -RADIUS)), RADIUS, 1.0, friction=friction)
    model.add(
        ff.Gravity((0.0, 0.0, -G)),
        ff.RigidBody("load", mass, SMALL, position=(1.0 + RADIUS, 0.0, -1.5),
                     velocity=(0.0, 0.0, -speed)),
        ff.Cable(
            "cable", [ff.Ground(), guide, ff.Marker("load")], axial_stiffness=1e9,
            preload=mass * G, damping=50.0, paid_out=lambda t: speed * t,
        ),
        ff.CableProbe("pull", "cable"),
        ff.PositionProbe("at", ff.Marker("load")),
        ff.EnergyProbe(),
    )  # fmt: skip
    found = run(model, 2e-3, 0.5)
    ratio = np.exp(-np.sign(speed) * friction * 0.5 * np.pi)
    np.testing.assert_allclose(found["at_z"], -1.5 - speed * found["t"], atol=2e-8)
    # the load pulls with its weight, and vibrates a little on the stiff cable; friction that does
    # not see the winch would make both tensions equal
    np.testing.assert_allclose(found["pull_end_tension"][1:], mass * G, rtol=1e-4)
    np.testing.assert_allclose(found["pull_tension"][1:], ratio * mass * G, rtol=1e-4)
    way = -speed * 0.5
    assert found["energy_work"][-1] == pytest.approx(ratio * mass * G * way, rel=1e-6)
    assert found["energy_dissipation"][-1] == pytest.approx(
        (ratio - 1.0) * mass * G * way, rel=1e-5
    )
    assert np.abs(found["energy_balance"]).max() < 1e-6


@pytest.mark.slow_on_ranks
@pytest.mark.serial
@pytest.mark.parametrize("integrator", ["stabilized_index2", "independent_coordinates"])
def test_other_integrators_know_sheaves(integrator: str) -> None:
    """The tackle moves as it does with the generalised-alpha scheme."""
    m, load = 2.0, 5.0
    options = ff.RunOptions(dt=1e-3, t_end=0.2, quiet=True, integrator=integrator)
    found = columns(ff.simulate(tackle(m, load, tension_only=False), options))
    rise = 0.5 * (4.0 * m - load) * G / (16.0 * m + load) * found["t"] ** 2
    # round-off, and constraints held to the tolerance; the load rises by 0.016 m
    np.testing.assert_allclose(found["load_at_z"], -1.0 + rise, atol=1e-8)


@pytest.mark.slow
@pytest.mark.serial
def test_the_energy_momentum_scheme_takes_cables_without_sheaves() -> None:
    """A winch whose stiffness changes is of second order; sheaves are refused."""
    ends = []
    for dt in (2e-3, 1e-3, 5e-4):
        model = hoist(axial_stiffness=4e3, rest_length=hauled, damping=40.0, tension_only=False)
        options = ff.RunOptions(dt=dt, t_end=0.4, quiet=True, integrator="energy_momentum")
        ends.append(ff.simulate(model, options).history["at_z"][-1])
    # four for second order, two where the stiffness is that of one end of the step
    assert (ends[0] - ends[1]) / (ends[1] - ends[2]) == pytest.approx(4.0, rel=0.1)
    options = ff.RunOptions(dt=1e-3, t_end=0.01, quiet=True, integrator="energy_momentum")
    with pytest.raises(ValueError, match=r'^Cable "rope": .* does not support sheaves'):
        ff.simulate(tackle(2.0, 5.0, tension_only=False), options)


@pytest.mark.serial
def test_a_winch_hauls_a_cable_that_does_not_stretch() -> None:
    """A load in two falls rises by half of what is hauled in; the tension from its acceleration."""
    model, r, mass = ff.Model("lift"), 0.1, 4.0
    path = [ff.Ground((r, 0.0, 0.0)), sheave(ff.Marker("load"), r, 1.0), ff.Ground((-r, 0.0, 0.0))]
    model.add(
        ff.Gravity((0.0, 0.0, -G)),
        ff.RigidBody("load", mass, SMALL, position=(0.0, 0.0, -2.0)),
        ff.Cable("cable", path, tension_only=False, paid_out=lambda t: -0.6 * t * t),
        ff.PositionProbe("at", ff.Marker("load")),
        ff.CableProbe("pull", "cable"),
        ff.EnergyProbe(),
    )
    found = ff.simulate(model, ff.RunOptions(dt=1e-3, t_end=0.5, quiet=True)).history
    np.testing.assert_allclose(found["at_z"], -2.0 + 0.3 * found["t"] ** 2, atol=1e-10)
    np.testing.assert_allclose(found["pull_tension"][1:], 0.5 * mass * (G + 0.6), rtol=1e-6)
    work = mass * G * 0.3 * 0.25 + 0.5 * mass * (0.6 * 0.5) ** 2
    # the mean of forces and rates of each step; a drive whose work is not counted is off by all
    assert found["energy_work"][-1] == pytest.approx(work, rel=1e-4)


@pytest.mark.serial
def test_modes_of_a_tackle() -> None:
    """Hand and load vibrate against one another on the rope, ``w^2 = k (1/m + 16/M)``."""
    m, load, stiffness, preload = 2.0, 8.0, 5e4, 2.0 * G
    model = tackle(m, load, axial_stiffness=stiffness, preload=preload)
    found = ff.find_modes(model, ff.ModeOptions(modes=2, quiet=True)).history["frequency"]
    rest = (0.5 + 4.0 * 1.0 + 4.0 * np.pi * 0.05) / (1.0 + preload / stiffness)
    exact = np.sqrt(stiffness / rest * (1.0 / m + 16.0 / load)) / (2.0 * np.pi)
    # vertical falls have no stiffness of their own along the guides; hand and load are in balance
    np.testing.assert_allclose(found, [0.0, exact], atol=1e-6)
