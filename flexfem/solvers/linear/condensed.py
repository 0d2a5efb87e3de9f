# SPDX-License-Identifier: LGPL-3.0-or-later
"""Factors of a body with a wide interface, whose nodes come last in the elimination.

A solve with joints is a forward substitution, the response of the interface, to which the joints'
forces are added, and a backward substitution: as much as one solve, where factors in another order
take two. The compliance of the interface is the inverse of its Schur complement, where they take a
solve for each of its rows.
"""

from collections.abc import Callable

from petsc4py import PETSc

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotri

from flexfem._types import FloatArray, IntArray
from flexfem.la.factor import is_symmetric
from flexfem.solvers.linear.symmetric_fronts import NodeTree, SymmetricFronts

__all__ = ["CondensedFactor"]


class CondensedFactor:
    """Factors of a symmetric positive definite matrix of one rank.

    The interface is that of :class:`flexfem.la.factor.Factor`, and a solve in two parts.

    Attributes:
        entries: 0: a solve after another one with other forces at the interface reads no more.
        together: number of right-hand sides that are quickly solved for together.
        face: (k,) nodes of the interface.
        compliance: (k width, k width) inverse at the interface.
    """

    entries = 0
    together = 1

    def __init__(self, fronts: SymmetricFronts) -> None:
        """Invert the complement of the factors.

        Raises:
            ArithmeticError: It is not positive definite.
        """
        self._fronts, self.face = fronts, fronts.nodes.left
        complement, self._count = fronts.complement, len(fronts.complement)
        self.compliance = complement
        if self._count:
            upper, wrong = dpotrf(complement.T, overwrite_a=True)
            inverse, undefined = dpotri(upper, overwrite_c=True)
            if wrong or undefined:
                raise ArithmeticError("the complement is not positive definite")
            lower = np.tril_indices(self._count, -1)
            inverse[lower] = inverse.T[lower]
            self.compliance = np.ascontiguousarray(inverse.T)
        fronts.complement = np.empty((0, 0))

    @classmethod
    def of(
        cls, matrix: PETSc.Mat, width: int, face: IntArray, trees: list[NodeTree]
    ) -> "CondensedFactor | None":
        """Factorise a sequential AIJ matrix; None if it is unsymmetric or not positive definite.

        Args:
            matrix: rows of nodes of ``width`` rows each.
            width: rows of a node.
            face: (k,) nodes of the interface.
            trees: those of other matrices, the same for equal patterns; a new one is appended.
        """
        if not is_symmetric(matrix):
            return None
        start, columns, values = matrix.getValuesCSR()
        tree = next((one for one in trees if one.fits(start, columns, face)), None)
        if tree is None:
            tree = NodeTree(start, columns, width, face)
            trees.append(tree)
        try:
            return cls(SymmetricFronts(tree, values))
        except ArithmeticError:
            return None

    def solver(
        self, rhs: FloatArray, solution: FloatArray, *, transposed: bool = False,
        lasting: bool = False,
    ) -> Callable[[], None]:  # fmt: skip
        """See :class:`flexfem.la.factor.Factor`."""

        def solve() -> None:
            self._fronts.complete(self.compliance @ self._fronts.reduce(rhs), solution)

        return solve

    def halves(
        self, rhs: FloatArray, solution: FloatArray
    ) -> tuple[Callable[[], None], Callable[[], None]]:
        """A solve in two parts.

        The first writes the solution at the interface. The second, for right-hand sides that have
        changed there since, writes all of it.

        Args:
            rhs: (n, width) contiguous, read in every call.
            solution: likewise, written in every call.
        """
        reduced, given = np.zeros(self._count), np.zeros(self._count)

        def respond() -> None:
            reduced[:] = self._fronts.reduce(rhs)
            given[:] = rhs[self.face].ravel()
            solution[self.face] = (self.compliance @ reduced).reshape(len(self.face), -1)

        def complete() -> None:
            forces = reduced + (rhs[self.face].ravel() - given)
            self._fronts.complete(self.compliance @ forces, solution)

        return respond, complete

    def foreign_solver(self, rhs: FloatArray, solution: FloatArray) -> None:
        """See :class:`flexfem.la.factor.Factor`: a solve is more than one call."""

    def solve_columns(
        self, right: FloatArray, solution: FloatArray, *, transposed: bool = False
    ) -> None:
        """See :class:`flexfem.la.factor.Factor`."""
        for one, found in zip(right, solution, strict=True):
            self.solver(one, found)()
