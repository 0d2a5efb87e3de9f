# SPDX-License-Identifier: LGPL-3.0-or-later
"""Validation and flattening of batched arguments."""

import math

import numpy as np
import numpy.typing as npt

from flexfem._types import FloatArray

__all__ = ["batch", "batch_pair"]


def _checked(owner: str, name: str, values: npt.ArrayLike, core: tuple[int, ...]) -> FloatArray:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim < len(core) or array.shape[array.ndim - len(core) :] != core:
        wanted = ", ".join(map(str, core))
        raise ValueError(f"{owner}: {name} must have the shape (..., {wanted}), got {array.shape}")
    return array


def _flat(array: FloatArray, leading: tuple[int, ...], core: tuple[int, ...]) -> FloatArray:
    """Contiguous rows, one for each member of the batch (also of an empty one)."""
    full = array if array.shape == leading + core else np.broadcast_to(array, leading + core)
    return np.ascontiguousarray(full).reshape(math.prod(leading), math.prod(core))


def batch(
    owner: str, name: str, values: npt.ArrayLike, core: tuple[int, ...]
) -> tuple[FloatArray, tuple[int, ...]]:
    """Return `values` as contiguous rows and the leading axes of the batch.

    Raises:
        ValueError: the last axes are not `core`.
    """
    array = _checked(owner, name, values, core)
    leading = array.shape[: array.ndim - len(core)]
    return _flat(array, leading, core), leading


def batch_pair(
    owner: str, names: tuple[str, str], first: npt.ArrayLike, second: npt.ArrayLike, size: int
) -> tuple[FloatArray, FloatArray, tuple[int, ...]]:
    """Return two arguments with a last axis of length `size`, broadcast against each other.

    Raises:
        ValueError: a last axis has another length, or the leading axes do not broadcast.
    """
    a = _checked(owner, names[0], first, (size,))
    b = _checked(owner, names[1], second, (size,))
    try:
        leading = np.broadcast_shapes(a.shape[:-1], b.shape[:-1])
    except ValueError:
        raise ValueError(
            f"{owner}: {names[0]} {a.shape} and {names[1]} {b.shape} have different leading axes"
        ) from None
    return _flat(a, leading, (size,)), _flat(b, leading, (size,)), leading
