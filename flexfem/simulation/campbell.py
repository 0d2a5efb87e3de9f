# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modes over the speed of a steady rotation: the data of a Campbell diagram."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.analyses.modes import CampbellOptions
from flexfem.model.model import Model
from flexfem.simulation.equilibria.operating_point import OperatingPoint
from flexfem.simulation.modes import modes_at
from flexfem.simulation.run.guard import guarded
from flexfem.simulation.run.outcome import Outcome, Results
from flexfem.simulation.speed_sweep import SpeedSweep
from flexfem.solvers.modal.mode_shapes import Modes
from flexfem.solvers.modal.tracking import follow, whirl

__all__ = ["sweep_spin"]

#: Share of one sense of whirl above which a mode is classified as a whirl.
_PURE = 0.9
#: Modes computed beyond those requested, as a multiple: in rotating axes the order changes with
#: speed.
_MORE = 2
_VALUES = ("frequency", "fixed", "damping", "whirl")


def sweep_spin(
    model: Model, options: CampbellOptions, *, case: str = "model", results: Results | None = None,
    comm: MPI.Intracomm | None = None,
) -> Outcome:  # fmt: skip
    """Follow modes over the speed of a steady rotation and write them (collective).

    The history has one row for each speed; its first column ``t`` is the speed (rad/s). Every mode
    has four columns: ``<mode>_frequency`` in axes that rotate with the model (Hz), ``<mode>_fixed``
    in fixed axes, ``<mode>_damping`` (ratio) and ``<mode>_whirl``, 1 for a circular motion with the
    rotation, -1 against it, both in rotating axes, 0 for a plane motion. A whirl has the
    frequency ``f + spin/2 pi`` or ``spin/2 pi - f`` in fixed axes, negative where it rotates
    against the spin; other modes have several and keep f there. Modes are named ``forward_1``,
    ``backward_1``, ... by the sense of their whirl in fixed axes at the last speed, or ``mode_1``,
    ..., counted by the moduli of their eigenvalues at the first speed, of which the lowest are
    kept. A mode that is not found at a speed is nan. A warning names the speeds at which one grows.
    The columns of the probes in the steady rotation come last: displacements and strains over the
    speed for example.

    Args:
        model: the model, the same on every rank.
        options: speeds, number of modes, output folder and so on.
        case: name for the summary.
        results: function of the history's columns that returns the headline results.
        comm: communicator, all ranks by default.

    Returns:
        The outcome, the same status on every rank; speeds before one that fails are kept.

    Raises:
        InputError: a mistake in the model or the options, before anything is written.
        TypeError: the options are those of another analysis.
        FunctionError: a function of the model failed at a later speed than the first; the speeds
            before are written (a RuntimeError).
        OSError: the results cannot be written.
        KeyboardInterrupt: SIGINT, SIGTERM or SIGHUP came; the speeds so far are written.
    """
    _checks.instance("sweep_spin", "options", options, CampbellOptions)
    comm = comm or MPI.COMM_WORLD
    with guarded(options, comm) as faults:
        point = OperatingPoint(model, options, comm)
        point.check_count("CampbellOptions", options.modes)
        _check_columns(model, options)
        return _SpinSweep(point, options).run(faults, case, results, comm)


def _check_columns(model: Model, options: CampbellOptions) -> None:
    """Refuse probes whose columns have the names of modes.

    Raises:
        InputError: names the first.
    """
    names = {f"{mode}_{value}" for mode in _possible(options.modes) for value in _VALUES}
    taken = next((c for p in model.probes for c in p.columns if c in names), None)
    if taken is not None:
        raise InputError(f"column '{taken}' of a probe: the analysis has one of this name")


class _SpinSweep(SpeedSweep):
    """Modes at all speeds, with the senses of their whirls."""

    growing = (
        "columns of those kept have a negative damping there, and the frequency 0 where they do "
        "not oscillate"
    )

    def __init__(self, point: OperatingPoint, options: CampbellOptions) -> None:
        """See :class:`SpeedSweep`."""
        super().__init__(point, options)
        self._senses = list[FloatArray]()

    def found(self) -> Modes:
        """See :meth:`SpeedSweep.found`."""
        count = self.options.modes
        return modes_at(self.point, self.options, min(_MORE * count, self.point.freedoms - count))

    def required(self, modes: Modes) -> int:
        """See :meth:`SpeedSweep.required`."""
        return self.options.modes

    def keep(self, speed: float, modes: Modes) -> dict[str, float]:
        """See :meth:`SpeedSweep.keep`."""
        sign = -1.0 if speed < 0.0 else 1.0
        self._senses.append(whirl(modes, sign * self.point.rotation(speed).axis))
        return {}

    def table(self) -> tuple[list[str], FloatArray]:
        """See :meth:`SpeedSweep.table`."""
        found, speeds = self.modes, self.speeds
        numbers = follow(found, len(found[-1]))
        table = np.full((len(speeds), len(numbers[-1]), len(_VALUES)), np.nan)
        for k, (modes, number) in enumerate(zip(found, numbers, strict=True)):
            for i in np.flatnonzero(number >= 0):
                j = number[i]
                f, sense = modes.frequencies[j], self._senses[k][j]
                table[k, i] = f, _fixed(f, sense, speeds[k]), modes.damping[j], sense
        # the lowest at the first speed, as find_modes has them: motions that do not oscillate are
        # not lower than slow ones; those that are not found there come last
        sizes, there = np.full(len(numbers[-1]), np.inf), np.flatnonzero(numbers[0] >= 0)
        sizes[there] = np.abs(found[0].eigenvalues[numbers[0][there]])
        table = table[:, np.argsort(sizes, kind="stable")[: self.options.modes]]
        columns = [f"{name}_{value}" for name in _names(table[-1]) for value in _VALUES]
        states = np.array([list(state.values()) for state in self.states])
        values = table.reshape(len(speeds), -1)
        return [*columns, *self.states[0]], np.hstack([values, states])


def _fixed(frequency: float, sense: float, speed: float) -> float:
    """Frequency in fixed axes, Hz."""
    turns = abs(speed) / (2.0 * np.pi)
    if abs(sense) < _PURE or speed == 0.0:
        return frequency
    return frequency + turns if sense > 0.0 else turns - frequency


def _possible(count: int) -> list[str]:
    """Names that modes may get."""
    kinds = ("mode", "forward", "backward")
    return [f"{kind}_{k + 1}" for kind in kinds for k in range(count)]


def _names(last: FloatArray) -> list[str]:
    """Names of the modes from their values at the last speed."""
    names: list[str] = []
    counts: dict[str, int] = {}
    for _, fixed, _, sense in last:
        kind = "mode" if abs(sense) < _PURE else "forward" if fixed > 0.0 else "backward"
        counts[kind] = counts.get(kind, 0) + 1
        names.append(f"{kind}_{counts[kind]}")
    return names
