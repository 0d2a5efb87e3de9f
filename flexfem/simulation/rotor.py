# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modes of a rotor on a support over its speed, in multiblade coordinates."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray, IntArray
from flexfem.analyses.modes import RotorOptions
from flexfem.model.model import Model
from flexfem.simulation.equilibria.rotor_point import RotorPoint
from flexfem.simulation.modes import doubts, modes_at
from flexfem.simulation.run.failure_reasons import with_hint
from flexfem.simulation.run.guard import guarded
from flexfem.simulation.run.outcome import Outcome, Results
from flexfem.simulation.speed_sweep import SpeedSweep
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
    inflow, are left out; a warning names the speeds at which any mode grows. ``torque`` (N m) is
    that of a drive on the first body which keeps the speed, positive about the axis, ``variation``
    the change of forces with the azimuth, relative to the largest. The columns of the probes come
    last.

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
        FunctionError: a function of the model failed at a later speed than the first; the speeds
            before are written (a RuntimeError).
        OSError: the results cannot be written.
        KeyboardInterrupt: SIGINT, SIGTERM or SIGHUP came; the speeds so far are written.
    """
    _checks.instance("sweep_rotor", "options", options, RotorOptions)
    comm = comm or MPI.COMM_WORLD
    with guarded(options, comm) as faults:
        point = RotorPoint(model, options, comm)
        point.check_count("RotorOptions", options.modes)
        return _RotorSweep(point, options).run(faults, case, results, comm)


class _RotorSweep(SpeedSweep):
    """Modes that oscillate at all speeds, with the shares of their energies."""

    point: RotorPoint
    options: RotorOptions
    growing = (
        "columns of those kept have a negative damping there, and those that do not oscillate have "
        "none"
    )

    def __init__(self, point: RotorPoint, options: RotorOptions) -> None:
        """See :class:`SpeedSweep`."""
        super().__init__(point, options)
        self._parts = list[FloatArray]()

    def found(self) -> Modes:
        """See :meth:`SpeedSweep.found`: enough beside those of states."""
        point, options = self.point, self.options
        states = point.system.comm.allreduce(point.linearization.states.count)
        more = min(options.modes + states + 2, point.freedoms - options.modes)
        return modes_at(point, options, more)

    def chosen(self, modes: Modes) -> Modes:
        """See :meth:`SpeedSweep.chosen`: those that oscillate, without those of states."""
        values = modes.eigenvalues
        moving = np.flatnonzero(np.abs(values.imag) > _STILL * np.abs(values))
        taken = _nearest(values[moving], self.point.linearization.eigenvalues_of_states())
        return modes.some(np.delete(moving, taken))

    def required(self, modes: Modes) -> int:
        """See :meth:`SpeedSweep.required`."""
        return self.options.modes

    def keep(self, speed: float, modes: Modes) -> dict[str, float]:
        """See :meth:`SpeedSweep.keep`."""
        self._parts.append(shares(modes))
        return {"torque": self.point.torque, "variation": self.point.variation}

    def finish(self) -> dict[str, float | None]:
        """See :meth:`SpeedSweep.finish`: eigenvalues at another azimuth of the rotor."""
        values = self.modes[-1].eigenvalues[: self.options.modes]
        self.point.rotate()
        other = self.chosen(self.found())
        if other.failure:
            if self.reason == "ok":
                self.reason = f"at another azimuth {doubts(other, self.options.modes)}"
            return {"azimuth": None}
        gaps = np.abs(other.eigenvalues[:, np.newaxis] - values).min(axis=0, initial=np.inf)
        change = float((gaps / np.abs(values)).max(initial=0.0))
        if change > self.options.variation and self.reason == "ok":
            self.reason = with_hint(
                f"eigenvalues change by {change:.1e} with the azimuth of the rotor",
                "bodies that rotate must have the symmetry of the blades",
            )
        return {"azimuth": change}

    def table(self) -> tuple[list[str], FloatArray]:
        """See :meth:`SpeedSweep.table`."""
        found = self.modes
        numbers = follow(found, len(found[-1]))
        order = np.argsort(found[-1].frequencies, kind="stable")
        table = np.full((len(found), len(order), len(_VALUES)), np.nan)
        for k, (modes, number, parts) in enumerate(zip(found, numbers, self._parts, strict=True)):
            for i in np.flatnonzero(number >= 0):
                j = number[i]
                table[k, i] = modes.frequencies[j], modes.damping[j], *parts[j, : len(_VALUES) - 2]
        whole = np.isfinite(table[:, :, 0]).all(axis=0)
        order = np.concatenate([order[whole[order]], order[~whole[order]]])[: self.options.modes]
        order = order[np.argsort(table[-1, order, 0], kind="stable")]
        self._tell(np.setdiff1d(np.flatnonzero(~whole), order), table[:, :, 0], order)
        names = _names(self._parts[-1][order])
        columns = [f"{name}_{value}" for name in names for value in _VALUES]
        states = np.array([list(state.values()) for state in self.states])
        values = table[:, order].reshape(len(found), -1)
        return [*columns, *self.states[0]], np.hstack([values, states])

    def _tell(self, left: IntArray, frequencies: FloatArray, taken: IntArray) -> None:
        """Warn of modes that are left out, though they are lower than others of the table."""
        last = frequencies[-1]
        lower = np.sort(last[left][last[left] < last[taken].max(initial=0.0)])
        if len(lower):
            values = ", ".join(f"{value:.4g}" for value in lower)
            self.point.cautions.say([
                f"modes of {values} Hz at {self.speeds[-1]:g} rad/s could not be followed to all "
                "speeds and are left out: take more speeds, unless they do not oscillate at others"
            ])  # fmt: skip


def _nearest(values: ComplexArray, others: ComplexArray) -> list[int]:
    """The values nearest to others, each of which has its own; pairs of least distance first."""
    gaps = np.abs(values[:, np.newaxis] - others) / np.abs(others)
    found: list[int] = []
    while gaps.size and gaps.min() < _NEAR:
        i, j = np.unravel_index(int(np.argmin(gaps)), gaps.shape)
        found.append(int(i))
        gaps[i], gaps[:, j] = np.inf, np.inf
    return found


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
