# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modes over the speed of a steady rotation: the data of a Campbell diagram."""

from __future__ import annotations

from collections.abc import Callable

from mpi4py import MPI

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.analyses.modes import CampbellOptions
from flexfem.core.status import Status
from flexfem.io.history import HistoryWriter
from flexfem.io.summary import remove_summary
from flexfem.launch import StopSignals
from flexfem.model.model import Model
from flexfem.simulation.interruption import Agreement, interruption
from flexfem.simulation.modes import modes_at
from flexfem.simulation.operating_point import OperatingPoint
from flexfem.simulation.outcome import Outcome, Results, conclude
from flexfem.simulation.reasons import MODES, with_hint
from flexfem.solvers.mode_shapes import Modes
from flexfem.solvers.tracking import follow, whirl

__all__ = ["sweep_spin"]

#: Share of a pure whirl above which a mode counts as one.
_PURE = 0.9
#: Modes computed beyond those asked for, a multiple: in turning axes the order changes with speed.
_MORE = 2
#: How a run that a signal has ended says so.
_INTERRUPTED = "interrupted after the spin"
_VALUES = ("frequency", "fixed", "damping", "whirl")


def sweep_spin(
    model: Model, options: CampbellOptions, *, case: str = "model", results: Results | None = None,
    comm: MPI.Intracomm | None = None,
) -> Outcome:  # fmt: skip
    """Follow modes over the speed of a steady rotation and write them (collective).

    The history has one row for each speed; its first column ``t`` is the speed (rad/s). Every mode
    has four columns: ``<mode>_frequency`` in axes that turn with the model (Hz), ``<mode>_fixed``
    in fixed axes, ``<mode>_damping`` (ratio) and ``<mode>_whirl``, 1 for a circular motion with the
    rotation, -1 against it, both as seen in turning axes, 0 for a plane motion. A whirl has the
    frequency ``f + spin/2 pi`` or ``spin/2 pi - f`` in fixed axes, negative where it turns against
    the rotation; other modes have several and keep f there. Modes are named ``forward_1``,
    ``backward_1``, ... by the sense of their whirl in fixed axes at the last speed, or ``mode_1``,
    ..., counted by their frequencies at the first speed, of which the lowest are kept. A mode that
    is not found at a speed is nan.

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
        OSError: the results cannot be written.
        KeyboardInterrupt: SIGINT or SIGTERM came; the speeds so far are written.
    """
    _checks.instance("sweep_spin", "options", options, CampbellOptions)
    point = OperatingPoint(model, options, comm)
    point.check_count("CampbellOptions", options.modes)
    agreement = Agreement(point.system.comm)
    with StopSignals() as signals:
        speeds, found, senses, reason = _sweep(point, options, lambda: agreement.on(signals))
        signal = agreement.on(signals) if reason.startswith(_INTERRUPTED) else 0
    columns, table = _table(speeds, found, senses, options.modes)
    if options.output is not None:
        remove_summary(options.output / "summary.json", point.system.comm)
        writer = HistoryWriter(options.output / "history.csv", columns, point.system.comm)
        for speed, row in zip(speeds, table, strict=True):
            writer.write(speed, row)
        writer.close()
    history: dict[str, FloatArray] = {}
    if point.system.comm.rank == 0 and len(speeds):
        history = {"t": np.array(speeds)} | dict(zip(columns, table.T.copy(), strict=True))
    summary = point.summary(case, reason)
    outcome = conclude(summary, history, results, options, point.system.comm)
    if signal:
        raise interruption(signal, reason, outcome=outcome)
    return outcome


def _sweep(
    point: OperatingPoint, options: CampbellOptions, stopped: Callable[[], int]
) -> tuple[list[float], list[Modes], list[FloatArray], str]:
    """Speeds reached, modes and senses of whirl at each, and how it ended."""
    reached: list[float] = []
    found: list[Modes] = []
    senses: list[FloatArray] = []
    for speed in np.linspace(options.spin, options.spin_end, options.speeds).tolist():
        status = point.settle(speed)
        if status is not Status.OK:
            text = f"{status.value} at the spin {speed:.6g} rad/s"
            return reached, found, senses, with_hint(text, MODES.get(status))
        more = min(_MORE * options.modes, point.freedoms - options.modes)
        modes = modes_at(point, options, more)
        if len(modes) == 0:
            text = f"no mode converged at the spin {speed:.6g} rad/s"
            return reached, found, senses, with_hint(text, "ask for fewer modes, or more speeds")
        sign = -1.0 if speed < 0.0 else 1.0
        reached.append(speed)
        found.append(modes)
        senses.append(whirl(modes, sign * point.rotation(speed).axis))
        if stopped() and len(reached) < options.speeds:
            return reached, found, senses, f"{_INTERRUPTED} {speed:.6g} rad/s"
    return reached, found, senses, "ok"


def _table(
    speeds: list[float], found: list[Modes], senses: list[FloatArray], count: int
) -> tuple[list[str], FloatArray]:
    """Names of the columns, and one row for each speed."""
    if not speeds:
        return ["mode_1_frequency"], np.zeros((0, 1))
    numbers = follow(found, len(found[-1]))
    table = np.full((len(speeds), len(numbers[-1]), len(_VALUES)), np.nan)
    for k, (modes, number) in enumerate(zip(found, numbers, strict=True)):
        for i in np.flatnonzero(number >= 0):
            j = number[i]
            f, sense = modes.frequencies[j], senses[k][j]
            table[k, i] = f, _fixed(f, sense, speeds[k]), modes.damping[j], sense
    # the lowest at the first speed; those that are lost on the way come last
    table = table[:, np.argsort(table[0, :, 0], kind="stable")[:count]]
    names = _names(table[-1])
    columns = [f"{name}_{value}" for name in names for value in _VALUES]
    return columns, table.reshape(len(speeds), -1)


def _fixed(frequency: float, sense: float, speed: float) -> float:
    """Frequency in fixed axes, Hz."""
    turns = abs(speed) / (2.0 * np.pi)
    if abs(sense) < _PURE or speed == 0.0:
        return frequency
    return frequency + turns if sense > 0.0 else turns - frequency


def _names(last: FloatArray) -> list[str]:
    """Names of the modes from their values at the last speed."""
    names: list[str] = []
    counts: dict[str, int] = {}
    for _, fixed, _, sense in last:
        kind = "mode" if abs(sense) < _PURE else "forward" if fixed > 0.0 else "backward"
        counts[kind] = counts.get(kind, 0) + 1
        names.append(f"{kind}_{counts[kind]}")
    return names
