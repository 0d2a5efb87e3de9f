# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modes of a model: frequencies, damping, pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np

from flexfem import _checks
from flexfem._faults import current
from flexfem._types import FloatArray
from flexfem.analyses.modes import ModeOptions
from flexfem.core.status import Status
from flexfem.io.paraview.field_output import FieldOutput
from flexfem.io.paraview.mode_output import write_modes
from flexfem.io.summary import remove_summary
from flexfem.io.tables.history import HistoryWriter
from flexfem.model.model import Model
from flexfem.simulation.equilibria.operating_point import OperatingPoint
from flexfem.simulation.run.failure_reasons import modes_hint, with_hint
from flexfem.simulation.run.guard import agreed, guarded, refuse
from flexfem.simulation.run.outcome import Outcome, Results, conclude
from flexfem.solvers.modal.mode_shapes import Modes, find

__all__ = [
    "ModesOutcome", "checks", "doubts", "find_modes", "growth_warnings", "modes_at",
    "settled_modes",
]  # fmt: skip

#: Accuracy below which errors are close to rounding, and above which no mode is determined.
_FINE, _COARSE = 1e-12, 1e-2
#: Number of times that modes are computed about an improved equilibrium.
_SETTLINGS = 3
_GROWING = "the column real has the rates, and a mode that does not oscillate has the frequency 0"
_COLUMNS = ("frequency", "damping_ratio", "real", "imag", "mass_x", "mass_y", "mass_z")


@dataclass(frozen=True, repr=False)
class ModesOutcome(Outcome):
    """Outcome of an eigenanalysis.

    Attributes:
        modes: the modes on this rank, None if there is no state.
        state: columns of the probes in the state the modes belong to.
    """

    modes: Modes | None = None
    state: Mapping[str, float] = field(default_factory=dict)


def find_modes(
    model: Model, options: ModeOptions, *, case: str = "model", results: Results | None = None,
    comm: MPI.Intracomm | None = None,
) -> ModesOutcome:  # fmt: skip
    """Find modes of a model and write them (collective).

    The history has one row for each mode; its first column ``t`` is the number of the mode. The
    others are ``frequency`` (Hz), ``damping_ratio``, ``real`` and ``imag`` of the eigenvalue (1/s)
    and ``mass_x, mass_y, mass_z``, the effective masses along the inertial axes (kg). Where one of
    them grows, a warning says that the state is unstable.

    The columns of the probes in the state about which the modes are, displacements and strains of a
    steady rotation for example, are in the outcome and the summary (``state``). Pictures of an
    equilibrium with its displacements and strains are in the folder ``equilibrium``.

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
    comm = comm or MPI.COMM_WORLD
    with guarded(options, comm) as faults:
        point = OperatingPoint(model, options, comm)
        point.check_count("ModeOptions", options.modes)
        status = point.settle(options.spin)
        found = modes_at(point, options) if status is Status.OK else None
        state = {} if found is None else point.columns()
        refuse(faults, comm)
        if options.output is not None:
            remove_summary(options.output / "summary.json", comm)
        if found is not None:
            point.cautions.say(growth_warnings(point.described, [found.growth], _GROWING))
        history = _write(point, options, found)
        summary = point.summary(case, _reason(point, status, options, found))
        return _ended(summary, options, results, comm, found, state, history)


def _ended(
    summary: dict[str, Any], options: ModeOptions, results: Results | None, comm: MPI.Intracomm,
    found: Modes | None, state: dict[str, float], history: dict[str, FloatArray],
) -> ModesOutcome:  # fmt: skip
    """Write the summary (collective)."""
    if found is not None:
        summary["checks"], summary["state"] = checks([found]), state
        summary["results"] = {
            f"frequency_{k + 1}": f for k, f in enumerate(found.frequencies.tolist())
        }
    ended = conclude(summary, history, results, options, comm)
    return ModesOutcome(
        ended.status, ended.summary, ended.history, ended.folder, found, state
    )  # fmt: skip


def modes_at(point: OperatingPoint, options: ModeOptions, more: int = 0) -> Modes:
    """Modes about the present state of an operating point (collective).

    An equilibrium is made more accurate by one step of Newton's method, about which the modes must
    have small residuals, too; otherwise they are computed again.

    Args:
        point: settled in a state, which is improved if it is an equilibrium.
        options: number of modes and accuracy.
        more: modes beyond those requested.

    """
    count = options.modes + more
    return settled_modes(point, count, 2.0 * np.pi * options.target, options.accuracy)


def settled_modes(point: OperatingPoint, count: int, target: float, accuracy: float) -> Modes:
    """Modes nearest to a target in rad/s, about an improved equilibrium (collective)."""
    for _ in range(_SETTLINGS):
        found = find(point.linearization, count, target, accuracy, point.improve)
        if not found.unsettled:
            break
    return found


def doubts(found: Modes, asked: int, accuracy: float | None = None) -> str:
    """Return faults of modes with advice; "ok" if there are none.

    Args:
        found: the modes.
        asked: number of modes requested.
        accuracy: of the options; None if there are no options of the search.
    """
    if found.failure:
        return with_hint(found.failure, modes_hint(Status.SINGULAR, 0.0))
    near = "" if accuracy is None else ", or give a target near them"
    if len(found) < asked:
        return with_hint(f"only {len(found)} of {asked} modes converged", _more(found, accuracy))
    if found.missing:
        return with_hint(
            f"{found.missing} modes in the range of the {asked} found were missed",
            f"request more modes{near}",
        )
    if not found.doubtful.any():
        return "ok" if not found.unsettled else with_hint(
            f"the error of the equilibrium moves modes by up to {found.state_error:.1e}",
            f"request fewer modes{'' if accuracy is None else ', or a larger accuracy'}",
        )  # fmt: skip
    worst = float(found.residuals.max())
    if worst == np.inf:
        return with_hint(
            "no mode that was found differs from zero",
            "take a state in which something is stiff, such as one with taut cables",
        )
    text = f"{int(found.doubtful.sum())} of {asked} modes have residuals up to {worst:.1e}"
    if accuracy is None:
        return with_hint(text, "request fewer modes")
    taken = f"; accuracy {worst:.1g} accepts them" if worst < _COARSE else ""
    return with_hint(
        f"{text}, more than accuracy {accuracy:g}", f"request fewer modes{near}{taken}"
    )


def _more(found: Modes, accuracy: float | None) -> str:
    """Return advice where fewer modes were found than requested, see :func:`doubts`."""
    if found.crowd == np.inf:
        finer = " or a larger accuracy" if accuracy is not None and accuracy < _FINE else ""
        near = "" if accuracy is None else ", or give a target near them"
        return f"request fewer modes{finer}{near}"
    ways = [f"request {len(found)}"] if len(found) else []
    if accuracy is not None:
        ways.append("give a target near modes that oscillate")
    ways.append("take less damping")
    return (
        f"stiff motions that damping keeps from oscillating all decay at about {found.crowd:.3g} "
        f"1/s, before further modes: {', or '.join(ways)}"
    )


def _reason(
    point: OperatingPoint, status: Status, options: ModeOptions, found: Modes | None
) -> str:  # fmt: skip
    if found is None:
        what = "steady rotation" if options.spin else "equilibrium"
        text = f"{point.failure(status)} in the search for the {what}"
        hint = modes_hint(status, options.spin, bool(point.system.contacts))
        return with_hint(text, hint)
    return doubts(found, options.modes, options.accuracy)


def growth_warnings(state: str, growths: Sequence[FloatArray], advice: str) -> list[str]:
    """Warning of modes that grow, which would pass for rigid motions where they do not oscillate.

    Args:
        state: words for the state, or the states, about which the modes are.
        growths: rates of the modes of each state, 1/s, zero for those that do not grow.
        advice: last words.
    """
    worst = max(growths, key=lambda rates: float(rates.max(initial=0.0)), default=np.empty(0))
    count = int(np.count_nonzero(worst))
    if not count:
        return []
    many = f"{count} of {len(worst)} modes grow{'s' if count == 1 else ''}"
    return [f"{state} is unstable: {many}, the fastest by exp({worst.max():.4g} 1/s t); {advice}"]


def checks(found: Sequence[Modes]) -> dict[str, Any]:
    """Return the summary's entries on checks of modes, the worst of one or more states."""
    counted = all(modes.missing is not None for modes in found)
    errors = [modes.state_error for modes in found if modes.state_error is not None]
    return {
        "largest_residual": max(float(modes.residuals.max(initial=0.0)) for modes in found),
        "state_error": max(errors, default=None),
        "missing": sum(modes.missing or 0 for modes in found) if counted else None,
        "not_counted": next((modes.uncounted for modes in found if modes.uncounted), None),
        "zero_below": max(modes.zero_below for modes in found) / (2.0 * np.pi),
    }


def _picture(point: OperatingPoint, folder: Path) -> None:
    """Write the fields of the present state (collective)."""
    fields = FieldOutput(folder, point.system, point.serial)
    fields.write(0.0, 0)
    fields.close()


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
        with current().files():
            for number, row in zip(numbers, table, strict=True):
                writer.write(float(number), row)
            writer.close()
        if options.frames > 0 and agreed(current(), system.comm) is None:
            shapes = [point.linearization.split(shape) for shape in found.shapes]
            with current().files():
                if point.is_equilibrium:
                    _picture(point, options.output / "equilibrium")
                write_modes(
                    options.output, system, point.serial, shapes, found.frequencies,
                    options.amplitude, options.frames,
                )  # fmt: skip
    if system.comm.rank != 0:
        return {}
    return {"t": numbers} | dict(zip(_COLUMNS, table.T.copy(), strict=True))
