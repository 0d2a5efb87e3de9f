# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sensors of NURBS beams: strains, stress resultants."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.families.beam_nurbs.elements import NurbsBeams
from flexfem.layout.element_places import holds
from flexfem.layout.family import SumOfValues
from flexfem.layout.lines import ElementPlace
from flexfem.layout.numbered_model import NumberedModel
from flexfem.model.probes.measured import StrainProbe
from flexfem.model.structure.place import element_at_fraction

if TYPE_CHECKING:
    from flexfem.system.system import BlockPart
__all__ = ["CurveStrainSensor"]


class CurveStrainSensor(SumOfValues):
    """Strains and resultants at a fraction of a NURBS beam, on the rank of the element."""

    def __init__(self, part: BlockPart, serial: NumberedModel, probe: StrainProbe) -> None:
        """Find the element."""
        block, beams = part.block, part.elements
        assert isinstance(beams, NurbsBeams)
        curve = serial.model.curve(serial.model[probe.beam])
        place = ElementPlace.on(
            serial.line(probe.beam), *element_at_fraction(curve, probe.fraction)
        )
        cells = np.empty(0, dtype=np.int64)
        if holds(block, place):
            cells = np.array([_cell(beams, block.local_index(place.nodes))])
        self._points = beams.points_at(np.array([place.xi]), cells)
        self.block, self.support = block, beams.support[cells]

    def values(self) -> FloatArray:
        """See :class:`flexfem.layout.family.NodalValues`."""
        return np.concatenate(self._points.resultants(self.block.frames), axis=2)[:, 0]


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
