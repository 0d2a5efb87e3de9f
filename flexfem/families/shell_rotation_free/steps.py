# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps that the kernels of rotation-free triangles share.

The energy of ``forms.shell`` depends on five vectors ``w_s = sum over nodes of W_sI q_I``:
the derivatives ``f_1, f_2`` and the three curvature vectors ``k`` (to which clamps add a given
part). Derivatives are those of the first three nodes, or smoothed ones of the first six. The
work is done in the present axes of the triangle: t along f_1, b in the triangle, n its normal, in
which ``f_1 = (l, 0, 0)`` and ``f_2 = (g, h, 0)``.

All numbers are those of several triangles, see ``kernels.vectors``. Kernels take the constants p
and q, the numbers of nodes of a patch and of those with derivatives, the factors of the derivatives
by positions and by velocities, and whether stresses are given; as coefficients stiffness, given
stresses, positions and steps; and in place of coordinates the result of :func:`constant_data`.
"""

import math
from typing import Any

import numpy as np

from flexfem._types import FloatArray
from flexfem.kernels.compiled import inlined_fused
from flexfem.kernels.lanes import LANES, in_rows, lanes
from flexfem.kernels.vectors import load
from flexfem.mesh.shells.patches import Patches

__all__ = [
    "AREA",
    "DAMPING",
    "POINTS",
    "STIFFNESS",
    "Several",
    "axes_of",
    "bent",
    "constant_data",
    "curvature",
    "gradient",
    "resultants",
    "strain_of",
    "stress_of",
    "turn_of",
    "vectors_of",
    "write_starts",
]

#: A number for each of several triangles, and a tuple of them.
type Several = Any

#: First coefficients, and columns of the constant data.
STIFFNESS, GIVEN, POINTS = 0, 36, 42
START, AREA, DAMPING, OFFSETS, WEIGHTS = 0, 6, 7, 8, 17


def constant_data(
    patches: Patches, offsets: FloatArray, starts: FloatArray, damping: FloatArray
) -> FloatArray:
    """Constant data of triangles, a row for each call of a kernel.

    Args:
        patches: maps of the triangles.
        offsets: (m, 3, 3) contribution of clamps to the k, 1/m.
        starts: (m, 6) reference values of zero strain.
        damping: (m,) stiffness-proportional, s.
    """
    there = patches.nodes >= 0
    flat = np.where(there[:, None, : patches.membrane.shape[2]], patches.membrane, 0.0)
    pieces = [starts, patches.areas, damping, offsets, np.swapaxes(flat, 1, 2),
              np.swapaxes(patches.curvatures, 1, 2)]  # fmt: skip
    return in_rows(lanes(np.concatenate([in_rows(piece) for piece in pieces], axis=1)))


def write_starts(data: FloatArray, starts: FloatArray) -> None:
    """Write other reference values (m, 6) of zero strain to a result of :func:`constant_data`."""
    if len(starts):
        batches = data.reshape(len(data), -1, LANES)
        batches[:, START : START + 6] = lanes(starts)


@inlined_fused
def start(coordinates: FloatArray, s: int) -> Several:
    """Reference value of zero strain."""
    return load(coordinates, START + s)


@inlined_fused
def gradient(coordinates: FloatArray, a: int, i: int) -> Several:
    """Weight of a node in f_1 or f_2."""
    return load(coordinates, WEIGHTS + 2 * i + a)


@inlined_fused
def curvature(coordinates: FloatArray, flat: int, s: int, i: int) -> Several:
    """Weight of a node in one of the k, after ``flat`` nodes with gradients."""
    return load(coordinates, WEIGHTS + 2 * flat + 3 * i + s)


@inlined_fused
def vectors_of(
    values: FloatArray, at: int, count: int, flat: int, coordinates: FloatArray
) -> tuple[Several, Several]:
    """f_1 and f_2, and the three k without the contribution of clamps: 6 and 9 components.

    The nodal values begin at ``at`` and are taken relative to node 0, so that no digits are lost
    far from the origin.
    """
    x0, y0, z0 = load(values, at), load(values, at + 1), load(values, at + 2)
    f10 = f11 = f12 = f20 = f21 = f22 = 0.0
    k10 = k11 = k12 = k20 = k21 = k22 = k30 = k31 = k32 = 0.0
    for i in range(1, count):
        x = load(values, at + 3 * i) - x0
        y = load(values, at + 3 * i + 1) - y0
        z = load(values, at + 3 * i + 2) - z0
        if i < flat:
            c, d = gradient(coordinates, 0, i), gradient(coordinates, 1, i)
            f10, f11, f12 = f10 + c * x, f11 + c * y, f12 + c * z
            f20, f21, f22 = f20 + d * x, f21 + d * y, f22 + d * z
        c, d = curvature(coordinates, flat, 0, i), curvature(coordinates, flat, 1, i)
        e = curvature(coordinates, flat, 2, i)
        k10, k11, k12 = k10 + c * x, k11 + c * y, k12 + c * z
        k20, k21, k22 = k20 + d * x, k21 + d * y, k22 + d * z
        k30, k31, k32 = k30 + e * x, k31 + e * y, k32 + e * z
    return (f10, f11, f12, f20, f21, f22), (k10, k11, k12, k20, k21, k22, k30, k31, k32)


@inlined_fused
def bent(k: Several, coordinates: FloatArray) -> Several:
    """The three k with the contribution of clamps."""
    return (
        k[0] + load(coordinates, OFFSETS), k[1] + load(coordinates, OFFSETS + 1),
        k[2] + load(coordinates, OFFSETS + 2), k[3] + load(coordinates, OFFSETS + 3),
        k[4] + load(coordinates, OFFSETS + 4), k[5] + load(coordinates, OFFSETS + 5),
        k[6] + load(coordinates, OFFSETS + 6), k[7] + load(coordinates, OFFSETS + 7),
        k[8] + load(coordinates, OFFSETS + 8),
    )  # fmt: skip


@inlined_fused
def axes_of(f: Several) -> Several:
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
def turn_of(change: Several, axes: Several) -> Several:
    """Rotation of the axes by changes of f_1 and f_2, from a result of :func:`axes_of`.

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
def _row(coefficients: FloatArray, i: int, e: Several) -> Several:
    """A row of the stiffness times strains."""
    D = STIFFNESS + 6 * i
    membrane = load(coefficients, D) * e[0] + load(coefficients, D + 1) * e[1]
    membrane = membrane + load(coefficients, D + 2) * e[2]
    bent = load(coefficients, D + 3) * e[3] + load(coefficients, D + 4) * e[4]
    return membrane + bent + load(coefficients, D + 5) * e[5]


@inlined_fused
def resultants(coefficients: FloatArray, e: Several) -> Several:
    """Stiffness times strains: n_11, n_22, n_12, m_11, m_22, m_12."""
    return (
        _row(coefficients, 0, e), _row(coefficients, 1, e), _row(coefficients, 2, e),
        _row(coefficients, 3, e), _row(coefficients, 4, e), _row(coefficients, 5, e),
    )  # fmt: skip


@inlined_fused
def strain_of(stretches: Several, bends: Several, coordinates: FloatArray) -> Several:
    """Strains: l, h, g and the k along the normal less their values of zero strain."""
    (l, h, g), (z1, z2, z3) = stretches, bends  # noqa: E741
    return (
        l - start(coordinates, 0), h - start(coordinates, 1), g - start(coordinates, 2),
        z1 - start(coordinates, 3), z2 - start(coordinates, 4), z3 - start(coordinates, 5),
    )  # fmt: skip


@inlined_fused
def stress_of(coefficients: FloatArray, given: float, area: Several, strain: Several) -> Several:
    """Stress resultants times the area: the given ones, if there are any, or those of strains."""
    if given > 0.0:
        return (
            area * load(coefficients, GIVEN), area * load(coefficients, GIVEN + 1),
            area * load(coefficients, GIVEN + 2), area * load(coefficients, GIVEN + 3),
            area * load(coefficients, GIVEN + 4), area * load(coefficients, GIVEN + 5),
        )  # fmt: skip
    e1, e2, e3, e4, e5, e6 = strain
    whole = area * e1, area * e2, area * e3, area * e4, area * e5, area * e6
    return resultants(coefficients, whole)
