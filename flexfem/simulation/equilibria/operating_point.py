# SPDX-License-Identifier: LGPL-3.0-or-later
"""The state about which a model is linearised: at rest, in equilibrium, in steady rotation."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem.analyses.modes import StateOptions
from flexfem.core.status import Status
from flexfem.integrators.redundancy import check_independence
from flexfem.integrators.start import check_gaps
from flexfem.la.dropped import destroy_dropped
from flexfem.model.model import Model
from flexfem.simulation.run.cautions import Cautions
from flexfem.simulation.run.checkpoints import SavedState
from flexfem.simulation.run.outcome import summary_of
from flexfem.simulation.run.setup import set_up
from flexfem.simulation.watch.inside_out import inside_out
from flexfem.solvers.modal.linearization import Linearization
from flexfem.solvers.modal.steady_rotation import (
    Rotation,
    check_steadiness,
    find_equilibrium,
    hold,
    improve_equilibrium,
)
from flexfem.system.measure.probes import ProbeRecorder

__all__ = ["OperatingPoint"]


class OperatingPoint:
    """A model in the state about which it is linearised.

    Attributes:
        serial, system: the model's data and its system.
        linearization: evaluated at the state after :meth:`settle`.
        freedoms: number of degrees of freedom, and of states of force elements.
        cautions: warnings of the analysis.
        inverted: text on the element that the last solution inverted, empty if there is none.
    """

    def __init__(
        self, model: Model, options: StateOptions, comm: MPI.Intracomm | None = None
    ) -> None:
        """Build the system and check its constraints (collective).

        Raises:
            InputError: a mistake in the model (a ValueError), or a given state of another model.
        """
        self._begin = time.perf_counter()
        saved = None if options.state is None else SavedState(options.state, comm or MPI.COMM_WORLD)
        self.serial, self.system = set_up(
            model, comm, options.split_above, kernels=options.kernels, moving=True
        )
        self.cautions = Cautions.of_model(self.serial, options, self.system)
        if saved is not None:
            saved.check(self.serial)
        self.options = options
        self._probes: ProbeRecorder | None = None
        self._settled: Rotation | None = None
        self.inverted = ""
        self.system.set_time(0.0)
        self.rotation(0.0)
        self.linearization = self._linearization()
        self.rotation(0.0).set(self.system)
        rows = self.system.constraints
        self.linearization.evaluate(np.zeros(rows.size))
        check_gaps(self.system)
        check_independence(self.system)
        rigid = int(np.sum(rows.owned * rows.rigid))
        own = self.linearization.states.count - rigid
        self.freedoms = self.system.unknowns + int(self.system.comm.allreduce(own))
        self.system.set_time(options.time)
        if saved is not None:
            saved.restore(self.system, self.system)
            for contacts in self.system.contacts:
                contacts.update()

    def rotation(self, spin: float) -> Rotation:
        """The rotation of the options at a speed (rad/s)."""
        axis = np.array(self.options.axis_vector)
        return Rotation(spin, axis / np.linalg.norm(axis), np.array(self.options.centre_vector))

    def settle(self, spin: float) -> Status:
        """Bring the system from the present state to that at a speed (rad/s) (collective).

        Raises:
            InputError: the model cannot rotate steadily about the axis.
        """
        destroy_dropped(self.system.comm)  # matrices and solvers of other speeds
        rotation = self.rotation(spin)
        if spin != 0.0:
            self._check(rotation)
        self.cautions.say()
        self._settled, self.inverted = None, ""
        if spin == 0.0 and self.options.start == "rest":
            rotation.set(self.system)
            status = Status.OK if hold(self.linearization) else Status.SINGULAR
            self.system.constraints.forces[:] = self.linearization.multipliers
            return status
        self._settled = rotation
        return find_equilibrium(self.linearization, rotation, self._upright)

    def _linearization(self) -> Linearization:
        """Linearised equations (collective)."""
        return Linearization(self.system)

    def _check(self, rotation: Rotation) -> None:
        """Raise if the model cannot rotate so (collective)."""
        check_steadiness(self.serial.model, self.system, rotation)

    def _upright(self) -> bool:
        """Return True if no element is inverted in the present state (collective)."""
        self.inverted = inside_out(self.serial, self.system)
        return not self.inverted

    def failure(self, status: Status) -> str:
        """Return the reason why there is no state, in words."""
        return self.inverted if status is Status.INSIDE_OUT else status.value

    @property
    def improve(self) -> Callable[[], bool] | None:
        """Step to a more accurate equilibrium: False if there is none; None for a given state."""
        rotation = self._settled
        if rotation is None:
            return None
        return lambda: improve_equilibrium(self.linearization, rotation)

    def columns(self) -> dict[str, float]:
        """Columns of all probes in the present state, the same on every rank (collective)."""
        if self._probes is None:
            self._probes = ProbeRecorder(self.system, self.serial, depth=1)
        self._probes.record(self.system.time)
        values = [row.tolist() for _, row in self._probes.flush()]
        row = self.system.comm.bcast(values[0] if values else None)
        return dict(zip(self._probes.columns, row, strict=True))

    @property
    def is_equilibrium(self) -> bool:
        """True if the state was computed, False if it was given."""
        return self.options.spin != 0.0 or self.options.start == "equilibrium"

    @property
    def described(self) -> str:
        """The kind of state in words."""
        if self.is_equilibrium:
            return "the steady rotation" if self.options.spin else "the equilibrium"
        return "the state" if self.options.state is not None else "the given configuration"

    def check_count(self, owner: str, count: int) -> None:
        """Raise if the model has fewer modes than requested.

        Raises:
            InputError: names the numbers.
        """
        if count > self.freedoms:
            raise InputError(
                f"{owner}: modes must not exceed the {self.freedoms} degrees of freedom of "
                f"{self.serial.model!r}, got {count}"
            )

    def summary(self, case: str, reason: str) -> dict[str, Any]:
        """Return the part of ``summary.json`` common to all analyses."""
        wall = time.perf_counter() - self._begin
        return summary_of(self.system, case, reason) | {
            "freedoms": self.freedoms,
            "wall_seconds": wall,
            "wall_seconds_setup": wall,
            "warnings": self.cautions.texts,
        }
