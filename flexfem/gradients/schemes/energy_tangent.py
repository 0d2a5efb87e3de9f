# SPDX-License-Identifier: LGPL-3.0-or-later
"""Exact derivatives of the equations of an energy-momentum step, by its end and by its start.

Mean forces of a step are those of the step from its end to its start, of size -h and with the
dissipation -chi (``integrators.energy_momentum.mechanics.StepPart.exchanged``). The derivatives by
the start are hence those of the other step by its end, for which elements, masses and rows have
exact ones. With ``f0`` the forces in the axes at the start, and ``R1^T R0`` from there to the end,

``dF = R1^T R0 (df0 + theta_0 x f0)``.

All matrices depend linearly on the change of rates with increments, which separates their parts by
positions and by rates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from flexfem._types import FloatArray
from flexfem.gradients.equations.kernels import add_products, add_transposed_products
from flexfem.gradients.equations.step_tangent import (
    POSITIONS,
    STEP,
    BlockVectors,
    add_row_forces,
    collected,
    places_of,
    put_steps,
    row_changes,
    subtract_from_owners,
)
from flexfem.gradients.equations.unilateral import StateChange, Unilateral
from flexfem.gradients.schemes.energy_nodes import StepPaths
from flexfem.gradients.unilateral.forces import barriers, leave_out_barriers
from flexfem.integrators.energy_momentum.mechanics import StepMechanics, StepPart
from flexfem.system.system import BlockPart, Shifts, System

__all__ = ["EnergyTangent", "StartChange"]

#: Matrices by positions at fixed rates, and by rates.
_STILL, _RATES = 0, 1


@dataclass(frozen=True)
class StartChange:
    """Changes of the start of a step, or factors of them, for each block.

    Attributes:
        twists: (n_owned, w) local twists at fixed rates.
        paths: (n_owned, w) twists with which increments would change as rates do.
        rates: (n_owned, w) rates of increments, for contacts.
        before: (n_owned, w) local twists at the start of the last step.
        local: (n_owned, w) local velocities, which count at the start of a motion.
    """

    twists: BlockVectors
    paths: BlockVectors
    rates: BlockVectors
    before: BlockVectors
    local: BlockVectors


class _End:
    """Matrices of all parts, and of the rows, by the nodes at one end of a step.

    Attributes:
        values: those by positions and those by rates, for each part.
        loads: (n_owned, w) forces of each block that do not turn with its nodes, in their axes.
        jacobian: (t, 2, 6) derivatives of the rows.
        hessians: (pairs, 12, 12) of their forces.
    """

    def __init__(self, system: System) -> None:
        self._system = system
        self.places = [places_of(part) for part in system.parts]
        self.values: list[list[FloatArray]] = []
        self.loads: BlockVectors = []
        self.jacobian = np.zeros((0, 2, 6))
        self.hessians = np.zeros((0, 12, 12))

    def multiply(self, matrices: Sequence[int], *, transposed: bool) -> None:
        """Add products of the blocks' matrices and steps to the residuals (collective)."""
        product = add_transposed_products if transposed else add_products
        for part, places, every in zip(self._system.parts, self.places, self.values, strict=True):
            block = part.block
            for matrix in matrices:
                first = 0
                for rows, columns in places:
                    if first == len(every[matrix]):
                        break  # no others
                    own = every[matrix][first:]
                    product(rows, columns, own, block.width, block.step, block.residual)
                    first += block.width**2 * rows.size * columns.shape[1]
            block.add_ghosts()

    def turn(self, *, transposed: bool) -> None:
        """Add the change of the rows' forces and of loads along the steps to the residuals."""
        system, hessians = self._system, self.hessians
        turned = _moments if transposed else _turned
        for part, loads in zip(system.parts, self.loads, strict=True):
            part.block.owned_residual[:] -= turned(part.block.owned_step, loads)
        if transposed:
            hessians = np.ascontiguousarray(hessians.transpose(0, 2, 1))
        forces = system.constraints.turning_forces(hessians, system.interface.steps)
        subtract_from_owners(system, -forces)


class EnergyTangent:
    """Derivatives at a trial state, see the module.

    Attributes:
        system: the system.
        forces: those that elements and rows do not have.
        first: True in the first step of a motion.
        paths: of the nodes of all blocks.
    """

    turning = False

    def __init__(
        self, system: System, mechanics: StepMechanics, forces: Sequence[Unilateral]
    ) -> None:
        """Store the system and its equations."""
        self.system, self._mechanics, self.forces = system, mechanics, tuple(forces)
        self._end, self._start = _End(system), _End(system)
        self._loads: BlockVectors = []
        # in the numerical dissipation: by twists at the start and at that of the last step
        self._dissipates = mechanics.chi > 0.0
        self._last = [_End(system), _End(system)]
        self.first = False
        self.paths: list[StepPaths] = []

    def take(self, shifts: Shifts) -> None:
        """Compute the derivatives at the trial state, whose multipliers are set (collective).

        Residuals of blocks and rows are left evaluated.
        """
        system, mechanics, rows = self.system, self._mechanics, self.system.constraints
        parts = [mechanics.over(part) for part in system.parts]
        self.paths = [StepPaths.of(one.state, one.block.owned) for one in parts]
        both = parts, [part.exchanged() for part in parts]
        self._take_loads(*both)
        forces = self._forces(shifts)
        pairs = zip(self.paths, forces, strict=True)
        self._loads = [by.turned(own, back=True) for by, own in pairs]
        for one in self.forces:
            one.take(shifts)
        values = partial(self._values, mechanics)
        self._end.values = [values(*pair) for pair in zip(system.parts, parts, strict=True)]
        self._end.jacobian = rows.step_jacobian.copy()
        self._end.hessians = mechanics.rows.hessians(rows.multipliers)
        for other in both[1]:
            if other.elements is not None:
                other.elements.exchange(other.state)
        self._start.values = [values(*pair) for pair in zip(system.parts, both[1], strict=True)]
        self._start.jacobian = mechanics.rows.start_jacobian()
        self._start.hessians = mechanics.rows.start_hessians(rows.multipliers)
        for own in parts:
            mechanics.begin_elements(own)
        if self._dissipates:
            self._take_last(parts)

    def _take_loads(self, parts: Sequence[StepPart], exchanged: Sequence[StepPart]) -> None:
        """Turn loads inside elements at each end of the step to the axes at the other one."""
        half, factors = 0.5 * self._mechanics.weight, self._mechanics.factors
        for end, others, back in ((self._end, exchanged, False), (self._start, parts, True)):
            end.loads = [
                half * by.turned(other.inner_loads(factors), back=back)
                for by, other in zip(self.paths, others, strict=True)
            ]

    def _take_last(self, parts: Sequence[StepPart]) -> None:
        """Compute derivatives by changes over the last step."""
        every = [
            (np.zeros(0), np.zeros(0)) if one.elements is None else self._mechanics.by_last(one)
            for one in parts
        ]
        jacobians = self._mechanics.rows.by_last()
        for k, end in enumerate(self._last):
            end.values = [[values[k].ravel()] for values in every]
            end.jacobian = jacobians[k]

    def _forces(self, shifts: Shifts) -> BlockVectors:
        """Evaluate all equations; returns those of the blocks without contacts (collective)."""
        system, mechanics = self.system, self._mechanics
        factors = [(one, one.factor) for one in barriers(system)]
        if factors:
            leave_out_barriers(system)
            mechanics.evaluate(system, shifts)
            found = [part.block.owned_residual.copy() for part in system.parts]
            for contacts, factor in factors:
                contacts.factor = factor
        mechanics.evaluate(system, shifts)
        return found if factors else [part.block.owned_residual.copy() for part in system.parts]

    @staticmethod
    def _values(mechanics: StepMechanics, part: BlockPart, own: StepPart) -> list[FloatArray]:
        """Entries of the matrices of a part by positions and by rates, in the order of places."""
        width, weight, every = part.block.width, mechanics.weight, []
        rate = own.state.law[2]
        for change in (0.0, rate):
            own.state.law[2] = change
            found = [] if own.elements is None else [own.elements.tangent(own.state, weight)]
            found += own.inner_tangents(mechanics.factors, weight)
            found += [
                one[:, :width, :width]
                for one in (
                    own.masses(len(part.masses.nodes), weight),
                    own.forces(part.forces, mechanics.factors, weight),
                )
            ]
            every.append(np.concatenate([one.ravel() for one in found]))
        return [every[0], every[1] - every[0]]

    def apply(
        self, blocks: BlockVectors, multipliers: FloatArray, matrix: int = STEP
    ) -> tuple[BlockVectors, FloatArray]:
        """Change of the equations of blocks and of rows (r,) by the end (collective).

        Args:
            blocks: local twists.
            multipliers: (r,) changes of L, the same on all ranks that have a row.
            matrix: that of the step, or that by positions at fixed rates.
        """
        system, rows = self.system, self.system.constraints
        put_steps(system, blocks)
        self._end.multiply(_of(matrix), transposed=False)
        self._end.turn(transposed=False)
        system.add_constraint_forces(multipliers)
        for one in self.forces:
            one.add()
        changes = row_changes(system, self._end.jacobian) - rows.yielding(multipliers)
        return collected(system), changes

    def apply_transposed(
        self, blocks: BlockVectors, multipliers: FloatArray, matrix: int = STEP
    ) -> tuple[BlockVectors, FloatArray]:
        """The transposed of :meth:`apply` (collective)."""
        system, rows = self.system, self.system.constraints
        put_steps(system, blocks)
        self._end.multiply(_of(matrix), transposed=True)
        self._end.turn(transposed=True)
        for one in self.forces:
            one.add_transposed()
        changes = rows.changes(system.interface.steps) - rows.yielding(multipliers, transposed=True)
        add_row_forces(system, self._end.jacobian, multipliers)
        return collected(system), changes

    def turned(self, blocks: BlockVectors) -> BlockVectors:
        """There are no directors."""
        return blocks

    turned_transposed = turned

    def by_rates(self, blocks: BlockVectors) -> BlockVectors:
        """Change of the equations by rates at the end, given as local twists (collective)."""
        put_steps(self.system, blocks)
        self._end.multiply((_RATES,), transposed=False)
        return collected(self.system)

    def by_rates_transposed(self, blocks: BlockVectors) -> BlockVectors:
        """The transposed of :meth:`by_rates` (collective)."""
        put_steps(self.system, blocks)
        self._end.multiply((_RATES,), transposed=True)
        return collected(self.system)

    def by_start(self, change: StartChange) -> tuple[BlockVectors, FloatArray]:
        """Change of the equations of blocks and of rows (r,) by the start (collective)."""
        system = self.system
        put_steps(system, change.paths)
        self._start.multiply((_RATES,), transposed=False)
        rated = [part.block.owned_residual.copy() for part in system.parts]
        put_steps(system, change.twists)
        self._start.multiply((_STILL,), transposed=False)
        self._start.turn(transposed=False)
        rows = row_changes(system, self._start.jacobian)
        found = []
        for k, part in enumerate(system.parts):
            own = part.block.owned_residual + rated[k] + _turned(change.twists[k], self._loads[k])
            found.append(self.paths[k].turned(own))
        if self._dissipates:
            last, more = self._by_last(change)
            found = [a + b for a, b in zip(found, last, strict=True)]
            rows = rows + more
        for part in system.parts:
            part.block.residual[:] = 0.0
        start = StateChange(change.twists, change.rates)
        for one in self.forces:
            rows = rows + one.add_start(start)
        pairs = zip(system.parts, found, strict=True)
        return [p.block.hold(p.block.owned_residual + own) for p, own in pairs], rows

    def _by_last(self, change: StartChange) -> tuple[BlockVectors, FloatArray]:
        """Change of the equations in the numerical dissipation (collective)."""
        system = self.system
        total = [np.zeros_like(own) for own in change.twists]
        rows = np.zeros(system.constraints.size)
        seen = change.local if self.first else change.before
        for end, twists, at in zip(
            self._last, (change.twists, change.before), (change.twists, seen), strict=True
        ):
            put_steps(system, at)
            rows = rows + row_changes(system, end.jacobian)
            put_steps(system, twists)
            end.multiply((0,), transposed=False)
            total = [a + b for a, b in zip(total, collected(system), strict=True)]
        return total, rows

    def _by_last_transposed(self, z: BlockVectors, mu: FloatArray) -> StartChange:
        """The transposed of :meth:`_by_last` (collective)."""
        system, found, seen = self.system, [], []
        for end in self._last:
            put_steps(system, z)
            end.multiply((0,), transposed=True)
            found.append(collected(system))
            for part in system.parts:
                part.block.residual[:] = 0.0
            add_row_forces(system, end.jacobian, mu)
            seen.append(collected(system))
        twists = [a + b for a, b in zip(found[0], seen[0], strict=True)]
        nothing = [np.zeros_like(own) for own in z]
        if self.first:
            return StartChange(twists, nothing, nothing, found[1], seen[1])
        before = [a + b for a, b in zip(found[1], seen[1], strict=True)]
        return StartChange(twists, nothing, nothing, before, nothing)

    def by_start_transposed(self, z: BlockVectors, mu: FloatArray) -> StartChange:
        """The transposed of :meth:`by_start` (collective)."""
        system = self.system
        back = [by.turned(own, back=True) for by, own in zip(self.paths, z, strict=True)]
        put_steps(system, back)
        self._start.multiply((_RATES,), transposed=True)
        paths = [part.block.owned_residual.copy() for part in system.parts]
        put_steps(system, back)
        self._start.multiply((_STILL,), transposed=True)
        self._start.turn(transposed=True)
        add_row_forces(system, self._start.jacobian, mu)
        twists = [
            part.block.owned_residual + _moments(own, loads)
            for part, own, loads in zip(system.parts, back, self._loads, strict=True)
        ]
        rates = [np.zeros_like(own) for own in z]
        for one in self.forces:
            start = one.start_transposed(z, mu)
            twists = [a + b for a, b in zip(twists, start.twists, strict=True)]
            rates = [a + b for a, b in zip(rates, start.rates, strict=True)]
        before = local = [np.zeros_like(own) for own in z]
        if self._dissipates:
            last = self._by_last_transposed(z, mu)
            twists = [a + b for a, b in zip(twists, last.twists, strict=True)]
            before, local = last.before, last.local
        return StartChange(twists, paths, rates, before, local)


def _of(matrix: int) -> tuple[int, ...]:
    """Matrices of which one of a step is the sum."""
    return {STEP: (_STILL, _RATES), POSITIONS: (_STILL,)}[matrix]


def _turned(twists: FloatArray, loads: FloatArray) -> FloatArray:
    """Changes ``theta x f`` (n, w) of loads with rotations."""
    found = np.zeros_like(loads)
    if loads.shape[1] == 6:
        found[:, :3] = np.cross(twists[:, 3:], loads[:, :3])
        found[:, 3:] = np.cross(twists[:, 3:], loads[:, 3:])
    return found


def _moments(factors: FloatArray, loads: FloatArray) -> FloatArray:
    """The transposed of :func:`_turned`."""
    found = np.zeros_like(loads)
    if loads.shape[1] == 6:
        found[:, 3:] = np.cross(loads[:, :3], factors[:, :3])
        found[:, 3:] += np.cross(loads[:, 3:], factors[:, 3:])
    return found
