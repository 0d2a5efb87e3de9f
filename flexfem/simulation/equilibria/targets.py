# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values of the load factor and of columns at which a path of equilibria is to have a point."""

from collections.abc import Mapping, Sequence

from flexfem._checks import InputError
from flexfem.options import target_values

__all__ = ["LOAD", "Targets"]

#: Name of the load factor among the columns.
LOAD = "t"

#: Difference to a value, as a part of the change over a step, that is round-off.
_THERE = 1e-9

#: Column, value that it passes, and differences to the value before and after the step.
Crossing = tuple[str, float, tuple[float, float]]


class Targets:
    """The values, and those that have been met.

    Attributes:
        values: by the name of the column.
        met: column, value and load factor of those that the path has met.
    """

    def __init__(self, text: str, columns: Sequence[str], end: float) -> None:
        """Read the option.

        Args:
            text: see :func:`flexfem.options.target_values`.
            columns: of the history.
            end: load factor at the end.

        Raises:
            InputError: a column that does not exist, or a load factor outside the range of the run.
        """
        self.values = target_values(text)
        self.met: list[dict[str, float | str]] = []
        self._end = end
        for name in self.values:
            if name != LOAD and name not in columns:
                raise InputError(
                    f"StaticOptions: output_at names the column '{name}', the history has "
                    f"{', '.join((LOAD, *columns))}"
                )
        for value in self.values.get(LOAD, ()):
            if not 0.0 < value <= end * (1.0 + _THERE):
                raise InputError(
                    f"StaticOptions: output_at t = {value:g} is not between 0 and {end:g}"
                )

    def room(self, t: float) -> float:
        """Return the distance from ``t`` to the next load factor, infinite if there is none."""
        ahead = [value - t for value in self.values.get(LOAD, ()) if not self.at(value, t)]
        return min((gap for gap in ahead if gap > 0.0), default=float("inf"))

    def at(self, value: float, t: float) -> bool:
        """Return True if a load factor is the given one."""
        return abs(t - value) <= _THERE * self._end

    def crossing(
        self, before: Mapping[str, float], after: Mapping[str, float],
        tried: Sequence[tuple[str, float]],
    ) -> Crossing | None:  # fmt: skip
        """The first value that the columns pass between two states, by linear interpolation.

        Args:
            before: columns at the accepted equilibrium.
            after: columns at the trial equilibrium.
            tried: values for which this step has been searched.
        """
        found: list[tuple[float, Crossing]] = []
        for name, start in before.items():
            for value in self.values[name]:
                low, high = start - value, after[name] - value
                near = _THERE * abs(high - low)
                if (low > 0.0) != (high > 0.0) and min(abs(low), abs(high)) > near:
                    found.append((low / (low - high), (name, value, (low, high))))
        found = [entry for entry in found if entry[1][:2] not in tried]
        return min(found)[1] if found else None

    def note(self, reached: Sequence[tuple[str, float]], t: float) -> bool:
        """Record values of the accepted equilibrium; returns True if there are any."""
        loads = [(LOAD, value) for value in self.values.get(LOAD, ()) if self.at(value, t)]
        every = dict.fromkeys([*reached, *loads])
        self.met += [{"column": name, "value": value, "t": t} for name, value in every]
        return bool(every)

    @property
    def missed(self) -> list[str]:
        """Values that the path has not met, as text."""
        met = {(entry["column"], entry["value"]) for entry in self.met}
        return [
            f"output_at: {name} = {value:g} was not reached"
            for name, values in self.values.items()
            for value in values
            if (name, value) not in met
        ]
