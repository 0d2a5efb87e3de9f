# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of penalties of contacts at the end of a step: frictionless ones have no memory."""

from __future__ import annotations

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.carriers import CarriedPoints
from flexfem.contact.contacts import Contacts
from flexfem.gradients.equations.unilateral import StateChange, StateFactors
from flexfem.system.system import Shifts, System

__all__ = ["Penalties"]


class Penalties:
    """Derivatives of the forces of penalties; see ``equations.unilateral.Unilateral``."""

    def __init__(self, system: System, contacts: Contacts) -> None:
        """Store the contacts of a system."""
        self._contacts, self._scale = contacts, 0.0
        self._rows = system.constraints.size
        self._steps, self._forces = np.zeros((2, len(contacts.carriers.home), 3))
        self._triangles: list[tuple[IntArray, FloatArray]] = []
        self._surfaces: list[tuple[IntArray, FloatArray, int]] = []

    def take(self, shifts: Shifts) -> None:
        """See ``Unilateral``."""
        self._scale = shifts.scale
        self._triangles = [made.blocks(shifts.scale) for made, _ in self._contacts.triangles()]
        self._surfaces = [
            (*made.blocks(shifts.scale), number) for _, made, number in self._contacts.rigid()
        ]

    def add(self) -> None:
        """See ``Unilateral``."""
        self._multiply(transposed=False)

    def add_transposed(self) -> None:
        """See ``Unilateral``."""
        self._multiply(transposed=True)

    def add_start(self, change: StateChange) -> FloatArray:
        """See ``Unilateral``: none."""
        return np.zeros(self._rows)

    def start_transposed(self, z: list[FloatArray], mu: FloatArray) -> StateFactors:
        """See ``Unilateral``: none."""
        return StateFactors([np.zeros_like(own) for own in z], [np.zeros_like(own) for own in z])

    def _multiply(self, *, transposed: bool) -> None:
        """Add products with the blocks' steps to their residuals."""
        carriers, frames, steps = self._contacts.carriers, self._contacts.frames, self._steps
        carriers.move(steps)
        twists, subscripts = frames.twists(), "cba,cb->ca" if transposed else "cab,cb->ca"
        self._forces[:] = frames.wrenches[:] = 0.0
        for nodes, blocks in self._triangles:
            own = steps[nodes].reshape(len(nodes), 3 * nodes.shape[1])
            found = np.einsum(subscripts, blocks, own)
            np.add.at(self._forces, nodes, found.reshape(*nodes.shape, 3))
        for nodes, blocks, number in self._surfaces:
            twist = np.tile(twists[number], (len(nodes), 1))
            found = np.einsum(subscripts, blocks, np.concatenate([steps[nodes], twist], axis=1))
            np.add.at(self._forces, nodes, found[:, :3])
            frames.wrenches[number] += found[:, 3:].sum(axis=0)
        carriers.gather(self._forces)
        frames.gather()
        for kind in self._contacts.kinds:
            if kind in carriers.by_kind:
                carriers.add_forces(kind, self._forces)
                self._turn(carriers.by_kind[kind], transposed=transposed)
            frames.add_wrenches(kind)

    def _turn(self, own: CarriedPoints, *, transposed: bool) -> None:
        """Add the change of the loads as their nodes turn."""
        if not own.turns:
            return
        at, loads, step = own.local, self._scale * own.loads, own.block.step[own.local]
        if transposed:
            factors = step[:, :3] + np.cross(step[:, 3:], own.arms)
            np.add.at(own.block.residual[:, 3:], at, np.cross(factors, loads))
            return
        change = np.cross(loads, step[:, 3:])
        moments = np.cross(own.arms, change)
        np.add.at(own.block.residual, at, np.concatenate([change, moments], axis=1))
