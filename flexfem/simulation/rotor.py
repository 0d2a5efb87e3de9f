# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modes of a rotor on a support over its speed, in multiblade coordinates."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from mpi4py import MPI

import numpy as np

from flexfem import _checks
from flexfem._faults import current
from flexfem._types import FloatArray, IntArray
from flexfem.analyses.modes import RotorOptions
from flexfem.core.status import Status
from flexfem.io.summary import remove_summary
from flexfem.io.tables.history import HistoryWriter
from flexfem.model.model import Model
from flexfem.simulation.equilibria.rotor_point import RotorPoint
from flexfem.simulation.modes import checks, doubts, modes_at
from flexfem.simulation.run.failure_reasons import modes_hint, with_hint
from flexfem.simulation.run.guard import agreed, guarded, refuse
from flexfem.simulation.run.outcome import Outcome, Results, conclude
from flexfem.solvers.modal.mode_errors import ComplexArray
from flexfem.solvers.modal.mode_shapes import Modes
from flexfem.solvers.modal.multiblade_shares import SHARES, shares
from flexfem.solvers.modal.tracking import follow

__all__ = ["sweep_rotor"]

#: Part of the modulus of an eigenvalue below which its imaginary part is no oscillation.
_STILL = 1e-6
#: Distance, relative, within which a mode is one of states of forces alone.
_NEAR = 0.3
_VALUES = ("frequency", "damping", "support", "drive", "collective", "forward", "backward")


def sweep_rotor(
    model: Model, options: RotorOptions, *, case: str = "model", results: Results | None = None,
    comm: MPI.Intracomm | None = None,
) -> Outcome:  # fmt: skip
    """Follow modes of a rotor on a support over its speed and write them (collective).

    A rotor of three or more identical blades rotates about an axis of a support that does not: a
    wind turbine, a helicopter. At every speed the steady state is found, deflected by the loads,
    and the equations are linearised about it, with the derivatives of all forces. In multiblade
    coordinates (Coleman and Feingold 1958) they are constant in time, and frequencies are those in
    fixed axes.

    The history has one row for each speed; its first column ``t`` is the speed (rad/s). Every
    oscillating mode has seven columns: ``<mode>_frequency`` (Hz), ``<mode>_damping`` (ratio) and
    the shares of its kinetic energy: ``_support`` of the motion that the rotor makes as a rigid
    body with its first body, ``_drive`` of the rigid rotation about the axis, ``_collective``,
    ``_forward`` and ``_backward`` of the blades relative to it. The largest at the last speed gives
    the mode's name, with ``flap`` for motions of the blades along the axis and ``edge`` across it,
    ``fore_aft`` and ``side_side`` for those of the support; ``other`` are modes of four and more
    blades without a force on the support. Modes of the states of forces alone, such as those of an
    inflow, are left out. ``torque`` (N m) is that of a drive on the first body
    which keeps the speed, positive about the axis, ``variation`` the change of forces with the
    azimuth, relative to the largest. The columns of the probes come last.

    Args:
        model: the model, the same on every rank.
        options: blades, speeds, number of modes, output folder and so on.
        case: name for the summary.
        results: function of the history's columns that returns the headline results.
        comm: communicator, all ranks by default.

    Returns:
        The outcome, the same status on every rank; speeds before one that fails are kept.

    Raises:
        InputError: a mistake in the model or the options, blades that are not alike, or forces that
            depend on the azimuth.
        TypeError: the options are those of another analysis.
        OSError: the results cannot be written.
    """
    _checks.instance("sweep_rotor", "options", options, RotorOptions)
    comm = comm or MPI.COMM_WORLD
    with guarded(options, comm) as faults:
        point = RotorPoint(model, options, comm)
        point.check_count("RotorOptions", options.modes)
        sweep = _sweep(point, options)
        if not sweep.speeds:
            refuse(faults, comm)
        columns, table = _table(sweep, options.modes)
        with faults.files():
            _write(options, columns, sweep.speeds, table, comm)
        history: dict[str, FloatArray] = {}
        if comm.rank == 0 and sweep.speeds:
            history = {"t": np.array(sweep.speeds)}
            history |= dict(zip(columns, table.T.copy(), strict=True))
        summary = point.summary(case, sweep.reason)
        if sweep.speeds:
            summary["checks"] = checks([modes.first(options.modes) for modes in sweep.modes])
            summary["checks"] |= {"azimuth": sweep.azimuth}
        return conclude(summary, history, results, options, comm)


def _write(
    options: RotorOptions, columns: list[str], speeds: list[float], table: FloatArray,
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
    """Results at the speeds reached, and how the sweep ended.

    Attributes:
        azimuth: relative change of eigenvalues at another azimuth, at the last speed.
    """

    speeds: list[float] = field(default_factory=list)
    modes: list[Modes] = field(default_factory=list)
    parts: list[FloatArray] = field(default_factory=list)
    states: list[dict[str, float]] = field(default_factory=list)
    reason: str = "ok"
    azimuth: float = 0.0


def _sweep(point: RotorPoint, options: RotorOptions) -> _Sweep:
    """Modes at all speeds in order (collective)."""
    sweep = _Sweep()
    for speed in np.linspace(options.spin, options.spin_end, options.speeds).tolist():
        failure = _step(point, options, speed, sweep)
        if failure:
            sweep.reason = failure
            return sweep
    sweep.azimuth = _change_with_azimuth(point, options, sweep.modes[-1])
    if sweep.azimuth > options.variation and sweep.reason == "ok":
        sweep.reason = with_hint(
            f"eigenvalues change by {sweep.azimuth:.1e} with the azimuth of the rotor",
            "bodies that rotate must have the symmetry of the blades",
        )
    return sweep


def _step(point: RotorPoint, options: RotorOptions, speed: float, sweep: _Sweep) -> str:
    """Add the results at a speed; the reason of a failure, else empty (collective)."""
    status = point.settle(speed)
    state = point.columns() if status is Status.OK else {}
    if error := agreed(current(), point.system.comm):  # a user-defined function
        return f"{error} at the speed {speed:.6g} rad/s"
    if status is not Status.OK:
        text = f"{point.failure(status)} at the speed {speed:.6g} rad/s"
        return with_hint(text, modes_hint(status, speed))
    modes = _oscillating(point, options)
    if len(modes) == 0:
        return f"no mode that oscillates was found at the speed {speed:.6g} rad/s"
    doubt = doubts(modes.first(options.modes), options.modes, options.accuracy)
    if doubt != "ok" and sweep.reason == "ok":
        sweep.reason = f"at the speed {speed:.6g} rad/s {doubt}"
    sweep.speeds.append(speed)
    sweep.modes.append(modes)
    sweep.parts.append(shares(modes))
    sweep.states.append({"torque": point.torque, "variation": point.variation} | state)
    return ""


def _oscillating(point: RotorPoint, options: RotorOptions) -> Modes:
    """Modes nearest to the target that oscillate, without those of states alone (collective)."""
    states = point.system.comm.allreduce(point.linearization.states.count)
    more = min(options.modes + states + 2, point.freedoms - options.modes)
    found = modes_at(point, options, more)
    values = found.eigenvalues
    chosen = np.flatnonzero(np.abs(values.imag) > _STILL * np.abs(values))
    taken = _nearest(values[chosen], point.linearization.eigenvalues_of_states())
    return _of(found, np.delete(chosen, taken))


def _nearest(values: ComplexArray, others: ComplexArray) -> list[int]:
    """The values nearest to others, each of which has its own; pairs of least distance first."""
    gaps = np.abs(values[:, np.newaxis] - others) / np.abs(others)
    found: list[int] = []
    while gaps.size and gaps.min() < _NEAR:
        i, j = np.unravel_index(int(np.argmin(gaps)), gaps.shape)
        found.append(int(i))
        gaps[i], gaps[:, j] = np.inf, np.inf
    return found


def _of(modes: Modes, chosen: IntArray) -> Modes:
    """Some of the modes."""
    return replace(
        modes, eigenvalues=modes.eigenvalues[chosen], shapes=modes.shapes[chosen],
        momenta=modes.momenta[chosen], masses=modes.masses[chosen],
        residuals=modes.residuals[chosen], doubtful=modes.doubtful[chosen],
    )  # fmt: skip


def _change_with_azimuth(point: RotorPoint, options: RotorOptions, modes: Modes) -> float:
    """Relative change of the first eigenvalues at another azimuth (collective)."""
    values = modes.eigenvalues[: options.modes]
    point.rotate()
    other = _oscillating(point, options).eigenvalues
    gaps = np.abs(other[:, np.newaxis] - values).min(axis=0, initial=np.inf)
    return float((gaps / np.abs(values)).max(initial=0.0))


def _table(sweep: _Sweep, count: int) -> tuple[list[str], FloatArray]:
    """Names of the columns, and one row for each speed."""
    if not sweep.speeds:
        return ["torque"], np.zeros((0, 1))
    numbers = follow(sweep.modes, len(sweep.modes[-1]))
    order = np.argsort(sweep.modes[-1].frequencies, kind="stable")
    table = np.full((len(sweep.speeds), len(order), len(_VALUES)), np.nan)
    for k, (modes, number, parts) in enumerate(zip(sweep.modes, numbers, sweep.parts, strict=True)):
        for i in np.flatnonzero(number >= 0):
            j = number[i]
            table[k, i] = modes.frequencies[j], modes.damping[j], *parts[j, : len(_VALUES) - 2]
    whole = np.isfinite(table[:, order, 0]).all(axis=0)
    order = np.concatenate([order[whole], order[~whole]])[:count]
    order = order[np.argsort(table[-1, order, 0], kind="stable")]
    names = _names(sweep.parts[-1][order])
    columns = [f"{name}_{value}" for name in names for value in _VALUES]
    states = np.array([list(state.values()) for state in sweep.states])
    values = table[:, order].reshape(len(sweep.speeds), -1)
    return [*columns, *sweep.states[0]], np.hstack([values, states])


def _names(parts: FloatArray) -> list[str]:
    """Names of modes by their largest shares, and by the motion of the blades or the support."""
    names: list[str] = []
    kinds = [SHARES[k] for k in np.argmax(parts[:, : len(SHARES)], axis=1)]
    for kind, (flap, fore_aft) in zip(kinds, parts[:, len(SHARES) :], strict=True):
        name = kind
        if kind == "support":
            name = "fore_aft" if fore_aft > 0.5 else "side_side"
        elif kind != "drive":
            name = f"{kind}_{'flap' if flap > 0.5 else 'edge'}"
        names.append(f"{name}_{1 + sum(one.rpartition('_')[0] == name for one in names)}")
    return names
