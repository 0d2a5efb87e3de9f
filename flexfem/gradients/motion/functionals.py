# SPDX-License-Identifier: LGPL-3.0-or-later
"""Functionals of a motion: numbers of columns of its history, with their derivatives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf

import numpy as np
import numpy.typing as npt

from flexfem._types import FloatArray
from flexfem.core.differences import STENCIL

__all__ = ["TIME", "Functional", "by_last_time", "change", "misfit", "parse"]

#: The times of a history, as a column.
TIME = "t"
#: Difference of the last time, as a part of the last step.
_PART = 1e-2
#: The kinds of functionals.
KINDS = ("final", "mean", "integral", "rms", "max", "min", "ks")


@dataclass(frozen=True)
class Functional:
    """A number that depends on some columns of a history.

    Attributes:
        name: text in tables.
        columns: names of the columns.
        value: of the history, whose columns are (n,) arrays by name, "t" among them.
        derivative: of the history; (n,) by each of the columns, in their order.
    """

    name: str
    columns: tuple[str, ...]
    value: Callable[[Mapping[str, FloatArray]], float]
    derivative: Callable[[Mapping[str, FloatArray]], FloatArray]


def misfit(
    targets: Mapping[str, npt.ArrayLike], scales: Mapping[str, float] | None = None
) -> Functional:
    """Half the sum of squares of differences between columns and measured values.

    Args:
        targets: values by column, one for each row of the history; NaN where there is none.
        scales: differences of each column that are alike, such as standard deviations of its noise;
            1 by default.

    Raises:
        ValueError: there are no targets, or a scale is not positive. When it is evaluated: the
            history has another number of rows.
    """
    names, wanted = tuple(targets), {}
    if not names:
        raise ValueError("misfit: give values of a column at least")
    for name, values in targets.items():
        wanted[name] = np.array(values, dtype=np.float64).reshape(-1)
        scale = (scales or {}).get(name, 1.0)
        if not 0.0 < scale < inf:
            raise ValueError(f"misfit: scale of {name} must be positive, got {scale}")

    def differences(history: Mapping[str, FloatArray]) -> FloatArray:
        found = []
        for name in names:
            if history[name].shape != wanted[name].shape:
                raise ValueError(
                    f"misfit: {name} has {len(history[name])} rows, got {len(wanted[name])} values"
                )
            found.append((history[name] - wanted[name]) / (scales or {}).get(name, 1.0))
        together: FloatArray = np.nan_to_num(np.array(found), nan=0.0)
        return together

    def derivative(history: Mapping[str, FloatArray]) -> FloatArray:
        factors = np.array([1.0 / (scales or {}).get(name, 1.0) for name in names])
        slopes: FloatArray = differences(history) * factors[:, np.newaxis]
        return slopes

    return Functional(
        "misfit", names, lambda history: 0.5 * float((differences(history) ** 2).sum()), derivative
    )


def by_last_time(functional: Functional, history: Mapping[str, FloatArray]) -> float:
    """Derivative of a number by the time of the last row, at fixed values of other columns.

    It is a difference of fourth order, as functionals have none by hand.
    """
    t, total = history[TIME], 0.0
    step = _PART * float(t[-1] - t[-2])
    for place, weight in STENCIL:
        moved = t.copy()
        moved[-1] += place * step
        total += weight / step * functional.value({**history, TIME: moved})
    return total


def change(
    functional: Functional, history: Mapping[str, FloatArray], moved: Mapping[str, FloatArray]
) -> float:
    """Change of a number with changes (n,) of its columns, and of the last time among them."""
    nothing = np.zeros(len(history[TIME]))
    others = {**moved, TIME: nothing}  # as other times count as given
    rows = np.array([others[name] for name in functional.columns])
    total = float((functional.derivative(history) * rows).sum())
    if (last := moved.get(TIME, nothing)[-1]) != 0.0:
        total += last * by_last_time(functional, history)
    return total


def parse(text: str, ks_rho: float | None = None) -> Functional:
    """Functional of ``kind:column``, such as ``final:tip_x``.

    Kinds are those of :class:`flexfem.studies.reductions.Reduction`, means and integrals over time
    by the trapezoidal rule, and ``ks``, the function of Kreisselmeier and Steinhauser (1979),
    ``log(mean(exp(rho x)))/rho`` over all rows, a smooth maximum from below.

    Args:
        text: see above.
        ks_rho: rho of ``ks``, one over the unit of the column.

    Raises:
        ValueError: it is not of this form, or rho is missing or not positive.
    """
    kind, _, column = text.strip().partition(":")
    if kind not in KINDS or not column:
        raise ValueError(
            f"gradient: '{text}' is not of the form {{{','.join(KINDS)}}}:column, as in final:tip_x"
        )
    if kind == "ks" and not (ks_rho is not None and 0.0 < ks_rho < inf):
        raise ValueError(f"gradient: {text.strip()} needs a positive ks_rho, got {ks_rho}")

    def both(history: Mapping[str, FloatArray]) -> tuple[float, FloatArray]:
        return _RULES[kind](history["t"], history[column], ks_rho or 0.0)

    return Functional(
        text.strip(), (column,), lambda history: both(history)[0],
        lambda history: both(history)[1][np.newaxis],
    )  # fmt: skip


def _weights(t: FloatArray) -> FloatArray:
    """Weights of the trapezoidal rule."""
    h, weights = np.diff(t), np.zeros(len(t))
    weights[1:] += 0.5 * h
    weights[:-1] += 0.5 * h
    return weights


def _final(t: FloatArray, x: FloatArray, rho: float) -> tuple[float, FloatArray]:
    return float(x[-1]), np.eye(1, len(x), len(x) - 1)[0]


def _integral(t: FloatArray, x: FloatArray, rho: float) -> tuple[float, FloatArray]:
    weights = _weights(t)
    return float(weights @ x), weights


def _mean(t: FloatArray, x: FloatArray, rho: float) -> tuple[float, FloatArray]:
    weights = _weights(t) / (t[-1] - t[0])
    return float(weights @ x), weights


def _rms(t: FloatArray, x: FloatArray, rho: float) -> tuple[float, FloatArray]:
    square, weights = _mean(t, x**2, rho)
    size = square**0.5
    return size, weights * x / size if size else np.zeros_like(x)


def _max(t: FloatArray, x: FloatArray, rho: float) -> tuple[float, FloatArray]:
    k = int(np.argmax(x))
    return float(x[k]), np.eye(1, len(x), k)[0]


def _min(t: FloatArray, x: FloatArray, rho: float) -> tuple[float, FloatArray]:
    value, by = _max(t, -x, rho)
    return -value, by


def _ks(t: FloatArray, x: FloatArray, rho: float) -> tuple[float, FloatArray]:
    top = x.max()
    parts = np.exp(rho * (x - top))
    # rows that are lost in the sum have no part in it, and may be where columns have kinks
    parts[parts < np.finfo(np.float64).eps / len(x)] = 0.0
    return float(top + np.log(parts.mean()) / rho), parts / parts.sum()


_RULES: dict[str, Callable[[FloatArray, FloatArray, float], tuple[float, FloatArray]]] = {
    "final": _final, "mean": _mean, "integral": _integral, "rms": _rms, "max": _max, "min": _min,
    "ks": _ks,
}  # fmt: skip
