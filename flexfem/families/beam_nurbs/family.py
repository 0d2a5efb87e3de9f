# SPDX-License-Identifier: LGPL-3.0-or-later
"""Beams along NURBS curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from typing import TYPE_CHECKING, Any, override

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.marker import Carrier, Marker
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.families.beam_nurbs.along import whole_arcs
from flexfem.families.beam_nurbs.curves import NurbsLines
from flexfem.families.beam_nurbs.elements import NurbsBeams, NurbsCells
from flexfem.families.beam_nurbs.loads import nurbs_line_forces, nurbs_node_forces
from flexfem.families.beam_nurbs.masses import ElementMasses
from flexfem.families.beam_nurbs.sensors import CurveStrainSensor
from flexfem.families.common.beam_family import BeamFamily
from flexfem.layout.elements import ElementFamily, one_width
from flexfem.layout.family import ContactLine, Sensor
from flexfem.layout.inner_forces import InnerForces
from flexfem.layout.line_loads import by_kind
from flexfem.layout.lines import Line
from flexfem.layout.mesh_facts import MeshFacts, beam_facts
from flexfem.layout.node_loads import Force
from flexfem.layout.numbered_model import NumberedModel
from flexfem.materials.section import Section
from flexfem.materials.section_wall import SectionWall
from flexfem.mesh.distributed.nodes import distributed
from flexfem.mesh.nurbs.polyline import polyline
from flexfem.model.bodies.basic import Beam
from flexfem.model.probes.base import AnyProbe
from flexfem.model.probes.measured import StrainProbe
from flexfem.model.structure.place import Place

if TYPE_CHECKING:
    from flexfem.system.system import BlockPart

__all__ = ["NurbsBeamFamily"]


class NurbsBeamFamily(BeamFamily):
    """See :class:`flexfem.layout.family.Family`."""

    formulation = "nurbs"

    def __init__(self, serial: NumberedModel, kind: int) -> None:
        """Lay out the beams."""
        self.curves = NurbsLines.of(serial.model)
        super().__init__(serial, kind, self.curves)

    @property
    @override
    def walls(self) -> list[tuple[tuple[SectionWall, ...], ...]]:
        return list(self.curves.walls)

    @override
    def fingerprint(self) -> Mapping[str, Any]:
        nodes = [self.curves.nodes(beam) for beam in range(len(self.own))]
        return {"mesh": [self.curves.frames, nodes]}

    @override
    def elements(self, body: Beam) -> int:
        return len(self.curves.nodes(self.curves.index(body.name)))

    @override
    def outline(self, body: Beam) -> FloatArray:
        beam, first = self.curves.index(body.name), self.curves.first_node
        return self.curves.frames[first[beam] : first[beam + 1], :3]

    @override
    def inertia(self, body: Beam, origin: FloatArray) -> FloatArray:
        return self.curves.inertia(self.curves.index(body.name), origin)

    @override
    def mesh_facts(self, body: Beam) -> MeshFacts:
        beam = self.curves.index(body.name)
        centroids = self.curves.frames[self.curves.nodes(beam), :3].mean(axis=1)
        lengths = np.asarray(self.curves.parts[beam].lengths)
        return beam_facts(body, self.curves.middle_section(beam), lengths, centroids)

    @override
    def patches(self) -> IntArray:
        return one_width([self.curves.nodes(beam) for beam in range(len(self.own))])

    @override
    def node(self, marker: Marker, place: Place | None) -> int:
        assert place is not None
        assert place.node is not None
        return int(self.curves.first_node[self.curves.index(marker.body)]) + place.node

    @override
    def line(self, carrier: Carrier) -> Line:
        return self.curves.line(self.curves.index(carrier.body), self.kind)

    @override
    def section_of(self, body: Beam) -> Section:
        return self.curves.middle_section(self.curves.index(body.name))

    @override
    def contact_line(self, name: str) -> ContactLine:
        beam = self.curves.index(name)
        first, last = self.curves.first_node[beam : beam + 2]
        points = self.curves.frames[first:last, :3]
        nodes, weights, edges = polyline(self.curves.parts[beam], points)
        return ContactLine(first + nodes, weights, edges)

    @override
    def costs(self) -> dict[str, tuple[int, int]]:
        parts = zip(self.own, self.curves.parts, strict=True)
        return {beam.name: (len(part.nodes), 1) for beam, part in parts}

    @override
    def block(self, comm: MPI.Intracomm, ranks: IntArray) -> tuple[FrameBlock, ElementFamily]:
        curves = self.curves
        of_beams = np.split(ranks, curves.first_cell[1:-1])
        owner = _owners_of_nodes(curves, of_beams)
        chosen = [np.flatnonzero(rank == comm.rank) for rank in of_beams]
        touched = [curves.nodes(b)[cells].ravel() for b, cells in enumerate(chosen)]
        ids, index_map = distributed(comm, owner, np.concatenate(touched))
        frames = curves.frames[ids]
        block = FrameBlock(
            "nurbs_beams", comm, frames, curves.velocities[ids], ids, index_map, inertial=True
        )
        data = _cells(curves, chosen, block)
        along = dict(zip(curves.numbers.tolist(), curves.along, strict=True))
        return block, NurbsBeams(comm, data, curves.sections, curves.owners, frames, along)

    @override
    def forces(
        self, block: FrameBlock, elements: ElementFamily | None, node_body: IntArray
    ) -> tuple[list[Force], list[InnerForces]]:
        at_nodes = list(nurbs_node_forces(self.serial, self.curves, block))
        inside = list(nurbs_line_forces(self.serial, self.kind, self.curves, block))
        return at_nodes, list(by_kind(inside, node_body, block))

    @override
    def sensor(self, probe: AnyProbe, part: BlockPart) -> Sensor | None:
        if isinstance(probe, StrainProbe) and self.serial.model[probe.beam] in self.own:
            return CurveStrainSensor(part, self.serial, probe)
        return None


def _owners_of_nodes(curves: NurbsLines, ranks: Sequence[IntArray]) -> IntArray:
    """Rank of every control point: the lowest rank of the elements around it."""
    owner = np.full(len(curves.frames), np.iinfo(np.int64).max)
    for beam, rank in enumerate(ranks):
        nodes = curves.nodes(beam)
        np.minimum.at(owner, nodes, np.broadcast_to(rank[:, np.newaxis], nodes.shape))
    return owner


def _cells(curves: NurbsLines, chosen: Sequence[IntArray], block: FrameBlock) -> list[NurbsCells]:
    """Elements of this rank by kind; every rank has the same kinds, maybe without elements."""
    data = []
    width = max(np.size(beam.damping) for beam in curves.beams)
    for (_, vectors, varies), group in groupby(curves.by_kind(), curves.kind):
        beams = list(group)
        counts = [len(chosen[b]) for b in beams]
        nodes = np.concatenate([curves.nodes(b)[chosen[b]] for b in beams])
        damping = [np.broadcast_to(curves.beams[b].damping, (width,)) for b in beams]
        cells = NurbsCells(
            nodes=block.local_index(nodes),
            body=np.repeat(curves.numbers[beams], counts),
            section=np.repeat(curves.section[beams], counts),
            shape=np.concatenate([curves.parts[b].shape[chosen[b]] for b in beams]),
            damping=np.repeat(damping, counts, axis=0),
            vectors=vectors,
            arc=_arcs([whole_arcs(curves.parts[b])[chosen[b]] for b in beams]),
        )
        data.append(_with_sections(cells, curves, beams, chosen) if varies else cells)
    return data


def _arcs(parts: Sequence[FloatArray]) -> FloatArray:
    """Polynomials (m, a) of several beams, filled up to the largest number of coefficients."""
    width = max(arc.shape[1] for arc in parts)
    filled = [np.pad(arc, ((0, 0), (0, width - arc.shape[1]))) for arc in parts]
    return np.concatenate(filled)


def _with_sections(
    cells: NurbsCells, curves: NurbsLines, beams: Sequence[int], chosen: Sequence[IntArray]
) -> NurbsCells:
    """Elements of beams along which the section varies, with what they take of it."""
    own = [(curves.varying[b], chosen[b]) for b in beams]
    found = [(varying, rows) for varying, rows in own if varying is not None]
    return replace(
        cells,
        stiffness=np.concatenate([varying.stiffness[rows] for varying, rows in found]),
        masses=ElementMasses.joined([varying.masses.take(rows) for varying, rows in found]),
    )
