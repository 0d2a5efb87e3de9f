# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dependence of rotation-free triangles on positions, in steps of compiled loops.

What the energy of ``forms.shell`` depends on are five vectors ``w_s = sum over nodes of W_sI q_I``:
the derivatives ``f_1, f_2`` and the curvature vectors ``k`` (to which clamps add a given part).
Derivatives are those of the first three nodes, or smoothed ones of the first six. The
work is done in the present axes of the triangle: t along f_1, b in the triangle, n its normal, in
which ``f_1 = (l, 0, 0)`` and ``f_2 = (g, h, 0)``. Then with changes x, y, z of the vectors along
t, b, n

    d eps_11 = x_1,  d eps_22 = y_2 - g/l y_1,  d gamma_12 = x_2 + h/l y_1,
    d n = -(p_1 z_1 + p_2 z_2),   p_1 = (1/l, -g/(l h)),  p_2 = (0, 1/h),

``p_a`` being the dual vectors of ``f_a``, along t and b.
"""

import numpy as np

from flexfem._types import FloatArray, IndexArray
from flexfem.kernels.compiled import inlined
from flexfem.kernels.records import Float1D, Float2D, Float3D, Index2D, Record

__all__ = [
    "TriangleData",
    "along_axes",
    "dual_into",
    "present_axes",
    "strain_into",
    "stress_into",
    "vectors_into",
]


class TriangleData(Record):
    """Constant data of rotation-free triangles whose patches have p nodes.

    Attributes:
        nodes: (m, p) nodes, -1 for missing ones.
        gradients: (m, 2, 3 or 6) weights of the first of them in f_1 and f_2.
        curvatures: (m, 3, p) weights of all in the k.
        offsets: (m, 3, 3) what clamps add to the k, 1/m.
        starts: (m, 6) what counts as no strain.
        areas: (m,) m^2.
        damping: (m,) stiffness-proportional, s.
    """

    nodes: Index2D
    gradients: Float3D
    curvatures: Float3D
    offsets: Float3D
    starts: Float2D
    areas: Float1D
    damping: Float1D


@inlined
def vectors_into(
    points: FloatArray, nodes: IndexArray, gradients: FloatArray, curvatures: FloatArray,
    offset: FloatArray, w: FloatArray,
) -> None:  # fmt: skip
    """Write the five vectors (5, 3), relative to node 0: no digits are lost far from the origin."""
    base = nodes[0]
    for a in range(3):
        w[0, a] = w[1, a] = 0.0
        for s in range(3):
            w[2 + s, a] = offset[s, a]
    for i in range(1, nodes.size):
        if nodes[i] >= 0:
            for a in range(3):
                q = points[nodes[i], a] - points[base, a]
                if i < gradients.shape[1]:
                    w[0, a] += gradients[0, i] * q
                    w[1, a] += gradients[1, i] * q
                for s in range(3):
                    w[2 + s, a] += curvatures[s, i] * q


@inlined
def present_axes(w: FloatArray, axes: FloatArray, local: FloatArray) -> None:
    """Write the present axes t, b, n (3, 3) and the five vectors along them (5, 3)."""
    axes[0] = w[0] / np.sqrt(w[0, 0] ** 2 + w[0, 1] ** 2 + w[0, 2] ** 2)
    g = w[1, 0] * axes[0, 0] + w[1, 1] * axes[0, 1] + w[1, 2] * axes[0, 2]
    for a in range(3):
        axes[1, a] = w[1, a] - g * axes[0, a]
    h = np.sqrt(axes[1, 0] ** 2 + axes[1, 1] ** 2 + axes[1, 2] ** 2)
    for a in range(3):
        axes[1, a] /= h
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        axes[2, a] = axes[0, b] * axes[1, c] - axes[0, c] * axes[1, b]
    along_axes(w, axes, local)


@inlined
def along_axes(w: FloatArray, axes: FloatArray, local: FloatArray) -> None:
    """Write the components of five vectors along the axes (5, 3)."""
    for s in range(5):
        for a in range(3):
            local[s, a] = w[s, 0] * axes[a, 0] + w[s, 1] * axes[a, 1] + w[s, 2] * axes[a, 2]


@inlined
def strain_into(local: FloatArray, start: FloatArray, strain: FloatArray) -> None:
    """Write the strains (6,)."""
    strain[0], strain[1] = local[0, 0] - start[0], local[1, 1] - start[1]
    strain[2] = local[1, 0] - start[2]
    for s in range(3):
        strain[3 + s] = local[2 + s, 2] - start[3 + s]


@inlined
def stress_into(
    D: FloatArray, given: FloatArray, m: int, area: float, strain: FloatArray, stress: FloatArray
) -> None:
    """Write the stress resultants (6,) times the area: those given (m, 6), if there are any."""
    for i in range(6):
        stress[i] = 0.0
        if len(given):
            stress[i] = area * given[m, i]
            continue
        for j in range(6):
            stress[i] += area * D[i, j] * strain[j]


@inlined
def dual_into(local: FloatArray, p: FloatArray) -> None:
    """Write the dual vectors (2, 2) of f_1 and f_2 along t and b."""
    p[0, 0], p[1, 0], p[1, 1] = 1 / local[0, 0], 0.0, 1 / local[1, 1]
    p[0, 1] = -local[1, 0] * p[0, 0] * p[1, 1]
