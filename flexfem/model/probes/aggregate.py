# SPDX-License-Identifier: LGPL-3.0-or-later
"""Probe of the largest value of a function over elements, such as a stress."""

from collections.abc import Callable, Sequence
from typing import ClassVar

import numpy as np

from flexfem import _checks
from flexfem._faults import FAILURES, noted
from flexfem._fields import checked, declared, function
from flexfem._types import FloatArray
from flexfem.model.probes.base import AnyProbe, check_columns, strings
from flexfem.model.structure.structure import Structure

__all__ = ["AggregateProbe"]


def _positive(owner: str, what: str, value: float | None) -> float | None:
    return None if value is None else _checks.number(owner, what, value, positive=True)


def _bodies(owner: str, what: str, values: Sequence[str]) -> tuple[str, ...]:
    names = (values,) if isinstance(values, str) else strings(owner, what, values)
    if not names:
        raise ValueError(f"{owner}: {what} must hold at least one name")
    return names


@declared
class AggregateProbe(AnyProbe):
    """The largest value of a function over the elements of some bodies, in one column.

    With ``rho`` it is the function of Kreisselmeier and Steinhauser (1979),
    ``log(mean(exp(rho f)))/rho`` over all elements, a smooth maximum from below: constraints on
    stresses of thousands of elements become one that gradients can follow.

    Attributes:
        name: Unique name in the model, and of the column.
        bodies: Names of beams, shells or solids.
        function: ``function(strains, resultants, places)`` with strains and stress resultants
            (m, 6) of m elements, as of :class:`StrainProbe`, :class:`ShellStrainProbe` or, for
            solids, mean Green strains and mean Cauchy stresses (Pa) in the order xx, yy, zz, yz,
            xz, xy, and the means (m, 3) of the positions of their nodes at the start, m; returns
            (m,) values.
        rho: of the smooth maximum, one over the unit of the values; None for the largest value.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: No bodies, or a rho that is not positive.
    """

    smooth: ClassVar[bool] = True
    name: str
    bodies: Sequence[str] = checked(_bodies)
    function: Callable[..., FloatArray] = function()
    rho: float | None = checked(_positive, default=None)

    def __post_init__(self) -> None:
        """Name the column."""
        check_columns(_checks.named(self, self.name), (self.name,))
        _checks.assign(self, columns=(self.name,))

    def check(self, model: Structure) -> None:
        """See :meth:`AnyProbe.check`."""
        for name in self.bodies:
            if model.get(name) not in model.bodies:
                raise ValueError(f'AggregateProbe "{self.name}": {model!r} has no body "{name}"')

    def evaluate(
        self, strains: FloatArray, resultants: FloatArray, places: FloatArray
    ) -> FloatArray:
        """Values (m,) of elements.

        In a run they are nan where the function fails.

        Raises:
            FunctionError: Outside of a run, where it fails or returns something else.
        """
        try:
            values = self.function(strains, resultants, places)
            return _checks.returned("function", values, (len(strains),))
        except FAILURES as error:
            noted(f'AggregateProbe "{self.name}"', self.function, error)
            return np.full(len(strains), np.nan)
