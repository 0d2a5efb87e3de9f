# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of functions of time from their values inside a span."""

import numpy as np

from flexfem._types import FloatArray

__all__ = ["stencil"]

#: Points of a stencil.
_POINTS = 9


def stencil(t: float, first: float, last: float, step: float) -> tuple[FloatArray, FloatArray]:
    """Times (9,) about t between first and last, and weights (3, 9) of derivatives 0, 1, 2 at t.

    The formulas are those of an interpolating polynomial of degree eight, as central as the span
    allows: a drive need not be smooth, or be defined, beyond its ends. t is one of the times.

    Source: B. Fornberg, Math. Comp. 51 (1988) 699-706.
    """
    half = _POINTS // 2
    before = half if last <= first else int(np.clip((t - first) / step + 1e-9, 0, half))
    after = half if last <= first else int(np.clip((last - t) / step + 1e-9, 0, half))
    start = -before if after == half else after - (_POINTS - 1)
    offsets = np.arange(start, start + _POINTS, dtype=np.float64)
    powers = offsets[np.newaxis] ** np.arange(_POINTS)[:, np.newaxis]
    right = np.zeros((_POINTS, 3))
    right[0, 0], right[1, 1], right[2, 2] = 1.0, 1.0 / step, 2.0 / step**2
    return t + step * offsets, np.linalg.solve(powers, right).T
