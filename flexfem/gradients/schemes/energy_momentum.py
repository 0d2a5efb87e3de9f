# SPDX-License-Identifier: LGPL-3.0-or-later
"""A step of the energy-momentum method, linearised.

Its equations ``F(q0, r0, q1, r1, L) = 0`` depend on configurations and rates of both ends, with
``r1 = c path(q0, q1) - (1 - chi)/(1 + chi) r0 + m chi/(1 + chi) h alpha0`` and the mean
accelerations ``alpha1 = (r1 - r0)/h`` of the step, ``c = 2/(h (1 + chi))``, m the memory of the
last step (``integrators.energy_momentum.scheme``). With the maps of
``gradients.schemes.energy_nodes``, ``A = K1 + V1 c P1`` is the matrix of the step, ``V r`` the
change of F with rates. Backwards, from the sums qb, rb of influences of the end of a step, of which
those of alpha1 become ``rb += ab/h``, ``r0b = -ab/h``:

1. ``A^T z + G^T mu = qb + c P1^T rb``;
2. ``rb <- rb - V1^T z``, the influence of the rates at fixed increments;
3. ``r0b += -V0^T z - (1 - chi)/(1 + chi) rb``, ``a0b = m chi/(1 + chi) h rb``;
4. ``q0b = -K0^T z - Phi_0^T mu - c P0^T rb``.

With dissipation stresses depend on strains at the start of the last step as well, of which ``a`` of
``Carried`` is the change.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from flexfem._types import FloatArray
from flexfem.constraints.elements.states import AT_REST
from flexfem.core.differences import STENCIL, differenced
from flexfem.core.state import State
from flexfem.gradients.equations.carried import Carried
from flexfem.gradients.equations.linearized import LinearizedStep
from flexfem.gradients.equations.node_maps import StepMaps, moved, moved_apart
from flexfem.gradients.equations.step_tangent import STEP, BlockVectors
from flexfem.gradients.equations.values import Equations, equations_at
from flexfem.gradients.memory.base import StepEnd
from flexfem.gradients.memory.controllers import recall
from flexfem.gradients.schemes.base import SIZE, Ahead, Recursion, SizeChange, States
from flexfem.gradients.schemes.energy_nodes import (
    NodeRates,
    NodesBefore,
    StepPaths,
    cayley_vectors,
    crossed,
)
from flexfem.gradients.schemes.energy_tangent import EnergyTangent, StartChange
from flexfem.gradients.unilateral.forces import unilateral_forces
from flexfem.integrators.energy_momentum.mechanics import StepMechanics
from flexfem.simulation.motion.stepping import Simulation
from flexfem.system.system import Shifts

__all__ = ["EnergyRecursion", "EnergySteps", "RateLaw"]

#: Derivatives by the configuration at the start of a step, beside those of the step.
_START = STEP + 1


@dataclass(frozen=True)
class RateLaw:
    """Law of the rates at the end of a step of size ``h``, s.

    Attributes:
        path: change with increments, 1/s.
        rates, accelerations: change with the rates and the mean accelerations at the start.
    """

    h: float
    path: float
    rates: float
    accelerations: float

    @classmethod
    def of(cls, h: float, last: float, chi: float) -> RateLaw:
        """Law of a step after another one of size ``last``, s, infinite for none."""
        memory = min(1.0, last / h)
        part = chi / (1.0 + chi)
        return cls(h, 2.0 / (h * (1.0 + chi)), (chi - 1.0) / (1.0 + chi), memory * part * h)


@dataclass(frozen=True)
class _Rates:
    """Sums of influences of rates and mean accelerations of a block, or their changes, (n, w)."""

    r: FloatArray
    alpha: FloatArray


class EnergyRecursion(Recursion):
    """See :class:`flexfem.gradients.schemes.base.Recursion`."""

    maps: list[StepMaps]

    def __init__(
        self, step: int, equations: tuple[LinearizedStep, EnergyTangent], law: RateLaw,
        ends: Sequence[tuple[NodeRates, NodeRates]], *, first: bool,
    ) -> None:  # fmt: skip
        """Store a step.

        Args:
            step: its number.
            equations: linearised at its end.
            law: of its rates.
            ends: maps of all blocks at both ends.
            first: True if there is no step before it.
        """
        self.step, self.maps = step, []
        self.linear, self._tangent = equations
        self._law, self._ends = law, ends
        self._tangent.first = first
        self._before = [NodesBefore.of(at.local, law.h) for at, _ in ends] if first else []

    @property
    def _paths(self) -> list[StepPaths]:
        return self._tangent.paths

    # -- Back -----------------------------------------------------------------------------------

    def arrive(self, carried: Sequence[Carried], memories: Sequence[BlockVectors] | None) -> None:
        """See :class:`flexfem.gradients.schemes.base.Recursion`; memories take nothing."""

    def back(
        self, carried: Sequence[Carried], rows: FloatArray, guess: FloatArray | None,
        accuracy: float | None,
    ) -> FloatArray:  # fmt: skip
        """See :class:`flexfem.gradients.schemes.base.Recursion`."""
        law, tangent, linear = self._law, self._tangent, self.linear
        blocks = [part.block for part in tangent.system.parts]
        after = [_rates_back(own, end) for own, (_, end) in zip(carried, self._ends, strict=True)]
        ends = [one.r + one.alpha / law.h for one in after]
        right = [
            block.hold(own.q + law.path * crossed(by.by_end, r, transpose=True))
            for block, own, by, r in zip(blocks, carried, self._paths, ends, strict=True)
        ]
        solution, _ = linear.solve(right, rows, transposed=True, guess=guess, accuracy=accuracy)
        z, mu = linear.parts(solution)
        by_rates, start = tangent.by_rates_transposed(z), tangent.by_start_transposed(z, mu)
        for k, (own, by) in enumerate(zip(carried, self._paths, strict=True)):
            rates = ends[k] - crossed(by.inverse_end, by_rates[k], transpose=True) / law.path
            before = crossed(by.inverse_start, start.paths[k], transpose=True) / law.path
            own.q = own.a - start.twists[k]
            own.q -= law.path * crossed(by.by_start, rates, transpose=True)
            own.v, own.a = -start.rates[k], -start.before[k]
            if tangent.first:
                self._add_first_back(own, start.local[k], k)
            first = _Rates(
                law.rates * rates - after[k].alpha / law.h - before, law.accelerations * rates
            )
            _add_start_back(own, first, self._ends[k][0])
        return solution

    def _add_first_back(self, own: Carried, local: FloatArray, k: int) -> None:
        """Add influences of what is before the start of a motion, which follows from that."""
        at, before = self._ends[k][0], self._before[k]
        sums = crossed(before.by_local, own.a, transpose=True) - local
        own.q += crossed(before.by_twist, own.a, transpose=True)
        own.q += crossed(at.local_twist, sums, transpose=True)
        own.v = own.v + crossed(at.local_rate, sums, transpose=True)
        own.a = np.zeros_like(own.a)

    # -- Ahead ----------------------------------------------------------------------------------

    def ahead(
        self, carried: Sequence[Carried], changes: Equations,
        size: tuple[SizeChange, float] | None, beside: Sequence[Equations] = (),
    ) -> Ahead:  # fmt: skip
        """See :class:`flexfem.gradients.schemes.base.Recursion`."""
        law = self._law
        (by_start, by_rows), before, rates = self._by_start(carried)
        left = [-(a + b) for a, b in zip(changes[0], by_start, strict=True)]
        solution, _ = self.linear.solve(left, -(changes[1] + by_rows))
        moves, multipliers = self.linear.parts(solution)
        after = []
        for k, (own, x) in enumerate(zip(carried, moves, strict=True)):
            r = rates[k] + law.path * crossed(self._paths[k].by_end, x)
            last = _Rates(r, (r - before[k].r) / law.h)
            found = _accepted(x.copy(), own.q, last, self._ends[k][1])
            if size is not None:
                found.add(Carried(0.0 * x, *size[0].rates[k]), size[1])
            after.append(found)
        return Ahead(after, multipliers, (moves, moves))

    def by_start(self, carried: Sequence[Carried]) -> Equations:
        """Change of the equations by that of the accepted state before the step (collective)."""
        return self._by_start(carried)[0]

    def accepted(self, block: int, last: _Rates) -> Carried:
        """Changes of the accepted state of a block by those of its rates at fixed positions."""
        still = np.zeros_like(last.r)
        return _accepted(still, still, last, self._ends[block][1])

    def _by_start(self, carried: Sequence[Carried]) -> tuple[Equations, list[_Rates], BlockVectors]:
        """The same, and changes of rates at the start, and of those at the end with it alone."""
        law, tangent, paths = self._law, self._tangent, self._paths
        before = [
            _rates_ahead(own, start) for own, (start, _) in zip(carried, self._ends, strict=True)
        ]
        rates = [
            law.rates * first.r + law.accelerations * first.alpha
            - law.path * crossed(by.by_start, own.q)
            for own, first, by in zip(carried, before, paths, strict=True)
        ]  # fmt: skip
        by_end = tangent.by_rates(
            [crossed(by.inverse_end, r) / law.path for by, r in zip(paths, rates, strict=True)]
        )
        seen = [
            crossed(by.inverse_start, first.r) / law.path
            for by, first in zip(paths, before, strict=True)
        ]
        befores, local = self._last(carried)
        change = StartChange(
            [own.q for own in carried], seen, [own.v for own in carried], befores, local
        )
        by_start, by_rows = tangent.by_start(change)
        total = [a + b for a, b in zip(by_end, by_start, strict=True)]
        return (total, by_rows), before, rates

    def _last(self, carried: Sequence[Carried]) -> tuple[BlockVectors, BlockVectors]:
        """Changes at the start of the last step, and of local velocities."""
        local = [
            crossed(at.local_twist, own.q) + crossed(at.local_rate, own.v)
            for own, (at, _) in zip(carried, self._ends, strict=True)
        ]
        if not self._tangent.first:
            return [own.a for own in carried], local
        before = [
            crossed(by.by_twist, own.q) + crossed(by.by_local, v)
            for own, by, v in zip(carried, self._before, local, strict=True)
        ]
        return before, local


def _rates_ahead(own: Carried, at: NodeRates) -> _Rates:
    """Changes of rates and mean accelerations at an accepted state."""
    w = own.w - crossed(at.w_twist, own.q) - crossed(at.w_rate, own.v)
    return _Rates(crossed(at.by_twist, own.q) + crossed(at.by_rate, own.v), crossed(at.mean, w))


def _add_start_back(own: Carried, sums: _Rates, at: NodeRates) -> None:
    """Set and add influences of an accepted state by those of its rates: :func:`_rates_ahead`."""
    own.w = crossed(at.mean, sums.alpha, transpose=True)
    own.q += crossed(at.by_twist, sums.r, transpose=True)
    own.q -= crossed(at.w_twist, own.w, transpose=True)
    own.v = own.v + crossed(at.by_rate, sums.r, transpose=True)
    own.v -= crossed(at.w_rate, own.w, transpose=True)


def _accepted(q: FloatArray, start: FloatArray, last: _Rates, at: NodeRates) -> Carried:
    """Changes of the accepted state after a step."""
    v = crossed(at.rate, last.r - crossed(at.by_twist, q))
    w = crossed(at.w_mean, last.alpha) + crossed(at.w_twist, q) + crossed(at.w_rate, v)
    return Carried(q, v, start.copy(), w)


def _rates_back(own: Carried, at: NodeRates) -> _Rates:
    """Influences of rates and mean accelerations; those of twists are added: :func:`_accepted`."""
    v = own.v + crossed(at.w_rate, own.w, transpose=True)
    r = crossed(at.rate, v, transpose=True)
    own.q = own.q + crossed(at.w_twist, own.w, transpose=True)
    own.q -= crossed(at.by_twist, r, transpose=True)
    return _Rates(r, crossed(at.w_mean, own.w, transpose=True))


class _Stored:
    """States of a system and of its scheme, which has those at the start of the last step."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation, self.comm = simulation, simulation.system.comm

    def state(self) -> State:
        """See :class:`flexfem.gradients.schemes.base.Stored`."""
        system = self._simulation.system
        return system.state() | self._simulation.integrator.state(system)

    def restore(self, state: State) -> None:
        """See :class:`flexfem.gradients.schemes.base.Stored`."""
        system = self._simulation.system
        system.restore(state)
        self._simulation.integrator.restore(system, state)


@dataclass(frozen=True)
class _Other:
    """A step beside one of the motion, to the same positions.

    Attributes:
        longer: change of its size, s, with the same end.
        later: change of its time, s.
        outputs: of controllers, by their numbers, over all of it; others are those of the model.
    """

    longer: float = 0.0
    later: float = 0.0
    outputs: Mapping[int, FloatArray] = field(default_factory=dict)


class EnergySteps:
    """See :class:`flexfem.gradients.schemes.base.Steps`."""

    matrices: ClassVar[Sequence[int]] = (STEP, _START)
    from_start = True

    def __init__(self, motion: States) -> None:
        """Store the motion."""
        self._motion, self.stored = motion, _Stored(motion.simulation)
        self._tangent: EnergyTangent | None = None

    def begin(self, simulation: Simulation) -> None:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        system = simulation.system
        _mechanics(simulation).begin(system, simulation.options.dt, system.factors)

    def shifts(self, step: int) -> Shifts:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        return self._motion.simulation.integrator.shifts(self._motion.grid.step(step).h)

    def mechanics(self, step: int) -> StepMechanics:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        return _mechanics(self._motion.simulation)

    def _last(self, step: int) -> float:
        """Size of the step before one, s, infinite for none."""
        return float(self._motion.state(step - 1).values["last_h"][0])

    def recall(self, step: int) -> None:
        """See :class:`flexfem.gradients.schemes.base.Steps`; it is stored with the states."""

    def recover(self, step: int) -> None:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        self.beside(self._motion.simulation, step)
        self._motion.system.constraints.multipliers[:] = (
            self.mechanics(step).weight * self._motion.state(step).rows["rows"]["forces"]
        )

    def beside(self, simulation: Simulation, step: int) -> StepMechanics:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        motion, system = self._motion, simulation.system
        for part, own in zip(system.parts, motion.system.parts, strict=True):
            frames = motion.frames(step - 1, own.block.name)
            part.block.frames0[:] = moved_apart(own.block, part.block, frames)
        self._place(simulation, step)
        system.constraints.multipliers[:] = motion.system.constraints.multipliers
        return _mechanics(simulation)

    def _place(self, simulation: Simulation, step: int, other: _Other | None = None) -> None:
        """Bring a model from its accepted state to the end of a step of the motion (collective).

        Nodes that are fixed in it stay where they are.

        Args:
            simulation: of the model.
            step: number of the step.
            other: a step beside it, if any.
        """
        motion, system, mechanics = self._motion, simulation.system, _mechanics(simulation)
        other, before, increments = other or _Other(), {}, {}
        h = motion.grid.step(step).h + other.longer
        system.reset()
        for part, own in zip(system.parts, motion.system.parts, strict=True):
            name, pair = own.block.name, (own.block, part.block)
            before[name] = moved_apart(*pair, motion.state(step - 1).rows[name]["before"])
            after = moved_apart(*pair, motion.frames(step, name))
            increments[name] = _increments(part.block.frames0, after)
        ended = self._ended(step) | dict(other.outputs)
        begin, end = (float(motion.times[k]) + other.later for k in (step - 1, step))
        lead, system.lead = system.lead, self._lead(step)
        _set_time(simulation, begin - other.longer, ended)
        mechanics.resume(system, before, self._last(step))
        system.lead = lead
        recall(simulation, motion.known[step - 1])
        _set_time(simulation, end - 0.5 * h, other.outputs)
        factors = system.factors.copy()
        _set_time(simulation, end, other.outputs)
        mechanics.begin(system, h, factors)
        mechanics.place(increments)
        system.interface.update()

    def _at(self, step: int, other: _Other) -> Equations:
        """Equations at the end of a step beside one of the motion (collective)."""
        simulation = self._motion.simulation
        self._place(simulation, step, other)
        shifts = simulation.integrator.shifts(self._motion.grid.step(step).h + other.longer)
        return equations_at(simulation.system, shifts, _mechanics(simulation))

    def _lead(self, step: int) -> float:
        """Time from the start of a step to that of its loads, s, beside a jump."""
        motion = self._motion
        before = step > 1 and motion.grid.renewal(step - 1) is None
        points = motion.simulation.breakpoints
        return points.lead(float(motion.times[step - 1]), before=before)

    def _ended(self, step: int) -> dict[int, FloatArray]:
        """Outputs of controllers, by their numbers, at the end of the step before one."""
        motion, state = self._motion, step - 1
        while state and motion.grid.renewal(state) is not None:
            state -= 1
        recall(motion.simulation, motion.known[max(state - 1, 0)])
        t = float(motion.times[state])
        found = [loop.outputs(t).copy() for loop in motion.simulation.controls.loops]
        recall(motion.simulation, motion.known[step - 1])
        return dict(enumerate(found))

    def end(self, step: int) -> StepEnd:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""

        def imposed(outputs: Mapping[int, FloatArray]) -> Equations:
            return self._at(step, _Other(outputs=outputs))

        # there are no states of force elements
        return StepEnd(step, self.shifts(step), AT_REST, self.mechanics(step), imposed)

    def size_change(self, over: Recursion) -> SizeChange:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        motion, system = self._motion, self._motion.system
        assert isinstance(over, EnergyRecursion)
        h, mechanics = motion.grid.step(over.step).h, self.mechanics(over.step)
        weights, found = [weight / (SIZE * h) for _, weight in STENCIL], list[list[FloatArray]]()
        for place, _ in STENCIL:
            longer = place * SIZE * h
            blocks, rows = self._at(over.step, _Other(longer=longer))
            values = [rows, *blocks]
            for part in system.parts:
                own = np.s_[: part.block.owned, : part.block.width]
                state = mechanics.over(part).state
                rates = state.rates[own].copy()
                values += [rates, (rates - state.rates0[own]) / (h + longer)]
            found.append(values)
        self._at(over.step, _Other())
        changes = [differenced(weights, every) for every in zip(*found, strict=True)]
        rows, blocks = changes[0], changes[1 : 1 + len(system.parts)]
        rated = changes[1 + len(system.parts) :]
        after = [
            over.accepted(k, _Rates(r, alpha))
            for k, (r, alpha) in enumerate(zip(rated[::2], rated[1::2], strict=True))
        ]
        return SizeChange([np.array([own.v, own.a, own.w]) for own in after], (blocks, rows))

    def at_time(self, step: int, later: float) -> Equations:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        return self._at(step, _Other(later=later))

    def tangent(self) -> EnergyTangent:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        system = self._motion.system
        self._tangent = EnergyTangent(system, self.mechanics(1), unilateral_forces(system, None))
        return self._tangent

    def over(self, step: int, linear: LinearizedStep) -> EnergyRecursion:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        assert self._tangent is not None  # that of ``linear``
        motion, mechanics, ends = self._motion, self.mechanics(step), []
        for part in motion.system.parts:
            block, centres = part.block, mechanics.over(part).state.centres
            first, last = (
                NodeRates.of(block, motion.state(k).rows[block.name], centres)
                for k in (step - 1, step)
            )
            ends.append((first, last))
        before = self._last(step)
        law = RateLaw.of(motion.grid.step(step).h, before, mechanics.chi)
        equations = linear, self._tangent
        return EnergyRecursion(step, equations, law, ends, first=not np.isfinite(before))

    def product(
        self, step: int, linear: LinearizedStep, matrix: int, direction: BlockVectors
    ) -> Equations:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        nothing = np.zeros(self._motion.system.constraints.size)
        if matrix == STEP:
            return linear.tangent.apply(direction, nothing)
        start = [Carried(q, 0.0 * q, 0.0 * q, 0.0 * q) for q in direction]
        return self.over(step, linear).by_start(start)

    def move(self, step: int, matrix: int, direction: BlockVectors) -> None:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        system, mechanics = self._motion.system, self.mechanics(step)
        if matrix == STEP:
            for part, own in zip(system.parts, direction, strict=True):
                part.block.owned_step[:] = own
            mechanics.move(system, 1.0)
            return
        for part, own in zip(system.parts, direction, strict=True):
            block = part.block
            block.owned_step[:] = own
            block.spread_step()
            block.frames0[:] = moved(block.frames0, block.step, inertial=block.inertial)
        self._place(self._motion.simulation, step)


def _mechanics(simulation: Simulation) -> StepMechanics:
    """Equations of the steps of a simulation, which are of this method."""
    mechanics = simulation.integrator.mechanics
    assert isinstance(mechanics, StepMechanics)
    return mechanics


def _set_time(simulation: Simulation, t: float, imposed: Mapping[int, FloatArray]) -> None:
    """Set loads and drives to a time, s, with outputs of controllers by their numbers."""
    for number, outputs in imposed.items():
        simulation.controls.loops[number].impose(t + simulation.system.lead, outputs)
    simulation.system.set_time(t)


def _increments(before: FloatArray, after: FloatArray) -> FloatArray:
    """Increments (n, 6) of a step from frames to those after it (n, 12)."""
    ways = after[:, :3] - before[:, :3]
    return np.concatenate([ways, cayley_vectors(before, after)], axis=1)
