# SPDX-License-Identifier: LGPL-3.0-or-later
"""Differences that are extrapolated, with steps that suit: curvature, kinks, rounding, gaps."""

from collections.abc import Callable

import numpy as np
import pytest

from flexfem.core.differences import extrapolated

pytestmark = pytest.mark.serial


def found(
    function: Callable[[float], float], at: float, rounding: float = 0.0
) -> tuple[float, list[float]]:
    """Derivative of a function, and the steps that were taken."""
    steps = []

    def difference(step: float) -> np.ndarray:
        steps.append(step)
        return np.array([function(at + step) - function(at - step)]) / (2.0 * step)

    derivatives, _ = extrapolated(difference, abs(at), np.array([rounding]))
    return float(derivatives[0]), steps


@pytest.mark.parametrize("power", [-8.0, -4.0, -1.0, 0.5, 3.0, 9.0])
def test_powers(power: float) -> None:
    """With few steps; of the second order they would be wrong by 1e-3."""
    slope, steps = found(lambda x: x**power, 1.7)
    assert slope == pytest.approx(power * 1.7 ** (power - 1.0), rel=1e-9)
    assert len(steps) <= 5


def test_poles_and_kinks_are_not_passed() -> None:
    """A pole at 1 % and a kink at 0.3 % of the value; functions that do not exist beyond 1 %."""
    pole, steps = found(lambda x: 1.0 / (1.01 - x), 1.0)
    # 1e-9 is left beside the pole, at the longest steps the sign would be wrong
    assert pole == pytest.approx(1e4, rel=1e-8)
    assert steps[-1] < 1e-3
    kink, _ = found(lambda x: x**2 + 5.0 * max(x - 1.003, 0.0), 1.0)
    assert kink == pytest.approx(2.0, rel=1e-9)

    def half(x: float) -> float:
        if x > 1.01:
            raise ValueError("there is nothing")
        return x**-2

    assert found(half, 1.0)[0] == pytest.approx(-2.0, rel=1e-9)


def test_what_exists_nowhere_near_is_refused() -> None:
    """Instead of a derivative of one side."""

    def side(x: float) -> float:
        if x > 1.0:
            raise ValueError("there is nothing")
        return x

    with pytest.raises(ValueError, match="there is nothing"):
        found(side, 1.0)


def test_rounding_is_not_followed() -> None:
    """What differs by rounding between two orders keeps the longest steps, also beside zero."""
    random = np.random.default_rng(1)

    def noisy(x: float) -> float:
        return 1e-12 * float(random.standard_normal())

    slope, steps = found(noisy, 1.0, 1e-11)
    assert len(steps) == 3
    # with the shortest steps it would be 1e-8
    assert abs(slope) < 1e-9
