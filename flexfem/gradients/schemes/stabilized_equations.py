# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linearised equations of a step of the stabilised index-2 form, and their solution.

A step has an increment n, which is integrated from rates, and another one o, so that ``q1 = q0
exp(n + o)``. With the equations ``R(n + o, n, L) = 0`` of bodies and force laws and the change D of
R along ``(o, o, mu)`` its unknowns n, o, L and mu satisfy (``integrators.stabilized_index2``)

``R = 0``, ``D = 0``, ``C = (G v + dPhi/dt) / (dv/dn) = 0``, ``Phi = 0``.

D is the difference of R at two neighbours of the state, which lie a part ``+-e`` of the change
beside it, over ``2 e``, and so are all its derivatives: those of R at each neighbour. With the
matrices K, V and W of ``equations.step_tangent`` (by positions at fixed rates, by velocities, by
accelerations), ``A = K + V + W``, factors z of R, y of D, and with m, k, so that those of C are -k
and those of Phi are m + k, the transposed equations are

``A^T z + G^T m + (G - C')^T k + D_1^T y = r1``, ``G z + D_L^T y = r2``,
``A^T y + C_V^T k - (V + W)^T z - D_2^T y = r3``, ``G y = 0``

where C' and C_V are derivatives of C by the increments and by velocities, ``D_1`` and ``D_2`` those
of D by both increments together and by the rates of n alone. The frozen operator of the step solves
both lines, one after the other, for GMRES. Derivatives of D are as small as the change, and left to
the next round.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray
from flexfem.gradients.equations.iterations import Operator
from flexfem.gradients.equations.linearized import LinearizedStep, UnsolvedError
from flexfem.gradients.equations.node_maps import StepMaps
from flexfem.gradients.equations.step_tangent import (
    ACCELERATIONS,
    POSITIONS,
    STEP,
    VELOCITIES,
    BlockVectors,
    StepTangent,
    forces_at_interface,
    forces_on_blocks,
    joined,
    put_steps,
)
from flexfem.gradients.equations.values import Equations, equations_at
from flexfem.integrators.stabilized_index2 import Rates
from flexfem.system.mechanics import END_POINT, EndPoint
from flexfem.system.system import MASS, Shifts, System

__all__ = ["CoupledEquations", "Neighbour", "RateEquations"]

#: Distance of neighbours, m or rad: second derivatives are differences over twice of it.
_WAY = 1e-4
#: Increments o that are rounding of positions, m or rad.
_ROUNDING = 1e-14
#: Error of the increment o, m or rad, up to which it is that of the iteration.
_MISSED = 1e-8


class RateEquations(EndPoint):
    """Equations of motion, with rates of constraints in the place of these.

    Attributes:
        rates: those of the step.
    """

    rates: Rates

    def evaluate_rows(self, system: System, shifts: Shifts) -> None:
        """See :class:`EndPoint`."""
        super().evaluate_rows(system, shifts)
        self.rates.use(system, shifts, END_POINT)


class Neighbour:
    """The equations at a state beside the end of a step.

    Attributes:
        weight: of its values in differences.
    """

    def __init__(self, system: System) -> None:
        """Find the places of all entries of matrices."""
        self._system, self._tangent, self.weight = system, StepTangent(system), 0.0
        self._shifts = MASS
        self._maps: list[StepMaps] = []
        self._at_end: Sequence[StepMaps] = ()
        self._rows: list[FloatArray] = []

    def take(self, shifts: Shifts, weight: float, at_end: Sequence[StepMaps]) -> None:
        """Compute the derivatives at the trial state (collective).

        Args:
            shifts: factors of the scheme.
            weight: of values there in differences.
            at_end: maps of the nodes to the end of the step.
        """
        self._shifts = shifts
        self._tangent.take(shifts)
        blocks = [part.block for part in self._system.parts]
        self._maps = [StepMaps.of(block, block.frames[: block.owned]) for block in blocks]
        self._at_end, self.weight = at_end, weight
        self._rows = [own.copy() for own in _live(self._system)]

    @contextmanager
    def _here(self) -> Iterator[None]:
        """Let the rows be those of this state."""
        live = _live(self._system)
        present = [own.copy() for own in live]
        for own, values in zip(live, self._rows, strict=True):
            own[:] = values
        yield
        for own, values in zip(live, present, strict=True):
            own[:] = values

    def moves(self, increments: BlockVectors, start: BlockVectors | None = None) -> BlockVectors:
        """Local twists there by increments, and by twists at the start of the step."""
        found = [by.by_increment(own) for by, own in zip(self._maps, increments, strict=True)]
        if start is not None:
            more = [by.before(own) for by, own in zip(self._maps, start, strict=True)]
            found = [a + b for a, b in zip(found, more, strict=True)]
        return [by.hold(own) for by, own in zip(self._maps, found, strict=True)]

    def apply(
        self, twists: BlockVectors, multipliers: FloatArray, matrix: int
    ) -> tuple[BlockVectors, FloatArray]:
        """Weighted change of the equations by local twists and multipliers (collective)."""
        with self._here():
            blocks, rows = self._tangent.apply(twists, multipliers, matrix)
        return [self.weight * own for own in blocks], self.weight * rows

    def apply_transposed(
        self, blocks: BlockVectors, multipliers: FloatArray, matrix: int
    ) -> tuple[BlockVectors, FloatArray]:
        """The transposed of :meth:`apply` (collective)."""
        with self._here():
            found, rows = self._tangent.apply_transposed(blocks, multipliers, matrix)
        forces = [self.weight * by.hold(own) for by, own in zip(self._maps, found, strict=True)]
        return forces, self.weight * rows

    def at_end(self, forces: BlockVectors) -> BlockVectors:
        """The same with twists at the end of the step by the same increments."""
        return [
            at.inverse.transposed(by.by_increment.transposed(own))
            for at, by, own in zip(self._at_end, self._maps, forces, strict=True)
        ]

    def beyond(self, forces: BlockVectors) -> BlockVectors:
        """The same with twists at the start, less those by the end of the step."""
        pairs = zip(self._at_end, self._maps, forces, self.at_end(forces), strict=True)
        return [by.before.transposed(own) - at.before.transposed(end) for at, by, own, end in pairs]

    def equations(self, system: System, restitution: FloatArray | None = None) -> Equations:
        """Equations of a model at its trial state, see ``SystemEquations`` (collective)."""
        del restitution
        return equations_at(system, self._shifts)


def _live(system: System) -> list[FloatArray]:
    """Arrays of the rows that depend on the state at which they were evaluated."""
    rows = system.constraints
    return [rows.force_jacobian, rows.compliance, rows.coupling]


class CoupledEquations:
    """The equations of one step at its end, where the system is."""

    def __init__(
        self, system: System, linear: LinearizedStep, maps: Sequence[StepMaps],
        rates: tuple[RateEquations, Shifts],
    ) -> None:  # fmt: skip
        """Store the step.

        Args:
            system: the system.
            linear: its equations with rates of constraints, linearised.
            maps: of its nodes.
            rates: these equations, and their factors.
        """
        self._system, self._linear, self._maps = system, linear, maps
        self._rates, self._shifts = rates
        self._neighbours: Sequence[Neighbour] = ()
        self._share = 0.0

    # -- Neighbours -----------------------------------------------------------------------------

    def take(self, neighbours: tuple[Neighbour, Neighbour]) -> None:
        """Find the change, and linearise at both neighbours; the state remains (collective).

        Raises:
            UnsolvedError: the state is no solution.
        """
        blocks = [part.block for part in self._system.parts]
        self._neighbours = neighbours
        self._trial = [{k: own.copy() for k, own in block.trial().items()} for block in blocks]
        self._multipliers = self._system.constraints.multipliers.copy()
        for block in blocks:
            block.put_shifts()
        self._change = [block.owned_step.copy() for block in blocks]
        self._change_of_multipliers = self._found()
        size = self._largest(self._change)
        self._share = _WAY / size if size > _ROUNDING else 0.0
        for sign, own in zip((1.0, -1.0), neighbours, strict=True):
            self._go(sign * self._share)
            own.take(self._shifts, 0.5 * sign / self._share if self._share else 0.0, self._maps)
        self._return()

    def _found(self) -> FloatArray:
        """The multipliers mu (r,) of the change (collective)."""
        rows = self._system.constraints
        forces, values = self._linear.tangent.apply(self._change, np.zeros(rows.size))
        solution, _ = self._linear.solve(forces, np.where(rows.rigid, 0.0, values))
        off, multipliers = self._linear.parts(solution)
        missed = self._largest(off)
        if not missed <= _MISSED:
            raise UnsolvedError(
                f"gradient: the step to t = {self._system.time:.6g} s cannot be recovered from the "
                f"states at its ends, what corrects its positions is off by {missed:.2g} (m or rad)"
            )
        return -multipliers

    def _largest(self, blocks: BlockVectors) -> float:
        own = max((float(np.abs(one).max(initial=0.0)) for one in blocks), default=0.0)
        return float(self._system.comm.allreduce(own, op=MPI.MAX))

    def _go(self, share: float) -> None:
        """Go a part of the change beside the end of the step (collective)."""
        self._put_trial()
        for part, change in zip(self._system.parts, self._change, strict=True):
            part.block.owned_step[:] = share * change
            part.block.correct(1.0)
        self._system.constraints.multipliers[:] += share * self._change_of_multipliers
        self._system.interface.update()

    def _put_trial(self) -> None:
        for part, trial in zip(self._system.parts, self._trial, strict=True):
            for name, values in part.block.trial().items():
                values[:] = trial[name]
        self._system.constraints.multipliers[:] = self._multipliers

    def _return(self) -> None:
        """Return to the end of the step, and evaluate its equations (collective)."""
        self._put_trial()
        self._rates.evaluate(self._system, self._shifts)

    def visits(self) -> Iterator[Neighbour]:
        """Go to one neighbour after the other, and return (collective)."""
        for sign, own in zip((1.0, -1.0), self._neighbours, strict=True):
            self._go(sign * self._share)
            yield own
        self._return()

    @property
    def rigid(self) -> BoolArray:
        """(r,) rows that are constraints."""
        return self._system.constraints.rigid

    # -- Solution -------------------------------------------------------------------------------

    def solve(self, right: FloatArray) -> FloatArray:
        """Solve the equations (collective); see ``LinearizedStep.solved``."""
        weight = self._weight(self._precondition(right))
        operator = Operator(
            lambda vector: self._act(self._turned(vector)), self._precondition,
            partial(self._products, weight), lambda vector: self._rest(self._turned(vector)),
        )  # fmt: skip
        return self._turned(self._linear.solved(operator, right, None, None)[0])

    def solve_transposed(
        self, right: FloatArray, guess: FloatArray | None, accuracy: float | None
    ) -> tuple[FloatArray, BlockVectors]:
        """Solve the transposed equations, and what the first line misses (collective)."""
        turned, back = self._turned_back(right), self._turned_back
        weight = self._weight(self._precondition_transposed(turned))
        operator = Operator(
            lambda vector: back(self._act_transposed(vector)), self._precondition_transposed,
            partial(self._products, weight), lambda vector: back(self._rest_transposed(vector)),
        )  # fmt: skip
        solution, left = self._linear.solved(operator, turned, guess, accuracy)
        if self._linear.tangent.turning:
            left = right - self._act_transposed(solution) - self._rest_transposed(solution)
        return solution, self.halves(left)[0][0]

    def _turned(self, vector: FloatArray) -> FloatArray:
        """Vectors with the turns of directors, of those without."""
        lines, tangent = self.halves(vector), self._linear.tangent
        return np.concatenate(
            [joined(tangent.turned([own.copy() for own in blocks]), rows) for blocks, rows in lines]
        )

    def _turned_back(self, vector: FloatArray) -> FloatArray:
        """The transposed of :meth:`_turned`."""
        lines, turned = self.halves(vector), self._linear.tangent.turned_transposed
        return np.concatenate(
            [joined(turned([own.copy() for own in blocks]), rows) for blocks, rows in lines]
        )

    def _products(self, weight: float, rows: FloatArray, vector: FloatArray) -> FloatArray:
        """Inner products of blocks, and of multipliers with a weight (collective).

        Multipliers of each line are forces in the other one.
        """
        found, owned = np.zeros(len(rows)), weight * self._system.constraints.owned
        for own, other in zip(np.split(rows, 2, axis=1), np.split(vector, 2), strict=True):
            found += self._linear.products(own, other)
            last = len(other) - len(owned)
            found += self._system.comm.allreduce(own[:, last:] @ (owned * other[last:]))
        return found

    def _weight(self, vector: FloatArray) -> float:
        """Weight of multipliers with which those of a solution are as large as its blocks."""
        blocks, both = (float(self._products(k, vector[np.newaxis], vector)[0]) for k in (0.0, 1.0))
        return blocks / (both - blocks) if both > blocks else 0.0

    def halves(self, vector: FloatArray) -> tuple[Equations, Equations]:
        """Blocks and rows (r,) of both lines of the equations in a vector."""
        first, second = np.split(vector, 2)
        return self._linear.parts(first), self._linear.parts(second)

    # -- Transposed -----------------------------------------------------------------------------

    def factors(self, vector: FloatArray) -> list[Equations]:
        """Factors of the equations with rates of constraints, and of those at the neighbours."""
        (z, m), (y, k) = self.halves(vector)
        rigid = self.rigid
        found = [(z, np.where(rigid, -k, m))]
        for own in self._neighbours:
            rows = np.where(rigid, 0.5 * (m + k), own.weight * k)
            found.append(([own.weight * x for x in y], rows))
        return found

    def _act_transposed(self, vector: FloatArray) -> FloatArray:
        (z, m), (y, k) = self.halves(vector)
        rigid, apply = self.rigid, self._linear.tangent.apply_transposed
        self._linear.applications += 2
        own = np.where(rigid, -k, m)
        forces, rows = apply(z, own)
        still, _ = apply(z, own, POSITIONS)
        more, second_rows = apply(y, np.where(rigid, 0.0, k))
        held = self._held(np.where(rigid, m + k, 0.0))
        first = [a + b for a, b in zip(forces, held, strict=True)]
        second = [a - b + c for a, b, c in zip(more, forces, still, strict=True)]
        return np.concatenate([joined(first, rows), joined(second, second_rows)])

    def _held(self, multipliers: FloatArray) -> BlockVectors:
        """Forces of constraints on positions with multipliers (r,)."""
        system = self._system
        jacobian = system.constraints.rigid_jacobian()
        return forces_on_blocks(system, forces_at_interface(system, jacobian, multipliers))

    def _precondition_transposed(self, vector: FloatArray) -> FloatArray:
        first, second = np.split(vector, 2)
        linear, rigid = self._linear, self.rigid
        found = linear.preconditioned(first, transposed=True)
        z, m = linear.parts(found)
        own = np.where(rigid, 0.0, m)
        forces, still = (linear.tangent.apply_transposed(z, own, k)[0] for k in (STEP, POSITIONS))
        blocks, rows = linear.parts(second)
        right = [a + b - c for a, b, c in zip(blocks, forces, still, strict=True)]
        more = linear.preconditioned(joined(right, rows), transposed=True)
        return np.concatenate([found, more])

    def _rest_transposed(self, vector: FloatArray) -> FloatArray:
        _, (y, k) = self.halves(vector)
        still, rows = self.by_second(y, k, POSITIONS)
        whole, _ = self.by_second(y, k, STEP)
        second = [b - a for a, b in zip(whole, still, strict=True)]
        return np.concatenate([joined(whole, rows), joined(second, 0.0 * rows)])

    def by_second(
        self, y: BlockVectors, k: FloatArray, matrix: int
    ) -> tuple[BlockVectors, FloatArray]:
        """Transposed derivatives of D, and those by L (r,), of one of the matrices (collective)."""
        own, found, rows = np.where(self.rigid, 0.0, k), [np.zeros_like(x) for x in y], 0.0 * k
        for one in self._neighbours:
            forces, more = one.apply_transposed(y, own, matrix)
            found = [a + b for a, b in zip(found, one.at_end(forces), strict=True)]
            rows = rows + more
        return found, rows

    def beyond(self, vector: FloatArray) -> BlockVectors:
        """Transposed derivatives of D by the start, less those by the end (collective)."""
        _, (y, k) = self.halves(vector)
        own, found = np.where(self.rigid, 0.0, k), [np.zeros_like(x) for x in y]
        for one in self._neighbours:
            forces, _ = one.apply_transposed(y, own, POSITIONS)
            found = [a + b for a, b in zip(found, one.beyond(forces), strict=True)]
        return found

    def by_rates(self, vector: FloatArray, matrix: int) -> BlockVectors:
        """Transposed derivatives of all equations by velocities, or accelerations (collective)."""
        _, (y, k) = self.halves(vector)
        z, own = self.factors(vector)[0]
        found, _ = self._linear.tangent.apply_transposed(z, own, matrix)
        more, _ = self.by_second(y, k, matrix)
        return [a + b for a, b in zip(found, more, strict=True)]

    # -- Ahead ----------------------------------------------------------------------------------

    def _act(self, vector: FloatArray) -> FloatArray:
        (x, s), (u, m) = self.halves(vector)
        rigid, apply = self.rigid, self._linear.tangent.apply
        self._linear.applications += 2
        forces, rates = apply(x, s)
        by_rates, less = self._by_rates(u)
        second, laws = apply(u, m)
        first = [a - b for a, b in zip(forces, by_rates, strict=True)]
        return np.concatenate(
            [
                joined(first, np.where(rigid, positions := self.positions(x), rates - less)),
                joined(second, np.where(rigid, positions - rates + less, laws)),
            ]
        )

    def _by_rates(self, twists: BlockVectors) -> Equations:
        """Changes of the equations by rates that change with increments (collective)."""
        nothing = np.zeros(self._system.constraints.size)
        pairs = [
            self._linear.tangent.apply(twists, nothing, k) for k in (VELOCITIES, ACCELERATIONS)
        ]
        (first, rows), (second, more) = pairs
        return [a + b for a, b in zip(first, second, strict=True)], rows + more

    def positions(self, twists: BlockVectors) -> FloatArray:
        """Changes of constraints (r,) by local twists (collective)."""
        put_steps(self._system, twists)
        rows = self._system.constraints
        return rows.rigid * rows.changes(self._system.interface.steps)

    def _precondition(self, vector: FloatArray) -> FloatArray:
        first, second = np.split(vector, 2)
        linear, rigid = self._linear, self.rigid
        found = linear.preconditioned(second, transposed=False)
        by_rates, laws = self._by_rates(linear.parts(found)[0])
        blocks, rows = linear.parts(first)
        right = [a + b for a, b in zip(blocks, by_rates, strict=True)]
        rows = rows + np.where(rigid, 0.0, laws)
        more = linear.preconditioned(joined(right, rows), transposed=False)
        return np.concatenate([more, found])

    def _rest(self, vector: FloatArray) -> FloatArray:
        (x, s), (u, _) = self.halves(vector)
        whole = [by.inverse(own) for by, own in zip(self._maps, x, strict=True)]
        rated = [a - by.inverse(own) for by, a, own in zip(self._maps, whole, u, strict=True)]
        blocks, rows = self.second((whole, rated, rated), s)
        nothing = joined([0.0 * own for own in x], 0.0 * s)
        return np.concatenate([nothing, joined(blocks, rows)])

    def second(
        self, increments: tuple[BlockVectors, BlockVectors, BlockVectors],
        multipliers: FloatArray, start: BlockVectors | None = None,
    ) -> Equations:  # fmt: skip
        """Changes of D (collective).

        Args:
            increments: by which positions change, and those with which velocities, and
                accelerations, would change as they do.
            multipliers: (r,) changes of L.
            start: local twists at the start of the step.
        """
        nothing = np.zeros_like(multipliers)
        blocks: BlockVectors = [np.zeros_like(own) for own in increments[0]]
        rows = nothing
        for one in self._neighbours:
            for k, own in zip((POSITIONS, VELOCITIES, ACCELERATIONS), increments, strict=True):
                moves = one.moves(own, None if k else start)
                forces, values = one.apply(moves, nothing if k else multipliers, k)
                blocks = [a + b for a, b in zip(blocks, forces, strict=True)]
                rows = rows + values
        return blocks, np.where(self.rigid, 0.0, rows)

    def beside(self, changes: Sequence[Equations]) -> tuple[Equations, FloatArray]:
        """Changes of D at a fixed state, and of constraints (r,), from those at the neighbours."""
        blocks = [np.zeros_like(own) for own in self._change]
        rows = positions = np.zeros(self._system.constraints.size)
        for own, (forces, values) in zip(self._neighbours, changes, strict=True):
            blocks = [a + own.weight * b for a, b in zip(blocks, forces, strict=True)]
            rows, positions = rows + own.weight * values, positions + 0.5 * values
        rigid = self.rigid
        return (blocks, np.where(rigid, 0.0, rows)), np.where(rigid, positions, 0.0)
