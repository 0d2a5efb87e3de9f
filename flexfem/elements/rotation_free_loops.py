# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops over rotation-free triangles: strains, internal forces, tangents.

What the energy of ``forms.shell`` depends on are five vectors ``w_s = sum over nodes of W_sI q_I``:
the derivatives ``f_1, f_2`` and the curvature vectors ``k`` (to which clamps add a given part). The
work is done in the present axes of the triangle: t along f_1, b in the triangle, n its normal, in
which ``f_1 = (l, 0, 0)`` and ``f_2 = (g, h, 0)``. Then with changes x, y, z of the vectors along
t, b, n

    d eps_11 = x_1,  d eps_22 = y_2 - g/l y_1,  d gamma_12 = x_2 + h/l y_1,
    d n = -(p_1 z_1 + p_2 z_2),   p_1 = (1/l, -g/(l h)),  p_2 = (0, 1/h),

``p_a`` being the dual vectors of ``f_a``, along t and b.
"""

import numpy as np

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.lie.compiled import inlined, kernel

__all__ = ["add_forces", "strains_into", "tangents_into"]


@inlined
def _vectors(
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
                if i < 3:
                    w[0, a] += gradients[0, i] * q
                    w[1, a] += gradients[1, i] * q
                for s in range(3):
                    w[2 + s, a] += curvatures[s, i] * q


@inlined
def _present(w: FloatArray, axes: FloatArray, local: FloatArray) -> None:
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
    for s in range(5):
        for a in range(3):
            local[s, a] = w[s, 0] * axes[a, 0] + w[s, 1] * axes[a, 1] + w[s, 2] * axes[a, 2]


@inlined
def _strain(local: FloatArray, start: FloatArray, strain: FloatArray) -> None:
    """Write the strains (6,)."""
    strain[0], strain[1], strain[2] = local[0, 0] - 1, local[1, 1] - 1, local[1, 0]
    for s in range(3):
        strain[3 + s] = local[2 + s, 2] - start[s]


@inlined
def _stress(D: FloatArray, area: float, strain: FloatArray, stress: FloatArray) -> None:
    """Write the stress resultants (6,) times the area."""
    for i in range(6):
        stress[i] = 0.0
        for j in range(6):
            stress[i] += area * D[i, j] * strain[j]


@kernel
def strains_into(
    points: FloatArray, nodes: IndexArray, gradients: FloatArray, curvatures: FloatArray,
    offsets: FloatArray, starts: FloatArray, strains: FloatArray,
) -> None:  # fmt: skip
    """Write the strains (m, 6) at positions (n, 3)."""
    w, axes, local = np.empty((5, 3)), np.empty((3, 3)), np.empty((5, 3))
    for m in range(len(nodes)):
        _vectors(points, nodes[m], gradients[m], curvatures[m], offsets[m], w)
        _present(w, axes, local)
        _strain(local, starts[m], strains[m])


@inlined
def _dual(local: FloatArray, p: FloatArray) -> None:
    """Write the dual vectors (2, 2) of f_1 and f_2 along t and b."""
    p[0, 0], p[1, 0], p[1, 1] = 1 / local[0, 0], 0.0, 1 / local[1, 1]
    p[0, 1] = -local[1, 0] * p[0, 0] * p[1, 1]


@inlined
def _forces(
    local: FloatArray, p: FloatArray, stress: FloatArray, axes: FloatArray, forces: FloatArray
) -> None:
    """Write what is dual to f_1, f_2 and to the components along n of the k, (3, 3)."""
    l, g, h = local[0, 0], local[1, 0], local[1, 1]  # noqa: E741
    m0 = m1 = 0.0
    for s in range(3):
        m0 += stress[3 + s] * local[2 + s, 0]
        m1 += stress[3 + s] * local[2 + s, 1]
    turned = (h * stress[2] - g * stress[1]) / l
    for a in range(3):
        t, b, n = axes[0, a], axes[1, a], axes[2, a]
        forces[0, a] = stress[0] * t + turned * b - (p[0, 0] * m0 + p[0, 1] * m1) * n
        forces[1, a] = stress[2] * t + stress[1] * b - p[1, 1] * m1 * n


@kernel
def add_forces(
    points: FloatArray, nodes: IndexArray, gradients: FloatArray, curvatures: FloatArray,
    offsets: FloatArray, starts: FloatArray, areas: FloatArray, sections: IntArray,
    stiffness: FloatArray, scale: float, residual: FloatArray,
) -> None:  # fmt: skip
    """Add ``scale`` times the internal forces to the residual (n, 3)."""
    w, axes, local = np.empty((5, 3)), np.empty((3, 3)), np.empty((5, 3))
    strain, stress, p, forces = np.empty(6), np.empty(6), np.empty((2, 2)), np.empty((2, 3))
    for m in range(len(nodes)):
        _vectors(points, nodes[m], gradients[m], curvatures[m], offsets[m], w)
        _present(w, axes, local)
        _strain(local, starts[m], strain)
        _stress(stiffness[sections[m]], scale * areas[m], strain, stress)
        _dual(local, p)
        _forces(local, p, stress, axes, forces)
        for i in range(nodes.shape[1]):
            to = nodes[m, i]
            if to < 0:
                continue
            bent = 0.0
            for s in range(3):
                bent += curvatures[m, s, i] * stress[3 + s]
            for a in range(3):
                residual[to, a] += bent * axes[2, a]
                if i < 3:
                    along = gradients[m, 0, i] * forces[0, a] + gradients[m, 1, i] * forces[1, a]
                    residual[to, a] += along


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
def _product(W: FloatArray, H: FloatArray, outer: bool, T: FloatArray, K: FloatArray) -> None:
    """Write ``W^T H W`` (p, p) for W (5, p); T is of the size of W.

    Without ``outer``, not between nodes of neighbours.
    """
    count = W.shape[1]
    for s in range(5):
        for j in range(count):
            T[s, j] = H[s, 0] * W[0, j] + H[s, 1] * W[1, j]
            T[s, j] += H[s, 2] * W[2, j] + H[s, 3] * W[3, j] + H[s, 4] * W[4, j]
    for i in range(3):
        for j in range(count):
            K[i, j] = W[0, i] * T[0, j] + W[1, i] * T[1, j]
            K[i, j] += W[2, i] * T[2, j] + W[3, i] * T[3, j] + W[4, i] * T[4, j]
    for i in range(3, count):
        for j in range(count if outer else 3):
            K[i, j] = W[2, i] * T[2, j] + W[3, i] * T[3, j] + W[4, i] * T[4, j]


@inlined
def _own(
    W: FloatArray, H: FloatArray, skew: FloatArray, normal: FloatArray, i: int, j: int,
    block: FloatArray,
) -> None:  # fmt: skip
    """Write the derivative of the force on own node i by node j along t, b, n, (3, 3)."""
    for a in range(2):
        for b in range(2):
            block[a, b] = 0.0
            if j < 3:
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
    block: FloatArray, K: FloatArray,
) -> None:  # fmt: skip
    """Write a tangent (3 p, 3 p)."""
    count = W.shape[1]
    for i in range(3):
        for j in range(i, count):
            _own(W, H, skew, normal, i, j, block)
            _put(axes, block, i, j, K)
    # nodes of neighbours bend the triangle only
    for a in range(3):
        for b in range(3):
            block[a, b] = axes[2, a] * axes[2, b]
    for i in range(3, count):
        for a in range(3):
            for j in range(3, count):
                for b in range(3):
                    K[3 * i + a, 3 * j + b] = normal[i, j] * block[a, b]


@kernel
def tangents_into(
    points: FloatArray, nodes: IndexArray, gradients: FloatArray, curvatures: FloatArray,
    offsets: FloatArray, starts: FloatArray, areas: FloatArray, sections: IntArray,
    stiffness: FloatArray, scale: float, first: int, tangents: FloatArray,
) -> None:  # fmt: skip
    """Write ``scale`` times the derivatives of the forces, (r, 3 p, 3 p), of r triangles."""
    count = nodes.shape[1]
    w, axes, local, block = np.empty((5, 3)), np.empty((3, 3)), np.empty((5, 3)), np.empty((3, 3))
    strain, stress, p, c = np.empty(6), np.empty(6), np.empty((2, 2)), np.empty((3, 5))
    flat, bent, mixed = np.empty((4, 4)), np.empty((5, 5)), np.empty((2, 5, 5))
    W, T = np.zeros((5, count)), np.empty((5, count))
    skew, normal = np.empty((2, count, count)), np.empty((count, count))
    for m in range(first, first + len(tangents)):
        _vectors(points, nodes[m], gradients[m], curvatures[m], offsets[m], w)
        _present(w, axes, local)
        _strain(local, starts[m], strain)
        D, area = stiffness[sections[m]], scale * areas[m]
        _stress(D, area, strain, stress)
        _dual(local, p)
        _membrane(local, stress, D, area, flat)
        _bending(local, p, stress, D, area, c, bent)
        _coupling(local, p, stress, D, area, c, mixed)
        W[:2, :3], W[2:] = gradients[m], curvatures[m]
        _product(W, bent, True, T, normal)
        for a in range(2):
            _product(W, mixed[a], False, T, skew[a])
        _put_all(axes, W, flat, skew, normal, block, tangents[m - first])
