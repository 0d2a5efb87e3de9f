# SPDX-License-Identifier: LGPL-3.0-or-later
"""Families whose nodes are points of cells."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar, override

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.marker import Carrier, Marker, SurfaceMarker
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.runs import starts
from flexfem.layout.elements import one_width
from flexfem.layout.family import Family
from flexfem.layout.lines import Line
from flexfem.layout.numbered_model import NumberedModel
from flexfem.layout.surface_places import SurfacePlace, fitted_sides
from flexfem.lie import se3
from flexfem.mesh.distributed.nodes import distributed
from flexfem.mesh.distributed.partition import ordered_along
from flexfem.model.bodies.mesh_body import MeshBody
from flexfem.model.structure.place import Place

__all__ = ["MeshFamily", "PositionFamily"]


class PositionFamily[B: Any](Family):
    """Bodies with cells, whose nodes are numbered body after body; see ``layout.family.Family``.

    Attributes:
        first: (b + 1,) first node of each body; first_cell: (b + 1,) first cell.
    """

    axes = False

    name: ClassVar[str]
    serial: NumberedModel

    def __init__(self, serial: NumberedModel, kind: int) -> None:
        """Number the nodes body after body."""
        super().__init__(serial, kind)
        self._bodies: list[B] = list(self.members(serial.model))
        self.first = starts([len(body.points) for body in self._bodies])
        self.first_cell = starts([body.elements for body in self._bodies])
        self._place_nodes()

    def _place_nodes(self) -> None:
        """Set frames, velocities and fixed unknowns of all nodes at the start."""
        places = np.concatenate([body.points for body in self._bodies])
        self._frames = se3.frame(places, np.tile(np.eye(3), (len(places), 1, 1)))
        self._velocities = np.zeros((len(places), 6))
        self._velocities[:, :3] = np.concatenate([body.node_velocities for body in self._bodies])
        self._held: BoolArray = np.concatenate([body.held for body in self._bodies])

    @abstractmethod
    def cells_of(self, body: B) -> IntArray:
        """Nodes (m, k) of the cells of a body, numbers in the body."""

    @property
    @override
    def bodies(self) -> list[B]:
        return self._bodies

    @property
    @override
    def frames(self) -> FloatArray:
        return self._frames

    @property
    @override
    def velocities(self) -> FloatArray:
        return self._velocities

    @property
    @override
    def held(self) -> BoolArray:
        return self._held

    @property
    @override
    def body_of_node(self) -> IntArray:
        return np.repeat(np.arange(len(self._bodies)), np.diff(self.first))

    @override
    def bodies_of(self, nodes: IntArray) -> IntArray:
        return np.searchsorted(self.first, nodes, side="right") - 1

    @override
    def clusters_of(self, nodes: IntArray) -> IntArray:
        return self.bodies_of(nodes)

    @override
    def supports(self) -> tuple[IntArray, FloatArray]:
        nodes, axis = np.nonzero(self._held)
        return nodes, np.eye(6)[axis]

    def number(self, name: str) -> int:
        """Number of a body."""
        return [body.name for body in self._bodies].index(name)

    @override
    def node(self, marker: Marker, place: Place | None) -> int:
        assert place is not None
        assert place.node is not None
        return int(self.first[self.number(marker.body)]) + place.node

    @override
    def patches(self) -> IntArray:
        bodies = zip(self.first[:-1], self._bodies, strict=True)
        return one_width([first + self.cells_of(body) for first, body in bodies])

    @override
    def share(self, ranks: Mapping[str, IntArray]) -> tuple[IntArray, dict[str, tuple[int, ...]]]:
        cells = [self.in_order(body, np.sort(ranks[body.name])) for body in self._bodies]
        nodes = {body.name: tuple(np.unique(ranks[body.name]).tolist()) for body in self._bodies}
        return np.concatenate(cells), nodes

    def in_order(self, body: B, ranks: IntArray) -> IntArray:
        """Ranks (m,) of the cells of a body, which ascend along it."""
        own = np.empty_like(ranks)
        own[ordered_along(body.points, self.cells_of(body))] = ranks
        return own

    def own_nodes(self, comm: MPI.Intracomm, ranks: IntArray) -> tuple[FrameBlock, list[BoolArray]]:
        """Nodes of this rank, and the cells (m,) of each body that it has (collective).

        Args:
            comm: communicator.
            ranks: rank of each cell, of :meth:`share`.
        """
        owner = np.full(len(self._frames), np.iinfo(np.int64).max)
        own, touched = [], [np.empty(0, np.int64)]
        for k, body in enumerate(self._bodies):
            rank = ranks[self.first_cell[k] : self.first_cell[k + 1]]
            nodes = self.first[k] + self.cells_of(body)
            np.minimum.at(owner, nodes, np.broadcast_to(rank[:, np.newaxis], nodes.shape))
            own.append(rank == comm.rank)
            touched.append(nodes[own[-1]].ravel())
        ids, index_map = distributed(comm, owner, np.concatenate(touched))
        block = FrameBlock(
            self.name, comm, self._frames[ids], self._velocities[ids], ids, index_map,
            inertial=True, width=3, dirichlet=self._held[ids] if self._held.any() else None,
        )  # fmt: skip
        return block, own


class MeshFamily[B: MeshBody](PositionFamily[B]):
    """Cells of a family of such bodies, and places of markers on their nodes."""

    @override
    def cells_of(self, body: B) -> IntArray:
        return body.mesh.cells

    @override
    def surface_place(self, marker: Marker) -> SurfacePlace:
        number = self.number(marker.body)
        first = int(self.first[number])
        if isinstance(marker, SurfaceMarker):
            nodes = tuple(first + node for node in marker.nodes)
            return SurfacePlace(self.kind, nodes, marker.weights)
        return SurfacePlace(self.kind, (first + self._bodies[number].node(marker),), (1.0,))

    @override
    def with_axes(self, marker: Marker, place: SurfacePlace) -> SurfacePlace:
        number = self.number(marker.body)
        body, first = self._bodies[number], int(self.first[number])
        own = np.array(place.nodes) - first
        found = _cells_around(own, body) if len(own) <= 3 else np.empty(0, np.int64)
        if not len(found) and len(own) >= 3:
            try:
                sides = fitted_sides(body.mesh.points[own], np.array(place.weights))
            except ValueError as error:
                raise ValueError(
                    f'Marker on "{body.name}": {len(own)} nodes define no axes, {error}'
                ) from None
            return replace(place, sides=sides)
        if body.mesh.dimension == 1 or not len(found):
            raise ValueError(
                f'Marker on "{body.name}": a joint that needs axes takes those of a triangle, '
                f"which {'bars do not have' if body.mesh.dimension == 1 else 'it is not in'}"
            )
        corners = body.mesh.corners[found[0]]
        others = [node for node in corners.tolist() if node not in own]
        nodes = (*own.tolist(), *others)[:3]
        weights = (*place.weights, 0.0, 0.0)[:3]
        return SurfacePlace(self.kind, tuple(first + node for node in nodes), weights)

    @override
    def line(self, carrier: Carrier) -> Line:
        kind = type(self._bodies[self.number(carrier.body)]).__name__
        raise ValueError(f'Carrier on "{carrier.body}": a {kind} has no line')


def _cells_around(nodes: IntArray, body: MeshBody) -> IntArray:
    """Cells of a body that have all of some nodes among their corners, ascending."""
    member = np.isin(body.mesh.corners, nodes)
    return np.flatnonzero(member.sum(axis=1) == len(nodes))
