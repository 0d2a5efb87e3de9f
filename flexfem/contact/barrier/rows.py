# SPDX-License-Identifier: LGPL-3.0-or-later
"""Closed contacts as springs beside the factors of the bodies: rows of the groups of pairs."""

from collections.abc import Sequence

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.barrier.grouped import GroupedPairs
from flexfem.contact.barrier.spins import Spins
from flexfem.contact.carriers import Carriers

__all__ = ["GroupRows"]


class GroupRows:
    """Rows of the groups that act on this rank at the last evaluation; a ``SpringRows``.

    A group has a row along its normal, with friction two more along the slip and across it.

    Attributes:
        slopes: derivative (c,) of each force by its motion, N/m.
        rub: True if there is friction.
    """

    def __init__(self, carriers: Carriers, spins: Spins, every: Sequence[GroupedPairs]) -> None:
        """Store the points and all pairs; no rows."""
        self._carriers, self._spins, self._every = carriers, spins, every
        self._steps, self._forces, self._couples = np.zeros((3, len(carriers.serial.start), 3))
        self.slopes, self._cuts = np.zeros(0), [0]
        self.rub = any(one.rubs for one in every)

    def take(self, factor: float) -> None:
        """Make the rows of all groups, with ``factor`` times their slopes."""
        slopes = [one.slopes.ravel() for one in self._every]
        self.slopes = factor * np.concatenate(slopes)
        self._cuts = np.cumsum([0, *map(len, slopes)]).tolist()

    def motions(self) -> FloatArray:
        """See ``SpringRows``."""
        self._carriers.move(self._steps)
        spins = self._spins.of_steps(self._steps)
        found = [one.motions(self._steps, spins).ravel() for one in self._every]
        return np.concatenate(found)

    def push(self, forces: FloatArray) -> None:
        """See ``SpringRows``."""
        self._forces[:] = self._couples[:] = 0.0
        for one, first, last in zip(
            self._every, self._cuts[:-1], self._cuts[1:], strict=True
        ):  # fmt: skip
            rows = np.ascontiguousarray(forces[first:last]).reshape(one.slopes.shape)
            one.push(rows, self._forces, self._couples)
        self._spins.gather(self._couples, self._forces)
        self._carriers.gather(self._forces)
        for kind in self._carriers.by_kind:
            self._carriers.add_forces(kind, self._forces)
            self._spins.add_couples(kind, self._couples)
