# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sensors of bodies in floating frames: elongations, and what reduced bodies miss."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from flexfem._types import FloatArray
from flexfem.families.floating.elements import FloatingBodies
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.model.probes.measured import ElongationProbe, ReductionErrorProbe

if TYPE_CHECKING:
    from flexfem.system.system import BlockPart

__all__ = ["BodyElongation", "BodyMissing"]


class BodyElongation:
    """Relative displacement of two interfaces by elastic strain, on the rank of the body."""

    def __init__(
        self, part: BlockPart, bodies: Sequence[FloatingBody], probe: ElongationProbe
    ) -> None:
        """Find the body and the coordinates."""
        number = [body.name for body in bodies].index(probe.body)
        self._weights, self._block = _along(bodies[number], probe), part.block
        elements = part.elements
        assert isinstance(elements, FloatingBodies)
        self._found = next((g.only(number) for g in elements.groups if number in g.body), None)

    def update(self) -> FloatArray:
        """See :class:`flexfem.layout.family.Sensor`."""
        if self._found is None:
            return np.zeros(1)
        block = self._block
        _, eta = self._found.coordinates(block.frames, block.velocity, block.acceleration)
        strains = self._found.strains(eta[:, :, 0])[0]
        return np.array([strains[: len(self._weights)] @ self._weights])


class BodyMissing:
    """Relative displacement that a body misses, on its rank."""

    def __init__(
        self, part: BlockPart, bodies: Sequence[FloatingBody], probe: ReductionErrorProbe
    ) -> None:
        """Find the body."""
        number, self._block = [body.name for body in bodies].index(probe.body), part.block
        elements = part.elements
        assert isinstance(elements, FloatingBodies)
        self._found = next((g.only(number) for g in elements.groups if number in g.body), None)

    def update(self) -> FloatArray:
        """See :class:`flexfem.layout.family.Sensor`."""
        if self._found is None:
            return np.zeros(1)
        block = self._block
        _, eta = self._found.coordinates(block.frames, block.velocity, block.acceleration)
        missing, moved = self._found.missing(eta)
        return missing / moved if moved[0] > 0.0 else np.zeros(1)


def _along(body: FloatingBody, probe: ElongationProbe) -> FloatArray:
    """Weights of the interfaces' coordinates in the elongation; those of the frame are zero."""
    first, second = probe.interfaces(body)
    places = [body.reduced.interfaces[i].position for i in (first, second)]
    direction = (places[1] - places[0]) / np.linalg.norm(places[1] - places[0])
    weights = np.zeros((len(body.reduced.interfaces), 6))
    weights[first, :3], weights[second, :3] = -direction, direction
    own: FloatArray = weights[body.relative].ravel()
    return own
