# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops of the strains of rotation-free triangles and of their rates.

Notation as in ``rotation_free_loops``, in scalars: see ``rotation_free_scalars``.
"""

from flexfem._types import FloatArray, IndexArray
from flexfem.elements.rotation_free_scalars import axes_of, vectors_of
from flexfem.lie.compiled import fused

__all__ = ["strain_rates_into", "strains_into"]


@fused
def strains_into(
    points: FloatArray, nodes: IndexArray, gradients: FloatArray, curvatures: FloatArray,
    offsets: FloatArray, starts: FloatArray, strains: FloatArray,
) -> None:  # fmt: skip
    """Write the strains (m, 6) at positions (n, 3)."""
    for m in range(len(nodes)):
        f, k = vectors_of(points, nodes[m], gradients[m], curvatures[m])
        l, g, h, _, _, _, _, _, _, n0, n1, n2 = axes_of(f)  # noqa: E741
        strain, start, bend = strains[m], starts[m], offsets[m]
        strain[0], strain[1], strain[2] = l - start[0], h - start[1], g - start[2]
        for s in range(3):
            x, y, z = k[3 * s] + bend[s, 0], k[3 * s + 1] + bend[s, 1], k[3 * s + 2] + bend[s, 2]
            strain[3 + s] = n0 * x + n1 * y + n2 * z - start[3 + s]


@fused
def strain_rates_into(
    points: FloatArray, velocities: FloatArray, nodes: IndexArray, gradients: FloatArray,
    curvatures: FloatArray, offsets: FloatArray, rates: FloatArray,
) -> None:  # fmt: skip
    """Write the rates of the strains (m, 6) at velocities (n, 3)."""
    for m in range(len(nodes)):
        f, k = vectors_of(points, nodes[m], gradients[m], curvatures[m])
        l, g, h, t0, t1, t2, b0, b1, b2, n0, n1, n2 = axes_of(f)  # noqa: E741
        change, d = vectors_of(velocities, nodes[m], gradients[m], curvatures[m])
        u0, u1, u2, v0, v1, v2 = change
        # rotation of the axes, and what it makes of the normal
        turn_n, turn_b = (u0 * b0 + u1 * b1 + u2 * b2) / l, -(u0 * n0 + u1 * n1 + u2 * n2) / l
        turn_t = (v0 * n0 + v1 * n1 + v2 * n2 + g * turn_b) / h
        w0, w1 = turn_b * t0 - turn_t * b0, turn_b * t1 - turn_t * b1
        w2 = turn_b * t2 - turn_t * b2
        rate, bend = rates[m], offsets[m]
        rate[0] = u0 * t0 + u1 * t1 + u2 * t2
        rate[1] = v0 * b0 + v1 * b1 + v2 * b2 - g * turn_n
        rate[2] = v0 * t0 + v1 * t1 + v2 * t2 + h * turn_n
        for s in range(3):
            x, y, z = k[3 * s] + bend[s, 0], k[3 * s + 1] + bend[s, 1], k[3 * s + 2] + bend[s, 2]
            along = n0 * d[3 * s] + n1 * d[3 * s + 1] + n2 * d[3 * s + 2]
            rate[3 + s] = along + w0 * x + w1 * y + w2 * z
