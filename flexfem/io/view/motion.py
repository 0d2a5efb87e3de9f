# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motions of frames and points over the instants of a page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexfem.io.view.packing import Pack, rounded

__all__ = ["Anchors", "quaternions", "store_frames", "store_points"]

type FloatArray = NDArray[np.floating[Any]]
type IntArray = NDArray[np.integer[Any]]

#: Largest deviation of a rigid surface from its shape, relative to its size: twenty times what
#: single precision leaves, far below what can be seen.
_RIGID = 1e-4


def quaternions(rotations: FloatArray) -> FloatArray:
    """Unit quaternions (..., 4), scalar part last, of rotation matrices (..., 3, 3)."""
    R = np.asarray(rotations)
    trace = np.einsum("...ii->...", R)
    # 4 q q^T (Bar-Itzhack 2000): its largest column is far from zero
    K = np.empty((*R.shape[:-2], 4, 4))
    K[..., :3, :3] = R + np.swapaxes(R, -1, -2)
    K[..., range(3), range(3)] += (1.0 - trace)[..., None]
    axis = np.stack(
        [R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], -1
    )
    K[..., :3, 3] = K[..., 3, :3] = axis
    K[..., 3, 3] = 1.0 + trace
    best = np.argmax(np.einsum("...ii->...i", K), axis=-1)
    q = np.take_along_axis(K, best[..., None, None], axis=-1)[..., 0]
    length = np.linalg.norm(q, axis=-1, keepdims=True)
    return q / np.where(length > 0.0, length, 1.0)


class Anchors:
    """Three points of every rigid part of a surface, from which its motion is found.

    Attributes:
        local: (n, 3) places of all points in the axes of their parts, which are inertial at the
            first instant, about the mean of each part.
    """

    def __init__(self, points: FloatArray, part: IntArray, parts: int) -> None:
        """Choose the points.

        Args:
            points: (n, 3) at the first instant.
            part: (n,) number of the part of each.
            parts: number of parts, each of which has points.
        """
        self._part = part
        count = np.bincount(part, minlength=parts)[:, None]
        self._centre = np.stack([np.bincount(part, w, parts) for w in points.T], 1) / count
        self.local = points - self._centre[part]
        first = _farthest(np.linalg.norm(self.local, axis=1), part, parts)
        along = points - points[first][part]
        second = _farthest(np.linalg.norm(along, axis=1), part, parts)
        line = points[second] - points[first]
        third = _farthest(np.linalg.norm(np.cross(along, line[part]), axis=1), part, parts)
        self._chosen = np.stack([first, second, third])
        self._axes = self._triads(points)
        size = np.linalg.norm(self.local, axis=1).max(initial=0.0)
        self._size = size if size > 0.0 else 1.0

    @property
    def flat(self) -> bool:
        """True if the points of some part lie on a line."""
        return not np.allclose(np.linalg.det(self._axes), 1.0, atol=1e-6)

    def frames(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Places (parts, 3) and rotations (parts, 3, 3) of all parts at another instant."""
        turn = self._triads(points) @ np.swapaxes(self._axes, -1, -2)
        first = self._chosen[0]
        return points[first] - np.einsum("nij,nj->ni", turn, self.local[first]), turn

    def fit(self, points: FloatArray, place: FloatArray, turn: FloatArray) -> bool:
        """True if the parts have kept their shapes."""
        moved = place[self._part] + np.einsum("nij,nj->ni", turn[self._part], self.local)
        return bool(np.abs(moved - points).max(initial=0.0) <= _RIGID * self._size)

    def _triads(self, points: FloatArray) -> FloatArray:
        a, b, c = (points[chosen] for chosen in self._chosen)
        e1 = _unit(b - a)
        e3 = _unit(np.cross(e1, c - a))
        return np.stack([e1, np.cross(e3, e1), e3], axis=-1)


def store_frames(
    pack: Pack, places: Sequence[FloatArray], turns: Sequence[FloatArray]
) -> dict[str, Any]:
    """Keep the motions of frames.

    Args:
        pack: where to.
        places: (n, 3) at each instant, m.
        turns: (n, 3, 3) at each instant.
    """
    q = quaternions(np.array(turns))
    for k in range(1, len(q)):  # the shorter way from each to the next
        q[k] *= np.where(np.einsum("ni,ni->n", q[k], q[k - 1]) < 0.0, -1.0, 1.0)[:, None]
    return {**store_points(pack, places), "turns": pack.store_motion(rounded(q, -1.0, 1.0))}


def store_points(
    pack: Pack, places: Sequence[FloatArray], about: FloatArray | None = None
) -> dict[str, Any]:
    """Keep the motions of points.

    Args:
        pack: where to.
        places: (n, 3) at each instant, m.
        about: (3,) the point from which they are measured, for single precision; by default the
            origin.
    """
    x = np.array(places)
    axes = tuple(range(x.ndim - 1))
    low, high = (x.min(axis=axes), x.max(axis=axes)) if x.size else (np.zeros(3), np.zeros(3))
    middle, half = 0.5 * (low + high).astype(float), float(0.5 * (high - low).max()) or 1.0
    # axis by axis: the largest array there is
    whole = np.empty(x.shape, dtype=np.int16)
    for i in range(3):
        whole[..., i] = rounded(x[..., i], middle[i] - half, middle[i] + half)
    far = middle if about is None else middle + about
    return {"places": pack.store_motion(whole), "middle": far.tolist(), "half": half}


def _farthest(distance: FloatArray, part: IntArray, parts: int) -> IntArray:
    """Point of the largest distance in every part."""
    order = np.lexsort((distance, part))
    return order[np.cumsum(np.bincount(part, minlength=parts)) - 1]


def _unit(v: FloatArray) -> FloatArray:
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return v / np.where(length > 0.0, length, 1.0)
