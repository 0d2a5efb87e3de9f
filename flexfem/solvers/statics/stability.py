# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stability of an equilibrium: unstable directions, and the softest motion.

The matrix is ``A = [[K, G^T], [G, -C]]`` with the exact tangent K. Each of its m constraint rows
adds one negative eigenvalue, so that A has m of them where the equilibrium is stable under
conservative loads. Equations of springs are scaled by less than their stiffness: they are
``[a G, -a C]`` in the matrix as it is assembled, which is not symmetric. Where a is negative, as
the slope of a force that falls with its spring's length, the row adds a positive one. Other loads
leave the sign of its determinant, which changes wherever an odd number of eigenvalues passes zero.
"""

from petsc4py import PETSc

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.la.direct import CountingFactors
from flexfem.la.dropped import destroy_dropped
from flexfem.solvers.linear.tangent import TangentSolver, of_multipliers, on_diagonals

__all__ = ["Inertia", "softest_motion"]

#: Iterations of the inverse iteration.
_SWEEPS = 6
#: Slope of a row's scaled force below which the row adds no stiffness.
_NO_SLOPE = 1e-16


class Inertia:
    """Counts by factorising the assembled matrix with MUMPS."""

    def __init__(self, tangent: TangentSolver, conservative: bool) -> None:
        """Choose the factorisation: symmetric for conservative loads."""
        self._tangent, self._conservative = tangent, conservative
        self._factors: CountingFactors | None = None
        self._falling = 0  # springs whose force falls

    def unstable(self) -> int:
        """Number of unstable directions at the assembled matrix (collective).

        For loads without a potential 0 or 1, as the determinant's sign is that of a stable
        equilibrium or not; -1 if the matrix is singular.
        """
        tangent = self._tangent
        if self._factors is None or self._nest is not tangent.matrix:
            self._factors = self._create()
        self._assemble()
        if not self._factors.factor(self._matrix):
            return -1
        count = tangent.system.constraints.size_global
        if self._conservative:
            return self._factors.negative_pivots - (count - self._falling)
        return int(self._factors.determinant * (-1.0) ** count < 0.0)

    def _assemble(self) -> None:
        """One matrix of the nest; its symmetric part, the whole matrix at an equilibrium."""
        self._tangent.matrix.convert("aij", self._matrix)
        if self._conservative:
            self._balance_springs()
            self._matrix.transpose(self._transposed)
            same = PETSc.Mat.Structure.SAME_NONZERO_PATTERN
            self._matrix.axpy(1.0, self._transposed, same)
            self._matrix.scale(0.5)

    def _balance_springs(self) -> None:
        """Scale equations and multipliers of springs alike, ``[b G, -C']`` with ``b^2 = abs(a)``.

        This changes no sign of an eigenvalue but those of falling forces, and leaves forces that do
        not change with the motion, as those of dampers at rest, without stiffness.
        """
        system, rows = self._tangent.system, self._tangent.system.constraints
        slopes = np.where(rows.rigid, 1.0, rows.slopes[:, 0])[rows.owned_rows]
        falling = slopes < -_NO_SLOPE
        self._falling = int(system.comm.allreduce(int(falling.sum())))
        roots = np.sqrt(np.maximum(np.abs(slopes), _NO_SLOPE))
        scales = np.where(falling, -1.0, 1.0) / roots
        equations, columns = (of_multipliers(self._matrix, one) for one in (scales, roots))
        self._matrix.diagonalScale(equations, columns)

    def _create(self) -> CountingFactors:
        destroy_dropped(self._tangent.system.comm)  # older ones
        self._nest = self._tangent.matrix
        self._matrix = self._nest.convert("aij", PETSc.Mat())
        self._transposed = self._matrix.transpose(PETSc.Mat())
        return CountingFactors(self._matrix, symmetric=self._conservative)


def softest_motion(
    tangent: TangentSolver, weights: list[FloatArray]
) -> tuple[float, list[FloatArray]]:
    """Eigenvalue nearest zero of ``A x = mu D x`` and its motion, by inverse iteration.

    D has the weights of the nodes, and zero for multipliers. Where several motions have the
    same eigenvalue, as those of a mechanism, the result mixes them all.

    Args:
        tangent: solver with the matrix assembled; it is changed and factorised.
        weights: (n_owned, width) of each block.

    Returns:
        mu, infinite if joints fix everything, NaN if an iterative solve did not converge; and the
        steps (n_owned, width) of each block, of length one in the norm of D.
    """
    parts, rows = tangent.system.parts, tangent.system.constraints
    shift = tangent.shift
    tangent.add_at_nodes([on_diagonals(shift * w) for w in weights])
    motion = [
        _scattered(part.block.node_ids[: part.block.owned])[:, : part.block.width] for part in parts
    ]
    motion = _normalised(tangent, motion, weights)
    value, counts = np.inf, tangent.system.linear.counts
    failed = counts.failed
    if not tangent.factor():
        return 0.0 if counts.failed == failed else np.nan, motion
    for _ in range(_SWEEPS):
        right = [w * x for w, x in zip(weights, motion, strict=True)]
        if not tangent.solve(right, np.zeros(rows.size)):
            return 0.0 if counts.failed == failed else np.nan, motion
        steps = [part.block.owned_step.copy() for part in parts]
        growth = _product(tangent, motion, steps, weights)
        if growth == 0.0:  # joints fix everything
            return np.inf, motion
        value = 1.0 / growth - shift
        motion = _normalised(tangent, steps, weights)
    return value, motion


def _scattered(ids: IntArray) -> FloatArray:
    """Numbers (n, 6) between -1 and 1 that depend on the nodes alone, not on the ranks."""
    numbers = 6.0 * np.asarray(ids, dtype=np.float64)[:, np.newaxis] + np.arange(1.0, 7.0)
    return np.asarray(np.sin(12.9898 * numbers * numbers))


def _product(
    tangent: TangentSolver, a: list[FloatArray], b: list[FloatArray], weights: list[FloatArray]
) -> float:
    local = sum(float((w * x * y).sum()) for w, x, y in zip(weights, a, b, strict=True))
    return float(tangent.system.comm.allreduce(local))


def _normalised(
    tangent: TangentSolver, motion: list[FloatArray], weights: list[FloatArray]
) -> list[FloatArray]:
    length = _product(tangent, motion, motion, weights) ** 0.5
    return [x / length for x in motion]
