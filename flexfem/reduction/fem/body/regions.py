# SPDX-License-Identifier: LGPL-3.0-or-later
"""Regions of a mesh that frames are tied to."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem, mesh

from flexfem import _checks
from flexfem._types import FloatArray, IntArray
from flexfem.reduction.fem.body.blocks import total

__all__ = ["Region", "find_region"]


@dataclass(frozen=True, eq=False)
class Region:
    """Entities of a mesh.

    Attributes:
        dimension: of the entities: facets, or vertices for a point.
        entities: this rank's, with those that it shares.
        centroid: (3,) of all of them, weighted by their measure, m.
    """

    dimension: int
    entities: npt.NDArray[np.int32]
    centroid: FloatArray

    def rows(self, space: fem.FunctionSpace, owned: int) -> IntArray:
        """This rank's rows of a space on the region (collective)."""
        space.mesh.topology.create_connectivity(self.dimension, space.mesh.topology.dim)
        width = space.dofmap.index_map_bs
        nodes = fem.locate_dofs_topological(space, self.dimension, self.entities)
        rows = (width * nodes[:, np.newaxis] + np.arange(width)).ravel()
        mine: IntArray = rows[rows < owned].astype(np.int64)
        return mine


def find_region(owner: str, domain: mesh.Mesh, where: Any) -> Region:
    """Find the facets or the vertex of a region (collective).

    Args:
        owner: for messages.
        domain: the mesh; facets are faces of solids, edges of surfaces, vertices of lines.
        where: (facet tags, tag) with the MeshTags of facets; a function of points (3, q) that is
            True on the region (facets with all vertices there); or a point (3,), which means the
            nearest vertex.

    Raises:
        TypeError: `where` is none of these.
        ValueError: nothing is there.
    """
    topology = domain.topology
    dimension = topology.dim - 1
    if isinstance(where, (tuple, list)) and len(where) == 2:
        tags, tag = where
        _checks.instance(owner, "tags", tags, mesh.MeshTags)
        if tags.dim != dimension:
            raise ValueError(
                f"{owner}: tags must be of facets (dimension {dimension}), got dimension {tags.dim}"
            )
        entities, what = tags.find(tag), f"the tag {tag}"
    elif callable(where):
        topology.create_entities(dimension)
        entities = mesh.locate_entities(domain, dimension, _marker(owner, where))
        what = "the points that the function returns"
    else:
        try:
            point = _checks.vector(owner, "point", where)
        except (TypeError, ValueError):
            raise TypeError(
                f"{owner}: a region must be (tags, tag), a function of points, or a point, got "
                f"{_checks.show(where)}"
            ) from None
        dimension, entities, what = 0, _nearest_vertex(domain, point), "the point"
    entities = np.unique(np.asarray(entities, dtype=np.int32))
    topology.create_entities(dimension)
    centroid = _centroid(domain, dimension, entities)
    if centroid is None:
        raise ValueError(f"{owner}: the mesh has no facets at {what}")
    return Region(dimension, entities, centroid)


def _marker(owner: str, where: Callable[[FloatArray], Any]) -> Callable[[FloatArray], Any]:
    """The function, its answers checked."""

    def marker(points: FloatArray) -> Any:
        answer = np.asarray(where(points))
        if answer.dtype != np.bool_ or answer.shape != (points.shape[1],):
            raise ValueError(
                f"{owner}: the function must give a truth value for each of (3, q) points, got "
                f"{_checks.show(answer)}"
            )
        return answer

    # all ranks find a wrong answer, also those without a part of the mesh
    marker(np.zeros((3, 2)))
    return marker


def _nearest_vertex(domain: mesh.Mesh, point: FloatArray) -> IntArray:
    """The vertex, on every rank that has it."""
    topology = domain.topology
    topology.create_connectivity(0, topology.dim)
    count = topology.index_map(0).size_local + topology.index_map(0).num_ghosts
    vertices = np.arange(count, dtype=np.int32)
    if count:
        x = domain.geometry.x[mesh.entities_to_geometry(domain, 0, vertices).ravel()]
    else:
        x = np.zeros((0, 3))
    away = np.linalg.norm(x - point, axis=1)
    best = int(np.argmin(away)) if count else -1
    found = domain.comm.allgather((float(away[best]), tuple(x[best])) if count else (np.inf, ()))
    place = np.array(min(found)[1])
    here: IntArray = vertices[
        np.linalg.norm(x - place, axis=1) <= 1e-12 * (1.0 + np.abs(place).max())
    ]
    return here


def _centroid(domain: mesh.Mesh, dimension: int, entities: IntArray) -> FloatArray | None:
    """Mean place of this rank's own entities and those of the others."""
    own = entities[entities < domain.topology.index_map(dimension).size_local]
    sums = np.zeros(4)
    if len(own):
        domain.topology.create_connectivity(dimension, domain.topology.dim)
        x = domain.geometry.x[mesh.entities_to_geometry(domain, dimension, own)]
        weights = _measures(x, dimension)
        sums[0] = weights.sum()
        sums[1:] = weights @ x.mean(axis=1)
    comm: MPI.Intracomm = domain.comm
    sums = total(comm, sums)
    return sums[1:] / sums[0] if sums[0] > 0.0 else None


def _measures(x: FloatArray, dimension: int) -> FloatArray:
    """Areas, lengths, or ones of entities with the given vertices (n, corners, 3)."""
    if dimension == 0:
        return np.ones(len(x))
    if dimension == 1:
        lengths: FloatArray = np.linalg.norm(x[:, 1] - x[:, 0], axis=1)
        return lengths
    # the last corner of a quadrilateral is opposite the first
    diagonal = x[:, 2] - x[:, 1]
    areas = [np.cross(x[:, 1] - x[:, corner], diagonal) for corner in {0, x.shape[1] - 1} - {2}]
    size: FloatArray = sum((np.linalg.norm(area, axis=1) for area in areas), np.zeros(len(x)))
    return 0.5 * size
