# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loop over rotation-free triangles: tangents.

Notation as in ``tangent_steps``.
"""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.families.shell_rotation_free.tangent_steps import (
    TriangleData,
    dual_into,
    present_axes,
    strain_into,
    stress_into,
    vectors_into,
)
from flexfem.kernels.compiled import inlined, kernel
from flexfem.kernels.records import Memory, unpack

__all__ = ["tangents_into"]


@inlined
def _membrane(
    local: FloatArray, stress: FloatArray, D: FloatArray, area: float, H: FloatArray
) -> None:
    """Write the derivatives among x_1, y_1, x_2, y_2, (4, 4)."""
    l, g, h = local[0, 0], local[1, 0], local[1, 1]  # noqa: E741
    for i in range(4):
        # change of the strains along each of the four
        a0, a1, a2 = 0.0, 0.0, 0.0
        if i == 0:
            a0 = 1.0
        elif i == 1:
            a1, a2 = -g / l, h / l
        elif i == 2:
            a2 = 1.0
        else:
            a1 = 1.0
        s0 = area * (D[0, 0] * a0 + D[0, 1] * a1 + D[0, 2] * a2)
        s1 = area * (D[1, 0] * a0 + D[1, 1] * a1 + D[1, 2] * a2)
        s2 = area * (D[2, 0] * a0 + D[2, 1] * a1 + D[2, 2] * a2)
        H[i, 0], H[i, 1], H[i, 2], H[i, 3] = s0, (h * s2 - g * s1) / l, s2, s1
    turned = (h * stress[2] - g * stress[1]) / l
    H[0, 1] -= turned / l
    H[1, 0] -= turned / l
    H[1, 2] -= stress[1] / l
    H[2, 1] -= stress[1] / l
    H[1, 3] += stress[2] / l
    H[3, 1] += stress[2] / l
    H[1, 1] += (stress[0] - (g * stress[2] + h * stress[1]) / l) / l


@inlined
def _bending(
    local: FloatArray, p: FloatArray, stress: FloatArray, D: FloatArray, area: float,
    c: FloatArray, H: FloatArray,
) -> None:  # fmt: skip
    """Write the change of the curvatures along the z (3, 5) and the derivatives among the z (5, 5).

    Not among the z of the k alone, where the derivative is D_b times the area.
    """
    l, g, h = local[0, 0], local[1, 0], local[1, 1]  # noqa: E741
    mn = 0.0
    for s in range(3):
        mn += stress[3 + s] * local[2 + s, 2]
        for a in range(2):
            c[s, a] = -(p[a, 0] * local[2 + s, 0] + p[a, 1] * local[2 + s, 1])
        for r in range(3):
            c[s, 2 + r] = 1.0 if r == s else 0.0
    for i in range(5):
        for j in range(5):
            H[i, j] = 0.0
            for s in range(3):
                for r in range(3):
                    H[i, j] += area * c[s, i] * D[3 + s, 3 + r] * c[r, j]
    for a in range(2):
        for b in range(2):
            H[a, b] -= mn * (p[a, 0] * p[b, 0] + p[a, 1] * p[b, 1])
    turned = (h * stress[2] - g * stress[1]) / l
    H[0, 0] += (stress[0] - turned * g / h) / l
    H[0, 1] += turned / h
    H[1, 0] += turned / h
    H[1, 1] += stress[1] / h


@inlined
def _coupling(
    local: FloatArray, p: FloatArray, stress: FloatArray, D: FloatArray, area: float,
    c: FloatArray, H: FloatArray,
) -> None:  # fmt: skip
    """Write the derivatives of the x (0) and y (1) of five vectors by their z, (2, 5, 5)."""
    l, g, h = local[0, 0], local[1, 0], local[1, 1]  # noqa: E741
    H[:] = 0.0
    for t in range(5):
        s0 = s1 = s2 = 0.0
        for s in range(3):
            s0 += area * D[0, 3 + s] * c[s, t]
            s1 += area * D[1, 3 + s] * c[s, t]
            s2 += area * D[2, 3 + s] * c[s, t]
        H[0, 0, t], H[1, 0, t], H[0, 1, t], H[1, 1, t] = s0, (h * s2 - g * s1) / l, s2, s1
    for a in range(2):
        along = 0.0
        for s in range(3):
            along -= c[s, a] * stress[3 + s]
        for b in range(2):
            for i in range(2):
                H[i, a, b] += along * p[b, i]
                for s in range(3):
                    H[i, 2 + s, b] = -stress[3 + s] * p[b, i]


@inlined
def _product(
    W: FloatArray, H: FloatArray, flat: int, outer: bool, T: FloatArray, K: FloatArray
) -> None:
    """Write ``W^T H W`` (p, p) for W (5, p); T is of the size of W.

    Without ``outer``, not between nodes of neighbours.
    """
    count = W.shape[1]
    for s in range(5):
        for j in range(count):
            T[s, j] = H[s, 0] * W[0, j] + H[s, 1] * W[1, j]
            T[s, j] += H[s, 2] * W[2, j] + H[s, 3] * W[3, j] + H[s, 4] * W[4, j]
    for i in range(flat):
        for j in range(count):
            K[i, j] = W[0, i] * T[0, j] + W[1, i] * T[1, j]
            K[i, j] += W[2, i] * T[2, j] + W[3, i] * T[3, j] + W[4, i] * T[4, j]
    for i in range(flat, count):
        for j in range(count if outer else flat):
            K[i, j] = W[2, i] * T[2, j] + W[3, i] * T[3, j] + W[4, i] * T[4, j]


@inlined
def _own(
    W: FloatArray, H: FloatArray, skew: FloatArray, normal: FloatArray, flat: int, i: int, j: int,
    block: FloatArray,
) -> None:  # fmt: skip
    """Write the derivative of the force on own node i by node j along t, b, n, (3, 3)."""
    for a in range(2):
        for b in range(2):
            block[a, b] = 0.0
            if j < flat:
                for s in range(2):
                    for t in range(2):
                        block[a, b] += W[s, i] * H[2 * s + a, 2 * t + b] * W[t, j]
        block[a, 2], block[2, a] = skew[a, i, j], skew[a, j, i]
    block[2, 2] = normal[i, j]


@inlined
def _put(axes: FloatArray, block: FloatArray, i: int, j: int, K: FloatArray) -> None:
    """Write a block, turned from the present axes, and its transpose to K (3 p, 3 p)."""
    for b in range(3):
        v0 = block[0, 0] * axes[0, b] + block[0, 1] * axes[1, b] + block[0, 2] * axes[2, b]
        v1 = block[1, 0] * axes[0, b] + block[1, 1] * axes[1, b] + block[1, 2] * axes[2, b]
        v2 = block[2, 0] * axes[0, b] + block[2, 1] * axes[1, b] + block[2, 2] * axes[2, b]
        for a in range(3):
            value = axes[0, a] * v0 + axes[1, a] * v1 + axes[2, a] * v2
            K[3 * i + a, 3 * j + b] = value
            K[3 * j + b, 3 * i + a] = value


@inlined
def _put_all(
    axes: FloatArray, W: FloatArray, H: FloatArray, skew: FloatArray, normal: FloatArray,
    flat: int, block: FloatArray, K: FloatArray,
) -> None:  # fmt: skip
    """Write a tangent (3 p, 3 p)."""
    count = W.shape[1]
    for i in range(flat):
        for j in range(i, count):
            _own(W, H, skew, normal, flat, i, j, block)
            _put(axes, block, i, j, K)
    # nodes of neighbours bend the triangle only
    for a in range(3):
        for b in range(3):
            block[a, b] = axes[2, a] * axes[2, b]
    for i in range(flat, count):
        for a in range(3):
            for j in range(flat, count):
                for b in range(3):
                    K[3 * i + a, 3 * j + b] = normal[i, j] * block[a, b]


@kernel
def tangents_into(
    points: FloatArray, triangles: Memory, sections: IntArray, stiffness: FloatArray,
    given: FloatArray, factors: FloatArray, first: int, tangents: FloatArray,
) -> None:  # fmt: skip
    """Write the derivatives of the forces, (r, 3 p, 3 p), of r triangles.

    ``factors`` (2,) are those of the derivatives by positions and by velocities. What the turning
    of the axes changes in strain rates is left out, a part of the order of damping times angular
    velocity.
    """
    own = unpack(TriangleData, triangles)
    nodes, gradients, curvatures, offsets = own.nodes, own.gradients, own.curvatures, own.offsets
    starts, areas, damping = own.starts, own.areas, own.damping
    count, inner = nodes.shape[1], gradients.shape[2]
    w, axes, local, block = np.empty((5, 3)), np.empty((3, 3)), np.empty((5, 3)), np.empty((3, 3))
    strain, stress, p, c = np.empty(6), np.empty(6), np.empty((2, 2)), np.empty((3, 5))
    flat, bent, mixed = np.empty((4, 4)), np.empty((5, 5)), np.empty((2, 5, 5))
    W, T = np.zeros((5, count)), np.empty((5, count))
    skew, normal = np.empty((2, count, count)), np.empty((count, count))
    for m in range(first, first + len(tangents)):
        vectors_into(points, nodes[m], gradients[m], curvatures[m], offsets[m], w)
        present_axes(w, axes, local)
        strain_into(local, starts[m], strain)
        D, area = stiffness[sections[m]], areas[m]
        stress_into(D, given, m, factors[0] * area, strain, stress)
        dual_into(local, p)
        # second derivatives of the energy by the five vectors
        area *= factors[0] + damping[m] * factors[1]
        _membrane(local, stress, D, area, flat)
        _bending(local, p, stress, D, area, c, bent)
        _coupling(local, p, stress, D, area, c, mixed)
        W[:2, :inner], W[2:] = gradients[m], curvatures[m]
        _product(W, bent, inner, True, T, normal)
        for a in range(2):
            _product(W, mixed[a], inner, False, T, skew[a])
        _put_all(axes, W, flat, skew, normal, inner, block, tangents[m - first])
