# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops over nodes that carry frames: prediction, correction, acceptance of a step."""

import numpy as np

from flexfem._types import FloatArray
from flexfem.lie.compiled import kernel
from flexfem.lie.se3 import inverse_tangent_apply, retract_into

__all__ = ["accept", "correct", "predict"]


@kernel
def _configure(
    frames0: FloatArray, n: FloatArray, v_base: FloatArray, w_base: FloatArray, rates: FloatArray,
    frames: FloatArray, v: FloatArray, w: FloatArray, i: int,
) -> None:  # fmt: skip
    """Configuration, velocity and acceleration of node ``i`` from its increment ``n[i]``."""
    retract_into(frames0[i], n[i], frames[i])
    for k in range(6):
        v[i, k] = v_base[i, k] + rates[0] * n[i, k]
        w[i, k] = w_base[i, k] + rates[1] * n[i, k]


@kernel
def predict(
    frames0: FloatArray, v0: FloatArray, a0: FloatArray, w0: FloatArray, law: FloatArray,
    rates: FloatArray, frames: FloatArray, n: FloatArray, v: FloatArray, w: FloatArray,
    v_base: FloatArray, w_base: FloatArray,
) -> None:  # fmt: skip
    """Start a step: ``n = law . (v0, a0)`` and the affine laws ``v(n)``, ``w(n)``.

    ``law`` (7,) holds the factors of v0 and a0 in the predicted increment, of v0 and a0 in
    ``v_base``, and of v0, a0 and w0 in ``w_base``; ``rates`` (2,) dv/dn and dw/dn.
    """
    for i in range(n.shape[0]):
        for k in range(6):
            n[i, k] = law[0] * v0[i, k] + law[1] * a0[i, k]
            v_base[i, k] = law[2] * v0[i, k] + law[3] * a0[i, k]
            w_base[i, k] = law[4] * v0[i, k] + law[5] * a0[i, k] + law[6] * w0[i, k]
        _configure(frames0, n, v_base, w_base, rates, frames, v, w, i)


@kernel
def correct(
    frames0: FloatArray, n: FloatArray, v_base: FloatArray, w_base: FloatArray, rates: FloatArray,
    frames: FloatArray, v: FloatArray, w: FloatArray, step: FloatArray, sign: float,
) -> float:  # fmt: skip
    """Move by the local twists ``sign * step`` and return the largest entry of the step.

    The increment follows to first order, ``n += Tinv(n) sign step``: at the solution both agree.
    """
    largest, change = 0.0, np.empty(6)
    for i in range(n.shape[0]):
        inverse_tangent_apply(n[i], step[i], change)
        for k in range(6):
            n[i, k] += sign * change[k]
            size = abs(step[i, k])
            if size > largest or size != size:  # a NaN stays the largest
                largest = size
        _configure(frames0, n, v_base, w_base, rates, frames, v, w, i)
    return largest


@kernel
def _orthonormalise(H: FloatArray) -> None:
    """``R <- R (3 I - R^T R) / 2``: keeps round-off from adding up over millions of steps."""
    c00 = H[3] * H[3] + H[6] * H[6] + H[9] * H[9]
    c11 = H[4] * H[4] + H[7] * H[7] + H[10] * H[10]
    c22 = H[5] * H[5] + H[8] * H[8] + H[11] * H[11]
    c01 = H[3] * H[4] + H[6] * H[7] + H[9] * H[10]
    c02 = H[3] * H[5] + H[6] * H[8] + H[9] * H[11]
    c12 = H[4] * H[5] + H[7] * H[8] + H[10] * H[11]
    for k in (3, 6, 9):
        a, b, c = H[k], H[k + 1], H[k + 2]
        H[k] = 0.5 * (a * (3.0 - c00) - b * c01 - c * c02)
        H[k + 1] = 0.5 * (b * (3.0 - c11) - a * c01 - c * c12)
        H[k + 2] = 0.5 * (c * (3.0 - c22) - a * c02 - b * c12)


@kernel
def accept(
    frames0: FloatArray, v0: FloatArray, a0: FloatArray, w0: FloatArray, frames: FloatArray,
    n: FloatArray, v: FloatArray, w: FloatArray, law: FloatArray, h: float, owned: int,
    misses: FloatArray,
) -> None:  # fmt: skip
    """End a step: the trial state becomes the state; ``law`` (3,) gives a from n, v0, a0.

    ``misses`` (2,) becomes the largest distances of the increments of the owned nodes from
    ``h v0`` and from ``h v0 + h^2/2 a0``.
    """
    misses[:] = 0.0
    for i in range(n.shape[0]):
        for k in range(6):
            if i < owned:
                miss = n[i, k] - h * v0[i, k]
                misses[0] = max(misses[0], abs(miss))
                misses[1] = max(misses[1], abs(miss - 0.5 * h * h * a0[i, k]))
            a0[i, k] = law[0] * n[i, k] + law[1] * v0[i, k] + law[2] * a0[i, k]
            v0[i, k] = v[i, k]
            w0[i, k] = w[i, k]
            n[i, k] = 0.0
        _orthonormalise(frames[i])
        for k in range(12):
            frames0[i, k] = frames[i, k]
