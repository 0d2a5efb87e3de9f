# SPDX-License-Identifier: LGPL-3.0-or-later
"""Parts of cables with mass that would sag much, in a run.

Parts between guides stay straight. Under its weight q per length across it a part of the length l
and the tension T sags by ``q l^2 / (8 T)``.
"""

from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray
from flexfem.joints.cable import Cable
from flexfem.simulation.watch.gathering import gathered
from flexfem.system.system import System

__all__ = ["SagWatch", "sagging_cables"]

#: Sag relative to the length from which it counts: the part is then longer by 0.24 %.
_SAG = 0.03
#: Part of its weight across a slack part at which it counts as vertical: round-off.
_LEVEL = 1e-6
#: Part of the looks with as much that is worth a warning: no transient of a start.
_OFTEN = 0.1


@dataclass
class _Cable:
    """A cable with mass that this rank owns.

    Attributes:
        index: number in the model.
        cable: the cable.
        row, markers: its row, and its first marker.
        count: of looks that found it sagging.
        worst: largest relative sag, number of its part, tension (N) and time (s).
    """

    index: int
    cable: Cable
    row: int
    markers: int
    count: int = 0
    worst: tuple[float, int, float, float] = (0.0, 0, 0.0, 0.0)


class SagWatch:
    """Sag of all cables with mass at the accepted states of a run."""

    def __init__(self, system: System) -> None:
        """Find the cables of this rank."""
        rows, self._system, self._looks = system.constraints, system, 0
        self._cables = [
            _Cable(placed.index, placed.joint, int(rows.start[i]), int(rows.marker_start[i]))
            for i, placed in enumerate(rows.joints)
            if placed.owned and isinstance(placed.joint, Cable) and placed.joint.mass_per_length
        ]

    def look(self) -> None:
        """Look at the accepted state of this rank."""
        self._looks += 1
        rows, t = self._system.constraints, self._system.time
        for one in self._cables:
            tension = float(rows.forces[one.row] + rows.impulses[one.row])
            count = len(one.cable.path)
            points = rows.poses[one.markers : one.markers + count, :3]
            sags = self._sags(one, points, tension)
            worst = int(np.argmax(sags))
            if sags[worst] > _SAG:
                one.count += 1
            if sags[worst] > one.worst[0]:
                one.worst = float(sags[worst]), worst, tension, t

    def _sags(self, one: _Cable, points: FloatArray, tension: float) -> FloatArray:
        """Relative sags of the straight parts between guides, infinite where it is slack."""
        lines, gravity = points[1:] - points[:-1], self._system.gravity
        along, square = lines @ gravity, gravity @ gravity
        across = np.sqrt(np.maximum((lines * lines).sum(axis=1) * square - along * along, 0.0))
        if tension <= 0.0:
            return np.where(across > _LEVEL * np.abs(along), np.inf, 0.0)
        sags: FloatArray = one.cable.mass_per_length / (8.0 * tension) * across
        return sags

    def texts(self) -> list[str]:
        """Warnings, the same on every rank (collective)."""
        own = {one.index: _text(one) for one in self._cables if one.count > _OFTEN * self._looks}
        return gathered(self._system.comm, own)


def _text(one: _Cable) -> str:
    """Warning of a cable that sags."""
    sag, part, tension, t = one.worst
    much = f"would sag by {100.0 * sag:.3g} % of its length" if np.isfinite(sag) else "would hang"
    return (
        f"{one.cable.owner}: from path[{part}] to path[{part + 1}] it {much} under its weight at "
        f"a tension of {max(tension, 0.0):.4g} N (t = {t:.6g}), and is computed as straight; use a "
        "Beam, or a Catenary where inertia does not matter"
    )


def sagging_cables(system: System) -> list[str]:
    """Warnings of one state, the accepted one, the same on every rank (collective)."""
    watch = SagWatch(system)
    watch.look()
    return watch.texts()
