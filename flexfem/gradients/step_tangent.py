# SPDX-License-Identifier: LGPL-3.0-or-later
"""Exact derivatives of the equations of a step at its end, applied forwards and transposed.

The equations are ``F(q, v, w, L) = 0``: those of the blocks, scaled by ``s = beta h^2``, and of the
rows. Derivatives are by the local twists of the nodes and by L. With the maps of
``gradients.node_maps`` the matrix of a step is the sum of three, ``A = K + V + W``: the change with
positions at fixed rates of the increments, with velocities, and with accelerations. Element
matrices are not assembled.
"""

from dataclasses import dataclass, replace

import numpy as np

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.core.nodes.action_kernels import subtract_forces
from flexfem.gradients.kernels import add_products, add_transposed_products
from flexfem.solvers.linear.tangent import part_values
from flexfem.system.mechanics import END_POINT
from flexfem.system.system import BlockPart, Shifts, System

__all__ = ["STEP", "BlockVectors", "StepTangent"]

#: (n_owned, width) for each part.
BlockVectors = list[FloatArray]

#: The matrices of a step: by positions, by velocities and by accelerations.
POSITIONS, VELOCITIES, ACCELERATIONS = range(3)
#: All of them: the matrix of the linearised step.
STEP = (POSITIONS, VELOCITIES, ACCELERATIONS)


@dataclass
class _Entries:
    """Entries of the matrices of a part: local rows and columns, and values (3, k)."""

    rows: IntArray
    columns: IntArray
    values: FloatArray


class StepTangent:
    """Derivatives at a trial state, see the module."""

    def __init__(self, system: System) -> None:
        """Find the places of all entries."""
        self._system = system
        self._entries = [_entries(part) for part in system.parts]
        terms = system.constraints.row_of_term
        self._rows = np.zeros((3, len(terms), 2, 6))
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
        for k, chosen in enumerate((still, *moved)):
            for part, entries in zip(system.parts, self._entries, strict=True):
                entries.values[k] = part_values(system, part, chosen)
                if k:
                    entries.values[k] -= entries.values[0]
            END_POINT.evaluate_rows(system, chosen)
            # equations of force laws are scaled by the slopes, and so by the shifts
            law = rows.compliance > 0.0
            scale = np.divide(compliance, rows.compliance, out=np.ones(rows.size), where=law)
            self._rows[k] = scale[rows.row_of_term][:, np.newaxis, np.newaxis] * rows.step_jacobian
            if k:
                self._rows[k] -= self._rows[0]
        END_POINT.evaluate_rows(system, shifts)
        self._hessians = rows.hessians(rows.multipliers)

    def apply(
        self, blocks: BlockVectors, multipliers: FloatArray, matrices: tuple[int, ...] = STEP
    ) -> tuple[BlockVectors, FloatArray]:
        """Change of the equations of blocks and of rows (r,) (collective).

        Args:
            blocks: local twists.
            multipliers: (r,) changes of L, the same on all ranks that have a row.
            matrices: those that are added up.
        """
        system, rows = self._system, self._system.constraints
        self._put(blocks)
        system.interface.update_steps()
        self._multiply(matrices, transposed=False)
        if POSITIONS in matrices:
            self._turn(self._hessians)
            system.add_constraint_forces(multipliers)
        steps = np.append(system.interface.steps, np.zeros((1, 6)), axis=0)
        jacobian = sum(self._rows[k] for k in matrices)
        sides = np.einsum("tsi,tsi->ts", jacobian, steps[rows.term_nodes])
        return self._collected(), rows.of_rows(sides) - rows.yielding(multipliers)

    def apply_transposed(
        self, blocks: BlockVectors, multipliers: FloatArray, matrices: tuple[int, ...] = STEP
    ) -> tuple[BlockVectors, FloatArray]:
        """The transposed of :meth:`apply` (collective).

        Args:
            blocks: factors of the equations of the blocks.
            multipliers: (r,) of those of the rows, the same on all ranks that have a row.
            matrices: those that are added up.
        """
        system, rows = self._system, self._system.constraints
        self._put(blocks)
        system.interface.update_steps()
        self._multiply(matrices, transposed=True)
        if POSITIONS in matrices:
            self._turn(np.ascontiguousarray(self._hessians.transpose(0, 2, 1)))
        jacobian = sum(self._rows[k] for k in matrices)
        forces = np.zeros((len(system.interface.keys) + 1, 6))
        factors = multipliers[rows.row_of_term][:, np.newaxis, np.newaxis]
        np.add.at(forces, rows.term_nodes, factors * jacobian)
        self._subtract(-forces[:-1])
        if POSITIONS not in matrices:
            return self._collected(), np.zeros(rows.size)
        own = rows.changes(system.interface.steps) - rows.yielding(multipliers)
        return self._collected(), own

    def _put(self, blocks: BlockVectors) -> None:
        """Write vectors to the steps of the blocks, ghosts included, and clear the residuals."""
        for part, values in zip(self._system.parts, blocks, strict=True):
            part.block.owned_step[:] = values
            part.block.spread_step()
            part.block.residual[:] = 0.0

    def _multiply(self, matrices: tuple[int, ...], *, transposed: bool) -> None:
        """Add the products of the blocks' own matrices and steps to the residuals."""
        product = add_transposed_products if transposed else add_products
        for part, own in zip(self._system.parts, self._entries, strict=True):
            block = part.block
            for k in matrices:
                product(
                    own.rows, own.columns, own.values[k], block.width, block.step, block.residual
                )
            block.add_ghosts()

    def _turn(self, hessians: FloatArray) -> None:
        """Add the change of the constraint forces along the steps."""
        system = self._system
        steps = system.interface.steps
        self._subtract(-system.constraints.turning_forces(hessians, steps))

    def _subtract(self, forces: FloatArray) -> None:
        """Subtract forces (n, 6) at interface nodes from the residuals of their owners."""
        for part in self._system.parts:
            if len(part.interface_nodes):
                subtract_forces(forces, part.interface_nodes, part.block.residual)

    def _collected(self) -> BlockVectors:
        return [part.block.hold(part.block.owned_residual.copy()) for part in self._system.parts]


def _entries(part: BlockPart) -> _Entries:
    """Places of the entries of ``part_values``: of cells, masses, forces and fixed unknowns."""
    width, block = part.block.width, part.block
    own = np.concatenate([part.masses.nodes, part.forces.nodes]).astype(np.int64)[:, np.newaxis]
    found = [_places(i, j, width) for i, j in (*part.couplings(), (own, own))]
    if block.dirichlet is not None:
        held = np.flatnonzero(block.dirichlet[: block.owned]).astype(np.int64)
        found.append((held, held))
    rows, columns = (np.concatenate(side) for side in zip(*found, strict=True))
    return _Entries(rows, columns, np.zeros((3, len(rows))))


def _places(
    i: IndexArray | IntArray, j: IndexArray | IntArray, width: int
) -> tuple[IntArray, IntArray]:
    """Rows and columns of dense blocks of nodes (m, k) with nodes (m, l), see ``block_indices``."""
    sides = [
        (width * nodes[..., np.newaxis] + np.arange(width)).reshape(
            len(nodes), width * nodes.shape[1]
        )
        for nodes in (i.astype(np.int64), j.astype(np.int64))
    ]
    rows = np.repeat(sides[0], sides[1].shape[1], axis=1).ravel()
    return rows, np.tile(sides[1], (1, sides[0].shape[1])).ravel()
