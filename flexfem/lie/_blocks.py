# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled vector operations and 3x3 blocks shared by the rotation and the frame maps.

Every map of SO(3) has the form ``F = I + p skew(theta) + q skew(theta)^2`` with coefficients that
depend on ``x = |theta|^2`` only. The functions here write ``F`` and its directional derivatives
into the flat array ``out`` at ``offset``, with rows ``stride`` entries apart. A coefficient comes
with its derivatives as :mod:`flexfem.lie._series` defines them: ``p = (p, 2 dp/dx, 4 d2p/dx2)``.
"""

from flexfem._types import FloatArray
from flexfem.kernels.compiled import inlined
from flexfem.lie._coefficients import Triple

__all__ = [
    "copy_entries",
    "cross",
    "dot",
    "first_block",
    "map_block",
    "second_block",
    "triple",
    "zero_block",
]


@inlined
def copy_entries(source: FloatArray, out: FloatArray) -> None:
    """Write all of ``source`` (n,) to the front of ``out``.

    ``out[:] = source`` would bring numba's message of shapes that differ: forty functions.
    """
    for i in range(source.size):
        out[i] = source[i]


@inlined
def triple(values: FloatArray, offset: int) -> Triple:
    """Three entries in a row, held in registers."""
    return values[offset], values[offset + 1], values[offset + 2]


@inlined
def dot(a: Triple, b: Triple) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def cross(a: Triple, b: Triple) -> Triple:
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def map_block(p: float, q: float, t: Triple, out: FloatArray, offset: int, stride: int) -> None:
    """``F`` at ``theta = t``."""
    i, j, k = offset, offset + stride, offset + 2 * stride
    a, b, c = t
    qab, qac, qbc = q * a * b, q * a * c, q * b * c
    pa, pb, pc = p * a, p * b, p * c
    aa, bb, cc = a * a, b * b, c * c
    out[i] = 1.0 - q * (bb + cc)
    out[i + 1] = qab - pc
    out[i + 2] = qac + pb
    out[j] = qab + pc
    out[j + 1] = 1.0 - q * (aa + cc)
    out[j + 2] = qbc - pa
    out[k] = qac - pb
    out[k + 1] = qbc + pa
    out[k + 2] = 1.0 - q * (aa + bb)


@inlined
def _parts_block(
    s: Triple, diagonal: Triple, rest: Triple, out: FloatArray, offset: int, stride: int
) -> None:
    """``skew(s) + m - tr(m) I``, the symmetric m given by its diagonal and (m01, m02, m12)."""
    i, j, k = offset, offset + stride, offset + 2 * stride
    out[i] = -(diagonal[1] + diagonal[2])
    out[i + 1] = rest[0] - s[2]
    out[i + 2] = rest[1] + s[1]
    out[j] = rest[0] + s[2]
    out[j + 1] = -(diagonal[0] + diagonal[2])
    out[j + 2] = rest[2] - s[0]
    out[k] = rest[1] - s[1]
    out[k + 1] = rest[2] + s[0]
    out[k + 2] = -(diagonal[0] + diagonal[1])


@inlined
def first_block(
    p: Triple, q: Triple, t: Triple, u: Triple, out: FloatArray, offset: int, stride: int
) -> None:
    """Derivative of ``F`` at ``theta = t`` along ``u``."""
    # skew(v) skew(w) = w v^T - (v . w) I, whence m = t n^T + n t^T
    along = dot(t, u)
    f, g = p[1] * along, 0.5 * q[1] * along
    n0, n1, n2 = q[0] * u[0] + g * t[0], q[0] * u[1] + g * t[1], q[0] * u[2] + g * t[2]
    s = (p[0] * u[0] + f * t[0], p[0] * u[1] + f * t[1], p[0] * u[2] + f * t[2])
    diagonal = (2.0 * n0 * t[0], 2.0 * n1 * t[1], 2.0 * n2 * t[2])
    rest = (n0 * t[1] + n1 * t[0], n0 * t[2] + n2 * t[0], n1 * t[2] + n2 * t[1])
    _parts_block(s, diagonal, rest, out, offset, stride)


@inlined
def second_block(
    p: Triple, q: Triple, t: Triple, u: Triple, h: Triple, out: FloatArray, offset: int, stride: int
) -> None:
    """Second derivative of ``F`` at ``theta = t`` along ``u`` and ``h``."""
    along_u, along_h, uh = dot(t, u), dot(t, h), dot(u, h)
    m0 = along_h * u[0] + along_u * h[0]
    m1 = along_h * u[1] + along_u * h[1]
    m2 = along_h * u[2] + along_u * h[2]
    f = p[1] * uh + p[2] * along_u * along_h
    g = 0.5 * (q[1] * uh + q[2] * along_u * along_h)
    # m = t n^T + n t^T + q (u h^T + h u^T)
    n0, n1, n2 = q[1] * m0 + g * t[0], q[1] * m1 + g * t[1], q[1] * m2 + g * t[2]
    s = (p[1] * m0 + f * t[0], p[1] * m1 + f * t[1], p[1] * m2 + f * t[2])
    diagonal = (
        2.0 * (n0 * t[0] + q[0] * u[0] * h[0]),
        2.0 * (n1 * t[1] + q[0] * u[1] * h[1]),
        2.0 * (n2 * t[2] + q[0] * u[2] * h[2]),
    )
    rest = (
        n0 * t[1] + n1 * t[0] + q[0] * (u[0] * h[1] + u[1] * h[0]),
        n0 * t[2] + n2 * t[0] + q[0] * (u[0] * h[2] + u[2] * h[0]),
        n1 * t[2] + n2 * t[1] + q[0] * (u[1] * h[2] + u[2] * h[1]),
    )
    _parts_block(s, diagonal, rest, out, offset, stride)


@inlined
def zero_block(out: FloatArray, offset: int, stride: int) -> None:
    """Zero."""
    for i in range(3):
        for j in range(3):
            out[offset + stride * i + j] = 0.0
