# SPDX-License-Identifier: LGPL-3.0-or-later
"""Detection of sliders that leave the lines they slide on."""

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.joint import Joint
from flexfem.core.marker import Carrier
from flexfem.core.runs import starts
from flexfem.joints.slide_stop import SlideStop
from flexfem.layout.numbered_model import NumberedModel
from flexfem.model.model import Model
from flexfem.system.system import System

__all__ = ["SliderExit"]

#: Admissible distance of a slider beyond an end of its carrier, relative to the length of that:
#: round-off of a start at the end, and the deformation of a stop there.
_FREE, _STOPPED = 1e-5, 0.1


class SliderExit:
    """Check that all sliders are on their carriers.

    Attributes:
        reason: message on the slider that has left, empty if none has.
    """

    def __init__(self, system: System, serial: NumberedModel) -> None:
        """Find the sliding joints, the same on every rank."""
        model = serial.model
        self.reason, self._system, self._model = "", system, model
        self._joints = [
            (joint, joint.a)
            for joint in model.joints
            if isinstance(joint.a, Carrier) and joint.partner is None
        ]
        lengths = np.array([serial.carrier_line(a).length for _, a in self._joints])
        room = _room(model, [joint for joint, _ in self._joints])
        beyond = np.array([getattr(joint, "beyond", 0.0) for joint, _ in self._joints])
        self._lower = -room[:, 0] * lengths - beyond
        self._upper = (1.0 + room[:, 1]) * lengths + beyond
        self._lengths = lengths
        rows, numbers = system.constraints, {j.name: k for k, (j, _) in enumerate(self._joints)}
        own = [
            (numbers[placed.joint.name], i)
            for i, placed in enumerate(rows.joints)
            if placed.owned and placed.joint.name in numbers
        ]
        self._own = np.array([k for k, _ in own], dtype=np.int64)
        tables = [i for _, i in own]
        self._on_lines = rows.lines.numbers(tables)
        counts = [int(rows.start[i + 1] - rows.start[i]) for i in tables]
        self._first_row, first = starts(counts)[:-1], rows.start[tables]
        self._rows = np.repeat(first - self._first_row, counts) + np.arange(sum(counts))

    def found(self) -> bool:
        """Return True if a slider has left at the last evaluation of the rows (collective).

        Released sliders are not checked.
        """
        if not self._joints:
            return False
        zeta, rows = np.zeros(len(self._joints)), self._system.constraints
        if len(self._own):
            holds = np.logical_or.reduceat(rows.active[self._rows], self._first_row)
            middle = 0.5 * self._lengths[self._own]
            zeta[self._own] = np.where(holds, rows.lines.arcs(self._on_lines), middle)
        if self._system.comm.size > 1:  # one rank owns a joint, the others add zeros
            self._system.comm.Allreduce(MPI.IN_PLACE, zeta, op=MPI.SUM)
        left = np.flatnonzero((zeta < self._lower) | (zeta > self._upper))
        if len(left):
            k = left[0]
            joint, carrier = self._joints[k]
            kind = type(self._model[carrier.body]).__name__
            self.reason = (
                f'{joint.owner}: the slider leaves {kind} "{carrier.body}" of '
                f"{self._lengths[k]:.6g} m at zeta = {zeta[k]:.6g} m"
            )
        return bool(len(left))


def _room(model: Model, joints: Sequence[Joint]) -> FloatArray:
    """Distances (n, 2) of sliders beyond both ends, relative to the length of their carrier."""
    room = np.full((len(joints), 2), _FREE)
    numbers = {id(joint): k for k, joint in enumerate(joints)}
    for stop in model.joints:
        if isinstance(stop, SlideStop) and id(stop.joint) in numbers:
            stopped = np.array([stop.lower is not None, stop.upper is not None])
            room[numbers[id(stop.joint)], stopped] = _STOPPED
    return room
