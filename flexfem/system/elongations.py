# SPDX-License-Identifier: LGPL-3.0-or-later
"""What measures elongations of beams and of bodies in floating frames."""

import numpy as np

from flexfem._types import FloatArray
from flexfem.elements.floating_bodies import FloatingBodies
from flexfem.elements.se3_beam import SE3Beams
from flexfem.model.floating_body import FloatingBody
from flexfem.model.measured import ElongationProbe
from flexfem.model.model import Model
from flexfem.system.placement import BEAMS, FLOATING
from flexfem.system.system import System

__all__ = ["BeamElongation", "BodyElongation"]


class BeamElongation:
    """Extension of this rank's elements of an SE(3) beam times their lengths."""

    def __init__(self, system: System, model: Model, probe: ElongationProbe) -> None:
        """Find the elements."""
        self._part = next(part for part in system.parts if part.kind == BEAMS)
        beams = self._part.elements
        assert isinstance(beams, SE3Beams)
        names = [beam.name for beam in model.beams]
        self._beams = beams
        self._cells = np.flatnonzero(beams.body == names.index(probe.body))

    def update(self) -> FloatArray:
        """See :class:`flexfem.system.gauges.Gauge`."""
        strains, _ = self._beams.resultants(self._part.block.frames, self._cells)
        return np.array([strains[:, 0] @ self._beams.lengths[self._cells]])


class BodyElongation:
    """Displacement by stress of two interfaces against one another, on the rank of the body."""

    def __init__(self, system: System, model: Model, probe: ElongationProbe) -> None:
        """Find the body and the coordinates."""
        self._block, self._found = None, None
        names = [body.name for body in model.floating_bodies]
        number, body = names.index(probe.body), model[probe.body]
        self._weights = _along(body, probe)
        for part in system.parts:
            if part.kind == FLOATING:
                bodies = part.elements
                assert isinstance(bodies, FloatingBodies)
                self._block = part.block
                self._found = next(
                    (g.only(number) for g in bodies.groups if number in g.body), None
                )

    def update(self) -> FloatArray:
        """See :class:`flexfem.system.gauges.Gauge`."""
        if self._found is None or self._block is None:
            return np.zeros(1)
        block = self._block
        _, eta = self._found.coordinates(block.frames, block.velocity, block.acceleration)
        strains = self._found.strains(eta[:, :, 0])[0]
        return np.array([strains[: len(self._weights)] @ self._weights])


def _along(body: FloatingBody, probe: ElongationProbe) -> FloatArray:
    """Weights of the interfaces' coordinates in the elongation; the frame's own are none."""
    first, second = probe.interfaces(body)
    places = [body.reduced.interfaces[i].position for i in (first, second)]
    direction = (places[1] - places[0]) / np.linalg.norm(places[1] - places[0])
    weights = np.zeros((len(body.reduced.interfaces), 6))
    weights[first, :3], weights[second, :3] = -direction, direction
    own: FloatArray = weights[body.relative].ravel()
    return own
