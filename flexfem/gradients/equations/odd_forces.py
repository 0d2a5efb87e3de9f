# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of forces ``C(q) p`` of linear damping and ``M(q) s`` of masses.

They are odd in rates, and those of stiffness and gyroscopic ones even: derivatives by positions are
half the difference between those at opposite rates.

Local accelerations ``p = R^T x - omega x v`` of nodes whose translations are inertial turn with
these, and change with their velocities.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.gradients.equations.node_maps import applied, rotations, transposed
from flexfem.gradients.equations.step_tangent import (
    POSITIONS,
    VELOCITIES,
    BlockVectors,
    StepTangent,
    collected,
    put_steps,
)
from flexfem.integrators.split.impulse import zero_increments
from flexfem.system.mechanics import VISCOUS
from flexfem.system.system import GYROSCOPIC, Shifts, System

__all__ = ["AT_STATE", "LinearDamping", "LocalRates", "OddForces", "damping_forces"]

#: Equations at a state, not scaled.
AT_STATE = Shifts(velocity=1.0, acceleration=1.0, scale=1.0)
#: Largest rates, m/s and so on, at which forces are differentiated: they are linear in them.
_LARGE = 1e3


@contextmanager
def _without_modes(system: System) -> Iterator[None]:
    """Leave out damping of modes, which is not that of elements."""
    dampers, system.modal_dampers = system.modal_dampers, None
    yield
    system.modal_dampers = dampers


class OddForces:
    """Forces that are odd in rates, at a trial state.

    Attributes:
        values: the forces of each block, (n_owned, w).
    """

    def __init__(
        self, system: System, rates: Sequence[FloatArray], put: Callable[[float], None]
    ) -> None:
        """Compute them (collective); the trial state is that of ``put`` after it.

        Args:
            system: the system.
            rates: all rates and multipliers, of which the largest is of interest.
            put: sets velocities, accelerations and multipliers to a multiple of them.
        """
        largest = max((float(np.abs(x).max(initial=0.0)) for x in rates), default=0.0)
        size = system.comm.allreduce(largest, op=MPI.MAX)
        self._scale = _LARGE / size if size > 0.0 else 1.0
        sides = []
        with _without_modes(system):
            self._sides = StepTangent(system), StepTangent(system)
            for tangent, sign in zip(self._sides, (1.0, -1.0), strict=True):
                put(sign * self._scale)
                with zero_increments(system):
                    tangent.take(AT_STATE)
                sides.append(collected(system))
        self.values = self._odd(*sides)
        self._nothing = np.zeros(system.constraints.size)

    def _odd(self, first: BlockVectors, second: BlockVectors) -> BlockVectors:
        return [(a - b) / (2.0 * self._scale) for a, b in zip(first, second, strict=True)]

    def changes(self, twists: BlockVectors) -> BlockVectors:
        """Changes by positions, with rates that do not turn (collective)."""
        return self._odd(*(own.apply(twists, self._nothing, POSITIONS)[0] for own in self._sides))

    def transposed(self, z: BlockVectors) -> BlockVectors:
        """Factors of twists by those of the forces (collective)."""
        sides = (own.apply_transposed(z, self._nothing, POSITIONS)[0] for own in self._sides)
        return self._odd(*sides)

    def damping(self, rates: BlockVectors) -> BlockVectors:
        """``C`` times local vectors (collective)."""
        first, second = (own.apply(rates, self._nothing, VELOCITIES)[0] for own in self._sides)
        return [0.5 * (a + b) for a, b in zip(first, second, strict=True)]


class LocalRates:
    """Local accelerations ``R^T x - omega x v`` of a block's nodes at a trial state."""

    def __init__(self, block: FrameBlock) -> None:
        """Store its directions and velocities."""
        self._inertial, self._turning = block.inertial, block.inertial and block.width == 6
        self._axes = rotations(block.frames[: block.owned]).copy()
        velocity = block.velocity[: block.owned].copy()
        self._v, self._omega = velocity[:, :3], velocity[:, 3:]

    def local(self, rates: FloatArray) -> FloatArray:
        """Rates of increments (n, w) in local axes."""
        found = rates.copy()
        if self._inertial:
            found[:, :3] = transposed(self._axes, rates[:, :3])
        return found

    def rates(self, local: FloatArray) -> FloatArray:
        """Inverse of :meth:`local`, and its transposed one."""
        found = local.copy()
        if self._inertial:
            found[:, :3] = applied(self._axes, local[:, :3])
        return found

    def changes(self, twists: FloatArray, v: FloatArray, x: FloatArray) -> FloatArray:
        """Changes (n, w) by twists, beside what turns, and by changes of v and x.

        These are rates of increments.
        """
        found, rates = self.local(x), self.local(v)
        if self._turning:
            found[:, :3] += np.cross(np.cross(self._omega, twists[:, 3:]), self._v)
            found[:, :3] -= np.cross(rates[:, 3:], self._v) + np.cross(self._omega, rates[:, :3])
        return found

    def transposed(self, factors: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Factors of twists, v and x by those (n, w) of the accelerations."""
        by_twists, by_v = np.zeros_like(factors), np.zeros_like(factors)
        if self._turning:
            turned = np.cross(self._v, factors[:, :3])
            by_twists[:, 3:] = np.cross(turned, self._omega)
            by_v[:, 3:] = -turned
            by_v[:, :3] = -np.cross(factors[:, :3], self._omega)
        return by_twists, self.rates(by_v), self.rates(factors)


class LinearDamping:
    """Forces ``C(q) p`` at a trial state, which is left as it is."""

    def __init__(self, system: System, accelerations: BlockVectors) -> None:
        """Compute them and their derivatives (collective).

        Args:
            system: the system.
            accelerations: p of each block, (n_owned, w).
        """
        rows, parts = system.constraints, system.parts
        self._nodes = [LocalRates(part.block) for part in parts]
        trial = [(part.block.velocity.copy(), part.block.acceleration.copy()) for part in parts]
        multipliers = rows.multipliers.copy()

        def put(factor: float) -> None:
            put_steps(system, accelerations)
            for part in parts:
                part.block.velocity[:] = factor * part.block.step
                part.block.acceleration[:] = 0.0
            rows.multipliers[:] = 0.0
            system.interface.update()

        self._forces = OddForces(system, accelerations, put)
        for part, (velocity, acceleration) in zip(parts, trial, strict=True):
            part.block.velocity[:], part.block.acceleration[:] = velocity, acceleration
        rows.multipliers[:] = multipliers
        system.interface.update()

    def changes(self, q: BlockVectors, v: BlockVectors, x: BlockVectors) -> BlockVectors:
        """Changes of the forces by local twists, and by rates of increments (collective)."""
        moved = [own.changes(*by) for own, *by in zip(self._nodes, q, v, x, strict=True)]
        turned, slowed = self._forces.changes(q), self._forces.damping(moved)
        return [a + b for a, b in zip(turned, slowed, strict=True)]

    def transposed(self, z: BlockVectors) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
        """Factors of the same by those of the forces, for each block (collective)."""
        found = []
        moved = self._forces.transposed(z)
        # linear damping is symmetric
        for own, turned, slowed in zip(self._nodes, moved, self._forces.damping(z), strict=True):
            q, v, x = own.transposed(slowed)
            found.append((turned + q, v, x))
        return found


def damping_forces(system: System, rates: BlockVectors) -> BlockVectors:
    """``C`` times local vectors at a trial state (collective)."""
    put_steps(system, rates)
    with zero_increments(system):
        VISCOUS.multiply_mass(system, 1.0, GYROSCOPIC)
    return collected(system)
