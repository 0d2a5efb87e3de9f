# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modes of a model: frequencies, damping, pictures."""

from __future__ import annotations

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.analyses.modes import ModeOptions
from flexfem.core.status import Status
from flexfem.io.history import HistoryWriter
from flexfem.io.mode_output import write_modes
from flexfem.io.summary import remove_summary
from flexfem.model.model import Model
from flexfem.simulation.operating_point import OperatingPoint
from flexfem.simulation.outcome import Outcome, Results, conclude
from flexfem.simulation.reasons import MODES, with_hint
from flexfem.solvers.mode_shapes import Modes, find

__all__ = ["ModesOutcome", "few_modes", "find_modes", "modes_at"]

_COLUMNS = ("frequency", "damping_ratio", "real", "imag", "mass_x", "mass_y", "mass_z")


@dataclass(frozen=True, repr=False)
class ModesOutcome(Outcome):
    """What an eigenanalysis came to.

    Attributes:
        modes: the modes on this rank, None if there is no state to look at.
    """

    modes: Modes | None = None


def find_modes(
    model: Model, options: ModeOptions, *, case: str = "model", results: Results | None = None,
    comm: MPI.Intracomm | None = None,
) -> ModesOutcome:  # fmt: skip
    """Find modes of a model and write them (collective).

    The history has one row for each mode; its first column ``t`` is the number of the mode. The
    others are ``frequency`` (Hz), ``damping_ratio``, ``real`` and ``imag`` of the eigenvalue (1/s)
    and ``mass_x, mass_y, mass_z``, the effective masses along the inertial axes (kg).

    Args:
        model: the model, the same on every rank.
        options: number of modes, state, output folder and so on.
        case: name for the summary.
        results: function of the history's columns that returns the headline results.
        comm: communicator, all ranks by default.

    Returns:
        The outcome, the same status on every rank.

    Raises:
        InputError: a mistake in the model or the options, before anything is written.
        TypeError: the options are those of another analysis.
        OSError: the results cannot be written.
    """
    _checks.instance("find_modes", "options", options, ModeOptions)
    point = OperatingPoint(model, options, comm)
    point.check_count("ModeOptions", options.modes)
    status = point.settle(options.spin)
    found = modes_at(point, options) if status is Status.OK else None
    if options.output is not None:
        remove_summary(options.output / "summary.json", point.system.comm)
    history = _write(point, options, found)
    reason = _reason(status, options, found)
    summary = point.summary(case, reason)
    if found is not None:
        summary["results"] = {
            f"frequency_{k + 1}": f for k, f in enumerate(found.frequencies.tolist())
        }
    ended = conclude(summary, history, results, options, point.system.comm)
    return ModesOutcome(ended.status, ended.summary, ended.history, found)


def modes_at(point: OperatingPoint, options: ModeOptions, more: int = 0) -> Modes:
    """Modes about the present state of an operating point (collective).

    Args:
        point: settled in a state.
        options: number of modes and accuracy.
        more: modes beyond those asked for.

    Raises:
        InputError: a target frequency for a damped or rotating model.
    """
    target = 2.0 * np.pi * options.target
    if target > 0.0 and point.linearization.damped():
        raise InputError(
            f"{type(options).__name__}: target {options.target:g} Hz needs a model at rest "
            "without damping"
        )
    return find(point.linearization, options.modes + more, target, options.accuracy)


def few_modes(found: Modes, asked: int, more: str = "") -> str:
    """That fewer modes converged than were asked for, and what ``more`` to try; else "ok"."""
    if len(found) >= asked:
        return "ok"
    return with_hint(f"only {len(found)} of {asked} modes converged", f"ask for fewer modes{more}")


def _reason(status: Status, options: ModeOptions, found: Modes | None) -> str:
    if found is None:
        what = "steady rotation" if options.spin else "equilibrium"
        return with_hint(f"{status.value} in the search for the {what}", MODES.get(status))
    return few_modes(found, options.modes, " or a larger accuracy, or give a target near them")


def _write(
    point: OperatingPoint, options: ModeOptions, found: Modes | None
) -> dict[str, FloatArray]:  # fmt: skip
    """Write table and pictures; the table on the first rank."""
    system = point.system
    if found is None:
        return {}
    values = found.eigenvalues
    table = np.column_stack(
        [found.frequencies, found.damping, values.real, values.imag, found.masses]
    )
    numbers = np.arange(1.0, len(found) + 1.0)
    if options.output is not None:
        writer = HistoryWriter(options.output / "history.csv", _COLUMNS, system.comm)
        for number, row in zip(numbers, table, strict=True):
            writer.write(float(number), row)
        writer.close()
        if options.frames > 0:
            shapes = [point.linearization.split(shape) for shape in found.shapes]
            write_modes(
                options.output, system, point.serial, shapes, found.frequencies,
                options.amplitude, options.frames,
            )  # fmt: skip
    if system.comm.rank != 0:
        return {}
    return {"t": numbers} | dict(zip(_COLUMNS, table.T.copy(), strict=True))
