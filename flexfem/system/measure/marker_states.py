# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motion of a few markers, known on every rank."""

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray
from flexfem.core.marker import Ground, Marker, Observed
from flexfem.layout.element_places import places_on_rank
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.model.probes.base import MarkerState
from flexfem.system.measure.sliders import Sliders
from flexfem.system.system import System

__all__ = ["MarkerStates", "without_spin"]

_WIDTH = 26  # frame, local twist, arc length and its rate, rate of the twist


class MarkerStates:
    """States of markers at the trial state; every rank gets the same numbers."""

    def __init__(self, system: System, serial: NumberedModel, markers: Sequence[Observed]) -> None:
        """Find the markers on this rank."""
        self._comm, self._system = system.comm, system
        self._sliders = Sliders(system, markers)
        self._offsets = np.array([serial.marker_frame(m) for m in markers]).reshape(-1, 12)
        self._start = [serial.marker_pose(m).rotation for m in markers]
        self._bare = without_spin(serial, markers)
        self._ground = np.zeros((len(markers), _WIDTH))
        # a marker on the ground is its offset from a fixed node at the origin
        if system.comm.rank == 0:
            for k, marker in enumerate(markers):
                if isinstance(marker, Ground):
                    self._ground[k, [3, 7, 11]] = 1.0
        self._sources = []
        for part in system.parts:
            local = [serial.local_node(m, part.kind, part.block) for m in markers]
            places = [k for k, node in enumerate(local) if node >= 0]
            self._sources.append((part.block, places, [local[k] for k in places]))
        self._inside = [
            (part.block, points, places)
            for part in system.parts
            for points, places in places_on_rank(serial, part.kind, part.block, markers)
        ]

    def evaluate(self) -> list[MarkerState]:
        """States of all markers (collective)."""
        nodes = self._ground.copy()
        for block, places, local in self._sources:
            nodes[places, :12], nodes[places, 12:18] = block.frames[local], block.velocity[local]
            nodes[places, 20:] = block.acceleration[local]
        for block, points, which in self._inside:
            nodes[which, :12], nodes[which, 12:18] = points.motion(block)
            nodes[which, 20:] = points.twist_rates(block)
        if self._sliders.exist:
            self._system.interface.update()
            nodes[self._sliders.places, :20] = self._sliders.motion()
            nodes[self._sliders.places, 20:] = np.nan
        if self._comm.size > 1:  # one rank owns a node, the others add zeros
            self._comm.Allreduce(MPI.IN_PLACE, nodes, op=MPI.SUM)
        frames = se3.compose(nodes[:, :12], self._offsets)
        turn = se3.rotation(nodes[:, :12])
        arm = self._offsets[:, :3]
        spins, turning = nodes[:, 15:18], nodes[:, 23:]
        speed = nodes[:, 12:15] + np.cross(spins, arm)
        rates = nodes[:, 20:23] + np.cross(turning, arm) + np.cross(spins, speed)
        for rotational in (spins, turning):
            rotational[self._bare] = np.nan
        return [
            MarkerState(
                H[:3].copy(), H[3:].reshape(3, 3).copy(), R @ v, R @ spin, float(arc), float(rate),
                start, R @ a, R @ alpha,
            )
            for H, R, v, spin, (arc, rate), start, a, alpha in zip(
                frames, turn, speed, spins, nodes[:, 18:20], self._start, rates, turning,
                strict=True,
            )
        ]  # fmt: skip


def without_spin(serial: NumberedModel, markers: Sequence[Observed]) -> BoolArray:
    """Return flags of markers at nodes without rotations: of shells, of elements in UFL.

    Their axes rotate with the elements around them at the end of a step, but their angular velocity
    is unknown: it is nan, not zero.
    """
    return np.array(
        [isinstance(m, Marker) and not serial.family_of(m.body).axes for m in markers],
        dtype=np.bool_,
    )
