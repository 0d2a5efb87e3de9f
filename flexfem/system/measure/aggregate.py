# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sensor of the largest value of a function over elements."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from math import inf

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray, IntArray
from flexfem.core.differences import ENOUGH, slopes_of_rows
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.layout.elements import ResultantElements
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.model.probes.aggregate import AggregateProbe
from flexfem.system.system import BlockPart, System

__all__ = ["Aggregate", "ElementValues"]


#: Smallest motion of nodes, over the size of their elements, whose strains are not rounding, and
#: that by which these strains are found.
_SEEN, _TRIED = 1e-9, 1e-6


class ElementValues:
    """Values of a probe's function in the chosen elements of a part.

    Attributes:
        block, support: see :class:`flexfem.layout.family.NodalValues`.
    """

    def __init__(self, part: BlockPart, probe: AggregateProbe) -> None:
        """Find the elements."""
        elements = part.elements
        assert isinstance(elements, ResultantElements)
        self._probe: AggregateProbe = probe
        self._elements: ResultantElements = elements
        named = np.array([body.name in probe.bodies for body in part.family.bodies])
        self._cells: IntArray = np.flatnonzero(named[elements.body])
        self.block: FrameBlock = part.block
        self.support: IntArray = elements.support[self._cells]
        there = self.support >= 0
        points = np.where(there[..., np.newaxis], part.block.start_frames[self.support, :3], 0.0)
        self._places: FloatArray = (
            points.sum(axis=1) / np.maximum(there.sum(axis=1), 1)[:, np.newaxis]
        )

    def values(self) -> FloatArray:
        """Values (m,) at the trial state."""
        return self._of_numbers(self._numbers(self.block.frames))

    def sizes(self) -> FloatArray:
        """Sizes (4,) of strains, of changes of angles, and of their resultants.

        Those of elements without strains are what very small motions of their nodes would do.
        """
        own = self._sizes(self._numbers(self.block.frames))
        found: FloatArray = np.maximum(own, _SEEN / _TRIED * self._strains_of_a_motion)
        return found

    def linearised(
        self, weights: FloatArray, sizes: FloatArray
    ) -> tuple[Callable[[], FloatArray], float, float]:
        """Values (m, 1) to the first order about the present state, as a function of the trial one.

        Args:
            weights: (m,), of whose values derivatives are sought.
            sizes: (4,) on all ranks, see :meth:`sizes`.

        Returns:
            It, by how much the derivatives miss changes along a direction at random, and the
            largest of these, both in sum with the weights.
        """
        still, wanted = self._numbers(self.block.frames), weights != 0.0
        slopes, missed, changes = slopes_of_rows(self._of_numbers, still, np.repeat(sizes, 3))
        slopes[~wanted] = 0.0

        def values() -> FloatArray:
            moved = self._numbers(self.block.frames) - still
            found: FloatArray = (slopes * moved).sum(axis=1, keepdims=True)
            return found

        size = np.abs(weights[wanted])
        return values, float(size @ missed[wanted]), float(size @ changes[wanted])

    def _numbers(self, frames: FloatArray) -> FloatArray:
        """Strains and resultants (m, 12)."""
        if not len(self._cells):
            return np.zeros((0, 12))
        return np.hstack(self._elements.resultants(frames, self._cells))

    def _of_numbers(self, numbers: FloatArray) -> FloatArray:
        if not len(numbers):
            return np.zeros(0)
        found: FloatArray = self._probe.evaluate(numbers[:, :6], numbers[:, 6:], self._places)
        return found

    @staticmethod
    def _sizes(numbers: FloatArray) -> FloatArray:
        found: FloatArray = np.abs(numbers).max(axis=0, initial=0.0).reshape(4, 3).max(axis=1)
        return found

    @cached_property
    def _strains_of_a_motion(self) -> FloatArray:
        """Sizes (4,) of what a motion of the nodes at random does."""
        block, frames = self.block, self.block.start_frames
        motion = np.random.default_rng(1).standard_normal((block.size_global, 6))
        motion = _TRIED * motion[block.global_ids]
        apart = np.linalg.norm(frames[self.support, :3] - self._places[:, np.newaxis], axis=-1)[
            self.support >= 0
        ]
        motion[:, :3] *= apart.max(initial=0.0) or 1.0
        return self._sizes(self._numbers(se3.retract(frames, motion)) - self._numbers(frames))


class Aggregate:
    """The column of a probe, on the first rank.

    Attributes:
        nodal: values of the elements by parts of the system.
    """

    def __init__(self, system: System, serial: NumberedModel, probe: AggregateProbe) -> None:
        """Find the elements (collective).

        Raises:
            InputError: a body has no stress resultants.
        """
        self._comm, self._rho, self._name = system.comm, probe.rho, probe.name
        self.nodal: Sequence[ElementValues] = [
            ElementValues(part, probe) for part in system.parts if _measured(part, serial, probe)
        ]
        self._count = self._comm.allreduce(sum(len(part.support) for part in self.nodal))

    def update(self) -> FloatArray:
        """See :class:`flexfem.layout.family.Sensor` (collective)."""
        largest, exponentials = self._exponentials()
        if self._rho is not None:
            # of ones less one, so that small values are not lost, but where most are far below
            parts = [(float(one.sum()), float((one - 1.0).sum())) for one in exponentials]
            means = np.array(parts).reshape(-1, 2).sum(axis=0) / self._count
            self._comm.Allreduce(MPI.IN_PLACE, means)
            largest += (np.log1p(means[1]) if means[1] > -0.5 else np.log(means[0])) / self._rho
        return np.array([largest if self._comm.rank == 0 else 0.0])

    def linearised(
        self, weights: FloatArray
    ) -> Sequence[tuple[Callable[[], FloatArray], FloatArray]]:
        """See :class:`flexfem.layout.family.NodalSensor` (collective).

        The derivative of the largest value is that of its element, or of the mean of several. The
        function is differentiated by strains and resultants at their own sizes: to change strains
        of stiff bodies by nodes that move takes steps beyond the next kink.

        Raises:
            InputError: the function has a kink.
        """
        _, exponentials = self._exponentials()
        total = self._comm.allreduce(sum(float(one.sum()) for one in exponentials))
        sizes = np.max([np.zeros(4), *(one.sizes() for one in self.nodal)], axis=0)
        self._comm.Allreduce(MPI.IN_PLACE, sizes, op=MPI.MAX)
        found, off = [], np.zeros(2)
        for part, one in zip(self.nodal, exponentials, strict=True):
            own = weights * one / total
            values, *checked = part.linearised(own, sizes)
            found.append((values, own[:, np.newaxis]))
            off += checked
        self._comm.Allreduce(MPI.IN_PLACE, off)
        if off[0] > ENOUGH * off[1]:
            raise InputError(
                f'gradient: AggregateProbe "{self._name}" has a kink or jumps at a state, and has '
                "no derivative there"
            )
        return found

    def _exponentials(self) -> tuple[float, list[FloatArray]]:
        """The largest value f of all, nan if there is one, and ``exp(rho (values - f))``.

        Without rho the latter are 1 for the largest values and 0 for others. Those that are lost in
        their sum are 0: so far below the largest value kinks do not count.
        """
        values = [part.values() for part in self.nodal]
        own = np.array([[one.max(initial=-inf), np.isnan(one).any()] for one in values])
        most = own.max(axis=0)
        self._comm.Allreduce(MPI.IN_PLACE, most, op=MPI.MAX)
        largest = np.nan if most[1] else float(most[0])
        if self._rho is None:
            return largest, [(one == largest).astype(np.float64) for one in values]
        least = np.finfo(np.float64).eps / max(self._count, 1)
        exponentials = [np.exp(self._rho * (one - largest)) for one in values]
        return largest, [np.where(one < least, 0.0, one) for one in exponentials]


def _measured(part: BlockPart, serial: NumberedModel, probe: AggregateProbe) -> bool:
    """True if a part has bodies of a probe.

    Raises:
        InputError: they have no stress resultants.
    """
    names = [body.name for body in part.family.bodies if body.name in probe.bodies]
    if names and not isinstance(part.elements, ResultantElements):
        raise InputError(
            f'AggregateProbe "{probe.name}": {type(serial.model[names[0]]).__name__} '
            f'"{names[0]}" has no stress resultants'
        )
    return bool(names)
