# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dirichlet conditions along arbitrary directions: rotated nodal axes."""

from collections.abc import Iterator

import numpy as np

from flexfem import _checks
from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.joint import perpendicular
from flexfem.lie import se3

__all__ = ["RIGHT", "DirichletNodes"]

#: Cosines below this are those of right angles, above one minus it those of equal directions.
RIGHT = 1e-6


class DirichletNodes:
    """Directions in which nodes have Dirichlet conditions."""

    def __init__(self, points: FloatArray) -> None:
        """Start without conditions at the nodes (n, 3)."""
        self._points = points
        self._axes: dict[int, list[FloatArray]] = {}

    def add(self, owner: str, nodes: IntArray, axis: FloatArray) -> None:
        """Fix nodes along a unit vector, parallel or at right angles to those given before.

        Raises:
            ValueError: it is neither; the message begins with the owner.
        """
        for node in nodes.tolist():
            axes = self._axes.setdefault(node, [])
            cosines = [abs(float(axis @ other)) for other in axes]
            if len(axes) == 3 or any(cosine > 1.0 - RIGHT for cosine in cosines):
                continue
            if any(cosine > RIGHT for cosine in cosines):
                raise ValueError(
                    f"{owner}: node {node} at {_checks.show(self._points[node].tolist())} is "
                    "held in two directions that are not at right angles"
                )
            axes.append(axis)

    def frames(self) -> tuple[FloatArray, BoolArray]:
        """Frames (n, 12) of all nodes, and flags (n, 3) of the axes along which they are fixed."""
        points = self._points
        turns, mask = np.tile(np.eye(3), (len(points), 1, 1)), np.zeros((len(points), 3), np.bool_)
        for node, axes in self._axes.items():
            mask[node, : len(axes)] = True
            if len(axes) < 3:
                turns[node] = np.stack(list(_completed(axes)), axis=1)
        return se3.frame(points, turns), mask


def _completed(axes: list[FloatArray]) -> Iterator[FloatArray]:
    """One or two unit vectors at right angles, and those that complete them to a basis."""
    yield from axes
    if len(axes) == 1:
        yield from perpendicular(axes[0])
    else:
        yield np.cross(axes[0], axes[1])
