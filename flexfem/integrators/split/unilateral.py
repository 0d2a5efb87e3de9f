# SPDX-License-Identifier: LGPL-3.0-or-later
"""What acts by impulses: forces over a step whose work is the change of what they store."""

from abc import ABC, abstractmethod

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.barrier.contacts import BarrierContacts
from flexfem.constraints.rows.step_laws import RowsOverStep, evaluate_over_step
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

    @property
    @abstractmethod
    def pressing(self) -> bool:
        """True if the accepted accelerations have forces in them: after a start, on this rank."""

    @abstractmethod
    def add_pressing(self) -> None:
        """Subtract these forces from the blocks' residuals."""

    def end(self) -> None:
        """End a step that has been accepted."""
        return

    @abstractmethod
    def read_means(self, shifts: Shifts, out: FloatArray) -> None:
        """Write the mean forces of the step of rows (r,) to ``out``."""

    @abstractmethod
    def read_pressing(self, out: FloatArray) -> None:
        """Write the forces of rows (r,) in the accepted accelerations to ``out``."""


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
        self._contacts.end_step(0.0)

    def read_means(self, shifts: Shifts, out: FloatArray) -> None:
        """See :class:`Unilateral`."""

    def read_pressing(self, out: FloatArray) -> None:
        """See :class:`Unilateral`."""

    def end(self) -> None:
        """See :class:`Unilateral`."""
        self._contacts.end_step(0.0)


class UnilateralRows(Unilateral):
    """Rows that are slack between limits: stops, slack springs and cables, backlash."""

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
            nodes0=rows.term_nodes.copy(), forces=np.zeros(len(numbers)), size=1.0, weight=1.0,
        )  # fmt: skip
        self._numbers, self._active = numbers, np.ones(len(numbers), dtype=np.bool_)
        kinds = rows.kinds[self._chosen[rows.row_of_term]]
        inexact = bool(((kinds < 0) | (kinds > RowKind.ANGLE)).any())
        self._inexact: bool = rows.comm.allreduce(inexact, op=MPI.LOR)

    def begin(self, h: float, weight: float) -> None:
        """See :class:`Unilateral`."""
        rows, over = self._rows, self._over
        over.size, over.weight = h, weight
        if self._inexact:
            rows.evaluate(_UNSCALED)
        else:
            rows.place_markers()
        over.frames0[:], over.poses0[:] = rows.interface.frames, rows.poses
        over.sums0[:] = rows.sums()
        np.subtract(over.sums0, rows.targets, out=over.values0)
        over.gradients0[:], over.nodes0[:] = rows.force_jacobian, rows.term_nodes
        active = rows.active[self._numbers]
        if (active != self._active).any():
            self._active, over.chosen = active, self._numbers[active]
            over.forces = np.zeros(len(over.chosen))

    def evaluate(self, shifts: Shifts) -> None:
        """See :class:`Unilateral`."""
        rows, over = self._rows, self._over
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

    @property
    def pressing(self) -> bool:
        """See :class:`Unilateral`."""
        return bool(self._rows.forces[self._numbers].any())

    def add_pressing(self) -> None:
        """See :class:`Unilateral`."""
        self._system.add_constraint_forces(np.where(self._chosen, self._rows.forces, 0.0))

    def read_means(self, shifts: Shifts, out: FloatArray) -> None:
        """See :class:`Unilateral`."""
        chosen = self._over.chosen
        out[chosen] = self._rows.multipliers[chosen] / (shifts.scale * self._over.weight)

    def read_pressing(self, out: FloatArray) -> None:
        """See :class:`Unilateral`."""
        out[self._numbers] = self._rows.forces[self._numbers]


#: Factors with which rows are evaluated at a state, not as part of a time step.
_UNSCALED = np.array([1.0, 1.0])
