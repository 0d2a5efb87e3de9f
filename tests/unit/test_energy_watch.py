# SPDX-License-Identifier: LGPL-3.0-or-later
"""Every motion is watched: spurious energy, dissipation, rotations in a step, jumps, NaN."""

from collections.abc import Callable
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.simulation.motion.stepping import Simulation
from flexfem.simulation.watch.energy_watch import EnergyWatch

Motion = Callable[[float], float]


def warned(model: ff.Model, dt: float, t_end: float, **options: Any) -> list[str]:
    """Warnings of a run that ends well, but for those on the number of its ranks."""
    outcome = ff.simulate(model, ff.RunOptions(dt=dt, t_end=t_end, quiet=True, **options))
    assert outcome.status == "ok"
    return [line for line in outcome.summary["warnings"] if " ranks " not in line]


@pytest.mark.serial
def test_a_body_that_spins_too_fast_for_its_steps() -> None:
    """Five radians in a step: its energy grows two hundredfold, found without an energy probe."""
    model = ff.Model("spin")
    model.add(ff.RigidBody("top", 1.0, (1.0, 2.0, 2.5), angular_velocity=(10, 5000, 20)))
    start, end = warned(model, 1e-3, 1.0)
    assert 'RigidBody "top": it starts with 5000 rad/s, which is 5 rad in a step' in start
    assert "spurious energy: the balance has grown by" in end


@pytest.mark.serial
def test_an_integrator_that_damps_nothing_is_named() -> None:
    model = ff.Model("spin")
    model.add(ff.RigidBody("top", 1.0, (1.0, 2.0, 2.5), angular_velocity=(10, 5000, 20)))
    assert "set rho_inf below 1" in warned(model, 1e-3, 1.0, rho_inf=1.0)[-1]


@pytest.mark.serial
def test_energies_are_looked_at_when_a_run_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    times: list[float] = []
    sample = EnergyWatch._sample

    def seen(watch: EnergyWatch, **how: bool) -> None:
        times.append(watch._system.time)
        sample(watch, **how)

    monkeypatch.setattr(EnergyWatch, "_sample", seen)
    model = ff.Model("leaving")
    model.add(
        ff.RigidBody("rail", 1.0, (1.0, 1.0, 1.0)),
        ff.Rigid("hold", ff.Ground(), ff.Marker("rail")),
        ff.RigidBody("bead", 1.0, (1.0, 1.0, 1.0), velocity=(1.0, 0.0, 0.0)),
        ff.Sliding("slide", ff.Carrier("rail", [(-1, 0, 0), (0.105, 0, 0)]), ff.Marker("bead")),
    )
    outcome = ff.simulate(model, ff.RunOptions(dt=1e-2, t_end=1.0, quiet=True))
    assert 'the slider leaves RigidBody "rail" of 1.105 m' in outcome.status
    # it fails after ten steps, or after parts of the eleventh: between the eighth and the sixteenth
    assert times[-1] == pytest.approx(outcome.history["t"][-1], abs=1e-12)
    assert times[-1] > 0.095


@pytest.mark.serial
def test_a_body_that_comes_to_spin_too_fast() -> None:
    """A moment accelerates its rotation: 0.5 rad in a step are reached in the middle."""
    model = ff.Model("spin")
    model.add(
        ff.RigidBody("top", 1.0, (1.0, 1.0, 1.0)),
        ff.PointMoment("motor", ff.Marker("top"), (0.0, 0.0, 1e4)),
    )
    (line,) = warned(model, 1e-3, 0.1)
    assert 'RigidBody "top": it rotates by 1 rad in the step of 0.001 s to t = 0.1 s' in line
    assert warned(model, 1e-3, 0.04) == []


def driven(motion: Motion, kind: str = "angle") -> ff.Model:
    """An arm of 1 kg m^2 whose hinge, or slider whose rail, is driven."""
    model = ff.Model("driven")
    model.add(ff.RigidBody("arm", 1.0, (1.0, 1.0, 1.0)))
    ends = ff.Ground(), ff.Marker("arm")
    if kind == "angle":
        hinge = ff.Revolute("hinge", *ends)
        model.add(hinge, ff.PrescribedAngle("motor", *ends, angle=motion))
    else:
        rail = ff.Prismatic("rail", *ends, axis=(1.0, 0.0, 0.0))
        cylinder = ff.PrescribedDisplacement(
            "motor", *ends, axis=(1.0, 0.0, 0.0), displacement=motion
        )
        model.add(rail, cylinder)
    return model


JUMPS: dict[str, tuple[Motion, str]] = {
    "value": (lambda t: float(t > 0.0495), "its drive jumps by 1"),
    "rate": (lambda t: max(t - 0.05, 0.0), "the rate of its drive jumps by 1"),
}


@pytest.mark.parametrize("kind", ["angle", "slide"])
@pytest.mark.parametrize("what", JUMPS)
def test_drives_that_jump_are_named(what: str, kind: str) -> None:
    """In the run in any case, and jumps of the value by the checks of the model as well."""
    motion, words = JUMPS[what]
    unit = {"angle": "rad", "slide": "m"}[kind] + {"value": "", "rate": "/s"}[what]
    model = driven(motion, kind)
    lines = [line for line in warned(model, 1e-3, 0.1) if '"motor"' in line]
    assert len(lines) == 1
    assert f"{words} {unit} in the step to t = 0.05" in lines[0]
    found = [f for f in ff.check(model, ff.RunOptions(dt=1e-3, t_end=0.1)) if f.check == "drives"]
    assert len(found) == (what == "value")


TIMES = np.linspace(0.0, 0.1, 41)
SMOOTH: dict[str, Motion] = {
    "in ten steps": ff.SmoothStep(0.02, 0.03),
    "at rest": lambda t: 0.0,
    "measured": ff.Table(TIMES, 1e-2 * np.sin(np.maximum(60.0 * TIMES - 0.3, 0.0)) ** 2),
    "vibrating": lambda t: 1e-2 * np.sin(300.0 * t) ** 4,
}


@pytest.mark.serial
@pytest.mark.parametrize("name", SMOOTH)
def test_drives_that_do_not_jump_are_left_alone(name: str) -> None:
    model = driven(SMOOTH[name])
    assert warned(model, 1e-3, 0.1) == []
    assert ff.check(model, ff.RunOptions(dt=1e-3, t_end=0.1)) == []


@pytest.mark.serial
def test_a_drive_that_an_event_holds_does_not_jump() -> None:
    """The joint lets go of its drive and catches hold of it somewhere else."""
    model = driven(ff.SmoothStep(0.0, 0.1))
    for t, act in ((0.04, ff.ReleaseJoint("motor")), (0.06, ff.LockJoint("motor"))):
        model.add(
            ff.Event(f"at_{t}", ff.Marker("arm"), lambda now, _, t=t: now - t, act, once=True)
        )
    assert warned(model, 1e-3, 0.1) == []


def falling(*more: Any) -> ff.Model:
    """A mass that falls 0.1 m into a stiff spring, which is no stop for the integrator."""
    model = ff.Model("falling")
    ends = ff.Ground(), ff.Marker("bob")
    model.add(
        ff.RigidBody("bob", 2.0, (0.1, 0.1, 0.1)),
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Prismatic("rail", *ends),
        ff.SpringDamper(
            "floor", ff.Ground((0.0, 0.0, 1.0)), ends[1], force=lambda x: 1e5 * max(x - 0.1, 0.0)
        ),
        *more,
    )
    return model


@pytest.mark.slow_on_ranks
@pytest.mark.serial
def test_energy_from_nowhere_is_told_without_a_probe() -> None:
    """Steps of 20 ms do not resolve the impact, steps of 0.2 ms do; a probe tells it alone."""
    (line,) = warned(falling(), 2e-2, 0.4, rho_inf=1.0)
    assert line.startswith("spurious energy: the balance has grown by")
    assert warned(falling(), 2e-4, 0.4, rho_inf=1.0) == []
    assert len(warned(falling(ff.EnergyProbe()), 2e-2, 0.4, rho_inf=1.0)) == 1


def vibrating(damping: float) -> ff.Model:
    """A mass on a spring with a period of 6 ms, set in motion."""
    model = ff.Model("vibrating")
    ends = ff.Ground(), ff.Marker("bob")
    model.add(
        ff.RigidBody("bob", 1.0, (0.1, 0.1, 0.1), velocity=(0.0, 0.0, 1.0)),
        ff.Prismatic("rail", *ends),
        ff.SpringDamper(
            "spring", ff.Ground((0.0, 0.0, -1.0)), ff.Marker("bob"), stiffness=1e6, damping=damping
        ),
    )
    return model


@pytest.mark.serial
def test_energy_that_only_the_scheme_takes_is_told() -> None:
    """Unresolved and annihilated; a damper may take it, and resolved it is not lost."""
    (line,) = warned(vibrating(0.0), 0.05, 1.0, rho_inf=0.0)
    assert line.startswith(
        "numerical dissipation: the balance has fallen by 0.5 J with energies of at most 0.5 J"
    )
    assert warned(vibrating(10.0), 0.05, 1.0, rho_inf=0.0) == []
    assert warned(vibrating(0.0), 2e-4, 0.1) == []


def arm_beside(model: ff.Model) -> ff.Model:
    """A light arm that is rotated by a drive beside the other bodies."""
    ends = ff.Ground((5.0, 0.0, 0.0)), ff.Marker("arm")
    model.add(
        ff.RigidBody("arm", 0.1, (1e-3, 1e-3, 1e-3), position=(5.0, 0.0, 0.0)),
        ff.Revolute("hinge", *ends),
        ff.PrescribedAngle("motor", *ends, angle=ff.SmoothStep(0.0, 0.3)),
    )
    return model


@pytest.mark.serial
def test_gains_and_losses_beside_a_drive() -> None:
    """Energy that the work of a drive cannot explain is reported."""
    (line,) = warned(arm_beside(vibrating(0.0)), 0.02, 1.0, rho_inf=0.0)
    # 0.5 J vibrated; the drive's work of 0.3 J at most comes and goes
    assert line.startswith("numerical dissipation: the balance has fallen by 0.")
    assert warned(arm_beside(vibrating(0.0)), 2e-4, 0.1) == []
    # a quarter of the largest energy, of which a fifteenth may be the drive's
    (line,) = warned(arm_beside(falling()), 0.4 / 26, 0.4, rho_inf=1.0)
    assert line.startswith("spurious energy: the balance has grown by")
    assert warned(arm_beside(falling()), 2e-4, 0.4, rho_inf=1.0) == []


@pytest.mark.three_ranks
@pytest.mark.parametrize("name", ["busy", "alternating"])
def test_the_watch_is_the_same_on_any_number_of_ranks(name: str) -> None:
    """Its comparisons and findings, with works of loads and drives on different ranks."""
    options = ff.RunOptions(dt=2e-3, t_end=0.4, tolerance=1e-11, quiet=True)
    seen = []
    for comm in (MPI.COMM_SELF, MPI.COMM_WORLD):
        model = busy() if name == "busy" else alternating()
        simulation = Simulation(model, options, comm)
        watch = EnergyWatch(
            simulation.system, simulation.serial, 2e-3, 1e-6, probed=False, fast=False
        )
        for step in range(20):
            simulation.advance(2e-3, 2e-3 * (step + 1))
            watch.step(0, step == 19)
        sums = comm.allreduce(np.array([watch._done(), *watch._drives.work]))
        seen.append([watch._largest, watch._gain, watch._most_gain, watch._loss, *sums])
    # a drive that two ranks count, or a load that none does, is of the order of the largest
    np.testing.assert_allclose(seen[1], seen[0], rtol=0.0, atol=1e-9 * seen[0][0])


def alternating() -> ff.Model:
    """Three bodies that are pushed and stopped one after the other: the work returns to zero."""
    model = ff.Model("alternating")
    for k, start in enumerate((0.000, 0.012, 0.024)):
        name = f"body_{k}"

        def pushed(t: float, start: float = start) -> float:
            return float(start < t < start + 5e-3) - float(start + 5e-3 < t < start + 10e-3)

        model.add(
            ff.RigidBody(name, 1.0, (0.1, 0.1, 0.1), position=(float(k), 0.0, 0.0)),
            ff.PointForce(f"push_{k}", ff.Marker(name), (0.0, 400.0, 0.0), amplitude=pushed),
        )
    return model


def busy() -> ff.Model:
    """A double pendulum with a drive, an actuator, a load that varies and one that follows."""
    model = ff.Model("busy")
    upper, lower = ff.Marker("upper"), ff.Marker("lower")
    tip = ff.Marker("lower", offset=(0.5, 0.0, 0.0))
    hinge = ff.Revolute("hinge", ff.Ground(), upper, axis=(0, 1, 0))
    elbow = ff.Revolute(
        "elbow",
        ff.Marker("upper", offset=(1.0, 0.0, 0.0)),
        ff.Marker("lower", offset=(-0.5, 0.0, 0.0)),
        axis=(0, 1, 0),
    )
    model.add(
        ff.RigidBody("upper", 2.0, (0.1, 0.3, 0.3)),
        ff.RigidBody("lower", 1.0, (0.1, 0.2, 0.2), position=(1.5, 0.0, 0.0)),
        ff.Gravity((0.0, 0.0, -9.81)),
        hinge,
        elbow,
        ff.PrescribedAngle(
            "drive", ff.Ground(), upper, axis=(0, 1, 0), angle=ff.SmoothStep(0.0, 0.4)
        ),
        ff.Actuator("motor", elbow.a, elbow.b, axis=(0, 1, 0), force=lambda t: 3.0 * np.sin(9 * t)),
        ff.PointForce("push", lower, (0, 0, 20.0), amplitude=lambda t: np.sin(12.0 * t)),
        ff.PointForce("thrust", tip, (0, 0, 4.0), follower=True),
        ff.EnergyProbe(),
    )
    return model


@pytest.mark.serial
def test_work_of_loads_and_drives_is_that_of_the_energy_probe() -> None:
    """To a per cent, by changes of what is driven here and by rates of the sides there.

    The largest work is 19 J, of the drive alone 14 J: the wrong sign of any of the four shows.
    """
    options = ff.RunOptions(dt=2e-3, t_end=0.4, integrator="stabilized_index2", quiet=True)
    simulation = Simulation(busy(), options)
    watch = EnergyWatch(simulation.system, simulation.serial, 2e-3, 1e-6, probed=False, fast=False)
    for step in range(200):
        simulation.advance(2e-3, 2e-3 * (step + 1))
        watch.step(0, step == 199)
    work = simulation.system.comm.allreduce(watch._done())
    history = MPI.COMM_WORLD.bcast(ff.simulate(busy(), options).history)
    largest = np.abs(history["energy_work"]).max()
    assert largest > 1.0
    assert work == pytest.approx(history["energy_work"][-1], abs=0.01 * largest)
    assert watch.texts() == []


@pytest.mark.serial
def test_what_is_not_finite_is_told() -> None:
    options = ff.RunOptions(dt=1e-3, t_end=1e-2, quiet=True)
    simulation = Simulation(vibrating(0.0), options)
    watch = EnergyWatch(simulation.system, simulation.serial, 1e-3, 1e-6, probed=False, fast=False)
    for values in (simulation.system.constraints.forces, simulation.system.parts[0].block.velocity):
        kept = values.copy()
        values[0] = np.inf
        watch._bad = None
        watch.step(0, True)
        values[:] = kept
        assert "not finite at t = 0 s or earlier" in watch.texts()[0]
