# SPDX-License-Identifier: LGPL-3.0-or-later
"""Laws of feedback by themselves: PID and state space against other formulations."""

import numpy as np
import pytest
from scipy.linalg import expm

import flexfem as ff


@pytest.mark.serial
def test_pid_is_the_transfer_function_of_its_parts():
    from scipy.signal import lfilter  # takes a tenth of what collecting all tests takes

    h, kp, ki, kd, tf = 0.1, 2.0, 3.0, 0.5, 0.05
    law, y = ff.PID(kp, ki, kd, filter_time=tf), np.random.default_rng(3).normal(size=50)
    found = [law.update(h * k, y[k : k + 1]) for k in range(50)]
    integral = lfilter([0.0, ki * h], [1.0, -1.0], y)
    slope = lfilter([kd, -kd], [tf + h, -tf], y, zi=[-kd / (tf + h) * y[0]])[0]
    assert found == pytest.approx(-(kp * y + integral + slope), abs=1e-12)


@pytest.mark.serial
def test_pid_does_not_wind_up():
    """A slow actuator at its limit: the integral that is wound up overshoots, this one does not."""
    peaks = []
    for tracking in (None, 1e9):
        law = ff.PID(2.0, 4.0, setpoint=1.0, upper=1.2, lower=-1.2, tracking_time=tracking)
        x, path = 0.0, []
        for k in range(2000):
            x += 0.01 * (law.update(0.01 * k, np.array([x])) - x)
            path.append(x)
        peaks.append(max(path))
        assert path[-1] == pytest.approx(1.0, abs=1e-3)
    assert peaks[0] < 1.05
    assert peaks[1] > 1.15


@pytest.mark.serial
@pytest.mark.parametrize("value", ["1.5", None, np.nan])
def test_setpoints_are_numbers(value: object) -> None:
    law = ff.PID(1.0, setpoint=lambda t: value if t else 0.0)
    law.update(0.0, np.zeros(1))
    with pytest.raises((TypeError, ValueError), match=r"PID: setpoint\(1\) must be"):
        law.update(1.0, np.zeros(1))


@pytest.mark.serial
def test_continuous_state_space_is_made_discrete():
    """Step response of a second-order lag about an operating point, against its exponential."""
    A, B, C = np.array([[0.0, 1.0], [-9.0, -1.2]]), np.array([[0.0], [9.0]]), np.array([[1.0, 0.0]])
    law = ff.StateSpace(A, B, C, [[0.0]], y0=[2.0], u0=[5.0]).discretised(0.01, "zoh")
    found = np.array([law.update(0.01 * k, np.array([3.0]))[0] for k in range(100)])
    rest = np.linalg.solve(A, -B[:, 0])
    exact = [5.0 + (C @ (rest - expm(A * 0.01 * k) @ rest))[0] for k in range(100)]
    assert found == pytest.approx(exact, abs=1e-10)  # exact for a constant input


@pytest.mark.serial
@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ff.PID("x"), "PID: proportional must be a number"),
        (lambda: ff.PID(1.0, lower=1.0, upper=0.0), "PID: lower must be below upper, got 1.0 and"),
        (lambda: ff.PID(1.0, filter_time=-1.0), "PID: filter_time must not be negative"),
        (lambda: ff.StateSpace(np.eye(2), np.eye(2), np.eye(3), np.eye(2)), "StateSpace: C must"),
        (lambda: ff.StateSpace([], [], [], [[1.0]]).discretised(0.1, "x"), "method must be one of"),
        (lambda: ff.StateSpace([], [], [], [[1.0]]).discretised(0.0), "sample_time must be pos"),
    ],
)
def test_bad_laws_are_told(make, message):
    with pytest.raises((TypeError, ValueError), match=message):
        make()
