# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points on shells and the carriers of markers there: a node, a triangle, or nodes without axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.places.line_points import FIXED, TRIANGLE, line_pose
from flexfem.core.row import Row
from flexfem.layout.lines import Line, LinePoint
from flexfem.mesh.surface_mesh import SurfaceMesh

__all__ = ["SurfacePlace", "carrier_frame", "turning"]

#: Significant digits of a triangle's shape, so that ties are broken identically on every machine.
_DIGITS = 9


@dataclass(frozen=True)
class SurfacePlace:
    """Point on nodes without axes, such as those of shells.

    Attributes:
        kind: block of the nodes, that of their family.
        nodes: (k,) one node, two of an edge or three of a triangle, numbers in the family.
        weights: (k,) their weights in the position.
    """

    kind: int
    nodes: tuple[int, ...]
    weights: tuple[float, ...]

    def on_triangle(self, mesh: SurfaceMesh, rows: IntArray) -> SurfacePlace:
        """The same point in a triangle, the one of the best shape if there are several.

        Args:
            mesh: the surface mesh.
            rows: triangles of the shell.
        """
        member = np.isin(mesh.triangles[rows], self.nodes)
        found = rows[member.sum(axis=1) == len(self.nodes)]
        sides = mesh.points[mesh.triangles[found]]
        squares = ((sides - np.roll(sides, 1, axis=1)) ** 2).sum(axis=(1, 2))
        shape = np.round(mesh.areas[found] / squares, _DIGITS)
        triangle = mesh.triangles[found[np.argmax(shape)]]
        # the carrier of the point first: a side of the triangle along the edge
        inside = np.isin(triangle, self.nodes)
        turned = [np.roll(triangle, -k) for k in range(3)]
        first = max(range(3), key=lambda k: np.roll(inside, -k).tolist())
        weight = dict(zip(self.nodes, self.weights, strict=True))
        nodes = tuple(int(node) for node in turned[first])
        return SurfacePlace(self.kind, nodes, tuple(weight.get(node, 0.0) for node in nodes))

    def position(self, points: FloatArray) -> FloatArray:
        """Position (3,) from those of all nodes of the mesh (n, 3)."""
        x: FloatArray = np.array(self.weights) @ points[list(self.nodes)]
        return x

    def carrier(self, axes: bool) -> LinePoint:
        """The point as that of a line; with ``axes`` those of a triangle, else inertial axes."""
        k = len(self.nodes)
        shape = np.zeros((1, k, k))
        shape[0, :, 0] = self.weights
        line = Line(
            kind=self.kind,
            nodes=np.array([self.nodes], dtype=np.int64),
            cells=np.zeros(1, dtype=np.int64),
            shape=shape,
            turns=None,
            starts=np.zeros(1),
            arc=np.zeros((1, 1)),
            element=TRIANGLE if axes else FIXED,
        )
        return LinePoint(line, 0, 0.0)


def carrier_frame(point: LinePoint, points: FloatArray) -> FloatArray:
    """Frame (12,) at the start of the carrier of a point; ``points`` (n, 3) of the mesh."""
    line, H = point.line, np.empty(12)
    frames = np.zeros((line.nodes.shape[1], 12))
    frames[:, :3] = points[line.nodes[0]]
    assert line.shape is not None
    line_pose(line.element, frames, line.shape[0], 0.0, H)
    return H


def turning(rows: Sequence[Row], marker: int) -> bool:
    """Return True if rows depend on the axes of a marker, given by its number."""
    for term in (term for row in rows for term in row.terms):
        by_a, by_b = term.kind.axes
        if (by_a and marker == term.a) or (by_b and marker == term.b):
            return True
    return False
