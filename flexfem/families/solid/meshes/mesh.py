# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes of solids with named regions, surfaces and sets of nodes; built without DOLFINx."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._memory import check_room
from flexfem._types import FloatArray, IntArray
from flexfem.families.solid.meshes.lagrange import (
    CELLS,
    Lagrange,
    lattice,
    reference_facets,
    reference_points,
    shapes,
)

__all__ = ["SolidMesh", "no_surface"]

#: Cells of files by the names of meshio: shape and degree.
_KINDS = {
    "triangle": ("triangle", 1), "triangle6": ("triangle", 2),
    "quad": ("quadrilateral", 1), "quad9": ("quadrilateral", 2),
    "tetra": ("tetrahedron", 1), "tetra10": ("tetrahedron", 2),
    "hexahedron": ("hexahedron", 1), "hexahedron27": ("hexahedron", 2),
}  # fmt: skip
#: Reference points of cells of second order in the order of VTK, and of corners.
_VTK_HEXAHEDRON = [
    (0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2),
    (1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2),
    (0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1),
    (0, 1, 1), (2, 1, 1), (1, 0, 1), (1, 2, 1), (1, 1, 0), (1, 1, 2), (1, 1, 1),
]  # fmt: skip
_VTK_QUADRILATERAL = [
    (0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1), (1, 1),
]  # fmt: skip
_VTK_TETRAHEDRON = [
    (0, 0, 0), (2, 0, 0), (0, 2, 0), (0, 0, 2),
    (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1),
]  # fmt: skip
_VTK_TRIANGLE = [(0, 0), (2, 0), (0, 2), (1, 0), (1, 1), (0, 1)]
_VTK_PRISM = [
    (0, 0, 0), (2, 0, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (0, 2, 2),
    (1, 0, 0), (1, 1, 0), (0, 1, 0), (1, 0, 2), (1, 1, 2), (0, 1, 2),
    (0, 0, 1), (2, 0, 1), (0, 2, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1),
]  # fmt: skip
_VTK: Mapping[str, Any] = {
    "triangle": _VTK_TRIANGLE, "quadrilateral": _VTK_QUADRILATERAL,
    "tetrahedron": _VTK_TETRAHEDRON, "hexahedron": _VTK_HEXAHEDRON, "prism": _VTK_PRISM,
}  # fmt: skip


@dataclass(frozen=True, eq=False, init=False)
class SolidMesh:
    """Cells of one shape that fill a solid, or a plane figure, with names of parts of it.

    Attributes:
        points: Places of the geometry's nodes, shape (n, 3), metres; z = 0 of plane figures.
        cells: Node indices, shape (m, k), in the order of Basix and DOLFINx.
        cell: "tetrahedron", "hexahedron", "prism" (wedge), "triangle" or "quadrilateral".
        degree: Degree of the geometry, 1 to 3.
        regions: Cell indices by the name of the region.
        surfaces: Corners (f, c) of facets (edges of plane figures) by the name of the surface.
        nodes: Node indices by the name of the set.
    """

    points: FloatArray
    cells: IntArray
    cell: str
    degree: int
    regions: Mapping[str, IntArray]
    surfaces: Mapping[str, IntArray]
    nodes: Mapping[str, IntArray]

    def __init__(
        self,
        points: npt.ArrayLike,
        cells: npt.ArrayLike,
        cell: str,
        *,
        degree: int = 1,
        regions: Mapping[str, npt.ArrayLike] = MappingProxyType({}),
        surfaces: Mapping[str, npt.ArrayLike] = MappingProxyType({}),
        nodes: Mapping[str, npt.ArrayLike] = MappingProxyType({}),
    ) -> None:
        """Create a mesh.

        Raises:
            TypeError: An argument does not consist of numbers of the right kind.
            ValueError: An unknown shape or degree, NaN, an index out of range, a node without
                cell, a cell that is inside out or has no volume, or an empty or unknown set.
        """
        owner = "SolidMesh"
        if not isinstance(cell, str) or cell not in CELLS:
            raise ValueError(
                f"{owner}: cell must be one of {', '.join(CELLS)}, got {_checks.show(cell)}"
            )
        if type(degree) is not int or not 1 <= degree <= 3:
            raise ValueError(f"{owner}: degree must be 1, 2 or 3, got {_checks.show(degree)}")
        xyz = _checks.array(owner, "points", points, (-1, 3))
        rows = _checks.indices(owner, "cells", cells, len(xyz), len(lattice(cell, degree)))
        if len(rows) == 0:
            raise ValueError(f"{owner}: cells must hold at least one cell, got none")
        _check_once(owner, rows[:, : len(lattice(cell, 1))])
        unused = np.setdiff1d(np.arange(len(xyz)), rows)
        if len(unused):
            raise ValueError(f"{owner}: node {unused[0]} belongs to no cell")
        _checks.assign(
            self, points=xyz, cells=_checks.freeze(rows, np.int64), cell=cell, degree=degree
        )
        self._check_volumes(owner)
        _checks.instance(owner, "surfaces", surfaces, Mapping)
        _checks.assign(
            self,
            regions=_sets(owner, "regions", regions, len(rows)),
            nodes=_sets(owner, "nodes", nodes, len(xyz)),
            surfaces=MappingProxyType(
                {name: self._surface(owner, name, rows) for name, rows in surfaces.items()}
            ),
        )

    def _check_volumes(self, owner: str) -> None:
        """Raise for cells that are inside out or flat, and for plane figures outside z = 0."""
        if self.dimension == 2 and self.points[:, 2].any():
            at = int(np.argmax(self.points[:, 2] != 0.0))
            raise ValueError(
                f"{owner}: plane figures lie at z = 0, node {at} is at z = {self.points[at, 2]:g}"
            )
        ratio = np.inf * np.ones(len(self.cells))
        sizes = np.ptp(self.points[self.cells], axis=1).max(axis=1) ** self.dimension
        for gradients in shapes(self.cell, self.degree, reference_points(self.cell, self.degree))[
            1
        ]:
            sides = np.einsum("kd,mka->mad", gradients, self.points[self.cells])
            ratio = np.minimum(ratio, np.linalg.det(sides[:, : self.dimension]) / sizes)
        if not (ratio > _FLAT).all():
            at = int(np.argmin(ratio))
            what = "is inside out" if ratio[at] < 0.0 else "has no volume"
            place = self.points[self.cells[at]].mean(axis=0)
            raise ValueError(
                f"{owner}: cell {at} at {_checks.show(place.round(9).tolist())} {what}"
            )

    def _surface(self, owner: str, name: str, corners: npt.ArrayLike) -> IntArray:
        """Checked corners (f, c) of a named surface, as rows of :attr:`facets` are."""
        _checks.text(owner, "name of a surface", name)
        width = self.facets.shape[1]
        what = f'surfaces["{name}"]'
        given = _checks.indices(owner, what, corners, len(self.points), width)
        if not len(given):
            raise ValueError(f"{owner}: {what} is empty")
        known = np.flatnonzero(np.isin(self.facets.max(axis=1), given.max(axis=1)))
        number = _numbers_of_rows(np.sort(np.concatenate([self.facets[known], given]), axis=1))
        row = np.full(len(number), -1)
        row[number[: len(known)]] = known
        rows = row[number[len(known) :]]
        if (rows < 0).any():
            at = int(np.argmax(rows < 0))
            raise ValueError(f"{owner}: {what}: {given[at].tolist()} is no facet of a cell")
        return _checks.freeze(self.facets[rows], np.int64)

    @property
    def elements(self) -> int:
        """Number of cells."""
        return len(self.cells)

    @property
    def region_names(self) -> tuple[str, ...]:
        """Names of the regions."""
        return tuple(self.regions)

    def region_fault(self, names: Collection[str]) -> str:
        """First words of what keeps some regions from having each cell once, or nothing."""
        times = np.zeros(len(self.cells), dtype=np.int64)
        for name in names:
            times[self.regions[name]] += 1
        if (times == 1).all():
            return ""
        at = int(np.argmax(times != 1))
        return f"cell {at} has {'no' if times[at] == 0 else 'more than one'}"

    @property
    def dimension(self) -> int:
        """2 for plane figures, 3 for solids."""
        return CELLS[self.cell]

    @cached_property
    def corners(self) -> IntArray:
        """Corners (m, c) of the cells."""
        return self.cells[:, : len(lattice(self.cell, 1))]

    @cached_property
    def _every_facet(self) -> tuple[IntArray, IntArray]:
        """Corners (f, c) of all facets, those of cell after cell, and numbers of equal ones."""
        local = reference_facets(self.cell)
        width = max(len(facet) for facet in local)
        rows = [self.corners[:, facet] for facet in local]
        rows = [np.pad(r, ((0, 0), (0, width - r.shape[1])), constant_values=-1) for r in rows]
        every = np.stack(rows, axis=1).reshape(-1, width)
        return every, _numbers_of_rows(np.sort(every, axis=1))

    @cached_property
    def facets(self) -> IntArray:
        """Corners (f, c) of all facets, once each, -1 for a fourth corner that is not there."""
        every, number = self._every_facet
        _, first = np.unique(number, return_index=True)
        return every[np.sort(first)]

    @cached_property
    def boundary(self) -> IntArray:
        """Corners (f, c) of the facets that belong to one cell."""
        every, number = self._every_facet
        _, first, times = np.unique(number, return_index=True, return_counts=True)
        found: IntArray = every[np.sort(first[times == 1])]
        return found

    def cells_of_facets(self, corners: IntArray) -> IntArray:
        """A cell (f,) of each of some facets (f, c), which are rows like those of :attr:`facets`.

        Of two it is the later one.
        """
        every, _ = self._every_facet
        near = np.flatnonzero(np.isin(every.max(axis=1), corners.max(axis=1)))
        number = _numbers_of_rows(np.sort(np.concatenate([every[near], corners]), axis=1))
        cell = np.full(len(number), -1)
        cell[number[: len(near)]] = near // len(reference_facets(self.cell))
        found: IntArray = cell[number[len(near) :]]
        return found

    def surface(self, owner: str, name: str) -> IntArray:
        """Corners (f, c) of a named surface; "boundary" names all of it unless a surface does.

        Raises:
            ValueError: There is no such surface; the message begins with the owner.
        """
        if name in self.surfaces:
            return self.surfaces[name]
        if name == "boundary":
            return self.boundary
        raise no_surface(owner, name, self.surfaces)

    def named_nodes(self, owner: str, name: str) -> IntArray:
        """Nodes of the geometry, ascending, of a surface or a set of nodes.

        Raises:
            ValueError: There is neither; the message begins with the owner.
        """
        if name in self.nodes:
            return self.nodes[name]
        corners = self.surface(owner, name)
        made = Lagrange.of(self.points, self.cells, self.cell, self.degree, self.degree)
        own = np.empty(len(self.points), dtype=np.int64)
        own[made.cells] = self.cells
        counts = (corners >= 0).sum(axis=1)
        found = [made.of_facets(corners[counts == k])[1].ravel() for k in np.unique(counts)]
        return np.unique(own[np.concatenate(found)])

    @classmethod
    def box(
        cls,
        sizes: npt.ArrayLike,
        counts: Sequence[int],
        cell: str = "hexahedron",
        *,
        origin: npt.ArrayLike = (0.0, 0.0, 0.0),
    ) -> Self:
        """Return a box of hexahedra or tetrahedra, or a rectangle at z = 0, along the axes.

        Its surfaces are "x0", "x1", "y0", ... at the lower and upper end of each axis.

        Args:
            sizes: Edge lengths, metres, three of a box, two of a rectangle.
            counts: Numbers of cells along the axes; each is cut in six tetrahedra (two triangles).
            cell: "hexahedron" or "tetrahedron", "quadrilateral" or "triangle".
            origin: Lowest corner, metres.

        Raises:
            TypeError: An argument does not consist of numbers of the right kind.
            ValueError: Sizes that are not positive, a number of cells below one, another shape.
        """
        owner = "SolidMesh.box"
        known = [name for name in CELLS if name != "prism"]
        if not isinstance(cell, str) or cell not in known:
            raise ValueError(
                f"{owner}: cell must be one of {', '.join(known)}, got {_checks.show(cell)}"
            )
        dimension = CELLS[cell]
        lengths = _checks.array(owner, "sizes", sizes, (dimension,))
        if not (lengths > 0.0).all():
            raise ValueError(f"{owner}: sizes must be positive, got {lengths.tolist()}")
        if not isinstance(counts, (list, tuple, np.ndarray)) or len(counts) != dimension:
            raise ValueError(
                f"{owner}: counts must be {dimension} numbers, got {_checks.show(counts)}"
            )
        numbers = [_checks.count(owner, "counts", count, 1) for count in counts]
        nodes = float(np.prod([n + 1.0 for n in numbers]))
        check_room(f"{owner}: {nodes:.3g} nodes", _NODE * nodes)
        ticks = [np.linspace(0.0, s, n + 1) for s, n in zip(lengths, numbers, strict=True)]
        grid = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, dimension)
        points = np.zeros((len(grid), 3))
        points[:, :dimension] = grid
        shape = [n + 1 for n in numbers]
        first = np.stack(np.meshgrid(*map(np.arange, numbers), indexing="ij"), -1)
        first = first.reshape(-1, dimension)
        steps = [offset[::-1] for offset in product((0, 1), repeat=dimension)]
        rows = np.stack([np.ravel_multi_index((first + s).T, shape) for s in steps], axis=1)
        if cell in ("tetrahedron", "triangle"):
            rows = rows[:, _CUT[dimension]].reshape(-1, dimension + 1)
        made = cls(points + _checks.vector(owner, "origin", origin), rows, cell)
        ends = {}
        for axis, name in enumerate("xyz"[:dimension]):
            for side, end in enumerate((0.0, lengths[axis])):
                on = np.append(points[:, axis] == end, True)
                ends[f"{name}{side}"] = made.boundary[on[made.boundary].all(axis=1)]
        return cls(made.points, rows, cell, surfaces=ends)

    @classmethod
    def read(
        cls,
        path: str | Path,
        *,
        scale: float = 1.0,
        merge: float | None = None,
        bodies: Sequence[str] | None = None,
        facets: Sequence[str] | None = None,
    ) -> Self:
        """Read the solids of a file of gmsh, Abaqus, Nastran or VTK, or its plane cells.

        Element sets are regions; sets of faces, of surface elements and of nodes that have faces at
        the boundary are surfaces, other sets of nodes stay sets of nodes. Pyramids, wedges and
        mixtures of cells are cut into tetrahedra (triangles).

        Args:
            path: As for :func:`read_mesh`.
            scale: Metres in a unit of length of the file, 1e-3 for millimetres.
            merge: Make nodes that are at most so far apart one, m; None leaves them apart.
            bodies: Element sets to take; None for all.
            facets: Sets to take as surfaces; None for all that have some.

        Raises:
            TypeError: An argument is of the wrong kind.
            ValueError: The file is missing or unreadable, has neither solids nor surfaces or no
                such set, groups overlap, or cells are inside out or without volume.
        """
        from flexfem.mesh.imported.body import body_data
        from flexfem.mesh.imported.read import read_mesh_file

        file = read_mesh_file(Path(path), scale, merge)
        data = body_data(file, bodies, facets)
        cell, degree = _KINDS[data.kind]
        try:
            made = cls._of_groups(
                data.points, data.cells[:, _from_vtk(cell, degree)], cell, degree, data.values,
                data.facets, data.facet_values, data.groups,
            )  # fmt: skip
        except ValueError as error:
            raise ValueError(f"{file.owner}: {error}") from None
        place = {tuple(x): k for k, x in enumerate(data.points.tolist())}
        sets = {}
        for name, rows in file.node_sets.items():
            found = [place[x] for x in map(tuple, file.points[rows].tolist()) if x in place]
            if found and name not in made.surfaces:
                sets[name] = found
        return made._with(nodes={**made.nodes, **sets})

    @classmethod
    def from_dolfinx(
        cls, mesh: Any, cell_tags: Any = None, facet_tags: Any = None,
        names: Mapping[str, tuple[int, int]] = MappingProxyType({}),
    ) -> Self:  # fmt: skip
        """Return the cells of a DOLFINx mesh, of all ranks on every rank (collective).

        Args:
            mesh: Mesh of one cell type, geometry of degree 1 to 3.
            cell_tags: MeshTags of regions; None for one region.
            facet_tags: MeshTags of surfaces; None without any.
            names: Dimension and tag by name; a :class:`BodyMesh` has them as ``groups``. Tags
                without a name are called "region 1" or "surface 1" after their number.

        Raises:
            TypeError: An argument is of the wrong kind.
            ValueError: Cells of another shape, or several shapes.
        """
        from flexfem.families.solid.meshes.from_dolfinx import gathered

        points, cells, cell, degree, values, facets, facet_values, groups = gathered(
            mesh, cell_tags, facet_tags, names
        )
        return cls._of_groups(points, cells, cell, degree, values, facets, facet_values, groups)

    @classmethod
    def _of_groups(
        cls, points: FloatArray, cells: IntArray, cell: str, degree: int, values: IntArray,
        facets: IntArray, facet_values: IntArray, groups: Mapping[str, tuple[int, int]],
    ) -> Self:  # fmt: skip
        """Mesh with tagged cells and facets; plane figures lie at z = 0."""
        dimension = CELLS[cell]
        tagged = {2: facet_values, 3: facet_values} | {dimension: values}
        tagged[dimension - 1] = facet_values
        regions, surfaces = {}, {}
        for name, (dim, tag) in groups.items():
            if dim == dimension and (values == tag).any():
                regions[name] = np.flatnonzero(values == tag)
            elif dim == dimension - 1 and (facet_values == tag).any():
                surfaces[name] = facets[facet_values == tag]
        return cls(points, cells, cell, degree=degree, regions=regions, surfaces=surfaces)

    def _with(self, **parts: Any) -> Self:
        """The mesh with other points, surfaces or sets of nodes, checked anew."""
        kept = {name: getattr(self, name) for name in ("points", "regions", "surfaces", "nodes")}
        return type(self)(cells=self.cells, cell=self.cell, degree=self.degree, **kept | parts)

    def moved(self, points: npt.ArrayLike) -> Self:
        """Return the mesh with its nodes at other places.

        Args:
            points: Shape (n, 3), metres.

        Raises:
            TypeError: They are no numbers.
            ValueError: Another shape, or cells that are inside out or without volume.
        """
        places = _checks.array("SolidMesh.moved", "points", points, self.points.shape)
        return self._with(points=places)

    def raised(self, degree: int) -> Self:
        """Return the same cells with further nodes, which :meth:`moved` may bring onto curves.

        Args:
            degree: Degree of the geometry, that of the mesh at least, 3 at most.

        Raises:
            ValueError: Another degree.
        """
        owner = "SolidMesh.raised"
        if type(degree) is not int or not self.degree <= degree <= 3:
            raise ValueError(
                f"{owner}: degree must be {self.degree} to 3, got {_checks.show(degree)}"
            )
        made = Lagrange.of(self.points, self.cells, self.cell, degree, self.degree)
        surfaces, nodes = (
            {name: np.where(rows < 0, -1, made.corner(rows)) for name, rows in sets.items()}
            for sets in (self.surfaces, self.nodes)
        )
        return type(self)(
            made.points, made.cells, self.cell, degree=degree, regions=self.regions,
            surfaces=surfaces, nodes={name: rows[rows >= 0] for name, rows in nodes.items()},
        )  # fmt: skip

    def with_surfaces(self, **places: Callable[[FloatArray], npt.ArrayLike]) -> Self:
        """Return the mesh with further surfaces, named by places on its boundary.

        Args:
            places: A function of places (n, 3), m, by the name of the surface, True at its corners.

        Raises:
            ValueError: It returns something else, or no facet has all of its corners there.
        """
        owner, found = "SolidMesh.with_surfaces", {}
        for name, place in places.items():
            there = np.asarray(place(self.points))
            if there.shape != (len(self.points),) or there.dtype != np.bool_:
                raise ValueError(
                    f"{owner}: {name} must return {len(self.points)} times True or False, got "
                    f"{_checks.show(there)}"
                )
            found[name] = self.boundary[(there[self.boundary] | (self.boundary < 0)).all(axis=1)]
        return self._with(surfaces={**self.surfaces, **found})


#: Bytes of a node of a box with its cells, sets and what makes them.
_NODE = 800.0
#: Determinant of a cell's Jacobian over its extent to the power of its dimension, at least.
_FLAT = 1e-12
#: Corners of the simplices that fill a quadrilateral or a hexahedron, all with one diagonal.
_CUT = {
    2: [[0, 1, 3], [0, 3, 2]],
    3: [[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]],
}


def _check_once(owner: str, corners: IntArray) -> None:
    """Refuse a cell that has a node twice, or that is there twice."""
    ordered = np.sort(corners, axis=1)
    double = (np.diff(ordered, axis=1) == 0).any(axis=1)
    if double.any():
        at = int(np.argmax(double))
        raise ValueError(f"{owner}: cell {at} has a node twice: {corners[at].tolist()}")
    order = np.lexsort(ordered.T[::-1])
    same = (ordered[order[1:]] == ordered[order[:-1]]).all(axis=1)
    if same.any():
        at = int(np.argmax(same))
        first, second = sorted(order[at : at + 2].tolist())
        raise ValueError(f"{owner}: cells {first} and {second} have the same nodes")


def _sets(
    owner: str, what: str, sets: Mapping[str, npt.ArrayLike], limit: int
) -> Mapping[str, IntArray]:
    """Checked ascending indices by name."""
    _checks.instance(owner, what, sets, Mapping)
    found = {}
    for name, rows in sets.items():
        _checks.text(owner, f"name in {what}", name)
        found[name] = _checks.freeze(
            np.unique(_checks.indices(owner, f'{what}["{name}"]', rows, limit, 1)), np.int64
        )
        if not len(found[name]):
            raise ValueError(f'{owner}: {what}["{name}"] is empty')
    return MappingProxyType(found)


def _numbers_of_rows(rows: IntArray) -> IntArray:
    """Numbers (m,) of rows (m, c) of numbers from -1, equal for equal rows alone."""
    base = int(rows.max(initial=0)) + 2
    found: IntArray = np.zeros(len(rows), dtype=np.int64)
    for column in rows.T:
        found = np.unique(found * base + column + 1, return_inverse=True)[1]
    return found


def _from_vtk(cell: str, degree: int) -> IntArray:
    """Positions in the order of VTK of the nodes in that of Basix."""
    given = np.array(_VTK[cell]) / 2.0
    own = reference_points(cell, degree)
    return np.array([int(np.abs(given - x).sum(axis=1).argmin()) for x in own], dtype=np.int64)


def no_surface(owner: str, name: str, surfaces: Iterable[str]) -> ValueError:
    """The error of a name that no surface has; the message begins with the owner."""
    known = ", ".join([*surfaces, "boundary"])
    return ValueError(f"{owner}: no surface {_checks.show(name)}; there are {known}")
