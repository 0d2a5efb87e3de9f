# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motion of a few markers, known on every rank."""

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.marker import Ground, Marker, Observed
from flexfem.core.nodes.frame_kernels import Nodes
from flexfem.kernels.compiled import kernel
from flexfem.kernels.records import Memory, unpack
from flexfem.kernels.sequence import Call, copy, sequence
from flexfem.layout.element_places import places_on_rank
from flexfem.layout.numbered_model import NumberedModel
from flexfem.model.probes.base import MarkerState
from flexfem.system.measure.sliders import Sliders
from flexfem.system.system import System

__all__ = ["MarkerStates", "without_spin"]

_WIDTH = 26  # frame, local twist, arc length and its rate, rate of the twist


@kernel
def _collect_nodes(memory: Memory, local: IntArray, places: IntArray, out: FloatArray) -> None:
    """Frame, twist and its rate of some ``local`` nodes into rows of ``out`` (n, 26)."""
    nodes = unpack(Nodes, memory)
    for k in range(local.size):
        node, to = local[k], places[k]
        for i in range(12):
            out[to, i] = nodes.frames[node, i]
        for i in range(6):
            out[to, 12 + i] = nodes.velocity[node, i]
            out[to, 20 + i] = nodes.acceleration[node, i]


@kernel
def _marker_motions(
    nodes: FloatArray, offsets: FloatArray, starts: FloatArray, bare: BoolArray, out: FloatArray
) -> None:
    """Motion (m, 33) of markers in inertial axes, see ``MarkerState.of_motions``.

    Args:
        nodes: (m, 26) motion of their nodes, in these nodes' axes.
        offsets: (m, 12) frames of the markers relative to the nodes.
        starts: (m, 3, 3) their rotations at the start.
        bare: (m,) True where spins are unknown.
        out: see above.
    """
    arm, speed, rate = np.empty(3), np.empty(3), np.empty(3)
    for m in range(nodes.shape[0]):
        own, offset, to = nodes[m], offsets[m], out[m]
        spin, turning = own[15:18], own[23:26]
        for i in range(3):
            arm[i] = offset[i]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            speed[i] = own[12 + i] + (spin[j] * arm[k] - spin[k] * arm[j])
            rate[i] = own[20 + i] + (turning[j] * arm[k] - turning[k] * arm[j])
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            rate[i] += spin[j] * speed[k] - spin[k] * speed[j]
        for i in range(3):
            R = own[3 + 3 * i : 6 + 3 * i]
            to[i] = own[i]
            to[12 + i], to[15 + i], to[18 + i], to[21 + i] = 0.0, 0.0, 0.0, 0.0
            for j in range(3):
                to[i] += R[j] * arm[j]
                to[3 + 3 * i + j] = 0.0
                for k in range(3):
                    to[3 + 3 * i + j] += R[k] * offset[3 + 3 * k + j]
                to[12 + i] += R[j] * speed[j]
                to[15 + i] += R[j] * spin[j]
                to[18 + i] += R[j] * rate[j]
                to[21 + i] += R[j] * turning[j]
            for j in range(3):
                to[24 + 3 * i + j] = 0.0
                for k in range(3):
                    to[24 + 3 * i + j] += to[3 + 3 * i + k] * starts[m, j, k]
            if bare[m]:
                to[15 + i] = to[21 + i] = np.nan


class MarkerStates:
    """States of markers at the trial state; every rank gets the same numbers."""

    def __init__(self, system: System, serial: NumberedModel, markers: Sequence[Observed]) -> None:
        """Find the markers on this rank."""
        self._comm, self._system = system.comm, system
        self._sliders = Sliders(system, markers)
        self._offsets = np.array([serial.marker_frame(m) for m in markers]).reshape(-1, 12)
        starts = [serial.marker_pose(m).rotation for m in markers]
        self._starts = np.array(starts).reshape(-1, 3, 3)
        self._start_of_each = list(self._starts)
        self._bare = without_spin(serial, markers)
        self._ground = np.zeros((len(markers), _WIDTH))
        # a marker on the ground is its offset from a fixed node at the origin
        if system.comm.rank == 0:
            for k, marker in enumerate(markers):
                if isinstance(marker, Ground):
                    self._ground[k, [3, 7, 11]] = 1.0
        self._nodes = np.empty_like(self._ground)
        calls = [Call(copy, self._ground, self._nodes)]
        for part in system.parts:
            local = np.array([serial.local_node(m, part.kind, part.block) for m in markers])
            places = np.flatnonzero(local >= 0)
            at = local[places].astype(np.int64)
            calls.append(Call(_collect_nodes, part.block.nodes.memory, at, places, self._nodes))
        self._collect = sequence(calls)
        self._inside = [
            (part.block, points, places)
            for part in system.parts
            for points, places in places_on_rank(serial, part.kind, part.block, markers)
        ]

    def evaluate(self) -> list[MarkerState]:
        """States of all markers (collective)."""
        nodes = self._nodes
        self._collect()
        for block, points, which in self._inside:
            nodes[which, :12], nodes[which, 12:18] = points.motion(block)
            nodes[which, 20:] = points.twist_rates(block)
        if self._sliders.exist:
            self._system.interface.update()
            nodes[self._sliders.places, :20] = self._sliders.motion()
            nodes[self._sliders.places, 20:] = np.nan
        if self._comm.size > 1:  # one rank owns a node, the others add zeros
            self._comm.Allreduce(MPI.IN_PLACE, nodes, op=MPI.SUM)
        motions = np.empty((len(nodes), 33))
        _marker_motions(nodes, self._offsets, self._starts, self._bare, motions)
        return MarkerState.of_motions(motions, self._start_of_each, nodes[:, 18:20].tolist())


def without_spin(serial: NumberedModel, markers: Sequence[Observed]) -> BoolArray:
    """Return flags of markers at nodes without rotations: of shells, of elements in UFL.

    Their axes rotate with the elements around them at the end of a step, but their angular velocity
    is unknown: it is nan, not zero.
    """
    return np.array(
        [isinstance(m, Marker) and not serial.family_of(m.body).axes for m in markers],
        dtype=np.bool_,
    )
