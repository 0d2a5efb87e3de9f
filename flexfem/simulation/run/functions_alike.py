# SPDX-License-Identifier: LGPL-3.0-or-later
"""Consistency of user-defined functions between ranks: loads, laws and drives of joints.

Loads and laws are evaluated on every rank, a drive by the ranks of its joint. For a joint on
several ranks the owner's value has the weight of all others together, with the opposite sign, so
that one sum over all ranks vanishes; values are exchanged only if it does not.
"""

from typing import Any

from mpi4py import MPI

import numpy as np

from flexfem._faults import ReturnError, noted
from flexfem._types import FloatArray
from flexfem.model.model import Model
from flexfem.system.system import System

__all__ = ["NONE", "FunctionsAlike"]

#: No outputs of controllers.
NONE: FloatArray = np.empty(0)
#: Relative difference of values between computers that may be rounding.
_ALIKE = 1e-9


class FunctionsAlike:
    """Comparison of the functions of a model at its trial time between ranks.

    Attributes:
        count: number of checksums.
    """

    count = 8

    def __init__(self, system: System, model: Model) -> None:
        """Find the drives that several ranks evaluate."""
        self._system, self._model = system, model
        self._alike_weights = NONE
        rows = system.constraints
        self._shared = [
            i for i, placed in enumerate(rows.joints) if placed.joint.driven and placed.shared
        ]
        of_joint = [np.arange(rows.start[i], rows.start[i + 1]) for i in self._shared]
        self._rows = np.concatenate([np.empty(0, dtype=np.int64), *of_joint])
        others = rows.holders[self._rows - rows.interior] - 1.0
        self._weights = np.where(rows.owned[self._rows] > 0.0, others, -1.0) * _weights(
            rows.numbers[self._rows]
        )

    def checksums(self, outputs: FloatArray = NONE) -> FloatArray:
        """Sums of values common to all ranks and of those that cancel, and their magnitudes.

        Args:
            outputs: outputs of controllers.
        """
        found = np.zeros(self.count)
        alike = self._alike(outputs)
        finite = np.where(np.isfinite(alike), alike, 0.0)
        if len(alike) > len(self._alike_weights):
            self._alike_weights = _weights(np.arange(len(alike)))
        weights = self._alike_weights[: len(alike)]
        found[:2] = weights @ finite, weights @ np.abs(finite)
        if len(self._rows):
            for k, values in enumerate(self._drives(), start=1):
                parts = np.where(np.isfinite(values), values, 0.0) * self._weights
                found[2 * k : 2 * k + 2] = parts.sum(), np.abs(parts).sum()
        return found

    def differ(self, every: FloatArray) -> bool:
        """Return True if the checksums (ranks, count) of all ranks indicate different functions."""
        own, size = every[:, 0], every[:, 1]
        off, sizes = np.abs(every[:, 2::2].sum(axis=0)), every[:, 3::2].sum(axis=0)
        return bool(np.ptp(own) > _ALIKE * size.max() or (off > _ALIKE * sizes).any())

    def _alike(self, outputs: FloatArray) -> FloatArray:
        return np.concatenate([outputs, self._system.factors])

    def _drives(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """For each row of drives on several ranks: its target, force law and directions."""
        rows, r = self._system.constraints, self._rows
        turned = rows.directions.reshape(len(rows.row_of_term), 9) @ _weights(np.arange(9))
        directions = np.bincount(rows.row_of_term, turned, minlength=rows.size)
        return rows.targets[r], rows.elastic[r] @ _weights(np.arange(5)), directions[r]

    def note(self, outputs: FloatArray = NONE) -> None:
        """Record the first function whose values differ between ranks as failed (collective).

        Args:
            outputs: outputs of controllers.
        """
        comm, loads = self._system.comm, self._model.loads
        controllers = self._model.controllers if len(outputs) else []
        every = np.array(comm.allgather(self._alike(outputs)))
        sources: list[tuple[Any, object]] = [
            *((one, one.law) for one in controllers for _ in one.columns),
            *((load, load.amplitude) for load in loads),
        ]
        for (source, function), values in zip(sources, every.T, strict=True):
            if _far_apart(values):
                self._note(f'{type(source).__name__} "{source.name}"', function, values)
                return
        self._note_drive(comm)

    def _note_drive(self, comm: MPI.Intracomm) -> None:
        """Record a drive of a joint whose rows differ between ranks."""
        rows, own = self._system.constraints, dict[int, FloatArray]()
        for i in self._shared:
            at = slice(rows.start[i], rows.start[i + 1])
            terms = slice(rows.term_start[rows.start[i]], rows.term_start[rows.start[i + 1]])
            parts = rows.targets[at], rows.elastic[at].ravel(), rows.directions[terms].ravel()
            own[rows.joints[i].index] = np.concatenate(parts)
        found: dict[int, list[FloatArray]] = {}
        for part in comm.allgather(own):
            for index, values in part.items():
                found.setdefault(index, []).append(values)
        for index, held in sorted(found.items()):
            for values in np.transpose(held):
                if _far_apart(values):
                    joint = self._model.joints[index]
                    function = next(filter(callable, vars(joint).values()))
                    self._note(joint.owner, function, values)
                    return

    def _note(self, owner: str, function: object, values: FloatArray) -> None:
        few, many, t = values.min(), values.max(), self._system.time
        why = f"gives {few:.9g} on one rank and {many:.9g} on another at t = {t:.6g} s"
        noted(owner, function, ReturnError(why))


def _weights(numbers: Any) -> FloatArray:
    """A different weight for each number, so that equal sums mean equal values."""
    weights: FloatArray = 1.5 + np.cos(numbers)
    return weights


def _far_apart(values: FloatArray) -> bool:
    """Return True if values differ by more than rounding."""
    return bool(np.ptp(values) > _ALIKE * np.abs(values).max())
