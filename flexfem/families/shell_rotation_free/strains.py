# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops of the strains of rotation-free triangles and of their rates.

Notation as in ``tangent_steps``, in scalars: see ``scalars``.
"""

from flexfem._types import FloatArray
from flexfem.families.shell_rotation_free.scalars import axes_of, bent, turn_of, vectors_of
from flexfem.families.shell_rotation_free.tangent_steps import TriangleData
from flexfem.kernels.compiled import fused
from flexfem.kernels.records import Memory, unpack

__all__ = ["strain_rates_into", "strains_into"]


@fused
def strains_into(points: FloatArray, triangles: Memory, strains: FloatArray) -> None:
    """Write the strains (m, 6) at positions (n, 3)."""
    own = unpack(TriangleData, triangles)
    nodes, gradients, curvatures, offsets = own.nodes, own.gradients, own.curvatures, own.offsets
    starts = own.starts
    for m in range(len(nodes)):
        f, k = vectors_of(points, nodes[m], gradients[m], curvatures[m])
        k = bent(k, offsets[m])
        l, g, h, _, _, _, _, _, _, n0, n1, n2 = axes_of(f)  # noqa: E741
        strain, start = strains[m], starts[m]
        strain[0], strain[1], strain[2] = l - start[0], h - start[1], g - start[2]
        for s in range(3):
            x, y, z = k[3 * s], k[3 * s + 1], k[3 * s + 2]
            strain[3 + s] = n0 * x + n1 * y + n2 * z - start[3 + s]


@fused
def strain_rates_into(
    points: FloatArray, velocities: FloatArray, triangles: Memory, rates: FloatArray
) -> None:
    """Write the rates of the strains (m, 6) at velocities (n, 3)."""
    own = unpack(TriangleData, triangles)
    nodes, gradients, curvatures, offsets = own.nodes, own.gradients, own.curvatures, own.offsets
    for m in range(len(nodes)):
        f, k = vectors_of(points, nodes[m], gradients[m], curvatures[m])
        k, axes = bent(k, offsets[m]), axes_of(f)
        n0, n1, n2 = axes[9], axes[10], axes[11]
        change, d = vectors_of(velocities, nodes[m], gradients[m], curvatures[m])
        dl, dh, dg, _, _, _, w0, w1, w2 = turn_of(change, axes)
        rate = rates[m]
        rate[0], rate[1], rate[2] = dl, dh, dg
        for s in range(3):
            x, y, z = k[3 * s], k[3 * s + 1], k[3 * s + 2]
            along = n0 * d[3 * s] + n1 * d[3 * s + 1] + n2 * d[3 * s + 2]
            rate[3 + s] = along + w0 * x + w1 * y + w2 * z
