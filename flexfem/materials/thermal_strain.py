# SPDX-License-Identifier: LGPL-3.0-or-later
"""Strains of beams and shells that are free to expand as their temperature changes."""

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
    """Strains under a temperature that is linear over each section of a beam or shell.

    An object is the `prestrain` of a :class:`Beam` or a :class:`Shell`. The temperature changes by
    `change + gradient_y y + gradient_z z`. A beam's section is stretched by `expansion * change`
    and bent by `expansion * gradient_z` about e2 and by `-expansion * gradient_y` about e3 (B. A.
    Boley, J. H. Weiner, Theory of Thermal Stresses (1960), section 10.2). A shell, through whose
    thickness z goes, is stretched by `expansion * change` in all directions, and its curvatures are
    `expansion * gradient_z` (same source, chapter 12).

    Attributes:
        expansion: Coefficient of thermal expansion, 1/K.
        change: Of the temperature on the axis or reference surface since the stress-free state, K:
            a number, or a function of the places and the time, seconds, that returns (k,). Places
            are arc lengths (k,), metres, of a beam, and points (k, 3) of a shell in the initial
            configuration, inertial axes, metres.
        gradient_y: Of the temperature along e2 of a beam, K/m; as `change`.
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
        """Strains (k, 6) of a beam at arc lengths (k,), metres, at a time, s."""
        strain = np.zeros((len(places), 6))
        strain[:, 0] = self._expanded(self.change, places, time)
        strain[:, 4] = self._expanded(self.gradient_z, places, time)
        strain[:, 5] = -self._expanded(self.gradient_y, places, time)
        return strain

    def of_shell(self, points: FloatArray, time: float) -> FloatArray:
        """Strains (k, 6) of a shell at points (k, 3), metres, at a time, s."""
        strain = np.zeros((len(points), 6))
        strain[:, 0] = strain[:, 1] = self._expanded(self.change, points, time)
        strain[:, 3] = strain[:, 4] = self._expanded(self.gradient_z, points, time)
        return strain

    def _expanded(self, given: Change, places: FloatArray, time: float) -> FloatArray:
        """Expansion times a change or gradient, a number or (k,)."""
        value = given(places, time) if callable(given) else given
        return self.expansion * _checks.numbers(value)
