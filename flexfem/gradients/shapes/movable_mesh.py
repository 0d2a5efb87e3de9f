# SPDX-License-Identifier: LGPL-3.0-or-later
"""A mesh whose shape is a smooth function of numbers: some nodes are moved, others follow.

Mesh generators place inner nodes anew when a size changes, and results jump. Here the cells stay,
and the places of all nodes are linear in the displacements of those that are moved: each other one
has the mean displacement of those around it, weighted by one over the square of their distances
(a discrete Laplace equation). Weights are positive, so that no node moves farther than those that
are moved do, and small cells keep their shapes where large ones between them and what is held can
change.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array, eye_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from flexfem import _checks
from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.families.solid.meshes.lagrange import reference_points, shapes
from flexfem.families.solid.meshes.mesh import SolidMesh
from flexfem.mesh.line_mesh import LineMesh
from flexfem.mesh.surface_mesh import SurfaceMesh

__all__ = ["MovableMesh"]

_OWNER = "MovableMesh"


class MovableMesh:
    """A mesh whose nodes follow those of some groups that are moved, with the same cells.

    Profiles and thicknesses of a mesh of gmsh become numbers that have derivatives::

        block = ff.MovableMesh(mesh, moving="notch", held="ends")

        def build(depths):
            mesh = block.moved(lambda x: np.outer(profile(x[:, 0], depths), (0.0, 1.0, 0.0)))

    Nodes of cells of higher degree that are not moved stay in the middle between corners, so that
    straight edges inside remain straight. Components do not mix: with displacements along y all
    nodes move along y.

    Attributes:
        mesh: as it was given.
        nodes: Nodes that are moved, ascending, shape (k,).
        places: Where they are in it, shape (k, 3), metres.
    """

    mesh: SolidMesh | SurfaceMesh | LineMesh
    nodes: IntArray
    places: FloatArray

    def __init__(
        self, mesh: SolidMesh | SurfaceMesh | LineMesh, moving: str | Sequence[str],
        held: str | Sequence[str] = (),
    ) -> None:  # fmt: skip
        """Create it.

        Args:
            mesh: A :class:`SolidMesh`, :class:`SurfaceMesh` or :class:`LineMesh`.
            moving: Names of surfaces, lines, points or sets whose nodes are moved.
            held: Names of those whose nodes stay where they are, unless they are moved.

        Raises:
            TypeError: The mesh is none of these.
            ValueError: There is no such name.
        """
        _checks.instance(_OWNER, "mesh", mesh, (SolidMesh, SurfaceMesh, LineMesh))
        self.mesh = mesh
        self.nodes = _named(mesh, moving)
        if not len(self.nodes):
            raise ValueError("MovableMesh: moving must name something to be moved, got none")
        self.places = mesh.points[self.nodes]
        count = len(mesh.points)
        known = np.zeros(count, dtype=np.bool_)
        known[_named(mesh, held)], known[self.nodes] = True, True
        self._free, self._solve = _following(mesh, known)

    def moved(
        self, displacements: Callable[[FloatArray], npt.ArrayLike] | npt.ArrayLike
    ) -> SolidMesh | SurfaceMesh | LineMesh:
        """Return the mesh with other places of its nodes.

        Args:
            displacements: Of the moved nodes, shape (k, 3), metres; or a function of their places.

        Raises:
            TypeError: They are no numbers.
            ValueError: Another shape, or cells that are inside out or without volume.
        """
        given = displacements(self.places) if callable(displacements) else displacements
        by = np.zeros(self.mesh.points.shape)
        by[self.nodes] = _checks.array(_OWNER, "displacements", given, self.places.shape)
        by[self._free] = self._solve(by)
        self._spread(by)
        return self.mesh.moved(self.mesh.points + by)

    def _spread(self, by: FloatArray) -> None:
        """Put nodes that are neither corners nor moved into the middle, in place."""
        mesh = self.mesh
        if not isinstance(mesh, SolidMesh) or mesh.degree == 1:
            return
        weights = shapes(mesh.cell, 1, reference_points(mesh.cell, mesh.degree))[0]
        placed = np.zeros(len(by), dtype=np.bool_)
        placed[mesh.corners], placed[self.nodes] = True, True
        every = np.einsum("kc,mca->mka", weights, by[mesh.corners])
        rest = ~placed[mesh.cells]
        by[mesh.cells[rest]] = every[rest]


def _named(mesh: SolidMesh | SurfaceMesh | LineMesh, names: str | Sequence[str]) -> IntArray:
    """Nodes, ascending, of some names."""
    chosen = [names] if isinstance(names, str) else list(names)
    found = [mesh.named_nodes(_OWNER, name) for name in chosen]
    return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *found]))


def _following(
    mesh: SolidMesh | SurfaceMesh | LineMesh, known: BoolArray
) -> tuple[IntArray, Callable[[FloatArray], FloatArray]]:
    """Corners that follow those that are known, and their displacements (f, 3) by those of all.

    Corners that nothing joins to a known one stay where they are.
    """
    cells = _corners(mesh)
    first, second = (cells[:, list(one)].ravel() for one in _pairs(cells.shape[1]))
    lengths = np.linalg.norm(mesh.points[first] - mesh.points[second], axis=1)
    count = len(known)
    graph = csr_array((1.0 / lengths**2, (first, second)), shape=(count, count))
    graph = csr_array(graph.maximum(graph.T))  # one edge, whatever the number of its cells
    _, part = connected_components(graph, directed=False)
    corner = np.zeros(count, dtype=np.bool_)
    corner[cells] = True
    free = np.flatnonzero(corner & ~known & np.isin(part, part[known]))
    if not len(free):
        return free, lambda by: by[free]
    sums = np.asarray(graph.sum(axis=1)).ravel()
    scaled = csr_array(graph[free] / sums[free, np.newaxis])
    solver = splu((eye_array(len(free)) - scaled[:, free]).tocsc())
    return free, lambda by: solver.solve(scaled @ np.where(known[:, np.newaxis], by, 0.0))


def _corners(mesh: SolidMesh | SurfaceMesh | LineMesh) -> IntArray:
    """Corners (m, c) of the cells."""
    if isinstance(mesh, SolidMesh):
        return mesh.corners
    return mesh.triangles if isinstance(mesh, SurfaceMesh) else mesh.cells


def _pairs(count: int) -> tuple[IntArray, IntArray]:
    """All pairs of the corners of a cell."""
    found: tuple[IntArray, IntArray] = np.triu_indices(count, 1)
    return found
