# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rows of nodes along lines of shells, which joints connect."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.marker import SurfaceMarker

__all__ = ["NodeRow"]

#: Part of a segment within which a place on it is a node.
_NODE = 1e-6


@dataclass(frozen=True, eq=False)
class NodeRow:
    """Nodes along a named line of a shell at the start.

    Attributes:
        name: of shell and line, for messages.
        body: the shell.
        nodes: (n,) numbers in the surface mesh in order; a closed row repeats its first node.
        points: (n, 3) their positions, m.
        apexes: (n - 1,) node beside each segment, that of a triangle of the shell.
        stiffness: (n - 1,) moment per length and angle, N, by which these triangles resist rotation
            about the segments, infinite where they rotate with the shell.
        damping: stiffness-proportional damping of the shell, s.
        beside: (n - 1, 2, 3) nodes of two triangles whose slopes across a segment are those of the
            shell at ``slopes`` (n - 1, 2), places from 0 to 1 in the segment; where both are the
            same, it is one triangle.
    """

    name: str
    body: str
    nodes: IntArray
    points: FloatArray
    apexes: IntArray
    stiffness: FloatArray
    damping: float
    beside: IntArray
    slopes: FloatArray

    @property
    def count(self) -> int:
        """Number of different nodes."""
        return len(self.nodes) - int(self.nodes[0] == self.nodes[-1])

    @property
    def length(self) -> float:
        """Length at the start, m."""
        return float(np.linalg.norm(self.sides, axis=1).sum())

    @cached_property
    def sides(self) -> FloatArray:
        """(n - 1, 3) vectors from node to node, m."""
        return np.diff(self.points, axis=0)

    def node(self, k: int) -> SurfaceMarker:
        """Marker at a node of the row."""
        return SurfaceMarker(self.body, (int(self.nodes[k]),), (1.0,))

    def midpoint(self, k: int) -> SurfaceMarker:
        """Marker at the midpoint of a segment."""
        return SurfaceMarker(self.body, self.nodes[k : k + 2].tolist(), (0.5, 0.5))

    def tilted(self, k: int, along: float) -> list[tuple[SurfaceMarker, float]]:
        """Markers that rotate with the shell at a place in a segment, with their weights."""
        first, second = self.slopes[k].tolist()
        part = 0.0 if first == second else (along - first) / (second - first)
        part = min(max(part, 0.0), 1.0)
        weights = zip(self.beside[k].tolist(), (1.0 - part, part), strict=True)
        thirds = (1.0 / 3.0,) * 3
        return [(SurfaceMarker(self.body, nodes, thirds), w) for nodes, w in weights if w > 0.0]

    def closest(self, x: FloatArray) -> tuple[int, float, FloatArray]:
        """Segment, place in it (0 to 1), and the vector from there to a point x, m."""
        squares = (self.sides**2).sum(axis=1)
        along = np.clip(((x - self.points[:-1]) * self.sides).sum(axis=1) / squares, 0.0, 1.0)
        gaps = x - self.points[:-1] - along[:, np.newaxis] * self.sides
        k = int(np.argmin((gaps**2).sum(axis=1)))
        return k, float(along[k]), gaps[k]

    def place(self, k: int, along: float, offset: FloatArray) -> SurfaceMarker:
        """Marker at a place in a segment, or ``offset`` beside it; at a node where it is there."""
        if min(along, 1.0 - along) < _NODE:
            at = int(self.nodes[k + int(along > 0.5)])
            return SurfaceMarker(self.body, (at,), (1.0,), offset)
        pair = self.nodes[k : k + 2].tolist()
        return SurfaceMarker(self.body, pair, (1.0 - along, along), offset)
