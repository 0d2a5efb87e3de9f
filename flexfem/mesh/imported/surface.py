# SPDX-License-Identifier: LGPL-3.0-or-later
"""Triangles of a mesh file, and lines and nodes on them."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.mesh.geometry.topology import edge_keys
from flexfem.mesh.imported.mesh_file import MeshFile, checked_names, shown

__all__ = ["SurfaceData", "split_quadrilaterals", "surface_data"]

# Diagonals count as equally long when they differ by less; then the first one is taken
_EQUAL = 1e-3


class SurfaceData(NamedTuple):
    """Arguments of a SurfaceMesh."""

    points: FloatArray
    triangles: IntArray
    bodies: Mapping[str, IntArray]
    lines: Mapping[str, IntArray]
    nodes: Mapping[str, int]
    midpoints: FloatArray | None


def surface_data(
    file: MeshFile,
    bodies: Sequence[str] | None,
    lines: Sequence[str] | None,
    nodes: Sequence[str] | None,
) -> SurfaceData:
    """Return the triangles in named element sets, with lines and nodes on them.

    Quadrilaterals are cut in two. Middle nodes of second order say where the midpoints of edges
    are.

    Raises:
        TypeError: Names that are no list of strings.
        ValueError: No triangles, bodies that share some, or a name that is not there.
    """
    sets = file.chosen("bodies", 2, bodies, disjoint=True)
    taken = np.zeros(len(file.dimensions), dtype=np.bool_)
    taken[np.concatenate(list(sets.values()))] = True
    element, corners, midpoints = _triangles(file)
    order = np.argsort(element, kind="stable")
    order = order[taken[element[order]]]
    element, corners, midpoints = element[order], corners[order], midpoints[order]
    rows, triangles = np.unique(corners, return_inverse=True)
    triangles = triangles.reshape(-1, 3)
    used = np.zeros(len(file.points), dtype=np.bool_)
    used[rows] = True
    named = file.one_nodes("nodes", nodes, used)
    owners = np.zeros(len(element), dtype=np.int64)
    for number, members in enumerate(sets.values()):
        owners[np.isin(element, members)] = number
    return SurfaceData(
        file.points[rows],
        triangles,
        {name: np.flatnonzero(owners == number) for number, name in enumerate(sets)},
        _Lines(file, rows, triangles, owners).found(lines),
        {name: int(np.searchsorted(rows, node)) for name, node in named.items()},
        None if np.isnan(midpoints).all() else midpoints,
    )


def split_quadrilaterals(points: FloatArray, quads: IntArray) -> IntArray:
    """Return the two triangles of each quadrilateral, as columns of it, shape (m, 2, 3).

    They are cut along the shorter diagonal, from the first to the third node when both are equally
    long: grids whose cells are numbered in the same order get parallel diagonals.
    """
    a, b, c, d = (points[quads[:, i]] for i in range(4))
    first, second = np.linalg.norm(c - a, axis=1), np.linalg.norm(d - b, axis=1)
    along_first = first <= (1.0 + _EQUAL) * second
    return np.where(
        along_first[:, np.newaxis, np.newaxis], [[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]
    )


def _triangles(file: MeshFile) -> tuple[IntArray, IntArray, FloatArray]:
    """Return element numbers, corners (m, 3) and midpoints of edges (m, 3, 3) of all triangles."""
    elements, corners = [np.empty(0, dtype=np.int64)], [np.empty((0, 3), dtype=np.int64)]
    midpoints = [np.empty((0, 3, 3))]
    for kind in ("triangle", "triangle6"):
        nodes = file.cells.get(kind, np.empty((0, 6), dtype=np.int64))
        elements.append(file.numbered(kind))
        corners.append(nodes[:, :3])
        midpoints.append(
            file.points[nodes[:, [4, 5, 3]]]  # opposite to the corners
            if kind == "triangle6"
            else np.full((len(nodes), 3, 3), np.nan)
        )
    for kind in ("quad", "quad8", "quad9"):
        nodes = file.cells.get(kind, np.empty((0, 9), dtype=np.int64))
        local = split_quadrilaterals(file.points, nodes[:, :4])
        elements.append(np.repeat(file.numbered(kind), 2))
        corners.append(
            np.take_along_axis(nodes[:, np.newaxis, :4].repeat(2, axis=1), local, axis=2).reshape(
                -1, 3
            )
        )
        midpoints.append(_quadrilateral_midpoints(file.points, kind, nodes, local))
    return np.concatenate(elements), np.concatenate(corners), np.concatenate(midpoints)


def _quadrilateral_midpoints(
    points: FloatArray, kind: str, nodes: IntArray, local: IntArray
) -> FloatArray:
    """Return midpoints of the edges opposite to the corners of the halves, shape (2 m, 3, 3)."""
    count = 2 * len(nodes)
    if kind == "quad" or count == 0:
        return np.full((count, 3, 3), np.nan)
    corner, side = points[nodes[:, :4]], points[nodes[:, 4:8]]
    # the middle of eight nodes is where their shape functions have it
    centre = (
        points[nodes[:, 8]]
        if kind == "quad9"
        else 0.5 * side.sum(axis=1) - 0.25 * corner.sum(axis=1)
    )
    places = np.concatenate([side, centre[:, np.newaxis]], axis=1)
    following = np.roll(local, -1, axis=2)
    last = np.roll(local, -2, axis=2)
    ends = np.stack([np.minimum(following, last), np.maximum(following, last)], axis=-1)
    step = ends[..., 1] - ends[..., 0]
    which = np.where(step == 2, 4, np.where(step == 3, 3, ends[..., 0]))
    found = np.take_along_axis(
        places[:, np.newaxis].repeat(2, axis=1), which[..., np.newaxis].repeat(3, axis=-1), axis=2
    )
    return found.reshape(-1, 3, 3)


class _Lines:
    """Lines along edges of triangles, from sets of lines, of edges and of nodes."""

    def __init__(
        self, file: MeshFile, rows: IntArray, triangles: IntArray, bodies: IntArray
    ) -> None:
        self.file, self.rows = file, rows
        count = len(rows)
        edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        keys = edge_keys(edges, count)
        self.keys, first = np.unique(keys, return_index=True)
        self.edges = edges[first]
        # at the boundary of a body, whatever other bodies are beside it
        own, times = np.unique(
            np.column_stack([keys, np.repeat(bodies, 3)]), axis=0, return_counts=True
        )
        self.boundary = np.isin(self.keys, own[times == 1, 0])
        self.local = np.full(len(file.points), -1)
        self.local[rows] = np.arange(count)

    def found(self, names: Sequence[str] | None) -> dict[str, IntArray]:
        """Return the node pairs of the requested lines, of all when None."""
        file = self.file
        every = dict.fromkeys([*file.element_sets, *file.facet_sets, *file.node_sets])
        if names is None:
            pairs = {k: self._pairs(k) for k in every if k not in file.optional}
            return {k: found for k, found in pairs.items() if isinstance(found, np.ndarray)}
        lines = {}
        for name in checked_names(file.owner, "lines", names):
            found = self._pairs(name)
            if isinstance(found, str):
                known = [k for k in every if isinstance(self._pairs(k), np.ndarray)]
                raise ValueError(
                    f'{file.owner}: line "{name}": {found}; lines there are {shown(known)}'
                )
            lines[name] = found
        return lines

    def _pairs(self, name: str) -> IntArray | str:
        """Return the node pairs of a line, or why there are none."""
        given = self._given(name)
        if len(given):
            there = np.isin(edge_keys(given, len(self.rows)), self.keys) & (given >= 0).all(axis=1)
            if there.all():
                return given
            return f"{(~there).sum()} of its {len(given)} lines follow no edge of the triangles"
        if name not in self.file.node_sets:
            return "there is no such set of lines, edges or nodes"
        nodes = self.local[self.file.node_sets[name]]
        return self._along(np.unique(nodes[nodes >= 0]))

    def _given(self, name: str) -> IntArray:
        """Return the ends of the lines and edges of a set, -1 for nodes of no triangle."""
        file = self.file
        found = [np.empty((0, 2), dtype=np.int64)]
        for kind in ("line", "line3"):
            numbers = np.isin(file.numbered(kind), file.element_sets.get(name, ()))
            found.append(file.cells[kind][numbers, :2] if numbers.any() else found[0])
        edges = [facet for facet in file.facet_sets.get(name, ()) if len(facet) == 2]
        if edges and not any(map(len, found)):
            found.append(np.array(edges))
        return self.local[np.concatenate(found)]

    def _along(self, nodes: IntArray) -> IntArray | str:
        """Return the edges between the nodes of a set if these make lines without branches."""
        if len(nodes) < 2:
            return f"a set of {len(nodes)} nodes of the triangles makes no line"
        inside = np.zeros(len(self.rows), dtype=np.bool_)
        inside[nodes] = True
        between = inside[self.edges].all(axis=1)
        # a set around a corner has the edge across the corner as well: the boundary comes first
        for edges in (self.edges[between & self.boundary], self.edges[between]):
            times = np.bincount(edges.ravel(), minlength=len(self.rows))[nodes]
            if ((times >= 1) & (times <= 2)).all():
                return edges
        return "edges between its nodes branch, or do not join all of them"
