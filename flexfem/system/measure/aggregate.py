# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sensor of the largest value of a function over elements."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray, IntArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.layout.elements import ResultantElements
from flexfem.layout.family import NodalValues
from flexfem.layout.numbered_model import NumberedModel
from flexfem.model.probes.aggregate import AggregateProbe
from flexfem.system.system import BlockPart, System

__all__ = ["Aggregate", "ElementValues"]


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
        self.support = elements.support[self._cells]
        there = self.support >= 0
        points = np.where(there[..., np.newaxis], part.block.start_frames[self.support, :3], 0.0)
        self._places: FloatArray = (
            points.sum(axis=1) / np.maximum(there.sum(axis=1), 1)[:, np.newaxis]
        )

    def values(self) -> FloatArray:
        """See :class:`flexfem.layout.family.NodalValues`."""
        if not len(self._cells):
            return np.zeros((0, 1))
        strains, resultants = self._elements.resultants(self.block.frames, self._cells)
        return self._probe.evaluate(strains, resultants, self._places)[:, np.newaxis]


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
        self._comm, self._rho = system.comm, probe.rho
        self.nodal: Sequence[NodalValues] = [
            ElementValues(part, probe) for part in system.parts if _measured(part, serial, probe)
        ]
        self._count = self._comm.allreduce(sum(len(part.support) for part in self.nodal))

    def update(self) -> FloatArray:
        """See :class:`flexfem.layout.family.Sensor` (collective)."""
        largest, exponentials = self._exponentials()
        if self._rho is not None:
            total = self._comm.allreduce(sum(float(one.sum()) for one in exponentials))
            largest += np.log(total / self._count) / self._rho
        return np.array([largest if self._comm.rank == 0 else 0.0])

    def by_values(self, weights: FloatArray) -> Sequence[FloatArray]:
        """See :class:`flexfem.layout.family.NodalSensor` (collective).

        The derivative of the largest value is that of its element, or of the mean of several.
        """
        _, exponentials = self._exponentials()
        total = self._comm.allreduce(sum(float(one.sum()) for one in exponentials))
        return [weights * one / total for one in exponentials]

    def _exponentials(self) -> tuple[float, list[FloatArray]]:
        """The largest value f of all, nan if there is one, and ``exp(rho (values - f))``.

        Without rho the latter are 1 for the largest values and 0 for others.
        """
        values = [part.values() for part in self.nodal]
        own = np.array([[one.max(initial=-inf), np.isnan(one).any()] for one in values])
        most = own.max(axis=0)
        self._comm.Allreduce(MPI.IN_PLACE, most, op=MPI.MAX)
        largest = np.nan if most[1] else float(most[0])
        if self._rho is None:
            return largest, [(one == largest).astype(np.float64) for one in values]
        return largest, [np.exp(self._rho * (one - largest)) for one in values]


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
