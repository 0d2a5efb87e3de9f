# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kernel of the tangents of rotation-free triangles.

Data and constants as in ``steps``. With changes x, y, z of the five vectors along t, b, n

    d eps_11 = x_1,  d eps_22 = y_2 - g/l y_1,  d gamma_12 = x_2 + h/l y_1,
    d n = -(p_1 z_1 + p_2 z_2),   p_1 = (1/l, -g/(l h)),  p_2 = (0, 1/h),

``p_a`` being the dual vectors of ``f_a``, along t and b. The second derivatives of the energy by
the vectors are those among x_1, y_1, x_2, y_2 (4, 4), among the z (5, 5), and of the x and of the y
by the z (5, 5) each. They are kept in work space behind the coefficients with data.
"""

from flexfem._types import FloatArray
from flexfem.families.shell_rotation_free.steps import (
    AREA,
    DAMPING,
    POINTS,
    STIFFNESS,
    Several,
    axes_of,
    bent,
    curvature,
    gradient,
    strain_of,
    stress_of,
    vectors_of,
)
from flexfem.kernels.by_hand import batched_by_hand
from flexfem.kernels.compiled import inlined_fused
from flexfem.kernels.lanes import LANES
from flexfem.kernels.vectors import add_to, load, store

__all__ = ["tangent", "work_space"]

#: Positions in the work space of the axes, the changes (3, 5) of the curvatures along the z, the
#: second derivatives, and the products of those by the z with the weights of the nodes.
_AXES, _CHANGES, _FLAT, _BENT, _ALONG_T, _ALONG_B, _PRODUCTS = 0, 9, 24, 40, 65, 90, 115


def work_space(count: int) -> int:
    """Number of coefficients that the kernel takes as work space for patches of some nodes."""
    return _PRODUCTS + 15 * count


@inlined_fused
def _respond(
    coefficients: FloatArray, i: int, j: int, e0: Several, e1: Several, e2: Several
) -> Several:
    """Component i of the stress resultants for the strains j, j + 1 and j + 2."""
    D = STIFFNESS + 6 * i + j
    value = load(coefficients, D) * e0 + load(coefficients, D + 1) * e1
    return value + load(coefficients, D + 2) * e2


@inlined_fused
def _write_flat(
    coefficients: FloatArray, area: Several, lengths: Several, stress: Several, H: FloatArray
) -> None:
    """Write the derivatives among x_1, y_1, x_2, y_2."""
    l, g, h = lengths  # noqa: E741
    one, zero = area, 0.0 * area
    for i in range(4):
        e0, e1, e2 = zero, zero, zero  # changes of the strains along each of the four
        if i == 0:
            e0 = one
        elif i == 1:
            e1, e2 = -(g / l) * one, h / l * one
        elif i == 2:
            e2 = one
        else:
            e1 = one
        s1 = _respond(coefficients, 1, 0, e0, e1, e2)
        s2 = _respond(coefficients, 2, 0, e0, e1, e2)
        store(H, 4 * i, _respond(coefficients, 0, 0, e0, e1, e2))
        store(H, 4 * i + 1, (h * s2 - g * s1) / l)
        store(H, 4 * i + 2, s2)
        store(H, 4 * i + 3, s1)
    n11, n22, n12 = stress[0], stress[1], stress[2]
    turned = (h * n12 - g * n22) / l
    add_to(H, 1, -turned / l)
    add_to(H, 4, -turned / l)
    add_to(H, 5, (n11 - (g * n12 + h * n22) / l) / l)
    add_to(H, 6, -n22 / l)
    add_to(H, 9, -n22 / l)
    add_to(H, 7, n12 / l)
    add_to(H, 13, n12 / l)


@inlined_fused
def _write_changes(k: Several, axes: Several, dual: Several, c: FloatArray) -> Several:
    """Write the changes of the curvatures; return the components of the k along n."""
    p00, p01, p11 = dual
    _, _, _, t0, t1, t2, b0, b1, b2, n0, n1, n2 = axes
    z1 = n0 * k[0] + n1 * k[1] + n2 * k[2]
    z2 = n0 * k[3] + n1 * k[4] + n2 * k[5]
    z3 = n0 * k[6] + n1 * k[7] + n2 * k[8]
    store(c, 0, k[0] * t0 + k[1] * t1 + k[2] * t2)
    store(c, 1, k[0] * b0 + k[1] * b1 + k[2] * b2)
    store(c, 5, k[3] * t0 + k[4] * t1 + k[5] * t2)
    store(c, 6, k[3] * b0 + k[4] * b1 + k[5] * b2)
    store(c, 10, k[6] * t0 + k[7] * t1 + k[8] * t2)
    store(c, 11, k[6] * b0 + k[7] * b1 + k[8] * b2)
    for s in range(3):
        x, y = load(c, 5 * s), load(c, 5 * s + 1)
        store(c, 5 * s, -(p00 * x + p01 * y))
        store(c, 5 * s + 1, -(p11 * y))
        for r in range(3):
            store(c, 5 * s + 2 + r, 0.0 * x + (1.0 if r == s else 0.0))
    return z1, z2, z3


@inlined_fused
def _write_bent(
    coefficients: FloatArray, area: Several, lengths: Several, dual: Several, stress: Several,
    normal: Several, c: FloatArray, H: FloatArray,
) -> None:  # fmt: skip
    """Write the derivatives among the z; ``normal`` is the sum of moments times k along n."""
    l, g, h = lengths  # noqa: E741
    p00, p01, p11 = dual
    for j in range(5):
        e0, e1, e2 = area * load(c, j), area * load(c, 5 + j), area * load(c, 10 + j)
        m0 = _respond(coefficients, 3, 3, e0, e1, e2)
        m1 = _respond(coefficients, 4, 3, e0, e1, e2)
        m2 = _respond(coefficients, 5, 3, e0, e1, e2)
        for i in range(5):
            store(H, 5 * i + j, load(c, i) * m0 + load(c, 5 + i) * m1 + load(c, 10 + i) * m2)
    turned = (h * stress[2] - g * stress[1]) / l
    add_to(H, 0, (stress[0] - turned * g / h) / l - normal * (p00 * p00 + p01 * p01))
    add_to(H, 1, turned / h - normal * p01 * p11)
    add_to(H, 5, turned / h - normal * p01 * p11)
    add_to(H, 6, stress[1] / h - normal * p11 * p11)


@inlined_fused
def _write_mixed(
    coefficients: FloatArray, area: Several, lengths: Several, dual: Several, stress: Several,
    c: FloatArray, work: FloatArray,
) -> None:  # fmt: skip
    """Write the derivatives of the x and of the y of the vectors by their z."""
    l, g, h = lengths  # noqa: E741
    p00, p01, p11 = dual
    X, Y = work[LANES * _ALONG_T :], work[LANES * _ALONG_B :]
    m0, m1, m2 = stress[3], stress[4], stress[5]
    for t in range(5):
        e0, e1, e2 = area * load(c, t), area * load(c, 5 + t), area * load(c, 10 + t)
        s1 = _respond(coefficients, 1, 3, e0, e1, e2)
        s2 = _respond(coefficients, 2, 3, e0, e1, e2)
        store(X, t, _respond(coefficients, 0, 3, e0, e1, e2))
        store(Y, t, (h * s2 - g * s1) / l)
        store(X, 5 + t, s2)
        store(Y, 5 + t, s1)
        for s in range(2, 5):
            store(X, 5 * s + t, 0.0 * l)
            store(Y, 5 * s + t, 0.0 * l)
    for a in range(2):
        along = -(load(c, a) * m0 + load(c, 5 + a) * m1 + load(c, 10 + a) * m2)
        add_to(X, 5 * a, along * p00)
        add_to(Y, 5 * a, along * p01)
        add_to(Y, 5 * a + 1, along * p11)
    for s in range(2, 5):
        m = m0
        if s == 3:
            m = m1
        elif s == 4:
            m = m2
        store(X, 5 * s, -m * p00)
        store(Y, 5 * s, -m * p01)
        store(Y, 5 * s + 1, -m * p11)


@inlined_fused
def _write_products(
    coordinates: FloatArray, count: int, flat: int, H: FloatArray, T: FloatArray
) -> None:
    """Write ``H W`` for the weights W (5, p), node by node."""
    for j in range(count):
        w2, w3 = curvature(coordinates, flat, 0, j), curvature(coordinates, flat, 1, j)
        w4 = curvature(coordinates, flat, 2, j)
        for s in range(5):
            value = load(H, 5 * s + 2) * w2 + load(H, 5 * s + 3) * w3 + load(H, 5 * s + 4) * w4
            if j < flat:
                value = value + load(H, 5 * s) * gradient(coordinates, 0, j)
                value = value + load(H, 5 * s + 1) * gradient(coordinates, 1, j)
            store(T, 5 * j + s, value)


@inlined_fused
def _times(coordinates: FloatArray, flat: int, i: int, T: FloatArray, j: int) -> Several:
    """``W^T H W`` of nodes i and j."""
    value = curvature(coordinates, flat, 0, i) * load(T, 5 * j + 2)
    value = value + curvature(coordinates, flat, 1, i) * load(T, 5 * j + 3)
    value = value + curvature(coordinates, flat, 2, i) * load(T, 5 * j + 4)
    if i < flat:
        value = value + gradient(coordinates, 0, i) * load(T, 5 * j)
        value = value + gradient(coordinates, 1, i) * load(T, 5 * j + 1)
    return value


@inlined_fused
def _in_plane(coordinates: FloatArray, H: FloatArray, a: int, b: int, i: int, j: int) -> Several:
    """Derivative of the force on node i by node j along t (0) or b (1) both."""
    G0, G1 = gradient(coordinates, 0, i), gradient(coordinates, 1, i)
    first = G0 * load(H, 4 * a + b) + G1 * load(H, 8 + 4 * a + b)
    second = G0 * load(H, 4 * a + 2 + b) + G1 * load(H, 10 + 4 * a + b)
    return first * gradient(coordinates, 0, j) + second * gradient(coordinates, 1, j)


@inlined_fused
def _put(tensor: FloatArray, count: int, i: int, j: int, axes: FloatArray, block: Several) -> None:
    """Add a block of nodes i and j along t, b, n, and its transpose."""
    tt, tb, tn, bt, bb, bn, nt, nb, nn = block
    for b in range(3):
        t, o, n = load(axes, b), load(axes, 3 + b), load(axes, 6 + b)
        v0, v1 = tt * t + tb * o + tn * n, bt * t + bb * o + bn * n
        v2 = nt * t + nb * o + nn * n
        for a in range(3):
            value = load(axes, a) * v0 + load(axes, 3 + a) * v1 + load(axes, 6 + a) * v2
            store(tensor, 3 * count * (3 * i + a) + 3 * j + b, value)
            store(tensor, 3 * count * (3 * j + b) + 3 * i + a, value)


@batched_by_hand
def tangent(
    tensor: FloatArray, coefficients: FloatArray, constants: FloatArray, coordinates: FloatArray
) -> None:
    """Write the derivatives of the internal forces (3 p, 3 p), the only entries of the tensor.

    They are those by positions and by velocities, times the factors. The change of strain rates by
    the rotation of the axes is neglected, a term of the order of damping times angular velocity.
    """
    count, flat = int(constants[0]), int(constants[1])
    f, k = vectors_of(coefficients, POINTS, count, flat, coordinates)
    k = bent(k, coordinates)
    axes = axes_of(f)
    l, g, h, t0, t1, t2, b0, b1, b2, n0, n1, n2 = axes  # noqa: E741
    lengths, dual = (l, g, h), (1.0 / l, -g / (l * h), 1.0 / h)
    work = coefficients[LANES * (POINTS + 3 * count) :]
    c, H = work[LANES * _CHANGES :], work[LANES * _FLAT :]
    bends = _write_changes(k, axes, dual, c)
    size = load(coordinates, AREA)
    strain = strain_of((l, h, g), bends, coordinates)
    stress = stress_of(coefficients, constants[4], constants[2] * size, strain)
    normal = stress[3] * bends[0] + stress[4] * bends[1] + stress[5] * bends[2]
    area = size * (constants[2] + constants[3] * load(coordinates, DAMPING))
    _write_flat(coefficients, area, lengths, stress, H)
    _write_bent(coefficients, area, lengths, dual, stress, normal, c, work[LANES * _BENT :])
    _write_mixed(coefficients, area, lengths, dual, stress, c, work)
    N = work[LANES * _PRODUCTS :]
    X, Y = N[LANES * 5 * count :], N[LANES * 10 * count :]
    _write_products(coordinates, count, flat, work[LANES * _BENT :], N)
    _write_products(coordinates, count, flat, work[LANES * _ALONG_T :], X)
    _write_products(coordinates, count, flat, work[LANES * _ALONG_B :], Y)
    store(work, 0, t0)
    store(work, 1, t1)
    store(work, 2, t2)
    store(work, 3, b0)
    store(work, 4, b1)
    store(work, 5, b2)
    store(work, 6, n0)
    store(work, 7, n1)
    store(work, 8, n2)
    zero = 0.0 * l
    for i in range(flat):
        for j in range(i, count):
            tt = tb = bt = bb = zero
            if j < flat:
                tt, tb = (
                    _in_plane(coordinates, H, 0, 0, i, j),
                    _in_plane(coordinates, H, 0, 1, i, j),
                )
                bt, bb = (
                    _in_plane(coordinates, H, 1, 0, i, j),
                    _in_plane(coordinates, H, 1, 1, i, j),
                )
            tn, nt = _times(coordinates, flat, i, X, j), _times(coordinates, flat, j, X, i)
            bn, nb = _times(coordinates, flat, i, Y, j), _times(coordinates, flat, j, Y, i)
            nn = _times(coordinates, flat, i, N, j)
            _put(tensor, count, i, j, work, (tt, tb, tn, bt, bb, bn, nt, nb, nn))
    for i in range(flat, count):  # nodes of neighbours enter the curvatures only
        for j in range(i, count):
            nn = _times(coordinates, flat, i, N, j)
            _put(tensor, count, i, j, work, (zero, zero, zero, zero, zero, zero, zero, zero, nn))
