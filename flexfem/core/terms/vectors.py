# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled rotations and products of three numbers, written into arrays."""

from flexfem._types import FloatArray
from flexfem.lie.compiled import kernel

__all__ = ["cross_into", "dot", "rotate_back_into", "rotate_into"]


@kernel
def rotate_into(H: FloatArray, v: FloatArray, out: FloatArray, at: int) -> None:
    """``R v`` of a frame stored as 12 numbers."""
    for i in range(3):
        k = 3 + 3 * i
        out[at + i] = H[k] * v[0] + H[k + 1] * v[1] + H[k + 2] * v[2]


@kernel
def rotate_back_into(H: FloatArray, v: FloatArray, out: FloatArray, at: int) -> None:
    """``R^T v`` of a frame stored as 12 numbers."""
    for i in range(3):
        k = 3 + i
        out[at + i] = H[k] * v[0] + H[k + 3] * v[1] + H[k + 6] * v[2]


@kernel
def cross_into(a: FloatArray, b: FloatArray, out: FloatArray, at: int) -> None:
    """``a x b``."""
    out[at] = a[1] * b[2] - a[2] * b[1]
    out[at + 1] = a[2] * b[0] - a[0] * b[2]
    out[at + 2] = a[0] * b[1] - a[1] * b[0]


@kernel
def dot(a: FloatArray, b: FloatArray) -> float:
    """``a . b``."""
    product: float = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product
