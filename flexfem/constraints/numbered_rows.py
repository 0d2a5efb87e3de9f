# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rows of the joints of a rank and their numbers among those of all ranks."""

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.constraints.elements.force_elements import ForceElements
from flexfem.constraints.row_table import RowTable
from flexfem.constraints.rows.placed_joint import PlacedJoint
from flexfem.core.state import Numbering

__all__ = ["NumberedRows"]


class NumberedRows(RowTable):
    """Rows of all joints of this rank: rows of one rank only first, shared rows last.

    Attributes:
        comm: communicator.
        interior: number of rows that only this rank evaluates.
        owned: (r,) 1 for rows whose multipliers this rank owns, ``owned_count`` in total.
        numbers: (r,) global numbers of the multipliers, ``size_global`` in total.
        shared_numbers: numbers of the shared rows among those of all ranks, ``shared_size`` in
            total.
        holders: number of ranks that evaluate each shared row.
        elements: joints whose rows have one law together.
        has_elements: True if there are any on any rank.
    """

    def __init__(self, comm: MPI.Intracomm, joints: Sequence[PlacedJoint]) -> None:
        """Collect the rows (collective: numbers the multipliers)."""
        super().__init__(sorted(joints, key=lambda j: (j.shared, j.index)))
        self.comm = comm
        counts = np.diff(self.start)
        shared = np.repeat([j.shared for j in self.joints], counts)
        self.interior = len(self.targets) - int(shared.sum())
        self.owned: FloatArray = np.repeat([float(j.owned) for j in self.joints], counts)
        self._number()
        self.elements = ForceElements(self.layout)
        self.has_elements: bool = comm.allreduce(len(self.elements) > 0, op=MPI.LOR)

    def _number(self) -> None:
        """Global numbers of the multipliers: owners number their rows, the others ask by joint."""
        count = int(self.owned.sum())
        offset = self.comm.scan(count) - count
        self.owned_count = count
        self.size_global: int = self.comm.allreduce(count)
        first = {}
        at = offset
        for i, joint in enumerate(self.joints):
            if joint.owned:
                first[joint.index] = at
                at += int(self.start[i + 1] - self.start[i])
        shared = [j.index for j in self.joints if j.owned and j.shared]
        merged = dict(first)
        for part in self.comm.allgather({index: first[index] for index in shared}):
            merged.update(part)
        numbers = [
            merged[j.index] + np.arange(self.start[i + 1] - self.start[i])
            for i, j in enumerate(self.joints)
        ]
        self.numbers: IntArray = np.concatenate([np.empty(0, dtype=np.int64), *numbers])
        # rows that several ranks evaluate, numbered among themselves in the order of the joints
        listed = np.concatenate(self.comm.allgather(self.numbers[self.interior :]))
        everywhere, holders = np.unique(listed, return_counts=True)
        self.shared_size = len(everywhere)
        self.shared_numbers: IntArray = np.searchsorted(everywhere, self.numbers[self.interior :])
        self.holders: IntArray = holders[self.shared_numbers]

    @property
    def owned_rows(self) -> IntArray:
        """Rows whose multipliers this rank owns, in the order of their global numbers."""
        return np.flatnonzero(self.owned).astype(np.int64)

    def numberings(self) -> dict[str, Numbering]:
        """Rows and terms in the order of the model's joints (collective)."""
        per_joint = {
            "rows": np.diff(self.start),
            "terms": np.diff(self.term_start[self.start]),
            "places": self.lines.counts("places"),
            "line_terms": self.lines.counts("line_terms"),
        }
        if self.has_elements:
            for name in ("element_states", "element_slopes"):
                per_joint[name] = self.elements.counts(name)
        joint = np.array([j.owned for j in self.joints], dtype=np.bool_)
        owned = {name: np.repeat(joint, counts) for name, counts in per_joint.items()}
        return {name: self._in_order(per_joint[name], owned[name]) for name in owned}

    def _in_order(self, counts: IntArray, owned: BoolArray) -> Numbering:
        """Numbering of rows or terms, of which each joint of this rank has ``counts``."""
        comm = self.comm
        index = np.array([j.index for j in self.joints], dtype=np.int64)
        every = np.zeros(comm.allreduce(int(index.max(initial=-1)) + 1, op=MPI.MAX), dtype=np.int64)
        every[index] = counts
        comm.Allreduce(MPI.IN_PLACE, every, op=MPI.MAX)
        first, at = np.cumsum(every) - every, np.cumsum(counts) - counts
        numbers = np.repeat(first[index] - at, counts) + np.arange(int(counts.sum()))
        return Numbering(numbers, owned, int(every.sum()))
