# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solids and surfaces of a mesh file as one body, and named faces of it."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.mesh.imported.cut import CELL_FACES, cut_faces, cut_solids
from flexfem.mesh.imported.mesh_file import (
    KINDS,
    MeshFile,
    checked_names,
    shown,
    without_copies,
)
from flexfem.mesh.imported.second_order import FULL_ORDER, full_order, is_straight
from flexfem.mesh.imported.surface import split_quadrilaterals

__all__ = ["BodyData", "body_data"]

# Kind of first order of each kind of cells
_SHAPES = {kind: kind.rstrip("0123456789") for kind in KINDS}


class BodyData(NamedTuple):
    """A mesh of one kind of cells with tags of cells and of their facets.

    Attributes:
        kind: of the cells.
        points: (n, 3), m.
        cells: (m, k), nodes in the order of VTK.
        values: (m,) tag of each cell.
        facets: (q, c) corners of the facets in groups.
        facet_values: (q,) their tags.
        groups: dimension and tag by name.
    """

    kind: str
    points: FloatArray
    cells: IntArray
    values: IntArray
    facets: IntArray
    facet_values: IntArray
    groups: dict[str, tuple[int, int]]


def body_data(
    file: MeshFile, bodies: Sequence[str] | None, facets: Sequence[str] | None
) -> BodyData:
    """Return the solids in named element sets, or the surfaces if there are no solids.

    Wedges, pyramids and mixtures of solids are cut into tetrahedra, mixtures of triangles and
    quadrilaterals into triangles. Facets are faces (edges) at the boundary of the body.

    Raises:
        TypeError: names that are no list of strings.
        ValueError: neither solids nor surfaces, groups that overlap, or a name that is not there.
    """
    dimension = _dimension(file, bodies)
    sets = file.chosen("bodies", dimension, bodies, disjoint=True)
    tag = np.zeros(len(file.dimensions), dtype=np.int64)
    for number, rows in enumerate(sets.values(), 1):
        tag[rows] = number
    points, kind, cells, element = _cells(file, tag > 0)
    corners = cells[:, : KINDS[kind].corners]
    groups = {name: (dimension, number) for number, name in enumerate(sets, 1)}
    found = _Facets(file, kind, corners).found(facets, groups)
    names = list(found)
    groups |= {name: (dimension - 1, len(sets) + i) for i, name in enumerate(names, 1)}
    rows, nodes = np.unique(cells, return_inverse=True)
    place = np.full(len(points), -1)
    place[rows] = np.arange(len(rows))
    width = len(CELL_FACES[_SHAPES[kind]][0])
    tagged = [np.empty((0, width), dtype=np.int64), *found.values()]
    return BodyData(
        kind,
        points[rows],
        nodes.reshape(cells.shape),
        tag[element],
        place[np.concatenate(tagged)],
        np.repeat(np.arange(len(names)) + len(sets) + 1, [len(found[name]) for name in names]),
        groups,
    )


def _dimension(file: MeshFile, bodies: Sequence[str] | None) -> int:
    """Return 3 if there are solids, 2 otherwise."""
    solid = file.dimensions == 3
    if bodies is None or isinstance(bodies, str):
        return 3 if solid.any() or not (file.dimensions == 2).any() else 2
    empty = np.empty(0, dtype=np.int64)
    chosen = [file.element_sets.get(name, empty) for name in bodies if isinstance(name, str)]
    surfaces = any((file.dimensions[rows] == 2).any() for rows in chosen)
    return 2 if surfaces and not any(solid[rows].any() for rows in chosen) else 3


def _cells(file: MeshFile, taken: np.ndarray) -> tuple[FloatArray, str, IntArray, IntArray]:
    """Return points, kind, nodes and element numbers of the cells taken, of one kind."""
    dimension = file.dimensions[np.argmax(taken)]
    parts = {}
    for kind, nodes in file.cells.items():
        numbers = file.numbered(kind)
        if KINDS[kind].dimension == dimension and (mine := taken[numbers]).any():
            parts[kind] = (nodes[mine], numbers[mine])
    if len(parts) == 1 and _SHAPES[next(iter(parts))] not in ("wedge", "pyramid"):
        ((kind, (nodes, numbers)),) = parts.items()
        if kind not in FULL_ORDER or is_straight(file.points, kind, nodes):
            shape = _SHAPES[kind]
            return file.points, shape, nodes[:, : KINDS[kind].corners], numbers
        points, nodes = full_order(file.points, kind, nodes)
        return points, FULL_ORDER[kind], nodes, numbers
    return file.points, *_simplices(file, parts, int(dimension))


def _simplices(
    file: MeshFile, parts: Mapping[str, tuple[IntArray, IntArray]], dimension: int
) -> tuple[str, IntArray, IntArray]:
    """Return kind, corners and element numbers of cells of several kinds cut into simplices."""
    shapes = {_SHAPES[kind] for kind in parts}
    whole = shapes in ({"hexahedron"}, {"quad"})
    cells, elements = [], []
    for kind, (nodes, numbers) in parts.items():
        shape, corners = _SHAPES[kind], nodes[:, : KINDS[kind].corners]
        if shape in ("triangle", "tetra") or whole:
            cells.append(corners)
            elements.append(numbers)
        elif dimension == 3:
            tetrahedra, row = cut_solids(shape, corners)
            cells.append(tetrahedra)
            elements.append(numbers[row])
        else:
            local = split_quadrilaterals(file.points, corners)
            pair = corners[:, np.newaxis].repeat(2, axis=1)
            cells.append(np.take_along_axis(pair, local, axis=2).reshape(-1, 3))
            elements.append(np.repeat(numbers, 2))
    element = np.concatenate(elements)
    order = np.argsort(element, kind="stable")
    kind = shapes.pop() if whole else ("tetra" if dimension == 3 else "triangle")
    return kind, np.concatenate(cells)[order], element[order]


class _Facets:
    """Faces of cells, and those in sets of faces, surface elements and nodes."""

    def __init__(self, file: MeshFile, kind: str, corners: IntArray) -> None:
        self.file = file
        faces = CELL_FACES[_SHAPES[kind]]
        self.width = len(faces[0])
        every = np.sort(np.concatenate([corners[:, face] for face in faces]), axis=1)
        self.facets, times = np.unique(every, axis=0, return_counts=True)
        self.boundary = self.facets[times == 1]

    @cached_property
    def known(self) -> set[tuple[int, ...]]:
        """All facets, for looking some up."""
        return {tuple(row) for row in self.facets.tolist()}

    def found(
        self, names: Sequence[str] | None, taken: Mapping[str, object]
    ) -> dict[str, IntArray]:
        """Return corners of the facets in the requested sets, of all that have some when None."""
        file = self.file
        every = dict.fromkeys([*file.facet_sets, *file.element_sets, *file.node_sets])
        free = [name for name in every if name not in taken]
        if names is None:
            tried = {k: self._facets(k) for k in free if k not in file.optional}
            groups = without_copies(
                {k: rows for k, rows in tried.items() if isinstance(rows, np.ndarray)}
            )
        else:
            groups = {}
            for name in checked_names(file.owner, "facets", names):
                rows = "a body has this name" if name in taken else self._facets(name)
                if isinstance(rows, str):
                    known = [k for k in free if isinstance(self._facets(k), np.ndarray)]
                    raise ValueError(
                        f'{file.owner}: facets "{name}": {rows}; sets with facets are '
                        f"{shown(known)}"
                    )
                groups[name] = rows
        self._check_disjoint(groups)
        return groups

    def _facets(self, name: str) -> IntArray | str:
        """Return the corners of the facets of a set, sorted, or why there are none."""
        given = self._given(name)
        if given:
            lost = sum(row not in self.known for row in given)
            if lost == 0:
                return np.array(sorted(given))
            return f"{lost} of its {len(given)} faces are none of the body"
        if name not in self.file.node_sets:
            return self.file.skipped.get(name, "there is no such set of faces or nodes")
        nodes = self.file.node_sets[name]
        if len(nodes) >= self.width:  # a file may have a set for each node
            inside = np.zeros(len(self.file.points), dtype=np.bool_)
            inside[nodes] = True
            rows: IntArray = self.boundary[inside[self.boundary].all(axis=1)]
            if len(rows):
                return rows
        return "no face at the boundary of the body has all of its nodes in this set"

    def _given(self, name: str) -> set[tuple[int, ...]]:
        """Return the faces that a set names by elements, those that were cut in pieces."""
        file = self.file
        faces = [tuple(face) for face in file.facet_sets.get(name, ())]
        rows = file.element_sets.get(name, ())
        for kind, nodes in file.cells.items() if not faces else ():
            if KINDS[kind].dimension == (1 if self.width == 2 else 2):
                mine = np.isin(file.numbered(kind), rows)
                faces += [tuple(face) for face in nodes[mine, : KINDS[kind].corners].tolist()]
        if self.width == 3:
            pieces = [cut_faces(np.array([face]))[0] for face in faces if len(face) == 4]
            faces = [face for face in faces if len(face) != 4]
            faces += [tuple(row) for piece in pieces for row in piece.tolist()]
        return {tuple(sorted(face)) for face in faces}

    def _check_disjoint(self, groups: Mapping[str, IntArray]) -> None:
        """Raise when two groups share a facet."""
        owner: dict[tuple[int, ...], str] = {}
        for name, rows in groups.items():
            for row in map(tuple, rows.tolist()):
                if (other := owner.setdefault(row, name)) != name:
                    raise ValueError(
                        f'{self.file.owner}: sets "{other}" and "{name}" share faces: choose '
                        f"those that are needed, facets=[...], from {shown(groups)}"
                    )
