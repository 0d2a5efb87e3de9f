# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loop of the internal forces of rotation-free triangles.

Notation as in ``tangent_steps``, in scalars: see ``scalars``.
"""

from flexfem._types import FloatArray, IntArray
from flexfem.families.shell_rotation_free.scalars import axes_of, bent, stress_of, vectors_of
from flexfem.families.shell_rotation_free.tangent_steps import TriangleData
from flexfem.kernels.compiled import fused
from flexfem.kernels.records import Memory, unpack

__all__ = ["add_forces"]


@fused
def add_forces(
    points: FloatArray, triangles: Memory, sections: IntArray, stiffness: FloatArray,
    given: FloatArray, scale: float, residual: FloatArray,
) -> None:  # fmt: skip
    """Add ``scale`` times the internal forces to the residual (n, 3).

    ``given`` are stress resultants (m, 6) that take the place of stiffness times strain, or none.
    """
    own = unpack(TriangleData, triangles)
    nodes, gradients, curvatures, offsets = own.nodes, own.gradients, own.curvatures, own.offsets
    starts, areas, flat = own.starts, own.areas, own.gradients.shape[2]
    for m in range(len(nodes)):
        near, G, C, start, bend = nodes[m], gradients[m], curvatures[m], starts[m], offsets[m]
        f, k = vectors_of(points, near, G, C)
        k10, k11, k12, k20, k21, k22, k30, k31, k32 = bent(k, bend)
        l, g, h, t0, t1, t2, b0, b1, b2, n0, n1, n2 = axes_of(f)  # noqa: E741
        # stress resultants times the area
        z1 = n0 * k10 + n1 * k11 + n2 * k12
        z2 = n0 * k20 + n1 * k21 + n2 * k22
        z3 = n0 * k30 + n1 * k31 + n2 * k32
        s11, s22, s12, m1, m2, m3 = stress_of(
            stiffness[sections[m]], given, m, scale * areas[m], start, (l, h, g), (z1, z2, z3)
        )
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
            along_n = C[0, i] * m1 + C[1, i] * m2 + C[2, i] * m3
            x, y, z = along_n * n0, along_n * n1, along_n * n2
            if i < flat:
                c, d = G[0, i], G[1, i]
                x, y, z = x + c * f10 + d * f20, y + c * f11 + d * f21, z + c * f12 + d * f22
            residual[node, 0] += x
            residual[node, 1] += y
            residual[node, 2] += z
