# SPDX-License-Identifier: LGPL-3.0-or-later
"""A body of a mesh file on all ranks: DOLFINx mesh and tags (collective)."""

from typing import Any

from mpi4py import MPI

import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx import graph, mesh
from dolfinx.io.utils import cell_perm_vtk, distribute_entity_data

from flexfem._types import IntArray
from flexfem.mesh.imported.body import BodyData
from flexfem.mesh.imported.mesh_file import KINDS

__all__ = ["distribute"]

# Cell and degree of the coordinates
_CELLS = {
    "triangle": (mesh.CellType.triangle, 1),
    "triangle6": (mesh.CellType.triangle, 2),
    "quad": (mesh.CellType.quadrilateral, 1),
    "quad9": (mesh.CellType.quadrilateral, 2),
    "tetra": (mesh.CellType.tetrahedron, 1),
    "tetra10": (mesh.CellType.tetrahedron, 2),
    "hexahedron": (mesh.CellType.hexahedron, 1),
    "hexahedron27": (mesh.CellType.hexahedron, 2),
}


def distribute(
    comm: MPI.Intracomm, data: BodyData | None
) -> tuple[mesh.Mesh, mesh.MeshTags, mesh.MeshTags | None, dict[str, tuple[int, int]]]:
    """Create the mesh of data that the first rank has (collective).

    Returns:
        Mesh, tags of cells, tags of facets (None if there are none), dimension and tag by name.
    """
    kind, groups, width = comm.bcast(
        None if data is None else (data.kind, data.groups, data.facets.shape[1])
    )
    cell, degree = _CELLS[kind]
    # its type stub lacks the base class of the elements
    element: Any = basix.ufl.element("Lagrange", cell.name, degree, shape=(3,))
    count = KINDS[kind].nodes
    cells = np.empty((0, count), dtype=np.int64)
    points = np.empty((0, 3))
    if data is not None:
        cells = np.ascontiguousarray(data.cells[:, cell_perm_vtk(cell, count)])
        points = data.points
    domain = mesh.create_mesh(comm, cells, element, points)
    values = comm.bcast(None if data is None else data.values)
    own = np.asarray(values)[domain.topology.original_cell_index].astype(np.int32)
    dimension = domain.topology.dim
    tags = mesh.meshtags(domain, dimension, np.arange(len(own), dtype=np.int32), own)
    tags.name = "cell_tags"
    if all(dim == dimension for dim, _ in groups.values()):
        return domain, tags, None, groups
    facets, marks = np.empty((0, width), dtype=np.int64), np.empty(0, dtype=np.int32)
    if data is not None:
        facets, marks = data.facets, data.facet_values.astype(np.int32)
    return domain, tags, _facet_tags(domain, facets, marks, degree), groups


def _facet_tags(
    domain: mesh.Mesh, corners: IntArray, marks: npt.NDArray[np.int32], degree: int
) -> mesh.MeshTags:
    """Tag facets that are given by their corners on the first rank (collective)."""
    dimension = domain.topology.dim - 1
    if degree > 1:
        # all nodes of a facet are expected, of which the corners alone matter
        layout = domain.geometry.cmaps[0].create_dof_layout()
        further = len(layout.entity_closure_dofs(dimension, 0)) - corners.shape[1]
        corners = np.column_stack([corners, *[corners[:, :1]] * further])
    entities, values = distribute_entity_data(
        domain, dimension, np.ascontiguousarray(corners), marks
    )
    domain.topology.create_connectivity(dimension, domain.topology.dim)
    tags = mesh.meshtags_from_entities(
        domain, dimension, graph.adjacencylist(entities), values.astype(np.int32, copy=False)
    )
    tags.name = "facet_tags"
    return tags
