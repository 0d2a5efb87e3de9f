# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sensors of NURBS beams: strains, stress resultants."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.families.beam_nurbs.elements import NurbsBeams, NurbsPoints
from flexfem.layout.element_places import holds
from flexfem.layout.lines import ElementPlace
from flexfem.layout.numbered_model import NumberedModel
from flexfem.model.probes.measured import StrainProbe
from flexfem.model.structure.place import element_at_fraction

if TYPE_CHECKING:
    from flexfem.system.system import BlockPart
__all__ = ["CurveStrainSensor"]


class CurveStrainSensor:
    """Strains and resultants at a fraction of a NURBS beam, on the rank of the element."""

    def __init__(self, part: BlockPart, serial: NumberedModel, probe: StrainProbe) -> None:
        """Find the element."""
        self._part = part
        block, beams = self._part.block, self._part.elements
        assert isinstance(beams, NurbsBeams)
        curve = serial.model.curve(serial.model[probe.beam])
        place = ElementPlace.on(
            serial.line(probe.beam), *element_at_fraction(curve, probe.fraction)
        )
        self._points: NurbsPoints | None = None
        if holds(block, place):
            cells = np.array([_cell(beams, block.local_index(place.nodes))])
            self._points = beams.points_at(np.array([place.xi]), cells)

    def update(self) -> FloatArray:
        """See :class:`flexfem.layout.family.Sensor`."""
        if self._points is None:
            return np.zeros(12)
        both = self._points.resultants(self._part.block.frames)
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
