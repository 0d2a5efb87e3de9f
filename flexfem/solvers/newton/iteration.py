# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton iteration with a convergence test per block."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, isfinite, isnan
from typing import Protocol

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.status import Status
from flexfem.kernels.sequence import largest_entry
from flexfem.system.mechanics import END_POINT, SolveAgain
from flexfem.system.moving_apart import Moved
from flexfem.system.system import PartStrains, Shifts, System

__all__ = [
    "Equations",
    "LinearStep",
    "NewtonOptions",
    "Observer",
    "iterate",
]

#: Solves for the steps of blocks (stored there) and multipliers (returned), with success; given
#: the strains of each part whose stresses the matrix takes.
LinearStep = Callable[[Shifts, PartStrains], tuple[bool, FloatArray]]
#: Called after an iteration with its number, its size and that of its motion alone, m or rad, its
#: contraction, the part of it that has been taken, and the strains of the next.
Observer = Callable[[int, float, float, float, float, PartStrains], None]

#: Steps growing by more than this beyond both before them mean divergence: one may be small because
#: it was not solved for accurately.
_DIVERGENCE = 2.0
#: Corrections larger than this many times the first one that contacts cut short mean divergence, if
#: more than so many of them are: contacts that close make one of them in a step that converges.
_WILD, _TAMED = 10.0, 1
#: Multiple of the tolerance below which growing steps are round-off.
_NOISE = 10.0
#: Part of the tolerance below which changes of contact forces are round-off of positions.
_ROUND_OFF = 1e-5
#: Part of corrections that contacts let pass, and number of smaller ones, one after the other,
#: after which there is no hope: each keeps a part of the gaps, and leads to the next.
_STUCK, _TRIALS = 0.1, 5
#: Ratio of these changes above which they are round-off, too, the largest such ones, in parts of
#: those that end an iteration, and their number, one after the other: accelerated corrections may
#: be longer than those before them once.
_STAGNATION, _ALIKE, _TWICE = 0.5, 1e4, 2

#: Number of a failure of linear solves; larger ones are iterative solves without convergence.
_SINGULAR = 1.0


@dataclass(frozen=True)
class NewtonOptions:
    """Stopping criteria of Newton's iteration.

    Attributes:
        tolerance: largest entry of a step of displacements (m), rotations (rad) and of multipliers
            times ``beta h^2`` at which the iteration stops; each block must meet it.
        max_iterations: iterations before a step counts as failed.
    """

    tolerance: float = 1e-6
    max_iterations: int = 25


class Equations(Protocol):
    """The equations at the end of a step, such as those of a ``Mechanics``."""

    def evaluate(self, system: System, shifts: Shifts) -> None:
        """Residuals of blocks and constraints at the trial state (collective)."""
        ...

    def correct(self, system: System, again: SolveAgain | None) -> Moved:
        """Subtract the blocks' steps (collective)."""
        ...


def iterate(
    system: System,
    shifts: Shifts,
    linear_step: LinearStep,
    options: NewtonOptions,
    observe: Observer | None = None,
    equations: Equations = END_POINT,
    again: SolveAgain | None = None,
    *,
    thin: bool = True,
) -> Status:
    """Iterate from the predicted state until every block's step is below the tolerance.

    Args:
        system: at the predicted trial state; left at the solution.
        shifts: factors of the time integrator.
        linear_step: solver of the linearised equations.
        options: tolerances.
        observe: called after every iteration; it may refresh the matrix.
        equations: the equations to be solved.
        again: second solver for equations that need one.
        thin: True to begin with the stresses of the accepted state and continue them in thin
            elements only; the others have the present ones.
    """
    rows, strains = system.constraints, system.accepted_strains(thin=thin)
    linear, comm = system.linear.counts, system.comm
    first = previous = before = change_of_forces = inf
    wild = stuck = stagnant = 0
    for iteration in range(1, options.max_iterations + 1):
        sent = comm.sent if comm.size > 1 else None
        equations.evaluate(system, shifts)
        system.counters.newton_iterations += 1
        failed = linear.failed
        success, change = linear_step(shifts, strains)
        strains = system.continued_strains(thin=thin)
        moved = equations.correct(system, again)
        rows.multipliers -= change if moved.part == 1.0 else moved.part * change
        sizes = _largest(comm, moved, change, success and moved.success, linear.failed > failed)
        if sent is not None:
            system.traffic.add(comm.sent, sent)
        if sizes[2] > 0.0:
            return Status.UNSOLVED if sizes[2] > _SINGULAR else Status.SINGULAR
        if not (isfinite(sizes[0]) and isfinite(sizes[1])):
            return Status.DIVERGED
        size = max(sizes[0], sizes[1])
        stagnant = stagnant + 1 if _STAGNATION * change_of_forces < sizes[3] <= _ALIKE else 0
        settled = sizes[3] <= 1.0 or size <= _ROUND_OFF * options.tolerance or stagnant >= _TWICE
        change_of_forces = sizes[3]
        converged = size <= options.tolerance and moved.part == 1.0 and settled
        contraction = size / previous if previous > 0.0 else 0.0
        if observe is not None:
            observe(iteration, size, sizes[0], contraction, moved.part, strains)
        if converged:
            return Status.OK
        stuck = stuck + 1 if moved.part < _STUCK else 0
        if stuck >= _TRIALS:
            return Status.NOT_CONVERGED
        grows = size > max(_DIVERGENCE * max(previous, before), _NOISE * options.tolerance)
        if grows and moved.part == 1.0 and sizes[3] <= 1.0:
            return Status.DIVERGED
        first = size if iteration == 1 else first
        wild += moved.part < 1.0 and size > max(_WILD * first, _NOISE * options.tolerance)
        if wild > _TAMED:
            return Status.DIVERGED
        previous, before = size, previous
    return Status.NOT_CONVERGED


def _largest(
    comm: MPI.Intracomm, moved: Moved, change: FloatArray, success: bool, unsolved: bool
) -> tuple[float, float, float, float]:
    """Largest steps of blocks and multipliers, failures, and changes of contacts on all ranks.

    Failures of linear solves are numbers, of which the largest one counts.
    """
    failure = 2.0 * _SINGULAR if unsolved else 0.0 if success else _SINGULAR
    values = moved.largest, largest_entry(change), failure, moved.unsettled
    if comm.size == 1:
        return values
    # MPI's maximum does not order NaN
    buffer = np.array([inf if isnan(value) else value for value in values])
    comm.Allreduce(MPI.IN_PLACE, buffer, op=MPI.MAX)
    return float(buffer[0]), float(buffer[1]), float(buffer[2]), float(buffer[3])
