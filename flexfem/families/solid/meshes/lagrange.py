# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nodes of Lagrange cells of any degree, numbered without DOLFINx, and their shape functions.

A node is identified by the corners that it is a mean of and by their weights, which are the same
from all cells around it: vertices, edges, facets and interiors need not be distinguished.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import basix
import numpy as np

from flexfem._types import FloatArray, IntArray

__all__ = [
    "CELLS",
    "Lagrange",
    "element",
    "lattice",
    "quadrature_points",
    "quadrature_weights",
    "reference_facets",
    "reference_points",
    "shapes",
]

#: Dimension of the cells by their names.
CELLS = {"tetrahedron": 3, "hexahedron": 3, "prism": 3, "triangle": 2, "quadrilateral": 2}


@cache
def element(cell: str, degree: int) -> Any:
    """Basix's Lagrange element with equidistant nodes, as in the geometry of DOLFINx's meshes."""
    return basix.create_element(
        basix.ElementFamily.P, basix.CellType[cell], degree, basix.LagrangeVariant.equispaced
    )


@cache
def reference_points(cell: str, degree: int) -> FloatArray:
    """Nodes (k, d) in the reference cell."""
    points: FloatArray = element(cell, degree).points
    return points


@cache
def reference_facets(cell: str) -> list[list[int]]:
    """Corners of the facets of the reference cell."""
    kind = basix.CellType[cell]
    topology: Sequence[Any] = basix.topology(kind)
    return [list(facet) for facet in topology[len(topology) - 2]]


def shapes(cell: str, degree: int, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shape functions (q, k) at reference points (q, d), and their derivatives (q, k, d)."""
    table = element(cell, degree).tabulate(1, np.ascontiguousarray(points))[..., 0]
    return table[0], np.moveaxis(table[1:], 0, -1)


@cache
def _quadrature(cell: str, order: int) -> Any:
    return basix.make_quadrature(basix.CellType[cell], order)


def quadrature_points(cell: str, order: int) -> FloatArray:
    """Points (q, d) of the rule of an order in the reference cell, those of FFCx."""
    points: FloatArray = _quadrature(cell, order)[0]
    return points


def quadrature_weights(cell: str, order: int) -> FloatArray:
    """Their weights (q,)."""
    weights: FloatArray = _quadrature(cell, order)[1]
    return weights


@cache
def lattice(cell: str, degree: int) -> IntArray:
    """Weights (k, c) of the corners at the nodes, in units that are the same for all shapes."""
    weights = shapes(cell, 1, reference_points(cell, degree))[0]
    return np.rint(weights * float(degree) ** 3).astype(np.int64)


@dataclass(frozen=True)
class Lagrange:
    """Nodes of the cells of one mesh.

    Attributes:
        cells: (m, k) nodes of the cells in the order of Basix.
        points: (n, 3) places, m.
        degree: of the shape functions.
        keys: (n,) keys of the nodes, ascending; order: (n,) their nodes.
        tags: (p,) random numbers of the mesh's corners, of which keys are weighted sums.
    """

    cells: IntArray
    points: FloatArray
    degree: int
    keys: Any
    order: IntArray
    tags: Any

    @classmethod
    def of(
        cls, points: FloatArray, cells: IntArray, cell: str, degree: int, geometry: int
    ) -> Lagrange:
        """Number the nodes as they occur in the cells.

        Args:
            points: (p, 3) nodes of the geometry, m.
            cells: (m, g) cells of the geometry.
            cell: shape.
            degree: of the shape functions.
            geometry: degree of the geometry.
        """
        corners = cells[:, : len(lattice(cell, 1))]
        # weighted sums modulo 2^64 are equal for equal nodes, and else by chance of 1e-7 at most
        tags = np.random.default_rng(2024).integers(0, 2**63, len(points), dtype=np.uint64)
        keys = _keys(corners, cell, degree, tags).ravel()
        known, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
        order = np.empty(len(known), dtype=np.int64)
        order[np.argsort(first)] = np.arange(len(known))
        own = order[inverse.ravel()].reshape(len(cells), -1)
        at = shapes(cell, geometry, reference_points(cell, degree))[0]
        places = np.empty((len(known), 3))
        places[own] = np.einsum("kg,mga->mka", at, points[cells])
        if degree == geometry:
            places[own] = points[cells]
        return cls(own, places, degree, known, order, tags)

    def of_facets(self, corners: IntArray) -> tuple[str, IntArray]:
        """Shape and nodes (f, k) of facets of equally many corners (f, c), -1 for none."""
        count = int((corners >= 0).sum(axis=1).max(initial=2))
        shape = {2: "interval", 3: "triangle", 4: "quadrilateral"}[count]
        keys = _keys(corners[:, :count], shape, self.degree, self.tags)
        return shape, self.order[np.searchsorted(self.keys, keys)]

    def corner(self, points: IntArray) -> IntArray:
        """Nodes at corners of the mesh; -1 for other nodes of its geometry."""
        keys = self.tags[points] * np.uint64(self.degree**3)
        at = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
        return np.where(self.keys[at] == keys, self.order[at], -1)


def _keys(corners: IntArray, cell: str, degree: int, tags: Any) -> Any:
    """Keys (m, k) of the nodes of cells."""
    with np.errstate(over="ignore"):
        return tags[corners] @ lattice(cell, degree).astype(np.uint64).T
