# SPDX-License-Identifier: LGPL-3.0-or-later
"""Columns of a history reduced to one number."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray

__all__ = ["REDUCTIONS", "Reduction"]


def _mean(t: FloatArray, values: FloatArray) -> float:
    """Mean over time by the trapezoidal rule; over the rows where ``t`` does not grow."""
    h = np.diff(t)
    if len(t) < 2 or not (h > 0.0).all():
        return float(values.mean())
    return float(h @ (values[1:] + values[:-1]) / (2.0 * (t[-1] - t[0])))


def _integral(t: FloatArray, values: FloatArray) -> float:
    """Integral over time by the trapezoidal rule."""
    return float(np.diff(t) @ (values[1:] + values[:-1]) / 2.0)


#: Reductions of (times, values) to one number.
REDUCTIONS: dict[str, Callable[[FloatArray, FloatArray], float]] = {
    "final": lambda t, values: float(values[-1]),
    "max": lambda t, values: float(values.max()),
    "min": lambda t, values: float(values.min()),
    "mean": _mean,
    "integral": _integral,
    "rms": lambda t, values: _mean(t, values**2) ** 0.5,
}


@dataclass(frozen=True)
class Reduction:
    """A column of the history and its reduction to a number.

    Attributes:
        kind: one of ``REDUCTIONS``; means and integrals are over time.
        column: name of the column.
    """

    kind: str
    column: str

    @classmethod
    def parse(cls, text: str) -> Reduction:
        """Read ``max:tip_x``.

        Raises:
            ValueError: It is not of this form.
        """
        kind, _, column = text.strip().partition(":")
        if kind not in REDUCTIONS or not column:
            raise ValueError(
                f"'{text}' is not of the form {{{','.join(REDUCTIONS)}}}:column, as in max:tip_x"
            )
        return cls(kind, column)

    @property
    def label(self) -> str:
        """Name in tables."""
        return f"{self.column}_{self.kind}"

    def of(self, history: Mapping[str, FloatArray]) -> float | None:
        """The number; None if the history has no such column, or no rows."""
        values = history.get(self.column)
        if values is None or not len(values):
            return None
        return REDUCTIONS[self.kind](history["t"], values)
