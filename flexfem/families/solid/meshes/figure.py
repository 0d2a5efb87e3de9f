# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nodes, surfaces, places and integrals of the cells of a solid at the start, in NumPy."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from flexfem import _checks
from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.families.solid.meshes.lagrange import (
    Lagrange,
    quadrature_points,
    quadrature_weights,
    reference_points,
    shapes,
)
from flexfem.families.solid.meshes.mesh import SolidMesh
from flexfem.mesh.patches import coupled_nodes

__all__ = ["Figure", "WholeFigure", "located_in", "no_nodes", "pieces"]

#: Distance of a midside node from the middle of a straight cell, relative to the cell's size.
_STRAIGHT = 1e-9
#: Iterations of Newton's method for a place in a curved cell, and its tolerance.
_STEPS, _CLOSE = 20, 1e-12
#: Distance from the reference cell that is round-off, and candidates for a place.
_INSIDE, _NEAREST = 1e-8, 30


@dataclass(frozen=True, eq=False)
class Figure(ABC):
    """Cells of a mesh with nodes of a degree: a solid, or a plane figure.

    Attributes:
        mesh: the mesh, a ``SolidMesh`` or a ``StoredSolidMesh``.
        degree: of the positions.
        plane: "strain" or "axisymmetric" of plane figures, None of solids.
        thickness: in plane strain, m.
    """

    mesh: Any
    degree: int
    plane: str | None
    thickness: float

    @property
    @abstractmethod
    def count(self) -> int:
        """Number of nodes."""

    @abstractmethod
    def has_surface(self, name: str) -> bool:
        """True if a surface has the name, as "boundary" always has."""

    @property
    @abstractmethod
    def straight(self) -> bool:
        """True if all cells are simplices with straight edges, whose Jacobian is constant."""

    @property
    @abstractmethod
    def pairs(self) -> int:
        """Number of pairs of nodes, in both orders and with themselves, that share a cell."""

    @property
    @abstractmethod
    def outline(self) -> FloatArray:
        """Points (k, 3) about which the box is that of all nodes, m."""

    @abstractmethod
    def places(self, nodes: IntArray) -> FloatArray:
        """Places (..., 3) of nodes of any shape, m."""

    @abstractmethod
    def cell_nodes(self, cells: IntArray) -> IntArray:
        """Nodes (m, k) of cells, in the order of Basix."""

    @abstractmethod
    def cell_places(self, cells: IntArray) -> FloatArray:
        """Places (m, g, 3) of the nodes of the geometry of cells, corners first, m."""

    @abstractmethod
    def facets_of(self, owner: str, surface: str) -> tuple[str, IntArray]:
        """Shape and nodes (f, k) of the facets of a surface, whose normals point outwards.

        Raises:
            ValueError: There is no such surface, or it has facets of two shapes.
        """

    @abstractmethod
    def facet_cells(self, surface: str) -> IntArray:
        """A cell (f,) of each of the facets of a surface."""

    @abstractmethod
    def nodes_of(self, owner: str, name: str) -> IntArray:
        """Nodes, ascending, of a surface or a set of nodes.

        Raises:
            ValueError: There is neither.
        """

    @abstractmethod
    def cells_around(self, nodes: IntArray) -> IntArray:
        """Cells, ascending, that have one of some nodes."""

    @abstractmethod
    def in_region(self, region: str, cells: IntArray) -> BoolArray:
        """(m,) True for the cells, ascending, that are in a region; "" is that of all cells."""

    @abstractmethod
    def overlap(self, first: str, second: str) -> int:
        """Number of cells that two regions share; "" is that of all cells."""

    @abstractmethod
    def boundary_of(self, cells: IntArray) -> IntArray:
        """Flat triangles (t, 3) between the nodes of outer facets of some cells, ascending."""

    @abstractmethod
    def masses(self, density: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """Points (q, 3), m, and masses (q,), kg, whose inertia is that of the figure.

        Of an axisymmetric body they are spread around the axis.

        Args:
            density: by region, kg/m^3.
        """

    @abstractmethod
    def nearest(self, place: FloatArray) -> int:
        """Node that is nearest to a place (3,)."""

    @abstractmethod
    def _candidates(self, place: FloatArray) -> IntArray:
        """Cells that may have a place (3,), enough of them."""

    def area_weights(self, owner: str, surface: str) -> tuple[IntArray, FloatArray]:
        """Nodes of a surface, ascending, and the integrals of their shape functions, m^2.

        They are lengths times the thickness, or around the axis, of plane figures.
        """
        shape, facets = self.facets_of(owner, surface)
        rule = shape, 2 * self.degree + 1
        points, weights = quadrature_points(*rule), quadrature_weights(*rule)
        values, gradients = shapes(shape, self.degree, points)
        places = self.places(facets)
        sides = np.einsum("qkd,fka->fqda", gradients, places)
        if shape == "interval":
            size = np.linalg.norm(sides[:, :, 0], axis=-1) * self.thickness
            if self.plane == "axisymmetric":
                at = np.einsum("qk,fka->fqa", values, places)[..., 0]
                size = size * 2.0 * np.pi * at / self.thickness
        else:
            size = np.linalg.norm(np.cross(sides[:, :, 0], sides[:, :, 1]), axis=-1)
        parts = np.einsum("qk,fq->fk", values, weights * size)
        nodes, inverse = np.unique(facets, return_inverse=True)
        return nodes, np.bincount(inverse.ravel(), parts.ravel())

    def located(self, owner: str, place: FloatArray) -> tuple[int, FloatArray]:
        """Cell at a place (3,), and the shape functions (k,) of the positions there.

        Raises:
            ValueError: it is outside of all cells; the message begins with the owner.
        """
        cell, xi = self.place_in_cell(owner, place)
        return cell, shapes(self.mesh.cell, self.degree, xi[np.newaxis])[0][0]

    def place_in_cell(self, owner: str, place: FloatArray) -> tuple[int, FloatArray]:
        """Cell at a place (3,), m, and its coordinates (d,) there.

        Raises:
            ValueError: it is outside of all cells; the message begins with the owner.
        """
        cells = self._candidates(place)
        found, outside = located_in(self.mesh, self.cell_places(cells), place)
        if outside > _INSIDE or (self.mesh.dimension == 2 and place[2] != 0.0):
            raise ValueError(
                f"{owner}: the position {_checks.show(place.tolist())} is outside of the solid"
            )
        return int(cells[found[0]]), found[1]


@dataclass(frozen=True, eq=False)
class WholeFigure(Figure):
    """Figure of a mesh whose arrays are in memory."""

    mesh: SolidMesh

    @cached_property
    def nodes(self) -> Lagrange:
        """Numbering of the nodes."""
        mesh = self.mesh
        return Lagrange.of(mesh.points, mesh.cells, mesh.cell, self.degree, mesh.degree)

    @cached_property
    def straight(self) -> bool:
        """See :attr:`Figure.straight`."""
        mesh = self.mesh
        if mesh.cell not in ("triangle", "tetrahedron") or self.plane == "axisymmetric":
            return False
        if mesh.degree == 1:
            return True
        middles = shapes(mesh.cell, 1, reference_points(mesh.cell, mesh.degree))[0]
        corners = mesh.points[mesh.corners]
        away = np.abs(np.einsum("kc,mca->mka", middles, corners) - mesh.points[mesh.cells]).max()
        return bool(away < _STRAIGHT * np.ptp(corners, axis=1).max(axis=1).min())

    @property
    def count(self) -> int:
        """See :attr:`Figure.count`."""
        return len(self.nodes.points)

    @property
    def pairs(self) -> int:
        """See :attr:`Figure.pairs`."""
        return coupled_nodes(self.nodes.cells)

    @property
    def outline(self) -> FloatArray:
        """See :attr:`Figure.outline`."""
        return self.nodes.points

    def has_surface(self, name: str) -> bool:
        """See :meth:`Figure.has_surface`."""
        return name in self.mesh.surfaces or name == "boundary"

    def places(self, nodes: IntArray) -> FloatArray:
        """See :meth:`Figure.places`."""
        return self.nodes.points[nodes]

    def cell_nodes(self, cells: IntArray) -> IntArray:
        """See :meth:`Figure.cell_nodes`."""
        return self.nodes.cells[cells]

    def cell_places(self, cells: IntArray) -> FloatArray:
        """See :meth:`Figure.cell_places`."""
        return self.mesh.points[self.mesh.cells[cells]]

    def facet_cells(self, surface: str) -> IntArray:
        """See :meth:`Figure.facet_cells`."""
        return self.mesh.cells_of_facets(self.mesh.surface("", surface))

    def cells_around(self, nodes: IntArray) -> IntArray:
        """See :meth:`Figure.cells_around`."""
        return np.flatnonzero(np.isin(self.nodes.cells, nodes).any(axis=1))

    def cells_of(self, region: str) -> IntArray:
        """Cells of a region, ascending, "" for all."""
        if region == "":
            return np.arange(self.mesh.elements)
        return self.mesh.regions[region]

    def in_region(self, region: str, cells: IntArray) -> BoolArray:
        """See :meth:`Figure.in_region`."""
        if region == "":
            return np.ones(len(cells), dtype=np.bool_)
        return np.isin(cells, self.mesh.regions[region], assume_unique=True)

    def overlap(self, first: str, second: str) -> int:
        """See :meth:`Figure.overlap`."""
        return len(np.intersect1d(self.cells_of(first), self.cells_of(second), assume_unique=True))

    def boundary_of(self, cells: IntArray) -> IntArray:
        """See :meth:`Figure.boundary_of`."""
        triangles, of = self.triangles("", "boundary")
        return triangles[np.isin(of, cells)]

    def nearest(self, place: FloatArray) -> int:
        """See :meth:`Figure.nearest`."""
        return int(np.argmin(np.linalg.norm(self.nodes.points - place, axis=1)))

    def _candidates(self, place: FloatArray) -> IntArray:
        middles = self.mesh.points[self.mesh.corners].mean(axis=1)
        return np.argsort(np.linalg.norm(middles - place, axis=1), kind="stable")[:_NEAREST]

    def facets_of(self, owner: str, surface: str) -> tuple[str, IntArray]:
        """See :meth:`Figure.facets_of`."""
        corners = _outward(self.mesh, self.mesh.surface(owner, surface))
        count = (corners >= 0).sum(axis=1)
        if (count != count[0]).any():
            raise ValueError(f'{owner}: surface "{surface}" has triangles and quadrilaterals')
        return self.nodes.of_facets(corners)

    def nodes_of(self, owner: str, name: str) -> IntArray:
        """See :meth:`Figure.nodes_of`."""
        mesh = self.mesh
        if self.has_surface(name):
            corners = mesh.surface(owner, name)
            parts = [
                self.nodes.of_facets(corners[(corners >= 0).sum(axis=1) == count])[1].ravel()
                for count in np.unique((corners >= 0).sum(axis=1))
            ]
            return np.unique(np.concatenate(parts))
        if name not in mesh.nodes:
            raise no_nodes(owner, name, mesh.surfaces, mesh.nodes)
        if mesh.degree == self.degree:
            own = np.full(len(mesh.points), -1)
            own[mesh.cells] = self.nodes.cells
            return np.unique(own[mesh.nodes[name]])
        found = self.nodes.corner(mesh.nodes[name])
        return np.unique(found[found >= 0])

    def triangles(self, owner: str, surface: str) -> tuple[IntArray, IntArray]:
        """Flat triangles (t, 3) between the nodes of a surface, and their cells (t,).

        Of plane figures they fill the figure, whatever the surface.
        """
        mesh = self.mesh
        if self.plane is not None:
            cut = pieces(mesh.cell, self.degree)
            every = self.nodes.cells[:, cut].reshape(-1, 3)
            return every, np.repeat(np.arange(mesh.elements), len(cut))
        corners = _outward(mesh, mesh.surface(owner, surface))
        count, found, cells = (corners >= 0).sum(axis=1), [], []
        for own in (corners[count == k] for k in np.unique(count)):
            shape, facets = self.nodes.of_facets(own)
            cut = pieces(shape, self.degree)
            found.append(facets[:, cut].reshape(-1, 3))
            cells.append(np.repeat(mesh.cells_of_facets(own), len(cut)))
        return np.concatenate(found), np.concatenate(cells)

    def masses(self, density: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """See :meth:`Figure.masses`."""
        cells = np.arange(self.mesh.elements)
        of_cells = np.empty(len(cells))
        for region, value in density.items():
            of_cells[self.cells_of(region)] = value
        return self.cell_masses(cells, of_cells)

    def cell_masses(self, cells: IntArray, density: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The same of some cells; ``density`` (m,) kg/m^3."""
        mesh = self.mesh
        d = mesh.dimension
        rule = mesh.cell, 2 + 3 * mesh.degree - 2
        points, weights = quadrature_points(*rule), quadrature_weights(*rule)
        values, gradients = shapes(mesh.cell, mesh.degree, points)
        nodes = self.cell_places(cells)
        places = np.einsum("qk,mka->mqa", values, nodes)
        sides = np.einsum("qkd,mka->mqad", gradients, nodes)[:, :, :d]
        volumes = weights * np.linalg.det(sides) * density[:, np.newaxis]
        if self.plane is None:
            return places.reshape(-1, 3), volumes.ravel()
        if self.plane != "axisymmetric":
            # two sheets at this height have the second moment of the thickness
            height = np.array([0.0, 0.0, self.thickness / 12.0**0.5])
            every = np.concatenate([places + height, places - height])
            return every.reshape(-1, 3), np.tile(volumes, (2, 1)).ravel() * self.thickness / 2.0
        r, y = places[..., 0], places[..., 1]
        zero = np.zeros_like(r)
        quarters = [(r, y, zero), (-r, y, zero), (zero, y, r), (zero, y, -r)]
        turned = [np.stack(quarter, axis=-1) for quarter in quarters]
        around = volumes * 2.0 * np.pi * r / 4.0
        return np.concatenate(turned).reshape(-1, 3), np.tile(around, (4, 1)).ravel()


def no_nodes(owner: str, name: str, surfaces: Iterable[str], sets: Iterable[str]) -> ValueError:
    """The error of a name that neither a surface nor a set of nodes has."""
    known = ", ".join([*surfaces, "boundary", *sets])
    return ValueError(
        f"{owner}: no surface or set of nodes {_checks.show(name)}; there are {known}"
    )


def located_in(
    mesh: Any, nodes: FloatArray, place: FloatArray
) -> tuple[tuple[int, FloatArray], float]:
    """The one of some cells that a place (3,) is in, and its coordinates there.

    Args:
        mesh: of the cells: their shape and degree.
        nodes: (m, g, 3) places of the geometry's nodes, m; cells whose middles are farther than
            those of enough others are not looked at.
        place: m.

    Returns:
        The row of the cell with the coordinates (d,), and how far the place is outside of it.
    """
    d, corners = mesh.dimension, len(reference_points(mesh.cell, 1))
    middles = nodes[:, :corners].mean(axis=1)
    near = np.argsort(np.linalg.norm(middles - place, axis=1), kind="stable")[:_NEAREST]
    best, found = np.inf, (-1, np.empty(0))
    for cell in near.tolist():
        own = nodes[cell]
        xi = reference_points(mesh.cell, 1).mean(axis=0)
        for _ in range(_STEPS):
            values, gradients = shapes(mesh.cell, mesh.degree, xi[np.newaxis])
            gap = (place - values[0] @ own)[:d]
            xi = xi + np.linalg.solve((gradients[0].T @ own)[:, :d].T, gap)
            if np.abs(gap).max() < _CLOSE * np.ptp(own, axis=0).max():
                break
        outside = float(-shapes(mesh.cell, 1, xi[np.newaxis])[0].min())
        if outside < best:
            best, found = outside, (cell, xi)
    return found, best


def _outward(mesh: SolidMesh, corners: IntArray) -> IntArray:
    """Corners (f, c) of facets in the order in which their normals leave a cell of each."""
    inside = mesh.points[mesh.corners[mesh.cells_of_facets(corners)]].mean(axis=1)
    there = (corners >= 0)[..., np.newaxis]
    middle = (mesh.points[corners] * there).sum(axis=1) / there.sum(axis=1)
    first = mesh.points[corners[:, 1]] - mesh.points[corners[:, 0]]
    if corners.shape[1] == 2:
        normal, swapped = np.cross(first, [0.0, 0.0, 1.0]), corners[:, ::-1]
    else:
        normal = np.cross(first, mesh.points[corners[:, 2]] - mesh.points[corners[:, 0]])
        swapped = corners[:, [0, 2, 1, 3][: corners.shape[1]]]
    leaves = np.einsum("fa,fa->f", normal, middle - inside) > 0.0
    return np.where(leaves[:, np.newaxis], corners, swapped)


def pieces(shape: str, degree: int) -> IntArray:
    """Triangles (t, 3) between the nodes of a facet, that run counterclockwise as it does."""
    at = {tuple(x): k for k, x in enumerate(np.rint(degree * reference_points(shape, degree)))}
    found = []
    for i in range(degree):
        for j in range(degree):
            a, b, c, d = (at.get((i + p, j + q)) for p, q in ((0, 0), (1, 0), (0, 1), (1, 1)))
            found += [t for t in ((a, b, c), (b, d, c)) if None not in t]
    return np.array(found, dtype=np.int64)
