# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sensors of probes that are not functions of markers.

Sensors of probes of single families are in these. A sensor returns the share of this rank in the
columns of its probe; the columns are the sums over all ranks.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.joint import Joint
from flexfem.core.marker import SurfaceMarker
from flexfem.joints.cable import Cable
from flexfem.layout.family import Sensor
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.lie.vectors import cross
from flexfem.model.contact import ContactProbe
from flexfem.model.probes.aggregate import AggregateProbe
from flexfem.model.probes.base import AnyProbe
from flexfem.model.probes.cable import CableProbe
from flexfem.model.probes.measured import EnergyProbe, MomentumProbe, ReactionProbe
from flexfem.system.measure.aggregate import Aggregate
from flexfem.system.measure.energies import EnergyMeter, refresh_rows
from flexfem.system.measure.momenta import MomentumMeter
from flexfem.system.system import System

__all__ = ["RowSensor", "create_sensor"]


class RowSensor(ABC):
    """Measurement of the forces of a joint's rows, on the rank that owns the joint.

    Attributes:
        width: number of columns.
        forced: number of the first ones, which depend on forces.
        joints: numbers of the joints of this rank with a name: those of lines of shells have
            parts, of which this rank has its own; then others whose forces are theirs, too.
    """

    width: ClassVar[int]
    forced: ClassVar[int]

    def __init__(self, system: System, name: str, others: Sequence[int] = ()) -> None:
        """Find the joint; ``others`` are numbers of joints on this rank that go with it."""
        self._system, rows = system, system.constraints
        self.joints = [
            k
            for k, placed in enumerate(rows.joints)
            if placed.joint.name == name and (placed.owned or not placed.joint.joins_lines)
        ]
        self.joints += others
        self._owned = any(rows.joints[k].owned for k in self.joints)
        self._foreign = [
            slice(rows.start[k], rows.start[k + 1]) for k in self.joints if not rows.joints[k].owned
        ]

    @abstractmethod
    def values(self, forces: FloatArray) -> FloatArray:
        """Columns of forces (r,) of all rows, which are evaluated; on each rank with the joint."""

    def update(self) -> FloatArray:
        """See :class:`flexfem.layout.family.Sensor` (collective)."""
        forces = self._system.reported_forces()
        if not self._owned:
            return np.zeros(self.width)
        refresh_rows(self._system)
        if self._foreign:
            forces = forces.copy()
            for rows in self._foreign:
                forces[rows] = 0.0
        return self.values(forces)


class _ReactionSensor(RowSensor):
    """Force and moment of a joint on the body of its marker b.

    For a joint of lines it is the resultant of its parts, about the first part's marker: a node of
    the line, or the marker of a body. Inertia and weight of a cable with mass reach the body over
    the tie of its last node.
    """

    width: ClassVar[int] = 6
    forced: ClassVar[int] = 6

    def __init__(self, system: System, probe: ReactionProbe, joint: Joint) -> None:
        super().__init__(system, probe.joint, _last_tie(system, joint))
        self._axes, rows = probe.axes, system.constraints
        self._first = rows.marker_start[self.joints]
        second = np.array([rows.joints[k].joint.second for k in self.joints], dtype=np.int64)
        self._markers = self._first + second

    def values(self, forces: FloatArray) -> FloatArray:
        rows = self._system.constraints
        at, wrenches = rows.poses[self._markers, :3], rows.reactions(forces)[self._markers]
        arms = cross(at - at[0], wrenches[:, :3])
        force, moment = wrenches[:, :3].sum(axis=0), (wrenches[:, 3:] + arms).sum(axis=0)
        if self._axes == "inertial":
            return np.concatenate([force, moment])
        R = se3.rotation(rows.poses[self._first[0] if self._axes == "a" else self._markers[0]])
        return np.concatenate([force @ R, moment @ R])


def _last_tie(system: System, joint: Joint) -> list[int]:
    """Number of the joint on this rank that keeps the last node of a cable with mass, if any."""
    if not isinstance(joint, Cable) or not joint.mass_per_length:
        return []
    node = joint.name, (len(joint.path) - 1,)
    ends = [(k, placed.joint.a) for k, placed in enumerate(system.constraints.joints)]
    return [k for k, a in ends if isinstance(a, SurfaceMarker) and (a.body, a.nodes) == node]


class _CableSensor(RowSensor):
    """Tensions and stretch of a part of a cable."""

    width: ClassVar[int] = 3
    forced: ClassVar[int] = 2

    def __init__(self, system: System, probe: CableProbe, cable: Cable) -> None:
        super().__init__(system, probe.cable)
        rows, mine = system.constraints, self.joints
        numbers = cable.part_rows[probe.part :]
        self._rows = rows.start[mine] + numbers[0]
        last = rows.start[1:][mine] if len(numbers) == 1 else rows.start[mine] + numbers[1]
        self._guides = [np.arange(r + 1, end) for r, end in zip(self._rows, last, strict=True)]

    def values(self, forces: FloatArray) -> FloatArray:
        rows = self._system.constraints
        end = forces[self._rows]
        first = end + forces[self._guides[0]].sum()
        stretch = rows.sums()[self._rows] - rows.targets[self._rows]
        return np.concatenate([first, end, stretch])


class _ContactSensor:
    """Penetration and forces of a contact."""

    def __init__(self, system: System, probe: ContactProbe) -> None:
        self._system, self._name = system, probe.contact

    def update(self) -> FloatArray:
        return self._system.contacts[0].measure(self._name)


def create_sensor(probe: AnyProbe, system: System, serial: NumberedModel) -> Sensor | None:
    """Sensor of a probe (collective), None for functions of markers."""
    match probe:
        case AggregateProbe():
            return Aggregate(system, serial, probe)
        case ContactProbe():
            return _ContactSensor(system, probe)
        case EnergyProbe():
            return EnergyMeter(system, serial.model, probe.bodies)
        case MomentumProbe():
            return MomentumMeter(system, serial.model, probe.bodies)
        case CableProbe():
            return _CableSensor(system, probe, serial.model[probe.cable])
        case ReactionProbe():
            return _ReactionSensor(system, probe, serial.model[probe.joint])
    sensors = (part.family.sensor(probe, part) for part in system.parts)
    return next((sensor for sensor in sensors if sensor is not None), None)
