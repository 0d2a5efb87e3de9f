# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces of actuators along prescribed motions, against closed forms."""

import math
from typing import Any

import numpy as np
import pytest

from flexfem.cli import load_case

Z = (0.0, 0.0, 1.0)
G = 9.81


def spiral(t: np.ndarray, duration: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity and acceleration (complex) of the manipulator's path at given times."""
    tau = t / duration
    s = 10 * tau**3 - 15 * tau**4 + 6 * tau**5
    ds = (30 * tau**2 - 60 * tau**3 + 30 * tau**4) / duration
    dds = (60 * tau - 180 * tau**2 + 120 * tau**3) / duration**2
    way = 0.03892 * np.exp(1j * (math.radians(111.75) + 2 * np.pi * (s - 1)))
    first, second = way * (1 + 2j * np.pi * s), way * 2j * np.pi * (2 + 2j * np.pi * s)
    return way * s, first * ds, second * ds**2 + first * dds


class PlanarManipulator:
    """3-RRR by geometry: two links of equal length in each chain, uniform rods."""

    def __init__(self, t: np.ndarray, duration: float, height: float) -> None:
        self.length, mass = 0.244, 2700.0 * 40e-6 * 0.244
        inertia = mass * (self.length**2 + height**2) / 12.0
        P, v, a = spiral(t, duration)
        n = len(t)
        self.J, self.F = np.zeros((n, 3, 2)), np.zeros((n, 2))
        self.rates = np.zeros((n, 3))
        for chain in range(3):
            corner = 0.5 / math.sqrt(3.0) * np.exp(1j * math.radians(90.0 + 120.0 * chain))
            d = P - corner
            first = np.exp(1j * (np.angle(d) + np.arccos(0.5 * np.abs(d) / self.length)))
            second = (d - self.length * first) / self.length
            # rates of both links by the velocity of P, along X and Y and along the path
            by_x, by_y = (self._rates(first, second, np.full(n, u)) for u in (1.0, 1j))
            w = self._rates(first, second, v)
            turning = -self.length * (w[0] ** 2 * first + w[1] ** 2 * second)
            e = self._rates(first, second, a - turning)
            self.J[:, chain] = np.stack([by_x[0], by_y[0]], axis=-1)
            self.rates[:, chain] = w[0]
            half = 0.5 * self.length
            for i, (on_first, on_second) in enumerate([(half, 0.0), (self.length, half)]):
                centre = on_first * (1j * e[0] - w[0] ** 2) * first
                centre = centre + on_second * (1j * e[1] - w[1] ** 2) * second
                for k, by in enumerate((by_x, by_y)):
                    move = on_first * 1j * by[0] * first + on_second * 1j * by[1] * second
                    self.F[:, k] += mass * (np.conj(move) * centre).real + inertia * by[i] * e[i]

    def _rates(self, first, second, velocity):
        """Angular velocities of both links that give P a velocity."""
        p, q = 1j * self.length * first, 1j * self.length * second
        det = p.real * q.imag - p.imag * q.real
        return (
            (velocity.real * q.imag - velocity.imag * q.real) / det,
            (p.real * velocity.imag - p.imag * velocity.real) / det,
        )


@pytest.fixture(scope="module")
def case() -> Any:
    """Functions of the case."""
    return load_case("parallel_manipulator").build.__globals__


@pytest.mark.serial
def test_planar_manipulator(case, monkeypatch):
    monkeypatch.setitem(case, "SAMPLES", 26)
    path = case["Path"]("spiral", "smooth", 0.5)
    t = np.linspace(0.0, 0.5, 26)
    known = PlanarManipulator(t, 0.5, 5e-3)
    J, F = known.J, known.F
    least = np.einsum("nij,njk,nk->ni", J, np.linalg.inv(np.swapaxes(J, 1, 2) @ J), F)
    two = np.linalg.solve(np.swapaxes(J[:, :2], 1, 2), F[..., np.newaxis])[..., 0]
    # least power: the same formula for scaled torques
    K = J[1:-1] / known.rates[1:-1, :, np.newaxis]
    power = np.einsum(
        "nij,njk,nk->ni", K, np.linalg.inv(np.swapaxes(K, 1, 2) @ K), F[1:-1]
    ) / known.rates[1:-1]  # fmt: skip
    for mode, expected in (("torque", least), ("1", two), ("3", power)):
        found = case["torques"](5e-3, mode, path)
        values = np.stack([spline.values for spline in found.values()], axis=1)
        values = values[1:-1] if mode == "3" else values
        # drives are differentiated to 1e-9; without the links' rotary inertia 0.1 would be missing
        np.testing.assert_allclose(values, expected, atol=1e-7 * np.abs(expected).max())
