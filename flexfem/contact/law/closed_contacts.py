# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lagged contacts, on which friction and damping act during a step."""

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray, IntArray
from flexfem.contact.law.friction import friction_forces, friction_losses
from flexfem.kernels.compiled import kernel

__all__ = ["MOST_CLOSED", "ClosedContacts", "ContactLaw"]

#: Contacts of one node with one surface, at most.
MOST_CLOSED = 4


@dataclass(frozen=True)
class ContactLaw:
    """Friction and damping law of contacts; ``stiffening`` has their elastic normal force.

    Attributes:
        friction: Coulomb's coefficient.
        damping: Viscous part of the normal force: stiffness times this, seconds, times the rate.
        stick: Tangential stiffness over the normal one, with friction.
    """

    friction: float = 0.0
    damping: float = 0.0
    stick: float = 1.0

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            TypeError: one of them is no number.
            ValueError: one of them is negative, or the tangential stiffness is not positive.
        """
        _checks.number("ContactLaw", "friction", self.friction, nonnegative=True)
        _checks.number("ContactLaw", "damping", self.damping, nonnegative=True)
        _checks.number("ContactLaw", "stick", self.stick, positive=True)

    @property
    def elastic(self) -> bool:
        """True if there is neither friction nor damping."""
        return self.friction == 0.0 and self.damping == 0.0


@dataclass
class ClosedContacts:
    """Contacts closed at the last accepted state, ascending by slave.

    Attributes:
        law: Friction and damping.
        slaves: Number of each contact's slave, shape (c,).
        normals: Shape (c, 3).
        pushes: Normal forces, shape (c,), newtons.
        pulls: Tangential forces on the residual of the slave, shape (c, 3), newtons.
        stiffness: Normal stiffness, shape (c,), N/m.
        numbers: Coefficient of friction, and over the normal stiffness the tangential one and the
            damping divided by the step, shape (3,).
        slips: Relative displacements at the trial state, shape (c, 3), m.
        forces, tangents: At the trial state, shapes (c, 3) and (c, 3, 3).
        origins: Number of the contact of the step before that gave each its tangential force, -1
            for none, shape (c,).
        lost: Energy dissipated in all accepted steps, J.
        acted: Sum of the forces at the end of the step before, on the contacts of its start, also
            of those that have opened in it, shape (3,), newtons.
    """

    law: ContactLaw
    slaves: IntArray
    normals: FloatArray
    pushes: FloatArray
    pulls: FloatArray
    stiffness: FloatArray
    lost: float = 0.0
    forces: FloatArray = field(init=False)
    tangents: FloatArray = field(init=False)
    origins: IntArray = field(init=False)
    slips: FloatArray = field(init=False)
    numbers: FloatArray = field(init=False)
    acted: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        """Allocate forces and tangents."""
        count = len(self.slaves)
        self.forces, self.tangents = np.zeros((count, 3)), np.zeros((count, 3, 3))
        self.origins = np.full(count, -1)
        self.slips, self.acted = np.zeros((count, 3)), np.zeros(3)
        self.numbers = np.array([self.law.friction, self._stick, 0.0])

    @classmethod
    def none(cls, law: ContactLaw) -> Self:
        """No contacts."""
        nothing = np.zeros((0, 3))
        return cls(law, np.zeros(0, np.int64), nothing, np.zeros(0), nothing.copy(), np.zeros(0))

    def evaluate(self, slips: FloatArray, h: float) -> None:
        """Forces and tangents for relative displacements (c, 3), m, in a step of ``h`` seconds."""
        self.numbers[2] = self.law.damping / h if h > 0.0 else 0.0
        self.slips = slips
        friction_forces(
            slips, self.normals, self.pushes, self.pulls, self.stiffness, self.numbers,
            self.forces, self.tangents,
        )  # fmt: skip

    @property
    def stored(self) -> float:
        """Energy stored by sticking at the start of the step, J."""
        sticking = self._sticking()
        stuck = sticking > 0.0
        return float(0.5 * ((self.pulls[stuck] ** 2).sum(1) / sticking[stuck]).sum())

    def follow(
        self, slaves: IntArray, normals: FloatArray, pushes: FloatArray, stiffness: FloatArray
    ) -> "ClosedContacts":
        """The contacts of the next step, from those that are closed at its start.

        Tangential forces are rotated into the new planes; those of open contacts vanish, and their
        stored energy is dissipated.
        """
        sticking = self._sticking()
        lost = self.lost + friction_losses(
            self.slips, self.normals, self.pulls, sticking, self.forces
        )
        pulls, origins = np.zeros((len(slaves), 3)), np.full(len(slaves), -1)
        before = 0.0
        if self.law.friction > 0.0:
            tangential = self.forces - self.normals * np.sum(
                self.forces * self.normals, axis=1, keepdims=True
            )
            _carry(self.slaves, self.normals, tangential, slaves, normals, pulls, origins)
            before = float(0.5 * ((tangential**2).sum(1) / sticking).sum())
        made = ClosedContacts(self.law, slaves, normals, pushes, pulls, stiffness, lost)
        made.lost += before - made.stored
        made.origins, made.acted = origins, self.forces.sum(axis=0)
        return made

    def packed(self, count: int, extra: FloatArray) -> FloatArray:
        """The contacts of each of some slaves in a row, shape (count, MOST_CLOSED (8 + k)).

        Args:
            count: Number of slaves.
            extra: Further numbers of each contact, shape (c, k).
        """
        ones = np.ones((len(self.slaves), 2))
        ones[:, 1] = self.pushes
        every = np.concatenate([ones, self.normals, self.pulls, extra], axis=1)
        rows = np.zeros((count, MOST_CLOSED, every.shape[1]))
        first = np.searchsorted(self.slaves, self.slaves)
        rows[self.slaves, np.arange(len(self.slaves)) - first] = every
        return rows.reshape(count, MOST_CLOSED * every.shape[1])

    @classmethod
    def unpacked(
        cls, law: ContactLaw, rows: FloatArray, stiffness: FloatArray
    ) -> tuple[Self, FloatArray]:
        """Contacts and their further numbers from rows; the slaves have the stiffness (s,)."""
        every = rows.reshape(len(rows), MOST_CLOSED, rows.shape[1] // MOST_CLOSED)
        slaves, place = np.nonzero(every[:, :, 0] > 0.0)
        found = every[slaves, place]
        normals, pulls = found[:, 2:5].copy(), found[:, 5:8].copy()
        made = cls(law, slaves, normals, found[:, 1].copy(), pulls, stiffness[slaves])
        return made, found[:, 8:].copy()

    @property
    def _stick(self) -> float:
        """Tangential stiffness over the normal one."""
        return self.law.stick if self.law.friction > 0.0 else 0.0

    def _sticking(self) -> FloatArray:
        return self.stiffness * self._stick


@kernel
def _carry(
    old_slaves: IntArray, old_normals: FloatArray, old_pulls: FloatArray, slaves: IntArray,
    normals: FloatArray, pulls: FloatArray, origins: IntArray,
) -> None:  # fmt: skip
    """Assign to each contact the tangential force of its slave in the most similar contact.

    The numbers of these are ``origins``.
    """
    for c in range(len(slaves)):
        first, last = np.searchsorted(old_slaves, slaves[c]), old_slaves.size
        best, one = 0.5, -1
        for o in range(first, last):
            if old_slaves[o] != slaves[c]:
                break
            along = 0.0
            for a in range(3):
                along += old_normals[o, a] * normals[c, a]
            if along > best:
                best, one = along, o
        origins[c] = one
        if one < 0:
            continue
        along = size = turned = 0.0
        for a in range(3):
            along += old_pulls[one, a] * normals[c, a]
            size += old_pulls[one, a] ** 2
        for a in range(3):
            pulls[c, a] = old_pulls[one, a] - along * normals[c, a]
            turned += pulls[c, a] ** 2
        for a in range(3):
            pulls[c, a] *= np.sqrt(size / turned) if turned > 0.0 else 0.0
