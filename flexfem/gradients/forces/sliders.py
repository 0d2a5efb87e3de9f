# SPDX-License-Identifier: LGPL-3.0-or-later
"""Markers that slide along lines, as functions of the nodes of their joints."""

from __future__ import annotations

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray, IntArray
from flexfem.core.differences import ENOUGH, slopes
from flexfem.core.marker import Observed, SlidingMarker
from flexfem.lie import se3, so3
from flexfem.system.measure.energies import refresh_rows
from flexfem.system.system import System

__all__ = ["SlidingMarkers"]


class SlidingMarkers:
    """Sections of carriers at sliders, on all ranks that have their joints."""

    def __init__(self, system: System, markers: Sequence[Observed]) -> None:
        """Find the joints of those among some markers."""
        self._system, rows = system, system.constraints
        joints = {placed.joint.name: k for k, placed in enumerate(rows.joints)}
        self._exist = any(isinstance(marker, SlidingMarker) for marker in markers)
        self._joints = [
            (place, joints[marker.joint])
            for place, marker in enumerate(markers)
            if isinstance(marker, SlidingMarker) and marker.joint in joints
        ]

    def place(self) -> None:
        """Find the sliders' places at an accepted state to which the system has returned."""
        if self._exist:
            refresh_rows(self._system)

    def back(self, found: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives by local twists and velocities (n, 6) of the interface nodes (collective).

        Args:
            found: (markers, 20) by all markers: positions, rotations, velocities, angular ones,
                accelerations, angular ones, arc length and its rate.

        Raises:
            InputError: there are none, as where a slider passes from an element to the next one.
        """
        sums, off = np.zeros((2, len(self._system.interface.keys), 6)), 0.0
        for place, joint in self._joints:
            weights = np.concatenate([found[place, :12], found[place, 18:]])
            if not weights.any():
                continue
            nodes, own, missed = self._of_joint(joint, weights)
            sums[:, nodes] += own
            off = max(off, missed)
        if not self._system.comm.allreduce(off, op=MPI.MAX) <= ENOUGH:
            raise InputError(
                "gradient: a column of a SlidingMarker has a kink or jumps at t = "
                f"{self._system.time:.6g} s, and has no derivative there"
            )
        return sums[0], sums[1]

    def _of_joint(self, joint: int, weights: FloatArray) -> tuple[IntArray, FloatArray, float]:
        """Nodes of a joint, (2, k, 6) derivatives by these of a section, and their error.

        Args:
            joint: its number.
            weights: (14,) of position, rotation, velocities, arc length and its rate.
        """
        rows, face = self._system.constraints, self._system.interface
        nodes = rows.nodes_of(np.arange(*rows.start[joint : joint + 2]))
        (start,) = rows.lines.motions([joint], face.frames, face.velocities)
        R = se3.rotation(start[:12])

        def value(way: FloatArray) -> float:
            frames, velocities = face.frames.copy(), face.velocities.copy()
            turns, rates = way.reshape(2, -1, 6)
            frames[nodes] = se3.retract(frames[nodes], turns)
            velocities[nodes] += rates
            (now,) = rows.lines.motions([joint], frames, velocities)
            own = se3.rotation(now[:12])
            parts = now[:3], so3.log(own @ R.T), own @ now[12:15], own @ now[15:18], now[18:]
            return float(weights @ np.concatenate(parts))

        found, off = slopes(value, 12 * len(nodes))
        return nodes, found.reshape(2, -1, 6), off
