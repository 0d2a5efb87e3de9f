# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes of solids in a folder of files, of which each rank reads its part, and their figures.

Cells are in the order in which ranks take them, and nodes in that in which cells have them. So the
cells of a rank are rows one after the other, and so are the nodes that it owns: those that no cell
of a rank before it has.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.families.solid.meshes.figure import Figure, no_nodes, pieces
from flexfem.families.solid.meshes.lagrange import CELLS, lattice
from flexfem.families.solid.meshes.mesh import no_surface
from flexfem.mesh.array_folder import ArrayFolder

__all__ = ["FACET", "FORMAT", "StoredFigure", "StoredSolidMesh"]

#: Kind and version of the folders.
FORMAT = "mesh of a solid, version 2"
#: Shape of the facets of cells.
FACET = {"tetrahedron": "triangle", "hexahedron": "quadrilateral"}
#: Attributes of meshes in memory.
_WHOLE = frozenset({
    "points", "cells", "regions", "surfaces", "nodes", "facets", "boundary", "corners",
    "cells_of_facets", "surface", "named_nodes", "moved", "raised", "with_surfaces",
})  # fmt: skip
#: Part of its extent by which the box of a piece is wider than that of its nodes, for cells that
#: bulge.
_WIDER = 0.25
#: Pieces whose nodes are looked at together.
_TOGETHER = 16


@dataclass(frozen=True, eq=False, init=False)
class StoredSolidMesh:
    """Mesh of a solid in a folder that :func:`store_solid_mesh` has written.

    Each rank reads the cells that it has, their nodes, and the surfaces and sets of nodes that the
    model names; none has the whole mesh. A :class:`Solid` takes it in place of a
    :class:`SolidMesh`, with the same degree, and computes the same.

    Attributes:
        cell: "tetrahedron" or "hexahedron".
        degree: Degree of the geometry.
        order: Degree of the positions for which it is stored.
        count: Number of nodes.
        elements: Number of cells.
        pieces: Number of pieces of which ranks take some.
        digest: Digest of the contents, against which what is read is checked.
    """

    cell: str
    degree: int
    order: int
    count: int
    elements: int
    pieces: int
    digest: str

    def __init__(self, folder: str | Path) -> None:
        """Read the facts of a folder.

        Raises:
            InputError: It is missing, damaged, or none of :func:`store_solid_mesh`.
        """
        _checks.instance("StoredSolidMesh", "folder", folder, (str, Path))
        files = ArrayFolder(f'StoredSolidMesh "{folder}"', Path(folder))
        facts = files.facts()
        if facts.get("format") != FORMAT:
            raise InputError(
                f"{files.owner}: its format is {_checks.show(facts.get('format'))}, not "
                f'"{FORMAT}"; write it with store_solid_mesh'
            )
        _ = files.checksums  # refuses facts that were changed
        names = ("cell", "degree", "order", "count", "elements", "pieces", "digest")
        try:
            _checks.assign(self, _files=files, **{name: facts[name] for name in names})
            _ = self._data
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{files.owner}: facts.json is damaged: {error}") from None

    def __getattr__(self, name: str) -> Any:
        """Refuse what only a mesh in memory has."""
        if name in _WHOLE:
            raise InputError(
                f'{self.owner}: "{name}" needs the whole mesh, of which each rank reads its part; '
                "take the SolidMesh from which it was stored"
            )
        raise AttributeError(f"StoredSolidMesh has no {name}")

    @cached_property
    def _data(self) -> _Stored:
        """Its contents; what is computed is not among the data by which models are compared."""
        return _Stored(self._files, self._files.facts(), self)

    @property
    def owner(self) -> str:
        """The mesh in messages."""
        owner: str = self._files.owner
        return owner

    @property
    def dimension(self) -> int:
        """3: stored meshes are those of solids in space."""
        return CELLS[self.cell]

    @property
    def region_names(self) -> tuple[str, ...]:
        """Names of the regions."""
        return self._data.regions

    def region_fault(self, names: Collection[str]) -> str:
        """See :meth:`SolidMesh.region_fault`."""
        if any(self._data.overlap(a, b) for a in names for b in names if a < b):
            return "a cell has more than one"
        sizes = sum(self._data.overlap(name, name) for name in names)
        return "" if sizes == self.elements else "a cell has no"

    def figure(self, degree: int) -> StoredFigure:
        """Its figure of the degree for which it is stored."""
        return StoredFigure(self, degree, None, 1.0)


class _Stored:
    """Contents of a folder."""

    def __init__(self, files: ArrayFolder, facts: Mapping[str, Any], mesh: StoredSolidMesh) -> None:
        """Check the facts.

        Raises:
            ValueError: one of them is damaged.
        """
        self.files, self.mesh = files, mesh
        for name in ("degree", "order", "count", "elements", "pieces"):
            _checks.count("facts", name, getattr(mesh, name), 1)
        _checks.text("facts", "digest", mesh.digest)
        if mesh.cell not in FACET or mesh.degree not in (1, mesh.order) or mesh.order > 3:
            raise ValueError(f"unknown cells {mesh.cell} of degree {mesh.degree}")
        self.width = len(lattice(mesh.cell, mesh.order))
        self.straight = bool(facts["straight"])
        self.box = _checks.array("facts", "box", facts["box"], (2, 3))
        self.pairs = int(facts["pairs"])
        self.size = _checks.count("facts", "size", facts["size"], 1)
        self.regions = tuple(map(str, facts["regions"]))
        self.surfaces = tuple(map(str, facts["surfaces"]))
        self.sets = tuple(map(str, facts["sets"]))
        every = 1 + len(self.regions)
        self.overlaps = _checks.array("facts", "overlaps", facts["overlaps"], (every, every))
        self.moments = _checks.array("facts", "moments", facts["moments"], (every, 13))

    def surface(self, owner: str, name: str) -> str:
        """Stem of the files of a surface; "boundary" is all of it unless a surface has the name."""
        if name in self.surfaces:
            return f"surface_{self.surfaces.index(name)}"
        if name == "boundary":
            return "boundary"
        raise no_surface(owner, name, self.surfaces)

    def region(self, name: str) -> int:
        """Row of a region in the overlaps and moments; "" is that of all cells."""
        return 0 if name == "" else 1 + self.regions.index(name)

    def overlap(self, first: str, second: str) -> int:
        """Number of cells that two regions share."""
        return int(self.overlaps[self.region(first), self.region(second)])

    def numbers(self, name: str, limit: int, **rows: int) -> IntArray:
        """Numbers below a limit."""
        return self.bounded(name, self.files.rows(name, (-1,), np.int64, **rows), limit)

    def table(self, name: str, width: int, limit: int, rows: IntArray) -> IntArray:
        """Chosen rows (k, w) of numbers below a limit."""
        found = self.files.chosen(name, (-1, width), np.int64, rows)
        return self.bounded(name, found, limit)

    def bounded(self, name: str, found: IntArray, limit: int) -> IntArray:
        """Numbers that were read, none of which may be negative or reach a limit."""
        if len(found) and not 0 <= found.min() <= found.max() < limit:
            raise InputError(
                f"{self.files.owner}: {name}.npy is damaged: it has the number "
                f"{found.min() if found.min() < 0 else found.max()}, those below {limit} exist"
            )
        return found

    @cached_property
    def firsts(self) -> IntArray:
        """(p + 1,) first node of each piece, one that no piece before has."""
        return self.numbers("firsts", self.mesh.count + 1)

    @cached_property
    def lowest(self) -> IntArray:
        """(p,) lowest node of each piece."""
        return self.numbers("lowest", self.mesh.count)

    @cached_property
    def boxes(self) -> FloatArray:
        """(p, 2, 3) boxes of the nodes of each piece, m."""
        found: FloatArray = self.files.rows("boxes", (self.mesh.pieces, 2, 3), np.float64)
        return found

    def cells_of(self, chosen: npt.ArrayLike) -> IntArray:
        """Cells of pieces, ascending."""
        first = self.size * np.unique(chosen)
        every = (first[:, np.newaxis] + np.arange(self.size)).ravel()
        return every[every < self.mesh.elements]

    def within(self, name: str, cells: IntArray) -> tuple[int, int]:
        """Rows of an array, ordered by cells, that may belong to some cells, ascending."""
        starts = self.numbers(f"{name}_starts", np.iinfo(np.int64).max)
        first, last = int(cells[0]) // self.size, int(cells[-1]) // self.size
        return int(starts[first]), int(starts[last + 1])


@dataclass(frozen=True, eq=False)
class StoredFigure(Figure):
    """Figure of a stored mesh: what is asked for is read."""

    mesh: StoredSolidMesh

    @property
    def _data(self) -> _Stored:
        return self.mesh._data

    @property
    def count(self) -> int:
        """See :attr:`Figure.count`."""
        return self.mesh.count

    def has_surface(self, name: str) -> bool:
        """See :meth:`Figure.has_surface`."""
        return name in self._data.surfaces or name == "boundary"

    @property
    def straight(self) -> bool:
        """See :attr:`Figure.straight`."""
        return self._data.straight

    @property
    def pairs(self) -> int:
        """See :attr:`Figure.pairs`."""
        return self._data.pairs

    @property
    def outline(self) -> FloatArray:
        """See :attr:`Figure.outline`."""
        return self._data.box

    @property
    def piece(self) -> int:
        """Number of cells in a piece, but for the last."""
        return self._data.size

    def first_nodes(self, piece: IntArray) -> IntArray:
        """First nodes (k,) that no piece before some (k,) has."""
        return self._data.firsts[piece]

    def places(self, nodes: IntArray) -> FloatArray:
        """See :meth:`Figure.places`."""
        rows = np.asarray(nodes)
        found = self._data.files.chosen("points", (self.count, 3), np.float64, rows.ravel())
        places: FloatArray = found.reshape(*rows.shape, 3)
        return places

    def cell_nodes(self, cells: IntArray) -> IntArray:
        """See :meth:`Figure.cell_nodes`."""
        return self._data.table("cells", self._data.width, self.count, cells)

    def cell_places(self, cells: IntArray) -> FloatArray:
        """See :meth:`Figure.cell_places`."""
        width = len(lattice(self.mesh.cell, self.mesh.degree))
        return self.places(self.cell_nodes(cells)[:, :width])

    def facets_of(self, owner: str, surface: str) -> tuple[str, IntArray]:
        """See :meth:`Figure.facets_of`."""
        stem, shape = self._data.surface(owner, surface), FACET[self.mesh.cell]
        width = len(lattice(shape, self.degree))
        found = self._data.files.rows(f"{stem}_facets", (-1, width), np.int64)
        return shape, self._data.bounded(f"{stem}_facets", found, self.count)

    def facet_cells(self, surface: str) -> IntArray:
        """See :meth:`Figure.facet_cells`."""
        stem = self._data.surface(self.mesh.owner, surface)
        return self._data.numbers(f"{stem}_cells", self.mesh.elements)

    def nodes_of(self, owner: str, name: str) -> IntArray:
        """See :meth:`Figure.nodes_of`."""
        data = self._data
        if self.has_surface(name):
            return np.unique(self.facets_of(owner, name)[1])
        if name not in data.sets:
            raise no_nodes(owner, name, data.surfaces, data.sets)
        return data.numbers(f"set_{data.sets.index(name)}", self.count)

    def cells_around(self, nodes: IntArray) -> IntArray:
        """See :meth:`Figure.cells_around`."""
        known, data = np.unique(nodes), self._data
        at = np.searchsorted(known, data.lowest)  # pieces with one of the nodes, or beside one
        met = (at < len(known)) & (known[np.minimum(at, len(known) - 1)] < data.firsts[1:])
        cells = data.cells_of(np.flatnonzero(met))
        return cells[np.isin(self.cell_nodes(cells), known).any(axis=1)]

    def in_region(self, region: str, cells: IntArray) -> BoolArray:
        """See :meth:`Figure.in_region`."""
        if region == "" or not len(cells):
            return np.ones(len(cells), dtype=np.bool_)
        name = f"region_{self._data.region(region) - 1}"
        first, end = self._data.within(name, cells)
        rows = self._data.numbers(name, self.mesh.elements, first=first, end=end)
        return np.isin(cells, rows, assume_unique=True)

    def overlap(self, first: str, second: str) -> int:
        """See :meth:`Figure.overlap`."""
        return self._data.overlap(first, second)

    def boundary_of(self, cells: IntArray) -> IntArray:
        """See :meth:`Figure.boundary_of`."""
        cut = pieces(FACET[self.mesh.cell], self.degree)
        if not len(cells):
            return np.empty((0, 3), dtype=np.int64)
        first, end = self._data.within("boundary", cells)
        of = self._data.numbers("boundary_cells", self.mesh.elements, first=first, end=end)
        rows = first + np.flatnonzero(np.isin(of, cells))
        width = len(lattice(FACET[self.mesh.cell], self.degree))
        return self._data.table("boundary_facets", width, self.count, rows)[:, cut].reshape(-1, 3)

    def masses(self, density: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """See :meth:`Figure.masses`: six points have the inertia of a region."""
        points, masses = [], []
        for region, value in density.items():
            row = self._data.moments[self._data.region(region)]
            volume, centre = row[0], row[1:4]
            squares, axes = np.linalg.eigh(row[4:].reshape(3, 3))
            arms = axes * np.sqrt(3.0 * np.maximum(squares, 0.0))
            points += [centre + arms.T, centre - arms.T]
            masses += [np.full(6, value * volume / 6.0)]
        return np.concatenate(points), np.concatenate(masses)

    def nearest(self, place: FloatArray) -> int:
        """See :meth:`Figure.nearest`."""
        low, high = np.moveaxis(self._data.boxes, 1, 0)
        away = np.linalg.norm(np.maximum(np.maximum(low - place, place - high), 0.0), axis=1)
        order, best, found = np.argsort(away, kind="stable"), np.inf, -1
        for start in range(0, len(order), _TOGETHER):
            if away[order[start]] > best:
                break
            cells = self._data.cells_of(order[start : start + _TOGETHER])
            nodes = np.unique(self.cell_nodes(cells))
            gaps = np.linalg.norm(self.places(nodes) - place, axis=1)
            at = int(np.argmin(gaps))
            if (gaps[at], nodes[at]) < (best, found):
                best, found = float(gaps[at]), int(nodes[at])
        return found

    def _candidates(self, place: FloatArray) -> IntArray:
        low, high = np.moveaxis(self._data.boxes, 1, 0)
        wider = _WIDER * np.ptp(self._data.boxes, axis=1)
        inside = ((low - wider <= place) & (place <= high + wider)).all(axis=1)
        return self._data.cells_of(np.flatnonzero(inside))
