# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps end at jumps and kinks of loads and drives: no pulse is lost, impulses are integrals."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.analyses.dynamics import INTEGRATORS
from flexfem.simulation.motion.breakpoints import Breakpoints
from flexfem.simulation.run.time_grid import TimeGrid

DT, T_END = 1e-2, 0.2
Function = Callable[[float], float]


def pulse(begin: float, end: float) -> ff.TimeFunction:
    """One, at the jumps too: the step that ends at the first has to take zero."""
    return ff.TimeFunction(lambda t: float(begin <= t <= end), (begin, end))


def free(amplitude: Function, *more: Any) -> ff.Model:
    """A body of 2 kg that 3 N push along x; loose in it a bob on a spring."""
    model = ff.Model("free")
    model.add(
        ff.RigidBody("body", 2.0, (0.1, 0.1, 0.1)),
        ff.RigidBody("bob", 0.5, (0.1, 0.1, 0.1), position=(1.0, 0.0, 0.0)),
        ff.SpringDamper("spring", ff.Marker("body"), ff.Marker("bob"), stiffness=300.0),
        ff.PointForce("push", ff.Marker("body"), (3.0, 0.0, 0.0), amplitude=amplitude),
        ff.MomentumProbe("all"),
        *more,
    )
    return model


def impulse(amplitude: Function, *more: Any, t_end: float = T_END, **options: Any) -> float:
    """Momentum at the end over the force: the integral of the amplitude as the steps have it."""
    given = ff.RunOptions(**{"dt": DT, "t_end": t_end, "quiet": True} | options)
    outcome = ff.simulate(free(amplitude, *more), given)
    assert outcome.status == "ok"
    found = outcome.history["all_px"][-1] / 3.0 if outcome.history else np.nan
    return float(MPI.COMM_WORLD.bcast(found))  # the first rank has the history


AMPLITUDES: dict[str, tuple[Function, float]] = {
    "pulse of 0.1 ms within a step": (pulse(0.0523, 0.0524), 1e-4),
    "switched on within a step": (pulse(0.0523, 1.0), T_END - 0.0523),
    "on and off at ends of steps": (pulse(0.05, 0.1), 0.05),
    "off within the first step": (pulse(0.0, 0.0042), 0.0042),
    "on at the start": (ff.TimeFunction(lambda t: float(t > 0.0), (0.0,)), T_END),
    "table": (ff.Table((0.0123, 0.0345, 0.0678), (0.0, 2.0, 0.0)), 0.0555),
    "pulse by a table": (
        ff.Table((0.0523, 0.0523 + 1e-12, 0.0524, 0.0524 + 1e-9), (0, 1, 1, 0)),
        1e-4,
    ),
    "jump by a table": (ff.Table((0.05, 0.05 + 1e-8, 0.0712, 0.0712 + 1e-8), (0, 1, 1, 0)), 0.0212),
    "jump by a smooth step": (ff.SmoothStep(0.0521, 0.0521 + 1e-12), T_END - 0.0521),
    "narrow smooth step": (ff.SmoothStep(0.0521, 0.0523), T_END - 0.0522),
}


@pytest.mark.parametrize("name", AMPLITUDES)
def test_impulses_are_integrals(name: str) -> None:
    """To rounding; a step that takes the load at one of its ends is off by up to 1e-2 of DT."""
    amplitude, integral = AMPLITUDES[name]
    assert impulse(amplitude) == pytest.approx(integral, abs=1e-12)


@pytest.mark.serial
@pytest.mark.parametrize("integrator", sorted(set(INTEGRATORS) - {"generalized_alpha"}))
def test_impulses_with_all_integrators(integrator: str) -> None:
    """Tables off the grid, for which each of them must start itself at a kink."""
    amplitude, integral = AMPLITUDES["table"]
    assert impulse(amplitude, integrator=integrator) == pytest.approx(integral, abs=1e-12)
    amplitude, integral = AMPLITUDES["pulse of 0.1 ms within a step"]
    assert impulse(amplitude, integrator=integrator) == pytest.approx(integral, abs=1e-12)


def test_pulses_are_met_by_adaptive_steps_and_beside_events() -> None:
    """An event in the very step of the pulse, at its beginning and within it."""
    amplitude, integral = AMPLITUDES["pulse of 0.1 ms within a step"]
    assert impulse(amplitude, adaptive=True) == pytest.approx(integral, abs=1e-12)
    for at in (0.0523, 0.05234, 0.05):
        event = ff.Event("clock", ff.Marker("bob"), lambda t, _, at=at: t - at, lambda _: None)
        assert impulse(amplitude, event) == pytest.approx(integral, abs=1e-12)


@pytest.mark.serial
def test_breakpoints_on_the_grid_cost_nothing() -> None:
    """A table with its kinks there has the steps and the factors of a function without any."""
    table = ff.Table((0.01, 0.03, 0.06), (0.0, 2.0, 0.0))
    options = ff.RunOptions(dt=DT, t_end=T_END, quiet=True)
    counts = [
        {key: ff.simulate(free(f), options).summary[key] for key in ("steps", "factorizations")}
        for f in (table, table.__call__)
    ]
    assert counts[0] == counts[1]


@pytest.mark.serial
def test_momentum_behind_kinks_on_the_grid_comes_back() -> None:
    """The errors of the scheme at one kink are compensated at the others; one alone is 1.4e-5."""
    table = ff.Table((0.01, 0.03, 0.06), (0.0, 2.0, 0.0))
    assert impulse(table, t_end=1.0) == pytest.approx(0.05, abs=1e-12)


@pytest.mark.serial
def test_dense_tables_are_sampled_and_told() -> None:
    """Ten thousand kinks in twenty steps."""
    times = np.linspace(0.0, T_END, 10_001)
    model = free(ff.Table(times, np.sin(50.0 * times)))
    found = Breakpoints(model, TimeGrid.of(DT, T_END), T_END)
    assert len(found.times) == 0
    (text,) = found.texts
    assert 'PointForce "push": 9980 breakpoints within steps, 499 in each of 0.01 s' in text
    fine = Breakpoints(model, TimeGrid.of(1e-5, T_END), T_END)
    assert fine.times == []
    assert fine.texts == []


@pytest.mark.serial
def test_smooth_functions_are_left_to_the_steps() -> None:
    """Ends of long smooth steps and of splines that begin at rest bring no steps of their own."""
    grid = TimeGrid.of(DT, T_END)
    smooth = ff.SmoothStep(0.0123, 0.1678)
    assert Breakpoints(free(smooth), grid, T_END).times == []
    assert Breakpoints(free(pulse(0.0123, 0.1678)), grid, T_END).times == [0.0123, 0.1678]
    drive = ff.PrescribedTranslation(
        "drive", ff.Ground(), ff.Marker("body"), ff.Table((0.0, 0.0123, 1.0), (0.0, 0.1, 0.1)),
        axis=(0.0, 1.0, 0.0),
    )  # fmt: skip
    assert Breakpoints(free(smooth, drive), grid, T_END).times == [0.0123]


@pytest.mark.serial
@pytest.mark.parametrize("times", [("a",), (np.nan,), 3.0 + 1.0j])
def test_wrong_breakpoints_are_named(times: Any) -> None:
    def shaken(t: float) -> float:
        return 1.0

    shaken.breakpoints = times  # type: ignore[attr-defined]
    with pytest.raises(ValueError, match='PointForce "push": breakpoints must be times in seconds'):
        ff.simulate(free(shaken), ff.RunOptions(dt=DT, t_end=T_END, quiet=True))
    with pytest.raises(ValueError, match="breakpoints must increase"):
        ff.TimeFunction(lambda t: 0.0, (1.0, 0.5))


@pytest.mark.serial
def test_work_of_a_pulse_within_a_step_is_known() -> None:
    """Energies balance: without the states within the step 6e-6 J would come from nowhere."""
    amplitude, _ = AMPLITUDES["pulse of 0.1 ms within a step"]
    for load in (amplitude, pulse(0.05, 0.1)):
        options = ff.RunOptions(dt=DT, t_end=T_END, rho_inf=1.0, quiet=True)
        outcome = ff.simulate(free(load, ff.EnergyProbe()), options)
        assert outcome.summary["warnings"] == []
        if outcome.history:
            work = np.abs(outcome.history["energy_work"]).max()
            assert np.abs(outcome.history["energy_balance"]).max() < 0.01 * work


def test_restarts_at_and_before_jumps(shared_tmp_path: Path) -> None:
    """The step behind a jump, and that with a pulse, are the same after a restart."""
    for load in (pulse(0.05, 0.1), pulse(0.0523, 0.0524)):
        shared = {"dt": DT, "quiet": True}
        whole = ff.simulate(free(load), ff.RunOptions(t_end=T_END, **shared))
        folder = shared_tmp_path / "half"
        first = ff.RunOptions(t_end=0.05, output=folder, checkpoint_every=5, **shared)
        ff.simulate(free(load), first)
        again = ff.RunOptions(t_end=T_END, restart=folder / "checkpoint_000005.h5", **shared)
        outcome = ff.simulate(free(load), again)
        if outcome.history:
            last = [h["all_px"][-1] for h in (whole.history, outcome.history)]
            assert last[0] == last[1]


@pytest.mark.serial
@pytest.mark.parametrize("degree", [3, 5])
def test_derivatives_of_splines_are_those_of_their_values(degree):
    """Inside the given times and outside, where the value stays as it is."""
    spline = ff.Spline([1.0, 1.4, 2.0, 2.1, 2.7, 3.0], [0.5, 1.5, -0.3, 2.0, 1.0, 4.0], degree)
    h = 1e-4
    for t in (0.2, 1.1, 1.9, 2.05, 2.9, 3.5):
        low, here, high = spline(t - h), spline(t), spline(t + h)
        # differences are good to 1e-5; a sign, an order or a slope beyond the ends is of order one
        assert spline.derivative(t) == pytest.approx((high - low) / (2 * h), abs=1e-3)
        second = (low - 2.0 * here + high) / h**2
        assert spline.derivative(t, 2) == pytest.approx(second, rel=1e-3, abs=1e-3)
