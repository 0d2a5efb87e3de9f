# SPDX-License-Identifier: LGPL-3.0-or-later
"""Columns of forces of joints, as functions of forces of rows and of few nodes."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.core.differences import ENOUGH, slopes
from flexfem.lie import se3
from flexfem.system.measure.energies import refresh_rows
from flexfem.system.measure.sensors import RowSensor
from flexfem.system.system import System

__all__ = ["ForceColumns"]


class ForceColumns:
    """The columns of a probe of a joint, on all ranks that have the joint.

    Attributes:
        forced: number of the first ones, which depend on forces.
    """

    def __init__(self, owner: str, system: System, sensor: RowSensor) -> None:
        """Find its rows and nodes.

        Raises:
            InputError: it joins lines.
        """
        self._owner, self._system, self._sensor = owner, system, sensor
        self.forced = sensor.forced
        rows = system.constraints
        lines = any(rows.joints[k].joint.joins_lines for k in sensor.joints)
        if system.comm.allreduce(lines, op=MPI.LOR):
            raise InputError(
                f"gradient: {owner}: forces of joints of lines have no derivatives yet; take "
                "other columns"
            )
        own = [np.arange(rows.start[k], rows.start[k + 1]) for k in sensor.joints]
        self._rows = np.concatenate([np.empty(0, dtype=np.int64), *own])

    def back(self, weights: FloatArray, forces: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives of weighted columns at an accepted state (collective).

        Args:
            weights: (c,) of the columns.
            forces: (r,) of all rows.

        Returns:
            (n, 6) by local twists of the interface nodes with fixed forces, and (r,) by forces.

        Raises:
            InputError: there are none.
        """
        system, rows, face = self._system, self._system.constraints, self._system.interface
        twists, factors, off = np.zeros((len(face.keys), 6)), np.zeros(rows.size), 0.0
        refresh_rows(system)
        if len(self._rows) and weights.any():
            rest = self._sensor.values(np.zeros(rows.size))
            for row, unit in zip(self._rows, np.eye(rows.size)[self._rows], strict=True):
                factors[row] = weights @ (self._sensor.values(unit) - rest)
            nodes = rows.nodes_of(self._rows)
            frames = face.frames[nodes].copy()

            def value(way: FloatArray) -> float:
                face.frames[nodes] = se3.retract(frames, way.reshape(-1, 6))
                refresh_rows(system)
                return float(weights @ self._sensor.values(forces))

            # of forces and their moments, however they cancel
            size = float(np.abs(weights).max() * np.abs(forces[self._rows]).max(initial=0.0))
            found, off = slopes(value, 6 * len(nodes), size)
            twists[nodes] = found.reshape(-1, 6)
            face.frames[nodes] = frames
            refresh_rows(system)
        if not system.comm.allreduce(off, op=MPI.MAX) <= ENOUGH:
            raise InputError(
                f"gradient: {self._owner} has a kink or jumps at a state, and has no derivative "
                "there"
            )
        return twists, factors
