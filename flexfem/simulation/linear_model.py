# SPDX-License-Identifier: LGPL-3.0-or-later
"""A linear model of small motions: state matrices from loads and drives to probes."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace

from mpi4py import MPI

import numpy as np

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.analyses.modes import LinearOptions
from flexfem.core.status import Status
from flexfem.io.state_space import write_arrays
from flexfem.model.model import Model
from flexfem.model.probes.base import Probe
from flexfem.model.probes.measured import ShellStrainProbe, StrainProbe
from flexfem.simulation.equilibria.operating_point import OperatingPoint
from flexfem.simulation.modes import doubts, growth_warnings, settled_modes
from flexfem.simulation.run.failure_reasons import modes_hint, with_hint
from flexfem.solvers.modal.mode_shapes import ComplexArray, find
from flexfem.solvers.modal.reduced_equations import Reduction, reduce_equations
from flexfem.system.measure.probe_rates import probe_rates
from flexfem.system.measure.strain_rates import strain_rates

__all__ = ["LARGEST", "LinearModel", "linearize", "output_names", "output_rates"]

#: Number of unknowns up to which a model may keep all degrees of freedom.
LARGEST = 600
_ACCURACY = 1e-10
#: Number of the lowest modes whose growth is told where no modes are requested.
_WATCHED = 20
#: Probes whose columns are outputs of a linear model.
_LINEAR = Probe, StrainProbe, ShellStrainProbe


@dataclass(frozen=True, repr=False)
class LinearModel:
    """``x' = A x + B u, y = y0 + C x + D u``, the same on every rank.

    The state holds the reduced coordinates, those of the drives, the rates of both, and the states
    of force elements. The inputs
    are changes of the loads' amplitudes, forces of the actuators (N or N m), and accelerations of
    the drives (the second derivative of the rows' targets, m/s^2 or rad/s^2: no state space has an
    input that acts through its derivatives). The outputs are the columns of the probes of markers
    and of strains, in the order of the model; energies, momenta, joint forces and contacts are left
    out.

    Attributes:
        A, B, C, D: (n, n), (n, m), (p, n), (p, m).
        inputs, outputs: names; a drive with several rows has one input ``<joint>_<row>`` for each.
        y0: (p,) outputs in the state about which the model is linearised.
        status: "ok"; or the reason why there is no such state, or no mode, with empty arrays; or
            the fault of the modes, with a warning and arrays of the motions of those found.
        state_error: relative change of the modes of the reduction by one more step towards the
            equilibrium; None without modes and about a given state.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    y0: FloatArray
    status: str = "ok"
    state_error: float | None = None

    def __repr__(self) -> str:
        """Status, size and names."""
        count, inputs, outputs = len(self.A), ", ".join(self.inputs), ", ".join(self.outputs)
        return f"LinearModel({self.status!r}, {count} states, inputs {inputs}; outputs {outputs})"

    @property
    def poles(self) -> ComplexArray:
        """Eigenvalues of A by modulus, 1/s."""
        values: ComplexArray = np.linalg.eigvals(self.A).astype(np.complex128)
        return values[np.argsort(np.abs(values), kind="stable")]


def linearize(
    model: Model, options: LinearOptions | None = None, comm: MPI.Intracomm | None = None
) -> LinearModel:
    """Linearise a model about a state (collective); writes ``linear_model.npz``.

    In a steady rotation the coordinates rotate with the model, while probes are those of the
    instant at which the model has its initial orientation. A warning on stderr says that the state
    is unstable, if a mode of the reduction grows; of all degrees of freedom one of the lowest.

    Args:
        model: the model, the same on every rank.
        options: the state, the reduction, the output folder.
        comm: communicator, all ranks by default.

    Raises:
        InputError: a mistake in the model, or too large a model without reduction.
        TypeError: the options are those of another analysis.
        OSError: the file cannot be written.
    """
    options = options or LinearOptions()
    _checks.instance("linearize", "options", options, LinearOptions)
    point = OperatingPoint(model, options, comm)
    if options.modes == 0 and point.system.unknowns > LARGEST:
        raise InputError(
            f"LinearOptions: give modes for {model!r} with {point.system.unknowns} > "
            f"{LARGEST} unknowns"
        )
    point.check_count("LinearOptions", options.modes)
    status = point.settle(options.spin)
    outputs = output_names(model)
    if status is not Status.OK:
        hint = modes_hint(status, options.spin, bool(point.system.contacts))
        return _nothing(outputs, with_hint(point.failure(status), hint))
    shapes, reason, error = None, "ok", None
    if options.modes == 0:
        found = find(point.linearization, min(point.freedoms, _WATCHED), 0.0, _ACCURACY)
    else:
        found = settled_modes(point, options.modes, 0.0, _ACCURACY)
        shapes, reason = found.shapes, doubts(found, options.modes)
        error = found.state_error
        if len(found) == 0:
            return _nothing(outputs, reason)
        if reason != "ok" and point.system.comm.rank == 0:
            warnings.warn(f"linearize: {reason}", RuntimeWarning, stacklevel=2)
    point.cautions.say(growth_warnings(point.described, [found.growth], "poles have the rates"))
    reduction = reduce_equations(point.linearization, len(model.loads), shapes)
    matrices = output_rates(model, point, reduction.basis)
    linear = replace(_assemble(model, reduction, outputs, *matrices, reason), state_error=error)
    if options.output is not None:
        arrays = {name: getattr(linear, name) for name in ("A", "B", "C", "D", "y0")}
        names = {"inputs": np.array(linear.inputs), "outputs": np.array(linear.outputs)}
        write_arrays(options.output / "linear_model.npz", arrays | names, point.system.comm)
    return linear


def _nothing(outputs: tuple[str, ...], status: str) -> LinearModel:
    none = np.zeros((0, 0))
    return LinearModel(none, none, none, none, (), outputs, np.zeros(0), status)


def output_names(model: Model) -> tuple[str, ...]:
    """Columns of probes that are outputs of a linear model."""
    return tuple(c for p in model.probes if isinstance(p, _LINEAR) for c in p.columns)


def output_rates(
    model: Model, point: OperatingPoint, motions: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Outputs (p,) and their derivatives (p, k) by k motions and by their rates (collective).

    Args:
        model: the model.
        point: in its state.
        motions: (k, n_local) local twists of this rank's nodes.
    """
    given = point.system, point.serial, point.linearization.split, motions
    strains, by_shape = strain_rates(*given)
    values, by_q, by_rate = probe_rates(*given)
    both = np.concatenate([values, strains])
    probes = [p for p in model.probes if isinstance(p, _LINEAR)]
    of_markers = [isinstance(p, Probe) for p in probes for _ in p.columns]
    markers = np.array(of_markers, dtype=np.bool_)
    order = np.empty(len(both), dtype=np.int64)
    order[markers], order[~markers] = np.split(np.arange(len(both)), [len(values)])
    by_rate = np.vstack([by_rate, np.zeros_like(by_shape)])
    return both[order], np.vstack([by_q, by_shape])[order], by_rate[order]


def _assemble(
    model: Model, reduction: Reduction, outputs: tuple[str, ...], y0: FloatArray,
    by_position: FloatArray, by_velocity: FloatArray, status: str,
) -> LinearModel:  # fmt: skip
    """State matrices from ``u = T q + S s`` with the drives' coordinates s, ``s'' = input``."""
    r = reduction
    n, drives, states = len(r.mass), r.drives, len(r.state_damping)
    loads = r.loads.shape[1]
    count = n + drives
    moving, last = slice(count, count + n), slice(2 * count, None)
    free = np.linalg.solve(r.mass, np.hstack([-r.stiffness, -r.damping, r.loads, -r.driven_mass]))
    widths = np.cumsum([count, states, count, loads])
    stiffness, by_state, damping, load, inertia = np.split(free, widths, axis=1)
    A = np.zeros((2 * count + states, 2 * count + states))
    A[:count, count : 2 * count] = np.eye(count)
    A[moving] = np.hstack([stiffness, damping, by_state])
    by_place, by_state = np.split(-r.state_stiffness, [count], axis=1)
    A[last] = np.hstack([by_place, -r.state_damping, by_state])
    B = np.zeros((len(A), loads + drives))
    B[moving] = np.hstack([load, inertia])
    B[count + n : 2 * count, loads:] = np.eye(drives)
    inputs = (*(load.name for load in model.loads), *r.actuators, *r.names)
    C = np.hstack([by_position, by_velocity, np.zeros((len(by_position), states))])
    return LinearModel(A, B, C, np.zeros((len(C), loads + drives)), inputs, outputs, y0, status)
