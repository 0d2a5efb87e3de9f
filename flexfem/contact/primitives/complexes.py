# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells of surfaces and polylines, and how often each counts.

The potentials b(D) of a vertex with all triangles, edges and vertices of a surface are summed with
the coefficients of inclusion and exclusion,

    c_t = 1,   c_e = 1 - sum of c over triangles at e,   c_w = 1 - sum of c over cells at w:

the sum of c over the cells that are nearer than some distance is the Euler characteristic of the
part of the surface in that sphere, 1 if it is a disc. A vertex over a flat surface hence meets b
once wherever it is, and nothing jumps where the closest point moves over an edge. Pairs of cells of
two polylines have products of the coefficients of lines.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray

__all__ = ["Complex", "Surface", "lengths"]

_NONE = np.zeros(0, np.int64)
#: One less the cosine of an angle between two triangles that count as one plane.
_FLAT = 1e-10
_SIDES = np.array([[0, 1], [1, 2], [2, 0]])


def lengths(points: FloatArray, edges: IntArray) -> FloatArray:
    """Length of every point (n,) at positions (n, 3): half of that of its edges, m."""
    size = np.linalg.norm(points[edges[:, 1]] - points[edges[:, 0]], axis=1)
    return np.bincount(edges.ravel(), np.repeat(size / 2.0, 2), len(points))


@dataclass(frozen=True)
class Complex:
    """Triangles, edges and vertices, each once. Cells are numbered in the order of the attributes.

    Attributes:
        vertices: Rows of the positions, ascending, shape (v,).
        edges: Vertices of the edges of triangles and polylines, the smaller first, shape (e, 2);
            they and what follows are numbers in ``vertices``.
        triangles: Vertices of the triangles, shape (t, 3).
        sides: Edges of the triangles, shape (t, 3).
        lines: Edges that belong to polylines, ascending, shape (l,).
        stations: Vertices that touch others, but are not touched: points inside edges, shape (s,).
        flat: Edges that stay inside of flat parts of a surface and cross no others: whatever
            touches them touches the triangles, shape (f,).
    """

    vertices: IntArray
    edges: IntArray
    triangles: IntArray
    sides: IntArray
    lines: IntArray
    stations: IntArray
    flat: IntArray

    @classmethod
    def of(
        cls, triangles: IntArray, lines: IntArray, points: IntArray, stations: IntArray = _NONE,
        rods: BoolArray | None = None,
    ) -> "Complex":  # fmt: skip
        """Number the cells of triangles (t, 3), edges of polylines (l, 2), points and stations.

        ``rods`` (l,) is True for edges that vertices touch, but no polyline crosses: what is wound
        around them touches along a line.

        Raises:
            ValueError: a triangle or an edge has a point twice.
        """
        cells = [np.asarray(c, np.int64).reshape(-1, k) for c, k in ((triangles, 3), (lines, 2))]
        for cell in cells:
            twice = (cell == np.roll(cell, 1, axis=1)).any(axis=1)
            if twice.any():
                raise ValueError(f"points {cell[twice][0].tolist()} of a cell: one is there twice")
        vertices = np.unique(
            np.concatenate([c.ravel() for c in (*cells, np.asarray(points), np.asarray(stations))])
        )
        corners, ends = (np.searchsorted(vertices, cell) for cell in cells)
        both = np.sort(np.concatenate([corners[:, _SIDES].reshape(-1, 2), ends]), axis=1)
        edges, at = np.unique(both, axis=0, return_inverse=True)
        at = at.ravel()
        sides = at[: 3 * len(corners)].reshape(-1, 3)
        inside = np.searchsorted(vertices, stations)
        crossed = at[sides.size :]
        lines = np.unique(crossed if rods is None else crossed[~rods])
        return cls(
            vertices.astype(np.int64), edges, corners, sides, lines, inside, _NONE,
        )  # fmt: skip

    def flattened(self, points: FloatArray, rigid: BoolArray) -> "Complex":
        """The same with the flat edges of rigid triangles (t,) at positions (n, 3)."""
        corners = points[self.vertices[self.triangles[rigid]]]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        sides = self.sides[rigid].ravel()
        order = np.argsort(sides, kind="stable")
        edge, triangle = sides[order], np.repeat(np.arange(len(normals)), 3)[order]
        counts = np.bincount(self.sides.ravel(), minlength=len(self.edges))
        first = np.flatnonzero((edge[1:] == edge[:-1]) & (counts[edge[1:]] == 2))
        a, b = normals[triangle[first]], normals[triangle[first + 1]]
        level = np.abs(np.einsum("ea,ea->e", a, b)) > 1.0 - _FLAT
        return replace(self, flat=edge[first[level]])

    @property
    def count(self) -> int:
        """Number of cells."""
        return len(self.vertices) + len(self.edges) + len(self.triangles)

    @cached_property
    def coefficients(self) -> FloatArray:
        """Coefficient of each cell (c,)."""
        edges = 1.0 - np.bincount(self.sides.ravel(), minlength=len(self.edges))
        corners = np.bincount(self.triangles.ravel(), minlength=len(self.vertices))
        ends = np.bincount(self.edges.ravel(), np.repeat(edges, 2), len(self.vertices))
        result = np.concatenate([1.0 - corners - ends, edges, np.ones(len(self.triangles))])
        result[self.stations] = 0.0
        return result

    @cached_property
    def line_coefficients(self) -> FloatArray:
        """Coefficient of each vertex and edge among polylines alone (v + e,), 0 off them."""
        ends = np.bincount(self.edges[self.lines].ravel(), minlength=len(self.vertices))
        result = np.concatenate([np.where(ends > 0, 1.0 - ends, 0.0), np.zeros(len(self.edges))])
        result[len(self.vertices) + self.lines] = 1.0
        return result

    @cached_property
    def points(self) -> IntArray:
        """Rows of the positions of each cell (c, 3), the last one repeated."""
        v, e, t = self.vertices, self.edges, self.triangles
        return np.concatenate([v[:, None].repeat(3, axis=1), v[e[:, [0, 1, 1]]], v[t]])

    @cached_property
    def crossing(self) -> tuple[IntArray, IntArray]:
        """Edges of triangles that cross others, and all edges that are crossed, as cells."""
        sharp = np.setdiff1d(np.arange(len(self.edges)), self.flat)
        v = len(self.vertices)
        return v + np.intersect1d(sharp, self.sides), v + sharp

    @cached_property
    def on_lines(self) -> BoolArray:
        """Vertices and edges of polylines (v + e,), also those whose coefficient is 0."""
        result = np.zeros(len(self.vertices) + len(self.edges), np.bool_)
        result[self.edges[self.lines].ravel()] = True
        result[len(self.vertices) + self.lines] = True
        return result


@dataclass(frozen=True)
class Surface:
    """A complex with what its points are in contact.

    All points of what touches as one, a body or a part of one, have the same numbers; cells with
    different ones have the largest radius and gap of their points.

    Attributes:
        complex: the cells.
        label: Number of the body of each point, shape (n,).
        radius: Distance of the surface from the points, shape (n,), metres.
        dhat: Gap below which it repels, shape (n,), metres.
        kappa: Stiffness of the barrier, shape (n,), N/m^3; a pair has the larger one.
        area: Area for which a point stands where it touches others, 0 if it does not touch itself,
            shape (n,), square metres.
        edge: Usual length of the edges of each body, shape (b,), metres; None: longer than all
            radii. Shorter ones may be wound around a sphere.
    """

    complex: Complex
    label: IntArray
    radius: FloatArray
    dhat: FloatArray
    kappa: FloatArray
    area: FloatArray
    edge: FloatArray | None = None

    @cached_property
    def cell_radius(self) -> FloatArray:
        """Radius of each cell (c,), m."""
        return np.asarray(self.radius[self.complex.points].max(axis=1))

    @cached_property
    def cell_dhat(self) -> FloatArray:
        """Gap of each cell (c,), m."""
        return np.asarray(self.dhat[self.complex.points].max(axis=1))

    @cached_property
    def cell_label(self) -> IntArray:
        """Body of each cell (c,)."""
        return np.asarray(self.label[self.complex.points[:, 0]])

    @cached_property
    def edge_area(self) -> FloatArray:
        """Area of each edge (e,): the smaller one of its ends, m^2."""
        return np.asarray(self.area[self.complex.vertices[self.complex.edges]].min(axis=1))

    def winds(self, first: IntArray, second: IntArray) -> BoolArray:
        """Pairs (m,) of a vertex with a cell whose body may be wound around it."""
        if self.edge is None:
            return np.zeros(len(first), np.bool_)
        large = self.cell_radius[first] > self.edge[self.cell_label[second]]
        wound: BoolArray = large & (self.cell_label[first] != self.cell_label[second])
        return wound

    @cached_property
    def cell_area(self) -> FloatArray:
        """Area (c,) of triangles and edges of polylines: that of their smallest point, m^2.

        It is 0 for what is part of these.
        """
        cells, v = self.complex, len(self.complex.vertices)
        found = np.zeros(cells.count)
        whole = np.concatenate([v + cells.lines, np.arange(v + len(cells.edges), cells.count)])
        found[whole] = self.area[cells.points[whole]].min(axis=1)
        return found

    def touch(self, first: IntArray, second: IntArray) -> FloatArray:
        """Distance (m,) at which pairs of cells touch, m."""
        return self.cell_radius[first] + self.cell_radius[second]

    def reach(self, first: IntArray, second: IntArray) -> FloatArray:
        """Gap (m,) below which pairs of cells repel, m: the smaller one of both."""
        return np.minimum(self.cell_dhat[first], self.cell_dhat[second])
