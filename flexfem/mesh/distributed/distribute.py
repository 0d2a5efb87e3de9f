# SPDX-License-Identifier: LGPL-3.0-or-later
"""DOLFINx meshes whose cells are on given ranks (collective)."""

from typing import Any

from mpi4py import MPI

import basix.ufl
import numpy as np

from flexfem._types import FloatArray, IndexArray, IntArray

__all__ = ["distributed_mesh"]


def distributed_mesh(
    comm: MPI.Intracomm,
    cell: str,
    points: FloatArray,
    cells: IndexArray,
    ranks: IntArray,
    offsets: IntArray,
    facet_cells: int,
) -> tuple[Any, Any, IntArray]:
    """Create a mesh of simplices and number its nodes (collective).

    Args:
        comm: Communicator.
        cell: "interval" or "triangle".
        points: All points, the same on every rank, shape (n, 3), metres; each is used by a cell.
        cells: Nodes of all cells, the same on every rank, shape (m, k).
        ranks: Owner of each cell, followed by the ranks where it is a ghost, cell after cell.
        offsets: Start of each cell in `ranks`, shape (m + 1,).
        facet_cells: Largest number of cells at one facet.

    Returns:
        The mesh, its space of continuous linear functions, whose degrees of freedom number the
        nodes, and the index of each local node in the input, owned nodes first.
    """
    import dolfinx

    def share(count: int) -> slice:
        return slice(count * comm.rank // comm.size, count * (comm.rank + 1) // comm.size)

    mine = share(len(cells))

    def partitioner(comm: Any, parts: int, cell_types: Any, topology: Any) -> Any:
        first, last = offsets[mine.start], offsets[mine.stop]
        links = ranks[first:last].astype(np.int32)
        starts = (offsets[mine.start : mine.stop + 1] - first).astype(np.int32)
        return dolfinx.graph.adjacencylist(links, starts)._cpp_object

    # its type stub lacks the base class of the elements
    element: Any = basix.ufl.element("Lagrange", cell, 1, shape=(3,))
    mesh = dolfinx.mesh.create_mesh(
        comm, cells[mine].astype(np.int64), element, points[share(len(points))], partitioner,
        max_facet_to_cell_links=max(2, facet_cells),
    )  # fmt: skip
    space = dolfinx.fem.functionspace(mesh, ("Lagrange", 1))
    index_map = space.dofmap.index_map
    nodes = np.empty(index_map.size_local + index_map.num_ghosts, dtype=np.int64)
    # geometry and function nodes are numbered apart
    nodes[space.dofmap.list] = mesh.geometry.input_global_indices[mesh.geometry.dofmaps[0]]
    return mesh, space, nodes
