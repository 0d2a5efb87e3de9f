# SPDX-License-Identifier: LGPL-3.0-or-later
"""Barriers in dynamic relaxation: their masses, and steps that pass through nothing.

The stiffness of a barrier changes by decades from step to step: its part of the masses is renewed
in every step, by the contacts that are closed, which also damp the motion along their normals in
proportion to their stiffness: what is held by a contact does not bounce. Steps are cut node by
node: those of points of pairs that would lose too much of their gap are shortened, and these nodes
begin again from rest, as after a plastic impact; the others go on. Pairs are checked again until
all keep their gap.
"""

from math import sqrt

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.barrier.contacts import BarrierContacts
from flexfem.solvers.relaxation.kernels import move
from flexfem.system.system import System

__all__ = ["StepsApart"]

#: Parts of their gaps that pairs keep in a step, and that they must have kept in one that is cut.
_KEEP, _KEPT = 0.4, 0.3
#: Part of the largest possible step that is taken, the number of times that steps of single nodes
#: are cut, and, of those that follow, that all are.
_SHORTER, _SINGLE, _ALL = 0.95, 10, 40
#: Number of steps for which pairs are searched at once.
_AHEAD = 100.0


class StepsApart:
    """Barriers of a system in its relaxation."""

    def __init__(self, system: System, contacts: BarrierContacts, limit: float) -> None:
        """Store the barriers; steps are stable below a ``limit`` of the eigenvalues."""
        self._system, self._contacts, self._limit = system, contacts, limit
        self._kept = [np.empty_like(part.block.frames) for part in system.parts]
        self._residuals = [np.empty_like(part.block.residual) for part in system.parts]
        contacts.look_ahead(_AHEAD)

    def leave_out(self, without: bool = True) -> None:
        """Leave the barriers out of the equations, for the masses of all else, or not."""
        self._contacts.update()
        self._contacts.factor = 0.0 if without else 1.0

    def add_masses(self, free: list[FloatArray], inverse: list[FloatArray]) -> None:
        """Write inverse masses (n_owned, width) with those of the closed contacts (collective).

        Args:
            free: those without.
            inverse: result.
        """
        for part, without, result in zip(self._system.parts, free, inverse, strict=True):
            if part.contacts is not None:
                # a unit normal has a sum of at most sqrt(3) with the entries of another one
                stiffness = self._contacts.nearby(part.kind)[:, : without.shape[1]]
                np.divide(without, 1.0 + without * (sqrt(3.0) / self._limit * stiffness), result)

    def damp(self, velocities: list[FloatArray], inverse: list[FloatArray]) -> None:
        """Slow velocities (n_owned, width) along the normals of closed contacts (collective).

        They lose the part in which the contacts' share in the masses is of the whole.

        Args:
            velocities: of all blocks.
            inverse: result of :meth:`add_masses`.
        """
        rows, blocks = self._contacts.rows(), [part.block for part in self._system.parts]
        for block, velocity, kept in zip(blocks, velocities, self._residuals, strict=True):
            block.owned_step[:] = velocity
            kept[:] = block.residual
            block.residual[:] = 0.0
        rows.push(rows.slopes * rows.motions())
        for block, velocity, kept, by in zip(
            blocks, velocities, self._residuals, inverse, strict=True
        ):
            np.subtract(velocity, by * block.owned_residual, out=velocity)
            block.residual[:] = kept

    def take_step(self, velocities: list[FloatArray]) -> None:
        """Move all nodes by their steps, or parts of them, without contact (collective).

        Velocities (n_owned, width) of nodes whose own steps are cut become zero.
        """
        parts, contacts = self._system.parts, self._contacts
        for part, kept in zip(parts, self._kept, strict=True):
            kept[:] = part.block.frames
        for time in range(_SINGLE + _ALL):
            for part in parts:
                part.block.spread_step()
                move(part.block.frames, part.block.step, part.block.width)
            safe = contacts.mark_unsafe(_KEPT if time else _KEEP)
            if safe >= 1.0:
                return
            shorter = _SHORTER * safe if time + 1 < _SINGLE + _ALL else 0.0
            for part, kept, velocity in zip(parts, self._kept, velocities, strict=True):
                block = part.block
                block.frames[:] = kept
                if time >= _SINGLE:
                    block.owned_step[:] *= shorter
                elif part.contacts is not None:
                    nodes = contacts.unsafe(part.kind)
                    block.owned_step[nodes] *= shorter
                    velocity[nodes] = 0.0
