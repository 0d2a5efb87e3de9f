# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solver of the multipliers' system with factors of former entries, refined by the present ones.

The system changes little from step to step, as local frames follow the bodies. A solve with old
factors is then followed by a few solves for the residuals of the present entries (Richardson's
iteration, preconditioned), as accurate as new factors, and cheaper where fronts are large: those of
a net with n crossings take n^1.5 operations to factorise and n log n to solve with.
"""

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray, IndexArray
from flexfem.kernels.compiled import kernel
from flexfem.solvers.linear.multiplier_system import InterfaceSystem

__all__ = ["KeptFactors", "with_kept_factors"]

#: Estimated error of a solution, relative to its largest entry, at which refinement ends. That of
#: the converged positions is this part of the last correction, which is below their tolerance.
_ACCURATE = 1e-8
#: Ratio of two corrections above which factors are renewed at once.
_SLOW = 0.2
#: Operations of a factorisation, by matrix products, in the time of one of a solve, which waits for
#: memory.
_FASTER = 7.0
#: Solves in the time of a factorisation, up to which old factors are never tried: an iteration
#: takes two or three more of them at least.
_LEAST = 6.0
#: Values for which factors are made anew, at most, after old ones were too slow: as long as bodies
#: turn against one another, they are of no use.
_LONGEST = 15
#: Operations of a factorisation below which it is as fast as the calls of a refinement, messages
#: between ranks included.
_SMALL = 3e7


@kernel
def _subtract_product(
    i: IndexArray, j: IndexArray, values: FloatArray, x: FloatArray, out: FloatArray
) -> None:
    """Subtract the product of a matrix of entries (i, j) with x."""
    for k in range(i.size):
        out[i[k]] -= values[k] * x[j[k]]


class KeptFactors:
    """Factors that serve the values of several steps.

    Whether they are kept depends on counts of operations and on numbers that are the same on all
    ranks. Solutions do not depend on it but for ``_ACCURATE``.

    Attributes:
        renewals: number of factorisations.
    """

    def __init__(
        self, comm: MPI.Intracomm, system: InterfaceSystem, i: IndexArray, j: IndexArray,
        worth: float,
    ) -> None:  # fmt: skip
        """See :func:`with_kept_factors`; ``worth``: solves in the time of a factorisation."""
        self._comm, self._system = comm, system
        self._i, self._j, self._worth = i, j, worth
        self._values: FloatArray | None = None
        self._fresh = False
        self._more = 0  # further solves for the present values, and for all since the last factors
        self._served = self._all = 0
        self._pause = self._wait = 0  # values that are factorised after old factors failed
        self.renewals = 0

    def factor(self, values: FloatArray, regular: bool) -> bool:
        """Take new values, and factorise if the last ones took more solves than that is worth.

        They also did if they took more than all since the last factorisation on average, with what
        that cost: old factors become slower, and this mean is then the least.

        Collective; see :meth:`InterfaceSystem.factor`. The values must stay until the next ones.
        """
        if self._keeps(values):
            return self._all_regular(regular)
        return self._renewed(self._system.factor(values, regular))

    def factor_and_solve(self, values: FloatArray, regular: bool, right: FloatArray) -> bool:
        """See :meth:`factor`, :meth:`solve` and :meth:`InterfaceSystem.factor_and_solve`."""
        if not self._keeps(values):
            return self._renewed(self._system.factor_and_solve(values, regular, right))
        regular = self._all_regular(regular)
        if regular:
            self.solve(right)
        return regular

    def _keeps(self, values: FloatArray) -> bool:
        """Take new values; True if the factors serve for them as well."""
        if self._values is not None and not self._fresh:
            self._pause = 0  # old factors have served
            self._served += 1
            self._all += self._more
        mean = (self._worth + self._all) / max(self._served, 1)
        keep = self._values is not None and self._more < min(self._worth, mean) and not self._wait
        self._wait = max(self._wait - 1, 0)
        self._values, self._more = values, 0
        self._fresh = not keep
        return keep

    def _all_regular(self, regular: bool) -> bool:
        return regular if self._comm.size == 1 else self._comm.allreduce(regular, op=MPI.LAND)

    def _renewed(self, regular: bool) -> bool:
        """Count a factorisation of the present values; they are forgotten if they are singular."""
        self.renewals += 1
        self._served = self._all = 0
        self._fresh = True
        if not regular:
            self._values = None
        return regular

    def solve(self, right: FloatArray) -> None:
        """See :meth:`InterfaceSystem.solve`; not a number where the matrix is singular."""
        if self._fresh:
            self._system.solve(right)
            return
        assert self._values is not None
        given, total, before = right.copy(), np.zeros_like(right), 0.0
        change = right
        while True:
            self._system.solve(change)
            self._more += 1
            total += change
            size, whole = self._largest(change, total)
            if size == 0.0 or 0.0 < size * size <= _ACCURATE * whole * before:
                break
            if not size <= (_SLOW * before if before else np.finfo(float).max):
                right[:] = given
                self._wait = self._pause = min(2 * self._pause + 1, _LONGEST)
                if not self._renewed(self._system.factor_and_solve(self._values, True, right)):
                    right[:] = np.nan
                return
            before = size
            change = given.copy()
            _subtract_product(self._i, self._j, self._values, total, change)
        right[:] = total
        self._more -= 1

    def _largest(self, change: FloatArray, total: FloatArray) -> tuple[float, float]:
        """Largest entries of two vectors on all ranks."""
        values = np.array([np.abs(x).max(initial=0.0) for x in (change, total)])
        if self._comm.size > 1:
            values[np.isnan(values)] = np.inf  # MPI's maximum does not order NaN
            self._comm.Allreduce(MPI.IN_PLACE, values, op=MPI.MAX)
        return float(values[0]), float(values[1])


def with_kept_factors(
    comm: MPI.Intracomm, system: InterfaceSystem, i: IndexArray, j: IndexArray
) -> InterfaceSystem | KeptFactors:
    """A system whose factors are kept if they are worth some solves, else as it is (collective).

    Args:
        comm: communicator of the system.
        system: of which the entries are given.
        i: rows of the entries.
        j: columns of the entries.
    """
    factor, solve = system.operations
    if comm.size > 1:  # not Allreduce, which counts what iterations send
        factor, solve = comm.bcast(comm.reduce(np.array([factor, solve]), op=MPI.SUM))
    worth = factor / _FASTER / max(solve, 1.0)
    return KeptFactors(comm, system, i, j, worth) if factor > _SMALL and worth > _LEAST else system
