# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled products of small matrices at nodes with the nodes' steps."""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.kernels.compiled import kernel

__all__ = ["add_products", "add_turning_forces", "subtract_forces"]


@kernel
def add_products(
    matrices: FloatArray, nodes: IntArray, steps: FloatArray, factor: float, residual: FloatArray
) -> None:
    """Add ``factor`` times matrices (k, 6, 6) times the steps of their nodes (k,)."""
    for k in range(nodes.size):
        for i in range(6):
            total = 0.0
            for j in range(6):
                total += matrices[k, i, j] * steps[nodes[k], j]
            residual[nodes[k], i] += factor * total


@kernel
def add_turning_forces(
    hessians: FloatArray, pair_nodes: IntArray, steps: FloatArray, out: FloatArray
) -> None:
    """Add ``hessians`` (p, 12, 12) times the steps of pairs of nodes (p, 2), -1 for the ground."""
    along = np.empty(12)
    for p in range(pair_nodes.shape[0]):
        for side in range(2):
            node = pair_nodes[p, side]
            for i in range(6):
                along[6 * side + i] = steps[node, i] if node >= 0 else 0.0
        for side in range(2):
            node = pair_nodes[p, side]
            if node < 0:
                continue
            for i in range(6):
                for j in range(12):
                    out[node, i] += hessians[p, 6 * side + i, j] * along[j]


@kernel
def subtract_forces(forces: FloatArray, local: IntArray, residual: FloatArray) -> None:
    """Subtract forces of nodes (n, 6) at nodes ``local[node]`` of a block (-1: another block)."""
    for node in range(local.size):
        if local[node] >= 0:
            for i in range(6):
                residual[local[node], i] -= forces[node, i]
