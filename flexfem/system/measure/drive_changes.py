# SPDX-License-Identifier: LGPL-3.0-or-later
"""Changes of drives from step to step: their work, its uncertainty, and jumps."""

from __future__ import annotations

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.constraints.batch import Constraints
from flexfem.core.laws import LawKind
from flexfem.core.row import RowKind
from flexfem.kernels.compiled import kernel, subroutine

__all__ = ["DriveChanges", "isolated"]

#: Ratio of a change to those before and after it above which it is a jump.
_TIMES = 5.0
#: Jump of a rate relative to the largest rate above which it is reported: motions prescribed point
#: by point have smaller ones at each point.
_PART = 0.5
#: Rows of the history of a row: its last sum, and the changes of the last four steps.
_WIDTH = 5
#: Record of a jump: 1 for the value or 2 for the rate, its size and the end of the step.
_KIND, _SIZE, _TIME = range(3)


@subroutine
def isolated(before: float, middle: float, after: float) -> bool:
    """Return True if a change is much larger than its neighbours."""
    return abs(middle) > _TIMES * max(abs(before), abs(after))


@kernel
def _work(
    rows: IntArray, forces: FloatArray, sums: FloatArray, mean: bool, last: FloatArray,
    work: FloatArray,
) -> None:  # fmt: skip
    """Add the work that rows do on bodies; ``last`` (2, k) forces and sums are updated."""
    for k in range(rows.size):
        r = rows[k]
        way, change = sums[r] - last[1, k], 0.5 * (forces[r] - last[0, k])
        work[0] -= (forces[r] if mean else forces[r] - change) * way
        work[1] += abs(change * way)
        last[0, k], last[1, k] = forces[r], sums[r]


@kernel
def _notice(
    sums: FloatArray, least: FloatArray, t: float, h: float, steps: int,
    past: FloatArray, largest: FloatArray, jumps: FloatArray,
) -> None:  # fmt: skip
    """Append the change of the last step to the history, and record a jump that it shows."""
    for k in range(sums.size):
        d = past[k]
        d[1], d[2], d[3] = d[2], d[3], d[4]
        d[4] = sums[k] - d[0]
        d[0] = sums[k]
        largest[k] = max(largest[k], abs(d[4]) / h)
        if steps >= 4 and isolated(d[2], d[3], d[4]) and abs(d[3]) > least[k]:
            if jumps[k, _KIND] != 1.0:
                jumps[k, _KIND], jumps[k, _SIZE], jumps[k, _TIME] = 1.0, d[3], t - h
        elif steps >= 5 and jumps[k, _KIND] != 1.0:
            bend = (d[3] - d[2]) / h
            alone = isolated((d[2] - d[1]) / h, bend, (d[4] - d[3]) / h)
            if alone and abs(bend) > max(least[k], abs(jumps[k, _SIZE])):
                jumps[k, _KIND], jumps[k, _SIZE], jumps[k, _TIME] = 2.0, bend, t - h


class DriveChanges:
    """The driven rows that this rank owns.

    Attributes:
        work: (2,) their work on bodies so far, J, and half of its absolute difference to the work
            with the forces at the ends of the steps instead of those at their starts: the possible
            error if forces oscillate from step to step.
        rows: (k,) their numbers, without drives that rotate directions instead of moving targets,
            and without components of wrenches at markers.
        wrenches: (m,) numbers of these.
        complete: True if all driven rows are included.
    """

    def __init__(self, rows: Constraints, size: float) -> None:
        """Read the accepted state.

        Args:
            rows: rows of all joints.
            size: size of the model, m.
        """
        self._table = rows
        driven = rows.working & (rows.owned > 0.0)
        turning = np.zeros(rows.size, dtype=np.bool_)
        turning[rows.row_of_term[rows.kinds == RowKind.AXES]] = True
        self.complete = not bool((driven & turning).any())
        acting = np.zeros(rows.size, dtype=np.bool_)
        acting[rows.row_of_term[(rows.kinds == RowKind.TWIST) & (rows.factors != 0.0)]] = True
        acting |= rows.of_elements & rows.on_lines
        self.wrenches: IntArray = np.flatnonzero(driven & acting).astype(np.int64)
        self._powers = self._wrench_powers()
        self.rows: IntArray = np.flatnonzero(driven & ~turning & ~acting).astype(np.int64)
        angles = np.zeros(rows.size, dtype=np.bool_)
        angles[rows.row_of_term[rows.kinds == RowKind.ANGLE]] = True
        # a motion of less than a ten-thousandth of the model's size is not a jump
        self._least: FloatArray = 1e-4 * np.where(angles[self.rows], 1.0, size)
        self._held: BoolArray = rows.elastic[self.rows, 0] == LawKind.RIGID
        # constraint equations are at their targets; forces act at any value
        self._all_held = bool(self._held.all())
        self._storing = rows.storing
        self._stores, self._pulls = bool(self._storing.any()), np.zeros(rows.size)
        stiff = self._storing & (rows.owned > 0.0) & (rows.elastic[:, 1] > 0.0)
        self._springs = np.flatnonzero(stiff)
        if self._stores:
            self._at_one, self._stiffness = self._energies_at_one()
        self._angles = angles
        values = self._values()[self.rows]
        self._last = np.array([self._forces()[self.rows], values])
        self._past = np.zeros((len(self.rows), _WIDTH))
        self._past[:, 0] = values
        self._largest, self._jumps = np.zeros(len(self.rows)), np.zeros((len(self.rows), 3))
        self._steps = 0
        self.work = np.zeros(2)

    def _values(self) -> FloatArray:
        """(r,) sums of the rows, or targets of moved springs; valid for the driven ones only."""
        rows = self._table
        if self._all_held:
            return rows.targets
        return np.where(self._storing, rows.targets, rows.sums()) if self._stores else rows.sums()

    def _forces(self) -> FloatArray:
        """(r,) forces that work on bodies, or elastic ones that work on moved springs.

        Dampers that see the motion of their rest are moved as well.
        """
        rows = self._table
        if not self._stores:
            return rows.forces
        _, pulls = rows.stored()
        before, self._pulls = self._pulls, pulls
        # beside forces that are means over the step
        elastic = self._storing & (rows.target_rates == 0.0)
        return np.where(elastic, 0.5 * (before + pulls) if rows.mean_forces else pulls, rows.forces)

    def _energies_at_one(self) -> tuple[FloatArray, FloatArray]:
        """Energy over stiffness of the moved springs, and their stiffness."""
        stiffness = self._table.elastic[self._springs, 1]
        return self._table.stored()[0][self._springs] / stiffness, stiffness

    def follow(self) -> None:
        """Add the work since the last call to that so far."""
        rows = self._table
        if self._stores:
            at_one, stiffness = self._energies_at_one()
            self.work[0] += 0.5 * float((stiffness - self._stiffness) @ (self._at_one + at_one))
            self._at_one, self._stiffness = at_one, stiffness
        values = self._values()
        if rows.split:
            self._follow_impulses(values[self.rows])
        _work(self.rows, self._forces(), values, rows.mean_forces, self._last, self.work)
        if len(self.wrenches):
            (t0, F0, v0), self._powers = self._powers, self._wrench_powers()
            t1, F1, v1 = self._powers
            way = 0.5 * (t1 - t0) * (v0 + v1)
            self.work -= 0.5 * float((F0 + F1) @ way), -0.5 * abs(float((F1 - F0) @ way))

    def _follow_impulses(self, values: FloatArray) -> None:
        """Add the work of impulses on the driven rows, which have such values (k,) now."""
        rows, own = self._table, self.rows
        multiplied = ~(self._storing & (rows.target_rates == 0.0))[own]
        means = rows.impulses[own] * multiplied
        self.work[0] -= float(means @ (values - self._last[1]))
        self._last[0] = np.where(multiplied, rows.entering[own], self._last[0])

    def _wrench_powers(self) -> tuple[float, FloatArray, FloatArray]:
        """Time (s), wrench components (N, N m) and the twists along them."""
        rows, own = self._table, self.wrenches
        return rows.instant, rows.forces[own], rows.rates()[own]

    def forget(self) -> None:
        """Discard the history of steps: an event may have changed locked rows."""
        self._steps = 0

    def notice(self, t: float, h: float) -> None:
        """Detect jumps after a whole step of size ``h`` (s) that ended at ``t`` (s)."""
        self._steps += 1
        _notice(
            self._last[1], self._least, t, h, self._steps, self._past, self._largest, self._jumps
        )  # fmt: skip

    def jumps(self) -> list[tuple[int, str]]:
        """Numbers of the joints that have jumped on this rank, each with a text on the jump."""
        found = []
        for k in np.flatnonzero(self._held & (self._jumps[:, _KIND] > 0.0)):
            kind, size, t = self._jumps[k].tolist()
            if kind == 2.0 and abs(size) < _PART * self._largest[k]:
                continue
            row = int(self.rows[k])
            joint = self._table.joints[self._table.joint_of_row[row]]
            unit = "rad" if self._angles[row] else "m"
            what = "its drive jumps" if kind == 1.0 else "the rate of its drive jumps"
            per = "" if kind == 1.0 else "/s"
            text = f"{joint.joint.owner}: {what} by {abs(size):.4g} {unit}{per}"
            found.append((joint.index, f"{text} in the step to t = {t:.6g} s"))
        return found
