# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes on which the curvatures of patches converge to a wrong limit."""

import numpy as np

from flexfem._types import FloatArray
from flexfem.mesh.shells.patches import Patches

__all__ = ["moment_imbalance", "moment_sums"]


def moment_sums(patches: Patches, count: int) -> FloatArray:
    """Return sums over triangles for :func:`moment_imbalance`, (n, 11); partial sums add up.

    Args:
        patches: some triangles, each of which is to be counted once.
        count: number of nodes n.
    """
    first, second = patches.axes[:, 0], patches.axes[:, 1]
    mixed = np.einsum("ma,mb->mab", first, second)
    bases = np.stack([
        np.einsum("ma,mb->mab", first, first),
        np.einsum("ma,mb->mab", second, second),
        (mixed + np.swapaxes(mixed, 1, 2)) / 4,
    ], 1)  # fmt: skip
    forces = np.einsum("m,mcab,mci->miab", patches.areas, bases, patches.curvatures)
    incomplete = (patches.nodes < 0).any(1)
    sums = np.zeros((count, 11))
    for i in range(patches.nodes.shape[1]):
        there = patches.nodes[:, i] >= 0
        values = forces[there, i].reshape(-1, 9)
        norms = np.linalg.norm(values, axis=1)
        columns = np.column_stack([values, norms, incomplete[there]])
        np.add.at(sums, patches.nodes[there, i], columns)
    return sums


def moment_imbalance(sums: FloatArray) -> FloatArray:
    """Distance of constant moments from equilibrium at the nodes, between 0 and 1, (n,).

    Forces of constant moments on inner nodes ought to cancel. Where they alternate from node to
    node, the shell evades its bending stiffness by ripples from node to node, and deflections
    converge to a wrong limit. Measured on supported square plates with patches of six nodes, root
    mean square over the inner nodes and limit of the deflection over the exact one: parallel
    diagonals 0 and 1, Delaunay meshes of a mesh generator 0.03 to 0.07 and 1.001, nodes moved at
    random by up to a quarter of the mesh size 0.2 and 1.10, crossed diagonals 0.60 and 1.73,
    alternating ones (union jack) 0.71 and 1.73. With averaged slopes it is 0 on plane meshes.

    It is given as 0 at nodes that belong to a patch at an edge.

    Args:
        sums: ``moment_sums`` of all triangles around the nodes.
    """
    resultant = np.linalg.norm(sums[:, :9], axis=1)
    inner = (sums[:, 9] > 0) & (sums[:, 10] == 0)
    imbalance = np.zeros(len(sums))
    np.divide(resultant, sums[:, 9], out=imbalance, where=inner)
    return imbalance
