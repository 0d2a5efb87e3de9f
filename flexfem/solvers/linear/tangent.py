# SPDX-License-Identifier: LGPL-3.0-or-later
"""The consistent tangent as a block matrix (MATNEST), solved directly.

``[[s (K + c C + m M) + H(L), G^T], [G, -compliance]]`` with H the derivative of the constraint
forces; all blocks have a constant pattern, so that only values are set in an iteration.
"""

import weakref
from collections.abc import Callable

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.la.direct import DirectSolver
from flexfem.la.dropped import destroy_dropped
from flexfem.la.factor import Factor
from flexfem.la.krylov import KrylovFactor
from flexfem.la.nest import (
    CoordinateMatrix,
    block_indices,
    create_nest_matrix,
    create_nest_vector,
)
from flexfem.la.saddle import BodyFactor, SaddleSolver
from flexfem.layout.elements import LumpedElements
from flexfem.layout.tangent_request import TangentRequest
from flexfem.solvers.linear.iterative import is_mass, iterates, krylov_factor
from flexfem.solvers.linear.mass_operator import MassBlock, mass_operator
from flexfem.system.mechanics import END_POINT, Mechanics
from flexfem.system.system import BlockPart, PartStrains, Shifts, System

__all__ = [
    "JointPattern",
    "TangentSolver",
    "of_multipliers",
    "on_diagonals",
    "part_pattern",
    "part_values",
    "with_contacts",
]


#: Stiffness of fixed unknowns, with a mass of 1 kg: their frequency is above all others.
_STIFF = 1e20
#: Relative accuracy of iterative solves with masses, and of those at rest, which may be results.
_ACCURACY, _AT_REST = 1e-12, 1e-10
#: Parts of the nodes' stiffness that make the matrix of a mechanism regular: with factors, and with
#: iterative solves, whose coarsest matrices are factorised.
_SHIFT, _KRYLOV_SHIFT = 1e-12, 1e-8


class TangentSolver:
    """Newton steps, each with a new matrix and a new factorisation.

    Attributes:
        matrix: block matrix (nest) of all blocks.
        multiplier_step: (r,) multipliers' part of the last solution, for all rows of this rank.
        weights: (n_owned, width) of each block, scaled stiffness of the nodes of a system at rest,
            with which iterative solvers hold bodies that only joints hold; None in motion.
    """

    weights: list[FloatArray] | None = None

    def __init__(self, system: System) -> None:
        """Prepare for the first matrix, with which patterns are created (collective)."""
        self.system = system
        sliding = system.constraints.lines.sliding
        self._totals: list[PETSc.Mat] = []  # blocks with contacts
        self._sliding: bool = system.comm.allreduce(sliding, op=MPI.LOR)
        self._masses: bool | None = None
        self._stopping: Callable[[], bool] = bool  # never

    def _create(self, shifts: Shifts) -> None:
        """Create patterns of all blocks for the present nodes of joints (collective).

        Masses have their own, in which joints couple no bodies, until another matrix is assembled:
        runs whose factors of bodies are frozen need no other one.
        """
        self._direct: DirectSolver | None = None
        self._at_rest: SaddleSolver | None = None
        self._methods: dict[int, KrylovFactor] = {}  # of bodies at rest
        system = self.system
        comm, rows = system.comm, system.constraints
        destroy_dropped(comm)  # older patterns
        parts = system.parts
        self._version = rows.lines.version
        self._iterative = [iterates(system, part, shifts) for part in parts]
        self._lumped = [is_mass(shifts) and part.lumped for part in parts]
        self._masses = is_mass(shifts)
        sizes = [p.block.sizes for p in parts]
        if rows.size_global:
            sizes.append((rows.owned_count, rows.size_global))
        self._couplings = JointPattern(system, masses=self._masses)
        self._grid = self._create_grid(sizes)
        self.matrix = create_nest_matrix(
            [[entry.mat for entry in line] for line in self._grid], comm
        )
        self._solver = self._linear_solver(shifts)
        self._rhs, self._solution = (create_nest_vector(sizes, comm) for _ in range(2))
        # all rows of this rank from their owners
        self._multipliers = PETSc.Vec().createSeq(rows.size)
        if rows.size_global:
            index = PETSc.IS().createGeneral(
                rows.numbers.astype(PETSc.IntType), comm=PETSc.COMM_SELF
            )
            last = self._rhs.getNestSubVecs()[-1]
            self._scatter = PETSc.Scatter().create(last, index, self._multipliers, None)

    def _linear_solver(self, shifts: Shifts) -> DirectSolver | SaddleSolver:
        """Solver of the block matrix; the direct one keeps its order of elimination.

        At rest the iterative one keeps its hierarchies and its elimination of multipliers.
        """
        linear = self.system.linear
        if not any(self._iterative):
            self._direct = self._direct or DirectSolver(self.matrix, "tangent_")
            return self._direct
        tolerance = _ACCURACY if is_mass(shifts) else linear.tolerance
        if self.weights is not None:
            tolerance = min(tolerance, _AT_REST)
        own = weakref.proxy(self)  # the owner: both are freed without the collector

        def body_factor(number: int, matrix: PETSc.Mat) -> BodyFactor:
            found: BodyFactor = own._body_factor(number, matrix)
            return found

        def stopping() -> bool:
            return bool(own._stopping())

        solver = self._at_rest or SaddleSolver(
            body_factor, len(self.system.parts), tolerance, linear.counts,
            held=self._held, stopping=stopping,
        )  # fmt: skip
        if self.weights is not None:
            self._at_rest = solver
        return solver

    @property
    def _held(self) -> bool:
        """True if only joints may hold bodies: without masses their own matrices are singular."""
        return self.weights is not None and self.system.constraints.size_global > 0

    @property
    def shift(self) -> float:
        """Part of the nodes' stiffness that makes the matrix of a mechanism regular."""
        return _KRYLOV_SHIFT if any(self._iterative) else _SHIFT

    def _body_factor(self, number: int, matrix: PETSc.Mat) -> BodyFactor:
        """Solver of the block of a part (collective)."""
        part = self.system.parts[number]
        if self._held:
            assert self.weights is not None
            matrix = matrix.copy()
            _add_at_nodes(part.block, matrix, on_diagonals(self.shift * self.weights[number]))
        if not self._iterative[number]:
            return Factor(matrix, part.block.width, local=False, chained=False)
        nodes, shifts = np.arange(part.block.owned), self._shifts
        last = self._methods.get(number)
        method = krylov_factor(self.system.linear, part, matrix, shifts, nodes, last)
        if self.weights is not None:
            self._methods[number] = method
        return method

    def stop_when(self, stopping: Callable[[], bool]) -> None:
        """End iterative solves, without a solution, once a signal has come.

        Args:
            stopping: returns True then (collective).
        """
        self._stopping = stopping

    def leave_rest(self) -> None:
        """Forget what belongs to a system at rest."""
        self.weights, self._at_rest, self._methods = None, None, {}

    def _create_grid(
        self, sizes: list[tuple[int, int]]
    ) -> list[list[CoordinateMatrix | MassBlock]]:
        """Matrices of all blocks; ``sizes`` (local, global) of the parts, then of multipliers."""
        comm, rows, parts = self.system.comm, self.system.constraints, self.system.parts
        grid: list[list[CoordinateMatrix | MassBlock]] = []
        for i, part in enumerate(parts):
            line: list[CoordinateMatrix | MassBlock] = []
            for j in range(len(parts)):
                if i == j and self._masses and self._iterative[i]:
                    line.append(MassBlock(mass_operator(self.system, part, END_POINT)))
                    continue
                row, column = self._couplings.pattern(i, j)
                if i == j:
                    own = part_pattern(part, lumped=self._lumped[i])
                    row, column = np.concatenate([own[0], row]), np.concatenate([own[1], column])
                line.append(CoordinateMatrix(comm, sizes[i], sizes[j], row, column))
            grid.append(line)
        if rows.size_global:
            last, bottom = sizes[-1], list[CoordinateMatrix | MassBlock]()
            for i, line in enumerate(grid):
                unknown, multiplier = self._couplings.gradient(i)
                line.append(CoordinateMatrix(comm, sizes[i], last, unknown, multiplier))
                bottom.append(CoordinateMatrix(comm, last, sizes[i], multiplier, unknown))
            held, pairs = rows.numbers[rows.owned_rows], rows.numbers[rows.coupled[self._coupled()]]
            corners = np.concatenate([np.stack([held, held], axis=1), pairs])
            corner = CoordinateMatrix(comm, last, last, corners[:, 0], corners[:, 1])
            grid.append([*bottom, corner])
        return grid

    def _coupled(self) -> BoolArray:
        """Return flags of the couplings between multipliers that this rank sets."""
        rows = self.system.constraints
        return rows.owned[rows.coupled[:, 0]] > 0.0

    def assemble(
        self, shifts: Shifts, strains: PartStrains | None = None, mechanics: Mechanics = END_POINT
    ) -> None:
        """Set the values of all blocks at the trial state (collective).

        Args:
            shifts: factors of the scheme.
            strains: of each part, whose stresses count; None for the present ones.
            mechanics: the equations.
        """
        system, rows = self.system, self.system.constraints
        self._shifts = shifts
        if self._outdated(shifts):
            self._create(shifts)
        self._iterative = [iterates(system, part, shifts) for part in system.parts]
        self._solver = self._linear_solver(shifts)
        owned = rows.owned
        factor = owned * rows.multipliers * shifts.stiffness
        hessians = mechanics.hessians(system, factor)
        count, strains = len(system.parts), strains or system.present
        for i, part in enumerate(system.parts):
            for j in range(count):
                if isinstance(self._grid[i][j], MassBlock):
                    continue
                values = [self._couplings.values(i, j, hessians)]
                if i == j:
                    request = shifts.request(strains[i])
                    values.insert(
                        0,
                        part_values(
                            system, part, shifts, request, mechanics, lumped=self._lumped[i]
                        ),
                    )
                self._grid[i][j].assemble(np.concatenate(values))
            if rows.size_global:
                forces = self._couplings.side_values(i, rows.force_jacobian)
                steps = mechanics.row_gradients(system, shifts)
                self._grid[i][count].assemble(forces)
                self._grid[count][i].assemble(self._couplings.side_values(i, steps))
        if rows.size_global:
            own = rows.compliance[rows.owned_rows], rows.coupling[self._coupled()]
            self._grid[count][count].assemble(-np.concatenate(own))
        if system.contacts and not self._masses:
            self._add_contacts(shifts)
        self.matrix.assemble()

    def _outdated(self, shifts: Shifts) -> bool:
        """True if patterns are those of other nodes, or lack entries (collective)."""
        if self._masses is None or (self._masses and not is_mass(shifts)):
            return True
        older = self._version != self.system.constraints.lines.version
        return self._sliding and bool(self.system.comm.allreduce(older, op=MPI.LOR))

    def release_masses(self) -> None:
        """Release pattern and factors if they are those of masses alone (collective).

        Another matrix needs others anyway, and with frozen factors of bodies there may be none.
        """
        if self._masses:
            self._masses, self._direct = None, None
            del self._grid, self._couplings, self._solver, self.matrix
            destroy_dropped(self.system.comm)

    def _add_contacts(self, shifts: Shifts) -> None:
        """Create the block matrix again for the sparsity of the present contacts (collective)."""
        parts = self.system.parts
        entries = self.system.contacts[0].entries(shifts.scale * shifts.stiffness)
        closed = any(len(values) for *_, values in entries.values())
        touching = []
        if self.system.comm.allreduce(closed, op=MPI.LOR):
            touching = [i for i, part in enumerate(parts) if part.contacts is not None]
        elif not self._totals:
            return  # the nest may be kept, and with it the order of elimination
        mats = [[entry.mat for entry in line] for line in self._grid]
        self._solver.reset()
        if self._direct is not None:
            self._direct.reset()
        self.matrix.destroy()
        for old in self._totals:
            old.destroy()
        self._totals = []
        for i in touching:
            for j in touching:
                mats[i][j] = with_contacts(parts[i], mats[i][j], shifts, parts[j])
                self._totals.append(mats[i][j])
        self.matrix = create_nest_matrix(mats, self.system.comm)

    def diagonals(self) -> list[FloatArray]:
        """(n_owned, width) diagonals of the blocks' own matrices as assembled last."""
        return [
            self._grid[i][i].mat.getDiagonal().getArray().reshape(-1, part.block.width)
            for i, part in enumerate(self.system.parts)
        ]

    def row_sums(self) -> list[FloatArray]:
        """(n_owned, width) sums of the absolute entries in each row, without multipliers.

        They are zero for fixed unknowns.
        """
        every = []
        for i, part in enumerate(self.system.parts):
            total = np.zeros(part.block.sizes[0])
            for j in range(len(self.system.parts)):
                start, _, values = self.matrix.getNestSubMatrix(i, j).getValuesCSR()
                row = np.repeat(np.arange(len(total)), np.diff(start))
                total += np.bincount(row, np.abs(values), minlength=len(total))
            every.append(part.block.hold(total.reshape(-1, part.block.width)))
        return every

    def add_at_nodes(self, values: list[FloatArray]) -> None:
        """Add (n_owned, width, width) at the nodes of each block until it is assembled again."""
        for i, (part, value) in enumerate(zip(self.system.parts, values, strict=True)):
            # with its contacts
            _add_at_nodes(part.block, self.matrix.getNestSubMatrix(i, i), value)
        self.matrix.assemble()

    def factor(self) -> bool:
        """Factorise the assembled matrix; False when it is singular."""
        if any(self._iterative):
            destroy_dropped(self.system.comm)  # older hierarchies
        return self._solver.factor(self.matrix)

    def solve(self, residuals: list[FloatArray], values: FloatArray) -> bool:
        """Solve ``matrix (dq, dL) = (residuals, values)`` into the blocks' steps.

        Args:
            residuals: (n_owned, width) right-hand side of each block.
            values: (r,) right-hand side of this rank's rows (owned ones are used).

        Returns:
            True if the solution is finite; the multipliers' part is in :attr:`multiplier_step`.
        """
        rows, parts = self.system.constraints, self.system.parts
        pieces = [p.block.hold(r).ravel() for p, r in zip(parts, residuals, strict=True)]
        if rows.size_global:
            pieces.append(values[rows.owned_rows])
        for vec, piece in zip(self._rhs.getNestSubVecs(), pieces, strict=True):
            vec.setArray(piece)
        success = self._solver.solve(self._rhs, self._solution)
        solutions = self._solution.getNestSubVecs()
        for part, vec in zip(parts, solutions, strict=False):
            part.block.owned_step[:] = vec.getArray(readonly=True).reshape(-1, part.block.width)
        if rows.size_global:
            self._scatter.scatter(solutions[-1], self._multipliers)
        self.multiplier_step = np.array(self._multipliers.getArray(readonly=True))
        return success

    def step(
        self, shifts: Shifts, strains: PartStrains | None = None, mechanics: Mechanics = END_POINT
    ) -> tuple[bool, FloatArray]:
        """One Newton step from the evaluated residuals: blocks' steps (to be subtracted).

        Args:
            shifts: factors of the scheme.
            strains: as in :meth:`assemble`.
            mechanics: the equations.

        Returns:
            Success, and the step of the multipliers (r,), to be subtracted.
        """
        self.assemble(shifts, strains, mechanics)
        self.system.counters.factorizations += 1
        if not self.factor():
            return False, np.zeros(self.system.constraints.size)
        blocks = [p.block.owned_residual for p in self.system.parts]
        success = self.solve(blocks, self.system.constraints.values)
        return success, self.multiplier_step

    def again(self, values: FloatArray) -> tuple[bool, FloatArray]:
        """Steps as of :meth:`step` for given row values (r,), with the last factors."""
        success = self.solve([p.block.owned_residual for p in self.system.parts], values)
        return success, self.multiplier_step


def on_diagonals(weights: FloatArray) -> FloatArray:
    """Diagonal matrices (n, width, width) of weights (n, width)."""
    return weights[:, np.newaxis] * np.eye(weights.shape[1])


def of_multipliers(matrix: PETSc.Mat, factors: FloatArray) -> PETSc.Vec:
    """Ones for the nodes and factors (r,) for the multipliers of this rank, its last unknowns.

    Args:
        matrix: an assembled one in one piece.
        factors: of the rank's own rows.
    """
    found = matrix.createVecLeft()
    found.set(1.0)
    values = found.getArray()
    values[len(values) - len(factors) :] = factors
    return found


def _add_at_nodes(block: FrameBlock, matrix: PETSc.Mat, values: FloatArray) -> None:
    """Add (n_owned, width, width) at the nodes to a block's matrix (collective)."""
    nodes = np.arange(block.offset, block.offset + block.owned)
    places = (block.width * nodes[:, np.newaxis] + np.arange(block.width)).astype(PETSc.IntType)
    matrix.setValuesRCV(places, places, values, PETSc.InsertMode.ADD)
    matrix.assemble()


def with_contacts(
    part: BlockPart, matrix: PETSc.Mat, shifts: Shifts, other: BlockPart | None = None
) -> PETSc.Mat:
    """A part's own matrix with its contacts at the state evaluated last (collective).

    With another part, the block of the part's rows and the other's columns.
    """
    assert part.contacts is not None
    second = part if other is None else other
    scale = shifts.scale * shifts.stiffness
    rows, columns, values = part.contacts.entries(scale, second.kind)
    block = part.block
    own = CoordinateMatrix(block.comm, block.sizes, second.block.sizes, rows, columns)
    own.assemble(values)
    total = matrix.copy()
    total.axpy(1.0, own.mat, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    own.mat.destroy()
    return total


def part_pattern(part: BlockPart, *, lumped: bool = False) -> tuple[IndexArray, IndexArray]:
    """Entries of a block's own matrix: cells, masses, forces; lumped masses alone couple no nodes.

    Only a part with :attr:`BlockPart.lumped` can be ``lumped``.
    """
    numbers, widths = part.block.global_ids, (part.block.width, part.block.width)
    if lumped:
        pairs = _lumped_couplings(part)
    else:
        own = np.concatenate([part.masses.nodes, part.forces.nodes]).astype(np.int64)
        pairs = [*part.couplings(), (own[:, np.newaxis], own[:, np.newaxis])]
    entries = [block_indices(numbers[i], numbers[j], widths) for i, j in pairs]
    if part.block.dirichlet is not None:
        entries.append(2 * (_held_unknowns(part.block).astype(PETSc.IntType),))
    entries = [entry for entry in entries if len(entry[0])] or entries[:1]
    if len(entries) == 1:
        return entries[0]
    return np.concatenate([e[0] for e in entries]), np.concatenate([e[1] for e in entries])


def part_values(
    system: System, part: BlockPart, shifts: Shifts, request: TangentRequest | None = None,
    mechanics: Mechanics = END_POINT, *, lumped: bool = False,
) -> FloatArray:  # fmt: skip
    """Values of the entries of ``part_pattern``.

    Fixed unknowns have rows and columns of their own.

    Args:
        system: at the trial state.
        part: part of the system of the matrix.
        shifts: factors of the scheme.
        request: request to its elements, None for that of ``shifts`` at the present stresses.
        mechanics: the equations.
        lumped: see ``part_pattern``.
    """
    width = part.block.width
    if lumped:
        return _lumped_values(system, part, shifts, mechanics)
    at_nodes = mechanics.masses(system, part, shifts), mechanics.forces(system, part, shifts)
    values = [matrices[:, :width, :width].ravel() for matrices in at_nodes]
    if part.elements is not None:
        values.insert(0, mechanics.cells(system, part, shifts, request or shifts.request()))
    values = [own for own in values if len(own)] or values[:1]
    every = np.concatenate(values) if len(values) > 1 else values[0]
    if part.block.dirichlet is None:
        return every
    every[part.dirichlet_entries] = 0.0
    own = shifts.scale * (shifts.acceleration + _STIFF * shifts.stiffness)
    return np.append(every, np.full(len(_held_unknowns(part.block)), own))


def _lumped_couplings(part: BlockPart) -> list[tuple[IndexArray, IndexArray]]:
    """Every owned node with itself, then those of masses at nodes."""
    nodes = np.arange(part.block.owned)[:, np.newaxis], part.masses.nodes[:, np.newaxis]
    return [(own, own) for own in nodes]


def _lumped_values(
    system: System, part: BlockPart, shifts: Shifts, mechanics: Mechanics
) -> FloatArray:
    """Values of the entries of ``part_pattern`` of lumped masses alone."""
    block, elements, factor = part.block, part.elements, shifts.scale * shifts.acceleration
    assert isinstance(elements, LumpedElements)
    own = factor * elements.masses[: block.owned, np.newaxis, np.newaxis] * np.eye(block.width)
    more = mechanics.masses(system, part, shifts)[:, : block.width, : block.width]
    every = np.concatenate([own.ravel(), more.ravel()])
    if block.dirichlet is None:
        return every
    every[part.held_entries(_lumped_couplings(part))] = 0.0
    return np.append(every, np.full(len(_held_unknowns(block)), factor))


def _held_unknowns(block: FrameBlock) -> IntArray:
    """Global numbers of the fixed unknowns that this rank owns."""
    assert block.dirichlet is not None
    return block.width * block.offset + np.flatnonzero(block.dirichlet[: block.owned])


class JointPattern:
    """Positions of the constraints' derivatives in the nest; owners of multipliers set them."""

    def __init__(self, system: System, *, masses: bool = False) -> None:
        """Find parts and numbers of all joints' nodes.

        Args:
            system: the system.
            masses: True for a matrix of masses, which has no second derivatives of rows.
        """
        rows, face = system.constraints, system.interface
        self._widths = [part.block.width for part in system.parts]
        padded = np.append(system.part_of_node, -1)  # interface node -1 is the ground
        number = np.append(face.number, 0)
        self._pair_owned = np.zeros_like(rows.pair_owned) if masses else rows.pair_owned
        self._pair_part, self._pair_number = padded[rows.pair_nodes], number[rows.pair_nodes]
        self._term_owned = rows.owned[rows.row_of_term] > 0.0
        self._term_part, self._term_number = padded[rows.term_nodes], number[rows.term_nodes]
        self._term_multiplier = rows.numbers[rows.row_of_term]

    def _pairs(self, i: int, j: int) -> list[tuple[int, int, IntArray]]:
        """Sides (a, b) and pairs of markers with the node of a in part i, that of b in part j."""
        return [
            (a, b, np.flatnonzero(
                self._pair_owned & (self._pair_part[:, a] == i) & (self._pair_part[:, b] == j)
            ))
            for a in range(2)
            for b in range(2)
        ]  # fmt: skip

    def pattern(self, i: int, j: int) -> tuple[IntArray, IntArray]:
        """Entries of block (i, j)."""
        number, widths = self._pair_number, (self._widths[i], self._widths[j])
        entries = [
            block_indices(number[k, a][:, np.newaxis], number[k, b][:, np.newaxis], widths)
            for a, b, k in self._pairs(i, j)
        ]
        return np.concatenate([e[0] for e in entries]), np.concatenate([e[1] for e in entries])

    def values(self, i: int, j: int, hessians: FloatArray) -> FloatArray:
        """Values of block (i, j) from the pairs' second derivatives (n_pairs, 12, 12)."""
        blocks = hessians.reshape(-1, 2, 6, 2, 6)[:, :, : self._widths[i], :, : self._widths[j]]
        return np.concatenate([blocks[k, a, :, b, :].ravel() for a, b, k in self._pairs(i, j)])

    def _sides(self, i: int) -> list[tuple[int, IntArray]]:
        return [
            (side, np.flatnonzero(self._term_owned & (self._term_part[:, side] == i)))
            for side in range(2)
        ]

    def gradient(self, i: int) -> tuple[IntArray, IntArray]:
        """Entries (unknown, multiplier) of ``G^T`` in part i."""
        unknowns, numbers, width = [], [], self._widths[i]
        for side, t in self._sides(i):
            first = width * self._term_number[t, side][:, np.newaxis]
            unknowns.append((first + np.arange(width)).ravel())
            numbers.append(np.repeat(self._term_multiplier[t], width))
        return np.concatenate(unknowns), np.concatenate(numbers)

    def side_values(self, i: int, jacobian: FloatArray) -> FloatArray:
        """Values of ``gradient(i)`` from gradients (t, 2, 6) of the terms."""
        width = self._widths[i]
        return np.concatenate([jacobian[t, side, :width].ravel() for side, t in self._sides(i)])
