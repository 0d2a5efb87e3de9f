# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loop of the tangents of rotation-free triangles times a step.

Notation as in ``tangent_steps``. The forces are differentiated along the step: their
components along the present axes change with strains and stresses, and they turn with the axes, by
their rotation. In scalars: see ``scalars``.
"""

from flexfem._types import FloatArray, IntArray
from flexfem.families.shell_rotation_free.scalars import (
    axes_of,
    bent,
    resultants,
    stress_of,
    turn_of,
    vectors_of,
)
from flexfem.families.shell_rotation_free.tangent_steps import TriangleData
from flexfem.kernels.compiled import fused
from flexfem.kernels.records import Memory, unpack

__all__ = ["add_action"]


@fused
def add_action(
    points: FloatArray, triangles: Memory, sections: IntArray, stiffness: FloatArray,
    given: FloatArray, factors: FloatArray, steps: FloatArray, residual: FloatArray,
) -> None:  # fmt: skip
    """Add the derivatives of the forces, as in ``tangents_into``, times steps (n, 3)."""
    own = unpack(TriangleData, triangles)
    nodes, gradients, curvatures, offsets = own.nodes, own.gradients, own.curvatures, own.offsets
    starts, areas, damping, flat = own.starts, own.areas, own.damping, own.gradients.shape[2]
    for m in range(len(nodes)):
        near, G, C, start, bend = nodes[m], gradients[m], curvatures[m], starts[m], offsets[m]
        f, k = vectors_of(points, near, G, C)
        k10, k11, k12, k20, k21, k22, k30, k31, k32 = bent(k, bend)
        axes = axes_of(f)
        l, g, h, t0, t1, t2, b0, b1, b2, n0, n1, n2 = axes  # noqa: E741
        # changes of f_1, f_2 and d of the k
        f, k = vectors_of(steps, near, G, C)
        d10, d11, d12, d20, d21, d22, d30, d31, d32 = k
        dl, dh, dg, turn_t, turn_b, turn_n, w0, w1, w2 = turn_of(f, axes)
        # the vectors k along the normal, and the changes of that
        z1 = n0 * k10 + n1 * k11 + n2 * k12
        z2 = n0 * k20 + n1 * k21 + n2 * k22
        z3 = n0 * k30 + n1 * k31 + n2 * k32
        e4 = n0 * d10 + n1 * d11 + n2 * d12 + w0 * k10 + w1 * k11 + w2 * k12
        e5 = n0 * d20 + n1 * d21 + n2 * d22 + w0 * k20 + w1 * k21 + w2 * k22
        e6 = n0 * d30 + n1 * d31 + n2 * d32 + w0 * k30 + w1 * k31 + w2 * k32
        # changes of the stress resultants, and those themselves, times the area
        D, area = stiffness[sections[m]], areas[m] * (factors[0] + damping[m] * factors[1])
        e1, e2, e3, e4, e5, e6 = area * dl, area * dh, area * dg, area * e4, area * e5, area * e6
        ds11, ds22, ds12, dm1, dm2, dm3 = resultants(D, e1, e2, e3, e4, e5, e6)
        s11, s22, s12, m1, m2, m3 = stress_of(
            D, given, m, areas[m] * factors[0], start, (l, h, g), (z1, z2, z3)
        )
        # moments times k along t, b, n, and the changes of the first two
        x, y = m1 * k10 + m2 * k20 + m3 * k30, m1 * k11 + m2 * k21 + m3 * k31
        z = m1 * k12 + m2 * k22 + m3 * k32
        along, across = x * t0 + y * t1 + z * t2, x * b0 + y * b1 + z * b2
        normal = x * n0 + y * n1 + z * n2
        x = dm1 * k10 + dm2 * k20 + dm3 * k30 + m1 * d10 + m2 * d20 + m3 * d30
        y = dm1 * k11 + dm2 * k21 + dm3 * k31 + m1 * d11 + m2 * d21 + m3 * d31
        z = dm1 * k12 + dm2 * k22 + dm3 * k32 + m1 * d12 + m2 * d22 + m3 * d32
        dalong = x * t0 + y * t1 + z * t2 + turn_n * across - turn_b * normal
        dacross = x * b0 + y * b1 + z * b2 - turn_n * along + turn_t * normal
        # forces on f_1, f_2 along t, b, n: (s11, turned, c) and (s12, s22, d), and their changes
        turned, d = (h * s12 - g * s22) / l, -across / h
        c = -(along + g * d) / l
        dturned = (dh * s12 + h * ds12 - dg * s22 - g * ds22 - turned * dl) / l
        dd = -(dacross + d * dh) / h
        dc = -(dalong + dg * d + g * dd + c * dl) / l
        x, y = ds11 + turn_b * c - turn_n * turned, dturned + turn_n * s11 - turn_t * c
        z = dc + turn_t * turned - turn_b * s11
        u0, u1 = x * t0 + y * b0 + z * n0, x * t1 + y * b1 + z * n1
        u2 = x * t2 + y * b2 + z * n2
        x, y = ds12 + turn_b * d - turn_n * s22, ds22 + turn_n * s12 - turn_t * d
        z = dd + turn_t * s22 - turn_b * s12
        v0, v1 = x * t0 + y * b0 + z * n0, x * t1 + y * b1 + z * n1
        v2 = x * t2 + y * b2 + z * n2
        for i in range(near.size):
            node = near[i]
            if node < 0:
                continue
            along_w = C[0, i] * m1 + C[1, i] * m2 + C[2, i] * m3
            along_n = C[0, i] * dm1 + C[1, i] * dm2 + C[2, i] * dm3
            x, y = along_w * w0 + along_n * n0, along_w * w1 + along_n * n1
            z = along_w * w2 + along_n * n2
            if i < flat:
                c, d = G[0, i], G[1, i]
                x, y, z = x + c * u0 + d * v0, y + c * u1 + d * v1, z + c * u2 + d * v2
            residual[node, 0] += x
            residual[node, 1] += y
            residual[node, 2] += z
