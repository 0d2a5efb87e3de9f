# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sensors of shells: strains, stress resultants, strain energies."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexfem._types import FloatArray
from flexfem.families.shell_director.elements import DirectorShells
from flexfem.families.shell_rotation_free.elements import RotationFreeShells
from flexfem.layout.family import SumOfValues
from flexfem.layout.numbered_model import NumberedModel
from flexfem.model.probes.measured import ShellEnergyProbe, ShellStrainProbe

if TYPE_CHECKING:
    from flexfem.system.system import BlockPart

__all__ = ["ShellEnergySensor", "ShellStrainSensor"]


class ShellStrainSensor(SumOfValues):
    """Strains and resultants of one triangle of a shell, on the rank that owns it."""

    def __init__(self, part: BlockPart, serial: NumberedModel, probe: ShellStrainProbe) -> None:
        """Find the triangle."""
        shells, ids = part.elements, part.block.node_ids
        assert isinstance(shells, (RotationFreeShells, DirectorShells))
        self._shells = shells
        corners = np.sort(ids[shells.carriers[:, :3]], axis=1).reshape(-1, 3)
        wanted = np.sort(probe.nodes(serial.model))
        # shells may share nodes and edges, not triangles
        self._cells = np.flatnonzero((corners == wanted).all(axis=1))
        self.block, self.support = part.block, shells.support[self._cells]

    def values(self) -> FloatArray:
        """See :class:`flexfem.layout.family.NodalValues`."""
        return np.concatenate(self._shells.resultants(self.block.frames, self._cells), axis=1)


class ShellEnergySensor(SumOfValues):
    """Membrane, bending and shear energies of the shells of this rank."""

    def __init__(self, part: BlockPart, serial: NumberedModel, probe: ShellEnergyProbe) -> None:
        """Find the triangles."""
        shells = part.elements
        assert isinstance(shells, (RotationFreeShells, DirectorShells))
        self._shells = shells
        names = [shell.name for shell in serial.model.shells]
        chosen = np.array([probe.bodies is None or name in probe.bodies for name in names])
        self._cells = np.flatnonzero(chosen[shells.body])
        self.block, self.support = part.block, shells.support[self._cells]

    def values(self) -> FloatArray:
        """See :class:`flexfem.layout.family.NodalValues`."""
        return self._shells.energy_parts(self.block.frames)[self._cells]
