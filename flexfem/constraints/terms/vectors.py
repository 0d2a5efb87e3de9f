# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled operations with three numbers and matrices of them, for the terms of rows."""

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.nodes.step_kernels import turn_back
from flexfem.kernels.compiled import inlined, subroutine
from flexfem.lie._coefficients import Triple

__all__ = [
    "add_block",
    "cross_into",
    "dot",
    "force_gradient",
    "force_hessian",
    "mean",
    "multiply",
    "product",
    "put",
    "rotate_back_into",
    "rotate_into",
    "scaled",
    "skew",
    "skew_into",
    "turned",
]


@subroutine
def rotate_into(H: FloatArray, v: FloatArray, out: FloatArray, at: int) -> None:
    """``R v`` of a frame stored as 12 numbers."""
    for i in range(3):
        k = 3 + 3 * i
        out[at + i] = H[k] * v[0] + H[k + 1] * v[1] + H[k + 2] * v[2]


@subroutine
def rotate_back_into(H: FloatArray, v: FloatArray, out: FloatArray, at: int) -> None:
    """``R^T v`` of a frame stored as 12 numbers."""
    for i in range(3):
        k = 3 + i
        out[at + i] = H[k] * v[0] + H[k + 3] * v[1] + H[k + 6] * v[2]


@subroutine
def cross_into(a: FloatArray, b: FloatArray, out: FloatArray, at: int) -> None:
    """``a x b``."""
    out[at] = a[1] * b[2] - a[2] * b[1]
    out[at + 1] = a[2] * b[0] - a[0] * b[2]
    out[at + 2] = a[0] * b[1] - a[1] * b[0]


@subroutine
def dot(a: FloatArray, b: FloatArray) -> float:
    """``a . b``."""
    product: float = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


@subroutine
def skew_into(v: FloatArray, sign: float, out: FloatArray, i: int, j: int) -> None:
    """Add ``sign * skew(v)`` to the 3x3 block of ``out`` at (i, j)."""
    out[i, j + 1] -= sign * v[2]
    out[i, j + 2] += sign * v[1]
    out[i + 1, j] += sign * v[2]
    out[i + 1, j + 2] -= sign * v[0]
    out[i + 2, j] -= sign * v[1]
    out[i + 2, j + 1] += sign * v[0]


@subroutine
def skew(v: FloatArray) -> FloatArray:
    """The matrix of ``v x``."""
    out = np.zeros((3, 3))
    skew_into(v, 1.0, out, 0, 0)
    return out


@subroutine
def product(A: FloatArray, B: FloatArray) -> FloatArray:
    """``A B`` of matrices (3, 3)."""
    C = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            C[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]
    return C


@subroutine
def add_block(out: FloatArray, i: int, j: int, sign: float, B: FloatArray) -> None:
    """Add ``sign B`` to the 3x3 block of ``out`` at (i, j)."""
    for k in range(3):
        for m in range(3):
            out[i + k, j + m] += sign * B[k, m]


@subroutine
def multiply(A: FloatArray, v: FloatArray, out: FloatArray) -> None:
    """``A v``."""
    for i in range(3):
        out[i] = A[i, 0] * v[0] + A[i, 1] * v[1] + A[i, 2] * v[2]


@inlined
def mean(a: Triple, b: Triple) -> Triple:
    """The mean of two vectors."""
    return 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])


@inlined
def scaled(factor: float, v: Triple) -> Triple:
    """``factor v``."""
    return factor * v[0], factor * v[1], factor * v[2]


@inlined
def turned(A: FloatArray, v: Triple) -> Triple:
    """``A v`` of a matrix (3, 3)."""
    return (
        A[0, 0] * v[0] + A[0, 1] * v[1] + A[0, 2] * v[2],
        A[1, 0] * v[0] + A[1, 1] * v[1] + A[1, 2] * v[2],
        A[2, 0] * v[0] + A[2, 1] * v[1] + A[2, 2] * v[2],
    )


@inlined
def put(v: Triple, out: FloatArray, at: int) -> None:
    """Write a vector to ``out[at : at + 3]``."""
    out[at], out[at + 1], out[at + 2] = v


@subroutine
def force_gradient(Ha: FloatArray, Hb: FloatArray, direction: Triple, g: FloatArray) -> None:
    """Gradient, by both positions, of a function with the change ``direction . (dx_b - dx_a)``."""
    put(scaled(-1.0, turn_back(Ha, direction)), g, 0)
    put(turn_back(Hb, direction), g, 6)


@subroutine
def force_hessian(
    Ha: FloatArray, Hb: FloatArray, direction: FloatArray, h: FloatArray, s: FloatArray
) -> None:
    """Part of a Hessian from the rotation of local axes at a fixed ``direction``."""
    rotate_back_into(Ha, direction, s[1], 0)
    rotate_back_into(Hb, direction, s[2], 0)
    skew_into(s[1], -1.0, h, 0, 3)
    skew_into(s[2], 1.0, h, 6, 9)
