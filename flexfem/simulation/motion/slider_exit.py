# SPDX-License-Identifier: LGPL-3.0-or-later
"""Detection of sliders that leave the lines they slide on."""

from mpi4py import MPI

import numpy as np

from flexfem.core.joint import Joint
from flexfem.core.marker import Carrier
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
        room = np.array([_room(model, joint) for joint, _ in self._joints]).reshape(-1, 2)
        beyond = np.array([getattr(joint, "beyond", 0.0) for joint, _ in self._joints])
        self._lower = -room[:, 0] * lengths - beyond
        self._upper = (1.0 + room[:, 1]) * lengths + beyond
        self._lengths = lengths
        names = [joint.name for joint, _ in self._joints]
        rows = system.constraints
        self._own = [
            (names.index(placed.joint.name), i)
            for i, placed in enumerate(rows.joints)
            if placed.owned and placed.joint.name in names
        ]

    def found(self) -> bool:
        """Return True if a slider has left at the last evaluation of the rows (collective).

        Released sliders are not checked.
        """
        if not self._joints:
            return False
        zeta, rows = np.zeros(len(self._joints)), self._system.constraints
        for k, i in self._own:
            holds = rows.active[rows.start[i] : rows.start[i + 1]].any()
            zeta[k] = rows.lines.arc(i) if holds else 0.5 * self._lengths[k]
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


def _room(model: Model, joint: Joint) -> tuple[float, float]:
    """Return the distances a slider may be beyond both ends, relative to the carrier's length."""
    stops = [stop for stop in model.joints if isinstance(stop, SlideStop) and stop.joint is joint]
    return (
        _FREE if all(stop.lower is None for stop in stops) else _STOPPED,
        _FREE if all(stop.upper is None for stop in stops) else _STOPPED,
    )
