# SPDX-License-Identifier: LGPL-3.0-or-later
"""Central differences of fourth order, and steps that suit a function."""

from collections.abc import Callable, Sequence
from math import inf

import numpy as np

from flexfem._faults import FAILURES
from flexfem._types import FloatArray

__all__ = ["STENCIL", "central", "suited_step"]

#: Places in steps, with weights over the step.
STENCIL = ((-2.0, 1.0 / 12.0), (-1.0, -2.0 / 3.0), (1.0, 2.0 / 3.0), (2.0, -1.0 / 12.0))
#: Steps, the longest first, and the relative change of the derivatives with a tenth of a step up to
#: which it suits.
_FINE, _SUITS = (1e-3, 1e-4, 1e-5, 1e-6), 1e-9


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
