# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points on nodes without axes and the carriers of markers there.

A carrier is a node, a triangle, a patch of nodes, or nodes with inertial axes. The axes of a patch
are those of the affine map ``x ~ xbar + A (X - Xbar)`` that is fitted to its nodes by least squares
with weights w_I: ``A = sum w_I x_I (M^+ d_I)^T`` with ``d_I = X_I - Xbar`` and ``M = sum w_I d_I
d_I^T``. It takes two directions t_1 and t_2 of the patch to ``A t_1`` and ``A t_2``, sums of nodal
positions with constant weights, whose axes are those of ``core.places.surface_points``. A wrench
on them is a statically equivalent set of nodal forces, as of an interpolation element (RBE3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.places.line_points import FIXED, SIDES, line_pose
from flexfem.core.row import Row
from flexfem.layout.lines import Line, LinePoint
from flexfem.mesh.surface_mesh import SurfaceMesh

__all__ = ["TRIANGLE_SIDES", "SurfacePlace", "carrier_frame", "fitted_sides", "turning"]

#: Weights of the corners in a triangle's sides, from its first corner to the second and the third.
TRIANGLE_SIDES: Final = ((-1.0, -1.0), (1.0, 0.0), (0.0, 1.0))

#: Significant digits of the shape of a triangle or of the extents of a patch, so that ties are
#: broken identically on every machine.
_DIGITS = 9


@dataclass(frozen=True, eq=False)
class SurfacePlace:
    """Point on nodes without axes, such as those of shells.

    Attributes:
        kind: block of the nodes, that of their family.
        nodes: (k,) one node, two of an edge, three of a triangle or those of a patch, numbers in
            the family.
        weights: (k,) their weights in the position.
        sides: (k, 2) their weights in the two sides that define axes, each with the sum zero; None
            for the sides of a triangle.
    """

    kind: int
    nodes: tuple[int, ...]
    weights: tuple[float, ...]
    sides: FloatArray | None = None

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
        """The point as that of a line; with ``axes`` those of its sides, else inertial axes.

        Raises:
            ValueError: axes of nodes without sides that are not three.
        """
        k = len(self.nodes)
        shape = np.zeros((1, k, k))
        shape[0, :, 0] = self.weights
        if axes:
            sides = np.array(TRIANGLE_SIDES if self.sides is None else self.sides)
            if sides.shape != (k, 2):
                raise ValueError(f"sides of {len(sides)} nodes cannot be those of {k}")
            shape[0, :, 1:3] = sides
        line = Line(
            kind=self.kind,
            nodes=np.array([self.nodes], dtype=np.int64),
            cells=np.zeros(1, dtype=np.int64),
            shape=shape,
            turns=None,
            starts=np.zeros(1),
            arc=np.zeros((1, 1)),
            element=SIDES if axes else FIXED,
        )
        return LinePoint(line, 0, 0.0)


def fitted_sides(points: FloatArray, weights: FloatArray) -> FloatArray:
    """Weights (k, 2) of nodes in the images of the two directions of their largest extents.

    Args:
        points: (k, 3) nodes at the start.
        weights: (k,) their weights in the fit, of which the amounts count.

    Raises:
        ValueError: the nodes are at one place or on one line.
    """
    amounts = np.abs(weights)
    offsets = points - amounts @ points / amounts.sum()
    moments = offsets.T @ (amounts[:, np.newaxis] * offsets)
    extents, axes = np.linalg.eigh(moments)
    least = 10.0**-_DIGITS * extents[-1]
    if not extents[1] > least:
        raise ValueError("they are on one line")
    # within round-off the same as axes of equal extents, whose directions are arbitrary
    group = np.cumsum(np.diff(extents[::-1], prepend=extents[-1]) < -least)
    directions = [
        direction for n in range(3) for direction in _directions(axes[:, ::-1][:, group == n])
    ]
    inverse = np.linalg.pinv(moments, rcond=10.0**-_DIGITS, hermitian=True)
    sides: FloatArray = amounts[:, np.newaxis] * (offsets @ inverse @ np.array(directions[:2]).T)
    return sides


def _directions(axes: FloatArray) -> list[FloatArray]:
    """Orthonormal directions in the space of some, (3, n), that depend on nothing but the space.

    They are the projections of inertial axes, the longest first, and so have the sign of their
    largest component.
    """
    space, found = axes @ axes.T, []
    for _ in range(axes.shape[1]):
        squares = np.diag(space)
        longest = int(np.argmax(np.round(squares, _DIGITS)))
        found.append(space[:, longest] / np.sqrt(squares[longest]))
        space = space - np.outer(found[-1], found[-1])
    return found


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
