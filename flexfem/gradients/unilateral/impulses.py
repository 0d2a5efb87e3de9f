# SPDX-License-Identifier: LGPL-3.0-or-later
"""Impulses at the end of a step, of contacts and stops, with their adjoint and their tangent.

Forces F over a step act by a jump W of the velocities (``integrators.split.step``). Less the jump,
the equations of a step with ``b F`` are those without forces, with the accepted accelerations w1
and the multipliers L1 that remain,

``s r(q1, v(n), w1) + G^T L1 = 0``,  ``G(q1) u = 0``,  ``u = w(n) - w1`` in local axes,  (*)

and with the scheme's ``e = (1 - alpha_m)/(1 - alpha_f)`` and ``k = 1 - gamma/(2 beta)``

``W = u h/b``,  ``v1 = v(n) + k W``,  ``a1 = a(n) - u/e``.

So an adjoint goes back over (*) before it does so over the equations of the step: with
``y = wb - (k h/b) vb + ab/e``, in local axes, and the mass matrix M

1. ``M s z + G^T m = y``, ``G z = 0``, and ``mu = -m``;
2. ``wb = (k h/b) vb - ab/e - G^T mu``, ``vb`` loses ``s z^T r_v``;
3. ``qb`` loses ``z^T d(s r + G^T L1)/dq`` and ``mu^T d(G u)/dq``;
4. multipliers of force laws, which are those of the step, get ``-G z`` on the right-hand side;
5. a gradient by parameters p loses ``z^T dr/dp + mu^T d(G u)/dp``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.state import State
from flexfem.gradients.equations.carried import Carried
from flexfem.gradients.equations.linearized import UnsolvedError
from flexfem.gradients.equations.node_maps import StepMaps, applied, rotations, transposed
from flexfem.gradients.equations.row_jumps import RowJumps
from flexfem.gradients.equations.step_tangent import (
    POSITIONS,
    VELOCITIES,
    BlockVectors,
    StepTangent,
    put_steps,
)
from flexfem.gradients.equations.unilateral import Unilateral
from flexfem.gradients.equations.values import Equations, equations_at
from flexfem.gradients.unilateral.forces import leave_out_barriers
from flexfem.gradients.unilateral.penalties import Penalties
from flexfem.integrators.generalized_alpha import GeneralizedAlpha
from flexfem.integrators.split.impulse import Impulse
from flexfem.system.system import Shifts, System

__all__ = ["Impulses"]


class Impulses:
    """Equations (*) at the end of a step, see the module."""

    def __init__(self, system: System, forces: Sequence[Unilateral]) -> None:
        """Set up the equations of a system with some unilateral forces (collective)."""
        self._system = system
        penalties = [one for one in forces if isinstance(one, Penalties)]
        self._tangent = StepTangent(system, forces=penalties)
        self._impulse = Impulse(system)
        self._jumps: BlockVectors = []

    def take(self, scheme: GeneralizedAlpha, h: float, shifts: Shifts, accepted: State) -> None:
        """Linearise at the end of a step (collective).

        Args:
            scheme: coefficients of the step, at whose trial state the system is.
            h: size of the step, s.
            shifts: factors of the step.
            accepted: the state after it.
        """
        system = self._system
        self._shifts, self._kick = shifts, scheme.unseen * h / scheme.weight
        self._share = 2.0 * scheme.beta * scheme.weight
        self._jumps = []
        for part in system.parts:
            block = part.block
            jump = _slow(block, accepted.rows[block.name]["acceleration"])
            self._jumps.append(_local(block, jump[: block.owned, : block.width]))
        system.constraints.multipliers[:] = shifts.scale * accepted.rows["rows"]["forces"]
        leave_out_barriers(system)
        system.interface.update()
        self._tangent.take(shifts)
        self._rows = RowJumps(system, self._jumps)

    # -- Adjoint --------------------------------------------------------------------------------

    def back(
        self, carried: Sequence[Carried], maps: Sequence[StepMaps]
    ) -> tuple[BlockVectors, FloatArray, FloatArray]:
        """Go back over the impulses, in place (collective).

        Args:
            carried: sums of influences of the accepted state, in the axes of the trial state.
            maps: of the step.

        Returns:
            z, mu, and right-hand sides (r,) of the rows in the step's transposed equations.

        Raises:
            UnsolvedError: masses are singular.
        """
        right, seeds, scale = [], [], self._shifts.scale
        for part, own, by in zip(self._system.parts, carried, maps, strict=True):
            seeds.append(self._kick * own.v - own.a / self._share)
            right.append(by.hold(_local(part.block, own.w - seeds[-1])))
        z, m = self._solved(right, np.zeros(self._system.constraints.size))
        z, mu = [own / scale for own in z], -m
        turned, forces = self._rows.transposed(mu)
        by_place, changes = self._tangent.apply_transposed(z, 0.0 * mu, POSITIONS)
        by_velocity, _ = self._tangent.apply_transposed(z, 0.0 * mu, VELOCITIES)
        for k, (part, own, by) in enumerate(zip(self._system.parts, carried, maps, strict=True)):
            own.q -= by_place[k] + turned[k]
            by.hold(own.q)
            v = own.v - by.by_increment.transposed(by_velocity[k]) / self._shifts.velocity
            w = seeds[k] - _rates(part.block, forces[k])
            own.v, own.w = by.hold_rates(v), by.hold_rates(w)
        return z, mu, -changes * self._of_laws

    @property
    def _of_laws(self) -> FloatArray:
        """(r,) 1 for rows of force laws that have a part in the equations (*), 0 for others."""
        rows = self._system.constraints
        found: FloatArray = np.where(rows.rigid | rows.unilateral, 0.0, 1.0)
        return found

    def _solved(self, right: BlockVectors, values: FloatArray) -> Equations:
        """Solution x, m of ``M x + G^T m = right``, ``G x = values`` (collective)."""
        for part, own in zip(self._system.parts, right, strict=True):
            part.block.residual[:] = 0.0
            part.block.owned_residual[:] = own
        rows = self._system.constraints
        present = rows.multipliers.copy()
        multipliers = self._impulse.solve(0.0, values)
        rows.multipliers[:] = present
        if multipliers is None:
            raise UnsolvedError("gradient: the masses are singular where an impulse acts")
        found = [part.block.hold(part.block.owned_step.copy()) for part in self._system.parts]
        return found, -multipliers * rows.rigid

    # -- Tangent --------------------------------------------------------------------------------

    def ahead(
        self, carried: Sequence[Carried], maps: Sequence[StepMaps], change: Equations,
        multipliers: FloatArray,
    ) -> None:  # fmt: skip
        """Go over the impulses, in place (collective).

        Args:
            carried: changes of the state without impulses, in the axes of the accepted state.
            maps: of the step.
            change: of the equations (*) at a fixed state.
            multipliers: (r,) changes of those of the step.

        Raises:
            UnsolvedError: masses are singular.
        """
        parts, rows = self._system.parts, self._system.constraints
        nothing = np.zeros(rows.size)
        # these axes are orthonormal ones
        moves = [by.axes.transposed(own.q) for own, by in zip(carried, maps, strict=True)]
        by_place, _ = self._tangent.apply(moves, multipliers * self._of_laws, POSITIONS)
        by_velocity, _ = self._tangent.apply(
            [by.by_increment(own.v) / self._shifts.velocity
             for own, by in zip(carried, maps, strict=True)], nothing, VELOCITIES,
        )  # fmt: skip
        jumps = [_local(part.block, own.w) for part, own in zip(parts, carried, strict=True)]
        values = self._rows.changes(moves, jumps) + change[1]
        right = [
            -(a + b + c) / self._shifts.scale
            for a, b, c in zip(by_place, by_velocity, change[0], strict=True)
        ]
        found, _ = self._solved(right, values * rows.rigid)
        for part, own, by, x in zip(parts, carried, maps, found, strict=True):
            w = _rates(part.block, x)
            jump = own.w - w
            v, a = own.v + self._kick * jump, own.a - jump / self._share
            own.v, own.a, own.w = (by.hold_rates(y) for y in (v, a, w))

    # -- Parameters -----------------------------------------------------------------------------

    def equations(self, system: System, restitution: FloatArray | None = None) -> Equations:
        """Equations (*) of a model at its trial state (collective); there is no restitution."""
        leave_out_barriers(system)
        blocks, _ = equations_at(system, self._shifts)
        put_steps(system, self._jumps)
        rows = system.constraints
        return blocks, rows.changes(system.interface.steps) * rows.rigid


def _slow(block: FrameBlock, accepted: FloatArray) -> FloatArray:
    """Give the trial state the accepted accelerations; returns by how much they were more."""
    nodes = block.nodes
    jump: FloatArray = nodes.acceleration_base + nodes.rates[1] * block.increment - accepted
    nodes.acceleration_base[:] -= jump
    block.step[:] = 0.0
    block.shift(1.0)
    return jump


def _local(block: FrameBlock, rates: FloatArray) -> FloatArray:
    """Rates of increments (n, w) in local axes."""
    found = rates.copy()
    if block.inertial:
        found[:, :3] = transposed(rotations(block.frames[: block.owned]), rates[:, :3])
    return found


def _rates(block: FrameBlock, local: FloatArray) -> FloatArray:
    """Inverse of :func:`_local`, and its transposed one."""
    found = local.copy()
    if block.inertial:
        found[:, :3] = applied(rotations(block.frames[: block.owned]), local[:, :3])
    return found
