# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of the laws of force elements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.differences import central, suited_step
from flexfem.core.laws import ElementLaw, ElementMotion

__all__ = ["exact_derivatives", "law_derivatives"]

#: Steps of one-sided and of central differences, relative where a size is known.
_STEP, _CENTRAL = 1e-7, 1e-5


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
