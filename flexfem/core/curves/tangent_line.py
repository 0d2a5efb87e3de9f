# SPDX-License-Identifier: LGPL-3.0-or-later
"""Straight line that touches two circles in space, or runs through points.

A line s from one circle to another, whose axes times radii are u and m, touches each at
``c(s, r n) = r (s x n) / |s x n|`` from its centre, so that

``F(s) = s + c(s, u) - c(s, m) - D = 0``

with the line D between the centres. Its projections on both planes are tangents there. In one plane
the solution is ``l (l D + D x (m - u)) / D^2`` with ``l = sqrt(D^2 - (m - u)^2)``; Newton's method
begins there. Points have zero axes.
"""

from math import sqrt

import numpy as np

from flexfem._types import FloatArray
from flexfem.kernels.compiled import subroutine
from flexfem.lie._blocks import cross, dot, triple

__all__ = ["straight_into", "turn_into"]

#: Newton steps, and their change relative to all lengths at convergence.
_STEPS, _SMALL = 50, 1e-14


@subroutine
def _dot(a: FloatArray, b: FloatArray) -> float:
    product: float = dot(triple(a, 0), triple(b, 0))
    return product


@subroutine
def _cross_into(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    out[0], out[1], out[2] = cross(triple(a, 0), triple(b, 0))


@subroutine
def _touch(s: FloatArray, axis: FloatArray, e: FloatArray) -> float:
    """Unit vector ``e`` from a sheave's centre to where ``s`` touches it; ``|s x n|``, 0: point."""
    radius = sqrt(_dot(axis, axis))
    e[:] = 0.0
    if radius == 0.0:
        return 0.0
    _cross_into(s, axis, e)
    size: float = sqrt(_dot(e, e)) / radius
    for i in range(3):
        e[i] /= size * radius
    return size


@subroutine
def turn_into(y: FloatArray, e: FloatArray, size: float, out: FloatArray) -> None:
    """Change of a touching point for a change ``y`` of ``s x (r n)``; ``size`` is ``|s x n|``."""
    along = _dot(e, y)
    for i in range(3):
        out[i] = (y[i] - along * e[i]) / size if size > 0.0 else 0.0


@subroutine
def _matrix(
    u: FloatArray, m: FloatArray, ends: FloatArray, sizes: FloatArray, A: FloatArray
) -> None:
    """Derivative of F by s."""
    unit, y, c = np.zeros(3), np.empty(3), np.empty(3)
    for j in range(3):
        unit[:] = 0.0
        unit[j] = 1.0
        for i in range(3):
            A[i, j] = unit[i]
        for side in range(2):
            _cross_into(unit, u if side == 0 else m, y)
            turn_into(y, ends[side], sizes[side], c)
            for i in range(3):
                A[i, j] += c[i] if side == 0 else -c[i]


@subroutine
def _invert(A: FloatArray, out: FloatArray) -> None:
    """Inverse of a matrix (3, 3)."""
    for i in range(3):
        _cross_into(A[(i + 1) % 3], A[(i + 2) % 3], out[i])
    determinant = _dot(A[0], out[0])
    for i in range(3):
        for j in range(i):
            out[i, j], out[j, i] = out[j, i], out[i, j]
    for i in range(3):
        for j in range(3):
            out[i, j] /= determinant


@subroutine
def _start(D: FloatArray, u: FloatArray, m: FloatArray, s: FloatArray) -> None:
    """The straight part as if both sheaves were in one plane."""
    w, side = np.empty(3), np.empty(3)
    for i in range(3):
        w[i] = m[i] - u[i]
    _cross_into(D, w, side)
    square = _dot(D, D)
    length = sqrt(max(square - _dot(w, w), 0.0))
    for i in range(3):
        s[i] = (length * D[i] + side[i]) / square * length


@subroutine
def straight_into(
    D: FloatArray, u: FloatArray, m: FloatArray, s: FloatArray, ends: FloatArray,
    sizes: FloatArray, inverse: FloatArray,
) -> None:  # fmt: skip
    """Solve F = 0 for the line from a circle with ``u`` to one with ``m``, D between the centres.

    Writes the line ``s``, not a number where there is none; unit vectors ``ends`` from the centres
    to where it touches them, zero of points; ``sizes`` ``|s x n|`` there; and the inverse of the
    derivative of F.
    """
    A, F, ra, rb = np.empty((3, 3)), np.empty(3), sqrt(_dot(u, u)), sqrt(_dot(m, m))
    _start(D, u, m, s)
    for _ in range(_STEPS):
        sizes[0], sizes[1] = _touch(s, u, ends[0]), _touch(s, m, ends[1])
        _matrix(u, m, ends, sizes, A)
        _invert(A, inverse)
        for i in range(3):
            F[i] = s[i] + ra * ends[0, i] - rb * ends[1, i] - D[i]
        change = 0.0
        for i in range(3):
            step = _dot(inverse[i], F)
            s[i] -= step
            change += abs(step)
        if change <= _SMALL * (sqrt(_dot(D, D)) + ra + rb):
            return
    s[:] = np.nan
