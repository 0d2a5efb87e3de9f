# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of the laws of force elements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.laws import ElementLaw, ElementMotion

__all__ = ["law_derivatives"]

#: Steps of one-sided and of central differences, relative where a size is known.
_STEP, _CENTRAL = 1e-7, 1e-5


def law_derivatives(
    law: ElementLaw, elements: IntArray, motion: ElementMotion, z: FloatArray, sizes: FloatArray,
    values: FloatArray | None = None, first: int = 0,
) -> FloatArray:  # fmt: skip
    """Derivatives (e, r + n, 2 r + n) of forces and of rates of states.

    By displacements along the r rows, by their rates, and by the n states. Differences are taken
    for all elements at once: one call of the law a column.

    Args:
        law: the law.
        elements: (e,) numbers of the elements.
        motion: their motion.
        z: (e, n) their states.
        sizes: (n,) magnitudes of states.
        values: (e, r + n) forces and rates there; if None, differences are central, of second
            order.
        first: columns before this one are left out.
    """
    own = law.derivatives(elements, motion, z)
    if own is not None:
        return own[:, :, first:]
    rows, states = motion.rates.shape[1], z.shape[1]
    faster = np.maximum(1.0, np.abs(motion.rates).max(axis=0, initial=0.0))
    steps = np.concatenate([np.ones(rows), faster, sizes])[first:]
    steps *= _CENTRAL if values is None else _STEP
    out = np.empty((len(elements), rows + states, len(steps)))
    for k, step in enumerate(steps.tolist()):
        after = _moved(law, elements, motion, z, first + k, step)
        if values is None:
            before = _moved(law, elements, motion, z, first + k, -step)
            out[:, :, k] = (after - before) / (2.0 * step)
        else:
            out[:, :, k] = (after - values) / step
    return out


def _moved(
    law: ElementLaw, elements: IntArray, motion: ElementMotion, z: FloatArray, column: int,
    step: float,
) -> FloatArray:  # fmt: skip
    """Forces and rates (e, r + n) where the quantity of a column has changed by ``step``."""
    rows = motion.rates.shape[1]
    if column < rows:
        motion = law.displaced(motion, column, step)
    elif column < 2 * rows:
        rates = motion.rates.copy()
        rates[:, column - rows] += step
        motion = replace(motion, rates=rates)
    else:
        z = z.copy()
        z[:, column - 2 * rows] += step
    return np.concatenate(law.forces(elements, motion, z), axis=1)
