# SPDX-License-Identifier: LGPL-3.0-or-later
"""Exact derivatives of the equations of a step at its end, applied forwards and transposed.

The equations are ``F(q, v, w, L) = 0``: those of the blocks, scaled by ``s = beta h^2``, and of the
rows. Derivatives are by the local twists of the nodes and by L. With the maps of
``gradients.equations.node_maps`` the matrix of a step is the sum of three, ``A = K + V + W``: the
change with positions at fixed rates of the increments, with velocities, and with accelerations.
Element matrices are not assembled.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.nodes.action_kernels import subtract_forces
from flexfem.gradients.equations.kernels import add_products, add_transposed_products
from flexfem.layout.elements import SeveralTangents
from flexfem.layout.tangent_request import TangentRequest
from flexfem.solvers.linear.tangent import part_values
from flexfem.system.mechanics import END_POINT, EndPoint
from flexfem.system.system import BlockPart, Shifts, System

__all__ = ["STEP", "BlockVectors", "StepTangent", "forces_on_blocks", "put_steps"]

#: (n_owned, width) for each part.
BlockVectors = list[FloatArray]

#: The matrices of a step: by positions, by velocities and by accelerations, and all together.
POSITIONS, VELOCITIES, ACCELERATIONS, STEP = range(4)
_WITH_POSITIONS = (POSITIONS, STEP)


@dataclass
class _Blocks:
    """Dense blocks of the matrices of a part.

    Attributes:
        nodes: local nodes (m, j) and (m, k) of the rows and columns of equal blocks, each with the
            number of its first entry.
        held: (h,) fixed unknowns of the owned nodes, flat, whose entries are the last ones.
        values: (4, entries).
    """

    nodes: list[tuple[IntArray, IntArray, int]]
    held: IntArray
    values: FloatArray


class StepTangent:
    """Derivatives at a trial state, see the module."""

    def __init__(self, system: System) -> None:
        """Find the places of all entries."""
        self._system = system
        self._blocks = [_blocks(part) for part in system.parts]
        terms = system.constraints.row_of_term
        self._rows = np.zeros((4, len(terms), 2, 6))
        self._hessians = np.zeros((0, 12, 12))

    def take(self, shifts: Shifts) -> None:
        """Compute the derivatives at the trial state, whose multipliers are set (collective).

        Residuals of blocks and rows are left evaluated with these shifts.
        """
        system, rows = self._system, self._system.constraints
        still = replace(shifts, velocity=0.0, acceleration=0.0)
        moved = replace(shifts, acceleration=0.0), replace(shifts, velocity=0.0)
        END_POINT.evaluate(system, shifts)
        compliance = rows.compliance.copy()
        for part, own in zip(system.parts, self._blocks, strict=True):
            mechanics = _Together(system, part, (still, *moved))
            for k, chosen in enumerate((still, *moved)):
                own.values[k] = part_values(system, part, chosen, mechanics=mechanics)
            own.values[1:STEP] -= own.values[0]
        for k, chosen in enumerate((still, *moved)):
            END_POINT.evaluate_rows(system, chosen)
            # equations of force laws are scaled by the slopes, and so by the shifts
            law = rows.compliance > 0.0
            scale = np.divide(compliance, rows.compliance, out=np.ones(rows.size), where=law)
            self._rows[k] = scale[rows.row_of_term][:, np.newaxis, np.newaxis] * rows.step_jacobian
            if k:
                self._rows[k] -= self._rows[0]
        for own in self._blocks:
            np.sum(own.values[:STEP], axis=0, out=own.values[STEP])
        np.sum(self._rows[:STEP], axis=0, out=self._rows[STEP])
        END_POINT.evaluate_rows(system, shifts)
        self._hessians = rows.hessians(rows.multipliers)

    def apply(
        self, blocks: BlockVectors, multipliers: FloatArray, matrix: int = STEP
    ) -> tuple[BlockVectors, FloatArray]:
        """Change of the equations of blocks and of rows (r,) (collective).

        Args:
            blocks: local twists.
            multipliers: (r,) changes of L, the same on all ranks that have a row.
            matrix: one of those of the step, or their sum.
        """
        system, rows = self._system, self._system.constraints
        put_steps(system, blocks)
        self._multiply(matrix, transposed=False)
        if matrix in _WITH_POSITIONS:
            self._turn(self._hessians)
            system.add_constraint_forces(multipliers)
        steps = np.append(system.interface.steps, np.zeros((1, 6)), axis=0)
        sides = np.einsum("tsi,tsi->ts", self._rows[matrix], steps[rows.term_nodes])
        return _collected(system), rows.of_rows(sides) - rows.yielding(multipliers)

    def apply_transposed(
        self, blocks: BlockVectors, multipliers: FloatArray, matrix: int = STEP
    ) -> tuple[BlockVectors, FloatArray]:
        """The transposed of :meth:`apply` (collective).

        Args:
            blocks: factors of the equations of the blocks.
            multipliers: (r,) of those of the rows, the same on all ranks that have a row.
            matrix: one of those of the step, or their sum.
        """
        system, rows = self._system, self._system.constraints
        put_steps(system, blocks)
        self._multiply(matrix, transposed=True)
        if matrix in _WITH_POSITIONS:
            self._turn(np.ascontiguousarray(self._hessians.transpose(0, 2, 1)))
        forces = np.zeros((len(system.interface.keys) + 1, 6))
        factors = multipliers[rows.row_of_term][:, np.newaxis, np.newaxis]
        np.add.at(forces, rows.term_nodes, factors * self._rows[matrix])
        _subtract(system, -forces[:-1])
        if matrix not in _WITH_POSITIONS:
            return _collected(system), np.zeros(rows.size)
        changes = rows.changes(system.interface.steps)
        return _collected(system), changes - rows.yielding(multipliers, transposed=True)

    def _multiply(self, matrix: int, *, transposed: bool) -> None:
        """Add the products of the blocks' own matrices and steps to the residuals."""
        product = add_transposed_products if transposed else add_products
        for part, own in zip(self._system.parts, self._blocks, strict=True):
            block, values = part.block, own.values[matrix]
            for rows, columns, first in own.nodes:
                product(rows, columns, values[first:], block.width, block.step, block.residual)
            if len(own.held):
                places = np.divmod(own.held, block.width)
                block.residual[places] += values[-len(own.held) :] * block.step[places]
            block.add_ghosts()

    def _turn(self, hessians: FloatArray) -> None:
        """Add the change of the constraint forces along the steps."""
        system = self._system
        steps = system.interface.steps
        _subtract(system, -system.constraints.turning_forces(hessians, steps))


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
    _subtract(system, -forces)
    return _collected(system)


def _subtract(system: System, forces: FloatArray) -> None:
    """Subtract forces (n, 6) at interface nodes from the residuals of their owners."""
    for part in system.parts:
        if len(part.interface_nodes):
            subtract_forces(forces, part.interface_nodes, part.block.residual)


def _collected(system: System) -> BlockVectors:
    """Residuals of the blocks, without those of what is fixed."""
    return [part.block.hold(part.block.owned_residual.copy()) for part in system.parts]


class _Together(EndPoint):
    """Equations of a part whose elements compute the matrices of several shifts together."""

    def __init__(self, system: System, part: BlockPart, shifts: Sequence[Shifts]) -> None:
        """Compute the matrices of the elements, if these can do so."""
        self._shifts, self._values = list(shifts), None
        if isinstance(part.elements, SeveralTangents):
            self._values = part.elements.several_values(
                part.block, system.gravity, [one.array for one in shifts], shifts[0].scale
            )

    def element_values(
        self, system: System, part: BlockPart, shifts: Shifts, request: TangentRequest
    ) -> FloatArray:
        """See :class:`EndPoint`."""
        if self._values is None:
            return super().element_values(system, part, shifts, request)
        return self._values[self._shifts.index(shifts)]


def _blocks(part: BlockPart) -> _Blocks:
    """Blocks of ``part_values``: of cells, masses, forces, and entries of fixed unknowns."""
    width, block = part.block.width, part.block
    own = np.concatenate([part.masses.nodes, part.forces.nodes]).astype(np.int64)[:, np.newaxis]
    nodes, first = [], 0
    for i, j in (*part.couplings(), (own, own)):
        rows, columns = (np.ascontiguousarray(side, dtype=np.int64) for side in (i, j))
        nodes.append((rows, columns, first))
        first += width**2 * rows.shape[0] * rows.shape[1] * columns.shape[1]
    held = np.zeros(0, dtype=np.int64)
    if block.dirichlet is not None:
        held = np.flatnonzero(block.dirichlet[: block.owned]).astype(np.int64)
    return _Blocks(nodes, held, np.zeros((4, first + len(held))))
