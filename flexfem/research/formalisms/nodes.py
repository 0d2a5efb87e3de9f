# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes of bodies, and where their nodes are among the coordinates of a mechanism."""

from mpi4py import MPI

import numpy as np

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._types import FloatArray, IntArray
from flexfem.research.formalisms.compiled import energies_of
from flexfem.research.formalisms.description.mechanism import EnergyBody

__all__ = ["BodyNodes"]

#: Distance of a point from its node, relative to the size of the body.
_NEAR = 1e-6


class BodyNodes:
    """A body's mesh and coordinates.

    Attributes:
        first: its first coordinate among those of the mechanism.
        size: number of nodes.
        mesh: the DOLFINx mesh.
        space: space of the elastic displacement.
        elastic: (nodes, components) coordinate of each elastic displacement, -1 where fixed.
        cells: (m, k) coordinates of each cell, elastic ones and those of the frame, -1 where fixed.
        points: (m, 3 corners) corners of each cell, m.
        x: (nodes, 3) local coordinates of the nodes, m.
    """

    def __init__(self, body: EnergyBody, first: int) -> None:
        """Make the mesh on this process alone and number its coordinates from ``first`` on.

        Raises:
            ValueError: the mesh does not fit the matter.
        """
        from dolfinx.fem import functionspace

        owner, matter = f'EnergyBody "{body.name}"', body.matter
        self.body, self.first, self._owner = body, first, owner
        self.mesh = body.mesh(MPI.COMM_SELF)
        cell, dimension = self.mesh.topology.cell_name(), self.mesh.geometry.dim
        energies = energies_of(matter, body.frame)
        wanted = energies.mesh.geometric_dimension
        if cell != matter.cell or dimension != wanted:
            raise InputError(
                f"{owner}: its mesh must have {matter.cell} cells in {wanted} dimensions, got "
                f"{cell} cells in {dimension}"
            )
        if self.mesh.geometry.cmaps[0].degree != 1:
            raise InputError(f"{owner}: its mesh must have straight cells")
        self.space = functionspace(self.mesh, energies.elastic_element)
        self.x = self.space.tabulate_dof_coordinates()
        held = body.holds(self.x)
        frame = np.arange(first, first + body.frame.count)
        self.elastic = np.full(held.shape, -1, dtype=np.int64)
        free = ~held
        self.elastic[free] = frame[-1] + 1 + np.arange(free.sum())
        self.size = len(frame) + int(free.sum())
        dofs = np.asarray(self.space.dofmap.list, dtype=np.int64)
        local = self.elastic[dofs].reshape(len(dofs), -1)
        self.cells: IntArray = np.hstack([local, np.tile(frame, (len(dofs), 1))])
        corners = self.mesh.geometry.dofmaps[0]
        self.points: FloatArray = self.mesh.geometry.x[corners].reshape(len(corners), -1).copy()

    def node(self, owner: str, point: tuple[float, ...]) -> int:
        """Number of the node at a point.

        Raises:
            InputError: there is none.
        """
        given = np.zeros(3)
        given[: len(point)] = _checks.array(owner, "point", point, (-1,))[:3]
        distance = np.linalg.norm(self.x - given, axis=1)
        nearest = int(np.argmin(distance))
        if distance[nearest] > _NEAR * np.ptp(self.x, axis=0).max():
            raise InputError(
                f"{owner}: {self._owner} has no node at {tuple(point)}, the nearest is at "
                f"{tuple(self.x[nearest].tolist())}"
            )
        return nearest

    def end(self, owner: str, point: tuple[float, ...] | None) -> tuple[IntArray, FloatArray]:
        """Coordinates of the frame and of a node, -1 where fixed, and the place of the node."""
        frame = np.arange(self.first, self.first + self.body.frame.count)
        if point is None:
            return frame, np.zeros(3)
        node = self.node(owner, point)
        return np.concatenate([frame, self.elastic[node]]), self.x[node]

    def corners(self) -> tuple[IntArray, IntArray]:
        """Nodes at the corners of cells, and the cells (m, corners) in numbers of these."""
        count = self.points.shape[1] // 3
        cells = np.asarray(self.space.dofmap.list)[:, :count]
        used, local = np.unique(cells, return_inverse=True)
        return used, local.reshape(cells.shape)

    def displacements(self, q: FloatArray) -> FloatArray:
        """Elastic displacements (nodes, components) in the frame."""
        extended = np.append(q, 0.0)  # fixed coordinates name the last entry
        return extended[self.elastic]

    def positions(self, q: FloatArray) -> FloatArray:
        """Positions (nodes, 3) in inertial axes."""
        translations = self.body.matter.components
        if self.body.matter.cell == "interval":
            translations = 3 if translations == 6 else 2
        local = self.x.copy()
        local[:, :translations] += self.displacements(q)[:, :translations]
        frame = self.body.frame
        g = q[self.first : self.first + frame.count]
        moved: FloatArray = frame.origin(g) + local @ frame.rotation_matrix(g).T
        return moved

    def position(self, point: tuple[float, ...] | None, q: FloatArray) -> FloatArray:
        """Position (3) of a node, or of the origin of the frame."""
        if point is None:
            frame = self.body.frame
            return frame.origin(q[self.first : self.first + frame.count])
        moved: FloatArray = self.positions(q)[self.node(self._owner, point)]
        return moved
