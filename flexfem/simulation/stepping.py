# SPDX-License-Identifier: LGPL-3.0-or-later
"""A system with its time integrator, stepped from Python."""

import time

from mpi4py import MPI

from flexfem._checks import InputError
from flexfem.core.status import Status
from flexfem.integrators.integrator import create_integrator
from flexfem.integrators.start import start_consistently
from flexfem.model.model import Model
from flexfem.options import RunOptions
from flexfem.solvers.newton import NewtonOptions
from flexfem.solvers.policies import Policy, create_policy
from flexfem.solvers.tangent import TangentSolver
from flexfem.system.assembly import Assembly
from flexfem.system.build import build
from flexfem.system.system import System

__all__ = ["HALVINGS", "Simulation"]

#: A step is halved this often before the run gives up.
HALVINGS = 12


class Simulation:
    """A system with its integrator, stepped from Python.

    Attributes:
        system: the assembled system.
        steps, rejected: accepted (partial) steps and rejected ones.
        step_seconds: wall-clock time of each call of :meth:`advance`, s.
    """

    def __init__(
        self, model: Model, options: RunOptions, comm: MPI.Intracomm | None = None
    ) -> None:
        """Build the system and start it consistently (collective).

        Raises:
            InputError: a mistake in the model (a ValueError).
        """
        try:
            model.validate()
            self.serial = Assembly(model)
            self.system: System = build(self.serial, comm or MPI.COMM_WORLD, options.split_above)
        except ValueError as error:  # on every rank, the model being the same
            raise InputError(str(error)) from error
        self.options = options
        self.system.set_time(0.0)
        self._integrator = create_integrator(options.integrator, options.rho_inf)
        tangent = TangentSolver(self.system)
        self.status = start_consistently(
            self.system, tangent, options.dt, options.redundant_constraints == "least_norm"
        )
        newton = NewtonOptions(options.tolerance)
        self._policy: Policy = create_policy(options.iteration_matrix, self.system, newton, tangent)
        self.steps = self.rejected = 0
        self.step_seconds: list[float] = []

    @property
    def time(self) -> float:
        """Time of the accepted state, s."""
        return self.system.time

    def advance(self, h: float, t: float | None = None) -> Status:
        """Advance by ``h`` (s) in one step, or in halved steps where one step fails.

        Args:
            h: step size; factors are kept for equal step sizes, so pass the same number.
            t: time reached, where the caller knows it free of accumulated rounding.
        """
        begin = time.perf_counter()
        status = self._advance(h, HALVINGS)
        self.step_seconds.append(time.perf_counter() - begin)
        if status is Status.OK and t is not None:
            self.system.time = t
        return status

    def _advance(self, h: float, halvings: int) -> Status:
        status = self._integrator.step(self.system, self._policy, h)
        if status is Status.OK:
            self.steps += 1
            return status
        self.rejected += 1
        if halvings == 0:
            return status
        first = self._advance(0.5 * h, halvings - 1)
        return self._advance(0.5 * h, halvings - 1) if first is Status.OK else first
