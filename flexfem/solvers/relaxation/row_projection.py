# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints in dynamic relaxation: forces of springs, projection onto the constraint equations.

A step v is projected to satisfy the constraints to first order, ``Phi + G v = 0``, by multipliers
of ``G M^-1 G^T``, M being diagonal.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.solvers.linear.multiplier_system import InterfaceSystem
from flexfem.system.system import System

__all__ = ["RowProjection"]


class RowProjection:
    """Forces and projection of the rows of a system."""

    def __init__(self, system: System) -> None:
        """Find the rows at each node (collective)."""
        self._system, rows = system, system.constraints
        local = np.full(len(system.part_of_node) + 1, False)
        for part in system.parts:
            local[:-1] |= part.interface_nodes >= 0
        term, side = np.nonzero(local[rows.term_nodes])
        node = rows.term_nodes[term, side]
        order = np.argsort(node, kind="stable")
        term, side, node = term[order], side[order], node[order]
        first, count = np.searchsorted(node, node), np.bincount(node, minlength=1)[node]
        one = np.repeat(np.arange(len(node)), count)
        other = np.arange(len(one)) - np.repeat(np.cumsum(count) - count, count) + first[one]
        self._term, self._side, self._node = term, side, node
        self._one, self._other = one, other
        every = np.arange(rows.size)
        row = rows.row_of_term[term]
        self._matrix = InterfaceSystem(
            system.comm, np.concatenate([row[one], every]), np.concatenate([row[other], every]),
            rows.interior, rows.shared_numbers, rows.holders, rows.grounded,
        )  # fmt: skip
        self._work = [np.zeros_like(part.block.residual) for part in system.parts]

    def add_forces(self) -> None:
        """Add the forces of all rows at the trial state to the residuals; rows are evaluated."""
        rows = self._system.constraints
        if rows.size:
            pull = np.where(rows.active, rows.static_forces()[:, 0], 0.0)
            rows.multipliers[:] = np.where(rows.rigid, rows.multipliers, pull)
        self._system.add_constraint_forces(rows.multipliers)

    def project(self, inverse: list[FloatArray], velocity: list[FloatArray], push: float) -> None:
        """Project steps and velocities onto the rigid rows; adds to multipliers (collective).

        Args:
            inverse: inverse masses (n_owned, width) of all blocks.
            velocity: (n_owned, width).
            push: factor of the residual in the velocities.
        """
        system, rows = self._system, self._system.constraints
        if not rows.size_global:
            return
        system.interface.update_steps()
        rigid = rows.rigid
        change = rows.values + rows.changes(system.interface.steps)
        right = np.where(rigid, rows.owned * change, 0.0)
        self._factor(inverse)
        self._matrix.solve(right)
        right[~rigid] = 0.0
        rows.multipliers += right / push
        for part, work, by, own in zip(system.parts, self._work, inverse, velocity, strict=True):
            block, width = part.block, part.block.width
            work[:] = 0.0
            rows.add_forces(right, part.interface_nodes, work)
            np.subtract(own, by * work[: block.owned, :width], out=own)
            block.owned_step[:] = own

    def _factor(self, inverse: list[FloatArray]) -> None:
        """Factorise ``G M^-1 G^T``."""
        system, rows = self._system, self._system.constraints
        masses = np.zeros((len(system.part_of_node), 6))
        for part, by in zip(system.parts, inverse, strict=True):
            mine = part.interface_nodes >= 0
            masses[mine, : part.block.width] = by[part.interface_nodes[mine]]
        gradients = rows.rigid_jacobian()[self._term, self._side]
        weighted = gradients * masses[self._node]
        pairs = np.einsum("pk,pk->p", gradients[self._one], weighted[self._other])
        own = np.where(rows.rigid, 0.0, rows.owned)
        self._matrix.factor(np.concatenate([pairs, own]))
