# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dynamic relaxation: from a model and options to results in a folder."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from mpi4py import MPI

import numpy as np

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.analyses.relaxation import RelaxationOptions
from flexfem.core.status import Status
from flexfem.integrators.start import check_start
from flexfem.model.model import Model
from flexfem.simulation.run.cautions import Cautions
from flexfem.simulation.run.checkpoints import Checkpoints, Restart
from flexfem.simulation.run.failure_reasons import RELAXATION, not_finite, with_hint
from flexfem.simulation.run.functions_alike import FunctionsAlike
from flexfem.simulation.run.loop import Steps, carry_out
from flexfem.simulation.run.outcome import Outcome, Results
from flexfem.simulation.run.recording import Recorder
from flexfem.simulation.run.setup import set_up
from flexfem.simulation.run.time_grid import TimeGrid
from flexfem.simulation.watch.validity import doubtful_state
from flexfem.solvers.linear.tangent import TangentSolver
from flexfem.solvers.relaxation.solver import Relaxation, Scheme
from flexfem.system.bounding_box import model_extent

__all__ = ["relax"]

#: Columns of the history before those of the probes.
_COLUMNS = ("residual", "largest_step", "pseudo_energy")


def relax(
    model: Model,
    options: RelaxationOptions,
    *,
    case: str = "model",
    results: Results | None = None,
    comm: MPI.Intracomm | None = None,
) -> Outcome:
    """Bring a model to equilibrium by dynamic relaxation and write the results (collective).

    Inertia, dampers and friction of joints do not act.

    Args:
        model: the model, the same on every rank.
        options: tolerances, damping, output folder and so on.
        case: name for the summary.
        results: function of the history's columns that returns the headline results.
        comm: communicator, all ranks by default.

    Returns:
        The outcome, the same status on every rank; not "ok" without convergence. In the history
        ``t`` counts iterations; ``residual`` is the norm of the forces out of balance relative to
        that of the applied ones (to its first value where none are applied), ``largest_step`` the
        largest displacement in an iteration relative to the size of the model, or rotation (rad),
        and ``pseudo_energy`` the kinetic energy of the fictitious motion.

    Raises:
        InputError: a mistake in the model, before anything is written (a ValueError).
        TypeError: the options are those of another analysis.
        FunctionError: a function of the model failed after the start; a checkpoint and the results
            so far are written (a RuntimeError).
        OSError: the results cannot be written.
        KeyboardInterrupt: SIGINT, SIGTERM or SIGHUP came; a checkpoint and the results so far are
            written.
    """
    _checks.instance("relax", "options", options, RelaxationOptions)
    comm = comm or MPI.COMM_WORLD
    return carry_out(partial(_Iterations, model, options, comm), options, comm, case, results)


class _Iterations(Steps):
    """Iterations of the relaxation, in groups between two records."""

    recorder: Recorder

    def __init__(
        self, model: Model, options: RelaxationOptions, comm: MPI.Intracomm,
        restart: Restart | None,
    ) -> None:  # fmt: skip
        self._options = options
        self._serial, self.system = set_up(
            model, comm, options.split_above, kernels=options.kernels
        )
        if self.system.remembering:
            raise InputError(
                f"RelaxationOptions: {model!r} has solids with internal variables, which depend on "
                "the path: use statics, or a motion"
            )
        self.cautions = Cautions.of_model(self._serial, options, self.system)
        if restart is not None:
            restart.check(self._serial)
        self.system.set_time(options.at_time)
        if restart is None:
            check_start(self.system)
        self.relaxation = Relaxation(
            TangentSolver(self.system), model_extent(self._serial), _scheme(options),
            at_time=options.at_time, fresh=restart is None,
        )  # fmt: skip
        if restart is not None:
            restart.restore(self.relaxation, self.relaxation.system)
        self.functions = FunctionsAlike(self.system, self._serial.model)
        self.checkpoints = Checkpoints(
            self.relaxation, self._serial, options, TimeGrid(1.0, 1), restart
        )
        self._finite = True
        self._begin = self._end = time.perf_counter()
        self.recorder = Recorder(
            self.system, self._serial, options, options.every, float(options.max_iterations),
            resume=None if restart is None else restart.state, unit="", measures=_COLUMNS,
        )  # fmt: skip

    @property
    def at(self) -> str:
        """See :class:`Steps`."""
        return f"iteration {self.relaxation.iteration}"

    @property
    def after(self) -> str:
        """See :class:`Steps`."""
        return f"{self.relaxation.iteration} iterations"

    @property
    def completed(self) -> int | None:
        """See :class:`Steps`."""
        return self.relaxation.iteration if self._finite else None

    def record_start(self) -> None:
        """See :class:`Steps`."""
        self._finite = self.relaxation.evaluate()
        self._record(last=not self._finite)
        self.done = not self._finite or self._converged()

    def begin(self) -> None:
        """See :class:`Steps`."""
        self._begin = self._end = time.perf_counter()

    def take(self, stopping: Callable[[], bool]) -> Status:
        """Iterate to the next record."""
        options, relaxation = self._options, self.relaxation
        self._finite = relaxation.advance()
        while (
            self._finite
            and relaxation.iteration % options.record_every
            and relaxation.iteration < options.max_iterations
        ):
            self._finite = relaxation.advance()
        self._finite = self._finite and relaxation.evaluate()
        converged = self._converged()
        over = relaxation.iteration >= options.max_iterations
        self.done = converged or over or not self._finite
        self._record(last=self.done)
        self._end = time.perf_counter()
        if not self._finite:
            return Status.DIVERGED
        return Status.NOT_CONVERGED if over and not converged else Status.OK

    def _converged(self) -> bool:
        """Return True if both measures are below their tolerances."""
        options, reached = self._options, self.relaxation.progress
        return reached.residual <= options.tolerance and reached.step <= options.step_tolerance

    def _record(self, last: bool) -> None:
        relaxation = self.relaxation
        relaxation.settle()
        reached = relaxation.progress
        values = np.array([reached.residual, reached.step, reached.energy])
        self.recorder.record(relaxation.iteration, last=last, measures=values)

    def reason(self, status: Status) -> str:
        """See :class:`Steps`."""
        reached, at = self.relaxation.progress, self.relaxation.iteration
        if self._finite and self._converged():
            return "ok"
        if self._finite:
            return with_hint(
                f"not in equilibrium after {at} iterations: residual {reached.residual:.3g} of the "
                f"applied forces, largest step {reached.step:.3g}",
                RELAXATION[0],
            )
        if culprit := not_finite(self._serial, np.array([self._options.at_time])):
            return f"{culprit} after {at} iterations"
        return with_hint(f"the relaxation diverged after {at} iterations", RELAXATION[1])

    def look_back(self, reason: str, history: Mapping[str, FloatArray]) -> None:
        """See :class:`Steps`."""
        self.cautions.say(doubtful_state(self._serial, self.system))

    def summary(self) -> dict[str, Any]:
        """See :class:`Steps`."""
        reached = self.relaxation.progress
        return {
            "steps": self.relaxation.iteration,
            "renewals": self.relaxation.renewals,
            "residual": reached.residual,
            "largest_step": reached.step,
            "wall_seconds_steps": self._end - self._begin,
        }


def _scheme(options: RelaxationOptions) -> Scheme:
    return Scheme(
        damping=options.damping,
        margin=options.margin,
        least=options.least_mass,
        physical=options.masses == "scaled",
        renew=options.renew_every,
    )
