# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled operations on quaternions ``(w, v)`` with scalar part w and vector part v.

A unit quaternion ``(cos(t/2), sin(t/2) n)`` represents the rotation by t about the unit vector n.
Matrices are stored row by row, 9 entries from ``offset`` on.
"""

from math import sqrt

from flexfem._types import FloatArray
from flexfem.kernels.compiled import inlined
from flexfem.lie._blocks import cross, dot, triple
from flexfem.lie._coefficients import Triple

__all__ = ["Quaternion", "conjugate", "from_matrix", "matrix_into", "product"]

Quaternion = tuple[float, Triple]


@inlined
def from_matrix(R: FloatArray, offset: int) -> Quaternion:
    """Unit quaternion with a scalar part >= 0; its largest component is computed first."""
    r00, r01, r02 = triple(R, offset)
    r10, r11, r12 = triple(R, offset + 3)
    r20, r21, r22 = triple(R, offset + 6)
    trace = r00 + r11 + r22
    if trace >= max(r00, r11, r22):
        w, x, y, z = 1.0 + trace, r21 - r12, r02 - r20, r10 - r01
    elif r00 >= r11 and r00 >= r22:
        w, x, y, z = r21 - r12, 1.0 + r00 - r11 - r22, r01 + r10, r02 + r20
    elif r11 >= r22:
        w, x, y, z = r02 - r20, r01 + r10, 1.0 + r11 - r00 - r22, r12 + r21
    else:
        w, x, y, z = r10 - r01, r02 + r20, r12 + r21, 1.0 + r22 - r00 - r11
    scale = 1.0 / sqrt(w * w + x * x + y * y + z * z)
    if w < 0.0:
        scale = -scale
    return w * scale, (x * scale, y * scale, z * scale)


@inlined
def matrix_into(q: Quaternion, R: FloatArray, offset: int) -> None:
    """Rotation matrix of a quaternion of any length but zero."""
    w, (x, y, z) = q
    f = 2.0 / (w * w + x * x + y * y + z * z)
    R[offset] = 1.0 - f * (y * y + z * z)
    R[offset + 1] = f * (x * y - w * z)
    R[offset + 2] = f * (x * z + w * y)
    R[offset + 3] = f * (x * y + w * z)
    R[offset + 4] = 1.0 - f * (x * x + z * z)
    R[offset + 5] = f * (y * z - w * x)
    R[offset + 6] = f * (x * z - w * y)
    R[offset + 7] = f * (y * z + w * x)
    R[offset + 8] = 1.0 - f * (x * x + y * y)


@inlined
def product(p: Quaternion, q: Quaternion) -> Quaternion:
    """Hamilton's product; the rotation q, in the axes that p has rotated."""
    (a, u), (b, v) = p, q
    c = cross(u, v)
    return a * b - dot(u, v), (
        a * v[0] + b * u[0] + c[0],
        a * v[1] + b * u[1] + c[1],
        a * v[2] + b * u[2] + c[2],
    )


@inlined
def conjugate(q: Quaternion) -> Quaternion:
    """The opposite rotation."""
    w, v = q
    return w, (-v[0], -v[1], -v[2])
