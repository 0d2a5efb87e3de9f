# SPDX-License-Identifier: LGPL-3.0-or-later
"""The turbine in wind: its aerodynamics against momentum theory, its energy, and its ranks."""

import sys
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from scipy.optimize import brentq

import flexfem as ff
from flexfem.cli import load_case
from tests.histories import columns

SMALL: dict[str, Any] = {"elements": 4, "tower_elements": 2}
WIND, RATE, RADIUS = 9.0, 0.62, 120.0
POLAR = (6.0, -0.07, 1.5, 0.009)


def test_elements_reach_momentum_theory() -> None:
    """Steady thrust and torque of a rigid rotor, by the inflow angle of each annulus alone.

    Root finding in one unknown (Ning, Wind Energy 17 (2014), without swirl). A rotor without the
    induction has 1.4 times its thrust.
    """
    turbine = sys.modules[load_case("turbine").build.__module__]
    r, twist = np.array([30.0, 60.0, 90.0, 110.0]), np.radians([9.0, 3.0, 0.0, -1.0])
    chord = np.array([5.7, 4.5, 3.2, 2.4])
    turns = np.array([turbine.about(2, -angle) for angle in twist])
    x = np.stack([0.0 * r, 0.0 * r, 150.0 + r], axis=1)
    v = np.stack([0.0 * r, -RATE * r, 0.0 * r], axis=1)
    ends = ff.Ends(x, turns, v, np.zeros((4, 3)), np.arange(4))
    common = (WIND, 0.0, RADIUS, 5.0, *POLAR, 1.225, 1.0, 0.0, 0.0, 0.0, 0.0, 150.0)
    a, given = np.full((4, 1), 0.3), np.array([(c, 1.0, *common) for c in chord])
    for _ in range(1200):
        forces, _, rates = turbine.aerodynamics(0.0, ends, a, given)
        a = a + 0.05 * rates
    for k in range(4):
        a_k, thrust, drive = _annulus(r[k], chord[k], twist[k])
        assert a[k, 0] == pytest.approx(a_k, abs=1e-6)
        assert forces[k, 0] == pytest.approx(thrust, rel=1e-5)
        assert -forces[k, 1] == pytest.approx(drive, rel=1e-5)


def _annulus(r: float, chord: float, twist: float) -> tuple[float, float, float]:
    """Induction, and force per length downwind and along the motion of one blade."""

    def state(a: float) -> tuple[float, float, float]:
        phi = np.arctan2(WIND * (1.0 - a), RATE * r)
        speed = np.hypot(WIND * (1.0 - a), RATE * r)
        lift = POLAR[2] * np.tanh(POLAR[0] * np.sin(phi - twist - POLAR[1]) / POLAR[2])
        q = 0.5 * 1.225 * chord * speed**2
        return (
            phi, q * (lift * np.cos(phi) + POLAR[3] * np.sin(phi)),
            q * (lift * np.sin(phi) - POLAR[3] * np.cos(phi)),
        )  # fmt: skip

    def gap(a: float) -> float:
        phi, thrust, _ = state(a)
        loss = 2.0 / np.pi * np.arccos(np.exp(-1.5 * (RADIUS - r) / (r * np.sin(phi))))
        load = 3.0 * thrust / (1.225 * np.pi * r * WIND**2)
        if a < 0.4:
            return float(load - 4.0 * loss * a * (1.0 - a))
        return float(load - (8 / 9 + (4 * loss - 40 / 9) * a + (50 / 9 - 4 * loss) * a * a))

    a = brentq(gap, 0.0, 0.8, xtol=1e-12)
    return a, *state(a)[1:]


@pytest.mark.serial
def test_the_energy_of_wind_and_generator_is_in_the_balance() -> None:
    """Of second order in the step; without the work of the wind it is off by ten times as much."""
    case = load_case("turbine")
    model = case.model(**case.prepare(SMALL)[0])
    model.add(ff.EnergyProbe())
    history = ff.simulate(model, ff.RunOptions(dt=0.02, t_end=1.0, quiet=True)).history
    taken = np.trapezoid(history["power"], history["t"])
    assert taken > 5e6
    assert np.abs(history["energy_balance"]).max() < 0.02 * taken
    assert history["out_1"].max() > 5.0
    assert (np.diff(history["azimuth"]) > 0.0).all()


@pytest.mark.slow
@pytest.mark.serial
def test_steady_states_are_those_of_the_motion() -> None:
    """Without gravity, tilt and shear, the rotor comes to the state that the linearisation finds.

    Both are at the speed where no other drive is needed; aerodynamics damp flapping, not the sway
    of the tower to the side.
    """
    case = load_case("turbine").under(ff.ROTOR)
    given = SMALL | {"wind": WIND, "wake": 0.5, "blade_damping": 20.0, "tower_damping": 0.2}
    values, options = case.prepare(
        given | {"spin": 0.62, "spin_end": 0.68, "speeds": 2, "modes": 6}
    )
    found = ff.sweep_rotor(case.model(**values), options).history
    share = found["torque"][0] / (found["torque"][0] - found["torque"][1])
    at = {name: v[0] + share * (v[1] - v[0]) for name, v in found.items()}
    values["rate"] = at["t"]
    motion = ff.simulate(
        case.model(**values), ff.RunOptions(dt=0.1, t_end=30.0, quiet=True, tolerance=1e-3)
    ).history
    # of second order in the change of the speed; without centrifugal forces tips bend by 4 % more
    for name, scale in (("rate", 0.65), ("out_1", 11.0), ("in_1", 1.0), ("top_x", 0.6)):
        expected = at["t"] if name == "rate" else at[name]
        assert motion[name][-1] == pytest.approx(expected, abs=3e-3 * scale), name
    damped = {name: v for name, v in found.items() if name.endswith("_damping")}
    assert min(damped["collective_flap_1_damping"]) > 0.2


def test_ranks() -> None:
    case = load_case("turbine")
    values, _ = case.prepare(SMALL)
    options = ff.RunOptions(dt=0.05, t_end=0.3, quiet=True)
    found = columns(ff.simulate(case.model(**values), options))
    alone = ff.simulate(case.model(**values), options, comm=MPI.COMM_SELF).history
    for name in ("rate", "power", "out_1", "in_2", "top_x"):
        scale = np.abs(alone[name]).max()
        np.testing.assert_allclose(found[name], alone[name], atol=1e-9 * scale, err_msg=name)
