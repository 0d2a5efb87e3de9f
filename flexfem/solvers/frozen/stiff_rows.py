# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stiff springs beside the frozen operator, such as the normal parts of closed contacts.

Their rows J and slopes D change from iteration to iteration and would need new factors of
``B + J^T D J``. With the factors of B, joints included, the forces ``lambda = D J x`` follow from

    (J B^-1 J^T + D^-1) lambda = J y,   y = B^-1 r,   x = y - B^-1 J^T lambda,

which is well posed however large the slopes. Forces are sought in the span of directions whose
responses ``B^-1 J^T p`` are known from one frozen solve each, such that the rows' motions that are
left are the least; while they are too large, they are the next direction (generalised conjugate
residuals; Eisenstat, Elman, Schultz 1983). All solves of an iteration share the directions: there
are no more of them than springs, and the last solves need none. Directions and motions are scaled
by ``1 / sqrt(c + 1/D)``, c a typical compliance of the rows, since slopes differ by decades.

Many springs, such as those of a heap of ropes, would need as many directions. With the compliances
C of nodes and between neighbours, ``J C J^T + D^-1`` is sparse: it is factorised, on each rank for
its own springs, and its inverse times the motions that are left is the next direction.

Where these are unknown, as in shells, the directions of an iteration and their responses serve the
next ones of the step: slopes change, and some springs come and go, but rows hardly do. Springs that
have gone still have forces in these directions; they are rows of their own, so compliant that their
forces are almost zero.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Protocol

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.solvers.frozen.vectors import StepVectors
from flexfem.system.system import Shifts, System

__all__ = ["SpringRows", "StiffRows"]

#: Solves with the frozen operator for the blocks' residuals and given values (r,) of the rows.
Solve = Callable[[FloatArray], FloatArray]
#: Motions (c,) for forces (c,) of springs alone, a direction with a number.
Respond = Callable[[FloatArray, int], FloatArray]
#: Motions (n_owned, k, w, w) of the nodes of a block and of the k - 1 next ones for loads on these
#: nodes, about; None if unknown, on all ranks.
NodeCompliances = Callable[[FrameBlock], FloatArray | None]
#: Rows, columns and values of a matrix, (k,) each.
Triplets = tuple[IntArray, IntArray, FloatArray]
#: Motions (c,) of a known response, given its number and its new one.
Recall = Callable[[int, int], FloatArray]
#: Next direction (c,) for motions (c,) that are left.
Direct = Callable[[FloatArray], FloatArray]

#: Largest number of directions; stiffness over that of the frozen operator below which springs are
#: soft: GMRES with the exact tangent needs no help with them.
_MOST, _SOFT = 100, 20.0
#: Number of springs on all ranks from which they are coupled by the compliances of nodes, and up to
#: which the matrix of one rank is dense.
_MANY, _DENSE = 8, 120
#: Part of the largest couplings below which others are left out of a large matrix: those of distant
#: nodes fill its factors, and cost more than the directions that they save.
_WEAK = 1e-2
#: Ratio of slopes up to which springs are alike.
_LIKE = 3.0
#: Relative error of the springs' forces: whether a stiff contact opens depends on small parts of
#: its force, and what is left keeps Newton's method from an end.
_ACCURACY = 1e-2
#: Largest number of directions that serve again; compliance of springs that have gone, in typical
#: ones.
_AGAIN, _GONE = 60, 1e4
#: Slope of springs that have none, whose forces stay zero; part of a direction's motions below
#: which it depends on the others, and part that an orthogonalisation must leave, else a second one
#: follows, both squared.
_NO_SLOPE, _DEPENDENT, _LOST = 1e-200, 1e-24, 0.01


class SpringRows(Protocol):
    """Springs of this rank along rows of motion.

    Attributes:
        slopes: derivatives (c,) of their forces by their motions, not negative, N/m.
        rub: True if there is friction, on any rank.
        keys: numbers (c,) by which rows are known in all iterations, each once on this rank; None,
            on all ranks, if they are not.
    """

    @property
    def keys(self) -> IntArray | None:
        """See above."""
        ...

    @property
    def slopes(self) -> FloatArray:
        """See above."""
        ...

    @property
    def rub(self) -> bool:
        """See above."""
        ...

    @property
    def blocks(self) -> dict[int, FrameBlock]:
        """Blocks on which they act, by kind; empty if their coupling is unknown, on all ranks."""
        ...

    def coupled(self, compliances: Mapping[int, FloatArray]) -> Triplets:
        """Rows, columns, values of ``J C J^T`` of this rank's springs, to be summed (collective).

        C are compliances (n_owned, k, w, w) of nodes, and between them and the k - 1 next ones, by
        the kind of their block.
        """
        ...

    def motions(self) -> FloatArray:
        """Motions (c,) for the blocks' steps, ``J x`` (collective)."""
        ...

    def push(self, forces: FloatArray) -> None:
        """Add ``J^T forces`` to the blocks' residuals (collective)."""
        ...


class StiffRows:
    """Correction of frozen solves by springs.

    Attributes:
        active: True if there are springs on any rank.
        rub: True if they are those of contacts with friction.
        soft: True if they are not much stiffer than the frozen operator.
    """

    def __init__(self, system: System, vectors: StepVectors) -> None:
        """Allocate the responses."""
        self._system, self._vectors = system, vectors
        self.active = self.soft = self.rub = False
        self._forces: _Forces | None = None
        self._again = False  # directions of the last forces may serve again
        self._values = np.zeros(system.constraints.size)
        # of the directions, in pages that are used as they come
        self._responses = np.empty((_MOST if system.contacts else 0, len(vectors)))

    def forget(self) -> None:
        """Let no direction serve again: factors change, or a step begins."""
        self._again = False

    def take(
        self, rows: SpringRows, shifts: Shifts, near: NodeCompliances, *, alike: bool = False
    ) -> None:
        """Use springs for the next solves, none for a matrix without stiffness (collective).

        If they are ``alike`` those of the last call, their coupling is kept where it can.
        """
        earlier = self._forces if self._again else None
        last = earlier if alike and self.active else None
        self.active = False
        scale = shifts.scale * shifts.stiffness
        if scale == 0.0:
            return
        slopes = scale * rows.slopes
        others = last is None or not last.like(slopes)
        count, changed = self._vectors.sum(
            np.array([float(np.count_nonzero(slopes)), float(others)])
        )  # fmt: skip
        if count:
            self.active, self.rub, self._again = True, rows.rub, True
            self._forces = _Forces(rows, slopes, self._vectors, rows.keys)
            if count >= _MANY and changed == 0.0 and last is not None:
                self._forces.couple_as(last)
            elif not (count >= _MANY and self._couple(self._forces, near)) and earlier:
                self._forces.follow(earlier)

    def _couple(self, forces: "_Forces", near: NodeCompliances) -> bool:
        """Couple the springs by the compliances of nodes; False if unknown (collective)."""
        rows = forces.rows
        found = {kind: near(block) for kind, block in rows.blocks.items()}
        known = {kind: one for kind, one in found.items() if one is not None}
        if known and len(known) == len(found):
            forces.couple(rows.coupled(known))
        return forces.coupled

    def correct(self, correction: FloatArray, solve: Solve, *, refine: bool = False) -> FloatArray:
        """Add the springs to the frozen solve whose steps are in the blocks (collective).

        The blocks' residuals are kept.

        Args:
            correction: the multipliers' correction (r,) by the frozen solve.
            solve: this, for the blocks' residuals and given values (r,) of the rows.
            refine: True if GMRES with the exact tangent follows, to which soft springs are left,
                but not friction: what sticks has a slip that is a small difference of motions.

        Returns:
            That with the springs.
        """
        assert self._forces is not None
        kept = [part.block.residual.copy() for part in self._system.parts]
        solution = self._vectors.collect(correction)
        parts = self._forces.solve(
            partial(self._respond, solve), self._recall, leave_soft=refine and not self.rub
        )
        self.soft = self._forces.soft and not self.rub
        solution -= parts @ self._responses[: len(parts)]
        for part, residual in zip(self._system.parts, kept, strict=True):
            part.block.residual[:] = residual
        return -self._vectors.put(solution)

    def _recall(self, number: int, new: int) -> FloatArray:
        """Motions (c,) of the response of a number, which gets a new one, not larger."""
        assert self._forces is not None
        self._responses[new] = self._responses[number]
        self._vectors.put(self._responses[new])
        return self._forces.rows.motions()

    def _respond(self, solve: Solve, forces: FloatArray, number: int) -> FloatArray:
        """Motions (c,) for forces (c,) of the springs alone; stores the response by its number."""
        assert self._forces is not None
        rows = self._forces.rows
        for part in self._system.parts:
            part.block.residual[:] = 0.0
        rows.push(forces)
        self._vectors.collect(solve(self._values), self._responses[number])
        return rows.motions()


class _Forces:
    """Forces of the springs of one iteration: directions with known responses.

    Rows are those of the springs, then those of springs that have gone, which do not move.

    Attributes:
        rows: the springs.
        soft: True if they are not much stiffer than the frozen operator.
    """

    def __init__(
        self, rows: SpringRows, slopes: FloatArray, vectors: StepVectors,
        keys: IntArray | None = None,
    ) -> None:  # fmt: skip
        """Begin without directions; rows with ``keys`` (c,) may be known in the next iteration."""
        self.rows, self._here, self._keys = rows, len(slopes), keys
        self._sum = vectors.sum
        self._typical, self._scaling, self.soft = 1.0, np.zeros(0), True
        self._direct: Direct | None = None
        self._earlier: _Forces | None = None
        self._inverses, self._count = np.zeros((_MOST, _MOST)), 0
        self._set_slopes(slopes)

    def _set_slopes(self, slopes: FloatArray) -> None:
        """Set those of all rows."""
        self._slopes = slopes
        self._compliance = 1.0 / np.maximum(slopes, _NO_SLOPE)
        # the scaled motions of directions are a triangle, here inverted, times an orthonormal basis
        self._all_directions, self._all = np.empty((2, _MOST, len(slopes)))

    @property
    def _basis(self) -> FloatArray:
        return self._all[: self._count]

    @property
    def _directions(self) -> FloatArray:
        return self._all_directions[: self._count]

    @property
    def _inverse(self) -> FloatArray:
        return self._inverses[: self._count, : self._count]

    @property
    def coupled(self) -> bool:
        """True if their coupling is known."""
        return self._direct is not None

    def like(self, slopes: FloatArray) -> bool:
        """True if the coupling is known, and about that of springs with other slopes (c,)."""
        own = self._slopes
        if self._direct is None or len(own) != len(slopes):
            return False
        return bool(((slopes <= _LIKE * own) & (own <= _LIKE * slopes)).all())

    def follow(self, earlier: "_Forces") -> None:
        """Begin with the directions of earlier forces, if their rows are known."""
        if self._keys is None or earlier._keys is None or not earlier._count:
            return
        self._earlier, self._typical = earlier, earlier._typical
        gone = np.setdiff1d(earlier._keys, self._keys, assume_unique=True)
        self._keys = np.concatenate([self._keys, gone])
        slopes = np.full(len(gone), 1.0 / (_GONE * self._typical))
        self._set_slopes(np.concatenate([self._slopes, slopes]))
        self._scaling = 1.0 / np.sqrt(self._typical + self._compliance)

    def couple_as(self, last: "_Forces") -> None:
        """Use the coupling of other springs that are about the same."""
        self._direct, self._scaling, self.soft = last._direct, last._scaling, False

    def couple(self, compliances: Triplets) -> None:
        """Use an approximate sparse ``J B^-1 J^T`` of this rank's springs from now on."""
        size, self.soft = len(self._slopes), False
        every = np.arange(size)
        i, j = (np.concatenate([one, every]) for one in compliances[:2])
        values = np.concatenate([compliances[2], self._compliance])
        own = i == j
        diagonal = np.bincount(i[own], values[own], minlength=size)
        # compliances of nodes may be negative in a wild state
        self._scaling = scaling = 1.0 / np.sqrt(np.maximum(diagonal, self._compliance))
        if not size:
            self._direct = np.copy
            return
        values *= scaling[i] * scaling[j]
        try:
            inverted = (_dense if size <= _DENSE else _sparse)(size, (i, j, values))
        except (RuntimeError, np.linalg.LinAlgError):  # singular there: each spring for itself
            inverted = np.copy
        self._direct = lambda left: scaling * inverted(scaling * left)

    def solve(self, respond: Respond, recall: Recall, *, leave_soft: bool) -> FloatArray:
        """Parts of the responses in that to the springs' forces, for the blocks' steps.

        Args:
            respond: motions (c,) for forces (c,) of the springs alone, a direction by its number.
            recall: motions (c,) of a response that serves again.
            leave_soft: True for no more directions than are known, or one, if the springs are soft.
        """
        motions = self._with_gone(self.rows.motions())
        if self._earlier is not None:
            self._serve_again(self._earlier, recall)
            self._earlier = None
        if self._direct is None and not self._count and not self._begin(respond, motions):
            return np.zeros(0)
        while True:
            found = self._sum(self._basis @ (self._scaling * motions))
            parts = self._inverse @ found
            if leave_soft and self.soft:
                return parts
            left = motions - (found @ self._basis) / self._scaling
            # springs' forces for the motions that are left, beside all
            error, size = self._norms(self._slopes * left, parts @ self._directions)
            if not error > _ACCURACY * size or not self._extend(respond, left):
                return parts

    def _with_gone(self, motions: FloatArray) -> FloatArray:
        """Motions of all rows for those of the springs (c,), or forces likewise."""
        return np.concatenate([motions, np.zeros(len(self._slopes) - self._here)])

    def _serve_again(self, earlier: "_Forces", recall: Recall) -> None:
        """Add the latest directions of earlier forces."""
        assert self._keys is not None
        assert earlier._keys is not None
        _, here, there = np.intersect1d(self._keys, earlier._keys, True, return_indices=True)
        for number in range(max(earlier._count - _AGAIN, 0), earlier._count):
            forces = np.zeros(len(self._slopes))
            forces[here] = earlier._directions[number, there]
            moved = self._with_gone(recall(number, self._count))
            size, pushed = self._norms(forces, self._slopes * moved)
            self.soft = self.soft and pushed < _SOFT * size
            self._append(forces, moved)

    def _begin(self, respond: Respond, motions: FloatArray) -> bool:
        """Find the scaling by the springs' forces for motions without reaction, if there are."""
        forces = self._slopes * motions
        (size,) = self._norms(forces)
        if not 0.0 < size < np.inf:
            return False
        forces /= size
        moved = self._with_gone(respond(forces[: self._here], 0))
        self._typical, ratio = self._norms(moved, self._slopes * moved)
        self.soft = ratio < _SOFT
        self._scaling = 1.0 / np.sqrt(self._typical + self._compliance)
        return self._append(forces, moved)

    def _extend(self, respond: Respond, left: FloatArray) -> bool:
        """Add a direction for motions (c,) that are left; False if it depends on the others."""
        if self._count >= _MOST:
            return False
        left, scaling = left[: self._here], self._scaling[: self._here]
        forces = scaling**2 * left if self._direct is None else self._direct(left)
        moved = respond(forces, self._count)
        return self._append(self._with_gone(forces), self._with_gone(moved))

    def _append(self, forces: FloatArray, moved: FloatArray) -> bool:
        """Add a direction (c,) with its motions (c,); False if it depends on the others."""
        count = self._count
        basis, column, whole = self._all[: count + 1], np.zeros(count), 0.0
        basis[-1] = self._scaling * (moved + self._compliance * forces)
        for _ in range(2):
            along = self._sum(basis @ basis[-1])
            basis[-1] -= along[:-1] @ basis[:-1]
            column += along[:-1]
            left = along[-1] - along[:-1] @ along[:-1]
            whole = whole or along[-1]
            if left > _LOST * along[-1]:
                break
        if not left > _DEPENDENT * whole:
            return False
        size = np.sqrt(left)
        basis[-1] /= size
        self._inverses[:count, count] = -self._inverse @ column / size
        self._inverses[count, count] = 1.0 / size
        self._all_directions[count] = forces
        self._count += 1
        return True

    def _norms(self, *vectors: FloatArray) -> list[float]:
        """Norms of vectors (c,) over all ranks."""
        squares = self._sum(np.array([vector @ vector for vector in vectors]))
        return [float(norm) for norm in np.sqrt(squares)]


def _dense(size: int, entries: Triplets) -> Direct:
    """Solve with a small symmetric matrix of entries that add up."""
    i, j, values = entries
    whole = np.bincount(size * i + j, values, minlength=size * size).reshape(size, size)
    inverse = np.linalg.inv(whole)
    return lambda right: inverse @ right


def _sparse(size: int, entries: Triplets) -> Direct:
    """Solve with a large one, whose diagonal is 1, without weak couplings."""
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import splu

    strong = np.abs(entries[2]) > _WEAK
    i, j, values = (one[strong] for one in entries)
    matrix = coo_array((values, (i, j)), shape=(size, size)).tocsc()
    factors = splu(
        matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )  # fmt: skip
    solve: Direct = factors.solve
    return solve
