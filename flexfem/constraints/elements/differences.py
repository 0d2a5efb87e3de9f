# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of the laws of force elements."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import inf

import numpy as np

from flexfem._faults import FAILURES
from flexfem._types import FloatArray, IntArray
from flexfem.core.laws import ElementLaw, ElementMotion

__all__ = ["central", "exact_derivatives", "law_derivatives", "suited_step"]

#: Steps of one-sided and of central differences, relative where a size is known.
_STEP, _CENTRAL = 1e-7, 1e-5
#: Steps of central differences of fourth order, the longest first, and the relative change of the
#: derivatives with a tenth of a step up to which it suits.
_FINE, _SUITS = (1e-3, 1e-4, 1e-5, 1e-6), 1e-9
#: Places of these in steps, with weights.
_STENCIL = ((-2.0, 1.0 / 12.0), (-1.0, -2.0 / 3.0), (1.0, 2.0 / 3.0), (2.0, -1.0 / 12.0))


def law_derivatives(
    law: ElementLaw, elements: IntArray, motion: ElementMotion, z: FloatArray, sizes: FloatArray,
    values: FloatArray | None = None, first: int = 0,
) -> FloatArray:  # fmt: skip
    """Derivatives (e, r + n, 12 m + n) of forces and of rates of states, see ``ElementLaw``.

    Differences are taken for all elements at once: one call of the law a column.

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
    steps = _units(motion, sizes)[first:] * (_CENTRAL if values is None else _STEP)
    columns: list[FloatArray] = []
    for k, step in enumerate(steps.tolist()):
        after = _moved(law, elements, motion, z, first + k, step)
        if values is None:
            before = _moved(law, elements, motion, z, first + k, -step)
            columns.append((after - before) / (2.0 * step))
        else:
            columns.append((after - values) / step)
    return np.stack(columns, axis=2)


def exact_derivatives(
    law: ElementLaw, elements: IntArray, motion: ElementMotion, z: FloatArray, sizes: FloatArray,
    step: float | None,
) -> tuple[FloatArray, float]:  # fmt: skip
    """The same by central differences of fourth order, and the step that suits the law.

    Args:
        law: the law.
        elements: (e,) numbers of the elements.
        motion: their motion.
        z: (e, n) their states.
        sizes: (n,) magnitudes of states.
        step: one that was found before, None to look for one.
    """
    own = law.derivatives(elements, motion, z)
    if own is not None:
        return own, 0.0
    units = _units(motion, sizes)

    def found(step: float) -> FloatArray:
        return central(
            lambda k, size: _moved(law, elements, motion, z, k, size), (step * units).tolist()
        )

    if step is None:
        step, _ = suited_step(found)
    return found(step), step


def central(moved: Callable[[int, float], FloatArray], sizes: Sequence[float]) -> FloatArray:
    """Derivatives (..., n) by central differences of fourth order.

    Args:
        moved: values of a function where a quantity, by its number, has changed by a size.
        sizes: (n,) steps of the quantities.
    """
    columns: list[FloatArray] = []
    for k, size in enumerate(sizes):
        parts = [weight / size * moved(k, part * size) for part, weight in _STENCIL]
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


def _units(motion: ElementMotion, sizes: FloatArray) -> FloatArray:
    """(12 m + n,) magnitudes of displacements, twists and states."""
    faster = np.maximum(1.0, np.abs(motion.twists).max(axis=0, initial=0.0)).ravel()
    return np.concatenate([np.ones(motion.twists[0].size), faster, sizes])


def _moved(
    law: ElementLaw, elements: IntArray, motion: ElementMotion, z: FloatArray, column: int,
    step: float,
) -> FloatArray:  # fmt: skip
    """Forces and rates (e, r + n) where the quantity of a column has changed by ``step``."""
    count = motion.twists[0].size
    if column < count:
        motion = replace(motion, poses=_displaced(motion.poses, column // 6, column % 6, step))
    elif column < 2 * count:
        twists = motion.twists.copy()
        twists.reshape(len(twists), -1)[:, column - count] += step
        motion = replace(motion, twists=twists)
    else:
        z = z.copy()
        z[:, column - 2 * count] += step
    return np.concatenate(law.forces(elements, motion, z), axis=1)


def _displaced(poses: FloatArray, marker: int, component: int, step: float) -> FloatArray:
    """Poses (e, m, 12) where a marker has moved along, or rotated about, one of its axes."""
    poses = poses.copy()
    own, k = poses[:, marker], component % 3
    axes = own[:, 3:].reshape(-1, 3, 3)
    if component < 3:
        own[:, :3] += step * axes[:, :, k]
        return poses
    i, j = (k + 1) % 3, (k + 2) % 3
    first, second = axes[:, :, i].copy(), axes[:, :, j].copy()
    turned = axes.copy()
    turned[:, :, i] = np.cos(step) * first + np.sin(step) * second
    turned[:, :, j] = np.cos(step) * second - np.sin(step) * first
    own[:, 3:] = turned.reshape(-1, 9)
    return poses
