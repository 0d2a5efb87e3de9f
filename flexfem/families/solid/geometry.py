# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nodes, surfaces, places and integrals of the cells of a solid at the start, in NumPy."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray, IntArray
from flexfem.families.solid.lagrange import (
    Lagrange,
    quadrature_points,
    quadrature_weights,
    reference_points,
    shapes,
)
from flexfem.families.solid.mesh import SolidMesh

__all__ = ["Figure"]

#: Distance of a midside node from the middle of a straight cell, relative to the cell's size.
_STRAIGHT = 1e-9
#: Iterations of Newton's method for a place in a curved cell, and its tolerance.
_STEPS, _CLOSE = 20, 1e-12
#: Distance from the reference cell that is round-off, and candidates for a place.
_INSIDE, _NEAREST = 1e-8, 30


@dataclass(frozen=True, eq=False)
class Figure:
    """Cells of a mesh with nodes of a degree: a solid, or a plane figure.

    Attributes:
        mesh: the mesh.
        degree: of the positions.
        plane: "strain" or "axisymmetric" of plane figures, None of solids.
        thickness: in plane strain, m.
    """

    mesh: SolidMesh
    degree: int
    plane: str | None
    thickness: float

    @cached_property
    def nodes(self) -> Lagrange:
        """Numbering of the nodes."""
        mesh = self.mesh
        return Lagrange.of(mesh.points, mesh.cells, mesh.cell, self.degree, mesh.degree)

    @cached_property
    def straight(self) -> bool:
        """True if all cells are simplices with straight edges, whose Jacobian is constant."""
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
    def points(self) -> FloatArray:
        """(n, 3) places of the nodes, m."""
        return self.nodes.points

    def facets_of(self, owner: str, surface: str) -> tuple[str, IntArray]:
        """Shape and nodes (f, k) of the facets of a surface, whose normals point outwards.

        Raises:
            ValueError: There is no such surface, or it has facets of two shapes.
        """
        corners = _outward(self.mesh, self.mesh.surface(owner, surface))
        count = (corners >= 0).sum(axis=1)
        if (count != count[0]).any():
            raise ValueError(f'{owner}: surface "{surface}" has triangles and quadrilaterals')
        return self.nodes.of_facets(corners)

    def nodes_of(self, owner: str, name: str) -> IntArray:
        """Nodes, ascending, of a surface or a set of nodes.

        Raises:
            ValueError: There is neither.
        """
        mesh = self.mesh
        if name in mesh.surfaces or name == "boundary":
            corners = mesh.surface(owner, name)
            parts = [
                self.nodes.of_facets(corners[(corners >= 0).sum(axis=1) == count])[1].ravel()
                for count in np.unique((corners >= 0).sum(axis=1))
            ]
            return np.unique(np.concatenate(parts))
        if name not in mesh.nodes:
            known = ", ".join([*mesh.surfaces, "boundary", *mesh.nodes])
            raise ValueError(
                f"{owner}: no surface or set of nodes {_checks.show(name)}; there are {known}"
            )
        if mesh.degree == self.degree:
            own = np.full(len(mesh.points), -1)
            own[mesh.cells] = self.nodes.cells
            return np.unique(own[mesh.nodes[name]])
        found = self.nodes.corner(mesh.nodes[name])
        return np.unique(found[found >= 0])

    def area_weights(self, owner: str, surface: str) -> tuple[IntArray, FloatArray]:
        """Nodes of a surface, ascending, and the integrals of their shape functions, m^2.

        They are lengths times the thickness, or around the axis, of plane figures.
        """
        shape, facets = self.facets_of(owner, surface)
        rule = shape, 2 * self.degree + 1
        points, weights = quadrature_points(*rule), quadrature_weights(*rule)
        values, gradients = shapes(shape, self.degree, points)
        places = self.points[facets]
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
        mesh, d = self.mesh, self.mesh.dimension
        middles = mesh.points[mesh.corners].mean(axis=1)
        near = np.argsort(np.linalg.norm(middles - place, axis=1), kind="stable")[:_NEAREST]
        best, found = np.inf, (-1, np.empty(0))
        for cell in near.tolist():
            nodes = mesh.points[mesh.cells[cell]]
            xi = reference_points(mesh.cell, 1).mean(axis=0)
            for _ in range(_STEPS):
                values, gradients = shapes(mesh.cell, mesh.degree, xi[np.newaxis])
                gap = (place - values[0] @ nodes)[:d]
                xi = xi + np.linalg.solve((gradients[0].T @ nodes)[:, :d].T, gap)
                if np.abs(gap).max() < _CLOSE * np.ptp(nodes, axis=0).max():
                    break
            outside = float(-shapes(mesh.cell, 1, xi[np.newaxis])[0].min())
            if outside < best:
                best, found = outside, (cell, xi)
        if best > _INSIDE or (d == 2 and place[2] != 0.0):
            raise ValueError(
                f"{owner}: the position {_checks.show(place.tolist())} is outside of the solid"
            )
        return found

    def triangles(self, owner: str, surface: str) -> tuple[IntArray, IntArray]:
        """Flat triangles (t, 3) between the nodes of a surface, and their cells (t,).

        Of plane figures they fill the figure, whatever the surface.
        """
        mesh = self.mesh
        if self.plane is not None:
            pieces = _pieces(mesh.cell, self.degree)
            every = self.nodes.cells[:, pieces].reshape(-1, 3)
            return every, np.repeat(np.arange(len(mesh.cells)), len(pieces))
        corners = _outward(mesh, mesh.surface(owner, surface))
        count, found, cells = (corners >= 0).sum(axis=1), [], []
        for own in (corners[count == k] for k in np.unique(count)):
            shape, facets = self.nodes.of_facets(own)
            pieces = _pieces(shape, self.degree)
            found.append(facets[:, pieces].reshape(-1, 3))
            cells.append(np.repeat(mesh.cells_of_facets(own), len(pieces)))
        return np.concatenate(found), np.concatenate(cells)

    def masses(self, density: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points (q, 3), m, and masses (q,), kg, whose inertia is that of a solid.

        Of an axisymmetric body they are spread around the axis.

        Args:
            density: (m,) of the cells, kg/m^3.
        """
        mesh = self.mesh
        d = mesh.dimension
        rule = mesh.cell, 2 + 3 * mesh.degree - 2
        points, weights = quadrature_points(*rule), quadrature_weights(*rule)
        values, gradients = shapes(mesh.cell, mesh.degree, points)
        nodes = mesh.points[mesh.cells]
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


def _pieces(shape: str, degree: int) -> IntArray:
    """Triangles (t, 3) between the nodes of a facet, that run counterclockwise as it does."""
    at = {tuple(x): k for k, x in enumerate(np.rint(degree * reference_points(shape, degree)))}
    found = []
    for i in range(degree):
        for j in range(degree):
            a, b, c, d = (at.get((i + p, j + q)) for p, q in ((0, 0), (1, 0), (0, 1), (1, 1)))
            found += [t for t in ((a, b, c), (b, d, c)) if None not in t]
    return np.array(found, dtype=np.int64)
