# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sensors of solids: fields at points, and means over cells."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from flexfem._types import FloatArray
from flexfem.families.solid.body import Solid
from flexfem.families.solid.elements import SolidElements
from flexfem.families.solid.forms import FIELDS
from flexfem.families.solid.meshes.lagrange import shapes
from flexfem.families.solid.probes import SolidProbe
from flexfem.layout.family import SumOfValues

if TYPE_CHECKING:
    from flexfem.system.system import BlockPart

__all__ = ["PlaceSensor", "SolidSensor", "von_mises"]

_STRESS, _STRAIN, _J = 0, FIELDS["stress"], FIELDS["stress"] + FIELDS["strain"]


class SolidSensor(SumOfValues):
    """Share of this rank in the columns of a probe.

    Fields are weighted means of those of cells; von Mises' stress, which is no linear function of
    them, is evaluated on the rank that has a point, or in each cell.
    """

    def __init__(
        self, part: BlockPart, bodies: Sequence[Solid], first_cell: int, probe: SolidProbe
    ) -> None:
        """Find the cells.

        Args:
            part: the family's.
            bodies: of the family.
            first_cell: number in the family of the first cell of the probe's solid.
            probe: the probe.
        """
        elements = part.elements
        assert isinstance(elements, SolidElements)
        self._elements, self._probe, self.block = elements, probe, part.block
        solid = next(body for body in bodies if body.name == probe.solid)
        at_cell: int | None = None
        self._at: FloatArray | None = None
        if probe.place is not None and not isinstance(probe.place, str):
            at_cell, xi = solid.figure.place_in_cell(f'SolidProbe "{probe.name}"', probe.place)
            kind = solid.mesh.cell, solid.degree - 1
            at = shapes(*kind, xi[np.newaxis])[0][0] if solid.degree > 1 else np.ones(1)
            self._at = at
        self._chosen, support, first, volume = [], [], 0, 0.0
        for group in elements.groups:
            number = group.number - first_cell
            inside = np.flatnonzero((number >= 0) & (number < solid.elements))
            if at_cell is None:
                cells = number[inside]
                order = np.argsort(cells)
                met = np.empty(len(cells), dtype=np.bool_)
                met[order] = solid.figure.in_region(probe.place or "", cells[order])
            else:
                met = number[inside] == at_cell
            chosen = inside[met]
            self._chosen.append(chosen)
            support.append(first + chosen)
            first, volume = first + len(number), volume + float(group.size[chosen].sum())
        self.support = elements.support[np.concatenate([np.empty(0, np.int64), *support])]
        self._volume = part.block.comm.allreduce(volume)

    def values(self) -> FloatArray:
        """See :class:`flexfem.layout.family.NodalValues`: the shares of the cells."""
        fields, found = self._elements.fields(self.block), []
        for values, group, chosen in zip(fields, self._elements.groups, self._chosen, strict=True):
            means = group.means(values[chosen], chosen)
            size = group.size[chosen, np.newaxis]
            if self._at is not None:
                own, share = np.einsum("j,mjc->mc", self._at, values[chosen]), np.ones_like(size)
            else:
                own, share = means, size / self._volume
            every = {
                "stress": share * own[:, _STRESS:_STRAIN], "strain": share * own[:, _STRAIN:_J],
                "J": share * own[:, _J : _J + 1], "volume": size * means[:, _J : _J + 1],
                "von_mises": share * von_mises(own[:, :_STRAIN])[:, np.newaxis],
            }  # fmt: skip
            found.append(np.hstack([every[name] for name in self._probe.measures]))
        return np.concatenate([np.empty((0, len(self._probe.columns))), *found])


class PlaceSensor(SumOfValues):
    """Position and displacement of a point or a surface, the share of this rank's nodes."""

    def __init__(self, part: BlockPart, solid: Solid, first_node: int, probe: SolidProbe) -> None:
        """Find the nodes.

        Args:
            part: the family's.
            solid: the probe's.
            first_node: number in the family of its first node.
            probe: the probe.
        """
        owner, block = f'SolidProbe "{probe.name}"', part.block
        if isinstance(probe.place, str):
            nodes, weights = solid.figure.area_weights(owner, probe.place)
        else:
            cell, weights = solid.figure.located(owner, probe.place)
            nodes = solid.figure.cell_nodes(np.array([cell]))[0]
        local = block.owned_index(first_node + nodes)
        self._probe, self.block, self._nodes = probe, block, local[local >= 0]
        self.support = self._nodes[:, np.newaxis]
        self._weights = weights[local >= 0, np.newaxis] / weights.sum()

    def values(self) -> FloatArray:
        """See :class:`flexfem.layout.family.NodalValues`: the shares of the nodes."""
        now, start = self.block.frames, self.block.start_frames
        x, X = (self._weights * frames[self._nodes, :3] for frames in (now, start))
        found = {"position": x, "displacement": x - X}
        return np.hstack([found[name] for name in self._probe.measures])


def von_mises(stress: FloatArray) -> FloatArray:
    """Von Mises' stress (m,) of stresses (m, 6), components as in ``forms.FIELDS``."""
    normal, shear = stress[:, :3], stress[:, 3:]
    around = normal - np.roll(normal, 1, axis=1)
    found: FloatArray = np.sqrt(0.5 * (around**2).sum(axis=1) + 3.0 * (shear**2).sum(axis=1))
    return found
