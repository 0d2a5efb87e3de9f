# SPDX-License-Identifier: LGPL-3.0-or-later
"""Force and moment per length along a beam."""

from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY
from typing import Any

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._faults import FAILURES, located
from flexfem._fields import ZERO, Given, checked, declared, flag, text
from flexfem._types import FloatArray
from flexfem.core.load import Amplitude, Load
from flexfem.loads.line_table import LineTable

__all__ = ["LineLoad"]

#: A vector, or a function of the place along the beam that returns one.
Distribution = FloatArray | Callable[[float], npt.ArrayLike]


def _distribution(owner: str, what: str, value: Any) -> Distribution:
    """Return a function as it is, or a checked vector."""
    return value if callable(value) else _checks.vector(owner, what, value)


def _coordinate(owner: str, what: str, value: str) -> str:
    """Return a checked coordinate along a beam."""
    if value not in ("length", "fraction"):
        raise ValueError(
            f'{owner}: {what} must be "length" or "fraction", got {_checks.show(value)}'
        )
    return value


def _breakpoints(owner: str, what: str, value: Sequence[float]) -> FloatArray:
    """Return checked places along a beam."""
    return _checks.array(owner, what, list(value) or np.empty(0), (-1,))


@declared
class LineLoad(Load):
    """Force and moment per initial length along a beam, uniform or functions of the place.

    Attributes:
        name: Unique name in the model.
        body: Name of the beam.
        force_per_length: In inertial axes, or in section axes for a follower, shape (3,), N/m; or a
            function of the place that returns it.
        moment_per_length: Likewise, N m/m.
        coordinate: Argument of functions: the arc "length" from the start, m, or the "fraction"
            of the beam's length.
        breakpoints: Places where functions jump or bend, besides those of a :class:`LineTable`.
            Forces are integrated by Gauss points in each element, or in each piece of it.
        follower: True if it rotates with the sections.
        amplitude: Factor as a function of time, None for the constant 1.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: An argument has the wrong shape or is not finite, or another coordinate.
    """

    name: str
    body: str = text()
    force_per_length: Given[npt.ArrayLike | Callable[[float], npt.ArrayLike], Distribution] = (
        checked(_distribution, default=ZERO)
    )
    _: KW_ONLY
    moment_per_length: Given[npt.ArrayLike | Callable[[float], npt.ArrayLike], Distribution] = (
        checked(_distribution, default=ZERO)
    )
    coordinate: str = checked(_coordinate, default="length")
    breakpoints: Given[Sequence[float], FloatArray] = checked(_breakpoints, default=())
    follower: bool = flag(default=False)
    amplitude: Amplitude | None = None

    _owner = property(Load._check)

    def __post_init__(self) -> None:
        """Add the kinks of tables to the breakpoints."""
        given = (self.force_per_length, self.moment_per_length)
        kinks = [table.breakpoints for table in given if isinstance(table, LineTable)]
        _checks.assign(self, breakpoints=np.unique(np.concatenate([self.breakpoints, *kinks])))

    @property
    def beams(self) -> tuple[str, ...]:
        """Names of the beams along which the load acts."""
        return (self.body,)

    @property
    def uniform(self) -> bool:
        """See :attr:`flexfem.core.load.Load.uniform`."""
        return not (callable(self.force_per_length) or callable(self.moment_per_length))

    @property
    def has_moment(self) -> bool:
        """See :attr:`flexfem.core.load.Load.has_moment`."""
        moment = self.moment_per_length
        return callable(moment) or bool(moment.any())

    @property
    def wrench(self) -> tuple[FloatArray, FloatArray]:
        """See :attr:`flexfem.core.load.Load.wrench`; only of uniform loads.

        Raises:
            ValueError: The load varies along the beam.
        """
        force, moment = self.force_per_length, self.moment_per_length
        if callable(force) or callable(moment):
            raise ValueError(f'LineLoad "{self.name}": it varies along the beam')
        return force, moment

    def at(self, place: float) -> tuple[FloatArray, FloatArray]:
        """Return force and moment per length (3,) at a place in the load's coordinate.

        Raises:
            TypeError: A function does not return numbers.
            ValueError: It fails, or does not return three finite ones.
        """
        force, moment = (
            self._value(what, given, place) if callable(given) else given
            for what, given in (
                ("force_per_length", self.force_per_length),
                ("moment_per_length", self.moment_per_length),
            )
        )
        return force, moment

    def _value(
        self, what: str, function: Callable[[float], npt.ArrayLike], place: float
    ) -> FloatArray:
        """Return the value of a function of the place."""
        owner = f'LineLoad "{self.name}"'
        try:
            value = function(place)
        except FAILURES as error:
            raise ValueError(f"{owner}: {what}: {located(function, error)}") from error
        return _checks.vector(owner, f"{what}({place:.6g})", value)
