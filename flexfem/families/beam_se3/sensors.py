# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sensors of SE(3) beams: strains, stress resultants, elongations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from flexfem._types import FloatArray
from flexfem.families.beam_se3.elements import SE3Beams
from flexfem.families.beam_se3.mesh import BeamMesh

if TYPE_CHECKING:
    from flexfem.system.system import BlockPart

__all__ = ["BeamElongation", "StrainSensor"]


class StrainSensor:
    """Strains and resultants of one SE(3) cell, on its rank."""

    def __init__(self, part: BlockPart, mesh: BeamMesh, nodes: Sequence[int]) -> None:
        """Find the cell of two nodes, given by their numbers in the model's mesh."""
        self._part = part
        beams, ids = self._part.elements, self._part.block.node_ids
        assert isinstance(beams, SE3Beams)
        self._beams = beams
        wanted = np.sort(mesh.numbers(nodes))
        ends = np.sort(ids[beams.data.cells], axis=1).reshape(-1, 2)
        self._cells = np.flatnonzero((ends == wanted).all(axis=1))

    def update(self) -> FloatArray:
        """See :class:`flexfem.layout.family.Sensor`."""
        if not len(self._cells):
            return np.zeros(12)
        both = self._beams.resultants(self._part.block.frames, self._cells)
        values: FloatArray = np.concatenate(both, axis=1)[0]
        return values


class BeamElongation:
    """Changes of the lengths of this rank's elements of an SE(3) beam, summed."""

    def __init__(self, part: BlockPart, number: int) -> None:
        """Find the elements of the beam of a number in the model."""
        self._part = part
        beams = self._part.elements
        assert isinstance(beams, SE3Beams)
        self._beams = beams
        self._cells = np.flatnonzero(beams.body == number)

    def update(self) -> FloatArray:
        """See :class:`flexfem.layout.family.Sensor`."""
        changes = self._beams.elongations(self._part.block.frames)
        return np.array([changes[self._cells].sum()])
