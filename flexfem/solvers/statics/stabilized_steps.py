# SPDX-License-Identifier: LGPL-3.0-or-later
"""Regularised (shifted) Newton method towards stable equilibria.

A multiple of their initial diagonals is added to the blocks' matrices, which does not change the
equilibrium: a step of Newton's method for a body in a viscous fluid. If contacts close within a
step, it is shortened to the point where they balance the driving forces.
"""

from math import isfinite

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.contacts import Contacts
from flexfem.core.status import Status
from flexfem.kernels.sequence import largest_entry
from flexfem.solvers.linear.tangent import on_diagonals
from flexfem.solvers.statics.equilibrium import Equilibrium
from flexfem.system.mechanics import END_POINT
from flexfem.system.moving_apart import Moved

__all__ = ["HeldEquilibrium"]

#: Stabilisation relative to the initial diagonal: smallest, largest, and factors of its change.
_SMALLEST, _LARGEST, _GROWTH, _DECAY = 1e-12, 1e6, 10.0, 0.1
#: Force that the stabilisation may carry at the end, relative to the loads, and relative to the
#: size of the model, which is round-off.
_HIDDEN, _NOTHING = 1e-6, 1e-16
#: Ratio of the work of the forces at the end of a step to that at its start below which the step is
#: too large; the first factor by which it is shortened, and the number of trials.
_TOO_FAR, _SHORTER, _TRIALS = -0.5, 0.9, 60


class HeldEquilibrium(Equilibrium):
    """Equilibrium by regularised steps that descend in energy and are short enough."""

    _hold = _used = _SMALLEST
    _load = 0.0

    @property
    def memory(self) -> FloatArray:
        """(2,) stabilisation with which the next load step begins, nearly zero at first."""
        return np.array([self._hold, self._used])

    @memory.setter
    def memory(self, values: FloatArray) -> None:
        self._hold, self._used = values.tolist()

    def solve(self, t: float, fraction: float = 1.0) -> Status:
        """See :class:`Equilibrium`."""
        self.loading.set(t, fraction)
        self._load = self._largest_load()
        return self.iterate(self._held_step)

    def _largest_load(self) -> float:
        """Largest force of the loads and initial strains that act now (collective)."""
        system, scale, largest = self.system, self.shifts.scale, 0.0
        for part in system.parts:
            part.add_residual(system.gravity, system.factors, scale)
            force = part.block.owned_residual.copy()
            part.add_residual(np.zeros(3), np.zeros_like(system.factors), scale)
            force -= part.block.owned_residual
            largest = max(largest, largest_entry(force[:, :3].ravel()))
        return self.largest(max(largest, self._largest_initial()))

    def _largest_initial(self) -> float:
        """Largest force, or moment by the size of the model, of initial strains on this rank."""
        system, largest = self.system, 0.0
        if not system.strained:
            return largest
        held = self.loading.inner_forces(self.shifts.scale)
        system.set_initial_strains(0.0)
        free = self.loading.inner_forces(self.shifts.scale)
        system.set_initial_strains(self.loading.fraction)
        for a, b in zip(held, free, strict=True):
            change = (a - b) / np.repeat([1.0, self.size], 3)[: a.shape[1]]
            largest = max(largest, largest_entry(change.ravel()))
        return largest

    def _held_step(self) -> tuple[bool, FloatArray, float]:
        """Step from the evaluated residuals; see ``LinearStep`` (collective)."""
        system, tangent, weights = self.system, self.tangent, self.weights
        rows = system.constraints
        blocks = [p.block.owned_residual for p in system.parts]
        longest = min([1.0, *(c.longest_step / self.size for c in system.contacts)])
        self.assemble()
        tangent.add_at_nodes(self.turning())
        added = 0.0
        while self._hold < _LARGEST:
            more, added = self._hold - added, self._hold
            tangent.add_at_nodes([on_diagonals(more * w) for w in weights])
            system.counters.factorizations += 1
            if self.inertia.unstable() == 0 and tangent.factor():
                success = tangent.solve(blocks, rows.values)
                size, turn, failed = self.measure(tangent.multiplier_step, success)
                short = turn <= self.limits.turn and size <= longest
                if isfinite(size) and not failed and short:
                    self._used = self._hold
                    self._hold = max(_DECAY * self._hold, _SMALLEST)
                    return True, tangent.multiplier_step, 0.0
            self._hold *= _GROWTH
        self._hold = _SMALLEST
        return False, np.zeros(rows.size), 0.0

    def _balanced(self) -> bool:
        """Return True if the shift carried no part of the loads in the last step (collective)."""
        force = max(
            largest_entry((w[:, :3] * p.block.owned_step[:, :3]).ravel())
            for w, p in zip(self.weights, self.system.parts, strict=True)
        )
        limit = max(_HIDDEN * self._load, _NOTHING * self.size)
        return not self._used * self.largest(force) > limit

    def _advance(self, change: FloatArray, load: float) -> Moved:
        """Move by the blocks' steps, shortened where contacts close, and the multipliers' step.

        The work that the forces do on the step is followed along it. The force of a contact is
        almost linear in the overshoot, so that secants converge to the balance.
        """
        system = self.system
        if not any(isinstance(contacts, Contacts) for contacts in system.contacts):
            return self.move(-1.0, change, load)
        steps = [part.block.owned_step.copy() for part in system.parts]
        start = self.keep()
        before = self._work(steps)
        points: list[tuple[float, float]] = []  # factors that are too large, and works
        factor = 1.0
        for _ in range(_TRIALS):
            self.move(-factor, change, 0.0)
            END_POINT.evaluate(system, self.shifts)
            work = self._work(steps)
            if not work < _TOO_FAR * abs(before):
                break
            points.append((factor, work))
            self.put_back(start)
            for part, step in zip(system.parts, steps, strict=True):
                part.block.owned_step[:] = step
            factor = _secant(points)
        for contacts in system.contacts:
            contacts.update()
        return Moved(0.0)

    def _work(self, steps: list[FloatArray]) -> float:
        """Work of the residuals on steps, over all ranks."""
        parts = self.system.parts
        local = sum(
            float((s * p.block.owned_residual).sum()) for s, p in zip(steps, parts, strict=True)
        )
        return float(self.system.comm.allreduce(local))


def _secant(points: list[tuple[float, float]]) -> float:
    """Next factor from those that were too large, and their works."""
    last, work = points[-1]
    if len(points) == 1:
        return _SHORTER * last
    other, more = points[-2]
    root = last - work * (other - last) / (more - work) if more != work else 0.0
    return root if 0.0 < root < last else 0.5 * last
