# SPDX-License-Identifier: LGPL-3.0-or-later
"""Strains of a beam that is free to expand as its temperature changes."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._fields import checked, declared, number
from flexfem._types import FloatArray

__all__ = ["ThermalStrain"]

#: A number, or a function of places (k,), metres, and the time, s, that returns numbers (k,).
Change = float | Callable[[FloatArray, float], npt.ArrayLike]


def _change(owner: str, what: str, value: Any) -> Any:
    """Return a checked number, or a function as it is."""
    return value if callable(value) else _checks.number(owner, what, value)


@declared
class ThermalStrain:
    """Strains of a beam's sections under a temperature that is linear over each section.

    The temperature changes by `change + gradient_y y + gradient_z z`: the section is stretched by
    `expansion * change` and bent by `expansion * gradient_z` about e2 and by
    `-expansion * gradient_y` about e3 (B. A. Boley, J. H. Weiner, Theory of Thermal Stresses
    (1960), section 10.2). An object is the `prestrain` of a :class:`Beam`.

    Attributes:
        expansion: Coefficient of thermal expansion, 1/K.
        change: Of the temperature on the axis since the stress-free state, K: a number, or a
            function of the arc lengths (k,), metres, and the time, seconds, that returns (k,).
        gradient_y: Of the temperature along e2, K/m; as `change`.
        gradient_z: Of the temperature along e3, K/m; as `change`.

    Raises:
        TypeError: An argument is no number, and no function where one may be given.
        ValueError: A number is not finite.
    """

    expansion: float = number()
    change: Change = checked(_change, default=0.0)
    gradient_y: Change = checked(_change, default=0.0)
    gradient_z: Change = checked(_change, default=0.0)

    @property
    def constant(self) -> bool:
        """True if nothing in it is a function."""
        return not any(map(callable, (self.change, self.gradient_y, self.gradient_z)))

    def __call__(self, places: FloatArray, time: float) -> FloatArray:
        """Strains (k, 6) at arc lengths (k,), metres, at a time, s."""
        strain = np.zeros((len(places), 6))
        parts = (0, 1.0, self.change), (4, 1.0, self.gradient_z), (5, -1.0, self.gradient_y)
        for column, sign, given in parts:
            value = given(places, time) if callable(given) else given
            strain[:, column] = sign * self.expansion * _checks.numbers(value)
        return strain
