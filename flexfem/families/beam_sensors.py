# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gauges of beams: strains, stress resultants, elongations."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.elements.nurbs_beam import NurbsBeams
from flexfem.elements.se3_beam import SE3Beams
from flexfem.model.measured import StrainProbe
from flexfem.model.place import element_at_fraction
from flexfem.system.assembly import Assembly
from flexfem.system.element_places import holds
from flexfem.system.lines import ElementPlace

if TYPE_CHECKING:
    from flexfem.system.system import BlockPart

__all__ = ["BeamElongation", "CurveStrainGauge", "StrainGauge"]


class StrainGauge:
    """Strains and resultants of one SE(3) cell, on the rank that holds it."""

    def __init__(self, part: BlockPart, serial: Assembly, probe: StrainProbe) -> None:
        """Find the cell."""
        self._part = part
        beams, ids = self._part.elements, self._part.block.node_ids
        assert isinstance(beams, SE3Beams)
        self._beams = beams
        wanted = np.sort(serial.mesh_nodes(probe.nodes(serial.model)))
        ends = np.sort(ids[beams.data.cells], axis=1).reshape(-1, 2)
        self._cells = np.flatnonzero((ends == wanted).all(axis=1))

    def update(self) -> FloatArray:
        """See :class:`flexfem.system.family.Gauge`."""
        if not len(self._cells):
            return np.zeros(12)
        both = self._beams.resultants(self._part.block.frames, self._cells)
        values: FloatArray = np.concatenate(both, axis=1)[0]
        return values


class BeamElongation:
    """Extension of this rank's elements of an SE(3) beam times their lengths."""

    def __init__(self, part: BlockPart, number: int) -> None:
        """Find the elements of the beam of a number in the model."""
        self._part = part
        beams = self._part.elements
        assert isinstance(beams, SE3Beams)
        self._beams = beams
        self._cells = np.flatnonzero(beams.body == number)

    def update(self) -> FloatArray:
        """See :class:`flexfem.system.family.Gauge`."""
        strains, _ = self._beams.resultants(self._part.block.frames, self._cells)
        return np.array([strains[:, 0] @ self._beams.lengths[self._cells]])


class CurveStrainGauge:
    """Strains and resultants at a fraction of a NURBS beam, on the rank that holds the element."""

    def __init__(self, part: BlockPart, serial: Assembly, probe: StrainProbe) -> None:
        """Find the element."""
        self._part = part
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
        """See :class:`flexfem.system.family.Gauge`."""
        if not len(self._cells):
            return np.zeros(12)
        both = self._beams.resultants_at(self._part.block.frames, self._xi, self._cells)
        values: FloatArray = np.concatenate(both, axis=2)[0, 0]
        return values


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
