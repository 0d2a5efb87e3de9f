# SPDX-License-Identifier: LGPL-3.0-or-later
"""What measures the probes that are not functions of markers.

A gauge gives the share of this rank in the columns of its probe; the shares of all ranks add up.
"""

from typing import Protocol

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.elements.director_shells import DirectorShells
from flexfem.elements.nurbs_beam import NurbsBeams
from flexfem.elements.rotation_free_shells import RotationFreeShells
from flexfem.elements.se3_beam import SE3Beams
from flexfem.lie import se3
from flexfem.model.contact import ContactProbe
from flexfem.model.floating_body import FloatingBody
from flexfem.model.measured import (
    ElongationProbe,
    EnergyProbe,
    MomentumProbe,
    ReactionProbe,
    ShellEnergyProbe,
    ShellStrainProbe,
    StrainProbe,
)
from flexfem.model.place import element_at_fraction
from flexfem.model.probe import AnyProbe
from flexfem.system.assembly import Assembly
from flexfem.system.element_places import holds
from flexfem.system.elongations import BeamElongation, BodyElongation
from flexfem.system.energies import EnergyMeter, refresh_rows
from flexfem.system.lines import ElementPlace
from flexfem.system.momenta import MomentumMeter
from flexfem.system.placement import BEAMS, NURBS, SHELLS
from flexfem.system.system import System

__all__ = ["Gauge", "create_gauge"]


class Gauge(Protocol):
    """Measures the accepted state."""

    def update(self) -> FloatArray:
        """Take in the accepted state and return this rank's share of the columns."""


class _ReactionGauge:
    """Force and moment of a joint on the body of its marker b, on the rank that owns the joint.

    Of the parts of a joint of lines it is the resultant, about the first part's marker there: a
    node of the line, or the marker of a body.
    """

    def __init__(self, system: System, probe: ReactionProbe) -> None:
        self._system, self._axes = system, probe.axes
        rows = system.constraints
        mine = [k for k, j in enumerate(rows.joints) if j.joint.name == probe.joint and j.owned]
        self._first = rows.marker_start[mine]
        second = np.array([rows.joints[k].joint.second for k in mine], dtype=np.int64)
        self._markers = self._first + second

    def update(self) -> FloatArray:
        forces = self._system.reported_forces()  # on all ranks
        if not len(self._markers):
            return np.zeros(6)
        refresh_rows(self._system)
        rows = self._system.constraints
        at, wrenches = rows.poses[self._markers, :3], rows.reactions(forces)[self._markers]
        arms = np.cross(at - at[0], wrenches[:, :3])
        force, moment = wrenches[:, :3].sum(axis=0), (wrenches[:, 3:] + arms).sum(axis=0)
        if self._axes == "inertial":
            return np.concatenate([force, moment])
        R = se3.rotation(rows.poses[self._first[0] if self._axes == "a" else self._markers[0]])
        return np.concatenate([force @ R, moment @ R])


class _CurveStrainGauge:
    """Strains and resultants at a fraction of a NURBS beam, on the rank that holds the element."""

    def __init__(self, system: System, serial: Assembly, probe: StrainProbe) -> None:
        self._part = next(part for part in system.parts if part.kind == NURBS)
        block, beams = self._part.block, self._part.elements
        assert isinstance(beams, NurbsBeams)
        curve = serial.model.curve(serial.model[probe.beam])
        place = ElementPlace.on(
            serial.line(probe.beam), *element_at_fraction(curve, probe.fraction)
        )
        self._beams, self._xi = beams, np.array([place.xi])
        self._cells = np.empty(0, dtype=np.int64)
        if holds(block, place):
            self._cells = np.array([_cell(beams, block.local_index(place.nodes))])

    def update(self) -> FloatArray:
        if not len(self._cells):
            return np.zeros(12)
        both = self._beams.resultants_at(self._part.block.frames, self._xi, self._cells)
        values: FloatArray = np.concatenate(both, axis=2)[0, 0]
        return values


class _ContactGauge:
    """Penetration and forces of a contact."""

    def __init__(self, system: System, probe: ContactProbe) -> None:
        self._system, self._name = system, probe.contact

    def update(self) -> FloatArray:
        return self._system.contacts[0].measure(self._name)


def _cell(beams: NurbsBeams, nodes: IntArray) -> int:
    """Number of the cell with the given local nodes."""
    first = 0
    for group in beams.connectivity:
        if group.shape[1] == len(nodes):
            found = np.flatnonzero((group == nodes).all(axis=1))
            if len(found):
                return first + int(found[0])
        first += len(group)
    raise LookupError("no such element on this rank")


class _StrainGauge:
    """Strains and resultants of one SE(3) cell, on the rank that holds it."""

    def __init__(self, system: System, serial: Assembly, probe: StrainProbe) -> None:
        self._part = next(part for part in system.parts if part.kind == BEAMS)
        beams, ids = self._part.elements, self._part.block.node_ids
        assert isinstance(beams, SE3Beams)
        self._beams = beams
        wanted = np.sort(serial.mesh_nodes(probe.nodes(serial.model)))
        ends = np.sort(ids[beams.data.cells], axis=1).reshape(-1, 2)
        self._cells = np.flatnonzero((ends == wanted).all(axis=1))

    def update(self) -> FloatArray:
        if not len(self._cells):
            return np.zeros(12)
        both = self._beams.resultants(self._part.block.frames, self._cells)
        values: FloatArray = np.concatenate(both, axis=1)[0]
        return values


class _ShellStrainGauge:
    """Strains and resultants of one triangle of a shell, on the rank that owns it."""

    def __init__(self, system: System, serial: Assembly, probe: ShellStrainProbe) -> None:
        self._part = next(part for part in system.parts if part.kind == SHELLS)
        shells, ids = self._part.elements, self._part.block.node_ids
        assert isinstance(shells, (RotationFreeShells, DirectorShells))
        self._shells = shells
        corners = np.sort(ids[shells.carriers[:, :3]], axis=1).reshape(-1, 3)
        wanted = np.sort(probe.nodes(serial.model))
        # shells may share nodes and edges, not triangles
        self._cells = np.flatnonzero((corners == wanted).all(axis=1))

    def update(self) -> FloatArray:
        if not len(self._cells):
            return np.zeros(12)
        both = self._shells.resultants(self._part.block.frames, self._cells)
        values: FloatArray = np.concatenate(both, axis=1)[0]
        return values


class _ShellEnergyGauge:
    """Strain energies of the shells of this rank by kind."""

    def __init__(self, system: System, serial: Assembly, probe: ShellEnergyProbe) -> None:
        self._part = next(part for part in system.parts if part.kind == SHELLS)
        shells = self._part.elements
        assert isinstance(shells, (RotationFreeShells, DirectorShells))
        self._shells = shells
        names = [shell.name for shell in serial.model.shells]
        chosen = np.array([probe.bodies is None or name in probe.bodies for name in names])
        self._cells = chosen[shells.body]

    def update(self) -> FloatArray:
        parts = self._shells.energy_parts(self._part.block.frames)
        total: FloatArray = self._cells @ parts
        return total


def create_gauge(probe: AnyProbe, system: System, serial: Assembly) -> Gauge | None:
    """Gauge of a probe (collective), None for functions of markers."""
    match probe:
        case ContactProbe():
            return _ContactGauge(system, probe)
        case ElongationProbe():
            floating = isinstance(serial.model[probe.body], FloatingBody)
            return (BodyElongation if floating else BeamElongation)(system, serial.model, probe)
        case EnergyProbe():
            return EnergyMeter(system, serial.model, probe.bodies)
        case MomentumProbe():
            return MomentumMeter(system, serial.model, probe.bodies)
        case ReactionProbe():
            return _ReactionGauge(system, probe)
        case ShellEnergyProbe():
            return _ShellEnergyGauge(system, serial, probe)
        case ShellStrainProbe():
            return _ShellStrainGauge(system, serial, probe)
        case StrainProbe():
            if serial.model[probe.beam].formulation == "nurbs":
                return _CurveStrainGauge(system, serial, probe)
            return _StrainGauge(system, serial, probe)
    return None
