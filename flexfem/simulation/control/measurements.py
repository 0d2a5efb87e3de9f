# SPDX-License-Identifier: LGPL-3.0-or-later
"""Measurements of controllers: columns of probes of any kind, the same numbers on every rank."""

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.io.tables.history import AngleColumns
from flexfem.layout.numbered_model import NumberedModel
from flexfem.model.probes.base import AnyProbe, Probe
from flexfem.system.measure.energies import EnergyMeter
from flexfem.system.measure.marker_states import MarkerStates
from flexfem.system.measure.sensors import Sensor, create_sensor
from flexfem.system.system import System

__all__ = ["Measurements"]


class Measurements:
    """Columns of some probes at accepted states.

    Functions of markers are evaluated at every accepted state, since angles are continuous from one
    to the next, and so are energies, whose work is summed up. All others are evaluated on request:
    joint forces and strains may cost as much as evaluating the joints or elements again.

    Attributes:
        columns: names of all columns.
        values: (columns,) the last measurements.
    """

    def __init__(
        self,
        system: System,
        serial: NumberedModel,
        probes: Sequence[AnyProbe],
        often: Sequence[str],
    ) -> None:
        """Find the markers (collective).

        Args:
            system: system whose accepted states are measured.
            serial: serial data of its model.
            probes: probes of the columns.
            often: names of those to be measured at every accepted state.
        """
        self._system, self._serial, self._often = system, serial, often
        # columns of markers come first
        self._probes = [probe for probe in probes if isinstance(probe, Probe)]
        self._sensed = [probe for probe in probes if not isinstance(probe, Probe)]
        own = [column for probe in self._probes for column in probe.columns]
        self.columns = own + [column for probe in self._sensed for column in probe.columns]
        self.values = np.zeros(len(self.columns))
        self._count = len(own)
        markers = [marker for probe in self._probes for marker in probe.markers]
        self._states = MarkerStates(system, serial, markers)
        self._angles = AngleColumns(own, [c for probe in self._probes for c in probe.unwrap])
        self._sensors: list[tuple[Sensor, slice]] = []
        self._frequent: list[tuple[Sensor, slice]] = []  # at every accepted state

    def begin(self) -> None:
        """Set up the meters at the accepted state, from which energies are counted (collective)."""
        self._sensors, self._frequent, at = [], [], self._count
        for probe in self._sensed:
            sensor, width = create_sensor(probe, self._system, self._serial), len(probe.columns)
            assert sensor is not None  # only functions of markers have none
            often = probe.name in self._often or isinstance(sensor, EnergyMeter)
            (self._frequent if often else self._sensors).append((sensor, slice(at, at + width)))
            at += width

    def accepted(self) -> None:
        """Measure the columns needed at every accepted state (collective)."""
        states, at, found = self._states.evaluate(), 0, [np.empty(0)]
        for probe in self._probes:
            count = len(probe.markers)
            found.append(probe.evaluate(self._system.time, states[at : at + count]))
            at += count
        self.values[: self._count] = self._angles.unwrap(np.concatenate(found))
        self._measure(self._frequent)

    def complete(self) -> None:
        """Measure all other columns at the accepted state (collective)."""
        self._measure(self._sensors)

    def _measure(self, sensors: Sequence[tuple[Sensor, slice]]) -> None:
        if not sensors:
            return
        shares = np.concatenate([sensor.update() for sensor, _ in sensors])
        if self._system.comm.size > 1:
            self._system.comm.Allreduce(MPI.IN_PLACE, shares)
        at = 0
        for _, place in sensors:
            width = place.stop - place.start
            self.values[place] = shares[at : at + width]
            at += width

    def state(self) -> dict[str, FloatArray]:
        """The last values, and the sums of energies over all ranks (collective)."""
        sums = np.concatenate([np.empty(0), *(meter.state() for meter in self._meters())])
        self._system.comm.Allreduce(MPI.IN_PLACE, sums)
        return {"controls_angles": self.values, "controls_sums": sums}

    def restore(self, values: FloatArray, sums: FloatArray) -> None:
        """Restore a result of :meth:`state`, at the accepted state it belongs to."""
        self.values = values.copy()
        self._angles.previous = values[: self._count].copy()
        self.begin()
        meters = self._meters()
        shares = sums.reshape(len(meters), EnergyMeter.SHARES) * float(self._system.comm.rank == 0)
        for meter, share in zip(meters, shares, strict=True):
            meter.restore(share)

    def _meters(self) -> list[EnergyMeter]:
        return [sensor for sensor, _ in self._frequent if isinstance(sensor, EnergyMeter)]
