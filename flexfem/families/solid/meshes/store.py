# SPDX-License-Identifier: LGPL-3.0-or-later
"""Writing of meshes of solids into folders that ranks read by parts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray, IntArray
from flexfem.families.solid.meshes.figure import WholeFigure
from flexfem.families.solid.meshes.mesh import SolidMesh
from flexfem.families.solid.meshes.stored import FACET, FORMAT, StoredSolidMesh
from flexfem.mesh.array_folder import write_arrays
from flexfem.mesh.distributed.partition import ordered_along

__all__ = ["store_solid_mesh"]

#: Cells, and nodes, whose data are computed together.
_CHUNK = 100_000
_OWNER = "store_solid_mesh"


def store_solid_mesh(
    mesh: SolidMesh, folder: str | Path, *, degree: int = 2, pieces: int = 10_000
) -> StoredSolidMesh:
    """Write a mesh once into a folder, of which the ranks of runs then read their parts.

    It takes one process that holds the whole mesh, and a quarter of a kilobyte for each node and
    cell more.

    Args:
        mesh: Tetrahedra or hexahedra, whose geometry has the degree 1 or that of the positions.
        folder: Which does not exist, or is empty.
        degree: That of the positions of the :class:`Solid`, 1 to 3.
        pieces: Of which ranks take some, at most; several times as many as ranks. A body of no more
            pieces than the option ``split_above`` of a run is on one rank.

    Returns:
        The stored mesh, as ``StoredSolidMesh(folder)`` does in another run.

    Raises:
        TypeError: An argument is of the wrong kind.
        ValueError: Cells or degrees of another kind, or the folder cannot be written.
    """
    _checks.instance(_OWNER, "mesh", mesh, SolidMesh)
    _checks.instance(_OWNER, "folder", folder, (str, Path))
    most = _checks.count(_OWNER, "pieces", pieces, 1)
    if mesh.cell not in FACET:
        raise ValueError(
            f"{_OWNER}: cells must be {' or '.join(FACET)}, got {_checks.show(mesh.cell)}"
        )
    if type(degree) is not int or not 1 <= degree <= 3 or mesh.degree not in (1, degree):
        raise ValueError(
            f"{_OWNER}: degree must be 1 to 3, and that of the mesh's geometry, {mesh.degree}, if "
            f"it is curved, got {_checks.show(degree)}"
        )
    figure = WholeFigure(mesh, degree, None, 1.0)
    written = _Written(figure, most)
    write_arrays(_OWNER, Path(folder), written.facts(), written.arrays)
    return StoredSolidMesh(folder)


class _Written:
    """Arrays of a folder, by name, and its facts."""

    def __init__(self, figure: WholeFigure, pieces: int) -> None:
        """Order cells and nodes."""
        mesh, nodes = figure.mesh, figure.nodes
        self._figure, self._mesh = figure, mesh
        order = ordered_along(nodes.points, nodes.cells)
        self._place = np.empty(len(order), dtype=np.int64)  # of each cell
        self._place[order] = np.arange(len(order))
        known, first = np.unique(nodes.cells[order].ravel(), return_index=True)
        self._number = np.empty(len(known), dtype=np.int64)  # of each node
        self._number[known[np.argsort(first)]] = np.arange(len(known))
        self._order, self._cells = order, self._number[nodes.cells[order]]
        self._size = -(-len(order) // pieces)
        self._starts = np.arange(0, len(order), self._size)
        points = np.empty_like(nodes.points)
        points[self._number] = nodes.points
        self.arrays: dict[str, Any] = {"points": points, "cells": self._cells}
        self._add_pieces(points)
        for k, rows in enumerate(mesh.regions.values()):
            self._add_ordered(f"region_{k}", np.sort(self._place[rows]))
        for k, name in enumerate(mesh.surfaces):
            self._add_facets(f"surface_{k}", name)
        self._add_boundary()
        self._sets: list[str] = []
        for name in mesh.nodes:
            if figure.has_surface(name):
                continue
            own = figure.nodes_of(_OWNER, name)
            if len(own):
                self.arrays[f"set_{len(self._sets)}"] = np.sort(self._number[own])
                self._sets.append(name)

    def _add_pieces(self, points: FloatArray) -> None:
        """Add nodes and boxes of the pieces."""
        corners = self._cells.reshape(len(self._cells), -1)
        highest = np.maximum.reduceat(corners.max(axis=1), self._starts)
        firsts = np.concatenate([[0], np.maximum.accumulate(highest) + 1])
        boxes = np.empty((len(self._starts), 2, 3))
        for side, take in enumerate((np.minimum, np.maximum)):
            ends = np.empty((len(corners), 3))
            for rows in _chunks(len(corners)):
                ends[rows] = take.reduce(points[corners[rows]], axis=1)
            boxes[:, side] = take.reduceat(ends, self._starts, axis=0)
        lowest = np.minimum.reduceat(corners.min(axis=1), self._starts)
        self.arrays |= {"firsts": firsts, "lowest": lowest, "boxes": boxes}

    def _add_ordered(self, name: str, cells: IntArray) -> None:
        """Add ascending cells, and where those of each piece begin."""
        ends = np.append(self._starts, len(self._order))
        self.arrays[f"{name}_starts"] = np.searchsorted(cells, ends)
        self.arrays[name] = cells

    def _add_facets(self, stem: str, surface: str) -> IntArray:
        """Add facets of a surface with their cells, which are returned."""
        _, facets = self._figure.facets_of(_OWNER, surface)
        cells = self._place[self._figure.facet_cells(surface)]
        self.arrays |= {f"{stem}_facets": self._number[facets], f"{stem}_cells": cells}
        return cells

    def _add_boundary(self) -> None:
        """Add all outer facets, ordered by their cells."""
        whole = self._figure if "boundary" not in self._mesh.surfaces else self._without_name()
        _, facets = whole.facets_of(_OWNER, "boundary")
        cells = self._place[whole.facet_cells("boundary")]
        order = np.argsort(cells, kind="stable")
        self.arrays["boundary_facets"] = self._number[facets[order]]
        self._add_ordered("boundary_cells", cells[order])
        self.arrays["boundary_starts"] = self.arrays.pop("boundary_cells_starts")

    def _without_name(self) -> WholeFigure:
        """The figure without a surface that is called "boundary"."""
        mesh = self._mesh
        plain = SolidMesh(mesh.points, mesh.cells, mesh.cell, degree=mesh.degree)
        return WholeFigure(plain, self._figure.degree, None, 1.0)

    def facts(self) -> dict[str, Any]:
        """Facts of the mesh."""
        mesh, figure = self._mesh, self._figure
        points, regions = figure.nodes.points, ["", *mesh.regions]
        return {
            "format": FORMAT, "cell": mesh.cell, "degree": mesh.degree, "order": figure.degree,
            "count": len(points), "elements": mesh.elements, "pieces": len(self._starts),
            "size": self._size, "straight": figure.straight,
            "box": [points.min(axis=0).tolist(), points.max(axis=0).tolist()],
            "pairs": figure.pairs, "regions": list(mesh.regions),
            "surfaces": list(mesh.surfaces), "sets": self._sets,
            "overlaps": [[figure.overlap(a, b) for b in regions] for a in regions],
            "moments": [self._moments(figure.cells_of(name)) for name in regions],
        }  # fmt: skip

    def _moments(self, cells: IntArray) -> list[float]:
        """Volume, centre, and second moments (3, 3) about it, per volume."""
        origin = self._mesh.points.mean(axis=0)
        volume, first, second = 0.0, np.zeros(3), np.zeros((3, 3))
        for rows in _chunks(len(cells)):
            own = cells[rows]
            points, masses = self._figure.cell_masses(own, np.ones(len(own)))
            away = points - origin
            volume += float(masses.sum())
            first += masses @ away
            second += away.T @ (masses[:, np.newaxis] * away)
        centre = first / volume
        about = second / volume - np.outer(centre, centre)
        return [volume, *(origin + centre).tolist(), *about.ravel().tolist()]


def _chunks(count: int) -> list[slice]:
    """Rows that are computed together."""
    return [slice(first, min(first + _CHUNK, count)) for first in range(0, count, _CHUNK)]
