# SPDX-License-Identifier: LGPL-3.0-or-later
"""Acceleration of Newton's iteration by its own last steps.

Where the matrix lacks a part of the derivative, as that of forces along mean lines of contacts,
whose places move with the step, each step leaves a part of the error that hardly changes in
direction: the iteration contracts slowly, and no other factors help. Steps that have been taken and
the changes of the next ones that they caused tell what is missing (Anderson, J. ACM 12 (1965)
547-560; as a quasi-Newton method: Fang, Saad, Numer. Linear Algebra Appl. 16 (2009) 197-221):

    y = x - s - sum_k g_k (dx_k - ds_k),   |s - sum_k g_k ds_k| minimal,

where the step s is to be subtracted. Steps of rotations are in the nodes' own axes, which turn so
little within an iteration that is near its end that steps can be compared.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.solvers.frozen.vectors import StepVectors

__all__ = ["Secants"]

#: Contraction of the steps from which an iteration is slow, and number of such steps, one after the
#: other, from which it is accelerated: Newton's method by itself becomes faster and faster.
_SLOW, _LONG = 0.3, 2
#: Number of earlier steps that are used; part of a change that must be new in it.
_MOST, _NEW = 5, 1e-3
#: Largest multiple of the steps' norm that an accelerated one may have.
_LONGEST = 20.0


class Secants:
    """Steps of one iteration, and what they have changed.

    Attributes:
        contraction: of the last step, before it was accelerated; 1 if it is the first one.
    """

    def __init__(self, vectors: StepVectors) -> None:
        """Begin without steps."""
        self._vectors = vectors
        self.forget()

    def forget(self) -> None:
        """Begin anew: steps have been cut."""
        self._ways: list[FloatArray] = []
        self._changes: list[FloatArray] = []
        self._last: tuple[FloatArray, FloatArray, float] | None = None
        self.contraction, self._slow = 1.0, 0

    def improve(self, correction: FloatArray) -> FloatArray:
        """Accelerate a step where the iteration contracts slowly (collective).

        Args:
            correction: multipliers' correction (r,); the blocks have their steps.

        Returns:
            That of the step which is left in the blocks and is to be taken as a whole.
        """
        vectors = self._vectors
        step = vectors.collect(correction)
        size = float(np.sqrt(vectors.squares(step)[0]))
        if self._last is not None:
            self._compare(step, size)
        better = self._accelerated(step, size) if self._slow >= _LONG else step
        self._last = better, step, size
        return correction if better is step else -vectors.put(better)

    def _compare(self, step: FloatArray, size: float) -> None:
        """Remember what the last step has changed, unless the iteration goes astray."""
        assert self._last is not None
        taken, before, largest = self._last
        if not size < largest:
            self.forget()
            return
        self.contraction = size / largest
        if self._slow < _LONG:
            self._slow = self._slow + 1 if self.contraction > _SLOW else 0
        self._ways.append(-taken)
        self._changes.append(step - before)
        del self._ways[:-_MOST], self._changes[:-_MOST]

    def _accelerated(self, step: FloatArray, size: float) -> FloatArray:
        """The accelerated step, or the same one (collective)."""
        changes = np.array(self._changes)
        products = self._vectors.gram(np.concatenate([changes, step[np.newaxis]]))
        weights = _least_squares(products[:-1, :-1], products[:-1, -1])
        if weights is None:
            return step
        better: FloatArray = step + weights @ (np.array(self._ways) - changes)
        square = self._vectors.squares(better)[0]
        return better if square <= (_LONGEST * size) ** 2 else step


def _least_squares(gram: FloatArray, right: FloatArray) -> FloatArray | None:
    """Weights (k,) for products of changes (k, k) and of these with a step (k,)."""
    sizes = np.sqrt(np.diagonal(gram))
    if not (np.isfinite(gram).all() and np.isfinite(right).all() and (sizes > 0.0).all()):
        return None
    values, vectors = np.linalg.eigh(gram / np.outer(sizes, sizes))
    kept = values > _NEW**2 * values[-1]
    along = (vectors[:, kept].T @ (right / sizes)) / values[kept]
    weights: FloatArray = (vectors[:, kept] @ along) / sizes
    return weights
