# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rotations: exponential, logarithm and tangent maps of SO(3).

A rotation vector ``theta`` (rad) represents the rotation matrix ``R = exp(skew(theta))``. The
tangent map is the right one: ``R(theta + d) = R(theta) exp(T(theta) d)`` to first order, so that
``T d`` is the increment of rotation in the rotated axes. The left map is ``T(-theta)``.

The functions named ``*_into`` are compiled, work on flat float64 arrays (matrices row by row, 9
entries), write to their last argument and allocate nothing; they are meant for other compiled code.
All others take arrays with any leading batch axes.

Formulas: Müller, Proc. R. Soc. A 477 (2021) 20210303; Sonneville, Cardona, Brüls, Comput. Methods
Appl. Mech. Eng. 268 (2014) 451-474.
"""

from math import atan2, sqrt

import numpy as np
import numpy.typing as npt

from flexfem._types import FloatArray
from flexfem.kernels.compiled import inlined, kernel
from flexfem.lie._batch import batch, batch_pair
from flexfem.lie._blocks import dot, first_block, map_block, triple
from flexfem.lie._coefficients import (
    Triple,
    inverse_coefficient,
    inverse_derivatives,
    pose_coefficients,
    tangent_derivatives,
)
from flexfem.lie.quaternion import from_matrix

__all__ = [
    "exp",
    "exp_into",
    "inverse_tangent",
    "inverse_tangent_derivative",
    "inverse_tangent_derivative_into",
    "inverse_tangent_into",
    "log",
    "log_into",
    "skew",
    "tangent",
    "tangent_derivative",
    "tangent_derivative_into",
    "tangent_into",
]


@inlined
def exp_into(theta: FloatArray, R: FloatArray) -> None:
    """Rotation matrix of a rotation vector."""
    t = triple(theta, 0)
    a, b, _ = pose_coefficients(dot(t, t))
    map_block(a, b, t, R, 0, 3)


@inlined
def log_entries(R: FloatArray, offset: int) -> Triple:
    """Rotation vector of the matrix stored at ``offset``."""
    w, v = from_matrix(R, offset)
    n = dot(v, v)
    if n < 1e-4:
        # atan(s)/s with s = |v|/w; s^8/9 is below rounding
        r = n / (w * w)
        factor = 2.0 / w * (1.0 - r * (1.0 / 3.0 - r * (0.2 - r * (1.0 / 7.0))))
    else:
        s = sqrt(n)
        factor = 2.0 * atan2(s, w) / s
    return factor * v[0], factor * v[1], factor * v[2]


@inlined
def log_into(R: FloatArray, theta: FloatArray) -> None:
    """Rotation vector of a rotation matrix, ``|theta| <= pi``; either sign at exactly pi."""
    theta[0], theta[1], theta[2] = log_entries(R, 0)


@inlined
def right_coefficients(x: float) -> tuple[Triple, Triple]:
    """Coefficients of skew(theta) and its square in the right tangent map, with derivatives."""
    b, c = tangent_derivatives(x)
    return (-b[0], -b[1], -b[2]), c


@inlined
def tangent_into(theta: FloatArray, T: FloatArray) -> None:
    """Right tangent map."""
    t = triple(theta, 0)
    _, b, c = pose_coefficients(dot(t, t))
    map_block(-b, c, t, T, 0, 3)


@inlined
def inverse_tangent_into(theta: FloatArray, Tinv: FloatArray) -> None:
    """Inverse of the right tangent map, ``|theta| < 2 pi``."""
    t = triple(theta, 0)
    map_block(0.5, inverse_coefficient(dot(t, t)), t, Tinv, 0, 3)


@inlined
def tangent_derivative_into(theta: FloatArray, direction: FloatArray, dT: FloatArray) -> None:
    """Derivative of the right tangent map along ``direction``."""
    t, u = triple(theta, 0), triple(direction, 0)
    p, q = right_coefficients(dot(t, t))
    first_block(p, q, t, u, dT, 0, 3)


@inlined
def inverse_tangent_derivative_into(
    theta: FloatArray, direction: FloatArray, dTinv: FloatArray
) -> None:
    """Derivative of the inverse of the right tangent map along ``direction``."""
    t, u = triple(theta, 0), triple(direction, 0)
    q = inverse_derivatives(dot(t, t))
    first_block((0.5, 0.0, 0.0), q, t, u, dTinv, 0, 3)


@kernel
def _exp_loop(theta: FloatArray, out: FloatArray) -> None:
    for i in range(len(out)):
        exp_into(theta[i], out[i])


@kernel
def _log_loop(R: FloatArray, out: FloatArray) -> None:
    for i in range(len(out)):
        log_into(R[i], out[i])


@kernel
def _tangent_loop(theta: FloatArray, out: FloatArray) -> None:
    for i in range(len(out)):
        tangent_into(theta[i], out[i])


@kernel
def _inverse_tangent_loop(theta: FloatArray, out: FloatArray) -> None:
    for i in range(len(out)):
        inverse_tangent_into(theta[i], out[i])


@kernel
def _tangent_derivative_loop(theta: FloatArray, direction: FloatArray, out: FloatArray) -> None:
    for i in range(len(out)):
        tangent_derivative_into(theta[i], direction[i], out[i])


@kernel
def _inverse_tangent_derivative_loop(
    theta: FloatArray, direction: FloatArray, out: FloatArray
) -> None:
    for i in range(len(out)):
        inverse_tangent_derivative_into(theta[i], direction[i], out[i])


def skew(v: npt.ArrayLike) -> FloatArray:
    """Matrix of the cross product, ``skew(v) w = v x w``.

    Args:
        v: vectors, shape (..., 3).

    Returns:
        Skew matrices, shape (..., 3, 3).

    Raises:
        ValueError: the last axis does not have length 3.
    """
    rows, leading = batch("so3.skew", "v", v, (3,))
    out = np.zeros((len(rows), 3, 3))
    out[:, 2, 1], out[:, 0, 2], out[:, 1, 0] = rows.T
    return (out - out.transpose(0, 2, 1)).reshape((*leading, 3, 3))


def exp(theta: npt.ArrayLike) -> FloatArray:
    """Rotation matrices of rotation vectors.

    Args:
        theta: rotation vectors (rad), shape (..., 3), any length.

    Returns:
        Rotation matrices, shape (..., 3, 3).

    Raises:
        ValueError: the last axis does not have length 3.
    """
    rows, leading = batch("so3.exp", "theta", theta, (3,))
    out = np.empty((len(rows), 9))
    _exp_loop(rows, out)
    return out.reshape((*leading, 3, 3))


def log(rotation: npt.ArrayLike) -> FloatArray:
    """Rotation vectors of rotation matrices, accurate from zero to pi.

    Args:
        rotation: rotation matrices, shape (..., 3, 3).

    Returns:
        Rotation vectors (rad), shape (..., 3), of length at most pi. At exactly pi both signs are
        right and one of them is returned.

    Raises:
        ValueError: the last axes are not 3 x 3.
    """
    rows, leading = batch("so3.log", "rotation", rotation, (3, 3))
    out = np.empty((len(rows), 3))
    _log_loop(rows, out)
    return out.reshape((*leading, 3))


def tangent(theta: npt.ArrayLike) -> FloatArray:
    """Right tangent map: ``exp(theta + d) = exp(theta) exp(tangent(theta) d)`` to first order.

    Args:
        theta: rotation vectors (rad), shape (..., 3).

    Returns:
        Tangent maps, shape (..., 3, 3).

    Raises:
        ValueError: the last axis does not have length 3.
    """
    rows, leading = batch("so3.tangent", "theta", theta, (3,))
    out = np.empty((len(rows), 9))
    _tangent_loop(rows, out)
    return out.reshape((*leading, 3, 3))


def inverse_tangent(theta: npt.ArrayLike) -> FloatArray:
    """Inverse of :func:`tangent`, for rotation vectors shorter than 2 pi.

    Args:
        theta: rotation vectors (rad), shape (..., 3).

    Returns:
        Inverse tangent maps, shape (..., 3, 3).

    Raises:
        ValueError: the last axis does not have length 3.
    """
    rows, leading = batch("so3.inverse_tangent", "theta", theta, (3,))
    out = np.empty((len(rows), 9))
    _inverse_tangent_loop(rows, out)
    return out.reshape((*leading, 3, 3))


def tangent_derivative(theta: npt.ArrayLike, direction: npt.ArrayLike) -> FloatArray:
    """Directional derivative of :func:`tangent`.

    Args:
        theta: rotation vectors (rad), shape (..., 3).
        direction: change of ``theta``, shape (..., 3); leading axes broadcast.

    Returns:
        ``d/ds tangent(theta + s direction)`` at s = 0, shape (..., 3, 3).

    Raises:
        ValueError: a last axis does not have length 3, or the leading axes do not broadcast.
    """
    owner = "so3.tangent_derivative"
    rows, along, leading = batch_pair(owner, ("theta", "direction"), theta, direction, 3)
    out = np.empty((len(rows), 9))
    _tangent_derivative_loop(rows, along, out)
    return out.reshape((*leading, 3, 3))


def inverse_tangent_derivative(theta: npt.ArrayLike, direction: npt.ArrayLike) -> FloatArray:
    """Directional derivative of :func:`inverse_tangent`; arguments as :func:`tangent_derivative`.

    Args:
        theta: rotation vectors (rad), shape (..., 3).
        direction: change of ``theta``, shape (..., 3); leading axes broadcast.

    Returns:
        ``d/ds inverse_tangent(theta + s direction)`` at s = 0, shape (..., 3, 3).

    Raises:
        ValueError: a last axis does not have length 3, or the leading axes do not broadcast.
    """
    owner = "so3.inverse_tangent_derivative"
    rows, along, leading = batch_pair(owner, ("theta", "direction"), theta, direction, 3)
    out = np.empty((len(rows), 9))
    _inverse_tangent_derivative_loop(rows, along, out)
    return out.reshape((*leading, 3, 3))
