# SPDX-License-Identifier: LGPL-3.0-or-later
"""Masses at the nodes of one block over a step that conserves energy."""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.nodes.step_kernels import StepNodes, momentum_force, momentum_tangent
from flexfem.kernels.compiled import kernel
from flexfem.kernels.records import Memory, unpack
from flexfem.lie import so3

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
    at: IntArray, lumps: FloatArray, nodes: Memory, h: float, scale: float
) -> None:
    """Add ``scale`` times mean inertia force minus weight of every mass to its node.

    Args:
        at: (k,) node of each mass.
        lumps: (k, 13) see ``core.nodes.step_kernels.momentum_force``.
        nodes: ``StepNodes``.
        h: step size, s.
        scale: see above.
    """
    own, force = unpack(StepNodes, nodes), np.empty(12)
    residual = own.residual
    for k in range(at.size):
        momentum_force(lumps[k], own, at[k], h, force)
        for i in range(6):
            residual[at[k], i] += scale * force[6 + i]


@kernel
def step_inertia_tangent(
    at: IntArray, lumps: FloatArray, nodes: Memory, h: float, scale: float, out: FloatArray
) -> None:
    """Write the derivatives of :func:`add_step_inertia` along local twists to ``out`` (k, 6, 6)."""
    own = unpack(StepNodes, nodes)
    for k in range(at.size):
        momentum_tangent(lumps[k], own, at[k], h, out[k])
        for i in range(6):
            for j in range(6):
                out[k, i, j] *= scale
