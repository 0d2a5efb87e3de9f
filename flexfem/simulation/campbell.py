# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modes over the speed of a steady rotation: the data of a Campbell diagram."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from mpi4py import MPI

import numpy as np

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._faults import current
from flexfem._types import FloatArray
from flexfem.analyses.modes import CampbellOptions
from flexfem.core.status import Status
from flexfem.io.summary import remove_summary
from flexfem.io.tables.history import HistoryWriter
from flexfem.launch import StopSignals
from flexfem.model.model import Model
from flexfem.simulation.equilibria.operating_point import OperatingPoint
from flexfem.simulation.modes import checks, doubts, modes_at
from flexfem.simulation.run.failure_reasons import modes_hint, with_hint
from flexfem.simulation.run.guard import agreed, guarded, refuse
from flexfem.simulation.run.interruption import Agreement, interruption
from flexfem.simulation.run.outcome import Outcome, Results, conclude
from flexfem.solvers.modal.mode_shapes import Modes
from flexfem.solvers.modal.tracking import follow, whirl

__all__ = ["sweep_spin"]

#: Share of one sense of whirl above which a mode is classified as a whirl.
_PURE = 0.9
#: Modes computed beyond those requested, as a multiple: in rotating axes the order changes with
#: speed.
_MORE = 2
#: Begin of the status of a run that a signal has ended.
_INTERRUPTED = "interrupted after the spin"
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
    ..., counted by their frequencies at the first speed, of which the lowest are kept. A mode that
    is not found at a speed is nan. The columns of the probes in the steady rotation come last:
    displacements and strains over the speed for example.

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
        agreement = Agreement(comm)
        with StopSignals() as signals:
            sweep = _sweep(point, options, lambda: agreement.on(signals))
            signal = agreement.on(signals) if sweep.reason.startswith(_INTERRUPTED) else 0
        if not sweep.speeds:
            refuse(faults, comm)
        columns, table = _table(sweep, options.modes)
        with faults.files():
            _write(options, columns, sweep.speeds, table, comm)
        history: dict[str, FloatArray] = {}
        if comm.rank == 0 and len(sweep.speeds):
            history = {"t": np.array(sweep.speeds)} | dict(
                zip(columns, table.T.copy(), strict=True)
            )
        summary = point.summary(case, sweep.reason)
        if sweep.speeds:
            summary["checks"] = checks([modes.first(options.modes) for modes in sweep.modes])
        outcome = conclude(summary, history, results, options, comm)
        if signal:
            raise interruption(signal, sweep.reason, outcome=outcome)
        return outcome


def _check_columns(model: Model, options: CampbellOptions) -> None:
    """Refuse probes whose columns have the names of modes.

    Raises:
        InputError: names the first.
    """
    names = {f"{mode}_{value}" for mode in _possible(options.modes) for value in _VALUES}
    taken = next((c for p in model.probes for c in p.columns if c in names), None)
    if taken is not None:
        raise InputError(f"column '{taken}' of a probe: the analysis has one of this name")


def _write(
    options: CampbellOptions, columns: list[str], speeds: list[float], table: FloatArray,
    comm: MPI.Intracomm,
) -> None:  # fmt: skip
    """Write the table (collective)."""
    if options.output is None:
        return
    remove_summary(options.output / "summary.json", comm)
    writer = HistoryWriter(options.output / "history.csv", columns, comm)
    for speed, row in zip(speeds, table, strict=True):
        writer.write(speed, row)
    writer.close()


@dataclass
class _Sweep:
    """Speeds reached, modes, senses of whirl and columns of probes at each, and how it ended."""

    speeds: list[float] = field(default_factory=list)
    modes: list[Modes] = field(default_factory=list)
    senses: list[FloatArray] = field(default_factory=list)
    states: list[dict[str, float]] = field(default_factory=list)
    reason: str = "ok"


def _sweep(
    point: OperatingPoint, options: CampbellOptions, stopped: Callable[[], int]
) -> _Sweep:  # fmt: skip
    """Modes at all speeds in order (collective)."""
    sweep = _Sweep()
    for speed in np.linspace(options.spin, options.spin_end, options.speeds).tolist():
        failure = _step(point, options, speed, sweep)
        if failure:
            sweep.reason = failure
            return sweep
        if stopped() and len(sweep.speeds) < options.speeds:
            sweep.reason = f"{_INTERRUPTED} {speed:.6g} rad/s"
            return sweep
    return sweep


def _step(point: OperatingPoint, options: CampbellOptions, speed: float, sweep: _Sweep) -> str:
    """Add the results at a speed; the reason of a failure, else empty (collective)."""
    status = point.settle(speed)
    state = point.columns() if status is Status.OK else {}
    if error := agreed(current(), point.system.comm):  # a user-defined function
        return f"{error} at the spin {speed:.6g} rad/s"
    if status is not Status.OK:
        text = f"{point.failure(status)} at the spin {speed:.6g} rad/s"
        return with_hint(text, modes_hint(status, speed))
    more = min(_MORE * options.modes, point.freedoms - options.modes)
    modes = modes_at(point, options, more)
    if len(modes) == 0:
        text = f"no mode converged at the spin {speed:.6g} rad/s"
        return with_hint(text, "request fewer modes, or more speeds")
    kept = modes.first(options.modes)
    doubt = doubts(kept, len(kept), options.accuracy)
    if doubt != "ok" and sweep.reason == "ok":
        sweep.reason = f"at the spin {speed:.6g} rad/s {doubt}"
    sign = -1.0 if speed < 0.0 else 1.0
    sweep.speeds.append(speed)
    sweep.modes.append(modes)
    sweep.senses.append(whirl(modes, sign * point.rotation(speed).axis))
    sweep.states.append(state)
    return ""


def _table(sweep: _Sweep, count: int) -> tuple[list[str], FloatArray]:
    """Names of the columns, and one row for each speed."""
    if not sweep.speeds:
        return ["mode_1_frequency"], np.zeros((0, 1))
    found, speeds = sweep.modes, sweep.speeds
    numbers = follow(found, len(found[-1]))
    table = np.full((len(speeds), len(numbers[-1]), len(_VALUES)), np.nan)
    for k, (modes, number) in enumerate(zip(found, numbers, strict=True)):
        for i in np.flatnonzero(number >= 0):
            j = number[i]
            f, sense = modes.frequencies[j], sweep.senses[k][j]
            table[k, i] = f, _fixed(f, sense, speeds[k]), modes.damping[j], sense
    # the lowest at the first speed; those that are not found at all speeds come last
    table = table[:, np.argsort(table[0, :, 0], kind="stable")[:count]]
    columns = [f"{name}_{value}" for name in _names(table[-1]) for value in _VALUES]
    states = np.array([list(state.values()) for state in sweep.states])
    return [*columns, *sweep.states[0]], np.hstack([table.reshape(len(speeds), -1), states])


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
