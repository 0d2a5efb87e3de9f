# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes of beam sections: triangles or quadrilaterals in named parts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Self

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from flexfem import _checks
from flexfem._types import FloatArray, IntArray
from flexfem.mesh.surface_mesh import SurfaceMesh

__all__ = ["SectionMesh"]

# Area of a cell, or height of a node over the plane, relative to its size, that counts as none
_FLAT = 1e-10


@dataclass(frozen=True, eq=False, init=False)
class SectionMesh:
    """Cells of a section, each in exactly one part.

    Attributes:
        points: Nodes (y, z) along e2 and e3, shape (n, 2), metres.
        cells: Nodes of triangles or quadrilaterals, counterclockwise, shape (m, 3) or (m, 4).
        parts: Cells, ascending, by the part's name.
    """

    points: FloatArray
    cells: IntArray
    parts: Mapping[str, IntArray]

    def __init__(
        self,
        points: npt.ArrayLike,
        cells: npt.ArrayLike,
        parts: Mapping[str, npt.ArrayLike] | None = None,
    ) -> None:
        """Create a mesh.

        Args:
            points: Nodes (y, z), shape (n, 2), metres.
            cells: Triangles of shape (m, 3) or quadrilaterals of shape (m, 4), nodes in the order
                around the cell.
            parts: Cells of each part; one part "section" when None.

        Raises:
            TypeError: An argument does not consist of numbers of the right kind.
            ValueError: A wrong shape, an index out of range, a cell without area or not convex, a
                node without cell, a cell in no or two parts, cells that overlap at an edge, or
                parts that no edge joins.
        """
        yz = _checks.array("SectionMesh", "points", points, (-1, 2))
        width = np.shape(cells)[-1] if np.ndim(cells) == 2 else 3
        rows = _checks.indices("SectionMesh", "cells", cells, len(yz), 4 if width == 4 else 3)
        if len(rows) == 0:
            raise ValueError("SectionMesh: cells must hold at least one cell, got none")
        rows = _counterclockwise(yz, rows)
        free = np.setdiff1d(np.arange(len(yz)), rows)
        if len(free):
            raise ValueError(f"SectionMesh: node {free[0]} belongs to no cell")
        _check_joined(rows, len(yz))
        found = {"section": np.arange(len(rows))} if parts is None else parts
        groups = MappingProxyType(_parts(found, len(rows)))
        _checks.assign(self, points=yz, cells=_checks.freeze(rows, np.int64), parts=groups)

    @classmethod
    def of_surface(cls, mesh: SurfaceMesh) -> Self:
        """Create the mesh of a section from triangles in the plane x3 = 0, e2 along x1.

        Its bodies are the parts; they must share the nodes between them. Meshes of gmsh and other
        programs are read by `read_surface_mesh`.

        Raises:
            TypeError: The argument is no SurfaceMesh.
            ValueError: A node is not in the plane, or as for the class itself.
        """
        _checks.instance("SectionMesh", "mesh", mesh, SurfaceMesh)
        high = np.abs(mesh.points[:, 2])
        if high.max() > _FLAT * np.ptp(mesh.points[:, :2]):
            worst = int(high.argmax())
            raise ValueError(
                f"SectionMesh: nodes must be in the plane x3 = 0, but node {worst} has "
                f"x3 = {mesh.points[worst, 2]:g}"
            )
        return cls(mesh.points[:, :2], mesh.triangles, mesh.bodies)

    @classmethod
    def of_outlines(
        cls,
        outline: npt.ArrayLike,
        holes: Sequence[npt.ArrayLike] = (),
        *,
        size: float,
        name: str = "section",
    ) -> Self:
        """Create triangles within a polygon with holes, by gmsh.

        Args:
            outline: Vertices (y, z), the last one joined to the first, shape (k, 2), metres.
            holes: Vertices of each hole.
            size: Length of the cells' edges, metres.
            name: Of the one part.

        Raises:
            TypeError: An argument does not consist of numbers.
            ValueError: Fewer than three vertices, sides that cross, a size that is not positive,
                or outlines that gmsh cannot fill.
        """
        from flexfem.sections.triangulation import triangulate

        _checks.number("SectionMesh", "size", size, positive=True)
        loops = [_loop("outline", outline), *(_loop("hole", hole) for hole in holes)]
        _check_apart(loops)
        points, triangles = triangulate(loops, size)
        return cls(points, triangles, {name: np.arange(len(triangles))})

    @property
    def areas(self) -> FloatArray:
        """Areas of the cells, shape (m,), m^2."""
        corners = self.points[self.cells]
        after = np.roll(corners, -1, axis=1)
        return 0.5 * _cross(corners, after).sum(axis=1)

    @property
    def centres(self) -> FloatArray:
        """Means (y, z) of the nodes of the cells, shape (m, 2), metres."""
        return self.points[self.cells].mean(axis=1)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    result: FloatArray = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return result


def _loop(what: str, vertices: npt.ArrayLike) -> FloatArray:
    """Return the vertices of a polygon."""
    points = _checks.array("SectionMesh", what, vertices, (-1, 2))
    if len(points) < 3:
        raise ValueError(
            f"SectionMesh: {what} must have at least three vertices, got {len(points)}"
        )
    repeated = (np.roll(points, -1, axis=0) == points).all(axis=1)
    if repeated.any():
        raise ValueError(
            f"SectionMesh: {what} must not name a vertex twice in a row, got "
            f"{points[int(repeated.argmax())].tolist()}"
        )
    return points


def _check_apart(loops: Sequence[FloatArray]) -> None:
    """Refuse sides that meet, and holes outside the outline or in one another."""
    starts = np.vstack(loops)
    ends = np.vstack([np.roll(loop, -1, axis=0) for loop in loops])
    along = (ends - starts)[:, None]
    side = np.sign(_cross(along, starts - starts[:, None]))
    other = np.sign(_cross(along, ends - starts[:, None]))
    apart = side * other < 0.0
    crossing = np.argwhere(apart & apart.T)
    if len(crossing):
        i, j = crossing[0].tolist()
        raise ValueError(
            f"SectionMesh: sides of outline and holes must not cross, but those from "
            f"{starts[i].tolist()} and {starts[j].tolist()} do"
        )
    for i, hole in enumerate(loops[1:], 1):
        within = [_inside(hole[0], loop) for j, loop in enumerate(loops) if j != i]
        if within != [True] + [False] * (len(loops) - 2):
            raise ValueError(
                f"SectionMesh: holes must lie within the outline and apart, but hole {i} does not"
            )


def _inside(point: FloatArray, loop: FloatArray) -> bool:
    """Return True if a point is within a polygon, by the sides that a ray crosses."""
    start, end = loop - point, np.roll(loop, -1, axis=0) - point
    passing = (start[:, 1] > 0.0) != (end[:, 1] > 0.0)
    right = _cross(start, end) * np.sign(end[:, 1] - start[:, 1]) > 0.0
    return bool((passing & right).sum() % 2)


def _counterclockwise(points: FloatArray, rows: IntArray) -> IntArray:
    """Return the cells in counterclockwise order; refuse those without area or not convex."""
    corners = points[rows]
    sides = np.roll(corners, -1, axis=1) - corners
    turns = _cross(sides, np.roll(sides, -1, axis=1))  # twice the area of each corner's triangle
    size = (sides**2).sum(axis=2).max(axis=1)
    sign = np.sign(turns.sum(axis=1))
    bad = (turns * sign[:, None]).min(axis=1) <= _FLAT * size
    if bad.any():
        cell = int(bad.argmax())
        raise ValueError(
            f"SectionMesh: cell {cell} with nodes {rows[cell].tolist()} must be convex and have "
            "an area"
        )
    return np.where(sign[:, None] > 0.0, rows, np.roll(rows[:, ::-1], 1, axis=1))


def _check_joined(rows: IntArray, nodes: int) -> None:
    """Refuse cells that overlap at an edge, and parts that no edge joins."""
    first, second = rows.ravel(), np.roll(rows, -1, axis=1).ravel()
    directed = first * nodes + second
    values, counts = np.unique(directed, return_counts=True)
    if counts.max() > 1:
        a, b = divmod(int(values[counts.argmax()]), nodes)
        raise ValueError(f"SectionMesh: cells overlap at the edge of nodes {a} and {b}")
    owner = np.repeat(np.arange(len(rows)), rows.shape[1])
    keys = np.minimum(first, second) * nodes + np.maximum(first, second)
    order = np.argsort(keys, kind="stable")
    keys, owner = keys[order], owner[order]
    pair = np.flatnonzero(keys[1:] == keys[:-1])
    graph = coo_array((np.ones(len(pair)), (owner[pair], owner[pair + 1])), shape=(len(rows),) * 2)
    count, label = connected_components(graph, directed=False)
    if count > 1:
        raise ValueError(
            f"SectionMesh: cells must be joined by edges, but {count} pieces are apart, one with "
            f"node {rows[label > 0][0, 0]}"
        )


def _parts(parts: Mapping[str, npt.ArrayLike], cells: int) -> dict[str, IntArray]:
    """Return the cells of each part, checked to be in one part each."""
    taken = np.zeros(cells, dtype=int)
    result = {}
    for name, found in parts.items():
        owner = f'SectionMesh: part "{_checks.text("SectionMesh", "name", name)}"'
        rows = _checks.indices(owner, "cells", found, cells, 1)
        if len(rows) == 0:
            raise ValueError(f"{owner} has no cells")
        result[name] = _checks.freeze(np.sort(rows), np.int64)
        np.add.at(taken, rows, 1)
    if (taken != 1).any():
        cell = int((taken != 1).argmax())
        raise ValueError(f"SectionMesh: cell {cell} must be in one part, is in {taken[cell]}")
    return result
