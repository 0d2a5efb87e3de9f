# SPDX-License-Identifier: LGPL-3.0-or-later
"""Check of the linearised equations against differences of the equations themselves.

Elements may compute an approximate tangent, with which Newton's method converges as well. The
derivatives of a motion would be wrong with it, unnoticed: adjoint and tangent agree all the same.
"""

from __future__ import annotations

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.gradients.equations.linearized import LinearizedStep
from flexfem.gradients.equations.values import Equations, equations_at
from flexfem.gradients.motion.trajectory import Motion
from flexfem.gradients.unilateral.forces import leave_out_barriers

__all__ = ["linearized"]

#: Largest relative difference. Exact tangents have 1e-9 to 3e-7 with changes that suit them, those
#: of shells with damping without changes of strain rates by rotations 1e-5 and more.
_EXACT = 3e-6
#: Part of the largest product of a block below which that of another matrix may be rounding.
_ROUNDED = 1e-6
#: Changes of differences, in m and rad, for bodies of all sizes.
_CHANGES = (1e-5, 1e-7, 1e-8, 1e-9)


def linearized(motion: Motion, accuracy: float) -> LinearizedStep:
    """Checked linearised equations of a motion, which is at another state after it (collective).

    Args:
        motion: the motion.
        accuracy: relative one of solutions.

    Raises:
        InputError: they are not exact, naming the body.
    """
    tangent, mechanics = motion.scheme.tangent(), motion.simulation.integrator.mechanics
    linear = LinearizedStep(motion.system, motion.policy, accuracy, tangent, mechanics)
    _check_exact(motion, linear)
    return linear


def _check_exact(motion: Motion, linear: LinearizedStep) -> None:
    """Compare both along a random direction, at the ends of some steps (collective).

    These are the first one, one in the middle and the last one: what is missing may be proportional
    to rates, which may be zero at one of them. So are some with impulses.
    """
    differences = _Differences(motion, linear)
    steps = motion.grid.steps
    for step in sorted({*_some(steps), *_some([k for k in steps if motion.kicked(k)])}):
        off = differences.smallest(step)
        worst = int(np.argmax(off))
        if not off[worst] <= _EXACT:
            parts = motion.system.parts
            name = parts[worst].owner if worst < len(parts) else "the joints"
            raise InputError(
                f"gradient: the linearised equations of {name}, or of a body of its kind, are not "
                f"exact (off by {off[worst]:.1e}); leave it out"
            )


def _some(steps: Sequence[int]) -> Sequence[int]:
    """The first, the middle and the last of some steps."""
    return [steps[k] for k in (0, (len(steps) - 1) // 2, -1)] if steps else []


class _Differences:
    """Differences of the equations along a direction."""

    def __init__(self, motion: Motion, linear: LinearizedStep) -> None:
        self._motion, self._linear = motion, linear
        random, self._direction = np.random.default_rng(2), []
        for part in motion.system.parts:
            block = part.block
            # the same on any number of ranks
            every = random.standard_normal((block.size_global, block.width))
            self._direction.append(block.hold(every[block.global_ids[: block.owned]]))

    def smallest(self, step: int) -> FloatArray:
        """Relative errors of the blocks, and of all rows, each with the change that suits it."""
        self._go_to_end(step)
        scheme = self._motion.scheme
        self._linear.tangent.take(scheme.shifts(step))
        exact = {
            matrix: scheme.product(step, self._linear, matrix, self._direction)
            for matrix in scheme.matrices
        }
        sizes = np.array([self._sizes(own) for own in exact.values()])
        sizes = np.maximum(sizes, _ROUNDED * sizes.max(axis=0))
        found = np.zeros(len(self._direction) + 1)
        for (matrix, own), size in zip(exact.items(), sizes, strict=True):
            np.maximum(found, self._errors(step, matrix, own, size), out=found)
        return found

    def _go_to_end(self, step: int) -> None:
        """Return to the end of a step, without contacts that rub.

        What sticks slips by less than any difference of positions that rounding allows.
        """
        self._motion.go_to_end(step)
        leave_out_barriers(self._motion.system, rubbing=True)

    def _errors(self, step: int, matrix: int, exact: Equations, sizes: FloatArray) -> FloatArray:
        """The same of one matrix, whose products with the direction are known, and their sizes."""
        found = np.full(len(self._direction) + 1, np.inf)
        for by in _CHANGES:
            ahead, behind = (self._moved(step, matrix, sign * by) for sign in (1.0, -1.0))
            missed = [
                (a - b) / (2.0 * by) - c
                for a, b, c in zip(ahead[0], behind[0], exact[0], strict=True)
            ]
            left = (ahead[1] - behind[1]) / (2.0 * by) - exact[1]
            off = self._sizes((missed, left))
            found = np.fmin(found, np.divide(off, sizes, out=off, where=sizes > 0.0))
            if found.max() <= _EXACT:
                break
        return found

    def _moved(self, step: int, matrix: int, by: float) -> Equations:
        """Equations of blocks and rows beside the end of a step."""
        self._go_to_end(step)
        scheme = self._motion.scheme
        scheme.move(step, matrix, [by * own for own in self._direction])
        leave_out_barriers(self._motion.system, rubbing=True)
        return equations_at(self._motion.system, scheme.shifts(step), scheme.mechanics(step))

    def _sizes(self, equations: Equations) -> FloatArray:
        """Norms of the equations of each block, and of the rows, on all ranks."""
        squares = np.array([float((one**2).sum()) for one in (*equations[0], equations[1])])
        self._motion.system.comm.Allreduce(MPI.IN_PLACE, squares)
        sizes: FloatArray = np.sqrt(squares)
        return sizes
