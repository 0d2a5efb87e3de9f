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
4. multipliers of force laws, which are those of the step, get ``-G z`` on the right-hand side,
   and those of redundant constraints with the compliance c, where ``G u = c (L - L1)/s`` with those
   L of the step, ``c mu/s``;
5. a gradient by parameters p loses ``z^T dr/dp + mu^T d(G u)/dp``.

With damping C of elements (``integrators.split.stiff_damping``) the first of (*) has
``s h C(q1) p`` more, with the local accelerations ``p = R^T (w1 + (k/b) u) - omega x v(n)``, so
that M becomes ``M + (1 - k/b) h C``; and the next step has the forces ``-c s h C(q1) w1``, which
depend on its start alone (:class:`LeftDamping`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.state import State
from flexfem.gradients.equations.carried import Carried
from flexfem.gradients.equations.linearized import UnsolvedError
from flexfem.gradients.equations.node_maps import StepMaps
from flexfem.gradients.equations.odd_forces import LinearDamping, LocalRates, damping_forces
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

__all__ = ["Impulses", "LeftDamping"]


class Impulses:
    """Equations (*) at the end of a step, see the module."""

    def __init__(self, system: System, forces: Sequence[Unilateral]) -> None:
        """Set up the equations of a system with some unilateral forces (collective)."""
        self._system = system
        penalties = [one for one in forces if isinstance(one, Penalties)]
        self._tangent = StepTangent(system, forces=penalties)
        self._impulse = Impulse(system, damped=True)
        self._damping: LinearDamping | None = None
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
        self._h, self._unseen = h, scheme.unseen / scheme.weight
        self._share = 2.0 * scheme.beta * scheme.weight
        self._jumps, self._nodes = [], [LocalRates(part.block) for part in system.parts]
        for part, nodes in zip(system.parts, self._nodes, strict=True):
            block = part.block
            jump = _slow(block, accepted.rows[block.name]["acceleration"])
            self._jumps.append(nodes.local(jump[: block.owned, : block.width]))
        remaining = shifts.scale * accepted.rows["rows"]["forces"]
        self._passed = (system.constraints.multipliers - remaining) / shifts.scale
        system.constraints.multipliers[:] = remaining
        leave_out_barriers(system)
        system.interface.update()
        self._tangent.take(shifts)
        self._rows = RowJumps(system, self._jumps)
        if self._impulse.damped:
            self._rates = [
                part.block.acceleration[: part.block.owned, : part.block.width]
                + self._unseen * jump
                for part, jump in zip(system.parts, self._jumps, strict=True)
            ]
            self._damping = LinearDamping(system, self._rates)

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
        for nodes, own, by in zip(self._nodes, carried, maps, strict=True):
            seeds.append(self._kick * own.v - own.a / self._share)
            right.append(by.hold(nodes.local(own.w - seeds[-1])))
        z, m = self._solved(right, np.zeros(self._system.constraints.size))
        z, mu = [own / scale for own in z], -m
        turned, forces = self._rows.transposed(mu)
        by_place, changes = self._tangent.apply_transposed(z, 0.0 * mu, POSITIONS)
        by_velocity, _ = self._tangent.apply_transposed(z, 0.0 * mu, VELOCITIES)
        for k, (nodes, own, by) in enumerate(zip(self._nodes, carried, maps, strict=True)):
            own.q -= by_place[k] + turned[k]
            own.v = own.v - by.by_increment.transposed(by_velocity[k]) / self._shifts.velocity
            own.w = seeds[k] - nodes.rates(forces[k])
        if self._damping is not None:
            factor = scale * self._h
            for own, (q, v, x) in zip(carried, self._damping.transposed(z), strict=True):
                own.q -= factor * q
                own.v = own.v - factor * v
                own.w = own.w - factor * self._unseen * x
        for own, by in zip(carried, maps, strict=True):
            own.q, own.v, own.w = by.hold(own.q), by.hold_rates(own.v), by.hold_rates(own.w)
        rows = self._system.constraints
        return z, mu, rows.relaxation / scale * mu * rows.rigid - changes * self._of_laws

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
        multipliers = self._impulse.solve((1.0 - self._unseen) * self._h, values)
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
        rows = self._system.constraints
        nothing = np.zeros(rows.size)
        # these axes are orthonormal ones
        moves = [by.axes.transposed(own.q) for own, by in zip(carried, maps, strict=True)]
        by_place, _ = self._tangent.apply(moves, multipliers * self._of_laws, POSITIONS)
        by_velocity, _ = self._tangent.apply(
            [by.by_increment(own.v) / self._shifts.velocity
             for own, by in zip(carried, maps, strict=True)], nothing, VELOCITIES,
        )  # fmt: skip
        jumps = [nodes.local(own.w) for nodes, own in zip(self._nodes, carried, strict=True)]
        values = self._rows.changes(moves, jumps) + change[1]
        values = values - rows.relaxation / self._shifts.scale * multipliers
        right = [
            -(a + b + c) / self._shifts.scale
            for a, b, c in zip(by_place, by_velocity, change[0], strict=True)
        ]
        if self._damping is not None:
            by_w = [self._unseen * own.w for own in carried]
            damped = self._damping.changes(moves, [own.v for own in carried], by_w)
            right = [a - self._h * b for a, b in zip(right, damped, strict=True)]
        found, _ = self._solved(right, values * rows.rigid)
        for nodes, own, by, x in zip(self._nodes, carried, maps, found, strict=True):
            w = nodes.rates(x)
            jump = own.w - w
            v, a = own.v + self._kick * jump, own.a - jump / self._share
            own.v, own.a, own.w = (by.hold_rates(y) for y in (v, a, w))

    # -- Parameters -----------------------------------------------------------------------------

    def equations(self, system: System, restitution: FloatArray | None = None) -> Equations:
        """Equations (*) of a model at its trial state (collective); there is no restitution."""
        leave_out_barriers(system)
        blocks, _ = equations_at(system, self._shifts)
        if self._damping is not None:
            factor, damped = self._shifts.scale * self._h, damping_forces(system, self._rates)
            blocks = [a + factor * b for a, b in zip(blocks, damped, strict=True)]
        put_steps(system, self._jumps)
        rows = system.constraints
        changes = rows.changes(system.interface.steps) - rows.relaxation * self._passed
        return blocks, changes * rows.rigid


def _slow(block: FrameBlock, accepted: FloatArray) -> FloatArray:
    """Give the trial state the accepted accelerations; returns by how much they were more."""
    nodes = block.nodes
    jump: FloatArray = nodes.acceleration_base + nodes.rates[1] * block.increment - accepted
    nodes.acceleration_base[:] -= jump
    block.step[:] = 0.0
    block.shift(1.0)
    return jump


class LeftDamping:
    """Forces ``-c s h C(q0) w0`` in a step, which accepted accelerations w0 before it lack."""

    def __init__(self, system: System, factor: float) -> None:
        """Linearise at the accepted state before the step (collective).

        Args:
            system: the system.
            factor: c s h, with the size h of the step before.
        """
        rates = [
            part.block.acceleration[: part.block.owned, : part.block.width].copy()
            for part in system.parts
        ]
        self._factor, self._forces = factor, LinearDamping(system, rates)

    def changes(self, carried: Sequence[Carried]) -> BlockVectors:
        """Changes of the equations of blocks by those of the state before (collective)."""
        by = [own.q for own in carried], [own.v for own in carried], [own.w for own in carried]
        return [-self._factor * own for own in self._forces.changes(*by)]

    def back(self, carried: Sequence[Carried], z: BlockVectors) -> None:
        """Add influences of the state before by factors of the equations, in place (collective)."""
        for own, (q, v, w) in zip(carried, self._forces.transposed(z), strict=True):
            own.q, own.v = own.q + self._factor * q, own.v + self._factor * v
            own.w = own.w + self._factor * w
