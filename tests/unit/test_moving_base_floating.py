# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stretch of floating bodies along their axes, from their ends."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad

from flexfem.lie import so3
from flexfem.research.moving_base.comparison.floating import _stretch

pytestmark = pytest.mark.serial


@pytest.mark.parametrize("across", [1, 2])
@pytest.mark.parametrize(("square", "cube"), [(1e-4, 0.0), (0.0, 3e-5), (2e-4, -4e-5)])
def test_bending_shortens_what_is_not_stretched(across: int, square: float, cube: float) -> None:
    """Two bodies bent to ``w = a x^2 + b x^3`` by half of the integral of ``w'^2``, one longer."""
    stretches, lengths, states = (2e-9, -3e-9), (2.5, 0.8), []
    for length, stretch in zip(lengths, stretches, strict=True):
        shorter = 0.5 * quad(lambda x: (2 * square * x + 3 * cube * x * x) ** 2, 0.0, length)[0]
        end, slope = np.zeros(3), 2.0 * square * length + 3.0 * cube * length**2
        end[0] = length + stretch - shorter
        end[across] = square * length**2 + cube * length**3
        turn = np.eye(3)
        # the first column is the direction of the axis
        turn[across, 0], turn[0, across] = slope, -slope
        root = so3.exp(np.array([0.3, -0.9, 0.4]))
        for place, axes in ((np.zeros(3), np.eye(3)), (end, turn)):
            states.append(SimpleNamespace(position=root @ place + 1.0, rotation=root @ axes))
    found = _stretch(lengths, states)
    # quadratic in w: one per cent of what bending takes is 1e-10 and more
    assert found == pytest.approx(sum(stretches), abs=2e-14)
