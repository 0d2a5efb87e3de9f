# SPDX-License-Identifier: LGPL-3.0-or-later
"""Columns of a history in parts, of which each depends on the nodes around one that is moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.families.solid.probes import SolidProbe
from flexfem.gradients.shapes.node_classes import Owners
from flexfem.layout.family import NodalSensor, NodalValues, SumOfValues
from flexfem.model.model import Model
from flexfem.model.probes.aggregate import AggregateProbe
from flexfem.model.probes.base import AnyProbe, Probe
from flexfem.model.probes.measured import (
    ElongationProbe,
    ShellEnergyProbe,
    ShellStrainProbe,
    StrainProbe,
)
from flexfem.system.measure.aggregate import ElementValues
from flexfem.system.measure.probes import ProbeRecorder
from flexfem.system.system import System

__all__ = ["ColumnShares", "Shares"]


#: Probes whose columns are functions of markers, or of values in elements.
_IN_PARTS = (
    Probe, AggregateProbe, ElongationProbe, ShellEnergyProbe, ShellStrainProbe, SolidProbe,
    StrainProbe,
)  # fmt: skip


@dataclass(frozen=True)
class Shares:
    """Parts of columns, or changes of them.

    Attributes:
        markers: (columns,) of probes that are functions of markers, on the first rank; zero of
            others and on other ranks.
        nodal: of the other probes, values (m, c) in elements of this rank, for each part of each.
    """

    markers: FloatArray
    nodal: list[FloatArray]

    def added(self, other: Shares, factor: float) -> Shares:
        """The sum of these and a multiple of others."""
        nodal = [a + factor * b for a, b in zip(self.nodal, other.nodal, strict=True)]
        return Shares(self.markers + factor * other.markers, nodal)


class ColumnShares:
    """Parts of some columns of a model and of its neighbours."""

    def __init__(self, model: Model, columns: Sequence[str], path: str) -> None:
        """Choose the probes of the columns.

        Args:
            model: with the probes.
            columns: their names.
            path: to the nodes, for messages.

        Raises:
            InputError: one is no sum of parts that depend on few nodes each.
        """
        self._probes: list[tuple[int, AnyProbe, slice]] = []
        self._markers = list[int]()
        first = count = 0
        for k, probe in enumerate(model.probes):
            self._markers.append(count)
            count += len(probe.markers)
            if any(name in columns for name in probe.columns):
                if not isinstance(probe, _IN_PARTS):
                    raise InputError(
                        f'gradient: columns of {type(probe).__name__} "{probe.name}" have no '
                        f'derivatives by nodes ("{path}") yet'
                    )
                self._probes.append((k, probe, slice(first, first + len(probe.columns))))
            first += len(probe.columns)
        self._count = first

    def values(self, recorder: ProbeRecorder, model: Model, t: float) -> Shares:
        """Parts at the present state of a model's system, at a time (collective)."""
        markers, nodal = np.zeros(self._count), list[FloatArray]()
        states = recorder.states()  # on the first rank
        for k, own, places in self._probes:
            probe, first = model.probes[k], self._markers[k]
            if not isinstance(own, Probe):
                nodal += [_values(one) for one in _sensor(recorder, own).nodal]
            elif isinstance(probe, Probe) and states:
                seen = states[first : first + len(probe.markers)]
                markers[places] = probe.evaluate(t, seen)
        return Shares(markers, nodal)

    def products(
        self, weights: FloatArray, change: Shares, at: tuple[System, ProbeRecorder], owners: Owners,
        count: int,
    ) -> FloatArray:  # fmt: skip
        """This rank's part of weights times changes, by what they belong to (collective).

        Args:
            weights: (k, columns of the history).
            change: of the parts.
            at: the system and the recorder of the motion or the path, at the present state.
            owners: nodes to which changes belong.
            count: number of nodes.

        Returns:
            (k, count).
        """
        found, read = np.zeros((len(weights), count)), 0
        system, recorder = at
        blocks = [part.block for part in system.parts]
        for k, probe, places in self._probes:
            own = weights[:, places]
            if isinstance(probe, Probe):
                if owners.probes[k] >= 0:
                    found[:, owners.probes[k]] += own @ change.markers[places]
                continue
            sensor = _sensor(recorder, probe)
            nodal = change.nodal[read : read + len(sensor.nodal)]
            read += len(nodal)
            for row, weight in enumerate(own):
                if not weight.any():
                    continue
                parts = zip(sensor.nodal, sensor.linearised(weight), nodal, strict=True)
                for one, (_, by), values in parts:
                    block = next(k for k, block in enumerate(blocks) if block is one.block)
                    of = owners.of_elements(block, one.support)
                    sums = (by * values).sum(axis=1)
                    found[row] += np.bincount(of[of >= 0], sums[of >= 0], minlength=count)
        return found


def _sensor(recorder: ProbeRecorder, probe: AnyProbe) -> NodalSensor:
    """The measurement of a probe, whose columns are known to have derivatives."""
    found = recorder.sensors[probe.name]
    assert isinstance(found, NodalSensor)
    return found


def _values(one: NodalValues) -> FloatArray:
    """Values (m, c) in elements of this rank."""
    assert isinstance(one, SumOfValues | ElementValues)
    values = one.values()
    return values.reshape(len(values), -1)
