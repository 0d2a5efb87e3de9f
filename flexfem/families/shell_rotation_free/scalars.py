# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps of the loops over rotation-free triangles in scalars.

Notation as in ``tangent_steps``. Loops over forces, actions and rates are most of the cost of
explicit relaxation and of refined iterations, and arrays of work space, which might overlap others
for all that a compiler knows, would more than double it.
"""

import math

from flexfem._types import FloatArray, IndexArray
from flexfem.kernels.compiled import inlined_fused

__all__ = ["axes_of", "bent", "resultants", "stress_of", "turn_of", "vectors_of"]


@inlined_fused
def vectors_of(
    points: FloatArray, near: IndexArray, G: FloatArray, C: FloatArray
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """f_1 and f_2, and the three k without what clamps add: 6 and 9 components.

    Relative to node 0, so that no digits are lost far from the origin.
    """
    base, flat = near[0], G.shape[1]
    f10 = f11 = f12 = f20 = f21 = f22 = 0.0
    k10 = k11 = k12 = k20 = k21 = k22 = k30 = k31 = k32 = 0.0
    for i in range(1, near.size):
        node = near[i]
        if node < 0:
            continue
        x = points[node, 0] - points[base, 0]
        y = points[node, 1] - points[base, 1]
        z = points[node, 2] - points[base, 2]
        if i < flat:
            c, d = G[0, i], G[1, i]
            f10, f11, f12 = f10 + c * x, f11 + c * y, f12 + c * z
            f20, f21, f22 = f20 + d * x, f21 + d * y, f22 + d * z
        c, d, e = C[0, i], C[1, i], C[2, i]
        k10, k11, k12 = k10 + c * x, k11 + c * y, k12 + c * z
        k20, k21, k22 = k20 + d * x, k21 + d * y, k22 + d * z
        k30, k31, k32 = k30 + e * x, k31 + e * y, k32 + e * z
    return (f10, f11, f12, f20, f21, f22), (k10, k11, k12, k20, k21, k22, k30, k31, k32)


@inlined_fused
def axes_of(f: tuple[float, ...]) -> tuple[float, ...]:
    """Components l, g, h of f_1 and f_2 and the present axes t, b, n."""
    f10, f11, f12, f20, f21, f22 = f
    l = math.sqrt(f10 * f10 + f11 * f11 + f12 * f12)  # noqa: E741
    t0, t1, t2 = f10 / l, f11 / l, f12 / l
    g = f20 * t0 + f21 * t1 + f22 * t2
    b0, b1, b2 = f20 - g * t0, f21 - g * t1, f22 - g * t2
    h = math.sqrt(b0 * b0 + b1 * b1 + b2 * b2)
    b0, b1, b2 = b0 / h, b1 / h, b2 / h
    n0, n1, n2 = t1 * b2 - t2 * b1, t2 * b0 - t0 * b2, t0 * b1 - t1 * b0
    return l, g, h, t0, t1, t2, b0, b1, b2, n0, n1, n2


@inlined_fused
def bent(k: tuple[float, ...], bend: FloatArray) -> tuple[float, ...]:
    """The three k with what clamps add, (3, 3)."""
    return (
        k[0] + bend[0, 0], k[1] + bend[0, 1], k[2] + bend[0, 2],
        k[3] + bend[1, 0], k[4] + bend[1, 1], k[5] + bend[1, 2],
        k[6] + bend[2, 0], k[7] + bend[2, 1], k[8] + bend[2, 2],
    )  # fmt: skip


@inlined_fused
def turn_of(change: tuple[float, ...], axes: tuple[float, ...]) -> tuple[float, ...]:
    """Effect of changes of f_1 and f_2, with what :func:`axes_of` returns.

    Returns:
        Changes of l, h and g, rotation of the axes about t, b, n, change of the normal.
    """
    u0, u1, u2, v0, v1, v2 = change
    l, g, h, t0, t1, t2, b0, b1, b2, n0, n1, n2 = axes  # noqa: E741
    y, z = u0 * b0 + u1 * b1 + u2 * b2, u0 * n0 + u1 * n1 + u2 * n2
    turn_n, turn_b = y / l, -z / l
    turn_t = (v0 * n0 + v1 * n1 + v2 * n2 + g * turn_b) / h
    w0, w1 = turn_b * t0 - turn_t * b0, turn_b * t1 - turn_t * b1
    w2 = turn_b * t2 - turn_t * b2
    dl = u0 * t0 + u1 * t1 + u2 * t2
    dh = v0 * b0 + v1 * b1 + v2 * b2 - g * turn_n
    dg = v0 * t0 + v1 * t1 + v2 * t2 + h * turn_n
    return dl, dh, dg, turn_t, turn_b, turn_n, w0, w1, w2


@inlined_fused
def _row(
    D: FloatArray, i: int, e1: float, e2: float, e3: float, e4: float, e5: float, e6: float
) -> float:
    membrane, bent = D[i, 0] * e1 + D[i, 1] * e2 + D[i, 2] * e3, D[i, 3] * e4 + D[i, 4] * e5
    return float(membrane + bent + D[i, 5] * e6)


@inlined_fused
def resultants(
    D: FloatArray, e1: float, e2: float, e3: float, e4: float, e5: float, e6: float
) -> tuple[float, ...]:
    """Stiffness times strains: n_11, n_22, n_12, m_11, m_22, m_12."""
    return (
        _row(D, 0, e1, e2, e3, e4, e5, e6),
        _row(D, 1, e1, e2, e3, e4, e5, e6),
        _row(D, 2, e1, e2, e3, e4, e5, e6),
        _row(D, 3, e1, e2, e3, e4, e5, e6),
        _row(D, 4, e1, e2, e3, e4, e5, e6),
        _row(D, 5, e1, e2, e3, e4, e5, e6),
    )


@inlined_fused
def stress_of(
    D: FloatArray, given: FloatArray, m: int, area: float, start: FloatArray,
    stretches: tuple[float, float, float], bends: tuple[float, float, float],
) -> tuple[float, ...]:  # fmt: skip
    """Stress resultants times the area: those given (m, 6), if there are any."""
    if len(given):
        s = given[m]
        return area * s[0], area * s[1], area * s[2], area * s[3], area * s[4], area * s[5]
    (l, h, g), (z1, z2, z3) = stretches, bends  # noqa: E741
    return resultants(
        D,
        area * (l - start[0]), area * (h - start[1]), area * (g - start[2]),
        area * (z1 - start[3]), area * (z2 - start[4]), area * (z3 - start[5]),
    )  # fmt: skip
