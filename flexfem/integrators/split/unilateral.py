# SPDX-License-Identifier: LGPL-3.0-or-later
"""What acts by impulses: forces over a step whose work is the change of what they store."""

from abc import ABC, abstractmethod

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.constraints.rows.step_laws import (
    RowsOverStep,
    any_beyond,
    begin_step,
    divide_rows,
    evaluate_over_step,
    open_rows,
)
from flexfem.contact.barrier.contacts import BarrierContacts
from flexfem.core.row import RowKind
from flexfem.system.system import Shifts, System

__all__ = ["Unilateral", "UnilateralContacts", "UnilateralRows"]


class Unilateral(ABC):
    """Unilateral forces F of a system, generalised forces of its blocks.

    Over a step they are discrete derivatives: the product of F and the increments of the nodes is
    minus the change of the energy that they store, or less by what they dissipate.
    """

    @abstractmethod
    def begin(self, h: float, weight: float) -> None:
        """Start a step of size ``h`` (s) at the accepted state, that of the interface (collective).

        In the equations of the step the forces are multiplied by ``weight``.
        """

    @abstractmethod
    def evaluate(self, shifts: Shifts) -> None:
        """Forces at the trial state, after rows and blocks have been evaluated (collective).

        They are added to the blocks' residuals, or are those of rows, times weight and
        ``shifts.scale``.
        """

    @property
    @abstractmethod
    def acting(self) -> bool:
        """True if there were forces at the last evaluation, on this rank."""

    @abstractmethod
    def add_means(self, shifts: Shifts) -> None:
        """Subtract the mean forces F of the step from the blocks' residuals."""

    @abstractmethod
    def read_means(self, shifts: Shifts, out: FloatArray) -> None:
        """Write the mean forces of the step of rows (r,) to ``out``."""

    @property
    @abstractmethod
    def pressing(self) -> bool:
        """True if forces leave the accepted accelerations, or join them, on this rank."""

    @abstractmethod
    def add_pressing(self) -> None:
        """Subtract forces that leave, less those that join, from the blocks' residuals.

        Rows are evaluated at the accepted state, with unscaled multipliers.
        """

    @abstractmethod
    def read_pressing(self, out: FloatArray) -> None:
        """Write the same of rows (r,) to ``out``."""

    @property
    def opened(self) -> bool:
        """True if forces in the accepted accelerations have ended in the step, on this rank."""
        return False

    def release(self, *, every: bool) -> None:
        """Let these forces leave, or ``every`` one in the accepted accelerations."""
        return

    def accept(self) -> None:
        """Take note that the trial state of the step is accepted."""
        return


class UnilateralContacts(Unilateral):
    """Contacts, whose forces are added by the blocks' own residuals."""

    def __init__(self, contacts: BarrierContacts) -> None:
        """Store the contacts of a system."""
        self._contacts = contacts

    def begin(self, h: float, weight: float) -> None:
        """See :class:`Unilateral`."""
        self._contacts.begin_step(h, weight)

    def evaluate(self, shifts: Shifts) -> None:
        """See :class:`Unilateral`."""

    @property
    def acting(self) -> bool:
        """See :class:`Unilateral`."""
        return any(one.count for one in self._contacts.contacts)

    def add_means(self, shifts: Shifts) -> None:
        """See :class:`Unilateral`."""
        self._contacts.subtract_means()

    @property
    def pressing(self) -> bool:
        """See :class:`Unilateral`."""
        return self._contacts.pressing

    def add_pressing(self) -> None:
        """See :class:`Unilateral`."""
        self._contacts.subtract_means()
        self._contacts.factor = 0.0

    def read_means(self, shifts: Shifts, out: FloatArray) -> None:
        """See :class:`Unilateral`."""

    def read_pressing(self, out: FloatArray) -> None:
        """See :class:`Unilateral`."""

    def accept(self) -> None:
        """See :class:`Unilateral`."""
        self._contacts.end_step(0.0)


class UnilateralRows(Unilateral):
    """Rows that are slack between limits: stops, slack springs and cables, backlash.

    One that stays closed is no impact: its force is a part of the scheme until it opens. That is so
    from a start at which it is closed, unless steps do not resolve what it does then, and after
    many steps in which its force hardly changes.
    """

    def __init__(self, system: System) -> None:
        """Set up the work space."""
        rows = self._rows = system.constraints
        self._system = system
        self._chosen = rows.unilateral
        numbers = np.flatnonzero(self._chosen).astype(np.int64)
        self._over = RowsOverStep(
            chosen=numbers, frames0=np.zeros_like(rows.interface.frames),
            poses0=np.zeros_like(rows.poses), sums0=np.zeros(rows.size),
            values0=np.zeros(rows.size), gradients0=np.zeros_like(rows.force_jacobian),
            nodes0=rows.term_nodes.copy(), forces=np.zeros(len(numbers)),
            values=np.zeros(len(numbers)), size=1.0, weight=1.0,
        )  # fmt: skip
        self._numbers, self._apart = numbers, np.ones(len(numbers), dtype=np.bool_)
        self._leaving, self._joining = np.zeros((2, len(numbers)), dtype=np.bool_)
        self._within, self._open = numbers[:0], np.zeros(0, dtype=np.bool_)
        kinds = rows.kinds[self._chosen[rows.row_of_term]]
        inexact = bool(((kinds < 0) | (kinds > RowKind.ANGLE)).any())
        self._inexact: bool = rows.comm.allreduce(inexact, op=MPI.LOR)

    def begin(self, h: float, weight: float) -> None:
        """See :class:`Unilateral`."""
        over = self._over
        over.size, over.weight = h, weight
        self._leaving[:] = False
        self._divide()
        self.restart()

    def restart(self) -> None:
        """Start the same step at the state of the interface."""
        rows, over = self._rows, self._over
        if not len(over.chosen):
            return
        if self._inexact:
            rows.evaluate(_UNSCALED)
        else:
            rows.place_markers()
        begin_step(rows.own.memory, rows.interface.interface_nodes.memory, over.memory)

    def _divide(self) -> bool:
        """Sort the rows: impulses, or forces of the scheme. True if some are to join the latter."""
        rows, over = self._rows, self._over
        changed, some = divide_rows(
            rows.own.memory, self._numbers, rows.forces, rows.settled, _SETTLED, self._apart,
            self._joining,
        )  # fmt: skip
        if changed:
            over.chosen = self._numbers[self._apart]
            over.forces, over.values = np.zeros((2, len(over.chosen)))
            self._within = self._numbers[~self._apart & rows.active[self._numbers]]
            self._open = np.zeros(len(self._within), dtype=np.bool_)
        return some

    def evaluate(self, shifts: Shifts) -> None:
        """See :class:`Unilateral`."""
        rows, over = self._rows, self._over
        if not len(over.chosen):
            return
        evaluate_over_step(
            rows.own.memory, rows.interface.interface_nodes.memory, over.memory, shifts.dynamics
        )
        rows.hold_gradients()

    @property
    def acting(self) -> bool:
        """See :class:`Unilateral`."""
        return bool(self._over.forces.any())

    def add_means(self, shifts: Shifts) -> None:
        """See :class:`Unilateral`."""
        means = np.zeros(self._rows.size)
        self.read_means(shifts, means)
        self._system.add_constraint_forces(means)

    def read_means(self, shifts: Shifts, out: FloatArray) -> None:
        """See :class:`Unilateral`."""
        chosen = self._over.chosen
        out[chosen] = self._rows.multipliers[chosen] / (shifts.scale * self._over.weight)

    @property
    def pressing(self) -> bool:
        """See :class:`Unilateral`."""
        return self._divide() or bool(self._leaving.any())

    def add_pressing(self) -> None:
        """See :class:`Unilateral`."""
        forces = np.zeros(self._rows.size)
        self.read_pressing(forces)
        self._system.add_constraint_forces(forces)

    def read_pressing(self, out: FloatArray) -> None:
        """See :class:`Unilateral`."""
        rows, leaving, joining = (
            self._rows,
            *(self._numbers[some] for some in (self._leaving, self._joining)),
        )
        out[leaving] = rows.forces[leaving]
        if len(joining):
            out[joining] = -rows.laws_forces()[joining]

    @property
    def opened(self) -> bool:
        """See :class:`Unilateral`."""
        if not len(self._within):
            return False
        rows = self._rows
        rows.place_markers()
        return open_rows(rows.own.memory, self._within, rows.forces, self._open)

    @property
    def holding(self) -> bool:
        """True if rows have forces in the accepted accelerations, on this rank."""
        return len(self._within) > 0

    @property
    def met(self) -> bool:
        """True if a row was beyond its limits at the last evaluation of rows, on this rank."""
        return any_beyond(self._rows.own.memory, self._numbers)

    def _beyond(self, which: IntArray, values: FloatArray) -> FloatArray:
        """(k,) distances by which values of rows are beyond their limits."""
        laws = self._rows.elastic[which]
        return values - np.clip(values, laws[:, 3], laws[:, 4])

    def release(self, *, every: bool) -> None:
        """See :class:`Unilateral`."""
        rows = self._rows
        self._leaving[:] = rows.forces[self._numbers] != 0.0
        if not every:
            self._leaving &= np.isin(self._numbers, self._within[self._open])
        rows.settled[self._numbers[self._leaving]] = 0.0

    def let_go(self, h: float) -> None:
        """Let closed rows leave the accelerations of a start that a step does not resolve.

        Collective. In a step of size ``h`` (s) such an acceleration a would open its row, of
        stretch s: ``h^2/2 abs(G a) > s``. The scheme would go on with it, and with a spectral
        radius below 1 the velocity after the step had more energy than all springs. By impulses
        they keep it.
        """
        system, rows, which = self._system, self._rows, self._numbers
        rows.evaluate(_UNSCALED, elements=False)
        for part in system.parts:
            block = part.block
            block.owned_step[:] = block.acceleration[: block.owned, : block.width]
            block.spread_step()
        system.interface.update_steps()
        moves = 0.5 * h * h * np.abs(rows.changes(system.interface.steps)[which])
        stretches = np.abs(self._beyond(which, (rows.sums() - rows.targets)[which]))
        some = bool((moves > stretches)[rows.forces[which] != 0.0].any())
        if system.comm.allreduce(some, op=MPI.LOR):
            self.release(every=True)

    def accept(self) -> None:
        """See :class:`Unilateral`."""
        rows, over = self._rows, self._over
        if not self.acting:
            rows.settled[:] = 0.0
            return
        ends = over.values0[over.chosen], over.values
        first, last = (self._beyond(over.chosen, values) for values in ends)
        steady = first * last > 0.0
        steady &= np.abs(last - first) <= _STEADY * np.abs(first)
        rows.settled[over.chosen] = np.where(steady, rows.settled[over.chosen] + 1.0, 0.0)


#: Relative change of a row's stretch in a step up to which it counts as closed for good, and number
#: of such steps in a row: half a wave of a sine has so many from 47 steps on.
_STEADY, _SETTLED = 0.05, 20.0
#: Factors with which rows are evaluated at a state, not as part of a time step.
_UNSCALED = np.array([1.0, 1.0])
