# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interface system of the frozen solver: a dual Schur complement over all bodies.

``S = G~ A^-1 G^T + compliance``. A body is coupled to it by the active components of its interface
nodes, its columns.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple, Protocol

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.core.runs import starts
from flexfem.kernels.sequence import Call, Step
from flexfem.solvers.frozen.pieces import Bodies
from flexfem.solvers.linear.kept_factors import KeptFactors, with_kept_factors
from flexfem.solvers.linear.multiplier_system import InterfaceSystem
from flexfem.solvers.linear.schur_kernels import (
    BodyColumns,
    add_diagonal,
    row_products,
    schur,
    schur_of_pairs,
    steps_beyond,
)
from flexfem.system.system import BlockPart, System

__all__ = ["MultiplierSystem", "Responding"]

#: Pairs of rows that are numbered at once.
_AT_ONCE = 1_000_000


class Responding(Protocol):
    """Interface of bodies with responses at the interface to right-hand sides."""

    def respond(self, y: FloatArray) -> None:
        """Write ``J A^-1 r`` into interface nodes and components (n, 6)."""
        ...


class Sequenced(Protocol):
    """The same as a step of a sequence."""

    def response(self, y: FloatArray) -> Step:
        """Step of a sequence that does the same."""
        ...


class _Pairs(NamedTuple):
    """Pairs of sides between nodes that their body couples: (k, 2), and the first of each body."""

    sides: IndexArray
    start: IntArray


class MultiplierSystem:
    """Schur complement of the multipliers, and the columns of the bodies of each part in it.

    Attributes:
        groups: bodies of each part, with their columns.
        keepable: True if all rows are linear or rigid, or of force elements, whose derivatives are
            kept, too: factors may then serve several iterations.
    """

    def __init__(self, system: System, *, constant: bool = False, transposed: bool = False) -> None:
        """Find rows and columns of every entry on this rank (collective).

        Args:
            system: system of the multipliers.
            constant: True if the matrices of flexible bodies are those of the first factorisation
                for ever. Nodes that these do not couple, as those of lumped masses, are then not
                coupled in the complement either.
            transposed: True for the transposed couplings between multipliers.
        """
        self._system, self._constant = system, constant
        self._coupled_rows = (1, 0) if transposed else (0, 1)
        rows, face = system.constraints, system.interface
        self._node_column = np.zeros(len(face.keys), dtype=np.int64)
        self._node_active = np.zeros(len(face.keys), dtype=np.int64)
        self._local_node = np.zeros(len(face.keys), dtype=np.bool_)
        self._owned_node = (face.local >= 0)[:, np.newaxis]
        self._response, self._beyond = np.zeros((2, len(face.keys), 6))
        active = rows.active_components()
        self.groups = [self._describe(part, active) for part in system.parts]
        # of each part; None for all pairs of sides, and before the couplings are known
        self._pairs: list[_Pairs | None] = [None] * len(self.groups)
        self._found = not constant
        if self._found:
            self._share_values()
        self._factors: InterfaceSystem | None = None
        self._solver: InterfaceSystem | KeptFactors | None = None
        self._direct = constant or transposed  # their solutions are results as they are
        linear = bool((rows.linear | rows.of_elements).all())
        self.keepable = bool(system.comm.allreduce(linear, op=MPI.LAND))
        self._version = rows.lines.version

    def _describe(self, part: BlockPart, active: IntArray) -> Bodies:
        """Interface columns of a part's bodies and the sides of terms that act on them."""
        bodies, nodes, node_start = part.clusters()
        interface_nodes = np.flatnonzero(
            self._system.part_of_node == self._system.parts.index(part)
        )
        interface_nodes = interface_nodes[
            np.isin(self._system.cluster_of_node[interface_nodes], bodies)
        ]
        number = np.searchsorted(bodies, self._system.cluster_of_node[interface_nodes])
        widths = np.bincount(number, weights=active[interface_nodes], minlength=len(bodies)).astype(
            np.int64
        )
        column_start = starts(widths)
        order = np.argsort(number, kind="stable")
        ordered = interface_nodes[order]
        begin = starts(active[ordered])
        node = np.repeat(ordered, active[ordered])
        columns = np.stack([node, np.arange(begin[-1]) - np.repeat(begin[:-1], active[ordered])], 1)
        self._node_column[ordered] = begin[:-1] - column_start[number[order]]
        self._node_active[interface_nodes], self._local_node[interface_nodes] = (
            active[interface_nodes],
            True,
        )
        sides, per_body = self._sides(interface_nodes, number, len(bodies))
        ranges, range_start = self._ranges(sides, starts(per_body))
        lengths = part.block.width * np.diff(node_start) * widths
        own = BodyColumns(
            width=part.block.width,
            nodes=nodes,
            node_start=node_start,
            right=np.zeros_like(part.block.residual),
            columns=columns,
            column_start=column_start,
            node_column=self._node_column,
            node_active=self._node_active,
            sides=sides,
            side_start=starts(per_body),
            ranges=ranges,
            range_start=range_start,
            responses=np.zeros(0 if part.elements is not None else int(lengths.sum())),
            response_start=starts(lengths),
            compliances=np.zeros(int((widths**2).sum())),
            compliance_start=starts(widths**2),
            entries=np.zeros(0),
        )
        return Bodies(part, own)

    def _sides(
        self, interface_nodes: IntArray, number: IntArray, count: int
    ) -> tuple[IntArray, IntArray]:
        """Sides of terms (term, side, node) on the given nodes by body, and their numbers."""
        body_of_node = np.full(len(self._node_column) + 1, -1, dtype=np.int64)
        body_of_node[interface_nodes] = number
        node = self._system.constraints.term_nodes
        term, side = np.nonzero(body_of_node[node] >= 0)  # interface node -1 is the last entry, -1
        sides = np.stack([term, side, node[term, side]], axis=1).astype(np.int64)
        body = body_of_node[sides[:, 2]]
        sides = np.ascontiguousarray(sides[np.lexsort((sides[:, 2], body))])
        return sides, np.bincount(body, minlength=count).astype(np.int64)

    def _ranges(self, sides: IntArray, start: IntArray) -> tuple[IntArray, IntArray]:
        """Columns on which sides act, in consecutive ranges, and the first range of each body."""
        count = len(start) - 1
        body, node = np.repeat(np.arange(count), np.diff(start)), sides[:, 2]
        first, active = self._node_column[node], self._node_active[node]
        order = np.lexsort((active, first, body))  # nodes without columns before their neighbours
        body, first = body[order], first[order]
        end = first + active[order]
        begins = np.ones(len(body), dtype=np.bool_)
        begins[1:] = (body[1:] != body[:-1]) | (first[1:] > end[:-1])
        ends = np.append(begins[1:], True)[: len(body)]
        ranges = np.stack([first[begins], end[ends]], axis=1)
        return ranges, starts(np.bincount(body[begins], minlength=count))

    def _share_values(self) -> None:
        """Entries of the Schur complement on this rank in one array: of bodies, then of rows."""
        rows, counts = self._system.constraints, []
        for group, pairs in zip(self.groups, self._pairs, strict=True):
            every = (np.diff(group.own.side_start) ** 2).sum()
            counts.append(int(every) if pairs is None else len(pairs.sides))
        ends = np.cumsum([*counts, rows.size])
        self._values = np.zeros(ends[-1] + len(rows.coupled))
        self._correction = np.zeros(rows.size)
        *parts, self._diagonal, self._coupling = np.split(self._values, ends)
        for group, entries in zip(self.groups, parts, strict=True):
            group.own.entries = entries

    def _pattern(self) -> tuple[IndexArray, IndexArray]:
        """Row and column of each of these entries, of which there may be very many."""
        rows = self._system.constraints
        row, column = (rows.coupled[:, k] for k in self._coupled_rows)
        found = np.empty((2, len(self._values)), dtype=np.int32)
        end = found.shape[1] - len(row)
        found[:, end - rows.size : end], found[:, end:] = np.arange(rows.size), (row, column)
        at = 0
        for group, pairs in zip(self.groups, self._pairs, strict=True):
            own = group.own
            out, of_side = found[:, at : at + len(own.entries)], rows.row_of_term[own.sides[:, 0]]
            if pairs is None:
                _write_pairs(of_side, own.side_start, out)
            else:
                out[:] = of_side[pairs.sides.T]
            at += len(own.entries)
        return found[0], found[1]

    def _eliminate(self) -> InterfaceSystem | KeptFactors:
        """Elimination of the entries that are not zero for ever (collective)."""
        if self._solver is not None:
            return self._solver
        rows = self._system.constraints
        i, j = self._pattern()
        self._factors = InterfaceSystem(
            self._system.comm, i, j, rows.interior, rows.shared_numbers, rows.holders,
            rows.grounded,
        )  # fmt: skip
        traffic = self._system.traffic
        traffic.elimination = self._factors.kind
        traffic.largest_front = self._factors.largest_front
        self._solver = self._factors
        if not (self._direct or (self._factors.alone and self._factors.band is not None)):
            self._solver = with_kept_factors(self._system.comm, self._factors, i, j)
        return self._solver

    def _find_pairs(self) -> list[_Pairs | None]:
        """Pairs of sides between nodes that are coupled by their body; None for all of a part."""
        return [
            _coupled_pairs(group.own)
            if group.part.elements is not None and not group.part.block.has_ghosts
            else None
            for group in self.groups
        ]

    def follow_sliders(self) -> None:
        """Update the nodes on which sliders act; the bodies are the same."""
        rows = self._system.constraints
        if rows.lines.version == self._version:
            return
        self._version = rows.lines.version
        for group in self.groups:
            own = group.own
            own.sides[:, 2] = rows.term_nodes[own.sides[:, 0], own.sides[:, 1]]
            own.ranges, own.range_start = self._ranges(own.sides, own.side_start)
        if self._constant and self._found and not _equal(self._pairs, self._find_pairs()):
            self._factors = self._solver = None
            self._found = False

    def factor(self, regular: bool) -> bool:
        """Assemble and factorise; False on all ranks if it is singular on one (collective).

        Args:
            regular: False if a rigid body of this rank has a singular matrix.
        """
        self._assemble()
        if not self._system.constraints.size_global:
            return regular
        return self._eliminate().factor(self._values, regular)

    def _assemble(self) -> None:
        """Compute the entries of the Schur complement of this rank's bodies."""
        rows = self._system.constraints
        if not self._found:
            self._pairs, self._found = self._find_pairs(), True
            self._share_values()
        for group, pairs in zip(self.groups, self._pairs, strict=True):
            if pairs is None:
                schur(group.own.memory, rows.own.memory)
            else:
                schur_of_pairs(group.own.memory, rows.own.memory, pairs.sides, pairs.start)
        np.multiply(rows.owned, rows.compliance, out=self._diagonal)
        if len(rows.coupling):
            self._coupling[:] = rows.owned[rows.coupled[:, 0]] * rows.coupling

    @property
    def correction(self) -> FloatArray:
        """(r,) result of the last solve, always the same array."""
        return self._correction

    @property
    def banded(self) -> bool:
        """True if this rank's unshared rows are a band, known after a factorisation.

        Its factors are those of every iteration then.
        """
        solver = None if self._constant else self._solver
        return isinstance(solver, InterfaceSystem) and solver.band is not None

    def factorisation(self) -> tuple[list[Call], list[Call]]:
        """What :meth:`factor` does if the system is ``banded``, and the calls that test it.

        :meth:`factor_shared` follows.
        """
        rows, factors = self._system.constraints, self._factors
        assert factors is not None
        assert factors.band is not None
        test, *others = factors.band.factorisation(self._values)
        steps = [
            *(Call(schur, group.own.memory, rows.own.memory) for group in self.groups),
            Call(
                add_diagonal, rows.owned, rows.compliance, rows.coupled, rows.coupling,
                self._diagonal, self._coupling,
            ),
            test, *others,
        ]  # fmt: skip
        return steps, [test]

    def factor_shared(self, regular: bool) -> bool:
        """Factorise the rows that ranks share; False on all ranks if one has failed (collective).

        Args:
            regular: False if a test of this rank has failed.
        """
        assert self._factors is not None
        return self._factors.factor_shared(regular)

    def solution(
        self, values: FloatArray, bodies: Sequence[Sequenced], *, beyond: bool,
        regular: BoolArray | None = None,
    ) -> list[Step]:  # fmt: skip
        """What :meth:`solve` does if the system is ``banded``.

        With ``regular`` what :meth:`factor_shared` does as well, see ``InterfaceSystem.solution``.
        """
        rows, steps = self._system.constraints, self._response
        calls = [one.response(self._response) for one in bodies]
        if beyond:
            owned, steps = np.ascontiguousarray(self._owned_node[:, 0]), self._beyond
            moved = self._system.interface.steps
            calls.append(Call(steps_beyond, owned, moved, self._response, steps))
        given = self._local_node, steps, rows.owned, values, self._correction
        calls.append(Call(row_products, rows.own.memory, *given))
        assert self._factors is not None
        return [*calls, *self._factors.solution(self._correction, regular)]

    def solve(
        self, values: FloatArray, bodies: Sequence[Responding], *, beyond: bool = False
    ) -> FloatArray:
        """Correction (r,) of the multipliers, always the same array (collective).

        Args:
            values: right-hand sides (r,) of this rank's rows.
            bodies: those with right-hand sides; the responses of the others are the last ones.
            beyond: True for a correction of the steps already applied at the interface.
        """
        self._load(values, bodies, beyond=beyond)
        assert self._solver is not None  # a factorisation comes first
        self._solver.solve(self._correction)
        return self._correction

    def factor_and_solve(
        self, regular: bool, values: FloatArray, bodies: Sequence[Responding]
    ) -> FloatArray | None:
        """What :meth:`factor` and :meth:`solve` do, with fewer messages (collective).

        Returns:
            See :meth:`solve`; None on all ranks if the system is singular on one.
        """
        self._assemble()
        solver = self._eliminate()
        self._load(values, bodies, beyond=False)
        regular = solver.factor_and_solve(self._values, regular, self._correction)
        return self._correction if regular else None

    def _load(self, values: FloatArray, bodies: Sequence[Responding], *, beyond: bool) -> None:
        """Write the right-hand side of the correction into its array."""
        rows = self._system.constraints
        for one in bodies:
            one.respond(self._response)
        steps = self._response
        if beyond:
            steps = np.multiply(self._owned_node, self._system.interface.steps, out=self._beyond)
            steps += self._response
        row_products(rows.own.memory, self._local_node, steps, rows.owned, values, self._correction)

    def forget_responses(self) -> None:
        """Set the responses of bodies without right-hand sides to zero."""
        self._response[:] = 0.0


def _coupled_pairs(own: BodyColumns) -> _Pairs | None:
    """Pairs of sides between coupled nodes, in the order of :func:`schur`; None if all are."""
    found, counts = [np.zeros((0, 2), dtype=np.int32)], [0] * (len(own.side_start) - 1)
    for b, (start, end) in enumerate(pairwise(own.side_start.tolist())):
        if start == end:
            continue
        first, number = np.unique(own.node_column[own.sides[start:end, 2]], return_inverse=True)
        width = own.column_start[b + 1] - own.column_start[b]
        matrix = own.compliances[own.compliance_start[b] :][: width**2] != 0.0
        blocks = np.logical_or.reduceat(matrix.reshape(width, width), first)
        blocks = np.logical_or.reduceat(blocks, first, axis=1)
        second, side = np.nonzero(blocks[np.ix_(number, number)])
        found.append(start + np.column_stack([side, second]).astype(np.int32))
        counts[b] = len(side)
    if np.array_equal(counts, np.diff(own.side_start) ** 2):
        return None
    return _Pairs(np.concatenate(found), starts(np.array(counts)))


def _equal(some: list[_Pairs | None], others: list[_Pairs | None]) -> bool:
    """True if these are the same pairs."""
    return all(
        (one is None) == (other is None) and all(map(np.array_equal, one or (), other or ()))
        for one, other in zip(some, others, strict=True)
    )


def _write_pairs(rows: IntArray, start: IntArray, out: IndexArray) -> None:
    """First and second (2, k) of all pairs of the rows of each body, the first one fastest.

    Bodies with equally many rows are written together, some of them at a time.
    """
    counts = np.diff(start)
    ends = starts(counts**2)
    for count in np.unique(counts[counts > 0]).tolist():
        bodies = np.flatnonzero(counts == count)
        for some in np.array_split(bodies, 1 + len(bodies) * count**2 // _AT_ONCE):
            own = rows[start[some, np.newaxis] + np.arange(count)]
            at = ends[some, np.newaxis, np.newaxis] + np.arange(count**2).reshape(count, count)
            out[0][at], out[1][at] = own[:, np.newaxis], own[:, :, np.newaxis]
