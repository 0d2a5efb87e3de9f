# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kernels of the forces and strains of rotation-free triangles, and of their changes along a step.

Notation, data and constants as in ``steps``.
"""

from flexfem._types import FloatArray
from flexfem.families.shell_rotation_free.steps import (
    AREA,
    DAMPING,
    POINTS,
    Several,
    axes_of,
    bent,
    curvature,
    gradient,
    resultants,
    strain_of,
    stress_of,
    turn_of,
    vectors_of,
)
from flexfem.kernels.by_hand import batched_by_hand
from flexfem.kernels.compiled import inlined_fused
from flexfem.kernels.vectors import add_to, load

__all__ = ["action", "damped_forces", "forces", "strain_rates", "strains"]


@batched_by_hand
def forces(
    tensor: FloatArray, coefficients: FloatArray, constants: FloatArray, coordinates: FloatArray
) -> None:
    """Internal forces on the nodes (p, 3), times the first of the factors."""
    count, flat = int(constants[0]), int(constants[1])
    f, k = vectors_of(coefficients, POINTS, count, flat, coordinates)
    k, axes = bent(k, coordinates), axes_of(f)
    area = constants[2] * load(coordinates, AREA)
    stress = stress_of(coefficients, constants[4], area, _strain(k, axes, coordinates))
    _spread(tensor, count, flat, coordinates, k, axes, stress)


@batched_by_hand
def damped_forces(
    tensor: FloatArray, coefficients: FloatArray, constants: FloatArray, coordinates: FloatArray
) -> None:
    """The same with those of the strain rates; the steps are velocities."""
    count, flat = int(constants[0]), int(constants[1])
    f, k = vectors_of(coefficients, POINTS, count, flat, coordinates)
    k, axes = bent(k, coordinates), axes_of(f)
    area, time = constants[2] * load(coordinates, AREA), load(coordinates, DAMPING)
    e1, e2, e3, e4, e5, e6 = _strain(k, axes, coordinates)
    v1, v2, v3, v4, v5, v6 = _rates(coefficients, count, flat, coordinates, k, axes)
    strain = (
        area * (e1 + time * v1), area * (e2 + time * v2), area * (e3 + time * v3),
        area * (e4 + time * v4), area * (e5 + time * v5), area * (e6 + time * v6),
    )  # fmt: skip
    stress = resultants(coefficients, strain)
    _spread(tensor, count, flat, coordinates, k, axes, stress)


@inlined_fused
def _strain(k: Several, axes: Several, coordinates: FloatArray) -> Several:
    """Strains (6,) from the three k and the axes."""
    k10, k11, k12, k20, k21, k22, k30, k31, k32 = k
    l, g, h, _, _, _, _, _, _, n0, n1, n2 = axes  # noqa: E741
    bends = (
        n0 * k10 + n1 * k11 + n2 * k12,
        n0 * k20 + n1 * k21 + n2 * k22,
        n0 * k30 + n1 * k31 + n2 * k32,
    )
    return strain_of((l, h, g), bends, coordinates)


@inlined_fused
def _rates(
    coefficients: FloatArray, count: int, flat: int, coordinates: FloatArray, k: Several,
    axes: Several,
) -> Several:  # fmt: skip
    """Rates (6,) of the strains; the steps are velocities."""
    k10, k11, k12, k20, k21, k22, k30, k31, k32 = k
    n0, n1, n2 = axes[9], axes[10], axes[11]
    change, d = vectors_of(coefficients, POINTS + 3 * count, count, flat, coordinates)
    d10, d11, d12, d20, d21, d22, d30, d31, d32 = d
    dl, dh, dg, _, _, _, w0, w1, w2 = turn_of(change, axes)
    return (
        dl,
        dh,
        dg,
        n0 * d10 + n1 * d11 + n2 * d12 + (w0 * k10 + w1 * k11 + w2 * k12),
        n0 * d20 + n1 * d21 + n2 * d22 + (w0 * k20 + w1 * k21 + w2 * k22),
        n0 * d30 + n1 * d31 + n2 * d32 + (w0 * k30 + w1 * k31 + w2 * k32),
    )


@inlined_fused
def _spread(
    tensor: FloatArray, count: int, flat: int, coordinates: FloatArray, k: Several, axes: Several,
    stress: Several,
) -> None:  # fmt: skip
    """Add the forces on the nodes that are dual to stress resultants times the area."""
    k10, k11, k12, k20, k21, k22, k30, k31, k32 = k
    l, g, h, t0, t1, t2, b0, b1, b2, n0, n1, n2 = axes  # noqa: E741
    s11, s22, s12, m1, m2, m3 = stress
    # forces dual to f_1 and f_2
    x, y = m1 * k10 + m2 * k20 + m3 * k30, m1 * k11 + m2 * k21 + m3 * k31
    z = m1 * k12 + m2 * k22 + m3 * k32
    along, across = x * t0 + y * t1 + z * t2, x * b0 + y * b1 + z * b2
    turned, c, d = (h * s12 - g * s22) / l, (g / h * across - along) / l, -across / h
    f10, f11 = s11 * t0 + turned * b0 + c * n0, s11 * t1 + turned * b1 + c * n1
    f12 = s11 * t2 + turned * b2 + c * n2
    f20, f21 = s12 * t0 + s22 * b0 + d * n0, s12 * t1 + s22 * b1 + d * n1
    f22 = s12 * t2 + s22 * b2 + d * n2
    for i in range(count):
        C1, C2 = curvature(coordinates, flat, 0, i), curvature(coordinates, flat, 1, i)
        C3 = curvature(coordinates, flat, 2, i)
        along_n = C1 * m1 + C2 * m2 + C3 * m3
        x, y, z = along_n * n0, along_n * n1, along_n * n2
        if i < flat:
            c, d = gradient(coordinates, 0, i), gradient(coordinates, 1, i)
            x, y, z = x + c * f10 + d * f20, y + c * f11 + d * f21, z + c * f12 + d * f22
        add_to(tensor, 3 * i, x)
        add_to(tensor, 3 * i + 1, y)
        add_to(tensor, 3 * i + 2, z)


@batched_by_hand
def action(
    tensor: FloatArray, coefficients: FloatArray, constants: FloatArray, coordinates: FloatArray
) -> None:
    """Derivatives of the forces, see ``tangent``, times a step, (p, 3).

    The forces are differentiated along the step: their components along the present axes change
    with strains and stresses, and they rotate with the axes.
    """
    count, flat = int(constants[0]), int(constants[1])
    f, k = vectors_of(coefficients, POINTS, count, flat, coordinates)
    k, axes = bent(k, coordinates), axes_of(f)
    k10, k11, k12, k20, k21, k22, k30, k31, k32 = k
    l, g, h, t0, t1, t2, b0, b1, b2, n0, n1, n2 = axes  # noqa: E741
    # changes of f_1, f_2 and d of the k
    f, d = vectors_of(coefficients, POINTS + 3 * count, count, flat, coordinates)
    d10, d11, d12, d20, d21, d22, d30, d31, d32 = d
    dl, dh, dg, turn_t, turn_b, turn_n, w0, w1, w2 = turn_of(f, axes)
    # changes of the vectors k along the normal
    e4 = n0 * d10 + n1 * d11 + n2 * d12 + w0 * k10 + w1 * k11 + w2 * k12
    e5 = n0 * d20 + n1 * d21 + n2 * d22 + w0 * k20 + w1 * k21 + w2 * k22
    e6 = n0 * d30 + n1 * d31 + n2 * d32 + w0 * k30 + w1 * k31 + w2 * k32
    # changes of the stress resultants, and the resultants, times the area
    size = load(coordinates, AREA)
    area = size * (constants[2] + constants[3] * load(coordinates, DAMPING))
    changes = area * dl, area * dh, area * dg, area * e4, area * e5, area * e6
    ds11, ds22, ds12, dm1, dm2, dm3 = resultants(coefficients, changes)
    strain = _strain(k, axes, coordinates)
    s11, s22, s12, m1, m2, m3 = stress_of(coefficients, constants[4], size * constants[2], strain)
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
    for i in range(count):
        C1, C2 = curvature(coordinates, flat, 0, i), curvature(coordinates, flat, 1, i)
        C3 = curvature(coordinates, flat, 2, i)
        along_w = C1 * m1 + C2 * m2 + C3 * m3
        along_n = C1 * dm1 + C2 * dm2 + C3 * dm3
        x, y = along_w * w0 + along_n * n0, along_w * w1 + along_n * n1
        z = along_w * w2 + along_n * n2
        if i < flat:
            c, d = gradient(coordinates, 0, i), gradient(coordinates, 1, i)
            x, y, z = x + c * u0 + d * v0, y + c * u1 + d * v1, z + c * u2 + d * v2
        add_to(tensor, 3 * i, x)
        add_to(tensor, 3 * i + 1, y)
        add_to(tensor, 3 * i + 2, z)


@batched_by_hand
def strains(
    tensor: FloatArray, coefficients: FloatArray, constants: FloatArray, coordinates: FloatArray
) -> None:
    """Strains (6,)."""
    count, flat = int(constants[0]), int(constants[1])
    f, k = vectors_of(coefficients, POINTS, count, flat, coordinates)
    _add_six(tensor, _strain(bent(k, coordinates), axes_of(f), coordinates))


@batched_by_hand
def strain_rates(
    tensor: FloatArray, coefficients: FloatArray, constants: FloatArray, coordinates: FloatArray
) -> None:
    """Rates of the strains (6,); the steps are velocities."""
    count, flat = int(constants[0]), int(constants[1])
    f, k = vectors_of(coefficients, POINTS, count, flat, coordinates)
    k, axes = bent(k, coordinates), axes_of(f)
    _add_six(tensor, _rates(coefficients, count, flat, coordinates, k, axes))


@inlined_fused
def _add_six(tensor: FloatArray, values: Several) -> None:
    """Add to the first six results."""
    e1, e2, e3, e4, e5, e6 = values
    add_to(tensor, 0, e1)
    add_to(tensor, 1, e2)
    add_to(tensor, 2, e3)
    add_to(tensor, 3, e4)
    add_to(tensor, 4, e5)
    add_to(tensor, 5, e6)
