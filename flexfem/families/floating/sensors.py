# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sensors of bodies in floating frames: elongations, and what reduced bodies miss."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from flexfem._types import FloatArray
from flexfem.families.floating.elements import FloatingBodies, FloatingGroup
from flexfem.layout.family import SumOfValues
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.model.probes.measured import ElongationProbe, ReductionErrorProbe

if TYPE_CHECKING:
    from flexfem.system.system import BlockPart

__all__ = ["BodyElongation", "BodyMissing"]


class _OfBody:
    """What sensors of one body share: the body, on its rank."""

    def __init__(self, part: BlockPart, bodies: Sequence[FloatingBody], name: str) -> None:
        """Find the body."""
        self.number, self._block = [body.name for body in bodies].index(name), part.block
        elements = part.elements
        assert isinstance(elements, FloatingBodies)
        groups = (g.only(self.number) for g in elements.groups if self.number in g.body)
        self._found = next(groups, None)

    def _coordinates(self, found: FloatingGroup) -> FloatArray:
        """Elastic coordinates of the body with their rates."""
        block = self._block
        return found.coordinates(block.frames, block.velocity, block.acceleration)[1]


class BodyElongation(_OfBody, SumOfValues):
    """Relative displacement of two interfaces by elastic strain, on the rank of the body."""

    def __init__(
        self, part: BlockPart, bodies: Sequence[FloatingBody], probe: ElongationProbe
    ) -> None:
        """Find the body and the coordinates."""
        super().__init__(part, bodies, probe.body)
        self._weights, self.block = _along(bodies[self.number], probe), part.block
        nothing = np.empty((0, 1), dtype=np.int64)
        self.support = nothing if self._found is None else self._found.nodes.astype(np.int64)

    def values(self) -> FloatArray:
        """See :class:`flexfem.layout.family.NodalValues`."""
        if self._found is None:
            return np.zeros((0, 1))
        strains = self._found.strains(self._coordinates(self._found)[:, :, 0])
        return strains[:, : len(self._weights)] @ self._weights[:, np.newaxis]


class BodyMissing:
    """Part of its displacement that a body misses, on its rank."""

    def __init__(
        self, part: BlockPart, bodies: Sequence[FloatingBody], probe: ReductionErrorProbe
    ) -> None:
        """Find the body."""
        self._body, self._block = [body.name for body in bodies].index(probe.body), part.block
        assert isinstance(part.elements, FloatingBodies)
        self._elements = part.elements

    def update(self) -> FloatArray:
        """See :class:`flexfem.layout.family.Sensor`."""
        missing, moved = self._elements.missing_of(self._body, self._block)
        whole = float(np.hypot(missing, moved))
        return np.array([missing / whole if whole > 0.0 else 0.0])


def _along(body: FloatingBody, probe: ElongationProbe) -> FloatArray:
    """Weights of the interfaces' coordinates in the elongation; those of the frame are zero."""
    first, second = probe.interfaces(body)
    places = [body.reduced.interfaces[i].position for i in (first, second)]
    direction = (places[1] - places[0]) / np.linalg.norm(places[1] - places[0])
    weights = np.zeros((len(body.reduced.interfaces), 6))
    weights[first, :3], weights[second, :3] = -direction, direction
    own: FloatArray = weights[body.relative].ravel()
    return own
