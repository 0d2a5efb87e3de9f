# SPDX-License-Identifier: LGPL-3.0-or-later
"""Controllers: closed loops against independent solutions, restarts, repeated steps, ranks."""

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm, solve_continuous_are

import flexfem as ff
from flexfem.simulation.motion.stepping import Simulation
from tests.unit.refusals import assert_on_page

COMM = MPI.COMM_WORLD
MASS, INERTIA, LENGTH, GRAVITY = 2.0, 0.05, 0.5, 9.81
ABOUT_HINGE = INERTIA + MASS * LENGTH**2
Z = (0.0, 0.0, 1.0)


def _turn(t: float, s: ff.MarkerState) -> tuple[float, float]:
    return float(np.arctan2(s.rotation[1, 0], s.rotation[0, 0])), float(s.angular_velocity[2])


def pendulum(*controllers: ff.Controller, up: float = -1.0) -> ff.Model:
    """A rod hinged at the origin, hanging (up = -1) or standing, with a motor and a torque."""
    model = ff.Model("pendulum")
    hinge = ff.Marker("rod", offset=(0.0, -up * LENGTH, 0.0))
    model.add(
        ff.RigidBody("rod", MASS, (0.03, 0.03, INERTIA), position=(0.0, up * LENGTH, 0.0)),
        ff.Gravity((0.0, -GRAVITY, 0.0)),
        ff.Revolute("hinge", ff.Ground(), hinge, axis=Z),
        ff.Actuator("motor", ff.Ground(), hinge, axis=Z),
        ff.PointMoment("torque", ff.Marker("rod"), Z, amplitude=None if controllers else _zero),
        ff.Probe("turn", ff.Marker("rod"), ("angle", "rate"), _turn, unwrap=("angle",)),
        *controllers,
    )
    if controllers and not any("torque" in c.outputs for c in controllers):
        model.add(ff.Controller("none", (), ["torque"], lambda t, y: 0.0))
    return model


def _zero(t: float) -> float:
    return 0.0


def pd(t: float, y: np.ndarray) -> float:
    """Proportional and derivative feedback towards one radian."""
    return float(20.0 * (1.0 - y[0]) - 2.0 * y[1])


def _motion(t: float, x: np.ndarray, torque: Callable[[float, np.ndarray], float]) -> list[float]:
    return [x[1], (torque(t, x) - MASS * GRAVITY * LENGTH * np.sin(x[0])) / ABOUT_HINGE]


def _flow(x: np.ndarray, span: float, torque: Callable[[float, np.ndarray], float]) -> np.ndarray:
    """The pendulum's state a time later, by a Runge-Kutta method of order 8."""
    tight: dict[str, Any] = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-12}
    found: np.ndarray = solve_ivp(_motion, (0.0, span), x, args=(torque,), **tight).y[:, -1]
    return found


def _held_loop(span: float, samples: int, delay: float) -> np.ndarray:
    """The pendulum under sampled control, each output acting a delay later than its sample."""
    x, before = np.zeros(2), pd(0.0, np.zeros(2))
    for _ in range(samples):
        now = pd(0.0, x)
        x = _flow(x, delay, lambda t, x, u=before: u)
        x = _flow(x, span - delay, lambda t, x, u=now: u)
        before = now
    return x


def _run(model: ff.Model, dt: float, t_end: float, **options: Any) -> ff.Outcome:
    outcome = ff.simulate(model, ff.RunOptions(dt=dt, t_end=t_end, quiet=True, **options))
    assert outcome.status == "ok", outcome.status
    return outcome


def _last(model: ff.Model, dt: float, t_end: float, **options: Any) -> np.ndarray:
    history = _run(model, dt, t_end, **options).history
    return np.array([history["angle"][-1], history["rate"][-1]])


@pytest.mark.serial
def test_continuous_law_is_of_second_order():
    exact = _flow(np.zeros(2), 0.5, pd)
    loop = lambda: pendulum(ff.Controller("pd", ["turn"], ["motor"], pd))  # noqa: E731
    coarse, fine = (np.abs(_last(loop(), dt, 0.5) - exact)[0] for dt in (0.01, 0.005))
    # values of the last step, not extrapolated, would be of first order: a ratio of 2
    assert coarse / fine == pytest.approx(4.0, abs=0.3)
    assert fine < 1e-3  # of 1 rad; without gravity in the loop it would be 0.3


@pytest.mark.serial
def test_continuous_law_is_called_by_iterations_once_at_the_end_and_for_differences():
    times: list[float] = []

    def noted(t: float, y: np.ndarray) -> float:
        times.append(t)
        return pd(t, y)

    model, steps, surplus = pendulum(ff.Controller("pd", ["turn"], ["motor"], noted)), 30, []
    simulation = Simulation(model, ff.RunOptions(dt=0.01, t_end=1.0, quiet=True))
    for _ in range(steps):
        calls, iterations = len(times), simulation.system.counters.newton_iterations
        assert simulation.advance(0.01).name == "OK"
        surplus.append(
            len(times) - calls - (simulation.system.counters.newton_iterations - iterations)
        )
    # differences of 12 columns of one marker serve 12 steps; a call to accept a step would make 2
    assert sorted(set(surplus)) == [1, 13]
    assert surplus.count(13) == 3


@pytest.mark.serial
@pytest.mark.parametrize("integrator", ["generalized_alpha", "energy_momentum"])
def test_sampled_law_is_held_and_acts_half_a_step_late(integrator):
    span, samples, errors = 0.02, 15, []
    for dt in (0.01, 0.005):
        loop = pendulum(ff.Controller("pd", ["angle", "rate"], ["motor"], pd, span))
        found = _last(loop, dt, span * samples, integrator=integrator)
        errors.append(np.abs(found - _held_loop(span, samples, 0.5 * dt)).max())
    # with another delay than half a step, the error would be of first order: a ratio of 2, and
    # 0.1 rad/s at these steps
    assert errors[0] / errors[1] == pytest.approx(4.0, abs=0.5)
    assert errors[1] < 1e-3


@pytest.mark.serial
def test_history_shows_what_is_held():
    model = pendulum(ff.Controller("pd", ["turn"], ["motor"], pd, 0.02))
    history = _run(model, 0.005, 0.06).history
    shown, sampled = history["pd_motor"], slice(None, None, 4)
    y = np.stack([history["angle"], history["rate"]], axis=1)
    # the output of a sample is shown from its instant on, and until the next one
    assert shown[sampled] == pytest.approx([pd(0.0, row) for row in y[sampled]], abs=1e-12)
    assert np.array_equal(shown[:-1], np.repeat(shown[:-1:4], 4))
    again = _run(model, 0.005, 0.06).history  # a run leaves the model as it was
    assert all(np.array_equal(again[name], history[name]) for name in history)


class Counter:
    """A law with memory that notes when it is called."""

    def __init__(self, torque: float = 3.0) -> None:
        self.state, self._torque = np.zeros(2), torque

    def update(self, t: float, y: np.ndarray) -> float:
        self.state = np.array([self.state[0] + 1.0, t])
        return self._torque * (-1.0) ** self.state[0]


@pytest.mark.serial
def test_repeated_and_partial_steps_sample_once():
    """Errors, events within steps and their repetition do not disturb the samples."""
    model = pendulum(ff.Controller("count", [], ["motor"], Counter(30.0), 0.02))
    model.add(
        ff.Event("top", ff.Marker("rod"), lambda t, s: t - 0.0333, ff.LockJoint("hinge", hold=True))
    )
    options = ff.RunOptions(
        dt=0.01, t_end=0.1, quiet=True, adaptive=True, error_tolerance=1e-6
    )  # fmt: skip
    simulation = Simulation(model, options)
    for step in range(10):
        simulation.advance(0.01, 0.01 * (step + 1))
    assert simulation.rejected > 0
    assert simulation.steps > 15
    assert [name for name, _ in simulation.events.fired] == ["top"]
    # at 0, 0.02, ... 0.1 s
    assert simulation.controls.state()["controls_0_law"].tolist() == pytest.approx([6.0, 0.1])
    assert model["count"].law.state.tolist() == [0.0, 0.0]


def beams(*controllers: ff.Controller) -> ff.Model:
    """Two flexible arms in series, each with a motor, and the angles of both."""
    x = np.linspace(0.0, 2.0, 7)
    points = np.insert(x, 3, 1.0)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    cells = np.array([(0, 1), (1, 2), (2, 3), (4, 5), (5, 6), (6, 7)])
    groups = {"upper": np.arange(3), "fore": np.arange(3, 6)}
    model = ff.Model("arms", mesh=ff.LineMesh(points, cells, groups))
    section = ff.Section.rectangle(0.03, 0.02, ff.Material(2.1e9, 0.3, 7850.0))
    root, elbow, fore = ff.Marker("upper", "start"), ff.Marker("upper", "end"), ff.Marker("fore", 0)
    fore = ff.Marker("fore", "start")
    model.add(
        ff.Beam("upper", section),
        ff.Beam("fore", section),
        ff.Revolute("shoulder", ff.Ground(), root, axis=Z),
        ff.Revolute("elbow", elbow, fore, axis=Z),
        ff.Actuator("first", ff.Ground(), root, axis=Z),
        ff.Actuator("second", elbow, fore, axis=Z, force=lambda t: 2.0 * t),
        ff.PointForce("push", ff.Marker("fore", "end"), (0.0, 1.0, 0.0)),
        ff.Probe("at_root", root, ("angle", "rate"), _turn, unwrap=("angle",)),
        ff.PositionProbe("tip", ff.Marker("fore", "end")),
        *controllers,
    )
    return model


def loops() -> Sequence[ff.Controller]:
    """A PID, a continuous law and a filter that drives a load."""
    low_pass = ff.StateSpace([[-40.0]], [[40.0]], [[25.0]], [[0.0]], y0=[0.0]).discretised(0.01)
    return (
        ff.Controller("pid", ["angle"], ["first"], ff.PID(60.0, 30.0, 5.0, 0.4, 0.01), 0.01),
        ff.Controller("hold", ["tip_y", "rate"], ["second"],
                      lambda t, y: -20.0 * y[0] - 0.5 * y[1]),
        ff.Controller("filter", ["tip_y"], ["push"], low_pass, 0.01),
    )  # fmt: skip


@pytest.mark.several_ranks
def test_ranks_apply_the_same_outputs():
    """Bodies on several ranks give what they give on one."""
    options = ff.RunOptions(dt=0.005, t_end=0.1, quiet=True)
    spread = ff.simulate(beams(*loops()), options)
    alone = ff.simulate(beams(*loops()), options, comm=MPI.COMM_SELF)
    assert spread.status == alone.status == "ok"
    if COMM.rank == 0:
        for name, column in alone.history.items():
            largest = max(np.abs(column).max(), 1e-3)
            # outputs that are missing on a rank would change it by its first digits
            assert np.abs(spread.history[name] - column).max() < 1e-9 * largest, name
        assert np.abs(alone.history["filter_push"]).max() > 0.1
        assert np.abs(alone.history["tip_y"]).max() > 0.02


def test_restart_goes_on_with_the_laws_memories(shared_tmp_path):
    common: dict[str, Any] = {"dt": 0.005, "quiet": True, "checkpoint_every": 7}
    whole = ff.simulate(beams(*loops()), ff.RunOptions(t_end=0.07, **common))
    first, second = shared_tmp_path / "a", shared_tmp_path / "b"
    ff.simulate(beams(*loops()), ff.RunOptions(t_end=0.035, output=first, **common))
    if COMM.rank == 0:
        shutil.copytree(first, second)
    COMM.Barrier()
    options = ff.RunOptions(
        t_end=0.07, output=second, restart=first / "checkpoint_000007.h5", **common
    )
    resumed = ff.simulate(beams(*loops()), options)
    if COMM.rank == 0:
        for name, column in whole.history.items():
            # the PID's integral or a hold started again would change outputs by their first digits
            largest = max(np.abs(column).max(), 1e-3)
            assert np.abs(resumed.history[name] - column).max() < 1e-11 * largest, name
    with pytest.raises(ValueError, match="another model, other controllers"):
        ff.simulate(beams(*loops()[:2]), options)


@pytest.mark.serial
def test_linear_quadratic_regulator_of_the_linearised_model():
    """A standing rod is linearised, and the gain that scipy finds balances the model itself."""
    linear = ff.linearize(pendulum(up=1.0))
    assert linear.inputs == ("torque", "motor")
    rate = np.sqrt(MASS * GRAVITY * LENGTH / ABOUT_HINGE)
    assert np.sort(linear.poles.real) == pytest.approx([-rate, rate], rel=1e-6)
    # a moment on the rod and a motor at its hinge do the same: angular acceleration per torque
    assert (linear.C @ linear.B)[1] == pytest.approx(2 * [1.0 / ABOUT_HINGE], rel=1e-6)
    B = linear.B[:, 1:]
    cost = solve_continuous_are(linear.A, B, linear.C.T @ linear.C, np.eye(1))
    gain = B.T @ cost @ np.linalg.inv(linear.C)  # from outputs, which tell the whole state

    def law(t: float, y: np.ndarray) -> np.ndarray:
        return -gain @ (y - linear.y0) + (0.1 if t < 0.05 else 0.0)

    model = pendulum(ff.Controller("lqr", ["turn"], ["motor"], law), up=1.0)
    history = _run(model, 0.0025, 0.6).history
    # the same in closed form: a push of 0.1 N m for 0.05 s, then free motion of the closed loop
    closed = linear.A - B @ gain @ linear.C
    rest = np.linalg.solve(closed, -0.1 * B[:, 0])
    x = expm(closed * 0.55) @ (rest - expm(closed * 0.05) @ rest)
    largest = np.abs(history["angle"]).max()
    assert 1e-4 < largest < 1e-2  # without control it falls: 0.07 rad
    assert history["angle"][-1] == pytest.approx((linear.C @ x)[0], abs=0.02 * largest)


def test_linear_inputs_do_not_depend_on_ranks():
    """The transfer function from motors and a load, some between bodies of two ranks."""
    spread, alone = (ff.linearize(beams(), comm=comm) for comm in (COMM, MPI.COMM_SELF))
    found, expected = (
        x.C @ np.linalg.solve(30.0j * np.eye(len(x.A)) - x.A, x.B) for x in (spread, alone)
    )
    assert spread.inputs == alone.inputs == ("push", "first", "second")
    # a motor that acts on one body only would change its column by as much as it is
    assert found == pytest.approx(expected, rel=1e-6, abs=1e-9 * np.abs(expected).max())
    turning = np.abs(expected[alone.outputs.index("rate")])
    assert turning.min() > 1e-3


@pytest.mark.serial
def test_outputs_are_zero_at_rest():
    """Controllers do not act in statics, nor loads that they drive."""
    model = pendulum(ff.Controller("push", ["turn"], ["torque", "motor"], lambda t, y: (5.0, 5.0)))
    model.add(
        ff.TorsionalSpringDamper("spring", ff.Ground(), ff.Marker("rod"), axis=Z, stiffness=9.0)
    )
    outcome = ff.solve_static(model, ff.StaticOptions(load_steps=1, quiet=True))
    assert outcome.status == "ok"
    assert abs(outcome.history["angle"][-1]) < 1e-9  # the torque alone would rotate it by 0.5 rad


def _controller(**given: Any) -> ff.Controller:
    usual: dict[str, Any] = {"name": "c", "inputs": ["turn"], "outputs": ["motor"], "law": pd}
    return ff.Controller(**(usual | given))


@pytest.mark.serial
@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"inputs": "turn"}, 'Controller "c": inputs must be a list of names'),
        ({"inputs": ["speed"]}, 'no probe or column "speed", its columns are .*angle, rate'),
        ({"outputs": []}, "outputs must hold at least one name"),
        (
            {"outputs": ["gear"]},
            "output \"gear\" must be an Actuator or a load .* has 'motor, torque'",
        ),
        ({"outputs": ["hinge"]}, 'output "hinge" must be an Actuator or a load .* is a Revolute'),
        ({"outputs": ["motor", "motor"]}, 'column "c_motor" occurs twice'),
        ({"law": 3.0}, r"law must be a function of t and y, or have update\(t, y\) and state"),
        ({"law": lambda t: [1.0]}, r"law must be a function of \(t, y\), got one of \(t\)"),
        ({"sample_time": -1.0}, "sample_time must be positive, got -1.0"),
        ({"sample_time": 0.003}, "sample_time must be a multiple of the time step 0.002 s, got"),
        ({"law": lambda t, y: y}, r"law must return 1 number, got array\(\[0., 0.\]\) at t = 0"),
        ({"law": lambda t, y: None}, "law must return 1 number, got None at t = 0"),
        (
            {"law": lambda t, y: np.nan},
            r"law returned \[nan\] at t = 0 s, from lambda",
        ),
        (
            {"law": lambda t, y: 1 / 0, "sample_time": 0.002},
            r"lambda \(test_control.py, line \d+\): ZeroDivisionError: division",
        ),
        ({"law": ff.PID(1.0)}, "PID: takes one measurement, got 2"),
    ],
)
def test_mistakes_are_told(given, message):
    with pytest.raises((TypeError, ValueError), match=message) as raised:
        ff.simulate(pendulum(_controller(**given)), ff.RunOptions(dt=0.002, t_end=0.01, quiet=True))
    assert "\n" not in str(raised.value)
    assert_on_page(str(raised.value))


@pytest.mark.serial
def test_two_masters_and_other_amplitudes_are_refused():
    first, second = _controller(), _controller(name="d")
    with pytest.raises(ValueError, match='"d": output "motor" is driven by Controller "c" already'):
        pendulum(first, second).validate()
    model = pendulum()
    model.add(_controller(outputs=["torque"]))
    with pytest.raises(ValueError, match='PointMoment "torque" has an amplitude of its own'):
        model.validate()
    model = pendulum(_controller())
    model.add(ff.Probe("other", ff.Marker("rod"), ["c_motor"], lambda t, s: [0.0]))
    with pytest.raises(ValueError, match='column "c_motor" is used already'):
        model.validate()


@pytest.mark.serial
def test_outputs_that_are_no_numbers_end_the_run(tmp_path: Path):
    law = lambda t, y: np.nan if t > 0.015 else 0.0  # noqa: E731
    model = pendulum(_controller(law=law, sample_time=0.01))
    outcome = ff.simulate(model, ff.RunOptions(dt=0.01, t_end=0.1, quiet=True, output=tmp_path))
    assert outcome.status == 'Controller "c": the output is not finite after t = 0.02 s'
    assert (tmp_path / "history.csv").exists()
    model = pendulum(_controller(law=lambda t, y: 1.0 / (t < 0.015), sample_time=0.01))
    line = r'^Controller "c": lambda \(test_control.py, line \d+\): ZeroDivisionError: '
    with pytest.raises(ff.FunctionError, match=line) as raised:
        ff.simulate(model, ff.RunOptions(dt=0.01, t_end=0.1, quiet=True))
    assert raised.value.outcome.status == f"{raised.value} after t = 0.02 s"
