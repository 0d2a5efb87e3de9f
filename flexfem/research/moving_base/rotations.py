# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rotation of sections by theta1, theta2, theta3: exactly, and to second order."""

from functools import cache

import numpy as np

from flexfem._types import FloatArray

__all__ = ["PERMUTATION", "ROTATIONS", "rotation_matrices", "second_derivatives"]

#: Names: a sequence of rotations about the axes of the base, one about the vector theta, none but
#: the first order.
ROTATIONS = ("sequence", "vector", "linear")

#: Permutation symbol.
PERMUTATION = np.zeros((3, 3, 3))
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    PERMUTATION[_i, _j, _k], PERMUTATION[_i, _k, _j] = 1.0, -1.0


def rotation_matrices(name: str, theta: FloatArray) -> FloatArray:
    """Matrices (k, 3, 3) of angles (k, 3); those of first order are no rotations, "vector" is."""
    if name != "sequence":
        from flexfem.lie import so3  # compiled code, which building a model does without

        return so3.exp(np.ascontiguousarray(theta))
    (c1, c2, c3), (s1, s2, s3) = np.cos(theta).T, np.sin(theta).T
    rows = [
        [c3 * c2, c3 * s2 * s1 - s3 * c1, c3 * s2 * c1 + s3 * s1],
        [s3 * c2, s3 * s2 * s1 + c3 * c1, s3 * s2 * c1 - c3 * s1],
        [-s2, c2 * s1, c2 * c1],
    ]
    matrices: FloatArray = np.moveaxis(np.array(rows), -1, 0)
    return matrices


@cache
def second_derivatives(name: str) -> FloatArray:
    """Of the matrix R_ab by theta_k and theta_l where theta = 0, (3, 3, 3, 3)."""
    one = np.eye(3)
    # theta~ theta~ = theta theta^T - theta^2
    pairs = np.einsum("ak,bl->abkl", one, one)
    vector = 0.5 * (pairs + np.swapaxes(pairs, 2, 3)) - np.einsum("ab,kl->abkl", one, one)
    c = np.zeros((3, 3, 3))
    for i, k, m, half in ((0, 1, 2, -0.5), (1, 0, 2, 0.5), (2, 0, 1, -0.5)):
        c[i, k, m] = c[i, m, k] = half
    sequence = vector - np.einsum("abi,ikl->abkl", PERMUTATION, c)
    by_name: dict[str, FloatArray] = {
        "linear": 0.0 * vector, "vector": vector, "sequence": sequence,
    }  # fmt: skip
    return by_name[name]
