# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops over the nodes of a block for dynamic relaxation."""

import numpy as np

from flexfem._types import FloatArray
from flexfem.kernels.compiled import kernel
from flexfem.lie.se3 import retract_into

__all__ = ["SUMS", "drive", "largest_into", "measure", "measure_way", "move"]

#: Sums of :func:`measure`: work of the change of the residual along the last step (0), twice the
#: kinetic energy (1), squares of residual forces (2) and moments (3), work of the residual along
#: the last step (4).
SUMS = 5


@kernel
def measure(
    residual: FloatArray, previous: FloatArray, velocity: FloatArray, inverse: FloatArray,
    sums: FloatArray,
) -> None:  # fmt: skip
    """Add the work and energies of a step to ``sums``.

    Args:
        residual: (n, 6) or more rows, of which the first n count.
        previous: (n, width) residual one step before.
        velocity: (n, width) the last step.
        inverse: (n, width) inverse masses, zero where an unknown is fixed.
        sums: (SUMS,).
    """
    for i in range(inverse.shape[0]):
        for k in range(inverse.shape[1]):
            if inverse[i, k] == 0.0:
                continue
            r, v = residual[i, k], velocity[i, k]
            sums[0] += v * (r - previous[i, k])
            sums[1] += v * v / inverse[i, k]
            sums[2 if k < 3 else 3] += r * r
            sums[4] += v * r


@kernel
def drive(
    residual: FloatArray, previous: FloatArray, inverse: FloatArray, keep: float, smooth: float,
    push: float, velocity: FloatArray, step: FloatArray,
) -> None:  # fmt: skip
    """New velocities (n, width), which are the steps (n, 6) as well; keeps the residual.

    They are ``keep v - (push r + smooth (r - previous)) / m``.
    """
    for i in range(inverse.shape[0]):
        for k in range(inverse.shape[1]):
            r = residual[i, k]
            force = push * r + smooth * (r - previous[i, k])
            velocity[i, k] = keep * velocity[i, k] - inverse[i, k] * force
            step[i, k] = velocity[i, k]
            previous[i, k] = r


@kernel
def measure_way(
    residual: FloatArray, first: FloatArray, way: FloatArray, inverse: FloatArray,
    sums: FloatArray,
) -> None:  # fmt: skip
    """Add ``way . (residual - first)`` and ``way . M way`` to ``sums`` (2,).

    Args:
        residual: (n, 6) or more rows, of which the first n count.
        first: (n, width) residual at the begin of the displacement.
        way: (n, width) displacement: sum of the steps since then.
        inverse: (n, width) inverse masses, zero where an unknown is fixed.
        sums: (2,).
    """
    for i in range(inverse.shape[0]):
        for k in range(inverse.shape[1]):
            if inverse[i, k] > 0.0:
                sums[0] += way[i, k] * (residual[i, k] - first[i, k])
                sums[1] += way[i, k] * way[i, k] / inverse[i, k]


@kernel
def move(frames: FloatArray, step: FloatArray, width: int) -> None:
    """Move frames (n, 12) by local twists (n, 6), of nodes with three unknowns by translations."""
    base = np.empty(12)
    for i in range(len(frames)):
        H, u = frames[i], step[i]
        if width == 3:
            for a in range(3):
                H[a] += H[3 + 3 * a] * u[0] + H[4 + 3 * a] * u[1] + H[5 + 3 * a] * u[2]
        else:
            for k in range(12):
                base[k] = H[k]
            retract_into(base, u, H)


@kernel
def largest_into(step: FloatArray, largest: FloatArray) -> None:
    """Raise (2,) to the largest translation and rotation of steps (n, width); NaN is preserved."""
    for i in range(step.shape[0]):
        for k in range(step.shape[1]):
            size = abs(step[i, k])
            at = 0 if k < 3 else 1
            if size > largest[at] or size != size:
                largest[at] = size
