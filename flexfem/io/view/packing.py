# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arrays made small for a page: whole numbers of 16 bits, their changes with time, deflated.

``web/arrays.js`` is the other side. A number is rounded to 1/65534 of the range of its array, which
is less than a pixel on any screen. Motions change little from one instant to the next, and their
rates less: differences of the first or second order are stored, whichever are smaller, with the
sign in the lowest bit, low and high bytes apart. What comes out is mostly zeros.
"""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["MISSING", "Pack", "Reference", "rounded"]

type FloatArray = NDArray[np.floating[Any]]
type Reference = dict[str, Any]

#: Stands for a value that is not known or not finite.
MISSING = -32768
_LARGEST = 32767
#: Higher levels take several times as long for some percent.
_LEVEL = 6


def rounded(values: FloatArray, low: float, high: float) -> NDArray[np.int16]:
    """Numbers of 16 bits for values between two bounds; ``MISSING`` for those not finite."""
    step = (high - low) / (2 * _LARGEST) or 1.0
    known = np.isfinite(values)
    with np.errstate(invalid="ignore", over="ignore"):
        steps = np.rint((np.where(known, values, low) - low) / step) - _LARGEST
    steps = np.clip(steps, -_LARGEST, _LARGEST)
    return np.where(known, steps, MISSING).astype(np.int16)


class Pack:
    """The arrays of a page, one after the other."""

    def __init__(self) -> None:
        """Begin without any."""
        self._chunks: list[bytes] = []
        self._size = 0

    @property
    def data(self) -> bytes:
        """All arrays."""
        return b"".join(self._chunks)

    def store(self, values: NDArray[Any]) -> Reference:
        """Keep an array as it is; returns what finds it again."""
        plain = np.ascontiguousarray(values)
        plain = plain.astype(plain.dtype.newbyteorder("<"), copy=False)
        return self._add(plain.tobytes(), plain.dtype.name, plain.shape)

    def store_motion(self, values: NDArray[np.int16]) -> Reference:
        """Keep numbers that change with time (instants, ...)."""
        flat = values.reshape(len(values), -1)
        before = np.zeros((1, flat.shape[1]), np.int16)
        signed = np.diff(flat, axis=0, prepend=before)
        second = np.diff(signed, axis=0, prepend=before)
        order = 2 if _cost(second) < _cost(signed) else 1
        signed = second if order == 2 else signed
        folded = ((signed << 1) ^ (signed >> 15)).astype("<u2")
        planes = folded.reshape(-1).view(np.uint8).reshape(-1, 2).T
        found = self._add(planes.tobytes(), "int16", values.shape)
        return found | {"order": order}

    def _add(self, raw: bytes, kind: str, shape: tuple[int, ...]) -> Reference:
        packed = zlib.compress(raw, _LEVEL)
        place = {"at": self._size, "bytes": len(packed), "type": kind, "shape": list(shape)}
        self._chunks.append(packed)
        self._size += len(packed)
        return place


def _cost(differences: NDArray[np.int16]) -> int:
    """About the bits that differences need."""
    sizes = np.abs(differences.astype(np.int32))
    return int(np.sum(np.log2(1.0 + sizes, dtype=np.float32), dtype=np.float64))
