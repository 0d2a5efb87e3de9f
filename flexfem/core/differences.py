# SPDX-License-Identifier: LGPL-3.0-or-later
"""Central differences of fourth order, extrapolated ones, and steps that suit a function."""

from collections.abc import Callable, Sequence
from math import inf

import numpy as np

from flexfem._faults import FAILURES
from flexfem._types import FloatArray

__all__ = [
    "ENOUGH", "STENCIL", "STEPS", "SUITS", "central", "differenced", "extrapolated", "slopes",
    "slopes_of_rows", "suited_step",
]  # fmt: skip

#: Places in steps, with weights over the step.
STENCIL = ((-2.0, 1.0 / 12.0), (-1.0, -2.0 / 3.0), (1.0, 2.0 / 3.0), (2.0, -1.0 / 12.0))
#: Differences relative to the size of what changes, the longest first.
STEPS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
#: Difference from a shorter step, relative to the largest changes, up to which a step suits, and up
#: to which the best one does.
SUITS, ENOUGH = 1e-7, 1e-5
#: Such a difference with the shortest step that is no rounding.
_BENT = 1e-2
#: Changes relative to the size of what they consist of that are rounding.
_ROUNDING = 1e-13
#: Steps, the longest first, and the relative change of the derivatives with a tenth of a step up to
#: which it suits.
_FINE, _SUITS = (1e-3, 1e-4, 1e-5, 1e-6), 1e-9
#: Longest step of extrapolated differences relative to the size of what changes, the number of
#: steps, each a half of the one before, and the relative difference between the two highest orders
#: up to which these suit: errors of a sixth order are its power 3/2.
_FAR, _HALVES, _CLOSE = 3.2e-2, 9, 1e-7
#: Most steps that are extrapolated together: what is beyond a pole or a kink is left behind.
_TOGETHER = 5


def central(moved: Callable[[int, float], FloatArray], sizes: Sequence[float]) -> FloatArray:
    """Derivatives (..., n) by central differences of fourth order.

    Args:
        moved: values of a function where a quantity, by its number, has changed by a size.
        sizes: (n,) steps of the quantities.
    """
    columns: list[FloatArray] = []
    for k, size in enumerate(sizes):
        parts = [weight / size * moved(k, part * size) for part, weight in STENCIL]
        columns.append(np.sum(parts, axis=0))
    return np.stack(columns, axis=-1)


def differenced(weights: Sequence[float], values: Sequence[FloatArray]) -> FloatArray:
    """Sum of values times weights, which sum to zero.

    Values that are large beside their differences lose no digits.
    """
    found: FloatArray = np.zeros_like(values[0])
    for weight, own in zip(weights[1:], values[1:], strict=True):
        found = found + weight * (own - values[0])
    return found


def extrapolated(
    difference: Callable[[float], FloatArray], size: float, rounding: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Derivatives (n,) of a function, with bounds of their errors, from central differences.

    Those with three or more steps, each a half of the one before, are extrapolated to zero
    (Richardson, Phil. Trans. A 210 (1911) 307-357), of sixth or higher order. Steps are halved
    until the two highest orders agree, or differ by no more than rounding, which is the less, the
    longer the steps are. How much they differ is a bound (n,) of the errors, unless differences
    change the more, the shorter steps are, as beside a jump: then it is by how much.

    Args:
        difference: ``(f(h) - f(-h)) / (2 h)``, (n,), of a step h.
        size: of what changes.
        rounding: (n,) of f.

    Raises:
        Exception: that of the function, if it does not exist beside the value.
    """
    orders, best, least = list[FloatArray](), np.zeros(0), np.full(len(rounding), inf)
    plain = list[FloatArray]()
    for k in range(_HALVES):
        step = _FAR * size / 2.0**k
        try:
            found = [difference(step)]
        except FAILURES:  # the function may not exist so far away
            if k > _HALVES - 3:
                raise
            orders.clear()
            continue
        plain.append(found[0])
        for n, longer in enumerate(orders, 1):
            found.append((4.0**n * found[-1] - longer) / (4.0**n - 1.0))
        orders = found[:_TOGETHER]
        if len(orders) < 3:
            continue
        own, off = orders[-1], np.abs(orders[-1] - orders[-2])
        best = np.where(off < least, own, best) if len(best) else own
        least = np.fmin(off, least)
        if (least <= np.maximum(_CLOSE * np.abs(best), rounding / step)).all():
            break
    before, last = (np.abs(plain[k] - plain[k - 1]) for k in (-2, -1))
    return best, np.where(last > before, np.maximum(last, least), least)


def suited_step(found: Callable[[float], FloatArray]) -> tuple[float, float]:
    """Step of differences that suits a function, and their relative error with it.

    Args:
        found: derivatives by differences with a step.
    """
    least, chosen, longer = inf, _FINE[-1], None
    for shorter in (*_FINE, 0.1 * _FINE[-1]):
        try:
            values = found(shorter)
        except FAILURES:  # the function may not exist so far away
            continue
        if longer is not None:
            off = float(np.abs(values - longer).max(initial=0.0))
            off /= float(np.abs(values).max(initial=0.0)) or 1.0
            if off < least:
                least, chosen = off, 10.0 * shorter
            if off <= _SUITS:
                break
        longer = values
    return chosen, least


def _along(change: Callable[[float], FloatArray], step: float) -> tuple[FloatArray, FloatArray]:
    """Derivatives of a function of a number at zero, and the largest changes over the step.

    Args:
        change: of the function's values, where the number is not zero.
        step: of the number.
    """
    total = largest = np.zeros(1)
    for part, weight in STENCIL:
        own = change(part * step)
        total = total + weight / step * own
        largest = np.maximum(largest, np.abs(own) / step)
    return total, largest


def slopes(
    value: Callable[[FloatArray], float], count: int, size: float = 0.0
) -> tuple[FloatArray, float]:
    """Derivatives (count,) of a function of numbers (count,) at zero, and their relative error.

    They are central differences of fourth order with the longest of STEPS that suits the function.

    Args:
        value: the function.
        count: of the numbers.
        size: of what its values consist of: so small a part of it is rounding.
    """
    still, random = value(np.zeros(count)), np.random.default_rng(3).standard_normal(count)

    def slope(direction: FloatArray, step: float) -> tuple[float, float]:
        def change(by: float) -> FloatArray:
            own = value(by * direction) - still
            return np.array([own if abs(own) > _ROUNDING * size else 0.0])

        total, largest = _along(change, step)
        return float(total[0]), float(largest[0])

    found, least = np.zeros(count), inf
    for step in STEPS:
        own, changes = np.array([slope(one, step) for one in np.eye(count)]).T
        # all numbers together, with a tenth of the step
        off = abs(slope(random, 0.1 * step)[0] - float(own @ random))
        off /= float(changes @ np.abs(random)) or 1.0
        if off < least:
            found, least = own, off
        if off <= SUITS:
            break
    return found, least


def slopes_of_rows(
    function: Callable[[FloatArray], FloatArray], x: FloatArray, sizes: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Derivatives of a function of rows of numbers, with the longest of STEPS that suits each row.

    Args:
        function: of (m, n) numbers, returns (m,) values, each of the numbers of its row.
        x: (m, n) where.
        sizes: (n,) of the numbers.

    Returns:
        Derivatives (m, n); by how much they miss that along a direction at random of the size of
        the numbers, with a shorter step (m,); and the largest changes along it (m,).
    """
    still = function(x)
    along: FloatArray = np.random.default_rng(3).standard_normal((x.shape[1],))

    def slope(direction: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
        return _along(lambda by: function(x + by * sizes * direction) - still, step)

    best, missed, changes = np.zeros_like(x), np.full(len(x), inf), np.zeros(len(x))
    for step in STEPS:
        by_number = np.array([slope(unit, step) for unit in np.eye(x.shape[1])])
        own, largest = by_number[:, 0].T, np.abs(along) @ by_number[:, 1]
        off = np.abs(slope(along, 0.1 * step)[0] - own @ along)
        # rows that are precise stay as they are, whatever others need
        better = (off < missed) & (missed > SUITS * changes)
        best[better], missed[better], changes[better] = own[better], off[better], largest[better]
        if (missed <= SUITS * changes).all():
            break
    # where long steps go over a kink on both sides alike, the shortest one does not
    bent = (missed > SUITS * changes) & (off > _BENT * largest)
    missed[bent] = changes[bent]
    return best / sizes, missed, changes
