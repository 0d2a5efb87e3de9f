# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time derivatives of driven rows, from values of the drives around an instant.

Drives are user-defined functions, which are differentiated numerically: centrally, to fourth order,
where they are smooth. Stencils that cross a kink are excluded as in weighted essentially
non-oscillatory schemes (Liu, Osher, Chan, J. Comput. Phys. 115 (1994) 200-212): instead of the
central one a backward and a forward one are then used, each weighted by its smoothness. Where
accelerations jump at the instant itself it is their mean.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from flexfem._types import BoolArray, FloatArray
from flexfem.constraints.batch import Constraints

__all__ = ["DriveRates", "drive_rates"]

#: Instants at which drives are evaluated, in spans; the one in the middle is that of interest.
_PLACES = np.arange(-3.0, 4.0)
#: Weights of the values there for derivatives: backward, central, forward.
_FIRST_BACKWARD = np.array([-2.0, 9.0, -18.0, 11.0, 0.0, 0.0, 0.0]) / 6.0
_FIRST_CENTRAL = np.array([0.0, 1.0, -8.0, 0.0, 8.0, -1.0, 0.0]) / 12.0
_FIRST = np.array([_FIRST_BACKWARD, _FIRST_CENTRAL, -_FIRST_BACKWARD[::-1]])
_SECOND_BACKWARD = np.array([-1.0, 4.0, -5.0, 2.0, 0.0, 0.0, 0.0])
_SECOND_CENTRAL = np.array([0.0, -1.0, 16.0, -30.0, 16.0, -1.0, 0.0]) / 12.0
_SECOND = np.array([_SECOND_BACKWARD, _SECOND_CENTRAL, _SECOND_BACKWARD[::-1]])
#: Selections of the instants to be evaluated: all, or those of one stencil.
_AROUND, _BEHIND, _AHEAD = slice(0, 7), slice(0, 4), slice(3, 7)
#: Ratio of fourth to third differences that indicates a kink, unless the third are below a part of
#: the second ones; ratio of third to second differences below which a side is smooth.
_KINK, _STRAIGHT, _SMOOTH = 0.25, 2e-2, 0.2
#: Exponent of the decrease of shares.
_POWER = 8
#: Rows are evaluated as they are, not as part of a time step.
_UNSCALED = np.array([1.0, 1.0])


#: No instants, and no weights.
_NEVER = np.empty(0), np.empty((0, 0)), np.empty((0, 0))


@dataclass(frozen=True)
class DriveRates:
    """Derivatives of rows by time at fixed positions.

    Attributes:
        time: the instant, s.
        first, second: (r,) derivatives of the values.
        turning: (r,) True for rows whose gradients depend on time.
        times, weights: (k,) instants, s, and (r, k) weights for further first derivatives; second
            ones have weights_again.
    """

    time: float
    first: FloatArray
    second: FloatArray
    turning: BoolArray
    times: FloatArray
    weights: FloatArray
    weights_again: FloatArray

    def of_rates(self, rows: Constraints) -> FloatArray:
        """(r,) derivatives by time of the rates of the rows at the interface's velocities."""
        out = np.zeros(rows.size)
        if not self.turning.any():
            return out
        for t, weight in zip(self.times.tolist(), self.weights.T, strict=True):
            rows.set_drives(t)
            rows.evaluate(_UNSCALED)
            out += weight * rows.rates()
        rows.set_drives(self.time)
        rows.evaluate(_UNSCALED)
        return out * self.turning


def drive_rates(rows: Constraints, t: float, span: float, end: float) -> DriveRates:
    """Differentiate the drives at time ``t`` (s) over multiples of ``span`` (s).

    They are evaluated between 0 and ``end`` (s) only, or after ``t`` if that is too short.
    """
    if not rows.driven:
        return _at_rest(rows, t)
    chosen = _AROUND
    if t + span * _PLACES[-1] > end:
        chosen = _BEHIND
    if t + span * _PLACES[0] < 0.0:
        chosen = _AHEAD
    times = t + span * _PLACES[chosen]
    values, turning = _sample(rows, t, times)
    if not (values.any() or turning.any()):
        return _at_rest(rows, t)
    if chosen is _AROUND:
        shares = _shares(values)
    else:
        shares = np.zeros((rows.size, 3))
        shares[:, 0 if chosen is _BEHIND else 2] = 1.0
    first, second = (shares @ weights for weights in _stencils(chosen.start, chosen.stop, span))
    by_time, twice = (np.einsum("rk,kr->r", w, values) for w in (first, second))
    return DriveRates(t, by_time, twice, turning, times, first, second)


def _at_rest(rows: Constraints, t: float) -> DriveRates:
    """Derivatives of drives that do not change around the instant."""
    nothing = np.zeros(rows.size)
    return DriveRates(t, nothing, nothing, nothing > 0.0, *_NEVER)


@lru_cache(maxsize=8)
def _stencils(start: int, stop: int, span: float) -> tuple[FloatArray, FloatArray]:
    """Weights (3, k) of the chosen instants for first and second derivatives."""
    return _FIRST[:, start:stop] / span, _SECOND[:, start:stop] / span**2


def _sample(rows: Constraints, t: float, times: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Values (k, r) of the rows at the given times less those at ``t``, and rows that rotate.

    For those that do not rotate it is minus their targets, without the rounding of positions.
    """
    targets, turning = rows.drives_at(times.tolist())
    own: FloatArray = -targets
    if turning.any():
        for values, time in zip(own, times.tolist(), strict=True):
            rows.set_drives(time)
            rows.evaluate(_UNSCALED)
            values[turning] = rows.values[turning]
        rows.set_drives(t)
    at = times.searchsorted(t)
    rows.targets[:] = targets[at]
    own -= own[at].copy()
    return own, turning


def _shares(values: FloatArray) -> FloatArray:
    """Shares (r, 3) of the stencils for values (7, r)."""
    second = _differences(_differences(values))
    third = _differences(second)
    size, jerk, jump = (np.maximum.reduce(np.abs(d)) for d in (second, third, _differences(third)))
    size[size == 0.0] = 1.0
    kink = jump / np.maximum(jerk, _STRAIGHT * size)
    central = 1.0 / (1.0 + (kink / _KINK) ** _POWER)
    sides = np.maximum(np.abs(third[[0, 3]]) / size, _SMOOTH) ** -_POWER
    behind, ahead = (1.0 - central) * sides / sides.sum(axis=0)
    return np.stack([behind, central, ahead], axis=1)


def _differences(values: FloatArray) -> FloatArray:
    """Differences (k - 1, r) of consecutive values (k, r), without the checks of ``numpy.diff``."""
    change: FloatArray = values[1:] - values[:-1]
    return change
