# SPDX-License-Identifier: LGPL-3.0-or-later
"""Frames: exponential, logarithm and tangent maps of SE(3).

A frame ``H = (x, R)`` is stored as 12 numbers: the position ``x`` and the rows of the rotation
matrix ``R``. A twist is ``w = (u, theta)``, translation first, in the axes of the frame it moves:
``H <- H exp(w)``. Lengths in the unit of the model, angles in rad.

The tangent map is the right one: ``exp(w + d) = exp(w) exp(T(w) d)`` to first order; the left map
is ``T(-w)``. Its coupling block is the directional derivative of the rotation's tangent map,
because the coupling block of any power series of ``[[A, B], [0, A]]`` is the derivative of the
series at A along B.

The functions named ``*_into``, ``*_apply`` and ``coadjoint_product`` are compiled, work on flat
float64 arrays (matrices row by row, 36 entries), write to their last argument and allocate nothing;
they are meant for other compiled code. ``retract_rows`` is their loop over the nodes of a mesh. All
others take arrays with any leading batch axes.

Formulas: Müller, Proc. R. Soc. A 477 (2021) 20210303; Sonneville, Cardona, Brüls, Comput. Methods
Appl. Mech. Eng. 268 (2014) 451-474.
"""

import numpy as np
import numpy.typing as npt

from flexfem._types import FloatArray
from flexfem.kernels.compiled import kernel
from flexfem.lie._batch import batch, batch_pair
from flexfem.lie._frames import (
    adjoint_into,
    coadjoint_product,
    compose_into,
    exp_into,
    inverse_into,
    inverse_tangent_apply,
    inverse_tangent_derivative_into,
    inverse_tangent_into,
    log_into,
    retract_into,
    tangent_apply,
    tangent_derivative_into,
    tangent_into,
)

__all__ = [
    "adjoint",
    "adjoint_into",
    "coadjoint_product",
    "compose",
    "compose_into",
    "exp",
    "exp_into",
    "frame",
    "inverse",
    "inverse_into",
    "inverse_tangent",
    "inverse_tangent_apply",
    "inverse_tangent_derivative",
    "inverse_tangent_derivative_into",
    "inverse_tangent_into",
    "log",
    "log_into",
    "position",
    "retract",
    "retract_into",
    "retract_rows",
    "rotation",
    "tangent",
    "tangent_apply",
    "tangent_derivative",
    "tangent_derivative_into",
    "tangent_into",
]


@kernel
def retract_rows(H0: FloatArray, w: FloatArray, H: FloatArray) -> None:
    """``H[i] = H0[i] exp(w[i])`` for arrays of shapes (n, 12), (n, 6), (n, 12); H may be H0."""
    for i in range(len(H)):
        retract_into(H0[i], w[i], H[i])


@kernel
def _exp_loop(w: FloatArray, out: FloatArray) -> None:
    for i in range(len(out)):
        exp_into(w[i], out[i])


@kernel
def _log_loop(H: FloatArray, out: FloatArray) -> None:
    for i in range(len(out)):
        log_into(H[i], out[i])


@kernel
def _compose_loop(A: FloatArray, B: FloatArray, out: FloatArray) -> None:
    for i in range(len(out)):
        compose_into(A[i], B[i], out[i])


@kernel
def _inverse_loop(H: FloatArray, out: FloatArray) -> None:
    for i in range(len(out)):
        inverse_into(H[i], out[i])


@kernel
def _adjoint_loop(H: FloatArray, out: FloatArray) -> None:
    for i in range(len(out)):
        adjoint_into(H[i], out[i])


@kernel
def _tangent_loop(w: FloatArray, out: FloatArray) -> None:
    for i in range(len(out)):
        tangent_into(w[i], out[i])


@kernel
def _inverse_tangent_loop(w: FloatArray, out: FloatArray) -> None:
    for i in range(len(out)):
        inverse_tangent_into(w[i], out[i])


@kernel
def _tangent_derivative_loop(w: FloatArray, direction: FloatArray, out: FloatArray) -> None:
    for i in range(len(out)):
        tangent_derivative_into(w[i], direction[i], out[i])


@kernel
def _inverse_tangent_derivative_loop(w: FloatArray, direction: FloatArray, out: FloatArray) -> None:
    for i in range(len(out)):
        inverse_tangent_derivative_into(w[i], direction[i], out[i])


def frame(position: npt.ArrayLike, rotation: npt.ArrayLike) -> FloatArray:
    """Frames from positions and rotation matrices.

    Args:
        position: shape (..., 3).
        rotation: shape (..., 3, 3); leading axes broadcast against those of ``position``.

    Returns:
        Frames, shape (..., 12).

    Raises:
        ValueError: wrong last axes, or leading axes that do not broadcast.
    """
    matrices, leading = batch("se3.frame", "rotation", rotation, (3, 3))
    rows = matrices.reshape((*leading, 9))
    points, start = batch("se3.frame", "position", position, (3,))
    try:
        shape = np.broadcast_shapes(start, leading)
    except ValueError:
        raise ValueError(
            f"se3.frame: position {(*start, 3)} and rotation {(*leading, 3, 3)} "
            f"have different leading axes"
        ) from None
    out = np.empty((*shape, 12))
    out[..., :3] = points.reshape((*start, 3))
    out[..., 3:] = rows
    return out


def position(H: npt.ArrayLike) -> FloatArray:
    """Positions (..., 3) of frames (..., 12), as a new array."""
    rows, leading = batch("se3.position", "H", H, (12,))
    return rows[:, :3].reshape((*leading, 3)).copy()


def rotation(H: npt.ArrayLike) -> FloatArray:
    """Rotation matrices (..., 3, 3) of frames (..., 12), as a new array."""
    rows, leading = batch("se3.rotation", "H", H, (12,))
    return rows[:, 3:].reshape((*leading, 3, 3)).copy()


def exp(w: npt.ArrayLike) -> FloatArray:
    """Frames (..., 12) of twists (..., 6).

    Raises:
        ValueError: the last axis does not have length 6.
    """
    rows, leading = batch("se3.exp", "w", w, (6,))
    out = np.empty((len(rows), 12))
    _exp_loop(rows, out)
    return out.reshape((*leading, 12))


def log(H: npt.ArrayLike) -> FloatArray:
    """Twists (..., 6) of frames (..., 12), with rotations of at most pi.

    Raises:
        ValueError: the last axis does not have length 12.
    """
    rows, leading = batch("se3.log", "H", H, (12,))
    out = np.empty((len(rows), 6))
    _log_loop(rows, out)
    return out.reshape((*leading, 6))


def compose(A: npt.ArrayLike, B: npt.ArrayLike) -> FloatArray:
    """Frames ``A B`` (..., 12); leading axes broadcast.

    Raises:
        ValueError: a last axis does not have length 12, or leading axes do not broadcast.
    """
    left, right, leading = batch_pair("se3.compose", ("A", "B"), A, B, 12)
    out = np.empty((len(left), 12))
    _compose_loop(left, right, out)
    return out.reshape((*leading, 12))


def retract(H: npt.ArrayLike, w: npt.ArrayLike) -> FloatArray:
    """Frames ``H exp(w)`` (..., 12) from frames (..., 12) and twists (..., 6).

    Raises:
        ValueError: wrong last axes, or leading axes that do not broadcast.
    """
    return compose(H, exp(w))


def inverse(H: npt.ArrayLike) -> FloatArray:
    """Inverse frames (..., 12).

    Raises:
        ValueError: the last axis does not have length 12.
    """
    rows, leading = batch("se3.inverse", "H", H, (12,))
    out = np.empty((len(rows), 12))
    _inverse_loop(rows, out)
    return out.reshape((*leading, 12))


def adjoint(H: npt.ArrayLike) -> FloatArray:
    """Adjoint maps (..., 6, 6): ``H exp(w) = exp(adjoint(H) w) H``.

    Raises:
        ValueError: the last axis does not have length 12.
    """
    rows, leading = batch("se3.adjoint", "H", H, (12,))
    out = np.empty((len(rows), 36))
    _adjoint_loop(rows, out)
    return out.reshape((*leading, 6, 6))


def tangent(w: npt.ArrayLike) -> FloatArray:
    """Right tangent maps (..., 6, 6): ``exp(w + d) = exp(w) exp(tangent(w) d)`` to first order.

    Raises:
        ValueError: the last axis does not have length 6.
    """
    rows, leading = batch("se3.tangent", "w", w, (6,))
    out = np.empty((len(rows), 36))
    _tangent_loop(rows, out)
    return out.reshape((*leading, 6, 6))


def inverse_tangent(w: npt.ArrayLike) -> FloatArray:
    """Inverses (..., 6, 6) of :func:`tangent`, for rotations of less than 2 pi.

    Raises:
        ValueError: the last axis does not have length 6.
    """
    rows, leading = batch("se3.inverse_tangent", "w", w, (6,))
    out = np.empty((len(rows), 36))
    _inverse_tangent_loop(rows, out)
    return out.reshape((*leading, 6, 6))


def tangent_derivative(w: npt.ArrayLike, direction: npt.ArrayLike) -> FloatArray:
    """Derivatives (..., 6, 6) of :func:`tangent` at ``w`` along ``direction``, both (..., 6).

    Raises:
        ValueError: a last axis does not have length 6, or leading axes do not broadcast.
    """
    owner = "se3.tangent_derivative"
    rows, along, leading = batch_pair(owner, ("w", "direction"), w, direction, 6)
    out = np.empty((len(rows), 36))
    _tangent_derivative_loop(rows, along, out)
    return out.reshape((*leading, 6, 6))


def inverse_tangent_derivative(w: npt.ArrayLike, direction: npt.ArrayLike) -> FloatArray:
    """Derivatives (..., 6, 6) of :func:`inverse_tangent` at ``w`` along ``direction``.

    Raises:
        ValueError: a last axis does not have length 6, or leading axes do not broadcast.
    """
    owner = "se3.inverse_tangent_derivative"
    rows, along, leading = batch_pair(owner, ("w", "direction"), w, direction, 6)
    out = np.empty((len(rows), 36))
    _inverse_tangent_derivative_loop(rows, along, out)
    return out.reshape((*leading, 6, 6))
