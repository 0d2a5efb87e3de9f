# SPDX-License-Identifier: LGPL-3.0-or-later
"""Masses at the nodes of one block over a step that conserves energy."""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.step_kernels import momentum_force, momentum_tangent
from flexfem.lie import so3
from flexfem.lie.compiled import kernel

__all__ = ["add_step_inertia", "lump", "moved_lumps", "step_inertia_tangent"]


def lump(matrix: FloatArray) -> FloatArray:
    """Mass, first moment and rotary inertia about the node, (..., 13), of matrices (..., 6, 6)."""
    first = np.stack([matrix[..., 5, 1], matrix[..., 3, 2], matrix[..., 4, 0]], axis=-1)
    rotary = matrix[..., 3:, 3:].reshape((*matrix.shape[:-2], 9))
    return np.concatenate([matrix[..., :1, 0], first, rotary], axis=-1)


def moved_lumps(lumps: FloatArray, centres: FloatArray) -> FloatArray:
    """The same masses (k, 13) with their moments about the points (k, 3)."""
    mass, first, arm = lumps[:, :1], so3.skew(lumps[:, 1:4]), so3.skew(centres)
    rotary = first @ arm + arm @ first - mass[:, np.newaxis] * (arm @ arm)
    rotary = lumps[:, 4:] + rotary.reshape(-1, 9)
    return np.concatenate([mass, lumps[:, 1:4] - mass * centres, rotary], axis=1)


@kernel
def add_step_inertia(
    nodes: IntArray, lumps: FloatArray, centres: FloatArray, frames0: FloatArray,
    frames: FloatArray, rates0: FloatArray, rates: FloatArray, gravity: FloatArray, h: float,
    scale: float, residual: FloatArray,
) -> None:  # fmt: skip
    """Add ``scale`` times mean inertia force minus weight of every mass to its node."""
    total, out = np.empty(6), np.empty(6)
    for k in range(nodes.size):
        node, m = nodes[k], lumps[k]
        momentum_force(
            m[0], m[0], m[1:4], m[4:].reshape(3, 3), centres[node], frames0[node], frames[node],
            rates0[node], rates[node], gravity, h, total, out,
        )  # fmt: skip
        for i in range(6):
            residual[node, i] += scale * out[i]


@kernel
def step_inertia_tangent(
    nodes: IntArray, lumps: FloatArray, centres: FloatArray, frames0: FloatArray,
    frames: FloatArray, increments: FloatArray, rates0: FloatArray, rates: FloatArray,
    gravity: FloatArray, h: float, rate: float, scale: float, out: FloatArray,
) -> None:  # fmt: skip
    """Write ``scale`` times the derivatives along local twists to ``out`` (k, 6, 6)."""
    for k in range(nodes.size):
        node, m = nodes[k], lumps[k]
        momentum_tangent(
            m[0], m[0], m[1:4], m[4:].reshape(3, 3), centres[node], frames0[node], frames[node],
            increments[node, 3:], rates0[node], rates[node], gravity, h, rate, out[k],
        )  # fmt: skip
        for i in range(6):
            for j in range(6):
                out[k, i, j] *= scale
