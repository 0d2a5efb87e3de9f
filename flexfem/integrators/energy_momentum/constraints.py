# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rows of this rank in the energy-momentum scheme.

Rigid rows are satisfied at the end of the step. The force of a spring is ``k`` times the mean of
its values at both ends, which is the change of its energy divided by that of its value; dampers use
the mean rate, and applied forces are means as well. Forces of stops, slack springs and functions
that store energy are the same quotients (``constraints.rows.step_laws``), without numerical
dissipation.
"""

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray, IntArray
from flexfem.constraints.batch import Constraints
from flexfem.constraints.rows.kernels import marker_poses
from flexfem.constraints.rows.step_laws import step_forces
from flexfem.core.differences import STENCIL
from flexfem.core.laws import STORING_FUNCTIONS, LawKind
from flexfem.core.row import RowKind
from flexfem.integrators.energy_momentum.point_rows import StepPointRows, other_lines
from flexfem.integrators.energy_momentum.rows import (
    StepTerms,
    add_step_hessians,
    at_start,
    evaluate_step,
    exchanged,
)

__all__ = ["StepRows"]

#: Laws whose energy is no quadratic form.
_QUOTIENTS = (LawKind.LIMIT, *STORING_FUNCTIONS)
_SUPPORTED = (LawKind.RIGID, LawKind.SPRING, *_QUOTIENTS)
#: Relative difference of values at the start.
_SIZE = 1e-3


class StepRows:
    """Rows between two states; every evaluation writes the arrays of :class:`Constraints`."""

    def __init__(self, rows: Constraints, chi: float) -> None:
        """Prepare the work space; ``chi`` is the numerical dissipation (collective).

        Raises:
            InputError: a row has a law without an energy; the joint is named on all ranks.
        """
        _check_laws(rows)
        self._rows, self._chi = rows, chi
        markers, terms = len(rows.marker_node), len(rows.kinds)
        frames, poses = rows.interface.frames, rows.poses
        self._step = StepTerms(
            frames0=np.zeros_like(frames), frames=frames, poses0=np.zeros((markers, 12)),
            poses=poses, values0=np.zeros(terms), values=np.zeros(terms),
            gradient=np.zeros((terms, 2, 6)),
        )  # fmt: skip
        # the derivative at the end is the discrete one of a step of size zero
        self._end = StepTerms(
            frames0=frames, frames=frames, poses0=poses, poses=poses, values0=np.zeros(terms),
            values=np.zeros(terms), gradient=rows.step_jacobian,
        )  # fmt: skip
        self._back, self._start = exchanged(self._step), at_start(self._step)
        self._points = StepPointRows(rows) if rows.lines.joints else None
        self._targets0, self._last = rows.targets.copy(), np.zeros(rows.size)
        self._values0, self._values = np.zeros(rows.size), np.zeros(rows.size)
        quotients = np.isin(rows.elastic[:, 0], _QUOTIENTS)
        self._quotients: IntArray = np.flatnonzero(quotients).astype(np.int64)
        self._laws0 = self._laws()  # at the start of the step
        self._h = self._weight = self._memory = 1.0
        # derivatives of the changes over the last step by its end, None for the gradient there,
        # and by its start, or by local velocities at the start of a motion
        self._over_last: tuple[FloatArray | None, FloatArray] = None, rows.step_jacobian

    def begin(self, h: float, weight: float, last_h: float) -> None:
        """Start a step of size ``h`` after one of ``last_h`` (s, infinite for none).

        ``weight`` scales the multipliers.
        """
        rows, face = self._rows, self._rows.interface
        self._h, self._weight = h, weight
        self._step.frames0[:] = face.frames
        marker_poses(rows.own.memory, self._step.frames0, self._step.poses0)
        if self._points is not None:
            self._points.begin()
        self._memory = min(1.0, h / last_h)
        if not np.isfinite(last_h):
            self.evaluate()
            self._last[:], self._memory = h * rows.rates(), 1.0
            if self._chi > 0.0:
                slopes = np.tile([0.0, h], (rows.size, 1))
                by_place = rows.rate_changes(slopes, 0.0, held=True)
                self._over_last = by_place, h * rows.force_jacobian

    def resume(self, last: float) -> None:
        """Begin a step of size ``last``, s, again that was the last one."""
        self.begin(last, 1.0, last)
        if self._chi > 0.0:
            self._over_last = None, -self._start_gradient()

    def accept(self) -> None:
        """Store the data of the trial state for the next step."""
        self.evaluate()
        self._last[:] = self._values - self._values0
        self.renewed()

    def renewed(self) -> None:
        """Store drives and laws at the accepted state, which are those behind a jump there."""
        self._targets0[:] = self._rows.targets
        self._laws0[:] = self._laws()

    def _laws(self) -> FloatArray:
        """Stiffness, damping and applied force (3, r) of all rows at their state.

        Stops and slack springs have a limit in place of the force, which may be infinite.
        """
        found = self._rows.elastic[:, 1:4].T.copy()
        found[2, self._quotients] = 0.0
        return found

    def state(self) -> dict[str, FloatArray]:
        """State carried from one step to the next, (r,) each."""
        return {
            "last_changes": self._last,
            "last_targets": self._targets0,
            "last_stiffness": self._laws0[0],
            "last_damping": self._laws0[1],
            "last_applied": self._laws0[2],
        }

    def _sums(self, terms: FloatArray) -> FloatArray:
        rows = self._rows
        return np.bincount(rows.row_of_term, rows.factors * terms, minlength=rows.size)

    def evaluate(self) -> None:
        """Values, gradients and compliances of all rows at the interface's state."""
        rows, step = self._rows, self._step
        factors = rows.factors[:, np.newaxis, np.newaxis]
        marker_poses(rows.own.memory, step.frames, step.poses)
        evaluate_step(rows.own.memory, self._end.memory)
        rows.step_jacobian *= factors
        evaluate_step(rows.own.memory, step.memory)
        np.multiply(step.gradient, factors, out=rows.force_jacobian)
        self._values0, self._values = self._sums(step.values0), self._sums(step.values)
        if self._points is not None:
            self._points.evaluate()
            self._values0 += self._points.values0
            self._values += self._points.values
        rows.hold_gradients()
        rows.values[:] = self._values - rows.targets - rows.relaxation * rows.multipliers
        rows.compliance[:] = rows.relaxation
        rows.coupling[:] = 0.0
        if not rows.rigid.all():
            self._forces()

    def _forces(self) -> None:
        """Evaluate the equations ``scale (F - L / weight) = 0`` of rows with laws or zero force."""
        rows, chi, h = self._rows, self._chi, self._h
        k, c, applied = 0.5 * (self._laws0 + rows.elastic[:, 1:4].T)
        change = self._values - self._values0
        moved = np.where(rows.target_rates != 0.0, rows.targets - self._targets0, 0.0)
        rate = (change - moved) / h
        mean = 0.5 * (self._values + self._values0 - rows.targets - self._targets0)
        force = k * (mean + 0.5 * chi * (change - self._memory * self._last)) + c * rate
        force += applied
        slope = 0.5 * (1.0 + chi) * k + c / h
        if len(self._quotients):
            found = self._quotient_forces(self._values0 - self._targets0, rate)
            force[self._quotients], slope[self._quotients] = found.T
        scale = 1.0 / (1.0 / self._weight + np.abs(slope))
        scale, slope, force = (
            np.where(rows.active, one, free)
            for one, free in ((scale, self._weight), (slope, 0.0), (force, 0.0))
        )
        free = ~rows.rigid
        rows.values[free] = (scale * (force - rows.multipliers / self._weight))[free]
        rows.compliance[free] = scale[free] / self._weight
        rows.step_jacobian *= np.where(free, scale * slope, 1.0)[rows.row_of_term, None, None]

    def _quotient_forces(self, values0: FloatArray, rate: FloatArray) -> FloatArray:
        """Forces and slopes (k, 2) of laws whose energy is no quadratic form.

        Args:
            values0: (r,) values at the start, less the targets there.
            rate: (r,) mean rates.
        """
        rows, found = self._rows, np.zeros((len(self._quotients), 2))
        values = self._values - rows.targets
        step_forces(rows.own.memory, self._quotients, values0, values, rate, self._h, found)
        return found

    def hessians(self, factor: FloatArray) -> FloatArray:
        """``sum_rows factor d(gradient)`` along local twists of the nodes, (n_pairs, 12, 12)."""
        return self._hessians(factor, self._step, by_start=False)

    def start_hessians(self, factor: FloatArray) -> FloatArray:
        """The same in the axes at the start, along local twists of the nodes there.

        The rows have been evaluated.
        """
        evaluate_step(self._rows.own.memory, self._back.memory)
        return self._hessians(factor, self._back, by_start=True)

    def _hessians(self, factor: FloatArray, step: StepTerms, *, by_start: bool) -> FloatArray:
        rows = self._rows
        out = np.zeros((len(rows.pair_nodes), 12, 12))
        factors = factor[rows.row_of_term] * rows.factors
        add_step_hessians(rows.own.memory, step.memory, factors, out)
        if self._points is not None:
            self._points.add_hessians(factor, out, by_start=by_start)
        rows.hold_hessians(out)
        return out

    def start_jacobian(self) -> FloatArray:
        """Derivatives (t, 2, 6) of the equations along local twists at the start of the step.

        The rows have been evaluated. What is left of the last step counts as given.
        """
        rows = self._rows
        return self._start_gradient() * self._start_slopes()[rows.row_of_term, None, None]

    def _start_gradient(self) -> FloatArray:
        """Derivatives (t, 2, 6) of all terms at the start of the step, by twists there."""
        rows = self._rows
        evaluate_step(rows.own.memory, self._start.memory)
        found = self._start.gradient * rows.factors[:, np.newaxis, np.newaxis]
        if self._points is not None:
            self._points.write_start(found)
        rows.hold_gradient(found)
        return found

    def by_last(self) -> tuple[FloatArray, FloatArray]:
        """Derivatives (t, 2, 6) of the equations by changes of rows over the last step.

        The rows have been evaluated.

        Returns:
            By twists at the start of this step, and by those at the start of the last one; in the
            first step of a motion by local velocities.
        """
        rows = self._rows
        k, _, _ = 0.5 * (self._laws0 + rows.elastic[:, 1:4].T)
        slopes = -0.5 * self._chi * self._memory * k * rows.compliance * self._weight
        slopes[rows.rigid | ~rows.active] = slopes[self._quotients] = 0.0
        first, last = self._over_last
        factors = slopes[rows.row_of_term, np.newaxis, np.newaxis]
        if first is None:
            first = self._start_gradient()
        return factors * first, factors * last

    def _start_slopes(self) -> FloatArray:
        """Derivatives (r,) of the equations by values at the start."""
        rows, h = self._rows, self._h
        k, c, _ = 0.5 * (self._laws0 + rows.elastic[:, 1:4].T)
        slope = 0.5 * (1.0 - self._chi) * k - c / h
        if len(self._quotients):
            values0, change = self._values0 - self._targets0, self._values - self._values0
            moved = np.where(rows.target_rates != 0.0, rows.targets - self._targets0, 0.0)
            size = _SIZE * np.maximum(np.abs(change), np.abs(values0))
            own, total = self._quotients, np.zeros((len(self._quotients), 2))
            for part, weight in STENCIL:
                by = part * size
                total += weight * self._quotient_forces(values0 + by, (change - moved - by) / h)
            slope[own] = np.divide(total[:, 0], size[own], where=size[own] > 0.0,
                                   out=np.zeros(len(own)))  # fmt: skip
        scale = rows.compliance * self._weight
        found: FloatArray = np.where(rows.rigid | ~rows.active, 0.0, scale * slope)
        return found


def _check_laws(rows: Constraints) -> None:
    laws = np.unique(rows.joint_of_row[~np.isin(rows.elastic[:, 0], _SUPPORTED)]).tolist()
    found = [(i, "friction and functions of forces") for i in laws]
    functions = np.unique(rows.joint_of_row[rows.row_of_term[rows.kinds >= RowKind.FUNCTION]])
    found += [(i, "functions as constraints") for i in functions.tolist()]
    spans = np.isin(rows.kinds, (RowKind.SPAN, RowKind.TOUCH, RowKind.CATENARY))
    sheaves = np.unique(rows.joint_of_row[rows.row_of_term[spans]])
    found += [(i, "sheaves and hanging cables") for i in sheaves.tolist()]
    found += [
        (i, "markers on lines, or on surfaces for joints that need axes") for i in other_lines(rows)
    ]
    named = [(rows.joints[i].index, rows.joints[i].joint.owner, what) for i, what in found]
    everywhere = min((one for part in rows.comm.allgather(named) for one in part), default=None)
    if everywhere is not None:
        _, owner, what = everywhere
        raise InputError(f"{owner}: the integrator energy_momentum does not support {what}")
