# SPDX-License-Identifier: LGPL-3.0-or-later
"""Closed contacts as springs beside the factors of the bodies: rows of the groups of pairs."""

from collections.abc import Mapping, Sequence

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.barrier.grouped import GroupedPairs
from flexfem.contact.barrier.spins import Spins
from flexfem.contact.carriers import Carriers, Points
from flexfem.contact.dissipation.coupling import couple, couple_next
from flexfem.contact.tangent_entries import Triplets
from flexfem.core.nodes.frame_block import FrameBlock

__all__ = ["GroupRows"]


class GroupRows:
    """Rows of the groups that act on this rank at the last evaluation; a ``SpringRows``.

    A group has a row along its normal, with friction two more along the slip and across it.

    Attributes:
        slopes: derivative (c,) of each force by its motion, N/m.
        rub: True if there is friction.
        keys: numbers (c,) of the rows, the same in every search; None with friction, whose rows
            turn with the slip.
    """

    def __init__(self, carriers: Carriers, spins: Spins, every: Sequence[GroupedPairs]) -> None:
        """Store the points and all pairs; no rows."""
        self._carriers, self._spins, self._every = carriers, spins, every
        self._steps, self._forces, self._couples = np.zeros((3, len(carriers.serial.start), 3))
        self._compliances = np.zeros((len(carriers.serial.start), 9))
        self.slopes, self._cuts = np.zeros(0), [0]
        self.keys: IntArray | None = None
        self.rub = any(one.rubs for one in every)

    def take(self, factor: float) -> None:
        """Make the rows of all groups, with ``factor`` times their slopes."""
        slopes = [one.slopes.ravel() for one in self._every]
        self.slopes = factor * np.concatenate(slopes)
        self._cuts = np.cumsum([0, *map(len, slopes)]).tolist()
        if not self.rub:
            keys = [len(slopes) * one.keys + k for k, one in enumerate(self._every)]
            self.keys = np.concatenate(keys)

    @property
    def blocks(self) -> dict[int, FrameBlock]:
        """See ``SpringRows``."""
        return {kind: one.block for kind, one in self._carriers.by_kind.items()}

    def coupled(self, compliances: Mapping[int, FloatArray]) -> Triplets:
        """See ``SpringRows``."""
        self._carriers.compliances(compliances, self._compliances)
        found = [
            one.vectors_of_rows(first)
            for one, first in zip(self._every, self._cuts[:-1], strict=True)
        ]
        points, rows, vectors = (np.concatenate(parts) for parts in zip(*found, strict=True))
        points, rows, vectors = _of_nodes(self._carriers.serial, points, rows, vectors)
        # what cannot move, such as the ground, would join all rows that touch it
        moves = self._compliances.any(axis=1)[points]
        points, rows, vectors = points[moves], rows[moves], vectors[moves]
        order = np.argsort(points, kind="stable")
        given = points[order], rows[order], vectors[order], self._compliances
        out = _triplets(couple(*given, _triplets(0)))
        couple(*given, out)
        parts = [out, *self._between(points, rows, vectors, compliances)]
        i, j, values = (np.concatenate(part) for part in zip(*parts, strict=True))
        return i, j, values

    def _between(
        self, points: IntArray, rows: IntArray, vectors: FloatArray,
        compliances: Mapping[int, FloatArray],
    ) -> list[Triplets]:  # fmt: skip
        """The same by what nodes of this rank do at the next ones."""
        found = []
        for kind, own in self._carriers.loads_of(points, vectors).items():
            if compliances[kind].shape[1] == 1 or not len(own.nodes):
                continue
            order = np.argsort(own.nodes, kind="stable")
            given = own.nodes[order], rows[own.entries[order]], own.loads[order], compliances[kind]
            out = _triplets(couple_next(*given, _triplets(0)))
            couple_next(*given, out)
            found.append(out)
        return found

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


def _triplets(count: int) -> Triplets:
    """Memory for so many rows, columns and values."""
    return np.empty(count, np.int64), np.empty(count, np.int64), np.empty(count)


def _of_nodes(
    serial: Points, points: IntArray, rows: IntArray, vectors: FloatArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """The same of points fixed to nodes: those that the others are means of take their parts."""
    between = points >= serial.carried
    if not between.any():
        return points, rows, vectors
    of, kept = points[between] - serial.carried, ~between
    parents, weights = serial.parents[of], serial.weights[of]
    width = parents.shape[1]
    parts = (weights[:, :, np.newaxis] * vectors[between][:, np.newaxis]).reshape(-1, 3)
    return (
        np.concatenate([points[kept], parents.ravel()]),
        np.concatenate([rows[kept], np.repeat(rows[between], width)]),
        np.concatenate([vectors[kept], parts]),
    )
