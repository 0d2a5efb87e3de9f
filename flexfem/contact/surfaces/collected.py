# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points and primitives of collision surfaces as they are added, body after body."""

from dataclasses import dataclass, field

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.contact.surfaces.primitives import Primitives, edges_of

__all__ = ["GROUND", "Collected", "CollisionBody"]

#: Kind of points that are fixed in space.
GROUND = -1


@dataclass(frozen=True)
class CollisionBody:
    """One body or rigid surface that touches.

    Attributes:
        label: for messages.
        owner: name of the body of the model that it is or is carried by, "" for the ground.
        carried: True for a rigid surface of a contact.
        rigid: True for this and for rigid bodies.
        through: stiffness through the thickness, N/m^3, infinite for rigid ones and where unknown.
        density: mass per area, kg/m^2, infinite on the ground and where unknown.
    """

    label: str
    owner: str
    carried: bool
    rigid: bool
    through: float
    density: float


@dataclass
class Collected:
    """Points, first those fixed to nodes, and what lies between them.

    Attributes:
        bodies: all bodies.
    """

    bodies: list[CollisionBody] = field(default_factory=list)
    _carried: list[tuple[IntArray, IntArray, FloatArray, BoolArray, FloatArray]] = field(
        default_factory=list
    )
    _between: list[tuple[IntArray, FloatArray]] = field(default_factory=list)
    _points: list[tuple[IntArray, float, int, FloatArray, bool]] = field(default_factory=list)
    _edges: list[tuple[IntArray, IntArray]] = field(default_factory=list)
    _triangles: list[tuple[IntArray, IntArray, IntArray, IntArray]] = field(default_factory=list)
    carried: int = 0

    def body(self, body: CollisionBody) -> int:
        """Add a body; returns its number."""
        self.bodies.append(body)
        return len(self.bodies) - 1

    def fixed(
        self, kind: int, node: IntArray, start: FloatArray, arms: FloatArray | None = None,
        held: BoolArray | None = None,
    ) -> IntArray:  # fmt: skip
        """Add points fixed to nodes; returns their numbers."""
        count, first = len(node), self.carried
        mask = np.zeros((count, 6), dtype=np.bool_)
        if held is not None:
            mask[:, : held.shape[1]] = held
        arms = np.zeros((count, 3)) if arms is None else arms
        kinds = np.full(count, kind)
        self._carried.append((kinds, np.asarray(node, dtype=np.int64), arms, mask, start))
        self.carried += count
        return np.arange(first, self.carried)

    def means(self, parents: IntArray, weights: FloatArray) -> IntArray:
        """Add means (k, q) of fixed points; returns numbers that follow -2 downwards."""
        first = sum(len(rows) for rows, _ in self._between)
        self._between.append((parents, weights))
        return -2 - np.arange(first, first + len(parents))

    def touching(
        self, rows: IntArray, radius: float, body: int, areas: FloatArray | None = None,
        vertex: bool = True,
    ) -> None:  # fmt: skip
        """Give points a radius, a body and the areas that they have without triangles.

        Those that are no vertex are further ones between the ends of an edge.
        """
        areas = np.zeros(len(rows)) if areas is None else areas
        self._points.append((rows, radius, body, areas, vertex))

    def edges(self, edges: IntArray, body: int) -> None:
        """Add edges of a polyline between points."""
        self._edges.append((edges, np.full(len(edges), body)))

    def triangles(
        self, triangles: IntArray, body: int, element: IntArray | None = None, side: int = 0
    ) -> None:
        """Add triangles between points; ``side`` is 1 where only that of the normals touches."""
        count = len(triangles)
        element = np.full(count, -1) if element is None else element
        self._triangles.append((triangles, np.full(count, body), element, np.full(count, side)))

    def _rows(self, rows: IntArray) -> IntArray:
        """Final numbers of points: means follow the fixed ones."""
        return np.where(rows < -1, self.carried - 2 - rows, rows)

    def all_carried(
        self,
    ) -> tuple[IntArray, IntArray, FloatArray, BoolArray, FloatArray, IntArray, FloatArray]:
        """Kinds, nodes, arms, fixed unknowns, all positions at the start, parents and weights."""
        nothing = (
            np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3)),
            np.zeros((0, 6), np.bool_), np.zeros((0, 3)),
        )  # fmt: skip
        kind, node, arms, held, fixed = (
            np.concatenate([none, *(one[k] for one in self._carried)])
            for k, none in enumerate(nothing)
        )
        width = max((rows.shape[1] for rows, _ in self._between), default=2)
        wide = [((0, 0), (0, width - rows.shape[1])) for rows, _ in self._between]
        every = list(zip(self._between, wide, strict=True))
        rows = [np.pad(one, fill, mode="edge") for (one, _), fill in every]
        shares = [np.pad(one, fill) for (_, one), fill in every]
        parents = np.concatenate([np.zeros((0, width), np.int64), *rows])
        weights = np.concatenate([np.zeros((0, width)), *shares])
        means = np.einsum("dq,dqa->da", weights, fixed[parents])
        start = np.concatenate([fixed, means])
        return kind, node, arms, held, start, parents, weights

    def primitives(self, start: FloatArray) -> Primitives:
        """All points, edges and triangles, given the positions (n, 3) of all points, m.

        A point of several bodies belongs to the first of them.
        """
        count = len(start)
        radius, body, areas = np.zeros(count), np.full(count, -1), np.zeros(count)
        corner = np.zeros(count, dtype=np.bool_)
        for rows, radii, number, own, vertex in reversed(self._points):
            at = self._rows(rows)
            radius[at], body[at] = np.maximum(radius[at], radii), number
            areas[at] += own
            corner[at] |= vertex
        triangles, owner = self.all_triangles()[:2]
        lines = [np.zeros((0, 2), np.int64), *(self._rows(one) for one, _ in self._edges)]
        sides, first = edges_of(triangles)
        of_lines = _joined([number for _, number in self._edges])
        return Primitives(
            start, body, corner, radius, areas, np.concatenate([*lines, sides]), len(of_lines),
            np.concatenate([of_lines, owner[first]]), triangles, owner,
        )  # fmt: skip

    def all_triangles(self) -> tuple[IntArray, IntArray, IntArray, IntArray]:
        """Triangles (m, 3), their bodies, elements and sides."""
        triangles = [np.zeros((0, 3), np.int64), *(one[0] for one in self._triangles)]
        body, element, side = (_joined([one[k] for one in self._triangles]) for k in (1, 2, 3))
        return np.concatenate(triangles), body, element, side


def _joined(parts: list[IntArray]) -> IntArray:
    return np.concatenate([np.zeros(0, np.int64), *parts])
