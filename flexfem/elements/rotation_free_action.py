# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loop of the tangents of rotation-free triangles times a step.

Notation as in ``rotation_free_loops``. The forces are differentiated along the step: their
components along the present axes change with strains and stresses, and they turn with the axes, by
the rotation ``omega``. Written in scalars for the reason given in ``rotation_free_forces``.
"""

import math

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.elements.rotation_free_forces import row
from flexfem.lie.compiled import fused

__all__ = ["add_action"]


@fused
def add_action(
    points: FloatArray, nodes: IndexArray, gradients: FloatArray, curvatures: FloatArray,
    offsets: FloatArray, starts: FloatArray, areas: FloatArray, sections: IntArray,
    stiffness: FloatArray, given: FloatArray, factors: FloatArray, damping: FloatArray,
    steps: FloatArray, residual: FloatArray,
) -> None:  # fmt: skip
    """Add the derivatives of the forces, as in ``tangents_into``, times steps (n, 3)."""
    flat = gradients.shape[2]
    for m in range(len(nodes)):
        near, G, C, start, bend = nodes[m], gradients[m], curvatures[m], starts[m], offsets[m]
        base = near[0]
        # f_1, f_2 and the three k, and their changes u, v and d, relative to node 0
        f10 = f11 = f12 = f20 = f21 = f22 = 0.0
        k10, k11, k12 = bend[0, 0], bend[0, 1], bend[0, 2]
        k20, k21, k22 = bend[1, 0], bend[1, 1], bend[1, 2]
        k30, k31, k32 = bend[2, 0], bend[2, 1], bend[2, 2]
        u0 = u1 = u2 = v0 = v1 = v2 = 0.0
        d10 = d11 = d12 = d20 = d21 = d22 = d30 = d31 = d32 = 0.0
        for i in range(1, near.size):
            node = near[i]
            if node < 0:
                continue
            x = points[node, 0] - points[base, 0]
            y = points[node, 1] - points[base, 1]
            z = points[node, 2] - points[base, 2]
            p = steps[node, 0] - steps[base, 0]
            q = steps[node, 1] - steps[base, 1]
            r = steps[node, 2] - steps[base, 2]
            if i < flat:
                c, d = G[0, i], G[1, i]
                f10, f11, f12 = f10 + c * x, f11 + c * y, f12 + c * z
                f20, f21, f22 = f20 + d * x, f21 + d * y, f22 + d * z
                u0, u1, u2 = u0 + c * p, u1 + c * q, u2 + c * r
                v0, v1, v2 = v0 + d * p, v1 + d * q, v2 + d * r
            c, d, e = C[0, i], C[1, i], C[2, i]
            k10, k11, k12 = k10 + c * x, k11 + c * y, k12 + c * z
            k20, k21, k22 = k20 + d * x, k21 + d * y, k22 + d * z
            k30, k31, k32 = k30 + e * x, k31 + e * y, k32 + e * z
            d10, d11, d12 = d10 + c * p, d11 + c * q, d12 + c * r
            d20, d21, d22 = d20 + d * p, d21 + d * q, d22 + d * r
            d30, d31, d32 = d30 + e * p, d31 + e * q, d32 + e * r
        # present axes t, b, n
        l = math.sqrt(f10 * f10 + f11 * f11 + f12 * f12)  # noqa: E741
        t0, t1, t2 = f10 / l, f11 / l, f12 / l
        g = f20 * t0 + f21 * t1 + f22 * t2
        b0, b1, b2 = f20 - g * t0, f21 - g * t1, f22 - g * t2
        h = math.sqrt(b0 * b0 + b1 * b1 + b2 * b2)
        b0, b1, b2 = b0 / h, b1 / h, b2 / h
        n0, n1, n2 = t1 * b2 - t2 * b1, t2 * b0 - t0 * b2, t0 * b1 - t1 * b0
        # their rotation, what it makes of the normal, and the changes of l, h and g
        y, z = u0 * b0 + u1 * b1 + u2 * b2, u0 * n0 + u1 * n1 + u2 * n2
        turn_n, turn_b = y / l, -z / l
        turn_t = (v0 * n0 + v1 * n1 + v2 * n2 + g * turn_b) / h
        w0, w1 = turn_b * t0 - turn_t * b0, turn_b * t1 - turn_t * b1
        w2 = turn_b * t2 - turn_t * b2
        dl = u0 * t0 + u1 * t1 + u2 * t2
        dh = v0 * b0 + v1 * b1 + v2 * b2 - g * turn_n
        dg = v0 * t0 + v1 * t1 + v2 * t2 + h * turn_n
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
        ds11 = row(D, 0, e1, e2, e3, e4, e5, e6)
        ds22 = row(D, 1, e1, e2, e3, e4, e5, e6)
        ds12 = row(D, 2, e1, e2, e3, e4, e5, e6)
        dm1 = row(D, 3, e1, e2, e3, e4, e5, e6)
        dm2 = row(D, 4, e1, e2, e3, e4, e5, e6)
        dm3 = row(D, 5, e1, e2, e3, e4, e5, e6)
        area = areas[m] * factors[0]
        if len(given):
            s = given[m]
            s11, s22, s12 = area * s[0], area * s[1], area * s[2]
            m1, m2, m3 = area * s[3], area * s[4], area * s[5]
        else:
            e1, e2, e3 = area * (l - start[0]), area * (h - start[1]), area * (g - start[2])
            e4, e5, e6 = area * (z1 - start[3]), area * (z2 - start[4]), area * (z3 - start[5])
            s11 = row(D, 0, e1, e2, e3, e4, e5, e6)
            s22 = row(D, 1, e1, e2, e3, e4, e5, e6)
            s12 = row(D, 2, e1, e2, e3, e4, e5, e6)
            m1 = row(D, 3, e1, e2, e3, e4, e5, e6)
            m2 = row(D, 4, e1, e2, e3, e4, e5, e6)
            m3 = row(D, 5, e1, e2, e3, e4, e5, e6)
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
            bent = C[0, i] * m1 + C[1, i] * m2 + C[2, i] * m3
            more = C[0, i] * dm1 + C[1, i] * dm2 + C[2, i] * dm3
            x, y, z = bent * w0 + more * n0, bent * w1 + more * n1, bent * w2 + more * n2
            if i < flat:
                c, d = G[0, i], G[1, i]
                x, y, z = x + c * u0 + d * v0, y + c * u1 + d * v1, z + c * u2 + d * v2
            residual[node, 0] += x
            residual[node, 1] += y
            residual[node, 2] += z
