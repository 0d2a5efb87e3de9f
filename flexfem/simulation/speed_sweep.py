# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modes at speed after speed, and their table: what analyses over a speed share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar

from mpi4py import MPI

import numpy as np

from flexfem._faults import Faults, current
from flexfem._types import FloatArray
from flexfem.analyses.modes import CampbellOptions
from flexfem.core.status import Status
from flexfem.io.summary import remove_summary
from flexfem.io.tables.history import HistoryWriter
from flexfem.launch import StopSignals
from flexfem.simulation.equilibria.operating_point import OperatingPoint
from flexfem.simulation.modes import checks, doubts, growth_warnings
from flexfem.simulation.run.failure_reasons import modes_hint, with_hint
from flexfem.simulation.run.guard import agreed, refuse
from flexfem.simulation.run.interruption import Agreement, interruption
from flexfem.simulation.run.outcome import Outcome, Results, conclude
from flexfem.solvers.modal.mode_shapes import Modes

__all__ = ["SpeedSweep"]


class SpeedSweep(ABC):
    """Modes at the speeds of the options, in order; those before a failure are kept.

    Attributes:
        speeds: reached so far, rad/s.
        modes: at each of them.
        states: columns of the steady state at each of them.
        growths: rates of all modes found there that grow, 1/s, zero for the others.
        reason: status of the analysis.
    """

    #: What the table says of modes that grow.
    growing: ClassVar[str]

    def __init__(self, point: OperatingPoint, options: CampbellOptions) -> None:
        """Begin before the first speed."""
        self.point, self.options = point, options
        self.speeds, self.modes = list[float](), list[Modes]()
        self.states = list[dict[str, float]]()
        self.growths = list[FloatArray]()
        self.reason = "ok"

    @abstractmethod
    def found(self) -> Modes:
        """Modes about the present state (collective)."""

    def chosen(self, modes: Modes) -> Modes:
        """Those of the modes found that the table may have."""
        return modes

    @abstractmethod
    def required(self, modes: Modes) -> int:
        """Number of the first modes that must be without a fault."""

    @abstractmethod
    def keep(self, speed: float, modes: Modes) -> dict[str, float]:
        """Store what the table needs of modes; further columns (collective)."""

    @abstractmethod
    def table(self) -> tuple[list[str], FloatArray]:
        """Names of the columns, and one row for each speed; at least one speed was reached."""

    def finish(self) -> dict[str, Any]:
        """Check what has been found at all speeds; entries of the summary (collective)."""
        return {}

    def run(
        self, faults: Faults, case: str, results: Results | None, comm: MPI.Intracomm
    ) -> Outcome:
        """Find, write and conclude (collective).

        Raises:
            KeyboardInterrupt: SIGINT, SIGTERM or SIGHUP came; the speeds so far are written.
        """
        agreement = Agreement(comm)
        with StopSignals() as signals:
            signal = self._follow(lambda: agreement.on(signals))
        if not self.speeds:
            refuse(faults, comm)
        self.point.cautions.say(self._growth_warnings())
        complete = not signal and len(self.speeds) == self.options.speeds
        further = self.finish() if complete else {}
        columns, table = self.table() if self.speeds else (["mode_1_frequency"], np.zeros((0, 1)))
        with faults.files():
            self._write(columns, table, comm)
        history: dict[str, FloatArray] = {}
        if comm.rank == 0 and self.speeds:
            history = {"t": np.array(self.speeds)}
            history |= dict(zip(columns, table.T.copy(), strict=True))
        summary = self.point.summary(case, self.reason)
        if self.speeds:
            kept = [modes.first(self.options.modes) for modes in self.modes]
            summary["checks"] = checks(kept) | further
        outcome = conclude(summary, history, results, self.options, comm)
        if signal:
            raise interruption(signal, self.reason, outcome=outcome)
        return outcome

    def _follow(self, stopped: Callable[[], int]) -> int:
        """Modes at all speeds; the signal that has ended this, else 0 (collective)."""
        options = self.options
        for speed in np.linspace(options.spin, options.spin_end, options.speeds).tolist():
            failure = self._step(speed)
            if failure:
                self.reason = failure
                return 0
            signal = stopped()
            if signal and len(self.speeds) < options.speeds:
                self.reason = f"interrupted after the spin {speed:.6g} rad/s"
                return signal
        return 0

    def _step(self, speed: float) -> str:
        """Add the results at a speed; the reason of a failure, else empty (collective)."""
        point, options, at = self.point, self.options, f"at the spin {speed:.6g} rad/s"
        status = point.settle(speed)
        state = point.columns() if status is Status.OK else {}
        if error := agreed(current(), point.system.comm):  # a user-defined function
            return f"{error} {at}"
        if status is not Status.OK:
            return with_hint(f"{point.failure(status)} {at}", modes_hint(status, speed))
        found = self.found()
        if found.failure:
            return f"{at} {doubts(found, options.modes)}"
        modes = self.chosen(found)
        if len(modes) == 0:
            return with_hint(f"no mode was found {at}", "request fewer modes, or more speeds")
        required = self.required(modes)
        doubt = doubts(modes.first(required), required, options.accuracy)
        if doubt != "ok" and self.reason == "ok":
            self.reason = f"{at} {doubt}"
        self.speeds.append(speed)
        self.modes.append(modes)
        self.growths.append(found.growth)
        self.states.append(self.keep(speed, modes) | state)
        return ""

    def _growth_warnings(self) -> list[str]:
        """Warning of all speeds at which a mode grows."""
        pairs = zip(self.speeds, self.growths, strict=True)
        where = [f"{speed:.6g}" for speed, rates in pairs if rates.any()]
        span = " to ".join(dict.fromkeys([*where[:1], *where[-1:]]))
        state = f"the state at {len(where)} of {len(self.speeds)} speeds, {span} rad/s,"
        return growth_warnings(state, self.growths, self.growing)

    def _write(self, columns: list[str], table: FloatArray, comm: MPI.Intracomm) -> None:
        """Write the table (collective)."""
        if self.options.output is None:
            return
        remove_summary(self.options.output / "summary.json", comm)
        writer = HistoryWriter(self.options.output / "history.csv", columns, comm)
        for speed, row in zip(self.speeds, table, strict=True):
            writer.write(speed, row)
        writer.close()
