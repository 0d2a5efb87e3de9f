# SPDX-License-Identifier: LGPL-3.0-or-later
"""Factors of a body with a wide interface, whose nodes come last in the elimination.

A solve with joints is a forward substitution, the response of the interface, to which the joints'
forces are added, and a backward substitution: as much as one solve, where factors in another order
take two. The compliance of the interface is the inverse of its Schur complement, where they take a
solve for each of its rows.

Matrices of congruent bodies are equal up to signs of components, where one is the mirror image of
the other. They share factors, which are then read once for all of these bodies in a solve.
"""

from collections.abc import Callable, Sequence

from petsc4py import PETSc

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotri

from flexfem._types import FloatArray, IntArray
from flexfem.la.factor import is_symmetric
from flexfem.solvers.linear.symmetric_fronts import NodeTree, SymmetricFronts

__all__ = ["CondensedFactor", "Latest", "Solves"]

#: Entries and factors of the last matrix of each tree.
type Latest = dict[NodeTree, tuple[FloatArray, "CondensedFactor"]]


class CondensedFactor:
    """Factors of a symmetric positive definite matrix of one rank.

    The interface is that of :class:`flexfem.la.factor.Factor`; see :class:`Solves` for solves in
    two parts.

    Attributes:
        entries: 0: a solve after another one with other forces at the interface reads no more.
        together: number of right-hand sides that are quickly solved for together.
        fronts: those of this matrix or of one that is equal to it but for signs.
        signs: (width,) of the components by which the other one becomes this one, in rows and
            columns.
        inverse: (k width, k width) that of the other one at the interface.
    """

    entries = 0
    together = 1

    def __init__(self, fronts: SymmetricFronts, inverse: FloatArray, signs: FloatArray) -> None:
        """Store factors."""
        self.fronts, self.inverse, self.signs = fronts, inverse, signs

    @property
    def face(self) -> IntArray:
        """(k,) nodes of the interface."""
        return self.fronts.nodes.left

    def compliance(self, rows: IntArray) -> FloatArray:
        """Inverse in some rows and the same columns of the interface."""
        signs = self.signs[rows % len(self.signs)]
        found: FloatArray = self.inverse[np.ix_(rows, rows)] * np.outer(signs, signs)
        return found

    @classmethod
    def of(
        cls, matrix: PETSc.Mat, width: int, face: IntArray, trees: list[NodeTree], latest: Latest
    ) -> "CondensedFactor | None":
        """Factorise a sequential AIJ matrix; None if it is unsymmetric or not positive definite.

        Args:
            matrix: rows of nodes of ``width`` rows each.
            width: rows of a node.
            face: (k,) nodes of the interface.
            trees: those of other matrices, the same for equal patterns; a new one is appended.
            latest: entries of the last matrix of each tree that was factorised, and its factors,
                for matrices that are equal up to signs; written.
        """
        if not is_symmetric(matrix):
            return None
        start, columns, values = matrix.getValuesCSR()
        tree = next((one for one in trees if one.fits(start, columns, face)), None)
        if tree is None:
            tree = NodeTree(start, columns, width, face)
            trees.append(tree)
        if tree in latest:
            entries, other = latest[tree]
            signs = tree.signs(entries, values)
            if signs is not None:
                return cls(other.fronts, other.inverse, signs)
        try:
            fronts = SymmetricFronts(tree, values)
            made = cls(fronts, _inverse(fronts), np.ones(width))
        except ArithmeticError:
            return None
        latest[tree] = values, made
        return made

    def solver(
        self, rhs: FloatArray, solution: FloatArray, *, transposed: bool = False,
        lasting: bool = False,
    ) -> Callable[[], None]:  # fmt: skip
        """See :class:`flexfem.la.factor.Factor`."""
        return Solves([self], [rhs], [solution]).solve

    def foreign_solver(self, rhs: FloatArray, solution: FloatArray) -> None:
        """See :class:`flexfem.la.factor.Factor`: a solve is more than one call."""

    def solve_columns(
        self, right: FloatArray, solution: FloatArray, *, transposed: bool = False
    ) -> None:
        """See :class:`flexfem.la.factor.Factor`."""
        Solves([self] * len(right), list(right), list(solution)).solve()


class Solves:
    """Solves with factors of the same fronts, each for its own right-hand side."""

    def __init__(
        self,
        factors: Sequence[CondensedFactor],
        right: Sequence[FloatArray],
        solutions: Sequence[FloatArray],
    ) -> None:
        """Allocate memory.

        Args:
            factors: s of them.
            right: (n, width) each, read in every call.
            solutions: likewise, written in every call.
        """
        self._fronts, self._inverse = factors[0].fronts, factors[0].inverse
        self._face, self._right, self._solutions = factors[0].face, right, solutions
        self._signs = [factor.signs for factor in factors]
        self._moved = self._fronts.room(len(factors))
        self._work = np.empty((len(factors), *right[0].shape))
        self._reduced = self._given = np.zeros((len(factors), len(self._inverse)))

    def respond(self) -> None:
        """Write the solutions at the interface."""
        self._reduce()
        self._given = self._at_face()
        found = (self._reduced @ self._inverse).reshape(len(self._signs), len(self._face), -1)
        for solution, one, signs in zip(self._solutions, found, self._signs, strict=True):
            solution[self._face] = one * signs

    def complete(self) -> None:
        """Write all of the solutions, for right-hand sides that have changed at the interface.

        Elsewhere they are those of the last :meth:`respond`.
        """
        self._complete(self._reduced + (self._at_face() - self._given))

    def solve(self) -> None:
        """Write the solutions."""
        self._reduce()
        self._complete(self._reduced)

    def _at_face(self) -> FloatArray:
        """Right-hand sides (s, k width) of the interface, with the signs of the fronts."""
        both = zip(self._right, self._signs, strict=True)
        return np.array([(one[self._face] * signs).ravel() for one, signs in both])

    def _reduce(self) -> None:
        for work, one, signs in zip(self._work, self._right, self._signs, strict=True):
            np.multiply(one, signs, out=work)
        self._reduced = self._fronts.reduce(self._work, self._moved)

    def _complete(self, forces: FloatArray) -> None:
        self._fronts.complete(forces @ self._inverse, self._moved, self._work)
        for solution, found, signs in zip(self._solutions, self._work, self._signs, strict=True):
            np.multiply(found, signs, out=solution)


def _inverse(fronts: SymmetricFronts) -> FloatArray:
    """Inverse of the complement of fronts, whose memory is used.

    Raises:
        ArithmeticError: It is not positive definite.
    """
    complement, fronts.complement = fronts.complement, np.empty((0, 0))
    if not len(complement):
        return complement
    upper, wrong = dpotrf(complement.T, overwrite_a=True)
    inverse, undefined = dpotri(upper, overwrite_c=True)
    if wrong or undefined:
        raise ArithmeticError("the complement is not positive definite")
    lower = np.tril_indices(len(complement), -1)
    inverse[lower] = inverse.T[lower]
    return np.ascontiguousarray(inverse.T)
