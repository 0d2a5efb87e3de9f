# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loop of the internal forces of rotation-free triangles.

Notation as in ``rotation_free_loops``, in scalars: see ``rotation_free_scalars``.
"""

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.elements.rotation_free_scalars import axes_of, resultants, vectors_of
from flexfem.lie.compiled import fused

__all__ = ["add_forces"]


@fused
def add_forces(
    points: FloatArray, nodes: IndexArray, gradients: FloatArray, curvatures: FloatArray,
    offsets: FloatArray, starts: FloatArray, areas: FloatArray, sections: IntArray,
    stiffness: FloatArray, given: FloatArray, scale: float, residual: FloatArray,
) -> None:  # fmt: skip
    """Add ``scale`` times the internal forces to the residual (n, 3).

    ``given`` are stress resultants (m, 6) that take the place of stiffness times strain, or none.
    """
    flat = gradients.shape[2]
    for m in range(len(nodes)):
        near, G, C, start, bend = nodes[m], gradients[m], curvatures[m], starts[m], offsets[m]
        f, k = vectors_of(points, near, G, C)
        k10, k11, k12 = k[0] + bend[0, 0], k[1] + bend[0, 1], k[2] + bend[0, 2]
        k20, k21, k22 = k[3] + bend[1, 0], k[4] + bend[1, 1], k[5] + bend[1, 2]
        k30, k31, k32 = k[6] + bend[2, 0], k[7] + bend[2, 1], k[8] + bend[2, 2]
        l, g, h, t0, t1, t2, b0, b1, b2, n0, n1, n2 = axes_of(f)  # noqa: E741
        # stress resultants times the area
        area = scale * areas[m]
        if len(given):
            s = given[m]
            s11, s22, s12 = area * s[0], area * s[1], area * s[2]
            m1, m2, m3 = area * s[3], area * s[4], area * s[5]
        else:
            D = stiffness[sections[m]]
            e1, e2 = area * (l - start[0]), area * (h - start[1])
            e3 = area * (g - start[2])
            e4 = area * (n0 * k10 + n1 * k11 + n2 * k12 - start[3])
            e5 = area * (n0 * k20 + n1 * k21 + n2 * k22 - start[4])
            e6 = area * (n0 * k30 + n1 * k31 + n2 * k32 - start[5])
            s11, s22, s12, m1, m2, m3 = resultants(D, e1, e2, e3, e4, e5, e6)
        # what is dual to f_1 and f_2
        x, y = m1 * k10 + m2 * k20 + m3 * k30, m1 * k11 + m2 * k21 + m3 * k31
        z = m1 * k12 + m2 * k22 + m3 * k32
        along, across = x * t0 + y * t1 + z * t2, x * b0 + y * b1 + z * b2
        turned, c, d = (h * s12 - g * s22) / l, (g / h * across - along) / l, -across / h
        f10, f11 = s11 * t0 + turned * b0 + c * n0, s11 * t1 + turned * b1 + c * n1
        f12 = s11 * t2 + turned * b2 + c * n2
        f20, f21 = s12 * t0 + s22 * b0 + d * n0, s12 * t1 + s22 * b1 + d * n1
        f22 = s12 * t2 + s22 * b2 + d * n2
        for i in range(near.size):
            node = near[i]
            if node < 0:
                continue
            bent = C[0, i] * m1 + C[1, i] * m2 + C[2, i] * m3
            x, y, z = bent * n0, bent * n1, bent * n2
            if i < flat:
                c, d = G[0, i], G[1, i]
                x, y, z = x + c * f10 + d * f20, y + c * f11 + d * f21, z + c * f12 + d * f22
            residual[node, 0] += x
            residual[node, 1] += y
            residual[node, 2] += z
