# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reduced elastic bodies in floating frames, each of them on one rank."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, override

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.inertia import inertia_about
from flexfem.core.joint import Joint
from flexfem.core.marker import Carrier, Marker
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.families.common.body_lines import floating_line
from flexfem.families.floating.elements import FloatingBodies, FloatingGroup
from flexfem.families.floating.nodes import FloatingNodes, body_data
from flexfem.families.floating.sensors import BodyElongation, BodyMissing
from flexfem.layout.elements import ElementFamily
from flexfem.layout.family import Family, Sensor
from flexfem.layout.lines import Line
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.mesh.distributed.nodes import distributed
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.model.model import Model
from flexfem.model.probes.base import AnyProbe
from flexfem.model.probes.measured import ElongationProbe, ReductionErrorProbe
from flexfem.model.structure.place import Place

if TYPE_CHECKING:
    from flexfem.system.system import BlockPart

__all__ = ["FloatingBodyFamily"]

#: Number of products of coordinates that cost as much as one beam element in a step, measured.
_PRODUCTS = 12


class FloatingBodyFamily(Family):
    """See :class:`flexfem.layout.family.Family`."""

    bodies_have_places = False
    noun = "floating body"
    series = "flexfem.io.paraview.family_series:FloatingSeries"

    serial: NumberedModel

    @classmethod
    def members(cls, model: Model) -> list[FloatingBody]:
        """Bodies of a model that belong to the family."""
        return model.floating_bodies

    def __init__(self, serial: NumberedModel, kind: int) -> None:
        """Lay out the bodies."""
        super().__init__(serial, kind)
        self.nodes = FloatingNodes(serial.model.floating_bodies)

    @property
    @override
    def bodies(self) -> list[FloatingBody]:
        return self.nodes.bodies

    @property
    @override
    def frames(self) -> FloatArray:
        return self.nodes.frames

    @property
    @override
    def velocities(self) -> FloatArray:
        return self.nodes.velocities

    @property
    @override
    def held(self) -> BoolArray:
        return self.nodes.held

    @property
    @override
    def placed(self) -> BoolArray:
        return ~self.nodes.held[:, 3]

    @property
    @override
    def body_of_node(self) -> IntArray:
        return self.nodes.body_of_node

    @override
    def joints(self) -> Sequence[Joint]:
        return self.nodes.locks

    @override
    def elements(self, body: FloatingBody) -> int:
        return 0

    @override
    def outline(self, body: FloatingBody) -> FloatArray:
        places = [one.position for one in body.reduced.interfaces] or [body.reduced.mass_centre]
        return body.position + np.array(places) @ body.rotation.T

    @override
    def inertia(self, body: FloatingBody, origin: FloatArray) -> FloatArray:
        frame = se3.frame(body.position, body.rotation)
        return inertia_about(origin, frame[np.newaxis], body.inertia_matrix)

    @override
    def patches(self) -> IntArray:
        first, count = self.nodes.first[:-1, np.newaxis], np.diff(self.nodes.first)[:, np.newaxis]
        numbers = np.arange(count.max())
        return np.where(numbers < count, first + numbers, -1)

    @override
    def node(self, marker: Marker, place: Place | None) -> int:
        assert place is not None
        assert place.node is not None
        return self._first(marker.body) + place.node

    def _first(self, name: str) -> int:
        """First node of a body."""
        return int(self.nodes.first[[body.name for body in self.bodies].index(name)])

    @override
    def line(self, carrier: Carrier) -> Line:
        body = self.serial.model[carrier.body]
        return floating_line(self.kind, self._first(carrier.body), body, carrier)

    @override
    def costs(self) -> dict[str, tuple[int, int]]:
        return {b.name: (1, max(b.reduced.size**2 // _PRODUCTS, 1)) for b in self.bodies}

    @override
    def block(self, comm: MPI.Intracomm, ranks: IntArray) -> tuple[FrameBlock, ElementFamily]:
        nodes = self.nodes
        none = np.empty(0, dtype=np.int64)
        ids, index_map = distributed(comm, ranks[nodes.body_of_node], none)
        block = FrameBlock(
            "floating_bodies", comm, nodes.frames[ids], nodes.velocities[ids], ids, index_map,
            inertial=True, dirichlet=nodes.held[ids] if nodes.held.any() else None,
            amplitudes=nodes.held[ids, 3],
        )  # fmt: skip
        groups = []
        for kind in nodes.kinds:
            own = [number for number in kind if ranks[number] == comm.rank]
            if own:
                body = nodes.bodies[kind[0]]
                every = nodes.first[own][:, np.newaxis] + np.arange(body.nodes)
                local = block.local_index(every).astype(np.int32)
                groups.append(
                    FloatingGroup(
                        body_data(body),
                        local,
                        np.array(own, dtype=np.int64),
                        body.reduced.polynomial,
                    )
                )
        return block, FloatingBodies(groups)

    @override
    def deflections(self, part: BlockPart) -> tuple[IntArray, FloatArray]:
        assert isinstance(part.elements, FloatingBodies)
        return part.elements.body, part.elements.deflections(part.block.frames)

    @override
    def missing(self, part: BlockPart) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
        assert isinstance(part.elements, FloatingBodies)
        bodies = part.elements
        if all(group.polynomial is None for group in bodies.groups):
            return super().missing(part)
        return bodies.body, *bodies.missing(part.block)

    @override
    def sensor(self, probe: AnyProbe, part: BlockPart) -> Sensor | None:
        if isinstance(probe, ElongationProbe) and self.serial.model[probe.body] in self.bodies:
            return BodyElongation(part, self.bodies, probe)
        if isinstance(probe, ReductionErrorProbe):
            return BodyMissing(part, self.bodies, probe)
        return None
