# SPDX-License-Identifier: LGPL-3.0-or-later
"""The surface of a body, its displacement and stress by each coordinate."""

from typing import Any

import basix
import numpy as np
import ufl
from dolfinx import fem, mesh

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.kernels.ffcx_options import compile_options
from flexfem.reduction.fem.body.blocks import set_rows
from flexfem.reduction.fem.body.linear_body import LinearBody
from flexfem.reduction.law_expansion import VOIGT, moduli
from flexfem.reduction.reduced_body import Recovery

__all__ = ["recover"]


def recover(body: LinearBody, functions: FloatArray, nonlinear: bool = False) -> Recovery:
    """This rank's part of the surface, or of the lines of a body of lines (collective).

    Args:
        body: the body.
        functions: this rank's rows of the displacement functions (rows, n).
        nonlinear: gradients of a body with an energy, in the place of stresses.
    """
    cells, corners = _faces(body.space.mesh)
    numbers, own = np.unique(cells, return_inverse=True)
    used = numbers.astype(np.int32)
    reference = basix.cell.geometry(_cell_type(body.space.mesh))
    points, vertex_of = _points(body.space.mesh, used, len(reference))
    n = functions.shape[1]
    state = fem.Function(body.space)
    assert body.displacement is not None
    how = compile_options(body.space.mesh.comm)
    displacement = fem.Expression(body.displacement(state), reference, **how)
    stress, size = None, 9 if nonlinear else 6
    if nonlinear:
        stress = fem.Expression(ufl.grad(state), reference, **how)
    elif body.stress is not None:
        tensor = body.stress(state)
        vector = ufl.as_vector([tensor[i, j] for i, j in VOIGT])
        stress = fem.Expression(vector, reference, **how)
    moves = np.zeros((len(points), 3, n))
    stresses = np.zeros((len(cells), size, n))
    for j in range(n):
        set_rows(state, functions[:, j])
        if not len(used):
            continue
        values = displacement.eval(body.space.mesh, used).reshape(len(used), len(reference), 3)
        moves[vertex_of, :, j] = values
        if stress is not None:
            values = stress.eval(body.space.mesh, used).reshape(len(used), len(reference), size)
            stresses[:, :, j] = values[own[:, np.newaxis], corners].mean(axis=1)
    faces = vertex_of[own[:, np.newaxis], corners]
    found = stresses if stress is not None else None
    if not nonlinear:
        return _recovery(points, faces, moves, found)
    assert body.energy is not None
    return _recovery(points, faces, moves, None, found, moduli(body.energy.derivatives))


def _recovery(
    points: FloatArray, faces: IntArray, moves: FloatArray, *stress: FloatArray | None
) -> Recovery:
    """Only the points that faces have."""
    used, cells = np.unique(faces, return_inverse=True)
    return Recovery(points[used], cells.reshape(faces.shape), moves[used], *stress)


def _cell_type(domain: mesh.Mesh) -> Any:
    return getattr(basix.CellType, domain.topology.cell_type.name)


def _points(domain: mesh.Mesh, cells: IndexArray, corners: int) -> tuple[FloatArray, IntArray]:
    """Vertices of some cells and, for each corner of these, its number among them."""
    topology = domain.topology
    topology.create_connectivity(0, topology.dim)
    to_vertex = topology.connectivity(topology.dim, 0).array.reshape(-1, corners)[cells]
    vertices, numbers = np.unique(to_vertex, return_inverse=True)
    x = np.zeros((0, 3))
    if len(vertices):
        geometry = mesh.entities_to_geometry(domain, 0, vertices.astype(np.int32))
        x = domain.geometry.x[geometry.ravel()]
    return x, numbers.reshape(to_vertex.shape)


def _faces(domain: mesh.Mesh) -> tuple[IntArray, IntArray]:
    """Triangles or lines: the cell of each and which of its corners they join."""
    topology, kind = domain.topology, _cell_type(domain)
    dimension = topology.dim
    if dimension < 3:
        own = np.arange(topology.index_map(dimension).size_local, dtype=np.int32)
        whole = [[0, 1]] if dimension == 1 else _triangles(basix.topology(kind)[2][0])
        return np.repeat(own, len(whole)), np.tile(np.array(whole), (len(own), 1))
    topology.create_connectivity(2, 3)
    topology.create_connectivity(3, 2)
    outer = mesh.exterior_facet_indices(topology)
    to_cell, to_facet = topology.connectivity(2, 3), topology.connectivity(3, 2)
    cells, corners = [], []
    for facet in outer:
        cell = to_cell.links(facet)[0]
        place = int(np.flatnonzero(to_facet.links(cell) == facet)[0])
        for triangle in _triangles(basix.topology(kind)[2][place]):
            cells.append(cell)
            corners.append(triangle)
    return np.array(cells, dtype=np.int32), np.array(corners, dtype=np.int64).reshape(-1, 3)


def _triangles(corners: list[int]) -> list[list[int]]:
    """A face in triangles; the corners of four go row by row."""
    if len(corners) == 3:
        return [list(corners)]
    a, b, c, d = corners
    return [[a, b, d], [a, d, c]]
