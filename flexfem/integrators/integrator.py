# SPDX-License-Identifier: LGPL-3.0-or-later
"""Base class of time integrators, and integrators by name.

A new scheme is a new file and its line in ``flexfem.analyses.dynamics.INTEGRATORS``.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib import import_module
from math import inf
from typing import ClassVar, Protocol

from flexfem._types import FloatArray
from flexfem.analyses.dynamics import INTEGRATORS
from flexfem.core.nodes.prediction import Prediction
from flexfem.core.state import State
from flexfem.core.status import Status
from flexfem.solvers.newton.policy import Policy
from flexfem.system.mechanics import END_POINT, Mechanics
from flexfem.system.system import Shifts, System

__all__ = ["Integrator", "create_integrator", "discard", "predictions"]


class Integrator(Protocol):
    """A one-step scheme, created with the spectral radius at infinite frequency.

    Attributes:
        order: order of positions and velocities in the step size.
    """

    order: ClassVar[int]

    def __init__(self, rho_inf: float) -> None:
        """Store the coefficients."""
        ...

    def prepare(self, system: System) -> None:
        """Prepare the scheme for a system before its start (collective).

        Raises:
            InputError: the scheme does not support a part of the model.
        """
        return  # most schemes support all models

    @property
    def turn_limit(self) -> float:
        """Rotation of flexible bodies in a step, rad, beyond which unresolved vibrations grow."""
        return inf

    @property
    def mechanics(self) -> Mechanics:
        """Equations that its steps solve, once it is prepared."""
        return END_POINT

    def state(self, system: System) -> State:
        """Return the state of the scheme, besides the accepted state of the system.

        Events may change velocities and accelerations between two steps without a call to the
        scheme.
        """
        return State()

    def restore(self, system: System, state: State) -> None:
        """Restore a result of :meth:`state`, after the system (collective)."""
        return

    @abstractmethod
    def shifts(self, h: float) -> Shifts:
        """Factors of the iteration matrix at step size ``h`` (s)."""
        ...

    @abstractmethod
    def solve(self, system: System, policy: Policy, h: float) -> Status:
        """Solve for the trial state ``h`` (s) later (collective).

        A trial state is accepted by :meth:`accept` or discarded by :func:`discard`. After a failure
        the system is at the accepted state.
        """
        ...

    @abstractmethod
    def error(self, system: System, policy: Policy, h: float) -> float:
        """Local error of the trial state of a step: largest over all nodes, m or rad (collective).

        It is the same number on all ranks, and of order ``order + 1`` in ``h``.
        """
        ...

    @abstractmethod
    def accept(self, system: System, h: float) -> None:
        """Accept the trial state (collective)."""
        ...

    def renewed(self, system: System) -> None:
        """Take note of an accepted state that was made consistent, with the loads behind a jump."""
        return

    def begin_parts(self, system: System) -> Integrator:
        """Scheme for parts of a step between jumps and kinks; the first part needs no history."""
        return self

    def end_parts(self, system: System, before: Sequence[FloatArray], ratio: float) -> None:
        """Return to whole steps.

        Args:
            system: in the state accepted last.
            before: accelerations (n, 6) of each block at the start of the last part.
            ratio: size of a whole step over that of the last part, 0 if that is too short.
        """
        return

    def step(self, system: System, policy: Policy, h: float) -> Status:
        """Advance the system by ``h`` (s); on failure it is left at the accepted state."""
        status = self.solve(system, policy, h)
        if status is Status.OK:
            self.accept(system, h)
        return status


def create_integrator(name: str, rho_inf: float) -> Integrator:
    """Integrator of the given name, one of ``flexfem.analyses.dynamics.INTEGRATORS``."""
    module, kind = INTEGRATORS[name].split(":")
    integrator: Integrator = getattr(import_module(module), kind)(rho_inf)
    return integrator


def predictions(
    system: System, predict: Callable[[Prediction], None]
) -> Iterator[Callable[[], None]]:
    """Predicted trial states as initial guesses: the best for the last step, then zero increments.

    Args:
        system: in its accepted state.
        predict: makes a trial state.

    Yields:
        Function that restores the present trial state.
    """
    for prediction in dict.fromkeys((system.prediction, Prediction.REST)):
        restart = partial(predict, prediction)
        restart()
        yield restart


def discard(system: System, start: float) -> None:
    """Return from a trial state to the accepted state at time ``start`` (s)."""
    system.set_time(start)
    system.reset()
