# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cables that leave their sheaves, or run around them too fast to be followed, in a run.

The length around a sheave shrinks to nothing where the cable leaves it, and would become negative:
a real cable would be straight there. Angles are continuous as long as they change by less than half
a turn in a step.
"""

from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.runs import starts
from flexfem.joints.cable import Cable
from flexfem.simulation.watch.gathering import gathered
from flexfem.system.system import System

__all__ = ["WrapWatch", "lost_sheaves"]

#: Angle, rad, by which a cable is off a sheave without a warning: round-off, and a cable that
#: touches it in one point.
_OFF = 1e-6
#: Change in a step, rad, above which it is not known that it was not a full turn less or more.
_JUMP = 2.0


@dataclass(frozen=True)
class _Place:
    """A sheave of a cable on this rank.

    Attributes:
        joint: number of the cable in the model, and of the sheave on it; for the order of texts.
        owner: of the cable in messages.
        most: angle, rad, up to which its mass follows it; infinite without mass.
    """

    joint: tuple[int, int]
    owner: str
    most: float


class WrapWatch:
    """Angles of all cables around their sheaves at the accepted states of a run."""

    def __init__(self, system: System) -> None:
        """Find the sheaves of this rank."""
        self._system, self._places = system, list[_Place]()
        self._cables: list[tuple[int, IntArray, FloatArray]] = []
        for i, placed in enumerate(system.constraints.joints):
            if placed.owned and isinstance(placed.joint, Cable):
                self._add(i, placed.index, placed.joint)
        self._off: dict[int, tuple[float, float]] = {}
        self._jumped: dict[int, tuple[float, float]] = {}
        self._wound: dict[int, tuple[float, float]] = {}
        self._most = np.array([place.most for place in self._places])
        self._last = self._angles()

    def _add(self, i: int, index: int, cable: Cable) -> None:
        shape = cable.shape(self._system.constraints.joints[i].poses)
        placed = self._system.constraints.joints[i]
        first = starts([len(row.terms) for row in placed.rows(0.0)])[cable.part_rows]
        terms = [[first[part] + term for part, term in wrap.touches] for wrap in shape.wraps]
        start = np.array([wrap.angle for wrap in shape.wraps])
        self._cables.append((i, np.array(terms, dtype=np.int64).reshape(-1, 2), start))
        mass = cable.mass_per_length > 0.0
        self._places += [
            _Place((index, w.guide), cable.owner, w.lowest + 2.0 * np.pi if mass else np.inf)
            for w in shape.wraps
        ]

    def _angles(self) -> FloatArray:
        """Angles around all sheaves of this rank, rad."""
        rows = self._system.constraints
        found = [start + rows.angles_of(i)[t].sum(axis=1) for i, t, start in self._cables]
        return np.concatenate([np.zeros(0), *found])

    def look(self) -> None:
        """Look at the accepted state of this rank."""
        if not self._places:
            return
        angles, t = self._angles(), self._system.time
        changes, self._last = np.abs(angles - self._last), angles
        for k in np.flatnonzero(angles < -_OFF).tolist():
            self._off.setdefault(k, (t, float(angles[k])))
        for k in np.flatnonzero(angles > self._most).tolist():
            self._wound.setdefault(k, (t, float(angles[k])))
        for k in np.flatnonzero(changes > _JUMP).tolist():
            self._jumped.setdefault(k, (t, float(changes[k])))

    def texts(self) -> list[str]:
        """Warnings, the same on every rank (collective)."""
        own = {}
        for k, place in enumerate(self._places):
            what = f"{place.owner}: path[{place.joint[1]}]: "
            if k in self._jumped:
                t, change = self._jumped[k]
                own[place.joint] = (
                    f"{what}the cable around it changes by {change:.3g} rad in the step to "
                    f"t = {t:.6g}, which may be a full turn less or more; use smaller steps"
                )
            elif k in self._off:
                t, angle = self._off[k]
                own[place.joint] = (
                    f"{what}the cable has left this sheave at t = {t:.6g} (by {-angle:.3g} rad), "
                    "and is computed as if it were bent round the other way; later results are "
                    "invalid there"
                )
            elif k in self._wound:
                t, angle = self._wound[k]
                own[place.joint] = (
                    f"{what}the cable runs round it by {angle:.3g} rad at t = {t:.6g}, but its "
                    f"mass is that of less than {place.most:.3g} rad, as at the start; later "
                    "results are invalid"
                )
        return gathered(self._system.comm, own)


def lost_sheaves(system: System) -> list[str]:
    """Warnings of one state, the accepted one, the same on every rank (collective)."""
    watch = WrapWatch(system)
    watch.look()
    return watch.texts()
