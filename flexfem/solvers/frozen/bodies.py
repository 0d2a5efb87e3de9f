# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies of the frozen solver: frozen factors and interface responses."""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.kernels.sequence import Call, ForeignCall, Number, Step
from flexfem.la.dense import SMALLEST_PIVOT
from flexfem.la.dropped import destroy_dropped
from flexfem.la.factor import Factor
from flexfem.la.nest import CoordinateMatrix
from flexfem.layout.tangent_request import TangentRequest
from flexfem.solvers.frozen.pieces import AnyFactor, Bodies, KeptFactor, Piece
from flexfem.solvers.linear.condensed import CondensedFactor, Latest, Solves
from flexfem.solvers.linear.iterative import is_mass, iterates, krylov_factor
from flexfem.solvers.linear.mass_operator import mass_operator
from flexfem.solvers.linear.schur_kernels import (
    interface_response,
    invert_blocks,
    multiply_blocks,
    rigid_responses,
)
from flexfem.solvers.linear.symmetric_fronts import NodeTree, SymmetricFronts
from flexfem.solvers.linear.tangent import part_pattern, part_values
from flexfem.system.mechanics import EndPoint, Mechanics
from flexfem.system.system import MASS, Shifts, System

__all__ = ["FlexibleBodies", "RigidBodies"]

#: Number of unknowns from which a body has its own factors: a solve then takes much longer than its
#: call.
_ALONE = 600
#: Unknowns of a part from which its matrix is made again for every factorisation of its bodies: it
#: takes the memory of their factors, and a tenth of the time.
_LARGE = 200_000
#: Unknowns of a shell from which its interface comes last in its factors. Fronts of solids are
#: larger, and faster in MUMPS.
_CONDENSED = 6000
#: Nodes from one to the next that are loaded together for compliances of nodes: what one does at
#: another is small in a step of a motion; next nodes whose motions are kept.
_APART, _BESIDE = 10, 4


class RigidBodies:
    """Rigid bodies of one part: their matrices are inverted in every iteration.

    Attributes:
        group: the bodies with their responses.
    """

    def __init__(self, system: System, group: Bodies, mechanics: Mechanics) -> None:
        """Store the bodies and the equations."""
        self._system, self.group, self._mechanics = system, group, mechanics
        self._of_masses = False  # the inverses are those of the masses
        nodes = group.part.masses.nodes
        self._single = np.array_equal(nodes, np.arange(group.part.block.owned))  # one mass each
        self._inverses = np.zeros((group.part.block.owned, 6, 6))

    def invert(self, shifts: Shifts) -> bool:
        """Invert the matrices at the trial state, with compliances; False if one is singular."""
        if self._of_masses and shifts is MASS:
            return True
        system, group, part = self._system, self.group, self.group.part
        masses = self._mechanics.masses(system, part, shifts)
        if self._single:
            blocks = masses
        else:
            blocks = np.zeros((part.block.owned, 6, 6))
            np.add.at(blocks, part.masses.nodes, masses)
        if len(part.forces.nodes):
            np.add.at(blocks, part.forces.nodes, self._mechanics.forces(system, part, shifts))
        regular = bool(invert_blocks(blocks, self._inverses, SMALLEST_PIVOT))
        rigid_responses(group.own.memory, self._inverses)
        self._of_masses = regular and shifts is MASS  # which are constant in the bodies' axes
        return regular

    @property
    def plain(self) -> bool:
        """True if there are no matrices besides those of one mass for each body."""
        of_masses = type(self._mechanics).masses is EndPoint.masses
        return self._single and of_masses and not len(self.group.part.forces.nodes)

    def inversion(self, rates: FloatArray, scale: Number) -> list[Call]:
        """What :meth:`invert` does if they are ``plain``, but for masses alone.

        The second call returns whether all are regular.

        Args:
            rates: ``Shifts.array``, which may change.
            scale: see ``Shifts``.
        """
        system, part, own = self._system, self.group.part, self.group.own
        matrices = np.zeros_like(self._inverses)
        return [
            part.masses.tangent_call(part.block, system.gravity, rates, scale, matrices),
            Call(invert_blocks, matrices, self._inverses, SMALLEST_PIVOT),
            Call(rigid_responses, own.memory, self._inverses),
        ]

    def solution(self) -> list[Step]:
        """What :meth:`solve` does."""
        block = self.group.part.block
        return [Call(multiply_blocks, self._inverses, self.group.own.right, block.step)]

    def response(self, y: FloatArray) -> Step:
        """What :meth:`respond` does."""
        return Call(interface_response, self.group.own.memory, y)

    def of_nodes(self) -> FloatArray:
        """Compliances (n_owned, 1, 6, 6) of the bodies."""
        return self._inverses[:, np.newaxis]

    def respond(self, y: FloatArray) -> None:
        """Write ``J A^-1 r`` for the right-hand sides r into nodes and components (n, 6)."""
        interface_response(self.group.own.memory, y)

    def solve(self, *, transposed: bool = False) -> None:
        """Steps of the owned nodes for their right-hand sides."""
        inverses = self._inverses
        if transposed:
            inverses = np.ascontiguousarray(inverses.transpose(0, 2, 1))
        multiply_blocks(inverses, self.group.own.right, self.group.part.block.step)


class FlexibleBodies:
    """Matrix and factors of the flexible bodies of one part.

    Attributes:
        group: the bodies with their responses.
        split: True if a body is on several ranks, which then factorise matrices together.
        pieces: those of this rank; their factors can be renewed one by one.
        common: number of the piece whose bodies have no factors of their own, those below a size
            and all of a part that is on several ranks; there may be one on every rank, an empty one
            too, and all of them are renewed together. None if this rank's bodies are all large.
    """

    _kept: KeptFactor

    def __init__(self, system: System, group: Bodies, mechanics: Mechanics) -> None:
        """Set up the pattern (collective)."""
        self._system, self.group, self._mechanics = system, group, mechanics
        block = group.part.block
        self._right = group.own.right[: block.owned, : block.width]
        elements = group.part.elements
        self._chained = elements is None or elements.chained
        self._thin = elements is not None and elements.thin
        self.split: bool = block.has_ghosts
        self.common: int | None = None
        self.pieces = self._divide()
        self._trees: list[NodeTree] = []
        # one piece uses right-hand sides and steps in place
        self._whole = len(self.pieces) == 1 and block.width == 6
        local = group.part.interface_nodes[group.own.columns[:, 0]]
        self._held = np.flatnonzero(local >= 0)
        self._ends = local[self._held], group.own.columns[self._held, 1]

    def _divide(self) -> list[Piece]:
        """Pieces: each large body alone, the others together; one if a body is on two ranks."""
        group, block = self.group, self.group.part.block
        rows = block.width * np.diff(group.own.node_start)
        large = (rows >= _ALONE) & (not self.split)
        lists = list(np.flatnonzero(large)[:, np.newaxis])
        if not lists or not large.all():
            lists.insert(0, np.flatnonzero(~large))
            self.common = 0
        body = np.repeat(np.arange(len(rows)), np.diff(group.own.node_start))
        pieces = []
        for bodies in lists:
            nodes = np.sort(group.own.nodes[np.isin(body, bodies)])
            shape = (len(nodes), block.width)
            pieces.append(Piece(bodies, nodes, np.zeros(shape), np.zeros(shape)))
        return pieces

    @property
    def every(self) -> list[int]:
        """Numbers of all pieces of this rank."""
        return list(range(len(self.pieces)))

    def factorise(
        self, shifts: Shifts, request: TangentRequest, chosen: Sequence[int] | None = None
    ) -> KeptFactor:
        """Factorise at the trial state and compute the compliances (collective).

        Args:
            shifts: those of the matrices.
            request: request to the elements.
            chosen: Numbers of this rank's pieces; the others keep the factors in use. None for all
                of them, on all ranks.
        """
        system, part = self._system, self.group.part
        if self._lumped(shifts):
            self._diagonal.assemble(
                part_values(system, part, shifts, mechanics=self._mechanics, lumped=True)
            )
        elif not self._free(shifts):
            self._matrix.assemble(part_values(system, part, shifts, request, self._mechanics))
        destroy_dropped(system.comm)  # older factors
        numbers = self.every if chosen is None else chosen
        latest: Latest = {}
        factors = {k: self._factor(self.pieces[k], shifts, latest) for k in numbers}
        self._forget_matrix()
        origin = self._mechanics.origin(system, part)[0]
        if chosen is None:
            self.use(self._keep(list(factors.values()), origin, self._lumped(shifts)))
        else:
            self._replace(factors, origin)
        if self._lumped(shifts):
            self._respond_alone()
        else:
            for k, factor in factors.items():
                self._respond(self.pieces[k], factor)
        return self._kept

    @cached_property
    def _matrix(self) -> CoordinateMatrix:
        """Matrix of all bodies (collective)."""
        return self._create_matrix(lumped=False)

    @cached_property
    def _diagonal(self) -> CoordinateMatrix:
        """Matrix of lumped masses of all bodies (collective)."""
        return self._create_matrix(lumped=True)

    def _create_matrix(self, *, lumped: bool) -> CoordinateMatrix:
        block = self.group.part.block
        pattern = part_pattern(self.group.part, lumped=lumped)
        return CoordinateMatrix(self._system.comm, block.sizes, block.sizes, *pattern)

    def _lumped(self, shifts: Shifts) -> bool:
        """True if the matrix is that of masses that couple no nodes, on all ranks."""
        return is_mass(shifts) and self.group.part.lumped

    def _free(self, shifts: Shifts) -> bool:
        """True if the matrix is that of masses that need not be assembled, on all ranks."""
        free = is_mass(shifts) and len(self.pieces) == 1 and self._alone
        return free and iterates(self._system, self.group.part, shifts)

    def _forget_matrix(self) -> None:
        """Release a large matrix, of which every piece has its own copy (collective)."""
        large = self.group.part.block.sizes[1] > _LARGE and not (self.split or self._chained)
        if large and "_matrix" in self.__dict__:
            self._matrix.mat.destroy()
            del self._matrix

    @property
    def _alone(self) -> bool:
        """True if all ranks do the same with a piece."""
        return self.split or self._system.comm.size == 1

    def _replace(self, factors: Mapping[int, AnyFactor], origin: Mapping[str, FloatArray]) -> None:
        """Store new factors of some pieces, and the nodal arrays from which they were computed."""
        self._kept.transposed.clear()
        for k, factor in factors.items():
            self._kept.factors[k], self._kept.solvers[k] = factor, self._solver(k, factor)
            self._kept.products[k] = self._product(k, factor)
            for name, values in origin.items():
                self._kept.nodes[name][self.pieces[k].nodes] = values[self.pieces[k].nodes]
        self._kept.halves[:] = self._halves(self._kept.factors, self._kept.solvers)

    def _keep(
        self, factors: list[AnyFactor], origin: Mapping[str, FloatArray], lumped: bool
    ) -> KeptFactor:
        """Allocate the storage of the factors of all pieces (collective).

        Lumped masses have no responses: each node has its own.
        """
        group = self.group
        reads = np.array([group.reads, sum(factor.entries for factor in factors)])
        self._system.comm.Allreduce(MPI.IN_PLACE, reads)
        direct = lumped or bool(reads[0] > reads[1])
        responses = np.zeros(0 if direct else group.own.response_start[-1])
        nodes = {name: values.copy() for name, values in origin.items()}
        solvers = [self._solver(k, factor) for k, factor in enumerate(factors)]
        compliances = np.zeros(len(group.own.compliances))
        products = [self._product(k, factor) for k, factor in enumerate(factors)]
        halves = self._halves(factors, solvers)
        return KeptFactor(
            factors, solvers, halves, products, direct, responses, compliances, nodes, [], []
        )

    def _solver(self, k: int, factor: AnyFactor, *, transposed: bool = False) -> Callable[[], None]:
        """Solve with the factors of piece ``k``, see :meth:`solve`."""
        return factor.solver(*self._arrays(k), transposed=transposed)

    def _arrays(self, k: int) -> tuple[FloatArray, FloatArray]:
        """Right-hand side and solution of piece ``k``."""
        if self._whole:
            return self._right, self.group.part.block.owned_step
        return self.pieces[k].right, self.pieces[k].solution

    def _halves(
        self, factors: Sequence[AnyFactor], solvers: Sequence[Callable[[], None]]
    ) -> list[tuple[Callable[[], None], Callable[[], None]]]:
        """See :class:`KeptFactor`; factors that are not condensed solve twice."""
        halves = []
        alike = dict[SymmetricFronts, list[tuple[CondensedFactor, FloatArray, FloatArray]]]()
        for k, (factor, solve) in enumerate(zip(factors, solvers, strict=True)):
            if isinstance(factor, CondensedFactor):
                alike.setdefault(factor.fronts, []).append((factor, *self._arrays(k)))
            else:
                halves.append((solve, solve))
        for group in alike.values():
            solves = Solves(*zip(*group, strict=True))
            halves.append((solves.respond, solves.complete))
        return halves

    def _transposed_solvers(self) -> list[Callable[[], None]]:
        """Solvers of all pieces with the transposed matrices."""
        kept = self._kept
        if not kept.transposed:
            kept.transposed[:] = [
                self._solver(k, factor, transposed=True) for k, factor in enumerate(kept.factors)
            ]
        return kept.transposed

    def _product(self, k: int, factor: AnyFactor) -> Callable[[], None] | None:
        """Multiply with the matrix of piece ``k``, see :meth:`add_product`."""
        if isinstance(factor, CondensedFactor) or not (factor.kept and self._chained):
            return None
        right, solution = self._arrays(k)
        return factor.multiplier(solution, right)

    def _factor(self, piece: Piece, shifts: Shifts, latest: Latest) -> AnyFactor:
        """Factors of a piece of the matrix, or what takes their place.

        ``latest`` has those of other pieces, which congruent bodies share.
        """
        block = self.group.part.block
        if self._free(shifts):
            matrix = mass_operator(self._system, self.group.part, self._mechanics)
            return krylov_factor(self._system.linear, self.group.part, matrix, shifts, piece.nodes)
        lumped = self._lumped(shifts)
        matrix = (self._diagonal if lumped else self._matrix).mat
        if len(self.pieces) > 1:
            own = block.width * piece.nodes[:, np.newaxis] + np.arange(block.width)
            index = PETSc.IS().createGeneral(
                own.ravel().astype(PETSc.IntType), comm=PETSc.COMM_SELF
            )
            matrix = matrix.getDiagonalBlock().createSubMatrix(index, index)
        rows = piece.right.size if not self.split else block.sizes[1]
        if rows and iterates(self._system, self.group.part, shifts, rows):
            if len(self.pieces) == 1:
                matrix = (matrix if self.split else matrix.getDiagonalBlock()).copy()
                if self._alone:  # large: better made again, by all ranks, than twice in memory
                    del self._matrix
            return krylov_factor(self._system.linear, self.group.part, matrix, shifts, piece.nodes)
        alone = len(piece.bodies) == 1 and not (self.split or lumped)
        if self._thin and alone and rows >= _CONDENSED:
            face = self._place[np.unique(self._ends[0][self._of_piece(piece)])]
            own = matrix.getDiagonalBlock()
            made = CondensedFactor.of(own, block.width, face, self._trees, latest)
            if made is not None:
                return made
        nodes = np.diff(self.group.own.node_start)[piece.bodies]
        return Factor(
            matrix, block.width, not self.split, chained=self._chained or lumped,
            largest=block.width * int(nodes.max(initial=0)),
        )  # fmt: skip

    def _respond(self, piece: Piece, factor: AnyFactor) -> None:
        """Compute compliances, and responses if they are stored, of the bodies of a piece.

        Collective if a body is on several ranks.
        """
        if self._kept.direct and isinstance(factor, CondensedFactor):
            self._take_compliances(piece, factor)
            return
        widths = np.diff(self.group.own.column_start)[piece.bodies]
        most = int(widths.max(initial=0))
        if self.split:
            most = self._system.comm.allreduce(most, op=MPI.MAX)
        # columns of the inverse suffice for compliances, and are faster to solve for than its rows
        transposed = not self._kept.direct
        for first in range(0, most, factor.together):
            numbers = range(first, min(first + factor.together, most))
            right = np.zeros((len(numbers), *piece.right.shape))
            solution = np.zeros_like(right)
            for c, unit in zip(numbers, right, strict=True):
                self._load(piece, piece.bodies[widths > c], c, unit)
            factor.solve_columns(right, solution, transposed=transposed)
            for c, found in zip(numbers, solution, strict=True):
                self._store(piece.bodies[widths > c], c, found)

    def _of_piece(self, piece: Piece) -> BoolArray:
        """(c,) True for the columns of a piece among those of this rank's nodes."""
        own = self.group.own
        body = np.repeat(np.arange(len(own.node_start) - 1), np.diff(own.column_start))
        return np.isin(body[self._held], piece.bodies)

    def _take_compliances(self, piece: Piece, factor: CondensedFactor) -> None:
        """Compliances of the bodies of a piece from that of its interface."""
        own, block = self.group.own, self.group.part.block
        at = np.full(len(piece.nodes), -1)
        at[factor.face] = np.arange(len(factor.face))
        for b in piece.bodies:
            columns = own.columns[own.column_start[b] : own.column_start[b + 1]]
            local = self.group.part.interface_nodes[columns[:, 0]]
            rows = at[self._place[local]] * block.width + columns[:, 1]
            matrix = factor.compliance(rows)
            if block.dirichlet is not None:
                free = ~block.dirichlet[local, columns[:, 1]]
                matrix *= free[:, np.newaxis] & free
            own.compliances[own.compliance_start[b] : own.compliance_start[b + 1]] = matrix.ravel()

    def _respond_alone(self) -> None:
        """Compute compliances of all bodies whose nodes are not coupled (collective if split)."""
        own, block = self.group.own, self.group.part.block
        width = np.diff(own.column_start)
        body = np.repeat(np.arange(len(width)), width)[self._held]
        at = own.compliance_start[body]
        row = self._held - own.column_start[body]
        first = own.node_column[own.columns[self._held, 0]]
        active = own.node_active[own.columns[self._held, 0]]
        own.compliances[:] = 0.0
        for c in range(block.width):
            self._right[:] = 0.0
            self._right[:, c] = 1.0
            self.solve()
            k = np.flatnonzero(c < active)
            place = at[k] + (first[k] + c) * width[body[k]] + row[k]
            own.compliances[place] = block.owned_step[self._ends][k]

    def _load(self, piece: Piece, bodies: IntArray, c: int, right: FloatArray) -> None:
        """Unit force on column ``c`` of every body of a piece, in zero right-hand sides."""
        own, block = self.group.own, self.group.part.block
        columns = own.columns[own.column_start[bodies] + c]
        local = self.group.part.interface_nodes[columns[:, 0]]
        held = local >= 0
        right[self._place[local[held]], columns[held, 1]] = 1.0
        if block.dirichlet is not None:
            right[block.dirichlet[piece.nodes]] = 0.0

    def respond(self, y: FloatArray) -> None:
        """Write ``J A^-1 r`` as :class:`RigidBodies` do (collective).

        Each rank writes a part of a body that is on several. The steps of the nodes are
        overwritten.
        """
        if not self._kept.direct:
            interface_response(self.group.own.memory, y)
            return
        self._solve([respond for respond, _ in self._kept.halves])
        columns = self.group.own.columns
        y[columns[:, 0], columns[:, 1]] = 0.0
        held = columns[self._held]
        y[held[:, 0], held[:, 1]] = self.group.part.block.owned_step[self._ends]

    def of_nodes(self) -> FloatArray | None:
        """Motions (n_owned, k, w, w) of nodes and the next ones by loads; None if not along lines.

        Columns are those of loads. They are about right; joints are left out (collective).
        """
        if self._chained and not self._kept.near:
            block, width, right = self.group.part.block, self.group.part.block.width, self._right
            most = self._system.comm.allreduce(min(block.owned, _APART), op=MPI.MAX)
            found = np.zeros((block.owned, 1 + _BESIDE, width, width))
            for first in range(most):
                for i in range(width):
                    right[:] = 0.0
                    right[first::_APART, i] = 1.0
                    self.solve()
                    for k in range(1 + _BESIDE):
                        moved = block.owned_step[first + k :: _APART]
                        found[first::_APART, k, :, i][: len(moved)] = moved
            self._kept.near.append(found)
        return self._kept.near[0] if self._chained else None

    def solve(self, *, transposed: bool = False) -> None:
        """Steps of the owned nodes for their right-hand sides (collective).

        With ``transposed`` by the transposed matrices.
        """
        self._solve(self._transposed_solvers() if transposed else self._kept.solvers)

    def complete(self) -> None:
        """Steps as of :meth:`solve` after forces were added at the interface (collective).

        Everything else is as in the last :meth:`respond`.
        """
        kept = self._kept
        self._solve([complete for _, complete in kept.halves] if kept.direct else kept.solvers)

    def _solve(self, solvers: Sequence[Callable[[], None]]) -> None:
        """Call the solvers of all pieces, some of several ones, for the right-hand sides."""
        block = self.group.part.block
        right = block.hold(self._right)
        if self._whole:
            solvers[0]()
            return
        step = block.owned_step
        for piece in self.pieces:
            piece.right[:] = right[piece.nodes]
        for solve in solvers:
            solve()
        for piece in self.pieces:
            step[piece.nodes] = piece.solution

    def solution(self) -> list[Step]:
        """What :meth:`complete` does with the factors in use."""
        block = self.group.part.block
        found = None
        if self._whole and block.dirichlet is None:
            found = self._kept.factors[0].foreign_solver(self._right, block.owned_step)
        return [self.complete if found is None else ForeignCall(*found)]

    def response(self, y: FloatArray) -> Step:
        """What :meth:`respond` does with the factors in use."""
        if self._kept.direct or self.split:
            return lambda: self.respond(y)
        return Call(interface_response, self.group.own.memory, y)

    def add_product(self, factor: float) -> bool:
        """Add ``factor`` times the matrices of the factors, times the steps, to the residual.

        False, and nothing is added, where they are not kept or may be out of date: of bodies that
        are not along lines (collective if a body is on several ranks).
        """
        products = self._kept.products
        if not all(products):
            return False
        block = self.group.part.block
        residual, step = block.owned_residual, block.owned_step
        for piece, multiply in zip(self.pieces, products, strict=True):
            assert multiply is not None
            if self._whole:
                multiply()
                residual += factor * self._right
                continue
            piece.solution[:] = step[piece.nodes]
            multiply()
            residual[piece.nodes] += factor * piece.right
        return True

    def use(self, kept: KeptFactor) -> None:
        """Use factors that were computed before."""
        self._kept = kept
        self.group.own.responses, self.group.own.compliances = kept.responses, kept.compliances

    def squares(self, missed: FloatArray) -> FloatArray:
        """Squared norms (p,) of a vector (n_owned, width) in the pieces of this rank."""
        squares = (missed**2).sum(axis=1)
        return np.array([float(squares[piece.nodes].sum()) for piece in self.pieces])

    def rows(self, pieces: Sequence[int]) -> int:
        """Number of unknowns of pieces."""
        return sum(self.pieces[k].right.size for k in pieces)

    @cached_property
    def _place(self) -> IntArray:
        """Position of every owned node in the solution of its piece."""
        place = np.full(self.group.part.block.owned, -1)
        for piece in self.pieces:
            place[piece.nodes] = np.arange(len(piece.nodes))
        return place

    def _store(self, bodies: IntArray, c: int, solution: FloatArray) -> None:
        """Column ``c`` of responses, row ``c`` of compliances; without responses column ``c``."""
        group, place = self.group, self._place
        for b in bodies:
            width = group.own.column_start[b + 1] - group.own.column_start[b]
            nodes = group.own.nodes[group.own.node_start[b] : group.own.node_start[b + 1]]
            if not self._kept.direct:
                a, e = group.own.response_start[b], group.own.response_start[b + 1]
                group.own.responses[a:e].reshape(-1, width)[:, c] = solution[place[nodes]].ravel()
            columns = group.own.columns[group.own.column_start[b] : group.own.column_start[b + 1]]
            local = group.part.interface_nodes[columns[:, 0]]
            held = local >= 0
            values = np.zeros(width)
            values[held] = solution[place[local[held]], columns[held, 1]]
            a, e = group.own.compliance_start[b], group.own.compliance_start[b + 1]
            matrix = group.own.compliances[a:e].reshape(width, width)
            (matrix if self._kept.direct else matrix.T)[c] = values
