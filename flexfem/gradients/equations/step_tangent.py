# SPDX-License-Identifier: LGPL-3.0-or-later
"""Exact derivatives of the equations of a step at its end, applied forwards and transposed.

The equations are ``F(q, v, w, L) = 0``: those of the blocks, scaled by ``s = beta h^2``, and of the
rows. Derivatives are by the local twists of the nodes and by L. With the maps of
``gradients.equations.node_maps`` the matrix of a step is the sum of three, ``A = K + V + W``: the
change with positions at fixed rates of the increments, with velocities, and with accelerations.
Element matrices are not assembled.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.nodes.action_kernels import subtract_forces
from flexfem.gradients.equations.damped_modes import DampedModes
from flexfem.gradients.equations.kernels import add_products, add_transposed_products
from flexfem.gradients.equations.node_maps import DirectorTurns
from flexfem.gradients.equations.unilateral import StateChange, Unilateral
from flexfem.layout.elements import StepMatrices, TurningElements
from flexfem.system.mechanics import END_POINT, EndPoint
from flexfem.system.system import BlockPart, Shifts, System

__all__ = [
    "STEP", "BlockVectors", "StepTangent", "add_row_forces", "collected", "forces_at_interface",
    "forces_on_blocks", "joined", "places_of", "put_steps", "row_changes", "subtract_from_owners",
]  # fmt: skip

#: (n_owned, width) for each part.
BlockVectors = list[FloatArray]

#: The matrices of a step: by positions, by velocities and by accelerations, and all together.
POSITIONS, VELOCITIES, ACCELERATIONS, STEP = range(4)
_WITH_POSITIONS = (POSITIONS, STEP)
#: Kinds of changes of damped modes in each matrix: with positions (0) and with velocities (1).
_KINDS = ((0,), (1,), (), (0, 1))


def places_of(part: BlockPart) -> list[tuple[IntArray, IntArray]]:
    """Local nodes (m, j) and (m, k) of the rows and columns of equal blocks of a part's matrices.

    They are those of cells, of forces inside them, of masses and of forces at nodes.
    """
    own = np.concatenate([part.masses.nodes, part.forces.nodes]).astype(np.int64)[:, np.newaxis]
    return [
        (np.ascontiguousarray(i, dtype=np.int64), np.ascontiguousarray(j, dtype=np.int64))
        for i, j in (*part.couplings(), (own, own))
    ]


class _PartMatrices:
    """Dense blocks of the matrices of a part, those of fixed unknowns included.

    Attributes:
        places: see :func:`places_of`.
    """

    def __init__(self, part: BlockPart) -> None:
        """Find the places of all entries."""
        self._part, width = part, part.block.width
        self.places = places_of(part)
        sizes = [width**2 * i.shape[0] * i.shape[1] * j.shape[1] for i, j in self.places]
        self._inside = 0 if part.elements is None else len(part.elements.couplings)
        self._cells = np.zeros((4, sum(sizes[: self._inside])))
        self._others = np.zeros((4, sum(sizes[self._inside :])))
        self._first = [
            first
            for part in (sizes[: self._inside], sizes[self._inside :])
            for first in np.cumsum(part) - part
        ]
        self._known = False

    def take(self, system: System, shifts: Shifts) -> None:
        """Compute all matrices but that by positions, where it is the rest."""
        part, width = self._part, self._part.block.width
        every = _parts_of(shifts)
        for values, own in zip(self._others, every, strict=False):
            inside = [
                one.tangent(part.block, system.factors, own.scale) for one in part.line_forces
            ]
            at_nodes = END_POINT.masses(system, part, own), END_POINT.forces(system, part, own)
            matrices = [*inside, *(one[:, :width, :width] for one in at_nodes)]
            values[:] = np.concatenate([one.ravel() for one in matrices])
        _separate(self._others)
        self._known = not isinstance(part.elements, StepMatrices)
        if isinstance(part.elements, StepMatrices):
            part.elements.step_values(
                part.block, system.gravity, shifts.array, shifts.scale, self._cells[1:]
            )
        elif part.elements is not None:
            for values, own in zip(self._cells, every, strict=False):
                values[:] = END_POINT.element_values(system, part, own, own.request())
            _separate(self._cells)
        if isinstance(part.elements, TurningElements) and part.elements.viscous:
            changes = part.elements.rate_changes(part.block, shifts.array, shifts.scale)
            self._cells[:ACCELERATIONS] += changes
            self._cells[STEP] += changes.sum(axis=0)

    def add_stresses(self, values: FloatArray) -> None:
        """Add entries of the cells to the matrix by positions."""
        for matrix in _WITH_POSITIONS if self._known else (STEP,):
            self._cells[matrix] += values

    def transposed_product(self, values: FloatArray) -> FloatArray:
        """Transposed product (n_owned, width) of entries of the cells with the block's steps."""
        block = self._part.block
        block.residual[:] = 0.0
        for (i, j), first in zip(self.places[: self._inside], self._first, strict=False):
            add_transposed_products(i, j, values[first:], block.width, block.step, block.residual)
        block.add_ghosts()
        return block.owned_residual.copy()

    def values(self, matrix: int) -> Iterator[FloatArray]:
        """Entries of a matrix at all places, row by row; more may follow those of a place."""
        if matrix == POSITIONS and not self._known:
            by_velocity, by_acceleration, step = self._cells[1:]
            self._cells[POSITIONS] = step - by_velocity - by_acceleration
            self._known = True
        for k, first in enumerate(self._first):
            yield (self._cells if k < self._inside else self._others)[matrix, first:]


def _parts_of(shifts: Shifts) -> tuple[Shifts, Shifts, Shifts]:
    """Shifts without rates, without accelerations, and without velocities."""
    still = replace(shifts, velocity=0.0, acceleration=0.0)
    return still, replace(shifts, acceleration=0.0), replace(shifts, velocity=0.0)


def _separate(values: FloatArray) -> None:
    """Parts of matrices (4, k) from the first three, for these shifts."""
    values[1:STEP] -= values[POSITIONS]
    np.sum(values[:STEP], axis=0, out=values[STEP])


class StepTangent:
    """Derivatives at a trial state, see the module.

    Attributes:
        turning: True if there are directors on any rank, which turn about themselves without being
            free to, see :class:`DirectorTurns`.
    """

    def __init__(
        self, system: System, mechanics: EndPoint = END_POINT, forces: Sequence[Unilateral] = ()
    ) -> None:
        """Find the places of all entries.

        Args:
            system: the system.
            mechanics: its equations.
            forces: those that elements and rows do not have.
        """
        self._system, self._mechanics, self.forces = system, mechanics, tuple(forces)
        self._matrices = [_PartMatrices(part) for part in system.parts]
        self._modes = DampedModes(system)
        self._rows = np.zeros((4, len(system.constraints.row_of_term), 2, 6))
        self._hessians = np.zeros((0, 12, 12))
        self._turns: list[DirectorTurns] = []  # none without directors
        turning = any((part.block.unturned >= 0).any() for part in system.parts)
        self.turning = bool(system.comm.allreduce(turning, op=MPI.LOR))

    def take(self, shifts: Shifts) -> None:
        """Compute the derivatives at the trial state, whose multipliers are set (collective).

        Residuals of blocks and rows are left evaluated with these shifts.
        """
        system, rows = self._system, self._system.constraints
        self._mechanics.evaluate(system, shifts)
        for one in self.forces:
            one.take(shifts)
        for own in self._matrices:
            own.take(system, shifts)
        if system.modal_dampers is not None:
            self._modes.take(shifts, self._matrices)
            self._mechanics.evaluate(system, shifts)
        compliance, by = rows.compliance.copy(), self._rows
        by[STEP] = rows.step_jacobian
        self._mechanics.evaluate_rows(system, replace(shifts, velocity=0.0))
        # equations of force laws are scaled by the slopes, and so by the shifts
        law = rows.compliance > 0.0
        scale = np.divide(compliance, rows.compliance, out=np.ones(rows.size), where=law)
        by[POSITIONS] = scale[rows.row_of_term][:, np.newaxis, np.newaxis] * rows.step_jacobian
        by[VELOCITIES] = by[STEP] - by[POSITIONS]
        self._mechanics.evaluate_rows(system, shifts)
        # those that act over the step are among the forces
        self._hessians = rows.hessians(np.where(rows.apart, 0.0, rows.multipliers))
        if self.turning:
            self._turns = [DirectorTurns.of(part.block) for part in system.parts]

    def turned(self, blocks: BlockVectors) -> BlockVectors:
        """Local twists with the turns of directors, of those without, in place."""
        for own, turns in zip(blocks, self._turns, strict=False):
            turns.add(own)
        return blocks

    def turned_transposed(self, blocks: BlockVectors) -> BlockVectors:
        """The transposed of :meth:`turned`, in place."""
        for own, turns in zip(blocks, self._turns, strict=False):
            turns.add_transposed(own)
        return blocks

    def apply(
        self, blocks: BlockVectors, multipliers: FloatArray, matrix: int = STEP
    ) -> tuple[BlockVectors, FloatArray]:
        """Change of the equations of blocks and of rows (r,) (collective).

        Args:
            blocks: local twists; those along fixed unknowns count as well.
            multipliers: (r,) changes of L, the same on all ranks that have a row.
            matrix: one of those of the step, or their sum.
        """
        system, rows = self._system, self._system.constraints
        put_steps(system, blocks)
        self._multiply(matrix, transposed=False)
        if matrix in _WITH_POSITIONS:
            self._turn(self._hessians)
            system.add_constraint_forces(multipliers)
            for one in self.forces:
                one.add()
        changes, found = row_changes(system, self._rows[matrix]), collected(system)
        self._modes.add(blocks, found, _KINDS[matrix])
        return found, changes - rows.yielding(multipliers)

    def apply_transposed(
        self, blocks: BlockVectors, multipliers: FloatArray, matrix: int = STEP
    ) -> tuple[BlockVectors, FloatArray]:
        """The transposed of :meth:`apply` (collective).

        Args:
            blocks: factors of the equations of the blocks, zero for fixed unknowns.
            multipliers: (r,) of those of the rows, the same on all ranks that have a row.
            matrix: one of those of the step, or their sum.
        """
        system, rows = self._system, self._system.constraints
        put_steps(system, blocks)
        self._multiply(matrix, transposed=True)
        if matrix in _WITH_POSITIONS:
            self._turn(np.ascontiguousarray(self._hessians.transpose(0, 2, 1)))
            for one in self.forces:
                one.add_transposed()
        add_row_forces(system, self._rows[matrix], multipliers)
        found = [part.block.owned_residual.copy() for part in system.parts]
        self._modes.add_transposed(blocks, found, _KINDS[matrix])
        if matrix not in _WITH_POSITIONS:
            return found, np.zeros(rows.size)
        changes = rows.changes(system.interface.steps)
        return found, changes - rows.yielding(multipliers, transposed=True)

    def by_start(self, change: StateChange) -> tuple[BlockVectors, FloatArray]:
        """Change of the equations by that of the start of the step (collective)."""
        rows = np.zeros(self._system.constraints.size)
        for part in self._system.parts:
            part.block.residual[:] = 0.0
        for one in self.forces:
            rows = rows + one.add_start(change)
        return collected(self._system), rows

    def _multiply(self, matrix: int, *, transposed: bool) -> None:
        """Add the products of the blocks' own matrices and steps to the residuals."""
        product = add_transposed_products if transposed else add_products
        for part, own in zip(self._system.parts, self._matrices, strict=True):
            block = part.block
            for (rows, columns), values in zip(own.places, own.values(matrix), strict=True):
                product(rows, columns, values, block.width, block.step, block.residual)
            block.add_ghosts()

    def _turn(self, hessians: FloatArray) -> None:
        """Add the change of the constraint forces along the steps."""
        system = self._system
        steps = system.interface.steps
        subtract_from_owners(system, -system.constraints.turning_forces(hessians, steps))


def put_steps(system: System, blocks: BlockVectors) -> None:
    """Write vectors to the steps of blocks and interface, and clear the residuals (collective)."""
    for part, values in zip(system.parts, blocks, strict=True):
        part.block.owned_step[:] = values
        part.block.spread_step()
        part.block.residual[:] = 0.0
    system.interface.update_steps()


def forces_on_blocks(system: System, forces: FloatArray) -> BlockVectors:
    """Forces (n, 6) at interface nodes on the blocks that own these."""
    for part in system.parts:
        part.block.residual[:] = 0.0
    subtract_from_owners(system, -forces)
    return collected(system)


def row_changes(system: System, jacobian: FloatArray) -> FloatArray:
    """Changes (r,) of rows with gradients (t, 2, 6) by the steps at the interface."""
    rows = system.constraints
    steps = np.append(system.interface.steps, np.zeros((1, 6)), axis=0)
    sides = np.einsum("tsi,tsi->ts", jacobian, steps[rows.term_nodes])
    return rows.of_rows(sides)


def add_row_forces(system: System, jacobian: FloatArray, multipliers: FloatArray) -> None:
    """Add the transposed :func:`row_changes` of multipliers (r,) to the residuals."""
    subtract_from_owners(system, -forces_at_interface(system, jacobian, multipliers))


def forces_at_interface(
    system: System, jacobian: FloatArray, multipliers: FloatArray
) -> FloatArray:
    """Sums (n, 6) at interface nodes of gradients (t, 2, 6) times multipliers (r,) of rows."""
    rows = system.constraints
    forces = np.zeros((len(system.interface.keys) + 1, 6))
    factors = multipliers[rows.row_of_term][:, np.newaxis, np.newaxis]
    np.add.at(forces, rows.term_nodes, factors * jacobian)
    return forces[:-1]


def subtract_from_owners(system: System, forces: FloatArray) -> None:
    """Subtract forces (n, 6) at interface nodes from the residuals of their owners."""
    for part in system.parts:
        if len(part.interface_nodes):
            subtract_forces(forces, part.interface_nodes, part.block.residual)


def collected(system: System) -> BlockVectors:
    """Residuals of the blocks, without those of what is fixed."""
    return [part.block.hold(part.block.owned_residual.copy()) for part in system.parts]


def joined(blocks: BlockVectors, rows: FloatArray) -> FloatArray:
    """The vector of the parts of all blocks and of the rows."""
    return np.concatenate([*(own.ravel() for own in blocks), rows])
