# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies of one part of the system, as the frozen solver sees them, and their kept factors."""

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.la.dropped import destroy_dropped
from flexfem.la.factor import Factor
from flexfem.la.nest import CoordinateMatrix
from flexfem.solvers.schur_kernels import interface_response
from flexfem.solvers.tangent import part_pattern, part_values
from flexfem.system.system import BlockPart, Shifts, System

__all__ = ["Bodies", "FlexibleBodies", "KeptFactor"]


@dataclass
class Bodies:
    """Bodies of one part with their interface columns; rigid bodies have one node each.

    ``responses`` holds the rows of ``A^-T J^T``, or nothing where another solve with the factors
    costs less than they do, ``compliances`` the matrices ``J A^-1 J^T``. Of the columns of a body
    those in its ``ranges`` (first, end), ``range_start`` by body, are acted on; a slider visits the
    others later.
    """

    part: BlockPart
    nodes: IntArray
    node_start: IntArray
    columns: IntArray
    column_start: IntArray
    sides: IntArray
    side_start: IntArray
    ranges: IntArray
    range_start: IntArray
    compliance_start: IntArray
    response_start: IntArray
    compliances: FloatArray
    responses: FloatArray
    entries: FloatArray

    @property
    def reads(self) -> int:
        """Numbers of the responses that :meth:`respond` reads, if they are kept."""
        per_range = self.ranges[:, 1] - self.ranges[:, 0]
        body = np.repeat(np.arange(len(self.node_start) - 1), np.diff(self.range_start))
        rows = self.part.block.width * np.diff(self.node_start)
        return int(rows[body] @ per_range)

    def respond(self, y: FloatArray) -> None:
        """Write ``J A^-1 r`` for the residuals r into slots and components (n, 6)."""
        interface_response(
            self.nodes, self.node_start, self.columns, self.column_start, self.ranges,
            self.range_start, self.responses, self.response_start, self.part.block.residual,
            self.part.block.width, y,
        )  # fmt: skip


@dataclass(frozen=True)
class KeptFactor:
    """Factors of the flexible bodies of a part for one step size.

    ``nodes`` are the arrays of ``Mechanics.origin`` that they were computed from; ``direct`` tells
    that there are no responses, see :class:`Bodies`.
    """

    factor: Factor
    direct: bool
    responses: FloatArray
    compliances: FloatArray
    nodes: dict[str, FloatArray]


class FlexibleBodies:
    """Matrix and factors of the flexible bodies of one part.

    Attributes:
        group: the bodies with their responses.
        factor: the factors in use.
    """

    factor: Factor
    _direct: bool

    def __init__(self, system: System, group: Bodies) -> None:
        """Set up the pattern (collective)."""
        self._system, self.group = system, group
        block = group.part.block
        self._matrix = CoordinateMatrix(
            system.comm, block.sizes, block.sizes, *part_pattern(group.part)
        )
        elements = group.part.elements
        self._chained = elements is None or elements.chained
        local = group.part.slots[group.columns[:, 0]]
        self._held = np.flatnonzero(local >= 0)
        self._ends = local[self._held], group.columns[self._held, 1]
        # solvers take numbers one after the other, blocks have six places for every node
        shape = (block.owned, block.width)
        self._packed = None if block.width == 6 else (np.zeros(shape), np.zeros(shape))

    def factorise(self, shifts: Shifts) -> KeptFactor:
        """Factorise at the trial state and compute the compliances (collective)."""
        system, group, part = self._system, self.group, self.group.part
        group.compliances = np.zeros(len(group.compliances))
        self._matrix.assemble(part_values(system, part, shifts))
        width = part.block.width
        destroy_dropped(system.comm)  # older factors
        self.factor = Factor(
            self._matrix.mat, width, not part.block.has_ghosts, chained=self._chained,
            largest=width * int(np.diff(group.node_start).max(initial=0)),
        )  # fmt: skip
        reads = np.array([group.reads, self.factor.entries])
        system.comm.Allreduce(MPI.IN_PLACE, reads)
        self._direct = bool(reads[0] > reads[1])
        group.responses = np.zeros(0 if self._direct else group.response_start[-1])
        widths = np.diff(group.column_start)
        most = system.comm.allreduce(int(widths.max(initial=0)), op=MPI.MAX)
        shape = (part.block.owned, part.block.width)
        rhs, solution = np.zeros(shape), np.zeros(shape)
        for c in range(most):
            bodies = np.flatnonzero(widths > c)
            columns = group.columns[group.column_start[bodies] + c]
            local = part.slots[columns[:, 0]]
            held = local >= 0
            rhs[:] = 0.0
            rhs[local[held], columns[held, 1]] = 1.0
            part.block.hold(rhs)
            self.factor.solve_transpose(rhs, solution)
            self._store(bodies, c, solution)
        nodes, _ = system.mechanics.origin(system, part)
        copies = {name: values.copy() for name, values in nodes.items()}
        return KeptFactor(self.factor, self._direct, group.responses, group.compliances, copies)

    def respond(self, y: FloatArray) -> None:
        """See :meth:`Bodies.respond`; of a body on several ranks each writes a part (collective).

        The steps of the nodes are lost.
        """
        if not self._direct:
            self.group.respond(y)
            return
        self.solve()
        columns = self.group.columns
        y[columns[:, 0], columns[:, 1]] = 0.0
        held = columns[self._held]
        y[held[:, 0], held[:, 1]] = self.group.part.block.owned_step[self._ends]

    def solve(self) -> None:
        """Steps of the owned nodes for their residuals (collective)."""
        block = self.group.part.block
        if self._packed is None:
            self.factor.solve(block.hold(block.owned_residual), block.owned_step)
            return
        right, solution = self._packed
        right[:] = block.hold(block.owned_residual)
        self.factor.solve(right, solution)
        block.owned_step[:] = solution

    def use(self, kept: KeptFactor) -> None:
        """Take factors that were computed before."""
        self.factor, self._direct = kept.factor, kept.direct
        self.group.responses, self.group.compliances = kept.responses, kept.compliances

    def _store(self, bodies: IntArray, c: int, solution: FloatArray) -> None:
        """Column ``c`` of the responses, row ``c`` of the compliances of the given bodies."""
        group = self.group
        for b in bodies:
            width = group.column_start[b + 1] - group.column_start[b]
            nodes = group.nodes[group.node_start[b] : group.node_start[b + 1]]
            if not self._direct:
                a, e = group.response_start[b], group.response_start[b + 1]
                group.responses[a:e].reshape(-1, width)[:, c] = solution[nodes].ravel()
            columns = group.columns[group.column_start[b] : group.column_start[b + 1]]
            local = group.part.slots[columns[:, 0]]
            row = np.where(local >= 0, solution[local, columns[:, 1]], 0.0)
            a, e = group.compliance_start[b], group.compliance_start[b + 1]
            group.compliances[a:e].reshape(width, width)[c] = row
