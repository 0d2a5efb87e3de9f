# SPDX-License-Identifier: LGPL-3.0-or-later
"""Identification of parameters of a model from measured columns of its history."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._types import BoolArray, FloatArray
from flexfem.analyses.dynamics import RunOptions
from flexfem.gradients.gradient import SOLVED, made_of
from flexfem.gradients.motion.arrays import Known, directions_of, influence_of
from flexfem.gradients.motion.exactness import linearized
from flexfem.gradients.motion.parameters import (
    Build,
    Values,
    check_build,
    check_function,
    check_names,
    checked_values,
    flat,
    limits_of,
    named,
    plain,
    scales,
)
from flexfem.gradients.motion.records import Storage
from flexfem.gradients.motion.runs import forward
from flexfem.gradients.motion.support import check_columns
from flexfem.gradients.motion.trajectory import Motion

__all__ = ["Identification", "identify"]


#: Singular values of the derivatives over the largest, below which they are errors, and the part of
#: a parameter in such directions from which on it is not told.
_SEEN, _PART = SOLVED, 1e-6
#: Deviations of measurements in a fit that advances, over the root of the mean square of what is
#: left over: motions of wrong parameters differ as much from their linearisation.
_SHARE = 0.5
#: Takes what is known after a motion, by name.
Report = Callable[[Mapping[str, float]], None]
#: What is known of parameters before, by name: their means and standard deviations.
Prior = Mapping[str, tuple[npt.ArrayLike, npt.ArrayLike]]


@dataclass(frozen=True)
class Identification:
    """Parameters that fit measurements best, and how well they are known.

    Attributes:
        values: parameters, numbers or arrays (n,).
        errors: their standard errors, of the same shapes: from the noise that is given, or that
            left over; infinite for those of which the measurements do not tell.
        covariance: (n, n) of all numbers, in the order of the parameters.
        noise: root of the mean square of the differences left over, in units of the noise that is
            given, those of parameters from their prior means among them.
        motions: number of motions that were computed.
        history: of every motion: its end ``t_end``, s; what is ``left``, as ``noise`` of it; and
            the largest ``change`` of a parameter since the one before, in units of its scale.
        success: True if the method has converged.
        message: its own words.
        warnings: which parameters the measurements do not tell.
    """

    values: Mapping[str, float | FloatArray]
    errors: Mapping[str, float | FloatArray]
    covariance: FloatArray = field(repr=False)
    noise: float
    motions: int
    success: bool
    message: str
    history: Sequence[Mapping[str, float]] = field(default=(), repr=False)
    warnings: tuple[str, ...] = ()

    def interval(self, name: str, share: float = 0.95) -> tuple[npt.NDArray, npt.NDArray]:
        """Confidence interval of a parameter, least and largest value of each of its numbers.

        Args:
            name: of the parameter.
            share: probability that it holds the value, if noise is normal and small.
        """
        from scipy.stats import norm

        half = float(norm.ppf(0.5 + 0.5 * share)) * np.asarray(self.errors[name])
        return np.asarray(self.values[name]) - half, np.asarray(self.values[name]) + half


def identify(
    build: Build,
    measured: Mapping[str, npt.ArrayLike],
    start: Mapping[str, npt.ArrayLike],
    options: RunOptions,
    *,
    noise: Mapping[str, float] | None = None,
    prior: Prior | None = None,
    bounds: Mapping[str, tuple[float | None, float | None]] | None = None,
    scale: Mapping[str, npt.ArrayLike] | None = None,
    advance: float | None = None,
    most: int = 30,
    tolerance: float = 1e-10,
    report: Report | None = None,
    comm: MPI.Intracomm | None = None,
) -> Identification:
    """Fit parameters of a model to measured columns by least squares (collective).

    The method is that of Levenberg and Marquardt as ``scipy.optimize.least_squares`` has it, with
    the derivatives of all columns from the linearised motion: one solve of it for each number, and
    no difference of motions. Standard errors are those of the linearised problem.

    Long motions have wrong minima: an echo, an oscillation or a bounce comes too early or late by
    more than it lasts. With ``advance`` the first motion is as short, and each further one by as
    much longer than the one before (as of Pires, Vautard, Talagrand 1996), with a step of Gauss and
    Newton in all parameters after each. Measurements count in it with deviations of a share of
    what is left over, where that is more than their noise, so that the prior holds what they do not
    tell yet (the iteratively regularised method of Bakushinskii 1992). The fit to all goes on from
    there.

    Args:
        build: model of the parameters' values.
        measured: values of columns of a :class:`Probe`, one for each row of the history; NaN where
            there is none, which does not count. Samples at other times are to be interpolated.
        start: values of all parameters to begin with, numbers or arrays (n,).
        options: of the motions.
        noise: standard deviations of the measurements of each column. Without them they are
            estimated, as equal in all columns, from the differences left over.
        prior: mean and standard deviation of parameters by name, numbers or arrays (n,), as they
            are known before: measurements of the parameters themselves, which keep in place what
            the columns do not tell. It needs ``noise``, to be weighed against.
        bounds: least and largest value of parameters by name, None for none.
        scale: changes of parameters that are alike; their sizes at the start by default.
        advance: time by which motions become longer, s; all have the same length by default. It
            needs a prior of all parameters, and steps of equal size.
        most: largest number of motions.
        tolerance: relative changes at which the method ends.
        report: called on all ranks with the row of the history after each motion.
        comm: communicator, all ranks by default.

    Raises:
        InputError, TypeError, ValueError: as :func:`gradient`; measurements do not fit the history;
            a column without any; a prior without noise, of a name that is no parameter, or of
            another shape; an advance without prior of all, with bounds, with adaptive steps, or
            shorter than a step.
        StoppedError: a motion failed.
    """
    _checks.instance("identify", "options", options, RunOptions)
    values = checked_values(start)
    check_build("identify", build, values)
    if report is not None:
        check_function("identify", "report", report)
    _checks.count("identify", "most", most, 1)
    _checks.number("identify", "tolerance", tolerance, positive=True)
    problem = _Fit(build, _columns(measured), values, options, comm)
    problem.report = report
    problem.noise = _noises(measured, noise or {})
    if prior and noise is None:
        raise ValueError("identify: a prior needs noise, the deviations of the measurements")
    problem.prior = _priors(values, prior or {})
    problem.scale = flat(values, scales("identify", values, scale or {}))
    if advance is not None:
        known = bool((problem.prior[1] > 0.0).all())
        _checks.number("identify", "an advance", advance)
        _check_advance(advance, options, prior=known, bounds=bool(bounds))
        problem.advance(advance, (most, tolerance))
    return problem.solved(bounds or {}, (most, tolerance), known=noise is not None)


class _Fit:
    """Differences of a motion from measurements, with their derivatives."""

    noise: Mapping[str, float]
    prior: tuple[FloatArray, FloatArray]
    scale: FloatArray
    report: Report | None = None

    def __init__(
        self, build: Build, measured: Mapping[str, FloatArray], values: Values,
        options: RunOptions, comm: MPI.Intracomm | None,
    ) -> None:  # fmt: skip
        self._build, self._options, self._comm = build, options, comm
        self._start, self._measured = values, measured
        self._last: tuple[bytes, FloatArray, FloatArray] | None = None
        self._known: Known = {}
        self.history: list[Mapping[str, float]] = []
        #: Scaled parameters of the last motion.
        self.before: FloatArray | None = None

    def solved(
        self, bounds: Mapping[str, tuple[float | None, float | None]],
        limits: tuple[int, float], *, known: bool,
    ) -> Identification:  # fmt: skip
        """Call the method."""
        from scipy.optimize import OptimizeResult, least_squares

        most, tolerance = limits
        begin = flat(self._start, self._start) / self.scale
        most, between = max(most - len(self.history), 1), self._bounds(bounds)
        if self._of(begin)[1].any():
            found = least_squares(
                lambda x: self._of(x)[0], begin, jac=lambda x: self._of(x)[1], max_nfev=most,
                bounds=between, ftol=tolerance, xtol=tolerance, gtol=None,
            )  # fmt: skip
        else:  # SciPy would divide by zero
            untold = "the measurements do not change with any parameter"
            found = OptimizeResult(x=begin, success=False, message=untold)
        differences, jacobian = self._of(found.x)
        left = _left(differences, len(begin))
        covariance, told = _covariance(jacobian)
        covariance *= (1.0 if known else left**2) * np.outer(self.scale, self.scale)
        covariance[np.diag(~told)] = np.inf
        roots = self._named(np.sqrt(np.diag(covariance)) / self.scale)
        unknown = named(self._start, np.where(told, 0.0, 1.0))
        return Identification(
            plain(self._named(found.x)), plain(roots), covariance, left, len(self.history),
            bool(found.success), str(found.message), tuple(self.history),
            tuple(_untold(name, own) for name, own in unknown.items() if own.any()),
        )  # fmt: skip

    def advance(self, time: float, limits: tuple[int, float]) -> None:
        """Move the start by steps with longer and longer motions, to the whole one (collective)."""
        rows = self._rows_of_steps()
        first = min(int(np.flatnonzero(np.isfinite(x))[0]) for x in self._measured.values())
        growth, end, change = round(time / self._options.dt), max(first - 1, 0), np.inf
        while end < rows - 1 or change > limits[1] ** 0.5:
            if len(self.history) >= limits[0] - 1:
                return
            end = min(end + growth, rows - 1)
            begin = flat(self._start, self._start) / self.scale
            part = self if end == rows - 1 else self._until(end)
            differences, jacobian = part._of(begin)
            self.before = begin
            seen = len(differences) - np.count_nonzero(self.prior[1])
            left = _SHARE * float(np.sqrt(np.mean(differences[:seen] ** 2)))
            weights = np.where(np.arange(len(differences)) < seen, 1.0 / max(left, 1.0), 1.0)
            step = np.linalg.lstsq(
                weights[:, np.newaxis] * jacobian, -weights * differences, rcond=None
            )[0]
            change = float(np.abs(step).max())
            self._start = self._named(begin + step)

    def _rows_of_steps(self) -> int:
        """Number of rows of the whole motion.

        Raises:
            ValueError: a column has another number of values.
        """
        rows = max(1, round(self._options.t_end / self._options.dt)) + 1
        for name, column in self._measured.items():
            _check_rows(name, rows, column.size)
        return rows

    def _until(self, end: int) -> _Fit:
        """The same with the motion up to a row."""
        step = self._options.t_end / (self._rows_of_steps() - 1)
        options = replace(self._options, dt=step, t_end=end * step)
        measured = {name: column[: end + 1] for name, column in self._measured.items()}
        part = _Fit(self._build, measured, self._start, options, self._comm)
        part.noise, part.prior, part.scale = self.noise, self.prior, self.scale
        part.report, part.history, part.before = self.report, self.history, self.before
        return part

    def _bounds(
        self, given: Mapping[str, tuple[float | None, float | None]]
    ) -> tuple[FloatArray, FloatArray]:
        """Least and largest value of each scaled number.

        Raises:
            ValueError: a name is no parameter, or a value is outside at the start.
        """
        limits = limits_of("identify", self._start, given)
        low, high = (
            flat(self._start, {name: own[k] for name, own in limits.items()}) / self.scale
            for k in range(2)
        )
        return low, high

    def _of(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Differences (k,) over noise, and derivatives (k, n) by scaled numbers (collective)."""
        key = np.ascontiguousarray(x).tobytes()
        if self._last is not None and self._last[0] == key:
            return self._last[1:]
        values, names = self._named(x), list(self._measured)
        made = made_of(self._build, values)
        check_columns(made, names)
        motion = Motion(made, self._options, self._comm, Storage(), names)
        influences = [
            influence_of(motion, self._build, values, name, self._known) for name in values
        ]
        directions = [[(own, 1.0)] for one in influences for own in directions_of(motion, one)]
        changes = forward(motion, linearized(motion, SOLVED), names, directions)
        columns = motion.on_all_ranks(motion.history())
        differences, rows = [], []
        for k, (name, wanted) in enumerate(self._measured.items()):
            _check_rows(name, len(columns[name]), len(wanted))
            seen = np.isfinite(wanted)
            differences.append((columns[name] - wanted)[seen] / self.noise[name])
            rows.append(changes[:, seen, k].T * self.scale / self.noise[name])
        means, weights = self.prior
        known = weights > 0.0
        differences.append((weights * (x * self.scale - means))[known])
        rows.append(np.diag(weights * self.scale)[known])
        self._last = key, np.concatenate(differences), np.concatenate(rows)
        self._record(x)
        return self._last[1:]

    def _record(self, x: FloatArray) -> None:
        """Add a row to the history, and report it (collective)."""
        assert self._last is not None
        change = 0.0 if self.before is None else float(np.abs(x - self.before).max())
        self.before = np.array(x)
        left = _left(self._last[1], len(x))
        self.history.append({"t_end": self._options.t_end, "left": left, "change": change})
        if self.report is not None:
            self.report(self.history[-1])

    def _named(self, x: FloatArray) -> Values:
        """Values by name of scaled numbers."""
        return named(self._start, np.asarray(x) * self.scale)


def _check_advance(time: float, options: RunOptions, *, prior: bool, bounds: bool) -> None:
    """Check that a fit may advance.

    Raises:
        ValueError: it may not.
    """
    if not options.dt <= time < np.inf:
        raise ValueError(f"identify: an advance must be a step at least, got {time}")
    if not prior:
        raise ValueError("identify: an advance needs a prior of every parameter")
    if bounds or options.adaptive:
        raise ValueError("identify: an advance takes neither bounds nor adaptive steps")


def _columns(measured: Mapping[str, npt.ArrayLike]) -> dict[str, FloatArray]:
    """Measured values (n,) by column, NaN where there is none.

    Raises:
        TypeError, ValueError: there is no column, or one without values or with others.
    """
    _checks.instance("identify", "measured", measured, Mapping)
    if not measured:
        raise ValueError("identify: give measured values of a column at least")
    found = {}
    for name, given in measured.items():
        try:
            own = np.array(given, dtype=np.float64).reshape(-1)
        except (TypeError, ValueError):
            own = np.array([np.inf])
        if np.isinf(own).any() or np.isnan(own).all():
            raise ValueError(
                f"identify: measured values of {name} must be finite numbers, NaN where there is "
                f"none, one at least, got {_checks.show(given)}"
            )
        found[name] = own
    return found


def _check_rows(name: str, rows: int, given: int) -> None:
    """Raise ValueError unless a column has a value for each row of the history."""
    if rows != given:
        raise ValueError(f"identify: {name} has {rows} rows, got {given} values")


def _left(differences: FloatArray, parameters: int) -> float:
    """Root of the mean square of what so many parameters leave over."""
    free = max(len(differences) - parameters, 1)
    return float(np.sqrt(differences @ differences / free))


def _covariance(jacobian: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Covariance (n, n) for unit noise, and (n,) which numbers the measurements tell."""
    count = jacobian.shape[1]
    padded = np.vstack([jacobian, np.zeros((max(count - len(jacobian), 0), count))])
    _, sizes, directions = np.linalg.svd(padded, full_matrices=False)
    seen = sizes > _SEEN * sizes.max(initial=0.0)
    scaled = directions[seen] / sizes[seen, np.newaxis]
    return scaled.T @ scaled, (directions[~seen] ** 2).sum(axis=0) <= _PART


def _untold(name: str, unknown: FloatArray) -> str:
    """Warning of a parameter, or of some of its numbers."""
    which = "" if unknown.ndim == 0 else f"[{', '.join(map(str, np.flatnonzero(unknown)))}]"
    return (
        f'identify: the measurements do not tell "{name}"{which}, or only together with others; '
        "measure more, or leave them out"
    )


def _noises(measured: Mapping[str, npt.ArrayLike], given: Mapping[str, float]) -> dict[str, float]:
    """Standard deviations by column.

    Raises:
        TypeError, ValueError: a column is not measured, or a deviation is no positive number.
    """
    _checks.instance("identify", "noise", given, Mapping)
    for name, value in given.items():
        if name not in measured:
            raise ValueError(f'identify: noise names "{name}", which is not measured')
        _checks.number("identify", f"noise of {name}", value, positive=True)
    return {name: float(given.get(name, 1.0)) for name in measured}


def _priors(start: Values, given: Prior) -> tuple[FloatArray, FloatArray]:
    """Prior means of all numbers, and one over their deviations, 0 without a prior.

    Raises:
        ValueError: a name is no parameter, or values have another shape or are not admissible.
    """
    means = {name: np.zeros(value.shape) for name, value in start.items()}
    deviations = {name: np.full(value.shape, np.inf) for name, value in start.items()}
    check_names("identify", "prior", start, given)
    for name, pair in given.items():
        try:
            mean, deviation = (np.array(one, dtype=np.float64) for one in pair)
        except (TypeError, ValueError):
            raise ValueError(
                f"identify: prior of {name} must be a mean and a deviation, got "
                f"{_checks.show(pair)}"
            ) from None
        shape = means[name].shape
        if not {mean.shape, deviation.shape} <= {(), shape}:
            raise ValueError(f"identify: prior of {name} must be numbers or have the shape {shape}")
        if not (np.isfinite(mean).all() and (deviation > 0.0).all()):
            raise ValueError(
                f"identify: prior of {name} must have finite means and positive deviations"
            )
        means[name][...], deviations[name][...] = mean, deviation
    return flat(start, means), 1.0 / flat(start, deviations)
