# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sensors of shells: strains, stress resultants, strain energies."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexfem._types import FloatArray
from flexfem.families.shell_director.elements import DirectorShells
from flexfem.families.shell_rotation_free.elements import RotationFreeShells
from flexfem.layout.numbered_model import NumberedModel
from flexfem.model.probes.measured import ShellEnergyProbe, ShellStrainProbe

if TYPE_CHECKING:
    from flexfem.system.system import BlockPart

__all__ = ["ShellEnergySensor", "ShellStrainSensor"]


class ShellStrainSensor:
    """Strains and resultants of one triangle of a shell, on the rank that owns it."""

    def __init__(self, part: BlockPart, serial: NumberedModel, probe: ShellStrainProbe) -> None:
        """Find the triangle."""
        self._part = part
        shells, ids = self._part.elements, self._part.block.node_ids
        assert isinstance(shells, (RotationFreeShells, DirectorShells))
        self._shells = shells
        corners = np.sort(ids[shells.carriers[:, :3]], axis=1).reshape(-1, 3)
        wanted = np.sort(probe.nodes(serial.model))
        # shells may share nodes and edges, not triangles
        self._cells = np.flatnonzero((corners == wanted).all(axis=1))

    def update(self) -> FloatArray:
        """See :class:`flexfem.layout.family.Sensor`."""
        if not len(self._cells):
            return np.zeros(12)
        both = self._shells.resultants(self._part.block.frames, self._cells)
        values: FloatArray = np.concatenate(both, axis=1)[0]
        return values


class ShellEnergySensor:
    """Membrane, bending and shear energies of the shells of this rank."""

    def __init__(self, part: BlockPart, serial: NumberedModel, probe: ShellEnergyProbe) -> None:
        """Find the triangles."""
        self._part = part
        shells = self._part.elements
        assert isinstance(shells, (RotationFreeShells, DirectorShells))
        self._shells = shells
        names = [shell.name for shell in serial.model.shells]
        chosen = np.array([probe.bodies is None or name in probe.bodies for name in names])
        self._cells = chosen[shells.body]

    def update(self) -> FloatArray:
        """See :class:`flexfem.layout.family.Sensor`."""
        parts = self._shells.energy_parts(self._part.block.frames)
        total: FloatArray = self._cells @ parts
        return total
