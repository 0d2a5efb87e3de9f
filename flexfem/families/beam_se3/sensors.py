# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sensors of SE(3) beams: strains, stress resultants, elongations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from flexfem._types import FloatArray
from flexfem.families.beam_se3.elements import SE3Beams
from flexfem.families.beam_se3.mesh import BeamMesh
from flexfem.layout.family import SumOfValues

if TYPE_CHECKING:
    from flexfem.system.system import BlockPart

__all__ = ["BeamElongation", "StrainSensor"]


class StrainSensor(SumOfValues):
    """Strains and resultants of one SE(3) cell, on its rank."""

    def __init__(self, part: BlockPart, mesh: BeamMesh, nodes: Sequence[int]) -> None:
        """Find the cell of two nodes, given by their numbers in the model's mesh."""
        beams, ids = part.elements, part.block.node_ids
        assert isinstance(beams, SE3Beams)
        self._beams = beams
        wanted = np.sort(mesh.numbers(nodes))
        ends = np.sort(ids[beams.data.cells], axis=1).reshape(-1, 2)
        self._cells = np.flatnonzero((ends == wanted).all(axis=1))
        self.block, self.support = part.block, beams.support[self._cells]

    def values(self) -> FloatArray:
        """See :class:`flexfem.layout.family.NodalValues`."""
        return np.concatenate(self._beams.resultants(self.block.frames, self._cells), axis=1)


class BeamElongation(SumOfValues):
    """Changes of the lengths of this rank's elements of an SE(3) beam, summed."""

    def __init__(self, part: BlockPart, number: int) -> None:
        """Find the elements of the beam of a number in the model."""
        beams = part.elements
        assert isinstance(beams, SE3Beams)
        self._beams = beams
        self._cells = np.flatnonzero(beams.body == number)
        self.block, self.support = part.block, beams.support[self._cells]

    def values(self) -> FloatArray:
        """See :class:`flexfem.layout.family.NodalValues`."""
        return self._beams.elongations(self.block.frames)[self._cells, np.newaxis]
