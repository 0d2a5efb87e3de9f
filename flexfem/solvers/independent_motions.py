# SPDX-License-Identifier: LGPL-3.0-or-later
"""Null space of the constraints, for systems small enough for dense matrices.

Local twists u of all nodes are split as ``u = N y + Y z``: N spans the motions that satisfy the
rigid rows at the accepted state, Y the rest, both orthonormal and constant over a step. At another
state of the step with gradient G, the independent y determine all others,

``G u = b:   u = Theta y + Y (G Y)^-1 b,   Theta = N - Y (G Y)^-1 G N``.

Fixed unknowns are in neither: in N they would have the large stiffness of Dirichlet conditions,
compared with which that of slender bodies is lost in rounding.

The equations of motion along Theta have no multipliers, which are found afterwards (Maggi's
equations; P. E. Nikravesh, Computer-Aided Analysis of Mechanical Systems (1988), section 13.2;
T. R. Kane, D. A. Levinson, Dynamics (1985)). All arrays are the same on every rank.
"""

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.la.dense import gather_rows
from flexfem.solvers.linear.tangent import TangentSolver
from flexfem.system.system import Shifts, System

__all__ = ["IndependentMotions"]

#: Diagonal entries of a triangular factor below this part of the largest indicate dependent rows.
_DEPENDENT = 1e-9


class IndependentMotions:
    """Split of the unknowns of a system by its rigid rows, and the reduced equations.

    Attributes:
        rigid: (r,) flags of the rows of all ranks that are rigid at present, by their global
            numbers.
    """

    def __init__(self, system: System) -> None:
        """Number the unknowns of all ranks (collective)."""
        self._system, self._tangent = system, TangentSolver(system)
        sizes = [part.block.sizes[1] for part in system.parts]
        self._first: IntArray = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        self._movable: BoolArray = self._of_blocks([_movable(p.block) for p in system.parts]) > 0.0
        self.rigid: BoolArray = np.zeros(0, dtype=np.bool_)

    @property
    def unknowns(self) -> int:
        """Number of unknowns on all ranks."""
        return int(self._first[-1])

    def begin(self) -> bool:
        """Split at the present state, at which rows are evaluated (collective).

        Returns:
            False if the split is singular.
        """
        rows = self._system.constraints
        self.rigid = self.of_rows(rows.rigid.astype(np.float64)) > 0.0
        G = self.gradient()[:, self._movable]
        basis, triangle = np.linalg.qr(G.T, mode="complete")
        rank = len(G)
        diagonal = np.abs(np.diag(triangle))
        self._combine: FloatArray | None = None
        if rank and not diagonal.min() > _DEPENDENT * diagonal.max():
            left, values, right = np.linalg.svd(G)
            rank = int((values > _DEPENDENT * values.max()).sum())
            basis, self._combine = right.T, left[:, :rank].T
        every = np.zeros((self.unknowns, len(basis)))
        every[self._movable] = basis
        self._rest, self._free = every[:, :rank], every[:, rank:]
        return self.look()

    def look(self) -> bool:
        """Update the gradient of the rows from their last evaluation (collective).

        Returns:
            True if the other motions are determined by the independent ones.
        """
        self._G = self.gradient()
        G = self._G if self._combine is None else self._combine @ self._G
        try:
            self._follow: FloatArray = np.linalg.solve((G @ self._rest).T, self._rest.T).T
        except np.linalg.LinAlgError:
            return False
        self._theta = self._free - self._follow @ (G @ self._free)
        return bool(np.isfinite(self._theta).all())

    def follow(self, values: FloatArray) -> FloatArray:
        """Dependent motion (n,) that changes the rigid rows by values (all rows)."""
        own = values[self.rigid]
        out: FloatArray = self._follow @ (own if self._combine is None else self._combine @ own)
        return out

    def along_rows(self, motion: FloatArray) -> FloatArray:
        """(all rows,) change of the rigid rows along a motion (n,), zero for others."""
        out = np.zeros(len(self.rigid))
        out[self.rigid] = self._G @ motion
        return out

    def multipliers(self, residual: FloatArray) -> FloatArray:
        """(all rows,) multipliers of the rigid rows that balance a residual (n,)."""
        out = np.zeros(len(self.rigid))
        found = -(self._follow.T @ residual)
        out[self.rigid] = found if self._combine is None else self._combine.T @ found
        return out

    def project(self, residual: FloatArray) -> FloatArray:
        """Residual (n,) along the independent motions."""
        found: FloatArray = self._theta.T @ residual
        return found

    def factor(self, shifts: Shifts) -> bool:
        """Assemble and invert the reduced tangent at the present state; success (collective)."""
        tangent, count = self._tangent, len(self._system.parts)
        tangent.assemble(shifts)
        self._system.counters.factorizations += 1
        blocks = count + int(self._system.constraints.size_global > 0)
        A = np.block([
            [gather_rows(tangent.matrix.getNestSubMatrix(i, j)) for j in range(blocks)]
            for i in range(blocks)
        ])  # fmt: skip
        n, elastic = self.unknowns, np.flatnonzero(~self.rigid)
        own = A[:n, :n] @ self._theta
        rows = n + elastic
        reduced = np.block([
            [self._theta.T @ own, self._theta.T @ A[:n, rows]],
            [A[rows, :n] @ self._theta, A[np.ix_(rows, rows)]],
        ])  # fmt: skip
        try:
            self._reduced = np.linalg.inv(reduced)
        except np.linalg.LinAlgError:
            return False
        return True

    def solve(self, residual: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Step (n,) of the unknowns and (all rows,) of the multipliers of rows with laws.

        Args:
            residual: (m,) residual along the independent motions.
            values: (all rows,) of which those with laws are used.
        """
        right = np.concatenate([residual, values[~self.rigid]])
        found = self._reduced @ right
        laws = np.zeros(len(self.rigid))
        laws[~self.rigid] = found[len(residual) :]
        return self._theta @ found[: len(residual)], laws

    # -- between the ranks' arrays and those of all ranks ---

    def gradient(self) -> FloatArray:
        """(rigid rows, n) gradient of the rigid rows as evaluated last (collective)."""
        system, rows = self._system, self._system.constraints
        widths = np.array([part.block.width for part in system.parts], dtype=np.int64)
        full = np.zeros((rows.size_global, self.unknowns + 1))
        term, side = np.nonzero(
            (rows.owned[rows.row_of_term] > 0.0)[:, np.newaxis] & (rows.term_nodes >= 0)
        )
        node = rows.term_nodes[term, side]
        part = system.part_of_node[node]
        first = self._first[part] + widths[part] * system.interface.number[node]
        column = first[:, np.newaxis] + np.arange(6)
        # nodes of three unknowns: the rest is written to a column that is not used
        column[np.arange(6) >= widths[part][:, np.newaxis]] = self.unknowns
        row = rows.numbers[rows.row_of_term[term]]
        np.add.at(full, (row[:, np.newaxis], column), rows.force_jacobian[term, side])
        system.comm.Allreduce(MPI.IN_PLACE, full)
        return full[self.rigid, :-1]

    def of_rows(self, values: FloatArray) -> FloatArray:
        """Values of all rows by their global numbers from those (r,) of this rank (collective)."""
        rows = self._system.constraints
        full = np.zeros(rows.size_global)
        owned = rows.owned_rows
        full[rows.numbers[owned]] = values[owned]
        self._system.comm.Allreduce(MPI.IN_PLACE, full)
        return full

    def to_rows(self, values: FloatArray) -> FloatArray:
        """Values (r,) of this rank's rows from those of all."""
        own: FloatArray = values[self._system.constraints.numbers]
        return own

    def of_nodes(self, kind: str) -> FloatArray:
        """(n,) residuals, velocities or accelerations of all nodes (collective).

        Forces along fixed unknowns are omitted.
        """
        values = []
        for part in self._system.parts:
            block = part.block
            own = np.array(getattr(block, kind)[: block.owned, : block.width])
            values.append(block.hold(own) if kind == "residual" else own)
        return self._of_blocks(values)

    def _of_blocks(self, values: Sequence[FloatArray]) -> FloatArray:
        """(n,) values of all nodes from those (n_owned, width) of this rank's (collective)."""
        full = np.zeros(self.unknowns)
        for part, first, own in zip(self._system.parts, self._first, values, strict=False):
            at = first + part.block.width * part.block.offset
            full[at : at + own.size] = own.ravel()
        self._system.comm.Allreduce(MPI.IN_PLACE, full)
        return full

    def to_steps(self, motion: FloatArray) -> None:
        """Write a motion (n,) to the blocks' steps, ghosts included (collective)."""
        for part, first in zip(self._system.parts, self._first, strict=False):
            block = part.block
            at = first + block.width * block.offset
            block.owned_step[:] = motion[at : at + block.sizes[0]].reshape(-1, block.width)
            block.spread_step()


def _movable(block: FrameBlock) -> FloatArray:
    """Flags (n_owned, width): ones, and zeros for fixed unknowns."""
    return block.hold(np.ones((block.owned, block.width)))
