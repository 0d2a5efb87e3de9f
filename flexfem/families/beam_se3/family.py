# SPDX-License-Identifier: LGPL-3.0-or-later
"""Beams of two-node elements that interpolate on SE(3)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, override

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray, IntArray
from flexfem.core.marker import Carrier, Marker
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.families.beam_se3.along import present_strains
from flexfem.families.beam_se3.elements import SE3Beams
from flexfem.families.beam_se3.loads import se3_line_forces, se3_node_forces
from flexfem.families.beam_se3.mesh import BeamMesh
from flexfem.families.beam_se3.sensors import BeamElongation, StrainSensor
from flexfem.families.common.along import Places
from flexfem.families.common.beam_family import BeamFamily
from flexfem.layout.elements import ElementFamily
from flexfem.layout.family import ContactLine, Sensor
from flexfem.layout.inner_forces import InnerForces
from flexfem.layout.line_loads import by_kind
from flexfem.layout.lines import Line, se3_line
from flexfem.layout.mesh_facts import MeshFacts, beam_facts
from flexfem.layout.node_loads import Force
from flexfem.layout.numbered_model import NumberedModel
from flexfem.materials.section import Section
from flexfem.materials.section_wall import SectionWall
from flexfem.mesh.distributed.beam_mesh import create_beam_mesh
from flexfem.mesh.geometry.topology import trace_lines
from flexfem.model.bodies.basic import Beam
from flexfem.model.contact import Contact
from flexfem.model.probes.base import AnyProbe
from flexfem.model.probes.measured import ElongationProbe, StrainProbe
from flexfem.model.structure.place import Place

if TYPE_CHECKING:
    from flexfem.system.system import BlockPart

__all__ = ["SE3BeamFamily"]


class SE3BeamFamily(BeamFamily):
    """See :class:`flexfem.layout.family.Family`."""

    formulation = "se3"

    def __init__(self, serial: NumberedModel, kind: int) -> None:
        """Lay out the beams."""
        self.mesh = BeamMesh.of(serial.model)
        super().__init__(serial, kind, self.mesh)
        self._numbers = {beam.name: i for i, beam in enumerate(self.bodies)}

    @override
    def check_energy_momentum(self, dissipates: bool) -> None:
        for beam in self.own:
            for what, given in (
                ("a prestrain that changes with time", beam.timed),
                ("one damping for each strain", np.ndim(beam.damping) > 0),
            ):
                if given:
                    raise InputError(
                        f'Beam "{beam.name}": the integrator energy_momentum does not support '
                        f"{what}"
                    )

    @property
    @override
    def walls(self) -> list[tuple[tuple[SectionWall, ...], ...]]:
        return self.mesh.walls

    @override
    def fingerprint(self) -> Mapping[str, Any]:
        return {"mesh": [self.mesh.points, self.mesh.cells.cells, self.mesh.frames]}

    @override
    def elements(self, body: Beam) -> int:
        return len(self._cells(body))

    @override
    def outline(self, body: Beam) -> FloatArray:
        return self.mesh.points[np.unique(self._cells(body))]

    @override
    def inertia(self, body: Beam, origin: FloatArray) -> FloatArray:
        return self.mesh.inertia(self._numbers[body.name], origin)

    @override
    def mesh_facts(self, body: Beam) -> MeshFacts:
        ends = self.mesh.points[self._cells(body)]
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        return beam_facts(body, self.section_of(body), lengths, ends.mean(axis=1))

    @override
    def patches(self) -> IntArray:
        return self.mesh.cells.cells.astype(np.int64)

    @override
    def section_of(self, body: Beam) -> Section:
        return self.mesh.section(self._numbers[body.name])

    def _cells(self, beam: Beam) -> IntArray:
        """(m, 2) nodes of the cells of a beam."""
        return self.mesh.nodes(self._numbers[beam.name])

    @override
    def node(self, marker: Marker, place: Place | None) -> int:
        assert place is not None
        assert place.node is not None
        return int(self.mesh.numbers([place.node])[0])

    @override
    def line(self, carrier: Carrier) -> Line:
        beam, data = self.serial.model[carrier.body], self.mesh.cells
        cells = np.arange(len(data.cells))[self.mesh.own(self._numbers[beam.name])]
        order = _chain(data.cells[cells].astype(np.int64))
        if order is None:
            raise ValueError(f'Beam "{beam.name}": group "{beam.group}" branches or falls apart')
        cells = cells[order]
        return se3_line(self.kind, cells, data.cells[cells], data.frames[cells], self.frames)

    @override
    def contact_chain(self, name: str) -> IntArray:
        return self.mesh.nodes(self._numbers[name])

    @override
    def contact_numbers(self, body: Beam, contact: Contact) -> tuple[float, float]:
        if self.section_of(body).stiffness is None:
            raise ValueError(
                f'Beam "{body.name}": its BeamLaw has no stiffness from which that of contact '
                "follows, give Contact(stiffness=...)"
            )
        return self.surface_numbers(body, contact.beam_radius(body))

    @override
    def contact_line(self, name: str) -> ContactLine:
        nodes, edges = np.unique(self.mesh.nodes(self._numbers[name]), return_inverse=True)
        weights = np.ones((len(nodes), 1))
        return ContactLine(nodes.astype(np.int64)[:, np.newaxis], weights, edges.reshape(-1, 2))

    @override
    def costs(self) -> dict[str, tuple[int, int]]:
        model = self.serial.model
        return {beam.name: (len(model.beam_cells(beam)), 1) for beam in self.own}

    @override
    def links(self) -> dict[tuple[str, str], int]:
        """None in models that are checked: beams share no nodes there."""
        found = dict[tuple[str, str], int]()
        for pair in self.mesh.common_nodes().tolist():
            a, b = (self.bodies[number].name for number in pair)
            found[a, b] = found.get((a, b), 0) + 6
        return found

    @override
    def block(self, comm: MPI.Intracomm, ranks: IntArray) -> tuple[FrameBlock, ElementFamily]:
        own, data = self.mesh, self.mesh.cells
        mesh = create_beam_mesh(comm, data.cells, ranks)
        mine = replace(data.take(mesh.cell_ids), cells=mesh.cells)
        frames = own.frames[mesh.node_ids]
        block = FrameBlock(
            "beams", comm, frames, own.velocities[mesh.node_ids], mesh.node_ids, mesh.index_map,
            inertial=True, elements=mesh.cell_ids,
        )  # fmt: skip
        strains = {
            self._numbers[beam.name]: partial(_initial_strain, beam)
            for beam in self.own
            if beam.timed
        }
        return block, SE3Beams(comm, mine, own.sections, own.owners, frames, strains)

    @override
    def forces(
        self, block: FrameBlock, elements: ElementFamily | None, node_body: IntArray
    ) -> tuple[list[Force], list[InnerForces]]:
        at_nodes = list(se3_node_forces(self.serial, self.mesh, self.own, block))
        inside = list(se3_line_forces(self.serial, self.kind, self.own, block))
        return at_nodes, list(by_kind(inside, node_body, block))

    @override
    def sensor(self, probe: AnyProbe, part: BlockPart) -> Sensor | None:
        model = self.serial.model
        if isinstance(probe, StrainProbe) and model[probe.beam] in self.own:
            return StrainSensor(part, self.mesh, probe.nodes(model))
        if isinstance(probe, ElongationProbe) and model[probe.body] in self.own:
            return BeamElongation(part, self._numbers[probe.body])
        return None


def _chain(cells: IntArray) -> IntArray | None:
    """Order of cells of one line, all in its direction; None if they branch or are disconnected."""
    lines = trace_lines(cells)
    if len(lines) != 1 or lines[0].reversed.any():
        return None
    return lines[0].cells


def _initial_strain(beam: Beam, ends: FloatArray, time: float) -> FloatArray:
    """Mean initial strains (m, 6) of cells of a beam between arc lengths (m, 2), m."""
    return present_strains(beam, Places.inside(ends), time)
