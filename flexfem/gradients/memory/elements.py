# SPDX-License-Identifier: LGPL-3.0-or-later
"""States of force elements, which are integrated with the motion.

At the end of a step ``z1 = z0 + a w0 + b g0 + c g(z1, motion)``, the rates g1 are those there, and
``w1 = (z1 - z0 - first w0)/last``; see ``constraints.elements.states``. Explicit laws act by their
forces at the state before the step. Where accelerations are computed again, ``z1 = z0``, ``w1`` is
g1, and explicit laws act by their forces there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray
from flexfem.constraints.elements.group import ElementGroup
from flexfem.constraints.elements.marker_changes import MarkerChanges
from flexfem.constraints.elements.states import AT_REST, StateStep
from flexfem.core.state import State
from flexfem.gradients.equations.step_tangent import BlockVectors, forces_on_blocks, put_steps
from flexfem.gradients.equations.values import Equations
from flexfem.gradients.memory.base import Memory, StepEnd
from flexfem.simulation.motion.stepping import Simulation
from flexfem.system.system import System

__all__ = ["ElementMemory"]


@dataclass(frozen=True)
class _Linear:
    """Derivatives of the elements of a group, whose carried numbers are p for each.

    Attributes:
        group: the group.
        rows: (e, r, p) of its rows' equations by the numbers before the step.
        numbers: (e, p, p) of the numbers after it by those before it.
        motion: for each set of elements, (k, p, t, 2, 6) of the numbers by positions and by rates.
    """

    group: ElementGroup
    rows: FloatArray
    numbers: FloatArray
    motion: list[tuple[MarkerChanges, tuple[FloatArray, FloatArray]]]


class ElementMemory(Memory):
    """States of all force elements of a rank; ranks that share an element have the same numbers."""

    def __init__(self, system: System, state: Callable[[int], State]) -> None:
        """Find them.

        Args:
            system: of the motion.
            state: the accepted state after a step.
        """
        self._system, self._state = system, state
        rows = system.constraints
        owned = [
            np.repeat(rows.owned[group.rows[:, 0]] > 0.0, _width(group))
            for group in rows.elements.groups
        ]
        self.owned = np.concatenate([Memory.owned, *owned])
        self._linear: list[_Linear] = []

    def start(self, simulation: Simulation) -> FloatArray:
        """See :class:`Memory`."""
        groups = simulation.system.constraints.elements.groups
        return _numbers([(one, (one.z0, one.g0, one.w0, one.held)) for one in groups])

    def take(self, end: StepEnd) -> None:
        """See :class:`Memory`."""
        rows = self._system.constraints
        still = np.array([0.0, end.shifts.scale])
        self._linear = []
        motions = rows.elements.motions(rows)
        for (group, motion), sets in zip(motions, rows.elements.sets, strict=True):
            law = group.exactly(motion, end.states)
            by_rows, numbers, ends = _derivatives(group, law, end.states)
            scale = rows.compliance[group.rows] * end.shifts.scale
            count = 6 * group.law.size
            place, twist = (
                np.ascontiguousarray(ends[:, :, part])
                for part in (np.s_[:count], np.s_[count : 2 * count])
            )
            along = []
            for some in sets:
                fixed = rows.elements.along(rows, place, twist, some, still)
                whole = rows.elements.along(rows, place, twist, some, end.shifts.dynamics)
                along.append((some, (fixed, whole - fixed)))
            self._linear.append(_Linear(group, scale[:, :, np.newaxis] * by_rows, numbers, along))

    def equations(self, change: FloatArray) -> Equations:
        """See :class:`Memory`."""
        rows = np.zeros(self._system.constraints.size)
        for one, own in self._by_group(change):
            rows[one.group.rows] += np.einsum("erp,ep->er", one.rows, own)
        return [np.zeros_like(part.block.owned_step) for part in self._system.parts], rows

    def ahead(self, change: FloatArray, moves: Sequence[BlockVectors]) -> FloatArray:
        """See :class:`Memory`."""
        found = [np.einsum("epq,eq->ep", one.numbers, own) for one, own in self._by_group(change)]
        for k, blocks in enumerate(moves):
            put_steps(self._system, blocks)
            steps = np.append(self._system.interface.steps, np.zeros((1, 6)), axis=0)
            for one, own in zip(self._linear, found, strict=True):
                for some, along in one.motion:
                    own[some.members] += np.einsum("kptsi,ktsi->kp", along[k], steps[some.nodes])
        return np.concatenate([np.zeros(0), *(own.ravel() for own in found)])

    def gather(self, sums: FloatArray) -> Sequence[BlockVectors]:
        """See :class:`Memory`."""
        forces = np.zeros((2, len(self._system.interface.keys) + 1, 6))
        for one, own in self._by_group(sums):
            for some, along in one.motion:
                for k in range(2):
                    parts = np.einsum("kptsi,kp->ktsi", along[k], own[some.members])
                    np.add.at(forces[k], some.nodes, parts)
        return [forces_on_blocks(self._system, own[:-1]) for own in forces]

    def back(self, sums: FloatArray, z: BlockVectors, mu: FloatArray) -> FloatArray:
        """See :class:`Memory`."""
        found = [np.zeros(0)]
        for one, own in self._by_group(sums):
            before = np.einsum("epq,ep->eq", one.numbers, own)
            before -= np.einsum("erp,er->ep", one.rows, mu[one.group.rows])
            found.append(before.ravel())
        return np.concatenate(found)

    def recall(self, simulation: Simulation, step: int) -> None:
        """See :class:`Memory`."""
        simulation.system.constraints.elements.restore(self._state(step - 1))

    def moved(self, simulation: Simulation, end: StepEnd, change: FloatArray) -> FloatArray:
        """See :class:`Memory`."""
        rows = simulation.system.constraints
        return _numbers(
            [(one, one.arrived(motion, end.states)) for one, motion in rows.elements.motions(rows)]
        )

    def _by_group(self, numbers: FloatArray) -> list[tuple[_Linear, FloatArray]]:
        """Derivatives of each group with its numbers (e, p)."""
        found, at = [], 0
        for one in self._linear:
            shape = one.numbers.shape[:2]
            size = shape[0] * shape[1]
            found.append((one, numbers[at : at + size].reshape(shape)))
            at += size
        return found


def _width(group: ElementGroup) -> int:
    """Number p of what an element carries: z, g, w, and forces of explicit laws."""
    return 3 * group.law.states + (group.rows.shape[1] if group.law.explicit else 0)


def _numbers(groups: Sequence[tuple[ElementGroup, Sequence[FloatArray]]]) -> FloatArray:
    """What all elements carry, (n,)."""
    found = [np.zeros(0)]
    for group, parts in groups:
        own = np.concatenate(parts if group.law.explicit else parts[:3], axis=1)
        found.append(own.ravel())
    return np.concatenate(found)


def _derivatives(
    group: ElementGroup, law: FloatArray, step: StateStep
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Derivatives of the elements of a group at the end of a step.

    Args:
        group: the group.
        law: (e, r + n, 12 m + n) derivatives of the law.
        step: of the states.

    Returns:
        (e, r, p) of the forces by the numbers before the step, (e, p, p) of the numbers after it by
        those before it, and (e, p, 12 m) by displacements and twists of the markers.
    """
    (e, r), n, explicit = group.rows.shape, group.law.states, group.law.explicit
    split = law.shape[2] - n
    f_x, f_z = law[:, :r, :split], law[:, :r, split:]
    g_x, g_z = law[:, r:, :split], law[:, r:, split:]
    one = np.eye(n)
    begin = np.zeros((n, _width(group)))  # z0 + a w0 + b g0
    begin[:, : 3 * n] = np.hstack([one, step.by_rate * one, step.by_auxiliary * one])
    follow = np.linalg.inv(one - step.gain * g_z)
    z_s, z_x = follow @ begin, step.gain * (follow @ g_x)
    rates = g_z @ z_s, g_x + g_z @ z_x
    before = np.zeros((n, _width(group)))  # z0 + first w0
    before[:, : 3 * n] = np.hstack([one, 0.0 * one, step.first * one])
    begins = step is AT_REST
    after = rates if begins else ((z_s - before) / step.last, z_x / step.last)
    numbers, motion = [z_s, rates[0], after[0]], [z_x, rates[1], after[1]]
    rows = f_z @ z_s
    if explicit:
        numbers.append(rows)
        motion.append(f_x + f_z @ z_x)
    if explicit and not begins:
        rows = np.broadcast_to(np.eye(r, _width(group), 3 * n), (e, r, _width(group)))
    return rows, np.concatenate(numbers, axis=1), np.concatenate(motion, axis=1)
